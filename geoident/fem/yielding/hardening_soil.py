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
solved by a semismooth Newton method. They are written with dual numbers: the tangent and the
derivatives by all constants are those of the converged equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from geoident.fem.elasticity import isotropic, lame_constants
from geoident.fem.yielding.domain import NoReturn
from geoident.fem.yielding.principal_axes import spectrum
from geoident.fem.yielding.small_strains import STRINGS, SmallStrains
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import Dual, stacked

GAMMA, CAP = 0, 1
"""Places of gamma_p and p_c in the state of a point, before those of strings (`SmallStrains`). A
point whose p_c is zero is in none yet."""

LEAST_STRESS = 0.01
"""Part of p_ref below which s_3 and p_c do not lower the stiffness."""

_PAIRS = ((0, 2), (0, 1), (1, 2))
_SHEAR, _OF_CAP, _PC, _PULL = slice(3, 6), 6, 7, slice(8, 11)
"""Unknowns after the principal stresses: three multipliers of shear, that of the cap, p_c, and
three of tension. Multipliers are times the modulus, so that all are in Pa."""
_N_UNKNOWNS = 11
_N_INPUTS = 6
"""Trial stresses (3), gamma_p, p_c and L; after them the constants."""

_SOFT = 1e-6
"""Compliance of the tension cut-off by that of the ground: at the apex more than three mechanisms
act at once."""

_TINY = 1e-6
"""Part of p_ref that keeps what is divided by above zero at the apex."""

_CONVERGED = 1e-12
_MOST_STEPS = 50


Numbers: TypeAlias = "Mapping[str, Dual] | Mapping[str, Dual | float]"
"""Constants of the law by name: numbers where they are not differentiated by."""


