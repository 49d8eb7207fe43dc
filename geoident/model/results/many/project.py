"""What was found of several sections of one ground: rows of tables, SI units.

NaN stands for what is not known, and an infinite end of an interval for what is not determined.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from geoident.model.results.columns import ROW, Record, column
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding
from geoident.model.results.result import Provenance
from geoident.units import in_unit, shown_unit

SHARED, CONSTANT, LAW, OWN = "shared", "constant", "law", "own"
"""What a parameter of a project is: shared by all sections, a constant of a law, one that follows a
law, or one of a section alone."""

ZERO, KNOWN, UNKNOWN_SCATTER, GIVEN_SCATTER, NO_SCATTER = (
    "zero", "determined", "not determined", "given", "none",
)  # fmt: skip
"""What is known of the scatter about a law."""

_OWN = {"dimension": ROW}
"""A number in the unit that its record names, or this unit."""

_KNOWN = {"dimension": ROW, "known": "determined"}
"""A number that people see only where it is determined."""


class CommonParameter(Record):
    """A shared parameter, or a constant of a law.

    Args:
        name: of it.
        kind: `SHARED` or `CONSTANT`.
        law: parameter to whose law it belongs; empty for a shared one.
        value: SI.
        sd: standard deviation, SI.
        lower95: lower end of the 95 % interval, SI.
        upper95: upper end.
        lower: bound.
        upper: bound.
        at_bound: the value lies on a bound.
        determined: the sections determine it.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
        from_prior: it is known, but hardly better than by its prior.
    """

    name: str
    kind: str = column(sheet="of")
    law: str
    value: float = column(like=_KNOWN)
    sd: float = column(like=_KNOWN)
    lower95: float = column(like=_KNOWN)
    upper95: float = column(like=_KNOWN)
    lower: float
    upper: float
    at_bound: bool
    determined: bool
    unit: str = column(like=_OWN)
    dimension: str
    from_prior: bool = False


class LawEstimate(Record):
    """A law and the scatter about it.

    Args:
        parameter: that follows it.
        formula: as written.
        scale: ``log`` or ``linear``: the scatter is of the logarithm, or SI.
        scatter: standard deviation of sections about the law.
        lower95: lower end of its 95 % interval.
        upper95: upper end.
        state: what is known of it, one of `ZERO`, `KNOWN` and so on.
        unit: in which people see the parameter.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    parameter: str
    formula: str
    scale: str
    scatter: float = column(like=_OWN)
    lower95: float = column(like=_OWN)
    upper95: float = column(like=_OWN)
    state: str
    unit: str = column(like=_OWN)
    dimension: str

    def words(self, size: float) -> str:
        """A scatter as people say it: in per cent, as a factor, or in the unit of the parameter.

        Args:
            size: of it.
        """
        if self.scale == "log":
            return f"{100 * size:.2g} %" if size < 1.0 else f"a factor {math.exp(size):.2g}"
        unit = shown_unit(self.unit, self.dimension)
        return f"{in_unit(size, self.unit, self.dimension):.3g} {unit}".rstrip()


class SectionEnd(Record):
    """A section.

    Args:
        name: of it.
        case_file: path of its case, as seen from the result.
        predicted: it took no part in the fit.
        readings: that were used; of one that is predicted, that judge it.
        alone: how its own fit ended; empty for one that has none.
        misfit: size of its residuals by that of their errors; NaN where nothing can be said.
        above: probability that chance makes them at least as large.
        outlying: probability that a section of the same ground is at least as far from what all
            others tell of it; NaN where nothing can be said.
    """

    name: str = column(sheet="section")
    case_file: str = column(sheet="case")
    predicted: bool
    readings: int
    alone: str
    misfit: float
    above: float = column(sheet="chance")
    outlying: float = column(sheet="as_far_off")


