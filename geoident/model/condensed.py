"""What a forward model hands to condensation."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.arrays import Floats


@dataclass(frozen=True)
class Condensed:
    """The condensed equations of an affine elastic model at one parameter vector (theory 4.1).

    With the displacements corrected so that they meet the measured readings, the equation error of
    the parameters q, carried to the gauges by the frozen model, is ``matrix @ q - vector``.
    At q = p it equals measured - v(p) as far as the readings are independent.

    Args:
        readings: (g,) v(p).
        flexibility: (g, g) S = G K^-1 G^T; its inverse turns an error in readings to one in forces.
        matrix: (g, n).
        vector: (g,).
    """

    readings: Floats
    flexibility: Floats
    matrix: Floats
    vector: Floats
