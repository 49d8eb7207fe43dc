"""What to do next: every command says it on stderr when it is done."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from geoident.errors import ExitCode

if TYPE_CHECKING:
    from geoident.cli.options import Options

Given = Mapping[str, Any]
Steps = tuple[str, ...]
Next = Callable[[Given, "Options"], Steps]
"""From a command's own parameters and the shared options to steps: commands or sentences."""


def say_next(command: str, given: Given, options: Options, code: int) -> None:
    """Say which steps make sense after a command; not with ``-q`` or ``--json``, nor after errors.

    Args:
        command: its name.
        given: its parameters by their names.
        options: the shared options.
        code: its exit code.
    """
    if options.quiet or options.as_json or code not in (ExitCode.DONE, ExitCode.NOT_CONVERGED):
        return
    steps = NEXT[command](given, options) if command in NEXT else ()
    if steps:
        with suppress(OSError):
            click.echo("\nNext:\n" + "\n".join(f"    {step}" for step in steps), err=True)


def line(command: str, *words: str) -> str:
    """A command line of geoident as a shell takes it.

    >>> line("fit", "my case.yaml")
    "geoident fit 'my case.yaml'"
    """
    return shlex.join(["geoident", command, *words])


def _after_init(given: Given, options: Options) -> Steps:
    from pathlib import Path

    case = str(Path(given["folder"]) / "case.yaml")
    if given["mesh"] is not None:
        return f"replace every FILL_IN in {shlex.quote(case)}", line("check", case)
    return line("check", case), line("fit", case)


def _after_check(given: Given, options: Options) -> Steps:
    return _for_one(given["cases"], lambda case: (line("fit", case, *_changes(options)),))


def _after_simulate(given: Given, options: Options) -> Steps:
    case, file = given["case"], options.output
    if file in (None, "-"):
        return (line("simulate", case, *_changes(options), "-o", _new_name("simulated", ".csv")),)
    return (line("fit", case, "--set", f"readings={_seen_from(case, file)}"),)


def _after_fit(given: Given, options: Options) -> Steps:
    if options.dry_run:
        return _for_one(given["cases"], lambda case: (line("fit", case, *_changes(options)),))
    return _for_one(given["cases"], lambda case: _look_at(_result("fit", case, options), "predict"))


def _after_predict(given: Given, options: Options) -> Steps:
    return _look_at(_result("predict", given["result"], options))


def _after_scan(given: Given, options: Options) -> Steps:
    if options.dry_run:
        return (line("scan", given["case"], *_changes(options)),)
    return line("show", _result("scan", given["case"], options)), line("fit", given["case"])


def _after_show(given: Given, options: Options) -> Steps:
    return line("report", *given["results"]), line("export", *given["results"])


def _new_name(stem: str, suffix: str) -> str:
    """The name of a file that is not there: what is proposed must not be refused, or do harm."""
    from itertools import count
    from pathlib import Path

    names = (f"{stem}{'' if n == 1 else f'-{n}'}{suffix}" for n in count(1))
    return next(name for name in names if not Path(name).exists())


def _seen_from(case: str, file: str) -> str:
    """A path as a case names it."""
    import os
    from pathlib import Path

    try:
        return Path(os.path.relpath(file, Path(case).parent)).as_posix()
    except ValueError:  # another drive
        return str(Path(file).absolute())


def _look_at(result: str, *others: str) -> Steps:
    return tuple(line(command, result) for command in ("show", "report", *others))


def _result(kind: str, case: str, options: Options) -> str:
    """The path of the result that a command has written."""
    from geoident.workflow.running.outputs import target

    return str(target(case, kind, output=options.output).path)


def _changes(options: Options) -> Steps:
    return tuple(word for change in options.overrides for word in ("--set", change))


def _for_one(items: Steps, steps: Callable[[str], Steps]) -> Steps:
    """Steps for the only item; none for several, of which each would need its own."""
    return steps(items[0]) if len(items) == 1 else ()


def _sentence(*sentences: str) -> Next:
    return lambda given, options: sentences


NEXT: Mapping[str, Next] = {
    "init": _after_init,
    "check": _after_check,
    "simulate": _after_simulate,
    "fit": _after_fit,
    "predict": _after_predict,
    "scan": _after_scan,
    "show": _after_show,
    "report": _sentence("open it in a browser or a viewer; a browser prints it to PDF"),
    "export": _sentence("open .csv in a spreadsheet, .pvd or .vtkhdf in ParaView"),
    "diff": _sentence("geoident report A B   # both on one page"),
    "schema": _sentence("write in the first line of a case: # yaml-language-server: $schema=FILE"),
    "doctor": _sentence("geoident init my-case"),
    "completion": _sentence("open a new shell, and press Tab after geoident"),
}
"""Name of a command to what comes after it."""
