"""The generalised criterion of Hoek and Brown as a yield law, smooth but for edges and tip.

E. Hoek, C. Carranza-Torres, B. Corkum (2002), Hoek-Brown failure criterion, 2002 edition. The
return is that of `curved_return`. Its derivatives follow from the equations that it ends with: with
the scaled gradients N and directions of flow M of the active planes, the curvature of an associated
flow D, and what parameters change of the flow (m') and of the planes (f'),

    (E^-1 + D) dsigma + M dlam = E^-1 ds* - E^-1 dE eps_p - m' ,    N^T dsigma = -f' .

D is large near the tip, where it is the inverse of what stays finite: 1/D is taken, and
(E^-1 + D)^-1 is E less a product for each of the two components that D has.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from geoident.fem.yielding.curved_return import (
    APEX,
    CUT_1,
    CUTS,
    SHEAR,
    HoekBrownConstants,
    HoekBrownCurve,
    Returned,
    bracketed,
    returned,
)
from geoident.fem.yielding.principal import OnAxes, check_isotropic
from geoident.fem.yielding.principal_axes import Spectrum, principal_values, spectrum
from geoident.fem.yielding.principal_axes import rough_principal_values as rough_values
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

_ROUNDING = 1e-13
"""Of the stresses: an excess below is none."""

_ROUGH = 1e-6
"""Of the largest stress: an error that rough principal values never have."""

_LEAST, _FAR = 1e-9, 1e6
"""Times the strength: the least and the most that a stress may need."""


class HoekBrownLaw:
    """The criterion in an isotropic elasticity, perfectly plastic.

    Args:
        elasticity: E (s, s), isotropic, of xx, yy, zz, xy (4) or xx, yy, zz, xy, yz, xz (6), Pa.
        constants: of the surface.

    Raises:
        ValueError: E is not isotropic.
    """

    def __init__(self, elasticity: Dual, constants: HoekBrownConstants) -> None:
        check_isotropic(elasticity.value)
        self._constants = constants
        self._lame = Dual(elasticity.columns[0, 1])
        self._twice = Dual(elasticity.columns[0, 0] - elasticity.columns[0, 1])
        self.curve = HoekBrownCurve(
            constants, float(self._lame.value), 0.5 * float(self._twice.value)
        )

    @property
    def planes(self) -> HoekBrownConstants:
        """Its strengths: sigci, and the cut-off if there is one."""
        return self._constants

    @property
    def associated(self) -> bool:
        """Whether plastic strains follow the normals."""
        return self.curve.flow is None

    @property
    def hardens(self) -> bool:
        """Never."""
        return False

    def at(self, points: Ints) -> HoekBrownLaw:
        """The same at points (k,): its numbers are those of all."""
        return self

    def project(self, trial: Floats, hardened: Floats | None = None) -> HoekBrownProjection:
        """Return trial stresses (s, m) to the surface; nothing hardens."""
        rough = rough_values(trial)
        margin = _ROUGH * np.abs(rough).max(axis=0, initial=0.0)
        raised = rough + np.stack([margin, 0.0 * margin, -margin])
        some = np.flatnonzero(self.curve.excess(raised) > 0.0)
        spectral = spectrum(trial[:, some])
        scale = np.abs(spectral.values).max(axis=0, initial=0.0)
        outside = np.flatnonzero(self.curve.excess(spectral.values) > _ROUNDING * scale)
        spectral = spectral.of(outside)
        step = HoekBrownStep(
            self.curve, self._constants, (self._lame, self._twice), spectral.values
        )
        return HoekBrownProjection(trial, some[outside], spectral, step)

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """By how much (y, m) strengths are short at stresses (s, m), Pa: positive outside.

        That of the surface is the sigci that the stress would need, less the given one: stresses
        and sigci grow in proportion.
        """
        values = principal_values(stress)
        rows = [self._needed(values) - self.curve.sigci]
        if self._constants.tension is not None:
            rows.append(values[0] - float(self._constants.tension.value))
        return np.stack(rows)

    def _needed(self, values: Floats) -> Floats:
        """The sigci (m,) on whose surface sorted principal stresses (3, m) lie, Pa.

        The root t = sigci' / sigci of  ln t + a ln(s - mb sigma_1 / sigci') = ln(apart / sigci).
        """
        curve = self.curve
        first, apart = values[0] / curve.sigci, (values[0] - values[2]) / curve.sigci
        scale = np.abs(values).max(axis=0, initial=0.0) / curve.sigci
        if curve.s == 0.0:  # rounding beyond the tip is no tension
            first = np.where(first <= 1e-10 * (scale + 1.0), np.minimum(first, 0.0), first)
        torn = np.maximum(first, 0.0) * curve.mb / (curve.s or _LEAST)
        low, high = np.maximum(torn, _LEAST), np.maximum(_FAR * (1.0 + scale), 2.0 * torn)
        sought = np.log(np.maximum(apart, 1e-100))

        def equation(t: Floats) -> tuple[Floats, Floats]:
            y = np.maximum(curve.s - curve.mb * first / t, 1e-100)
            slope = 1.0 / t + curve.a * curve.mb * first / (t * t * y)
            return np.log(t) + curve.a * np.log(y) - sought, np.asarray(slope)

        at_low, at_high = equation(low)[0], equation(high)[0]
        found = bracketed(equation, low, high)
        found = np.where(at_low >= 0.0, low, np.where(at_high <= 0.0, high, found))
        return np.asarray(curve.sigci * found)


class HoekBrownStep:
    """The step of sorted principal stresses to the surface.

    Args:
        curve: the surface.
        constants: the same with derivatives by n parameters.
        moduli: Lame's constant and 2 G with derivatives, Pa.
        trial: (3, q) principal values of the trial stress, outside the surface.
    """

    def __init__(
        self,
        curve: HoekBrownCurve,
        constants: HoekBrownConstants,
        moduli: tuple[Dual, Dual],
        trial: Floats,
    ) -> None:
        self._curve, self._constants, self._moduli = curve, constants, moduli
        self.trial = trial
        self.found: Returned = returned(curve, trial)

    @property
    def returned(self) -> Floats:
        """(3, q) principal values of the admissible stress."""
        return self.found.stress

    @cached_property
    def multipliers(self) -> Floats:
        """(q, 2) of the surface (divided by z, where the flow is associated) and of the cut-off.

        At the tip, where many flows make one plastic strain, their sizes count.
        """
        each = self.found.multipliers
        if self._curve.natural:
            each = np.where((self.found.active == APEX)[:, None], np.abs(each), each)
        return self._summed(each)

    def _summed(self, each: Floats) -> Floats:
        """(q, 2, ...) sums over pairs and over cuts of values (q, 3, ...)."""
        pairs = np.array([len(pairs) for pairs in SHEAR])[self.found.active]
        of_pair = np.arange(3) < pairs[:, None]
        of_pair = of_pair.reshape(*of_pair.shape, *(1,) * (each.ndim - 2))
        if self._curve.natural:  # the tip is a part of the surface
            of_pair = np.ones_like(of_pair)
        return np.stack([(each * of_pair).sum(axis=1), (each * ~of_pair).sum(axis=1)], axis=1)

    @property
    def reserve(self) -> Floats:
        """(q,) 1/2 (s* - sigma)^T E^-1 (s* - sigma), J/m3."""
        apart = self.trial - self.found.stress
        return np.asarray(0.5 * (apart * self.found.plastic).sum(axis=0))

    @cached_property
    def active(self) -> Bools:
        """(q, 2) whether the surface is active, and the cut-off."""
        numbers = self.found.active
        shears = np.array([len(pairs) > 0 for pairs in SHEAR])[numbers]
        if self._curve.natural:
            return np.stack([np.ones_like(shears), np.zeros_like(shears)], axis=1)
        return np.stack([shears, numbers >= CUT_1], axis=1)

    @cached_property
    def reached(self) -> Bools:
        """(q, 2) whether the stress lies on the surface, and on the cut-off."""
        stress, curve = self.found.stress, self._curve
        near = 1e2 * _ROUNDING * (np.abs(self.trial).max(axis=0) + curve.sigci * 1e-6)
        on = stress[0] - stress[2] - curve.width(curve.y_of(stress[0])) >= -near
        cut = np.zeros_like(on) if curve.natural else stress[0] - curve.cut >= -near
        return np.stack([on, cut], axis=1) | self.active

    @cached_property
    def working(self) -> Bools:
        """(q, 2) whether they flow."""
        size = np.abs(self.found.plastic).max(axis=0)[:, None]
        return np.asarray(np.abs(self.multipliers) > 1e-11 * size)

    @cached_property
    def _system(self) -> _Linearised:
        return _Linearised(self._curve, self.found)

    @cached_property
    def reduction(self) -> Floats:
        """(q, 3, 3) dsigma/ds*."""
        twice, lame = 2.0 * self._curve.shear, self._curve.lame
        inverse = (np.eye(3) - lame / (3.0 * lame + twice)) / twice
        return np.asarray(self._system.by_strain @ inverse)

    def derivatives(self, trial: Floats, *, of_law: bool) -> tuple[Floats, Floats]:
        """Derivatives (3, q, n + k) of the stress and (2, q, n + k) of multipliers.

        Args:
            trial: (3, q, n + k) of the principal values of the trial stress.
            of_law: the first n columns are by the parameters of the law.
        """
        strain = self._curve.strain(trial)
        limits = np.zeros((trial.shape[1], 3, trial.shape[2]))
        if of_law:
            n = self._constants.sigci.n
            for column in range(n):
                self._add_direct(column, strain[:, :, column], limits[:, :, column])
        stress, multipliers = self._system.solve(strain, limits)
        return stress, np.moveaxis(self._summed(multipliers), 0, 1)

    def _add_direct(self, column: int, strain: Floats, limits: Floats) -> None:
        """What a parameter changes where stress and multipliers are kept.

        Args:
            column: number of the parameter.
            strain: (3, q) in place: elastic strains of what changes the trial stress.
            limits: (q, 3) in place: yield functions of the planes of each set.
        """
        curve, found, given = self._curve, self.found, self._constants

        def rate(number: Dual | None) -> float:
            return 0.0 if number is None else float(number.columns[1 + column])

        lame, twice = (rate(modulus) for modulus in self._moduli)
        if lame or twice:
            strain -= curve.strain(lame * found.plastic.sum(axis=0) + twice * found.plastic)
        by_log = rate(given.sigci) / curve.sigci
        mb, s, a = rate(given.mb), rate(given.s), rate(given.a)
        cut = rate(given.cut)
        moves = any((by_log, mb, s, a))
        sine = 0.0
        if given.dilation is not None:
            sine = rate(given.dilation) * float(np.cos(given.dilation.value))
        for number in np.unique(found.active):
            at = np.flatnonzero(found.active == number)
            pairs = SHEAR[number]
            for place in range(CUTS[number]):
                limits[at, len(pairs) + place] = -cut
            y = found.y[at]
            for place, (i, j) in enumerate(pairs):
                multiplier = found.multipliers[at, place]
                if sine:
                    strain[i, at] -= sine * multiplier
                    strain[j, at] -= sine * multiplier
                if not moves:
                    continue
                first = found.stress[i, at] / curve.sigci
                along = s - first * (mb - curve.mb * by_log)  # dy at a fixed stress
                log = np.log(y)
                limits[at, place] = -curve.sigci * (y * (by_log + log * a) + curve.a * along)
                if curve.flow is None:
                    turned = mb / curve.mb + a / curve.a + log * a + (curve.a - 1.0) * along / y
                    strain[i, at] -= multiplier * curve.c * turned


class _Linearised:
    """The equations of a return, linearised where it ended.

    Args:
        curve: the surface.
        found: where trial stresses (q) ended.
    """

    def __init__(self, curve: HoekBrownCurve, found: Returned) -> None:
        q = len(found.active)
        self.by_strain = np.zeros((q, 3, 3))
        self._by_limit = np.zeros((q, 3, 3))
        self._of_strain = np.zeros((q, 3, 3))
        self._of_limit = np.zeros((q, 3, 3))
        for number in np.unique(found.active):
            self._fill(curve, found, int(number), np.flatnonzero(found.active == number))

    def _fill(self, curve: HoekBrownCurve, found: Returned, number: int, at: Ints) -> None:
        pairs, cuts = SHEAR[number], CUTS[number]
        y, k = found.y[at], len(pairs) + cuts
        z = y ** (1.0 - curve.a)
        grows, shrinks, _ = curve.directions(z)
        normals, flow = np.zeros((len(at), 3, k)), np.zeros((len(at), 3, k))
        for place, (i, j) in enumerate(pairs):
            normals[:, i, place], normals[:, j, place] = z + curve.c, -z
            flow[:, i, place], flow[:, j, place] = grows, -shrinks
        for place in range(cuts):
            normals[:, place, len(pairs) + place] = flow[:, place, len(pairs) + place] = 1.0
        soft = self._softened(curve, found.multipliers[at], pairs, y)
        moved = soft @ flow
        inverse = np.linalg.inv(np.swapaxes(normals, 1, 2) @ moved)
        gains = inverse @ np.swapaxes(normals, 1, 2)
        self._of_strain[at, :k] = gains @ soft
        self._of_limit[at, :k, :k] = inverse
        self._by_limit[at, :, :k] = moved @ inverse
        self.by_strain[at] = 0.0 if number == APEX else soft - moved @ gains @ soft

    @staticmethod
    def _softened(
        curve: HoekBrownCurve, multipliers: Floats, pairs: tuple[tuple[int, int], ...], y: Floats
    ) -> Floats:
        """(E^-1 + D)^-1 (k, 3, 3)."""
        twice = 2.0 * curve.shear
        soft = np.tile(curve.lame + twice * np.eye(3), (len(y), 1, 1))
        if curve.flow is not None or not pairs:
            return soft
        bends = curve.mb**2 * curve.a * (1.0 - curve.a) / curve.sigci
        for i in sorted({i for i, _ in pairs}):
            total = sum(multipliers[:, p] for p, (first, _) in enumerate(pairs) if first == i)
            with np.errstate(divide="ignore"):
                rest = y / (bends * np.maximum(total, 0.0))  # 1 / D_i
            column = soft[:, :, i]
            soft = (
                soft - column[:, :, None] * column[:, None] / (rest + soft[:, i, i])[:, None, None]
            )
        return soft

    def solve(self, strain: Floats, limits: Floats) -> tuple[Floats, Floats]:
        """Derivatives of the stress (3, q, n) and of the multipliers (q, 3, n).

        Args:
            strain: (3, q, n) right side, in strains.
            limits: (q, 3, n) changes of the yield functions at kept stresses.
        """
        stress = np.einsum("qij,jqn->iqn", self.by_strain, strain)
        stress -= np.einsum("qik,qkn->iqn", self._by_limit, limits)
        multipliers = np.einsum("qki,iqn->qkn", self._of_strain, strain)
        return stress, multipliers + self._of_limit @ limits


class HoekBrownProjection(OnAxes):
    """What `HoekBrownLaw` makes of trial stresses; see `law.Projection`.

    Args:
        trial: (s, m).
        yielded: (q,) the points outside the surface, ascending.
        spectral: principal values and axes of their trial stress.
        step: of the principal values.
    """

    def __init__(
        self, trial: Floats, yielded: Ints, spectral: Spectrum, step: HoekBrownStep
    ) -> None:
        super().__init__(trial, yielded, spectral, step)
        self.step = step
        self._count = len(step._constants)

    @property
    def multipliers(self) -> Floats:
        """(q, y) dlam >= 0 of this step at those points."""
        return np.maximum(self.step.multipliers[:, : self._count], 0.0)

    @property
    def active(self) -> Bools:
        """(q, y) planes on which the derivatives are taken."""
        return self.step.active[:, : self._count]

    @property
    def biactive(self) -> Bools:
        """(q, y) planes that are reached with dlam = 0."""
        step = self.step
        return np.asarray((step.reached & ~step.working)[:, : self._count])

    @property
    def reserve(self) -> Floats:
        """(q,) J/m3."""
        return self.step.reserve

    def derivatives(
        self, trial: Floats, hardened: Floats | None = None, *, of_law: bool
    ) -> tuple[Floats, Floats]:
        """Derivatives (s, q, n + k) of stress and (y, q, n + k) of multipliers.

        Args:
            trial: (s, q, n + k) of the trial stress.
            hardened: (y, q, n + k), none: nothing hardens.
            of_law: the first n columns are by the parameters of the law.
        """
        along = self.along(trial)
        values, multipliers = self.step.derivatives(along[:3], of_law=of_law)
        return self.assembled(values, along), multipliers[: self._count]
