"""What is drawn from in place of the posterior: mixtures of multivariate t (theory 11.2).

The first is Laplace's approximation at each known minimum. With the rows A of residuals and
priors (theory 6.2), each parameter measured by its range R, A R = U S V^T, a direction v_k has the
standard deviation min(1/S_k, L_k / 2), L_k = 1 / max_i |v_ik| its admissible extent: a direction
that nothing determines is drawn all along its extent. Tails are those of Student's t. Draws outside
the bounds are thrown away, which leaves the density inside them as it is, up to a constant.

`adapted` fits a mixture to weighted draws by expectation and maximisation (Cappe and others 2008):
from a poor approximation it finds a good one, such as along a bent ridge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln, logsumexp

from geoident.errors import ModelError
from geoident.identify.posterior.density import PosteriorDensity
from geoident.model.arrays import Floats

UNBOUNDED_RANGE = 10.0
"""Range in u of a parameter without finite bounds, as in theory 6.2."""

DEGREES = 5.0
"""Degrees of freedom of the tails; beyond `MANY` parameters they are normal."""

MANY = 12
"""Parameters from which on heavy tails cost more draws than they save."""

_SPREAD = 0.1  # weight of the uniform component
_FEW = 4  # parameters up to which there is one
_MOST_TRIALS = 1000  # for each draw that is to lie inside the bounds
_ROUNDS = 30  # of expectation and maximisation
_LEAST_SHARE = 1e-6  # of the whole variance, in every direction of a component
_ROUNDING = 1e-12  # of the mean variance: what rounding takes from draws that are all on a line
_LEAST_DRAWS = 3.0  # effective ones for each parameter of a component, or it is given up
_INFLATION, _WIDTH = 1.15, 2.5  # of components, of their wide copies
_WIDE, _FIRST = 0.2, 0.1  # share of the wide copies, and of the first mixture


@dataclass(frozen=True)
class Mixture:
    """Components of a multivariate t each, and a uniform one over the bounds.

    Args:
        shares: (K,) weights of the components; with ``uniform`` they add up to one.
        centres: (K, m) in u.
        roots: (K, m, m) lower triangular, the root of each scale matrix.
        degrees: of freedom; infinite for normal ones.
        lower, upper: (m,) bounds in u.
        uniform: weight of the uniform component; 0 where a bound is infinite.
    """

    shares: Floats
    centres: Floats
    roots: Floats
    degrees: float
    lower: Floats
    upper: Floats
    uniform: float = 0.0

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        """Draws (count, m) inside the bounds.

        Raises:
            ModelError: hardly any lie there.
        """
        found, kept, tried = [np.empty((0, self.centres.shape[1]))], 0, 0
        while kept < count:
            if tried > _MOST_TRIALS * count:
                raise ModelError(
                    "The posterior cannot be sampled: its approximation lies outside the bounds.",
                    "Look at the fit: is it converged, and are its bounds meant?",
                )
            x = self._anywhere(rng, 2 * count)
            x = x[np.all((x >= self.lower) & (x <= self.upper), axis=1)]
            tried += 2 * count
            kept += len(x)
            found.append(x)
        return np.asarray(np.concatenate(found)[:count])

    def logarithms(self, x: Floats) -> Floats:
        """Log density (k,) at x (k, m) inside the bounds, up to one constant."""
        parts = self._parts(x)
        if self.uniform > 0.0:
            flat = np.log(self.uniform) - np.sum(np.log(self.upper - self.lower))
            parts = np.column_stack([parts, np.full(len(x), flat)])
        return np.asarray(logsumexp(parts, axis=1))

    def _anywhere(self, rng: np.random.Generator, count: int) -> Floats:
        m = self.centres.shape[1]
        weights = np.append(self.shares, self.uniform)
        which = rng.choice(len(weights), size=count, p=weights / weights.sum())
        normal = rng.standard_normal((count, m))
        if np.isfinite(self.degrees):
            normal *= np.sqrt(self.degrees / rng.chisquare(self.degrees, count))[:, None]
        of_box = which == len(self.shares)
        which[of_box] = 0
        x = self.centres[which] + np.einsum("kij,kj->ki", self.roots[which], normal)
        if of_box.any():
            x[of_box] = rng.uniform(self.lower, self.upper, (int(of_box.sum()), m))
        return np.asarray(x)

    def _parts(self, x: Floats) -> Floats:
        """Log of each component's share times density, (k, K)."""
        with np.errstate(divide="ignore"):
            shares = np.log(self.shares)
        return np.stack(
            [
                share + _log_t(self.distances(x, k), self.roots[k], self.degrees)
                for k, share in enumerate(shares)
            ],
            axis=1,
        )

    def distances(self, x: Floats, k: int) -> Floats:
        """Squared Mahalanobis distance (count,) of x (count, m) from the centre of component k."""
        z = np.linalg.solve(self.roots[k], (x - self.centres[k]).T)
        return np.asarray(np.sum(z**2, axis=0))


