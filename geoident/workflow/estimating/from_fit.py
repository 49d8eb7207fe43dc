"""What ``predict`` and ``sample`` share: they read the result of a fit, and their own names it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.result.file import read_result
from geoident.model.results.result import Result
from geoident.workflow.estimating.finished import Finished, write
from geoident.workflow.programs.program import executed
from geoident.workflow.running.jobs import (
    Inputs,
    Job,
    Request,
    inputs_of_result,
    job_provenance,
    of_fit,
)
from geoident.workflow.running.outputs import existing, require_free, target
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


def plan_on_fit(command: str, purpose: str, request: Request, fit: Result, inputs: Inputs) -> Job:
    """The job of a command on a fit.

    Args:
        command: its name.
        purpose: what else the result depends on, besides case, fit and seed.
        request: with the path of the fit as its case.
        fit: the result of the fit.
        inputs: the case that is computed.

    Raises:
        OutputError: the result could not be written, or another one would be lost.
    """
    place = target(request.case, command, output=request.output)
    identity = inputs.identity(f"{command} {fit.fingerprint} {purpose}", (), seed=request.seed)
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
