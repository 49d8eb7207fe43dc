"""Corners, where a few elements would decide how many steps a stage takes."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.meshes import box, regroup
from support.yielding import constant, mohr, parameters, rock

from geoident.forward.march import equilibrium
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


def found():
    """Readings, their derivatives, and the factorizations that they took."""
    staged = heading()
    v, J = staged.response(READ).evaluate(P)
    return v, J, staged.counts.factorizations


def test_the_worst_places_are_solved_by_themselves_and_nothing_else_changes(monkeypatch):
    """Steps of the whole ground alone take nearly twice as many, to the same state."""
    w, exact, many = found()
    monkeypatch.setattr(equilibrium, "LARGE", 0)
    v, slopes, few = found()
    assert v == pytest.approx(w, rel=1e-9)
    assert slopes == pytest.approx(exact, rel=1e-7)
    assert few <= 10
    assert many >= 14


def test_they_are_part_of_the_ground_only(monkeypatch):
    """Where more than a tenth would have to move, whole steps are taken."""
    _, _, many = found()
    monkeypatch.setattr(equilibrium, "LARGE", 0)
    monkeypatch.setattr(equilibrium, "_PATCH", 0.0)
    assert found()[2] == many


def test_the_last_factor_serves_again_near_the_end(monkeypatch):
    v, _, few = found()
    monkeypatch.setattr(equilibrium, "_CLOSE", 0.0)
    w, _, more = found()
    assert v == pytest.approx(w, rel=1e-9)
    assert few < more
