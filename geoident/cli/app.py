"""The group of commands. A command's module is imported when it is asked for."""

from __future__ import annotations

import io
import sys
import warnings
from importlib import import_module
from typing import Any, NoReturn

import click

from geoident import __version__
from geoident.cli.error_boundary import PipeClosed, guarded
from geoident.io.text.wording import did_you_mean

COMMANDS = (
    "init",
    "check",
    "simulate",
    "fit",
    "predict",
    "scan",
    "batch",
    "sample",
    "backtest",
    "update",
    "watch",
    "control",
    "plan",
    "show",
    "report",
    "export",
    "diff",
    "compare",
    "schema",
    "doctor",
    "completion",
)

EPILOG = """\b
Examples:
  geoident init my-case --template cavern
  geoident check case.yaml
  geoident fit case.yaml
  geoident show case.fit.h5
  geoident COMMAND --help

\b
Exit codes: 0 done, 1 a bug, 2 wrong flags, 3 invalid input,
4 finished but not converged, not determined, poorly fitted or out of budget,
5 the model has no solution, 6 output, 7 some of several cases or runs failed,
8 an alarm,
130/143 interrupted (the same command continues).
"""


class Commands(click.Group):
    """The commands, imported one by one, under one guard that turns errors into exit codes."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order in which people need them."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of a command."""
        if cmd_name not in COMMANDS:
            return None
        command = import_module(f"geoident.cli.commands.{cmd_name}").command
        return command if isinstance(command, click.Command) else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is asked for; of a wrong one the nearest is named.

        Args:
            ctx: of the group.
            args: what was written.

        Raises:
            click.UsageError: there is no such command.
        """
        name = str(args[0])
        if name not in COMMANDS and not name.startswith("-"):
            hint = did_you_mean(name, COMMANDS, what="The commands are")
            ctx.fail(f"There is no command {name!r}. {hint.replace('are:', 'are')}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands, each with its whole first sentence.

        Args:
            ctx: of the group.
            formatter: takes the lines.
        """
        rows = []
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            about = (command.help or "") if command is not None else ""
            rows.append((name, about.partition("\n\n")[0].replace("\n", " ")))
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a closed pipe gets past click's own handling.

        Raises:
            PipeClosed: nobody reads the output any more.
        """
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:
            raise PipeClosed from error

    def main(self, *args: Any, **extra: Any) -> NoReturn:
        """Run the program and end it with its exit code; never a traceback."""
        extra["standalone_mode"] = False
        sys.exit(guarded(lambda: super(Commands, self).main(*args, **extra)))


@click.group(
    cls=Commands,
    epilog=EPILOG,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, "-V", "--version", prog_name="geoident")
def geoident() -> None:
    """Identify ground parameters from gauge readings by finite elements.

    A case file (YAML) describes the ground, its construction and its gauges; `fit` identifies the
    parameters from the readings and predicts the stages to come.
    """


def main() -> NoReturn:
    """Entry point of the command ``geoident``."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # ours are said in words; those of libraries are noise
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # names of files may be any bytes
    geoident.main(prog_name="geoident")
