"""Draws of a posterior, as a table, for other programs and for spreadsheets."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from geoident.model.results.posterior import LEVELS, PosteriorDraws
from geoident.model.results.result import Result
from geoident.report.text.layout import TextTable, decimals, number, with_interval
from geoident.report.text.parameters import AS_PRIOR, headers, unit_of, unknown_words
from geoident.report.text.rows import CsvRow, CsvTable, beside, sheet
from geoident.units import in_unit, shown_unit, si_unit

TITLE = "Posterior: draws of the parameters"
AS_BOUNDS = "as its bounds"
_SHOWN = (0.025, 0.25, 0.5, 0.75, 0.975)


def posterior_table(result: Result) -> TextTable:
    """One row a parameter: mean, standard deviation, quantiles, effective size, R-hat.

    Args:
        result: for people, without the modes of fields.
    """
    quantiles = [f"{100 * level:g} %" for level in _SHOWN]
    chains = result.posterior is not None and math.isfinite(result.posterior.largest_r_hat)
    header = ["name", "mean", "sd", *quantiles, "unit", "ESS", *(["R-hat"] if chains else []), ""]
    posterior = result.posterior
    rows = (
        [] if posterior is None else [_row(result, i, chains) for i in range(len(posterior.names))]
    )
    right = "l" + "r" * (2 + len(_SHOWN)) + "lr" + ("r" if chains else "")
    return TextTable(header, rows, right=right)


def _row(result: Result, i: int, chains: bool) -> list[str]:
    posterior = result.posterior
    assert posterior is not None
    unit = unit_of(result.parameters, posterior.names[i])
    places = [LEVELS.index(level) for level in _SHOWN]
    mean, sd, *levels = (
        in_unit(float(x), *unit)
        for x in (posterior.mean[i], posterior.sd[i], *posterior.quantiles[i, places])
    )
    shown = [with_interval(x, levels[0], levels[-1])[0] for x in (mean, *levels)]
    known = bool(result.parameters.determined[i])
    prior = unknown_words(result.parameters, i) == AS_PRIOR
    return [
        posterior.names[i],
        shown[0],
        number(sd, 2),
        *shown[1:],
        shown_unit(*unit),
        decimals(float(posterior.effective[i]), 0),
        *([decimals(float(posterior.r_hat[i]), 3)] if chains else []),
        "" if known else AS_PRIOR if prior else AS_BOUNDS,
    ]


def cost_sentence(posterior: PosteriorDraws) -> str:
    """How the draws were made, and what they have cost."""
    chains, length = posterior.log_density.shape
    drawn = f"{posterior.n_draws} draws"
    drawn += f" in {chains} chains of {length}" if chains > 1 else ""
    if math.isfinite(posterior.pareto_k):
        judged = f"Pareto k {posterior.pareto_k:.2f} (reliable up to 0.7)"
        share = f"{100 * posterior.acceptance:.0f} % of the evaluations count"
    else:
        judged = f"largest R-hat {posterior.largest_r_hat:.3f} (reliable up to 1.01)"
        share = f"{100 * posterior.acceptance:.0f} % of the steps were accepted"
    return (
        f"{drawn} by {posterior.sampler} sampling, worth {posterior.least_effective:.0f} "
        f"independent ones; {judged}; {posterior.evaluations} evaluations of the model, {share}."
    )


def posterior_object(result: Result) -> dict[str, Any]:
    """Draws in numbers, SI; the draws themselves stand in the file."""
    posterior = result.posterior
    assert posterior is not None
    parameters = {
        name: {
            "mean": posterior.mean[i],
            "sd": posterior.sd[i],
            "quantiles": {
                f"{level:g}": posterior.quantiles[i, k] for k, level in enumerate(LEVELS)
            },
            "unit": si_unit(result.parameters.dimensions[i]),
            "effective_size": posterior.effective[i],
            "r_hat": posterior.r_hat[i],
        }
        for i, name in enumerate(posterior.names)
    }
    return {
        "sampler": posterior.sampler,
        "draws": posterior.n_draws,
        "chains": posterior.log_density.shape[0],
        "effective_size": posterior.least_effective,
        "pareto_k": posterior.pareto_k,
        "r_hat": posterior.largest_r_hat,
        "acceptance": posterior.acceptance,
        "evaluations": posterior.evaluations,
        "parameters": parameters,
    }


def posterior_sheet(result: Result) -> CsvTable:
    """Draws in numbers, in the units of the case."""
    posterior = result.posterior
    if posterior is None:
        return CsvTable()
    levels = tuple(f"q{100 * level:g}" for level in LEVELS)
    rows: list[CsvRow] = []
    for i, name in enumerate(posterior.names):
        unit = unit_of(result.parameters, name)
        sizes = (posterior.mean[i], posterior.sd[i], *posterior.quantiles[i])
        shown = [in_unit(float(x), *unit) for x in sizes]
        worth = float(posterior.effective[i]), float(posterior.r_hat[i])
        rows.append((name, *shown, shown_unit(*unit), *worth))
    header = ("parameter", "mean", "sd", *levels, "unit", "effective_size", "r_hat")
    return CsvTable(header, tuple(rows))


def draws_sheet(result: Result) -> CsvTable:
    """All draws in the units of the case: chain, draw, parameters, log density."""
    posterior = result.posterior
    if posterior is None:
        return CsvTable()
    places: list[CsvRow] = list(np.ndindex(posterior.log_density.shape))
    draws = sheet(
        posterior,
        "chain",
        "draw",
        quantities=result.quantities,
        labels={"parameter": headers(result.parameters)},
        only=("values", "log_density"),
    )
    return beside(CsvTable(("chain", "draw"), tuple(places)), draws)