def _log_t(distance: Floats, root: Floats, degrees: float) -> Floats:
    m = len(root)
    size = float(np.sum(np.log(np.diag(root))))
    if not np.isfinite(degrees):
        return np.asarray(-0.5 * distance - size - 0.5 * m * np.log(2.0 * np.pi))
    constant = gammaln(0.5 * (degrees + m)) - gammaln(0.5 * degrees)
    constant -= 0.5 * m * np.log(degrees * np.pi)
    return np.asarray(constant - size - 0.5 * (degrees + m) * np.log1p(distance / degrees))


def laplace(density: PosteriorDensity, minima: Sequence[Floats]) -> Mixture:
    """The approximation of the posterior at some minima of phi.

    Args:
        density: to be approximated.
        minima: p (n,) of each, SI; the first is the fit.

    Raises:
        ModelError: the model has no solution at the first.
    """
    found = [_at(density, p, needed=k == 0) for k, p in enumerate(minima)]
    kept = [component for component in found if component is not None]
    sizes = np.array([size for _, _, size in kept])
    shares = np.exp(sizes - logsumexp(sizes))
    shares = 0.5 * shares + 0.5 / len(kept)  # the sizes are rough: none is left out
    bounded = bool(np.all(np.isfinite(density.upper - density.lower)))
    uniform = _SPREAD if bounded and len(density) <= _FEW else 0.0
    return Mixture(
        shares=(1.0 - uniform) * shares,
        centres=np.array([centre for centre, _, _ in kept]),
        roots=np.array([root for _, root, _ in kept]),
        degrees=DEGREES if len(density) <= MANY else np.inf,
        lower=density.lower,
        upper=density.upper,
        uniform=uniform,
    )


def _at(
    density: PosteriorDensity, p: Floats, *, needed: bool
) -> tuple[Floats, Floats, float] | None:
    """Centre, root of the covariance, and the logarithm of the mass of one minimum."""
    try:
        A, phi = density.rows(p)
    except ModelError:
        if needed:
            raise
        return None
    width = density.upper - density.lower
    width = np.where(np.isfinite(width), width, UNBOUNDED_RANGE)
    _, S, Vt = np.linalg.svd(_square(A * width))
    extent = 1.0 / np.abs(Vt).max(axis=1)
    with np.errstate(divide="ignore"):
        sd = np.minimum(1.0 / S, 0.5 * extent)
    covariance = (Vt.T * sd**2) @ Vt * np.outer(width, width)
    root = np.linalg.cholesky(covariance)
    size = -0.5 * phi + float(np.sum(np.log(np.diag(root))))
    return density.coordinates(p), root, size


def _square(A: Floats) -> Floats:
    """Rows (g, m) with zeros below, so that there are at least m."""
    missing = A.shape[1] - A.shape[0]
    return np.vstack([A, np.zeros((missing, A.shape[1]))]) if missing > 0 else A


