"""Steps that make sense after a command: it names them, and they are said on stderr at its end."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence

from geoident.cli.options import Next, Options, Steps


def line(command: str, *words: str) -> str:
    """A command line of geoident as a shell takes it.

    >>> line("fit", "my case.yaml")
    "geoident fit 'my case.yaml'"
    """
    return shlex.join(["geoident", command, *words])


def always(*steps: str) -> Next:
    """The same steps, whatever the command was given."""
    return lambda arguments, options: steps


def new_name(stem: str, suffix: str) -> str:
    """The name of a file that is not there: what is proposed must not be refused, or do harm."""
    from itertools import count
    from pathlib import Path

    names = (f"{stem}{'' if n == 1 else f'-{n}'}{suffix}" for n in count(1))
    return next(name for name in names if not Path(name).exists())


def on_result(result: str, *others: str) -> Steps:
    """Commands that take a result: ``show``, ``report``, and others."""
    return tuple(line(command, result) for command in ("show", "report", *others))


def result_of(kind: str, case: str, options: Options) -> str:
    """The path of the result that a command has written.

    Args:
        kind: the command.
        case: what it was run on.
        options: the shared options.
    """
    from geoident.workflow.running.outputs import target

    return str(target(case, kind, output=options.output).path)


def overrides(options: Options) -> Steps:
    """The words of a command line that change the case in the same way."""
    return tuple(word for change in options.overrides for word in ("--set", change))


def for_one(items: Sequence[str], steps: Callable[[str], Steps]) -> Steps:
    """Steps for the only item; none for several, of which each would need its own."""
    return steps(items[0]) if len(items) == 1 else ()
