"""The wish to stop, which whoever computes long asks for."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.errors import ExitCode, Interrupted


@dataclass
class StopRequest:
    """A wish from outside, such as a signal, to stop after the running evaluation.

    Args:
        exit_code: with which the command is to end; None while nobody wishes it.
    """

    exit_code: ExitCode | None = None

    def ask(self, exit_code: ExitCode) -> None:
        """Wish the stop."""
        self.exit_code = exit_code

    def check(self) -> None:
        """Stop here if a stop was wished.

        Raises:
            Interrupted: it was.
        """
        if self.exit_code is not None:
            raise Interrupted("Interrupted.", exit_code=self.exit_code)
