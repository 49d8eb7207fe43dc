"""Hardening soil at strain points: stress and state after a strain step (theory 19).

The law is in `hardening_law`, the equations of an implicit step in `hardening_equations`. A strain
step comes in two halves. In each the elasticity is that of one level of stress: in the first half
of its beginning, in the second of what its end is expected to be, so that on the whole the level is
that of the middle. Limits follow the stress at the end of each half.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem.elasticity import isotropic
from geoident.fem.yielding.hardening_equations import (
    BEGIN,
    GAMMA_BEFORE,
    LEVEL,
    MULTIPLIERS,
    N_INPUTS,
    PC,
    SHEAR,
    TRIAL,
    Solution,
    StepEquations,
)
from geoident.fem.yielding.hardening_law import (
    LEAST_STRESS,
    cap_constants,
    cap_radius,
    compliances,
    derived,
    least,
    strength,
    stress_level,
)
from geoident.fem.yielding.principal_axes import PAIRS, Spectrum, spectrum
from geoident.fem.yielding.small_strains import STRINGS, SmallStrains
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import Dual, stacked

GAMMA, CAP = 0, 1
"""Places of gamma_p and p_c in the state of a point, before those of strings (`SmallStrains`). A
point whose p_c is zero is in none yet."""

_ONE, _OTHER = np.array(PAIRS).T

_EQUAL = 1e-9
"""Difference of principal stresses, by the largest, below which they are taken as equal."""


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
        self._has_shear, has_cap = "E50" in constants, "Eoed" in constants
        numbers = derived(constants)
        one = Dual.constant(1.0, constants["E"].n)
        alpha, hardening = cap_constants(constants) if has_cap else (one, one)
        numbers |= {"squared": alpha * alpha, "H": hardening}
        self._names = tuple(numbers)
        self._columns = np.stack([number.columns for number in numbers.values()])
        self._equations = StepEquations(numbers, has_shear=self._has_shear, has_cap=has_cap)
        self._K0nc = constants.get("K0nc")
        self._small = SmallStrains(constants, n_strain) if "G0" in constants else None
        self.n_state = 2 if self._small is None else 2 + STRINGS * n_strain

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
        largest = strength(s[2], k)
        ratio = least((s[0] - s[2]) / largest, 1.0 - 1e-9)
        q, gamma = ratio * largest, ratio * 0.0
        if self._has_shear:
            initial, unloading = compliances(k, stress_level(s[2], k))
            gamma = (q * initial / (1.0 - k["Rf"] * ratio) - q * unloading).positive_part()
        return gamma, cap_radius(s, k) - k["a"]

    def mobilised(self, stress: Floats) -> Floats:
        """(q,) largest shear stress of stresses (s, q) by the strength."""
        s = _principal(stress[..., None])
        k = {name: Dual(self._columns[n, :1]) for n, name in enumerate(self._names)}
        return ((s[0] - s[2]) / strength(s[2], k)).value

    def integrate(
        self,
        stress: Floats,
        state: Floats,
        strain: Floats,
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
            by_constants: False: the derivatives are by other things than parameters.
            known: solutions of the halves of the same step, for their derivatives.
            near: those of a step close by, from which to begin.

        Raises:
            NoReturn: the equations of a point were not solved.
        """
        n, c = (None if by_constants else 1), stress.shape[2] - 1
        constants, matrix = (
            np.pad(of[..., :n], [(0, 0)] * (of.ndim - 1) + [(0, c + 1 - of[..., :n].shape[-1])])
            for of in (self._columns, self._matrix)
        )
        k = {name: Dual(constants[n]) for n, name in enumerate(self._names)}
        state = state.copy()
        if self._small is not None:
            own = self._columns.shape[1] - 1 if by_constants else 0
            strain, state[2:] = self._small.follow(state[2:], strain, own)
        moved, solutions = Dual(0.5 * _product(Dual(matrix), strain)), list[Solution]()
        first = stress_level(_principal(stress)[2], k)
        for half in (0, 1):
            begin = _principal(stress)
            level = stress_level(begin[2], k)
            if half:
                level = level * _expected(level / first)
            trial = stress + (moved * level).columns
            axes = spectrum(trial[..., 0])
            old = [state[GAMMA, :, 0], state[CAP, :, 0], level.value]
            inputs = np.concatenate([begin.value, -axes.values[::-1], old])
            solution = (
                known[half]
                if known
                else self._equations.solve(inputs, near[half] if near else None)
            )
            solutions.append(solution)
            some = np.flatnonzero(solution.active.any(axis=0))
            if len(some):
                by = self._equations.derivatives(solution, inputs, some, constants=by_constants)
                pushed = np.empty((len(some), N_INPUTS + len(constants), c + 1))
                axes, before = axes.of(some), begin.columns[:, some].swapaxes(0, 1)
                along = np.einsum("qis,sqc->qic", axes.resolve[:, 2::-1], trial[:, some])
                pushed[:, BEGIN], pushed[:, TRIAL] = before, -along
                pushed[:, GAMMA_BEFORE:LEVEL] = np.moveaxis(state[: CAP + 1, some], 0, 1)
                pushed[:, LEVEL], pushed[:, N_INPUTS:] = level.columns[some], constants
                slopes, x = by @ pushed[..., 1:], solution.x[:, some]  # (q, 5, c)
                end = np.concatenate([x[:3].T[..., None], slopes[:, :3]], axis=2)
                # the axes are in the order of tension, the principal stresses of pressure
                stress = _end_stress(
                    axes, trial[:, some], -end[:, ::-1], by[:, 2::-1, TRIAL][:, :, ::-1]
                )
                sheared = x[MULTIPLIERS][SHEAR].sum(axis=0)
                state[GAMMA, some, 0] += sheared / self._equations.modulus(inputs[LEVEL, some])
                state[CAP, some, 0] = x[PC]
                state[: CAP + 1, some, 1:] = np.moveaxis(slopes[:, 3:5], 1, 0)
                trial[:, some] = stress
            stress = trial
        return Integrated(stress, state, np.asarray(solution.active.any(axis=0)), solutions)


