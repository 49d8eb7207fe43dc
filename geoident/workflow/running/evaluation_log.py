"""A model that remembers its answers, so that an interrupted run goes on where it was.

Every evaluation is written to a log the moment it is known. An identifier started again asks for
the same parameter vectors in the same order, is answered from the log, and arrives at the point of
interruption with the same numbers and the same counts as if it had never stopped.

Of the counts, evaluations, factorizations and solves are sums over the evaluations that this run
asked for, whether computed now or remembered. Symbolic analyses are made once a process: the
largest count that any process saw is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from hashlib import sha256
from typing import Protocol, runtime_checkable

import numpy as np

from geoident.errors import ModelError, TimeIsUp
from geoident.identify.problem.ahead import Look, Turn
from geoident.identify.problem.responses import (
    AffineElastic,
    ComplementaritySystem,
    HasIncrements,
    HasOpening,
    OpeningForm,
    YieldSystem,
)
from geoident.model.arrays import Bools, Floats
from geoident.model.response import (
    BilinearSystem,
    Condensed,
    HasSurrogate,
    Response,
    Surrogate,
)
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity
from geoident.workflow.executing.looking_ahead import (
    EvaluationArrays,
    Failure,
    LookedAhead,
    Recording,
    ResponseBeside,
)

_ACTIVITY = ("points", "biactive", "distances", "reached", "slopes")
_NAMES = ("planes", "stages")


class Log(Protocol):
    """Where evaluations are kept: `io.result.checkpoint.EvaluationLog`, or a toy in tests."""

    def find(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """What was kept for this kind of evaluation at p (n,), or None."""

    def add(self, kind: str, p: Floats, arrays: EvaluationArrays) -> None:
        """Keep an evaluation.

        Args:
            kind: of evaluation.
            p: (n,) where.
            arrays: (...) what was found, by name.
        """


EXACT = 1e-6
"""Error in energy, relative, up to which the surrogate answers for the model.

