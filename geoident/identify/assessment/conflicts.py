"""Priors that contradict the readings, and pairs of strongly correlated parameters.

Each prior is left out in turn (theory 6.6). The distance of its mean from the estimate without it,
divided by the standard deviation of that distance, is a standard normal number where prior, errors
and model are right.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.findings import Finding
from geoident.units import in_unit, shown_unit

FALSE_ALARMS = 0.05
"""Part of the fits with right priors in which one of them is reported as contradicting."""

TIED = 0.95
"""Size of a correlation from which on two parameters are reported as strongly correlated."""

_LEAST_VARIANCE_LEFT = 1e-6
"""Of 1 - h: below it only this prior determines the parameter, and the distance is 0 / 0."""


@dataclass(frozen=True)
class PriorConflict:
    """A prior that is far from the estimate without it.

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
    """The priors that contradict readings and other priors, the farthest first.

    Args:
        x: (n,) the estimate, scaled.
        rows: (k, n) of the priors, by x.
        residuals: (k,) of the priors at the estimate.
        covariance: (n, n) of x; zero rows for what a bound holds.
        named: (n,) parameters of the case; modes of fields are not judged.
    """
    of = [int(np.argmax(np.abs(row))) for row in rows]
    judged = [k for k, i in enumerate(of) if named[i] and covariance[i, i] > 0.0]
    if not judged:
        return ()
    limit = -float(ndtri(0.5 * FALSE_ALARMS / len(judged)))
    conflicts = []
    for k in judged:
        moved = covariance @ rows[k]
        left = 1.0 - float(rows[k] @ moved)  # 1 - h: what the rest leaves of the variance
        if left < _LEAST_VARIANCE_LEFT:
            continue
        distance = float(residuals[k]) / np.sqrt(left)
        if abs(distance) > limit:
            i = of[k]
            without = float(x[i] + moved[i] * residuals[k] / left)
            sd = np.sqrt(covariance[i, i] + moved[i] ** 2 / left)
            conflicts.append(PriorConflict(i, float(distance), without, float(sd)))
    return tuple(sorted(conflicts, key=lambda one: -abs(one.distance)))


def conflict_findings(
    conflicts: Sequence[PriorConflict], parameters: Sequence[Parameter], reference: Floats
) -> tuple[Finding, ...]:
    """One finding for each prior that contradicts the readings.

    Args:
        conflicts: the priors and their distances.
        parameters: the n unknowns.
        reference: (n,) by which linear parameters are divided in x.
    """
    findings = []
    for conflict in conflicts:
        q, size = parameters[conflict.parameter], float(reference[conflict.parameter])
        assert q.prior is not None
        steps = np.array([0.0, -NORMAL_95, NORMAL_95])
        x = conflict.x + steps * conflict.sd_x
        natural = [*(np.exp(x) if q.scale == "log" else size * x), q.prior.mean, q.prior.sd]
        value, low, high, mean, sd = (
            f"{in_unit(float(number), q.unit, q.dimension):.3g}" for number in natural
        )
        unit = f" {shown_unit(q.unit, q.dimension)}".rstrip()
        given = f"{value}{unit} (95 %: {low} to {high})"
        if not q.lower <= natural[0] <= q.upper:  # as linearised; no number that could be meant
            side = "less than its lower" if natural[0] < q.lower else "more than its upper"
            given = f"{side} bound"
        chance = 2.0 * float(ndtr(-abs(conflict.distance)))
        seldom = f"1 of {1.0 / chance:.0f}" if chance > 1e-4 else "less than 1 of 10 000"
        sentence = (
            f"The prior of {q.name} ({mean} +- {sd}{unit}) contradicts the readings: without it "
            f"they give {given}, {abs(conflict.distance):.1f} "
            f"standard deviations from it. By chance this happens in {seldom} fits. The result "
            "lies between the two: the prior, the accuracies or the model is wrong."
        )
        without = dict(zip(("value", "lower95", "upper95"), map(float, natural), strict=False))
        numbers = {**without, "distance": conflict.distance}
        findings.append(Finding("prior-conflict", q.name, sentence, numbers))
    return tuple(findings)


def tied_findings(
    parameters: Sequence[Parameter], correlation: Floats, gaps: Sequence[Finding]
) -> Iterator[Finding]:
    """A finding for each strongly correlated pair of parameters.

    Args:
        parameters: the k that the case names.
        correlation: (k, k) NaN where they are not determined.
        gaps: what is not determined: of parameters that cannot be separated nothing more is said.
    """
    inseparable = [{*gap.subject.split(", ")} for gap in gaps]
    for i, one in enumerate(parameters):
        for j, other in enumerate(parameters[i + 1 :], start=i + 1):
            size = float(correlation[i, j])
            named = any({one.name, other.name} <= names for names in inseparable)
            if named or not abs(size) >= TIED:
                continue
            how = (
                "Larger or smaller values of both"
                if size > 0.0
                else "A larger value of one with a smaller value of the other"
            )
            yield Finding(
                "correlated",
                f"{one.name}, {other.name}",
                f"{one.name} and {other.name} are strongly correlated ({size:.2f}). "
                f"{how} would fit the readings nearly as well. A prior on one of them would "
                "narrow both.",
                {"correlation": size},
            )
