"""Where a prior contradicts the readings, and which parameters these tie to each other.

Each prior is left out in turn (theory 6.6): how far its mean then lies from what all the rest says,
in the standard deviation of that distance, is a standard normal number where prior, errors and
model are right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.results.bands import NORMAL_95
from geoident.units import in_unit, shown_unit

FALSE_ALARMS = 0.05
"""Part of the fits with right priors in which one of them is said to contradict the readings."""

TIED = 0.95
"""Size of a correlation from which on two parameters are said to be tied to each other."""

_SEEN = 1e-6
"""Part of the variance of a prior that the rest must leave, for the distance to mean something."""


@dataclass(frozen=True)
class PriorConflict:
    """A prior that is far from what all the rest says.

    Args:
        parameter: number of the parameter.
        distance: of its mean from the estimate without it, in standard deviations of that.
        x: the estimate without it, scaled.
        sd_x: its standard deviation.
    """

    parameter: int
    distance: float
    x: float
    sd_x: float


def prior_conflicts(
    x: Floats, rows: Floats, residuals: Floats, covariance: Floats, named: Bools
) -> tuple[PriorConflict, ...]:
    """The priors that contradict all the rest, the farthest first.

    Args:
        x: (n,) the estimate, scaled.
        rows: (k, n) of the priors, by x.
        residuals: (k,) of the priors at the estimate.
        covariance: (n, n) of x; zero rows for what a bound holds.
        named: (n,) parameters whose priors people have written.
    """
    of = [int(np.argmax(np.abs(row))) for row in rows]
    judged = [k for k, i in enumerate(of) if named[i] and covariance[i, i] > 0.0]
    if not judged:
        return ()
    limit = -float(ndtri(0.5 * FALSE_ALARMS / len(judged)))
    found = []
    for k in judged:
        moved = covariance @ rows[k]
        left = 1.0 - float(rows[k] @ moved)  # 1 - h: what the rest leaves of the variance
        if left < _SEEN:
            continue
        distance = float(residuals[k]) / np.sqrt(left)
        if abs(distance) > limit:
            i = of[k]
            without = float(x[i] + moved[i] * residuals[k] / left)
            sd = np.sqrt(covariance[i, i] + moved[i] ** 2 / left)
            found.append(PriorConflict(i, float(distance), without, float(sd)))
    return tuple(sorted(found, key=lambda one: -abs(one.distance)))


def conflict_sentences(
    found: Sequence[PriorConflict], parameters: Sequence[Parameter], reference: Floats
) -> tuple[str, ...]:
    """What is said of priors that contradict the readings.

    Args:
        found: the conflicts.
        parameters: the n unknowns.
        reference: (n,) by which linear parameters are divided in x.
    """
    return tuple(_conflict(one, parameters[one.parameter], reference) for one in found)


def _conflict(found: PriorConflict, parameter: Parameter, reference: Floats) -> str:
    prior = parameter.prior
    assert prior is not None
    size = 1.0 if parameter.scale == "log" else float(reference[found.parameter])
    ends = [found.x + step * NORMAL_95 * found.sd_x for step in (0.0, -1.0, 1.0)]
    natural = [float(np.exp(x)) if parameter.scale == "log" else size * x for x in ends]
    unit = parameter.unit, parameter.dimension
    value, low, high = (f"{in_unit(number, *unit):.3g}" for number in natural)
    mean, sd = (f"{in_unit(number, *unit):.3g}" for number in (prior.mean, prior.sd))
    word = shown_unit(*unit)
    chance = 2.0 * float(ndtr(-abs(found.distance)))
    return (
        f"The prior of {parameter.name} ({mean} +- {sd} {word}".rstrip()
        + f") contradicts the readings: without it they give {value} {word}".rstrip()
        + f" (95 %: {low} to {high}), {abs(found.distance):.1f} standard deviations from it, which "
        f"chance makes in {_one_of(chance)} fits. The result lies between the two: one of prior, "
        "accuracies and model is wrong."
    )


def _one_of(chance: float) -> str:
    """A chance in words.

    >>> _one_of(0.0124), _one_of(1e-9)
    ('1 of 81', 'less than 1 of 10 000')
    """
    return f"1 of {1.0 / chance:.0f}" if chance > 1e-4 else "less than 1 of 10 000"


def tied_sentences(
    parameters: Sequence[Parameter], correlation: Floats, said: Sequence[str]
) -> Iterator[str]:
    """Pairs of parameters that the readings hardly tell apart, though each has its interval.

    Args:
        parameters: the k that the case names.
        correlation: (k, k) NaN where they are not determined.
        said: sentences before, which name what cannot be separated at all.
    """
    for i, one in enumerate(parameters):
        for j in range(i + 1, len(parameters)):
            other, size = parameters[j], float(correlation[i, j])
            if not abs(size) >= TIED or _together(one.name, other.name, said):
                continue
            how = (
                "both larger or both smaller" if size > 0.0 else "one larger and the other smaller"
            )
            yield (
                f"The readings tie {one.name} and {other.name} to each other (correlation "
                f"{size:.2f}): {how}, they would be met nearly as well. What is known of one from "
                "elsewhere, as a prior, would narrow both."
            )


def _together(one: str, other: str, said: Sequence[str]) -> bool:
    head = [text.partition(":")[0] for text in said if text.startswith("The readings cannot sepa")]
    words = [text.replace(",", " ").split() for text in head]
    return any(one in named and other in named for named in words)
