"""The key `yield` of a material: one section per kind of yield surface, and what it is built into.

A surface is held against the elasticity of its material, and against the start of the parameters.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from math import hypot
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from geoident.io.case.frames import strata
from geoident.io.case.parameters import ParameterSection, numbers_at_start
from geoident.io.case.varied.number import FieldAngle, StrengthOrVaried, fields_in, growths_in
from geoident.io.schema.section import Alternatives, Context, Section, optional
from geoident.io.schema.values import (
    Angle,
    CaseNumber,
    Coefficient,
    Count,
    DirectionVector,
    Multiple,
    Name,
    Stress,
    scalar_of,
)
from geoident.model.ground import Elastic, Growth, Isotropic, RandomField
from geoident.model.parameter import Scalar
from geoident.model.yielding import (
    DruckerPrager,
    Fit,
    GivenPlanes,
    HardeningSoil,
    HoekBrown,
    MohrCoulomb,
    WeakPlane,
    YieldPlane,
    YieldSurface,
    bounded_surfaces,
)

_COMPONENTS = {2: ([0, 1, 3], [0, 1, 2, 3]), 3: ([0, 1, 2, 3, 4, 5],)}
_STRESSES = ("xx", "yy", "zz", "xy", "yz", "xz")
_ROUNDED = 2e-3  # what lengths of normals written with three digits may differ from one
_SAME = 1e-6

_FIT = (
    "How the planes lie to the exact surface: inside it, around it, or so that they are of the "
    "same size on average (`best`, if missing)."
)
TENSION = (
    "Tensile strength: largest principal stress; if missing, the other strengths alone limit it."
)
_COHESION: Any = Field(description="Cohesion.", examples=["1.5 MPa", "$c"])
_FRICTION: Any = Field(description="Friction angle, from 0 to below 90 deg.", examples=["35 deg"])


class SurfaceBase(Section):
    """A yield surface: what all kinds have in common."""

    @abstractmethod
    def surface(self, context: Context) -> YieldSurface:
        """The surface for the model; what cannot be is noted as a fault."""

    def key_of(self, strength: str) -> str:
        """The key under which a strength of the model stands."""
        return strength


class YieldPlaneSection(Section):
    """One plane of a yield surface: normal^T stress <= distance, tension positive."""

    name: Name | None = optional("In tables and reports; 'plane N' if missing.")
    normal: DirectionVector = Field(
        description="Unit normal: factors of the stresses xx, yy, xy in 2-D (or xx, yy, zz, xy), "
        "of xx, yy, zz, xy, yz, xz in a solid.",
        examples=[["0.6", "0", "0.8"]],
    )
    distance: Stress = Field(
        description="Distance k of the plane from the stress-free state; planes that name the same "
        "parameter are tied.",
        examples=["2 MPa", "$k1"],
    )

    def unit_normal(self, context: Context) -> tuple[float, ...]:
        """The normal (6,) of length one; zeros, with a fault, where it is none.

        Args:
            context: of the key `normal`.
        """
        numbers = [number.factor for number in self.normal]
        ways = _COMPONENTS[context.dim]
        places = next((way for way in ways if len(way) == len(numbers)), None)
        full = [0.0] * 6
        if places is None:
            expected = " or ".join(str(len(way)) for way in ways)
            message = f"found {len(numbers)} components; expected {expected}"
            hint = f"They are of {', or '.join(', '.join(_STRESSES[k] for k in w) for w in ways)}."
            context.refuse("wrong-dimension", message, hint)
            return tuple(full)
        length = hypot(*numbers)
        if length == 0:
            context.refuse("zero-direction", "the normal has length zero", "Write a unit normal.")
            return tuple(full)
        unit = [number / length for number in numbers]
        if abs(length - 1) > _ROUNDED:
            message = f"the normal has length {length:.4g}; expected a unit normal"
            hint = f"Write '[{', '.join(f'{x:.6g}' for x in unit)}]', and the distance along it."
            context.refuse("not-unit", message, hint)
        for place, number in zip(places, unit, strict=True):
            full[place] = number
        return tuple(full)


class PlanesSection(SurfaceBase):
    """A yield surface given plane by plane; all of them hold, the flow is along their normals."""

    type: Literal["planes"] = Field(description="Kind of yield surface.")
    planes: list[YieldPlaneSection] = Field(min_length=1, description="The planes.")
    hardening: Stress | None = optional(
        "Hardening modulus: growth of a distance per plastic strain on its plane; 0 if missing."
    )

    def surface(self, context: Context) -> GivenPlanes:
        """The planes, of which no two have the same normal or name."""
        planes = [
            YieldPlane(
                plane.name or f"plane {n + 1}",
                plane.unit_normal(context.at("planes", n, "normal")),
                plane.distance.scalar,
            )
            for n, plane in enumerate(self.planes)
        ]
        _check_different(planes, context.at("planes"))
        return self.to_model(GivenPlanes, planes=tuple(planes))


class _CoulombBase(SurfaceBase):
    """A yield surface of Mohr and Coulomb, exact or by planes."""

    tension: StrengthOrVaried | None = optional(TENSION)
    planes: Annotated[int, Count()] | None = optional(
        "Planes in place of the exact surface: in 2-D the sides of the polygon in "
        "place of Mohr's circle (even; three planes each), in a solid the number of planes (from "
        "48 on, taken six at a time).",
        examples=["16"],
    )
    fit: Fit | None = optional(_FIT)

    def _check_planes(self, context: Context) -> None:
        if self.planes is not None:
            _check_count(self.planes, 4 if context.dim == 2 else 48, context, even=context.dim == 2)
        elif self.fit is not None:
            message = "'fit' says how planes lie to the exact surface; there are none"
            hint = "Add 'planes: 16', or leave out 'fit'."
            context.at("fit").refuse("no-planes", message, hint)


class TrescaSection(_CoulombBase):
    """Tresca: the shear stress is limited, whatever the pressure."""

    one_of = (Alternatives("strength", "cohesion", hint="Give the shear strength once."),)

    type: Literal["tresca"] = Field(description="Kind of yield surface.")
    strength: StrengthOrVaried | None = optional(
        "Shear strength: half the compressive one.", examples=["2 MPa"]
    )
    cohesion: StrengthOrVaried | None = optional("Another name of the shear strength.")

    def surface(self, context: Context) -> MohrCoulomb:
        """Mohr-Coulomb without friction."""
        strength = self.strength or self.cohesion
        assert strength is not None
        self._check_planes(context)
        return self.to_model(MohrCoulomb, cohesion=strength.scalar, friction=Scalar(0.0))

    def key_of(self, strength: str) -> str:
        """The shear strength has two names."""
        return "strength" if self.strength is not None else strength


class MohrCoulombSection(_CoulombBase):
    """Mohr-Coulomb: exact, in principal stresses, or by `planes`."""

    type: Literal["mohr-coulomb"] = Field(description="Kind of yield surface.")
    cohesion: StrengthOrVaried = _COHESION
    friction: FieldAngle = _FRICTION
    dilation: Angle | None = optional(
        "Dilation angle, from 0 to the friction angle: the flow is associated if "
        "missing. Only without `planes`."
    )

    def surface(self, context: Context) -> MohrCoulomb:
        """The surface, exact or by planes."""
        if self.dilation is not None and self.planes is not None:
            message = (
                "planes flow along their normals, so their dilation angle is the friction angle"
            )
            hint = "Leave out 'dilation', or 'planes' for the exact surface."
            context.at("dilation").refuse("dilation", message, hint)
        self._check_planes(context)
        return self.to_model(MohrCoulomb)


class DruckerPragerSection(SurfaceBase):
    """Drucker-Prager's cone by planes, from the cohesion and friction of Mohr-Coulomb."""

    type: Literal["drucker-prager"] = Field(description="Kind of yield surface.")
    cohesion: StrengthOrVaried = _COHESION
    friction: FieldAngle = _FRICTION
    match: Literal["outer", "inner", "plane-strain"] = Field(
        "plane-strain",
        description="Where the cone meets Mohr-Coulomb: in triaxial compression (its outer edges), "
        "in extension (inner edges), or so that both carry the same in plane strain.",
    )
    tension: StrengthOrVaried | None = optional(TENSION)
    planes: Annotated[int, Count()] = Field(
        24, description="Least number of planes: from 6 on in 2-D, from 10 on in a solid."
    )
    fit: Fit | None = optional(_FIT)

    def surface(self, context: Context) -> DruckerPrager:
        """The cone by planes."""
        _check_count(self.planes, 6 if context.dim == 2 else 10, context, even=False)
        return self.to_model(DruckerPrager)


