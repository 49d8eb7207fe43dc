"""Everything that geoident refuses or cannot do, and the exit code that says so.

The command line turns each of these into a message on stderr and the exit code; nothing
else ends a command. Codes are those of docs/commands.md.

Remedies are the same for all who call, their words are not: what is ``--force`` on a command line
is ``force=True`` in Python. A message therefore names such a thing by a `Term`; each caller is
told its own word (`worded`), that of the command line where nobody says otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


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
    ALARM = 8
    INTERRUPTED = 130
    TERMINATED = 143


class Caller(Enum):
    """Who is told of an error."""

    COMMAND_LINE = 0
    PYTHON = 1


class Term(Enum):
    """Something that a remedy names: its word on a command line, and its word in Python.

    >>> worded(f"{Term.FORCE} replaces it"), worded(f"{Term.FORCE} replaces it", Caller.PYTHON)
    ('--force replaces it', 'force=True replaces it')
    """

    FORCE = ("--force", "force=True")
    FRESH = ("--fresh", "fresh=True")
    CLUSTER = ("--cluster", "the cluster")
    READINGS = ("--readings", "readings=...")
    OUTPUT = ("-o", "output=...")
    FIELDS = ("--fields", "fields=...")
    TRUST = ("--trust", "`geoident.trust(case)`")
    TRUST_FILE = ("--trust", "`geoident.trust(file)`")
    OVERRIDES = ("--set", "overrides")
    OVERRIDE = ("--set path=value", 'overrides={"path": value}')
    OTHER_CASE = ("--case", "case=...")
    SAME_AGAIN = ("The same command", "The same call")
    COMMAND = ("command", "call")
    FIT = ("`geoident fit`", "`fit(case)`")
    INIT_FROM = ("`geoident init DIR --from MESH`", "the command `geoident init`")
    CONTROL = ("`geoident control FIT --readings NEW`", "`control(fit, readings=...)`")
    SIMULATE = ("`geoident simulate`", "`simulate(case)`")
    CANDIDATES = ("`geoident plan --candidates`", "`plan(candidates=...)`")
    WANTED = ("--for", "wanted")
    BUDGET = ("--budget", "budget")
    DRAWS = ("--draws 0", "draws=0")
    SAFETY = ("predict --safety", "safety")
    KEYS = ("`geoident schema`", "the page of keys (`geoident schema`)")

    def __str__(self) -> str:
        return f"\u27e6{self.name}\u27e7"


_TERM = re.compile("\u27e6([A-Z_]+)\u27e7")


def worded(text: str, caller: Caller = Caller.COMMAND_LINE) -> str:
    """A text with the terms in the words of who calls."""

    def word(found: re.Match[str]) -> str:
        name = found[1]
        return Term[name].value[caller.value] if name in Term.__members__ else found[0]

    return _TERM.sub(word, text)


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
        return worded(f"{place}{path}{self.message}{hint}")

    def worded_for(self, caller: Caller) -> Fault:
        """The same in the words of who calls."""
        place = replace(self.location, file=worded(self.location.file, caller))
        message, hint = worded(self.message, caller), worded(self.hint, caller)
        return replace(self, message=message, hint=hint, location=place)


class GeoidentError(Exception):
    """Root of all errors that geoident raises on purpose."""

    exit_code: ExitCode = ExitCode.BUG

    def __str__(self) -> str:
        return worded(super().__str__())

    def __reduce__(self) -> tuple[Any, ...]:
        # an error may come from another process; what made its message is not all kept
        return _restored, (type(self), self.args, self.__dict__.copy())

    def tell(self, caller: Caller) -> None:
        """Put the message in the words of who calls."""
        self.args = tuple(worded(part, caller) for part in self.args)


def _restored(
    kind: type[GeoidentError], args: tuple[Any, ...], state: dict[str, Any]
) -> GeoidentError:
    """An error as it was, of which only its parts have come."""
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(state)
    return error


class UsageError(GeoidentError):
    """The options of a command, or the arguments of a call, do not fit together."""

    exit_code = ExitCode.USAGE


class MissingExtra(UsageError, ImportError):
    """A package is asked for that comes with an extra of the installation."""


class InputError(GeoidentError):
    """The case, its mesh or its readings are wrong: carries all faults found at once."""

    exit_code = ExitCode.INVALID_INPUT

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))

    def tell(self, caller: Caller) -> None:
        """Put all faults in the words of who calls."""
        self.faults = tuple(fault.worded_for(caller) for fault in self.faults)
        self.args = ("\n".join(str(fault) for fault in self.faults),)


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

    def tell(self, caller: Caller) -> None:
        """Put message and remedy in the words of who calls."""
        self.fault = self.fault.worded_for(caller)
        self.message, self.hint = self.fault.message, self.fault.hint
        self.args = (str(self.fault),)


class TimeIsUp(ModelError):
    """The time that was given ended within an evaluation, so that there is no answer.

    A search takes it for a place without solution, and then ends, since its observer says so too.
    """


class CollapseError(ModelError):
    """The ground cannot carry the loads of a stage (plastic collapse).

    Args:
        message: what was found, one sentence.
        hint: the likely remedy, or empty.
        stage: name of the stage.
        fraction: part of the change of load of that stage that can be carried, 0 to 1; NaN where
            it was not computed.
        mechanism: (n_dofs,) velocities with which the ground moves then, the largest 1; None
            where they are not known.
        motion: the same on its mesh (`geoident.model.results.yielded.Mechanism`), to be drawn;
            None where it is not known. It does not leave its process.
        reached: the last equilibrium that was found on the way to the load
            (`geoident.forward.analysis.stage.LastEquilibrium`), or None; it stays there, too.
        proven: whether no equilibrium exists; else none was found.
    """

    def __init__(
        self,
        message: str,
        hint: str = "",
        *,
        stage: str,
        fraction: float,
        mechanism: npt.NDArray[np.float64] | None = None,
        motion: object = None,
        reached: object = None,
        proven: bool = False,
    ) -> None:
        self.stage = stage
        self.proven = proven
        self.fraction = fraction
        self.mechanism = mechanism
        self.motion = motion
        self.reached = reached
        super().__init__(message, hint)

    def __reduce__(self) -> tuple[Any, ...]:
        made, (kind, args, known) = super().__reduce__()
        return made, (kind, args, {**known, "motion": None, "reached": None})

    def add(self, sentence: str) -> None:
        """Add a sentence to the remedy."""
        self.hint = f"{self.hint}\n    {sentence}" if self.hint else sentence
        self.fault = replace(self.fault, hint=self.hint)
        self.args = (str(self.fault),)


class OutputError(GeoidentError):
    """An output exists already, or cannot be written."""

    exit_code = ExitCode.OUTPUT


class LostCluster(GeoidentError):
    """The scheduler of a cluster has gone, and did not come back; what had ended is kept.

    Args:
        address: of the scheduler.
        seconds: that it was waited for.
    """

    exit_code = ExitCode.SOME_FAILED

    def __init__(self, address: str, seconds: float) -> None:
        super().__init__(
            f"{address}: the scheduler of the cluster was lost, and did not return within "
            f"{seconds:g} s\n    what has ended is kept. {Term.SAME_AGAIN} continues with the rest."
        )


class Interrupted(GeoidentError):
    """The user stopped the run; what was computed is in a checkpoint."""

    exit_code = ExitCode.INTERRUPTED

    def __init__(self, message: str, *, exit_code: ExitCode = ExitCode.INTERRUPTED) -> None:
        self.exit_code = exit_code
        super().__init__(message)
