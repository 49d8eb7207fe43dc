"""Every model of a case: what all of them share is written once, in `ObservedModel`.

A model is a subclass of `ObservedModel`. It gives `observe`: what all channels see at all states
of construction at one parameter vector, with derivatives, and what only it knows (fields, reaction,
yielding); and `why_unseen`: why a channel cannot be read at a stage. Shared by all models are:

    zeros               a reading is what is seen, mostly less what was seen at the zero (`zeros`)
    instrument errors   ratios are factors, offsets and drifts are added (`instrument_errors`)
    readability         which channels can be read at which stages
    admissibility       which parameters have a model at all
    `response`          chosen readings as a function of the parameters, for identifiers
    `survey`            all that the model says at one parameter vector, for results

What a model observes depends on p alone. It may begin its iterations where earlier ones have ended
(which changes last digits only) and keep what is dear to compute again.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from geoident.errors import CollapseError, ModelError
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.gauges.zeros import ReadingRule
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.response import Evaluation
from geoident.model.results.costs import Counts
from geoident.model.results.interfaces import InterfaceStates
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.result import FieldSeries, MemberForces, SupportReactions
from geoident.model.results.shells import ShellForces
from geoident.model.results.yielded import Mechanism, YieldedGround
from geoident.model.yielding import Activity


@dataclass(frozen=True)
class Query:
    """What a model is asked at one parameter vector.

    Args:
        places: the readings that are wanted; a model may leave out what they do not need.
        last: number of the last state that is wanted.
        derivatives: whether derivatives by all parameters are.
        partial: what a stage without equilibrium leaves unknown is NaN, instead of an error.
        survey: with notes and forces in structures: all that a result says beside readings.
        fields: with displacements and stresses; a model of an opening in closed form gives its
            ground reaction instead, a program its most exact differences.
    """

    places: ReadingPlaces
    last: int
    derivatives: bool = True
    partial: bool = False
    survey: bool = False
    fields: bool = False


@dataclass(frozen=True, kw_only=True)
class Details:
    """What only some models know.

    Args:
        fields: displacements and stresses of all states, or None.
        members: forces in linings and bolts, or None if there are none.
        shells: those of shells.
        interfaces: what interfaces carry and how far they moved, or None if there are none.
        activity: what the yield planes do in all stages, or None if nothing can yield.
        notes: what the user should know of the model at these parameters.
        reaction: of the ground around an opening in closed form, or None.
        advance: of a tunnel face, with the fields; None for a case without distances to one.
        reactions: of the supports, with the fields, or None.
        yielded: how far ground yields, with the fields; None where nothing can.
        mechanism: how the ground moves at the first stage that collapses, or None.
    """

    fields: FieldSeries | None = None
    members: MemberForces | None = None
    shells: ShellForces | None = None
    interfaces: InterfaceStates | None = None
    activity: Activity | None = None
    notes: tuple[str, ...] = ()
    reaction: GroundReaction | None = None
    advance: FaceAdvance | None = None
    reactions: SupportReactions | None = None
    yielded: YieldedGround | None = None
    mechanism: Mechanism | None = None


@dataclass(frozen=True)
class Observed:
    """What a model observed at one parameter vector.

    Args:
        seen: (m, n_channels, 1 + n) what channels see of the first m states, SI, with derivatives;
            the last axis has length 1 if none were asked for, or if they are in ``jacobian``.
        jacobian: (g, n) of the readings that were asked for, where derivatives came by adjoints.
        failures: why stages have no equilibrium.
        details: what else it knows.
    """

    seen: Floats
    jacobian: Floats | None = None
    failures: tuple[ModelError, ...] = ()
    details: Details = Details()


@dataclass(frozen=True)
class Survey(Details):
    """All that a model says at one parameter vector.

    Args:
        computed: (n_channels, n_stages) readings, SI; NaN where a channel can't be read.
        sensitivity: (n_channels, n_stages, n) their derivatives.
        collapses: a sentence for every stage at which the ground cannot carry the loads, and the
            name of the stage; what builds on it is NaN.
        increments: (n_states, n_channels) what the step of each state changes in what the channels
            see, SI; of the virgin state what is there. 0 where they cannot be read.
    """

    computed: Floats
    sensitivity: Floats
    collapses: Mapping[str, str] = field(default_factory=dict)
    increments: Floats = field(default_factory=lambda: np.zeros((0, 0)))


class ObservedModel(ABC):
    """A model of a case: computes what its gauges read.

    Args:
        case: the case; the coefficients of modes of its fields are the last of its parameters.
        rule: how readings are made of what channels see.
        built_on: (n_states, n_states) which states stand in the history of each, see
            `ConstructionSequence.built_on`.
        bases: (n_states,) the state on which each builds.

    Attributes:
        names: of the n parameters.
        instrument_errors: what the gauges add by themselves.
        on_state: is told of every state computed.
        evaluations: how often the model was evaluated.
    """

    def __init__(self, case: Case, rule: ReadingRule, built_on: Bools, bases: Ints) -> None:
        self.case, self.rule, self.built_on, self.bases = case, rule, built_on, bases
        self.names = tuple(parameter.name for parameter in case.parameters)
        self.instrument_errors = InstrumentErrors(case, built_on)
        self.on_state: Callable[[int], None] | None = None
        self.evaluations = 0

    # What each model gives

    @abstractmethod
    def observe(self, p: Floats, query: Query) -> Observed:
        """What all channels see at p (n,), and what else the model knows there.

        Raises:
            ModelError: there is no solution; with ``query.partial``, only if nothing is left.
        """

    @abstractmethod
    def why_unseen(self, state: int, row: int) -> str:
        """Why a channel cannot be read at a state at which it can't, a clause."""

    def domain_fault(self, p: Floats) -> str | None:
        """Why finite p (n,) is outside the domain, or None."""
        return None

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return Counts(self.evaluations, 0, 0, 0)

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state, the virgin state first."""
        return (0,) * len(self.bases)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        return ()

    def forget(self) -> None:  # noqa: B027 - most models have nothing to forget
        """Begin the next evaluation as a new model does."""

    # What is the same for all

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return self.domain_fault(p) if np.all(np.isfinite(p)) else "a parameter is not finite"

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""
        row, state = self.rule.channels.index(channel), self.case.stage_names.index(stage)
        if self.rule.before_zero(state, row):
            return "it is zeroed only at a later stage"
        return None if self.rule.readable[state, row] else self.why_unseen(state, row)

    def steps(self, pairs: Sequence[tuple[str, str]]) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g): 1, 0 or -1.

        Args:
            pairs: their channels and stages.
        """
        places = ReadingPlaces.of(self.case, pairs, ())
        return self.rule.steps(self.built_on, places.rows, places.states)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> ObservedResponse[Any]:
        """The response in the readings of some (channel, stage) pairs.

        Args:
            pairs: what was read.
            times: when each was read, seconds since 1970; None for what is known of its stage.
        """
        return ObservedResponse(self, ReadingPlaces.of(self.case, pairs, times))

    def survey(
        self, p: Floats, *, fields: bool, partial: bool = False, last: int | None = None
    ) -> Survey:
        """All channels at all stages, their derivatives, and the fields if wanted.

        Args:
            p: (n,) parameters.
            fields: whether displacements and stresses are wanted, or what stands for them.
            partial: where a stage has no equilibrium, give what can be known without it.
            last: index of the last state wanted: readings of later ones are NaN, and forces in
                structures are left out; None for all.

        Raises:
            ModelError: a stage has no equilibrium; with ``partial``, only if nothing is left.
        """
        last = len(self.bases) - 1 if last is None else last
        places = self.readable_until(last)
        query = Query(places, last, partial=partial, survey=True, fields=fields)
        observed = self.observe(p, query)
        table = self.table(p, observed, places, derivatives=True)
        if observed.failures and not np.isfinite(table).any():
            raise observed.failures[0]
        return Survey(
            table[..., 0],
            table[..., 1:],
            {
                error.message: error.stage if isinstance(error, CollapseError) else ""
                for error in observed.failures
            },
            self._read_increments(p, observed),
            **vars(observed.details),
        )

    def computed(self, p: Floats) -> Floats:
        """All channels at all stages (n_channels, n_stages) at p (n,), SI, without derivatives.

        What a stage without equilibrium leaves unknown is NaN.

        Raises:
            ModelError: there is no solution.
        """
        last = len(self.bases) - 1
        query = Query(self.readable_until(last), last, derivatives=False, partial=True)
        return self.table(p, self.observe(p, query), query.places, derivatives=False)[..., 0]

    def evaluation_of(
        self, p: Floats, observed: Observed, places: ReadingPlaces, *, derivatives: bool
    ) -> Evaluation:
        """Readings (g,) of what was observed at p (n,), with their Jacobian if wanted."""
        table = self.readings_of(p, observed, places, derivatives=derivatives)
        return Evaluation(
            table[:, 0],
            table[:, 1:] if derivatives else None,
            self._read_increments(p, observed),
            observed.details.activity,
        )

    def increments_of(self, observed: Observed) -> Floats:
        """What the step of each state changes in what channels see, (n_states, n_channels), SI."""
        return self.rule.increments(observed.seen[:, :, 0], self.bases)

    def _read_increments(self, p: Floats, observed: Observed) -> Floats:
        """The same as channels read it at p (n,), with their ratios."""
        return self.increments_of(observed) * self.instrument_errors.ratios(self.values(p))

    def readings_of(
        self, p: Floats, observed: Observed, places: ReadingPlaces, *, derivatives: bool
    ) -> Floats:
        """Readings with what instruments add, (g, 1 + n) or (g, 1), SI."""
        columns = None if derivatives and observed.jacobian is None else 1
        seen = observed.seen[:, :, :columns]
        table = self.rule.readings(seen, places.rows, places.states)
        if derivatives and observed.jacobian is not None:
            table = np.hstack([table, observed.jacobian])
        names, values = self.names if derivatives else (), self.values(p)
        table = self.instrument_errors.scaled(table, values, names, places.rows)
        return np.asarray(table + self.instrument_errors.added(values, names, places))

    def table(
        self, p: Floats, observed: Observed, places: ReadingPlaces, *, derivatives: bool
    ) -> Floats:
        """All readings (n_channels, n_stages, 1 + n or 1); NaN where none is at a place."""
        readings = self.readings_of(p, observed, places, derivatives=derivatives)
        table = np.full((*self.rule.readable.shape, readings.shape[1]), np.nan)
        table[places.states, places.rows] = readings
        return table[1:].swapaxes(0, 1)  # without the virgin state

    def readable_until(self, last: int) -> ReadingPlaces:
        """All that can be read up to a state, at the times known of the stages."""
        readable = self.rule.readable[: last + 1].copy()
        readable[0] = False
        states, rows = np.nonzero(readable)
        return ReadingPlaces(rows, states, np.full(len(rows), np.nan))


