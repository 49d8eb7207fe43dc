"""Flat triangles as images: which triangle lies at each pixel, and how far from its corners.

That is found once for a sheet and a window. Every field and every stage then is a look-up, where
drawing thousands of triangles again would take a second each. A triangle covers one run of pixels
in each row of the image, and what is linear on it is linear along the run: so the geometry is that
of runs, and a pixel costs one addition.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints

PER_INCH = 200
"""Pixels of an image in an inch of the figure."""

_RIM = 1e-9
"""How far beyond a triangle, in parts of it, a pixel still lies on it: none falls between two."""


@dataclass(frozen=True)
class Raster:
    """Pixels of a window that lie on triangles, as runs along its rows.

    Args:
        low: (2,) lower left corner of the window.
        high: (2,) upper right corner.
        shape: rows and columns of the image; the lowest row comes first.
        triangles: (m, 3) of points.
        triangle: (r,) the triangle of each run.
        first: (r,) its first pixel, a place in the flattened image; triangles that touch may have
            a pixel in common.
        count: (r,) its pixels.
        weights: (r, 3) of the corners of the triangle at the middle of the first pixel.
        steps: (m, 3) what the weights grow by from pixel to pixel.
    """

    low: Floats
    high: Floats
    shape: tuple[int, int]
    triangles: Ints
    triangle: Ints
    first: Ints
    count: Ints
    weights: Floats
    steps: Floats

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper edge, as matplotlib wants them."""
        (x0, y0), (x1, y1) = self.low.tolist(), self.high.tolist()
        return x0, x1, y0, y1

    def linear(self, values: Floats, shown: Bools) -> Floats:
        """An image (rows, columns) of values at points, linear on triangles; NaN elsewhere.

        Args:
            values: (n,) at the points.
            shown: (m,) which triangles are shown.
        """
        runs = np.flatnonzero(shown[self.triangle])
        triangle, count = self.triangle[runs], self.count[runs]
        corners = values[self.triangles]
        slope = np.einsum("ij,ij->i", self.steps, corners)[triangle]
        start = np.einsum("ij,ij->i", self.weights[runs], corners[triangle])
        along = _along(count)
        image = np.full(self.shape[0] * self.shape[1], np.nan)
        image[np.repeat(self.first[runs], count) + along] = (
            np.repeat(start, count) + np.repeat(slope, count) * along
        )
        return image.reshape(self.shape)

    def flat(self, values: Any, shown: Bools, *, empty: Any = np.nan) -> Any:
        """An image (rows, columns, ...) of values of triangles.

        Args:
            values: (m, ...) of the triangles.
            shown: (m,) which of them are shown.
            empty: what stands where there is none.
        """
        runs = np.flatnonzero(shown[self.triangle])
        count, values = self.count[runs], np.asarray(values)
        kind = np.result_type(values.dtype, np.asarray(empty).dtype)
        image = np.full((self.shape[0] * self.shape[1], *values.shape[1:]), empty, dtype=kind)
        pixel = np.repeat(self.first[runs], count) + _along(count)
        image[pixel] = np.repeat(values[self.triangle[runs]], count, axis=0)
        return image.reshape(*self.shape, *values.shape[1:])


def _along(count: Ints) -> Ints:
    """0, 1, 2, ... along each of some runs, behind each other."""
    ends = np.cumsum(count)
    return np.asarray(np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - count, count))


def raster_of(xy: Floats, triangles: Ints, low: Floats, high: Floats, *, width: float) -> Raster:
    """Finds the pixels of triangles.

    Args:
        xy: (n, 2) points.
        triangles: (m, 3) of them.
        low: (2,) lower left corner of what is shown.
        high: (2,) upper right corner.
        width: of the image, inches.
    """
    columns = max(round(width * PER_INCH), 8)
    size = (high - low) / np.array([columns, 1.0])
    rows = max(round(size[1] / size[0]), 1)
    size[1] /= rows
    corners = ((xy - low) / size)[triangles] - 0.5  # pixels have their middles at whole numbers
    steps, up = _steps(corners)
    number, y = _rows(corners, steps, rows)
    away = np.stack([np.zeros(len(y)), y]).T - corners[number, 0]  # of column 0 from a corner
    weights = steps[number] * away[:, :1] + up[number] * away[:, 1:] + np.eye(3)[0]
    start, end = _ends(weights, steps[number], columns)
    runs = np.flatnonzero(end >= start)
    number, start, end, y = number[runs], start[runs], end[runs], y[runs]
    return Raster(
        low,
        high,
        (rows, columns),
        triangles,
        number,
        y * columns + start,
        end - start + 1,
        weights[runs] + steps[number] * start[:, None],
        steps,
    )


def _steps(corners: Floats) -> tuple[Floats, Floats]:
    """What the weights of the corners (m, 3, 2) of triangles grow by along x and along y.

    Returns:
        (m, 3) each; NaN where a triangle has no area.
    """
    opposite = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    first, second = opposite[:, 0], opposite[:, 1]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    over = np.full(len(area), np.nan)
    np.divide(1.0, area, out=over, where=area != 0.0)
    return -opposite[..., 1] * over[:, None], opposite[..., 0] * over[:, None]


def _rows(corners: Floats, steps: Floats, rows: int) -> tuple[Ints, Ints]:
    """The rows that cross triangles (m, 3, 2) which have an area: triangle and row of each."""
    y = corners[..., 1]
    first = np.ceil(y.min(axis=1) - _RIM).clip(0, rows).astype(np.int64)
    last = np.floor(y.max(axis=1) + _RIM).clip(-1, rows - 1).astype(np.int64)
    count = np.where(np.isfinite(steps[:, 0]), np.maximum(last - first + 1, 0), 0)
    number = np.repeat(np.arange(len(corners)), count)
    return number, first[number] + _along(count)


def _ends(weights: Floats, steps: Floats, columns: int) -> tuple[Ints, Ints]:
    """First and last column (r,) of runs in which no weight is negative.

    Args:
        weights: (r, 3) in the column 0.
        steps: (r, 3) what they grow by.
        columns: of the image.
    """
    start, end = np.zeros(len(weights)), np.full(len(weights), columns - 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = -(weights + _RIM) / steps  # where a weight changes its sign
    for k in range(3):
        grows, falls = steps[:, k] > 0.0, steps[:, k] < 0.0
        start = np.where(grows, np.maximum(start, np.ceil(zero[:, k])), start)
        end = np.where(falls, np.minimum(end, np.floor(zero[:, k])), end)
        outside = ~grows & ~falls & (weights[:, k] < -_RIM)
        end[outside] = -1.0
    return start.clip(0, columns).astype(np.int64), end.clip(-1, columns - 1).astype(np.int64)


def show(axes: Any, raster: Raster, colours: Any, **style: Any) -> None:
    """Put an image of colours (rows, columns, 4) in its place; NaN is nothing.

    Args:
        axes: where to draw.
        raster: of what.
        colours: (rows, columns, 4) red, green, blue and opacity, 0 to 1, or bytes of them.
        style: of the image.
    """
    rgba = colours
    if colours.dtype != np.uint8:
        rgba = np.round(255 * np.nan_to_num(colours)).astype(np.uint8)
    axes.imshow(
        rgba, extent=raster.extent, origin="lower", interpolation="none", aspect="equal", **style
    )