def adapted(
    mixture: Mixture, x: Floats, weights: Floats, *, components: int, rng: np.random.Generator
) -> Mixture:
    """The mixture that fits weighted draws, by expectation and maximisation.

    Args:
        mixture: the first one, which stays a part of it, so that no place that it reaches is lost.
        x: (k, m) draws.
        weights: (k,) of the draws, adding up to one.
        components: K, how many.
        rng: of random numbers.
    """
    whole = _covariance(x, weights, weights @ x)
    even = np.trace(whole) / len(whole) * np.eye(len(whole))
    whole += _ROUNDING * even
    floor = _LEAST_SHARE * whole + _ROUNDING * even
    chosen = _centres(x, weights, components, whole, rng)
    share = (1.0 - mixture.uniform) / len(chosen)
    now = Mixture(
        np.full(len(chosen), share),
        chosen,
        np.tile(np.linalg.cholesky(whole / len(chosen) ** 2 + floor), (len(chosen), 1, 1)),
        mixture.degrees,
        mixture.lower,
        mixture.upper,
        mixture.uniform,
    )
    for _ in range(_ROUNDS):
        now = _maximised(now, x, weights, floor)
    return _defended(now, mixture)


def _defended(mixture: Mixture, first: Mixture) -> Mixture:
    """With a wider copy of each component, so that no weight between and beyond them is large."""
    parts = (mixture.shares, mixture.shares, first.shares)
    weights = (1.0 - _WIDE - _FIRST, _WIDE, _FIRST)
    return replace(
        mixture,
        shares=np.concatenate([w * share for w, share in zip(weights, parts, strict=True)]),
        centres=np.concatenate([mixture.centres, mixture.centres, first.centres]),
        roots=np.concatenate([_INFLATION * mixture.roots, _WIDTH * mixture.roots, first.roots]),
    )


def _centres(
    x: Floats, weights: Floats, count: int, whole: Floats, rng: np.random.Generator
) -> Floats:
    """Draws (count, m) far from each other, by weight and squared distance (k-means++)."""
    z = np.linalg.solve(np.linalg.cholesky(whole), x.T).T
    taken = [int(rng.choice(len(x), p=weights))]
    nearest = np.sum((z - z[taken[0]]) ** 2, axis=1)
    while len(taken) < count:
        chance = weights * nearest
        if chance.sum() <= 0.0:
            break
        taken.append(int(rng.choice(len(x), p=chance / chance.sum())))
        nearest = np.minimum(nearest, np.sum((z - z[taken[-1]]) ** 2, axis=1))
    return x[taken]


def _maximised(now: Mixture, x: Floats, weights: Floats, floor: Floats) -> Mixture:
    """One step of expectation and maximisation."""
    parts, m = now._parts(x), x.shape[1]
    belongs = np.exp(parts - now.logarithms(x)[:, None]) * weights[:, None]
    shares, centres, roots = [], [], []
    for k, mine in enumerate(belongs.T):
        total = float(mine.sum())
        if total <= 0.0 or total**2 / float(mine @ mine) < _LEAST_DRAWS * m:
            continue  # hardly any draws are left for it
        pull = np.ones(len(x))
        if np.isfinite(now.degrees):
            pull = (now.degrees + m) / (now.degrees + now.distances(x, k))
        centre = (mine * pull) @ x / float(mine @ pull)
        scale = _covariance(x, mine * pull / total, centre) + floor
        shares.append(total)
        centres.append(centre)
        roots.append(np.linalg.cholesky(scale))
    found = np.array(shares)
    return Mixture(
        (1.0 - now.uniform) * found / found.sum(),
        np.array(centres),
        np.array(roots),
        now.degrees,
        now.lower,
        now.upper,
        now.uniform,
    )


def _covariance(x: Floats, weights: Floats, centre: Floats) -> Floats:
    gap = x - centre
    return np.asarray((gap * weights[:, None]).T @ gap)
