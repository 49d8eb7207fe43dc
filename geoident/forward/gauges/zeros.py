"""What channels read of what they see: mostly the change since the state of their zero.

A channel sees one number x_j at each state j. Its reading at the state j, with the zero at j0, is

    v = a x_j + b x_j0        (a, b) = (1, -1) for a change, (1, 0) for a value, (0, 1) for what
                                       was there in situ
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import Reads

WEIGHTS = {Reads.CHANGE: (1.0, -1.0), Reads.VALUE: (1.0, 0.0), Reads.VIRGIN: (0.0, 1.0)}
"""Weights (a, b) of the state of a stage and of that of the zero in a reading."""


@dataclass(frozen=True)
class ReadingRule:
    """How the readings of all channels follow from what they see, and when they can be read.

    Args:
        channels: names.
        zero: (n_channels,) state at which each channel reads zero; where it reads a value, the
            virgin state.
        weights: (2, n_channels) the weights a and b.
        readable: (n_states, n_channels) when it can be read.

    >>> change = np.array([[1.0], [-1.0]])
    >>> rule = ReadingRule(("roof",), np.array([1]), change, np.ones((3, 1), bool))
    >>> seen = np.array([[0.0], [2.0], [5.0]])[..., None]
    >>> rule.readings(seen, np.array([0]), np.array([2]))
    array([[3.]])
    """

    channels: tuple[str, ...]
    zero: Ints
    weights: Floats
    readable: Bools

    def readings(self, observed: Floats, rows: Ints, states: Ints) -> Floats:
        """What channels read, (..., k), of what they see.

        Args:
            observed: (n_states, n_channels, k) what all channels see of the states.
            rows: (...) channels.
            states: (...) states of their readings.
        """
        at_stage, at_zero = self.weights[:, rows, None]
        # A NaN of a state that does not count must not spread.
        reading = np.where(at_stage == 0, 0.0, at_stage * observed[states, rows])
        # Zeros after the last state: such readings are masked by `readable`.
        zero = np.minimum(self.zero[rows], len(observed) - 1)
        return reading + np.where(at_zero == 0, 0.0, at_zero * observed[zero, rows])

    def steps(self, built_on: Bools, rows: Ints, states: Ints) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g).

        Args:
            built_on: (n_states, n_states) see `ConstructionSequence.built_on`.
            rows: (g,) channels.
            states: (g,) states of their readings.
        """
        at_stage, at_zero = self.weights[:, rows]
        return np.asarray(built_on[:, states] * at_stage + built_on[:, self.zero[rows]] * at_zero)

    def increments(self, observed: Floats, base: Ints) -> Floats:
        """What the step of each state changes in what channels see, (n_states, n_channels), SI.

        Of the virgin state it is what is there; 0 where a channel cannot be read.

        Args:
            observed: (m, n_channels) what all channels see of the first m states.
            base: (n_states,) the state on which each builds.
        """
        seen = np.zeros(self.readable.shape)
        known = self.readable[: len(observed)] & np.isfinite(observed)
        seen[: len(observed)][known] = observed[known]
        change = seen - seen[base]
        change[0] = seen[0]
        change[: len(observed)][~known] = 0.0
        change[len(observed) :] = 0.0
        return np.asarray(change)

    def before_zero(self, state: int, row: int) -> bool:
        """Whether a channel that reads a change is zeroed only after a state."""
        return bool(state < self.zero[row] and self.weights[1, row] < 0)
