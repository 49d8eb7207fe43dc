"""Rock masses by their Geological Strength Index: what Hoek and his colleagues derive from it.

Strength: E. Hoek, C. Carranza-Torres, B. Corkum (2002), Hoek-Brown failure criterion, 2002
edition, Proc. NARMS-TAC, Toronto:

    mb = mi exp((GSI - 100) / (28 - 14 D)),   s = exp((GSI - 100) / (9 - 3 D)),
    a  = 1/2 + (exp(-GSI / 15) - exp(-20 / 3)) / 6 .

Stiffness: E. Hoek, M. S. Diederichs (2006), Empirical estimation of rock mass modulus, Int. J. Rock
Mech. Min. Sci. 43: from the modulus Ei of intact rock, which may be its modulus ratio MR times its
strength sigci,

    E = Ei (0.02 + (1 - D/2) / (1 + exp((60 + 15 D - GSI) / 11))) ,

and where nothing is known of the intact rock, the simplified form

    E = 100 GPa (1 - D/2) / (1 + exp((75 + 25 D - GSI) / 11)) .
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, nan

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.dual import Dual
from geoident.model.parameter import Scalar, Values, scalars_of

LARGEST_GSI = 100.0
"""Of intact rock."""

_SIMPLIFIED = 100e9
"""Pa."""


def strength_constants(mi: Dual, GSI: Dual, D: Dual) -> tuple[Dual, Dual, Dual]:
    """mb, s and a of a rock mass.

    Args:
        mi: constant of intact rock.
        GSI: Geological Strength Index, 0 to 100.
        D: disturbance by blasting and relaxation, 0 to 1.
    """
    below = GSI - LARGEST_GSI
    mb = mi * (below / (28.0 - 14.0 * D)).exp()
    s = (below / (9.0 - 3.0 * D)).exp()
    a = 0.5 + ((GSI * (-1.0 / 15.0)).exp() - exp(-20.0 / 3.0)) / 6.0
    return mb, s, a


def rock_mass_modulus(Ei: Dual | None, GSI: Dual, D: Dual) -> Dual:
    """E of a rock mass, Pa.

    Args:
        Ei: Young's modulus of intact rock, Pa; None for the simplified form.
        GSI: Geological Strength Index, 0 to 100.
        D: disturbance, 0 to 1.
    """
    whole = 1.0 - 0.5 * D
    if Ei is None:
        return _SIMPLIFIED * whole / (1.0 + ((75.0 + 25.0 * D - GSI) / 11.0).exp())
    return Ei * (0.02 + whole / (1.0 + ((60.0 + 15.0 * D - GSI) / 11.0).exp()))


@dataclass(frozen=True)
class RockMassModulus(Scalar):
    """E of a rock mass by Hoek and Diederichs, a number that follows from others.

    Args:
        factor: none.
        parameter: none; see ``parameters``.
        GSI: Geological Strength Index.
        D: disturbance.
        Ei: modulus of intact rock; None for MR times sigci, or for the simplified form.
        MR: modulus ratio.
        sigci: uniaxial compressive strength of intact rock.

    >>> round(RockMassModulus(GSI=Scalar(45.0), Ei=Scalar(20e9)).value({}) / 1e9, 3)
    4.473
    """

    factor: float = nan
    parameter: str | None = None
    GSI: Scalar = Scalar(LARGEST_GSI)
    D: Scalar = Scalar(0.0)
    Ei: Scalar | None = None
    MR: Scalar | None = None
    sigci: Scalar | None = None

    @property
    def parts(self) -> dict[str, Scalar]:
        """The numbers from which it follows, by name."""
        return scalars_of(self)

    @property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that it depends on."""
        return frozenset().union(*(part.parameters for part in self.parts.values()))

    def value(self, values: Values) -> float:
        """E at the given parameter values, Pa."""
        return float(self.columns(values, ())[0])

    def columns(self, values: Values, names: Sequence[str]) -> Floats:
        """E and its derivatives by n parameters, (1 + n,)."""
        made = {name: Dual(part.columns(values, names)) for name, part in self.parts.items()}
        intact = made.get("Ei")
        if intact is None and "MR" in made:
            intact = made["MR"] * made["sigci"]
        modulus = rock_mass_modulus(intact, made["GSI"], made["D"])
        return np.asarray(modulus.columns)