@dataclass(frozen=True)
class Integrated:
    """Where a strain step led.

    Args:
        stress: (s, q, 1 + c) with its derivatives, Pa.
        state: (z, q, 1 + c) gamma_p and p_c, after them what small strains remember.
        yields: (q,) points whose plastic strain grew in the last part of the step.
    """

    stress: Floats
    state: Floats
    yields: Bools


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
            past = self._of_stress([upright, sides, sides], k)
            for other, mine in zip(past, (gamma, cap), strict=True):
                higher = other.value > mine.value
                mine.columns[higher] = other.columns[higher]
        least = (k["p_ref"] * LEAST_STRESS).columns
        cap.columns[:] = np.where(cap.columns[:, :1] > least[..., :1], cap.columns, least)
        state = state.copy()
        state[GAMMA, new], state[CAP, new] = gamma.columns, cap.columns
        return state

    def _of_stress(self, s: list[Dual], k: Mapping[str, Dual]) -> tuple[Dual, Dual]:
        """gamma_p and p_c (q,) whose surfaces go through principal stresses, three of (q,)."""
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
    ) -> Integrated:
        """Stress and state after a strain step, with their derivatives.

        Args:
            stress: (s, q, 1 + c) before, Pa; the first n of the c derivatives are by the parameters
                of the constants.
            state: (z, q, 1 + c) before.
            strain: (s, q, 1 + c) the step.
            parts: equal parts of the step, each an implicit step of its own.
            by_constants: False: the derivatives are by other things than parameters.

        Raises:
            NoReturn: the equations of a point were not solved.
        """
        n, c = (None if by_constants else 1), stress.shape[2] - 1
        constants, matrix = (
            np.pad(of[..., :n], [(0, 0)] * (of.ndim - 1) + [(0, c + 1 - of[..., :n].shape[-1])])
            for of in (self._columns, self._matrix)
        )
        yields, state = np.zeros(stress.shape[1], dtype=bool), state.copy()
        if self._small is not None:
            own = self._columns.shape[1] - 1 if by_constants else 0
            strain, state[2:] = self._small.follow(state[2:], strain, own)
        for _ in range(parts):
            stress, state, yields = self._part(
                stress, state, strain / parts, constants, Dual(matrix), by_constants=by_constants
            )
        return Integrated(stress, state, yields)

    def _part(
        self,
        stress: Floats,
        state: Floats,
        strain: Floats,
        constants: Floats,
        matrix: Dual,
        *,
        by_constants: bool,
    ) -> tuple[Floats, Floats, Bools]:
        """One implicit step; constants (k, 1 + c) and E (s, s) with as many derivatives."""
        c = stress.shape[2] - 1
        k = {name: Dual(constants[n]) for n, name in enumerate(self._names)}
        level = self._level(_principal(stress)[2], k)
        moved = _product(matrix, strain)
        trial = stress + (Dual(moved) * level).columns
        axes = spectrum(trial[..., 0])
        s_trial = -axes.values[::-1]
        before = np.stack([state[GAMMA, :, 0], state[CAP, :, 0], level.value])
        inputs = np.concatenate([s_trial, before])  # (6, q)
        x, active = self._solve(inputs)
        yields = np.asarray(active.any(axis=1))
        if not yields.any():
            return trial, state, yields
        some = np.flatnonzero(yields)
        by = self._jacobian(x[:, some], inputs[:, some], active[some], constants=by_constants)
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
        ends[:, :3, 0] = -x[2::-1, some].T
        ends[:, :3, 1:] = -moved_x[:, 2::-1]
        ratio = _turning(s_trial[:, some], x[:3, some], by)
        ends[:, 3:, 0] = 0.0
        ends[:, 3:, 1:] = ratio[..., None] * along[:, 3:, 1:]
        stress, state = trial.copy(), state.copy()
        stress[:, some] = np.einsum("qsi,qic->sqc", assemble, ends)
        state[GAMMA, some, 0] += x[_SHEAR, some].sum(axis=0) / self._modulus(inputs[5, some])
        state[CAP, some, 0] = x[_PC, some]
        state[: CAP + 1, some, 1:] = np.moveaxis(moved_x[:, 3:5], 1, 0)
        return stress, state, yields

    def _modulus(self, level: Floats) -> Floats:
        """E_ur L (q,) by which multipliers are multiplied, Pa; it is not differentiated."""
        return np.asarray(self._E * level)

    def _solve(self, inputs: Floats) -> tuple[Floats, Bools]:
        """Unknowns (11, q) and mechanisms (q, 7) that act, by a semismooth Newton method.

        Args:
            inputs: (6, q).
        """
        q = inputs.shape[1]
        x, active = np.zeros((_N_UNKNOWNS, q)), np.zeros((q, 7), dtype=bool)
        x[:3], x[_PC] = inputs[:3], inputs[4]
        rest = np.arange(q)
        scale = self._p_ref * LEAST_STRESS + np.abs(inputs[:3]).max(axis=0)
        for _ in range(_MOST_STEPS):
            residual, excess = self._residual(x[:, rest], inputs[:, rest])
            size = scale[rest, None]
            acts = _multipliers(x[:, rest]) + excess.value > _CONVERGED * size
            now = _chosen(residual, excess, acts, x[:, rest])
            active[rest] = acts
            open_ = np.abs(now.value).max(axis=1) > _CONVERGED * scale[rest]
            rest = rest[open_]
            if not len(rest):
                return x, active
            columns = now.columns[open_]
            try:
                step = np.linalg.solve(columns[..., 1:], columns[..., :1])[..., 0]
            except np.linalg.LinAlgError as error:
                raise NoReturn("no stress of a hardening soil") from error
            x[:, rest] -= step.T
            x[_PC, rest] = np.maximum(x[_PC, rest], inputs[4, rest] * (1.0 - 1e-9))
            if not np.isfinite(x[:, rest]).all():
                break
        raise NoReturn("no stress of a hardening soil")

    def _jacobian(self, x: Floats, inputs: Floats, active: Bools, *, constants: bool) -> Floats:
        """Derivatives (q, 5, 6 + k) of principal stresses, gamma_p, p_c by inputs and constants."""
        residual, excess = self._residual(x, inputs, constants=constants)
        columns = _chosen(residual, excess, active, x).columns
        own, given = columns[..., 1 : 1 + _N_UNKNOWNS], columns[..., 1 + _N_UNKNOWNS :]
        slopes = -np.linalg.solve(own, given)
        size = self._modulus(inputs[5])[:, None]
        by = np.zeros((len(active), 5, _N_INPUTS + len(self._names)))
        by[:, :3, : slopes.shape[2]] = slopes[:, :3]
        by[:, 3, : slopes.shape[2]] = slopes[:, _SHEAR].sum(axis=1) / size
        by[:, 3, 3] += 1.0
        by[:, 4, : slopes.shape[2]] = slopes[:, _PC]
        return by

    def _residual(
        self, x: Floats, inputs: Floats, *, constants: bool | None = None
    ) -> tuple[Dual, Dual]:
        """Equations (q, 4) of stresses and p_c, and excess (q, 7) over the seven limits, Pa.

        With derivatives by the unknowns; unless ``constants`` is None also by inputs and constants.

        Args:
            x: (11, q).
            inputs: (6, q).
            constants: whether derivatives by the constants are wanted.
        """
        n_more = 0 if constants is None else _N_INPUTS + len(self._names)
        n = _N_UNKNOWNS + n_more
        unknown = [_independent(x[i], i, n) for i in range(_N_UNKNOWNS)]
        given = [
            _independent(inputs[i], _N_UNKNOWNS + i if n_more else None, n)
            for i in range(_N_INPUTS)
        ]
        first = _N_UNKNOWNS + _N_INPUTS
        k: dict[str, Dual | float] = {
            name: _independent(self._columns[i, :1], first + i, n)
            if constants
            else float(self._columns[i, 0])
            for i, name in enumerate(self._names)
        }
        s, p_c, level = unknown[:3], unknown[_PC], given[5]
        size = self._modulus(inputs[5])
        shear = [one / size for one in unknown[_SHEAR]]
        pulled = [one / size for one in unknown[_PULL]]
        of_cap = unknown[_OF_CAP] / size
        a, p_ref = k["a"], k["p_ref"]
        gamma = given[3] + shear[0] + shear[1] + shear[2]
        np.maximum(gamma.columns[..., 0], 0.0, out=gamma.columns[..., 0])  # of an iterate
        plastic = [-one for one in pulled]
        excess = []
        for multiplier, (i, j) in zip(shear, _PAIRS, strict=True):
            strength = _strength(s[j], k)
            limit = _hardened(gamma, strength, level, k) if self.has_shear else strength
            excess.append(s[i] - s[j] - limit)
            dilates = _dilation(s[i], s[j], k)
            plastic[i] = plastic[i] + multiplier * (1.0 - dilates) * 0.5
            plastic[j] = plastic[j] - multiplier * (1.0 + dilates) * 0.5
        p = (s[0] + s[1] + s[2]) / 3.0
        radius = _cap_radius(s, k)
        for i in range(3):
            normal = ((s[i] - p) * 1.5 / k["squared"] + (p + a) / 3.0) / radius
            plastic[i] = plastic[i] + of_cap * normal
        compacted = of_cap * (p + a) / radius
        excess.append(radius - a - p_c)
        if not self.has_cap:
            excess[-1] = excess[-1] * 0.0 - self._p_ref
        excess += [-s[i] - k["tension"] - pulled[i] * k["E"] * level * _SOFT for i in range(3)]
        volume = (plastic[0] + plastic[1] + plastic[2]) * k["lame"]
        residual = [
            s[i] - given[i] + level * (volume + plastic[i] * (2.0 * k["mu"])) for i in range(3)
        ]
        grown = _power((p_c + a) / (p_ref + a), k["m"]) * k["H"] * compacted
        residual.append(p_c - given[4] - grown)
        return _last(residual), _last(excess)


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


