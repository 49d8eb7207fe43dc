"""Corners, where a few elements would decide how many steps a stage takes."""

from __future__ import annotations

import pytest
from support.cases import displacement, model, rollers
from support.meshes import box, regroup
from support.yielding import NOTHING, constant, mohr, rock

from geoident.model.case import Stage

FROZEN = [0.01031365953274, 0.01417259537401]
"""By Newton's method alone, on this mesh, m."""


def test_places_solved_by_themselves_do_not_change_the_state():
    """A quarter of an opening with a corner of 90 degrees, made in two stages.

    The mesh has more than 10,000 unknowns, from which on the worst places are solved alone first.
    """
    mesh = regroup(
        box("tri6", (36, 36), size=(9.0, 9.0)),
        first=lambda c: (c[:, 0] < 2.0) & (c[:, 1] < 1.0),
        second=lambda c: (c[:, 0] < 2.0) & (c[:, 1] < 2.0),
    )
    stages = ("first", "second")
    staged = model(
        mesh,
        materials={"rock": rock(5e9, 0.25, mohr(2e6, 0.66, tension=3e5))},
        groups={"first": "rock", "second": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=constant(-10e6, -12e6, -9e6),
        stages=tuple(Stage(name, excavate=(name,)) for name in stages),
        channels=(displacement("g", (0.0, 2.0), (0.0, -1.0)),),
    )
    assert len(staged.systems[1].pattern.dofs) > 10_000
    readings = staged.response([("g", name) for name in stages]).readings(NOTHING)
    assert readings == pytest.approx(FROZEN, rel=1e-9)
