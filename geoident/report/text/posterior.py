"""Draws of a posterior, as a table, for other programs and for spreadsheets."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from geoident.model.results.posterior import LEVELS, PosteriorDraws
from geoident.model.results.result import Result
from geoident.report.text.layout import TextTable, decimals, number, with_interval
from geoident.report.text.parameters import AS_PRIOR, unit_of
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
    found = result.posterior
    rows = [] if found is None else [_row(result, i, chains) for i in range(len(found.names))]
    right = "l" + "r" * (2 + len(_SHOWN)) + "lr" + ("r" if chains else "")
    return TextTable(header, rows, right=right)


def _row(result: Result, i: int, chains: bool) -> list[str]:
    found = result.posterior
    assert found is not None
    unit = unit_of(result.parameters, found.names[i])
    places = [LEVELS.index(level) for level in _SHOWN]
    mean, sd, *levels = (
        in_unit(float(x), *unit) for x in (found.mean[i], found.sd[i], *found.quantiles[i, places])
    )
    shown = [with_interval(x, levels[0], levels[-1])[0] for x in (mean, *levels)]
    known = bool(result.parameters.determined[i])
    alone = AS_PRIOR if result.parameters.priors[i] else AS_BOUNDS
    return [
        found.names[i],
        shown[0],
        number(sd, 2),
        *shown[1:],
        shown_unit(*unit),
        decimals(float(found.effective[i]), 0),
        *([decimals(float(found.r_hat[i]), 3)] if chains else []),
        "" if known else alone,
    ]


def cost_sentence(found: PosteriorDraws) -> str:
    """How the draws were made, and what they have cost."""
    chains, length = found.log_density.shape
    drawn = f"{found.n_draws} draws"
    drawn += f" in {chains} chains of {length}" if chains > 1 else ""
    if math.isfinite(found.pareto_k):
        judged = f"Pareto k {found.pareto_k:.2f} (reliable up to 0.7)"
        share = f"{100 * found.acceptance:.0f} % of the evaluations count"
    else:
        judged = f"largest R-hat {found.largest_r_hat:.3f} (reliable up to 1.01)"
        share = f"{100 * found.acceptance:.0f} % of the steps were accepted"
    return (
        f"{drawn} by {found.sampler} sampling, worth {found.least_effective:.0f} independent ones;"
        f" {judged}; {found.evaluations} evaluations of the model, {share}."
    )


def posterior_object(result: Result) -> dict[str, Any]:
    """Draws in numbers, SI; the draws themselves stand in the file."""
    found = result.posterior
    assert found is not None
    parameters = {
        name: {
            "mean": found.mean[i],
            "sd": found.sd[i],
            "quantiles": {f"{level:g}": found.quantiles[i, k] for k, level in enumerate(LEVELS)},
            "unit": si_unit(result.parameters.dimensions[i]),
            "effective_size": found.effective[i],
            "r_hat": found.r_hat[i],
        }
        for i, name in enumerate(found.names)
    }
    return {
        "sampler": found.sampler,
        "draws": found.n_draws,
        "chains": found.log_density.shape[0],
        "effective_size": found.least_effective,
        "pareto_k": found.pareto_k,
        "r_hat": found.largest_r_hat,
        "acceptance": found.acceptance,
        "evaluations": found.evaluations,
        "parameters": parameters,
    }


def draw_rows(result: Result) -> tuple[tuple[str, ...], list[tuple[float, ...]]]:
    """Header and rows of all draws in the user's units: chain, draw, parameters, log density."""
    found, table = result.posterior, result.parameters
    units = [(table.units[i], table.dimensions[i]) for i in range(len(table.names))]
    words = [shown_unit(*unit) for unit in units]
    names = [
        f"{name} [{word}]" if word else name for name, word in zip(table.names, words, strict=True)
    ]
    header = ("chain", "draw", *names, "log_density")
    if found is None:
        return header, []
    size = np.array([in_unit(1.0, *unit) for unit in units])
    chains, length = found.log_density.shape
    number_of = np.indices((chains, length)).reshape(2, -1)
    columns = np.column_stack([*number_of, found.flat * size, found.log_density.ravel()])
    return header, [tuple(row) for row in columns.tolist()]
