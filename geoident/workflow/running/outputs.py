"""Where results go, and whether what stands there already is to be kept.

A result of the same identity is up to date: it is not computed again. One of another identity is
the work of somebody: of the same case it is kept beside under a number (case.fit.1.h5), whatever
else it is stays where it is unless the user says so. A checkpoint beside a result tells that its
computation was cut short, so it is never up to date.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from geoident import __version__
from geoident.errors import OutputError, Term, UsageError
from geoident.io.result.file import FORMAT, ResultIdentity, read_identity
from geoident.io.result.vtkhdf import sidecar_path
from geoident.io.text.atomic import atomic_output, output_error, refuse_inputs
from geoident.io.text.text_file import STDIN, seen_from
from geoident.model.results.result import STOPPED
from geoident.workflow.programs.digest import known_sha256


class Existing(Enum):
    """What stands at the place of an output."""

    NOTHING = "nothing"
    UP_TO_DATE = "the same result"
    UNFINISHED = "the same result, cut short"
    OTHER = "a result of other input"
    FOREIGN = "a result of another case or command"
    UNKNOWN = "something that is not a result of geoident"


@dataclass(frozen=True)
class Target:
    """The place of an output and of its checkpoint.

    Args:
        path: of the result.
        checkpoint: of the log of evaluations, beside it.
        named: the user has named it, or its folder.
    """

    path: Path
    checkpoint: Path
    named: bool = False


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
    checkpoint = path.with_name(path.name.removesuffix(".h5") + ".checkpoint")
    return Target(path, checkpoint, named=output is not None)


def runs_folder(case: str) -> Path:
    """The folder of the runs of a model elsewhere.

    Args:
        case: path of the case; ``-`` for stdin.

    >>> runs_folder("site/case.yaml").as_posix()
    'site/case.runs'
    """
    beside = Path("stdin") if case == STDIN else Path(case)
    return beside.with_name(f"{_stem(beside)}.runs")


def _is_folder(output: str) -> bool:
    """Whether an output is an existing folder; raises where it can only be one and is none."""
    try:
        is_folder = Path(output).is_dir()
    except OSError as error:  # such as a name that is too long
        raise output_error(output, error) from error
    if not is_folder and output.endswith(("/", os.sep)):
        remedy = f"create it, or choose another place with {Term.OUTPUT}"
        raise OutputError(f"{output}: cannot be written: there is no such folder\n    {remedy}")
    return is_folder


def _stem(path: Path) -> str:
    """Name without its endings: of a case, or of a result made from one."""
    stem = path.name
    kinds = (".fit", ".scan", ".predict", ".sample", ".backtest", ".control", ".plan")
    for ending in (".h5", *kinds, ".yaml", ".yml"):
        stem = stem.removesuffix(ending)
    return stem or path.name


def existing(place: Target, identity: str, *, kind: str, case: str) -> Existing:
    """What stands at the place of the result that has this identity.

    Args:
        place: of the result.
        identity: hash of everything that it depends on.
        kind: of the result, such as ``fit``.
        case: path of its case; ``-`` for stdin.
    """
    if not place.path.exists():
        return Existing.NOTHING
    result = read_identity(place.path)
    if result is None:
        return Existing.UNKNOWN
    if result.identity != identity:
        return Existing.OTHER if _is_of(result, place, kind, case) else Existing.FOREIGN
    return Existing.UNFINISHED if place.checkpoint.exists() else Existing.UP_TO_DATE


def require_free(existing: Existing, place: Target, *, force: bool, inputs: Sequence[str]) -> None:
    """Try whether a result, its sidecar and its checkpoint may be written, before computing.

    Args:
        existing: what stands at the place.
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
    if not force and existing in (Existing.FOREIGN, Existing.UNKNOWN):
        raise OutputError(
            f"{place.path}: exists and holds {existing.value}; it is not overwritten\n"
            f"    {Term.FORCE} replaces it, {Term.OUTPUT} writes elsewhere"
        )
    with suppress(_Probe), atomic_output(place.path, overwrite=True, inputs=inputs):
        raise _Probe


# What was there before


KEPT = 9
"""Old results of one place that are kept at least; older ones go, unless they took `LONG`."""

LONG = 600.0
"""Seconds from which on a result is never removed."""


def _is_of(result: ResultIdentity, place: Target, kind: str, case: str) -> bool:
    """Whether a result is an earlier one of this command and case.

    Beside the case its name says so; where the user has named a place, the case in it does.
    """
    if result.kind != kind:
        return False
    if not place.named:
        return True
    ours = Path("stdin") if case == STDIN else Path(case)
    theirs = place.path.parent / result.case_file
    return os.path.realpath(theirs) == os.path.realpath(ours)


