"""What is said of several sections at the end of their fit: tables, findings, status."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from geoident.errors import ExitCode, ModelError
from geoident.identify.assessment.misfit import Misfit
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.hierarchical.bands import ReadingBands, reading_bands
from geoident.identify.hierarchical.joint_problem import SectionReadings
from geoident.identify.hierarchical.knowledge import (
    Interval95,
    SectionsKnowledge,
    section_misfits,
    total_misfit,
)
from geoident.identify.hierarchical.search import HierarchicalFit
from geoident.io.text.text_file import seen_from
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter
from geoident.model.project.project import ParameterLaw
from geoident.model.results.bands import NORMAL_95
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
from geoident.workflow.project.findings import findings
from geoident.workflow.project.models import SectionAnswers
from geoident.workflow.project.plan import COMMAND, ProjectJob
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
    """

    fit: HierarchicalFit
    numbers: tuple[int, ...]
    readings: tuple[SectionReadings, ...]
    prepared: tuple[PreparedSection, ...]


@dataclass(frozen=True)
class LeftOut:
    """A section that was left out of the fit of all others.

    Args:
        number: of the section.
        fitted: the others.
    """

    number: int
    fitted: Fitted


def project_result(
    job: ProjectJob, models: SectionAnswers, whole: Fitted, left_out: Sequence[LeftOut]
) -> ProjectResult:
    """The result of a project.

    Args:
        job: the project.
        models: of its sections.
        whole: the fit of all that are fitted.
        left_out: each of them as the others predict it, where that was asked for.
    """
    knowledge = SectionsKnowledge(whole.fit)
    tables = _Tables(job, models, whole, knowledge)
    misfits = dict(zip(whole.numbers, section_misfits(whole.fit), strict=True))
    total = total_misfit(whole.fit)
    common, laws = tables.common(), tables.laws()
    rows, readings = tables.sections()
    later = [tables.left_out(one) for one in left_out]
    poor = total.above < POOR and total.scale >= UNUSABLE
    status = _status(whole.fit, common, laws, rows, poor=poor)
    result = ProjectResult(
        title=job.project.title,
        status=status,
        exit_code=int(ExitCode.DONE if status == "converged" else ExitCode.NOT_CONVERGED),
        reason=_reason(whole.fit, common, laws, rows, poor=poor, scale=total.scale),
        objective=float(whole.fit.outcome.objective),
        misfit=total.scale,
        above=total.above,
        findings=(),
        notes=tables.notes(),
        project_text=job.text,
        provenance=_provenance(job),
        counts=models.counts,
        common=common,
        laws=laws,
        sections=tables.ends(misfits, readings),
        covariates=tables.covariates(),
        parameters=rows,
        readings=readings,
        points=tables.points(),
        left_out_parameters=tuple(row for parameters, _ in later for row in parameters),
        left_out_readings=tuple(row for _, found in later for row in found),
        history=tuple(
            SearchStep(one.objective, one.step, one.counts.evaluations, one.note)
            for one in whole.fit.outcome.iterations
        ),
    )
    return replace(result, findings=findings(result, tables.gaps()))


def _status(
    fit: HierarchicalFit,
    common: Sequence[CommonParameter],
    laws: Sequence[LawEstimate],
    rows: Sequence[SectionParameter],
    *,
    poor: bool,
) -> str:
    if fit.outcome.status != "converged":
        return fit.outcome.status
    if poor:
        return "poor-fit"
    return "not-determined" if _undetermined(common, laws, rows) else "converged"


def _undetermined(
    common: Sequence[CommonParameter],
    laws: Sequence[LawEstimate],
    rows: Sequence[SectionParameter],
) -> list[str]:
    """Names of what is not determined: common parameters, scatters, parameters of sections."""
    named = [row.name for row in common if not row.determined]
    named += [f"scatter of {law.parameter}" for law in laws if law.state == UNKNOWN_SCATTER]
    known = {row.name for row in common}
    own = [row for row in rows if not row.determined and row.parameter not in known]
    return named + [f"{row.parameter} of {row.section}" for row in own]


