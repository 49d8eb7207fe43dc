"""What a command is asked for, and where its result comes from."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from geoident import __version__
from geoident.errors import Fault, InputError
from geoident.io.text.text_file import STDIN, seen_from
from geoident.model.case import Case
from geoident.model.methods import MethodOptions
from geoident.model.result import Provenance
from geoident.workflow.running.inputs import Inputs, load_inputs
from geoident.workflow.running.outputs import Standing, Target, require_free, standing, target


@dataclass(frozen=True)
class Request:
    """One case and what to do with it.

    Args:
        case: path of the case, ``-`` for stdin.
        overrides: such as ``parameters.E.start=9 GPa``.
        output: a file or an existing folder; None for beside the case.
        seed: of random numbers.
        solver: name of the sparse solver, or ``auto``.
        force: overwrite a result of other input.
        fresh: compute again what is up to date, and forget the checkpoint.
    """

    case: str
    overrides: tuple[str, ...] = ()
    output: str | None = None
    seed: int = 0
    solver: str = "auto"
    force: bool = False
    fresh: bool = False


@dataclass(frozen=True)
class Job:
    """A request whose case was read and whose output may be written.

    Args:
        request: what was asked for.
        command: ``fit`` or ``scan``.
        methods: the identifiers to run, one after the other.
        inputs: the case.
        place: of the result.
        identity: hash of everything that the result depends on.
        found: what stands at the place of the result.
    """

    request: Request
    command: str
    methods: tuple[MethodOptions, ...]
    inputs: Inputs
    place: Target
    identity: str
    found: Standing

    @property
    def up_to_date(self) -> bool:
        """The result stands there already and is to be kept."""
        return self.found is Standing.UP_TO_DATE and not self.request.fresh


def plan_fit(request: Request) -> Job:
    """Read a case that is to be fitted, and look at what stands where its result goes.

    Raises:
        InputError: the case is wrong.
        OutputError: the result could not be written, or another one would be lost.
    """
    inputs = load_inputs(request.case, overrides=request.overrides)
    return _plan(request, inputs, "fit", inputs.case.fit.methods)


def plan_scan(request: Request) -> Job:
    """The same for a case that is to be scanned: its method is replaced by a scan.

    The grid is that of the case's ``fit.scan`` if it is written.
    """
    inputs = load_inputs(request.case, overrides=[*request.overrides, "fit.method=scan"])
    return _plan(request, inputs, "scan", inputs.case.fit.methods)


def _plan(request: Request, inputs: Inputs, command: str, methods: Sequence[MethodOptions]) -> Job:
    _require_parameters(inputs.case, command)
    identity = inputs.identity(command, methods, seed=request.seed)
    place = target(request.case, command, output=request.output)
    found = standing(place, identity)
    job = Job(request, command, tuple(methods), inputs, place, identity, found)
    if not job.up_to_date:
        require_free(found, place, force=request.force, inputs=inputs.files)
    return job


def _require_parameters(case: Case, command: str) -> None:
    if not case.parameters:
        message = f"there are no parameters, so there is nothing to {command}"
        hint = "Write what is unknown under 'parameters'; `geoident simulate` needs none."
        place = case.source.locate(("parameters",))
        raise InputError([Fault("no-parameters", message, hint, place, "parameters")])


LIBRARIES = ("numpy", "scipy", "h5py", "meshio", "pyyaml", "pydantic")


def provenance(
    inputs: Inputs, *, command: str, identity: str, seed: int, output: Path
) -> Provenance:
    """The provenance of a result that goes to ``output``.

    Args:
        inputs: the case and its mesh.
        command: its name.
        identity: hash of all that the result depends on.
        seed: of random numbers.
        output: path of the result.
    """
    return Provenance(
        command=command,
        versions=versions(),
        seed=seed,
        # relative to the folder of the result, so that both may move
        case_file=seen_from(output.parent, "stdin" if inputs.path == STDIN else inputs.path),
        case_sha256=inputs.case_sha256,
        mesh_sha256=inputs.mesh_sha256,
        readings_sha256=inputs.readings_sha256,
        identity=identity,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def job_provenance(job: Job) -> Provenance:
    """The provenance of the result of a job."""
    return provenance(
        job.inputs,
        command=job.command,
        identity=job.identity,
        seed=job.request.seed,
        output=job.place.path,
    )


def versions() -> dict[str, str]:
    """Versions of geoident, of Python and of the libraries that numbers go through."""
    found = {"geoident": __version__, "python": platform.python_version()}
    return found | {name: version(name) for name in LIBRARIES}
