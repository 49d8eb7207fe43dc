"""What the pictures of one result have in common: case, planes, windows, stages, derived fields."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from matplotlib.transforms import Bbox

from geoident.errors import InputError
from geoident.fem.location import Locator, Site
from geoident.io.case.file import parse_case
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.mesh import element_centres
from geoident.model.moments import with_states
from geoident.model.results.result import FieldSeries, GaugeTable, Result
from geoident.report.drawing.sheets import Plane, Sheet, SheetMaker, Trace
from geoident.report.drawing.style import MM, evenly, short
from geoident.report.text.case import axis_names

MOST_STAGES = 12
"""Stages that a figure shows one by one; of more, evenly spaced ones."""

_MARGIN = 0.2
_NICE = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Window:
    """The part of a sheet that is shown: its corners (2,), m."""

    low: Floats
    high: Floats

    @property
    def aspect(self) -> float:
        """Height over width."""
        return float((self.high[1] - self.low[1]) / (self.high[0] - self.low[0]))

    @property
    def size(self) -> float:
        """The longer side, m."""
        return float((self.high - self.low).max())


class Scene:
    """The fields of a result, ready to be drawn.

    Args:
        result: a result with fields.
        fields: its fields.
        only: the one state to be shown; None for those that tell most.
    """

    def __init__(self, result: Result, fields: FieldSeries, only: int | None = None) -> None:
        self.result = result
        self.fields = fields
        self.only = only
        self.axis_names = axis_names(result)
        self._maker = SheetMaker(fields.mesh)
        self._sections: dict[Plane, Sheet] = {}

    @property
    def solid(self) -> bool:
        """Whether the model has three dimensions."""
        return self.fields.mesh.dim == 3

    @cached_property
    def views(self) -> tuple[SheetView, ...]:
        """The plane, or cuts through the gauges, the one with most of them first."""
        sheets = (
            [self._maker.flat()]
            if not self.solid
            else [
                self.section(plane)
                for plane in planes_through(gauge_points(self.result.gauges), self.box)
            ]
        )
        met = [sheet for sheet in sheets if len(sheet.triangles)]
        return tuple(SheetView(self, sheet, number) for number, sheet in enumerate(met, start=1))

    def section(self, plane: Plane) -> Sheet:
        """The cut through a solid along a plane, made once."""
        if plane not in self._sections:
            self._sections[plane] = self._maker.cut(plane)
        return self._sections[plane]

    @cached_property
    def box(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the mesh, (dim,) each, m."""
        points = self.fields.mesh.points
        return points.min(axis=0), points.max(axis=0)

    @cached_property
    def last_fitted(self) -> int:
        """State of the last stage whose readings were used; the last of all where none was."""
        used = np.flatnonzero(self.result.gauges.used.any(axis=0))
        return 1 + int(used.max()) if used.size else self.n_states - 1

    @property
    def since(self) -> str:
        """From when on displacements count."""
        present = self.fields.present
        placed = bool((present & ~present[0]).any() or (present[1:] & ~present[:-1]).any())
        return "since the initial state" + (", or since the ground was placed" if placed else "")

    @property
    def n_states(self) -> int:
        """The virgin state and those after every stage."""
        return len(self.fields.displacement)

    @cached_property
    def states(self) -> tuple[int, ...]:
        """States after stages that are shown one by one."""
        if self.only is not None:
            return (self.only,)
        states = self.reached
        if len(states) > MOST_STAGES:
            chosen = states[evenly(len(states), MOST_STAGES)]
            ends = states[self.result.gauges.ends[states - 1]]
            if len(ends) < len(states):  # of stages that last all ends, and moments between them
                ends = ends[evenly(len(ends), MOST_STAGES)]
                between = np.setdiff1d(chosen, ends)[: MOST_STAGES - len(ends)]
                chosen = np.concatenate([ends, between])
            states = np.unique(chosen)
        return tuple(int(state) for state in states)

    @cached_property
    def reached(self) -> Ints:
        """States (k,) after stages; without those that collapse and what builds on them."""
        unknown = np.isnan(self.fields.displacement.sum(axis=(1, 2)))
        return np.flatnonzero(~unknown[1:]) + 1

    @property
    def key_states(self) -> tuple[int, ...]:
        """The last fitted state and the last of all."""
        if self.only is not None:
            return (self.only,)
        return tuple(sorted({self.last_fitted, int(self.reached[-1])} & set(self.reached.tolist())))

    def stage(self, state: int) -> str:
        """The name of a state."""
        return self.result.gauges.stages[state - 1] if state else "initial state"

    def title(self, state: int) -> str:
        """The name of a state for a panel, and whether it comes after the last fitted one."""
        return short(self.stage(state), 20) + " (predicted)" * (state > self.last_fitted)

    @cached_property
    def case(self) -> Case | None:
        """The case, from the result; None where it cannot be read."""
        return case_of(self.result)

    @cached_property
    def zero_state(self) -> int:
        """The state in which most of the channels were zeroed, before those that are shown."""
        stages = self.result.gauges.stages
        zeros = [channel.zero for channel in self.case.channels] if self.case is not None else []
        states = [stages.index(zero) + 1 for zero in zeros if zero in stages]
        states += [0] * (len(zeros) - len(states))
        earlier = [state for state in states if state < min(self.key_states, default=0)]
        return Counter(earlier).most_common(1)[0][0] if earlier else 0

    def base(self, state: int) -> int:
        """The state on which the stage that leads to a state builds."""
        if self.case is None or state == 0:
            return max(state - 1, 0)
        stages = self.case.stages[:state]
        if len(stages) < state:
            return state - 1
        if stages[-1].base is not None:
            names = [stage.name for stage in stages]
            return names.index(stages[-1].base) + 1 if stages[-1].base in names else 0
        return next((k for k in range(state - 1, 0, -1) if not stages[k - 1].independent), 0)

    def history(self, state: int) -> tuple[int, ...]:
        """The stages that lead to a state, in their order."""
        states = []
        while state > 0:
            states.append(state)
            state = self.base(state)
        return tuple(reversed(states))

    def displacement(self, state: int, *, since: int = 0) -> Floats:
        """(n_nodes, dim) since another state, m; of what was placed later since then."""
        return np.asarray(self.fields.displacement[state] - self.fields.displacement[since])

    @cached_property
    def locator(self) -> Locator:
        """Finds the elements in which points lie."""
        return Locator(self.fields.mesh)

    @cached_property
    def moved(self) -> Bools:
        """(n_elements,) excavated or placed at some stage."""
        present = self.fields.present
        return np.asarray((present != present[0]).any(axis=0))

    @cached_property
    def near(self) -> Floats:
        """(k, dim) points of the gauges and centres of what is excavated or placed, m."""
        centres = element_centres(self.fields.mesh)[self.moved]
        return np.vstack([gauge_points(self.result.gauges), centres])

    def borders_label(self, state: int) -> Ints:
        """Labels (n_elements,) for `Sheet.borders`: groups of what is present, -1 for the rest."""
        return np.where(self.fields.present[state], self._maker.label, -1)

    def magnification(self, size: float) -> float:
        """A round factor that makes the largest displacement a twentieth of a size (m)."""
        largest = max(
            float(np.linalg.norm(self.displacement(s), axis=1).max()) for s in self.key_states
        )
        return round_down(0.05 * size / largest) if largest > 0 else 1.0

    @cached_property
    def gauge_motion(self) -> tuple[Floats, Floats]:
        """Gauge points (k, dim), m, and displacements (n_states, k, dim); NaN where absent."""
        points = np.unique(gauge_points(self.result.gauges).round(6), axis=0)
        locator, fields = self.locator, self.fields
        places = [tuple(point) for point in points.tolist()]
        locator.find(places)
        motion = np.full((self.n_states, *points.shape), np.nan)
        for k, place in enumerate(places):
            for state in range(self.n_states):
                site = locator.best(place, fields.present[state])
                if site is not None:
                    moved = (
                        fields.displacement[state, site.nodes] - fields.displacement[0, site.nodes]
                    )
                    motion[state, k] = site.shapes @ moved
        return points, motion