@dataclass(frozen=True)
class SectionCovariate:
    """What is known of a section.

    Args:
        section: its name.
        covariate: name.
        value: SI.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    section: str
    covariate: str
    value: float
    unit: str
    dimension: str


class SectionParameter(Record):
    """A parameter of a section.

    Args:
        section: its name.
        parameter: name.
        kind: `SHARED`, `LAW` or `OWN`.
        value: with all sections, SI.
        sd: standard deviation, SI.
        lower95: lower end of the 95 % interval, SI.
        upper95: upper end.
        alone: what the section says by itself, SI; NaN where it does not determine it.
        alone_lower95: lower end of its 95 % interval.
        alone_upper95: upper end.
        law: what the law says there, SI; NaN where it has none.
        law_lower95: lower end of the 95 % interval of the law itself.
        law_upper95: upper end.
        shrinkage: 0 where the section stands for itself, 1 where it only follows the others; NaN
            for shared parameters and predicted sections.
        at_bound: the value lies on a bound.
        determined: it is.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
        from_prior: it is known, but hardly better than by its prior.
    """

    section: str
    parameter: str
    kind: str
    value: float = column(like=_KNOWN)
    sd: float = column(like=_KNOWN)
    lower95: float = column(like=_KNOWN)
    upper95: float = column(like=_KNOWN)
    alone: float = column(dimension=ROW, sheet="alone value")
    alone_lower95: float = column(dimension=ROW, sheet="alone lower95")
    alone_upper95: float = column(dimension=ROW, sheet="alone upper95")
    law: float = column(dimension=ROW, sheet="law value")
    law_lower95: float = column(dimension=ROW, sheet="law lower95")
    law_upper95: float = column(dimension=ROW, sheet="law upper95")
    shrinkage: float
    at_bound: bool
    determined: bool
    unit: str = column(like=_OWN)
    dimension: str
    from_prior: bool = False


class SectionReading(Record):
    """A reading of a section.

    Args:
        section: its name.
        gauge: name of the channel.
        stage: name of the stage.
        measured: SI; NaN where nothing was read.
        sd: standard deviation of a reading, SI.
        used: it took part in the fit.
        computed: SI.
        lower95: lower end of the 95 % band of a reading that took no part, SI; NaN of one that did.
        upper95: upper end.
        unit: in which people see it; empty for that of its dimension.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    section: str
    gauge: str
    stage: str
    measured: float = column(like=_OWN)
    sd: float = column(like=_OWN)
    used: bool
    computed: float = column(like=_OWN)
    lower95: float = column(like=_OWN)
    upper95: float = column(like=_OWN)
    unit: str = column(like=_OWN)
    dimension: str

    @property
    def judged(self) -> bool:
        """There are a reading and a band."""
        return self.measured == self.measured and self.lower95 == self.lower95

    @property
    def inside(self) -> bool:
        """The reading lies within its band."""
        return self.judged and self.lower95 <= self.measured <= self.upper95


@dataclass(frozen=True)
class LawPoint:
    """A law along one covariate, all others at their medians.

    Args:
        parameter: that follows the law.
        covariate: name.
        at: value of the covariate, SI.
        value: of the law, SI.
        lower95: lower end of the 95 % interval of the law.
        upper95: upper end.
        section_lower95: lower end of the 95 % interval of a section there.
        section_upper95: upper end.
    """

    parameter: str
    covariate: str
    at: float
    value: float
    lower95: float
    upper95: float
    section_lower95: float
    section_upper95: float


@dataclass(frozen=True)
class SearchStep:
    """A step of the search over all sections.

    Args:
        objective: the discrepancy of all sections, with the part of the laws.
        step: size of the step in scaled parameters.
        evaluations: up to here.
        note: such as ``accepted``.
    """

    objective: float
    step: float
    evaluations: int
    note: str


class ProjectResult(Record):
    """What was found of several sections.

    Args:
        title: of the project.
        status: ``converged``, ``poor-fit``, ``not-determined``, ``not-converged``, ...
        exit_code: of the command.
        reason: why the search stopped, a sentence.
        objective: the discrepancy of all sections, with the part of the laws.
        misfit: size of all residuals by that of their errors.
        above: probability that chance makes them at least as large.
        findings: what an engineer must know before using the numbers.
        notes: sentences.
        project_text: the file as written.
        provenance: of the result.
        counts: what it cost.
        common: shared parameters and constants of laws.
        laws: and their scatter.
        sections: in the order of the project.
        covariates: of them.
        parameters: of them.
        readings: of them.
        points: of the laws, for drawing.
        left_out_parameters: of each fitted section as the others predict it; empty if not asked.
        left_out_readings: likewise.
        history: of the search.
    """

    title: str
    status: str
    exit_code: int
    reason: str
    objective: float
    misfit: float
    above: float
    findings: tuple[Finding, ...] = column("finding", group="findings", optional=True)
    notes: tuple[str, ...] = column(optional=True)
    project_text: str = column(group="project", name="verbatim", dataset=True)
    provenance: Provenance = column()
    counts: Counts = column()
    common: tuple[CommonParameter, ...] = column("row", group="common", optional=True)
    laws: tuple[LawEstimate, ...] = column("row", group="laws", optional=True)
    sections: tuple[SectionEnd, ...] = column("row", group="sections", optional=True)
    covariates: tuple[SectionCovariate, ...] = column("row", group="covariates", optional=True)
    parameters: tuple[SectionParameter, ...] = column("row", group="parameters", optional=True)
    readings: tuple[SectionReading, ...] = column("row", group="readings", optional=True)
    points: tuple[LawPoint, ...] = column("row", group="law_points", optional=True)
    left_out_parameters: tuple[SectionParameter, ...] = column(
        "row", group="left_out_parameters", optional=True
    )
    left_out_readings: tuple[SectionReading, ...] = column(
        "row", group="left_out_readings", optional=True
    )
    history: tuple[SearchStep, ...] = column("iteration", group="history")

    def of(self, section: str) -> tuple[SectionParameter, ...]:
        """The parameters of a section."""
        return tuple(row for row in self.parameters if row.section == section)

    @property
    def fitted(self) -> tuple[SectionEnd, ...]:
        """The sections that took part."""
        return tuple(section for section in self.sections if not section.predicted)

    @property
    def predicted(self) -> tuple[SectionEnd, ...]:
        """The sections that took no part."""
        return tuple(section for section in self.sections if section.predicted)