def set_aside(path: Path) -> tuple[Path, tuple[Path, ...]]:
    """Keep a result that is about to be replaced beside it, under the next number.

    It stays in its place as well until that is written, so that it is never gone.

    Args:
        path: of the result.

    Returns:
        Where it is kept, and what was removed for it.

    Raises:
        OutputError: it cannot be kept there.
    """
    final = _final(path)
    earlier = kept_results(final)
    number = 1 + (earlier[-1][0] if earlier else 0)
    aside = final.with_name(f"{final.stem}.{number}{final.suffix}")
    try:
        aside.hardlink_to(final)
    except (OSError, NotImplementedError):  # file systems without hard links, or just taken
        with atomic_output(aside, overwrite=False, inputs=()) as temporary:
            shutil.copyfile(final, temporary)
    return aside, _thinned([kept for _, kept in earlier])


def _final(path: Path) -> Path:
    """The file itself, where its name is a link."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def kept_results(path: Path) -> list[tuple[int, Path]]:
    """Earlier results of a place with their numbers, the oldest first."""
    final = _final(path)
    pattern = re.compile(re.escape(final.stem) + r"\.([1-9][0-9]*)" + re.escape(final.suffix))
    try:
        names = [entry.name for entry in final.parent.iterdir()]
    except OSError:
        return []
    matches = [(match, name) for name in names if (match := pattern.fullmatch(name))]
    return sorted((int(match[1]), final.with_name(name)) for match, name in matches)


def _thinned(earlier: Sequence[Path]) -> tuple[Path, ...]:
    """Remove the oldest of too many earlier results: none that took long, or has updates."""
    removed = []
    for path in earlier[: max(0, len(earlier) + 1 - KEPT)]:
        result = read_identity(path)
        lasting = result is None or "updates" in result.contents.split()
        if result is not None and not lasting and result.seconds < LONG:
            with suppress(OSError):
                path.unlink()
                removed.append(path)
    return tuple(removed)


def restore(place: Target, identity: str) -> tuple[Path, Path] | None:
    """Put an earlier result of the same input back in its place, and keep what stands there.

    Args:
        place: of the result.
        identity: hash of everything that it depends on.

    Returns:
        Where it was, and where what stood there is now; None if there is none of this input.

    Raises:
        OutputError: what stands there cannot be kept.
    """
    for _, path in reversed(kept_results(place.path)):
        result = read_identity(path)
        if result is not None and result.identity == identity and result.status != STOPPED:
            aside, _ = set_aside(place.path)
            try:
                path.replace(_final(place.path))
            except OSError as error:
                raise output_error(place.path, error) from error
            return path, aside
    return None


# Known to be up to date without reading a case


def stamp(
    folder: Path, files: Sequence[str], command: str, overrides: Sequence[str], seed: int
) -> str:
    """What a result is made from, by the bytes of its files.

    A result of the same stamp is up to date, and this is known in a hundredth of the time that it
    takes to read its case; one of another stamp may be up to date nonetheless.

    Args:
        folder: of the result.
        files: paths of the case and of all files that it names.
        command: its name.
        overrides: overrides.
        seed: of random numbers.

    Returns:
        JSON; empty where a file cannot be read.
    """
    sums = {seen_from(folder, path): known_sha256(path) for path in files}
    if "" in sums.values():
        return ""
    return json.dumps({**_made_by(command, overrides, seed), "files": sums}, sort_keys=True)


def known(
    case: str, command: str, *, output: str | None, overrides: Sequence[str], seed: int
) -> tuple[Target, ResultIdentity] | None:
    """Where the result of a case stands, if its stamp says that it is up to date.

    Args:
        case: path of the case.
        command: its name.
        output: a file, an existing folder, or None for beside the case.
        overrides: overrides.
        seed: of random numbers.
    """
    place = target(case, command, output=output)
    result = read_identity(place.path) if place.path.exists() else None
    if result is None or not result.stamp or result.kind != command or place.checkpoint.exists():
        return None
    stands = json.loads(result.stamp)
    sums, folder = stands.pop("files"), place.path.parent
    if stands != _made_by(command, overrides, seed) or seen_from(folder, case) not in sums:
        return None
    same = all(known_sha256(folder / name) == expected for name, expected in sums.items())
    return (place, result) if same else None


def _made_by(command: str, overrides: Sequence[str], seed: int) -> dict[str, object]:
    own = {"version": __version__, "format": FORMAT}
    return {**own, "command": command, "overrides": list(overrides), "seed": seed}


class _Probe(Exception):
    """Ends a trial of writing before anything is put in place."""
