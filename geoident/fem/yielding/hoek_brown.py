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
from dataclasses import dataclass
from functools import cached_property
from math import sin

import numpy as np

from geoident.fem.yielding.law import ReturnStep, YieldLaw
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

    def __init__(self, elasticity: Dual, constants: HoekBrownConstants) -> None:
        check_isotropic(elasticity.value)
        self.planes = constants
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

    def slopes(self, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives (q,) of sigma_1, of q and of z by w; of z only where the flow turns."""
        k = self.exponent
        largest = -self.sigci / self.mb * y ** (1.0 - k) / k
        width = self.sigci * self.a * y ** (self.a - k) / k
        z = (1.0 - self.a) * y ** (1.0 - self.a - k) / k if self.associated else np.zeros_like(y)
        return largest, width, z

    def middle_part(self, n_blocks: Ints) -> Floats:
        """By what part (...) of all falls of stresses in the blocks one between them falls."""
        return np.asarray(self.lame / (self.lame * n_blocks + self.twice_shear))

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
        k = self.exponent

        def equation(w: Floats) -> tuple[Floats, Floats]:
            y = w ** (1.0 / k)
            return self.unbalanced(y, upper, lower, n_upper, n_lower)[:2]

        begin = np.maximum(self.y_of(upper), self.y_cut)
        low = begin**k
        lacking, _ = equation(low)
        exists = lacking < 0.0
        span = self.mb * np.abs(upper - lower) / self.sigci + 1e-12
        high = (begin + span) ** k
        for _ in range(200):
            short = exists & (equation(high)[0] < 0.0)
            if not short.any():
                break
            span = np.where(short, 4.0 * span, span)
            high = np.where(short, (begin + span) ** k, high)
        w = np.where(exists, bracketed(equation, low, np.where(exists, high, low)), low)
        return np.where(exists, w ** (1.0 / k), begin), np.where(exists, 0.0, lacking)

    def unbalanced(
        self, y: Floats, upper: Floats, lower: Floats, n_upper: int | Ints, n_lower: int | Ints
    ) -> tuple[Floats, Floats, Floats]:
        """What is left of L (k,) where U is brought to sigma_1(y), Pa; its slopes by w and -U."""
        g, d = self.flow(y)
        first_slope, width_slope, z_slope = self.slopes(y)
        volume, fall = self.lame * (g - d), upper - self.largest(y)
        upper_rate = volume + self.twice_shear * g / n_upper
        ratio = (volume - self.twice_shear * d / n_lower) / upper_rate
        turned = -(1.0 / n_lower + ratio / n_upper) * self.twice_shear / upper_rate * z_slope
        rest = lower - ratio * fall - self.largest(y) + self.width(y)
        return rest, (ratio - 1.0) * first_slope + width_slope - turned * fall, ratio


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


def _end_on(law: HoekBrownLaw, trial: Floats, place: int) -> tuple[Floats, Floats, Floats]:
    """The return to the face, an edge, or what the cut-off adds to these.

    Args:
        law: the surface.
        trial: (3, k) sorted principal stresses.
        place: which of them.

    Returns:
        Stress (3, k), y (k,), and by how much (k,) its conditions are broken, Pa.
    """
    n_upper, n_lower = int(_UPPER[place]), int(_LOWER[place])
    upper, lower = slice(0, n_upper), slice(3 - n_lower, 3)
    middle = slice(upper.stop, lower.start)
    y, lacking = np.full(trial.shape[1], law.y_cut), np.zeros(trial.shape[1])
    if place < CUT_1:
        means = trial[upper].mean(axis=0), trial[lower].mean(axis=0)
        y, lacking = law.y_of_means(*means, n_upper, n_lower)
    stress = trial.copy()
    stress[upper] = law.cut if place >= CUT_1 else law.largest(y)
    stress[lower] = stress[0] - law.width(y)
    stress[middle] -= law.middle_part(_UPPER[place] + _LOWER[place]) * (trial - stress).sum(axis=0)

    strain = law.plastic_stress(trial - stress)
    opens, shears, (g, d) = strain[upper], -strain[lower], law.flow(y)
    least = stress[0] - law.width(y)
    conditions = [
        lacking[None],
        -opens,
        -shears,
        stress[middle] - stress[0],
        least - stress[middle],
    ]
    if place >= CUT_1:  # what pairs do not open the cut-off does
        conditions.append(((g * shears.sum(axis=0) - d * opens.sum(axis=0)) / (g + d))[None])
    return stress, y, np.maximum(np.concatenate(conditions).max(axis=0), 0.0)


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
        self._end, self._y, broken = _end_on(law, start, FACE)
        self.place = np.full(start.shape[1], FACE)
        scale = np.abs(start).max(axis=0, initial=0.0) + law.sigci * 1e-12
        rest = np.flatnonzero(broken > _BROKEN * scale)
        if rest.size:
            ends = [_end_on(law, start[:, rest], place) for place in range(len(_UPPER))]
            best = np.argmin([broken for _, _, broken in ends], axis=0)
            at = np.arange(rest.size)
            self.place[rest] = best
            self._end[:, rest] = np.stack([end for end, _, _ in ends])[best, :, at].T
            self._y[rest] = np.stack([y for _, y, _ in ends])[best, at]
        self._natural = law.planes.ends_at_tip
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

    @cached_property
    def biactive(self) -> Bools:
        """(q, y)."""
        law, stress = self._law, self._end
        near = _REACHED * (np.abs(self.start).max(axis=0, initial=0.0) + law.sigci * 1e-6)
        on = stress[0] - stress[2] - law.width(law.y_of(stress[0])) >= -near
        cut = stress[0] - law.cut >= -near
        if self._natural:
            on, cut = np.ones_like(on), np.zeros_like(cut)
        reached = np.stack([on | (self._n_lower > 0), cut], axis=1)
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
        """Derivatives (3, q, n + k) of the end; nothing hardens."""
        law, given, y = self._law, self._law.planes, self._y
        n = given.sigci.n if of_law else 0
        first, width = np.zeros(start.shape[1:]), np.zeros(start.shape[1:])
        on_cut, on_curve = (np.flatnonzero(self.place >= CUT_1), np.flatnonzero(self.place < CUT_1))
        if n:
            cut = given.cut
            first[on_cut, :n] = cut.columns[1:]
            if not self._natural:
                log = (given.s - given.mb * cut / given.sigci).log()
                width[on_cut, :n] = (given.sigci * (given.a * log).exp()).columns[1:]

        # on the curve: what constants change at fixed y; then w, by the equation for it
        at = on_curve
        n_upper, n_lower = self._n_upper[at], self._n_lower[at]
        U = (self.start * self._upper).sum(axis=0)[at] / n_upper
        L = (self.start * self._lower).sum(axis=0)[at] / n_lower
        _, slope, ratio = law.unbalanced(y[at], U, L, n_upper, n_lower)
        unbalanced = (start * self._lower[..., None]).sum(axis=0)[at] / n_lower[:, None]
        unbalanced -= (ratio / n_upper)[:, None] * (start * self._upper[..., None]).sum(axis=0)[at]
        if n:
            direct = self._direct(at, U)
            first[at, :n], width[at, :n], unbalanced_by_law = (
                part.columns[:, 1:] for part in direct
            )
            unbalanced[:, :n] += unbalanced_by_law
        w = -unbalanced / slope[:, None]
        first_slope, width_slope, _ = law.slopes(y[at])
        first[at] += first_slope[:, None] * w
        width[at] += width_slope[:, None] * w

        upper, lower = self._upper[..., None], self._lower[..., None]
        ends = np.where(upper, first, np.where(lower, first - width, 0.0))
        blocks = self._n_upper + self._n_lower
        falls = law.middle_part(blocks)[:, None] * ((upper | lower) * (start - ends)).sum(axis=0)
        if n:
            lame, twice = law.moduli
            part = lame / (lame * blocks + twice)
            fall = ((self._upper | self._lower) * (self.start - self._end)).sum(axis=0)
            falls[:, :n] += part.columns[:, 1:] * fall[:, None]
        return np.where(upper | lower, ends, start - falls), None

    def _direct(self, at: Ints, upper: Floats) -> tuple[Dual, Dual, Dual]:
        """sigma_1, q and what is left of L, each (k,), with what constants change at fixed y.

        Args:
            at: (k,) points on the curve.
            upper: U (k,), Pa.
        """
        given, (lame, twice), log = self._law.planes, self._law.moduli, np.log(self._y[at])
        largest = given.sigci / given.mb * (given.s - self._y[at])
        width = given.sigci * (given.a * log).exp()
        if given.dilation is None:
            d = ((1.0 - given.a) * log).exp()
            g = d + given.mb * given.a
        else:
            sine = given.dilation.sine()
            g, d = 1.0 + sine, 1.0 - sine
        volume = lame * (g - d)
        ratio = volume - twice * d * (1.0 / self._n_lower[at])
        ratio = ratio / (volume + twice * g * (1.0 / self._n_upper[at]))
        return largest, width, width - largest - ratio * (upper - largest)
