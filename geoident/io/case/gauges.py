"""Gauges of a case to channels: every gauge is one or more relative displacements."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geoident.io.case.schema import (
    CaseSection,
    ConvergenceSection,
    DisplacementSection,
    ExtensometerSection,
    GaugeSection,
    SettlementSection,
)
from geoident.io.case.values import Given
from geoident.io.text.faults import Faults
from geoident.model.case import Analysis, KeyPath
from geoident.model.gauges import Channel
from geoident.model.parameter import Scalar

Vector = tuple[float, ...]
_AXES = "xyz"


def sections_of_channels(section: CaseSection) -> dict[str, GaugeSection]:
    """Names of all channels with what the case says of the gauge of each."""
    names: dict[str, GaugeSection] = {}
    for name, gauge in section.gauges.items():
        if isinstance(gauge, ExtensometerSection):
            names |= {f"{name}.{anchor}": gauge for anchor in gauge.anchors}
        else:
            names[name] = gauge
    return names


def build_channels(section: CaseSection, faults: Faults) -> tuple[Channel, ...]:
    """The channels of all gauges, in the order of the file."""
    dim = Analysis(section.analysis).dim
    channels: dict[str, Channel] = {}
    for name, gauge in section.gauges.items():
        for channel in _Gauge(name, gauge, dim, faults).channels():
            if channel.name in channels:
                message = f"two channels are named '{channel.name}'"
                faults.add(channel.key, "duplicate-channel", message, "Rename one.", key=True)
            channels[channel.name] = channel
    return tuple(channels.values())


def vector(
    given: Sequence[Given], dim: int, path: KeyPath, faults: Faults, *, what: str
) -> Vector | None:
    """Components in SI units; None, with a fault, where their number is not that of the axes.

    Args:
        given: the components as they are written.
        dim: number of axes.
        path: of the key.
        faults: takes what is wrong.
        what: has these components, for the message.
    """
    if len(given) == dim:
        return tuple(number.factor for number in given)
    message = f"{what} has {len(given)} components; {dim} expected ({', '.join(_AXES[:dim])})"
    hint = f"'analysis' says that there are {dim}: correct it or the components."
    faults.add(path, "wrong-dimension", message, hint)
    return None


class _Gauge:
    """One gauge on its way to channels."""

    def __init__(self, name: str, section: GaugeSection, dim: int, faults: Faults) -> None:
        self.name = name
        self.section = section
        self.dim = dim
        self.faults = faults
        self.path: KeyPath = ("gauges", name)

    def channels(self) -> list[Channel]:
        section = self.section
        if isinstance(section, ExtensometerSection):
            return self._extensometer(section)
        if isinstance(section, ConvergenceSection):
            ends = [self._point(p, "between", n) for n, p in enumerate(section.between)]
            return self._distance(self.name, ends[0], ends[1], "between")
        return self._displacement(section)

    def _point(self, given: Sequence[Given], *key: str | int) -> Vector | None:
        return vector(given, self.dim, (*self.path, *key), self.faults, what="the point")

    def _extensometer(self, section: ExtensometerSection) -> list[Channel]:
        head = self._point(section.head, "head")
        found: list[Channel] = []
        for anchor, given in section.anchors.items():
            point = self._point(given, "anchors", anchor)
            found += self._distance(f"{self.name}.{anchor}", head, point, "anchors", anchor)
        return found

    def _distance(
        self, name: str, first: Vector | None, second: Vector | None, *key: str
    ) -> list[Channel]:
        if first is None or second is None:
            return []
        direction = _unit(tuple(b - a for a, b in zip(first, second, strict=True)))
        if direction is None:
            self._refuse_zero(*key)
            return []
        written = key if self.section.kind == "extensometer" else ()
        return [self._channel(name, first, second, direction, written)]

    def _displacement(self, section: DisplacementSection | SettlementSection) -> list[Channel]:
        point = self._point(section.point, "point")
        ground = isinstance(section.relative_to, str)
        first = None if ground else self._point(list(section.relative_to), "relative_to")  # type: ignore[arg-type]
        direction = self._direction(section)
        if point is None or direction is None or (first is None and not ground):
            return []
        if first == point:
            self._refuse_zero("relative_to")
            return []
        return [self._channel(self.name, first, point, direction, ())]

    def _direction(self, section: DisplacementSection | SettlementSection) -> Vector | None:
        if isinstance(section, SettlementSection):
            return _axis(self.dim - 1, self.dim, -1.0)
        if section.direction is not None:
            path = (*self.path, "direction")
            given = vector(section.direction, self.dim, path, self.faults, what="the direction")
            return None if given is None else _unit(given)
        axis = _AXES.index(section.component or "x")
        if axis < self.dim:
            return _axis(axis, self.dim, 1.0)
        message = "a plane model has no displacement along z"
        self.faults.add((*self.path, "component"), "wrong-dimension", message, "Use x or y.")
        return None

    def _refuse_zero(self, *key: str) -> None:
        message = "both points are the same, so nothing can be read between them"
        hint = "Correct the coordinates of one."
        self.faults.add((*self.path, *key), "zero-length", message, hint)

    def _channel(
        self,
        name: str,
        first: Vector | None,
        second: Vector,
        direction: Vector,
        key: tuple[str, ...],
    ) -> Channel:
        section = self.section
        return Channel(
            name=name,
            gauge=self.name,
            kind=section.kind,
            first=first,
            second=second,
            direction=direction,
            accuracy=section.accuracy.factor,
            zero=section.zero,
            key=(*self.path, *key),
            offset=_scalar(section.offset),
            drift=_scalar(section.drift),
            drift_per_stage=_scalar(section.drift_per_stage),
            dimension=section.accuracy.dimension,
            unit=_shown_in(section.accuracy),
        )


def _shown_in(accuracy: Given) -> str:
    """The unit in which readings are shown: lengths in mm, all else in that of the accuracy."""
    return "mm" if accuracy.dimension == "length" else accuracy.unit


def _scalar(given: Given | None) -> Scalar | None:
    return None if given is None else given.scalar


def _unit(components: Vector) -> Vector | None:
    length = math.hypot(*components)
    return tuple(x / length for x in components) if length > 0 else None


def _axis(axis: int, dim: int, sign: float) -> Vector:
    return tuple(sign if n == axis else 0.0 for n in range(dim))
