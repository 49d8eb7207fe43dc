"""Tables of what was found: parameters and channels by name, and all of them as data frames."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from geoident.api.calling import needed
from geoident.io.text.wording import did_you_mean, listing
from geoident.model.arrays import Bools, Floats
from geoident.model.results.result import GaugeTable, ParameterTable, Result
from geoident.report.page.html import table as html_table
from geoident.report.text.case import stage_dates
from geoident.report.text.csv_tables import csv_tables
from geoident.report.text.layout import TextTable, number
from geoident.report.text.parameters import (
    parameter_table,
    parameters_sheet,
    parameters_text,
    value_cells,
)
from geoident.report.text.rows import CsvCell, CsvTable
from geoident.units import shown_unit, si_unit

if TYPE_CHECKING:
    import pandas as pd

_Named = TypeVar("_Named")
_MOST_ROWS = 30
"""Rows of a table that are shown; a data frame has them all."""


@dataclass(frozen=True, repr=False)
class ResultTable:
    """One table of a result, in the units of the case: the one that ``geoident export`` writes.

    Args:
        header: names of the columns.
        rows: the cells, row by row; NaN where there is no value or none is determined.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[CsvCell, ...], ...]

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, name: str) -> tuple[CsvCell, ...]:
        """The cells of a column, top down.

        Raises:
            KeyError: there is no such column.
        """
        place = self.header.index(_known(name, self.header, "column"))
        return tuple(row[place] for row in self.rows)

    def to_frame(self) -> pd.DataFrame:
        """The table as a ``pandas.DataFrame``, one row each.

        Raises:
            MissingExtra: pandas is not installed.
        """
        return _frame({name: self.column(name) for name in self.header})

    @property
    def _text(self) -> TextTable:
        shown = [[_cell(cell) for cell in row] for row in self.rows[:_MOST_ROWS]]
        if len(self) > _MOST_ROWS:
            rest = f"... {len(self) - _MOST_ROWS} more"
            shown.append([rest, *[""] * (len(self.header) - 1)])
        first = self.rows[0] if self.rows else ()
        return TextTable(self.header, shown, right="".join("lr"[_is_number(c)] for c in first))

    def __repr__(self) -> str:
        return self._text.text or f"ResultTable({', '.join(self.header)}; no rows)"

    def _repr_html_(self) -> str:
        return html_table(self._text)


def dates_of(result: Result) -> NDArray[np.datetime64] | None:
    """When the stages end, (n_stages,), to the second; None where no stage is dated."""
    seconds = stage_dates(result)
    if not np.isfinite(seconds).any():
        return None
    known = np.isfinite(seconds)
    dates = np.full(len(seconds), np.datetime64("NaT", "s"))
    dates[known] = seconds[known].astype("datetime64[s]")
    return dates.astype("datetime64[ns]")  # as pandas and xarray want them


def tables_of(result: Result) -> dict[str, ResultTable]:
    """Name to table, those without rows left out."""
    return {name: _table(table) for name, table in csv_tables(result).items()}


def _table(table: CsvTable) -> ResultTable:
    return ResultTable(table.header, table.rows)


@dataclass(frozen=True)
class ParameterEstimate:
    """One identified parameter, SI.

    Args:
        value: the estimate; NaN where neither readings nor prior determine it.
        sd: its standard deviation, about that of its prior where only that knows it; NaN where
            neither readings nor prior determine it.
        lower95, upper95: its 95 % interval.
        unit: the SI unit.
        at_bound: it lies on a bound.
        determined: the readings (with its prior) determine it, not the prior alone; on a bound, how
            far from it the ground may be.
        text: the same in the unit of the case, as people write it.
    """

    value: float
    sd: float
    lower95: float
    upper95: float
    unit: str
    at_bound: bool
    determined: bool
    text: str = ""

    def __str__(self) -> str:
        return self.text


