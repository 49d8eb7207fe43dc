"""What to do next, said at the end of a command."""

from __future__ import annotations

import shlex
from contextlib import suppress

import click

from geoident.cli.options import Options


def say_next(options: Options, *steps: str) -> None:
    """Say on stderr which steps make sense now; not with ``-q`` or ``--json``.

    Args:
        options: as given.
        steps: command lines, or sentences.
    """
    if options.quiet or options.as_json or not steps:
        return
    with suppress(OSError):
        click.echo("\nNext:\n" + "\n".join(f"    {step}" for step in steps), err=True)


def line(command: str, *words: str) -> str:
    """A command line of geoident as a shell takes it.

    >>> line("fit", "my case.yaml")
    "geoident fit 'my case.yaml'"
    """
    return shlex.join(["geoident", command, *words])
