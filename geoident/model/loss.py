"""Losses: how much a large residual counts, as users write them.

One table, `LOSS_OPTIONS`, maps the names to the option types; the schema and the messages are made
from it. The formulas are in `geoident.identify.loss`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SquaredOptions:
    """Weighted least squares: right where all errors are as the accuracies say."""


@dataclass(frozen=True)
class HuberOptions:
    """Huber's loss: quadratic in the middle, linear outside, so that no reading pulls too hard.

    Args:
        delta: residual, in standard deviations, from which on a reading counts less. 1.345 loses
            5 % of the information if no reading is wrong.
    """

    delta: float = 1.345


@dataclass(frozen=True)
class StudentOptions:
    """The loss of Student's t distribution: the pull of a reading that is far off fades away.

    Args:
        nu: degrees of freedom; few for many wrong readings, many for nearly least squares.
    """

    nu: float = 4.0


LossOptions = SquaredOptions | HuberOptions | StudentOptions

LOSS_OPTIONS: Mapping[str, type[LossOptions]] = {
    "squared": SquaredOptions,
    "huber": HuberOptions,
    "student-t": StudentOptions,
}


def loss_name(options: LossOptions) -> str:
    """The name under which users know a loss."""
    return next(name for name, kind in LOSS_OPTIONS.items() if kind is type(options))


def loss_text(options: LossOptions) -> str:
    """A loss with its option, as results hold it.

    >>> loss_text(HuberOptions()), loss_text(SquaredOptions())
    ('huber (delta 1.345)', 'squared')
    """
    match options:
        case HuberOptions(delta):
            return f"huber (delta {delta:g})"
        case StudentOptions(nu):
            return f"student-t (nu {nu:g})"
        case _:
            return "squared"
