"""What a command says while it works: to stderr, with a live line where that is a terminal."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from geoident.cli.options import Options

if TYPE_CHECKING:
    from geoident.model.parameter import Parameter
    from geoident.model.result import Iteration


class Terminal:
    """The monitor of commands that run at a terminal or under a script.

    Args:
        options: how much to say.
        parameters: those that iterations tell the values of.
    """

    def __init__(self, options: Options, parameters: tuple[Parameter, ...] = ()) -> None:
        self._options = options
        self._parameters = parameters
        self._status: Any = None

    def warn(self, message: str) -> None:
        """Said even when quiet."""
        self._say(f"warning: {message}")

    def inform(self, message: str) -> None:
        """Said unless quiet."""
        if not self._options.quiet:
            self._say(message)

    def detail(self, message: str) -> None:
        """Said when verbose."""
        if self._options.verbose:
            self._say(message)

    def step(self, iteration: Iteration) -> None:
        """One iteration: a line when verbose, else the live line."""
        from geoident.report.text import iteration_text

        line = iteration_text(iteration, self._parameters)
        if self._status is not None:
            self._status.update(line)
        else:
            self.detail(line)

    @contextmanager
    def live(self, title: str) -> Iterator[None]:
        """Show a live line meanwhile, on a terminal and unless verbose or quiet."""
        if self._options.quiet or self._options.verbose or not sys.stderr.isatty():
            yield
            return
        from rich.console import Console

        with Console(stderr=True, highlight=False, markup=False).status(title) as status:
            self._status = status
            try:
                yield
            finally:
                self._status = None

    def _say(self, message: str) -> None:
        if self._status is not None:
            self._status.console.print(message, markup=False, highlight=False, soft_wrap=True)
        else:
            click.echo(message, err=True)
