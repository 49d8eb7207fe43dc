"""Results as calls give them: what was found, the file it stands in, and ways to look at it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from geoident.api.arrays import dataset
from geoident.api.calling import AnyPath, spoken
from geoident.api.notebook import result_html
from geoident.api.plots import Plots
from geoident.api.reduced import KeptModel
from geoident.api.result_handle import ResultHandle
from geoident.api.tables import GaugeReadings, Parameters, ResultTable, summary_of, tables_of
from geoident.io.result.file import read_result as read_file
from geoident.model.arrays import Floats
from geoident.model.results.backtest import Scores
from geoident.model.results.in_service import ChangeRow, ParameterChangeRow, PowerRow
from geoident.model.results.plan import GaugePlan, PlanTarget
from geoident.model.results.posterior import PosteriorDraws
from geoident.model.results.result import Grid, Result
from geoident.model.results.rivals import Evidence, ModelComparison
from geoident.model.results.updates import UpdateStep
from geoident.model.results.yielded import Mechanism
from geoident.report.page.html import joined, table, tag
from geoident.report.text.result import summary_text
from geoident.report.text.rivals import MODELS_LEGEND, models_table, models_text
from geoident.workflow.running.kept_reduced import restored_alone
from geoident.workflow.running.result_files import with_outdated

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_MOST = 4
"""Parameters in the short form of a result."""


@dataclass(frozen=True, repr=False)
class ResultFile(ResultHandle[Result]):
    """A result and where it stands. In a notebook it shows its parameters and the overview.

    Args:
        data: all that was found, as arrays, SI.
        path: of the result file.
        up_to_date: it stood there already and was not computed again.
    """

    @cached_property
    def parameters(self) -> Parameters:
        """The identified parameters by name."""
        return Parameters(self.data)

    @cached_property
    def gauges(self) -> GaugeReadings:
        """The channels of the gauges by name: measured, computed, predicted."""
        return GaugeReadings(self.data)

    @cached_property
    def tables(self) -> Mapping[str, ResultTable]:
        """All tables by name, in the units of the case: those that ``geoident export`` writes."""
        return tables_of(self.data)

    @cached_property
    def plot(self) -> Plots:
        """The figures, as axes of matplotlib."""
        return Plots(self.data)

    @spoken
    def to_xarray(self) -> xr.Dataset:
        """All arrays as one ``xarray.Dataset``, SI.

        Dimensions: channel, stage, parameter; of the fields state (the virgin one first), node,
        element, axis, component; of draws draw; of a scan its parameters. The units of readings and
        parameters are the coordinates ``reading_unit`` and ``parameter_unit``.

        Raises:
            MissingExtra: xarray is not installed.
        """
        return dataset(self.data)

    def __str__(self) -> str:
        return summary_text(self.data)

    def __repr__(self) -> str:
        summary = summary_of(self.parameters, most=_MOST)
        state = f"{self.status}; {summary}" if summary else self.status
        return f"{type(self).__name__}({Path(self.path).name}: {state})"

    def _repr_html_(self) -> str:
        return result_html(self.data, title=f"{self.data.kind} of {self.path}", plots=self.plot)


@dataclass(frozen=True, repr=False)
class FitResult(ResultFile):
    """What `fit` found: parameters, how well the readings determine them, and later stages."""

    @property
    def predictions(self) -> ResultTable:
        """Later stages with 95 % bands, in the units of the case; no rows where there are none."""
        return _predictions(self)

    @property
    def mechanism(self) -> Mechanism | None:
        """How the ground moves at the first later stage that collapses; None where none does."""
        return self.data.mechanism

    @property
    def reduced(self) -> KeptModel | None:
        """The reduced model that the fit keeps (``fit.reduced: keep``), else None.

        Called with parameters it gives readings, with bounds of their errors, in a millisecond:
        ``result.reduced({"E_rock": "12 GPa"})``. It needs neither the mesh nor the readings.

        Raises:
            InputError: the case in the file cannot be read as this version reads it.
        """
        restored = restored_alone(self.data, self.path)
        return None if restored is None else KeptModel(restored, self.data.parameters.values)

    @property
    def updates(self) -> tuple[UpdateStep, ...]:
        """The first fit and every update since; empty where there was none."""
        return () if self.data.updates is None else self.data.updates.steps

    @property
    def evidence(self) -> Evidence | None:
        """How well the model explains the readings; None where that is not known."""
        return self.data.evidence


@dataclass(frozen=True, repr=False)
class PredictionResult(ResultFile):
    """What `predict` found: later stages, or another case, with 95 % bands."""

    @property
    def predictions(self) -> ResultTable:
        """Predicted readings with 95 % bands, in the units of the case."""
        return _predictions(self)


@dataclass(frozen=True, repr=False)
class ScanResult(ResultFile):
    """What `scan` found: the misfit over one or two parameters."""

    @property
    def grid(self) -> Grid:
        """Names of the parameters, their values (k,), SI, and the misfit at all of them."""
        assert self.data.grid is not None
        return self.data.grid

    @spoken
    def to_frame(self) -> pd.DataFrame:
        """The grid as a ``pandas.DataFrame``, one row a point, in the units of the case.

        Raises:
            MissingExtra: pandas is not installed.
        """
        return self.tables["grid"].to_frame()


@dataclass(frozen=True, repr=False)
class SampleResult(ResultFile):
    """What `sample` found: draws of the parameters; ``arviz.from_netcdf`` opens its file."""

    @property
    def posterior(self) -> PosteriorDraws:
        """The draws and how reliable they are."""
        assert self.data.posterior is not None
        return self.data.posterior

    @property
    def draws(self) -> Floats:
        """(n_draws, n_parameters) draws of all chains, SI."""
        assert self.data.for_people.posterior is not None
        return self.data.for_people.posterior.flat

    @spoken
    def to_frame(self) -> pd.DataFrame:
        """The draws as a ``pandas.DataFrame``, one row a draw, in the units of the case.

        Raises:
            MissingExtra: pandas is not installed.
        """
        return self.tables["draws"].to_frame()


@dataclass(frozen=True, repr=False)
class BacktestResult(ResultFile):
    """What `backtest` found: how predictions of stages that were read came true."""

    @property
    def scores(self) -> Scores:
        """How well the next stages that were read were predicted, all together."""
        assert self.data.backtest is not None
        return self.data.backtest.next

    @property
    def later_scores(self) -> Scores:
        """The same of all stages after the next ones."""
        assert self.data.backtest is not None
        return self.data.backtest.further

    @spoken
    def to_frame(self) -> pd.DataFrame:
        """Every prediction and what was read, as a ``pandas.DataFrame``, in the units of the case.

        Raises:
            MissingExtra: pandas is not installed.
        """
        return self.tables["backtest"].to_frame()


@dataclass(frozen=True, repr=False)
class ControlResult(ResultFile):
    """What `control` found: whether new readings of a structure in service are as expected."""

    @property
    def state(self) -> str:
        """``green``, ``amber`` or ``red``."""
        return self.data.status

    @property
    def changes(self) -> tuple[ChangeRow, ...]:
        """Steps and drifts that the readings show, SI; one of several gauges has a row for each."""
        return self.data.changes

    @property
    def parameter_changes(self) -> tuple[ParameterChangeRow, ...]:
        """Parameters of a structure on its mesh that have changed, SI.

        Of those that cannot be told apart there is a row for each, the most probable one first.
        """
        return self.data.parameter_changes

    @property
    def power(self) -> tuple[PowerRow, ...]:
        """Changes that were asked for: whether they would be seen, and after how many seconds."""
        return self.data.power

    @spoken
    def to_frame(self) -> pd.DataFrame:
        """Every new reading and what it was expected to be, as a ``pandas.DataFrame``.

        Raises:
            MissingExtra: pandas is not installed.
        """
        return self.tables["judged"].to_frame()


@dataclass(frozen=True, repr=False)
class PlanResult(ResultFile):
    """What `plan` found: the gauges to take, and how well all will be known then."""

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the gauges to take, the one that tells most first."""
        return tuple(one.gauge for one in self._plan.chosen)

    @property
    def targets(self) -> tuple[PlanTarget, ...]:
        """What is to be known, SI."""
        return self._plan.targets

    @property
    def _plan(self) -> GaugePlan:
        assert self.data.plan is not None
        return self.data.plan

    @spoken
    def to_frame(self) -> pd.DataFrame:
        """Every candidate with what it adds and what its loss costs, as a ``pandas.DataFrame``.

        Raises:
            MissingExtra: pandas is not installed.
        """
        return self.tables["plan"].to_frame()


