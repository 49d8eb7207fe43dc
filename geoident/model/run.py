"""A run: a case, some of whose values are replaced. All that varies a case is a table of these.

The variations of a campaign, the sections of a project and the models of a ladder are runs.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Self

from geoident.errors import Location

Setting = tuple[str, str]
"""Path of a key of the case, and what stands in its place, as YAML."""


@dataclass(frozen=True)
class Run:
    """A row of a run table.

    Args:
        name: label; the files of the run are named after it.
        case: path of the case.
        settings: what is put in place of values of the case, in order; a later one counts.
        places: where each setting is written.
        place: where the row is written.
    """

    name: str
    case: str
    settings: tuple[Setting, ...] = ()
    places: tuple[Location, ...] = ()
    place: Location = Location("")

    @property
    def overrides(self) -> tuple[str, ...]:
        """The settings as overrides of the case.

        >>> Run("a", "case.yaml", (("parameters.E.start", "9 GPa"),)).overrides
        ('parameters.E.start=9 GPa',)
        """
        return tuple(f"{path}={value}" for path, value in self.settings)

    def on(self, base: Run) -> Self:
        """The same run with the settings of another one before its own."""
        settings, places = (*base.settings, *self.settings), (*base.places, *self.places)
        return replace(self, settings=settings, places=places)


def varied_paths(runs: Iterable[Run]) -> tuple[str, ...]:
    """Paths of all that is set in some run, in the order in which they appear."""
    return tuple(dict.fromkeys(path for run in runs for path, _ in run.settings))
