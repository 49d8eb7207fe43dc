"""The tunnel face: how distances to it become released stress, and first readings by distance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, Field, Tag

from geoident.io.case.parameters import ParameterSection
from geoident.io.schema.section import Context, Section
from geoident.io.schema.values import (
    TEXT_OR_MAPPING,
    CaseNumber,
    Coefficient,
    Coordinates,
    Length,
    Multiple,
    Name,
    Size,
    scalar_of,
)
from geoident.io.text.faults import Faults
from geoident.model.actions import Conversion, FaceProfile
from geoident.model.case import VIRGIN, Analysis, KeyPath
from geoident.model.parameter import Scalar

if TYPE_CHECKING:
    from geoident.io.case.case import CaseSection
    from geoident.io.case.stages import StageSection

_AT: KeyPath = ("face",)


class FaceBase(Section):
    """What every profile needs to know beside its constants."""

    radius: Size | None = Field(
        None,
        description="Radius of the tunnel, or of the circle of its area; without a mesh that of "
        "`fit.closed-form` if missing.",
        examples=["4 m"],
    )
    groups: list[Name] | None = Field(
        None,
        min_length=1,
        description="Element groups that the tunnel fills; what the stages with a `distance` "
        "excavate if missing.",
    )
    centre: Coordinates | None = Field(
        None,
        description="Where the in-situ stress is taken for the reaction curve; the middle of the "
        "groups if missing.",
    )
    conversion: Conversion | None = Field(
        None,
        description="How the part s of its final motion that the wall has made becomes a part of "
        "the stress that is released, where the ground yields. reaction-curve (the default): on "
        "the reaction curve of the circular opening without support, so that its wall has moved "
        "by that part. mesh: so that the wall of the tunnel in the mesh, without support, has "
        "moved by that part in the mean, whatever its shape, its ground and the in-situ stress; it "
        "takes some analyses more. direct: the part s itself. In elastic ground all are the same.",
    )

    @property
    def constants(self) -> tuple[CaseNumber, ...]:
        """Those of the profile that may be parameters."""
        return ()


class VlachopoulosDiederichsSection(FaceBase):
    """Vlachopoulos & Diederichs (2009): s = 1 - (1 - s0) exp(-3 x / (2 Rp)) behind the face.

    s0 = exp(-0.15 Rp / R) / 3 at the face, s0 exp(x / R) ahead of it (distances negative).
    """

    profile: Literal["vlachopoulos-diederichs"]
    plastic_radius: Size | None = Field(
        None,
        description="Plastic radius Rp around the tunnel without support, far from its face; by "
        "the closed form of the opening if missing.",
        examples=["10.5 m"],
    )


class PanetSection(FaceBase):
    """Panet (1995): s = alpha + (1 - alpha) [1 - (m / (m + x / R))^2] behind the face."""

    profile: Literal["panet"]
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

    @property
    def constants(self) -> tuple[CaseNumber, ...]:
        """Alpha and m."""
        return self.alpha, self.m


class ChernSection(FaceBase):
    """Chern et al. (1998): s = [1 + exp(-(x / R) / reach)]^-exponent, ahead of the face, too."""

    profile: Literal["chern"]
    reach: Multiple = Field(
        CaseNumber("1.10", 1.10, None, "dimensionless"),
        description="How far the face reaches, in radii.",
        examples=[1.1],
    )
    exponent: Multiple = Field(
        CaseNumber("1.7", 1.7, None, "dimensionless"), description="Exponent.", examples=[1.7]
    )

    @property
    def constants(self) -> tuple[CaseNumber, ...]:
        """Reach and exponent."""
        return self.reach, self.exponent


FaceSection = Annotated[
    VlachopoulosDiederichsSection | PanetSection | ChernSection, Field(discriminator="profile")
]


class FirstReadingSection(Section):
    """The stage at which the face was so far away."""

    distance: Length = Field(
        description="`distance` of a stage, at whose end the gauge reads zero.", examples=["2.5 m"]
    )


ZeroValue = Annotated[
    Annotated[Name, Tag("text")] | Annotated[FirstReadingSection, Tag("mapping")],
    TEXT_OR_MAPPING,
]
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
    return section.to_model(
        FaceProfile,
        law=section.profile,
        groups=groups_released(section, stages),
        radius=radius or Scalar(1.0),  # where it is missing, that is a fault
        constants=tuple(number.scalar for number in section.constants),
        centre=centre,
    )


def check_face(case: CaseSection, circle: float | None, faults: Faults) -> None:
    """Note what of a face and its distances cannot be.

    Args:
        case: the case.
        circle: radius of an opening without mesh, m, or None.
        faults: where to note.
    """
    section = case.face
    distances = [n for n, stage in enumerate(case.stages) if stage.distance is not None]
    if section is None:
        for n in distances:
            message = "the case does not say how a distance to the face releases stress"
            hint = "Add 'face: {profile: vlachopoulos-diederichs, radius: 4 m}'."
            faults.add(("stages", n, "distance"), "no-face", message, hint, key=True)
        return
    if case.analysis != Analysis.PLANE_STRAIN.value:
        message = f"'analysis' is {case.analysis}, in which the face is a part of the model"
        hint = "Excavate the tunnel up to it, stage by stage; 'face' belongs to plane strain."
        faults.add(_AT, "wrong-analysis", message, hint, key=True)
    if not distances:
        message = "no stage says how far its section is behind the face"
        faults.add(_AT, "no-distance", message, "Add 'distance: 2.5 m' to stages.", key=True)
    if section.radius is None and circle is None:
        message = "the radius of the tunnel is missing"
        hint = "Add 'radius: 4 m', of a tunnel that is not round that of the circle of its area."
        faults.add(_AT, "missing-key", message, hint, key=True)
    if section.conversion == "mesh" and circle is not None:
        message = "the case has no mesh whose wall would tell"
        hint = "Leave 'conversion' out: the closed form has its own reaction curve."
        faults.add((*_AT, "conversion"), "no-mesh", message, hint)
    for n, group in enumerate(section.groups or ()):
        if group not in case.groups:
            faults.add_unknown((*_AT, "groups", n), "group", group, case.groups)
    _check_numbers(section, case.parameters, faults)
    _check_distances(section, case, distances, faults)


def _range(
    given: CaseNumber, parameters: Mapping[str, ParameterSection]
) -> tuple[float, float] | None:
    """The least and the largest value of a number; None where its parameter is not known."""
    if given.parameter is None:
        return given.factor, given.factor
    if given.parameter not in parameters:
        return None
    low, high = sorted(given.factor * x.factor for x in parameters[given.parameter].bounds)
    return low, high


def _check_numbers(
    section: FaceSection, parameters: Mapping[str, ParameterSection], faults: Faults
) -> None:
    """Numbers, or both bounds of their parameters, are in the ranges of the profile."""
    for key in ("radius", "plastic_radius", "m", "reach", "exponent", "alpha"):
        given: CaseNumber | None = getattr(section, key, None)
        ends = None if given is None else _range(given, parameters)
        if given is None or ends is None:
            continue
        good, words = ends[0] > 0.0, "positive"
        if key == "alpha":
            good, words = ends[0] >= 0.0 and ends[1] < 1.0, "0 or more, and less than 1"
        if good:
            continue
        if given.parameter is not None:
            message = f"the bounds of {given.parameter} are too wide for '{key}' of the face"
            place: KeyPath = ("parameters", given.parameter, "bounds")
            faults.add(place, "out-of-range", message, f"It must be {words}.")
        else:
            message = f"'{given.text}': {key} must be {words}"
            faults.add((*_AT, key), "out-of-range", message, "Correct the number.")
    plastic, radius = getattr(section, "plastic_radius", None), section.radius
    if plastic is None or radius is None or plastic.parameter or radius.parameter:
        return
    if plastic.factor < radius.factor:
        message = f"the plastic radius '{plastic.text}' is within the tunnel ('{radius.text}')"
        hint = "It counts from the centre; where nothing yields it is the tunnel's."
        faults.add((*_AT, "plastic_radius"), "out-of-range", message, hint)


def _check_distances(
    section: FaceSection, case: CaseSection, distances: Sequence[int], faults: Faults
) -> None:
    """Distances fit the profile, release what nothing else does, and do not fall."""
    groups = groups_released(section, case.stages)
    before = -math.inf, ""
    for n in distances:
        stage = case.stages[n]
        given = stage.distance
        assert given is not None
        path: KeyPath = ("stages", n, "distance")
        least, _ = _range(given, case.parameters) or (0.0, 0.0)
        if isinstance(section, PanetSection) and least < 0.0:
            message = f"'{given.text}' is ahead of the face, where Panet's profile ends"
            hint = "Take 'profile: vlachopoulos-diederichs' or 'chern', which cover this range."
            faults.add(path, "out-of-range", message, hint)
        for group in sorted(stage.release.keys() & set(groups)):
            message = f"what '{group}' releases is given, and follows from the distance, too"
            place = ("stages", n, "release", group)
            faults.add(place, "contradiction", message, "Remove one of the two.", key=True)
        if given.parameter is not None or stage.independent:
            continue
        if stage.base is None and given.factor < before[0]:
            message = f"the face is {given.text} away, after {before[1]}"
            hint = "A face advances or stops: correct one of the distances."
            faults.add(path, "face-order", message, hint)
        before = given.factor, f"{given.text} at '{stage.name}'"