class Parameters(Mapping[str, ParameterEstimate]):
    """The identified parameters by name, without the coefficients of fields.

    Args:
        result: with the parameters.
    """

    def __init__(self, result: Result) -> None:
        self._result = result.for_people

    @property
    def _table(self) -> ParameterTable:
        return self._result.parameters

    def __getitem__(self, name: str) -> ParameterEstimate:
        table = self._table
        i = table.names.index(_known(name, table.names, "parameter"))
        return ParameterEstimate(
            value=float(table.values[i]) if table.known[i] else math.nan,
            sd=float(table.sd[i]),
            lower95=float(table.lower95[i]),
            upper95=float(table.upper95[i]),
            unit=si_unit(table.dimensions[i]),
            at_bound=bool(table.at_bound[i]),
            determined=bool(table.determined[i]),
            text=_in_words(table, i),
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self._table.names)

    def __len__(self) -> int:
        return len(self._table.names)

    @property
    def values_si(self) -> dict[str, float]:
        """Name to value, SI; NaN where it is not determined."""
        return {name: estimate.value for name, estimate in self.items()}

    def to_frame(self, *, si: bool = False) -> pd.DataFrame:
        """The parameters as a ``pandas.DataFrame``, one row each, their names as the index.

        Columns: those of the table ``parameters`` of ``geoident export``. What is not determined,
        and an open bound, is NaN.

        Args:
            si: SI units in place of those of the case.

        Raises:
            MissingExtra: pandas is not installed.
        """
        table = parameters_sheet(self._result, si=si)
        columns = zip(*table.rows, strict=True) if table.rows else ((),) * len(table.header)
        frame = _frame(dict(zip(table.header, columns, strict=True)))
        return frame.set_index("parameter")

    def __repr__(self) -> str:
        return parameters_text(self._table, self._result.certificate) or "no parameters"

    def _repr_html_(self) -> str:
        return html_table(parameter_table(self._table))


def _in_words(table: ParameterTable, i: int) -> str:
    """Value and interval of a parameter in the unit of the case."""
    value, interval = value_cells(table, i)
    if not table.determined[i]:
        return value
    text = f"{value} {shown_unit(table.units[i], table.dimensions[i])}".rstrip()
    return f"{text} (95 %: {interval})" if interval else text


def summary_of(parameters: Parameters, *, most: int) -> str:
    """The parameters in one line, as far as they are determined.

    Args:
        parameters: of a result.
        most: parameters at most.
    """
    texts = [
        f"{name} = {estimate.text}" if estimate.determined else f"{name} {estimate.text}"
        for name, estimate in list(parameters.items())[:most]
    ]
    more = len(parameters) - most
    return "; ".join([*texts, f"{more} more"] if more > 0 else texts)


@dataclass(frozen=True)
class ChannelReadings:
    """One channel, stage by stage, SI; NaN where there is nothing.

    Args:
        channel: its name.
        gauge: name of the instrument to which it belongs.
        unit: the SI unit.
        stages: names of the stages.
        measured: (n_stages,) readings.
        computed: (n_stages,) the model at the estimate.
        sd: (n_stages,) standard deviation of each reading.
        used: (n_stages,) the reading took part in the fit.
        predicted: (n_stages,) what is predicted of stages that took no part.
        lower95, upper95: (n_stages,) 95 % band of that.
    """

    channel: str
    gauge: str
    unit: str
    stages: tuple[str, ...]
    measured: Floats
    computed: Floats
    sd: Floats
    used: Bools
    predicted: Floats
    lower95: Floats
    upper95: Floats

    def at(self, stage: str) -> tuple[float, float]:
        """What was measured and what is computed at a stage, SI; NaN for nothing.

        Raises:
            KeyError: there is no such stage.
        """
        j = self.stages.index(_known(stage, self.stages, "stage"))
        return float(self.measured[j]), float(self.computed[j])


