"""What methods ask of a model beside its readings: the protocols that its response may fulfil.

`Response` of `model.response` is the least of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from geoident.model.arrays import Bools, Floats
from geoident.model.response import BilinearSystem, Condensed, Response
from geoident.model.yielding import Activity


@runtime_checkable
class AffineElastic(Response, Protocol):
    """A model whose equations are affine in its parameters: condensation needs this."""

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, a sentence, or None if they are."""

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        """Condensed equations at p (theory 4.1).

        Args:
            p: (n,) parameters.
            measured: (g,) readings, SI.
            sd: (g,) their standard deviations, SI; where readings share errors, the matrix (g, g)
                that makes their errors independent and of size one.
        """


@runtime_checkable
class HasIncrements(Response, Protocol):
    """A model that says what each stage adds to its readings: a model error needs this."""

    def increments(self, p: Floats) -> Floats:
        """(n_states, n_channels) what the step of each state changes in what all channels see.

        Args:
            p: (n,) parameters.
        """


@runtime_checkable
class HasEvaluated(Response, Protocol):
    """A model that remembers what it was asked: to ask the same again costs nothing."""

    def evaluated_points(self) -> Sequence[Floats]:
        """Parameter vectors (n,) that this run has evaluated with derivatives, in their order."""


@runtime_checkable
class HasDifferences(Response, Protocol):
    """A model whose derivatives are differences, good enough to search by until they decide."""

    def sharpen(self, p: Floats) -> bool:
        """Make the Jacobian at p (n,) as good as it can be; whether it was not before."""


@runtime_checkable
class HasNoise(Response, Protocol):
    """A model whose readings are not quite smooth in the parameters: few digits, iterations."""

    @property
    def noise(self) -> Floats:
        """(g,) standard deviation of what is not smooth, as far as it is known; 0 if it is not."""


class OpeningForm(Response, Protocol):
    """The closed form of an opening: readings by formulas."""

    @property
    def covered(self) -> Bools:
        """(g,) which readings of the model it answers; ``readings`` are these, in their order."""

    def remarks(self, p: Floats) -> tuple[str, ...]:
        """What is to be known of it at p (n,), sentences without a full stop."""


@runtime_checkable
class HasOpening(Response, Protocol):
    """A model that may be a circular opening in uniform ground: closed-form needs this."""

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningForm | str:
        """Its closed form, or why it has none, a clause.

        Args:
            centre: of the opening, m; None to find it.
            radius: of the opening, m; None to find it.
        """


@runtime_checkable
class YieldSystem(Response, Protocol):
    """A model with yield limits, stage by stage: complementarity needs this (theory 5).

    ``readings`` and ``evaluate`` raise `geoident.errors.CollapseError` where the loads cannot be
    carried. The Jacobian is that of the active pieces; at a kink, that of the planes that the
    projection counts as active.
    """

    def yields(self) -> bool:
        """Whether any material of the model has yield limits."""

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,). Costs nothing where p was the last to be evaluated."""


@runtime_checkable
class ComplementaritySystem(YieldSystem, Protocol):
    """A yield system that shows its equations: full-space and global need this (theory 5)."""

    def system_obstacle(self) -> str | None:
        """Why the equations are not those of a `BilinearSystem`, a clause, or None if they are."""

    def system(self) -> BilinearSystem:
        """The equations, with readings in the order of the response."""
