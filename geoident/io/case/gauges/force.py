"""Gauges that read strains, forces, stresses and pressures: their sections.

What they read has a value of its own: without `zero` it is the value itself that is read (a stress,
a force), with `zero` its change since that stage. Strains of the ground are changes always.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from geoident.io.case.gauges.accuracy import (
    ESTIMATE,
    FORCES,
    ForceAccuracy,
    PressureAccuracy,
    StrainAccuracy,
)
from geoident.io.case.gauges.gauge import (
    GaugeBase,
    GivenLength,
    distance,
    point_of,
    unit_vector,
)
from geoident.io.schema.section import Context, SectionFaults, refuse
from geoident.io.schema.values import (
    Coordinates,
    Count,
    DirectionVector,
    Flag,
    Given,
    Length,
    Line,
    Name,
    Of,
    SharesUnit,
)
from geoident.model.arrays import Vector
from geoident.model.case import VIRGIN
from geoident.model.gauges import Channel, MovingPoint, Reads
from geoident.model.structures import Bars, Beam, Structure, Struts
from geoident.units import unit_list, with_article

StressComponent = Literal["xx", "yy", "zz", "xy", "yz", "xz"]
Principal = Literal["major", "intermediate", "minor", "plane-major", "plane-minor"]

PressureOffset = Annotated[Given, Of("pressure", tied=True)]
StrainOffset = Annotated[Given, Of("strain", tied=True)]
ForceOffset = Annotated[Given, Of(None, tied=True)]
Stations = Annotated[list[Length], SharesUnit()]

_MOST_STATIONS = 10_000
_ZERO = (
    "Stage at whose end the gauge reads zero: it then reads the change since. Without it the "
    f"value itself is read. '{VIRGIN}' is the state before the first stage."
)
_TOWARDS = "A point on the inside of the beam; needed where ground is on both sides of it."


class _ForceGauge(GaugeBase):
    zero: Name = Field(VIRGIN, description=_ZERO)

    @model_validator(mode="after")
    def _no_drift_in_time(self) -> _ForceGauge:
        if self.drift is not None:
            message = "'drift' in time is there for gauges of lengths only"
            refuse(("drift",), "no-drift", message, "Give 'drift_per_stage', or an 'offset'.")
        return self

    @property
    def made_of(self) -> Reads:
        """Whether a value is read, or a change since a zero that the case gives."""
        return Reads.CHANGE if "zero" in self.model_fields_set else Reads.VALUE

    def at_point(
        self, name: str, part: str, point: Vector, direction: Vector, key: Context
    ) -> Channel:
        """One channel at a point; `part` is the quantity that it reads, empty for the only one."""
        motion = (str(getattr(self, "kind", "")), None, point, direction)
        found = self.reads(f"{name}.{part}" if part else name, name, motion, key.path)
        return replace(found, reads=self.made_of, quantity=part)


class StressGaugeSection(_ForceGauge):
    """Stress at a point: overcoring, flat jack, hydraulic fracturing, stress cells.

    Of `components` and `principal` values one channel each, named GAUGE.xx or GAUGE.major; of a
    `direction` one channel: the normal stress on the plane across it. Principal values count from
    the most compressive one: major, intermediate, minor of all directions; plane-major and
    plane-minor of those in the section of a plane model, or in the horizontal plane of a solid.
    """

    kind: Literal["stress"]
    accuracy: PressureAccuracy = Field(
        description="Standard deviation of one reading.", examples=["0.3 MPa"]
    )
    offset: PressureOffset | None = Field(None, description="Added to all readings.")
    drift_per_stage: PressureOffset | None = Field(None, description="Drift per stage.")
    point: Coordinates = Field(description="Where it is read.")
    components: list[StressComponent] | None = Field(
        None,
        min_length=1,
        description="Components that are read; zz of a section is out of plane, about an axis the "
        "hoop stress.",
    )
    principal: list[Principal] | None = Field(
        None, min_length=1, description="Principal values that are read."
    )
    direction: DirectionVector | None = Field(
        None, description="Normal of the plane whose normal stress is read."
    )
    effective: Flag = Field(
        False, description="Of the skeleton alone; else of skeleton and water together."
    )
    positive: Literal["tension", "compression"] = Field(
        "tension", description="Which stress has positive readings."
    )
    state: Literal["current", "virgin"] = Field(
        "current",
        description="virgin: the stress before all stages, whenever it was read, as by overcoring "
        "in ground that nothing has changed yet.",
    )

    @model_validator(mode="after")
    def _one_way(self) -> StressGaugeSection:
        ways = ("components", "principal", "direction")
        given = [way for way in ways if getattr(self, way) is not None]
        faults = SectionFaults()
        if len(given) != 1:
            message = f"found {' and '.join(given) or 'none of them'}; one of components, "
            message += "principal and direction is expected"
            faults.add((), "wrong-pair", message, "Give exactly one of them.")
        if self.state == "virgin" and "zero" in self.model_fields_set:
            message = "found 'zero' of a stress in the virgin state, which does not change"
            faults.add(("zero",), "wrong-pair", message, "Remove 'zero' or 'state: virgin'.")
        for way in ("components", "principal"):
            _refuse_twice(way, getattr(self, way) or [], faults)
        _refuse_no_direction("direction", self.direction, faults)
        faults.raise_any()
        return self

    @property
    def made_of(self) -> Reads:
        """A value, a change, or the value of the virgin state."""
        return Reads.VIRGIN if self.state == "virgin" else super().made_of

    @property
    def parts(self) -> Sequence[str]:
        """Quantities that are read; an empty one for the normal stress."""
        return self.components or self.principal or [""]

    def channel_names(self, name: str) -> list[str]:
        """One name for every component or principal value."""
        return [f"{name}.{part}" if part else name for part in self.parts]

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every component or principal value."""
        point = point_of(self.point, context.at("point"))
        direction = _direction(self.direction, context.at("direction"))
        known = [
            _has_component(part, context.at("components", n))
            for n, part in enumerate(self.components or ())
        ]
        if point is None or direction is None or not all(known):
            return []
        return [
            replace(
                self.at_point(name, part, point, direction, context),
                effective=self.effective,
                compression=self.positive == "compression",
            )
            for part in self.parts
        ]