class SheetView:
    """A sheet of a scene, in the window around the gauges and the construction.

    Args:
        scene: what is drawn.
        sheet: the plane, or a section of a solid.
        number: of the section.
    """

    def __init__(self, scene: Scene, sheet: Sheet, number: int = 1) -> None:
        self.scene = scene
        self.sheet = sheet
        self.across = list(sheet.axes)
        self.tag = f"section-{number}-" if scene.solid else ""
        self.where = f", section {sheet.plane}" if sheet.plane is not None else ""
        self.layouts: dict[int, list[Bbox]] = {}
        """Places of the axes of figures of so many panels, which are the same for all fields."""
        self._areas: dict[int, tuple[Ints, Floats]] = {}
        self._lines: dict[int, tuple[Trace, Trace]] = {}

    @cached_property
    def window(self) -> Window:
        """The part with the gauges and the construction, and a margin, in the mesh."""
        near = self.scene.near[:, self.across]
        low, high = (corner[self.across] for corner in self.scene.box)
        if not len(near) or not np.all(np.ptp(near, axis=0) > 0):
            return Window(low, high)
        return Window(*box_around(near, (low, high)))

    def lines(self, state: int) -> tuple[Trace, Trace]:
        """Where groups meet in a state, and where the ground ends."""
        if state not in self._lines:
            present = self.scene.fields.present[state]
            borders = self.sheet.borders(self.scene.borders_label(state))
            self._lines[state] = borders, self.sheet.outline(present)
        return self._lines[state]

    def areas(self, state: int) -> tuple[Ints, Floats]:
        """Triangles (m, 3) in the window that are present in a state, and their areas (m,), m2."""
        if state not in self._areas:
            sheet = self.sheet
            triangles = sheet.triangles[self.scene.fields.present[state][sheet.element]]
            a, b, c = (sheet.xy[corner] for corner in triangles.T)
            centre = (a + b + c) / 3
            inside = ((centre >= self.window.low) & (centre <= self.window.high)).all(axis=1)
            (ux, uy), (vx, vy) = (b - a)[inside].T, (c - a)[inside].T
            self._areas[state] = triangles[inside], 0.5 * np.abs(ux * vy - uy * vx)
        return self._areas[state]

    def weighted(self, state: int, value: Floats) -> Floats:
        """(2, m) means of a quantity on the present triangles in the window, and their areas.

        Args:
            state: number of the state.
            value: (n,) at the points of the sheet.
        """
        triangles, areas = self.areas(state)
        a, b, c = triangles.T
        mean = (value[a] + value[b] + value[c]) / 3
        return np.stack([mean, areas])[:, np.isfinite(mean)]

    def displacement_size(self, state: int, *, since: int = 0) -> Floats:
        """Length (n,) of the displacement since another state at the n points, mm."""
        moved = self.sheet.of_nodes(self.scene.displacement(state, since=since))
        return np.asarray(MM * np.linalg.norm(moved, axis=1))

    @cached_property
    def _principal(self) -> tuple[Ints, Floats]:
        """Elements (k,) behind the sheet with their principal stresses (n_states, k, 3), Pa."""
        elements = self.sheet.elements_behind
        return elements, principal_stresses(self.scene.fields.stress[:, elements])

    def stress(self, state: int, which: int) -> Floats:
        """A principal stress (n,) at the n points, Pa; NaN where nothing is present.

        Args:
            state: number of the state.
            which: 0 for the least: the largest compression.
        """
        fields, (elements, stresses) = self.scene.fields, self._principal
        values = np.full(fields.mesh.n_elements, np.nan)
        values[elements] = stresses[state, :, which]
        return self.sheet.of_corners(self.sheet.corners.average(values, fields.present[state]))

    def sites(self, state: int, places: Floats) -> list[Site | None]:
        """The present elements in which places (k, 2), m, lie; None where there is none."""
        points, plane = places, self.sheet.plane
        if plane is not None:
            points = np.insert(places, plane.axis, plane.value, axis=1)
        each = [tuple(point) for point in points.tolist()]
        self.scene.locator.find(each)
        present = self.scene.fields.present[state]
        return [self.scene.locator.best(point, present) for point in each]

    def holds(self, points: Floats) -> Bools:
        """Which points (k, dim), m, lie on it, within a hundredth of the size of the model."""
        plane = self.sheet.plane
        if plane is None:
            return np.ones(len(points), dtype=bool)
        near = 1e-2 * float((self.scene.box[1] - self.scene.box[0]).max())
        return np.asarray(np.abs(points[:, plane.axis] - plane.value) <= near)

    def gauges(self) -> Iterator[tuple[str, Floats]]:
        """Name and ends (k, 2), m, of each channel that lies on it."""
        table = self.scene.result.gauges
        for name, first, second in zip(table.gauges, table.first, table.second, strict=True):
            ends = np.array([end for end in (first, second) if np.isfinite(end).all()])
            if len(ends) and self.holds(ends).all():
                yield name, ends[:, self.across]


