"""The result of several sections as HDF5: one group a table, described in docs/result_file.md."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from geoident.errors import InputError
from geoident.io.result.file import PROJECT_FORMAT
from geoident.io.result.hdf5 import (
    TableReader,
    TableWriter,
    hdf5_input,
    hdf5_output,
    plain_text,
    refusal,
    texts,
    visible,
)
from geoident.io.result.tables import COUNTS
from geoident.io.text.atomic import atomic_output
from geoident.model.results.costs import Counts
from geoident.model.results.many.project import (
    CommonParameter,
    LawEstimate,
    LawPoint,
    ProjectResult,
    SectionCovariate,
    SectionEnd,
    SectionParameter,
    SectionReading,
)
from geoident.model.results.result import Iteration, Provenance

_KIND = "fit"
_TEXTS = ("title", "status", "reason")
_NUMBERS = ("objective", "misfit", "above")
_LISTS = ("findings", "notes")
_PROVENANCE = tuple(
    entry.name
    for entry in fields(Provenance)
    if entry.name not in ("versions", "seed", "format", "seconds", "stamp")
)
_TABLES: dict[str, tuple[str, type]] = {
    "common": ("common", CommonParameter),
    "laws": ("laws", LawEstimate),
    "sections": ("sections", SectionEnd),
    "covariates": ("covariates", SectionCovariate),
    "parameters": ("parameters", SectionParameter),
    "readings": ("readings", SectionReading),
    "law_points": ("points", LawPoint),
    "left_out_parameters": ("left_out_parameters", SectionParameter),
    "left_out_readings": ("left_out_readings", SectionReading),
}
_DTYPES: dict[str, Any] = {"float": np.float64, "int": np.int64, "bool": np.int8}


def write_project_result(
    result: ProjectResult, path: str | Path, *, overwrite: bool, inputs: Sequence[str] = ()
) -> tuple[str, ...]:
    """Write the result of a project.

    Args:
        result: what to write.
        path: of the file.
        overwrite: replace an existing file.
        inputs: paths of what the command has read, which are never replaced.

    Returns:
        The path written.

    Raises:
        OutputError: the file exists or cannot be written.
    """
    with (
        atomic_output(path, overwrite=overwrite, inputs=inputs) as temporary,
        hdf5_output(temporary) as file,
    ):
        _write(file, result)
    return (str(path),)


def _write(file: h5py.File, result: ProjectResult) -> None:
    _write_attributes(file, result)
    file.create_group("project")["verbatim"] = plain_text(result.project_text)
    for group, (name, kind) in _TABLES.items():
        rows = getattr(result, name)
        if rows:
            _write_rows(file, group, rows, kind)
    _write_history(file, result.history)


def _write_attributes(file: h5py.File, result: ProjectResult) -> None:
    attributes = file.attrs
    attributes["format"] = PROJECT_FORMAT
    attributes["kind"] = _KIND
    for name in _TEXTS:
        attributes[name] = plain_text(getattr(result, name))
    for name in _NUMBERS:
        attributes[name] = np.float64(getattr(result, name))
    for name in _LISTS:
        if getattr(result, name):
            attributes.create(name, texts(getattr(result, name)), dtype=h5py.string_dtype())
    for name in _PROVENANCE:
        attributes[name] = plain_text(getattr(result.provenance, name))
    for name in COUNTS:
        attributes[name] = np.int64(getattr(result.counts, name))
    attributes["versions"] = plain_text(json.dumps(dict(result.provenance.versions)))
    attributes["seed"] = np.int64(result.provenance.seed)
    if math.isfinite(result.provenance.seconds):
        attributes["seconds"] = np.float64(result.provenance.seconds)
    if result.provenance.stamp:
        attributes["stamp"] = plain_text(result.provenance.stamp)
    attributes["exit_code"] = np.int64(result.exit_code)


def _write_rows(file: h5py.File, group: str, rows: Sequence[Any], kind: type) -> None:
    writer = TableWriter(file, group, {"row": np.arange(len(rows), dtype=np.int64)})
    for entry in fields(kind):
        values = [getattr(row, entry.name) for row in rows]
        if str(entry.type) == "str":
            writer.add(entry.name, [str(value) for value in values], "row")
        else:
            writer.add(entry.name, np.array(values, dtype=_DTYPES[str(entry.type)]), "row")


def _write_history(file: h5py.File, history: Sequence[Iteration]) -> None:
    writer = TableWriter(file, "history", {"iteration": np.arange(len(history), dtype=np.int64)})
    for name in ("objective", "step"):
        values = np.array([getattr(one, name) for one in history], dtype=np.float64)
        writer.add(name, values, "iteration")
    counts = np.array([one.counts.evaluations for one in history], dtype=np.int64)
    writer.add("evaluations", counts, "iteration")
    writer.add("note", [one.note for one in history], "iteration")


def is_project_result(path: str | Path) -> bool:
    """Whether a file is the result of several sections."""
    with suppress(InputError, OSError, ValueError), hdf5_input(path) as file:
        return str(file.attrs.get("format", "")).startswith("geoident-project-result/")
    return False


def read_project_result(path: str | Path) -> ProjectResult:
    """Read back what `write_project_result` wrote.

    Raises:
        InputError: no such file, not such a result, of a version this program does not know, or
            damaged.
    """
    with hdf5_input(path) as file:
        found = file.attrs.get("format")
        if found != PROJECT_FORMAT:
            message = f"format {found!r} is not known; expected {PROJECT_FORMAT!r}"
            hint = "read it with the version of geoident that wrote it, or run the command again"
            raise refusal(path, "unknown-format", message, hint)
        return _read(file)


def _read(file: h5py.File) -> ProjectResult:
    root = file.attrs
    said: dict[str, Any] = {name: visible(str(root[name])) for name in _TEXTS}
    said |= {name: float(root[name]) for name in _NUMBERS}
    said |= {name: tuple(visible(str(t)) for t in root.get(name, ())) for name in _LISTS}
    for group, (name, kind) in _TABLES.items():
        said[name] = _read_rows(file, group, kind) if group in file else ()
    provenance = Provenance(
        versions=json.loads(str(root["versions"])),
        seed=int(root["seed"]),
        format="",
        seconds=float(root.get("seconds", math.nan)),
        stamp=str(root.get("stamp", "")),
        **{name: str(root[name]) for name in _PROVENANCE},
    )
    return ProjectResult(
        **said,
        exit_code=int(root["exit_code"]),
        project_text=TableReader(file, "project").text("verbatim"),
        provenance=provenance,
        counts=Counts(**{name: int(root[name]) for name in COUNTS}),
        history=_read_history(file),
    )


def _read_rows(file: h5py.File, group: str, kind: type[Any]) -> tuple[Any, ...]:
    reader = TableReader(file, group)
    count = len(reader.array("row", "iu"))
    columns: dict[str, Sequence[Any]] = {}
    for entry in fields(kind):
        match str(entry.type):
            case "str":
                columns[entry.name] = reader.texts(entry.name, count)
            case "float":
                columns[entry.name] = reader.floats(entry.name, count).tolist()
            case "bool":
                columns[entry.name] = reader.bools(entry.name, count).tolist()
            case _:
                columns[entry.name] = reader.ints(entry.name, count).tolist()
    return tuple(
        kind(**{name: values[k] for name, values in columns.items()}) for k in range(count)
    )


def _read_history(file: h5py.File) -> tuple[Iteration, ...]:
    reader = TableReader(file, "history")
    count = len(reader.array("iteration", "iu"))
    objective, step = reader.floats("objective", count), reader.floats("step", count)
    evaluations, notes = reader.ints("evaluations", count), reader.texts("note", count)
    return tuple(
        Iteration(
            "gauss-newton", k, float(objective[k]), np.zeros(0), float(step[k]),
            Counts(evaluations=int(evaluations[k])), notes[k],
        )
        for k in range(count)
    )  # fmt: skip
