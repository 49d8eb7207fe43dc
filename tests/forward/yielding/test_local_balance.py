"""Corners, where a few elements would decide how many steps a stage takes."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.meshes import box, regroup
from support.yielding import constant, mohr, parameters, rock

from geoident.forward.march import (
    equilibrium,
    plastic_derivatives,
    plastic_step,
    stage_equations,
)
from geoident.forward.march.inexact_newton import Directions
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
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    v, slopes, few = found()
    assert v == pytest.approx(w, rel=1e-9)
    assert slopes == pytest.approx(exact, rel=1e-7)
    assert few <= 10
    assert many >= 14


def test_they_are_part_of_the_ground_only(monkeypatch):
    """Where more than a tenth would have to move, whole steps are taken."""
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    monkeypatch.setattr(equilibrium, "_WORTH", 0)
    _, _, few = found()
    with monkeypatch.context() as alone:
        alone.setattr(equilibrium, "_settled", lambda equations, trial: None)
        _, _, many = found()
    monkeypatch.setattr(equilibrium, "_PATCH", 0.0)
    assert found()[2] == many > few


def test_a_factor_leads_the_steps_after_it(monkeypatch):
    """By conjugate gradients on the tangent, to the state and derivatives of whole steps."""
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    v, slopes, few = found()
    monkeypatch.setattr(equilibrium, "_WORTH", 0)
    w, exact, many = found()
    assert v == pytest.approx(w, rel=1e-9)
    assert slopes == pytest.approx(exact, rel=1e-7)
    assert few <= 6
    assert few < many


def far_from_it(*parts):
    """Factorizations of a march with derivatives at parameters far from known ones."""
    response = heading().response(READ)
    response.evaluate(P)
    before = response.counts.factorizations
    response.evaluate(np.array(parts) * P)
    return response.counts.factorizations - before


def test_far_from_what_is_known_no_step_is_lost(monkeypatch):
    """Tangents that keep a hundredth of the elastic stiffness lead there, not whole steps."""
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    monkeypatch.setattr(equilibrium, "_IN_REACH", 1e9)  # no elastic step
    few = far_from_it(1.0, 0.75)
    monkeypatch.setattr(equilibrium, "_STIFFER", 0)
    assert few < far_from_it(1.0, 0.75)


def test_stronger_ground_begins_with_the_elastic_step(monkeypatch):
    """Its factor is held from the first march on, and leads: the last ones are made on the end."""
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    few = far_from_it(1.2, 2.0)
    monkeypatch.setattr(equilibrium, "_IN_REACH", 1e9)
    many = far_from_it(1.2, 2.0)
    assert few <= len(STAGES) + 1 < many


def test_what_was_known_at_a_time_can_be_given_back(monkeypatch):
    """Without the factors, which are made again: one a stage."""
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    response = heading().response(READ)
    response.evaluate(P)
    known = response.starts()
    response.forget()
    response.evaluate(1.5 * P)
    costs = []
    for begin in (response.forget, lambda: response.begin_from(known)):
        begin()
        before = response.counts.factorizations
        response.readings(NEAR_BY * P)
        costs.append(response.counts.factorizations - before)
    assert costs[1] <= len(STAGES) < costs[0]


def test_the_last_factor_serves_again_near_the_end(monkeypatch):
    v, _, few = found()
    monkeypatch.setattr(equilibrium, "_CLOSE", 0.0)
    w, _, more = found()
    assert v == pytest.approx(w, rel=1e-9)
    assert few < more


NEAR_BY = np.array([1.002, 0.999])
"""Where a search goes next, by the parameters of before."""


def next_to_it(wanted):
    """What a march near a known parameter vector finds, and the factorizations that it takes.

    Args:
        wanted: readings alone, or with their derivatives.
    """
    response = heading().response(READ)
    response.evaluate(P)
    before = response.counts.factorizations
    found = getattr(response, wanted)(NEAR_BY * P)
    return found, response.counts.factorizations - before


def test_readings_near_what_is_known_take_no_factorization(monkeypatch):
    """A side of a kink, as the certificate of a search compares it."""
    v, many = next_to_it("readings")
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    w, none = next_to_it("readings")
    assert w == pytest.approx(v, rel=1e-9)
    assert many >= 2
    assert none == 0


def test_derivatives_near_what_is_known_take_one_factorization_a_stage_at_most(monkeypatch):
    (v, slopes), many = next_to_it("evaluate")
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    (w, same), few = next_to_it("evaluate")
    assert w == pytest.approx(v, rel=1e-9)
    assert same == pytest.approx(slopes, rel=1e-7)
    assert few <= len(STAGES) < many


def test_the_last_factor_leads_the_derivatives_too(monkeypatch):
    """It was made beside the end; conjugate gradients on it find what a factor of the end would."""
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    monkeypatch.setattr(equilibrium, "_PIECES_KNOWN", 0.0)
    v, slopes, few = found()
    monkeypatch.setattr(plastic_derivatives, "_FEW", 0)
    w, exact, more = found()
    assert v == pytest.approx(w, rel=1e-12)
    assert slopes == pytest.approx(exact, rel=1e-9)
    assert few < more


def test_where_derivatives_are_wanted_the_last_step_has_their_factor(monkeypatch):
    """It costs what they would have cost anyway, and ends the search for the state."""
    monkeypatch.setattr(stage_equations, "LARGE", 0)
    monkeypatch.setattr(plastic_derivatives, "_FEW", 0)
    (v, slopes), few = next_to_it("evaluate")
    monkeypatch.setattr(equilibrium, "_PIECES_KNOWN", 0.0)
    counted = []
    step_on = Directions.step_on
    monkeypatch.setattr(
        Directions, "step_on", lambda self, *given: counted.append(1) or step_on(self, *given)
    )
    (w, same), more = next_to_it("evaluate")
    assert w == pytest.approx(v, rel=1e-9)
    assert same == pytest.approx(slopes, rel=1e-7)
    assert few <= more
    assert len(counted) > 2 * len(STAGES)


def test_what_was_known_long_ago_is_known_while_there_is_room(monkeypatch):
    """A search comes back to its best point after restarts elsewhere."""

    def coming_back():
        response = heading().response(READ)
        for part in (1.0, 0.7, 0.8, 0.9, 1.2, 1.1):
            response.evaluate(np.array([part, 1.0]) * P)
        before = response.counts.factorizations
        response.readings(P)
        return response.counts.factorizations - before

    assert coming_back() == 0
    monkeypatch.setattr(plastic_step, "_KEPT", 0)
    assert coming_back() > 0
