"""A campaign: one case in many variations, and what is to be computed of each."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.errors import Location
from geoident.model.cluster import Cluster
from geoident.model.run import Run, Setting

SEED = "seed"
"""Path that is none of a case: the seed of random numbers of a run of a campaign."""


@dataclass(frozen=True)
class SampledRange:
    """How one value is sampled.

    Args:
        path: of the key.
        kind: ``linear`` or ``log`` between two ends, ``normal`` or ``lognormal`` about a middle.
        first: lower end; mean (of a lognormal one the median).
        second: upper end; standard deviation.
        unit: as written behind the numbers, empty for none.
        place: where it is written.
    """

    path: str
    kind: str
    first: float
    second: float
    unit: str
    place: Location


@dataclass(frozen=True)
class Sampling:
    """A number of variations spread over spans.

    Args:
        method: ``latin-hypercube`` or ``sobol``.
        count: number of runs.
        seed: of the random numbers.
        spans: what varies.
    """

    method: str
    count: int
    seed: int
    spans: tuple[SampledRange, ...]


@dataclass(frozen=True)
class Campaign:
    """What a campaign file says.

    Args:
        path: of the file.
        title: free text.
        command: what is computed of each run: ``fit``, ``simulate``, ``predict`` or ``scan``.
        case: path of the base case.
        result: path of the fit that is predicted from; empty but for ``predict``.
        settings: what is put in place of values of the base case in all runs.
        places: where each of these is written.
        runs: with what varies; none where they follow from a sampling.
        sampling: the runs, where they follow from one.
        seed: of random numbers of each run.
        solver: name of the sparse solver.
        retries: times that a run is begun again after its process was lost.
        noise: of a simulation: noise of the gauges is added.
        draw: of a simulation: fields are drawn.
        stages: of a prediction: names of the stages; all that were not fitted if empty.
        max_time: seconds after which a search ends with what it has, or None.
        time_limit: seconds after which a run is taken to hang, or None.
        cluster: that computes the runs, or None for processes of this command.
    """

    path: str
    title: str
    command: str
    case: str
    result: str
    settings: tuple[Setting, ...]
    places: tuple[Location, ...]
    runs: tuple[Run, ...]
    sampling: Sampling | None
    seed: int
    solver: str
    retries: int
    noise: bool
    draw: bool
    stages: tuple[str, ...]
    max_time: float | None = None
    time_limit: float | None = None
    cluster: Cluster | None = None

    @property
    def base(self) -> Run:
        """The base case with what is set in all runs."""
        return Run("", self.case, self.settings, self.places, Location(self.path))
