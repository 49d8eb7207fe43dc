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
    seen = (ends.max(axis=1) >= box[0]).all(axis=1) & (ends.min(axis=1) <= box[1]).all(axis=1)
    if seen.any():
        parted = np.pad(ends[seen], ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
        look = {"rasterized": len(parted) > _MANY, "solid_capstyle": "round", **style}
        axes.add_artist(Line2D(*parted.reshape(-1, 2).T, zorder=2, **look))
