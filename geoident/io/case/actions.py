"""Actions from outside in a case: from their sections to the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from geoident.io.case.action_schema import (
    LoadSection,
    TemperatureFieldSection,
    TemperatureSection,
    WaterLoadSection,
    WaterSection,
)
from geoident.io.case.gauges import vector
from geoident.io.case.in_situ import surface_of
from geoident.io.case.values import Given
from geoident.io.text.faults import Faults
from geoident.model.actions import (
    HeadLine,
    Load,
    PointForce,
    Pressure,
    Seismic,
    Temperature,
    TemperatureField,
    Traction,
    Water,
    WaterPressure,
)
from geoident.model.case import Analysis, KeyPath
from geoident.model.parameter import Scalar

WATER = Scalar(9.81e3)
"""Unit weight of water, N/m3."""


class LoadBuilder:
    """Makes the loads of a case.

    Args:
        analysis: kind of analysis.
        gravity: whether there is any.
        faults: takes note of what does not fit.
    """

    def __init__(self, analysis: Analysis, *, gravity: bool, faults: Faults) -> None:
        self._analysis = analysis
        self._dim = analysis.dim
        self._gravity = gravity
        self._faults = faults

    def build(self, sections: Mapping[str, LoadSection], path: KeyPath) -> dict[str, Load]:
        """The loads at a place of the case, by name."""
        return {name: self._load(load, (*path, name)) for name, load in sections.items()}

    def _load(self, section: LoadSection, path: KeyPath) -> Load:
        group = section.on or ""
        if section.pressure is not None:
            return Pressure(group, section.pressure.scalar)
        if section.traction is not None:
            return Traction(group, self._scalars(section.traction, (*path, "traction")))
        if section.water is not None:
            return self._water(group, section.water, (*path, "water"))
        if section.seismic is not None:
            return self._seismic(section.seismic, (*path, "seismic"))
        return self._force(section, path)

    def _water(self, group: str, section: WaterLoadSection, path: KeyPath) -> WaterPressure:
        falls = None
        if section.falls is not None:
            place = (*path, "falls")
            start = self._point(section.falls.start, (*place, "from"))
            end = self._point(section.falls.end, (*place, "to"))
            falls = HeadLine(start, end, section.falls.level.scalar)
        weight = section.unit_weight
        return WaterPressure(group, section.level.scalar, weight.scalar if weight else WATER, falls)

    def _seismic(self, given: Sequence[Given], path: KeyPath) -> Seismic:
        if not self._gravity:
            message = "there is no gravity, of which it is a part"
            self._faults.add(path, "no-gravity", message, "Add 'gravity: 9.81 m/s2'.", key=True)
        return Seismic(self._scalars(given, path))

    def _force(self, section: LoadSection, path: KeyPath) -> PointForce:
        plane = self._analysis is Analysis.PLANE_STRAIN
        wanted, wrong = ("line_force", "force") if plane else ("force", "line_force")
        given = getattr(section, wanted) or getattr(section, wrong)
        if getattr(section, wrong) is not None:
            kind = self._analysis.value
            message = f"'{wrong}' in {kind} analysis; '{wanted}' is expected"
            unit = "kN/m" if plane else "kN"
            self._faults.add(
                (*path, wrong), "wrong-dimension", message, f"Give it in {unit}.", key=True
            )
        value = self._scalars(given, (*path, wanted))
        at = None if section.at is None else self._point(section.at, (*path, "at"))
        return PointForce(section.on or "" if at is None else at, value)

    def _scalars(self, given: Sequence[Given], path: KeyPath) -> tuple[Scalar, ...]:
        vector(given, self._dim, path, self._faults, what=f"the {str(path[-1]).replace('_', ' ')}")
        return tuple(number.scalar for number in given)

    def _point(self, given: Sequence[Given], path: KeyPath) -> tuple[float, ...]:
        return vector(given, self._dim, path, self._faults, what="the point") or ()


def build_water(section: WaterSection | None) -> Water | None:
    """Water in the pores."""
    if section is None:
        return None
    weight = section.unit_weight.scalar if section.unit_weight else WATER
    groups = None if section.groups is None else tuple(section.groups)
    return Water(surface_of(section.table), weight, groups)


def build_temperature(
    sections: Mapping[str, TemperatureSection], path: KeyPath, dim: int, faults: Faults
) -> dict[str, Temperature]:
    """Changes of temperature by group.

    Args:
        sections: what the case says, by group.
        path: of the key.
        dim: number of axes.
        faults: takes what is wrong.
    """
    return {
        group: _field(given, (*path, group), dim, faults)
        if isinstance(given, TemperatureFieldSection)
        else given.scalar
        for group, given in sections.items()
    }


def _field(
    section: TemperatureFieldSection, path: KeyPath, dim: int, faults: Faults
) -> TemperatureField:
    points = [
        vector(point, dim, (*path, "points", n), faults, what="the point") or ()
        for n, point in enumerate(section.points or ())
    ]
    factor = section.factor.scalar if section.factor else Scalar(1.0)
    values = tuple(value.factor for value in section.values or ())
    return TemperatureField(tuple(points), values, factor)
