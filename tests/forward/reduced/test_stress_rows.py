"""Which gauges of stresses and forces a reduced model has, and by which sums."""

from __future__ import annotations

import numpy as np
import pytest
from support.force_gauges import gauge
from support.reduced import braced

from geoident.forward.analysis.stage import StageEnd
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.observation import AnalysisState
from geoident.forward.reduced.affine_analysis import _samples
from geoident.forward.reduced.points import AnalysisPoints
from geoident.forward.reduced.stress_rows import beyond_reduction, stress_rows
from geoident.model.dual import ParameterPoint

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
    analysis, observation = staged.analysis, staged.observation
    found = stress_rows(analysis, observation)
    assert found.channels.tolist() == [0, 1, 4, 5]
    assert np.all(np.diff(found.points) > 0)
    points, systems = AnalysisPoints(analysis.systems), analysis.systems
    random = np.random.default_rng(8)
    stress = random.standard_normal((points.n_strain, points.n_ground, 1))
    members = random.standard_normal((systems.structures.n_rows, 1))
    end = StageEnd(
        2, np.zeros((systems.discretization.n_dofs, 1)), stress, members,
        np.zeros(points.n_ground, dtype=bool),
    )  # fmt: skip
    point = ParameterPoint(analysis.case.start, ())
    exact = observation.values(AnalysisState(end, point, systems.structures))[:, 0]
    joined = points.joined(stress, members)[:, found.points, 0]
    seen = np.einsum("csq,sq->c", found.weights, joined)
    np.testing.assert_allclose(seen, exact[found.channels], rtol=1e-12)
    assert np.all(np.any(found.weights != 0.0, axis=(0, 1)))


def test_gauges_that_are_no_such_sums_are_named(staged):
    analysis, observation = staged.analysis, staged.observation
    assert beyond_reduction(analysis, observation, np.array([0, 1, 4, 5])) is None
    said = "gauge '{}' reads more than displacements, normal stresses and forces"
    assert beyond_reduction(analysis, observation, np.array([4, 2])) == said.format("of bolts")
    assert beyond_reduction(analysis, observation, np.array([3])) == said.format("major")


def test_moduli_and_loads_are_looked_at_all_over_the_domain(staged):
    """At corners and 24 and more vectors between them, each of them possible."""
    analysis = staged.analysis
    names = tuple(q.name for q in analysis.case.parameters)
    found = _samples(analysis, names)
    assert len(found) >= 24 + 3 * len(names)
    lower, upper = (np.array([getattr(q, side) for q in analysis.case.parameters])
                    for side in ("lower", "upper"))  # fmt: skip
    assert np.all(found >= lower - 1e-9 * np.abs(lower))
    assert np.all(found <= upper + 1e-9 * np.abs(upper))
    assert len(np.unique(found, axis=0)) == len(found)
    for p in found:
        values = dict(zip(names, map(float, p), strict=True))
        assert inadmissible_numbers(analysis.case, analysis.sequence, values) is None
    assert np.linalg.matrix_rank((found - found.mean(axis=0)) / np.ptp(found, axis=0)) == len(names)
