"""Hardening soil at strain points: stress and state after a strain step (theory 19).

Schanz, Vermeer & Bonnier (1999), with the initial modulus E_i = 2 E50 / (2 - Rf), by which E50 is
the secant modulus at half of the strength. Compression is positive here: s_1 >= s_2 >= s_3 are the
principal values of minus the stress, a = c cot(phi).

Stiffness follows the least principal stress at the *beginning* of a step,

    L = ((a + s_3) / (a + p_ref))^m ,    E_ur L and E_i L ,    s_3 not below p_ref / 100 .

For each pair of principal stresses i < j the shear stress is limited by that which the plastic
shear strain gamma_p (one for all pairs) allows, and by Mohr-Coulomb:

    s_i - s_j <= min(q(gamma_p), q_f) ,    q_f = 2 sin(phi) / (1 - sin(phi)) (s_j + a) ,
    gamma_p = (2 / E_i) q / (1 - Rf q / q_f) - (2 / E_ur) q     for q(gamma_p) .

It flows by Rowe's dilatancy of the pair, sin(psi_m) = max(0, (sin phi_m - sin phi_cv) / (1 -
sin phi_m sin phi_cv)), and gamma_p grows by the sum of the multipliers. The cap

    q^2 / alpha^2 + (p + a)^2 <= (p_c + a)^2 ,    q^2 = 3 J_2 ,

flows along its normal, and p_c grows by H ((p_c + a) / (p_ref + a))^m with the volume that the cap
takes; alpha and H follow from Eoed and K0nc (`cap_constants`). No principal stress is below minus
the tensile strength.

The equations of a step (implicit Euler, in the principal axes of the elastic trial stress) are
solved by a semismooth Newton method. The law is written once, with dual numbers of what it depends
on: stress, p_c and gamma_p, at the end also L and the constants. Multipliers enter the equations as
factors, so that the derivatives by them are its terms. The tangent and the derivatives by all
constants are those of the converged equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from geoident.fem.elasticity import isotropic, lame_constants
from geoident.fem.yielding.domain import NoReturn
from geoident.fem.yielding.principal_axes import spectrum
from geoident.fem.yielding.small_strains import STRINGS, SmallStrains
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, Number, joined, stacked

GAMMA, CAP = 0, 1
"""Places of gamma_p and p_c in the state of a point, before those of strings (`SmallStrains`). A
point whose p_c is zero is in none yet."""

LEAST_STRESS = 0.01
"""Part of p_ref below which s_3 and p_c do not lower the stiffness."""

_UPPER, _LOWER = np.array([0, 0, 1]), np.array([2, 1, 2])
"""Principal stresses i and j of the three pairs."""
_PC, _MULTIPLIERS = 3, slice(4, 11)
_N_UNKNOWNS = 11
"""Principal stresses, p_c and the multipliers of the seven mechanisms. Multipliers are times the
modulus, so that all are in Pa."""
_SHEAR, _OF_CAP, _PULL = slice(0, 3), 3, slice(4, 7)
"""Mechanisms: three pairs, the cap, three cut-offs of tension."""
_N_INPUTS = 6
"""Trial stresses (3), gamma_p, p_c and L; after them the constants."""

_SOFT = 1e-6
"""Compliance of the tension cut-off by that of the ground: at the apex more than three mechanisms
act at once."""

_TINY = 1e-6
"""Part of p_ref that keeps what is divided by above zero at the apex."""

_OF_GAMMA, _OF_LEVEL = 4, 5
"""The law is differentiated by principal stresses, p_c, gamma_p, L and constants, in this order."""

_CONVERGED = 1e-12
_MOST_STEPS = 15
_LEAST_SHARE = 1.0 / 256.0
"""Of the way to a trial stress, below which it is not halved."""


Numbers: TypeAlias = "Mapping[str, Dual] | Mapping[str, float]"
"""Constants of the law by name: numbers where they are not differentiated by."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Of the equations of an implicit step.

    Args:
        x: (11, q) principal stresses, p_c and multipliers.
        active: (7, q) mechanisms that act.
        slopes: (11, 17, q) of the equations by unknowns and inputs.
    """

    x: Floats
    active: Bools
    slopes: Floats


@dataclass(frozen=True, eq=False)
class Integrated:
    """Where a strain step led.

    Args:
        stress: (s, q, 1 + c) with its derivatives, Pa.
        state: (z, q, 1 + c) gamma_p and p_c, after them what small strains remember.
        yields: (q,) points whose plastic strain grew in the last part of the step.
        solutions: of its parts.
    """

    stress: Floats
    state: Floats
    yields: Bools
    solutions: list[Solution]


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


class HardeningSoil:
    """The law of one material at one parameter vector.

    Args:
        constants: E (of unloading, at p_ref), nu, m, p_ref, Rf, cohesion, friction, dilation,
            tension; where shear hardens E50 (else Mohr-Coulomb stands alone), where there is a cap
            Eoed and K0nc, where small strains are stiffer G0 and gamma_07; with derivatives by n
            parameters.
        n_strain: number s of strain components, 4 or 6.
    """

    def __init__(self, constants: Mapping[str, Dual], n_strain: int) -> None:
        full = isotropic({name: constants[name] for name in ("E", "nu")}).columns
        self._matrix = np.ascontiguousarray(full[:n_strain, :n_strain])
        self.has_shear, self.has_cap = "E50" in constants, "Eoed" in constants
        numbers = _derived(constants)
        one = Dual.constant(1.0, constants["E"].n)
        alpha, hardening = cap_constants(constants) if self.has_cap else (one, one)
        numbers |= {"squared": alpha * alpha, "H": hardening}
        self._names = tuple(numbers)
        self._columns = np.stack([number.columns for number in numbers.values()])
        self._lame, self._mu = (float(numbers[name].value) for name in ("lame", "mu"))
        self._K0nc = constants.get("K0nc")
        self._small = SmallStrains(constants, n_strain) if "G0" in constants else None
        self.n_state = 2 if self._small is None else 2 + STRINGS * n_strain
        self._E, self._p_ref = (float(constants[name].value) for name in ("E", "p_ref"))

    def _constants(self, c: int) -> dict[str, Dual]:
        """What the law is made of, by name, with c derivatives."""
        padded = np.pad(self._columns, ((0, 0), (0, c + 1 - self._columns.shape[1])))
        return {name: Dual(padded[n]) for n, name in enumerate(self._names)}

    @property
    def elasticity(self) -> Floats:
        """E (s, s) at p_ref, Pa."""
        return np.ascontiguousarray(self._matrix[..., 0])

    def begun(
        self, stress: Floats, state: Floats, once: tuple[Dual, Dual] | None, vertical: int
    ) -> Floats:
        """State (z, q, 1 + c) of points that have none yet: as a first loading would have left.

        Args:
            stress: (s, q, 1 + c), Pa.
            state: (z, q, 1 + c).
            once: overconsolidation ratio and pre-overburden pressure, by which the vertical stress
                was higher once, then with K0nc to the sides; None: the stress was never higher.
            vertical: number of the component of the vertical stress.
        """
        new = state[CAP, :, 0] == 0.0
        if not new.any():
            return state
        c, stress = stress.shape[2] - 1, stress[:, new]
        k, s = self._constants(c), _principal(stress)
        gamma, cap = self._of_stress(s, k)
        if once is not None and self._K0nc is not None:
            upright = _padded(once[0], c) * -Dual(stress[vertical]) + _padded(once[1], c)
            sides = _padded(self._K0nc, c) * upright
            past = self._of_stress(stacked([upright, sides, sides]), k)
            for other, mine in zip(past, (gamma, cap), strict=True):
                higher = other.value > mine.value
                mine.columns[higher] = other.columns[higher]
        least = (k["p_ref"] * LEAST_STRESS).columns
        cap.columns[:] = np.where(cap.columns[:, :1] > least[..., :1], cap.columns, least)
        state = state.copy()
        state[GAMMA, new], state[CAP, new] = gamma.columns, cap.columns
        return state

    def _of_stress(self, s: Dual, k: Mapping[str, Dual]) -> tuple[Dual, Dual]:
        """gamma_p and p_c (q,) whose surfaces go through principal stresses (3, q)."""
        strength = _strength(s[2], k)
        ratio = _least((s[0] - s[2]) / strength, 1.0 - 1e-9)
        q, gamma = ratio * strength, ratio * 0.0
        if self.has_shear:
            initial, unloading = _compliances(k, self._level(s[2], k))
            gamma = (q * initial / (1.0 - k["Rf"] * ratio) - q * unloading).positive_part()
        return gamma, _cap_radius(s, k) - k["a"]

    def _level(self, s_3: Dual, k: Mapping[str, Dual]) -> Dual:
        """L (q,) at the least principal stress (q,)."""
        a, floor = k["a"], k["p_ref"] * LEAST_STRESS
        held = Dual(
            np.where(s_3.columns[..., :1] > floor.columns[..., :1], s_3.columns, floor.columns)
        )
        return ((a + held) / (a + k["p_ref"])).power(k["m"])

    def mobilised(self, stress: Floats) -> Floats:
        """(q,) largest shear stress of stresses (s, q) by the strength."""
        s = _principal(stress[..., None])
        k = {name: Dual(self._columns[n, :1]) for n, name in enumerate(self._names)}
        return ((s[0] - s[2]) / _strength(s[2], k)).value

    def integrate(
        self,
        stress: Floats,
        state: Floats,
        strain: Floats,
        parts: int,
        *,
        by_constants: bool = True,
        known: Sequence[Solution] = (),
        near: Sequence[Solution] = (),
    ) -> Integrated:
        """Stress and state after a strain step, with their derivatives.

        Args:
            stress: (s, q, 1 + c) before, Pa; the first n of the c derivatives are by the parameters
                of the constants.
            state: (z, q, 1 + c) before.
            strain: (s, q, 1 + c) the step.
            parts: equal parts of the step, each an implicit step of its own.
            by_constants: False: the derivatives are by other things than parameters.
            known: solutions of the parts of the same step, for their derivatives.
            near: those of a step close by, from which to begin.

        Raises:
            NoReturn: the equations of a point were not solved.
        """
        n, c = (None if by_constants else 1), stress.shape[2] - 1
        constants, matrix = (
            np.pad(of[..., :n], [(0, 0)] * (of.ndim - 1) + [(0, c + 1 - of[..., :n].shape[-1])])
            for of in (self._columns, self._matrix)
        )
        state = state.copy()
        if self._small is not None:
            own = self._columns.shape[1] - 1 if by_constants else 0
            strain, state[2:] = self._small.follow(state[2:], strain, own)
        solutions = []
        for n_part in range(parts):
            stress, state, solution = self._part(
                stress,
                state,
                strain / parts,
                constants,
                Dual(matrix),
                known=known[n_part] if known else None,
                near=near[n_part] if near else None,
                by_constants=by_constants,
            )
            solutions.append(solution)
        yields = np.asarray(solutions[-1].active.any(axis=0))
        return Integrated(stress, state, yields, solutions)

    def _part(
        self,
        stress: Floats,
        state: Floats,
        strain: Floats,
        constants: Floats,
        matrix: Dual,
        *,
        known: Solution | None,
        near: Solution | None,
        by_constants: bool,
    ) -> tuple[Floats, Floats, Solution]:
        """One implicit step; constants (k, 1 + c) and E (s, s) with as many derivatives."""
        c = stress.shape[2] - 1
        k = {name: Dual(constants[n]) for n, name in enumerate(self._names)}
        begin = _principal(stress)
        level = self._level(begin[2], k)
        moved = _product(matrix, strain)
        trial = stress + (Dual(moved) * level).columns
        axes = spectrum(trial[..., 0])
        s_trial = -axes.values[::-1]
        before = np.stack([state[GAMMA, :, 0], state[CAP, :, 0], level.value])
        inputs = np.concatenate([s_trial, before])  # (6, q)
        solution = known or self._solve(begin.value, inputs, near)
        some = np.flatnonzero(solution.active.any(axis=0))
        if not len(some):
            return trial, state, solution
        x, active, inputs = solution.x[:, some], solution.active[:, some], inputs[:, some]
        slopes = solution.slopes[..., some]
        if by_constants:
            slopes = self._equations(x, inputs, active, constants=True)[1]
        by = self._jacobian(slopes, inputs, active)
        # along the axes, in their order (the largest tension first), and across them
        resolve, assemble = axes.resolve[some], axes.assemble[some]
        along = np.einsum("qis,sqc->qic", resolve, trial[:, some])
        ends = np.empty_like(along)
        pushed = np.empty((len(some), _N_INPUTS + len(constants), c + 1))
        pushed[:, :3] = -along[:, 2::-1]
        pushed[:, 3:5] = np.moveaxis(state[: CAP + 1, some], 0, 1)
        pushed[:, 5] = level.columns[some]
        pushed[:, _N_INPUTS:] = constants
        moved_x = by @ pushed[..., 1:]  # (q, 5, c)
        ends[:, :3, 0] = -x[2::-1].T
        ends[:, :3, 1:] = -moved_x[:, 2::-1]
        ratio = _turning(inputs[:3], x[:3], by)
        ends[:, 3:, 0] = 0.0
        ends[:, 3:, 1:] = ratio[..., None] * along[:, 3:, 1:]
        stress, state = trial.copy(), state.copy()
        stress[:, some] = np.einsum("qsi,qic->sqc", assemble, ends)
        state[GAMMA, some, 0] += x[_MULTIPLIERS][_SHEAR].sum(axis=0) / self._modulus(inputs[5])
        state[CAP, some, 0] = x[_PC]
        state[: CAP + 1, some, 1:] = np.moveaxis(moved_x[:, 3:5], 1, 0)
        return stress, state, solution

    def _modulus(self, level: Floats) -> Floats:
        """E_ur L (q,) by which multipliers are multiplied, Pa; it is not differentiated."""
        return np.asarray(self._E * level)

    def _solve(self, begin: Floats, inputs: Floats, near: Solution | None) -> Solution:
        """The unknowns and the mechanisms that act.

        Points whose mechanisms do not settle, as near the apex, are followed from the beginning of
        the step: the trial stress comes there in parts.

        Args:
            begin: (3, q) principal stresses at the beginning of the step.
            inputs: (6, q).
            near: a solution at other inputs, from which to begin.

        Raises:
            NoReturn: the equations of a point were not solved.
        """
        x = np.zeros((_N_UNKNOWNS, inputs.shape[1]))
        x[:3], x[_PC] = inputs[:3], inputs[4]
        if near is not None:
            some = near.active.any(axis=0)
            x[:, some] = near.x[:, some]
        solution, left = self._newton(x, inputs)
        if not len(left):
            return solution
        follow, begin, whole = np.zeros((_N_UNKNOWNS, len(left))), begin[:, left], inputs[:, left]
        follow[:3], follow[_PC] = begin, whole[4]
        done, share = 0.0, 0.25
        while done < 1.0:
            part = whole.copy()
            part[:3] = begin + (done + share) * (whole[:3] - begin)
            found, failed = self._newton(follow, part)
            if not len(failed):
                done, follow = done + share, found.x
            elif share > _LEAST_SHARE:
                share *= 0.5
            else:
                raise NoReturn("no stress of a hardening soil")
        solution.x[:, left], solution.active[:, left] = found.x, found.active
        solution.slopes[..., left] = found.slopes
        return solution

    def _newton(self, x: Floats, inputs: Floats) -> tuple[Solution, Ints]:
        """The solution from unknowns (11, q) on by a semismooth method, and points without one."""
        q = x.shape[1]
        x, active = x.copy(), np.zeros((7, q), dtype=bool)
        at_end = np.empty((_N_UNKNOWNS, _N_UNKNOWNS + _N_INPUTS, q))
        rest = np.arange(x.shape[1])
        scale = self._p_ref * LEAST_STRESS + np.abs(inputs[:3]).max(axis=0)
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
            x[_PC, rest] = np.maximum(x[_PC, rest], inputs[4, rest] * (1.0 - 1e-9))
            if not np.isfinite(x[:, rest]).all():
                break
        return Solution(x, active, at_end), rest

    def _jacobian(self, slopes: Floats, inputs: Floats, active: Bools) -> Floats:
        """Derivatives (q, 5, 6 + k) of principal stresses, gamma_p, p_c by inputs and constants."""
        given = slopes[:, _N_UNKNOWNS:]
        moved = -_solved(slopes[:, :_N_UNKNOWNS], given, active)
        by = np.zeros((5, _N_INPUTS + len(self._names), inputs.shape[1]))
        n = given.shape[1]
        by[:3, :n] = moved[:3]
        by[3, :n] = moved[_MULTIPLIERS][_SHEAR].sum(axis=0) / self._modulus(inputs[5])
        by[3, 3] += 1.0
        by[4, :n] = moved[_PC]
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
            inputs: (6, q).
            active: mechanisms that act; None: those beyond their limit.
            constants: False: derivatives (11, 17, q) by the unknowns and the inputs; True: (11, 17
                + k, q) also by the constants.
        """
        size = self._modulus(inputs[5])
        multipliers = x[_MULTIPLIERS] / size
        law = self._law(x, inputs, multipliers, constants=constants)
        if active is None:
            scale = self._p_ref * LEAST_STRESS + np.abs(inputs[:3]).max(axis=0)
            active = x[_MULTIPLIERS] + law.excess.value > _CONVERGED * scale
        columns = np.moveaxis(joined([law.residual, law.excess]).columns, -1, 1)
        equations, of_gamma = columns[:, 0], columns[:, 1 + _OF_GAMMA]
        n_more = columns.shape[1] - 2 - _OF_LEVEL
        slopes = np.zeros((_N_UNKNOWNS, _N_UNKNOWNS + _N_INPUTS + n_more, x.shape[1]))
        slopes[:, :4] = columns[:, 1:5]
        by_multipliers = slopes[:, _MULTIPLIERS]
        by_multipliers[:, _SHEAR] = (of_gamma / size)[:, None]
        by_multipliers[:3] += (
            self._lame * law.flow.sum(axis=0) + 2.0 * self._mu * law.flow
        ) / self._E
        by_multipliers[_PC, _OF_CAP] -= law.growth / size
        mechanism = np.arange(7)
        by_multipliers[4 + mechanism[_PULL], mechanism[_PULL]] -= _SOFT
        by_inputs = slopes[:, _N_UNKNOWNS:]
        by_inputs[:, 3] = of_gamma
        by_inputs[:, 5:] = columns[:, 1 + _OF_LEVEL :]
        by_inputs[np.arange(4), [0, 1, 2, 4]] -= 1.0
        equations[4:] = np.where(active, equations[4:], x[_MULTIPLIERS])
        slopes[4:] *= active[:, None]
        by_multipliers[4 + mechanism, mechanism] += ~active
        return equations, slopes, active

    def _law(self, x: Floats, inputs: Floats, multipliers: Floats, *, constants: bool) -> _Law:
        """The law at an iterate, with its derivatives; multipliers (7, q) are given numbers."""
        n = _OF_LEVEL + 1 + (len(self._names) if constants else 0)
        y = _variables(np.stack([*x[:3], x[_PC], inputs[3] + multipliers[_SHEAR].sum(axis=0)]), n)
        s, p_c, gamma = y[:3], y[3], y[_OF_GAMMA]
        np.maximum(gamma.columns[..., 0], 0.0, out=gamma.columns[..., 0])  # of an iterate
        level = _variables(inputs[5:], n, _OF_LEVEL)[0]
        k: Numbers = dict(zip(self._names, self._columns[:, 0].tolist(), strict=True))
        if constants:
            numbers = _variables(self._columns[:, :1], n, _OF_LEVEL + 1)
            k = {name: numbers[i] for i, name in enumerate(self._names)}
        a, p_ref = k["a"], k["p_ref"]
        flow = Dual(np.moveaxis(np.zeros((1 + n, 3, 7, x.shape[1])), 0, -1))
        upper, lower = s[_UPPER], s[_LOWER]
        limit = _strength(lower, k)
        if self.has_shear:
            limit = _hardened(gamma, limit, *_compliances(k, level), k)
        dilates, pair = _dilation(upper, lower, k), np.arange(3)
        flow.columns[_UPPER, pair] = ((1.0 - dilates) * 0.5).columns
        flow.columns[_LOWER, pair] = ((1.0 + dilates) * -0.5).columns
        p, radius = _mean(s), _cap_radius(s, k)
        inside, distance = 1.0 / radius, p + a
        normal = ((s - p) * (1.5 / k["squared"]) + distance / 3.0) * inside
        flow.columns[:, _OF_CAP] = normal.columns
        flow.columns[pair, 4 + pair, :, 0] = -1.0
        growth = _power((p_c + a) / (p_ref + a), k["m"]) * k["H"] * (distance * inside)
        plastic = Dual((flow.columns * multipliers[..., None]).sum(axis=1))
        volume = Dual(plastic.columns.sum(axis=0)) * k["lame"]
        stress = s - inputs[:3] + (plastic * (2.0 * k["mu"]) + volume) * level
        cap = radius - a - p_c
        if not self.has_cap:
            cap = cap * 0.0 - self._p_ref
        pull = -s - k["tension"] - k["E"] * level * (_SOFT * multipliers[_PULL])
        grown = p_c - inputs[4] - growth * multipliers[_OF_CAP]
        excess = [upper - lower - limit, cap[None], pull]
        return _Law(joined([stress, grown[None]]), joined(excess), flow.value, growth.value)