@lru_cache(maxsize=8)  # A page asks for the case of each of few results several times.
def _case_of_text(text: str) -> Case | None:
    """The case of a result from its text, without readings; None where it cannot be read."""
    try:
        return parse_case(
            text, "case.yaml", overrides=["readings=[]"], with_mesh=False, with_texts=False
        ).case
    except InputError:
        return None


def case_of(result: Result) -> Case | None:
    """The case of a result without its readings; None where this version cannot read it."""
    case = _case_of_text(result.case_resolved)
    return None if case is None else with_states(case, result.gauges.stages)


def principal_stresses(stress: Floats) -> Floats:
    """Principal stresses (..., 3), ascending: compression first; zero where there is no stress.

    Args:
        stress: (..., 6) components.
    """
    xx, yy, zz, xy, yz, xz = np.moveaxis(np.nan_to_num(stress), -1, 0)
    if not yz.any() and not xz.any():
        middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        return np.sort(np.stack([middle - half, middle + half, zz], axis=-1), axis=-1)
    rows = [(xx, xy, xz), (xy, yy, yz), (xz, yz, zz)]
    tensor = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(np.linalg.eigvalsh(tensor))


def scene_of(result: Result, only: int | None = None) -> Scene | None:
    """The scene of a result; None if it has no fields, or none after a stage.

    Args:
        result: what to draw.
        only: the one state to be shown; None for those that tell most.
    """
    fields = result.fields
    if fields is None or len(fields.displacement) < 2:
        return None
    return Scene(result, fields, only)


