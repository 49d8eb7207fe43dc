"""What a command is given and asked for: a case, its model and hashes; where the result goes."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

import numpy as np

from geoident import __version__
from geoident.errors import Fault, InputError, Location, ModelError, Term
from geoident.fem.refinement.finer import raised
from geoident.fem.solvers import pick_solver
from geoident.forward.external.convergence import LawModel
from geoident.forward.external.model import ExternalModel
from geoident.forward.external.program import ProgramModel
from geoident.forward.external.settlement import SettlementModel
from geoident.forward.external.table import TableModel
from geoident.forward.ground.field import mode_parameters
from geoident.forward.in_service.model import SeasonalReadings
from geoident.forward.in_service.structure import service_model
from geoident.forward.model import StagedModel, staged_model
from geoident.forward.observed import ObservedModel
from geoident.forward.openings.model import OpeningModel, opening_model
from geoident.io.case.file import parse_case, read_case
from geoident.io.loaded import LoadedCase
from geoident.io.mesh.file import mesh_files, read_mesh
from geoident.io.result.file import FORMAT
from geoident.io.text.text_file import STDIN, require_file, seen_from
from geoident.model.arrays import Floats
from geoident.model.case import Case, Source
from geoident.model.external import ConvergenceLaw, ExternalProgram, PythonFunction, RunTable
from geoident.model.in_service import SeasonalModel
from geoident.model.mesh import Mesh
from geoident.model.methods import MethodOptions, method_name
from geoident.model.moments import with_states
from geoident.model.results.result import Provenance, Result
from geoident.model.settlement import SettlementLaw
from geoident.workflow.executing.versions import versions
from geoident.workflow.programs.digest import (
    digest_of,
    file_sha256,
    known_sha256,
    model_files,
)
from geoident.workflow.programs.function import FunctionRuns
from geoident.workflow.programs.program import ProgramRuns
from geoident.workflow.running.outputs import (
    Existing,
    Target,
    existing,
    require_free,
    runs_folder,
    stamp,
    target,
)
from geoident.workflow.running.readings import readings_of

NO_READINGS = "readings=[]"
"""Override for a case whose readings are not asked for; their file need not be there."""


@dataclass(frozen=True)
class Inputs:
    """A case that was read, and the hashes of all that it consists of.

    Args:
        path: the case as the user named it.
        loaded: the case, its text, and the files that it names.
        case_sha256: of the case after overrides, without the head of its report.
        mesh_sha256: of the bytes of the mesh, or of the files of a model elsewhere; empty if there
            is none.
        readings_sha256: of the bytes of the readings, and of what acts day by day; empty if there
            is no file of them.
        program_sha256: of the program that is run, of which another machine may have another
            build; empty if there is none, or it lies beside the case.
    """

    path: str
    loaded: LoadedCase
    case_sha256: str
    mesh_sha256: str
    readings_sha256: str
    program_sha256: str = ""

    @property
    def case(self) -> Case:
        """The case."""
        return self.loaded.case

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of the case and of all files that it names: what no output may replace."""
        mesh = self.loaded.mesh_path
        parts = () if mesh is None else mesh_files(mesh)
        elsewhere = self.case.elsewhere
        parts = (*parts, *(() if elsewhere is None else elsewhere.inputs))
        parts = (*parts, *(() if self.case.service is None else self.case.service.inputs))
        named = (*self.loaded.files, *self.loaded.readings_paths, *parts)
        return named if self.path == STDIN else (self.path, *named)

    def identity(self, command: str, methods: Sequence[MethodOptions], *, seed: int) -> str:
        """Hash of everything that the result of a command depends on.

        Args:
            command: its name.
            methods: options of the methods, in their order.
            seed: of random numbers.
        """
        parts = {
            "command": command,
            "case": self.case_sha256,
            "mesh": self.mesh_sha256,
            "readings": self.readings_sha256,
            "version": __version__,
            "format": FORMAT,
            "seed": seed,
            "methods": [[method_name(options), asdict(options)] for options in methods],
            **({"program": self.program_sha256} if self.program_sha256 else {}),
        }
        return sha256(json.dumps(parts, sort_keys=True).encode())


def load_inputs(
    path: str,
    *,
    overrides: Sequence[str] = (),
    text: str | None = None,
) -> Inputs:
    """Read a case (``-`` is stdin) with overrides such as ``parameters.E.start=9 GPa``.

    The mesh and the readings are hashed; the mesh is not parsed.

    Args:
        path: of the case.
        overrides: texts ``path=value`` in place of what it says.
        text: of the case where it stands in no file; its path need not be there then.

    Raises:
        InputError: with all faults of the case.
    """
    if text is None:
        return _hashed(path, read_case(path, overrides=tuple(overrides)))
    return _hashed(path, parse_case(text, path, overrides=tuple(overrides)))


