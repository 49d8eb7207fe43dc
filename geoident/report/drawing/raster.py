"""Flat triangles as images: which triangle lies at each pixel, and how far from its corners.

That is found once for a sheet and a window. Every field and every stage then is a look-up, where
drawing thousands of triangles again would take a second each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints

PER_INCH = 200
"""Pixels of an image in an inch of the figure."""


@dataclass(frozen=True)
class Raster:
    """Pixels of a window that lie on triangles.

    Args:
        low: (2,) lower left corner of the window.
        high: (2,) upper right corner.
        shape: rows and columns of the image; the lowest row comes first.
        pixel: (k,) places in the flattened image; a pixel comes once for each triangle on it.
        triangle: (k,) the triangle there.
        corners: (k, 3) points of this triangle.
        weights: (k, 3) of its corners at the middle of the pixel.
    """

    low: Floats
    high: Floats
    shape: tuple[int, int]
    pixel: Ints
    triangle: Ints
    corners: Ints
    weights: Floats

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
        kept = np.flatnonzero(shown[self.triangle])
        image = np.full(self.shape[0] * self.shape[1], np.nan)
        image[self.pixel[kept]] = np.einsum(
            "ij,ij->i", self.weights[kept], values[self.corners[kept]]
        )
        return image.reshape(self.shape)

    def flat(self, values: Any, shown: Bools) -> Floats:
        """An image (rows, columns, ...) of values (m, ...) of triangles; NaN elsewhere."""
        kept = np.flatnonzero(shown[self.triangle])
        values = np.asarray(values, dtype=np.float64)
        image = np.full((self.shape[0] * self.shape[1], *values.shape[1:]), np.nan)
        image[self.pixel[kept]] = values[self.triangle[kept]]
        return image.reshape(*self.shape, *values.shape[1:])


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
    corners = (xy[triangles] - low) / size  # in pixels
    first = np.ceil(corners.min(axis=1) - 0.5).astype(np.int64).clip(0, (columns, rows))
    last = np.floor(corners.max(axis=1) - 0.5).astype(np.int64).clip(-1, (columns - 1, rows - 1))
    across, up = np.maximum(last - first + 1, 0).T
    number = np.repeat(np.arange(len(triangles)), across * up)
    ends = np.cumsum(across * up)
    k = np.arange(len(number)) - np.repeat(ends - across * up, across * up)
    x, y = first[number, 0] + k % across[number], first[number, 1] + k // across[number]
    origin = corners[:, 0]
    a, b = corners[:, 1] - origin, corners[:, 2] - origin
    with np.errstate(divide="ignore", invalid="ignore"):
        over = 1.0 / (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    dx, dy = x + 0.5 - origin[number, 0], y + 0.5 - origin[number, 1]
    s = (dx * b[number, 1] - dy * b[number, 0]) * over[number]
    t = (dy * a[number, 0] - dx * a[number, 1]) * over[number]
    inside = np.flatnonzero((s >= -1e-9) & (t >= -1e-9) & (s + t <= 1 + 1e-9))
    s, t, number = s[inside], t[inside], number[inside]
    return Raster(
        low,
        high,
        (rows, columns),
        y[inside] * columns + x[inside],
        number,
        triangles[number],
        np.stack([1 - s - t, s, t], axis=1),
    )


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