def box_around(points: Floats, box: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Corners (dim,) of the box around points (k, dim) with a margin, inside another box, m."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    return np.maximum(low - margin, box[0]), np.minimum(high + margin, box[1])


def gauge_points(gauges: GaugeTable) -> Floats:
    """(k, dim) points of all gauges, m."""
    ends = np.vstack([gauges.first, gauges.second])
    return np.asarray(ends[np.isfinite(ends).all(axis=1)])


def planes_through(points: Floats, box: tuple[Floats, Floats]) -> tuple[Plane, ...]:
    """For up to two coordinates, the plane across it that holds most of some points.

    Args:
        points: (k, 3), m; without any the planes go through the middle of the box.
        box: corners (3,) of the mesh; planes on its border are moved inside by a hair.
    """
    if not len(points):
        points = np.mean(box, axis=0)[None]
    planes = []
    for axis in range(3):
        values, counts = np.unique(points[:, axis].round(3), return_counts=True)
        planes.append((int(counts.max()), axis, float(values[np.argmax(counts)])))
    best = sorted(planes, key=lambda each: (-each[0], each[1]))[:2]
    axes = [axis for _, axis, _ in best]
    inset = 1e-6 * (box[1] - box[0])
    inside = np.clip([value for *_, value in best], (box[0] + inset)[axes], (box[1] - inset)[axes])
    return tuple(Plane(axis, float(value)) for axis, value in zip(axes, inside, strict=True))


def round_down(value: float) -> float:
    """The next 1, 2 or 5 times a power of ten below.

    >>> round_down(730.0), round_down(0.03)
    (500.0, 0.02)
    """
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(n for n in _NICE if n * power <= value * (1 + 1e-12)) * power)
