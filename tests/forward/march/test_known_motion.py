"""A march that is told its displacements ends as the one that has solved for them."""

from __future__ import annotations

import numpy as np
import pytest
from support.reduced import braced, strata

from geoident.forward.march.march import RunOptions


@pytest.mark.parametrize("make", [braced, strata], ids=lambda make: make.__name__)
@pytest.mark.parametrize("derivatives", [True, False])
def test_forces_and_stresses_follow_from_displacements(make, derivatives):
    """Those of bars and plates too, and their derivatives; the last stage is solved for."""
    staged = make()
    p = np.array([q.start for q in staged.case.parameters])

    def ends(known=None):
        run = staged.at(p, RunOptions(derivatives=derivatives, known=known))
        return [(end.u.copy(), end.stress.copy(), end.members.copy()) for end in run.states()]

    solved = ends()
    last = len(solved) - 1
    before = staged.counts.factorizations
    followed = ends(lambda state: solved[state][0] if state < last else None)
    assert staged.counts.factorizations == before + 1
    for ours, theirs in zip(followed, solved, strict=True):
        for found, right in zip(ours, theirs, strict=True):
            for column in range(right.shape[-1]):
                size = np.abs(right[..., column]).max(initial=0.0)
                np.testing.assert_allclose(
                    found[..., column], right[..., column], rtol=0.0, atol=1e-8 * size
                )
