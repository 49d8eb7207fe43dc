"""What the forward model asks of an external model: runs at parameter vectors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from geoident.model.arrays import Bools, Floats


@dataclass(frozen=True)
class FailedRun:
    """A run that gave no readings.

    Args:
        reason: why, a clause.
        folder: in which its files are kept; empty for none.
    """

    reason: str
    folder: str = ""

    def __str__(self) -> str:
        return f"{self.reason} ({self.folder})" if self.folder else self.reason


class ModelRuns(Protocol):
    """Runs of a program or a function; a run at the same parameters is made once."""

    @property
    def seen(self) -> Bools:
        """(n,) which parameters the model depends on."""

    @property
    def provided(self) -> Bools:
        """(n_stages, n_channels) which readings the model gives."""

    @property
    def has_jacobian(self) -> bool:
        """Whether the model gives derivatives itself."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user on the runs so far, sentences."""

    def require_trust(self) -> str:
        """Ask whether it may be run, unless that is known; raises `InputError` if it may not.

        Returns:
            A name for what is run, which is the same on all machines.
        """

    def written(self, p: Floats) -> Floats:
        """The parameters (n,) as the program reads them: with the digits that are written."""

    def quantum(self, p: Floats) -> Floats:
        """(n,) the smallest change of each parameter that the program can see at p (n,)."""

    @property
    def at_once(self) -> int:
        """How many runs are made at a time."""

    def each(
        self, points: Sequence[Floats], check: Callable[[], None]
    ) -> Iterator[Floats | FailedRun]:
        """Readings (n_stages, n_channels), SI, in turn, each as soon as its run ends; others go on.

        NaN where none is given.

        Args:
            points: (n,) where.
            check: is called every moment; raises to end the runs.

        Raises:
            InputError: the model may not be run.
            OutputError: a folder or the log cannot be written.
        """

    def jacobian(self, p: Floats, check: Callable[[], None]) -> Floats | FailedRun:
        """Derivatives (n_stages, n_channels, n) at p (n,), of those that give them.

        Args:
            p: (n,) where.
            check: see `each`.
        """