class WeakPlaneSection(SurfaceBase):
    """Coulomb's law on planes of one orientation, such as strata or joints.

    The planes lie by dip and dip_direction, or by their normal, as those of a
    transversely-isotropic material.
    """

    one_of = (
        Alternatives("dip dip_direction?", "normal", hint="Horizontal planes: 'dip: 0 deg'."),
    )

    type: Literal["weak-plane"] = Field(description="Kind of yield surface.")
    dip: Angle | None = optional(
        "Inclination of the planes, from the horizontal downwards. In 2-D without "
        "`dip_direction`: the apparent dip, falling towards +x.",
        examples=["35 deg", "$dip"],
    )
    dip_direction: Angle | None = optional(
        "Azimuth of the line of dip, clockwise from north (y) in a solid."
    )
    normal: DirectionVector | None = optional(
        "Normal of the planes in x, y, z; its length does not matter."
    )
    cohesion: StrengthOrVaried = Field(description="Cohesion on the planes.", examples=["0.2 MPa"])
    friction: FieldAngle = Field(description="Friction angle on the planes.", examples=["25 deg"])
    tension: StrengthOrVaried | None = optional(
        "Tensile strength across the planes; cohesion / tan(friction) if missing."
    )
    planes: Annotated[int, Count()] = Field(
        16, description="Sides of the polygon in place of the circle of shear stress in a solid."
    )

    def surface(self, context: Context) -> WeakPlane:
        """The planes; their number counts in a solid only."""
        if context.dim == 3:
            _check_count(self.planes, 4, context, even=True)
        frame = strata(context, self.dip, self.dip_direction, self.normal)
        return self.to_model(WeakPlane, frame=frame)


