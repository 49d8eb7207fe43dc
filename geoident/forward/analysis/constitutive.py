"""The ground of a stage at its strain points: stress and tangent at given strains (theory 5).

Materials are elastic, and where one yields its law brings the trial stress to the yield surface.
`ReachedPlanes` counts which planes the points of a stage reach. Nothing else in the analysis knows
of planes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoident.fem.elasticity import Moduli
from geoident.fem.yielding.law import ReturnStep, YieldLaw, YieldLimits
from geoident.fem.yielding.localisation import may_localise
from geoident.forward.stages import Index, numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.yielding import Activity


@dataclass(frozen=True)
class MaterialPoints:
    """The strain points of one material, with its moduli and its yield law there.

    Args:
        name: of the material.
        points: which they are.
        elasticity: E at these points.
        law: its yield law, or None.
        hardened: (y, m) multipliers of earlier stages at these points, or None.
        of_structure: they are members of a structure, with generalised strains.
        bends: they are parts of a beam, whose curvature times their length is a rotation.
    """

    name: str
    points: Index
    elasticity: Moduli
    law: YieldLaw | None = None
    hardened: Floats | None = None
    of_structure: bool = False
    bends: bool = False

    @property
    def associated(self) -> bool:
        """Whether its plastic strains, if it yields, follow the normals, so that Pi exists."""
        return self.law is None or self.law.associated

    @property
    def hardens(self) -> bool:
        """Whether multipliers of earlier stages count."""
        return self.law is not None and self.law.hardens

    def with_associated_flow(self) -> MaterialPoints:
        """The same with plastic strains that follow the normals."""
        return self if self.law is None else replace(self, law=self.law.with_associated_flow())

    def excess(self, stress: Floats) -> Floats:
        """The yield functions (y, m) of its law at stresses (s, m), Pa."""
        assert self.law is not None
        return self.law.excess(stress, self.hardened)

    def restrict(self, points: Ints, n_points: int) -> MaterialPoints | None:
        """Its part among some points (q,), ascending, numbered by them; None where there is none.

        Args:
            points: (q,) strain points of the mesh.
            n_points: number of them all.
        """
        own = numbers(self.points, n_points)
        _, rows, kept = np.intersect1d(own, points, assume_unique=True, return_indices=True)
        if not rows.size:
            return None
        law = None if self.law is None else self.law.at(rows)
        hardened = None if self.hardened is None else self.hardened[:, rows]
        elasticity = self.elasticity.at(rows)
        return MaterialPoints(
            self.name, kept, elasticity, law, hardened, self.of_structure, self.bends
        )

    def integrate_stress(
        self, stress: Floats, strain: Floats, viscosity: float
    ) -> PlasticResponse | None:
        """Bring stresses to the end of a step; the plastic response, None if it never yields.

        Args:
            stress: (s, m) of all points before the step; its own are overwritten.
            strain: (s, m) of the step.
            viscosity: part mu of the overstress s* - P(s*) that is kept (`viscous_path`); of
                structures none is, whose flow is associated and stable.

        Raises:
            NoReturn: non-associated flow leads back to no stress.
            NoProjection: a projection does not end.
        """
        points = self.points
        trial = stress[:, points] + self.elasticity.stress(strain[:, points])
        if self.law is None:
            stress[:, points] = trial
            return None
        if self.of_structure:
            viscosity = 0.0
        projection = self.law.project(trial, self.hardened)
        stress[:, points] = projection.stress
        if viscosity > 0.0:
            stress[:, points] += viscosity * (trial - projection.stress)
        flowing = numbers(points, stress.shape[1])[projection.yielded]
        return PlasticResponse(self, projection, flowing, viscosity)


@dataclass(frozen=True, eq=False)
class PlasticResponse:
    """What a material that yields does at the strains of a step.

    Args:
        ground: its strain points.
        projection: of their trial stresses.
        points: (q,) the strain points of the mesh with an active plane, ascending.
        viscosity: part mu of the overstress that is kept.
    """

    ground: MaterialPoints
    projection: ReturnStep
    points: Ints
    viscosity: float = 0.0

    @cached_property
    def tangent_change(self) -> Floats:
        """T E - E (q, s, s), with (1 - mu) T + mu in place of T."""
        T = self.projection.reduction
        return np.asarray((1.0 - self.viscosity) * (T - np.eye(T.shape[1])) @ self._moduli)

    def may_localise(self) -> Bools:
        """(q,) points at which shear of the ground without its viscosity may go into a band."""
        return may_localise(self.projection.reduction @ self._moduli)

    @property
    def _moduli(self) -> Floats:
        return self.ground.elasticity.matrices(self.projection.yielded)

    def derivatives(
        self, trial: Floats, earlier: Floats | None = None, *, of_law: bool
    ) -> tuple[Floats, Floats | None]:
        """Derivatives of stress (s, q, n) and multipliers (y, q, n), as in `ReturnStep`.

        Args:
            trial: (s, q, n) of the trial stress.
            earlier: (y, q, n) of the multipliers of earlier stages; None for zero.
            of_law: the first columns are by the parameters of the law.
        """
        stress, multipliers = self.projection.derivatives(trial, earlier, of_law=of_law)
        if self.viscosity > 0.0:
            stress = stress + self.viscosity * (trial - stress)
        return stress, multipliers


class ReachedPlanes:
    """Which yield planes the strain points of an analysis reach.

    Args:
        planes: of all materials and structures that yield, at the parameters of the analysis.
        stages: names of the stages.
    """

    def __init__(self, planes: Mapping[str, YieldLimits], stages: tuple[str, ...]) -> None:
        self._planes, self._stages = planes, stages
        ends = np.cumsum([0, *map(len, self._planes.values())])
        self._rows = {
            name: slice(int(first), int(last))
            for name, first, last in zip(self._planes, ends[:-1], ends[1:], strict=True)
        }
        shape = (int(ends[-1]), len(stages))
        self._points = np.zeros(shape, dtype=np.int64)
        self._biactive = np.zeros(shape, dtype=np.int64)
        self._margin = np.full(shape[0], -np.inf)

    def count(self, state: int, response: PlasticResponse) -> None:
        """Count the points of one material that are on its planes at the end of a state.

        Of a stage in time the most at the end of a part of a step.
        """
        place = self._rows[response.ground.name], state - 1
        for counts, now in (
            (self._points, response.projection.multipliers > 0.0),
            (self._biactive, response.projection.biactive),
        ):
            counts[place] = np.maximum(counts[place], now.sum(axis=0))

    def note_excess(self, material: str, excess: Floats) -> None:
        """Note the yield functions (y, m) of a material at the end of a state, Pa."""
        rows = self._rows[material]
        self._margin[rows] = np.maximum(self._margin[rows], excess.max(axis=1, initial=-np.inf))

    def activity(self) -> Activity:
        """Which planes were reached, with slopes by all parameters."""
        distances = np.concatenate([p.distances.columns for p in self._planes.values()])
        return Activity(
            planes=tuple(f"{m}: {name}" for m, p in self._planes.items() for name in p.names),
            stages=self._stages,
            points=self._points,
            biactive=self._biactive,
            distances=distances[:, 0].copy(),
            reached=distances[:, 0] + self._margin,
            slopes=distances[:, 1:].copy(),
        )
