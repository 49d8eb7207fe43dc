"""All runs of a case that were ever made, so that none is made again: ``CASE.runs/runs.jsonl``.

Beside it lie the folders of runs, each of which only one run has.

One object of JSON a line, added when its run ends: what was written for it, what it gave or why
it failed, how long it took. Numbers are there with all their digits. A line that was cut short by
the end of a process is passed over, and so are runs of another model.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geoident.errors import OutputError
from geoident.forward.external.runs import FailedRun
from geoident.io.text.atomic import refuse_link
from geoident.model.arrays import Floats

FILE = "runs.jsonl"


@dataclass(frozen=True)
class CompletedRun:
    """A run that was made.

    Args:
        result: what it gave (...), SI, or why it failed.
        seconds: it took.
    """

    result: Floats | FailedRun
    seconds: float


class RunLog:
    """The runs of one model.

    Args:
        folder: of the runs.
        model: digest of all that decides what a run gives.
        again: runs that failed are forgotten.
    """

    def __init__(self, folder: Path, model: str, *, again: bool = False) -> None:
        self._file, self._model, self._lock = folder / FILE, model, threading.Lock()
        self._known: dict[str, CompletedRun] = {}
        try:
            lines = self._file.read_text(encoding="utf-8").splitlines()
        except OSError:
            lines = []
        for line in lines:
            self._take(line, again=again)

    def find(self, key: str) -> CompletedRun | None:
        """The run of a key, or None."""
        return self._known.get(key)

    def add(self, key: str, made: CompletedRun, values: Mapping[str, float]) -> None:
        """Keep a run.

        Args:
            key: of what was written for it.
            made: what came of it.
            values: parameters by name, SI.

        Raises:
            OutputError: it cannot be written.
        """
        result = made.result
        entry: dict[str, Any] = {"model": self._model, "key": key, "parameters": dict(values)}
        if isinstance(result, FailedRun):
            entry |= {"failed": result.reason, "folder": result.folder}
        else:
            entry |= {"readings": _plain(result)}
        line = json.dumps({**entry, "seconds": round(made.seconds, 4)}) + "\n"
        with self._lock:
            self._known[key] = made
            try:
                refuse_link(self._file)
                self._file.parent.mkdir(parents=True, exist_ok=True)
                with self._file.open("ab") as file:  # one write: lines of others stay whole
                    file.write(line.encode())
                    file.flush()
                    os.fsync(file.fileno())
            except OSError as error:
                message = f"{self._file}: a run cannot be kept: {error.strerror or error}"
                raise OutputError(message) from error

    def _take(self, line: str, *, again: bool) -> None:
        try:
            entry = json.loads(line)
            if entry["model"] != self._model or (again and "failed" in entry):
                return
            result: Floats | FailedRun
            if "failed" in entry:
                result = FailedRun(str(entry["failed"]), str(entry["folder"]))
            else:
                result = np.array(entry["readings"], dtype=np.float64)
            self._known[str(entry["key"])] = CompletedRun(result, float(entry["seconds"]))
        except (ValueError, KeyError, TypeError):
            return


def _plain(values: Floats) -> Any:
    """Nested lists, with None where nothing is given."""
    if values.ndim > 1:
        return [_plain(part) for part in values]
    return [None if np.isnan(value) else float(value) for value in values]


_prefix = [""]
"""What names of folders of runs begin with in this process."""


def set_folder_prefix(prefix: str) -> None:
    """Let names of folders of runs begin with something that no other process has.

    Folders of several machines then lie beside each other in one.

    Args:
        prefix: of the names.
    """
    _prefix[0] = prefix


def new_folder(folder: Path) -> Path:
    """A folder that no other run has, below that of all runs: 00001, 00002, ...

    Raises:
        OutputError: it cannot be made.
    """
    prefix = _prefix[0]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = [path.name.removeprefix(prefix) for path in folder.iterdir()]
        number = max((int(name) for name in names if name.isdigit()), default=0) + 1
        while True:
            with suppress(FileExistsError):
                place = folder / f"{prefix}{number:05d}"
                place.mkdir()
                return place
            number += 1
    except OSError as error:
        message = f"{folder}: a folder for a run cannot be made: {error.strerror or error}"
        raise OutputError(message) from error
