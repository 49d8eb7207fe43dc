"""What is said of several sections at the end of their fit: tables, findings, status."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property

import numpy as np

from geoident.errors import ExitCode, ModelError
from geoident.identify.assessment.uncertainty import PRIOR_SHARE, assess
from geoident.identify.hierarchical.bands import ReadingBands, reading_bands
from geoident.identify.hierarchical.joint_problem import SectionReadings
from geoident.identify.hierarchical.knowledge import (
    Interval95,
    SectionsKnowledge,
    section_misfits,
    total_misfit,
)
from geoident.identify.hierarchical.search import HierarchicalFit, SectionsStart
from geoident.io.text.text_file import seen_from
from geoident.io.text.wording import listing
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter
from geoident.model.project.project import ProjectSection
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.findings import Finding
from geoident.model.results.many.project import (
    CONSTANT,
    GIVEN_SCATTER,
    KNOWN,
    LAW,
    NO_SCATTER,
    OWN,
    SHARED,
    UNKNOWN_SCATTER,
    ZERO,
    CommonParameter,
    LawEstimate,
    LawPoint,
    ProjectResult,
    SearchStep,
    SectionCovariate,
    SectionEnd,
    SectionParameter,
    SectionReading,
)
from geoident.model.results.result import Provenance
from geoident.workflow.estimating.diagnosis import POOR, UNUSABLE
from geoident.workflow.executing.versions import versions
from geoident.workflow.project.common_errors import CommonErrors, with_common
from geoident.workflow.project.error_sizes import doubtful_accuracies
from geoident.workflow.project.errors import CommonSizes, ErrorsAt, shown_given_used
from geoident.workflow.project.findings import accuracy_finding, findings
from geoident.workflow.project.models import SectionAnswers
from geoident.workflow.project.plan import ProjectJob
from geoident.workflow.project.sections import PreparedSection
from geoident.workflow.running.jobs import sha256

_POINTS = 41
"""Of a law along a covariate."""

_OPEN = 0.9
"""Part of the largest scatter beyond which its interval says nothing."""

_NAN = float("nan")


@dataclass(frozen=True)
class Fitted:
    """A fit of some sections of a project.

    Args:
        fit: of them.
        numbers: which of the project's.
        readings: of all sections of the project.
        prepared: likewise.
        sizes: of the errors of their readings.
        common: what these have in common.
        at_rest: parameters and these sizes go together.
    """

    fit: HierarchicalFit
    numbers: tuple[int, ...]
    readings: tuple[SectionReadings, ...]
    prepared: tuple[PreparedSection, ...]
    sizes: CommonSizes
    common: CommonErrors
    at_rest: bool = True

    @property
    def points(self) -> dict[int, Floats]:
        """Number of each section to the parameters (n,) of its model, SI."""
        return {n: p[: len(p) - len(self.common.names)] for n, p in self._whole_points.items()}

    @property
    def _whole_points(self) -> dict[int, Floats]:
        """The same with what their errors have in common."""
        joint, values = self.fit.joint, self.fit.outcome.values
        return {n: joint.point(k, values)[0] for k, n in enumerate(self.numbers)}

    @property
    def of_errors(self) -> Floats:
        """(r,) what the errors of all sections have in common."""
        names, values = self.common.names, self.fit.outcome.values
        first = len(self.fit.joint.shared) - len(names)
        return values[first : first + len(names)]

    def start(self, numbers: Sequence[int]) -> SectionsStart:
        """Where another search over some of the sections begins."""
        joint, values, tau = self.fit.joint, self.fit.outcome.values, self.fit.tau
        points = self._whole_points
        return SectionsStart(
            values[: joint.n_common],
            tuple(points[n] for n in numbers),
            np.where(tau > 0.0, tau, 0.02 * joint.largest),
        )

    @cached_property
    def knowledge(self) -> SectionsKnowledge:
        """Intervals of all that it found."""
        return SectionsKnowledge(self.fit)


def project_result(
    job: ProjectJob, models: SectionAnswers, whole: Fitted, left_out: Mapping[int, Fitted]
) -> ProjectResult:
    """The result of a project.

    Args:
        job: the project.
        models: of its sections.
        whole: the fit of all that are fitted.
        left_out: number of a section to the fit of all others, where that was asked for.
    """
    joint, outcome, total = whole.fit.joint, whole.fit.outcome, total_misfit(whole.fit)
    common, laws = _common_parameters(whole), _law_estimates(whole)
    points = whole.points
    shown = dict(zip(points, models.shown(list(points.items())), strict=True))
    parameters: list[SectionParameter] = []
    readings: list[SectionReading] = []
    for n in range(len(whole.prepared)):
        rows = _fitted(models, whole, n, shown[n]) if n in shown else _predicted(models, whole, n)
        parameters += rows[0]
        readings += rows[1]
    later = [_predicted(models, others, n) for n, others in left_out.items()]

    loose = [row.name for row in common if not (row.determined or row.from_prior)]
    loose += [f"scatter of {law.parameter}" for law in laws if law.state == UNKNOWN_SCATTER]
    shared = {row.name for row in common}
    loose += [
        f"{row.parameter} of {row.section}"
        for row in parameters
        if not (row.determined or row.from_prior) and row.parameter not in shared
    ]
    poor = total.above < POOR and total.scale >= UNUSABLE
    mistaken = {
        job.project.sections[n].name: one
        for n in whole.numbers
        if (one := whole.prepared[n].mistaken) is not None
    }
    misled = [name for name, one in mistaken.items() if one.poor]
    status, reason = outcome.status, outcome.reason
    if status == "converged":
        status = "poor-fit" if poor or misled else "not-determined" if loose else "converged"
    if loose:
        reason += f" Not determined: {', '.join(loose)}."
    if poor:
        reason += " The models do not fit the readings: the residuals are "
        reason += f"{total.scale:.2g} times as large as their errors explain."

    if misled:
        reason += (
            f" Readings or priors of {listing(misled)} seem to be mistaken and have moved the "
        )
        reason += "parameters (see the findings)."

    notes = _notes_of_sections(job, whole.prepared)
    if any(whole.prepared[n].errors.stated.kind == "estimate" for n in whole.numbers):
        notes.append(whole.sizes.sentence())
    notes += [
        f"The prior of {law.parameter} in the cases does not count: the law takes its place."
        for law in joint.laws
        if joint.templates[law.parameter].prior is not None
    ]
    project = job.project
    result = ProjectResult(
        title=project.title,
        status=status,
        exit_code=int(ExitCode.DONE if status == "converged" else ExitCode.NOT_CONVERGED),
        reason=reason,
        objective=float(outcome.objective),
        misfit=total.scale,
        above=total.above,
        findings=(),
        notes=tuple(notes),
        project_text=job.text,
        provenance=_provenance(job),
        counts=models.counts,
        common=common,
        laws=laws,
        sections=_section_ends(job, whole, readings),
        covariates=tuple(
            SectionCovariate(section.name, c.name, section.covariates[c.name], c.unit, c.dimension)
            for section in project.sections
            for c in project.covariates
            if c.name in section.covariates
        ),
        parameters=tuple(parameters),
        readings=tuple(readings),
        points=_law_points(project.sections, whole),
        left_out_parameters=tuple(row for rows, _ in later for row in rows),
        left_out_readings=tuple(row for _, rows in later for row in rows if row.judged),
        history=tuple(
            SearchStep(one.objective, one.step, one.counts.evaluations, one.note)
            for one in outcome.iterations
        ),
    )
    v, J = whole.fit.problem.response.evaluate(outcome.values)
    gaps = assess(whole.fit.problem, outcome.values, J, v).findings
    gaps = tuple(one for one in gaps if not {*one.subject.split(", ")} & {*whole.common.names})
    of_sections = (finding for one in whole.prepared for finding in one.findings)
    mistakes = {name: one.findings for name, one in mistaken.items()}
    restless = () if whole.at_rest else (_NOT_AT_REST,)
    accuracies = _accuracy_findings(job, models, whole)
    said = (*findings(result, gaps, mistakes), *of_sections, *accuracies, *restless)
    return replace(result, findings=said)


def _accuracy_findings(job: ProjectJob, models: SectionAnswers, whole: Fitted) -> Iterator[Finding]:
    """Sections whose gauges are much less or more accurate than their cases state."""
    points, prepared = whole.points, [whole.prepared[n] for n in whole.numbers]
    answers = models.evaluate(points)
    errors = [
        ErrorsAt.of(one.errors, models.steps(n, p)).used()
        for one, (n, p) in zip(prepared, points.items(), strict=True)
    ]
    of_models = [answers[n] for n in points]
    off = doubtful_accuracies(whole.fit, of_models, errors, whole.common, whole.sizes)
    for k, one in off.items():
        section = job.project.sections[whole.numbers[k]]
        channels = [channel for channel, _ in errors[k].section.rows]
        yield accuracy_finding(section, channels, one)


_NOT_AT_REST = Finding(
    "model-error-doubt",
    "",
    "The parameters of all sections and the errors of their readings did not come to rest: others, "
    "with the errors that follow from them, meet the readings as well. State the model error "
    "('model_error: 15 %' under 'fit' of the cases).",
)


def _notes_of_sections(job: ProjectJob, prepared: Sequence[PreparedSection]) -> list[str]:
    """Notes that all fitted sections have, as they are; those of some under their names."""
    names = [section.name for section in job.project.sections]
    fitted = {section.name for section in job.project.fitted}
    of_note: dict[str, list[str]] = {}
    for name, one in zip(names, prepared, strict=True):
        for note in dict.fromkeys(one.notes):
            of_note.setdefault(note, []).append(name)
    return [
        note if fitted <= {*having} else f"{', '.join(having)}: {note}"
        for note, having in of_note.items()
    ]


def _provenance(job: ProjectJob) -> Provenance:
    return Provenance(
        command=job.command,
        versions=versions(),
        seed=job.request.seed,
        case_file=seen_from(job.place.path.parent, job.project.path),
        case_sha256=sha256(job.text.encode()),
        mesh_sha256=sha256("".join(one.mesh_sha256 for one in job.inputs).encode()),
        readings_sha256=sha256("".join(one.readings_sha256 for one in job.inputs).encode()),
        identity=job.identity,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.monotonic() - job.started,
        stamp=job.stamp,
    )


def _section_ends(
    job: ProjectJob, whole: Fitted, readings: Sequence[SectionReading]
) -> tuple[SectionEnd, ...]:
    """How well the readings of each section are met."""
    misfits = dict(zip(whole.numbers, section_misfits(whole.fit), strict=True))
    rows = []
    for n, section in enumerate(job.project.sections):
        misfit, outlying = misfits.get(n, (None, _NAN))
        scale, above = (misfit.scale, misfit.above) if misfit else (_NAN, _NAN)
        own = [row for row in readings if row.section == section.name]
        counted = [row for row in own if (row.judged if section.predicted else row.used)]
        rows.append(
            SectionEnd(
                section.name, seen_from(job.place.path.parent, section.case), section.predicted,
                len(counted), whole.prepared[n].status, scale, above, outlying,
            )
        )  # fmt: skip
    return tuple(rows)


def _common_parameters(whole: Fitted) -> tuple[CommonParameter, ...]:
    joint, known = whole.fit.joint, whole.knowledge.common()
    owner = {q.name: law.parameter for law in joint.laws for q in law.constants}
    rows = []
    for k, q in enumerate(joint.unknowns[: joint.n_common]):
        if q.name in whole.common.names:
            continue
        kind, law = CONSTANT if q.name in owner else SHARED, owner.get(q.name, "")
        estimate, (at_bound, determined, from_prior) = _estimate(q, known, k)
        rows.append(
            CommonParameter(
                q.name, kind, law, *estimate, q.lower, q.upper, at_bound, determined, q.unit,
                q.dimension, from_prior,
            )
        )  # fmt: skip
    return tuple(rows)


def _estimate(
    q: Parameter, known: Interval95, k: int
) -> tuple[tuple[float, float, float, float], tuple[bool, bool, bool]]:
    """An entry of estimates of a parameter.

    Returns:
        Value, standard deviation and ends of its interval, SI, of which all but the value are NaN
        where it is not determined; whether it lies on a bound, whether it is determined: 1.96
        standard deviations are at most half of the range, as for one case; and whether it is so
        only as its prior is, which is then not called determined.
    """
    value, sd = float(known.value[k]), float(known.sd[k])
    if q.scale == "log":
        determined = NORMAL_95 * sd / value <= 0.5 * math.log(q.upper / q.lower)
    else:
        width = q.upper - q.lower
        determined = not math.isfinite(width) or NORMAL_95 * sd <= 0.5 * width
    spread = (sd, float(known.lower95[k]), float(known.upper95[k]))
    spread = spread if determined else (_NAN, _NAN, _NAN)
    from_prior = determined and q.prior is not None and sd * q.prior.slope(value) >= PRIOR_SHARE
    return (value, *spread), (
        value in (q.lower, q.upper),
        determined and not from_prior,
        from_prior,
    )


def _law_estimates(whole: Fitted) -> tuple[LawEstimate, ...]:
    joint, tau = whole.fit.joint, whole.fit.tau
    rows = []
    for k, law in enumerate(joint.laws):
        q, unit = joint.templates[law.parameter], joint.law_scaling.reference[k]
        low, high = tau[k], tau[k]
        if law.scatter.kind == "estimate":
            ends = whole.knowledge.scatter.interval(k)
            low, high = min(ends[0], tau[k]), max(ends[1], tau[k])
            known = ZERO if tau[k] == 0.0 else KNOWN
            state = UNKNOWN_SCATTER if high >= _OPEN * joint.largest[k] else known
        else:
            state = GIVEN_SCATTER if law.scatter.kind == "given" else NO_SCATTER
        rows.append(
            LawEstimate(
                law.parameter, law.text, q.scale, float(tau[k] * unit), float(low * unit),
                math.inf if state == UNKNOWN_SCATTER else float(high * unit), state, q.unit,
                q.dimension,
            )
        )  # fmt: skip
    return tuple(rows)


def _law_points(sections: Sequence[ProjectSection], whole: Fitted) -> tuple[LawPoint, ...]:
    """Each law along each of its covariates, the others at their medians."""
    joint, none = whole.fit.joint, np.zeros(0)
    rows: list[LawPoint] = []
    for k, law in enumerate(joint.laws):
        constants = {q.name for q in law.constants}
        for name in dict.fromkeys(law.formula.names()):
            if name in constants:
                continue
            known = np.array([section.covariates[name] for section in sections])
            room = 0.05 * float(np.ptp(known))
            middle = {
                c: float(np.median([section.covariates[c] for section in sections]))
                for c in sections[0].covariates
            }
            grid = np.linspace(known.min() - room, known.max() + room, _POINTS)
            for at in grid.tolist() if room > 0.0 else ():
                q, covariates = joint.templates[law.parameter], {**middle, name: at}
                section = SectionReadings("", (q,), covariates, none, none)
                with suppress(ModelError):  # the law has no value there
                    mean = whole.knowledge.law(section)
                    further = whole.knowledge.further(section).interval
                    values = mean.value[k], mean.lower95[k], mean.upper95[k]
                    ends = further.lower95[0], further.upper95[0]
                    rows.append(LawPoint(law.parameter, name, at, *map(float, (*values, *ends))))
    return tuple(rows)


# Sections

SectionRows = tuple[list[SectionParameter], list[SectionReading]]


def _fitted(
    models: SectionAnswers, whole: Fitted, n: int, shown: tuple[Floats, Floats] | None
) -> SectionRows:
    """A section that took part: its parameters, and its readings, with bands where not used.

    Args:
        models: of all sections.
        whole: the fit.
        n: number of the section.
        shown: readings (g,) that are shown, with Jacobians (g, n); None without a solution.
    """
    k = whole.numbers.index(n)
    section, knowledge = whole.fit.joint.sections[k], whole.knowledge
    shrinkage = knowledge.shrinkage(k)
    parameters = _parameter_rows(whole, n, section, knowledge.section(k), shrinkage)
    if shown is None:
        return parameters, []
    prepared = whole.prepared[n]
    v, half = shown[0].copy(), np.full(len(shown[0]), _NAN)
    later = np.array([not one.used for one in prepared.shown], dtype=np.bool_)
    if later.any():
        p = whole.points[n]
        basis, z = whole.common.basis(prepared.errors, whole.sizes), whole.of_errors
        used = with_common(models.evaluate({n: p})[n], basis[prepared.errors.used], z)
        expected, slopes = with_common(shown, basis, z)
        errors = ErrorsAt.of(prepared.errors, models.steps(n, p)).sized(whole.sizes)
        implied = shown_given_used(prepared, errors, whole.fit.problem, used, slopes)
        J, C = implied.jacobian, knowledge.section_covariance(k)
        variance = np.einsum("ij,jk,ik->i", J, C, J) + implied.sd**2
        v[later] = (expected + implied.shift)[later]
        half[later] = NORMAL_95 * np.sqrt(variance[later])
    rows = zip(prepared.shown, v, v - half, v + half, strict=True)
    return parameters, [one.row(section.name, *ends) for one, *ends in rows]


def _predicted(models: SectionAnswers, fitted: Fitted, n: int) -> SectionRows:
    """A section that took no part in a fit, as that predicts it.

    Args:
        models: of all sections.
        fitted: the fit of others.
        n: number of the section.
    """
    section, shown = fitted.readings[n], fitted.prepared[n].shown
    further = fitted.knowledge.further(section)
    parameters = _parameter_rows(fitted, n, section, further.interval, None)
    try:
        own = fitted.prepared[n]
        p = further.values[: len(own.parameters)]
        errors = ErrorsAt.of(own.errors, models.steps(n, p))
        bands = reading_bands(
            further,
            lambda points: models.shown([(n, p) for p in points]),
            *errors.like_others(fitted.sizes),
            fitted.common.basis(own.errors, fitted.sizes),
        )
    except ModelError:
        none = np.full(len(shown), np.nan)
        bands = ReadingBands(none, none, none)
    readings = [
        replace(one, used=False).row(section.name, *ends)
        for one, *ends in zip(shown, bands.computed, bands.lower95, bands.upper95, strict=True)
    ]
    return parameters, readings


def _parameter_rows(
    fitted: Fitted, n: int, section: SectionReadings, known: Interval95, shrinkage: Floats | None
) -> list[SectionParameter]:
    """The parameters of a section.

    Args:
        fitted: the fit.
        n: number of the section.
        section: its parameters and covariates.
        known: what the fit says of them.
        shrinkage: (n,) of them; None for a section that took no part.
    """
    joint, law = fitted.fit.joint, fitted.knowledge.law(section)
    rows = []
    for i, q in enumerate(fitted.prepared[n].parameters):
        at = joint.law_of(q.name)
        kind = SHARED if q.name in joint.shared else OWN if at is None else LAW
        of_law = _NAN, _NAN, _NAN
        if at is not None:
            of_law = float(law.value[at]), float(law.lower95[at]), float(law.upper95[at])
        alone, low, high = map(float, fitted.prepared[n].alone[:, i])
        shrunk = _NAN if kind == SHARED or shrinkage is None else float(shrinkage[i])
        own = replace(q, prior=None) if kind == LAW else q  # the law takes the place of its prior
        estimate, (at_bound, determined, from_prior) = _estimate(own, known, i)
        rows.append(
            SectionParameter(
                section.name, q.name, kind, *estimate,
                alone, low, high, *of_law, shrunk,
                at_bound, determined, q.unit, q.dimension, from_prior,
            )
        )  # fmt: skip
    return rows
