"""The tables of rivals in a result file: other minima, evidence, several models compared."""

from __future__ import annotations

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter
from geoident.model.results.rivals import Evidence, ModelComparison, ModelScore, Rivals

RIVALS = "rivals"
EVIDENCE = "evidence"


def write_rival_answers(
    file: h5py.File,
    rivals: Rivals | None,
    evidence: Evidence | None,
    comparison: ModelComparison | None,
    names: tuple[str, ...],
) -> None:
    """Writes ``/rivals``, ``/evidence`` and ``/models``, each where there is one.

    Args:
        file: the result.
        rivals: other minima.
        evidence: of the model.
        comparison: of several models.
        names: of the parameters.
    """
    if comparison is not None:
        _write_models(file, comparison)
    if rivals is not None:
        _write_rivals(file, rivals, names)
    if evidence is not None:
        _write_evidence(file, evidence)


def _write_rivals(file: h5py.File, found: Rivals, names: tuple[str, ...]) -> None:
    """Writes ``/rivals``: one row a minimum, the lowest first.

    Args:
        file: the result.
        found: the minima.
        names: of the parameters.
    """
    rows = np.arange(len(found), dtype=np.int64)
    out = TableWriter(file, RIVALS, {"minimum": rows, "parameter": names, "other": names})
    out.add("value", found.values, "minimum", "parameter", unit="SI unit of the parameter")
    out.add("objective", found.objectives, "minimum")
    out.add("odds", found.odds, "minimum")
    out.add("covariance", found.covariance, "minimum", "parameter", "other")


def read_rivals(file: h5py.File) -> Rivals:
    """The minima."""
    group = TableReader(file, RIVALS)
    k, n = len(group.array("minimum", "i")), len(group.texts("parameter"))
    return Rivals(
        values=group.floats("value", k, n),
        objectives=group.floats("objective", k),
        odds=group.floats("odds", k),
        covariance=group.floats("covariance", k, n, n),
    )


def _write_evidence(file: h5py.File, found: Evidence) -> None:
    """Writes ``/evidence``: attributes of an empty group."""
    group = file.create_group(EVIDENCE)
    group.attrs["log_evidence"] = np.float64(found.log_evidence)
    group.attrs["log_likelihood"] = np.float64(found.log_likelihood)
    group.attrs["readings"] = np.int64(found.readings)


def read_evidence(file: h5py.File) -> Evidence:
    """How well the model explains the readings."""
    group = TableReader(file, EVIDENCE)
    return Evidence(
        log_evidence=group.attribute("log_evidence", float),
        log_likelihood=group.attribute("log_likelihood", float),
        readings=int(group.attribute("readings", float)),
    )


MODELS = "models"
_MODEL_NUMBERS = ("objective", "log_evidence", "log_likelihood", "backtest")
_MODEL_COUNTS = ("parameters", "backtested", "modes")


def _write_models(file: h5py.File, found: ModelComparison) -> None:
    """Writes ``/models``: one row a model, from the simplest on."""
    models = found.models
    names = tuple(model.name for model in models)
    out = TableWriter(file, MODELS, {"model": names, "sentence": found.sentences})
    out.add("path", [model.path for model in models], "model")
    out.add("status", [model.status for model in models], "model")
    for name in _MODEL_NUMBERS:
        out.add(name, np.array([getattr(m, name) for m in models], dtype=np.float64), "model")
    for name in _MODEL_COUNTS:
        out.add(name, np.array([getattr(m, name) for m in models], dtype=np.int64), "model")
    out.group.attrs["chosen"] = np.int64(found.chosen)
    out.group.attrs["decided"] = np.int64(found.decided)
    out.group.attrs["readings"] = np.int64(found.readings)


def read_models(file: h5py.File) -> ModelComparison:
    """The comparison of several models."""
    group = TableReader(file, MODELS)
    names = group.texts("model")
    k = len(names)
    paths, statuses = group.texts("path", k), group.texts("status", k)
    numbers = {name: group.floats(name, k).tolist() for name in _MODEL_NUMBERS}
    counts = {name: group.ints(name, k).tolist() for name in _MODEL_COUNTS if name in group}
    models = tuple(
        ModelScore(
            name=names[i],
            path=paths[i],
            status=statuses[i],
            **{name: column[i] for name, column in {**numbers, **counts}.items()},
        )
        for i in range(k)
    )
    whole = {name: int(group.attribute(name, float)) for name in ("chosen", "decided", "readings")}
    return ModelComparison(
        models=models,
        chosen=whole["chosen"],
        decided=bool(whole["decided"]),
        readings=whole["readings"],
        sentences=group.texts("sentence"),
    )
