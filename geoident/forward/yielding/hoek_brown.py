"""The criterion of Hoek and Brown as a case states it: at parameters, and in words.

People know the strength of a rock mass as Mohr-Coulomb's c and phi: those of the line that lies
closest to the curve. E. Hoek, C. Carranza-Torres, B. Corkum (2002), Hoek-Brown failure criterion,
2002 edition: between the tensile strength and a confining stress sigma3_max the areas above and
below the line balance. It is shown only; computed is always the curve.

For deep tunnels they give sigma3_max / sigma_cm = 0.47 (sigma_cm / sigma_0)^-0.94, with the largest
in-situ stress sigma_0 and the global strength sigma_cm of the rock mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, degrees, sqrt

import numpy as np

from geoident.fem.yielding.hoek_brown import HoekBrownConstants, bracketed
from geoident.fem.yielding.principal_axes import principal_values
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Values
from geoident.model.yielding import HoekBrown

_TUNNEL = 0.47, -0.94
"""Factor and exponent of sigma3_max around deep tunnels (Hoek, Carranza-Torres & Corkum 2002)."""

_LEAST = 1e-3
"""Of sigci: smaller stresses are none to fit a line to."""


def hoek_brown(surface: HoekBrown, point: ParameterPoint) -> HoekBrownConstants:
    """The constants of the surface with their derivatives.

    Args:
        surface: as the case states it.
        point: the parameters.
    """
    mb, s, a = surface.rock_mass(point.number)
    optional = surface.dilation, surface.tension
    dilation, tension = (None if number is None else point.number(number) for number in optional)
    return HoekBrownConstants(point.number(surface.sigci), mb, s, a, dilation, tension)


def hoek_brown_share(constants: HoekBrownConstants, mean: Floats, deviator: Floats) -> Floats:
    """By what part (k,) deviators reach the surface at the mean stress that they have.

    Args:
        constants: of the surface.
        mean: (k,) mean stresses, Pa.
        deviator: (k, 3) principal deviators, descending, Pa.
    """
    sigci, mb, s, a = (
        float(number.value) for number in (constants.sigci, constants.mb, constants.s, constants.a)
    )
    cut = float(constants.cut.value)
    first, apart = deviator[:, 0], deviator[:, 0] - deviator[:, 2]
    some = (mean < cut) & (apart > 1e-12 * np.abs(mean))
    share = np.where(mean < cut, 0.0, np.inf)
    mean, first, apart = mean[some], first[some], apart[some]
    most = (cut - mean) / np.maximum(first, 1e-300)

    def equation(times: Floats) -> tuple[Floats, Floats]:
        y = np.maximum(s - mb * (mean + times * first) / sigci, 1e-300)
        slope = apart + a * mb * first * y ** (a - 1.0)
        return times * apart - sigci * y**a, slope

    at_most, _ = equation(most)
    root = bracketed(equation, np.zeros_like(most), most)
    share[some] = 1.0 / np.where(at_most <= 0.0, most, root)
    return share


@dataclass(frozen=True)
class RockMassStrength:
    """The constants of a rock mass, plain numbers.

    Args:
        sigci: strength of intact rock, Pa.
        mb: constant of the rock mass.
        s: constant of the rock mass.
        a: exponent.
    """

    sigci: float
    mb: float
    s: float
    a: float

    @classmethod
    def of(cls, surface: HoekBrown, values: Values) -> RockMassStrength:
        """At parameter values (SI)."""
        numbers = surface.rock_mass(lambda scalar: Dual(scalar.columns(values, ())))
        return cls(surface.sigci.value(values), *(float(number.value) for number in numbers))

    @property
    def whole(self) -> float:
        """The global strength sigma_cm, Pa."""
        mb, s, a = self.mb, self.s, self.a
        rise = (mb + 4.0 * s - a * (mb - 8.0 * s)) * (mb / 4.0 + s) ** (a - 1.0)
        return float(self.sigci * rise / (2.0 * (1.0 + a) * (2.0 + a)))

    def around_tunnel(self, stress: float) -> float:
        """The confining stress sigma3_max around a deep tunnel, Pa.

        Args:
            stress: the largest in-situ stress, Pa, compression positive.
        """
        part, power = _TUNNEL
        return float(part * self.whole * (self.whole / stress) ** power)

    def coulomb(self, most: float) -> tuple[float, float]:
        """Cohesion (Pa) and angle of friction (rad) up to a confining stress, Pa.

        Args:
            most: sigma3_max, Pa.
        """
        mb, s, a, part = self.mb, self.s, self.a, most / self.sigci
        slope = 6.0 * a * mb * (s + mb * part) ** (a - 1.0)
        both = (1.0 + a) * (2.0 + a)
        friction = asin(slope / (2.0 * both + slope))
        rise = ((1.0 + 2.0 * a) * s + (1.0 - a) * mb * part) * (s + mb * part) ** (a - 1.0)
        return self.sigci * rise / (both * sqrt(1.0 + slope / both)), friction


def equivalent_notes(material: Material, stress: Floats, values: Values) -> tuple[str, ...]:
    """What the strength of a material amounts to as Mohr-Coulomb's, in the in-situ stress.

    Args:
        material: the material; nothing is said of other surfaces.
        stress: (s, q) in-situ stress where it is, tension positive, Pa.
        values: parameters by name, SI.
    """
    surface = next((one for one in material.yields if isinstance(one, HoekBrown)), None)
    if surface is None or not stress.size:
        return ()
    mass = RockMassStrength.of(surface, values)
    name = f"'{material.name}' has mb {mass.mb:.3g}, s {mass.s:.3g} and a {mass.a:.3g}"
    principal = principal_values(stress)  # tension positive, descending
    major, minor = -float(principal[2].min()), -float(principal[0].min())
    if not major > _LEAST * mass.sigci:
        return (f"{name} at the start values; there is no in-situ stress to fit c and phi to",)
    deep = mass.around_tunnel(major)
    text = f"{name} at the start values; as Mohr-Coulomb that is {_line(mass, deep)} around a deep "
    text += f"tunnel in the largest in-situ stress of {_mega(major)}"
    if minor > _LEAST * mass.sigci:
        text += f", {_line(mass, minor)} that there is in situ"
    return (text + " (Hoek et al. 2002); what is computed is the curve itself",)


def _line(mass: RockMassStrength, most: float) -> str:
    cohesion, friction = mass.coulomb(most)
    return f"c {_mega(cohesion)} and phi {degrees(friction):.3g} deg up to sigma3 = {_mega(most)}"


def _mega(stress: float) -> str:
    return f"{stress / 1e6:.3g} MPa" if stress >= 1e5 else f"{stress / 1e3:.3g} kPa"
