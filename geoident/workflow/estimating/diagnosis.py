"""What is known of a fit: the table of its parameters, the influence of readings, its proof."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from geoident.forward.observed import Survey
from geoident.identify.assessment.diagnostics import diagnose, effective_sd
from geoident.identify.assessment.misfit import misfit
from geoident.identify.assessment.uncertainty import Assessment, assess
from geoident.identify.assessment.unknown_variances import OverAccuracies
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.methods import loss_text
from geoident.model.parameter import Parameter
from geoident.model.results.findings import Finding
from geoident.model.results.model_error import ModelErrorTable
from geoident.model.results.result import (
    DIAGNOSTIC_COLUMNS,
    Diagnostics,
    GaugeTable,
    ParameterTable,
)
from geoident.model.yielding import Certificate
from geoident.units import in_unit, shown_unit

FAR_OFF = 3.5
"""Studentized residual from which on a reading is named: one in 2000 by chance."""

WORTH_SAYING = 0.1
"""Influence, in standard deviations of a parameter, below which no reading is named for it."""

SIGNIFICANCE = 0.01
"""Probability of residuals as large, or as small, by chance below which it is said."""

TOO_LARGE = 1.25
"""Size of the residuals by that of the errors below which nothing is said, however sure it is."""

TOO_SMALL = 0.67
"""The same for residuals that are too small."""

EXACT = 0.01
"""Size below which the readings are computed ones, of which nothing is to be said."""

POOR = 1e-4
"""Probability by chance below which a model does not fit, ..."""

UNUSABLE = 2.0
"""... if the residuals are also as large as this: then 95 % intervals hold two thirds."""

UNUSABLE_SIZE = 0.5
"""Model error, of the computed motion, beyond which a model is of no use."""


def assess_robustly(
    problem: Problem,
    p: Floats,
    readings: Floats,
    jacobian: Floats,
    over: OverAccuracies | None = None,
) -> Assessment:
    """How well the parameters are known, each reading with the weight that the loss leaves it.

    Args:
        problem: readings, model and loss.
        p: (n,) the estimate, SI.
        readings: (g,) v there, SI.
        jacobian: (g, n) its derivative.
        over: what is known at other accuracies; None where they are given.
    """
    weighted = replace(problem, sd=effective_sd(problem, readings))
    return assess(weighted, p, jacobian, readings, over)


def diagnostics_table(
    problem: Problem, readings: ReadingTable, p: Floats, assessment: Assessment
) -> Diagnostics:
    """The diagnostics of the used readings; see `diagnose`.

    Args:
        problem: the used readings, model and loss.
        readings: all k of them with what the model says at p.
        p: (n,) the estimate, SI.
        assessment: how well the parameters are known there.
    """
    used = readings.used
    computed, jacobian = at_used(readings)
    pairs = readings.used_pairs
    number = {pair: n for n, pair in enumerate(dict.fromkeys(pairs))}
    sets = np.array([number[pair] for pair in pairs], dtype=np.int64)
    diagnostics = diagnose(problem, assessment, computed, jacobian, sets)
    left = misfit(problem, p, computed, jacobian)

    def of_all(values: Floats) -> Floats:
        """Values (g, ...) of the used readings as those of all (k, ...)."""
        column = np.full((len(readings), *values.shape[1:]), np.nan)
        column[used] = values
        return column

    return Diagnostics(
        loss=loss_text(problem.loss),
        squares=Discrepancy(problem).squares(p, computed),
        scale=diagnostics.scale,
        influence=of_all(diagnostics.influence),
        misfit=left.scale,
        above=left.above,
        below=left.below,
        **{name: of_all(getattr(diagnostics, name)) for name in DIAGNOSTIC_COLUMNS},
    )


def with_effect_of(
    findings: Sequence[Finding], sensitivity: Floats | None, case: Case, names: Sequence[str]
) -> tuple[Finding, ...]:
    """Findings that also say of a parameter without effect that nothing depends on it, and why.

    Args:
        findings: of the parameters.
        sensitivity: (n_channels, n_stages, n) derivatives of all that is computed, or None.
        case: its materials and groups.
        names: of the n parameters.
    """
    if sensitivity is None:
        return tuple(findings)
    moved = np.asarray(np.nan_to_num(sensitivity).reshape(-1, len(names)).any(axis=0))
    idle = {name for name, moves in zip(names, moved, strict=True) if not moves}

    def told(finding: Finding) -> Finding:
        if finding.kind not in ("not-determined", "only-prior") or finding.subject not in idle:
            return finding
        unused = case.unused_materials(finding.subject)
        why = f": no group is of the material {' or '.join(map(repr, unused))}" if unused else ""
        more = f" At these values no reading depends on it{why}."
        return replace(finding, sentence=finding.sentence + more)

    return tuple(map(told, findings))


def at_used(readings: ReadingTable) -> tuple[Floats, Floats]:
    """What the model says of the used readings (g,), and its derivatives (g, n)."""
    assert readings.sensitivity is not None
    return readings.computed[readings.used], readings.sensitivity[readings.used]


def remarks(
    diagnostics: Diagnostics, gauges: GaugeTable, parameters: Sequence[str]
) -> tuple[Finding, ...]:
    """Readings that are far off or most influential.

    Args:
        diagnostics: the diagnostics of each reading.
        gauges: the readings.
        parameters: names of the n parameters.
    """
    diagnostics = diagnostics.wide(gauges)
    return (*_far_off(diagnostics, gauges), *_most_influential(diagnostics, gauges, parameters))


def _most_influential(
    diagnostics: Diagnostics, gauges: GaugeTable, parameters: Sequence[str]
) -> Iterator[Finding]:
    """The reading whose removal changes the answer most."""
    if np.count_nonzero(np.isfinite(diagnostics.standardized)) < 2 or not len(parameters):
        return
    i, j = np.unravel_index(int(np.nanargmax(diagnostics.distance)), diagnostics.distance.shape)
    channel, stage, change = gauges.channels[i], gauges.stages[j], diagnostics.influence[i, j]
    alone = [
        parameter for parameter, part in zip(parameters, change, strict=True) if np.isinf(part)
    ]
    k = int(np.argmax(np.abs(change)))
    if alone:
        sentence = (
            f"Without the reading {channel} at {stage} nothing would determine "
            f"{' and '.join(alone)}."
        )
    elif abs(change[k]) >= WORTH_SAYING:
        sentence = (
            f"The most influential reading is {channel} at {stage}: without it {parameters[k]} "
            f"would be {_in_sd(abs(change[k]))} of its standard deviations "
            f"{'lower' if change[k] > 0.0 else 'higher'}."
        )
    else:
        return
    yield Finding("influential-reading", f"{channel}, {stage}", sentence)


def _in_sd(change: float) -> str:
    """Two digits; no number where the change is too large for the linear model that tells it.

    >>> _in_sd(0.273), _in_sd(138.2)
    ('0.27', 'more than 5')
    """
    return "more than 5" if change > 5.0 else f"{change:.2g}"


def _far_off(diagnostics: Diagnostics, gauges: GaugeTable) -> Iterator[Finding]:
    size = np.abs(diagnostics.studentized)
    size[~(size > FAR_OFF)] = np.nan
    order = np.argsort(-np.nan_to_num(size), axis=None)[: np.count_nonzero(np.isfinite(size))]
    if not order.size:
        return
    places = list(zip(*np.unravel_index(order[:5], size.shape), strict=True))
    named = [
        f"{gauges.channels[i]} at {gauges.stages[j]} ({_size(diagnostics.studentized[i, j])})"
        for i, j in places
    ]
    rest = f" and {len(order) - 5} more" if len(order) > 5 else ""
    yield Finding(
        "far-reading",
        ", ".join(dict.fromkeys(gauges.channels[i] for i, _ in places)),
        "Readings far from the model, in standard deviations of their residual: "
        f"{', '.join(named)}{rest}.",
    )


def _size(t: float) -> str:
    return f"{t:+.1f}" if abs(t) < 1000.0 else f"{t:+.2g}"


def misfit_findings(diagnostics: Diagnostics, *, correlated: bool) -> Iterator[Finding]:
    """Residuals that are larger or smaller than the stated accuracies explain.

    Args:
        diagnostics: of each reading.
        correlated: residuals of neighbours go together, which no scatter of gauges explains.
    """
    if diagnostics.above < SIGNIFICANCE and diagnostics.misfit > TOO_LARGE and correlated:
        yield Finding(
            "misfit",
            "",
            f"The residuals are {_times(diagnostics.misfit)} times as large as the stated "
            f"accuracies explain ({_by_chance(diagnostics.above)}), and go together: the model "
            "does not describe the ground, and the intervals are too narrow. Accuracies that are "
            "estimated would not help, a model error does.",
            {"misfit": diagnostics.misfit, "probability": diagnostics.above},
        )
    elif diagnostics.above < SIGNIFICANCE and diagnostics.misfit > TOO_LARGE:
        yield Finding(
            "misfit",
            "",
            f"The residuals are {_times(diagnostics.misfit)} times as large as the stated "
            f"accuracies explain ({_by_chance(diagnostics.above)}): the gauges are less accurate "
            "than stated, or the model does not describe the ground; the intervals are then too "
            "narrow. If it is the gauges, write 'accuracies: estimate' under 'fit' (or 'accuracy: "
            "estimate' at a gauge): the residuals then say how accurate they are.",
            {"misfit": diagnostics.misfit, "probability": diagnostics.above},
        )
    elif diagnostics.below < SIGNIFICANCE and EXACT < diagnostics.misfit < TOO_SMALL:
        yield Finding(
            "misfit",
            "",
            f"The residuals are only {diagnostics.misfit:.2g} of what the stated accuracies imply "
            f"({_by_chance(diagnostics.below)}): the gauges are more accurate than stated, and the "
            "intervals wider than they need be. Write 'accuracies: estimate' under 'fit' to let "
            "the residuals say how accurate they are.",
            {"misfit": diagnostics.misfit, "probability": diagnostics.below},
        )


def _times(size: float) -> str:
    return f"{size:.1f}" if size < 10.0 else f"{size:.3g}"


def _by_chance(probability: float) -> str:
    """How often chance does it, in words."""
    if probability < 1e-6:
        return "by chance in less than one of a million fits"
    return f"by chance in one of {float(f'{1.0 / probability:.1g}'):.0f} fits"


def why_poor(
    diagnostics: Diagnostics,
    gross: Ints,
    model_error: ModelErrorTable | None,
    *,
    mistaken: bool = False,
) -> str:
    """The sentence that a fit is poor, after a blank; empty for one that is not.

    It is where what is left is far more than the errors explain, a model error among them that was
    given; where the model error that the residuals show is beyond that of any model one would rely
    on; and where no gauge can have shown a reading, though a robust loss disregards it.

    Args:
        diagnostics: the diagnostics of each reading.
        gross: (m,) rows of `gross_readings`.
        model_error: of the fit; None where there is none.
        mistaken: the estimate is far from what it would be without mistakes in the readings.
    """
    if mistaken:
        return (
            " The model does not fit the readings: a sign, unit or zero of some seems to be wrong, "
            "and has then moved the parameters (see the findings)."
        )
    if diagnostics.above < POOR and diagnostics.misfit >= UNUSABLE:
        times = _times(diagnostics.misfit)
        how = f"the residuals are {times} times as large as the stated accuracies"
        return f" The model does not fit the readings: {how} explain (see the findings)."
    if model_error is not None and model_error.kind == "estimated":
        size, low, high = model_error.size, model_error.lower95, model_error.upper95
        if size > UNUSABLE_SIZE and model_error.large:
            return (
                " The model does not fit the readings: it meets them only with a model error of "
                f"{100 * size:.0f} % of the computed motion (95 %: {100 * low:.0f} to "
                f"{100 * high:.0f} %)."
            )
    if len(gross):
        return " The model does not fit the readings: some are grossly wrong (see the findings)."
    return ""


def bound_findings(
    certificate: Certificate | None, parameters: Sequence[Parameter]
) -> Iterator[Finding]:
    """A finding for each parameter whose yield planes no strain point reaches."""
    if certificate is None:
        return
    unreached = [q for q in parameters if q.name in certificate.lower_bounds]
    least = {q.name: certificate.lower_bounds[q.name] for q in unreached}
    for q in sorted(unreached, key=lambda q: least[q.name] <= max(q.lower, 0.0)):
        sentence = f"No strain point reaches the yield planes of {q.name}"
        if least[q.name] > max(q.lower, 0.0):
            sentence += (
                f": {q.name} is at least {_in_unit(least[q.name], q)}, the other parameters being "
                "as found."
            )
        else:
            sentence += ", wherever it is within its bounds."
        yield Finding("unreached", q.name, sentence, {"at_least": least[q.name]})
    names = ", ".join(dict.fromkeys([*(q.name for q in unreached), *certificate.open_above]))
    if names:
        yield Finding(
            "unreached",
            names,
            f"The bands of predicted stages hold as long as {names} keeps the ground from yielding "
            "as in the fitted stages; where a later stage loads it more, readings will tell.",
        )


def opened(table: ParameterTable, certificate: Certificate | None) -> ParameterTable:
    """The parameters, with intervals up to the bound where readings exclude nothing above."""
    if certificate is None or not certificate.open_above:
        return table
    above = np.isin(table.names, certificate.open_above)
    return replace(table, upper95=np.where(above, table.upper, table.upper95))


def over_all_stages(certificate: Certificate | None, survey: Survey) -> Certificate | None:
    """The certificate with what yields in predicted stages too.

    What is known of planes that are never reached stays that of the stages with readings.
    """
    if certificate is None or survey.activity is None:
        return certificate
    yielding = survey.activity
    activity = replace(certificate.activity, points=yielding.points, biactive=yielding.biactive)
    return replace(certificate, activity=activity)


def _in_unit(value: float, parameter: Parameter) -> str:
    unit = parameter.unit, parameter.dimension
    return f"{in_unit(value, *unit):.4g} {shown_unit(*unit)}".rstrip()


def parameter_table(
    parameters: Sequence[Parameter], values: Floats, assessment: Assessment
) -> ParameterTable:
    """The parameters at their values with what is known of them.

    Args:
        parameters: the n unknowns.
        values: (n,) SI.
        assessment: how well they are known.
    """
    return replace(
        bare_parameter_table(parameters, values),
        sd=assessment.sd,
        lower95=assessment.lower95,
        upper95=assessment.upper95,
        at_bound=assessment.at_bound,
        determined=assessment.determined,
        covariance=assessment.covariance,
        correlation=assessment.correlation,
    )


def bare_parameter_table(parameters: Sequence[Parameter], values: Floats) -> ParameterTable:
    """The parameters at their values (n,) where nothing was asked about their uncertainty."""
    n = len(parameters)
    unknown = np.full(n, np.nan)
    bounds = np.array([(q.lower, q.upper) for q in parameters], dtype=np.float64).reshape(n, 2)
    return ParameterTable(
        names=tuple(q.name for q in parameters),
        values=values,
        sd=unknown,
        lower95=unknown,
        upper95=unknown,
        lower=bounds[:, 0],
        upper=bounds[:, 1],
        start=np.array([q.start for q in parameters], dtype=np.float64),
        at_bound=np.any(bounds == values[:, None], axis=1),
        determined=np.ones(n, dtype=np.bool_),
        priors=tuple(q.prior for q in parameters),
        units=tuple(q.unit for q in parameters),
        dimensions=tuple(q.dimension for q in parameters),
        covariance=np.full((n, n), np.nan),
        correlation=np.full((n, n), np.nan),
        fields=tuple(q.field for q in parameters) if any(q.field for q in parameters) else (),
        descriptions=tuple(q.describe for q in parameters)
        if any(q.describe for q in parameters)
        else (),
    )
