"""Heat in stages: what has a given temperature, exchanges heat, or sets it free.

Temperatures are in degrees Celsius, of which only differences count.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar, Values


@dataclass(frozen=True)
class Course:
    """A number that changes in time: linear between some times, constant before and after.

    Args:
        times: (k,) s, increasing.
        values: (k,) at these times.
    """

    times: tuple[float, ...]
    values: tuple[Scalar, ...]

    def at(self, time: float, point: ParameterPoint) -> Dual:
        """Its value at a time, s."""
        return self._sum(
            [np.interp(time, self.times, row) for row in np.eye(len(self.times))], point
        )

    def over(self, start: float, end: float, point: ParameterPoint) -> Dual:
        """Its integral from a time to another, s."""
        inside = [time for time in self.times if start < time < end]
        at = np.array([start, *inside, end])
        rows = (np.interp(at, self.times, row) for row in np.eye(len(self.times)))
        return self._sum([float(np.trapezoid(row, at)) for row in rows], point)

    def _sum(self, shares: Sequence[float], point: ParameterPoint) -> Dual:
        """The values times shares (k,) of them."""
        terms = zip(self.values, shares, strict=True)
        return sum(
            (point.number(value).times(share) for value, share in terms if share),
            start=point.constant(0.0),
        )


@dataclass(frozen=True)
class HeatFace:
    """Faces or nodes that heat flows through.

    Args:
        temperature: of the ground there; with a film, of the air or water beyond. Its times count
            from the beginning of the stage that says it.
        film: coefficient of the exchange, W/m2K; None: the ground has the temperature.
    """

    temperature: Course
    film: Scalar | None = None

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        return (*self.temperature.values, *(() if self.film is None else (self.film,)))


@dataclass(frozen=True)
class Hydration:
    """Heat of concrete that hardens: by how much it would warm if none could leave.

    It is rise (1 - exp(-age / time)), or a table.

    Args:
        rise: in the end, K.
        time: s.
        curve: rise over the age, in place of the two; None for none.
    """

    rise: Scalar = Scalar(0.0)
    time: Scalar = Scalar(1.0)
    curve: Course | None = None

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        return (self.rise, self.time) if self.curve is None else self.curve.values

    def until(self, age: float, point: ParameterPoint) -> Dual:
        """The rise until an age, s; in K."""
        if self.curve is not None:
            return self.curve.at(age, point)
        left = (point.number(self.time).reciprocal() * -age).exp()
        return point.number(self.rise) * (left * -1.0 + 1.0)

    def breach(self, values: Values) -> str | None:
        """What cannot be at parameter values, a clause; None for nothing."""
        time = self.time.value(values)
        why = f"the time of its hydration is {time:.4g} s, it must be positive"
        return None if time > 0.0 else why


def bends(course: Course | None, begun: float) -> Iterator[float]:
    """Times, s, at which a course that began at a time changes its slope."""
    if course is not None and len(course.times) > 1:
        yield from (begun + time for time in course.times)