def inputs_of_result(result: Result, path: str, overrides: Sequence[str] = ()) -> Inputs:
    """The case of a result, from what the result holds; only the mesh is looked for where it was.

    Args:
        result: holds the case and its readings.
        path: where the case stood.
        overrides: changes to it, such as further gauges.

    Raises:
        InputError: the case cannot be read as this version reads it.
    """
    try:
        changes = [_days_alone(result), *overrides]
        loaded = parse_case(result.case_resolved, path, overrides=changes)
    except InputError as error:
        unplaced = [replace(fault, location=Location(path)) for fault in error.faults]
        raise InputError(unplaced) from error
    nowhere = Source(path)  # the lines of the resolved case are not those of the file
    loaded = replace(
        loaded,
        case=_as_fitted(loaded.case, result, nowhere),
        text=result.case_text,
        resolved=loaded.resolved if overrides else result.case_resolved,
    )
    hashes = result.provenance
    return replace(
        _hashed(path, loaded),
        case_sha256=hashes.case_sha256,
        readings_sha256=hashes.readings_sha256,
    )


def _days_alone(result: Result) -> str:
    """The override that leaves no readings; of a settlement law their days, its stages."""
    if not result.settlement:
        return NO_READINGS
    nothing = {"gauge": result.gauges.channels[0], "value": f"0 {result.gauges.units[0]}"}
    days = [{**nothing, "stage": stage} for stage in result.gauges.stages]
    return f"readings={json.dumps(days)}"


def _as_fitted(case: Case, result: Result, source: Source) -> Case:
    """A case with the readings, accuracies and modes of a result, whose files need not be there."""
    gauges = result.gauges
    case = with_states(case, gauges.stages)
    pairs = zip(gauges.channels, gauges.accuracy.tolist(), strict=True)
    known = {name: accuracy for name, accuracy in pairs if accuracy > 0.0}  # NaN in old files
    errors = dict(zip(gauges.channels, gauges.errors, strict=False))
    channels = []
    for c in case.channels:
        parts = errors.get(c.name)
        if parts is not None and c.errors is not None:
            parts = replace(parts, already_estimated=c.errors.estimated)
        channels.append(replace(c, accuracy=known.get(c.name, c.accuracy), errors=parts))
    readings = readings_of(gauges.readings)
    accuracies, sd = result.accuracies, gauges.readings.own_sd
    if accuracies is not None and sd is not None and len(accuracies.of_reading) == len(readings):
        # those with an estimated accuracy have none of their own
        own = {c.name: c.own_accuracy for c in channels}
        readings = tuple(
            r if k < 0 else replace(r, accuracy=None, count=round((own[r.channel] / size) ** 2))
            for r, k, size in zip(
                readings, accuracies.of_reading.tolist(), sd.tolist(), strict=True
            )
        )
    return replace(
        case,
        parameters=(*case.parameters, *mode_parameters(case, result.parameters.names)),
        readings=readings,
        channels=tuple(channels),
        source=source,
    )


def _hashed(path: str, loaded: LoadedCase) -> Inputs:
    elsewhere, mesh, program = loaded.case.elsewhere, "", ""
    if isinstance(elsewhere, RunTable) and elsewhere.campaign:
        # by its numbers: the file is written anew whenever its campaign is looked at
        mesh = sha256(elsewhere.values.tobytes() + elsewhere.readings.tobytes())
    elif elsewhere is not None:
        mesh = digest_of((), elsewhere.inputs)
        run = [file for file in model_files(elsewhere) if file not in elsewhere.inputs]
        program = digest_of((), run) if run else ""
    elif loaded.mesh_path is not None:
        mesh = _hash_file(loaded.mesh_path, "mesh")
    day_by_day = () if loaded.case.service is None else loaded.case.service.inputs
    each = [_hash_file(file, "readings") for file in (*loaded.readings_paths, *day_by_day)]
    readings = sha256("".join(each).encode()) if len(each) > 1 else "".join(each)
    return Inputs(
        path,
        loaded,
        case_sha256=sha256((loaded.computed or loaded.resolved).encode()),
        mesh_sha256=mesh,
        readings_sha256=readings,
        program_sha256=program,
    )


