"""A circular opening as a model: of a case without mesh, or a first estimate beside the mesh.

The far stress is rarely the same all round. Its mean is p0 of the closed form; what deviates,
d = (xx - yy) / 2 and xy, moves the ground as in Kirsch's elastic solution (G. Kirsch 1898; Brady &
Brown, Rock Mechanics for Underground Mining, section 7.2). In elastic ground that is exact, in
ground that yields an approximation, and it is said how large the deviation is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from geoident.errors import InputError, ModelError
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.kinds import reads_displacements
from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.in_situ.stress import InSituStress, StressPlaces
from geoident.forward.observed import Details, Observed, ObservedModel, ObservedResponse, Query
from geoident.forward.openings.at_point import OpeningAtPoint
from geoident.forward.openings.face import (
    FaceState,
    advance_of,
    conversion_note,
    face_at,
    face_note,
    face_states,
)
from geoident.forward.openings.obstacles import NO_SECTION, stage_obstacles, unsuitable
from geoident.forward.openings.reaction import ground_reaction
from geoident.forward.openings.site import OpeningSite, site_in_mesh, site_without_mesh
from geoident.forward.openings.supports import hardening_faults, too_thick
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.checks import built_notes, lining_faults
from geoident.forward.structures.members import inadmissible as impossible_structure
from geoident.forward.yielding.hoek_brown import equivalent_notes
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis, Case
from geoident.model.dual import ParameterPoint
from geoident.model.gauges import Channel
from geoident.model.mesh import Mesh
from geoident.model.parameter import Values
from geoident.model.yielding import MohrCoulomb

_NO_MESH = Mesh(np.empty((0, 2)), ())

_UNEVEN = 0.01
"""Deviation from an all-round stress, in parts of it, from which on it is said."""

_INSIDE = 0.95
"""A point nearer than this to the centre, in radii, is inside the opening; others on its wall."""


class OpeningModel(ObservedModel):
    """The closed form of a case for which `unsuitable` knows no reason against it.

    Args:
        on_mesh: the case, on its mesh or on one without elements.
        site: where the opening is.
    """

    def __init__(self, on_mesh: CaseOnMesh, site: OpeningSite) -> None:
        case, sequence = on_mesh.case, on_mesh.sequence
        virgin, channels = sequence.states[0].materials, case.channels
        self._on_mesh, self._site = on_mesh, site
        self._material = case.materials[virgin[site.ground]]
        self._face = face_at(on_mesh, site.centre, site.ground)
        a, (x, y) = site.radius, site.centre
        around = np.array([[x, y], [x - a, y], [x + a, y], [x, y - a], [x, y + a]])
        places = StressPlaces(around, np.full(len(around), site.ground))
        self._in_situ = InSituStress(on_mesh, places)
        self._points = _ChannelPoints(site, channels)
        self._obstacles = stage_obstacles(on_mesh, site)
        opened = [not site.groups & state.materials.keys() for state in sequence.states]
        self._open: Bools = np.array(opened, dtype=np.bool_)
        closed_form = np.array([reason is None for reason in self._obstacles], dtype=np.bool_)
        moves = np.array([reads_displacements(c) for c in channels], dtype=np.bool_)
        gone = self._open[:, None] & self._points.inside
        self._covered: Bools = closed_form[:, None] & ~gone & moves  # (n_states, n_channels)
        stages = np.flatnonzero(closed_form & self._open)
        self._stages = {int(n): sequence.states[n].name for n in stages}
        zero = np.array([case.zero_of(channel) for channel in channels], np.int64)
        since_zero = self._covered & self._covered[zero, np.arange(len(zero))]
        since_zero &= np.arange(len(since_zero))[:, None] >= zero
        weights = np.repeat([[1.0], [-1.0]], len(zero), axis=1)
        rule = ReadingRule(tuple(c.name for c in channels), zero, weights, since_zero)
        super().__init__(case, rule, sequence.built_on, sequence.bases)

    def observe(self, p: Floats, query: Query) -> Observed:
        """Displacements since the virgin state at p (n,), of the states that readings build on.

        NaN where there is no closed form.

        Raises:
            ModelError: a stage that is needed has no equilibrium, or none in closed form, unless
                ``query.partial``.
        """
        self.evaluations += 1
        values, names = self.values(p), self.names if query.derivatives else ()
        at, failures = self._at(values, names), list[ModelError]()
        seen = np.full((*self._covered.shape, 1 + len(names)), np.nan)
        read = {*query.places.states.tolist(), *self.rule.zero[query.places.rows].tolist()}
        for n in np.flatnonzero(self.built_on[:, sorted(read)].any(axis=1)).tolist():
            if self._obstacles[n] is not None:
                continue
            try:
                seen[n] = self._points.seen(at, n) if self._open[n] else 0.0
            except ModelError as error:
                if n in read and not query.partial:
                    raise
                failures += [error] if n in read else []
        details = Details(
            notes=face_note(self._face, self._on_mesh, values) if query.survey else (),
            reaction=ground_reaction(at, self._site.centre, self._stages) if query.fields else None,
            advance=advance_of(self._face, self._on_mesh, values) if query.fields else None,
        )
        return Observed(seen, None, tuple(failures), details)

    def increments_of(self, observed: Observed) -> Floats:
        """What the step of each state changes in what channels see, (n_states, n_channels), m.

        0 where there is no closed form, and of states that were not needed; also before the zero
        of a channel.
        """
        seen = observed.seen[..., 0]
        known = self._covered & np.isfinite(seen)
        seen = np.where(known, seen, 0.0)
        return np.where(known, seen - seen[self.bases], 0.0)

    def why_unseen(self, state: int, row: int) -> str:
        """Why a channel has no closed form between its zero and a state, a clause."""
        n = next(n for n in (int(self.rule.zero[row]), state) if not self._covered[n, row])
        if (reason := self._obstacles[n]) is not None:
            return reason
        if not reads_displacements(self.case.channels[row]):
            return "it reads something else than displacements"
        return "a point of it lies in excavated ground"

    def domain_fault(self, p: Floats) -> str | None:
        """Why finite p (n,) is outside the domain, or None."""
        values = self.values(p)
        fault = inadmissible(self._material, values) or impossible_structure(self.case, values)
        return fault or too_thick(self.case, self._site.radius, values)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> OpeningResponse:
        """The response in the readings of some (channel, stage) pairs."""
        return OpeningResponse(self, ReadingPlaces.of(self.case, pairs, times))

    def face_states(self, values: Values) -> tuple[FaceState, ...]:
        """What distances to the face become at some parameters; see `openings.face`."""
        return face_states(self._face, self._on_mesh, values)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        at = self._at(self.case.start, ())
        return (
            *self._notes(at, self.case.start),
            *conversion_note(self._face, self._on_mesh),
            *built_notes(self._on_mesh),
        )

    def remarks(self, p: Floats) -> tuple[str, ...]:
        """What is to be known of the closed form at p (n,), sentences without a stop."""
        values = self.values(p)
        at = self._at(values, ())
        remarks = list(self._notes(at, values))
        for number, name in list(self._stages.items())[-1:]:
            try:
                radius = at.state(number).plastic_radius
            except ModelError:
                continue
            if radius is not None:
                reach = f"{float(radius.value):.3g} m from the centre"
                remarks.append(f"at stage '{name}' the ground yields up to {reach}")
            if supports := at.supports(number):
                remarks.append(f"at stage '{name}' {_supports_text(supports)}")
        return tuple(remarks)

    def _notes(self, at: OpeningAtPoint, values: Values) -> tuple[str, ...]:
        """Where the opening is, and what the closed form takes otherwise than the case."""
        (x, y), a, name = self._site.centre, self._site.radius, self._material.name
        place = f"closed form of a circular opening of radius {a:.4g} m about ({x:.4g}, {y:.4g}) m"
        sentences = [f"{place} in '{name}'", *self._site.remarks]
        p0, (xx, yy, _, xy) = float(at.opening.rock.pressure.value), -at.stress.value
        off = float(np.abs([xx - p0, yy - p0, xy]).max())
        supported = any(state.structures for state in self._on_mesh.sequence.states)
        if off > _UNEVEN * abs(p0):
            how = f"{100 * off / abs(p0):.0f} %" if p0 else f"{off:.3g} Pa"
            text = f"the in-situ stress around the opening is up to {how} off its mean at the "
            text += "centre"
            if self._material.yields:
                text += "; the closed form takes that part as if the ground were elastic"
            if supported:
                text += "; supports resist the mean of the stress only, and not that part"
            sentences.append(text)
        if any(isinstance(s, MohrCoulomb) and s.planes for s in self._material.yields):
            sentences.append("the closed form takes the exact surface for the polyhedron")
        return (*sentences, *equivalent_notes(self._material, at.stress.value[:, :1], values))

    def _at(self, values: Values, names: Sequence[str]) -> OpeningAtPoint:
        point = ParameterPoint(values, names)
        return OpeningAtPoint(self._on_mesh, self._site, self._in_situ, point, self._face)


def _supports_text(supports: Mapping[str, tuple[float, float]]) -> str:
    """What supports press with, Pa, and which part of their capacity that is, a clause."""
    parts = []
    for name, (pressure, capacity) in supports.items():
        part = f"'{name}' {pressure / 1e6:.3g} MPa"
        if np.isfinite(capacity):
            full = "all" if pressure >= capacity else f"{100.0 * pressure / capacity:.0f} %"
            part += f" ({full} of what it carries)"
        parts.append(part)
    total = sum(pressure for pressure, _ in supports.values())
    return f"supports press on the wall with {total / 1e6:.3g} MPa: {', '.join(parts)}"


class _ChannelPoints:
    """The points of all channels: where they lie around the opening, and what of them is read.

    Attributes:
        inside: (n_channels,) a point of the channel lies where the opening is going to be.
    """

    def __init__(self, site: OpeningSite, channels: Sequence[Channel]) -> None:
        motions = [motion for channel in channels for motion in channel.motions]
        points, vectors = (np.array([m[k] for m in motions]).reshape(-1, 2) for k in (0, 1))
        self._channel = np.repeat(np.arange(len(channels)), [len(c.motions) for c in channels])
        x = points - np.array(site.centre)
        r, angle = np.linalg.norm(x, axis=1), np.arctan2(x[:, 1], x[:, 0])
        self.inside: Bools = np.zeros(len(channels), dtype=np.bool_)
        self.inside[self._channel[r < _INSIDE * site.radius]] = True
        self._r = np.maximum(r, site.radius)
        self._cosine, self._sine = np.cos(2.0 * angle), np.sin(2.0 * angle)
        self._outwards = vectors[:, 0] * np.cos(angle) + vectors[:, 1] * np.sin(angle)
        self._around = vectors[:, 1] * np.cos(angle) - vectors[:, 0] * np.sin(angle)

    def seen(self, at: OpeningAtPoint, n: int) -> Floats:
        """Relative displacements (n_channels, 1 + n) at a state with the opening, m.

        Raises:
            ModelError: the ground has no equilibrium, or none in closed form.
        """
        state, rock, a = at.state(n), at.opening.rock, at.opening.radius
        s = (a / self._r) ** 2
        size = at.released(n) * a * a / (2.0 * rock.shear * self._r)
        along = at.deviation * self._cosine + at.shear * self._sine
        across = at.deviation * self._sine - at.shear * self._cosine
        radial = state.displacement(self._r) - size * along * (4.0 * (1.0 - rock.nu) - s)
        hoop = size * across * (2.0 - 4.0 * rock.nu + s)
        moved = (radial * self._outwards + hoop * self._around).columns[:, :-1]  # not by pressure
        seen = np.zeros((len(self.inside), moved.shape[1]))
        np.add.at(seen, self._channel, moved)
        return seen


class OpeningResponse(ObservedResponse[OpeningModel]):
    """Readings of some channels at some stages in closed form; only those that have one.

    Args:
        model: the closed form of the case.
        places: what was read, where and when.

    Attributes:
        covered: (g,) which of the readings have a closed form; the response consists of these.
    """

    def __init__(self, model: OpeningModel, places: ReadingPlaces) -> None:
        self.covered: Bools = model.rule.readable[places.states, places.rows]
        super().__init__(model, places.only(self.covered))

    def remarks(self, p: Floats) -> tuple[str, ...]:
        """What is to be known of the closed form at p (n,)."""
        return self._model.remarks(p)

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """Itself: the model is the closed form, of the opening that the case gives."""
        return self


def opening_model(case: Case) -> OpeningModel:
    """The closed form of a case that has no mesh.

    Raises:
        InputError: it has none.
    """
    on_mesh, options = CaseOnMesh(case, _NO_MESH), case.fit.closed_form
    if faults := [*lining_faults(on_mesh), *hardening_faults(on_mesh)]:
        raise InputError(faults)
    model = _model(on_mesh, site_without_mesh(on_mesh.sequence, options.centre, options.radius))
    if isinstance(model, str):
        message = f"there is no closed form of this case: {model}"
        place = ("fit", "closed-form")
        raise InputError([case.source.fault(place, "no-closed-form", message)])
    return model


def opening_in_mesh(
    on_mesh: CaseOnMesh, centre: tuple[float, float] | None, radius: float | None
) -> OpeningModel | str:
    """The closed form of a case that has a mesh, or why there is none, a clause.

    Args:
        on_mesh: the case on its mesh.
        centre: of the opening as the case gives it, m.
        radius: likewise, m.
    """
    if on_mesh.case.analysis is not Analysis.PLANE_STRAIN:
        return NO_SECTION
    return _model(on_mesh, site_in_mesh(on_mesh, centre, radius))


def _model(on_mesh: CaseOnMesh, site: OpeningSite | str) -> OpeningModel | str:
    """The model of an opening, or why there is none."""
    if isinstance(site, str):
        return site
    material = on_mesh.sequence.states[0].materials[site.ground]
    why = unsuitable(on_mesh.case, material, has_mesh=on_mesh.mesh is not _NO_MESH)
    return OpeningModel(on_mesh, site) if why is None else why
