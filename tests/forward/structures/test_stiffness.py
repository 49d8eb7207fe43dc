"""Stiffness of structures from their sizes."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.forward.structures.members import rigidities
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Bolts

STEEL, ENDS_OF_ONE = Scalar(200e9), (((0.0, 0.0), (0.0, 3.0)),)


@pytest.mark.parametrize(
    ("structure", "EA", "EI"),
    [
        (Beam("wall", E=Scalar(30e9), thickness=Scalar(0.3)), 30e9 * 0.3, 30e9 * 0.3**3 / 12.0),
        (
            Beam("wall", E=Scalar(30e9), thickness=Scalar(0.3), nu=Scalar(0.2)),
            30e9 * 0.3 / 0.96,
            30e9 * 0.3**3 / 12.0 / 0.96,
        ),
        (Beam("wall", EA=Scalar(4e9), EI=Scalar(3e7)), 4e9, 3e7),
        (
            Bolts(ENDS_OF_ONE, Scalar(1.5), E=STEEL, diameter=Scalar(0.03)),
            200e9 * np.pi * 0.015**2 / 1.5,
            0.0,
        ),
        (Bolts(ENDS_OF_ONE, Scalar(1.5), E=STEEL, area=Scalar(7e-4)), 200e9 * 7e-4 / 1.5, 0.0),
        (Bolts(ENDS_OF_ONE, None, EA=Scalar(1.4e8)), 1.4e8, 0.0),
        (Bolts(ENDS_OF_ONE, None, EA=Scalar(1.4e8), number=Scalar(12.0)), 12 * 1.4e8, 0.0),
    ],
)
def test_stiffness_follows_from_sizes(structure, EA, EI):
    """Per metre of tunnel: a plate of a wall, held along the tunnel where nu is given; bars."""
    found = [float(dual.value) for dual in rigidities(structure, ParameterPoint({}, ()))]
    assert found == pytest.approx([EA, EI], rel=1e-12)
