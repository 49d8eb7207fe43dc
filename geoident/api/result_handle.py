"""What all results have: where they stand and how they ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from geoident.model.results.findings import Finding, sentences_of


class Stored(Protocol):
    """What stands in a file or a folder."""

    @property
    def path(self) -> str:
        """Where."""


class Ended(Protocol):
    """What a command found, as far as it says how that ended."""

    @property
    def status(self) -> str:
        """How it ended."""

    @property
    def reason(self) -> str:
        """Why it ended so, in words."""

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 0 where it ended as it should."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What an engineer must know."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What else was noticed."""


_Data = TypeVar("_Data", bound=Ended)


@dataclass(frozen=True, repr=False)
class ResultHandle(Generic[_Data]):
    """What was found, how that ended, and where it stands.

    Args:
        data: all that was found, SI.
        path: of the result file.
        up_to_date: it stood there already and was not computed again.
    """

    data: _Data
    path: str
    up_to_date: bool = False

    @property
    def status(self) -> str:
        """How it ended, such as ``converged`` or ``not-determined``; `reason` says why."""
        return self.data.status

    @property
    def reason(self) -> str:
        """Why it ended so, in words."""
        return self.data.reason

    @property
    def converged(self) -> bool:
        """Whether it ended as it should; `reason` says why."""
        return self.data.exit_code == 0

    @property
    def findings(self) -> tuple[str, ...]:
        """Sentences on what an engineer must know; `data` has them with kinds and numbers."""
        return sentences_of(self.data.findings)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what else was noticed."""
        return self.data.notes
