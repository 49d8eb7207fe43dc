"""Everything that geoident refuses or cannot do, and the exit code that says so.

The command line turns each of these into a message on stderr and the exit code; nothing
else ends a command. Codes are those of the table in README ("Exit codes").
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum


class ExitCode(IntEnum):
    """What a finished command says to the shell."""

    DONE = 0
    BUG = 1
    USAGE = 2
    INVALID_INPUT = 3
    NOT_CONVERGED = 4
    NO_SOLUTION = 5
    OUTPUT = 6
    SOME_FAILED = 7
    INTERRUPTED = 130
    TERMINATED = 143


@dataclass(frozen=True, order=True)
class Location:
    """A place in a file, counted from 1. Line 0 means the file as a whole.

    Args:
        file: its path.
        line: of a text, or row of a sheet.
        column: of a text in characters, or of a sheet in columns.
        sheet: name of the sheet of a workbook; empty for a text.

    >>> str(Location("site.csv", 7, 2)), str(Location("site.xlsx", 7, 2, "Points"))
    ('site.csv:7:2', 'site.xlsx:Points!B7')
    """

    file: str
    line: int = 0
    column: int = 0
    sheet: str = ""

    def __str__(self) -> str:
        if self.sheet:
            return f"{self.file}:{self.sheet}{f'!{self.cell}' if self.line else ''}"
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file

    @property
    def cell(self) -> str:
        """The place as a sheet names it: ``B7``.

        >>> Location("", 7, 28, "Points").cell
        'AB7'
        """
        letters, rest = "", self.column
        while rest > 0:
            rest, letter = divmod(rest - 1, 26)
            letters = chr(ord("A") + letter) + letters
        return f"{letters}{self.line}"


@dataclass(frozen=True)
class Fault:
    """One thing wrong with the input.

    Args:
        code: short stable name of the kind of fault, such as ``missing-group``.
        message: what was found and what was expected, one sentence.
        hint: the likely remedy, or empty.
        location: file, line and column.
        path: the path of the key in the case, such as ``stages[1].excavate[0]``.
    """

    code: str
    message: str
    hint: str = ""
    location: Location = Location("")
    path: str = ""

    def __str__(self) -> str:
        place = f"{self.location}: " if self.location.file else ""
        path = f"{self.path}: " if self.path else ""
        hint = f"\n    {self.hint}" if self.hint else ""
        return f"{place}{path}{self.message}{hint}"


class GeoidentError(Exception):
    """Root of all errors that geoident raises on purpose."""

    exit_code: ExitCode = ExitCode.BUG


class UsageError(GeoidentError):
    """The flags of a command do not fit together."""

    exit_code = ExitCode.USAGE


class InputError(GeoidentError):
    """The case, its mesh or its readings are wrong: carries all faults found at once."""

    exit_code = ExitCode.INVALID_INPUT

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


class ModelError(GeoidentError):
    """The model has no solution: a mechanism, a singular matrix, a collapse.

    Args:
        message: what was found, one sentence.
        hint: the likely remedy, or empty.
        location: the place in the case that it comes from, if one is known.
        path: the path of the key there.
    """

    exit_code = ExitCode.NO_SOLUTION

    def __init__(
        self, message: str, hint: str = "", *, location: Location = Location(""), path: str = ""
    ) -> None:
        self.message = message
        self.hint = hint
        self.fault = Fault("no-solution", message, hint, location, path)
        super().__init__(str(self.fault))


class CollapseError(ModelError):
    """The ground cannot carry the loads of a stage (plastic collapse).

    Args:
        message: what was found, one sentence.
        hint: the likely remedy, or empty.
        stage: name of the stage.
        fraction: part of the change of load of that stage that can be carried, 0 to 1; NaN where
            it was not computed.
    """

    def __init__(self, message: str, hint: str = "", *, stage: str, fraction: float) -> None:
        self.stage = stage
        self.fraction = fraction
        super().__init__(message, hint)


class OutputError(GeoidentError):
    """An output exists already, or cannot be written."""

    exit_code = ExitCode.OUTPUT


class Interrupted(GeoidentError):
    """The user stopped the run; what was computed is in a checkpoint."""

    exit_code = ExitCode.INTERRUPTED

    def __init__(self, message: str, *, exit_code: ExitCode = ExitCode.INTERRUPTED) -> None:
        self.exit_code = exit_code
        super().__init__(message)
