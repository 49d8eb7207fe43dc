"""Several cases on a cluster: what a case reads travels there, what it writes comes back."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from geoident.cli.options import Options
from geoident.cli.trust import asked
from geoident.errors import InputError
from geoident.forward.external.program import ProgramModel
from geoident.io.mesh.file import mesh_files
from geoident.io.text.atomic import atomic_output, make_folder
from geoident.io.text.named_files import named_files
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
from geoident.model.cluster import Cluster
from geoident.model.external import ExternalProgram, PythonFunction
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import Converted, Executor
from geoident.workflow.executing.parcel import packed
from geoident.workflow.programs.program import program_of
from geoident.workflow.programs.travelling import (
    TravellingAnswer,
    TravellingTask,
    begun_with,
    known_logs,
)
from geoident.workflow.running.jobs import build_model, load_inputs
from geoident.workflow.running.outputs import kept_results, runs_folder, target

E = TypeVar("E")


@dataclass(frozen=True)
class RunCase:
    """A case whose model is run.

    Args:
        model: that it names.
        permitted: `Execution.portable` of it; empty where nobody has said that it may be run.
    """

    model: ExternalProgram | PythonFunction
    permitted: str


@dataclass(frozen=True)
class AwayCase(TravellingTask):
    """A case on its way to a worker.

    Args:
        kept: path to content of the files with which it goes on.
        runs: folder of the runs of its model; empty where that runs nothing.
        case: its path.
        beside: path to content of files of earlier results, which decide what is done.
        evaluations: path of its checkpoint.
    """

    case: str
    beside: Mapping[str, bytes]
    evaluations: str

    @property
    def checkpoint(self) -> str:
        """Path of its evaluations."""
        return self.evaluations


class AwayCases(Converted[str, AwayCase, E, TravellingAnswer[E]]):
    """An executor of cases that has them computed on a cluster, and writes what comes back.

    Args:
        executor: computes on other machines.
        command: of the cases.
        options: of the command.
        run: cases whose model is run.
    """

    def __init__(
        self,
        executor: Executor[AwayCase, TravellingAnswer[E]],
        command: str,
        options: Options,
        run: Collection[str] = (),
    ) -> None:
        def sent(case: str) -> AwayCase:
            place = target(case, command, output=options.output)
            beside = {str(path): b"" for _, path in kept_results(place.path)}  # their names count
            with suppress(OSError):
                beside[str(place.path)] = place.path.read_bytes()
            runs = str(runs_folder(case)) if case in run else ""
            return AwayCase({}, runs, case, beside, str(place.checkpoint)).going_on()

        super().__init__(executor, sent, _written)


def _written(answer: TravellingAnswer[E]) -> E:
    """Write what has come of a case; how it ended.

    Raises:
        OutputError: a result cannot be written.
    """
    for name, content in answer.files.items():
        make_folder(Path(name).parent)
        with atomic_output(name, overwrite=True, inputs=()) as temporary:
            Path(temporary).write_bytes(content)
    answer.keep_runs()
    return answer.end


def cases_on(
    cluster: Cluster,
    cases: Sequence[str],
    options: Options,
    set_up: Callable[[], Callable[[str], E]],
    tell: Callable[[str], None],
    run: Mapping[str, RunCase] = MappingProxyType({}),
) -> DaskCluster[AwayCase, TravellingAnswer[E]]:
    """A cluster for several cases.

    Args:
        cluster: which one.
        cases: their paths, relative to where the command runs.
        options: of the command.
        set_up: gives, in a process there, the function that computes a case.
        tell: is told what people should know.
        run: the cases whose model is run.
    """
    of_models = [file for one in run.values() for file in one.model.inputs]
    programs = [name for one in run.values() for name in program_of(one.model)]
    named = (*(name for case in cases for name in _files(case)), *of_models)
    files = tuple(name for name in dict.fromkeys(named) if name not in programs)
    logs = known_logs(runs_folder(case) for case in run)
    outputs = [] if options.output is None else [options.output]
    return DaskCluster(
        cluster,
        partial(begun_with, logs, partial(set_up_cases, options.output, set_up)),
        packed(files, beside=(*cases, *outputs), programs=tuple(dict.fromkeys(programs))),
        jobs=min(options.jobs, len(cases)) if options.jobs else None,
        tell=tell,
    )


def _files(case: str) -> Iterator[str]:
    """A case and what it names; what cannot be read is told by whoever computes it."""
    if not Path(case).is_file():
        return
    yield case
    with suppress(InputError):
        text = decode(read_bytes(case, limit=MAX_BYTES, what="case"), case)
        for name in named_files(parse_yaml(text, case).data, Path(case).parent):
            yield from mesh_files(name)


def run_cases(cases: Sequence[str], options: Options) -> dict[str, RunCase]:
    """Cases whose model is run, and whether it may be; on a terminal that is asked.

    Args:
        cases: their paths; what is wrong with one is told by whoever computes it.
        options: of the command.
    """
    by_path: dict[str, RunCase] = {}
    for case in cases:
        with suppress(InputError):
            text = decode(read_bytes(case, limit=MAX_BYTES, what="case"), case)
            data = parse_yaml(text, case).data
            if not (isinstance(data, dict) and "model" in data):
                continue
            inputs = load_inputs(case, overrides=options.overrides)
            given = inputs.case.elsewhere
            model = build_model(inputs) if given is not None else None
            if isinstance(model, ProgramModel) and isinstance(
                given, ExternalProgram | PythonFunction
            ):
                by_path[case] = RunCase(given, "")
                with asked(trust=options.trust, as_json=options.as_json):
                    by_path[case] = RunCase(given, model.runs.require_trust())
    return by_path


def set_up_cases(
    output: str | None, set_up: Callable[[], Callable[[str], E]]
) -> Callable[[AwayCase], TravellingAnswer[E]]:
    """In a process far away: what computes a case, and takes what it writes.

    Args:
        output: folder for results, or None for beside the cases.
        set_up: gives the function that computes a case.
    """
    if output is not None:
        Path(output).mkdir(parents=True, exist_ok=True)
    compute = set_up()

    def compute_away(away: AwayCase) -> TravellingAnswer[E]:
        folder = Path(output) if output is not None else Path(away.case).parent
        folder.mkdir(parents=True, exist_ok=True)
        before = {path.name for path in folder.iterdir()} - {Path(away.checkpoint).name}
        for name, content in away.beside.items():
            Path(name).write_bytes(content)
        with away.begun() as made:
            end = compute(away.case)
        files = {}
        for path in sorted(folder.iterdir()):
            if path.name in before:
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
                continue
            content = path.read_bytes()
            if {**away.beside, **away.kept}.get(str(path)) != content:
                files[str(path)] = content
            path.unlink()
        return TravellingAnswer(end, files, away.runs, made)

    return compute_away
