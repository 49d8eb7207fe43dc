"""Corners, where a few elements would decide how many steps a stage takes."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.meshes import box, regroup
from support.yielding import constant, mohr, parameters, rock

from geoident.forward.analysis import equilibrium, plastic_step
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
    assert few < 0.75 * many


def test_they_are_part_of_the_ground_only(monkeypatch):
    """Where more than a tenth would have to move, whole steps are taken."""
    monkeypatch.setattr(equilibrium, "LARGE", 0)
    _, _, few = found()
    with monkeypatch.context() as alone:
        alone.setattr(equilibrium, "_settled", lambda equations, patches, trial: None)
        _, _, many = found()
    monkeypatch.setattr(equilibrium, "_PATCH", 0.0)
    assert found()[2] == many > few


NEAR_BY = np.array([1.002, 0.999])
"""Where a search goes next, by the parameters of before."""


def test_what_was_known_long_ago_is_known_while_there_is_room(monkeypatch):
    """A search comes back to its best point after restarts elsewhere."""

    def coming_back():
        response = heading().response(READ)
        for part in (1.0, 0.7, 0.8, 0.9, 1.2, 1.1):
            response.evaluate(np.array([part, 1.0]) * P)
        before = response.counts.factorizations
        response.readings(P)
        return response.counts.factorizations - before

    few = coming_back()
    monkeypatch.setattr(plastic_step, "_KEPT", 0)
    assert few < coming_back()
