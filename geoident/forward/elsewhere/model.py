"""A case whose readings a program or a function gives: fulfils `CaseModel` by runs.

A reading of channel a at stage j is what the run gives there, less what it gives at the zero of
the channel where that reads a change; of the virgin state that is 0. Offsets and drifts of gauges
are added with their exact derivatives, and need no run.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager

import numpy as np

from geoident.errors import ModelError
from geoident.forward.elsewhere.differences import Differences, Linear
from geoident.forward.elsewhere.runs import FailedRun, ModelRuns
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.model_response import ModelResponse
from geoident.forward.protocols import Survey
from geoident.forward.stages import ConstructionSequence, ConstructionState
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.results.costs import Counts

AGREE = 1e-2
"""Part of the derivatives by which given ones may differ from differences."""

TINY = 1e-300


class ElsewhereModel:
    """A case that runs answer.

    Args:
        case: the case.
        runs: of its program or function.
    """

    def __init__(self, case: Case, runs: ModelRuns) -> None:
        self.case, self.runs = case, runs
        self.names = tuple(parameter.name for parameter in case.parameters)
        states = [
            ConstructionState(name, {}, frozenset(), {}, base=max(n - 1, 0))
            for n, name in enumerate(case.stage_names)
        ]
        self.sequence = ConstructionSequence((), np.zeros(0, np.int64), tuple(states))
        self.instrument_errors = InstrumentErrors(case, self.sequence.built_on)
        self.on_state: Callable[[int], None] | None = None
        self.zero = np.array([case.zero_of(channel) for channel in case.channels], np.int64)
        self._changes = np.array([channel.is_zeroed for channel in case.channels], dtype=bool)
        self._asked: dict[bytes, bool] = {}  # parameters that runs have seen
        accuracy = np.array([channel.accuracy for channel in case.channels], dtype=np.float64)
        weights = 1.0 / np.broadcast_to(accuracy, runs.given.shape)[runs.given]
        self.differences = Differences(
            self._results, case.parameters, runs.seen, weights, runs.quantum, runs.written
        )
        self._checked = False
        self._given_jacobians: dict[bytes, Linear] = {}

    @property
    def counts(self) -> Counts:
        """Costs so far: runs, those that an earlier call has made among them."""
        return Counts(len(self._asked), 0, 0, 0)

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state: none here."""
        return (0,) * len(self.sequence.states)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of the runs."""
        return self.runs.notes

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None: only a run can tell."""
        return None if np.all(np.isfinite(p)) else "a parameter is not finite"

    @property
    def readable(self) -> Bools:
        """(n_states, n_channels) where a channel can be read."""
        given = np.concatenate([np.ones((1, len(self.zero)), dtype=bool), self.runs.given])
        later = np.arange(len(given))[:, None] >= self.zero
        at_zero = given[self.zero, np.arange(len(self.zero))]
        result = given & np.where(self._changes, later & at_zero, True)
        result[0] = False
        return np.asarray(result)

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""
        row = [c.name for c in self.case.channels].index(channel)
        state = self.case.stage_names.index(stage)
        if self.readable[state, row]:
            return None
        if state == 0:
            return "the model gives nothing before the first stage"
        if self._changes[row] and state < self.zero[row]:
            return "it is zeroed only at a later stage"
        where = "there" if not self.runs.given[state - 1, row] else "at its zero"
        return f"the model gives no reading of it {where}"

    def steps(self, pairs: Sequence[tuple[str, str]]) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g): 1, 0 or -1.

        Args:
            pairs: their channels and stages.
        """
        places, built_on = ReadingPlaces.of(self.case, pairs, ()), self.sequence.built_on
        since = built_on[:, self.zero[places.rows]].astype(np.float64)
        since[:, ~self._changes[places.rows]] = 0.0
        return np.asarray(built_on[:, places.states] - since)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> ElsewhereResponse:
        """The response in the readings of some (channel, stage) pairs."""
        return ElsewhereResponse(self, pairs, times)

    def survey(
        self, p: Floats, *, fields: bool, partial: bool = False, last: int | None = None
    ) -> Survey:
        """All channels at all stages and their derivatives.

        Args:
            p: (n,) parameters.
            fields: this is what a result is made of: derivatives by central differences; else as
                good as a search needs them, unless better ones are known.
            partial: of no effect: a run has failed, or it has not.
            last: of no effect: a run is of all stages.

        Raises:
            ModelError: a run failed.
        """
        values = self.values(p)
        exact = fields or self.differences.is_exact(p)
        table = self.table(self.linear(p, exact=exact))
        table = self.instrument_errors.added_to_all(table, values, self.names)
        table = table[1:].swapaxes(0, 1)
        nothing = np.zeros((len(self.sequence.states), len(self.zero)))
        return Survey(table[..., 0], table[..., 1:], None, increments=nothing)

    def linear(self, p: Floats, *, exact: bool = False) -> Linear:
        """What runs give at p (n,), (m,), and derivatives.

        Args:
            p: (n,) parameters.
            exact: derivatives as good as they can be; else as good as a search needs them.

        Raises:
            ModelError: a run failed.
        """
        if self.runs.has_jacobian:
            return self._with_jacobian(p)
        return self.differences.exact(p) if exact else self.differences.linear(p)

    def computed(self, p: Floats) -> Floats:
        """All channels at all stages (n_channels, n_stages) at p (n,), SI, by one run.

        Raises:
            ModelError: the run failed.
        """
        values = self.values(p)
        table = self.instrument_errors.added_to_all(self.of_one_run(p), values, ())
        return np.asarray(table[1:, :, 0].T)

    def of_one_run(self, p: Floats) -> Floats:
        """What a run gives at p (n,), (n_states, n_channels, 1), relative to the zeros.

        Raises:
            ModelError: the run failed.
        """
        v = self.differences.values(p)
        return self.table(Linear(p, v, np.zeros((len(v), 0))))

    def table(self, found: Linear) -> Floats:
        """(n_states, n_channels, 1 + k) relative to the zeros; NaN where nothing is given."""
        flat = np.column_stack([found.v, found.dv_dp])
        given = self.runs.given
        seen = np.full((len(given) + 1, given.shape[1], flat.shape[1]), np.nan)
        seen[0] = 0.0
        seen[1:][given] = flat
        at_zero = seen[self.zero, np.arange(len(self.zero))]
        result = np.where(self._changes[None, :, None], seen - at_zero, seen)
        result[~self.readable] = np.nan
        return np.asarray(result)

    @property
    def noise(self) -> Floats:
        """(n_states, n_channels) standard deviation of what runs add at random; 0 if unknown."""
        given, known = self.runs.given, self.differences.noise
        seen = np.zeros((len(given) + 1, given.shape[1]))
        if known is not None:
            seen[1:][given] = known**2
        at_zero = seen[self.zero, np.arange(len(self.zero))]
        return np.asarray(np.sqrt(np.where(self._changes, seen + at_zero, seen)))

    def ahead(self, points: Sequence[Floats]) -> Generator[None, None, None]:
        """Make runs that are going to be asked for; they go on while nobody waits for them.

        Args:
            points: (n,) where; each step of the generator waits for the next one.
        """
        for _ in self.runs.each(points, self._check):
            yield

    def _results(self, points: Sequence[Floats]) -> list[Floats | FailedRun]:
        """Readings (m,) of runs; those that were asked for before cost nothing."""
        for p in points:
            self._asked[self.runs.written(p)[self.runs.seen].tobytes()] = True
        found = self.runs.results(points, self._check)
        return [f if isinstance(f, FailedRun) else f[self.runs.given] for f in found]

    def _check(self) -> None:
        """Is asked while runs go on."""
        if self.on_state is not None:
            self.on_state(len(self.sequence.states) - 1)

    def _with_jacobian(self, p: Floats) -> Linear:
        """Readings and the derivatives that come with them, which are tested once.

        Raises:
            ModelError: a run failed, or the derivatives are not those of the readings.
        """
        known = self._given_jacobians.get(p.tobytes())
        if known is not None:
            return known
        v = self.differences.values(p)
        found = self.runs.jacobian(p, self._check)
        if isinstance(found, FailedRun):
            raise ModelError(f"The derivatives of the model failed: {found}.")
        linear = Linear(p, v, found[self.runs.given])
        if not self._checked:
            self._compare(linear)
            self._checked = True
        self._given_jacobians[p.tobytes()] = linear
        return linear

    def _compare(self, given: Linear) -> None:
        """Hold given derivatives against differences.

        Raises:
            ModelError: they differ.
        """
        other = self.differences.exact(given.p).dv_dp
        weights = 1.0 / np.array([channel.accuracy for channel in self.case.channels])
        w = np.broadcast_to(weights, self.runs.given.shape)[self.runs.given][:, None]
        size = np.linalg.norm(w * other, axis=0)
        off = np.linalg.norm(w * (given.dv_dp - other), axis=0)
        loose = np.linalg.norm(w * self.differences.doubt(given.p), axis=0)
        wrong = off > AGREE * size + loose
        if wrong.any():
            j = int(np.argmax(np.where(wrong, off / np.maximum(size, TINY), 0.0)))
            part = off[j] / max(size[j], TINY)
            message = (
                f"The derivatives that the model gives differ from differences of its readings, "
                f"those by {self.names[j]} by {100 * part:.2g} %"
            )
            hint = "Correct them, or remove 'jacobian' to have differences taken."
            path = ("model", "jacobian")
            place = self.case.source.locate(path)
            raise ModelError(f"{message}.", hint, location=place, path="model.jacobian")


class ElsewhereResponse(ModelResponse):
    """Readings of some (channel, stage) pairs by runs.

    Args:
        model: of the case.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.
    """

    def __init__(
        self,
        model: ElsewhereModel,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        super().__init__(model)
        self._model = model
        self._places = ReadingPlaces.of(model.case, pairs, times)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,): one run. Raises `geoident.errors.ModelError` where it fails."""
        return self._at(p, self._model.of_one_run(p), ())[:, 0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n), as good as a search needs it."""
        found = self._at(p, self._model.table(self._model.linear(p)), self.names)
        return found[:, 0], found[:, 1:]

    @property
    def at_once(self) -> int:
        """How many parts of a search are worked on at a time."""
        return self._model.runs.at_once

    @property
    def may_be_led(self) -> bool:
        """Whether descents are led by what others have evaluated: updates are made of that."""
        return True

    @contextmanager
    def turns(self, looks: Sequence[object]) -> Iterator[Callable[[int], None]]:
        """Make the runs of parts of a search meanwhile, as many at a time as may be.

        Args:
            looks: the parts that ask at points; nothing is begun for others.
        """
        model = self._model
        asked: list[Floats] = [getattr(look, "points", np.zeros((0, 0))) for look in looks]
        ends, made = np.cumsum([len(points) for points in asked]), 0
        with closing(model.ahead([p for points in asked for p in points])) as runs:

            def turn(number: int) -> None:
                nonlocal made
                while made < ends[number]:
                    next(runs)
                    made += 1

            yield turn

    def sharpen(self, p: Floats) -> bool:
        """From now on the Jacobian at p (n,) is by central differences; whether that is new."""
        model = self._model
        if model.runs.has_jacobian or model.differences.is_exact(p):
            return False
        try:
            model.differences.exact(p)
        except ModelError:
            return False
        return True

    @property
    def noise(self) -> Floats:
        """(g,) standard deviation of what runs add to the readings at random; 0 if unknown."""
        places = self._places
        return np.asarray(self._model.noise[places.states, places.rows])

    def _at(self, p: Floats, table: Floats, names: Sequence[str]) -> Floats:
        places = self._places
        added = self._model.instrument_errors.added(self._model.values(p), names, places)
        return np.asarray(table[places.states, places.rows] + added)
