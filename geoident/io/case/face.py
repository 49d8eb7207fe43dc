"""The tunnel face: how distances to it become released stress, and first readings by distance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from geoident.io.schema.section import Alternatives, Context, Section, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coefficient,
    Coordinates,
    Length,
    Multiple,
    Name,
    Size,
    TextOrMapping,
    scalar_of,
)
from geoident.io.text.faults import Faults
from geoident.model.actions import Conversion, FaceProfile, ProfileLaw
from geoident.model.case import VIRGIN, KeyPath
from geoident.model.parameter import Scalar

if TYPE_CHECKING:
    from geoident.io.case.stages import StageSection


class FaceBase(Section):
    """What every profile needs to know beside its constants."""

    constants: ClassVar[tuple[str, ...]] = ()
    """Keys of those constants of the profile that may be parameters."""

    radius: Size | None = optional(
        "Radius of the tunnel, or of the circle of its area; without a mesh that of "
        "`fit.closed-form` if missing.",
        examples=["4 m"],
    )
    groups: list[Name] | None = optional(
        "Element groups that the tunnel fills; what the stages with a `distance` "
        "excavate if missing.",
        min_length=1,
    )
    centre: Coordinates | None = optional(
        "Where the in-situ stress is taken for the reaction curve; the middle of the "
        "groups if missing."
    )
    conversion: Conversion | None = optional(
        "How the part s of its final motion that the wall has made becomes a part of "
        "the stress that is released, where the ground yields. reaction-curve (the default): on "
        "the reaction curve of the circular opening without support, so that its wall has moved "
        "by that part. mesh: so that the wall of the tunnel in the mesh, without support, has "
        "moved by that part in the mean, whatever its shape, its ground and the in-situ stress; it "
        "takes some analyses more. direct: the part s itself. In elastic ground all are the same."
    )


class OtherProfilesSection(Section):
    """Weights of other profiles, the usual constants of which are taken."""

    model_config = ConfigDict(populate_by_name=False)

    def averaged(self, radius: Scalar) -> tuple[tuple[FaceProfile, Scalar], ...]:
        """The profiles that are named, each with its weight."""
        constants: dict[ProfileLaw, tuple[Scalar, ...]] = {
            "vlachopoulos-diederichs": (),
            "panet": _usual(PanetSection),
            "chern": _usual(ChernSection),
        }
        weights = {law: getattr(self, law.replace("-", "_"), None) for law in constants}
        return tuple(
            (FaceProfile(law, (), radius, constants[law]), weight.scalar)
            for law, weight in weights.items()
            if weight is not None
        )


_VLACHOPOULOS_DIEDERICHS = "Of that of Vlachopoulos & Diederichs."
_PANET = "Of Panet's."
_CHERN = "Of that of Chern et al."
_NAME_ONE = "Give one or both a weight, a number or a parameter."


class BesideVlachopoulosDiederichsSection(OtherProfilesSection):
    """Weights of other profiles, the usual constants of which are taken."""

    one_of = (Alternatives("panet chern?", "chern", hint=_NAME_ONE),)

    panet: Coefficient | None = optional(_PANET, examples=["$w_panet"])
    chern: Coefficient | None = optional(_CHERN, examples=["$w_chern"])


class BesidePanetSection(OtherProfilesSection):
    """Weights of other profiles, the usual constants of which are taken."""

    one_of = (Alternatives("vlachopoulos-diederichs chern?", "chern", hint=_NAME_ONE),)

    vlachopoulos_diederichs: Coefficient | None = optional(
        _VLACHOPOULOS_DIEDERICHS, alias="vlachopoulos-diederichs"
    )
    chern: Coefficient | None = optional(_CHERN)


class BesideChernSection(OtherProfilesSection):
    """Weights of other profiles, the usual constants of which are taken."""

    one_of = (Alternatives("vlachopoulos-diederichs panet?", "panet", hint=_NAME_ONE),)

    vlachopoulos_diederichs: Coefficient | None = optional(
        _VLACHOPOULOS_DIEDERICHS, alias="vlachopoulos-diederichs"
    )
    panet: Coefficient | None = optional(_PANET)


_AVERAGED = (
    "Other profiles with their weights w: s = s0 + sum of w (s - s0) with s0 that of `profile`, "
    "which takes the rest. Weights that are parameters with a prior let intervals contain the "
    "choice between profiles."
)


class VlachopoulosDiederichsSection(FaceBase):
    """Vlachopoulos & Diederichs (2009): s = 1 - (1 - s0) exp(-3 x / (2 Rp)) behind the face.

    s0 = exp(-0.15 Rp / R) / 3 at the face, s0 exp(x / R) ahead of it (distances negative).
    """

    profile: Literal["vlachopoulos-diederichs"]
    averaged_with: BesideVlachopoulosDiederichsSection | None = optional(_AVERAGED)
    plastic_radius: Size | None = optional(
        "Plastic radius Rp around the tunnel without support, far from its face; by "
        "the closed form of the opening if missing.",
        examples=["10.5 m"],
    )


class PanetSection(FaceBase):
    """Panet (1995): s = alpha + (1 - alpha) [1 - (m / (m + x / R))^2] behind the face."""

    constants = ("alpha", "m")

    profile: Literal["panet"]
    averaged_with: BesidePanetSection | None = optional(_AVERAGED)
    alpha: Coefficient = Field(
        CaseNumber("0.25", 0.25, None, "dimensionless"),
        description="Part of its final motion that the wall has made at the face.",
        examples=[0.25],
    )
    m: Multiple = Field(
        CaseNumber("0.75", 0.75, None, "dimensionless"),
        description="How far the face reaches, in radii.",
        examples=[0.75],
    )


class ChernSection(FaceBase):
    """Chern et al. (1998): s = [1 + exp(-(x / R) / reach)]^-exponent, ahead of the face, too."""

    constants = ("reach", "exponent")

    profile: Literal["chern"]
    averaged_with: BesideChernSection | None = optional(_AVERAGED)
    reach: Multiple = Field(
        CaseNumber("1.10", 1.10, None, "dimensionless"),
        description="How far the face reaches, in radii.",
        examples=[1.1],
    )
    exponent: Multiple = Field(
        CaseNumber("1.7", 1.7, None, "dimensionless"), description="Exponent.", examples=[1.7]
    )


def _usual(section: type[PanetSection | ChernSection]) -> tuple[Scalar, ...]:
    """Constants of the paper."""
    return tuple(section.model_fields[key].default.scalar for key in section.constants)


FaceSection = Annotated[
    VlachopoulosDiederichsSection | PanetSection | ChernSection, Field(discriminator="profile")
]


class FirstReadingSection(Section):
    """The stage at which the face was so far away."""

    distance: Length = Field(
        description="`distance` of a stage, at whose end the gauge reads zero.", examples=["2.5 m"]
    )


ZeroValue = TextOrMapping[Name, FirstReadingSection]
"""Where a gauge reads zero: the name of a stage, or the distance to the face there."""

_Gauge = TypeVar("_Gauge", bound=BaseModel)


def with_zero_stage(
    gauge: _Gauge, stages: Sequence[StageSection], path: KeyPath, faults: Faults
) -> _Gauge:
    """A gauge with the name of a stage where its zero is given by a distance to the face.

    Args:
        gauge: of the case, or what a gauge says of one of its probes.
        stages: of the case.
        path: of the gauge.
        faults: takes a distance that no stage has.
    """
    changed: dict[str, Any] = {}
    zero, distortions = getattr(gauge, "zero", None), getattr(gauge, "distortions", None)
    if isinstance(zero, FirstReadingSection):
        changed["zero"] = _stage_at(zero.distance, stages, (*path, "zero", "distance"), faults)
    if distortions is not None:
        place = (*path, "distortions")
        changed["distortions"] = with_zero_stage(distortions, stages, place, faults)
    return gauge.model_copy(update=changed) if changed else gauge


def _stage_at(
    given: CaseNumber, stages: Sequence[StageSection], path: KeyPath, faults: Faults
) -> str:
    matches = [s.name for s in stages if s.distance and s.distance.scalar == given.scalar]
    if matches:
        return matches[0]
    message = f"at no stage is the face {given.text} away"
    known = [f"{s.distance.text} at '{s.name}'" for s in stages if s.distance]
    hint = f"Distances are {', '.join(known)}." if known else ""
    new = f"Add a stage with 'distance: {given.text}' for the first reading."
    faults.add(path, "unknown-stage", message, f"{hint} {new}".strip())
    return VIRGIN


def groups_released(section: FaceSection | None, stages: Sequence[StageSection]) -> tuple[str, ...]:
    """Element groups whose stress is released by distance: as given, or as excavated.

    Args:
        section: the key `face`.
        stages: of the case.
    """
    if section is None:
        return ()
    if section.groups is not None:
        return tuple(section.groups)
    dug = (group for stage in stages if stage.distance is not None for group in stage.excavate)
    return tuple(dict.fromkeys(dug))


def build_face(
    section: FaceSection | None,
    stages: Sequence[StageSection],
    circle: float | None,
    context: Context,
) -> FaceProfile | None:
    """The profile of a case.

    Args:
        section: the key `face`.
        stages: of the case.
        circle: radius of an opening without mesh, m, or None.
        context: of the key.
    """
    if section is None:
        return None
    radius = scalar_of(section.radius) or (None if circle is None else Scalar(circle))
    centre = None
    if section.centre is not None:
        centre = context.at("centre").vector(section.centre)
    radius = radius or Scalar(1.0)  # where it is missing, that is a fault
    others = section.averaged_with
    return section.to_model(
        FaceProfile,
        law=section.profile,
        groups=groups_released(section, stages),
        radius=radius,
        averaged=() if others is None else others.averaged(radius),
        constants=tuple(getattr(section, key).scalar for key in section.constants),
        centre=centre,
    )
