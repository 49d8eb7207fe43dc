"""A model that computes each of its answers once, and goes on where an interrupted run was.

`CachedResponse` stands between identifiers and a model, and is the only object that

    logs         every evaluation goes to the log of the run the moment it is known. An identifier
                 started again asks for the same parameter vectors, is answered from the log, and
                 arrives at the point of interruption with the same numbers;
    counts       evaluations are the parameter vectors that this run asked for, wherever the answer
                 came from: limits and patience that go by them do not depend on interruptions.
                 Factorizations and solutions are what this run has done;
    prefetches   parts of a search that know nothing of each other are worked on by other processes
                 before they are asked for (`ahead`);
    substitutes  where a search allows an error, the surrogate of the model answers if the estimate
                 of its error is below that (`substituting`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from hashlib import sha256
from typing import Protocol

import numpy as np

from geoident.errors import Interrupted, ModelError, TimeIsUp
from geoident.fem.solvers.threads import one_thread
from geoident.forward.reducible import ReducibleResponse
from geoident.identify.problem.ahead import BeginPart, SearchTask
from geoident.identify.problem.responses import (
    AffineElastic,
    ComplementaritySystem,
    HasOpening,
    OpeningForm,
    YieldSystem,
)
from geoident.model.arrays import Floats
from geoident.model.response import (
    CERTAIN,
    BilinearSystem,
    Condensed,
    Evaluation,
    HasSurrogate,
    Response,
    Surrogate,
)
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity
from geoident.workflow.executing.worker import STOP
from geoident.workflow.running.control import OUT_OF_TIME, Control
from geoident.workflow.running.evaluation_log import (
    EvaluationArrays,
    Log,
    Recording,
    activity_arrays,
    activity_from_arrays,
    evaluation_arrays,
)
from geoident.workflow.running.prefetching import Prefetched, ResponseBeside
from geoident.workflow.running.workers import ModelParts, SearchPartTask

EXACT = 1e-6
"""Error in energy, relative, up to which the surrogate stands for the model where the model is
asked once more at the end. What is found by it (weights of readings, and where to look at the model
itself) is known to 0.2 % at best."""


class Staged(AffineElastic, YieldSystem, HasOpening, Protocol):
    """All that the identifiers may ask of the staged model."""

    def evaluation(self, p: Floats, *, derivatives: bool = True) -> Evaluation:
        """All that is known of the readings at p (n,)."""

    def forget(self) -> None:
        """Begin the next evaluation as a new model does."""


class CachedResponse:
    """A response whose evaluations are logged, and answered from the log when they come again.

    Args:
        inner: the model.
        log: of evaluations of the same problem.
        before: called before every evaluation that must be computed; raises to stop the run.
        elsewhere: processes that have the same model; None for none.

    Attributes:
        failures: evaluations without solution, in their order: kind, parameters (n,) and why.
    """

    def __init__(
        self,
        inner: Staged,
        log: Log,
        *,
        before: Callable[[], None],
        elsewhere: ResponseBeside | None = None,
    ) -> None:
        self.failures: list[tuple[str, Floats, ModelError]] = []
        self._inner, self._log, self._before, self._elsewhere = inner, log, before, elsewhere
        self._prefetched: Prefetched | None = None
        self._no_solution: dict[tuple[str, bytes], ModelError] = {}  # found by other processes
        self._spent = self._begun = inner.counts
        self._asked: set[tuple[str, bytes]] = set()
        self._evaluated: list[Floats] = []
        self._visited: list[Floats] = []
        self._metric = ""  # of the first condensation
        self._tolerance = 0.0
        self._approximate: set[bytes] = set()  # where the surrogate answered, not `CERTAIN`

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self._inner.names

    @property
    def counts(self) -> Counts:
        """Costs of the model before, and since: what was asked for, and what was done for it."""
        analyses = self._inner.counts.analyses
        evaluations = self._begun.evaluations + len(self._asked)
        return replace(self._spent, evaluations=evaluations, analyses=analyses)

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain of the model, or None."""
        return self._inner.admissible(p)

    # Evaluations

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,)."""
        return np.array(self._plain_evaluation(p)["v"])

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        known = self._substitute(p) or self._logged_or_computed(
            "evaluate", p, lambda: evaluation_arrays(self._inner.evaluation(p))
        )
        return np.array(known["v"]), np.array(known["dv_dp"])

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see, (n_states, n_channels).

        At a p (n,) that was evaluated it costs nothing.
        """
        known = self._substitute(p) or self._from_log("evaluate", p) or self._plain_evaluation(p)
        return np.array(known["increments"])

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,); at one that was evaluated it costs nothing."""
        arrays = self._from_log("evaluate", p) or self._plain_evaluation(p)
        activity = activity_from_arrays(arrays)
        if activity is None:  # the evaluation was carried over from another fit
            arrays = self._logged_or_computed(
                "activity", p, lambda: activity_arrays(self._inner.activity(p))
            )
            activity = activity_from_arrays(arrays)
            assert activity is not None
        return activity

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        """Condensed equations at p for readings that are the same in the whole run.

        Their accuracies change where they are estimated: each is a kind of its own in the log.

        Args:
            p: (n,) parameters, SI.
            measured: (g,) readings, SI.
            sd: (g,) their standard deviations, SI; where readings share errors, the matrix (g, g)
                that makes their errors independent and of size one.
        """
        metric = sha256(np.ascontiguousarray(sd).tobytes()).hexdigest()
        self._metric = self._metric or metric
        kind = "condense" if metric == self._metric else f"condense {metric[:16]}"
        known = self._logged_or_computed(
            kind, p, lambda: dict(vars(self._inner.condense(p, measured, sd)))
        )
        names = "readings", "flexibility", "matrix", "vector"
        return Condensed(*(np.array(known[name]) for name in names))

    def evaluated_points(self) -> Sequence[Floats]:
        """Parameter vectors (n,) that this run has evaluated with derivatives, in their order."""
        return tuple(self._evaluated)

    # What is no evaluation

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, or None."""
        return self._inner.obstacle()

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningForm | str:
        """The closed form, whose evaluations cost nothing and are not kept, or why none is."""
        return self._inner.opening(centre, radius)

    def yields(self) -> bool:
        """Whether any material of the model has yield limits."""
        return self._inner.yields()

    def system_obstacle(self) -> str | None:
        """Why the equations are no `BilinearSystem`, or None if they are one."""
        inner = self._inner
        if not isinstance(inner, ComplementaritySystem):
            return "the model does not show its equations"
        return inner.system_obstacle()

    def system(self) -> BilinearSystem:
        """The equations of all stages as vectors; not logged, they cost no analysis."""
        inner = self._inner
        assert isinstance(inner, ComplementaritySystem)
        return inner.system()

    # The surrogate

    @contextmanager
    def substituting(self, tolerance: float) -> Iterator[None]:
        """Meanwhile the surrogate answers wherever the estimate of its error is small enough.

        Args:
            tolerance: of the error in energy, relative.
        """
        before, self._tolerance = self._tolerance, tolerance
        try:
            yield
        finally:
            self._tolerance = before

    def answered_approximately(self, p: Floats) -> bool:
        """Whether at p (n,) the surrogate has answered with an error that is not `CERTAIN`."""
        return p.tobytes() in self._approximate and ("evaluate", p.tobytes()) not in self._asked

    def visited(self) -> Sequence[Floats]:
        """Parameter vectors (n,) of whose evaluations the surrogate is made, in their order."""
        return tuple(self._visited)

    def exact_answer(self, p: Floats) -> EvaluationArrays | None:
        """Readings, derivatives and increments at p (n,), where they are known and `CERTAIN`."""
        known = self._log.find("evaluate", p)
        if known is not None:
            return known
        known = self._log.find(self._kind_of_surrogate(), p)
        return known if known is not None and known["error"][0] <= CERTAIN else None

    def _substitute(self, p: Floats) -> EvaluationArrays | None:
        """The surrogate's evaluation at p (n,); None where it is not asked or not close."""
        tolerance = self._tolerance
        if not tolerance or not self._visited or ("evaluate", p.tobytes()) in self._asked:
            return None
        kind = self._kind_of_surrogate()
        known = self._log.find(kind, p)
        if known is None or ("v" not in known and known["error"][0] <= tolerance):
            known = self._ask_surrogate(p, tolerance)
            if known is None:
                return None
            self._log.add(kind, p, known)
        if not known["error"][0] <= tolerance:
            return None
        if known["error"][0] > CERTAIN:
            self._approximate.add(p.tobytes())
        return known

    def _kind_of_surrogate(self) -> str:
        """Kind of its evaluations in the log: it is another surrogate after each evaluation."""
        return f"surrogate {sha256(np.array(self._visited).tobytes()).hexdigest()[:16]}"

    def _ask_surrogate(self, p: Floats, tolerance: float) -> EvaluationArrays | None:
        """The surrogate's answer at p (n,), its error alone if that is too large; None for none."""
        try:
            surrogate = self._surrogate()
            if surrogate is None:
                return None
            error = surrogate.error(p)
            arrays = {"error": np.array([error])}
            if error <= tolerance:
                v, dv_dp = surrogate.evaluate(p)
                arrays |= {"v": v, "dv_dp": dv_dp, "increments": surrogate.increments(p)}
        except ModelError:  # such as no time for what it is made of
            return None
        return arrays

    def _surrogate(self) -> Surrogate | None:
        inner = self._inner
        if not self._visited or not isinstance(inner, HasSurrogate):
            return None
        if inner.surrogate_obstacle() is not None:
            return None
        return inner.surrogate(self._visited)

    # Prefetching: parts of a search that other processes work on before they are asked for

    @property
    def at_once(self) -> int:
        """How many parts of a search are worked on at a time."""
        return 1 if self._elsewhere is None else self._elsewhere.processes.at_once()

    @contextmanager
    def prefetch(self, tasks: Sequence[SearchTask]) -> Iterator[BeginPart]:
        """Work on parts of a search meanwhile; each begins with a model that has forgotten others.

        Args:
            tasks: they, in their order.
        """
        where, inner = self._elsewhere, self._inner
        several = where is not None and len(tasks) > 1 and where.processes.at_once(tasks) > 1
        # what others evaluate gives no surrogate here, which is to answer a part of what they ask
        if where is not None and several and not (self._tolerance and self._surrogate()):
            self._prefetched = Prefetched(
                where, tasks, is_known=self._has_readings, take=self._merge, check=self._before
            )

        def turn(number: int) -> None:
            inner.forget()
            if self._prefetched is not None:
                self._prefetched.turn = number

        try:
            yield turn
        finally:
            ahead, self._prefetched = self._prefetched, None
            if tasks:  # what comes next has not seen the parts, wherever they were made
                inner.forget()
            if ahead is not None:
                ahead.end()

    def _merge(self, recording: Recording) -> None:
        """Keep what another process has evaluated."""
        for kind, p, arrays in recording.evaluations:
            if self._log.find(kind, p) is None:
                self._log.add(kind, p, arrays)
        for kind, p, error in recording.failures:
            self._no_solution[kind, p.tobytes()] = error
        self._spent = self._spent + recording.spent

    def _has_readings(self, p: Floats) -> bool:
        """Whether the readings at p (n,) are in the log, or known to be none."""
        return any(
            (kind, p.tobytes()) in self._no_solution or self._log.find(kind, p) is not None
            for kind in ("readings", "evaluate")
        )

    def _prefetched_answer(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """What another process has evaluated at p (n,); None where it is to be computed here.

        Raises:
            ModelError: there is no solution, or every process that worked on it was lost.
        """
        if self._prefetched is None:
            return None
        self._prefetched.wait()
        if (error := self._no_solution.get((kind, p.tobytes()))) is not None:
            self._asked.add((kind, p.tobytes()))
            raise error
        if (known := self._from_log(kind, p)) is None:
            self._prefetched.require_answer()
        return known

    # The log

    def _plain_evaluation(self, p: Floats) -> EvaluationArrays:
        """An evaluation at p (n,), if need be without derivatives."""
        return (
            self._substitute(p)
            or self._from_log("readings", p)
            or self._from_log("evaluate", p)
            or self._compute(
                "readings",
                p,
                lambda: evaluation_arrays(self._inner.evaluation(p, derivatives=False)),
            )
        )

    def _logged_or_computed(
        self, kind: str, p: Floats, work: Callable[[], EvaluationArrays]
    ) -> EvaluationArrays:
        """The arrays of an evaluation, from the log or computed for it."""
        known = self._from_log(kind, p)
        return self._compute(kind, p, work) if known is None else known

    def _from_log(self, kind: str, p: Floats) -> EvaluationArrays | None:
        known = self._log.find(kind, p)
        if known is not None:
            self._mark_asked(kind, p, known)
        return known

    def _compute(
        self, kind: str, p: Floats, work: Callable[[], EvaluationArrays]
    ) -> EvaluationArrays:
        self._before()
        if (known := self._prefetched_answer(kind, p)) is not None:
            return known
        before = self._inner.counts
        try:
            arrays = work()
        except ModelError as error:
            if not isinstance(error, TimeIsUp):
                self._asked.add((kind, p.tobytes()))
                self.failures.append((kind, p.copy(), error))
            raise
        finally:
            self._spent = self._spent + (self._inner.counts - before)
        self._log.add(kind, p, arrays)
        self._mark_asked(kind, p, arrays)
        return arrays

    def _mark_asked(self, kind: str, p: Floats, arrays: EvaluationArrays) -> None:
        """Count an evaluation that this run has asked for at p (n,)."""
        key = kind, p.tobytes()
        if key in self._asked:
            return
        self._asked.add(key)
        if kind != "evaluate":
            return
        self._evaluated.append(p.copy())
        # an answer carried over from another fit names the points its surrogate was made of
        for place in arrays.get("visited", p[None]):
            if not any(np.array_equal(place, before) for before in self._visited):
                self._visited.append(np.array(place))


@contextmanager
def substituting(response: Response, tolerance: float = EXACT) -> Iterator[None]:
    """Meanwhile the surrogate of a response answers; see `CachedResponse.substituting`."""
    if not isinstance(response, CachedResponse):
        yield
        return
    with response.substituting(tolerance):
        yield


def answered_approximately(response: Response, p: Floats) -> bool:
    """Whether at p (n,) a surrogate has answered with an error that is not `CERTAIN`."""
    return isinstance(response, CachedResponse) and response.answered_approximately(p)


def part_evaluator(parts: ModelParts) -> Callable[[SearchPartTask], Recording]:
    """In a process of its own: the model, and what evaluates parts of a search with it.

    Args:
        parts: of the model.
    """
    model = parts.build()

    def evaluate(task: SearchPartTask) -> Recording:
        control, recording = Control(stop=STOP, max_time=task.seconds), Recording()

        def before() -> None:
            STOP.check()
            if control.over() is not None:
                raise TimeIsUp(OUT_OF_TIME)

        model.on_state = lambda state: control.within()
        response = model.response(task.pairs, task.times)
        assert isinstance(response, ReducibleResponse)
        cached, begun = CachedResponse(response, recording, before=before), response.counts
        response.forget()
        with one_thread(), suppress(Interrupted, ModelError):  # what was found until then is of use
            task.search(cached)
        recording.failures, recording.spent = cached.failures, response.counts - begun
        return recording

    return evaluate
