"""A finite element model in service: what its gauges read under a level and temperatures.

From the last stage on the structure is elastic and stays as it is, so what a gauge sees is a sum of
what the water and the temperatures do to it (theory 16.7),

    y(t) = h(z(t)) + sum_j w_j q_j(t) + c(t)

with h the answer to the pressure of the water below a level z, w_j that to a temperature field V_j
and q_j(t) its amplitude on a day (`heat`). c(t) is what materials that creep, age or soften add, to
the first order: a sum over the load so far of the answers to their stress taken away under the
water at each level (`creep`). All of these answers are states of one staged analysis:
load cases that build on the last stage, which share its factorization and carry their derivatives.
Between levels h is a cubic spline; there are as many levels as keep its error below a hundredth of
the accuracy of the gauges. So a fit needs one factorization for each parameter vector, and nothing
elastic is solved for a single day.

All readings are relative to a constant of their gauge.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from geoident.errors import Fault, InputError
from geoident.fem.faces import load_patches
from geoident.fem.loads import facet_geometry
from geoident.fem.solvers import Solver, pick_solver
from geoident.forward.checks import check_on_mesh
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.kinds import place_gauges
from geoident.forward.gauges.observation import PlacedGauges
from geoident.forward.heat.conduction import heat_capacity, shapes_at_points
from geoident.forward.in_service.checks import (
    nonlinear_faults,
    service_faults,
    wetted_heights,
)
from geoident.forward.in_service.creep import MOTIONS, curve_fault
from geoident.forward.in_service.heat import HeatModel, mean_of_day
from geoident.forward.model import StagedModel, with_fields
from geoident.forward.observed import Query
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import PointTemperature, Water, WaterPressure
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case, Stage
from geoident.model.cells import CELLS
from geoident.model.dual import ParameterPoint
from geoident.model.in_service import DAY, YEAR, StructureInService
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

_APART = (0.5, 2.0)
"""Factors on parameters of heat at which temperatures are looked at."""

_FIRST_LEVELS, _MOST_LEVELS = 17, 129

_FINE = 0.01
"""Error of the interpolation between levels, in accuracies of a gauge."""

_NO_READINGS = ReadingPlaces(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
"""What all channels see is asked for, and no reading."""

_TO_COME = 2.0 * YEAR
"""For which creep is known beyond the loads, s: that of the next year is asked for."""

_REMEMBERED = 3
"""Parameter vectors whose answers are kept: a search asks again where another one ended."""


def service_model(mesh: Mesh, case: Case, *, solver: Solver) -> ServiceModel:
    """The model of a structure in service, after all checks.

    Args:
        mesh: its mesh.
        case: the case.
        solver: factorizes the stiffness matrices.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """
    on_mesh, gauges = check_on_mesh(case, mesh)
    if faults := [*service_faults(on_mesh)]:
        raise InputError(faults)
    model = ServiceModel(with_fields(on_mesh), gauges, solver=solver)
    if faults := [*nonlinear_faults(model), *model.curve_faults()]:
        raise InputError(faults)
    return model


@dataclass(frozen=True)
class Motions:
    """What acts makes of some readings (k), SI, without the constants of the gauges.

    Args:
        parts: ``level``, ``temperature`` and, where a material changes, ``creep``, what each makes
            of them: (k, 1 + n) with derivatives, NaN where it is not known.
    """

    parts: Mapping[str, Floats]

    @property
    def total(self) -> Floats:
        """(k, 1 + n) their sum."""
        return np.asarray(sum(self.parts.values()))


@dataclass(frozen=True)
class _Answers:
    """What all channels see at one parameter vector.

    Args:
        levels: (l, n_channels, 1 + n) of the water at the levels.
        warmed: (d, n_channels, 1 + n) of the temperatures of all days; None for none.
        crept: (d, n_channels, 1 + n) of creep, ageing and softening on all days; None for none.
    """

    levels: Floats
    warmed: Floats | None = None
    crept: Floats | None = None


class ServiceModel(StagedModel):
    """`StagedModel` of a case in service; `service_model` gives one that is checked.

    By itself it answers for the stages; `motions` for readings in service.

    Args:
        on_mesh: the case and the mesh that it fits.
        gauges: those of the case, on its mesh.
        solver: factorizes the stiffness matrices.
    """

    def __init__(self, on_mesh: CaseOnMesh, gauges: PlacedGauges, *, solver: Solver) -> None:
        super().__init__(on_mesh, gauges, solver=solver)
        service = on_mesh.case.service
        assert service is not None
        self.service: StructureInService = service
        self.last = len(self.bases) - 1
        self._answers: dict[bytes, _Answers] = {}

    @cached_property
    def heat(self) -> HeatModel | None:
        """The temperatures; None where they do not change."""
        if self.service.air is None:
            return None
        solver = pick_solver(self._solver.name)  # its factors are not those of the stiffness
        return HeatModel(self.on_mesh, self.service, self.last, self._places, solver)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        return (*super().notes, *self._thick_elements())

    def _thick_elements(self) -> Iterator[str]:
        """Elements behind faces in air and water that are too thick for the temperature there."""
        if self.service.air is None:
            return
        state, points = self.sequence.states[self.last], self.discretization.points
        present = self.sequence.present(self.last)
        volume = np.bincount(points.element, points.volume, minlength=self.mesh.n_elements)
        point, worst = ParameterPoint(self.case.start, ()), (1.0, 0.0, 0.0)
        for group in (*self.service.wetted, *self.service.in_air):
            for patch in load_patches(self.mesh, self.on_mesh.table, group, present) or ():
                normals = facet_geometry(self.mesh.points, patch, self.on_mesh.kinematics).normals
                area = np.linalg.norm(normals, axis=2).sum(axis=1)
                thick = volume[patch.element] / area / CELLS[patch.kind].order
                for element, spacing in zip(patch.element, thick, strict=True):
                    material = self.case.materials[
                        state.materials[int(self.sequence.group_of[element])]
                    ]
                    assert material.conductivity is not None
                    k = float(point.number(material.conductivity).value)
                    reach = np.sqrt(k / float(heat_capacity(material, point).value) * YEAR / np.pi)
                    worst = max(worst, (2.0 * spacing / reach, spacing, reach))
        if worst[0] > 1.0:
            _, spacing, reach = worst
            yield (
                f"behind faces in air and water nodes are up to {spacing:.2g} m apart, and the "
                f"temperature of a year reaches {reach:.2g} m deep: with more than "
                f"{0.5 * reach:.2g} m there the mesh shifts conductivity and expansion"
            )

    def curve_faults(self) -> Iterator[Fault]:
        """Creep, ageing and softening that are impossible at the start values."""
        for name, kind, fault in self._wrong_curves(ParameterPoint(self.case.start, ())):
            path, hint = ("materials", name, kind), "Correct its share or its time, or their start."
            yield self.case.source.fault(path, "impossible-curve", f"'{name}': {fault}", hint)

    def _wrong_curves(self, point: ParameterPoint) -> Iterator[tuple[str, str, str]]:
        """Material, kind and a clause for each curve whose numbers are impossible."""
        longest = float(self._creep_days[-1] - self.loaded) if self.creeping else 0.0
        for name in self.creeping:
            for kind, curve in self.case.materials[name].in_time.items():
                if (fault := curve_fault(kind, curve, longest, point)) is not None:
                    yield name, kind, fault

    def domain_fault(self, p: Floats) -> str | None:
        """Why finite p (n,) is outside the domain, or None."""
        if (fault := super().domain_fault(p)) is not None:
            return fault
        point = ParameterPoint(self.values(p), ())
        for name, _, fault in self._wrong_curves(point):
            return f"{name}: {fault}"
        names = self.sequence.states[self.last].materials.values() if self.service.air else ()
        for name in set(names):
            material = self.case.materials[name]
            assert material.conductivity is not None
            sizes = point.number(material.conductivity), heat_capacity(material, point)
            if not all(float(size.value) > 0.0 for size in sizes):
                return f"conductivity and heat capacity of {name} must be positive"
        return None

    def motions(self, p: Floats, rows: Ints, times: Floats, loads: Floats | None = None) -> Motions:
        """What acts makes of readings.

        Args:
            p: (n,) parameters, SI.
            rows: (k,) channels.
            times: (k,) when they are read, s since 1970.
            loads: (k,) times whose level and temperatures act then; None: the same. Creep goes on.

        Raises:
            ModelError: there is no solution.
        """
        loads = times if loads is None else loads
        answers = self._answered(p)
        n = answers.levels.shape[2]
        level, temperature = np.zeros((len(rows), n)), np.zeros((len(rows), n))
        if self.service.level is not None:
            z = np.clip(self.service.level.at(loads), *self.levels[[0, -1]])
            self._interpolated(answers.levels, z, rows, level)
        if self.heat is not None and answers.warmed is not None:
            temperature = _between(self._days, answers.warmed, loads, rows)
            temperature[~self.heat.known(loads)] = np.nan
        parts = {"level": level, "temperature": temperature}
        if answers.crept is not None:
            parts["creep"] = _between(self._creep_days, answers.crept, times, rows)
        return Motions(
            {
                name: self.instrument_errors.scaled(part, self.values(p), self.names, rows)
                for name, part in parts.items()
            }
        )

    def _interpolated(self, table: Floats, z: Floats, rows: Ints, into: Floats) -> None:
        """Splines of a table (l, n_channels, 1 + n) at levels z (k,) and channels (k,)."""
        spline = _spline(self.levels, table)
        known = np.isfinite(z)
        into[~known] = np.nan
        for row in np.unique(rows):
            at = np.flatnonzero((rows == row) & known)
            into[at] = spline.construct_fast(spline.c[:, :, row], spline.x)(z[at])

    def _answered(self, p: Floats) -> _Answers:
        key = p.tobytes()
        if key not in self._answers:
            while len(self._answers) >= _REMEMBERED:
                del self._answers[next(iter(self._answers))]
            self._answers[key] = self._answer(p)
        return self._answers[key]

    def _answer(self, p: Floats) -> _Answers:
        loaded = self._loaded
        states = len(loaded.bases)
        self.evaluations += 1
        observed = loaded.observe(p, Query(_NO_READINGS, states - 1), adjoints=False)
        seen = observed.seen[self.last + 1 :] - observed.seen[self.last]
        number = len(self.levels) if self.service.level is not None else 0
        fields = seen[max(number, 1) * len(self.creeping) + number :]
        under = seen[: len(seen) - len(fields)].reshape(max(number, 1), -1, *seen.shape[1:])
        levels, more = (under[:, 0], under[:, 1:] - under[:, :1]) if number else (seen[:0], under)
        point = ParameterPoint(self.values(p), self.names)
        return _Answers(
            levels,
            None if self.heat is None else self._warmed(self.heat, fields, point),
            self._crept(more, point) if self.creeping else None,
        )

    def _warmed(self, heat: HeatModel, fields: Floats, point: ParameterPoint) -> Floats:
        """What temperatures make of all days, from that of their fields (s, n_channels, 1 + n)."""
        q = np.einsum(
            "sj,djn->dsn", self._fields[1], heat.amplitudes(point, self._theta), optimize=True
        )
        days = np.einsum("djn,jc->dcn", q, fields[..., 0], optimize=True)
        days[..., 1:] += np.einsum("dj,jcn->dcn", q[..., 0], fields[..., 1:], optimize=True)
        return np.asarray(days)

    def _crept(self, more: Floats, point: ParameterPoint) -> Floats:
        """The same of creep, ageing and softening.

        Args:
            more: (l, m, n_channels, 1 + n) the answers to the stress of each of m materials taken
                away, under the water at each level.
            point: the parameters.
        """
        days, level = self._creep_days, self.service.level
        if level is not None:
            past = days - np.maximum(np.ceil((days - level.times[-1]) / YEAR), 0.0) * YEAR
            z = np.clip(mean_of_day(level, past), *self.levels[[0, -1]])
            if self.loaded < level.times[0]:  # what was before is not known
                z[0] = np.clip(level.values.mean(), *self.levels[[0, -1]])
            loads = _spline(self.levels, more)(z)
        else:
            loads = np.repeat(more, len(days), axis=0)
        total = np.zeros((len(days), *more.shape[2:]))
        since = float(days[0] - self.loaded)
        for k, name in enumerate(self.creeping):
            for kind, curve in self.case.materials[name].in_time.items():
                total += MOTIONS[kind](loads[:, k], since, curve, point)
        return total

    @cached_property
    def creeping(self) -> tuple[str, ...]:
        """Materials of the structure in service that creep, age or soften."""
        names = dict.fromkeys(self.sequence.states[self.last].materials.values())
        return tuple(name for name in names if self.case.materials[name].in_time)

    @cached_property
    def loaded(self) -> float:
        """When the sustained loads began to act, s since 1970."""
        service = self.service
        return service.since if service.loaded is None else service.loaded

    @cached_property
    def _creep_days(self) -> Floats:
        """(d,) days under load with a known level and some to come, s since 1970.

        The water of those to come is that of the same days of the last year.
        """
        level, end = self.service.level, max(one.times[-1] for one in self.service.series)
        first = self.loaded if level is None else max(self.loaded, float(level.times[0]))
        last = max(end if level is None else float(level.times[-1]), first) + _TO_COME
        return np.arange(np.ceil(first / DAY), np.ceil(last / DAY) + 1.0) * DAY

    @cached_property
    def _fields(self) -> tuple[Floats, Floats]:
        """Temperature fields (n_nodes, s), and (s, r) what they are made of.

        They are those of all days at the start values, and with each parameter of heat half and
        twice as large.
        """
        assert self.heat is not None
        return self.heat.principal_fields(
            [self.heat.amplitudes(point, self._theta)[..., 0] for point in self._places]
        )

    @cached_property
    def _places(self) -> tuple[ParameterPoint, ...]:
        """The start, and with each parameter of heat half and twice as large."""
        places = [self.case.start]
        for parameter in self.case.parameters:
            for factor in _APART if parameter.name in self.of_heat else ():
                moved = np.clip(parameter.start * factor, parameter.lower, parameter.upper)
                places.append({**self.case.start, parameter.name: float(moved)})
        return tuple(ParameterPoint(values, ()) for values in places)

    @cached_property
    def of_heat(self) -> frozenset[str]:
        """Parameters on which temperatures depend."""
        materials = [
            self.case.materials[name] for name in self.sequence.states[self.last].materials.values()
        ]
        numbers = [self.service.film]
        for one in materials:
            numbers += [one.conductivity, one.heat_capacity, one.specific_heat]
            numbers += [one.density] if one.specific_heat is not None else []
        return frozenset().union(*(n.parameters for n in numbers if n is not None))

    @cached_property
    def _days(self) -> Floats:
        assert self.heat is not None
        return self.heat.days()

    @cached_property
    def _theta(self) -> Floats:
        assert self.heat is not None
        return self.heat.inputs_at(self._days)

    @cached_property
    def levels(self) -> Floats:
        """(l,) levels of the water at which its effect is solved, m, ascending."""
        return self._with_levels[0]

    @property
    def _loaded(self) -> StagedModel:
        """The same case with a state for each level and each temperature field."""
        return self._with_levels[1]

    @cached_property
    def _with_levels(self) -> tuple[Floats, StagedModel]:
        """As many levels as the accuracies of the gauges ask for, at the start values."""
        low, high = wetted_heights(self.on_mesh, self.service)
        start = np.array([parameter.start for parameter in self.case.parameters])
        accuracy = np.array([channel.accuracy for channel in self.case.channels])
        number = _FIRST_LEVELS
        while True:
            levels = np.linspace(low, high, number)
            model = self._under(levels)
            if self.service.level is None or number >= _MOST_LEVELS:
                return levels, model
            each = 1 + len(self.creeping)
            last = self.last + number * each
            observed = model.observe(start, Query(_NO_READINGS, last, derivatives=False))
            seen = observed.seen[self.last + 1 :: each, :, 0]
            if np.all(_spline_error(levels, seen) < _FINE * accuracy):
                return levels, model
            number = 2 * number - 1

    def _under(self, levels: Floats) -> StagedModel:
        """The case with load cases behind the last stage.

        Water at each level and, after it, the stress of each material that creeps taken away; then
        temperature fields.
        """
        case, base = self.case, self.case.stage_names[-1]
        state = self.sequence.states[self.last]

        def relaxed(under: str) -> Iterator[Stage]:
            for name in self.creeping:
                of_it = (g for g, material in state.materials.items() if material == name)
                groups = tuple(self.sequence.groups[g] for g in of_it)
                words = f"creep of {name}, {under}"
                yield Stage(words, relaxed=groups, base=under, independent=True)

        stages = [*relaxed(base)] if self.service.level is None else []
        if self.service.level is not None:
            for level in levels:
                parts, z = 16 if self.mesh.dim == 2 else 4, Scalar(float(level))
                loads = {
                    f"water of the service on {group}": WaterPressure(group, z, parts=parts)
                    for group in self.service.wetted
                }
                pores = None
                for uplift in self.service.uplift:
                    loads |= {
                        f"uplift on {group}": WaterPressure(
                            group, z, falls=uplift.falls, parts=parts
                        )
                        for group in uplift.on
                    }
                    if uplift.pores:
                        pores = Water(z, groups=uplift.pores, falls=uplift.falls)
                name = f"water at {level:.9g} m"
                stages.append(Stage(name, loads=loads, water=pores, base=base, independent=True))
                stages += relaxed(name)
        if self.heat is not None:
            groups = [self.sequence.groups[g] for g in state.materials]
            at_points = shapes_at_points(self.mesh, self.discretization)
            for number, values in enumerate((at_points @ self._fields[0]).T):
                field = PointTemperature(np.ascontiguousarray(values))
                warmed = dict.fromkeys(groups, field)
                name = f"temperature field {number + 1}"
                stages.append(Stage(name, temperature=warmed, base=base, independent=True))
        with_loads = replace(case, stages=(*case.stages, *stages))
        on_mesh = replace(self.on_mesh, case=with_loads)
        gauges, faults = place_gauges(on_mesh)
        if faults:
            raise InputError(faults)
        return StagedModel(on_mesh, gauges, solver=self._solver)


def _between(days: Floats, table: Floats, times: Floats, rows: Ints) -> Floats:
    """Of a table (d, n_channels, 1 + n) on days (d,), at times (k,) and channels (k,): linear."""
    values = np.empty((len(rows), table.shape[2]))
    for row in np.unique(rows):
        at = np.flatnonzero(rows == row)
        for c in range(table.shape[2]):
            values[at, c] = np.interp(times[at], days, table[:, row, c])
    return values


def _spline(levels: Floats, table: Floats) -> CubicSpline:
    """Of values (l, ...) at levels (l,), m."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - 0.2 s, and only here

    return CubicSpline(levels, table, axis=0)


def _spline_error(levels: Floats, seen: Floats) -> Floats:
    """(n_channels,) estimated error of the spline through all levels.

    It is less than an eighth of that through every second one at the levels between: it goes with
    the third power of their distance where the slope of the face changes, with the fourth
    elsewhere.
    """
    between = _spline(levels[::2], seen[::2])(levels[1::2])
    return np.asarray(0.125 * np.abs(between - seen[1::2]).max(axis=0))


def known_at(service: StructureInService, heat: HeatModel | None, times: Floats) -> Bools:
    """(k,) at which times all that acts is known."""
    known = np.ones(len(times), dtype=np.bool_)
    if service.level is not None:
        known &= np.isfinite(service.level.at(times))
    return known if heat is None else known & heat.known(times)