def _end_stress(axes: Spectrum, trial: Floats, ends: Floats, slopes: Floats) -> Floats:
    """Stresses (s, q, 1 + c) at the end of a step, with their derivatives, in the trial axes.

    Stresses across the axes change by (e_i - e_j) / (T_i - T_j) of those of the trial stress.

    Args:
        axes: of the trial stresses.
        trial: (s, q, 1 + c) stresses.
        ends: (q, 3, 1 + c) principal values at the end, in the order of the axes.
        slopes: (q, 3, 3) of the ends by the principal values of the trial stress.
    """
    along = np.einsum("qis,sqc->qic", axes.resolve, trial)
    gap, left = (of[:, _ONE, 0] - of[:, _OTHER, 0] for of in (along, ends))
    near = np.abs(gap) <= _EQUAL * np.abs(along[:, :3, 0]).max(axis=1, keepdims=True)
    limit = slopes[:, _ONE, _ONE] - slopes[:, _ONE, _OTHER]
    ratio = np.where(near, limit, left / np.where(near, 1.0, gap))
    along[:, :3], along[:, 3:, 0] = ends, 0.0
    along[:, 3:, 1:] *= ratio[..., None]
    return np.asarray(np.einsum("qsi,qic->sqc", axes.assemble, along))


def _expected(growth: Dual) -> Dual:
    """Growth of L in the second half of a step, after that in the first: the same, at most 2."""
    return (growth - 1.0).through(np.tanh, lambda x: 1.0 - np.tanh(x) ** 2) + 1.0


def _padded(one: Dual, n: int) -> Dual:
    """With more derivatives, n in all, that are zero."""
    return Dual(np.pad(one.columns, [(0, 0)] * (one.columns.ndim - 1) + [(0, n - one.n)]))


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
