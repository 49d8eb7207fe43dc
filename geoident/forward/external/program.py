"""A case whose readings a program or a function gives, by runs at parameter vectors."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager

import numpy as np

from geoident.errors import ModelError
from geoident.forward.external.differences import Differences, Linear
from geoident.forward.external.model import ExternalModel
from geoident.forward.external.runs import FailedRun, ModelRuns
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.observed import ObservedResponse
from geoident.model.arrays import Floats
from geoident.model.case import Case

AGREE = 1e-2
"""Relative difference of given derivatives from differences that is taken as error of these."""

TINY = 1e-300  # in place of a size of zero, which would divide by it


class ProgramModel(ExternalModel):
    """A case whose readings come from runs of a program or a function.

    Args:
        case: the case.
        runs: of its program or function.
    """

    def __init__(self, case: Case, runs: ModelRuns) -> None:
        super().__init__(case, runs.provided, runs.seen)
        self.runs = runs
        accuracy = np.array([channel.accuracy for channel in case.channels], dtype=np.float64)
        weights = 1.0 / np.broadcast_to(accuracy, runs.provided.shape)[runs.provided]
        self.differences = Differences(
            self._results, case.parameters, runs.seen, weights, runs.quantum, runs.written
        )
        self._weights = weights
        self._checked = False
        self._given_jacobians: dict[bytes, Linear] = {}

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user on the runs, sentences."""
        return self.runs.notes

    def key(self, p: Floats) -> bytes:
        """The same for all p (n,) that are written alike."""
        return self.runs.written(p)[self.seen].tobytes()

    def given_readings(self, p: Floats, *, derivatives: bool, exact: bool) -> Floats:
        """What runs give at p (n,): one run, and more for differences.

        Raises:
            ModelError: a run failed.
        """
        if derivatives:
            linear = self.linear(p, exact=exact or self.differences.is_exact(p))
            columns = np.column_stack([linear.v, linear.dv_dp])
        else:
            columns = self.differences.values(p)[:, None]
        table = np.full((*self.provided.shape, columns.shape[1]), np.nan)
        table[self.provided] = columns
        return table

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> ProgramResponse:
        """The response in the readings of some (channel, stage) pairs."""
        return ProgramResponse(self, ReadingPlaces.of(self.case, pairs, times))

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

    @property
    def noise(self) -> Floats:
        """(n_states, n_channels) standard deviation of what runs add at random; 0 if unknown."""
        provided, known = self.runs.provided, self.differences.noise
        seen = np.zeros((len(provided) + 1, provided.shape[1]))
        if known is not None:
            seen[1:][provided] = known**2
        at_stage, at_zero = self.rule.weights**2
        zero = seen[self.rule.zero, np.arange(seen.shape[1])]
        return np.asarray(np.sqrt(at_stage * seen + at_zero * zero))

    def ahead(self, points: Sequence[Floats]) -> Generator[None, None, None]:
        """Make runs before they are asked for; they go on in the background.

        Args:
            points: (n,) where; each step of the generator waits for one run.
        """
        for _ in self.runs.each(points, self._check):
            yield

    def _results(self, points: Sequence[Floats]) -> list[Floats | FailedRun]:
        """Readings (m,) of runs; those made before are not made again."""
        self._asked.update(self.key(p) for p in points)
        results = self.runs.each(points, self._check)
        return [f if isinstance(f, FailedRun) else f[self.provided] for f in results]

    def _check(self) -> None:
        """Report progress while runs go on; may raise to end them."""
        if self.on_state is not None:
            self.on_state(len(self.sequence.states) - 1)

    def _with_jacobian(self, p: Floats) -> Linear:
        """Readings and the derivatives that come with them, which are tested once.

        Raises:
            ModelError: a run failed, or the derivatives are not those of the readings.
        """
        if p.tobytes() in self._given_jacobians:
            return self._given_jacobians[p.tobytes()]
        v = self.differences.values(p)
        jacobian = self.runs.jacobian(p, self._check)
        if isinstance(jacobian, FailedRun):
            raise ModelError(f"The derivatives of the model failed: {jacobian}.")
        linear = Linear(p, v, jacobian[self.provided])
        if not self._checked:
            self._compare(linear)
            self._checked = True
        self._given_jacobians[p.tobytes()] = linear
        return linear

    def _compare(self, derivatives: Linear) -> None:
        """Compare given derivatives with differences.

        Raises:
            ModelError: they differ.
        """
        other, w = self.differences.exact(derivatives.p).dv_dp, self._weights[:, None]
        size = np.linalg.norm(w * other, axis=0)
        off = np.linalg.norm(w * (derivatives.dv_dp - other), axis=0)
        loose = np.linalg.norm(w * self.differences.doubt(derivatives.p), axis=0)
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


class ProgramResponse(ObservedResponse[ProgramModel]):
    """Readings of some channels at some stages by runs.

    Args:
        model: of the case.
        places: what was read, where and when.
    """

    @property
    def at_once(self) -> int:
        """How many runs are made at a time."""
        return self._model.runs.at_once

    @contextmanager
    def prefetch(self, tasks: Sequence[object]) -> Iterator[Callable[[int], None]]:
        """Make the runs of parts of a search meanwhile, as many at a time as may be.

        Args:
            tasks: the parts that ask at points; nothing is begun for others.
        """
        model = self._model
        asked: list[Floats] = [getattr(task, "points", np.zeros((0, 0))) for task in tasks]
        ends, made = np.cumsum([len(points) for points in asked]), 0
        with closing(model.ahead([p for points in asked for p in points])) as runs:

            def turn(number: int) -> None:
                nonlocal made
                while made < ends[number]:
                    next(runs)
                    made += 1

            yield turn

    def sharpen(self, p: Floats) -> bool:
        """Take central differences at p (n,) from now on; whether this changes the Jacobian."""
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
