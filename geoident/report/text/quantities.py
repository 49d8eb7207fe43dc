"""Numbers in the units in which people wrote them."""

from __future__ import annotations

import math

from geoident.model.parameter import Prior
from geoident.model.result import NORMAL_95
from geoident.report.text.layout import number
from geoident.units import DIMENSIONS, UNITS


def si_unit(dimension: str) -> str:
    """The SI unit of a dimension; empty for a pure number."""
    return DIMENSIONS.get(dimension, "")


def in_unit(value: float, unit: str, dimension: str) -> float:
    """An SI value in a unit; in SI where the unit is none of the dimension.

    Args:
        value: SI.
        unit: as the user wrote it.
        dimension: of the value.

    >>> in_unit(2.5e9, "GPa", "pressure")
    2.5
    """
    known = UNITS.get(unit)
    return value / known[1] if known and known[0] == dimension else value


def shown_unit(unit: str, dimension: str) -> str:
    """The unit that `in_unit` gives."""
    known = UNITS.get(unit)
    return unit if known and known[0] == dimension else si_unit(dimension)


def prior_in_unit(prior: Prior | None, unit: str, dimension: str) -> str:
    """A prior in words, with its numbers in a unit; empty for none.

    Args:
        prior: SI, or None.
        unit: as the user wrote it.
        dimension: of the parameter.

    >>> prior_in_unit(Prior(8e6, 1e6), "MPa", "pressure")
    '8 +- 1'
    >>> prior_in_unit(Prior(8e6, 1e6, "lognormal"), "MPa", "pressure")
    '8 +- 1 (lognormal)'
    """
    if prior is None:
        return ""
    mean, sd = (number(in_unit(value, unit, dimension)) for value in (prior.mean, prior.sd))
    return f"{mean} +- {sd}" + ("" if prior.kind == "normal" else f" ({prior.kind})")


def prior_interval(prior: Prior | None) -> tuple[float, float] | None:
    """The 95 % interval of a prior, SI; None if there is no prior.

    The sd of a lognormal prior is that of the logarithm times its median.

    >>> [round(end / 1e6, 2) for end in prior_interval(Prior(8e6, 1e6))]
    [6.04, 9.96]
    """
    if prior is None:
        return None
    if prior.kind == "normal":
        return prior.mean - NORMAL_95 * prior.sd, prior.mean + NORMAL_95 * prior.sd
    factor = math.exp(NORMAL_95 * prior.sd / prior.mean)
    return prior.mean / factor, prior.mean * factor
