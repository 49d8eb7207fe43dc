"""Where results go, and whether what stands there already is to be kept.

A result of the same identity is up to date: it is not computed again. One of another identity is
the work of somebody, and is not overwritten unless the user says so. A checkpoint beside a result
tells that its computation was cut short, so it is never up to date.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from geoident.errors import OutputError, Term, UsageError
from geoident.io.result.file import read_identity
from geoident.io.result.vtkhdf import sidecar_path
from geoident.io.text.atomic import atomic_output, output_error, refuse_inputs
from geoident.io.text.text_file import STDIN


class Standing(Enum):
    """What stands at the place of an output."""

    NOTHING = "nothing"
    UP_TO_DATE = "the same result"
    UNFINISHED = "the same result, cut short"
    OTHER = "a result of other input"
    UNKNOWN = "something that is not a result of geoident"


@dataclass(frozen=True)
class Target:
    """The place of an output and of its checkpoint.

    Args:
        path: of the result.
        checkpoint: of the log of evaluations, beside it.
    """

    path: Path
    checkpoint: Path


def target(case: str, kind: str, *, output: str | None = None) -> Target:
    """The place of the result of a command.

    Args:
        case: path of the case or of a result that the name is made from; ``-`` for stdin.
        kind: of the result, such as ``fit``.
        output: a file, an existing folder, or None for beside the case.

    Raises:
        UsageError: it would be stdout.

    >>> target("cases/cavern/case.yaml", "fit").path.as_posix()
    'cases/cavern/case.fit.h5'
    """
    beside = Path("stdin") if case == STDIN else Path(case)
    name = f"{_stem(beside)}.{kind}.h5"
    if output == STDIN:
        msg = f"A result cannot be written to stdout: give a file or a folder to {Term.OUTPUT}."
        raise UsageError(msg)
    if output is None:
        path = beside.with_name(name)
    else:
        path = Path(output) / name if _is_folder(output) else Path(output)
    return Target(path, path.with_name(path.name.removesuffix(".h5") + ".checkpoint"))


def _is_folder(output: str) -> bool:
    """Whether an output is an existing folder; raises where it can only be one and is none."""
    try:
        found = Path(output).is_dir()
    except OSError as error:  # such as a name that is too long
        raise output_error(output, error) from error
    if not found and output.endswith(("/", os.sep)):
        remedy = f"create it, or choose another place with {Term.OUTPUT}"
        raise OutputError(f"{output}: cannot be written: there is no such folder\n    {remedy}")
    return found


def _stem(path: Path) -> str:
    """Name without its endings: of a case, or of a result made from one."""
    stem = path.name
    kinds = (".fit", ".scan", ".predict", ".sample", ".backtest")
    for ending in (".h5", *kinds, ".yaml", ".yml"):
        stem = stem.removesuffix(ending)
    return stem or path.name


def standing(place: Target, identity: str) -> Standing:
    """What stands at the place of the result that has this identity."""
    if not place.path.exists():
        return Standing.NOTHING
    found = read_identity(place.path)
    if found is None:
        return Standing.UNKNOWN
    if found.identity != identity:
        return Standing.OTHER
    return Standing.UNFINISHED if place.checkpoint.exists() else Standing.UP_TO_DATE


def require_free(found: Standing, place: Target, *, force: bool, inputs: Sequence[str]) -> None:
    """Try whether a result, its sidecar and its checkpoint may be written, before computing.

    Args:
        found: what stands at the place.
        place: of the output.
        force: what stands there may be replaced if it is no input.
        inputs: paths that are read, and so must not be written.

    Raises:
        OutputError: one of them is an input, somebody's work would be lost, or the place cannot be
            written.
    """
    sidecar = sidecar_path(place.path)
    for path in (place.path, place.checkpoint, *([] if sidecar is None else [sidecar])):
        refuse_inputs(path, inputs)
    if not force and found in (Standing.OTHER, Standing.UNKNOWN):
        raise OutputError(
            f"{place.path}: exists and holds {found.value}; it is not overwritten\n"
            f"    {Term.FORCE} replaces it, {Term.OUTPUT} writes elsewhere"
        )
    with suppress(_Probe), atomic_output(place.path, overwrite=True, inputs=inputs):
        raise _Probe


def write_text(text: str, path: str, *, force: bool, inputs: Sequence[str]) -> None:
    """Write a text file, whole or not at all, and never over one of the inputs.

    Args:
        text: of the file.
        path: of the file.
        force: replace another file.
        inputs: paths that are read, and so must not be written.
    """
    write_bytes(text.encode(), path, force=force, inputs=inputs)


def write_bytes(content: bytes, path: str, *, force: bool, inputs: Sequence[str]) -> None:
    """Write a binary file, whole or not at all, and never over one of the inputs.

    Args:
        content: of the file.
        path: of the file.
        force: replace another file.
        inputs: paths that are read, and so must not be written.
    """
    with atomic_output(path, overwrite=force, inputs=inputs) as temporary:
        Path(temporary).write_bytes(content)


class _Probe(Exception):
    """Ends a trial of writing before anything is put in place."""
