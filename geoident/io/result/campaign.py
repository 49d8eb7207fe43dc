"""What is kept of a campaign: a journal of its runs as they end, and one HDF5 file over all.

The journal, ``runs.jsonl``, has a line for the campaign and one for each run that has ended; the
last line of a run counts. A line that was cut short (power) is passed over. SI units.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableWriter, hdf5_output, plain_text, visible
from geoident.io.text.atomic import atomic_output, make_folder, output_error, refuse_link
from geoident.io.text.campaign_folder import JOURNAL, OVER_ALL, TABLE
from geoident.io.text.lock import locked
from geoident.model.arrays import Floats
from geoident.model.results.costs import COUNTS, Counts
from geoident.model.results.many.campaign import CampaignTable, RunParameter, RunReading, RunRecord

FORMAT = "geoident-campaign-result/1"

_EACH = 3.0
"""Seconds of runs that a power failure may cost."""


@dataclass(frozen=True)
class CampaignHead:
    """What a journal says of its campaign.

    Args:
        title: free text.
        command: that each run is of.
        campaign_file: path of its file, as seen from the folder.
        case_file: of the base case.
        paths: what varies.
        total: number of runs.
        fit_file: path of the fit that is predicted from, as seen from the folder; empty for none.
        fit_fingerprint: `Result.fingerprint` of that fit.
    """

    title: str
    command: str
    campaign_file: str
    case_file: str
    paths: tuple[str, ...]
    total: int
    fit_file: str = ""
    fit_fingerprint: str = ""


def record_object(record: RunRecord) -> dict[str, Any]:
    """A run as an object of JSON, SI; what is not finite is null.

    Args:
        record: of the run.
    """
    parts = {
        "settings": dict(record.settings),
        "parameters": [vars(one) for one in record.parameters],
        "readings": [vars(one) for one in record.readings],
        "counts": vars(record.counts),
    }
    return {key: _plain(parts.get(key, value)) for key, value in vars(record).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _visible(value: Any) -> Any:
    """A value of JSON whose texts say nothing to a terminal."""
    if isinstance(value, dict):
        return {_visible(key): _visible(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_visible(entry) for entry in value]
    return visible(value) if isinstance(value, str) else value


def _record(data: Mapping[str, Any]) -> RunRecord:
    def numbers(entry: Mapping[str, Any]) -> dict[str, Any]:
        return {key: math.nan if value is None else value for key, value in entry.items()}

    plain = dict(data)
    plain["settings"] = tuple(plain["settings"].items())
    plain["parameters"] = tuple(RunParameter(**numbers(p)) for p in plain["parameters"])
    plain["readings"] = tuple(RunReading(**numbers(r)) for r in plain["readings"])
    plain["counts"] = Counts(**plain["counts"])
    plain["losses"] = tuple(plain["losses"])
    return RunRecord(**numbers(plain))


def read_journal(folder: Path) -> tuple[CampaignHead | None, tuple[RunRecord, ...]]:
    """What the journal of a folder says; nothing where there is none.

    Args:
        folder: of the campaign.

    Returns:
        The campaign, and the last record of each run, in the order of their names' first lines.
    """
    try:
        lines = (folder / JOURNAL).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None, ()
    head: CampaignHead | None = None
    records: dict[str, RunRecord] = {}
    for line in lines:
        with suppress(ValueError, TypeError, KeyError, AttributeError):  # cut short
            data = _visible(json.loads(line)) if "\\u00" in line else json.loads(line)
            if "campaign_file" in data:
                head = CampaignHead(**{**data, "paths": tuple(data["paths"])})
            else:
                record = _record(data)
                records[record.name] = record
    return head, tuple(records.values())


def read_head(folder: Path) -> CampaignHead | None:
    """What the journal of a folder says of its campaign, without its runs; None where it is none.

    Args:
        folder: of the campaign.
    """
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError):
        with (folder / JOURNAL).open(encoding="utf-8", errors="replace") as file:
            data = _visible(json.loads(file.readline()))
        if "campaign_file" in data:
            return CampaignHead(**{**data, "paths": tuple(data["paths"])})
    return read_journal(folder)[0]


def tables_are_newer(folder: Path) -> bool:
    """Whether the tables of all runs are there, and were written after the journal."""
    with suppress(OSError):
        written = [(folder / name).stat().st_mtime_ns for name in (JOURNAL, TABLE, OVER_ALL)]
        return written[0] <= min(written[1:])
    return False


class RunJournal:
    """The journal of a campaign that is computed; a context. Only one process has it at a time.

    Args:
        folder: of the campaign, which is made if it is missing.
        head: of the campaign.
        known: records to begin with.

    Raises:
        OutputError: it cannot be written, or another process has it.
    """

    def __init__(self, folder: Path, head: CampaignHead, known: Sequence[RunRecord]) -> None:
        make_folder(folder)
        self._path = folder / JOURNAL
        self._head, self._known = head, known
        self._lock: IO[str] | None = None
        self._file: IO[str] | None = None
        self._synced = time.monotonic()

    def __enter__(self) -> RunJournal:
        lock = self._path.with_name(".lock")
        for name in (JOURNAL, TABLE, OVER_ALL):
            refuse_link(self._path.with_name(name))
        busy = f"{lock.parent}: another geoident computes this campaign now\n    wait for its end"
        self._lock = locked(lock, busy)
        lines = [asdict(self._head), *(record_object(record) for record in self._known)]
        with atomic_output(self._path, overwrite=True, inputs=()) as temporary:
            Path(temporary).write_text("".join(map(_line, lines)), encoding="utf-8")
        self._file = self._path.open("a", encoding="utf-8")
        return self

    def add(self, record: RunRecord) -> None:
        """Keep a run that has ended.

        Raises:
            OutputError: it cannot be written.
        """
        assert self._file is not None
        try:
            self._file.write(_line(record_object(record)))
            self._file.flush()
            if time.monotonic() - self._synced > _EACH:
                os.fsync(self._file.fileno())
                self._synced = time.monotonic()
        except OSError as error:
            raise output_error(self._path, error) from error

    def __exit__(self, *_: object) -> None:
        for file in (self._file, self._lock):
            if file is not None:
                with suppress(OSError):
                    file.close()


def _line(value: Mapping[str, Any]) -> str:
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    return text.encode("utf-8", "backslashreplace").decode() + "\n"


def write_over_all(table: CampaignTable, path: Path, *, inputs: Sequence[str]) -> None:
    """Write all runs into one HDF5 file, described in docs/result_file.md.

    Args:
        table: of the runs.
        path: of the file.
        inputs: paths that were read, and so must not be written.

    Raises:
        OutputError: it cannot be written.
    """
    with (
        atomic_output(path, overwrite=True, inputs=inputs) as temporary,
        hdf5_output(temporary) as file,
    ):
        attributes = file.attrs
        attributes["format"] = FORMAT
        for name in ("title", "command", "campaign_file", "case_file", "created"):
            attributes[name] = plain_text(getattr(table, name))
        attributes["versions"] = plain_text(json.dumps(table.versions))
        attributes["total"] = np.int64(table.total)
        _write_runs(file, table.runs)
        _write_settings(file, table)
        _write_parameters(file, table)
        _write_readings(file, table)


def _write_runs(file: Any, runs: Sequence[RunRecord]) -> None:
    writer = TableWriter(file, "runs", {"run": [run.name for run in runs]})
    for name in ("status", "reason", "file", "host", "key"):
        writer.add(name, [getattr(run, name) for run in runs], "run")
    writer.add("exit_code", np.array([r.exit_code for r in runs], np.int64), "run")
    writer.add("objective", _column([run.objective for run in runs]), "run")
    writer.add("seconds", _column([run.seconds for run in runs]), "run", unit="s")
    lost = np.array([len(run.losses) for run in runs], np.int64)
    writer.add("processes_lost", lost, "run")
    for name in COUNTS:
        counts = np.array([getattr(run.counts, name) for run in runs], np.int64)
        writer.add(name, counts, "run")


def _write_settings(file: Any, table: CampaignTable) -> None:
    axes = {"run": [run.name for run in table.runs], "path": table.paths}
    writer = TableWriter(file, "settings", axes)
    flat = [dict(run.settings).get(path, "") for run in table.runs for path in table.paths]
    values = np.array([plain_text(text) for text in flat], dtype=object)
    shape = (len(table.runs), len(table.paths))
    writer.group.create_dataset("value", data=values.reshape(shape), dtype=h5py.string_dtype())
    for axis, name in enumerate(("run", "path")):
        writer.group["value"].dims[axis].attach_scale(writer.group[name])


def _write_parameters(file: Any, table: CampaignTable) -> None:
    names = table.parameter_names
    axes = {"run": [run.name for run in table.runs], "parameter": names}
    writer = TableWriter(file, "parameters", axes)
    known = {p.name: p for run in table.runs for p in run.parameters}
    writer.add("unit", [known[name].unit for name in names], "parameter")
    writer.add("dimension", [known[name].dimension for name in names], "parameter")
    for column in ("value", "sd", "lower95", "upper95"):
        cells = [{p.name: float(getattr(p, column)) for p in run.parameters} for run in table.runs]
        writer.add(column, _wide(cells, names), "run", "parameter")


def _write_readings(file: Any, table: CampaignTable) -> None:
    """Readings of simulations and predictions, one column for each channel and stage."""
    places = list(dict.fromkeys((r.gauge, r.stage) for run in table.runs for r in run.readings))
    if not places:
        return
    axes: dict[str, Any] = {
        "run": [run.name for run in table.runs],
        "reading": np.arange(len(places), dtype=np.int64),
    }
    writer = TableWriter(file, "readings", axes)
    known = {(r.gauge, r.stage): r for run in table.runs for r in run.readings}
    writer.add("gauge", [gauge for gauge, _ in places], "reading")
    writer.add("stage", [stage for _, stage in places], "reading")
    writer.add("dimension", [known[place].dimension for place in places], "reading")
    for column in ("value", "lower95", "upper95"):
        cells = [
            {(r.gauge, r.stage): float(getattr(r, column)) for r in run.readings}
            for run in table.runs
        ]
        writer.add(column, _wide(cells, places), "run", "reading")


def _wide(cells: Sequence[Mapping[Any, float]], columns: Sequence[Any]) -> Floats:
    rows = [[row.get(name, math.nan) for name in columns] for row in cells]
    return np.array(rows, dtype=np.float64).reshape(len(cells), len(columns))


def _column(values: Sequence[float]) -> Floats:
    return np.array(values, dtype=np.float64)


def is_campaign(path: str) -> bool:
    """Whether a path is the folder of a campaign, or its file over all."""
    place = Path(path)
    with suppress(OSError, ValueError):  # too long or strange for a name
        return (place / JOURNAL).is_file() or (place.name == OVER_ALL and place.is_file())
    return False