def cap_constants(constants: Mapping[str, Dual]) -> tuple[Dual, Dual]:
    """Alpha and H (Pa) of the cap by which a first loading without strain to the sides has K0nc.

    And the tangent modulus Eoed where its stress is p_ref. The elastic strain is that of E at K0nc
    p_ref, the strain of shear that by which gamma_p follows the stress; what is left is the cap's.

    Args:
        constants: as of `HardeningSoil`.
    """
    k = _derived(constants)
    a, p_ref, K0, nu, Eoed = (
        k["a"],
        k["p_ref"],
        constants["K0nc"],
        constants["nu"],
        constants["Eoed"],
    )
    side = K0 * p_ref
    scale = a + p_ref
    level = ((a + side) / scale).power(k["m"])
    initial, unloading = _compliances(k, level)
    q, strength = p_ref - side, _strength(side, k)
    ratio = q / strength
    rate, rate_side = Eoed, K0 * Eoed
    elastic = (rate - nu * rate_side * 2.0) / (k["E"] * level)
    elastic_side = (rate_side * (1.0 - nu) - nu * rate) / (k["E"] * level)
    # gamma_p = q (A / (1 - Rf r) - B), A and B ~ L^-1, r = q / q_f
    left = 1.0 - k["Rf"] * ratio
    gamma = q * (initial / left - unloading)
    rate_ratio = (rate - rate_side) / strength - ratio * rate_side / (a + side)
    rate_gamma = (rate - rate_side) * (initial / left - unloading)
    rate_gamma = rate_gamma + q * initial * k["Rf"] * rate_ratio / (left * left)
    rate_gamma = rate_gamma - gamma * k["m"] * rate_side / (a + side)
    dilates = _dilation(p_ref, side, k)
    shear = rate_gamma * (1.0 - dilates) * 0.5
    shear_side = rate_gamma * (1.0 + dilates) * -0.25
    cap, cap_side = 1.0 - elastic - shear, -(elastic_side + shear_side)
    volume, distortion = cap + cap_side * 2.0, (cap - cap_side) * (2.0 / 3.0)
    p = (p_ref + side * 2.0) / 3.0
    alpha = (q / (p + a) * volume / distortion).root()
    squared = alpha * alpha
    radius = (q * q / squared + (p + a) * (p + a)).root()
    rate_p = (rate + rate_side * 2.0) / 3.0
    rate_cap = (q * (rate - rate_side) / squared + (p + a) * rate_p) / radius
    hardening = rate_cap / volume / (radius / scale).power(k["m"])
    return alpha, hardening


