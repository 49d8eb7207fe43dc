"""Many lines of the ground as one: drawing each by itself takes longer than finding them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from geoident.model.arrays import Floats

_MANY = 2000  # lines from which on an image is smaller


def add_segments(axes: Any, ends: Floats, box: tuple[Floats, Floats], **style: Any) -> None:
    """Draw lines that may be seen in a box, all as one; very many of them as an image.

    Args:
        axes: where to draw.
        ends: (k, 2, 2) their ends.
        box: lower and upper corner (2,) of what is shown.
        style: of the lines.
    """
    kept = (ends.max(axis=1) >= box[0]).all(axis=1) & (ends.min(axis=1) <= box[1]).all(axis=1)
    seen = ends[kept]
    if not len(seen):
        return
    look = {"rasterized": len(seen) > _MANY, "zorder": 2, "solid_capstyle": "round", **style}
    axes.add_artist(Line2D(*_chained(seen).T, **look))


def _chained(ends: Floats) -> Floats:
    """Lines (k, 2, 2) that meet as long ones (n, 2), with NaN between: a third of the bytes."""
    places, number = np.unique(ends.reshape(-1, 2) @ np.array([1.0, 1.0j]), return_inverse=True)
    first, second = number.reshape(-1, 2).T.tolist()
    at: list[list[int]] = [[] for _ in places]
    for k, (a, b) in enumerate(zip(first, second, strict=True)):
        at[a].append(k)
        at[b].append(k)
    used = [False] * len(first)
    order: list[int] = []
    starts = [k for k, lines in enumerate(at) if len(lines) != 2] + list(range(len(at)))
    for start in starts:
        for line in at[start]:
            here, following = start, line
            if not used[following]:
                order += [-1, here]
            while not used[following]:
                used[following] = True
                here = first[following] + second[following] - here
                order.append(here)
                following = next((k for k in at[here] if not used[k]), following)
    chain = np.append(places, complex(np.nan, np.nan))[np.array(order[1:])]
    return np.stack([chain.real, chain.imag], axis=1)
