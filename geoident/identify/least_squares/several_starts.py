"""Descents from several points, and the minima that they come to (theory 12.1).

A descent goes to the minimum whose basin it starts in. Where that may be the wrong one, further
descents begin elsewhere:

    an angle is sought      the misfit has the symmetries of the ground, so several basins: the
                            angle is spread evenly over its period, the rest starts as given
    sign of another basin   between two points that the first descent evaluated, the way to the
                            lower one begins uphill (phi is not quasi-convex), or it ended at a
                            kink: all parameters are spread over their bounds
    Student's loss          readings that are far off lose all weight, so every part of them that
                            agrees may have a minimum: starts where parts of the linearised readings
                            lead, and all parameters are spread

Where the user says how many, all parameters are spread. Angles are counted on the circle: a start
is never near another one by a whole period, a descent that ends on the bound of an angle goes on
from the other side, and two minima that differ by a period are one.

A further descent is left as soon as its next step would end at a minimum that is known, or as it
settles so far above the best one that it cannot become a rival; never where it is the best itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice, product

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Iterate, Step
from geoident.identify.least_squares.descent import Descent, Ending
from geoident.identify.problem.ahead import SearchTask, prefetching
from geoident.identify.problem.outcome import LocalMinimum, Outcome
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter

AUTOMATIC = 5
"""Starts where an angle is sought, or a sign of another basin was met."""

BESIDE = 3
"""Starts beside those that come before all others."""

RIVAL = 4.0
"""A minimum that lies no more than this above the best one (in phi) is its rival."""

SAME = 0.5
"""Two points are one minimum if the linearised readings differ by no more, in standard
deviations."""

_ALIKE = 0.1
"""And if their phi differ by no more."""

_NEARLY_ALL = 0.9
"""Bounds that leave out no more of a period than a tenth are taken as the whole of it."""

_WIDE = 0.25
"""An angle known to a quarter of its period or better has one basin only."""

_PRIOR_REACH = 3.0
"""No start lies further from the mean of a prior, in its standard deviations."""

_UPHILL = 0.25
"""How far the slope towards a lower point must rise, as part of the actual fall, to be a sign."""

_MOST_SPREAD = 12
"""Parameters that are spread over their bounds at most: more leave Halton's sequence uneven."""


class Angles:
    """The parameters that are angles of material axes, and points that mean the same ground.

    Args:
        parameters: the n unknowns.
        scaling: of them.

    Attributes:
        period: (n,) in x; infinite for what is no angle.
    """

    def __init__(self, parameters: Sequence[Parameter], scaling: Scaling) -> None:
        self._scaling = scaling
        periods = [q.period for q in parameters]
        period = np.array([np.inf if turn is None else turn for turn in periods], dtype=np.float64)
        self.period: Floats = period / scaling.reference
        names = [q.name for q in parameters]
        self._mirrors = [
            (i, names.index(q.mirror[0]), q.mirror[1] / scaling.reference[names.index(q.mirror[0])])
            for i, q in enumerate(parameters)
            if q.mirror is not None and q.mirror[0] in names
        ]
        low, high = start_ranges(scaling)
        self.sought = tuple(
            int(i)
            for i in np.flatnonzero(high - low > _WIDE * self.period)
            if periods[i] is not None
        )

    def differences(self, x: Floats, y: Floats) -> Iterator[Floats]:
        """From x (n,) to y (n,) and to what means the same, each (n,) by the shortest way."""
        for image in self._images(y):
            d = image - x
            turns = np.where(np.isfinite(self.period), self.period, 1.0)
            whole = np.where(np.isfinite(self.period), np.round(d / turns), 0.0)
            yield d - whole * turns

    def _images(self, y: Floats) -> Iterator[Floats]:
        """Y (n,) itself, and with dips turned over."""
        for turned in product((False, True), repeat=len(self._mirrors)):
            image = y.copy()
            for flip, (dip, strike, half) in zip(turned, self._mirrors, strict=True):
                if flip:
                    image[dip], image[strike] = -image[dip], image[strike] + half
            yield image

    def whole(self, i: int) -> bool:
        """The bounds of a parameter hold all of its period, or nearly so."""
        width = self._scaling.upper[i] - self._scaling.lower[i]
        return bool(width >= _NEARLY_ALL * self.period[i])

    def other_side(self, x: Floats) -> Floats | None:
        """Where to go on from x (n,) on the bound of an angle; None where there is no such one."""
        scaling, y = self._scaling, x.copy()
        for i in np.flatnonzero(np.isfinite(self.period)):
            if self.whole(int(i)) and x[i] >= scaling.upper[i]:
                y[i] = max(x[i] - self.period[i], scaling.lower[i])
            elif self.whole(int(i)) and x[i] <= scaling.lower[i]:
                y[i] = min(x[i] + self.period[i], scaling.upper[i])
        return None if np.array_equal(x, y) else y