def _derived(constants: Mapping[str, Dual]) -> dict[str, Dual]:
    """What the equations are written with: a, E_i, sines, and the constants as they stand."""
    k, phi = constants, constants["friction"]
    lame, mu = lame_constants({name: k[name] for name in ("E", "nu")})
    sine, dilation = phi.sine(), k["dilation"].sine()
    initial = {"E_i": k["E50"] * 2.0 / (2.0 - k["Rf"])} if "E50" in k else {}
    return {
        **{name: k[name] for name in ("E", "m", "p_ref", "Rf", "tension")},
        **initial,
        "lame": lame,
        "mu": mu,
        "a": k["cohesion"] * phi.cosine() / sine,
        "sine": sine,
        "sine_cv": (sine - dilation) / (1.0 - sine * dilation),
    }


def _compliances(k: Numbers, level: Number) -> tuple[Number, Number]:
    """2 / E_i and 2 / E_ur at L, 1/Pa."""
    return 2.0 / (k["E_i"] * level), 2.0 / (k["E"] * level)


def _strength(s_j: Dual, k: Numbers) -> Dual:
    """q_f at the lower stress of a pair, Pa; a little more than zero at the apex and beyond."""
    sine, tiny = k["sine"], k["p_ref"] * _TINY
    return ((s_j + (k["a"] - tiny)).positive_part() + tiny) * (2.0 * sine / (1.0 - sine))


