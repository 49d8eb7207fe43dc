"""Several cases: one after the other or side by side, and one exit code for all."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import click

from geoident.cli.error_boundary import code_of
from geoident.cli.options import Options
from geoident.errors import ExitCode, GeoidentError

MILD = {ExitCode.DONE, ExitCode.NOT_CONVERGED}
STOPPED = (ExitCode.INTERRUPTED, ExitCode.TERMINATED)


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
            from geoident.report.text.json import dumps, failure_object

            click.echo(dumps(failure_object(error, case=case)))
        raise
