"""From the numbers of a case to elastic moduli, with exact derivatives by the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from geoident.fem.elasticity import (
    Law,
    anisotropic_law,
    isotropic_law,
    love_law,
    orthotropic_law,
    strata_law,
    turned,
)
from geoident.fem.rotation import Turn, turn_of_attitude, turn_of_axes
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.ground import (
    Anisotropic,
    Attitude,
    Elastic,
    Frame,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    angles,
    breach,
    constants,
    numbers_of,
)
from geoident.model.yielding import yield_breach

Values = Mapping[str, float]
"""Parameter name to value, SI."""

_LAWS: Mapping[type, Callable[[Values], Law]] = {
    Isotropic: isotropic_law,
    TransverselyIsotropic: strata_law,
    LoveModuli: love_law,
    Orthotropic: orthotropic_law,
    Anisotropic: anisotropic_law,
}


def elasticity(material: Material, values: Values, n_strain: int) -> Floats:
    """E (n_strain, n_strain), Pa."""
    return law_of(material.elastic, values, section=n_strain < 6).matrix[:n_strain, :n_strain]


def elasticity_slopes(material: Material, values: Values, n_strain: int) -> dict[str, Floats]:
    """dE/dp (n_strain, n_strain) for every parameter on which the material's moduli depend."""
    if not any(scalar.parameter for scalar in numbers_of(material.elastic).values()):
        return {}
    law = law_of(material.elastic, values, section=n_strain < 6)
    slopes: dict[str, Floats] = {}
    for name, scalar in numbers_of(material.elastic).items():
        if scalar.parameter is not None:
            change = scalar.factor * law.slopes[name][:n_strain, :n_strain]
            slopes[scalar.parameter] = slopes.get(scalar.parameter, 0.0) + change
    return slopes


def inadmissible(material: Material, values: Values) -> str | None:
    """Why moduli or strengths are none, a sentence, or None if they are."""
    breaches = (yield_breach(surface, values) for surface in material.yields)
    found = breach(material.elastic, values) or next(filter(None, breaches), None)
    if found is None:
        return None
    return f"{found.constant} of {material.name} is {found.shown}, {found.limit}"


def affine_obstacle(material: Material, free: frozenset[str]) -> str | None:
    """Why the equations are not affine in the free parameters, or None if they are."""
    if material.yields:
        return f"{material.name} yields: its stresses are not linear in the displacements"
    elastic = material.elastic
    tied = {name: s.parameter for name, s in numbers_of(elastic).items() if s.parameter in free}
    for name in tied:
        if name.startswith("nu") or name in angles(elastic):
            remedy = " (K and G enter linearly)" if isinstance(elastic, Isotropic) else ""
            return f"{name} of {material.name} enters the stiffness nonlinearly{remedy}"
    young = [name for name in constants(elastic) if name.startswith("E")]
    # At fixed ratios between them the matrix grows in proportion to all Young's moduli.
    if tied.keys().isdisjoint(young) or len({tied.get(name) for name in young}) == 1:
        return None
    remedy = f"unless {', '.join(young)} are all tied to one parameter"
    if isinstance(elastic, TransverselyIsotropic):
        remedy += " (Love's A, C, F, L and N enter linearly)"
    first = next(name for name in young if name in tied)
    return f"{first} of {material.name} enters the stiffness nonlinearly {remedy}"


def law_of(elastic: Elastic, values: Values, *, section: bool) -> Law:
    """The law in the axes of the model, or of a plane section, with all six components."""
    law = _LAWS[type(elastic)]({n: s.value(values) for n, s in constants(elastic).items()})
    frame: Frame | None = getattr(elastic, "frame", None)
    return law if frame is None else turned(law, _turn(frame, values, section=section))


def _turn(frame: Frame, values: Values, *, section: bool) -> Turn:
    if isinstance(frame, Attitude):
        dip, direction = frame.dip.value(values), frame.dip_direction.value(values)
        return turn_of_attitude(dip, direction, frame.rotation.value(values), section=section)
    return turn_of_axes(np.array(frame.first), np.array(frame.second))
