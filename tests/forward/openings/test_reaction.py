"""The ground reaction of an opening, against the formulas that handbooks give for it."""

import numpy as np
import pytest

from geoident.model.actions import Pressure
from geoident.model.case import Stage
from geoident.model.parameter import Scalar
from geoident.model.results.opening import GroundReaction
from tests.forward.openings.test_opening_model import MPa, without_mesh
from tests.support.cases import material
from tests.support.yielding import mohr, rock

E, NU, P0, RADIUS = 3e9, 0.25, 10 * MPa, 2.0
C, PHI = 1.0 * MPa, np.radians(30.0)
STAGES = (
    Stage("face", excavate=("core",), release={"core": Scalar(0.3)}),
    Stage("lined", release={"core": Scalar(1.0)}, loads={"l": Pressure("wall", Scalar(0.5 * MPa))}),
    Stage("far on", loads={"l": Pressure("wall", Scalar(0.0))}),
)


def reaction(ground, stages=STAGES) -> GroundReaction:
    model = without_mesh(ground, stages=stages)
    found = model.survey(np.empty(0), fields=True, partial=True).reaction
    assert found is not None
    assert model.survey(np.empty(0), fields=False, partial=True).reaction is None
    return found


def remarks(model):
    return model.response(()).remarks(np.empty(0))


@pytest.fixture(scope="module")
def yielding():
    return reaction(rock(E, NU, mohr(C, PHI, psi=0.0)))


def test_elastic_ground_reacts_by_a_straight_line():
    found = reaction(material("rock", E, NU))
    shear = E / (2.0 * (1.0 + NU))
    np.testing.assert_allclose(
        found.displacement, (P0 - found.pressure) * RADIUS / (2.0 * shear), rtol=1e-12, atol=1e-15
    )
    assert np.isnan(found.plastic_radius).all()
    assert np.isnan(found.critical)
    assert (found.radius, tuple(found.centre)) == (RADIUS, (0.0, 0.0))
    np.testing.assert_allclose(found.in_situ[:3], P0)
    # Lame: the stress around an empty opening is twice that of the ground
    assert found.hoop[-1, 0] == pytest.approx(2.0 * P0)
    assert found.radial[-1, 0] == pytest.approx(0.0, abs=1.0)


def test_yielding_ground_has_the_plastic_radius_of_the_handbooks(yielding):
    N = (1.0 + np.sin(PHI)) / (1.0 - np.sin(PHI))
    q = 2.0 * C * np.cos(PHI) / (1.0 - np.sin(PHI))
    s = q / (N - 1.0)
    critical = (2.0 * P0 - q) / (1.0 + N)
    assert yielding.critical == pytest.approx(critical, rel=1e-12)
    plastic = yielding.pressure < critical
    np.testing.assert_array_equal(np.isfinite(yielding.plastic_radius), plastic)
    p = yielding.pressure[plastic]
    R = RADIUS * (2.0 / (N + 1.0) * (P0 + s) / (p + s)) ** (1.0 / (N - 1.0))
    np.testing.assert_allclose(yielding.plastic_radius[plastic], R, rtol=1e-10)
    inside = yielding.radii < yielding.stage_plastic_radius[-1]
    r = yielding.radii[inside]
    radial = -s + (yielding.stage_pressure[-1] + s) * (r / RADIUS) ** (N - 1.0)
    np.testing.assert_allclose(yielding.radial[-1, inside], radial, rtol=1e-9, atol=1.0)
    np.testing.assert_allclose(yielding.hoop[-1, inside], N * radial + q, rtol=1e-9)


def test_stages_lie_on_the_curve(yielding):
    assert yielding.stages == ("face", "lined", "far on")
    np.testing.assert_allclose(yielding.stage_pressure, [7.0 * MPa, 0.5 * MPa, 0.0], atol=1.0)
    on_curve = np.interp(
        yielding.stage_pressure, yielding.pressure[::-1], yielding.displacement[::-1]
    )
    np.testing.assert_allclose(yielding.stage_displacement, on_curve, rtol=2e-3)
    assert np.isnan(yielding.stage_plastic_radius[0])


def test_the_last_stage_says_how_far_the_ground_yields(yielding):
    """Not an earlier one, whose wall is held back, though it comes from the same ground."""
    model = without_mesh(rock(E, NU, mohr(C, PHI, psi=0.0)), stages=STAGES)
    said = [text for text in remarks(model) if "the ground yields up to" in text]
    radius = yielding.stage_plastic_radius[-1]
    assert said == [f"at stage 'far on' the ground yields up to {radius:.3g} m from the centre"]
    assert radius > yielding.stage_plastic_radius[1] + 0.05
    held = without_mesh(rock(E, NU, mohr(C, PHI, psi=0.0)), stages=STAGES[:1])
    assert not any("yields up to" in text for text in remarks(held))