def _hardened(gamma: Dual, strength: Dual, initial: Number, unloading: Number, k: Numbers) -> Dual:
    """min(q(gamma_p), q_f): the root of the quadratic that the hyperbola is.

    Its slopes are those of gamma_p = initial q / (1 - q / asymptote) - unloading q.
    """
    asymptote = strength / k["Rf"]
    g, A, i, u = (_value(one) for one in (gamma, asymptote, initial, unloading))
    b, twice = (i - u) * A + g, 2.0 * g * A
    q = twice / (b + np.sqrt(b * b + 2.0 * u * twice))
    ratio = q / A
    left = 1.0 - ratio
    inverse = 1.0 / (i - u * left * left)
    terms = ((gamma, left * left * inverse), (asymptote, i * ratio * ratio * inverse))
    constants = ((initial, -left * q * inverse), (unloading, left * left * q * inverse))
    return _least(_chained(q, *terms, *constants), strength)


def _dilation(s_i: Dual, s_j: Dual, k: Numbers) -> Dual:
    """sin(psi_m) of a pair."""
    tiny, constant = k["p_ref"] * _TINY, k["sine_cv"]
    sum_ = (s_i + s_j + (2.0 * k["a"] - tiny)).positive_part() + tiny
    ratio, inverse = (s_i.value - s_j.value) / sum_.value, 1.0 / sum_.value
    mobilised = _least(
        _chained(ratio, (s_i, inverse), (s_j, -inverse), (sum_, -ratio * inverse)), k["sine"]
    )
    m, c = mobilised.value, _value(constant)
    below = 1.0 / (1.0 - m * c)
    slopes = (1.0 - c * c) * below**2, (m * m - 1.0) * below**2
    sine = _chained((m - c) * below, (mobilised, slopes[0]), (constant, slopes[1]))
    return sine.positive_part()