def _reason(
    fit: HierarchicalFit,
    common: Sequence[CommonParameter],
    laws: Sequence[LawEstimate],
    rows: Sequence[SectionParameter],
    *,
    poor: bool,
    scale: float,
) -> str:
    said = fit.outcome.reason
    loose = _undetermined(common, laws, rows)
    if loose:
        said += f" Not determined: {', '.join(loose)}."
    if poor:
        said += " The models do not fit the readings: the residuals are "
        said += f"{scale:.2g} times as large as their errors explain."
    return said


def _provenance(job: ProjectJob) -> Provenance:
    folder = job.place.path.parent
    return Provenance(
        command=COMMAND,
        versions=versions(),
        seed=job.request.seed,
        case_file=seen_from(folder, job.project.path),
        case_sha256=sha256(job.text.encode()),
        mesh_sha256=sha256("".join(one.mesh_sha256 for one in job.inputs).encode()),
        readings_sha256=sha256("".join(one.readings_sha256 for one in job.inputs).encode()),
        identity=job.identity,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.monotonic() - job.started,
        stamp=job.stamp,
    )


class _Tables:
    """The tables of a project at the end of its fit."""

    def __init__(
        self,
        job: ProjectJob,
        models: SectionAnswers,
        whole: Fitted,
        knowledge: SectionsKnowledge,
    ) -> None:
        self._job, self._models, self._whole = job, models, whole
        self._knowledge = knowledge
        self._fit, self._joint = whole.fit, whole.fit.joint

    def gaps(self) -> tuple[str, ...]:
        """What the sections together do not determine, in sentences."""
        problem, values = self._fit.problem, self._fit.outcome.values
        v, J = problem.response.evaluate(values)
        return assess(problem, values, J, v).findings

    def common(self) -> tuple[CommonParameter, ...]:
        joint, found = self._joint, self._knowledge.common()
        owner = {q.name: law.parameter for law in joint.laws for q in law.constants}
        rows = []
        for k, q in enumerate(joint.unknowns[: joint.n_common]):
            value, sd, low, high = _numbers(found, k)
            determined = _is_determined(q, value, sd)
            rows.append(
                CommonParameter(
                    q.name, CONSTANT if q.name in owner else SHARED, owner.get(q.name, ""),
                    value, *_known(determined, sd, low, high), q.lower, q.upper,
                    _at_bound(q, value), determined, q.unit, q.dimension,
                )
            )  # fmt: skip
        return tuple(rows)

    def laws(self) -> tuple[LawEstimate, ...]:
        joint, tau, scatter = self._joint, self._fit.tau, self._knowledge.scatter
        rows = []
        for k, law in enumerate(joint.laws):
            q, unit = joint.templates[law.parameter], joint.law_scaling.reference[k]
            low, high = (tau[k], tau[k])
            if law.scatter.kind == "estimate":
                ends = scatter.interval(k)
                low, high = min(ends[0], tau[k]), max(ends[1], tau[k])
            state = _scatter_state(law, float(tau[k]), float(high), float(joint.largest[k]))
            rows.append(
                LawEstimate(
                    law.parameter, law.text, q.scale, float(tau[k] * unit), float(low * unit),
                    math.inf if state == UNKNOWN_SCATTER else float(high * unit), state,
                    q.unit, q.dimension,
                )
            )  # fmt: skip
        return tuple(rows)

    def covariates(self) -> tuple[SectionCovariate, ...]:
        project = self._job.project
        return tuple(
            SectionCovariate(section.name, c.name, section.covariates[c.name], c.unit, c.dimension)
            for section in project.sections
            for c in project.covariates
            if c.name in section.covariates
        )

    def ends(
        self, misfits: dict[int, tuple[Misfit, float]], readings: Sequence[SectionReading]
    ) -> tuple[SectionEnd, ...]:
        folder = self._job.place.path.parent
        rows = []
        for n, section in enumerate(self._job.project.sections):
            misfit, outlying = misfits.get(n, (None, _NAN))
            scale, above = (misfit.scale, misfit.above) if misfit else (_NAN, _NAN)
            own = [row for row in readings if row.section == section.name]
            counted = [r for r in own if (r.judged if section.predicted else r.used)]
            rows.append(
                SectionEnd(
                    section.name, seen_from(folder, section.case), section.predicted,
                    len(counted), self._whole.prepared[n].status, scale, above, outlying,
                )
            )  # fmt: skip
        return tuple(rows)

    def notes(self) -> tuple[str, ...]:
        """What is to be known of the cases, and of priors that do not count."""
        said = [note for one in self._whole.prepared for note in one.notes]
        for law in self._joint.laws:
            if self._joint.templates[law.parameter].prior is not None:
                said.append(
                    f"The prior of {law.parameter} in the cases does not count: the law takes its "
                    "place."
                )
        return tuple(dict.fromkeys(said))

    def sections(self) -> tuple[tuple[SectionParameter, ...], tuple[SectionReading, ...]]:
        """Parameters and readings of all sections, those that are predicted among them."""
        parameters: list[SectionParameter] = []
        readings: list[SectionReading] = []
        position = {n: k for k, n in enumerate(self._whole.numbers)}
        points = {n: self._joint.point(k, self._fit.outcome.values)[0] for n, k in position.items()}
        shown = dict(zip(points, self._models.shown(list(points.items())), strict=True))
        for n, section in enumerate(self._job.project.sections):
            if section.predicted:
                rows, found = predicted_section(self._models, self._whole, self._knowledge, n)
                parameters += rows
                readings += found
                continue
            parameters += self._fitted_parameters(n, position[n])
            readings += self._fitted_readings(n, position[n], shown[n])
        return tuple(parameters), tuple(readings)

    def _fitted_parameters(self, n: int, k: int) -> list[SectionParameter]:
        found = self._knowledge.section(k)
        law = self._knowledge.law(self._joint.sections[k])
        shrinkage = self._knowledge.shrinkage(k)
        alone = self._whole.prepared[n].alone
        rows = []
        for i, q in enumerate(self._joint.sections[k].parameters):
            kind = _kind(self._whole, q.name)
            at = self._joint.law_of(q.name)
            rows.append(
                _row(
                    self._joint.sections[k].name, q, kind, _numbers(found, i),
                    (float(alone[0, i]), float(alone[1, i]), float(alone[2, i])),
                    _law_numbers(law, at), _NAN if kind == SHARED else float(shrinkage[i]),
                )
            )  # fmt: skip
        return rows

    def _fitted_readings(
        self, n: int, k: int, shown: tuple[Floats, Floats] | None
    ) -> list[SectionReading]:
        """Readings of a section: those of the fit, and others with bands."""
        name = self._joint.sections[k].name
        if shown is None:
            return []
        v, J = shown
        C = self._knowledge.section_covariance(k)
        rows = []
        for i, one in enumerate(self._whole.prepared[n].shown):
            half = NORMAL_95 * math.sqrt(float(J[i] @ C @ J[i]) + one.sd**2)
            low, high = (_NAN, _NAN) if one.used else (v[i] - half, v[i] + half)
            rows.append(
                SectionReading(
                    name, one.gauge, one.stage, one.measured, one.sd, one.used, float(v[i]),
                    float(low), float(high), one.unit, one.dimension,
                )
            )  # fmt: skip
        return rows

    def left_out(self, one: LeftOut) -> tuple[list[SectionParameter], list[SectionReading]]:
        """A section as all others predict it."""
        knowledge = SectionsKnowledge(one.fitted.fit)
        rows, readings = predicted_section(self._models, one.fitted, knowledge, one.number)
        return rows, [row for row in readings if row.judged]

    def points(self) -> tuple[LawPoint, ...]:
        """Each law along each of its covariates."""
        rows: list[LawPoint] = []
        sections = self._job.project.sections
        for k, law in enumerate(self._joint.laws):
            constants = {q.name for q in law.constants}
            names = [n for n in dict.fromkeys(law.formula.names()) if n not in constants]
            for name in names:
                known = np.array([section.covariates[name] for section in sections])
                room = 0.05 * float(np.ptp(known))
                middle = {
                    c: float(np.median([section.covariates[c] for section in sections]))
                    for c in sections[0].covariates
                }
                grid = np.linspace(known.min() - room, known.max() + room, _POINTS)
                for at in grid.tolist() if room > 0.0 else ():
                    rows += self._point(k, law, name, {**middle, name: at})
        return tuple(rows)

    def _point(
        self, k: int, law: ParameterLaw, name: str, covariates: dict[str, float]
    ) -> list[LawPoint]:
        q = self._joint.templates[law.parameter]
        none = np.zeros(0)
        section = SectionReadings("", (q,), covariates, none, none)
        try:
            mean = self._knowledge.law(section)
            further = self._knowledge.further(section).interval
        except ModelError:  # the law has no value there
            return []
        return [
            LawPoint(
                law.parameter, name, covariates[name], float(mean.value[k]),
                float(mean.lower95[k]), float(mean.upper95[k]), float(further.lower95[0]),
                float(further.upper95[0]),
            )
        ]  # fmt: skip


