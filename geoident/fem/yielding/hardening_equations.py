"""The equations of an implicit step of hardening soil at strain points (theory 19).

In the principal axes of the elastic trial stress they are solved by a semismooth Newton method.
Limits hold at the end of the step. Flow and growth of the cap are those in the middle of it, at the
means of beginning and end, so that a step is exact to the second order.

The law is written once, with dual numbers of what it depends on: stress, p_c and gamma_p, at the
end also L and the constants. Multipliers enter the equations as factors, so that the derivatives by
them are its terms. Tangent and derivatives by all constants are those of the converged equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geoident.fem.yielding.domain import NoReturn
from geoident.fem.yielding.hardening_law import (
    LEAST_STRESS,
    Numbers,
    cap_radius,
    compliances,
    dilation,
    hardened,
    mean_stress,
    power,
    strength,
    stress_level,
)
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, joined

_UPPER, _LOWER = np.array([0, 0, 1]), np.array([2, 1, 2])
"""Principal stresses i and j of the three pairs."""
PC, MULTIPLIERS = 3, slice(4, 11)
_N_UNKNOWNS = 11
"""Principal stresses, p_c and the multipliers of the seven mechanisms. Multipliers are times the
modulus, so that all are in Pa."""
SHEAR, _OF_CAP, _PULL = slice(0, 3), 3, slice(4, 7)
"""Mechanisms: three pairs, the cap, three cut-offs of tension."""
N_INPUTS = 9
"""Stresses at the beginning (3), trial stresses (3), gamma_p, p_c, L; after them the constants."""
BEGIN, TRIAL, GAMMA_BEFORE, _PC_BEFORE, LEVEL = slice(0, 3), slice(3, 6), 6, 7, 8

_SOFT = 1e-6
"""Compliance of the tension cut-off by that of the ground: at the apex more than three mechanisms
act at once."""

_OF_GAMMA, _OF_LEVEL = 4, 5
"""The law is differentiated by principal stresses, p_c, gamma_p, L and constants, in this order."""

_CONVERGED = 1e-12
_MOST_STEPS = 10
_LEAST_SHARE = 1.0 / 16.0
"""Of the way to a trial stress, below which it is not halved."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Of the equations of an implicit step.

    Args:
        x: (11, q) principal stresses, p_c and multipliers.
        active: (7, q) mechanisms that act.
        beyond: (k,) points whose trial stress is beyond a limit.
        slopes: (11, 20, k) of their equations by unknowns and inputs.
    """

    x: Floats
    active: Bools
    beyond: Ints
    slopes: Floats


@dataclass(frozen=True, eq=False)
class _Law:
    """The law at an iterate of an implicit step.

    Args:
        residual: (4, q) of the equations of principal stresses and p_c, Pa.
        excess: (7, q) over the limits, Pa.
        flow: (3, 7, q) plastic strains by the multipliers.
        growth: (q,) of p_c by the multiplier of the cap, Pa.
    """

    residual: Dual
    excess: Dual
    flow: Floats
    growth: Floats


class StepEquations:
    """The equations of one material at one parameter vector.

    Args:
        numbers: what the law is made of, by name, with derivatives (`derived` and of the cap).
        has_shear: whether shear hardens; False: Mohr-Coulomb stands alone.
        has_cap: whether there is a cap.
    """

    def __init__(self, numbers: Mapping[str, Dual], *, has_shear: bool, has_cap: bool) -> None:
        self._numbers, self._has_shear, self._has_cap = numbers, has_shear, has_cap
        self._values = {name: float(number.value) for name, number in numbers.items()}
        self._E, self._p_ref = self._values["E"], self._values["p_ref"]

    def modulus(self, level: Floats) -> Floats:
        """E_ur L (q,) by which multipliers are multiplied, Pa; it is not differentiated."""
        return np.asarray(self._E * level)

    def _scale(self, inputs: Floats) -> Floats:
        """Stresses (q,) by which an error is measured, Pa."""
        return np.asarray(self._p_ref * LEAST_STRESS + np.abs(inputs[TRIAL]).max(axis=0))

    def solve(self, inputs: Floats, near: Solution | None) -> Solution:
        """The unknowns and the mechanisms that act, where the trial stress is beyond a limit.

        Points whose mechanisms do not settle, as near the apex, are followed from the beginning of
        the step: the trial stress comes there in parts.

        Args:
            inputs: (9, q).
            near: a solution at other inputs, from which to begin.

        Raises:
            NoReturn: the equations of a point were not solved.
        """
        q = inputs.shape[1]
        x, active = np.zeros((_N_UNKNOWNS, q)), np.zeros((7, q), dtype=bool)
        x[:3], x[PC] = inputs[TRIAL], inputs[_PC_BEFORE]
        trial, p_c, gamma = (Dual(inputs[n, ..., None]) for n in (TRIAL, _PC_BEFORE, GAMMA_BEFORE))
        excess = self._excess(trial, p_c, gamma, self._values).value
        beyond = np.flatnonzero((excess > _CONVERGED * self._scale(inputs)).any(axis=0))
        if near is not None:
            acted = near.active.any(axis=0)
            x[:, acted] = near.x[:, acted]
        solution, left = self._newton(x[:, beyond], inputs[:, beyond])
        if len(left):
            self._follow(solution, inputs[:, beyond], left)
        x[:, beyond], active[:, beyond] = solution.x, solution.active
        return Solution(x, active, beyond, solution.slopes)

    def _follow(self, solution: Solution, inputs: Floats, left: Ints) -> None:
        """Solve points (k,) of a solution from the beginning of the step on.

        Raises:
            NoReturn: the equations of a point were not solved.
        """
        follow, whole = np.zeros((_N_UNKNOWNS, len(left))), inputs[:, left]
        follow[:3], follow[PC] = whole[BEGIN], whole[_PC_BEFORE]
        done, share = 0.0, 0.25
        while done < 1.0:
            part = whole.copy()
            part[TRIAL] = whole[BEGIN] + (done + share) * (whole[TRIAL] - whole[BEGIN])
            found, failed = self._newton(follow, part)
            if not len(failed):
                done, follow = done + share, found.x
            elif share > _LEAST_SHARE:
                share *= 0.5
            else:
                raise NoReturn("no stress of a hardening soil")
        solution.x[:, left], solution.active[:, left] = found.x, found.active
        solution.slopes[..., left] = found.slopes

    def _newton(self, x: Floats, inputs: Floats) -> tuple[Solution, Ints]:
        """The solution from unknowns (11, q) on by a semismooth method, and points without one."""
        q = x.shape[1]
        x, active = x.copy(), np.zeros((7, q), dtype=bool)
        at_end = np.empty((_N_UNKNOWNS, _N_UNKNOWNS + N_INPUTS, q))
        rest = np.arange(q)
        scale = self._scale(inputs)
        for _ in range(_MOST_STEPS):
            equations, slopes, acts = self._equations(x[:, rest], inputs[:, rest])
            active[:, rest], at_end[..., rest] = acts, slopes
            open_ = np.abs(equations).max(axis=0) > _CONVERGED * scale[rest]
            rest = rest[open_]
            if not len(rest):
                break
            try:
                own = slopes[:, :_N_UNKNOWNS, open_]
                step = _solved(own, equations[:, None, open_], acts[:, open_])
            except np.linalg.LinAlgError:
                break
            x[:, rest] -= step[:, 0]
            x[PC, rest] = np.maximum(x[PC, rest], inputs[_PC_BEFORE, rest] * (1.0 - 1e-9))
            if not np.isfinite(x[:, rest]).all():
                break
        return Solution(x, active, np.arange(q), at_end), rest

    def derivatives(
        self, solution: Solution, inputs: Floats, some: Ints, *, constants: bool
    ) -> Floats:
        """Derivatives (k, 5, 9 + number of constants) of principal stresses, gamma_p and p_c.

        Args:
            solution: of the equations.
            inputs: (9, q).
            some: points (k,) at which mechanisms act, ascending.
            constants: False: those by the constants are left zero.
        """
        inputs, active = inputs[:, some], solution.active[:, some]
        if constants:
            slopes = self._equations(solution.x[:, some], inputs, active, constants=True)[1]
        else:
            slopes = solution.slopes[..., np.searchsorted(solution.beyond, some)]
        given = slopes[:, _N_UNKNOWNS:]
        moved = -_solved(slopes[:, :_N_UNKNOWNS], given, active)
        by = np.zeros((5, N_INPUTS + len(self._numbers), len(some)))
        n = given.shape[1]
        by[:3, :n] = moved[:3]
        by[3, :n] = moved[MULTIPLIERS][SHEAR].sum(axis=0) / self.modulus(inputs[LEVEL])
        by[3, GAMMA_BEFORE] += 1.0
        by[4, :n] = moved[PC]
        return np.ascontiguousarray(by.transpose(2, 0, 1))

    def _equations(
        self,
        x: Floats,
        inputs: Floats,
        active: Bools | None = None,
        *,
        constants: bool = False,
    ) -> tuple[Floats, Floats, Bools]:
        """Equations (11, q), in the order of the unknowns, their derivatives, what acts (7, q).

        Args:
            x: (11, q).
            inputs: (9, q).
            active: mechanisms that act; None: those beyond their limit.
            constants: False: derivatives (11, 20, q) by the unknowns and the inputs; True: (11, 20
                + k, q) also by the constants.
        """
        size = self.modulus(inputs[LEVEL])
        multipliers = x[MULTIPLIERS] / size
        law = self._law(x, inputs, multipliers, constants=constants)
        if active is None:
            active = x[MULTIPLIERS] + law.excess.value > _CONVERGED * self._scale(inputs)
        columns = np.moveaxis(joined([law.residual, law.excess]).columns, -1, 1)
        equations, of_gamma = columns[:, 0], columns[:, 1 + _OF_GAMMA]
        n_more = columns.shape[1] - 2 - _OF_LEVEL
        slopes = np.zeros((_N_UNKNOWNS, _N_UNKNOWNS + N_INPUTS + n_more, x.shape[1]))
        slopes[:, :4] = columns[:, 1:5]
        by_multipliers = slopes[:, MULTIPLIERS]
        by_multipliers[:, SHEAR] = (of_gamma / size)[:, None]
        by_multipliers[:3] += (
            self._values["lame"] * law.flow.sum(axis=0) + 2.0 * self._values["mu"] * law.flow
        ) / self._E
        by_multipliers[PC, _OF_CAP] -= law.growth / size
        mechanism = np.arange(7)
        by_multipliers[4 + mechanism[_PULL], mechanism[_PULL]] -= _SOFT
        by_inputs = slopes[:, _N_UNKNOWNS:]
        by_inputs[:, GAMMA_BEFORE] = of_gamma
        by_inputs[:, LEVEL:] = columns[:, 1 + _OF_LEVEL :]
        # strains follow from the means of beginning and end
        by_inputs[:4, [0, 1, 2, _PC_BEFORE]] = slopes[:4, :4]
        by_inputs[np.arange(4), [0, 1, 2, _PC_BEFORE]] -= 1.0
        by_inputs[np.arange(4), [3, 4, 5, _PC_BEFORE]] -= 1.0
        equations[4:] = np.where(active, equations[4:], x[MULTIPLIERS])
        slopes[4:] *= active[:, None]
        by_multipliers[4 + mechanism, mechanism] += ~active
        return equations, slopes, active

    def _law(self, x: Floats, inputs: Floats, multipliers: Floats, *, constants: bool) -> _Law:
        """The law at an iterate, with its derivatives; multipliers (7, q) are given numbers."""
        n = _OF_LEVEL + 1 + (len(self._numbers) if constants else 0)
        y = _variables(
            np.stack([*x[:3], x[PC], inputs[GAMMA_BEFORE] + multipliers[SHEAR].sum(axis=0)]), n
        )
        s, p_c, gamma = y[:3], y[3], y[_OF_GAMMA]
        np.maximum(gamma.columns[..., 0], 0.0, out=gamma.columns[..., 0])  # of an iterate
        level = _variables(inputs[LEVEL:], n, _OF_LEVEL)[0]
        k: Numbers = self._values
        if constants:
            numbers = _variables(np.array([*self._values.values()])[:, None], n, _OF_LEVEL + 1)
            k = {name: numbers[i] for i, name in enumerate(self._values)}
        a, p_ref = k["a"], k["p_ref"]
        middle = (s + inputs[BEGIN]) * 0.5
        flow = Dual(np.moveaxis(np.zeros((1 + n, 3, 7, x.shape[1])), 0, -1))
        dilates, pair = dilation(middle[_UPPER], middle[_LOWER], k), np.arange(3)
        flow.columns[_UPPER, pair] = ((1.0 - dilates) * 0.5).columns
        flow.columns[_LOWER, pair] = ((1.0 + dilates) * -0.5).columns
        p, inside = mean_stress(middle), 1.0 / cap_radius(middle, k)
        distance = p + a
        normal = ((middle - p) * (1.5 / k["squared"]) + distance / 3.0) * inside
        flow.columns[:, _OF_CAP] = normal.columns
        flow.columns[pair, 4 + pair, :, 0] = -1.0
        tip = (p_c + inputs[_PC_BEFORE]) * 0.5 + a
        growth = power(tip / (p_ref + a), k["m"]) * k["H"] * (distance * inside)
        plastic = Dual((flow.columns * multipliers[..., None]).sum(axis=1))
        volume = Dual(plastic.columns.sum(axis=0)) * k["lame"]
        stress = s - inputs[TRIAL] + (plastic * (2.0 * k["mu"]) + volume) * level
        grown = p_c - inputs[_PC_BEFORE] - growth * multipliers[_OF_CAP]
        excess = self._excess(s, p_c, gamma, k)
        soft = k["E"] * level * (_SOFT * multipliers[_PULL])
        excess.columns[_PULL] -= soft.columns
        return _Law(joined([stress, grown[None]]), excess, flow.value, growth.value)

    def _excess(self, s: Dual, p_c: Dual, gamma: Dual, k: Numbers) -> Dual:
        """(7, q) over the limits, Pa, of principal stresses (3, q), p_c and gamma_p (q,)."""
        limit = strength(s[_LOWER], k)
        if self._has_shear:
            limit = hardened(gamma, limit, *compliances(k, stress_level(s[2], k)), k)
        cap = cap_radius(s, k) - k["a"] - p_c
        if not self._has_cap:
            cap = cap * 0.0 - self._p_ref
        return joined([s[_UPPER] - s[_LOWER] - limit, cap[None], -s - k["tension"]])


def _variables(values: Floats, n: int, first: int = 0) -> Dual:
    """Numbers (k, ...), each with derivative one by a variable of its own, from one of n on.

    Derivatives are apart in memory, those of all points together: numpy is quicker so.
    """
    columns = np.zeros((1 + n, *values.shape))
    columns[0] = values
    rows = np.arange(len(values))
    columns[1 + first + rows, rows] = 1.0
    return Dual(np.moveaxis(columns, 0, -1))


def _solved(slopes: Floats, right: Floats, active: Bools) -> Floats:
    """Solutions (11, r, q) of the equations with slopes (11, 11, q) of mechanisms that act (7, q).

    Those that act at no point are left out: of what does not act the multiplier is zero.
    """
    kept = np.append(np.ones(4, dtype=bool), active.any(axis=1))
    result, rest = right.copy(), slopes[kept]
    given = right[kept] - np.einsum("ijq,jrq->irq", rest[:, ~kept], right[~kept])
    own = rest[:, kept].transpose(2, 0, 1)
    result[kept] = np.linalg.solve(own, given.transpose(2, 0, 1)).transpose(1, 2, 0)
    return result
