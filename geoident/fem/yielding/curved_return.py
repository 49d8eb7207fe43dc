"""Return mapping to the surface of Hoek and Brown, in sorted principal stresses (theory 5.12).

With sigma_1 >= sigma_2 >= sigma_3 (tension positive) the surface is, for every pair i before j,

    f_ij = sigma_i - sigma_j - q(sigma_i) <= 0 ,    q = sigci y^a ,    y = s - mb sigma_i / sigci

and no principal stress exceeds the cut-off T, at most the tip s sigci / mb. The pairs 13, 23 and 12
are its face and its edges sigma_1 = sigma_2 and sigma_2 = sigma_3. At the tip q falls with an
infinite slope. So yield functions are multiplied by z = y^(1-a), which makes their gradients

    n = (z + mb a, -z)   on i and j ,

finite and continuous up to the tip, where they are those of the cut-off; and the unknown of the
return is w = y^min(a, 1-a), by which q and z have finite slopes. On the face and on each edge the
return is one equation for w, monotone where it changes its sign: Newton's method in a bracket.
Where the cut-off is reached too, all equations are linear.

The flow is along n (associated) or along (1 + sin psi, -(1 - sin psi)); that of the cut-off along
its normal. Which planes are active: the one set whose stress is admissible and whose multipliers
are not negative; rounding decides between neighbours whose stresses are the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sin

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

FACE, EDGE_12, EDGE_23, CUT_1, CUT_2, APEX, FACE_CUT, EDGE_12_CUT, EDGE_23_CUT = range(9)
"""Sets of active planes: of the surface, of the cut-off, and of both."""

SHEAR: tuple[tuple[tuple[int, int], ...], ...] = (
    ((0, 2),), ((0, 2), (1, 2)), ((0, 2), (0, 1)), (), (), (),
    ((0, 2),), ((0, 2),), ((0, 2), (0, 1)),
)  # fmt: skip
"""Pairs ij of each set."""

CUTS = (0, 0, 0, 1, 2, 3, 1, 2, 1)
"""How many principal stresses are at the cut-off, the largest first."""

_WHOLE, _HALF = 1.0, 0.5
_NEAR_ROOT = 1e-8
"""Relative change of a root from which on only rounding can keep the next one from being less."""

_VALID = 1e-12
"""Of the stresses: what rounding may break of the conditions of the face."""


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
    def natural(self) -> bool:
        """Whether the tip alone limits tension."""
        return self.tension is None or self.cut is not self.tension


class HoekBrownCurve:
    """The surface at one parameter vector in one isotropic elasticity.

    Args:
        constants: of the surface.
        lame: Lame's constant, Pa.
        shear: G, Pa.
    """

    def __init__(self, constants: HoekBrownConstants, lame: float, shear: float) -> None:
        self.sigci, self.mb = float(constants.sigci.value), float(constants.mb.value)
        self.s, self.a = float(constants.s.value), float(constants.a.value)
        self.cut, self.natural = float(constants.cut.value), constants.natural
        self.y_cut = 0.0 if self.natural else max(self.s - self.mb * self.cut / self.sigci, 0.0)
        self.lame, self.shear = lame, shear
        self.c = self.mb * self.a
        self._root = min(self.a, 1.0 - self.a)
        self.flow: tuple[float, float] | None = None
        if constants.dilation is not None:
            sine = sin(float(constants.dilation.value))
            self.flow = 1.0 + sine, 1.0 - sine

    def strain(self, stress: Floats) -> Floats:
        """E^-1 times principal stresses (3, ...), Pa: strains (3, ...)."""
        part = self.lame / (3.0 * self.lame + 2.0 * self.shear)
        return np.asarray((stress - part * stress.sum(axis=0)) / (2.0 * self.shear))

    def y_of(self, largest: Floats) -> Floats:
        """The y >= 0 (...) of largest principal stresses (...), Pa."""
        return np.maximum(self.s - self.mb * largest / self.sigci, 0.0)

    def width(self, y: Floats) -> Floats:
        """The width q (...) of y (...), Pa."""
        return np.asarray(self.sigci * y**self.a)

    def largest(self, y: Floats) -> Floats:
        """The sigma_1 (...) of y (...), Pa."""
        return np.asarray((self.s - y) * (self.sigci / self.mb))

    def excess(self, values: Floats) -> Floats:
        """(m,) the larger of f_13 and sigma_1 - T of sorted principal stresses (3, m), Pa."""
        beyond = values[0] - self.cut
        width = self.width(self.y_of(values[0]))
        return np.asarray(np.maximum(values[0] - values[2] - width, beyond))

    def directions(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """The flow on i, against j, and the change of volume of both, (...) of z (...)."""
        if self.flow is not None:
            grows, shrinks = (np.full_like(z, part) for part in self.flow)
            return grows, shrinks, grows - shrinks
        return z + self.c, z, np.full_like(z, self.c)

    def on_curve(self, upper: Floats, lower: Floats, alpha: Floats, beta: Floats) -> _OnCurve:
        """The return to the face or an edge.

        Args:
            upper: (k,) sigma_1 of the trial stress, or its mean with sigma_2 on that edge.
            lower: (k,) sigma_3, or its mean with sigma_2.
            alpha: (k,) 1, or 1/2 where ``upper`` is a mean.
            beta: (k,) the same of ``lower``.
        """
        k = self._root

        def equation(w: Floats) -> tuple[Floats, Floats]:
            """What is left of sigma_3 if sigma_1 is that of w, and its slope."""
            y = w ** (1.0 / k)
            z = y ** (1.0 - self.a)
            rises = y ** (1.0 - k) / k  # dy/dw
            first, width = self.largest(y), self.width(y)
            grows, shrinks, volume = self.directions(z)
            first_rate = self.lame * volume + 2.0 * self.shear * alpha * grows
            third_rate = self.lame * volume - 2.0 * self.shear * beta * shrinks
            ratio = third_rate / first_rate
            rest = lower - ratio * (upper - first) - first + width
            slope = (ratio - 1.0) * (-self.sigci / self.mb) * rises
            slope += self.sigci * self.a * y ** (self.a - k) / k
            if self.flow is None:
                turned = -(beta + ratio * alpha) * 2.0 * self.shear / first_rate
                slope -= turned * (upper - first) * (1.0 - self.a) * y ** (1.0 - self.a - k) / k
            return rest, slope

        begin = np.maximum(self.y_of(upper), self.y_cut)
        low = begin**k
        missing, _ = equation(low)
        exists = missing < 0.0
        span = self.mb * np.abs(upper - lower) / self.sigci + 1e-12
        high = (begin + span) ** k
        for _ in range(200):
            short = exists & (equation(high)[0] < 0.0)
            if not short.any():
                break
            span = np.where(short, 4.0 * span, span)
            high = np.where(short, (begin + span) ** k, high)
        w = np.where(exists, bracketed(equation, low, np.where(exists, high, low)), low)
        y = np.where(exists, w ** (1.0 / k), begin)
        grows, _, volume = self.directions(y ** (1.0 - self.a))
        rate = self.lame * volume + 2.0 * self.shear * alpha * grows
        return _OnCurve(y, (upper - self.largest(y)) / rate, np.where(exists, 0.0, missing))


@dataclass(frozen=True)
class _OnCurve:
    """A return to the face or an edge.

    Args:
        y: (k,) where on the curve.
        multiplier: (k,) of the scaled plane, or the sum of two.
        missing: (k,) zero where there is a return; else how far from one, Pa.
    """

    y: Floats
    multiplier: Floats
    missing: Floats


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
        for _ in range(200):
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


@dataclass(frozen=True, eq=False)
class Returned:
    """Where trial stresses end.

    Args:
        stress: (3, q) sorted principal stresses.
        plastic: (3, q) plastic strains of the step.
        active: (q,) the set of active planes.
        y: (q,) where on the curve; that of the cut-off where it is active.
        multipliers: (q, 3) of the scaled planes of the set: pairs first.
    """

    stress: Floats
    plastic: Floats
    active: Ints
    y: Floats
    multipliers: Floats


def returned(curve: HoekBrownCurve, trial: Floats) -> Returned:
    """Return sorted principal stresses (3, q) outside the surface.

    Args:
        curve: the surface.
        trial: (3, q), Pa.
    """
    scale = np.abs(trial).max(axis=0) + curve.sigci * 1e-12
    whole = np.full(trial.shape[1], _WHOLE)
    face = curve.on_curve(trial[0], trial[2], whole, whole)
    stress = _on_face(curve, trial, face)
    broken = _face_broken(stress, face)
    active = np.full(trial.shape[1], FACE)
    y = face.y.copy()
    rest = np.flatnonzero(broken > _VALID * scale)
    if rest.size:
        sets = [(FACE, stress[:, rest], face.y[rest], broken[rest])]
        sets += _edges(curve, trial[:, rest]) + _corners(curve, trial[:, rest])
        best = np.argmin(np.stack([one[3] for one in sets]), axis=0)
        at = np.arange(rest.size)
        active[rest] = np.array([one[0] for one in sets])[best]
        stress[:, rest] = np.stack([one[1] for one in sets])[best, :, at].T
        y[rest] = np.stack([one[2] for one in sets])[best, at]
    if curve.natural:
        active[(active > APEX) | (y <= 0.0)] = APEX  # the surface has no width there
    stress[:, active == APEX] = curve.cut
    plastic = curve.strain(trial - stress)
    return Returned(stress, plastic, active, y, _multipliers(curve, plastic, active, y))


def _on_face(curve: HoekBrownCurve, trial: Floats, face: _OnCurve) -> Floats:
    volume = curve.directions(face.y ** (1.0 - curve.a))[2]
    first = curve.largest(face.y)
    middle = trial[1] - curve.lame * volume * face.multiplier
    return np.stack([first, middle, first - curve.width(face.y)])


def _face_broken(stress: Floats, face: _OnCurve) -> Floats:
    """By how much (q,) the order of the stresses is broken, or no return found, Pa."""
    order = np.maximum(stress[1] - stress[0], stress[2] - stress[1])
    return np.asarray(np.maximum(np.maximum(order, face.missing), 0.0))


_Set = tuple[int, Floats, Floats, Floats]
"""Its name, stresses (3, k), y (k,), and by how much (k,) its conditions are broken, Pa."""


def _edges(curve: HoekBrownCurve, trial: Floats) -> list[_Set]:
    """Returns to the edges of sorted trial stresses (3, k)."""
    whole, half = (np.full(trial.shape[1], part) for part in (_WHOLE, _HALF))
    twice = 2.0 * curve.shear
    found: list[_Set] = []
    upper = curve.on_curve(0.5 * (trial[0] + trial[1]), trial[2], half, whole)
    first = curve.largest(upper.y)
    grows = curve.directions(upper.y ** (1.0 - curve.a))[0]
    smaller = 0.5 * (upper.multiplier * grows * twice - (trial[0] - trial[1]))
    broken = np.maximum(np.maximum(-smaller, upper.missing), 0.0)
    stress = np.stack([first, first, first - curve.width(upper.y)])
    found.append((EDGE_12, stress, upper.y, broken))
    lower = curve.on_curve(trial[0], 0.5 * (trial[1] + trial[2]), whole, half)
    first = curve.largest(lower.y)
    shrinks = curve.directions(lower.y ** (1.0 - curve.a))[1]
    smaller = 0.5 * (lower.multiplier * shrinks * twice - (trial[1] - trial[2]))
    broken = np.maximum(np.maximum(-smaller, lower.missing), 0.0)
    third = first - curve.width(lower.y)
    found.append((EDGE_23, np.stack([first, third, third]), lower.y, broken))
    return found


def _corners(curve: HoekBrownCurve, trial: Floats) -> list[_Set]:
    """Returns to the cut-off and where it meets the surface, of sorted trial stresses (3, k)."""
    lame, twice = curve.lame, 2.0 * curve.shear
    top = np.full(trial.shape[1], curve.cut)
    low = top - float(curve.width(np.array(curve.y_cut)))
    y = np.full(trial.shape[1], curve.y_cut)
    grows, shrinks, _ = curve.directions(y ** (1.0 - curve.a))
    grows, shrinks = grows / (grows + shrinks), shrinks / (grows + shrinks)

    def needed(stress: Floats, pairs: int) -> Floats:
        """By how much multipliers are negative: of pairs with sigma_3, and with sigma_2."""
        strain = twice * curve.strain(trial - stress)
        opens = strain[:2].sum(axis=0) if pairs == 1 else strain[0]
        shears = -strain[2] if pairs == 1 else -strain[1:].sum(axis=0)
        signs = [-shears, strain[1]] if pairs == 2 else [-shears, -strain[1]]
        signs += [strain[2], grows * shears - shrinks * opens]
        return _largest(signs)

    opening = np.maximum(trial[0] - top, 0.0) / (lame + twice)
    one = np.stack([top, trial[1] - lame * opening, trial[2] - lame * opening])
    outside = [top - trial[0], one[1] - top, low - one[2]]
    sets: list[_Set] = [(CUT_1, one, y, _largest(outside))]
    opening = (trial[0] + trial[1] - 2.0 * top) / (2.0 * lame + twice)
    two = np.stack([top, top, trial[2] - lame * opening])
    least = 0.5 * (twice * opening - (trial[0] - trial[1]))
    sets.append((CUT_2, two, y, _largest([-least, two[2] - top, low - two[2]])))
    three = np.stack([top, top, top])
    sets.append((APEX, three, y, _largest([-twice * curve.strain(trial - three)[2]])))
    total = lame + twice
    e1 = (total * (trial[0] - top) - lame * (trial[2] - low)) / (total**2 - lame**2)
    e3 = (total * (trial[2] - low) - lame * (trial[0] - top)) / (total**2 - lame**2)
    middle = trial[1] - lame * (e1 + e3)
    signs = [twice * e3, twice * (-grows * e3 - shrinks * e1), middle - top, low - middle]
    sets.append((FACE_CUT, np.stack([top, middle, low]), y, _largest(signs)))
    upper, lower = np.stack([top, top, low]), np.stack([top, low, low])
    sets.append((EDGE_12_CUT, upper, y, needed(upper, 1)))
    sets.append((EDGE_23_CUT, lower, y, needed(lower, 2)))
    return sets


def _largest(signs: list[Floats]) -> Floats:
    return np.asarray(np.maximum(np.stack(signs).max(axis=0), 0.0))


def _multipliers(curve: HoekBrownCurve, plastic: Floats, active: Ints, y: Floats) -> Floats:
    """(q, 3) of the scaled planes of each set, from plastic strains (3, q): pairs first."""
    grows, shrinks, _ = curve.directions(y ** (1.0 - curve.a))
    found = np.zeros((plastic.shape[1], 3))
    for number in np.unique(active):
        at: Bools = active == number
        if number == APEX:
            found[at] = plastic[:, at].T
            continue
        e, up, down = plastic[:, at], grows[at], shrinks[at]
        if number in (CUT_1, CUT_2):
            found[at, : CUTS[number]] = e[: CUTS[number]].T
        elif number in (FACE, FACE_CUT):
            found[at, 0] = -e[2] / down
            found[at, 1] = e[0] - up * found[at, 0]
        elif number == EDGE_12:
            found[at, 0], found[at, 1] = e[0] / up, e[1] / up
        elif number in (EDGE_23, EDGE_23_CUT):
            found[at, 0], found[at, 1] = -e[2] / down, -e[1] / down
            found[at, 2] = e[0] - up * (found[at, 0] + found[at, 1])
        else:
            found[at, 0] = -e[2] / down
            found[at, 1], found[at, 2] = e[0] - up * found[at, 0], e[1]
        if number < CUT_1:
            found[at, len(SHEAR[number]) :] = 0.0
    return found
