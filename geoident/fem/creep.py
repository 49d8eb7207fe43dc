"""Creep and ageing at strain points: a chain of springs and dashpots over one step (theory 18.4).

A chain is an elastic spring, Kelvin elements and dashpots in a row. Strains of elements are kept as
the stress that makes them in the elastic spring, q_i = E eps_i, so that they are carried as stress
is, and no compliance is needed. With d the stress less that under which the ground was at rest, and
P_i d its deviator, its mean, or all of it,

    q_i' = (phi_i P_i d - q_i) / tau_i       Kelvin: share phi of the elastic strain, time tau
    q_d' = P_d d / T                         dashpot: in the time T the elastic strain once more
    sigma' = f (E eps' - sum_i q_i' - q_d')  f: what there is of the stiffness at this age

Over a step h the stress is linear in time, for which a Kelvin element is exact. A dashpot that is
exact for it makes large steps swing (their growth tends to -1); it is integrated so that a constant
rate of strain, and a constant stress, are exact, and large steps fade. All is of second order:

    dsigma = R (E deps - z) ,   z = sum_i (1 - e^-x_i) (phi_i P_i d - q_i) + y P_d d
    1 / r = 1 / f + sum_i lambda_i phi_i + y / (1 - e^-y) - 1
    lambda_i = 1 - (1 - e^-x_i) / x_i ,   x_i = h / tau_i ,   y = h / T

with one r for the deviator and one for the mean: R E is the stiffness of the step, R z the stress
that the past takes away. R. L. Taylor, K. S. Pister, G. L. Goudreau (1970), Thermomechanical
analysis of viscoelastic solids, Int. J. Numer. Meth. Eng. 2, for the exponentials.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import Dual

SHEAR, VOLUME = 0, 1

_SMALL = 1e-4
"""Below it functions of x are their series, whose next terms are as small as rounding."""


@dataclass(frozen=True)
class CreepChain:
    """The numbers of the chain of one material, with their derivatives by n parameters.

    Args:
        shares: phi (k,) of Kelvin elements.
        times: tau (k,), s.
        parts: (k, 2) whether an element is in shear, and in volume.
        flow: 1 / T (2,) of dashpots in shear and volume, 1/s; 0 for none.
    """

    shares: Dual
    times: Dual
    parts: Bools
    flow: Dual

    @property
    def ends(self) -> bool:
        """Whether its strain under a stress that stays comes to an end."""
        return not self.flow.value.any()

    def step(self, h: float) -> CreepStep:
        """What the chain makes of a step.

        Args:
            h: its size, s; infinite for all the time that Kelvin elements take.
        """
        if np.isinf(h):
            one = Dual.constant(np.ones(len(self.parts)), self.shares.n)
            still = Dual.constant(np.zeros(2), self.shares.n)
            return self._step(one, one, still, still)
        x, y = self.times.reciprocal() * h, self.flow * h
        faded = x.through(lambda v: -np.expm1(-v), lambda v: np.exp(-v))
        return self._step(faded, x.through(_late, _late_slope), y, y.through(_flow, _flow_slope))

    def _step(self, faded: Dual, late: Dual, flow: Dual, flow_soft: Dual) -> CreepStep:
        taken = late * self.shares
        softer = flow_soft.columns + np.einsum("kp,kc->pc", self.parts.astype(float), taken.columns)
        return CreepStep(self, faded, taken, flow, Dual(softer))


@dataclass(frozen=True)
class CreepStep:
    """A step of a chain.

    Args:
        chain: the chain.
        faded: 1 - e^-x (k,).
        taken: lambda phi (k,).
        flow: y (2,).
        softer: 1 / r - 1 / f (2,).
    """

    chain: CreepChain
    faded: Dual
    taken: Dual
    flow: Dual
    softer: Dual

    def stiffness(self, grown: Dual | None = None) -> Dual:
        """R of shear and volume, (2,); (q, 2) where the stiffness depends on the age.

        Args:
            grown: f (q,) at points, on average over the step; None for 1.
        """
        if grown is None:
            return (self.softer + 1.0).reciprocal()
        return Dual(grown.reciprocal().columns[:, None] + self.softer.columns).reciprocal()

    def history(self, driving: Floats, strains: Floats) -> Floats:
        """Z (s, q, c): what creeps in the step if no stress changes, as stress.

        Args:
            driving: d (s, q, c) at its beginning, c of 1 + n columns or more.
            strains: q (k, s, q, c).
        """
        parts = self.chain.parts.astype(float)
        weights = self.flow.columns + parts.T @ (self.faded * self.chain.shares).columns
        z = scaled(weights, driving)
        fades = column_matrices(self.faded.columns, driving.shape[-1])
        for one, fade in zip(strains, fades, strict=True):
            z -= one @ fade
        return z

    def advanced(self, strains: Floats, driving: Floats, change: Floats) -> Floats:
        """Strains q (k, s, q, c) at the end of the step.

        Args:
            strains: at its beginning.
            driving: d (s, q, c) there.
            change: of the stress (s, q, c) in the step.
        """
        c = driving.shape[-1]
        stays = column_matrices((self.faded * -1.0 + 1.0).columns, c)
        by_driving = column_matrices((self.faded * self.chain.shares).columns, c)
        by_change = column_matrices(self.taken.columns, c)
        weights = np.concatenate([by_driving, by_change], axis=1)
        both = {  # driving and its change, in the part of the stress that makes elements creep
            part: np.concatenate(
                [scaled(np.array(part)[:, None], values) for values in (driving, change)], axis=-1
            )
            for part in {(float(shear), float(volume)) for shear, volume in self.chain.parts}
        }
        end = np.empty_like(strains)
        for n, (shear, volume) in enumerate(self.chain.parts):
            np.matmul(strains[n], stays[n], out=end[n])
            end[n] += both[float(shear), float(volume)] @ weights[n]
        return end


def column_matrices(numbers: Floats, c: int) -> Floats:
    """Numbers (k, 1 + n) as matrices (k, c, c) that multiply the columns of values from the right.

    The first column is a value, n are its derivatives; what else there is of c are no derivatives
    of the numbers: they are multiplied by their values. One product with such a matrix takes the
    place of several passes over the values of a chain.
    """
    k, n = numbers.shape
    matrices = numbers[:, :1, None] * np.eye(c)
    matrices[:, 0, 1:n] = numbers[:, 1:]
    return np.asarray(matrices.reshape(k, c, c))


def times(number: Floats, values: Floats) -> Floats:
    """A number (1 + n,), or several (..., 1 + n), times values (..., 1 + n + k).

    The k further columns are no derivatives of the number: they are multiplied by its value.
    """
    n = number.shape[-1]
    product = values * number[..., :1]
    product[..., 1:n] += values[..., :1] * number[..., 1:]
    return product


def mean_stress(values: Floats) -> Floats:
    """The mean of the normal components (q, c) of values (s, q, c)."""
    return np.asarray(values[:NORMAL_COMPONENTS].mean(axis=0))


def scaled(numbers: Floats, values: Floats) -> Floats:
    """The deviator and the mean of values (s, q, c), each times a number of its own.

    Args:
        numbers: (2, 1 + n) of shear and volume, or (q, 2, 1 + n).
        values: with c of 1 + n columns or more.
    """
    result = times(numbers[..., SHEAR, :], values)
    if not np.array_equal(numbers[..., SHEAR, :], numbers[..., VOLUME, :]):
        differ = numbers[..., VOLUME, :] - numbers[..., SHEAR, :]
        result[:NORMAL_COMPONENTS] += times(differ, mean_stress(values)[None])
    return result


def scaling_matrices(numbers: Floats, s: int) -> Floats:
    """The matrices of `scaled`, (..., s, s), of numbers (..., 2) without derivatives."""
    volume = np.zeros((s, s))
    volume[:NORMAL_COMPONENTS, :NORMAL_COMPONENTS] = 1.0 / NORMAL_COMPONENTS
    shear = numbers[..., SHEAR, None, None] * (np.eye(s) - volume)
    return np.asarray(shear + numbers[..., VOLUME, None, None] * volume)


def _late(x: Floats) -> Floats:
    """1 - (1 - e^-x) / x: what has come of a strain whose stress grew over the step."""
    safe = np.maximum(x, _SMALL)
    return np.where(x < _SMALL, x / 2.0 - x**2 / 6.0, (safe + np.expm1(-safe)) / safe)


def _late_slope(x: Floats) -> Floats:
    safe = np.maximum(x, _SMALL)
    slope = -(np.expm1(-safe) + safe * np.exp(-safe)) / safe**2
    return np.where(x < _SMALL, 0.5 - x / 3.0, slope)


def _flow(y: Floats) -> Floats:
    """Y / (1 - e^-y) - 1."""
    safe = np.maximum(y, _SMALL)
    return np.where(y < _SMALL, y / 2.0 + y**2 / 12.0, safe / -np.expm1(-safe) - 1.0)


def _flow_slope(y: Floats) -> Floats:
    safe = np.maximum(y, _SMALL)
    left = -np.expm1(-safe)
    return np.where(y < _SMALL, 0.5 + y / 6.0, (left - safe * np.exp(-safe)) / left**2)


def logarithmic_chain(time: float, longest: float) -> tuple[Floats, Floats, float]:
    """Kelvin elements and a dashpot that creep as log(1 + t / T) does.

    log(1 + t / T) is the integral of (1 - e^(-t / tau)) e^(-T / tau) over log tau, which the
    trapezoidal rule takes with an error that falls exponentially with its spacing. What is slower
    than the slowest element still flows evenly in the times of the case: a dashpot.

    Args:
        time: T, s.
        longest: time up to which it is to hold, s.

    Returns:
        Shares (k,) and times (k,) of elements, as parts of a share and of T; 1 / T of the dashpot,
        as part of the share by T.
    """
    slowest = np.log(max(_BEYOND * longest / time, 1.0))
    steps = np.arange(-_QUICKEST, int(np.ceil(slowest / _SPACING)) + 1)
    times_ = np.exp(_SPACING * steps)
    shares = _SPACING * np.exp(-1.0 / times_)
    # the trapezoidal sum of all slower elements, 1 / tau being a geometric series
    flow = _SPACING / times_[-1] / np.expm1(_SPACING)
    return shares, times_, float(flow)


_SPACING = np.log(10.0) / 3.0
"""Of log tau: three elements a decade."""

_QUICKEST = 3
"""Elements quicker than T: the next would have a share of 3e-10."""

_BEYOND = 30.0
"""The slowest element, in times of the case."""
