"""A march whose states are kept as they come, so that it can go on where it was left.

A fit asks for the readings of its last parameters, then for what the mesh does to them, at the end
for all that later stages will show. All of it is one march. Of a state is kept what does not depend
on the number of parameters: its displacements and stresses, and what the gauges see of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import islice

from geoident.forward.march.march import Run
from geoident.forward.march.stage import StageEnd
from geoident.model.arrays import Floats

MOST_KEPT = 100_000_000
"""Numbers that the states of a march may take: 0.8 GB."""

See = Callable[[StageEnd, Run], tuple[Floats, tuple[str, ...]]]
"""What all channels see of a state, (n_channels, 1 + n), and whose principal stresses coincide."""


@dataclass(eq=False)
class KeptMarch:
    """One elastic march with derivatives, as far as it was asked for.

    Args:
        run: whose states are wanted, to the last one.
        see: what gauges see.

    Attributes:
        ends: the states so far; of displacements and stresses, their values alone.
        observed: of every state, what all channels see with derivatives, (n_channels, 1 + n).
        equal: of every state, the channels that read one of several equal principal stresses.
    """

    run: Run
    see: See
    ends: list[StageEnd] = field(default_factory=list)
    observed: list[Floats] = field(default_factory=list)
    equal: list[tuple[str, ...]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._states = self.run.states()

    @property
    def p(self) -> tuple[float, ...]:
        """The values of all parameters."""
        return tuple(self.run.given.values.values())

    @property
    def last(self) -> int:
        """The state to which it has come; -1 before the first."""
        return len(self.ends) - 1

    def go_on(self, last: int, tell: Callable[[StageEnd, Run], None] | None = None) -> None:
        """March on to a state. It holds no factor while it waits.

        Args:
            last: index of the state.
            tell: is given every state that is computed now, whole, with the run; its arrays change.

        Raises:
            ModelError: the stiffness of a stage is not positive definite. It cannot go on then.
        """
        for end in islice(self._states, max(last - self.last, 0)):
            observed, equal = self.see(end, self.run)
            if tell is not None:
                tell(end, self.run)
            self.observed.append(observed)
            self.equal.append(equal)
            self.ends.append(_values(end))
        self.run.factors.forget()


def _values(end: StageEnd) -> StageEnd:
    """The values of a state without derivatives, copied."""
    return replace(
        end,
        u=end.u[:, :1].copy(),
        stresses=end.stresses.values(),
        members=end.members[:, :1].copy(),
        yielded=end.yielded.copy(),
        forces=None if end.forces is None else end.forces[:, :1].copy(),
    )