class SeveralStarts:
    """Descents of one problem.

    Args:
        descent: what goes down.
        starts: how many, the given one among them; None: as many as are needed.
        task: makes a descent from a start (n,) a part of the search (`ahead`).
        also: starts (n,) of a loss that may have several minima, before all others.
    """

    def __init__(
        self,
        descent: Descent[Iterate],
        starts: int | None,
        task: Callable[[Floats], SearchTask],
        also: Sequence[Floats] = (),
    ) -> None:
        self.descent, self.evaluator = descent, descent.evaluator
        self._starts, self._task, self._also = starts, task, also
        self._problem = self.evaluator.discrepancy.problem
        self._parameters = self._problem.parameters
        self._angles = Angles(self._parameters, self.evaluator.scaling)
        named = sum(not q.field for q in self._parameters)  # a mode's prior is an equation
        self._freedom = max(len(self._problem.measured) - named, 1)
        self._endings: list[Ending[Iterate]] = []

    def run(self) -> Outcome:
        """All descents: the best point, and the other minima that they came to, lowest first.

        Raises:
            ModelError: there is no solution at the given start, and at no other that was asked for.
        """
        start, begun, remarks = self._first()
        self._endings = [self.down(start, further=False)]
        why = self._reason()
        automatic = BESIDE if len(self._also) else AUTOMATIC
        wanted = self._starts or (automatic if why else 1)
        first_start = self.evaluator.scaling.start
        places = [*self._also, *islice(self._places(first_start), begun - 1, wanted - 1)]
        with prefetching(self._problem.response, [self._task(x) for x in places]) as turn:
            for number, x in enumerate(places):
                if self.evaluator.history.stop is not None:
                    break
                turn(number)
                begun += 1
                point = self.evaluator.start(x, f"start {begun}")
                if point is not None:
                    self._endings.append(self.down(point, further=True))
        if why and begun > 1:
            remarks.append(f"the search had {begun} starts, as {why}")
        best = min(self._endings, key=lambda ending: ending.point.phi)
        others = [e.point for e in self._endings if e.status == "converged" and e is not best]
        minima = distinct_minima([best.point, *others], self._angles)[1:]
        return replace(
            self.evaluator.history.outcome(best.point.p, best.point.phi, best.status, best.reason),
            minima=tuple(LocalMinimum(point.p, point.phi) for point in minima),
            remarks=tuple(remarks),
        )

    def _first(self) -> tuple[Iterate, int, list[str]]:
        """Where to begin: the given start, or the first of the others that has a solution.

        Returns:
            The point, how many were tried, and what is to be said of it, clauses.
        """
        evaluator = self.evaluator
        start = evaluator.scaling.start
        try:
            point = evaluator.evaluate(start)
        except ModelError as error:
            for n, x in enumerate(islice(self._places(start), (self._starts or 1) - 1), 2):
                other = evaluator.start(x, f"start {n}")
                if other is not None:
                    why = error.message.rstrip(".")
                    return other, n, [f"the search began elsewhere than at the given start: {why}"]
            raise
        evaluator.record(point.x, point, 0.0, "start")
        return point, 1, []

    def _places(self, start: Floats) -> Iterator[Floats]:
        scaling = self.evaluator.scaling
        if self._starts is None and self._angles.sought:
            return spread(scaling, self._angles, start, self._angles.sought)
        named = [i for i, q in enumerate(self._parameters) if not q.field]
        return spread(scaling, self._angles, start, named)

    def _reason(self) -> str:
        """Why one start is not enough, a clause; empty where it is, or the user says how many."""
        if self._starts is not None:
            return ""
        names = [self._parameters[i].name for i in self._angles.sought]
        if names:
            return f"{' and '.join(names)} {'is an angle' if len(names) == 1 else 'are angles'}"
        if len(self._also):
            return "the loss student-t may have several minima"
        if self._endings[0].stalled:
            return "the misfit has kinks where it ended"
        if self.evaluator.begins_uphill(_UPHILL, RIVAL):
            return "the way to a better point began uphill"
        return ""

    def down(self, start: Iterate, *, further: bool) -> Ending[Iterate]:
        """One descent; past the bounds of angles.

        Args:
            start: where it begins.
            further: it ends where nothing new is to be found beside those before.
        """
        ending = self.descent.run(start, leave=self._not_worth_it if further else None)
        for _ in range(2):
            x = None if ending.abandoned else self._angles.other_side(ending.point.x)
            if x is None or self.evaluator.history.stop is not None:
                break
            point = self.evaluator.start(x, "past the bound of an angle")
            again = None if point is None else self.descent.run(point)
            if again is None or again.point.phi >= ending.point.phi:
                break
            ending = again
        return ending

    def _not_worth_it(self, point: Iterate, full: Step) -> bool:
        """The next step of a further descent ends at a known minimum, or far above the best."""
        best = min(self._endings, key=lambda ending: ending.point.phi).point
        if point.phi < best.phi:  # else the best of all would be one that was left
            return False
        promised = point.phi - full.gain
        window = 2.0 * RIVAL * max(1.0, best.phi / self._freedom)
        if full.length <= 1.0 and promised - 2.0 * full.gain > best.phi + window:
            return True
        aim = self.evaluator.box.reach(point.x, full.d)
        known = (e.point for e in self._endings if e.status == "converged")
        return full.length <= 0.3 and any(
            abs(promised - one.phi) <= _ALIKE and at_minimum(one, aim, self._angles)
            for one in known
        )


