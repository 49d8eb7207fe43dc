"""``geoident completion``."""

from __future__ import annotations

import sys

import click
from click.shell_completion import get_completion_class

from geoident.cli.options import Arguments, OneOf, Options, Steps, takes

SHELLS = ("bash", "zsh", "fish")

EPILOG = """\b
Examples:
  geoident completion bash >> ~/.bashrc
  geoident completion zsh >> ~/.zshrc
  geoident completion fish > ~/.config/fish/completions/geoident.fish
"""


FILES = {
    "bash": ">> ~/.bashrc",
    "zsh": ">> ~/.zshrc",
    "fish": "> ~/.config/fish/completions/geoident.fish",
}
"""Where a shell looks for the script."""


def _looked_at() -> bool:
    return sys.stdout.isatty()


def _next(arguments: Arguments, options: Options) -> Steps:
    """On a terminal the script has only been looked at; in a file a new shell reads it."""
    shell = arguments["shell"]
    if _looked_at():
        return (f"geoident completion {shell} {FILES[shell]}",)
    return (f"open a new {shell} that reads the file, and press Tab after geoident",)


@click.command(epilog=EPILOG)
@click.argument("shell", type=OneOf(SHELLS))
@takes(after=_next)
@click.pass_context
def command(context: click.Context, shell: str, options: Options) -> int:
    """Print the script by which the shell completes commands, options and files with Tab."""
    kind = get_completion_class(shell)
    if kind is None:  # pragma: no cover - click knows all of SHELLS
        raise click.UsageError(f"There is no completion for {shell}.")
    program = context.find_root()
    name = program.info_name or "geoident"
    click.echo(kind(program.command, {}, name, "_GEOIDENT_COMPLETE").source())
    return 0
