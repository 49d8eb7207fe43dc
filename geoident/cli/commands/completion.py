"""``geoident completion``."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from geoident.cli.options import Options, always, takes

SHELLS = ("bash", "zsh", "fish")

EPILOG = """\b
Examples:
  geoident completion bash >> ~/.bashrc
  geoident completion zsh >> ~/.zshrc
  geoident completion fish > ~/.config/fish/completions/geoident.fish
"""


@click.command(epilog=EPILOG)
@click.argument("shell", type=click.Choice(SHELLS))
@takes(after=always("open a new shell, and press Tab after geoident"))
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