def sha256(content: bytes) -> str:
    """SHA-256 as hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def _hash_file(path: str, what: str) -> str:
    require_file(path, what)
    try:
        return file_sha256(path)
    except OSError as error:
        message = f"The {what} file cannot be read: {error.strerror or error}."
        raise InputError([Fault("unreadable-file", message, location=Location(path))]) from error


def load_mesh(inputs: Inputs, path: str) -> Mesh:
    """Parse the mesh of a case that stands at a path.

    Raises:
        InputError: the mesh is of no use; a fault without a line in the mesh, which may be a binary
            file, is placed where the case names the mesh.
    """
    case = inputs.case
    try:
        checksums = tuple(map(known_sha256, mesh_files(path)))
        return _mesh(path, case.analysis.dim, case.mesh_order, checksums)
    except InputError as error:
        raise InputError(_in_case(fault, case) for fault in error.faults) from error


@lru_cache(maxsize=1)
def _mesh(path: str, dim: int, order: int, checksums: tuple[str, ...]) -> Mesh:
    """A mesh; the next case of a campaign is on the same one mostly, as its checksums tell.

    What was found of it (`forward.of_mesh`) stays with it.
    """
    mesh = read_mesh(path, dim=dim)
    return raised(mesh) if order == 2 else mesh


def _in_case(fault: Fault, case: Case) -> Fault:
    if fault.location.line:
        return fault
    message = f"{fault.location.file}: {fault.message}"
    return case.source.fault(("mesh", "file"), fault.code, message, fault.hint)


def build_model(
    inputs: Inputs, *, solver: str = "auto", fresh: bool = False
) -> StagedModel | OpeningModel | ExternalModel:
    """The staged model of a case, the closed form where it has no mesh, its runs if elsewhere.

    Args:
        inputs: the case.
        solver: name of the sparse solver, or ``auto``.
        fresh: runs that failed before are made again.

    Raises:
        InputError: what the case says does not fit the mesh, or weight and in-situ stress
            contradict each other at the start values.
        ModelError: the model moves freely somewhere.
    """
    case, elsewhere, path = inputs.case, inputs.case.elsewhere, inputs.loaded.mesh_path
    match elsewhere:
        case RunTable():
            return TableModel(case, elsewhere)
        case ConvergenceLaw():
            return LawModel(case, elsewhere)
        case SettlementLaw():
            return SettlementModel(case, elsewhere)
        case SeasonalModel():
            return SeasonalReadings(case)
        case ExternalProgram():
            runs = ProgramRuns(case, elsewhere, runs_folder(inputs.path), again=fresh)
            return ProgramModel(case, runs)
        case PythonFunction():
            calls = FunctionRuns(case, elsewhere, runs_folder(inputs.path), again=fresh)
            return ProgramModel(case, calls)
    if path is None:
        return opening_model(case)
    make = staged_model if case.service is None else service_model
    model = make(load_mesh(inputs, path), case, solver=pick_solver(solver))
    if faults := model.contradictions():
        raise InputError(faults)
    return model


def start_values(case: Case, model: ObservedModel) -> Floats:
    """The start values (n,) of the parameters, SI.

    Raises:
        ModelError: they are outside the domain of the model.
    """
    p = np.array([parameter.start for parameter in case.parameters], dtype=np.float64)
    reason = model.admissible(p)
    if reason is not None:
        raise ModelError(f"The start values are outside the domain of the model: {reason}")
    return p


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
        begun: the checkpoint is of this very command, whose process was lost; it is gone on from,
            though all is computed again.
        text: of the case where it stands in no file.
        reduced: path of a result whose reduced model is to be asked first; None for none.
    """

    case: str
    overrides: tuple[str, ...] = ()
    output: str | None = None
    seed: int = 0
    solver: str = "auto"
    force: bool = False
    fresh: bool = False
    begun: bool = False
    text: str | None = None
    reduced: str | None = None


@dataclass(frozen=True, kw_only=True)
class Planned:
    """A request that was read, and whose output may be written.

    Args:
        request: what was asked for.
        command: its name.
        place: of the result.
        identity: hash of everything that the result depends on.
        existing: what stands at the place of the result.
        stamp: of the files as they were read, see `outputs.stamp`.
        started: when it was planned, by the clock that counts seconds.
    """

    request: Request
    command: str
    place: Target
    identity: str
    existing: Existing
    stamp: str = ""
    started: float = field(default_factory=time.monotonic)

    @property
    def up_to_date(self) -> bool:
        """The result stands there already and is to be kept."""
        return self.existing is Existing.UP_TO_DATE and not self.request.fresh


