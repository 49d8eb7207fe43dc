"""``/backtest`` of a result: fits of the first stages, and what they said of the later ones.

Axes: ``fit`` (the last stage whose readings it used), ``gauge`` (a channel), ``stage``,
``parameter``, ``horizon`` (``next`` stage that was read, ``further``), ``skipped``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, refusal
from geoident.io.result.reading_tables import reading_unit
from geoident.io.result.tables import COUNTS, read_counts
from geoident.model.arrays import Floats
from geoident.model.results.backtest import Backtest, BacktestStep, Scores, Skipped
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.result import GaugeTable

GROUP = "backtest"
_HORIZONS = ("next", "further")
_BANDS = ("mean", "sd", "lower95", "upper95")
_PARAMETERS = {"value": "values"} | {name: name for name in ("sd", "lower95", "upper95")}
_WHOLE = ("readings", "open", "inside")


def write_backtest(
    file: h5py.File, found: Backtest, gauges: GaugeTable, names: Sequence[str]
) -> None:
    """Writes ``/backtest``, SI.

    Args:
        file: the result.
        found: what to write.
        gauges: channels and stages.
        names: of the n parameters.
    """
    steps = found.steps
    axes = {
        "fit": [gauges.stages[step.last] for step in steps],
        "gauge": gauges.channels,
        "stage": gauges.stages,
        "parameter": names,
        "horizon": _HORIZONS,
        "skipped": [one.stage for one in found.skipped],
    }
    out = TableWriter(file, GROUP, axes)
    out.add("why_skipped", [one.why for one in found.skipped], "skipped")
    for name in ("last", "readings"):
        out.add(name, np.array([getattr(step, name) for step in steps], dtype=np.int64), "fit")
    for name in ("status", "reason"):
        out.add(name, [getattr(step, name) for step in steps], "fit")
    for name in COUNTS:
        counts = np.array([getattr(step.counts, name) for step in steps], dtype=np.int64)
        out.add(name, counts, "fit")
    shape = len(steps), len(names)
    for name, field in _PARAMETERS.items():
        out.add(f"parameter_{name}", _stacked(steps, field, shape), "fit", "parameter")
    determined = np.array([step.determined for step in steps], dtype=np.bool_)
    out.add("determined", determined.reshape(shape), "fit", "parameter")
    wide, unit = (len(steps), *gauges.computed.shape), reading_unit(gauges)
    for name in _BANDS:
        values = np.array([getattr(step.prediction, name) for step in steps], dtype=np.float64)
        out.add(name, values.reshape(wide), "fit", "gauge", "stage", unit=unit)
    out.add("log_density", _stacked(steps, "log_density", wide), "fit", "gauge", "stage")
    excess = _stacked(steps, "excess", (len(steps), len(gauges.stages)))
    out.add("stress_excess", excess, "fit", "stage")
    out.add("measured", found.measured, "gauge", "stage", unit=unit)
    both = found.next, found.further
    for entry in fields(Scores):
        kind = np.int64 if entry.name in _WHOLE else np.float64
        name = "predicted" if entry.name == "readings" else entry.name
        out.add(name, np.array([getattr(one, entry.name) for one in both], dtype=kind), "horizon")
    for name in ("few", "far"):
        out.group.attrs[name] = np.float64(getattr(found, name))


def _stacked(steps: Sequence[BacktestStep], name: str, shape: tuple[int, ...]) -> Floats:
    return np.array([getattr(step, name) for step in steps], dtype=np.float64).reshape(shape)


def read_backtest(file: h5py.File, gauges: GaugeTable, n: int) -> Backtest:
    """What `write_backtest` wrote.

    Args:
        file: the result.
        gauges: channels and stages.
        n: number of parameters.
    """
    group = TableReader(file, GROUP)
    k = len(group.texts("fit"))
    skipped = group.texts("skipped")
    whys = group.texts("why_skipped", len(skipped))
    return Backtest(
        steps=_read_steps(group, gauges, k, n),
        skipped=tuple(Skipped(*pair) for pair in zip(skipped, whys, strict=True)),
        next=_read_scores(group, 0),
        further=_read_scores(group, 1),
        few=group.attribute("few", float),
        far=group.attribute("far", float),
        measured=group.floats("measured", *gauges.computed.shape),
    )


def _read_steps(group: TableReader, gauges: GaugeTable, k: int, n: int) -> tuple[BacktestStep, ...]:
    wide = (k, *gauges.computed.shape)
    last, readings = (group.ints(name, k).tolist() for name in ("last", "readings"))
    if not {*last} <= {*range(len(gauges.stages))}:
        message = f"{group.name}/last names a stage that is not there"
        raise refusal(group.group.file.filename, "damaged-result", message)
    status, reason = (group.texts(name, k) for name in ("status", "reason"))
    counts = np.stack([read_counts(group, name, k) for name in COUNTS], axis=1)
    columns = {f: group.floats(f"parameter_{name}", k, n) for name, f in _PARAMETERS.items()}
    determined = group.bools("determined", k, n)
    bands = {name: group.floats(name, *wide) for name in _BANDS}
    density = group.floats("log_density", *wide)
    excess = group.floats("stress_excess", k, len(gauges.stages))
    return tuple(
        BacktestStep(
            last=last[i],
            readings=readings[i],
            status=status[i],
            reason=reason[i],
            **{name: column[i] for name, column in columns.items()},
            determined=determined[i],
            prediction=Prediction(**{name: values[i] for name, values in bands.items()}),
            log_density=density[i],
            excess=excess[i],
            counts=Counts(*counts[i].tolist()),
        )
        for i in range(k)
    )


def _read_scores(group: TableReader, row: int) -> Scores:
    def value(name: str) -> float:
        return float(group.floats(name, len(_HORIZONS))[row])

    def whole(name: str) -> int:
        return int(group.ints(name, len(_HORIZONS))[row])

    return Scores(
        readings=whole("predicted"),
        open=whole("open"),
        inside=whole("inside"),
        rms=value("rms"),
        sharpness=value("sharpness"),
        interval_score=value("interval_score"),
        log_score=value("log_score"),
    )
