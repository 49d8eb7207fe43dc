"""Corners, where a few elements would decide how many steps a stage takes."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.meshes import box, regroup
from support.yielding import constant, mohr, parameters, rock

from geoident.forward.analysis import equilibrium
from geoident.model.case import Stage
from geoident.model.parameter import Scalar

P = np.array([5e9, 2e6])
STAGES = (Stage("first", excavate=("first",)), Stage("second", excavate=("second",)))
READ = [("g", "first"), ("g", "second")]


def heading():
    """A quarter of an opening with a corner of 90 degrees, made in two stages."""
    whole = box("tri6", (18, 18), size=(9.0, 9.0))
    mesh = regroup(
        whole,
        first=lambda c: (c[:, 0] < 2.0) & (c[:, 1] < 1.0),
        second=lambda c: (c[:, 0] < 2.0) & (c[:, 1] < 2.0),
    )
    mohr_coulomb = mohr(Scalar(1.0, "c"), 0.66, tension=3e5)
    return model(
        mesh,
        materials={"rock": rock(Scalar(1.0, "E"), 0.25, mohr_coulomb)},
        groups={"first": "rock", "second": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=constant(-10e6, -12e6, -9e6),
        parameters=parameters(E=5e9, c=2e6),
        stages=STAGES,
        channels=(displacement("g", (0.0, 2.0), (0.0, -1.0)),),
    )


def test_places_solved_by_themselves_do_not_change_the_state(monkeypatch):
    """Large meshes solve the worst places alone first; here a small one does."""
    readings, slopes = heading().response(READ).evaluate(P)
    monkeypatch.setattr(equilibrium, "LARGE", 0)
    patched = heading().response(READ).evaluate(P)
    assert patched[0] == pytest.approx(readings, rel=1e-9)
    assert patched[1] == pytest.approx(slopes, rel=1e-7)
