"""A band of one number that is dear to compute, from few draws of the posterior (theory 5.14).

The number y at d draws of coordinates z is fitted by a surface, linear or quadratic in z, with the
penalty lambda |coefficients|^2 that predicts draws best which it was not fitted to. What is left of
y at such draws (leave one out) is the error of the surface, taken as normal. The surface is then
asked at many draws, each with a draw of that error. How much the few draws leave open is seen by
fitting the surface to other draws of them (bootstrap).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats

_PENALTIES = (1e-8, 1e-3, 1e-2, 0.1, 1.0)
"""lambda, by the number of draws: z and the terms have the size of one."""

_CLEARLY = 0.7
"""Part of what a linear surface leaves up to which a quadratic one is taken: else its curvature is
noise, which counts far out.
"""

_AGAIN = 200
"""Fits to draws of the draws."""


@dataclass(frozen=True)
class Surface:
    """A number as a function of coordinates.

    Args:
        quadratic: with squares and products; else linear.
        penalty: lambda.
        coefficients: of the terms.
        left: standard deviation of what is left at draws that it was not fitted to.
    """

    quadratic: bool
    penalty: float
    coefficients: Floats
    left: float

    def at(self, z: Floats) -> Floats:
        """The number (d,) at coordinates (d, n)."""
        return np.asarray(_terms(z, quadratic=self.quadratic) @ self.coefficients)


@dataclass(frozen=True)
class ScalarBand:
    """What is known of a number.

    Args:
        quantiles: (3,) at 2.5, 50 and 97.5 %.
        below: the probability that it is below a limit.
        below_sd: standard deviation of that by the choice of draws.
        surface: in its coordinates.
    """

    quantiles: Floats
    below: float
    below_sd: float
    surface: Surface


def fitted_surface(z: Floats, y: Floats) -> Surface:
    """The surface that predicts best what it was not fitted to.

    Args:
        z: (d, n) coordinates, each of the size of one.
        y: (d,) the number there.
    """
    linear = min((_fitted(z, y, quadratic=False, penalty=h) for h in _PENALTIES), key=_left)
    n = z.shape[1]
    if (n + 1) * (n + 2) // 2 > len(y) // 2:
        return linear
    curved = min((_fitted(z, y, quadratic=True, penalty=h) for h in _PENALTIES), key=_left)
    return curved if curved.left < _CLEARLY * linear.left else linear


def _left(surface: Surface) -> float:
    return surface.left


def scalar_band(
    z: Floats, y: Floats, many: Floats, limit: float, rng: np.random.Generator
) -> ScalarBand:
    """The band of a number.

    Args:
        z: (d, n) coordinates, each of the size of one.
        y: (d,) the number there.
        many: (m, n) coordinates of many draws.
        limit: of whose undershooting the probability is wanted.
        rng: for errors of the surface, and draws of the draws.
    """
    surface = fitted_surface(z, y)
    errors = rng.standard_normal(len(many))
    values = surface.at(many) + surface.left * errors
    again = []
    for _ in range(_AGAIN):
        rows = rng.integers(len(y), size=len(y))
        other = _fitted(z[rows], y[rows], quadratic=surface.quadratic, penalty=surface.penalty)
        again.append(float((other.at(many) + surface.left * errors < limit).mean()))
    below = float((values < limit).mean())
    by_chance = np.sqrt(below * (1.0 - below) / len(many))
    return ScalarBand(
        np.quantile(values, [0.025, 0.5, 0.975]),
        below,
        float(np.hypot(np.std(again), by_chance)),
        surface,
    )


def _fitted(z: Floats, y: Floats, *, quadratic: bool, penalty: float) -> Surface:
    terms = _terms(z, quadratic=quadratic)
    weight = np.full(terms.shape[1], penalty * len(y))
    weight[0] = 0.0  # the mean is free
    normal = terms.T @ terms + np.diag(weight + 1e-12 * len(y))
    influence = np.linalg.solve(normal, terms.T)
    coefficients = influence @ y
    own = np.clip(np.einsum("dk,kd->d", terms, influence), 0.0, 1.0 - 1e-9)
    without = (y - terms @ coefficients) / (1.0 - own)
    return Surface(quadratic, penalty, coefficients, float(np.sqrt(np.mean(without**2))))


def _terms(z: Floats, *, quadratic: bool) -> Floats:
    terms = [np.ones(len(z)), *z.T]
    if quadratic:
        i, j = np.triu_indices(z.shape[1])
        terms += [*(z[:, i] * z[:, j]).T]
    return np.column_stack(terms)
