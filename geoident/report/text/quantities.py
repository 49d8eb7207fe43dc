"""Numbers in the units in which people wrote them."""

from __future__ import annotations

import math
import re

from geoident.model.result import NORMAL_95
from geoident.report.text.layout import number
from geoident.units import DIMENSIONS, UNITS

_PRIOR = re.compile(r"(\w+)\((\S+), (\S+)\)")


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


def prior_in_unit(prior: str, unit: str, dimension: str) -> str:
    """The text of a prior with its numbers in a unit.

    Args:
        prior: the text.
        unit: as the user wrote it.
        dimension: of the parameter.

    >>> prior_in_unit("normal(8e+06, 1e+06)", "MPa", "pressure")
    '8 +- 1'
    >>> prior_in_unit("lognormal(8e+06, 1e+06)", "MPa", "pressure")
    '8 +- 1 (lognormal)'
    """
    match = _PRIOR.fullmatch(prior)
    if match is None:
        return prior
    mean, sd = (number(in_unit(float(text), unit, dimension)) for text in match.groups()[1:])
    kind = "" if match[1] == "normal" else f" ({match[1]})"
    return f"{mean} +- {sd}{kind}"


def prior_interval(prior: str) -> tuple[float, float] | None:
    """The 95 % interval of the text of a prior, SI; None if there is no prior.

    The sd of a lognormal prior is that of the logarithm times its median.

    >>> [round(end / 1e6, 2) for end in prior_interval("normal(8e+06, 1e+06)")]
    [6.04, 9.96]
    """
    match = _PRIOR.fullmatch(prior)
    if match is None:
        return None
    mean, sd = float(match[2]), float(match[3])
    if match[1] == "normal":
        return mean - NORMAL_95 * sd, mean + NORMAL_95 * sd
    factor = math.exp(NORMAL_95 * sd / mean)
    return mean / factor, mean * factor
