"""A reduced model as a result keeps it: arrays that answer without mesh (theory 14)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from geoident.model.arrays import Bools, Floats, Ints

FORM = "geoident-reduced/4"
"""What the blocks of a kept reduced model mean; another form is not read.

Earlier forms had adjoints of the readings, and bounds by them; this one has what analyses that were
withheld say of their errors.
"""


@dataclass(frozen=True, eq=False)
class KeptReducedModel:
    """A reduced model with estimates of the errors of its readings, without its mesh.

    Args:
        form: what the blocks mean, see `FORM`.
        names: of the n parameters.
        reference: (n,) parameters whose moduli measure, SI.
        lower: (n,) least parameters for which it was made, SI.
        upper: (n,) largest ones, SI.
        analyses: (m, n) where it was made, SI: there it is exact.
        materials: of which there is ground in any state, and rigidities of structures.
        channels: names of all channels.
        weights: (2, n_channels) how often a reading counts the state of its stage and its zero.
        zero: (n_channels,) states at which channels read zero.
        readable: (n_states, n_channels) when they can be read.
        built_on: (n_states, n_states) [i, j]: state i is part of the history of state j, or is j.
        rows: (g,) channels of the readings that it answers.
        states: (g,) states of these readings.
        blocks: name to array (...): moduli, loads, states, errors of readings.
    """

    form: str
    names: tuple[str, ...]
    reference: Floats
    lower: Floats
    upper: Floats
    analyses: Floats
    materials: tuple[str, ...]
    channels: tuple[str, ...]
    weights: Floats
    zero: Ints
    readable: Bools
    built_on: Bools
    rows: Ints
    states: Ints
    blocks: Mapping[str, Floats]
