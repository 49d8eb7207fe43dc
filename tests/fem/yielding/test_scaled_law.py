"""A law with factors of strength and stiffness is, point by point, the law of those numbers."""

from __future__ import annotations

import numpy as np
import pytest
from support.plastic import Planes, coulomb, isotropic, principal

from geoident.fem.yielding.scaled_law import ScaledLaw
from geoident.model.dual import Dual

LAME, SHEAR = 1.3, 0.9
ELASTICITY, STIFFER = isotropic(LAME, SHEAR, 6), isotropic(0.3, -0.2, 6)


@pytest.mark.parametrize("dilation", [None, 0.2])
def test_each_point_is_that_of_a_law_with_its_numbers(dilation):
    """Stress, tangent, multipliers, potential, and derivatives by a cohesion and by E."""
    rng = np.random.default_rng(8)
    planes = coulomb(0.6, 0.8, tension=0.3, dilation=dilation)
    count = 30
    strength, stiffness = rng.uniform(0.5, 2.0, (2, count))
    shift = rng.normal(size=count)
    slopes, moved = rng.normal(size=(2, count, 2))
    changes = [Planes(distances=np.array([0.7, 0.2])), Planes(elasticity=STIFFER)]
    factors = (Dual(np.column_stack(c)) for c in ((strength, slopes), (shift, moved)))
    law = ScaledLaw(principal(ELASTICITY, planes, changes), *factors, stiffness)
    along = planes.normals.sum(axis=1)  # what a unit of hydrostatic tension takes of the distance
    assert law.associated == (dilation is None)
    assert not law.hardens
    trial = 3.0 * rng.normal(size=(6, count))
    trial[:, 0] = 0.0
    moves = rng.normal(size=(6, count, 3))
    step = law.project(trial)
    assert 0.5 * count < step.yielded.size < count
    by_law, _ = step.derivatives(moves[:, step.yielded], of_law=True)
    by_trial, _ = step.derivatives(moves[:, step.yielded], of_law=False)
    outside = law.excess(trial)
    for n in range(count):
        f, g = strength[n], stiffness[n]
        distances = f * planes.distances + shift[n] * along
        numbers = Planes(planes.normals, distances, planes.flow)
        slope, moves_k = (
            np.outer(x[n], y) for x, y in ((slopes, planes.distances), (moved, along))
        )
        with_slopes = [
            Planes(distances=f * changes[0].distances + slope[0] + moves_k[0]),
            Planes(distances=slope[1] + moves_k[1], elasticity=g * STIFFER),
        ]
        alone = principal(g * ELASTICITY, numbers, with_slopes)
        one = alone.project(trial[:, n : n + 1])
        np.testing.assert_allclose(outside[:, n], alone.excess(trial[:, n : n + 1])[:, 0])
        np.testing.assert_allclose(step.stress[:, n], one.stress[:, 0], atol=1e-12)
        part = law.at(np.array([n])).project(trial[:, n : n + 1])
        np.testing.assert_allclose(part.stress, one.stress, atol=1e-12)
        assert (n in step.yielded) == bool(one.yielded.size)
        if not one.yielded.size:
            continue
        at = step.yielded.tolist().index(n)
        np.testing.assert_allclose(step.multipliers[at], one.multipliers[0], atol=1e-12)
        np.testing.assert_allclose(step.reduction[at], one.reduction[0], atol=1e-11)
        np.testing.assert_allclose(step.reserve[at], one.reserve[0], rtol=1e-10)
        assert step.biactive[at].tolist() == one.biactive[0].tolist()
        for slope, of_law in ((by_law, True), (by_trial, False)):
            expected, _ = one.derivatives(moves[:, n : n + 1], of_law=of_law)
            np.testing.assert_allclose(slope[:, at], expected[:, 0], atol=1e-10)
