"""The ground at one parameter vector: moduli and yield laws of its materials, each made once."""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.law import YieldLaw, YieldPlanes
from geoident.fem.yielding.polyhedral import PolyhedralLaw
from geoident.fem.yielding.principal import PrincipalLaw
from geoident.forward.ground.elasticity import elasticity
from geoident.forward.yielding.surfaces import is_smooth, yield_planes
from geoident.model.case import Case
from geoident.model.dual import Dual, ParameterPoint


class GroundAt:
    """Moduli and yield laws of all materials of a case, with their derivatives.

    A law keeps the active sets that it meets, so one serves a whole march.

    Args:
        case: the case.
        point: the parameters; all derivatives are by its names.
        n_strain: number s of strain components of the analysis.
    """

    def __init__(self, case: Case, point: ParameterPoint, n_strain: int) -> None:
        self.n_strain = n_strain
        self._case = case
        self._point = point
        self._elasticities: dict[str, Dual] = {}
        self._planes: dict[str, YieldPlanes] = {}
        self._laws: dict[str, YieldLaw | None] = {}

    def elasticity(self, material: str) -> Dual:
        """E (s, s) of a material, Pa."""
        if material not in self._elasticities:
            elastic, s = self._case.materials[material].elastic, self.n_strain
            full = elasticity(elastic, self._point, section=s < 6)
            self._elasticities[material] = Dual(np.ascontiguousarray(full.columns[:s, :s]))
        return self._elasticities[material]

    def yield_planes(self) -> dict[str, YieldPlanes]:
        """The planes of every material of the case that yields."""
        if not self._planes:
            self._planes = {
                name: yield_planes(material, self._point, self.n_strain)
                for name, material in self._case.materials.items()
                if material.yields
            }
        return self._planes

    def yield_law(self, material: str) -> YieldLaw | None:
        """The law of a material, or None if it does not yield.

        Raises:
            EmptyDomain: no stress satisfies the planes of a smooth surface.
        """
        if material not in self._laws:
            planes, elasticity = self.yield_planes().get(material), self.elasticity(material)
            if planes is None:
                self._laws[material] = None
            elif is_smooth(self._case.materials[material]):
                self._laws[material] = PrincipalLaw(elasticity, planes)
            else:
                self._laws[material] = PolyhedralLaw(elasticity, planes)
        return self._laws[material]