def _compliances(k: Numbers, level: Dual) -> tuple[Dual, Dual]:
    """2 / E_i and 2 / E_ur at L, 1/Pa."""
    return 2.0 / (k["E_i"] * level), 2.0 / (k["E"] * level)


def _strength(s_j: Dual, k: Numbers) -> Dual:
    """q_f at the lower stress of a pair, Pa; a little more than zero at the apex and beyond."""
    sine, tiny = k["sine"], k["p_ref"] * _TINY
    return ((s_j + (k["a"] - tiny)).positive_part() + tiny) * (2.0 * sine / (1.0 - sine))


def _hardened(gamma: Dual, strength: Dual, level: Dual, k: Numbers) -> Dual:
    """min(q(gamma_p), q_f): the root of the quadratic that the hyperbola is."""
    initial, unloading = _compliances(k, level)
    asymptote = strength / k["Rf"]
    b, twice = (initial - unloading) * asymptote + gamma, 2.0 * gamma * asymptote
    q = twice / (b + (b * b + 2.0 * unloading * twice).root())
    return _least(q, strength)


def _dilation(s_i: Dual, s_j: Dual, k: Numbers) -> Dual:
    """sin(psi_m) of a pair."""
    tiny, constant = k["p_ref"] * _TINY, k["sine_cv"]
    mean = (s_i + s_j + (2.0 * k["a"] - tiny)).positive_part() + tiny
    mobilised = _least((s_i - s_j) / mean, k["sine"])
    return ((mobilised - constant) / (1.0 - mobilised * constant)).positive_part()