class GaugeReadings(Mapping[str, ChannelReadings]):
    """The channels of all gauges by name: what was read of them, and what the model says.

    Args:
        result: with the readings.
    """

    def __init__(self, result: Result) -> None:
        self._result = result.for_people

    @property
    def _table(self) -> GaugeTable:
        return self._result.gauges

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages, in their order."""
        return self._table.stages

    def __getitem__(self, name: str) -> ChannelReadings:
        table, prediction = self._table, self._result.prediction
        i = table.channels.index(_known(name, table.channels, "channel"))
        nothing = np.full(len(table.stages), np.nan)
        return ChannelReadings(
            name,
            table.gauges[i],
            si_unit(table.dimensions[i]),
            table.stages,
            table.measured[i],
            table.computed[i],
            table.sd[i],
            table.used[i],
            predicted=nothing if prediction is None else prediction.mean[i],
            lower95=nothing if prediction is None else prediction.lower95[i],
            upper95=nothing if prediction is None else prediction.upper95[i],
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self._table.channels)

    def __len__(self) -> int:
        return len(self._table.channels)

    def to_frame(self, *, si: bool = False) -> pd.DataFrame:
        """All channels as a ``pandas.DataFrame``, one row for each channel and stage.

        Columns: gauge, channel, stage, date (where stages are dated), measured, computed, residual,
        sd, predicted, lower95, upper95, unit, used, bad. Rows with neither a reading nor a computed
        value are left out.

        Args:
            si: SI units in place of those of the case.

        Raises:
            MissingExtra: pandas is not installed.
        """
        table, prediction = self._table, self._result.prediction
        nothing = np.full_like(table.computed, np.nan)
        columns = {
            "measured": table.measured,
            "computed": table.computed,
            "residual": table.measured - table.computed,
            "sd": table.sd,
            "predicted": nothing if prediction is None else prediction.mean,
            "lower95": nothing if prediction is None else prediction.lower95,
            "upper95": nothing if prediction is None else prediction.upper95,
        }
        present = np.isfinite(table.measured) | np.isfinite(table.computed)
        j, i = np.nonzero(present.T)
        dates = dates_of(self._result)
        units = [si_unit(d) for d in table.dimensions] if si else list(table.shown_units)
        shown = {name: v if si else table.in_units(v) for name, v in columns.items()}
        return _frame(
            {
                "gauge": [table.gauges[k] for k in i],
                "channel": [table.channels[k] for k in i],
                "stage": [table.stages[k] for k in j],
                **({"date": dates[j]} if dates is not None else {}),
                **{name: values[i, j] for name, values in shown.items()},
                "unit": [units[k] for k in i],
                "used": table.used[i, j],
                "bad": table.bad[i, j],
            }
        )

    @property
    def _shown(self) -> ResultTable:
        gauges = csv_tables(self._result).get("gauges")
        return ResultTable((), ()) if gauges is None else _table(gauges)

    def __repr__(self) -> str:
        return repr(self._shown) if len(self._shown) else "no channels"

    def _repr_html_(self) -> str:
        return self._shown._repr_html_()


def _known(name: str, names: Sequence[str], kind: str) -> str:
    """A name that is there.

    Raises:
        KeyError: it is not.
    """
    if name in names:
        return name
    within = [known for known in names if known.startswith(f"{name}.")]
    hint = f"Its {kind}s: {listing(within)}." if within else ""
    msg = f"no {kind} {name!r}. {hint or did_you_mean(name, names, what=f'{kind.capitalize()}s')}"
    raise KeyError(msg)


def _frame(columns: Mapping[str, object]) -> pd.DataFrame:
    frame: pd.DataFrame = needed("pandas", extra="notebook", what="to_frame").DataFrame(columns)
    return frame


def _cell(cell: CsvCell) -> str:
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return number(cell) if isinstance(cell, float) else str(cell)


def _is_number(cell: CsvCell) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)