class HoekBrownSection(SurfaceBase):
    """The generalised criterion of Hoek and Brown (2002 edition), exact.

    By mi, GSI and D of intact rock and rock mass, or by mb, s and a directly.
    """

    one_of = (
        Alternatives("mi GSI D?", "mb s a", hint="Give all constants of one set."),
        Alternatives(
            "dilation",
            "flow",
            hint="Flow without change of volume: 'flow: none'; along the normals: "
            "'flow: associated'.",
        ),
    )

    type: Literal["hoek-brown"] = Field(description="Kind of yield surface.")
    sigci: StrengthOrVaried = Field(
        description="Uniaxial compressive strength of intact rock.", examples=["50 MPa", "$sigci"]
    )
    mi: Multiple | None = optional(
        "Constant of intact rock, with GSI: about 4 for claystone, 32 for granite."
    )
    GSI: Coefficient | None = optional(
        "Geological Strength Index, 0 to 100.", examples=["45", "$GSI"]
    )
    D: Coefficient | None = optional(
        "Disturbance by blasting and relaxation, 0 to 1, with GSI; 0 if missing."
    )
    mb: Multiple | None = optional("Constant of the rock mass, with s and a.")
    s: Coefficient | None = optional(
        "Constant of the rock mass, with mb and a: 0 to 1, 1 for intact rock."
    )
    a: Coefficient | None = optional(
        "Exponent, with mb and s: 0.5 for intact rock, 0.2 to 0.9 at most."
    )
    dilation: Angle | None = optional(
        "Constant dilation angle; 0 deg for flow without change of volume.",
        examples=["0 deg", "5 deg"],
    )
    flow: Literal["associated", "none"] | None = optional(
        "In place of `dilation`: `associated` flows along the normals, which near an "
        "unsupported wall dilates as no rock does; `none` does not change its volume, as "
        "`dilation: 0 deg`."
    )
    tension: StrengthOrVaried | None = optional(
        "Tensile strength: largest principal stress, lower than s sigci / mb, which "
        "limits it if missing."
    )

    def surface(self, context: Context) -> HoekBrown:
        """The surface; a tie has its own number for each constant."""
        dilation = Scalar(0.0) if self.flow == "none" else scalar_of(self.dilation)
        return self.to_model(HoekBrown, dilation=dilation)