def _cap_radius(s: list[Dual], k: Numbers) -> Dual:
    """p_c + a of the cap through principal stresses, Pa."""
    p = (s[0] + s[1] + s[2]) / 3.0
    parts = [s[i] - p for i in range(3)]
    squared = (parts[0] * parts[0] + parts[1] * parts[1] + parts[2] * parts[2]) * 1.5
    tiny, p = k["p_ref"] * _TINY, p + k["a"]
    return (squared / k["squared"] + p * p + tiny * tiny).root()


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


def _independent(values: Floats, place: int | None, n: int) -> Dual:
    """Numbers (q,) with derivative one by the variable at a place; None: by none."""
    number = Dual.constant(values, n)
    if place is not None:
        number.columns[..., 1 + place] = 1.0
    return number


def _last(duals: list[Dual]) -> Dual:
    """Numbers (q,) as (q, k)."""
    return Dual(np.moveaxis(stacked(duals).columns, 0, 1))


def _product(matrix: Dual, strain: Floats) -> Floats:
    """E eps (s, q, 1 + c) with both derivatives."""
    product = np.einsum("st,tqc->sqc", matrix.value, strain)
    product[..., 1:] += np.einsum("stc,tq->sqc", matrix.columns[..., 1:], strain[..., 0])
    return np.asarray(product)


def _principal(stress: Floats) -> list[Dual]:
    """s_1 >= s_2 >= s_3, three of (q,), of stresses (s, q, 1 + c)."""
    axes = spectrum(stress[..., 0])
    along = -np.einsum("qis,sqc->iqc", axes.resolve[:, :3], stress)
    along[..., 0] = -axes.values
    return [Dual(along[i]) for i in (2, 1, 0)]


def _multipliers(x: Floats) -> Floats:
    """(q, 7) of the unknowns (11, q)."""
    return np.concatenate([x[_SHEAR], x[_OF_CAP : _OF_CAP + 1], x[_PULL]]).T


def _chosen(residual: Dual, excess: Dual, active: Bools, x: Floats) -> Dual:
    """The equations (q, 11), in the order of the unknowns: of what does not act, no multiplier."""
    places = np.array([3, 4, 5, 6, 8, 9, 10])
    none = np.zeros_like(excess.columns)
    none[..., 0] = _multipliers(x)
    none[:, np.arange(7), 1 + places] = 1.0
    limits = np.where(active[..., None], excess.columns, none)
    whole = np.empty((len(active), _N_UNKNOWNS, excess.columns.shape[2]))
    whole[:, :3], whole[:, _PC] = residual.columns[:, :3], residual.columns[:, 3]
    whole[:, places] = limits
    return Dual(whole)


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
