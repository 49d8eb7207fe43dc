"""What commands on the result of a fit share: they read it, ask what it knows, and name it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoident.errors import Fault, InputError, Location, Term
from geoident.forward.observed import ObservedModel, Survey
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.profile_path import Nonlinearity
from geoident.identify.assessment.uncertainty import Assessment
from geoident.io.result.file import read_result
from geoident.model.case import Case
from geoident.model.results.result import STOPPED, Result
from geoident.workflow.estimating.accuracies import Possible
from geoident.workflow.estimating.another_case import pick_assessment
from geoident.workflow.estimating.diagnosis import assess_robustly, at_used
from geoident.workflow.estimating.estimate import over_accuracies
from geoident.workflow.estimating.finished import Finished, write
from geoident.workflow.estimating.model_error import LaterModelError
from geoident.workflow.estimating.predictions import KnownErrors, follow_model
from geoident.workflow.estimating.setup import problem_of_result, setup_of_result, used_response
from geoident.workflow.programs.program import executed
from geoident.workflow.running.computed import with_computed
from geoident.workflow.running.jobs import (
    Inputs,
    Job,
    Request,
    inputs_of_result,
    job_provenance,
    of_fit,
)
from geoident.workflow.running.outputs import existing, require_free, target
from geoident.workflow.running.readings import used_rows
from geoident.workflow.running.result_files import case_path, files_of_result


@dataclass(frozen=True, kw_only=True)
class FitTask:
    """A command on the result of a fit, planned.

    Args:
        fit: the result of the fit.
        job: the case that is computed, and the place of the new result. The "case" of its request
            is the path of the fit.
    """

    fit: Result
    job: Job

    @property
    def files_read(self) -> tuple[str, ...]:
        """Paths of the fit, of the case that is computed, and of what they name."""
        return (*files_of_result(self.fit, self.job.request.case), *self.job.inputs.files)

    def require_free(self) -> None:
        """Refuse to overwrite what is not ours; see `outputs.require_free`."""
        job = self.job
        require_free(job.existing, job.place, force=job.request.force, inputs=self.files_read)

    def write(self, result: Result) -> Finished:
        """Write a result, with the fit that it was made from."""
        job, request = self.job, self.job.request
        origin = of_fit(job_provenance(job), self.fit, request.case, job.place.path)
        result = replace(result, provenance=origin)
        return write(result, job.place, job.existing, inputs=self.files_read, force=request.force)


def plan_on_fit(
    command: str, purpose: str, request: Request, fit: Result | None, inputs: Inputs
) -> Job:
    """The job of a command on a fit, or on a case without one.

    Args:
        command: its name.
        purpose: what else the result depends on, besides case, fit and seed.
        request: with the path of the fit as its case.
        fit: the result of the fit; None where the case stands for itself.
        inputs: the case that is computed.

    Raises:
        OutputError: the result could not be written, or another one would be lost.
    """
    place = target(request.case, command, output=request.output)
    of = "" if fit is None else f"{fit.fingerprint} "
    identity = inputs.identity(f"{command} {of}{purpose}", (), seed=request.seed)
    return Job(
        request=request,
        command=command,
        place=place,
        identity=identity,
        existing=existing(place, identity, kind=command, case=inputs.path),
        methods=(),
        inputs=inputs,
    )


CONTROLLED = "controlled"
"""What new readings of a structure in service are by its fit."""


def read_fit(path: str, made: str) -> tuple[Result, Inputs]:
    """The result of a fit, and its case with the mesh as it is now.

    Args:
        path: of the result.
        made: what cannot be done with other results, such as "predicted".

    Raises:
        InputError: it is not the result of a fit.
    """
    fit = read_result(path)
    if fit.kind != "fit":
        message = f"A {fit.kind} cannot be {made} from; the result of a fit is expected."
        hint = ""
        if made == CONTROLLED:
            message = f"this is the result of a {fit.kind}; new readings are held against a fit"
            hint = f"Name the result of the fit: {fit.provenance.fit_file or 'CASE.fit.h5'}."
        raise InputError([Fault("not-a-fit", message, hint, Location(path))])
    if fit.seasonal is not None and made != CONTROLLED:
        message = f"The fit is of a structure in service: nothing is {made} stage by stage."
        hint = f"Judge new readings: {Term.CONTROL}."
        raise InputError([Fault("no-parameters", message, hint, Location(path))])
    return fit, inputs_of_result(fit, case_path(path, fit.provenance.case_file))


def require_same_mesh(fit: Result, inputs: Inputs, hint: str) -> None:
    """Refuse a case whose mesh, or whose model elsewhere, has changed since the fit.

    Args:
        fit: the result of the fit.
        inputs: its case.
        hint: what to do.

    Raises:
        InputError: it has changed.
    """
    if inputs.mesh_sha256 != fit.provenance.mesh_sha256:
        model = inputs.case.elsewhere
        message = "The mesh is not the one that the fit was made with."
        if model is not None:
            message = (
                f"The model is not the one that the fit was made with: {executed(model)} has "
                "changed since, or another file has this name here."
            )
            hint = f"Put the file of the fit beside the result, or do this: {hint}"
        place = Location(inputs.loaded.mesh_path or inputs.path)
        raise InputError([Fault("changed-mesh", message, hint, place)])


class KnownByFit(NamedTuple):
    """What a fit knows beside its parameters.

    Args:
        assessment: how well it knows them, in the order of the model.
        errors: what its readings tell of the errors of later ones; None where none do.
        nonlinearity: how readings deviate from linear; None for not at all.
    """

    assessment: Assessment
    errors: KnownErrors | None
    nonlinearity: Nonlinearity | None


def known_by_fit(
    fit: Result,
    fitted: Case,
    model: ObservedModel,
    case: Case,
    survey: Survey,
    *,
    same_case: bool,
    others: bool = False,
    follow: bool = True,
) -> KnownByFit:
    """What a fit knows, assessed again from the sensitivities that it holds.

    Args:
        fit: the fit, with the parameters.
        fitted: its case.
        model: of the case to predict.
        case: to predict.
        survey: of the model there.
        same_case: it is the case of the fit, perhaps with further readings.
        others: its gauges are not those of the fit: of these it knows no error, nor that of the
            model where they are.
        follow: follow the model where it is not linear, which costs evaluations.
    """
    p, readings = fit.parameters.values, fit.gauges.readings
    setup = setup_of_result(fit, fitted, model)
    response = used_response(setup) if same_case else model.response(())
    problem = problem_of_result(fit, setup.case, response)
    computed, jacobian = at_used(readings)
    over = over_accuracies(setup, problem, p, computed, jacobian)
    order = np.array([fit.parameters.names.index(name) for name in model.names], dtype=np.int64)
    assessment = pick_assessment(assess_robustly(problem, p, computed, jacobian, over), order)
    nonlinearity = None
    if same_case and follow:  # where the model is not linear, as the fit has it
        at_p = with_computed(readings, case, model, survey, p)
        assessment, nonlinearity = follow_model(
            model, case, problem, p, survey, at_p, assessment,
            converged=fit.status not in (STOPPED, "not-converged"),
        )  # fmt: skip
    error = setup.model_error
    if error is not None and others:
        error = error.of_nothing_used()
    known = None
    if error is not None or any(c.errors for c in (*setup.case.channels, *case.channels)):
        known = KnownErrors(
            case,
            replace(problem, sd=effective_sd(problem, computed)),
            computed,
            jacobian[:, order],
            used_rows(setup.case, readings.used),
            None if error is None else LaterModelError(error, case, model, survey.increments),
            Possible.of(fit.accuracies, readings.used),
        )
        known = known.of_nothing_used() if others else known
    return KnownByFit(assessment, known, nonlinearity)
