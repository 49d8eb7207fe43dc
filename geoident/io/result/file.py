"""Result files: HDF5, one group a table, described in docs/result_file.md.

Everything that identifies a result stands in the attributes of the root group. A file appears under
its name only when it is complete (`geoident.io.text.atomic`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from geoident.errors import InputError
from geoident.io.result import (
    backtest,
    opening,
    posterior,
    reading_tables,
    reduced,
    rivals,
    surface,
    tables,
    vtkhdf,
)
from geoident.io.result.hdf5 import (
    TableReader,
    hdf5_input,
    hdf5_output,
    plain_text,
    refusal,
    texts,
    visible,
)
from geoident.io.result.varied import GROUP as VARIED
from geoident.io.result.varied import read_varied, write_varied
from geoident.io.text.atomic import atomic_output
from geoident.model.arrays import Floats
from geoident.model.results.costs import Counts
from geoident.model.results.result import Diagnostics, GaugeTable, Provenance, Result, fingerprint

FORMAT = "geoident-result/2"
WIDE_FORMAT = "geoident-result/1"
"""The format before: no long table of readings."""
PROJECT_FORMAT = "geoident-project-result/1"
"""The format of results of several sections, see `geoident.io.result.project`."""
_RESULT_TEXTS = ("kind", "status", "method", "reason")
_RESULT_LISTS = ("findings", "notes")
_PROVENANCE_TEXTS = tuple(
    entry.name
    for entry in fields(Provenance)
    if entry.name not in ("versions", "seed", "format", "seconds")
    and not entry.name.startswith(("stamp", "fit_"))
)
_MAY_MISS = ("stamp", "fit_file", "fit_fingerprint")
"""Texts of the provenance that not every result has."""


@dataclass(frozen=True)
class ResultIdentity:
    """What tells whether an existing result is up to date.

    Args:
        identity: hash of everything that it depends on.
        kind: the command that wrote it.
        status: how it ended.
        exit_code: of the command.
        case_file: path of its case as seen from the folder of the result.
        seconds: that it took to compute; infinite where that is unknown.
        objective: its misfit.
        stamp: see `geoident.model.results.result.Provenance`.
        fit_file: likewise.
        fit_fingerprint: likewise.
    """

    identity: str
    kind: str
    status: str
    exit_code: int
    case_file: str
    seconds: float
    objective: float = math.nan
    stamp: str = ""
    fit_file: str = ""
    fit_fingerprint: str = ""

    @property
    def fingerprint(self) -> str:
        """See `geoident.model.results.result.Result.fingerprint`."""
        return fingerprint(self.identity, self.status, self.objective)


def write_result(
    result: Result, path: str | Path, *, overwrite: bool, inputs: Sequence[str] = ()
) -> tuple[str, ...]:
    """Writes a result, and beside it a sidecar for ParaView if it has fields.

    The sidecar is put in place first: a complete result always has its sidecar.

    Args:
        result: what to write.
        path: the result file; the sidecar has the suffix ``.vtkhdf`` in place of ``.h5``.
        overwrite: replace an existing file.
        inputs: paths of what the command has read, which are never replaced.

    Returns:
        The paths written, the result first.

    Raises:
        OutputError: a file exists or cannot be written; the result is then as it was before.
    """
    sidecar = vtkhdf.sidecar_path(path)
    with atomic_output(path, overwrite=overwrite, inputs=inputs) as temporary:
        small = result.fields is None and result.reduced is None and result.posterior is None
        with hdf5_output(temporary, small=small) as file:
            _write(file, result)
        if sidecar and result.fields is not None:
            _write_sidecar(sidecar, Path(path).name, overwrite=overwrite, inputs=inputs)
    if sidecar is None or result.fields is None:
        _drop_sidecar(sidecar, Path(path).name)
        return (str(path),)
    return (str(path), str(sidecar))


def _write_sidecar(sidecar: Path, name: str, *, overwrite: bool, inputs: Sequence[str]) -> None:
    """Writes the sidecar; one that points to this result already may be replaced anyway."""
    own = vtkhdf.sidecar_target(sidecar) == name
    with atomic_output(sidecar, overwrite=overwrite or own, inputs=inputs) as temporary:
        vtkhdf.write_sidecar(temporary, name)


def _drop_sidecar(sidecar: Path | None, name: str) -> None:
    """Removes the sidecar of the result that was replaced by one without fields."""
    if sidecar is not None and vtkhdf.sidecar_target(sidecar) == name:
        with suppress(OSError):
            sidecar.unlink()


def _write(file: h5py.File, result: Result) -> None:
    _write_attributes(file, result)
    case = file.create_group("case")
    case["verbatim"] = plain_text(result.case_text)
    case["resolved"] = plain_text(result.case_resolved)
    names, gauges = result.parameters.names, result.gauges
    tables.write_parameters(file, result.parameters, result.singular_values)
    reading_tables.write_gauges(file, gauges)
    reading_tables.write_readings(file, gauges, result.diagnostics, names)
    tables.write_history(file, result.history, names)
    if result.sensitivity is not None:
        tables.write_sensitivity(file, result.sensitivity, gauges, names)
    if result.prediction is not None:
        tables.write_prediction(file, result.prediction, gauges)
    if result.diagnostics is not None:
        reading_tables.write_diagnostics(file, result.diagnostics, gauges, names)
    _write_errors(file, result)
    _write_findings(file, result)
    if result.grid is not None:
        tables.write_grid(file, result.grid)
    write_varied(file, result.varied)
    _write_states(file, result)
    if result.certificate is not None:
        tables.write_certificate(file, result.certificate, names)
    rivals.write_rival_answers(file, result.rivals, result.evidence, result.comparison, names)
    if result.fields is not None:
        vtkhdf.write_fields(file, result.fields, result.varied, result.mechanism)
        if result.mechanism is not None:
            tables.write_mechanism(file, result.mechanism)
    file.attrs["contents"] = " ".join(sorted(file))


def _write_states(file: h5py.File, result: Result) -> None:
    """What the states hold beside their fields: forces, reactions, what yields."""
    if result.members is not None:
        tables.write_members(file, result.members)
    if result.reactions is not None and result.reactions.supports:
        tables.write_reactions(file, result.reactions)
    if result.yielded is not None:
        tables.write_yielded(file, result.yielded)
    if result.reaction is not None:
        opening.write_reaction(file, result.reaction)
    if result.advance is not None:
        opening.write_advance(file, result.advance)


def _write_errors(file: h5py.File, result: Result) -> None:
    """What was estimated of the errors of gauges and model."""
    if result.accuracies is not None:
        reading_tables.write_accuracies(file, result.accuracies)
    if result.model_error is not None:
        tables.write_model_error(file, result.model_error)
    if result.surface is not None:
        surface.write_surface(file, result.surface)


def _write_findings(file: h5py.File, result: Result) -> None:
    """Groups of single commands and options."""
    if result.backtest is not None:
        backtest.write_backtest(file, result.backtest, result.gauges, result.parameters.names)
    if result.posterior is not None:
        posterior.write_posterior(file, result.posterior, result.parameters)
    if result.reduced is not None:
        reduced.write_reduced(file, result.reduced)


def _write_attributes(file: h5py.File, result: Result) -> None:
    attributes = file.attrs
    attributes["format"] = FORMAT
    for name in _RESULT_TEXTS:
        attributes[name] = plain_text(getattr(result, name))
    for name in _RESULT_LISTS:
        if getattr(result, name):
            attributes.create(name, texts(getattr(result, name)), dtype=h5py.string_dtype())
    for name in _PROVENANCE_TEXTS:
        attributes[name] = plain_text(getattr(result.provenance, name))
    for name in tables.COUNTS:
        attributes[name] = np.int64(getattr(result.counts, name))
    attributes["versions"] = plain_text(json.dumps(dict(result.provenance.versions)))
    attributes["seed"] = np.int64(result.provenance.seed)
    if math.isfinite(result.provenance.seconds):
        attributes["seconds"] = np.float64(result.provenance.seconds)
    for name in _MAY_MISS:
        if getattr(result.provenance, name):
            attributes[name] = plain_text(getattr(result.provenance, name))
    attributes["exit_code"] = np.int64(result.exit_code)
    attributes["objective"] = np.float64(result.objective)


def read_identity(path: str | Path) -> ResultIdentity | None:
    """What identifies an existing result; None if there is none, or it is not readable as one."""
    try:
        with hdf5_input(path) as file:
            if file.attrs.get("format") != PROJECT_FORMAT:
                _refuse_unknown_format(file, path)
            root = _Attributes(file, path)
            return ResultIdentity(
                root.text("identity"),
                root.text("kind"),
                root.text("status"),
                root.int("exit_code"),
                root.text("case_file"),
                root.float("seconds", math.inf),
                root.float("objective", math.nan),
                *(root.text(name, "") for name in _MAY_MISS),
            )
    except InputError:
        return None


def read_result(path: str | Path) -> Result:
    """Reads back all that `write_result` wrote.

    Raises:
        InputError: no such file, not a result, of a version this program does not know, truncated
            or damaged; it says which piece is missing.
    """
    with hdf5_input(path) as file:
        _refuse_unknown_format(file, path)
        return _read(file, _Attributes(file, path))


def _refuse_unknown_format(file: h5py.File, path: str | Path) -> None:
    found = file.attrs.get("format")
    if found in (FORMAT, WIDE_FORMAT):
        return
    target = vtkhdf.sidecar_target(path)
    if target is not None:
        hint = f"this is the sidecar for ParaView; the result is {target}"
        raise refusal(path, "not-a-result", "not a result of geoident", hint)
    if found == PROJECT_FORMAT:
        hint = "geoident show and geoident report read it; give one of a case here"
        raise refusal(path, "not-a-result", "the result of several sections, not of a case", hint)
    if not isinstance(found, str) or not found.startswith("geoident-result/"):
        hint = "give the path of a result file, such as CASE.fit.h5"
        raise refusal(path, "not-a-result", "an HDF5 file, but not a result of geoident", hint)
    hint = "read it with the version of geoident that wrote it, or run the command again"
    message = f"format {found!r} is not known; expected {FORMAT!r}"
    raise refusal(path, "unknown-format", message, hint)


class _Attributes:
    """The attributes of the root group; a missing one is named."""

    def __init__(self, file: h5py.File, path: str | Path) -> None:
        self._attributes = file.attrs
        self._path = path

    def text(self, name: str, missing: str | None = None) -> str:
        if missing is not None and name not in self._attributes:
            return missing
        return visible(str(self._get(name)))

    def int(self, name: str, missing: int | None = None) -> int:
        if missing is not None and name not in self._attributes:
            return missing
        return int(self._get(name))

    def float(self, name: str, missing: float | None = None) -> float:
        if missing is not None and name not in self._attributes:
            return missing
        return float(self._get(name))

    def list(self, name: str) -> tuple[str, ...]:
        return tuple(visible(str(text)) for text in self._attributes.get(name, ()))

    def _get(self, name: str) -> Any:
        if name not in self._attributes:
            raise refusal(self._path, "damaged-result", f"the attribute {name!r} is missing")
        return self._attributes[name]


def _read(file: h5py.File, root: _Attributes) -> Result:
    contents = root.text("contents").split()
    parameters, singular = tables.read_parameters(file)
    n = len(parameters.names)
    sensitivity = tables.read_sensitivity(file, n) if "sensitivity" in contents else None
    gauges, diagnostics = _read_readings(file, root, sensitivity, n)
    case = TableReader(file, "case")
    said: dict[str, Any] = {name: root.text(name) for name in _RESULT_TEXTS}
    said |= {name: root.list(name) for name in _RESULT_LISTS}
    fields = vtkhdf.read_fields(file) if vtkhdf.GROUP in contents else None
    moving = fields is not None and tables.MECHANISM in contents
    return Result(
        **said,
        exit_code=root.int("exit_code"),
        objective=root.float("objective"),
        case_text=case.text("verbatim"),
        case_resolved=case.text("resolved"),
        provenance=_read_provenance(root),
        parameters=parameters,
        gauges=gauges,
        counts=Counts(
            **{name: root.int(name, tables.NEWER_COUNTS.get(name)) for name in tables.COUNTS}
        ),
        history=tables.read_history(file, n),
        singular_values=singular,
        sensitivity=sensitivity,
        prediction=tables.read_prediction(file, gauges) if "prediction" in contents else None,
        diagnostics=diagnostics,
        grid=tables.read_grid(file) if "grid" in contents else None,
        members=tables.read_members(file) if "structures" in contents else None,
        reactions=tables.read_reactions(file) if tables.REACTIONS in contents else None,
        yielded=tables.read_yielded(file) if tables.YIELDED in contents else None,
        reaction=opening.read_reaction(file) if opening.GROUP in contents else None,
        advance=opening.read_advance(file) if opening.FACE in contents else None,
        certificate=(tables.read_certificate(file) if "certificate" in contents else None),
        rivals=rivals.read_rivals(file) if rivals.RIVALS in contents else None,
        comparison=rivals.read_models(file) if rivals.MODELS in contents else None,
        evidence=rivals.read_evidence(file) if rivals.EVIDENCE in contents else None,
        fields=fields,
        mechanism=tables.read_mechanism(file, fields.mesh) if fields and moving else None,
        model_error=(tables.read_model_error(file) if tables.MODEL_ERROR in contents else None),
        surface=surface.read_surface(file) if surface.GROUP in contents else None,
        posterior=posterior.read_posterior(file) if posterior.GROUP in contents else None,
        varied=read_varied(file) if VARIED in contents else (),
        reduced=reduced.read_reduced(file) if reduced.GROUP in contents else None,
        accuracies=(
            reading_tables.read_accuracies(file) if reading_tables.ACCURACIES in contents else None
        ),
        backtest=(backtest.read_backtest(file, gauges, n) if backtest.GROUP in contents else None),
    )


def _read_readings(
    file: h5py.File, root: _Attributes, sensitivity: Floats | None, n: int
) -> tuple[GaugeTable, Diagnostics | None]:
    """The readings, and the influence of each; of both formats."""
    diagnosed = "diagnostics" in root.text("contents").split()
    if root.text("format") == WIDE_FORMAT:
        gauges = reading_tables.gauges_of_wide(file, sensitivity)
        found = reading_tables.diagnostics_of_wide(file, gauges, n) if diagnosed else None
        return gauges, found
    gauges = reading_tables.read_gauges(file, n)
    return gauges, reading_tables.read_diagnostics(file, n) if diagnosed else None


def _read_provenance(root: _Attributes) -> Provenance:
    texts_ = {name: root.text(name) for name in _PROVENANCE_TEXTS}
    return Provenance(
        versions=json.loads(root.text("versions")),
        seed=root.int("seed"),
        format=root.text("format").replace(FORMAT, ""),
        seconds=root.float("seconds", math.nan),
        **{name: root.text(name, "") for name in _MAY_MISS},
        **texts_,
    )