class PressureCellSection(_ForceGauge):
    """Total pressure normal to a plane in the ground, or of the ground on a beam.

    Of skeleton and water together, compression positive. In the ground `normal` is the normal of
    the plane; on a beam (`on`) it is read across the beam, in the ground beside it.
    """

    kind: Literal["pressure-cell"]
    accuracy: PressureAccuracy = Field(
        description="Standard deviation of one reading.", examples=["10 kPa"]
    )
    offset: PressureOffset | None = Field(None, description="Added to all readings.")
    drift_per_stage: PressureOffset | None = Field(None, description="Drift per stage.")
    point: Coordinates = Field(description="Where it is read.")
    normal: DirectionVector | None = Field(
        None, description="Normal of the plane on which the pressure is read."
    )
    on: Name | None = Field(None, description="Beam on which the pressure is read.")
    towards: Coordinates | None = Field(None, description=_TOWARDS)

    @model_validator(mode="after")
    def _one_plane(self) -> PressureCellSection:
        faults = SectionFaults()
        if (self.normal is None) == (self.on is None):
            found = "neither" if self.on is None else "both"
            message = f"found {found}; either normal or on is expected"
            faults.add((), "wrong-pair", message, "Give exactly one of them.")
        elif self.towards is not None and self.on is None:
            message = "'towards' tells the sides of a beam apart, and none is given"
            faults.add(("towards",), "wrong-pair", message, "Remove it, or give 'on'.")
        _refuse_no_direction("normal", self.normal, faults)
        faults.raise_any()
        return self

    @property
    def structure(self) -> str | None:
        """The structure that it sits on."""
        return self.on

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        point = point_of(self.point, context.at("point"))
        normal = _direction(self.normal, context.at("normal"))
        inside = _optional_point(self.towards, context.at("towards"))
        if point is None or normal is None:
            return []
        found = self.at_point(name, "", point, normal, context)
        return [replace(found, structure=self.on or "", towards=inside, compression=True)]