KINDS: Mapping[str, type[ResultFile]] = {
    "fit": FitResult,
    "predict": PredictionResult,
    "scan": ScanResult,
    "sample": SampleResult,
    "backtest": BacktestResult,
    "control": ControlResult,
    "plan": PlanResult,
}
"""Kind of a result to its class."""


def _predictions(result: ResultFile) -> ResultTable:
    return result.tables.get("prediction", ResultTable((), ()))


@dataclass(frozen=True, repr=False)
class ModelChoice:
    """Which of several models of the same readings these ask for.

    Args:
        data: evidence and backtest of every model.
    """

    data: ModelComparison

    @property
    def chosen(self) -> str:
        """Name of the model that the readings ask for: the simplest that none beats clearly."""
        return self.data.models[self.data.chosen].name

    @property
    def decided(self) -> bool:
        """Whether all others are clearly worse."""
        return self.data.decided

    @property
    def probabilities(self) -> dict[str, float]:
        """Name to probability, all being as likely before the readings and one of them right."""
        names = [model.name for model in self.data.models]
        return dict(zip(names, self.data.probabilities, strict=True))

    @property
    def sentences(self) -> tuple[str, ...]:
        """What the readings support, in words."""
        return self.data.sentences

    def __str__(self) -> str:
        return models_text(self.data)

    def __repr__(self) -> str:
        parts = ", ".join(f"{name} {100 * p:.2g} %" for name, p in self.probabilities.items())
        how = "clearly" if self.decided else "not clearly"
        return f"ModelChoice({self.chosen} is chosen, {how}; {parts})"

    def _repr_html_(self) -> str:
        sentences = tag("ul", *(tag("li", text) for text in self.sentences))
        return joined([table(models_table(self.data)), sentences, tag("p", MODELS_LEGEND)])


@spoken
def read_result(path: AnyPath) -> ResultFile:
    """Read a result that a command or a call has written.

    Args:
        path: of the result.

    Returns:
        A `FitResult`, `PredictionResult`, `ScanResult`, `SampleResult` or `BacktestResult`.

    Raises:
        InputError: the file is missing, damaged, or no result.
    """
    file = os.fspath(path)
    data, _ = with_outdated(read_file(file), file)
    return KINDS.get(data.kind, ResultFile)(data, file, up_to_date=True)
