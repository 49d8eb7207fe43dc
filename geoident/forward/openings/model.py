"""A circular opening as a model: of a case without mesh, or a first estimate beside the mesh."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from geoident.errors import InputError, ModelError
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.model_response import ModelResponse
from geoident.forward.openings.face import (
    FaceState,
    advance_of,
    conversion_note,
    face_at,
    face_note,
    face_states,
)
from geoident.forward.openings.field import NO_SECTION, OpeningField, unsuitable
from geoident.forward.openings.reaction import ground_reaction
from geoident.forward.openings.site import Circle, OpeningSite, site_in_mesh, site_without_mesh
from geoident.forward.protocols import Survey
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis, Case
from geoident.model.mesh import Mesh
from geoident.model.parameter import Values
from geoident.model.results.costs import Counts

_NO_MESH = Mesh(np.empty((0, 2)), ())


class OpeningModel:
    """The closed form of a case: fulfils `CaseModel`, as the staged model does.

    Args:
        on_mesh: the case, on its mesh or on one without elements.
        site: where the opening is.
    """

    def __init__(self, on_mesh: CaseOnMesh, site: OpeningSite) -> None:
        self.case, self.sequence = case, sequence = on_mesh.case, on_mesh.sequence
        self.names = tuple(parameter.name for parameter in case.parameters)
        self._on_mesh = on_mesh
        self._face = face_at(on_mesh, site.centre, site.ground)
        self.field = OpeningField(on_mesh, site, self._face)
        self.zero = np.array([case.zero_of(channel) for channel in case.channels], np.int64)
        self.instrument_errors = InstrumentErrors(case, sequence.built_on)
        self.on_state: Callable[[int], None] | None = None
        self._evaluations = 0

    @property
    def counts(self) -> Counts:
        """Costs so far: evaluations; nothing is factorized."""
        return Counts(self._evaluations, 0, 0, 0)

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state: none."""
        return (0,) * len(self.sequence.states)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        return (*self.field.notes(self.case.start), *conversion_note(self._face, self._on_mesh))

    def face_states(self, values: Values) -> tuple[FaceState, ...]:
        """What distances to the face become at some parameters; see `face_states`."""
        return face_states(self._face, self._on_mesh, values)

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        if not np.all(np.isfinite(p)):
            return "a parameter is not finite"
        return self.field.admissible(self.values(p))

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""
        names = [c.name for c in self.case.channels]
        row, state = names.index(channel), self.case.stage_names.index(stage)
        zero = int(self.zero[row])
        if state < zero:
            return "it is zeroed only at a later stage"
        reasons = (self.field.why_uncovered(n, row) for n in (zero, state))
        return next((reason for reason in reasons if reason is not None), None)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> OpeningResponse:
        """The response in the readings of some (channel, stage) pairs."""
        return OpeningResponse(self, pairs, times)

    def survey(
        self, p: Floats, *, fields: bool, partial: bool = False, last: int | None = None
    ) -> Survey:
        """All channels at all stages and their derivatives.

        Args:
            p: (n,) parameters.
            fields: with the reaction of the ground, which stands for the fields of a mesh.
            partial: where a stage has no equilibrium, give what can be known without it.
            last: of no effect: a stage costs nothing.

        Raises:
            ModelError: a stage has no equilibrium; with ``partial``, only if nothing is left.
        """
        values, failures = self.values(p), list[ModelError]()
        table = self.relative(values, self.names, failures=failures if partial else None)
        table = self.instrument_errors.added_to_all(table, values, self.names)
        table = table[1:].swapaxes(0, 1)  # without the virgin state
        if failures and not np.isfinite(table).any():
            raise failures[0]
        said = tuple(dict.fromkeys(error.message for error in failures))
        change = self.increments(p)
        found = ground_reaction(self.field, values) if fields else None
        return Survey(
            table[..., 0],
            table[..., 1:],
            None,
            collapses=said,
            reaction=found,
            increments=change,
            notes=face_note(self._face, self._on_mesh, values),
            advance=advance_of(self._face, self._on_mesh, values) if fields else None,
        )

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what the channels see, (n_states, n_channels), m.

        0 where there is no closed form.

        Args:
            p: (n,) parameters.
        """
        seen = self.field.observed(self.values(p), (), wanted=None, failures=[])[..., 0]
        known = self.field.covered & np.isfinite(seen)
        seen = np.where(known, seen, 0.0)
        change = seen - seen[self.sequence.bases]
        return np.where(known, change, 0.0)

    def steps(self, pairs: Sequence[tuple[str, str]]) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g): 1, 0 or -1.

        Args:
            pairs: their channels and stages.
        """
        places, built_on = ReadingPlaces.of(self.case, pairs, ()), self.sequence.built_on
        since = built_on[:, self.zero[places.rows]].astype(np.float64)
        return np.asarray(built_on[:, places.states] - since)

    def relative(
        self,
        values: dict[str, float],
        names: Sequence[str],
        *,
        wanted: Collection[int] | None = None,
        failures: list[ModelError] | None = None,
    ) -> Floats:
        """Motions since the zeros, (n_states, n_channels, 1 + n), m; NaN where not to be read.

        What is raised is that of `OpeningField.observed`.

        Args:
            values: parameters by name, SI.
            names: the n of them to differentiate by.
            wanted: the states that are; None for all.
            failures: takes what is raised, and the states that it concerns are NaN; None to raise.
        """
        self._evaluations += 1
        observed = self.field.observed(values, names, wanted=wanted, failures=failures)
        result = observed - observed[self.zero, np.arange(len(self.zero))]
        result[~self.readable] = np.nan
        return np.asarray(result)

    @property
    def readable(self) -> Bools:
        """(n_states, n_channels) where a channel has a closed form since its zero."""
        columns = np.arange(len(self.zero))
        later = np.arange(len(self.field.covered))[:, None] >= self.zero
        return np.asarray(self.field.covered & self.field.covered[self.zero, columns] & later)