def _mean(s: Dual) -> Dual:
    """Mean p (q,) of principal stresses (3, q)."""
    return Dual(s.columns.sum(axis=0) / 3.0)


def _cap_radius(s: Dual, k: Numbers) -> Dual:
    """p_c + a (q,) of the cap through principal stresses (3, q), Pa."""
    p = _mean(s)
    parts = s - p
    squared = Dual((parts * parts).columns.sum(axis=0) * 1.5)
    tiny, p = k["p_ref"] * _TINY, p + k["a"]
    return (squared / k["squared"] + p * p + tiny * tiny).root()


def _value(number: Number) -> Floats:
    return number.value if isinstance(number, Dual) else np.asarray(number)


def _chained(value: Floats, *terms: tuple[Number, Floats]) -> Dual:
    """A function of numbers: its value (...), and each number with the slope (...) by it."""
    parts = [slope[..., None] * one.columns for one, slope in terms if isinstance(one, Dual)]
    columns = parts[0]
    for part in parts[1:]:
        columns += part
    columns[..., 0] = value
    return Dual(columns)


def _least(one: Dual, other: Dual | float) -> Dual:
    """The smaller of two numbers."""
    if not isinstance(other, Dual):
        other = Dual.constant(np.full(one.value.shape, other), one.n)
    return Dual(np.where(one.columns[..., :1] < other.columns[..., :1], one.columns, other.columns))


