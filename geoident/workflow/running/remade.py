"""Pages, pictures and tables: what geoident makes of a case or of its results, again and again.

Somebody who edits a case, fits and reports goes round in a circle. So what geoident made itself,
and nobody changed, gives way to what it makes of the same case now: the old page can be made again
from the result that `outputs.set_aside` has kept. What geoident did not make, what was edited, and
what is of another case stays, and the user is told which of these it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from geoident.errors import OutputError, Term, UsageError
from geoident.io.text.atomic import atomic_output, refuse_inputs
from geoident.io.text.mark import CaseOrigin, marked, origin_of, read_mark
from geoident.io.text.text_file import STDIN
from geoident.workflow.running.outputs import set_aside


def place_of_page(output: str | None, beside: Path) -> Path:
    """Where a page goes.

    Args:
        output: a file, an existing folder, or None for beside what it is made of.
        beside: the page there; its name is that of the page in a folder, too.

    Raises:
        UsageError: it would go to stdout.
    """
    if output == STDIN:
        msg = f"A page cannot be written to stdout: give a file or a folder to {Term.OUTPUT}."
        raise UsageError(msg)
    place = beside if output is None else Path(output)
    return place / beside.name if place.is_dir() else place


def write_remade(
    contents: Mapping[str, bytes],
    *,
    cases: Sequence[str],
    force: bool,
    inputs: Sequence[str],
    form: str = "",
) -> None:
    """Write files with their marks; each takes the place of one that was made of the same case.

    One of the same content is left as it is. All places are looked at before anything is written.

    Args:
        contents: path of a file to what it holds, without a mark.
        cases: paths of the cases that they are made of.
        force: replace any other file, too.
        inputs: paths that are read, and so must not be written.
        form: of the files, of `mark.FORMATS`; by their endings if missing.

    Raises:
        OutputError: something else stands in one of the places, or one is an input.
    """
    new = {
        path: marked(content, form or _form(path), origin_of(cases, path))
        for path, content in contents.items()
    }
    old = {path: _present(path) for path in contents}
    replaced: dict[str, bool] = {}
    for path in contents:
        refuse_inputs(path, inputs)
        before = old[path]
        why = "" if before is None else foreign(before, form or _form(path), cases, path)
        if why and not force:
            raise _refused(path, why)
        replaced[path] = force or before is not None
    for path, content in new.items():
        if old[path] != content:
            with atomic_output(path, overwrite=replaced[path], inputs=inputs) as temporary:
                Path(temporary).write_bytes(content)


def _form(path: str) -> str:
    return path.rpartition(".")[2].lower()


def _present(path: str) -> bytes | None:
    """What a file holds; None where there is none, or where what stands there cannot be read."""
    try:
        return Path(path).read_bytes() if Path(path).is_file() else None  # a pipe never ends
    except OSError:
        return None  # writing says what is in the way


def foreign(content: bytes, form: str, cases: Sequence[str], path: str | Path) -> str:
    """Why a file is not to give way to one that is made of some cases; empty if it may.

    Args:
        content: of the file.
        form: of `mark.FORMATS`.
        cases: paths of the cases.
        path: of the file.
    """
    mark = read_mark(content, form)
    if mark is None:
        return "exists, and this version of geoident did not make it"
    if not mark.intact:
        return "was changed since geoident made it"
    if not mark.origin.shares(origin_of(cases, path)):
        return f"was made of another case ({_named(mark.origin)})"
    return ""


def _named(origin: CaseOrigin) -> str:
    return ", ".join(origin.names)


def _refused(path: str | Path, why: str) -> OutputError:
    return OutputError(
        f"{path}: {why}; it is not overwritten\n    {Term.FORCE} replaces it; or give another name"
    )


def write_readings(
    text: str, path: str, *, case: str, force: bool, inputs: Sequence[str]
) -> Path | None:
    """Write readings that were simulated, and say in the file that they were.

    Those of an earlier state of the case cannot be made again, so they are kept beside.

    Args:
        text: lines of readings.
        path: of the file.
        case: path of the case that they are of.
        force: replace any other file.
        inputs: paths that are read, and so must not be written.

    Returns:
        Where what stood there is kept; None if nothing had to be.

    Raises:
        OutputError: something else stands there, or the file cannot be written.
    """
    refuse_inputs(path, inputs)
    content = f"{text}# Simulated by geoident, not measured.\n"
    new = marked(content.encode(), "csv", origin_of([case], path))
    old = _present(path)
    if old == new:
        return None
    why = "" if old is None else foreign(old, "csv", [case], path)
    if why and not force:
        raise _refused(path, why)
    aside = set_aside(Path(path))[0] if old is not None and not force else None
    with atomic_output(path, overwrite=force or old is not None, inputs=inputs) as temporary:
        Path(temporary).write_bytes(new)
    return aside
