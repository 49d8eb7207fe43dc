"""The size of the model error from the residuals (theory 9).

With model errors of covariance eta^2 S beside the errors of the gauges, Sigma = Sigma_0 + eta^2 S.
The restricted likelihood of eta (theory 7), with the model linearised at the estimate, times a
weak prior,

    w(eta) ~ exp(l(eta)) exp(-eta^2 / (2 * 0.3^2)) ,   eta >= 0 ,

is summed over a grid. From then on Sigma is its mean, with eta^2 the mean of the grid: of all that
one could plug in it gives nearly the bands of the whole mixture, since variances add up.

Accuracies that are estimated along have, at every eta, the values of highest likelihood, under a
weak prior too: a model error that explains all residuals would let them vanish.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.assessment.variance_components import (
    HeldLast,
    Likelihood,
    VarianceComponents,
    estimate_components,
)
from geoident.model.arrays import Floats

PRIOR_SD = 0.3
"""Of the half-normal prior of eta: errors of 10 to 30 % of the motion are usual."""

ACCURACY_SPREAD = np.log(3.0)
"""Of the logarithm of an accuracy that is estimated along: known within a factor of three."""

SIZES = np.concatenate([[1e-6], np.geomspace(0.005, 1.0, 28)])
"""The eta that are weighed, (m,); the first of them stands for none."""

_WIDTHS = np.gradient(SIZES)
_UPPER = np.append(0.5 * (SIZES[1:] + SIZES[:-1]), SIZES[-1])
"""Upper ends of the pieces of eta that the grid stands for."""


@dataclass(frozen=True)
class SizeWeights:
    """What the residuals say of the size of the model error.

    Args:
        weights: (m,) of `SIZES`, with the prior; their sum is one.
        minus_two_l: (m,) -2 l without the prior.
        components: the accuracies that are estimated along, at the size that is used.
    """

    weights: Floats
    minus_two_l: Floats
    components: VarianceComponents

    @property
    def size(self) -> float:
        """The root of the mean of eta^2."""
        return mean_size(self.weights)

    @property
    def log_gain(self) -> float:
        """Logarithm of the evidence over all sizes, less that at the size that is used.

        By the restricted likelihood, times the prior with its normalisation.
        """
        log_prior = 0.5 * np.log(2.0 / np.pi) - np.log(PRIOR_SD) - 0.5 * (SIZES / PRIOR_SD) ** 2
        parts = log_prior + np.log(_WIDTHS) - 0.5 * (self.minus_two_l - self.components.minus_two_l)
        return float(parts.max() + np.log(np.exp(parts - parts.max()).sum()))

    def quantile(self, part: float) -> float:
        """Eta below which a part of the weight lies."""
        below = np.concatenate([[0.0], np.cumsum(self.weights)])
        return float(np.interp(part, below, np.concatenate([[0.0], _UPPER])))


def mean_size(weights: Floats) -> float:
    """The root of the mean of eta^2, for weights (m,) of `SIZES`."""
    return float(np.sqrt(weights @ SIZES**2))


def weigh_sizes(likelihood: Likelihood, start: Floats) -> SizeWeights:
    """The weights of the sizes of the model error.

    Args:
        likelihood: of the factors of all components; the last one is the model error at eta = 1.
        start: (c,) logarithms of the factors of the others to begin with.
    """
    values, t = np.empty(len(SIZES)), start
    for m, eta in enumerate(SIZES.tolist()):
        found = at_size(likelihood, eta, t)
        t, values[m] = found.log_factor, found.minus_two_l
    log_weight = -0.5 * (values - values.min()) - 0.5 * (SIZES / PRIOR_SD) ** 2
    weights = np.exp(log_weight) * _WIDTHS
    weights /= weights.sum()
    return SizeWeights(weights, values, at_size(likelihood, mean_size(weights), t))


def at_size(likelihood: Likelihood, eta: float, start: Floats) -> VarianceComponents:
    """The other components at one size of the model error.

    Args:
        likelihood: of the factors of all components, the model error at eta = 1 last.
        eta: its size.
        start: (c,) logarithms of the factors of the others to begin with.
    """
    held = HeldLast(likelihood, 2.0 * np.log(eta), ACCURACY_SPREAD)
    if len(start):
        return estimate_components(held, start)
    nothing = np.zeros(0)
    return VarianceComponents(nothing, np.zeros((0, 0)), nothing, nothing, held.value(nothing))
