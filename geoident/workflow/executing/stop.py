"""The wish to stop, which whoever computes long asks for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from geoident.errors import ExitCode, Interrupted


@dataclass
class StopRequest:
    """A wish from outside, such as a signal, to stop after the running evaluation.

    Args:
        exit_code: with which the command is to end; None while nobody wishes it.
    """

    exit_code: ExitCode | None = None
    _heard_by: list[Callable[[], None]] = field(default_factory=list, repr=False, compare=False)

    def ask(self, exit_code: ExitCode) -> None:
        """Wish the stop."""
        self.exit_code = exit_code
        for listener in self._heard_by:
            listener()

    @contextmanager
    def heard_by(self, listener: Callable[[], None]) -> Iterator[None]:
        """Meanwhile somebody else is told of the wish, too, at once.

        Args:
            listener: may be called from the handler of a signal.
        """
        self._heard_by.append(listener)
        try:
            yield
        finally:
            self._heard_by.remove(listener)

    def check(self) -> None:
        """Stop here if a stop was wished.

        Raises:
            Interrupted: it was.
        """
        if self.exit_code is not None:
            raise Interrupted("Interrupted.", exit_code=self.exit_code)
