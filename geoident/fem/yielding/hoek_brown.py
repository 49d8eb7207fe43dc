"""The generalised criterion of Hoek and Brown as a yield law: return mapping and derivatives.

E. Hoek, C. Carranza-Torres, B. Corkum (2002), Hoek-Brown failure criterion, 2002 edition. With
sigma_1 >= sigma_2 >= sigma_3 (tension positive) the surface is, for every pair i before j,

    f_ij = sigma_i - sigma_j - q(sigma_i) <= 0 ,    q = sigci y^a ,    y = s - mb sigma_i / sigci

and no principal stress exceeds the cut-off T, at most the tip s sigci / mb. At the tip q falls with
an infinite slope. So yield functions are multiplied by z = y^(1-a), which makes their gradients

    n = (z + mb a, -z)   on i and j ,

finite and continuous up to the tip, where they are those of the cut-off; and the unknown of the
return is w = y^k, k = min(a, 1-a), by which q and z have finite slopes. The flow is along n
(associated) or along (1 + sin psi, -(1 - sin psi)), written (g, -d) below; that of the cut-off is
along its normal.

*Return.* Some of the largest principal stresses (n_t of them) end at sigma_1 and some of the
smallest (n_l) at sigma_1 - q; plastic strains are those of these two blocks alone. On the face and
the edges the multipliers of their pairs add up to l, and with Lame's lambda, v = g - d and the
means U and L of the trial stresses of the blocks (theory 5.12)

    U - (lambda v + 2 G g / n_t) l = sigma_1(y)
    L - (lambda v - 2 G d / n_l) l = sigma_1(y) - q(y) .

Without l that is one equation for w, monotone where it changes its sign: Newton's method in a
bracket. Where the cut-off is reached, y is known. A stress between the blocks changes by what these
do to it elastically. Which stresses are in the blocks: the one choice whose stress is admissible
and whose multipliers are not negative; rounding decides between neighbours of the same stress.

*Derivatives* follow from the same equations by implicit differentiation, the constants being dual
numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import sin

import numpy as np

from geoident.fem.yielding.law import ReturnStep, YieldLaw, seen_from
from geoident.fem.yielding.principal_axes import (
    ROUGH,
    Spectrum,
    check_isotropic,
    principal_values,
    rough_principal_values,
    spectrum,
)
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

FACE, EDGE_12, EDGE_23, CUT_1, CUT_2, APEX, FACE_CUT, EDGE_12_CUT, EDGE_23_CUT = range(9)
"""Where a return ends: on the surface alone, on the cut-off alone, on both."""

_UPPER = np.array([1, 2, 1, 1, 2, 3, 1, 2, 1])
"""n_t: how many of the largest principal stresses end at sigma_1, which may be the cut-off."""

_LOWER = np.array([1, 1, 2, 0, 0, 0, 1, 1, 2])
"""n_l: how many of the smallest ones end at sigma_1 - q."""

_ON_SURFACE = 1e-13
"""Of the stresses: what rounding of the principal values makes of the yield functions."""

_REACHED = 1e2 * _ON_SURFACE
"""Of the stresses: within this the surface is reached; a return adds up some ten roundings."""

_BROKEN = 1e-12
"""Of the stresses: what rounding of a return may break of the conditions of the face."""

_NEAR_ROOT = 1e-8
"""Relative change of a root from which on only rounding can keep the next one from being less."""

_LEAST_Y = 1e-300
"""In place of zero at the tip, where the width has no derivative by ln y."""

_LEAST_STRENGTH, _LARGEST_STRENGTH = 1e-9, 1e6
"""Times sigci: between these the strength that a stress needs is looked for."""


@dataclass(frozen=True, eq=False)
class HoekBrownConstants:
    """Numbers of the surface with their derivatives by n parameters; one value each.

    Args:
        sigci: uniaxial compressive strength of intact rock, Pa.
        mb: constant of the rock mass.
        s: constant of the rock mass.
        a: exponent, between 0 and 1.
        dilation: psi, rad; None for associated flow.
        tension: cut-off, Pa, at most at the tip; None for the tip.
    """

    sigci: Dual
    mb: Dual
    s: Dual
    a: Dual
    dilation: Dual | None = None
    tension: Dual | None = None

    @property
    def distances(self) -> Dual:
        """(y,) strengths: sigci, by which stresses scale, and the cut-off if there is one, Pa."""
        parts = [self.sigci] if self.tension is None else [self.sigci, self.tension]
        return Dual(np.stack([part.columns for part in parts]))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the surface, and of its cut-off if there is one."""
        return ("shear",) if self.tension is None else ("shear", "tension")

    def __len__(self) -> int:
        return len(self.names)

    @property
    def cut(self) -> Dual:
        """T, Pa: a tension beyond the tip has no effect."""
        tip = self.s * self.sigci / self.mb
        return tip if self.tension is None or self.tension.value >= tip.value else self.tension

    @property
    def ends_at_tip(self) -> bool:
        """Whether the tip alone limits tension."""
        return self.cut is not self.tension


