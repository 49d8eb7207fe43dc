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
from geoident.model.gauges import DAY
from geoident.model.parameter import Parameter
from geoident.model.results.backtest import Backtest, BacktestStep, Reach, bands_of
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

FEWEST = 5
"""Readings below which it says nothing that they are inside: so are all of four, 41 times in 100,
of bands that hold 80 %."""

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
    ahead, reach = backtest.next, backtest.reach
    if not ahead.readings and reach is None:
        return Verdict(False, NOTHING, remarkable=True)
    worst = _worst(backtest, gauges)
    tests = []
    if reach is not None:
        far = f"up to {duration(reach.far, dated=reach.dated)} ahead"
        numbers = reach.readings, reach.inside, reach.rms, reach.few, reach.large
        tests.append(_tested(far, *numbers, worst, _limits(reach)))
    if ahead.readings and (reach is None or len(backtest.steps) > 1):
        numbers = ahead.readings, ahead.inside, ahead.rms, backtest.few, backtest.far
        tests.append(_tested("of the next stage", *numbers, worst))
    failed = [test for test in tests if not test.holds]
    return (failed or tests)[0]


def _tested(
    which: str,
    readings: int,
    inside: int,
    rms: float,
    few: float,
    large: float,
    worst: str,
    limits: str = "",
) -> Verdict:
    """Whether the bands of some readings hold.

    Args:
        which: of the readings, in words.
        readings: how many have a band.
        inside: how many are inside.
        rms: root mean square of the standardized errors.
        few: probability that bands that hold leave so few inside.
        large: probability that standardized errors are then as large.
        worst: the reading that is farthest off, a sentence.
        limits: what the test cannot say, sentences.
    """
    coverage = inside / readings
    what = "reading" if readings == 1 else "readings"
    verb = "is" if inside == 1 else "are"
    counted = (
        f"{inside} of {readings} {what} {which} {verb} inside "
        f"{'its band' if readings == 1 else 'their bands'} ({100 * coverage:.0f} %)"
    )
    more = f"{worst} {limits}".strip()
    if few < ALARM:
        sentence = f"The 95 % bands do not hold: {counted}, as few as chance leaves {odds(few)}."
        return Verdict(False, f"{sentence} {more}", remarkable=True)
    if large < ALARM:
        sentence = (
            f"The 95 % bands do not hold: {counted}, but the errors of the predictions are "
            f"{rms:.1f} times as large as the bands say, which happens {odds(large)}."
        )
        return Verdict(False, f"{sentence} {more}", remarkable=True)
    if coverage < WORTH_SAYING:
        sentence = (
            f"{counted}, fewer than 95 %, but with so few readings that happens "
            f"{odds(few)} by chance."
        )
        return Verdict(True, f"{sentence} {more}", remarkable=min(few, large) < ODD)
    if readings < FEWEST:
        sentence = f"{counted}. So few say nothing of whether the 95 % bands hold."
        return Verdict(True, f"{sentence} {limits}".strip(), remarkable=False)
    return Verdict(True, f"The 95 % bands hold: {counted}. {limits}".strip(), remarkable=False)


def _limits(reach: Reach) -> str:
    """What a test of a series cannot say, sentences."""
    sentences = []
    if reach.independent < FEWEST and reach.readings >= FEWEST:
        sentences.append(
            f"Their errors go together: they say as much as {reach.independent:.1f} independent "
            "readings."
        )
    if reach.far < reach.asked:
        asked, far = (duration(x, dated=reach.dated) for x in (reach.asked, reach.far))
        sentences.append(f"The prediction looks {asked} ahead: nothing tests it beyond {far}.")
    return " ".join(sentences)


def duration(time: float, *, dated: bool) -> str:
    """A time in words: s, or stages where these have no dates.

    >>> duration(86400.0 * 200, dated=True), duration(1.0, dated=False)
    ('200 days', '1 stage')
    """
    number, unit = (time / DAY, "day") if dated else (time, "stage")
    return f"{number:.3g} {unit}{'' if number == 1.0 else 's'}"


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


_COUNTLESS = 1e4
"""Standard deviations from which on only their power of ten is told."""


def _worst(backtest: Backtest, gauges: GaugeTable) -> str:
    """The reading that is farthest from its prediction."""
    worst, sentence = 0.0, ""
    for step in backtest.steps:
        z = bands_of(backtest, step).z
        if np.isfinite(z).any() and np.nanmax(np.abs(z)) > worst:
            i, j = np.unravel_index(int(np.nanargmax(np.abs(z))), z.shape)
            worst = float(abs(z[i, j]))
            size = f"{z[i, j]:+.1f}" if worst < _COUNTLESS else f"{z[i, j]:+.0e}"
            sentence = (
                f"Farthest off: {gauges.channels[i]} at {gauges.stages[j]}, {size} "
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
                f"{parameter.name} is not constant: {_some(values)}. It changes by up to "
                f"{change:.1f} times what its intervals allow{_direction(z)}. The model "
                "needs another value for every stage."
            )
            restless.append(Finding("not-settled", parameter.name, sentence, {"change": change}))
        else:
            others.append(f"{parameter.name} is constant within its intervals: {_some(values)}.")
    return tuple(restless), tuple(others)


def _some(values: Sequence[str]) -> str:
    """Values in words; of many the first and the last ones."""
    if len(values) <= _MOST_VALUES:
        return join(values)
    return f"{', '.join(values[:2])}, ..., {join(values[-2:])}"


_MOST_VALUES = 8


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