class OpeningResponse(ModelResponse):
    """Readings of some (channel, stage) pairs in closed form; only those that have one.

    Args:
        model: the closed form of the case.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.

    Attributes:
        covered: (g,) which of the pairs have a closed form; the response consists of these.
    """

    def __init__(
        self,
        model: OpeningModel,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        places = ReadingPlaces.of(model.case, pairs, times)
        super().__init__(model)
        self._model = model
        self.covered: Bools = model.readable[places.states, places.rows]
        self._places = covered = places.only(self.covered)
        self._wanted = set(map(int, (*covered.states, *model.zero[covered.rows])))

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), m."""
        return self._run(p, ())[:, 0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        table = self._run(p, self.names)
        return table[:, 0], table[:, 1:]

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see at p (n,).

        (n_states, n_channels), m.
        """
        return self._model.increments(p)

    def remarks(self, p: Floats) -> tuple[str, ...]:
        """What is to be known of the closed form at p (n,)."""
        return self._model.field.remarks(self._model.values(p))

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """Itself: the model is the closed form, of the opening that the case gives."""
        return self

    def _run(self, p: Floats, names: Sequence[str]) -> Floats:
        values = self._model.values(p)
        motions = self._model.relative(values, names, wanted=self._wanted)
        added = self._model.instrument_errors.added(values, names, self._places)
        return np.asarray(motions[self._places.states, self._places.rows] + added)


def opening_model(case: Case) -> OpeningModel:
    """The closed form of a case that has no mesh.

    Raises:
        InputError: it has none.
    """
    on_mesh, given = CaseOnMesh(case, _NO_MESH), case.fit.closed_form
    found = site_without_mesh(on_mesh.sequence, Circle(given.centre, given.radius))
    model = found if isinstance(found, str) else _model_or_reason(on_mesh, found)
    if isinstance(model, str):
        message = f"there is no closed form of this case: {model}"
        place = ("fit", "closed-form")
        raise InputError([case.source.fault(place, code="no-closed-form", message=message)])
    return model


def opening_in_mesh(on_mesh: CaseOnMesh, circle: Circle) -> OpeningModel | str:
    """The closed form of a case that has a mesh, or why there is none, a clause.

    Args:
        on_mesh: the case on its mesh.
        circle: what the case says of the opening.
    """
    if on_mesh.case.analysis is not Analysis.PLANE_STRAIN:
        return NO_SECTION
    found = site_in_mesh(on_mesh, circle)
    return found if isinstance(found, str) else _model_or_reason(on_mesh, found)


def _model_or_reason(on_mesh: CaseOnMesh, site: OpeningSite) -> OpeningModel | str:
    material = on_mesh.sequence.states[0].materials[site.ground]
    if on_mesh.case.materials[material].fields:
        return f"constants of '{material}' vary from place to place"
    why = unsuitable(on_mesh.case, material, has_mesh=on_mesh.mesh is not _NO_MESH)
    return OpeningModel(on_mesh, site) if why is None else why