class HoekBrownLaw(YieldLaw):
    """The criterion in an isotropic elasticity, perfectly plastic.

    Args:
        elasticity: E (s, s), isotropic, of xx, yy, zz, xy (4) or xx, yy, zz, xy, yz, xz (6), Pa.
        constants: of the surface.

    Raises:
        ValueError: E is not isotropic.
    """

    planes: HoekBrownConstants

    def __init__(self, elasticity: Dual, constants: HoekBrownConstants) -> None:
        check_isotropic(elasticity.value)
        self.planes, self._elasticity = constants, elasticity
        self.moduli = elasticity[0, 1], elasticity[0, 0] - elasticity[0, 1]
        """lambda and 2 G with derivatives, Pa."""
        self.lame, self.twice_shear = (float(modulus.value) for modulus in self.moduli)
        self.sigci, self.mb, self.s, self.a, self.cut = (
            float(number.value)
            for number in (constants.sigci, constants.mb, constants.s, constants.a, constants.cut)
        )
        self.associated = constants.dilation is None
        self.sine = 0.0 if constants.dilation is None else sin(float(constants.dilation.value))
        self.y_cut = 0.0 if constants.ends_at_tip else float(self.y_of(np.array(self.cut)))
        self.exponent = min(self.a, 1.0 - self.a)
        """k of the unknown w = y^k."""

    def with_associated_flow(self) -> HoekBrownLaw:
        """The law with plastic strains along the normals."""
        return HoekBrownLaw(self._elasticity, replace(self.planes, dilation=None))

    def project(self, trial: Floats, hardened: Floats | None = None) -> HoekBrownReturn:
        """Return trial stresses (s, m) to the surface; nothing hardens."""
        rough = rough_principal_values(trial)
        margin = ROUGH * np.abs(rough).max(axis=0, initial=0.0)
        raised = rough + np.stack([margin, 0.0 * margin, -margin])
        near = np.flatnonzero(self._beyond(raised) > 0.0)
        spectral = spectrum(trial[:, near])
        scale = np.abs(spectral.values).max(axis=0, initial=0.0)
        outside = np.flatnonzero(self._beyond(spectral.values) > _ON_SURFACE * scale)
        return HoekBrownReturn(self, trial, near[outside], spectral.of(outside))

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """By how much (y, m) strengths are short at stresses (s, m), Pa: positive outside.

        That of the surface is the sigci that the stress would need, less the given one: stresses
        and sigci grow in proportion.
        """
        values = principal_values(stress)
        rows = [self._needed(values) - self.sigci]
        if self.planes.tension is not None:
            rows.append(values[0] - float(self.planes.tension.value))
        return np.stack(rows)

    def _needed(self, values: Floats) -> Floats:
        """The sigci (m,) on whose surface sorted principal stresses (3, m) lie, Pa.

        The root t = sigci' / sigci of  ln t + a ln(s - mb sigma_1 / sigci') = ln(apart / sigci).
        """
        first, apart = values[0] / self.sigci, (values[0] - values[2]) / self.sigci
        scale = np.abs(values).max(axis=0, initial=0.0) / self.sigci
        if self.s == 0.0:  # rounding beyond the tip is no tension
            first = np.where(first <= 1e-10 * (scale + 1.0), np.minimum(first, 0.0), first)
        at_tip = np.maximum(first, 0.0) * self.mb / (self.s or _LEAST_STRENGTH)
        low = np.maximum(at_tip, _LEAST_STRENGTH)
        high = np.maximum(_LARGEST_STRENGTH * (1.0 + scale), 2.0 * at_tip)
        sought = np.log(np.maximum(apart, 1e-100))

        def equation(t: Floats) -> tuple[Floats, Floats]:
            y = np.maximum(self.s - self.mb * first / t, 1e-100)
            slope = 1.0 / t + self.a * self.mb * first / (t * t * y)
            return np.log(t) + self.a * np.log(y) - sought, np.asarray(slope)

        root = bracketed(equation, low, high)
        root = np.where(equation(high)[0] <= 0.0, high, root)
        return np.asarray(self.sigci * np.where(equation(low)[0] >= 0.0, low, root))

    def _beyond(self, values: Floats) -> Floats:
        """(m,) the larger of f_13 and sigma_1 - T of sorted principal stresses (3, m), Pa."""
        apart = values[0] - values[2] - self.width(self.y_of(values[0]))
        return np.asarray(np.maximum(apart, values[0] - self.cut))

    def y_of(self, largest: Floats) -> Floats:
        """Return y >= 0 (...) at largest principal stresses (...), Pa."""
        return np.maximum(self.s - self.mb * largest / self.sigci, 0.0)

    def largest(self, y: Floats) -> Floats:
        """sigma_1 (...) at y (...), Pa."""
        return np.asarray((self.s - y) * (self.sigci / self.mb))

    def width(self, y: Floats) -> Floats:
        """The width q (...) at y (...), Pa."""
        return np.asarray(self.sigci * y**self.a)

    def flow(self, y: Floats) -> tuple[Floats, Floats]:
        """The flow g, d (...) at y (...)."""
        if not self.associated:
            return np.full_like(y, 1.0 + self.sine), np.full_like(y, 1.0 - self.sine)
        z = y ** (1.0 - self.a)
        return z + self.mb * self.a, z

    def plastic_stress(self, fall: Floats) -> Floats:
        """2 G E^-1 times differences of principal stresses (3, ...), Pa."""
        part = self.lame / (3.0 * self.lame + self.twice_shear)
        return np.asarray(fall - part * fall.sum(axis=0))

    def y_of_means(
        self, upper: Floats, lower: Floats, n_upper: int, n_lower: int
    ) -> tuple[Floats, Floats]:
        """Where blocks of two means end on the curve, by the equation for w.

        Args:
            upper: U (k,), Pa.
            lower: L (k,), Pa.
            n_upper: n_t.
            n_lower: n_l.

        Returns:
            y (k,), and what L lacks (k,) where nothing solves the equation, Pa: else 0.
        """
        k, twice = self.exponent, self.twice_shear

        def equation(w: Floats) -> tuple[Floats, Floats]:
            """What is left of L where U is brought to sigma_1(y), Pa, and its slope by w."""
            y = w ** (1.0 / k)
            g, d = self.flow(y)
            volume, fall = self.lame * (g - d), upper - self.largest(y)
            upper_rate = volume + twice * g / n_upper
            ratio = (volume - twice * d / n_lower) / upper_rate
            first_slope = -self.sigci / self.mb * y ** (1.0 - k) / k
            width_slope = self.sigci * self.a * y ** (self.a - k) / k
            slope = (ratio - 1.0) * first_slope + width_slope
            if self.associated:  # the flow turns
                z_slope = (1.0 - self.a) * y ** (1.0 - self.a - k) / k
                slope += (1.0 / n_lower + ratio / n_upper) * twice / upper_rate * z_slope * fall
            return lower - ratio * fall - self.largest(y) + self.width(y), slope

        begin = np.maximum(self.y_of(upper), self.y_cut)
        low = begin**k
        lacking, _ = equation(low)
        exists = lacking < 0.0
        # 1 - ratio is at least 1 / (1 + n_t lambda / 2 G), so the root lies before this
        span = self.mb * np.abs(upper - lower) / self.sigci * (1.0 + n_upper * self.lame / twice)
        high = (begin + span + 1e-12) ** k
        w = np.where(exists, bracketed(equation, low, np.where(exists, high, low)), low)
        return np.where(exists, w ** (1.0 / k), begin), np.where(exists, 0.0, lacking)

    def end_on(self, trial: Floats, place: int) -> tuple[Floats, Floats, Floats]:
        """The return to the face, an edge, or what the cut-off adds to these.

        Args:
            trial: (3, k) sorted principal stresses.
            place: which of them.

        Returns:
            Stress (3, k), y (k,), and by how much (k,) its conditions are broken, Pa.
        """
        n_upper, n_lower = int(_UPPER[place]), int(_LOWER[place])
        upper, lower = slice(0, n_upper), slice(3 - n_lower, 3)
        middle = slice(upper.stop, lower.start)
        y, lacking = np.full(trial.shape[1], self.y_cut), np.zeros(trial.shape[1])
        if place < CUT_1:
            means = trial[upper].mean(axis=0), trial[lower].mean(axis=0)
            y, lacking = self.y_of_means(*means, n_upper, n_lower)
        stress = trial.copy()
        stress[upper] = self.cut if place >= CUT_1 else self.largest(y)
        least = stress[0] - self.width(y)
        stress[lower] = least
        part = self.lame / (self.lame * (n_upper + n_lower) + self.twice_shear)
        stress[middle] -= part * (trial - stress).sum(axis=0)

        strain = self.plastic_stress(trial - stress)
        opens, shears, (g, d) = strain[upper], -strain[lower], self.flow(y)
        between = stress[middle]
        conditions = [lacking[None], -opens, -shears, between - stress[0], least - between]
        if place >= CUT_1:  # what pairs do not open the cut-off does
            conditions.append(((g * shears.sum(axis=0) - d * opens.sum(axis=0)) / (g + d))[None])
        return stress, y, np.maximum(np.concatenate(conditions).max(axis=0), 0.0)


