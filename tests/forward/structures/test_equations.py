"""Stiffness of structures from their sizes; bolts in the equations of complementarity methods."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.forward.structures.members import rigidities
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Bolts
from tests.support.load_cells import ENDS, GAUGES, VALUES, nailed


def test_bolts_are_points_of_one_strain_without_initial_force():
    """Weights are their lengths, the modulus EA over the spacing; a linear field strains them."""
    staged = nailed(GAUGES[0], free=("E", "EA"))
    system = staged.response([("d", "go on")]).staged_system()
    (nails,) = (s for s in system.sets if s.name == "nails")
    number = system.sets.index(nails)
    along = np.array([np.subtract(second, first) for first, second in ENDS])
    length = np.linalg.norm(along, axis=1)
    np.testing.assert_allclose(nails.volume, length)
    np.testing.assert_array_equal(nails.initial.constant, np.zeros((1, 2)))
    np.testing.assert_array_equal(nails.initial.slopes, np.zeros((1, 2, 2)))
    gradient = np.array([[2e-3, -1e-3], [5e-4, 3e-3]])
    u = (staged.mesh.points @ gradient.T).ravel()
    expected = np.einsum("bi,ij,bj->b", along, gradient, along) / length**2
    np.testing.assert_allclose(nails.compatibility @ u, expected, rtol=1e-9)
    assert [number in stage.laws for stage in system.stages] == [False, True, True]
    assert [number in stage.fresh for stage in system.stages] == [False, True, False]
    law = system.laws[system.stages[-1].laws[number]]
    assert law.n_planes == 0
    np.testing.assert_allclose(law.elasticity.at(np.array([2e9, 7e8])), [[7e8 / VALUES["s"]]])


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
