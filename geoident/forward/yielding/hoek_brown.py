"""The criterion of Hoek and Brown as a case states it, at parameters; as Mohr-Coulomb's."""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.hoek_brown import HoekBrownConstants, bracketed
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.yielding import HoekBrown


def hoek_brown(surface: HoekBrown, point: ParameterPoint) -> HoekBrownConstants:
    """The constants of the surface with their derivatives.

    Args:
        surface: as the case states it.
        point: the parameters.
    """
    mb, s, a = surface.rock_mass(point.number)
    given = surface.dilation, surface.tension
    dilation, tension = (None if number is None else point.number(number) for number in given)
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
    found = bracketed(equation, np.zeros_like(most), most)
    share[some] = 1.0 / np.where(at_most <= 0.0, most, found)
    return share
