"""Options that commands share, the one object in which they travel, and what to do after a command.

A command names the steps that make sense after it; they are said on stderr at its end.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import wraps
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from geoident.errors import ExitCode
from geoident.io.text.wording import nearest
from geoident.units import UnitError, read_duration

if TYPE_CHECKING:
    _Seconds = click.ParamType[float]
    _Choice = click.Choice[str]
else:  # older versions of click know no type of the value
    _Seconds = click.ParamType
    _Choice = click.Choice


@dataclass(frozen=True)
class Options:
    """The shared options as given. Commands that do not have one see its default."""

    output: str | None = None
    jobs: int | None = None
    overrides: tuple[str, ...] = ()
    seed: int = 0
    max_time: float | None = None
    solver: str = "auto"
    dry_run: bool = False
    force: bool = False
    fresh: bool = False
    as_json: bool = False
    trust: bool = False
    reduced: str | None = None
    quiet: bool = False
    verbose: bool = False


Arguments = Mapping[str, Any]
"""Name to value of what a command is given besides the shared options."""
Steps = tuple[str, ...]
"""What to do next: command lines, or sentences."""
Next = Callable[[Arguments, Options], Steps]
"""From what a command was given to what comes after it."""


class Duration(_Seconds):
    """A time such as ``90s``, ``10min`` or ``1h30min``, in seconds."""

    name = "TIME"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Seconds of a text.

        Args:
            value: what was written.
            param: the option.
            ctx: of the command.
        """
        try:
            return read_duration(str(value))
        except UnitError as error:
            self.fail(f"{error.message}. {error.hint}", param, ctx)


class OneOf(_Choice):
    """A choice that proposes the nearest word for one that is not among them."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        """What is said of a wrong word.

        Args:
            value: what was written.
            ctx: of the command.
        """
        near = nearest(str(value), [str(word) for word in self.choices])
        message = str(super().get_invalid_choice_message(value, ctx))
        return f"{message.removesuffix('.')}. Did you mean {near!r}?" if near else message


class Whole(click.IntRange):
    """A whole number from zero on; the help does not say the largest one."""

    def __init__(self) -> None:
        super().__init__(0, 2**63 - 1)

    def _describe_range(self) -> str:
        return ""


_OPTIONS: dict[str, Callable[[Any], Any]] = {
    "output": click.option(
        "-o",
        "--output",
        metavar="PATH",
        type=click.Path(),
        help="File or existing folder for the output.",
    ),
    "jobs": click.option(
        "-j",
        "--jobs",
        type=click.IntRange(min=1),
        metavar="N",
        help="Number of processes: for cases, or for the independent parts of one search.  "
        "[default: all cores, for one case where it saves time]",
    ),
    "overrides": click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="PATH=VALUE",
        help="Replace a value of the case; may be repeated.",
    ),
    "seed": click.option(
        "--seed",
        type=Whole(),
        default=0,
        show_default=True,
        metavar="N",
        help="Seed of random numbers.",
    ),
    "max_time": click.option(
        "--max-time", type=Duration(), help="Stop searching after this time, such as 10min."
    ),
    "solver": click.option(
        "--solver",
        type=OneOf(["auto", "pardiso", "cholmod", "splu", "iterative"]),
        default="auto",
        show_default=True,
        help="Sparse solver.",
    ),
    "reduced": click.option(
        "--reduced",
        metavar="RESULT",
        type=click.Path(),
        help="Use the reduced model of this fit (fit.reduced: keep) where it is accurate enough.",
    ),
    "dry_run": click.option(
        "--dry-run", is_flag=True, help="Print what would be done, without computing."
    ),
    "force": click.option(
        "--force", is_flag=True, help="Overwrite output that was made from other input."
    ),
    "fresh": click.option(
        "--fresh", is_flag=True, help="Compute again even if up to date; ignore the checkpoint."
    ),
    "as_json": click.option(
        "--json", "as_json", is_flag=True, help="One JSON object per case on stdout, SI units."
    ),
    "trust": click.option(
        "--trust",
        is_flag=True,
        help="Trust what the files would run (the model of a case, jobs, a scheduler of dask); the "
        "answer is remembered.",
    ),
    "quiet": click.option("-q", "--quiet", is_flag=True, help="Print errors only."),
    "verbose": click.option("-v", "--verbose", is_flag=True, help="Print more, on stderr."),
}


def takes(*names: str, after: Next) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Give a command some of the shared options; it gets them as one `Options`, its last argument.

    ``-q`` and ``-v`` belong to every command, and so does saying at its end what to do next.

    Args:
        names: of the shared options.
        after: what to do next.
    """
    wanted = [*names, "quiet", "verbose"]

    def decorate(function: Callable[..., int]) -> Callable[..., int]:
        @wraps(function)
        def command(**given: Any) -> int:
            shared = {f.name: given.pop(f.name) for f in fields(Options) if f.name in given}
            options = Options(**shared)
            if "trust" in names:
                from geoident.cli.trust import asked  # noqa: PLC0415 - help must not wait for it

                with asked(trust=options.trust, as_json=options.as_json):
                    code = function(**given, options=options)
            else:
                code = function(**given, options=options)
            if code in (ExitCode.DONE, ExitCode.NOT_CONVERGED, ExitCode.ALARM):
                _say_next(after, given, options)
            return code

        decorated: Callable[..., int] = command
        for name in reversed(wanted):
            decorated = _OPTIONS[name](decorated)
        return decorated

    return decorate