def _power(base: Dual, exponent: Dual | float) -> Dual:
    if isinstance(exponent, Dual):
        return base.power(exponent)
    return base.through(lambda x: x**exponent, lambda x: exponent * x ** (exponent - 1.0))


def _padded(one: Dual, n: int) -> Dual:
    """With more derivatives, n in all, that are zero."""
    return Dual(np.pad(one.columns, [(0, 0)] * (one.columns.ndim - 1) + [(0, n - one.n)]))


def _variables(values: Floats, n: int, first: int = 0) -> Dual:
    """Numbers (k, ...), each with derivative one by a variable of its own, from one of n on.

    Derivatives are apart in memory, those of all points together: numpy is quicker so.
    """
    columns = np.zeros((1 + n, *values.shape))
    columns[0] = values
    rows = np.arange(len(values))
    columns[1 + first + rows, rows] = 1.0
    return Dual(np.moveaxis(columns, 0, -1))


def _product(matrix: Dual, strain: Floats) -> Floats:
    """E eps (s, q, 1 + c) with both derivatives."""
    product = np.einsum("st,tqc->sqc", matrix.value, strain)
    product[..., 1:] += np.einsum("stc,tq->sqc", matrix.columns[..., 1:], strain[..., 0])
    return np.asarray(product)


def _principal(stress: Floats) -> Dual:
    """s_1 >= s_2 >= s_3 (3, q) of stresses (s, q, 1 + c)."""
    axes = spectrum(stress[..., 0])
    along = -np.einsum("qis,sqc->iqc", axes.resolve[:, :3], stress)
    along[..., 0] = -axes.values
    return Dual(along[::-1])


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


def _turning(trial: Floats, end: Floats, by: Floats) -> Floats:
    """(q, 3) by what shear stresses across the axes change: (s_i - s_j) / (trial s_i - s_j).

    In the order 12, 23, 13 of the axes, the first of which is that of the largest tension. Of equal
    trial stresses it is the limit, ds_i/dtrial_i - ds_i/dtrial_j.
    """
    ratios = []
    for i, j in ((2, 1), (1, 0), (2, 0)):
        apart = trial[i] - trial[j]
        near = np.abs(apart) <= 1e-9 * np.abs(trial).max(axis=0)
        limit = by[:, i, i] - by[:, i, j]
        ratios.append(np.where(near, limit, (end[i] - end[j]) / np.where(near, 1.0, apart)))
    return np.stack(ratios, axis=1)
