"""How far the strength of a lining of rectangular section is used by N and M together.

The section is ideally plastic: a block of compressive strength f_c on one side of the neutral axis,
one of tensile strength f_t on the other (plain sprayed concrete: f_t = 0; steel: f_t = f_c). With
the depth c in compression and the thickness h, per metre and tension positive,

    N = f_t (h - c) - f_c c ,      M = (f_c + f_t) c (h - c) / 2 .

Without c this is the limit 2 (f_c + f_t) |M| = (f_t h - N)(f_c h + N). Where N and M grow together
by the factor t until they reach it, u = 1/t is the utilisation (theory 2.5).
"""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats


def utilisation(
    axial: Floats, moment: Floats, *, thickness: float, compressive: float, tensile: float = 0.0
) -> Floats:
    """The part of what a rectangular section can bear that N and M use, 1 at the limit.

    A plain section in compression has N / (f_c h (1 - 2 e / h)) with the eccentricity e = |M / N|,
    as EN 1992-1-1, 12.6.1 has it.

    Args:
        axial: N (...), N per metre, tension positive.
        moment: M (...), N m per metre.
        thickness: h, m.
        compressive: f_c, Pa, positive.
        tensile: f_t, Pa, at least 0.

    Returns:
        (...); infinite where a section without tensile strength meets no compression, or one
        outside of it. NaN where N or M is.

    >>> utilisation(np.array([-1e6]), np.array([5e4]), thickness=0.3, compressive=10e6)
    array([0.5])
    """
    total, h = compressive + tensile, thickness
    a = compressive * tensile * h**2
    b = 2.0 * total * np.abs(moment) + axial * h * (compressive - tensile)
    root = np.sqrt(b**2 + 4.0 * a * axial**2)
    with np.errstate(divide="ignore", invalid="ignore"):  # the branch that does not cancel
        outside = (b + root) / (2.0 * a) if a > 0.0 else np.where(np.isnan(b), np.nan, np.inf)
        u = np.where(b < 0.0, 2.0 * axial**2 / (root - b), outside)
    return np.where((axial == 0.0) & (moment == 0.0), 0.0, u)