def asks_safety(function: Callable[..., int]) -> Callable[..., int]:
    """Give a command ``--safety`` and ``--at``: its argument ``safety`` has the stages, or is None.

    Without a stage they are empty: the last one is meant.
    """

    @wraps(function)
    def command(*, safety: bool, at: tuple[str, ...], **given: Any) -> int:
        if at and not safety:
            raise click.UsageError("--at needs --safety")
        stages = tuple(name.strip() for part in at for name in part.split(",") if name.strip())
        return function(**given, safety=stages if safety else None)

    decorated: Callable[..., int] = command
    for option in (
        click.option(
            "--at",
            metavar="STAGE",
            multiple=True,
            help="Stage of --safety; may be repeated.  [default: the last one]",
        ),
        click.option(
            "--safety",
            is_flag=True,
            help="Print the factor of safety by strength reduction and how the ground then fails, "
            "and write a result, CASE.safety.h5; of a fit with the 95 % interval of the factor and "
            "the probability that it is below one.",
        ),
    ):
        decorated = option(decorated)
    return decorated


def _say_next(after: Next, arguments: Arguments, options: Options) -> None:
    """Say on stderr what to do next; not with ``-q``, nor to programs."""
    if options.quiet or options.as_json:
        return
    steps = after(arguments, options)
    if steps:
        with suppress(OSError):
            click.echo("\nNext:\n" + "\n".join(f"    {step}" for step in steps), err=True)


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
    names = (f"{stem}{'' if n == 1 else f'-{n}'}{suffix}" for n in count(1))
    return next(name for name in names if not Path(name).exists())


def on_result(result: str, *others: str) -> Steps:
    """Commands that take a result: ``show``, ``report``, and others."""
    return tuple(line(command, result) for command in ("show", "report", *others))


def on_fit(result: str) -> Steps:
    """Commands that take the result of a fit, of a structure in service ``control`` among them."""
    from geoident.io.result.file import read_identity  # noqa: PLC0415 - help must not wait for it

    written = read_identity(result)
    in_service = written is not None and "seasonal" in written.contents.split()
    return on_result(result, "control" if in_service else "predict")


def result_of(kind: str, case: str, options: Options) -> str:
    """The path of the result that a command has written.

    Args:
        kind: the command.
        case: what it was run on.
        options: the shared options.
    """
    from geoident.workflow.running.outputs import target  # noqa: PLC0415 - help must not wait for it

    return str(target(case, kind, output=options.output).path)


def overrides(options: Options) -> Steps:
    """The words of a command line that change the case in the same way."""
    return tuple(word for change in options.overrides for word in ("--set", change))


def for_one(items: Sequence[str], steps: Callable[[str], Steps]) -> Steps:
    """Steps for the only item; none for several, of which each would need its own."""
    return steps(items[0]) if len(items) == 1 else ()
