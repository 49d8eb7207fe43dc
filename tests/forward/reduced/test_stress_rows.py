"""Which gauges of stresses and forces a reduced model has, and by which sums."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.force_gauges import gauge
from support.reduced import braced

from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.observation import MarchState
from geoident.forward.march.stage import StageEnd
from geoident.forward.reduced import affine_march as affine_module
from geoident.forward.reduced.affine_march import _samples, affine_march
from geoident.forward.reduced.points import MarchPoints
from geoident.forward.reduced.stress_rows import beyond_reduction, stress_rows
from geoident.forward.reduced.zones import zones_of
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Parameter

FORCE = {"dimension": "force"}
CHANNELS = (
    gauge("stress", "xx", (6.0, 6.1), "xx"),
    gauge("strain", "of struts", (4.5, 5.0), structure="struts", zero="lined"),  # EA is given
    gauge("strain", "of bolts", (4.5, 7.0), structure="bolts", zero="heading"),  # EA is sought
    gauge("stress", "major", (6.0, 6.1), "major"),
    gauge("load-cell", "strut", (4.5, 5.0), "N", structure="struts", **FORCE),
    gauge("load-cell", "second bolt", (1.0, 8.5), "N", structure="bolts", member=1, **FORCE),
)


@pytest.fixture(scope="module")
def staged():
    return braced(channels=CHANNELS)


def test_sums_over_points_and_members_are_what_gauges_read(staged):
    """Of any stresses and forces; strains by a rigidity that is sought are no such sums."""
    march, observation = staged.march, staged.observation
    found = stress_rows(march, observation)
    assert found.channels.tolist() == [0, 1, 4, 5]
    assert np.all(np.diff(found.points) > 0)
    points, systems = MarchPoints(march.systems), march.systems
    random = np.random.default_rng(8)
    stress = random.standard_normal((points.n_strain, points.n_ground, 1))
    members = random.standard_normal((systems.structures.n_rows, 1))
    end = StageEnd(
        2, np.zeros((systems.discretization.n_dofs, 1)), stress, members,
        np.zeros(points.n_ground, dtype=bool),
    )  # fmt: skip
    point = ParameterPoint(march.case.start, ())
    exact = observation.values(MarchState(end, point, systems.structures))[:, 0]
    joined = points.joined(stress, members)[:, found.points, 0]
    seen = np.einsum("csq,sq->c", found.weights, joined)
    np.testing.assert_allclose(seen, exact[found.channels], rtol=1e-12)
    assert np.all(np.any(found.weights != 0.0, axis=(0, 1)))


def test_gauges_that_are_no_such_sums_are_named(staged):
    march, observation = staged.march, staged.observation
    assert beyond_reduction(march, observation, np.array([0, 1, 4, 5])) is None
    said = "gauge '{}' reads more than displacements, normal stresses and forces"
    assert beyond_reduction(march, observation, np.array([4, 2])) == said.format("of bolts")
    assert beyond_reduction(march, observation, np.array([3])) == said.format("major")


def test_members_whose_force_a_jack_gives(staged):
    """Those of the struts in the stage that builds them, and of none in any other."""
    march = staged.march
    last = len(march.sequence.states) - 1
    made = affine_march(march, zones_of(staged.on_mesh), last, staged.observation)
    (part,) = (p for p in march.systems.structures.parts if p.name == "struts")
    rows = made.points.n_ground + np.arange(part.rows.start, part.rows.stop)
    assert [made.jacked(n).tolist() for n in range(last + 1)] == [[], [], rows.tolist(), [], []]
    assert len(made.zones) == last + 1
    assert set(made.form.spans) == {
        "rock", "young", "shotcrete", "EA of plate", "EI of plate", "EA of bolts", "EA of struts",
    }  # fmt: skip
    fixed = {name for name, span in made.form.spans.items() if span.fixed is not None}
    assert fixed == {"EA of struts"}
    p = np.array([q.start for q in march.case.parameters])
    at = made.form.at(p[None])
    for name, rank in (("rock", 2), ("EA of plate", 1)):
        span = made.form.spans[name]
        c, dc = span.coordinates(p[None])
        np.testing.assert_array_equal(at.moduli[name], c)
        np.testing.assert_array_equal(at.slopes[name], dc)
        assert c.shape == (1, rank)


def test_moduli_and_loads_are_looked_at_all_over_the_domain(staged):
    """At corners and 24 and more vectors between them, each of them possible."""
    march = staged.march
    names = tuple(q.name for q in march.case.parameters)
    found = _samples(march, names)
    assert len(found) >= 24 + 3 * len(names)
    lower, upper = (np.array([getattr(q, side) for q in march.case.parameters])
                    for side in ("lower", "upper"))  # fmt: skip
    assert np.all(found >= lower - 1e-9 * np.abs(lower))
    assert np.all(found <= upper + 1e-9 * np.abs(upper))
    assert len(np.unique(found, axis=0)) == len(found)
    for p in found:
        values = dict(zip(names, map(float, p), strict=True))
        assert inadmissible_numbers(march.case, march.sequence, values) is None
    assert np.linalg.matrix_rank((found - found.mean(axis=0)) / np.ptp(found, axis=0)) == len(names)


@pytest.mark.parametrize("most", [1.2, 0.1])
def test_samples_outside_the_domain_are_brought_towards_the_start(monkeypatch, most):
    """By halves, until x + y is at most what is allowed; no more than twenty times."""
    asked = []

    def inadmissible(case, sequence, values):
        asked.append((values["x"], values["y"]))
        return None if sum(asked[-1]) <= most else "too much"

    corners = np.array([[-1.0, 0.5], [3.0, 0.0], [0.0, 2.0]])
    points = [SimpleNamespace(values=dict(zip("xy", corner, strict=True))) for corner in corners]
    monkeypatch.setattr(affine_module, "inadmissible_numbers", inadmissible)
    monkeypatch.setattr(affine_module, "trial_points", lambda *_: points)
    parameters = (Parameter("x", 0.25, -9.0, 9.0), Parameter("y", 0.5, -9.0, 9.0))
    march = SimpleNamespace(case=SimpleNamespace(parameters=parameters), sequence=None)
    found = _samples(march, ("x", "y"))
    assert found.shape == (24 + 3 * 2, 2)
    np.testing.assert_array_equal(found[:3], corners)
    random, start, tried = np.random.default_rng(0), np.array([0.25, 0.5]), []
    for p in found[3:]:
        there = np.array([-1.0, 0.0]) + np.array([4.0, 2.0]) * random.random(2)
        for _ in range(20):
            tried.append(there)
            if there.sum() <= most:
                break
            there = (there + start) / 2
        np.testing.assert_allclose(p, there, rtol=1e-14)
    assert len(tried) > len(found) + 5
    np.testing.assert_allclose(asked, tried, rtol=1e-14)
