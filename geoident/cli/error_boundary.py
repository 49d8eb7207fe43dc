"""The one place where errors become messages on stderr and exit codes, one for several cases."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import click

from geoident.cli.options import Options
from geoident.errors import ExitCode, GeoidentError, InputError, ModelError

PIPE_CLOSED = 141
"""128 + SIGPIPE: what the shell reports of any program whose reader went away."""

_OUTPUT_ERRORS = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO}

MILD = {ExitCode.DONE, ExitCode.NOT_CONVERGED}
STOPPED = (ExitCode.INTERRUPTED, ExitCode.TERMINATED)


class PipeClosed(Exception):
    """Whoever read our output went away."""


def guarded(work: Callable[[], Any]) -> int:
    """Run a program and tell its exit code; what it says of errors goes to stderr."""
    try:
        code = work()
        sys.stdout.flush()
    except Exception as error:
        return code_of(error)
    except KeyboardInterrupt:
        return say_error("Interrupted.", ExitCode.INTERRUPTED)
    return int(code or ExitCode.DONE)


def code_of(error: Exception) -> int:
    """Say what happened; the exit code for it."""
    if isinstance(error, (PipeClosed, BrokenPipeError)):
        return _hush()
    if isinstance(error, click.Abort):
        return say_error("Interrupted.", ExitCode.INTERRUPTED)
    if isinstance(error, click.ClickException):
        with suppress(OSError):
            error.show()
        return error.exit_code if error.exit_code else ExitCode.USAGE
    if isinstance(error, GeoidentError):
        return say_geoident_error(error)
    return _code_of_system_error(error) if isinstance(error, OSError) else say_bug(error)


def _code_of_system_error(error: OSError) -> int:
    if error.errno == errno.ENAMETOOLONG:
        message = f"error: {error.filename}: {error.strerror}\n    choose a shorter name"
        return say_error(message, ExitCode.OUTPUT)
    if error.errno in _OUTPUT_ERRORS:
        _hush()
        return say_error(f"error: output: {error.strerror}", ExitCode.OUTPUT)
    return say_bug(error)


def say_geoident_error(error: GeoidentError) -> int:
    """An error that geoident raised on purpose."""
    if isinstance(error, InputError):
        count = len(error.faults)
        total = f"\n{count} faults" if count > 1 else ""
        return say_error(f"{error}{total}", error.exit_code)
    placed = isinstance(error, ModelError) and error.fault.location.file
    stopped = error.exit_code in (ExitCode.INTERRUPTED, ExitCode.TERMINATED)
    prefix = "" if placed or stopped else "error: "
    return say_error(f"{prefix}{error}", error.exit_code)


def say_bug(error: BaseException) -> int:
    """An error that nobody foresaw: the traceback goes to a file."""
    if isinstance(error, MemoryError):
        return say_error("error: out of memory; use a coarser mesh or fewer runs at a time", 1)
    kind = f"{type(error).__name__}: {error}".splitlines()[0]
    log = _write_log(error)
    where = f"The details are in {log}" if log else "The log of it could not be written"
    if type(error).__name__ == "LinAlgError":  # numpy's, which is perhaps not imported
        message = (
            "error: the equations of the problem cannot be solved with the precision of numbers"
        )
        remedy = "see whether units, exponents, bounds or accuracies are far from what is usual"
        return say_error(f"{message}\n    {remedy}. {where}.", ExitCode.NO_SOLUTION)
    message = f"error: a bug in geoident: {kind}\n    {where}; please report it with your case."
    return say_error(message, ExitCode.BUG)


def say_error(message: str, code: int) -> int:
    """A message on stderr; the exit code comes back."""
    with suppress(OSError):
        click.echo(message, err=True)
    return int(code)


def _write_log(error: BaseException) -> str | None:
    try:
        handle, path = tempfile.mkstemp(prefix="geoident-", suffix=".log")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(f"command: {sys.argv}\npython: {sys.version}\n\n")
            file.writelines(traceback.format_exception(error))
    except OSError:
        return None
    return path


def _hush() -> int:
    """Let nothing more be written to stdout, or Python would complain at its end."""
    with suppress(OSError, ValueError):
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, sys.stdout.fileno())
    return PIPE_CLOSED


def combined(codes: Sequence[int]) -> int:
    """The exit code of several cases; that of a single one is its own.

    >>> combined([0, 3]), combined([0, 4]), combined([3])
    (7, 4, 3)
    """
    if len(codes) == 1:
        return codes[0]
    for stopped in STOPPED:
        if stopped in codes:
            return int(stopped)
    if all(code in MILD for code in codes):
        return int(max(codes, default=ExitCode.DONE))
    return int(ExitCode.SOME_FAILED)


def each(items: Sequence[str], action: Callable[[str], int]) -> int:
    """Do something with every item in this process, however the others end."""
    if len(items) == 1:
        return action(items[0])
    return combined([_survive(action, item) for item in items])


def _survive(action: Callable[[str], int], item: str) -> int:
    try:
        return action(item)
    except (BrokenPipeError, click.ClickException):
        raise
    except Exception as error:
        return code_of(error)


@contextmanager
def failures_as_json(case: str, options: Options) -> Iterator[None]:
    """With ``--json``, a case that fails leaves an object on stdout as well."""
    try:
        yield
    except GeoidentError as error:
        if options.as_json:
            from geoident.report.text.json import dumps, failure_object  # noqa: PLC0415 - help must not wait for it

            click.echo(dumps(failure_object(error, case=case)))
        raise
