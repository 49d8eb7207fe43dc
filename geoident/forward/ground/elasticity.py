"""From the numbers of a case to elastic moduli with exact derivatives by the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from geoident.fem import elasticity as formulas
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import (
    Anisotropic,
    Attitude,
    Elastic,
    Frame,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    bounded,
    breach,
    constants,
)
from geoident.model.parameter import Values

_FORMULAS: Mapping[type, Callable[[formulas.Constants], Dual]] = {
    Isotropic: formulas.isotropic,
    TransverselyIsotropic: formulas.transversely_isotropic,
    LoveModuli: formulas.love,
    Orthotropic: formulas.orthotropic,
    Anisotropic: formulas.anisotropic,
}


def elasticity(elastic: Elastic, point: ParameterPoint, *, section: bool) -> Dual:
    """E (6, 6) in the axes of the model, or of a plane section, Pa.

    Args:
        elastic: symmetry, constants and axes.
        point: the parameters.
        section: the model is a plane section, seen looking north.
    """
    numbers = {n: point.number(s) for n, s in constants(elastic).items()}
    return elasticity_of(elastic, numbers, point, section=section)


def elasticity_of(
    elastic: Elastic,
    numbers: formulas.Constants,
    point: ParameterPoint,
    *,
    section: bool,
    extra: int = 0,
) -> Dual:
    """E (6, 6), or (q, 6, 6) at several points, of constants that are given.

    Args:
        elastic: symmetry and axes.
        numbers: its constants, or (q, 1, 1) of them, with derivatives by n parameters and by
            ``extra`` things more.
        point: the n parameters.
        section: the model is a plane section, seen looking north.
        extra: number of further derivatives.
    """
    matrix = _FORMULAS[type(elastic)](numbers)
    frame: Frame | None = getattr(elastic, "frame", None)
    if frame is None:
        return matrix
    axes = material_axes(frame, point, section=section).columns
    wide = np.concatenate([axes, np.zeros((3, 3, extra))], axis=2)
    return formulas.turned(matrix, Dual(wide))


def material_axes(frame: Frame, point: ParameterPoint, *, section: bool) -> Dual:
    """Material axes 1, 2, 3 as columns (3, 3) in the axes of the model.

    Args:
        frame: attitude or vectors.
        point: the parameters.
        section: the model is a plane section, seen looking north.
    """
    if isinstance(frame, Attitude):
        dip, direction = point.number(frame.dip), point.number(frame.dip_direction)
        rotation = point.number(frame.rotation)
        return formulas.axes_of_attitude(dip, direction, rotation, section=section)
    axes = formulas.axes_of_vectors(np.array(frame.first), np.array(frame.second))
    return point.constant(axes)


def inadmissible(material: Material, values: Values) -> str | None:
    """Why moduli or strengths are none, a sentence, or None if they are."""
    breaches = (surface.breach(values) for surface in material.yields)
    elastic = bounded(material.elastic, material.growths)
    found = breach(elastic, values) or next(filter(None, breaches), None)
    if found is None:
        return None
    return f"{found.constant} of {material.name} is {found.shown}, {found.limit}"