class HardeningSoilSection(SurfaceBase):
    """Hardening soil (Schanz, Vermeer & Bonnier 1999): stiffness by stress and by strain.

    The E and nu of the material are those of unloading and reloading, E at `p_ref`.
    """

    type: Literal["hardening-soil"] = Field(description="Kind of law.")
    E50: Stress | None = optional(
        "Secant modulus at half of the strength in a drained triaxial test at `p_ref`; "
        "without it nothing hardens: the stiffness is that of unloading up to Mohr-Coulomb.",
        examples=["30 MPa", "$E50"],
    )
    Eoed: Stress | None = optional(
        "Tangent modulus of a first loading in the oedometer at a vertical stress of "
        "`p_ref`, from which the cap follows; without it there is no cap.",
        examples=["30 MPa", "$Eoed"],
    )
    m: Coefficient = Field(
        description="Exponent of the stress by which all moduli grow: about 0.5 of sand, 1 of soft "
        "clay.",
        examples=["0.5", "$m"],
    )
    p_ref: Stress | None = optional("Reference stress; 100 kPa if missing.")
    Rf: Coefficient | None = optional("Strength by the asymptote of the hyperbola; 0.9 if missing.")
    cohesion: Stress = Field(description="Effective cohesion.", examples=["1 kPa", "$c"])
    friction: Angle = Field(
        description="Effective friction angle, above 0 and below 90 deg.", examples=["35 deg"]
    )
    dilation: Angle | None = optional(
        "Dilation angle at failure (Rowe's below it); 0 deg if missing."
    )
    tension: Stress | None = optional("Tensile strength; 0 if missing.")
    K0nc: Coefficient | None = optional(
        "Horizontal by vertical stress of a first loading in the oedometer, with "
        "`Eoed`; 1 - sin(friction) if missing."
    )
    OCR: Coefficient | None = optional(
        "Highest vertical stress of the past by that in situ, with `Eoed`. Without "
        "`OCR`, `POP` and `preconsolidation_stress` the stress in situ is the highest that there "
        "was.",
        examples=["1.5", "$OCR"],
    )
    POP: Stress | None = optional(
        "Highest vertical stress of the past less that in situ, with `Eoed`.", examples=["50 kPa"]
    )
    preconsolidation_stress: Stress | None = optional(
        "Highest vertical stress of the past, with `Eoed` and in place of `OCR` and "
        "`POP`: effective, compression positive. In situ less than what is there has no effect.",
        examples=["180 kPa", "$sigma_p"],
    )
    G0: Stress | None = optional(
        "Shear modulus at the smallest strains, at `p_ref`, with `gamma_07`; without "
        "both small strains are no stiffer than unloading.",
        examples=["120 MPa", "$G0"],
    )
    gamma_07: Coefficient | None = optional(
        "Shear strain gamma_0.7 at which the secant shear modulus has fallen to 0.722 "
        "`G0`: 1e-4 to 2e-4 of sand, up to 5e-4 of plastic clay.",
        examples=["1.5e-4", "$gamma_07"],
    )

    def surface(self, context: Context) -> HardeningSoil:
        """The law; what belongs to a cap needs one."""
        for key in ("K0nc", "OCR", "POP", "preconsolidation_stress"):
            if self.Eoed is None and getattr(self, key) is not None:
                message = f"'{key}' belongs to the cap, and without 'Eoed' there is none"
                context.at(key).refuse("no-cap", message, "Add 'Eoed: ...', or remove it.")
        for key in ("OCR", "POP"):
            if self.preconsolidation_stress is not None and getattr(self, key) is not None:
                message = f"'{key}' beside 'preconsolidation_stress', which gives the past alone"
                context.at(key).refuse("two-pasts", message, "Remove one of them.")
        for key in ("Eoed", "Rf"):
            if self.E50 is None and getattr(self, key) is not None:
                message = f"'{key}' belongs to soil that hardens, and without 'E50' none does"
                context.at(key).refuse("no-hardening", message, "Add 'E50: ...', or remove it.")
        for key, other, value in (("G0", "gamma_07", "1.5e-4"), ("gamma_07", "G0", "100 MPa")):
            if getattr(self, key) is not None and getattr(self, other) is None:
                message = f"'{key}' without '{other}': small strains take both"
                hint = f"Add '{other}: {value}', or remove '{key}'."
                context.at(key).refuse("small-strains", message, hint)
        defaults = {"p_ref": 1e5, "Rf": 0.9, "dilation": 0.0, "tension": 0.0}
        return self.to_model(
            HardeningSoil,
            **{
                key: Scalar(number)
                for key, number in defaults.items()
                if getattr(self, key) is None
            },
        )


YieldSection = Annotated[
    PlanesSection
    | TrescaSection
    | MohrCoulombSection
    | DruckerPragerSection
    | WeakPlaneSection
    | HoekBrownSection
    | HardeningSoilSection,
    Field(discriminator="type"),
]


