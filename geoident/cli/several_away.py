"""Several cases on a cluster: what a case reads travels there, what it writes comes back."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

from geoident.cli.options import Options
from geoident.errors import InputError
from geoident.io.case.file import named_files
from geoident.io.mesh.file import mesh_files
from geoident.io.text.atomic import atomic_output, make_folder
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
from geoident.model.cluster import Cluster
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import Answered, Executor
from geoident.workflow.executing.parcel import layout_of, own_copy, packed
from geoident.workflow.running.outputs import kept_results, target

E = TypeVar("E")

_RUNS = ".runs"
"""Ending of folders of runs of a model elsewhere, which do not travel."""


@dataclass(frozen=True)
class AwayCase:
    """A case on its way to a worker.

    Args:
        case: its path.
        beside: path to content of files of earlier results, which decide what is done.
    """

    case: str
    beside: Mapping[str, bytes]


@dataclass(frozen=True)
class AwayOutput(Generic[E]):
    """What has come of a case.

    Args:
        end: how it ended.
        files: path to content of what it has written.
    """

    end: E
    files: Mapping[str, bytes]


class AwayCases(Generic[E]):
    """An executor of cases that has them computed on a cluster, and writes what comes back.

    Args:
        executor: computes on other machines.
        command: of the cases.
        options: of the command.
    """

    def __init__(
        self, executor: Executor[AwayCase, AwayOutput[E]], command: str, options: Options
    ) -> None:
        self._executor, self._command, self._options = executor, command, options

    def run(self, tasks: Iterable[str]) -> Iterator[Answered[E]]:
        """How cases end; their files are written then.

        Args:
            tasks: paths of the cases.

        Raises:
            OutputError: a result cannot be written.
        """
        for answer in self._executor.run(map(self._sent, tasks)):
            output = answer.value
            for name, content in output.files.items() if output else ():
                make_folder(Path(name).parent)
                with atomic_output(name, overwrite=True, inputs=()) as temporary:
                    Path(temporary).write_bytes(content)
            end = None if output is None else output.end
            yield Answered(
                answer.number, end, answer.losses, answer.stopped, answer.seconds, answer.process
            )

    def _sent(self, case: str) -> AwayCase:
        place = target(case, self._command, output=self._options.output)
        beside = {str(path): b"" for _, path in kept_results(place.path)}  # their names count
        for path in (place.path, place.checkpoint):
            with suppress(OSError):
                beside[str(path)] = path.read_bytes()
        return AwayCase(case, beside)

    def ask_to_stop(self) -> None:
        """Begin no more cases, and let those that run end as soon as they can."""
        self._executor.ask_to_stop()

    def kill(self) -> None:
        """End all cases at once."""
        self._executor.kill()


def cases_on(
    cluster: Cluster,
    cases: Sequence[str],
    options: Options,
    set_up: Callable[[], Callable[[str], E]],
    tell: Callable[[str], None],
) -> DaskCluster[AwayCase, AwayOutput[E]]:
    """A cluster for several cases.

    Args:
        cluster: which one.
        cases: their paths, relative to where the command runs.
        options: of the command.
        set_up: gives, in a process there, the function that computes a case.
        tell: is told what people should know.
    """
    files = tuple(dict.fromkeys(name for case in cases for name in _files(case)))
    outputs = [] if options.output is None else [options.output]
    layout = layout_of((*cases, *files, *outputs))
    return DaskCluster(
        cluster,
        partial(set_up_cases, layout.here, options.output, set_up),
        packed({layout.name(path): Path(path) for path in files}),
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


def set_up_cases(
    here: str,
    output: str | None,
    set_up: Callable[[], Callable[[str], E]],
    unpacked: Path,
) -> Callable[[AwayCase], AwayOutput[E]]:
    """In a process far away: what computes a case, and takes what it writes.

    Args:
        here: where paths are meant from, as seen from the folder of the files.
        output: folder for results, or None for beside the cases.
        set_up: gives the function that computes a case.
        unpacked: folder of the files.
    """
    own_copy(unpacked, here)
    if output is not None:
        Path(output).mkdir(parents=True, exist_ok=True)
    compute = set_up()

    def compute_away(away: AwayCase) -> AwayOutput[E]:
        folder = Path(output) if output is not None else Path(away.case).parent
        folder.mkdir(parents=True, exist_ok=True)
        before = {path.name for path in folder.iterdir()}
        for name, content in away.beside.items():
            Path(name).write_bytes(content)
        end = compute(away.case)
        files = {}
        for path in sorted(folder.iterdir()):
            if path.name in before:
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
                continue
            content = path.read_bytes()
            if away.beside.get(str(path)) != content:
                files[str(path)] = content
            path.unlink()
        return AwayOutput(end, files)

    return compute_away