def bracketed(
    equation: Callable[[Floats], tuple[Floats, Floats]], low: Floats, high: Floats
) -> Floats:
    """Roots (k,) between two ends, by Newton's steps and halving where they leave the bracket.

    Args:
        equation: value and slope (k,) at places (k,); negative at ``low``, positive at ``high``.
        low: (k,)
        high: (k,)
    """
    x = 0.5 * (low + high)
    done = np.zeros(x.shape, dtype=np.bool_)
    last = np.full(x.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(200):  # three times what halving alone takes
            value, slope = equation(x)
            low, high = np.where(value <= 0.0, x, low), np.where(value > 0.0, x, high)
            step = x - value / slope
            inside = (step >= low) & (step <= high)
            following = np.where(inside, step, 0.5 * (low + high))
            change = np.abs(following - x)
            # near the root each change is far smaller than the last, until only rounding is left
            rounding = (change <= _NEAR_ROOT * np.abs(x)) & (change >= 0.5 * last)
            done |= (value == 0.0) | (change <= 2e-16 * np.abs(x)) | rounding
            if done.all():
                break
            last = np.where(inside, change, np.inf)
            x = np.where(done, x, following)
    return x


class HoekBrownReturn(ReturnStep):
    """The return of trial stresses to the surface of Hoek and Brown.

    Args:
        law: of the material.
        trial: s* (s, m) of all points.
        yielded: (q,) those outside the surface, ascending.
        spectral: principal values and axes of their trial stress.

    Attributes:
        place: (q,) where each point ends: face, edge, cut-off, tip.
    """

    def __init__(self, law: HoekBrownLaw, trial: Floats, yielded: Ints, spectral: Spectrum) -> None:
        super().__init__(trial, yielded, spectral)
        self._law = law
        start = self.start
        self._end, self._y, broken = law.end_on(start, FACE)
        self.place = np.full(start.shape[1], FACE)
        scale = np.abs(start).max(axis=0, initial=0.0) + law.sigci * 1e-12
        rest = np.flatnonzero(broken > _BROKEN * scale)
        if rest.size:
            ends = [law.end_on(start[:, rest], place) for place in range(len(_UPPER))]
            best = np.argmin([broken for _, _, broken in ends], axis=0)
            at = np.arange(rest.size)
            self.place[rest] = best
            self._end[:, rest] = np.stack([end for end, _, _ in ends])[best, :, at].T
            self._y[rest] = np.stack([y for _, y, _ in ends])[best, at]
        self._natural = np.bool_(law.planes.ends_at_tip)
        if self._natural:  # the surface has no width there
            self.place[(self.place > APEX) | (self._y <= 0.0)] = APEX
        self._end[:, self.place == APEX] = law.cut
        self._plastic = law.plastic_stress(start - self._end) / law.twice_shear
        self._n_upper, self._n_lower = _UPPER[self.place], _LOWER[self.place]
        number = np.arange(3)[:, None]
        self._upper, self._lower = number < self._n_upper, number >= 3 - self._n_lower

    @property
    def end(self) -> Floats:
        """(3, q) principal values of the admissible stress."""
        return self._end

    @cached_property
    def _both_multipliers(self) -> Floats:
        """(q, 2) of the surface (divided by z, where the flow is associated) and of the cut-off.

        At the tip, where many flows make one plastic strain, their sizes count.
        """
        e, (g, d) = self._plastic, self._law.flow(self._y)
        shears = -(e * self._lower).sum(axis=0)
        pairs = shears / np.where(shears == 0.0, 1.0, d)
        cut = np.where(self.place < CUT_1, 0.0, (e * self._upper).sum(axis=0) - g * pairs)
        if self._natural:  # the tip is a part of the surface
            pairs = np.where(self.place == APEX, np.abs(e).sum(axis=0), pairs)
            cut = np.zeros_like(cut)
        return np.stack([pairs, cut], axis=1)

    @property
    def multipliers(self) -> Floats:
        """(q, y)."""
        return np.maximum(self._both_multipliers[:, : len(self._law.planes)], 0.0)

    @property
    def biactive(self) -> Bools:
        """(q, y)."""
        law, first, last = self._law, self._end[0], self._end[2]
        near = _REACHED * (np.abs(self.start).max(axis=0, initial=0.0) + law.sigci * 1e-6)
        on = (first - last - law.width(law.y_of(first)) >= -near) | (self._n_lower > 0)
        reached = np.stack(
            [on | self._natural, (first - law.cut >= -near) & ~self._natural], axis=1
        )
        size = np.abs(self._plastic).max(axis=0, initial=0.0)[:, None]
        working = np.abs(self._both_multipliers) > 1e-11 * size  # a return adds up some roundings
        return np.asarray((reached & ~working)[:, : len(law.planes)])

    @property
    def reserve(self) -> Floats:
        """(q,) 1/2 (s* - sigma)^T E^-1 (s* - sigma), J/m3."""
        return np.asarray(0.5 * ((self.start - self._end) * self._plastic).sum(axis=0))

    @cached_property
    def end_by_start(self) -> Floats:
        """(q, 3, 3)."""
        start = np.broadcast_to(np.eye(3)[:, None], (3, len(self.place), 3))
        slopes, _ = self.end_derivatives(start, None, of_law=False)
        return np.ascontiguousarray(slopes.swapaxes(0, 1))

    def end_derivatives(
        self, start: Floats, hardened: Floats | None, *, of_law: bool
    ) -> tuple[Floats, None]:
        """Derivatives (3, q, n + k) of the end; nothing hardens.

        Where the end is on the curve, a last column by ln y gives its change: what is left of L
        stays zero.
        """
        law, planes = self._law, self._law.planes
        size = start.shape[2]

        def number(constant: Dual) -> Dual:
            return seen_from(constant, 2 + size, of_law=of_law)

        constants = (planes.sigci, planes.mb, planes.s, planes.a, *law.moduli)
        sigci, mb, s, a, lame, twice = (number(constant) for constant in constants)
        trial = Dual(np.concatenate([self.start[..., None], start, 0.0 * start[..., :1]], axis=-1))
        upper, lower = self._upper[..., None], self._lower[..., None]
        on_cut, n_upper, n_lower = self.place >= CUT_1, self._n_upper, self._n_lower

        # on the curve: the equation for y, in which all but ln y keeps its place
        log_y = Dual.constant(np.log(np.maximum(self._y, _LEAST_Y)), 1 + size)
        log_y.columns[:, -1] = 1.0
        d = ((1.0 - a) * log_y).exp()
        g = d + mb * a
        if planes.dilation is not None:
            sine = number(planes.dilation).sine()
            g, d = 1.0 + sine, 1.0 - sine
        n_some = np.maximum(n_lower, 1)  # none on the cut-off alone, where this does not count
        U = Dual((trial.columns * upper).sum(axis=0)) / n_upper
        L = Dual((trial.columns * lower).sum(axis=0)) / n_some
        volume = lame * (g - d)
        ratio = (volume - twice * d / n_some) / (volume + twice * g / n_upper)
        largest, width = sigci / mb * (s - log_y.exp()), sigci * (a * log_y).exp()
        rest = (L - ratio * (U - largest) - largest + width).columns
        slope = np.where(on_cut, np.inf, rest[:, -1])

        log_y.columns[:, 1:-1] = -rest[:, 1:-1] / slope[:, None]
        log_y.columns[:, -1] = 0.0
        if not self._natural:
            y_cut = s - mb * number(planes.cut) / sigci
            log_y.columns[on_cut, 1:] = y_cut.log().columns[1:]
        largest, width = sigci / mb * (s - log_y.exp()), sigci * (a * log_y).exp()
        ends = np.where(upper, largest.columns, (largest - width).columns)
        fall = Dual(((upper | lower) * (trial.columns - ends)).sum(axis=0))
        between = trial - lame / (lame * (n_upper + n_lower) + twice) * fall
        return np.where(upper | lower, ends, between.columns)[..., 1:-1], None