def at_minimum(one: Iterate, x: Floats, angles: Angles) -> bool:
    """The point x (n,), or what means the same, is at a minimum, as its linearised readings show.

    Args:
        one: the minimum.
        x: (n,) scaled parameters.
        angles: which of them are angles.
    """
    J = one.linearization.jacobian
    return any(bool(np.linalg.norm(J @ d) <= SAME) for d in angles.differences(one.x, x))


def distinct_minima(points: Sequence[Iterate], angles: Angles) -> list[Iterate]:
    """The minima among points, each once: the first as it is, the others lowest first.

    Args:
        points: where descents converged, the best first.
        angles: which parameters are angles.
    """
    kept = list(points[:1])
    for point in sorted(points[1:], key=lambda point: point.phi):
        if not any(
            abs(one.phi - point.phi) <= _ALIKE
            and at_minimum(one, point.x, angles)
            and at_minimum(point, one.x, angles)
            for one in kept
        ):
            kept.append(point)
    return kept


def start_ranges(scaling: Scaling) -> tuple[Floats, Floats]:
    """Lowest and highest start (n,), (n,) in x: the bounds, or near a prior.

    A parameter without finite bounds varies by two units of x to both sides of its start.
    """
    low, high = _open_ranges(scaling)
    for i, prior in scaling.priors:
        ends = (prior.at_score(-_PRIOR_REACH), prior.at_score(_PRIOR_REACH))
        x = [scaling.to_scaled(np.full(len(scaling), end))[i] for end in ends]
        low[i], high[i] = max(low[i], x[0]), min(high[i], x[1])
    return low, np.maximum(low, high)


def _open_ranges(scaling: Scaling) -> tuple[Floats, Floats]:
    """The bounds (n,), (n,) in x, or two units of x to both sides of the start."""
    low = np.where(np.isfinite(scaling.lower), scaling.lower, scaling.start - 2.0)
    return low, np.where(np.isfinite(scaling.upper), scaling.upper, scaling.start + 2.0)


def spread(
    scaling: Scaling, angles: Angles, start: Floats, which: Sequence[int]
) -> Iterator[Floats]:
    """Points x (n,) around a given start, without end, the same in every run.

    Angles that may take all values are Halton's sequence on the circle, shifted to the given start,
    which is so its first point; other parameters are Halton's sequence between their bounds.

    Args:
        scaling: of the n unknowns.
        angles: which of them are angles.
        start: (n,) the first start.
        which: the parameters that vary; the rest stays at the given start.
    """
    low, high = start_ranges(scaling)
    # the first primes are the most even ones: they belong to the angles
    order = sorted(which, key=lambda i: not np.isfinite(angles.period[i]))[:_MOST_SPREAD]
    for point in _halton(len(order)):
        x = start.copy()
        for i, u in zip(order, point.tolist(), strict=True):
            width = min(high[i] - low[i], angles.period[i])
            around = width >= _NEARLY_ALL * angles.period[i]
            share = (u + (start[i] - low[i]) / width) % 1.0 if around else u
            x[i] = low[i] + share * width
        yield x


def halton_starts(scaling: Scaling, count: int) -> Iterator[Floats]:
    """``count`` points x (n,) inside the bounds, the same in every run.

    A parameter without finite bounds varies by two units of x to both sides of its start.
    """
    lower, upper = _open_ranges(scaling)
    for share in islice(_halton(len(scaling)), count):
        yield lower + share * (upper - lower)


def _halton(d: int) -> Iterator[Floats]:
    """Halton's points (d,) in the unit cube, without the first, which is a corner of it."""
    from scipy.stats import qmc  # noqa: PLC0415 - a quarter of a second, and few fits need it

    points = qmc.Halton(d, scramble=False).fast_forward(1)
    while True:
        yield points.random()[0]
