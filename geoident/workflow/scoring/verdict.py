"""What a backtest says in words: whether its bands hold, and whether the parameters settle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from geoident.forward.ground.field import named_parameters
from geoident.identify.assessment.findings import join
from geoident.identify.assessment.scores import changes
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.parameter import Parameter
from geoident.model.results.backtest import Backtest, BacktestStep, bands_of
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.findings import Finding
from geoident.model.results.result import GaugeTable
from geoident.units import in_unit, shown_unit

ALARM = 0.01
"""Chance below which bands do not hold, or a parameter does not settle."""

WORTH_SAYING = 0.85
"""Coverage below which it is said how often chance would do that."""

ODD = 0.1
"""Chance below which the user should look at it."""


_FAR_MORE = 2.0
"""Length of an interval, by that of a linearisation, from which on the latter does not hold."""

_GIVEN = 1e9
"""Degrees of freedom of accuracies that are given."""

NOTHING = (
    "No prediction could be compared with a reading: none of the fits determines what the readings "
    "of a later stage depend on."
)


@dataclass(frozen=True)
class Verdict:
    """Whether the bands of a backtest hold.

    Args:
        holds: they do, as far as the readings can tell.
        sentence: the same in words.
        remarkable: whether the user should know even of bands that may hold.
    """

    holds: bool
    sentence: str
    remarkable: bool


def verdict(backtest: Backtest, gauges: GaugeTable) -> Verdict:
    """Whether the bands hold.

    Args:
        backtest: the backtest; some of its predictions are scored.
        gauges: names of channels and stages.
    """
    ahead = backtest.next
    if not ahead.readings:
        return Verdict(False, NOTHING, remarkable=True)
    counted = (
        f"{ahead.inside} of {ahead.readings} readings of the next stage are inside their "
        f"bands ({100 * ahead.coverage:.0f} %)"
    )
    if backtest.few < ALARM:
        sentence = (
            f"The 95 % bands do not hold: {counted}, as few as chance leaves {odds(backtest.few)}."
        )
        return Verdict(False, f"{sentence} {_worst(backtest, gauges)}", remarkable=True)
    if backtest.far < ALARM:
        sentence = (
            f"The 95 % bands do not hold: {counted}, but the errors of the predictions are "
            f"{ahead.rms:.1f} times as large as the bands say, which happens {odds(backtest.far)}."
        )
        return Verdict(False, f"{sentence} {_worst(backtest, gauges)}", remarkable=True)
    if ahead.coverage < WORTH_SAYING:
        odd = min(backtest.few, backtest.far) < ODD
        sentence = (
            f"{counted}, fewer than 95 %, but with so few readings that happens "
            f"{odds(backtest.few)} by chance."
        )
        return Verdict(True, f"{sentence} {_worst(backtest, gauges)}", remarkable=odd)
    return Verdict(True, f"The 95 % bands hold: {counted}.", remarkable=False)


def odds(probability: float) -> str:
    """A small probability in words.

    >>> odds(0.004), odds(0.08), odds(0.4)
    ('less than once in 100 times', 'once in 12 times', '40 times in 100')
    """
    if probability < 1e-3:
        return "less than once in 1000 times"
    if probability < 1e-2:
        return "less than once in 100 times"
    if probability < 0.2:
        return f"once in {1.0 / probability:.0f} times"
    return f"{100 * probability:.0f} times in 100"


def _worst(backtest: Backtest, gauges: GaugeTable) -> str:
    """The reading that is farthest from its prediction."""
    worst, sentence = 0.0, ""
    for step in backtest.steps:
        z = bands_of(backtest, step).z
        if np.isfinite(z).any() and np.nanmax(np.abs(z)) > worst:
            i, j = np.unravel_index(int(np.nanargmax(np.abs(z))), z.shape)
            worst = float(abs(z[i, j]))
            sentence = (
                f"Farthest off: {gauges.channels[i]} at {gauges.stages[j]}, {z[i, j]:+.1f} "
                f"standard deviations from the prediction by the readings up to "
                f"{gauges.stages[step.last]}."
            )
    return sentence


def settling(
    case: Case, steps: Sequence[BacktestStep], variances: Floats, *, estimated: bool
) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """Whether each parameter settles as readings are added.

    Args:
        case: its parameters and stages.
        steps: the fits, in the order of their last stages.
        variances: (k, n) of the scaled parameters after each fit, see `trials.variances`.
        estimated: accuracies were estimated, by each of them anew.

    Returns:
        Findings on parameters that do not, and sentences on the others.
    """
    restless, others = [], []
    scaling = Scaling(case.parameters)
    for i, parameter in enumerate(named_parameters(case)):  # the first of all
        at = [k for k, step in enumerate(steps) if step.determined[i] and np.isfinite(step.sd[i])]
        known = [steps[k] for k in at]
        values = [
            f"{_shown(float(step.values[i]), parameter)} up to {_stage(case, step)}"
            for step in known
        ]
        if len(known) < 2:
            where = f"only by the readings up to {_stage(case, known[0])}" if known else "by no fit"
            others.append(f"{parameter.name} is determined {where}.")
            continue
        x = np.array([scaling.to_scaled(step.values)[i] for step in known])
        z = changes(x, _honest(variances[at, i], scaling, known, i))
        spare = known[0].readings - len(named_parameters(case)) if estimated else _GIVEN
        if fdtrc(len(z), max(spare, 1), float(z @ z) / len(z)) < ALARM:
            change = float(np.abs(z).max())
            sentence = (
                f"{parameter.name} is not constant: {join(values)}. It changes by up to "
                f"{change:.1f} times what its intervals allow{_direction(z)}. The model "
                "needs another value for every stage."
            )
            restless.append(Finding("not-settled", parameter.name, sentence, {"change": change}))
        else:
            others.append(f"{parameter.name} is constant within its intervals: {join(values)}.")
    return tuple(restless), tuple(others)


def _honest(variances: Floats, scaling: Scaling, steps: Sequence[BacktestStep], i: int) -> Floats:
    """Variances (k,) of a scaled parameter, by its own intervals where these tell far more.

    A change of variance is a small difference, which needs one linearisation, that at the last
    answer. It does not hold for a fit whose ground did not yield yet, or whose answer lay on a
    bound: the intervals there are longer than it would have them.

    Args:
        variances: (k,) at the last answer.
        scaling: of the parameters.
        steps: the k fits.
        i: the parameter.
    """
    x = np.array([scaling.to_scaled(step.values)[i] for step in steps])
    ends = np.array(
        [[scaling.to_scaled(end)[i] for end in (step.lower95, step.upper95)] for step in steps]
    )
    own = (np.nan_to_num(np.abs(ends - x[:, None])).max(axis=1) / NORMAL_95) ** 2
    return np.where(own > _FAR_MORE**2 * variances, own, variances)


def _stage(case: Case, step: BacktestStep) -> str:
    return case.stages[step.last].name


def _direction(z: Floats) -> str:
    if len(z) < 2 or not (np.all(z > 0.0) or np.all(z < 0.0)):
        return ""
    return ", always upwards" if z[0] > 0.0 else ", always downwards"


def _shown(value: float, parameter: Parameter) -> str:
    unit = parameter.unit, parameter.dimension
    return f"{in_unit(value, *unit):.4g} {shown_unit(*unit)}".rstrip()
