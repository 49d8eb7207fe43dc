"""Whether a file may have run what it names: by a flag, or asked on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager

import click

from geoident.workflow.programs.trust import Execution, decided_by


@contextmanager
def asked(
    *, trust: bool, as_json: bool, permitted: Collection[str] | None = None
) -> Iterator[None]:
    """Meanwhile ``--trust`` decides, or who sits at the terminal.

    Args:
        trust: all may run.
        as_json: nobody is asked, since programs read what is said.
        permitted: on another machine, `Execution.portable` of what may be run; nothing is
            remembered there.
    """

    def decide(execution: Execution) -> bool:
        if trust or execution.portable in (permitted or ()):
            return True
        if as_json or not _on_terminal():
            return False
        statement = execution.said
        click.echo(f"\n{statement[0].upper()}{statement[1:]}.{execution.shown('    ')}", err=True)
        return click.confirm("May it?", default=False, err=True)

    with decided_by(decide, remembered=permitted is None):
        yield


def _on_terminal() -> bool:
    return sys.stdin.isatty() and sys.stderr.isatty()
