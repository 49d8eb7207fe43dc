"""Stiffness at small strains, with memory of the last reversals (theory 19).

A string of length l_i drags a point x_i through the space of strains: it is slack within l_i around
x_i, and taut it draws x_i straight after the strain (Simpson 1992, BRICK; Iwan 1967 in strains),

    r_i = strain - x_i ,    |r_i| <= l_i ,    |r|^2 = (1 + nu)^2 r^T E r / E .

The norm is that of the elastic energy; in a drained triaxial test it is the shear strain gamma =
eps_1 - eps_3. Slack strings stiffen the ground. All of its law beneath, elasticity and plasticity,
takes the strain step

    deps + sum_i c_i dr_i ,

so its stiffness is 1 + sum of c_i (of the slack strings) times that of large strains. Lengths and
c_i make the first loading follow Hardin & Drnevich as Santos & Correia (2001) have it,

    secant G = G_0 / (1 + 0.385 gamma / gamma_07) ,    tangent G not below G_ur = E / (2 (1 + nu)) ,

and a reversal the same curve of twice its size (Masing). The step of a string is the closest point
in the norm: it depends on the strain continuously, whatever the strain does.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.fem.elasticity import isotropic
from geoident.model.arrays import Floats
from geoident.model.dual import Dual

STRINGS = 10
"""With them the secant modulus is right to 1 % where G_0 is up to nine times G_ur."""

_GROWTH = 2.5
"""Exponent by which lengths grow from string to string."""

_AT_GAMMA_07 = 0.385
"""At gamma_07 the secant modulus is 1 / 1.385 = 0.722 of G_0 (Santos & Correia)."""


class SmallStrains:
    """The strings of one material at one parameter vector.

    Args:
        constants: E, nu, G0 (at the same stress) and gamma_07; with derivatives by n parameters.
        n_strain: number s of strain components, 4 or 6.
    """

    def __init__(self, constants: Mapping[str, Dual], n_strain: int) -> None:
        E, nu = constants["E"], constants["nu"]
        ratio = constants["G0"] * 2.0 * (1.0 + nu) / E
        parts = (np.arange(STRINGS + 1) / STRINGS) ** _GROWTH
        x = Dual((ratio.root() - 1.0).columns * parts[:, None])  # 0.385 gamma / gamma_07
        shear = x * ratio / (x + 1.0)
        chords = (shear[1:] - shear[:-1]) / (x[1:] - x[:-1]) * (x[1] + 1.0)  # the first: G_0
        one = Dual.constant(np.ones(1), E.n)
        slopes = np.concatenate([chords.columns, one.columns])
        self._stiffens = Dual(slopes[:-1] - slopes[1:])
        self._lengths = x[1:] * constants["gamma_07"] / _AT_GAMMA_07
        full = isotropic({"E": Dual.constant(1.0, E.n), "nu": nu})
        self._metric = (full * ((1.0 + nu) * (1.0 + nu)))[:n_strain, :n_strain]

    def follow(self, history: Floats, strain: Floats, n: int) -> tuple[Floats, Floats]:
        """The strain step that the law beneath takes, and the strings at its end.

        Args:
            history: (s STRINGS, q, 1 + c) vectors r_i, component by component.
            strain: (s, q, 1 + c) the step; the first n of its c derivatives are by the parameters
                of the constants.
            n: none of them, or all.
        """
        s, q, columns = strain.shape
        before = history.reshape(s, STRINGS, q, columns)
        after = before + strain[:, None]
        lengths, stiffens, metric = (
            _widened(of, n, columns) for of in (self._lengths, self._stiffens, self._metric)
        )
        values = after[..., 0]
        squared = np.einsum("siq,st,tiq->iq", values, metric.value, values)
        string, point = np.nonzero(squared > lengths.value[:, None] ** 2)
        r = Dual(after[:, string, point])
        energy = Dual((r * (metric @ r)).columns.sum(axis=0))
        after[:, string, point] = (r * (lengths[string] / energy.root())).columns
        more = stiffens[:, None] * Dual(after - before)
        return strain + more.columns.sum(axis=1), after.reshape(history.shape)


def _widened(number: Dual, n: int, columns: int) -> Dual:
    """With derivatives by the first n parameters only, and zeros for others."""
    kept = number.columns[..., : 1 + n]
    return Dual(np.pad(kept, [(0, 0)] * (kept.ndim - 1) + [(0, columns - kept.shape[-1])]))