def predicted_section(
    models: SectionAnswers, fitted: Fitted, knowledge: SectionsKnowledge, number: int
) -> tuple[list[SectionParameter], list[SectionReading]]:
    """A section that took no part in a fit, as that predicts it.

    Args:
        models: of all sections.
        fitted: the fit of others.
        knowledge: what that fit tells.
        number: of the section.
    """
    section, prepared = fitted.readings[number], fitted.prepared[number]
    further = knowledge.further(section)
    law = knowledge.law(section)
    rows = []
    for i, q in enumerate(section.parameters):
        at = fitted.fit.joint.law_of(q.name)
        alone = prepared.alone[:, i]
        rows.append(
            _row(
                section.name, q, _kind(fitted, q.name), _numbers(further.interval, i),
                (float(alone[0]), float(alone[1]), float(alone[2])), _law_numbers(law, at), _NAN,
            )
        )  # fmt: skip
    sd = np.array([one.sd for one in prepared.shown], dtype=np.float64)
    try:
        bands = reading_bands(
            further, lambda points: models.shown([(number, p) for p in points]), sd
        )
    except ModelError:
        none = np.full(len(sd), np.nan)
        bands = ReadingBands(none, none, none)
    readings = [
        SectionReading(
            section.name, one.gauge, one.stage, one.measured, one.sd, False,
            float(bands.computed[i]), float(bands.lower95[i]), float(bands.upper95[i]),
            one.unit, one.dimension,
        )
        for i, one in enumerate(prepared.shown)
    ]  # fmt: skip
    return rows, readings


