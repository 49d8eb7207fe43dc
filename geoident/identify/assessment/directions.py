"""Names directions of the parameters in the language of the field.

A direction is read in relative changes of the parameters, w = d(ln p), so that "E and sigma_v scale
together" is the direction (1, 1) whatever their units and scales. A parameter whose bounds have
zero between them has no relative change; its scaled x takes the place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats

NOTICEABLE = 0.15
"""Entries below this part of the largest are not named."""

SIMILAR = 0.05
"""Entries that differ by less than this part count as equal."""


@dataclass(frozen=True)
class Direction:
    """A direction with its noticeable entries.

    Args:
        indices: of the parameters in it.
        names: their names.
        weights: their relative changes, the largest of size one, the first positive.
        relative: every entry is a relative change.
    """

    indices: tuple[int, ...]
    names: tuple[str, ...]
    weights: tuple[float, ...]
    relative: bool

    @classmethod
    def of(cls, w: Floats, names: Sequence[str], relative: Sequence[bool]) -> Direction:
        """Keeps the noticeable entries.

        Args:
            w: (n,) relative changes of the parameters.
            names: of the parameters.
            relative: for each, whether its entry is a relative change.
        """
        size = np.abs(w)
        kept = [int(i) for i in np.flatnonzero(size > NOTICEABLE * size.max())]
        weights = w[kept] / size.max() * np.sign(w[kept[0]])
        return cls(
            tuple(kept),
            tuple(names[i] for i in kept),
            tuple(float(a) for a in weights),
            all(relative[i] for i in kept),
        )

    @property
    def single(self) -> bool:
        """One parameter only."""
        return len(self.indices) == 1

    @property
    def equal(self) -> bool:
        """All entries are relative changes of the same size."""
        return self.relative and min(abs(a) for a in self.weights) > 1.0 - SIMILAR

    @property
    def subjects(self) -> str:
        """The parameters in a list, such as ``E and sigma_v``."""
        return join(self.names)

    def phrase(self) -> str:
        """How the parameters change along the direction.

        >>> Direction((0, 1), ("E", "sigma_v"), (1.0, 1.0), True).phrase()
        'E and sigma_v scale together'
        >>> Direction((0, 1), ("E", "nu"), (1.0, -0.4), True).phrase()
        'E and nu trade off (one up, the other down)'
        """
        up = [name for name, a in zip(self.names, self.weights, strict=True) if a > 0.0]
        down = [name for name, a in zip(self.names, self.weights, strict=True) if a < 0.0]
        if not down:
            return f"{self.subjects} {'scale' if self.equal else 'grow'} together"
        if len(self.names) == 2:
            return f"{self.subjects} trade off (one up, the other down)"
        return f"{join(up)} up trade off with {join(down)} down"


def join(names: Sequence[str]) -> str:
    """A list in words.

    >>> join(["E", "nu", "K0"])
    'E, nu and K0'
    """
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
