"""The yield surfaces of a material: built of their sections, and held against the material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from geoident.io.case.parameters import ParameterSection, start_values
from geoident.io.case.varied.number import fields_in
from geoident.io.case.yielding.sections import YieldSection, YieldSections
from geoident.io.schema.section import Context
from geoident.io.schema.values import Given
from geoident.model.ground import Elastic, Isotropic
from geoident.model.ground import Field as RandomField
from geoident.model.yielding import HoekBrown, YieldSurface


def build_yields(
    given: YieldSections | None,
    elastic: Elastic,
    parameters: Mapping[str, ParameterSection],
    context: Context,
) -> tuple[YieldSurface, ...]:
    """The yield surfaces of a material.

    What cannot be, as given or at the start of the parameters, is noted as a fault.

    Args:
        given: what stands under the key `yield`.
        elastic: elasticity of the material.
        parameters: the parameters of the case.
        context: of the key `yield`.
    """
    surfaces = []
    sections = _listed(given, context)
    for place, section in sections:
        surface = section.surface(place)
        surfaces.append(surface)
        _check_smooth(surface, elastic, place, alone=len(sections) == 1)
        _check_strengths(section, surface, parameters, place)
    return tuple(surfaces)


def fields_of_yields(
    given: YieldSections | None, context: Context, *, material: str
) -> tuple[RandomField, ...]:
    """The fields among the strengths of a material.

    Args:
        given: what stands under the key `yield`.
        context: of the key `yield`.
        material: its name.
    """
    return tuple(
        field
        for n, (place, section) in enumerate(_listed(given, context))
        for field in fields_in(
            section, place, material=material, surface=n, names={"strength": "cohesion"}
        )
    )


def _listed(
    given: YieldSections | None, context: Context
) -> Sequence[tuple[Context, YieldSection]]:
    """The sections under a key `yield`, each with its own place."""
    if given is None:
        return []
    if isinstance(given, list):
        return [(context.at(n), section) for n, section in enumerate(given)]
    return [(context, given)]


def _check_strengths(
    section: YieldSection,
    surface: YieldSurface,
    parameters: Mapping[str, ParameterSection],
    context: Context,
) -> None:
    """Note a strength that is inadmissible as given, or at the start of the parameters."""
    starts = start_values(section.numbers, parameters)
    found = None if starts is None else surface.breach(starts)
    if found is None:
        return
    key = section.key_of(found.constant)
    given: Given = getattr(section, key)
    message, hint = f"'{given.text}': {found.limit}", "Correct the number or its unit."
    if given.parameter is not None:
        message = f"'{given.text}' is {found.shown} at the start; {found.limit}"
        hint = f"Change the start of {given.parameter}."
    context.at(key).refuse("out-of-range", message, hint)


def _check_smooth(
    surface: YieldSurface, elastic: Elastic, context: Context, *, alone: bool
) -> None:
    """The smooth surface is a law of principal stresses, which go with no other directions."""
    if not surface.is_smooth:
        return
    hint = f"Add 'planes: {16 if context.dim == 2 else 96}' to it."
    if isinstance(surface, HoekBrown):
        hint = "Leave out the other, or describe it by planes of Mohr-Coulomb."
    if not alone:
        message = "a smooth surface cannot be combined with another one"
        context.refuse("smooth-surface", message, hint)
    elif not isinstance(elastic, Isotropic):
        message = "a smooth surface needs isotropic elasticity"
        context.refuse("smooth-surface", message, hint)
