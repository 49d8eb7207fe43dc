"""What every model of a case can say, whether it stands on a mesh or on a closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from geoident.forward.gauges.instrument_errors import InstrumentErrors
from geoident.forward.stages import ConstructionSequence
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.response import Response
from geoident.model.results.costs import Counts
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.result import FieldSeries, MemberForces, SupportReactions
from geoident.model.results.yielded import Mechanism, YieldedGround
from geoident.model.yielding import Activity


@dataclass(frozen=True)
class Survey:
    """All that the model says at one parameter vector.

    Args:
        computed: (n_channels, n_stages) readings, m; NaN where a channel can't be read.
        sensitivity: (n_channels, n_stages, n) their derivatives.
        fields: displacements and stresses of all states, or None.
        members: forces in linings and bolts, or None if there are none.
        collapses: a sentence for every stage at which the ground cannot carry the loads; what
            builds on it is NaN.
        activity: what the yield planes do in all stages, or None if nothing can yield.
        notes: what the user should know of this march.
        increments: (n_states, n_channels) what the step of each state changes in what the channels
            see, SI; of the virgin state what is there. 0 where they cannot be read.
        reaction: of the ground around an opening in closed form, or None.
        advance: of a tunnel face, with the fields; None for a case without distances to one.
        reactions: of the supports, with the fields, or None.
        yielded: how far ground yields, with the fields; None where nothing can.
        mechanism: how the ground moves at the first stage that collapses, or None.
    """

    computed: Floats
    sensitivity: Floats
    fields: FieldSeries | None
    members: MemberForces | None = None
    collapses: tuple[str, ...] = ()
    activity: Activity | None = None
    notes: tuple[str, ...] = ()
    increments: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    reaction: GroundReaction | None = None
    advance: FaceAdvance | None = None
    reactions: SupportReactions | None = None
    yielded: YieldedGround | None = None
    mechanism: Mechanism | None = None


class CaseModel(Protocol):
    """A case that is ready to answer: `StagedModel` on a mesh, `OpeningModel` without one."""

    on_state: Callable[[int], None] | None

    @property
    def case(self) -> Case:
        """The case; the coefficients of modes of its fields are the last of its parameters."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""

    @property
    def sequence(self) -> ConstructionSequence:
        """The states of construction."""

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state, the virgin state first."""

    @property
    def instrument_errors(self) -> InstrumentErrors:
        """What the gauges add by themselves."""

    @property
    def counts(self) -> Counts:
        """Costs so far."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""

    def steps(self, pairs: Sequence[tuple[str, str]]) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g): 1, 0 or -1.

        Args:
            pairs: their channels and stages.
        """

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> Response:
        """The response in the readings of some (channel, stage) pairs."""

    def survey(
        self, p: Floats, *, fields: bool, partial: bool = False, last: int | None = None
    ) -> Survey:
        """All channels at all stages, their derivatives, and the fields if wanted.

        Args:
            p: (n,) parameters.
            fields: whether displacements and stresses are wanted.
            partial: what stages that collapse leave unknown is NaN, instead of an error.
            last: index of the last state wanted, after which readings may be NaN; None for all.
        """
