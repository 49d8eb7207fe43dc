"""What became of the runs of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from geoident.errors import ExitCode
from geoident.model.results.costs import NO_COST, Counts

SET_ASIDE = "set-aside"
FAILED = "failed"
INTERRUPTED = "interrupted"
FINAL = (ExitCode.DONE, ExitCode.INVALID_INPUT, ExitCode.NOT_CONVERGED, ExitCode.NO_SOLUTION)
"""Exit codes of runs that would end the same way again."""

NAN = float("nan")

SAME_MISFIT = 1e-5
"""Relative difference up to which misfits are the same."""


@dataclass(frozen=True)
class RunParameter:
    """A parameter of a run.

    Args:
        name: its name.
        value: SI; NaN where it is not determined.
        sd: standard deviation, SI; NaN where there is none.
        lower95: lower end of the 95 % interval, SI.
        upper95: upper end.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    name: str
    value: float
    sd: float
    lower95: float
    upper95: float
    unit: str
    dimension: str


@dataclass(frozen=True)
class RunReading:
    """What a run computes for a channel at a stage.

    Args:
        gauge: name of the channel.
        stage: of the stage.
        value: SI.
        lower95: lower end of the 95 % band, SI; NaN where there is none.
        upper95: upper end.
        unit: in which people see it; empty for that of its dimension.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    stage: str
    value: float
    lower95: float
    upper95: float
    unit: str
    dimension: str


@dataclass(frozen=True)
class RunRecord:
    """One run.

    Args:
        name: of the run.
        key: hash of everything that it depends on.
        settings: what varies: paths and values as written; those it leaves as they are, empty.
        status: of its result, or `FAILED`, `SET_ASIDE`, `INTERRUPTED`.
        exit_code: of its command.
        reason: why it ended so.
        file: of its result, in the folder of the campaign; empty where there is none.
        objective: misfit; NaN where there is none.
        parameters: of the case.
        readings: that were simulated or predicted.
        counts: what it cost.
        seconds: that it took, of the clock.
        host: name of the machine.
        losses: why each process was lost over it.
    """

    name: str
    key: str
    settings: tuple[tuple[str, str], ...]
    status: str
    exit_code: int
    reason: str = ""
    file: str = ""
    objective: float = NAN
    parameters: tuple[RunParameter, ...] = ()
    readings: tuple[RunReading, ...] = ()
    counts: Counts = field(default=NO_COST)
    seconds: float = NAN
    host: str = ""
    losses: tuple[str, ...] = ()

    @property
    def final(self) -> bool:
        """It would end the same way again, so it is not run again."""
        return self.exit_code in FINAL and self.status not in (SET_ASIDE, "out-of-budget")

    @property
    def finished(self) -> bool:
        """There is a result."""
        return self.exit_code in (ExitCode.DONE, ExitCode.NOT_CONVERGED) and bool(self.file)


@dataclass(frozen=True)
class CampaignTable:
    """All runs of a campaign.

    Args:
        title: of the campaign.
        command: that each run is of.
        campaign_file: path of its file, as seen from its folder.
        case_file: path of the base case, likewise.
        paths: what varies.
        runs: those that have ended, in the order of the campaign.
        total: number of all runs.
        versions: of the program and the libraries.
        created: date and time.
        outdated: a sentence where they were made from an earlier fit than its file holds now.
    """

    title: str
    command: str
    campaign_file: str
    case_file: str
    paths: tuple[str, ...]
    runs: tuple[RunRecord, ...]
    total: int
    versions: dict[str, str]
    created: str
    outdated: str = ""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order in which they appear."""
        return tuple(dict.fromkeys(p.name for run in self.runs for p in run.parameters))

    @property
    def failed(self) -> tuple[RunRecord, ...]:
        """Runs without a result."""
        return tuple(run for run in self.runs if not run.finished)

    @property
    def exit_code(self) -> int:
        """Of the campaign: 7 where some runs have failed."""
        failed = [ExitCode.SOME_FAILED] if self.failed else []
        return campaign_code([*(run.exit_code for run in self.runs), *failed])


def campaign_code(codes: Sequence[int]) -> int:
    """The exit code of a campaign, from those of its runs.

    >>> campaign_code([0, 0]), campaign_code([0, 4]), campaign_code([0, 5])
    (0, 4, 7)
    """
    if all(code in (ExitCode.DONE, ExitCode.NOT_CONVERGED) for code in codes):
        return int(max(codes, default=ExitCode.DONE))
    return int(ExitCode.SOME_FAILED)