class PiezometerSection(_ForceGauge):
    """Pressure of the water in the pores at a point, compression positive, zero above its table.

    It reads what the case says of the water, so it tells about its level and nothing else.
    """

    kind: Literal["piezometer"]
    accuracy: PressureAccuracy = Field(
        description="Standard deviation of one reading.", examples=["2 kPa"]
    )
    offset: PressureOffset | None = Field(None, description="Added to all readings.")
    drift_per_stage: PressureOffset | None = Field(None, description="Drift per stage.")
    point: Coordinates = Field(description="Where it is read.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        point = point_of(self.point, context.at("point"))
        none = (0.0,) * context.dim
        return [] if point is None else [self.at_point(name, "", point, none, context)]


class LoadCellSection(_ForceGauge):
    """Force of a structure: of one bolt, strut or anchor, or N, M or Q of a beam at a place.

    Bolts and anchors count tension positive, struts compression (`sign` says otherwise); N of a
    beam is positive in tension, M with tension on the inside, Q = dM/ds with s along the beam and
    its inside to the right. Forces of a beam are per metre.
    """

    kind: Literal["load-cell"]
    accuracy: ForceAccuracy = Field(
        description="Standard deviation of one reading: of one bar a force, of a beam N and Q in "
        "kN/m, M in kNm/m.",
        examples=["5 kN"],
    )
    offset: ForceOffset | None = Field(None, description="Added to all readings.")
    drift_per_stage: ForceOffset | None = Field(None, description="Drift per stage.")
    structure: Name = Field(description="The structure whose force is read.")
    bar: Annotated[int, Count()] | None = Field(
        None, description="Which of its bars, counted from 1; may be missing if it has one."
    )
    point: Coordinates | None = Field(None, description="Where on a beam.")
    quantity: Literal["N", "M", "Q"] = Field(
        "N", description="Axial force, bending moment or shear force."
    )
    sign: Literal["tension", "compression"] | None = Field(
        None, description="Which axial force has positive readings."
    )
    towards: Coordinates | None = Field(None, description=_TOWARDS)

    @property
    def dimension(self) -> str:
        """Dimension of what it reads: of one bar a force, of a beam a force or moment per metre."""
        if isinstance(self.accuracy, Given) and self.accuracy.text != ESTIMATE:
            return self.accuracy.dimension
        if self.point is None:
            return "force"
        return "moment per length" if self.quantity == "M" else "line load"

    @model_validator(mode="after")
    def _forces(self) -> LoadCellSection:
        faults = SectionFaults()
        numbers = {"accuracy": self.accuracy, "offset": self.offset}
        numbers["drift_per_stage"] = self.drift_per_stage
        for key, given in numbers.items():
            if not isinstance(given, Given) or given.parameter is not None:
                continue
            if given.text == ESTIMATE:
                continue
            if given.dimension not in FORCES:
                message = f"'{given.text}' is no force, line load or moment per length"
                hint = "Forces of one bar in kN; N and Q of a beam in kN/m, M in kNm/m."
                faults.add((key,), "unit", message, hint)
            elif given.dimension != self.dimension and self.dimension in FORCES:
                message = f"'{given.text}' is {with_article(given.dimension)}; the accuracy says "
                message += f"that {with_article(self.dimension)} is read"
                hint = f"Its units: {unit_list(self.dimension)}."
                faults.add((key,), "unit", message, hint)
        if self.sign is not None and self.quantity != "N":
            message = f"'sign' is that of the axial force; {self.quantity} is read"
            faults.add(("sign",), "wrong-pair", message, "Remove it; 'towards' turns moments.")
        faults.raise_any()
        return self

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        found = _on_structure(self, name, self.point, self.bar, self.towards, context)
        compression = None if self.sign is None else self.sign == "compression"
        return [replace(c, quantity=self.quantity, compression=bool(compression)) for c in found]


class StrainSection(_ForceGauge):
    """Strain, elongation positive: of the ground, along a fibre optic cable, of a structure.

    * `point` with `direction` or `component`: the strain of the ground there;
    * `between` two points: the mean strain from one to the other;
    * `along` a line with `every` or `at`: mean strains over the length `base` around each station,
      as a fibre optic cable reads them: channels GAUGE.2.5, with the station in metres along it;
    * `structure` with `bar`, or with `point` and `fibre`: of a bar, or of a fibre of a beam.

    Of the ground it is the change since `zero`; of a structure the value since it was built.
    """

    kind: Literal["strain"]
    accuracy: StrainAccuracy = Field(
        description="Standard deviation of one reading.", examples=["5 microstrain"]
    )
    offset: StrainOffset | None = Field(None, description="Added to all readings.")
    drift_per_stage: StrainOffset | None = Field(None, description="Drift per stage.")
    point: Coordinates | None = Field(None, description="Where it is read.")
    direction: DirectionVector | None = Field(None, description="Along which it is read.")
    component: StressComponent | None = Field(
        None, description="In place of a direction; of shear strains gamma = 2 eps."
    )
    between: Line | None = Field(None, description="The two points of a mean strain.")
    along: list[Coordinates] | None = Field(
        None, min_length=2, description="Points of the cable, straight between them."
    )
    every: GivenLength | None = Field(
        None, description="Distance of the stations along the cable.", examples=["0.25 m"]
    )
    at: Stations | None = Field(
        None, min_length=1, description="Stations along the cable, in place of `every`."
    )
    base: GivenLength | None = Field(
        None, description="Length over which each station is a mean; `every` if missing."
    )
    structure: Name | None = Field(None, description="The structure whose strain is read.")
    bar: Annotated[int, Count()] | None = Field(
        None, description="Which of its bars, counted from 1; may be missing if it has one."
    )
    fibre: Literal["inside", "outside", "axis"] | None = Field(
        None, description="Which fibre of a beam."
    )
    depth: GivenLength | None = Field(
        None,
        description="Distance of the fibre from the axis of the beam; half of its thickness if "
        "missing.",
    )
    towards: Coordinates | None = Field(None, description=_TOWARDS)

    @model_validator(mode="after")
    def _one_way(self) -> StrainSection:
        given = {key for key in _STRAIN_KEYS if getattr(self, key) is not None}
        faults = SectionFaults()
        if not any(needed <= given <= needed | more for needed, more in _STRAIN_WAYS):
            named = " and ".join(key for key in _STRAIN_KEYS if key in given)
            message = f"found {named or 'no place'}; expected is one of: {_STRAIN_WORDS}"
            faults.add((), "wrong-pair", message, "Give the keys of one of these ways.")
        _refuse_no_direction("direction", self.direction, faults)
        faults.raise_any()
        return self

    @property
    def made_of(self) -> Reads:
        """A change of the ground since the zero; of a structure its value, if no zero is given."""
        return Reads.CHANGE if self.structure is None else super().made_of

    def channel_names(self, name: str) -> list[str]:
        """One name; along a line one for every station."""
        if self.along is None:
            return [name]
        length = sum(math.dist(a, b) for a, b in pairwise(self._line()))
        return [f"{name}.{station:.6g}" for station in self._stations(length)]

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel; along a line one for every station."""
        if self.structure is not None:
            return self._of_structure(name, context)
        if self.along is not None:
            return self._along(name, context)
        if self.between is not None:
            return self._between(name, self.between, context)
        point = point_of(self.point or [], context.at("point"))
        direction = _direction(self.direction, context.at("direction"))
        if point is None or direction is None:
            return []
        if self.component and not _has_component(self.component, context.at("component")):
            return []
        found = self.at_point(name, "", point, direction, context)
        return [replace(found, quantity=self.component or "")]

    def _between(
        self, name: str, between: Sequence[list[Given]], context: Context
    ) -> list[Channel]:
        place = context.at("between")
        first, second = (point_of(point, place.at(n)) for n, point in enumerate(between))
        motion = distance(self.kind, first, second, place)
        if motion is None or first is None or second is None:
            return []
        return [self.reads(name, name, motion, context.path, _mean_strain([first, second]))]

    def _along(self, name: str, context: Context) -> list[Channel]:
        place = context.at("along")
        given = [point_of(point, place.at(n)) for n, point in enumerate(self.along or ())]
        line = [point for point in given if point is not None]
        if len(line) < len(given):
            return []
        for n, (a, b) in enumerate(pairwise(line), start=1):
            if a == b:
                message = "the point is the same as the one before"
                place.at(n).refuse("zero-length", message, "Remove one of them.")
                return []
        length = sum(math.dist(a, b) for a, b in pairwise(line))
        half, stations = self._base / 2, self._stations(length)
        if not self._fits(stations, half, length, context):
            return []
        found = []
        for station in stations:
            part = _part_of(line, station - half, station + half)
            terms = _mean_strain(part)
            direction = unit_vector(tuple(b - a for a, b in zip(part[0], part[-1], strict=True)))
            motion = (self.kind, part[0], part[-1], direction or (0.0,) * context.dim)
            channel = self.reads(f"{name}.{station:.6g}", name, motion, context.path, terms)
            found.append(channel)
        return found

    def _fits(
        self, stations: Sequence[float], half: float, length: float, context: Context
    ) -> bool:
        """Whether the stations with their bases lie on the line; a fault where they do not."""
        key = context.at("at" if self.at else "every")
        if not stations:
            message = f"the line is {length:.6g} m long, less than one base of {2 * half:.6g} m"
            key.refuse("beyond-line", message, "Correct the line or the length.")
        elif len(stations) > _MOST_STATIONS:
            message = f"{len(stations)} stations; at most {_MOST_STATIONS} are allowed"
            key.refuse("too-many-stations", message, "Let them be farther apart.")
        else:
            beyond = [s for s in stations if not -1e-9 <= s - half <= s + half <= length + 1e-9]
            if not beyond:
                return True
            message = f"the station {beyond[0]:.6g} m with its base of {2 * half:.6g} m reaches "
            message += f"beyond the line, which is {length:.6g} m long"
            key.refuse("beyond-line", message, "Correct the station, the base or the line.")
        return False

    def _line(self) -> list[Vector]:
        """The points of the line as they are written, m."""
        return [tuple(x.factor for x in point) for point in self.along or ()]

    @property
    def _base(self) -> float:
        given = self.base or self.every
        return 0.0 if given is None else given.factor

    def _stations(self, length: float) -> list[float]:
        if self.at is not None:
            return [station.factor for station in self.at]
        step, base = (self.every.factor if self.every else 0.0), self._base
        count = math.floor((length - base) / step * (1 + 1e-12) + 1e-9) + 1 if step else 0
        return [base / 2 + n * step for n in range(max(0, min(count, _MOST_STATIONS + 1)))]

    def _of_structure(self, name: str, context: Context) -> list[Channel]:
        found = _on_structure(self, name, self.point, self.bar, self.towards, context)
        depth = None if self.depth is None else self.depth.factor
        return [replace(c, quantity=self.fibre or "", fibre=depth) for c in found]


_STRAIN_WAYS: Sequence[tuple[set[str], set[str]]] = (
    ({"point", "direction"}, set()),
    ({"point", "component"}, set()),
    ({"between"}, set()),
    ({"along", "every"}, {"base"}),
    ({"along", "at", "base"}, set()),
    ({"structure"}, {"bar"}),
    ({"structure", "point", "fibre"}, {"depth", "towards"}),
)
"""Keys that are needed, and those that may be given with them."""
_STRAIN_KEYS = (
    "point", "direction", "component", "between", "along", "every", "at", "base", "structure",
    "bar", "fibre", "depth", "towards",
)  # fmt: skip
_STRAIN_WORDS = (
    "point and direction; point and component; between; along and every; along, at and base; "
    "structure (and bar); structure, point and fibre"
)

OnStructure = LoadCellSection | StrainSection | PressureCellSection


def on_structures(
    channels: Sequence[Channel],
    sections: Mapping[str, GaugeBase],
    structures: Mapping[str, Structure],
    context: Context,
) -> Iterator[Channel]:
    """Channels with the places that their structures give them; none, with a fault, without place.

    A bar gives its ends, and a strut that compression counts.

    Args:
        channels: of all gauges.
        sections: gauge to its section.
        structures: of the case.
        context: of the key `gauges`.
    """
    for channel in channels:
        structure = structures.get(channel.structure)
        if structure is None:
            if not channel.structure:
                yield channel
            continue  # an unknown structure is a fault of its own (`references`)
        section, place = sections[channel.gauge], context.at(channel.gauge)
        if isinstance(structure, Beam):
            if getattr(section, "point", None) is None:
                message = f"'{channel.structure}' is a beam; where on it is missing"
                place.refuse("missing-key", message, "Add 'point'.", key=True)
            elif getattr(section, "bar", None) is not None:
                message = f"'{channel.structure}' is a beam, which has no bars"
                place.at("bar").refuse("wrong-structure", message, "Remove it.", key=True)
            else:
                yield channel
        elif (found := _on_bar(channel, section, structure, place)) is not None:
            yield found


def _on_bar(channel: Channel, section: GaugeBase, bars: Bars, place: Context) -> Channel | None:
    """A channel on one of some bars; None, with a fault, where it is not known on which."""
    count, bar = len(bars.ends), getattr(section, "bar", None)
    name = channel.structure
    if channel.kind == "pressure-cell":
        message = f"'{name}' are bars, on which the ground does not press"
        place.at("on").refuse("wrong-structure", message, "Name a beam, or give 'normal'.")
    elif getattr(section, "point", None) is not None:
        message = f"'{name}' are bars, whose force is the same along each"
        hint = "Remove 'point', and say with 'bar' which of them."
        place.at("point").refuse("wrong-structure", message, hint, key=True)
    elif channel.quantity in ("M", "Q"):
        message = f"'{name}' are bars, which bear no {channel.quantity}; N is expected"
        place.at("quantity").refuse("wrong-structure", message, "Correct it, or name a beam.")
    elif bar is None and count > 1:
        message = f"'{name}' has {count} bars; which of them is missing"
        place.refuse("missing-key", message, "Add 'bar: 1', counted from 1.", key=True)
    elif bar is not None and bar > count:
        message = f"there is no bar {bar}; '{name}' has {count}"
        place.at("bar").refuse("no-such-bar", message, "They count from 1.")
    else:
        first, second = bars.ends[channel.member]
        along = unit_vector(tuple(b - a for a, b in zip(first, second, strict=True)))
        counts = getattr(section, "sign", None)
        pushed = isinstance(bars, Struts) if counts is None else counts == "compression"
        return replace(
            channel,
            first=first,
            second=second,
            direction=along or channel.direction,
            compression=pushed and channel.kind == "load-cell",
        )
    return None


def _on_structure(
    section: LoadCellSection | StrainSection,
    name: str,
    point: list[Given] | None,
    bar: int | None,
    towards: list[Given] | None,
    context: Context,
) -> list[Channel]:
    """The channel of a gauge on a structure; the place on a bar is found later."""
    none = (0.0,) * context.dim
    place = _optional_point(point, context.at("point"))
    inside = _optional_point(towards, context.at("towards"))
    if point is not None and place is None:
        return []
    found = section.at_point(name, "", place or none, none, context)
    member = 0 if bar is None else bar - 1
    return [replace(found, structure=section.structure or "", member=member, towards=inside)]


def _optional_point(given: list[Given] | None, place: Context) -> Vector | None:
    return None if given is None else point_of(given, place)


def _direction(given: list[Given] | None, place: Context) -> Vector | None:
    """A unit vector (dim,), zeros where none is given; None, with a fault, for no vector."""
    if given is None:
        return (0.0,) * place.dim
    vector = place.vector(given, "the direction")
    return None if vector is None else unit_vector(vector)


def _has_component(component: str, place: Context) -> bool:
    """Whether the analysis has a component; a fault where it has not."""
    if place.dim == 3 or component not in ("yz", "xz"):
        return True
    message = f"a plane model has no component {component}"
    place.refuse("wrong-dimension", message, "Its components: xx, yy, zz, xy.")
    return False


def _refuse_twice(key: str, names: Sequence[str], faults: SectionFaults) -> None:
    for n, name in enumerate(names):
        if name in names[:n]:
            faults.add((key, n), "duplicate", f"'{name}' is listed twice", "Remove one.")


def _refuse_no_direction(key: str, given: list[Given] | None, faults: SectionFaults) -> None:
    if given is not None and not any(x.factor for x in given):
        message = "the direction has length zero"
        faults.add((key,), "zero-direction", message, "Write a vector such as [0, 1].")


def _mean_strain(line: Sequence[Vector]) -> tuple[MovingPoint, ...]:
    """Points and vectors, 1/m, whose motions add up to the mean strain along a line."""
    length = sum(math.dist(a, b) for a, b in pairwise(line))
    terms: list[MovingPoint] = []
    for a, b in pairwise(line):
        along = tuple((y - x) / math.dist(a, b) / length for x, y in zip(a, b, strict=True))
        terms += [(a, tuple(-x for x in along)), (b, along)]
    return tuple(terms)


def _part_of(line: Sequence[Vector], start: float, end: float) -> list[Vector]:
    """The part of a line from one distance along it to another, m."""
    lengths = [math.dist(a, b) for a, b in pairwise(line)]
    at = [0.0, *accumulate(lengths)]
    bends = [point for s, point in zip(at, line, strict=True) if start < s < end]
    ends = []
    for s in (start, end):
        k = min(bisect_right(at, s, lo=1), len(lengths)) - 1
        t = (s - at[k]) / lengths[k]
        ends.append(tuple(x + t * (y - x) for x, y in zip(line[k], line[k + 1], strict=True)))
    return [ends[0], *bends, ends[1]]
