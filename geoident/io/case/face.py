"""The tunnel face: how distances to it become released stress, and first readings by distance."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise
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


class FaceCheck:
    """What of a face and its distances cannot be.

    Args:
        section: the key `face`, or None.
        stages: of the case.
        parameters: of the case.
        faults: where to note.
    """

    def __init__(
        self,
        section: FaceSection | None,
        stages: Sequence[StageSection],
        parameters: Mapping[str, ParameterSection],
        faults: Faults,
    ) -> None:
        self._section, self._stages = section, stages
        self._parameters, self._faults = parameters, faults

    def note(self, analysis: str, groups: Collection[str], *, circle: bool) -> None:
        """Note all faults.

        Args:
            analysis: kind of analysis, as written.
            groups: element groups of the case.
            circle: whether `fit.closed-form` gives the radius of an opening without mesh.
        """
        section = self._section
        distances = [n for n, s in enumerate(self._stages) if s.distance is not None]
        if section is None:
            for n in distances:
                message = "the case does not say how a distance to the face releases stress"
                hint = "Add 'face: {profile: vlachopoulos-diederichs, radius: 4 m}'."
                self._faults.add(("stages", n, "distance"), "no-face", message, hint, key=True)
            return
        if analysis != Analysis.PLANE_STRAIN.value:
            message = f"'analysis' is {analysis}, in which the face is a part of the model"
            hint = "Excavate the tunnel up to it, stage by stage; 'face' belongs to plane strain."
            self._faults.add(_AT, "wrong-analysis", message, hint, key=True)
        if not distances:
            message = "no stage says how far its section is behind the face"
            hint = "Add 'distance: 2.5 m' to stages."
            self._faults.add(_AT, "no-distance", message, hint, key=True)
        if section.radius is None and not circle:
            message = "the radius of the tunnel is missing"
            hint = (
                "Add 'radius: 4 m', of a tunnel that is not round that of the circle of its area."
            )
            self._faults.add(_AT, "missing-key", message, hint, key=True)
        if section.conversion == "mesh" and circle:
            message = "the case has no mesh whose wall would tell"
            hint = "Leave 'conversion' out: the closed form has its own reaction curve."
            self._faults.add((*_AT, "conversion"), "no-mesh", message, hint)
        for n, group in enumerate(section.groups or ()):
            if group not in groups:
                self._faults.add_unknown((*_AT, "groups", n), "group", group, groups)
        self._note_numbers(section)
        self._note_distances(section, distances)

    def _note_numbers(self, section: FaceSection) -> None:
        for key in ("radius", "plastic_radius", "m", "reach", "exponent"):
            given = getattr(section, key, None)
            if given is not None:
                self._require(key, given, lambda low, _: low > 0.0, "positive")
        if isinstance(section, PanetSection):
            words = "0 or more, and less than 1"
            self._require(
                "alpha", section.alpha, lambda low, high: low >= 0.0 and high < 1.0, words
            )
        plastic = getattr(section, "plastic_radius", None)
        radius = section.radius
        if plastic is None or radius is None or plastic.parameter or radius.parameter:
            return
        if plastic.factor < radius.factor:
            message = f"the plastic radius '{plastic.text}' is within the tunnel ('{radius.text}')"
            hint = "It counts from the centre; where nothing yields it is the tunnel's."
            self._faults.add((*_AT, "plastic_radius"), "out-of-range", message, hint)

    def _require(self, key: str, given: CaseNumber, holds: Any, words: str) -> None:
        """A number, or both bounds of its parameter, must be as they should."""
        parameter = self._parameters.get(given.parameter or "")
        if parameter is not None:
            ends = sorted(given.factor * bound.factor for bound in parameter.bounds)
            if not holds(*ends):
                message = f"the bounds of {given.parameter} let '{key}' of the face be "
                message += "what it cannot be"
                place: KeyPath = ("parameters", str(given.parameter), "bounds")
                self._faults.add(place, "out-of-range", message, f"It must be {words}.")
        elif given.parameter is None and not holds(given.factor, given.factor):
            message = f"'{given.text}': {key} must be {words}"
            self._faults.add((*_AT, key), "out-of-range", message, "Correct the number.")

    def _note_distances(self, section: FaceSection, distances: Sequence[int]) -> None:
        groups = groups_released(section, self._stages)
        for n in distances:
            stage = self._stages[n]
            given = stage.distance
            assert given is not None
            path: KeyPath = ("stages", n, "distance")
            if isinstance(section, PanetSection) and self._lowest(given) < 0.0:
                message = f"'{given.text}' is ahead of the face, where Panet's profile ends"
                hint = "Take 'profile: vlachopoulos-diederichs' or 'chern', which cover this range."
                self._faults.add(path, "out-of-range", message, hint)
            for group in sorted(stage.release.keys() & set(groups)):
                message = f"what '{group}' releases is given, and follows from the distance, too"
                hint = "Remove one of the two."
                self._faults.add(
                    ("stages", n, "release", group), "contradiction", message, hint, key=True
                )
        for one, other in self._following(distances):
            first, second = self._stages[one].distance, self._stages[other].distance
            assert first is not None
            assert second is not None
            if second.factor < first.factor:
                message = f"the face is {second.text} away, after {first.text} at "
                message += f"'{self._stages[one].name}'"
                hint = "A face advances or stops: correct one of the distances."
                self._faults.add(("stages", other, "distance"), "face-order", message, hint)

    def _lowest(self, given: CaseNumber) -> float:
        parameter = self._parameters.get(given.parameter or "")
        if parameter is None:
            return given.factor if given.parameter is None else 0.0
        return min(given.factor * bound.factor for bound in parameter.bounds)

    def _following(self, distances: Sequence[int]) -> Iterator[tuple[int, int]]:
        """Pairs of stages with given distances that follow each other."""
        trunk: list[int] = []
        for n in distances:
            stage = self._stages[n]
            given = stage.distance
            if given is not None and given.parameter is None and not stage.independent:
                if stage.base is not None:
                    trunk = []
                trunk.append(n)
                yield from pairwise(trunk[-2:])