@dataclass(frozen=True)
class Earlier:
    """A fit that goes before that of a job.

    Args:
        values: its parameters by name, SI, where the search begins.
        ended: its search ended there, and was not cut short.
        joined: makes of the result of the job that which is written, with what went before.
    """

    values: Mapping[str, float]
    ended: bool
    joined: Callable[[Result], Result]


@dataclass(frozen=True, kw_only=True)
class Job(Planned):
    """A case that is to be computed.

    Args:
        methods: the identifiers to run, one after the other.
        inputs: the case.
        earlier: the fit that this one brings up to date; None for none.
    """

    methods: tuple[MethodOptions, ...]
    inputs: Inputs
    earlier: Earlier | None = None

    def joined(self, result: Result) -> Result:
        """A result with what an earlier fit has left to it."""
        return result if self.earlier is None else self.earlier.joined(result)


def plan_fit(request: Request) -> Job:
    """Read a case that is to be fitted, and look at what stands where its result goes.

    Args:
        request: what to do.

    Raises:
        InputError: the case is wrong.
        OutputError: the result could not be written, or another one would be lost.
    """
    return _plan(request, "fit")


def plan_backtest(request: Request) -> Job:
    """The same for a case that is to be fitted to ever more of its stages."""
    return _plan(request, "backtest")


def plan_scan(request: Request) -> Job:
    """The same for a case that is to be scanned: its method is replaced by a scan.

    The grid is that of the case's ``fit.scan`` if it is written.
    """
    return _plan(request, "scan", "fit.method=scan")


def require_stages(case: Case) -> None:
    """Refuse to go stage by stage where a structure is in service on its mesh.

    Raises:
        InputError: it is.
    """
    if case.service is None:
        return
    message = "the readings of a structure in service have dates, not stages"
    hint = f"{Term.FIT} fits it, and judges the readings after 'fit.until'. Without 'service' and "
    hint += "its loads the stages are computed."
    raise InputError([case.source.fault(("service",), "no-stages", message, hint)])


def _plan(request: Request, command: str, *further: str) -> Job:
    """Plan a command on a case with further overrides."""
    overrides = [*request.overrides, *further]
    try:
        inputs = load_inputs(request.case, overrides=overrides, text=request.text)
    except InputError:
        # what is wrong with the case itself is said first, and what is in service refused as such
        inputs = load_inputs(request.case, overrides=request.overrides, text=request.text)
        require_stages(inputs.case)
        if not isinstance(inputs.case.elsewhere, SeasonalModel):
            raise
    case = inputs.case
    if command != "fit":
        require_stages(case)
    if isinstance(case.elsewhere, SeasonalModel):
        if command != "fit":
            message = "a seasonal model has coefficients of each gauge, and no parameters"
            hint = f"{Term.FIT} fits it, and judges the readings after 'fit.until'."
            raise InputError([case.source.fault(("model",), "no-parameters", message, hint)])
    elif not case.parameters and not case.fields:
        message = f"there are no parameters, so there is nothing to {command}"
        hint = f"Write what is unknown under 'parameters'; {Term.SIMULATE} needs none."
        written = case.source.locate(("parameters",))
        raise InputError([Fault("no-parameters", message, hint, written, "parameters")])
    methods = case.fit.methods
    identity = inputs.identity(command, methods, seed=request.seed)
    place = target(request.case, command, output=request.output)
    in_file = request.text is None and request.case != STDIN
    job = Job(
        request=request,
        command=command,
        place=place,
        identity=identity,
        existing=existing(place, identity, kind=command, case=request.case),
        stamp=stamp(place.path.parent, inputs.files, command, request.overrides, request.seed)
        if in_file
        else "",
        methods=tuple(methods),
        inputs=inputs,
    )
    if not job.up_to_date:
        require_free(job.existing, place, force=request.force, inputs=inputs.files)
    return job


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


def of_fit(origin: Provenance, fit: Result, path: str, output: Path) -> Provenance:
    """A provenance with the fit that a result was made from.

    Args:
        origin: the provenance.
        fit: the fit.
        path: of its file.
        output: path of the result.
    """
    seen = seen_from(output.parent, path)
    return replace(origin, fit_file=seen, fit_fingerprint=fit.fingerprint)


def job_provenance(job: Job) -> Provenance:
    """The provenance of the result of a job."""
    origin = provenance(
        job.inputs,
        command=job.command,
        identity=job.identity,
        seed=job.request.seed,
        output=job.place.path,
    )
    return replace(origin, seconds=time.monotonic() - job.started, stamp=job.stamp)
