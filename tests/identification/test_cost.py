"""What the identification of yield limits costs, counted in factorizations."""

from __future__ import annotations

import numpy as np
import pytest
from support.yield_sites import Task, deep_opening, task

from geoident.identify.problem.methods import identify
from geoident.identify.problem.outcome import Outcome
from geoident.model.methods import ComplementarityOptions

MOST = 150


def spent(given: Task) -> tuple[Outcome, int]:
    """The outcome, and the factorizations on the way to it."""
    before = given.problem.response.counts.factorizations
    outcome = identify(given.problem, [ComplementarityOptions()], lambda iteration: None)
    return outcome, given.problem.response.counts.factorizations - before


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_two_distances_of_ten_thousand_elements_in_three_stages(seed):
    site = deep_opening(2, elements=10_000)
    assert site.model.mesh.n_elements >= 10_000
    assert len(site.model.case.stages) == 3
    given = task(site, seed)
    outcome, count = spent(given)
    print(f"seed {seed}: {count} factorizations, phi {outcome.objective:.2g}")
    np.testing.assert_allclose(outcome.values, given.truth, rtol=1e-3)
    assert count < MOST