def _shape(value: Any) -> str:
    return "list" if isinstance(value, list | tuple) else "<mapping>"


YieldSections = Annotated[
    Annotated[YieldSection, Tag("<mapping>")]
    | Annotated[list[YieldSection], Field(min_length=1), Tag("list")],
    Discriminator(_shape),
]


def build_yields(
    given: YieldSections | None,
    elastic: Elastic,
    growths: Sequence[Growth],
    parameters: Mapping[str, ParameterSection],
    context: Context,
) -> tuple[YieldSurface, ...]:
    """The yield surfaces of a material.

    What cannot be, as given or at the start of the parameters, is noted as a fault.

    Args:
        given: what stands under the key `yield`.
        elastic: elasticity of the material.
        growths: of its strengths.
        parameters: the parameters of the case.
        context: of the key `yield`.
    """
    sections = _listed(given, context)
    surfaces = tuple(section.surface(place) for place, section in sections)
    bounded = bounded_surfaces(surfaces, growths)
    for (place, section), surface in zip(sections, bounded, strict=True):
        _check_exact(surface, elastic, place, alone=len(sections) == 1)
        _check_strengths(section, surface, parameters, place)
    return surfaces


_NAMES = {"strength": "cohesion"}
"""Key of a strength to its name in the model, where it is another one."""


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
        for field in fields_in(section, place, material=material, surface=n, names=_NAMES)
    )


def growths_of_yields(
    given: YieldSections | None, context: Context, *, material: str
) -> tuple[Growth, ...]:
    """The growths among the strengths of a material; arguments as of `fields_of_yields`."""
    return tuple(
        growth
        for n, (place, section) in enumerate(_listed(given, context))
        for growth in growths_in(section, place, material=material, surface=n, names=_NAMES)
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
    starts = numbers_at_start(section.numbers, parameters)
    violation = None if starts is None else surface.breach(starts)
    if violation is None:
        return
    key = section.key_of(violation.constant)
    given: CaseNumber = getattr(section, key)
    message, hint = f"'{given.text}': {violation.limit}", "Correct the number or its unit."
    if given.parameter is not None:
        message = f"'{given.text}' is {violation.shown} at the start; {violation.limit}"
        hint = f"Change the start of {given.parameter}."
    context.at(key).refuse("out-of-range", message, hint)


def _check_exact(surface: YieldSurface, elastic: Elastic, context: Context, *, alone: bool) -> None:
    """The exact surface is a law of principal stresses, which goes with isotropic ground only."""
    if not surface.in_principal_stresses:
        return
    hint = f"Add 'planes: {16 if context.dim == 2 else 96}' to it."
    if isinstance(surface, HoekBrown):
        hint = "Leave out the other, or describe it by planes of Mohr-Coulomb."
    if not alone:
        message = "an exact surface cannot be combined with another one"
        context.refuse("smooth-surface", message, hint)
    elif not isinstance(elastic, Isotropic):
        message = "an exact surface needs isotropic elasticity"
        context.refuse("smooth-surface", message, hint)


def _check_count(planes: int, fewest: int, context: Context, *, even: bool) -> None:
    """Note too few planes, or a polygon that is not its own mirror image."""
    if planes >= fewest and not (even and planes % 2):
        return
    expected = f"{'an even number ' if even else 'a number '}from {fewest} on"
    message = f"found {planes}; expected {expected}"
    hint = f"Write 'planes: {max(fewest, planes + planes % 2)}'."
    context.at("planes").refuse("number-of-planes", message, hint)


def _check_different(planes: Sequence[YieldPlane], context: Context) -> None:
    """Two planes of one normal, of which only one can count, and names used twice."""
    for n, plane in enumerate(planes):
        for m, other in enumerate(planes[:n]):
            if any(plane.normal) and _near(plane.normal, other.normal):
                message = f"planes {m + 1} and {n + 1} have the same normal"
                hint = "Keep the one with the smaller distance; the other has no effect."
                context.at(n, "normal").refuse("same-normal", message, hint)
            if plane.name == other.name:
                message = f"planes {m + 1} and {n + 1} have the same name '{plane.name}'"
                context.at(n, "name").refuse("same-name", message, "Rename one.")


def _near(one: Sequence[float], other: Sequence[float]) -> bool:
    return hypot(*(a - b for a, b in zip(one, other, strict=True))) < _SAME