Where the model is asked once more at the end. What is found by it (weights of readings, and where
to look at the model itself) is known to 0.2 % at best."""


def carry_over(
    known: EvaluationArrays | None,
    other: Log,
    p: Floats,
    rows: Bools,
    n_states: int,
    visited: Sequence[Floats] = (),
) -> None:
    """Give a fit of some of the readings of another what is known of all at p, if it is.

    Args:
        known: readings, derivatives and increments at p, as the log of the fit of all has them or
            `Remembered.answer` gives them; None for nothing.
        other: of the fit of some.
        p: (n,) parameters, SI.
        rows: (g,) which of the readings of the first the second has too.
        n_states: how far the second marches, with the virgin state.
        visited: (n,) parameters at which the first was evaluated with derivatives: their marches
            serve the reduced model of the second.
    """
    if known is None or "increments" not in known:
        return
    some = {name: known[name][rows] for name in ("v", "dv_dp")}
    increments = np.array(known["increments"])
    increments[n_states:] = 0.0
    free = {"cost": np.zeros(4), "visited": np.array(visited).reshape(-1, len(p))}
    other.add("evaluate", p, {**some, "increments": increments, **free})


@runtime_checkable
class CountsOnce(Response, Protocol):
    """A model that does not count again what it computes again."""

    def remembers(self, p: Floats) -> None:
        """The answer at p (n,) with derivatives is known and was counted, from an earlier run."""


class Staged(AffineElastic, YieldSystem, HasOpening, Protocol):
    """All that the identifiers may ask of the staged model."""


@runtime_checkable
class BeginsNear(Protocol):
    """A model whose evaluations may begin from what earlier ones have left."""

    def forget(self) -> None:
        """Begin the next evaluation as a new model does."""


@runtime_checkable
class KeepsStarts(BeginsNear, Protocol):
    """One that can be given back from where its evaluations may begin."""

    def starts(self) -> object:
        """From where they may begin now, without factors."""

    def begin_from(self, starts: object) -> None:
        """Begin the next evaluation from what was known then.

        Args:
            starts: of this model, as they were.
        """


def forget(model: object) -> None:
    """Have a model begin its next evaluation as a new one does, if it does not anyway."""
    if isinstance(model, BeginsNear):
        model.forget()


class Remembered:
    """A response whose evaluations are logged, and answered from the log when they come again.

    Args:
        inner: the model.
        log: of evaluations of the same problem.
        before: called before every evaluation that must be computed; raises to stop the run.
        elsewhere: processes that look ahead; None for none.

    Attributes:
        failures: evaluations without solution, in their order: kind, parameters (n,) and failure.
    """

    def __init__(
        self,
        inner: Staged,
        log: Log,
        *,
        before: Callable[[], None],
        elsewhere: ResponseBeside | None = None,
    ) -> None:
        self.failures: list[tuple[str, Floats, Failure]] = []
        self._elsewhere = elsewhere
        self._ahead: LookedAhead | None = None
        self._failed: dict[tuple[str, bytes], Failure] = {}  # known from other processes
        self._inner = inner
        self._log = log
        self._before = before
        self._counts = inner.counts
        self._seen: set[tuple[str, bytes]] = set()
        self._evaluated: list[Floats] = []
        self._metric = ""  # of the first condensation
        self._visited: list[Floats] = []  # where it was evaluated with derivatives
        self._led = 0.0
        self._near: set[bytes] = set()  # where the surrogate has answered

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self._inner.names

    @property
    def counts(self) -> Counts:
        """Costs so far, those of remembered evaluations among them."""
        return self._counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain of the model, or None."""
        return self._inner.admissible(p)

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, or None."""
        return self._inner.obstacle()

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningForm | str:
        """The closed form, whose evaluations cost nothing and are not kept, or why none is."""
        return self._inner.opening(centre, radius)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,)."""
        known = self._instead(p) or self._from_log("readings", p) or self._from_log("evaluate", p)
        if known is None:
            known = self._compute(
                "readings", p, lambda: {"v": self._inner.readings(p), **self._seen_at(p)}
            )
        return np.array(known["v"])

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        near = self._instead(p)
        if near is not None:
            return np.array(near["v"]), np.array(near["dv_dp"])
        inner = self._inner
        known = self._known("evaluate", p, lambda: self._evaluate(p))
        if isinstance(inner, CountsOnce):
            inner.remembers(p)
        # what another fit has evaluated costs nothing, and no march is made for it
        for other in known.get("visited", p[None]):
            if not any(np.array_equal(other, before) for before in self._visited):
                self._visited.append(other.copy())
        return np.array(known["v"]), np.array(known["dv_dp"])

    @contextmanager
    def led(self, exact: float = EXACT) -> Iterator[None]:
        """Meanwhile the surrogate answers wherever it is close enough by its own estimate.

        For searches whose weights are not yet those of the end: there the model is to be asked
        once more.

        Args:
            exact: its error in energy, relative, at most.
        """
        before, self._led = self._led, exact
        try:
            yield
        finally:
            self._led = before

    def knows_nearly(self, p: Floats) -> bool:
        """Whether at p (n,) the surrogate has answered, and not the model."""
        return p.tobytes() in self._near and ("evaluate", p.tobytes()) not in self._seen

    def answer(self, p: Floats) -> EvaluationArrays | None:
        """Readings, derivatives and increments at p (n,), where they are known; else None."""
        return self._log.find("evaluate", p)

    def _instead(self, p: Floats) -> EvaluationArrays | None:
        """What the surrogate says at p (n,); None where it is not asked or not close."""
        if not self._led or ("evaluate", p.tobytes()) in self._seen or not self._visited:
            return None
        try:
            surrogate = self.surrogate(self._visited)
            if surrogate is None or not surrogate.error(p) <= self._led:
                return None
            v, dv_dp = surrogate.evaluate(p)
            increments = surrogate.increments(p)
        except ModelError:  # such as no time for an evaluation
            return None
        self._near.add(p.tobytes())
        return {"v": v, "dv_dp": dv_dp, "increments": increments}

    @property
    def at_once(self) -> int:
        """How many parts of a search are worked on at a time."""
        return 1 if self._elsewhere is None else self._elsewhere.processes.at_once()

    @property
    def may_be_led(self) -> bool:
        """Whether descents are led by what others have evaluated, by a reduced model."""
        return self.surrogate_obstacle() is None

    @contextmanager
    def turns(self, looks: Sequence[Look]) -> Iterator[Turn]:
        """Work on parts of a search meanwhile; each begins with a model that has forgotten others.

        What comes after them begins from what was known before.

        Args:
            looks: they, in their order.
        """
        where, inner = self._elsewhere, self._inner
        before = inner.starts() if looks and isinstance(inner, KeepsStarts) else None
        if where is not None and len(looks) > 1 and where.processes.at_once(looks) > 1:
            self._ahead = LookedAhead(self, where, looks)

        def turn(number: int) -> None:
            forget(inner)
            if self._ahead is not None:
                self._ahead.turn = number

        try:
            yield turn
        finally:
            ahead, self._ahead = self._ahead, None
            if looks:  # what comes next has not seen the parts, wherever they were made
                forget(inner)
            if isinstance(inner, KeepsStarts) and before is not None:
                inner.begin_from(before)
            if ahead is not None:
                ahead.end()

    def take(self, found: Recording) -> None:
        """Keep what another process has evaluated; it counts when it is asked for."""
        for kind, p, arrays in found.evaluations:
            if self._log.find(kind, p) is None:
                self._log.add(kind, p, arrays)
        for kind, p, failure in found.failures:
            self._failed[kind, p.tobytes()] = failure

    def knows(self, kind: str, p: Floats) -> bool:
        """Whether the answer at p (n,) is in the log, or known to be none."""
        return (kind, p.tobytes()) in self._failed or self._log.find(kind, p) is not None

    def recalled(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """The answer at p (n,) if it is in the log; it counts.

        Raises:
            ModelError: it is known that there is no solution.
        """
        failure = self._failed.get((kind, p.tobytes()))
        if failure is not None:
            self._spend(failure.cost)
            raise failure.error
        return self._from_log(kind, p)

    def evaluated(self) -> Sequence[Floats]:
        """Parameter vectors (n,) that this run has evaluated with derivatives, in their order."""
        return tuple(self._evaluated)

    def visited(self) -> Sequence[Floats]:
        """Parameter vectors (n,) of which the surrogate is made, in their order."""
        return tuple(self._visited)

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see, (n_states, n_channels).

        At a p (n,) that was evaluated it costs nothing.
        """
        known = self._instead(p) or self._from_log("evaluate", p) or self._from_log("readings", p)
        if known is None or "increments" not in known:
            known = self._compute("increments", p, lambda: self._seen_at(p))
        return np.array(known["increments"])

    def surrogate_obstacle(self) -> str | None:
        """Why the model has no surrogate, a clause, or None if it may have one."""
        inner = self._inner
        if not isinstance(inner, HasSurrogate):
            return "the model has none"
        return inner.surrogate_obstacle()

    def surrogate(self, visited: Sequence[Floats]) -> Surrogate | None:
        """The surrogate that some evaluations make, whose answers are logged; None for none.

        Args:
            visited: (n,) where.
        """
        inner = self._inner
        if not (visited and isinstance(inner, HasSurrogate)) or self.surrogate_obstacle():
            return None
        return LoggedSurrogate(inner, self._log, visited)

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
        known = self._known(kind, p, lambda: self._condense(p, measured, sd))
        return Condensed(
            readings=np.array(known["v"]),
            flexibility=np.array(known["flexibility"]),
            matrix=np.array(known["matrix"]),
            vector=np.array(known["vector"]),
        )

    def yields(self) -> bool:
        """Whether any material of the model has yield limits."""
        return self._inner.yields()

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,), logged: to find them again costs a whole analysis."""
        return _restored(self._known("activity", p, lambda: _stored(self._inner.activity(p))))

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

    def _evaluate(self, p: Floats) -> EvaluationArrays:
        v, dv_dp = self._inner.evaluate(p)
        return {"v": v, "dv_dp": dv_dp, **self._seen_at(p)}

    def _seen_at(self, p: Floats) -> EvaluationArrays:
        """What the run that was just made at p (n,) says of the steps of the stages."""
        inner = self._inner
        return {"increments": inner.increments(p)} if isinstance(inner, HasIncrements) else {}

    def _condense(self, p: Floats, measured: Floats, sd: Floats) -> EvaluationArrays:
        found = self._inner.condense(p, measured, sd)
        return {
            "v": found.readings,
            "flexibility": found.flexibility,
            "matrix": found.matrix,
            "vector": found.vector,
        }

    def _known(
        self, kind: str, p: Floats, work: Callable[[], EvaluationArrays]
    ) -> EvaluationArrays:
        """What the log has, or what is computed for it."""
        known = self._from_log(kind, p)
        return self._compute(kind, p, work) if known is None else known

    def _from_log(self, kind: str, p: Floats) -> EvaluationArrays | None:
        known = self._log.find(kind, p)
        if known is not None and (kind, p.tobytes()) not in self._seen:
            self._see(kind, p)
            self._spend(known["cost"])
        return known

    def _compute(
        self, kind: str, p: Floats, work: Callable[[], EvaluationArrays]
    ) -> EvaluationArrays:
        self._before()
        if self._ahead is not None and (known := self._ahead.known(kind, p)) is not None:
            return known
        before = self._inner.counts
        try:
            arrays = work()
        except Exception as error:
            cost = _cost(before, self._inner.counts)
            self._spend(cost)
            if isinstance(error, ModelError) and not isinstance(error, TimeIsUp):
                self.failures.append((kind, p.copy(), Failure(error, cost)))
            raise
        cost = _cost(before, self._inner.counts)
        self._log.add(kind, p, {**arrays, "cost": cost})
        self._see(kind, p)
        self._spend(cost)
        return arrays

    def _see(self, kind: str, p: Floats) -> None:
        """Note that this run has asked for something at p (n,)."""
        if kind == "evaluate" and (kind, p.tobytes()) not in self._seen:
            self._evaluated.append(p.copy())
        self._seen.add((kind, p.tobytes()))

    def _spend(self, cost: Floats) -> None:
        evaluations, factorizations, solves, analyses, *more = (int(number) for number in cost)
        self._counts = replace(
            self._counts,
            evaluations=self._counts.evaluations + evaluations,
            factorizations=self._counts.factorizations + factorizations,
            solves=self._counts.solves + solves,
            analyses=max(self._counts.analyses, analyses),
            iterations=self._counts.iterations + sum(more),
        )


class LoggedSurrogate:
    """A surrogate whose answers are logged: a run that goes on makes none to hear them again.

    Args:
        inner: the model.
        log: of its evaluations.
        visited: (n,) parameters of which the surrogate is made.
    """

    def __init__(self, inner: HasSurrogate, log: Log, visited: Sequence[Floats]) -> None:
        self._inner, self._log, self._visited = inner, log, tuple(visited)
        self._kind = f"surrogate {sha256(np.array(visited).tobytes()).hexdigest()[:16]}"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self._inner.names

    @property
    def counts(self) -> Counts:
        """It costs nothing that is counted."""
        return Counts()

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return self._inner.admissible(p)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,)."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        known = self._at(p)
        return np.array(known["v"]), np.array(known["dv_dp"])

    def error(self, p: Floats) -> float:
        """Error of its stresses at p (n,) in energy, relative to their own; infinite for none."""
        return float(self._at(p)["error"][0])

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see, (n_states, n_channels)."""
        return np.array(self._at(p)["increments"])

    def _at(self, p: Floats) -> EvaluationArrays:
        known = self._log.find(self._kind, p)
        if known is None:
            surrogate = self._inner.surrogate(self._visited)
            nothing = np.zeros(0)
            known = {"v": nothing, "dv_dp": nothing, "increments": nothing}
            known["error"] = np.array([np.inf])
            if surrogate is not None:
                with suppress(ModelError):
                    v, dv_dp = surrogate.evaluate(p)
                    increments, error = surrogate.increments(p), np.array([surrogate.error(p)])
                    known = {"v": v, "dv_dp": dv_dp, "increments": increments, "error": error}
            self._log.add(self._kind, p, known)
        if not len(known["v"]):
            raise ModelError("the surrogate has no answer")
        return known


@contextmanager
def led(response: Response, exact: float = EXACT) -> Iterator[None]:
    """Meanwhile a response that has a reduced model is answered by it; see `Remembered.led`."""
    with response.led(exact) if isinstance(response, Remembered) else nullcontext():
        yield


def known_nearly(response: Response, p: Floats) -> bool:
    """Whether at p (n,) the surrogate has answered, and not the model."""
    return isinstance(response, Remembered) and response.knows_nearly(p)


def _stored(found: Activity) -> EvaluationArrays:
    """The planes as arrays of numbers, names as code points."""
    numbers = {name: np.asarray(getattr(found, name), dtype=float) for name in _ACTIVITY}
    texts = {name: "\n".join(getattr(found, name)) for name in _NAMES}
    codes = {name: np.array(list(map(ord, text)), dtype=float) for name, text in texts.items()}
    return {**numbers, **codes}


def _restored(known: EvaluationArrays) -> Activity:
    """The planes that `_stored` made arrays of."""
    texts = {name: "".join(chr(int(code)) for code in known[name]) for name in _NAMES}
    planes, stages = (tuple(texts[name].split("\n")) for name in _NAMES)
    return Activity(
        planes=planes,
        stages=stages,
        points=np.asarray(known["points"], dtype=np.int64),
        biactive=np.asarray(known["biactive"], dtype=np.int64),
        distances=np.array(known["distances"]),
        reached=np.array(known["reached"]),
        slopes=np.array(known["slopes"]),
    )


def _cost(before: Counts, after: Counts) -> Floats:
    """What came between two counts; analyses up to the second."""
    return np.array(
        [
            after.evaluations - before.evaluations,
            after.factorizations - before.factorizations,
            after.solves - before.solves,
            after.analyses,
            after.iterations - before.iterations,
        ],
        dtype=np.float64,
    )
