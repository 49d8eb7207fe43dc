"""Draws of a posterior in the groups that ArviZ opens: ``arviz.from_netcdf(path)``.

``/posterior`` has one variable a parameter (chain, draw), in SI units; the modes of a field
together (chain, draw, mode). ``/posterior_predictive`` has the predicted ``readings`` (chain, draw,
reading), with ``channel`` and ``stage_name`` of each; where there are many, of every few draws.
``/sample_stats`` has the log density ``lp``. How reliable the draws are stands in the
attributes of ``/posterior`` and in ``/posterior_summary``.
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, plain_text
from geoident.model.arrays import Floats, Ints
from geoident.model.results.posterior import LEVELS, PosteriorDraws
from geoident.model.results.result import ParameterTable
from geoident.units import DIMENSIONS

GROUP = "posterior"
_SUMMARY = "posterior_summary"
_AXES = ("chain", "draw")
NamedAxes = dict[str, Sequence[str] | Floats | Ints]
"""Name of every dimension to its coordinates."""
_NUMBERS = ("pareto_k", "acceptance")


def write_posterior(file: h5py.File, posterior: PosteriorDraws, table: ParameterTable) -> None:
    """Writes ``/posterior``, ``/sample_stats``, ``/posterior_predictive``, ``/posterior_summary``.

    Args:
        file: the result.
        posterior: the draws.
        table: of the same parameters.
    """
    chains, length = posterior.log_density.shape
    axes: NamedAxes = {"chain": np.arange(chains), "draw": np.arange(length)}
    variables = _grouped(posterior.names, posterior.fields)
    modes = {
        f"{name}_mode": np.arange(1, 1 + len(i)) for name, i in variables.items() if len(i) > 1
    }
    out = TableWriter(file, GROUP, {**axes, **modes})
    for name, columns in variables.items():
        unit = DIMENSIONS.get(table.dimensions[columns[0]], "")
        if len(columns) > 1:
            out.add(name, posterior.values[:, :, columns], *_AXES, f"{name}_mode")
        else:
            out.add(name, posterior.values[:, :, columns[0]], *_AXES, unit=unit)
    attributes = out.group.attrs
    attributes["effective_size"] = np.float64(posterior.least_effective)
    attributes["sampler"] = plain_text(posterior.sampler)
    attributes["evaluations"] = np.int64(posterior.evaluations)
    for name in _NUMBERS:
        attributes[name] = np.float64(getattr(posterior, name))
    stats = TableWriter(file, "sample_stats", axes)
    stats.add("lp", posterior.log_density, *_AXES)
    _write_predictive(file, posterior, chains)
    _write_summary(file, posterior)


def _write_predictive(file: h5py.File, posterior: PosteriorDraws, chains: int) -> None:
    readings = [f"{c} at {s}" for c, s in zip(posterior.channels, posterior.stages, strict=True)]
    axes: NamedAxes = {"chain": np.arange(chains), "draw": posterior.taken, "reading": readings}
    out = TableWriter(file, "posterior_predictive", axes)
    out.add("readings", posterior.predicted, *_AXES, "reading")
    out.add("channel", posterior.channels, "reading")
    out.add("stage_name", posterior.stages, "reading")


def _write_summary(file: h5py.File, posterior: PosteriorDraws) -> None:
    axes: NamedAxes = {"parameter": posterior.names, "quantile": np.array(LEVELS)}
    out = TableWriter(file, _SUMMARY, axes)
    out.add("mean", posterior.mean, "parameter")
    out.add("sd", posterior.sd, "parameter")
    out.add("quantiles", posterior.quantiles, "parameter", "quantile")
    out.add("ess", posterior.effective, "parameter")
    out.add("r_hat", posterior.r_hat, "parameter")
    out.add("field", posterior.fields, "parameter")


def read_posterior(file: h5py.File) -> PosteriorDraws:
    """The draws."""
    summary, group = TableReader(file, _SUMMARY), TableReader(file, GROUP)
    names = summary.texts("parameter")
    n, chains = len(names), len(group.array("chain", "iu"))
    length = len(group.array("draw", "iu"))
    fields = summary.texts("field", n)
    values = np.empty((chains, length, n))
    for name, columns in _grouped(names, fields).items():
        if len(columns) > 1:
            values[:, :, columns] = group.floats(name, chains, length, len(columns))
        else:
            values[:, :, columns[0]] = group.floats(name, chains, length)
    predictive = TableReader(file, "posterior_predictive")
    taken, channels = predictive.array("draw", "iu"), predictive.texts("channel")
    return PosteriorDraws(
        names=names,
        fields=fields,
        values=values,
        log_density=TableReader(file, "sample_stats").floats("lp", chains, length),
        sampler=group.attribute("sampler", str),
        pareto_k=group.attribute("pareto_k", float),
        effective=summary.floats("ess", n),
        r_hat=summary.floats("r_hat", n),
        acceptance=group.attribute("acceptance", float),
        evaluations=int(group.attribute("evaluations", float)),
        channels=channels,
        stages=predictive.texts("stage_name", len(channels)),
        predicted=predictive.floats("readings", chains, len(taken), len(channels)),
        taken=taken.astype(np.int64),
    )


def _grouped(names: Sequence[str], fields: Sequence[str]) -> dict[str, Ints]:
    """Names of variables, which must not be those of axes, to the numbers of their parameters."""
    groups: dict[str, list[int]] = {}
    for i, (name, of_field) in enumerate(zip(names, fields, strict=True)):
        variable = of_field or name
        groups.setdefault(f"{variable}_" if variable in _AXES else variable, []).append(i)
    return {name: np.array(numbers, dtype=np.int64) for name, numbers in groups.items()}