ModelT = TypeVar("ModelT", bound=ObservedModel)


class ObservedResponse(Generic[ModelT]):
    """Readings of a model as a function of its parameters: a `Response` for identifiers.

    Args:
        model: of the case.
        places: what was read, where and when.
    """

    def __init__(self, model: ModelT, places: ReadingPlaces) -> None:
        self._model, self._places = model, places
        self._last = int(places.states.max(initial=0))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self._model.names

    @property
    def counts(self) -> Counts:
        """Costs so far: of the model."""
        return self._model.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return self._model.admissible(p)

    def forget(self) -> None:
        """Begin the next evaluation as a new model does."""
        self._model.forget()

    def evaluation(self, p: Floats, *, derivatives: bool = True) -> Evaluation:
        """All that is known of the readings at p (n,).

        Raises:
            ModelError: the model has no solution there.
        """
        observed = self._model.observe(p, Query(self._places, self._last, derivatives=derivatives))
        return self._model.evaluation_of(p, observed, self._places, derivatives=derivatives)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), SI."""
        return self.evaluation(p, derivatives=False).readings

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        evaluation = self.evaluation(p)
        assert evaluation.jacobian is not None
        return evaluation.readings, evaluation.jacobian

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see at p (n,).

        (n_states, n_channels), SI, up to the last stage that a reading needs.
        """
        return self.evaluation(p, derivatives=False).increments
