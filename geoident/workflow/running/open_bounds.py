"""What a bound leaves open, looked at with the model itself where it is not linear (theory 6.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from geoident.errors import ModelError
from geoident.forward.protocols import CaseModel, Survey
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.open_path import Answers, OpenPath, followed
from geoident.identify.assessment.uncertainty import Assessment, Bend
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.workflow.running.diagnosis import at_used
from geoident.workflow.running.readings import with_computed


def _said(survey: Survey, readings: ReadingTable) -> Answers:
    """What a survey says of the used readings and of all channels and stages."""
    rows = survey.sensitivity.reshape(survey.computed.size, -1)
    return Answers(*at_used(readings), survey.computed.ravel(), rows)


@dataclass(frozen=True)
class Bends:
    """How all readings deviate from linear along what a bound leaves open.

    Args:
        path: its points, with the readings of all channels and stages, row by row.
        t: (K,) where the points of the posterior lie on it.
        undetermined: the open parameter is not determined.
    """

    path: OpenPath
    t: Floats
    undetermined: bool

    def of(self, places: Bools) -> Bend:
        """Of the readings at some places (n_channels, n_stages)."""
        chosen = replace(self.path, bend=self.path.bend[:, places.ravel()])
        return Bend(chosen.bent(self.t), self.undetermined)


def follow_open_bound(
    model: CaseModel,
    case: Case,
    problem: Problem,
    values: Floats,
    survey: Survey,
    readings: ReadingTable,
    assessment: Assessment,
) -> tuple[Assessment, Bends | None]:
    """The assessment and the readings along a parameter that its bound leaves open.

    Costs nothing where no bound is near, and one evaluation where the model is linear there.

    Args:
        model: of the case.
        case: the case.
        problem: the used readings, with the accuracies as stated or estimated.
        values: (n,) the estimate, SI.
        survey: the model there.
        readings: with what the model says of each there.
        assessment: of the linearised model.
    """

    def evaluate(p: Floats) -> Answers | None:
        try:
            if model.admissible(p) is not None:
                return None
            there = model.survey(p, fields=False, partial=True)
        except ModelError:
            return None
        return _said(there, with_computed(readings, case, model, there, p))

    weighted = replace(problem, sd=effective_sd(problem, readings.computed[readings.used]))
    assessment, path = followed(assessment, weighted, values, _said(survey, readings), evaluate)
    if path is None:
        return assessment, None
    i = path.parameter
    known = assessment.determined[i] | assessment.from_prior[i]
    return assessment, Bends(path, assessment.posterior.shift[i], not bool(known))
