"""Surveyed coordinates: from easting, northing and height of points to readings of targets.

A target reads components of the displacement of its point along unit vectors of the model. With R
the matrix whose rows are the axes of the model in the system of the survey and s the length in the
model of a length of 1 in the survey (1 divided by the scale of a map projection),

    x = s R (X - X0),    reading = d . x,  less that of the zero epoch,

so that the origin X0 falls out of readings; it only tells whether the target stands where the case
says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from geoident.model.arrays import Vector


@dataclass(frozen=True)
class SurveyTarget:
    """A target whose readings are made of coordinates.

    Args:
        directions: channel to its unit vector in the axes of the model, (3,).
        point: (dim,) where the case says it stands, m.
    """

    directions: Mapping[str, Vector]
    point: Vector


@dataclass(frozen=True)
class SurveyGrid:
    """The system of a survey, and what is made of it.

    Args:
        axes: rows (3, 3): the x, y and z axis of the model in easting, northing and height.
        scale: length in the model of a length of 1 in the survey.
        origin: (3,) of the model in the survey, m; None where it is not given.
        points: name of a point in the file to the names of its gauges; empty where they agree.
        targets: gauge to what is read there.
    """

    axes: tuple[Vector, Vector, Vector]
    scale: float = 1.0
    origin: Vector | None = None
    points: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    targets: Mapping[str, SurveyTarget] = field(default_factory=dict)

    def turned(self, vector: Vector) -> Vector:
        """A vector (3,) of the survey in the axes of the model, m."""
        return tuple(
            self.scale * sum(a * x for a, x in zip(axis, vector, strict=True)) for axis in self.axes
        )

    def position(self, coordinates: Vector) -> Vector | None:
        """Coordinates (3,) of the survey in the axes of the model, m; None without an origin."""
        if self.origin is None:
            return None
        return self.turned(tuple(x - o for x, o in zip(coordinates, self.origin, strict=True)))


def axes_of_azimuth(azimuth: float, *, plane: bool) -> tuple[Vector, Vector, Vector]:
    """Axes of a model whose x axis points to an azimuth, in easting, northing and height.

    In a plane model y points up and z out of the plane; in a solid z points up. Both are
    right-handed.

    Args:
        azimuth: of the x axis, clockwise from north, rad.
        plane: the model is a plane or turned about an axis.

    >>> axes_of_azimuth(0.0, plane=False)[:2]
    ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
    """
    east, north = math.sin(azimuth), math.cos(azimuth)
    along, up = (east, north, 0.0), (0.0, 0.0, 1.0)
    if plane:
        return along, up, (north, -east, 0.0)
    return along, (-north, east, 0.0), up
