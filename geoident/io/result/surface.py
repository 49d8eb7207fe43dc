"""The response surfaces of a table of runs in a result: ``/surface``."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, plain_text
from geoident.model.results.surface import SurfaceTable

GROUP = "surface"

_TEXTS = {"gauge": "channels", "stage": "stages", "kind": "words", "display_unit": "units",
          "dimension": "dimensions"}  # fmt: skip
_NUMBERS = ("left_out", "own", "accuracy", "lower", "upper")


def write_surface(file: h5py.File, table: SurfaceTable) -> None:
    """Writes ``/surface``: a row for each column of readings.

    Args:
        file: the result.
        table: the surfaces.
    """
    out = TableWriter(file, GROUP, {"column": np.arange(len(table))})
    out.group.attrs["file"] = plain_text(table.file)
    out.group.attrs["runs"] = np.int64(table.runs)
    for name, key in _TEXTS.items():
        out.add(name, list(getattr(table, key)), "column")
    for name in _NUMBERS:
        out.add(name, getattr(table, name), "column")


def read_surface(file: h5py.File) -> SurfaceTable:
    """The response surfaces of a fit."""
    group = TableReader(file, GROUP)
    rows = len(group.array("column", "iu"))
    texts: dict[str, Any] = {key: group.texts(name, rows) for name, key in _TEXTS.items()}
    numbers: dict[str, Any] = {name: group.floats(name, rows) for name in _NUMBERS}
    runs = int(group.attribute("runs", float))
    return SurfaceTable(file=group.attribute("file", str), runs=runs, **texts, **numbers)
