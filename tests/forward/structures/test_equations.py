"""Bolts in the equations that the complementarity methods work on."""

from __future__ import annotations

import numpy as np
from support.load_cells import ENDS, GAUGES, VALUES, nailed


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