def _kind(fitted: Fitted, name: str) -> str:
    joint = fitted.fit.joint
    if name in joint.shared:
        return SHARED
    return OWN if joint.law_of(name) is None else LAW


def _row(
    section: str,
    q: Parameter,
    kind: str,
    numbers: tuple[float, float, float, float],
    alone: tuple[float, float, float],
    law: tuple[float, float, float],
    shrinkage: float,
) -> SectionParameter:
    value, sd, low, high = numbers
    determined = _is_determined(q, value, sd)
    return SectionParameter(
        section, q.name, kind, value, *_known(determined, sd, low, high), *alone, *law, shrinkage,
        _at_bound(q, value), determined, q.unit, q.dimension,
    )  # fmt: skip


def _numbers(found: Interval95, k: int) -> tuple[float, float, float, float]:
    ends = float(found.lower95[k]), float(found.upper95[k])
    return float(found.value[k]), float(found.sd[k]), *ends


def _law_numbers(found: Interval95, k: int | None) -> tuple[float, float, float]:
    if k is None:
        return (_NAN, _NAN, _NAN)
    return float(found.value[k]), float(found.lower95[k]), float(found.upper95[k])


def _known(determined: bool, sd: float, low: float, high: float) -> tuple[float, float, float]:
    return (sd, low, high) if determined else (_NAN, _NAN, _NAN)


def _is_determined(q: Parameter, value: float, sd: float) -> bool:
    """Whether 1.96 standard deviations are at most half of the range, as for one case."""
    if q.scale == "log":
        return NORMAL_95 * sd / value <= 0.5 * math.log(q.upper / q.lower)
    width = q.upper - q.lower
    return not math.isfinite(width) or NORMAL_95 * sd <= 0.5 * width


def _at_bound(q: Parameter, value: float) -> bool:
    return value in (q.lower, q.upper)


def _scatter_state(law: ParameterLaw, tau: float, upper: float, largest: float) -> str:
    if law.scatter.kind != "estimate":
        return GIVEN_SCATTER if law.scatter.kind == "given" else NO_SCATTER
    if upper >= _OPEN * largest:
        return UNKNOWN_SCATTER
    return ZERO if tau == 0.0 else KNOWN
