"""A table of variations: the first line names values of a case, each further line is a run."""

from __future__ import annotations

import re
from collections.abc import Sequence

from geoident.errors import Fault, InputError, Location
from geoident.io.schema.run_file import require_value_path
from geoident.io.text.cells import Cell, cells_of, delimiter_of, written_lines
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import Refusal, shorten
from geoident.model.run import Run

NAME_COLUMN = "run"
"""The column of a table, or the key of a row, that names runs."""

_MAX_BYTES = 50_000_000
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_+=,.@-]{0,79}")
_MOST_FAULTS = 100


def run_name_problem(name: str) -> str:
    """Why a name cannot be that of a run and of its files; empty if it can.

    >>> run_name_problem("stiff-1"), run_name_problem("a/b")
    ('', "'a/b' is not a name for a run")
    """
    return "" if _NAME.fullmatch(name) else f"'{shorten(name)}' is not a name for a run"


NAME_HINT = "Letters, digits and _ - + = , . @, not beginning with a point or a dash; 80 at most."


def read_table(path: str) -> list[Run]:
    """The runs of a table, without the case that they are of.

    Args:
        path: of a text with commas, semicolons or tabs between its cells, as its first line has
            them; lines that begin with ``#`` are remarks.

    Raises:
        InputError: with all faults, each with its line and column.
    """
    text = decode(read_bytes(path, limit=_MAX_BYTES, what="table of runs"), path)
    lines = list(written_lines(text))
    if not lines:
        hint = "The first line names values of the case, such as parameters.E.start."
        raise InputError([Fault("empty", "the table is empty", hint, Location(path))])
    delimiter = delimiter_of(lines[0][1])
    faults: list[Fault] = []
    header = cells_of(lines[0][1], delimiter)
    _check_header(header, path, lines[0][0], faults)
    runs = []
    for number, line in lines[1:]:
        cells = cells_of(line, delimiter)
        if len(cells) != len(header):
            message = f"found {len(cells)} cells; {len(header)} are expected, as in the header"
            hint = "Put quotes around a cell that holds the character between cells."
            faults.append(Fault("bad-row", message, hint, Location(path, number, 1)))
        else:
            runs.append(_run(header, cells, path, number))
        if len(faults) > _MOST_FAULTS:
            break
    if len(lines) == 1:
        hint = "Write one line a run."
        faults.append(Fault("empty", "there is no run", hint, Location(path, lines[0][0], 1)))
    if faults:
        raise InputError(faults)
    return runs


def _check_header(header: Sequence[Cell], path: str, line: int, faults: list[Fault]) -> None:
    seen: set[str] = set()
    for cell in header:
        place = Location(path, line, cell.column)
        if cell.text in seen:
            message = f"the column '{shorten(cell.text)}' is given twice"
            faults.append(Fault("duplicate-column", message, "Remove one of them.", place))
        seen.add(cell.text)
        try:
            require_value_path(cell.text)
        except Refusal as error:
            faults.append(Fault(error.code, error.message, error.hint, place))


def _run(header: Sequence[Cell], cells: Sequence[Cell], path: str, line: int) -> Run:
    """A run; its name is empty where the table does not give one."""
    filled = [(column.text, cell) for column, cell in zip(header, cells, strict=True) if cell.text]
    given = [(column, cell) for column, cell in filled if column != NAME_COLUMN]
    return Run(
        next((cell.text for column, cell in filled if column == NAME_COLUMN), ""),
        "",
        tuple((column, cell.text) for column, cell in given),
        tuple(Location(path, line, cell.column) for _, cell in given),
        Location(path, line, 1),
    )
