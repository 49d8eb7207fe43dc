"""Angles of strata from any start: what one descent misses, several find (theory 12.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.strata import TRUTH, write_case, write_readings

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh
from geoident.model.methods import GaussNewtonOptions

AUTOMATIC = GaussNewtonOptions()
SINGLE = GaussNewtonOptions(starts=1)


@pytest.fixture(scope="module")
def problem(tmp_path_factory) -> Problem:
    folder = tmp_path_factory.mktemp("strata")
    path = write_case(folder)
    write_readings(path, TRUTH, seed=1)
    loaded = read_case(str(path))
    mesh = read_mesh(str(loaded.mesh_path), dim=2)
    case = loaded.case
    staged = staged_model(mesh, case, solver=pick_solver("auto"))
    readings = [reading for reading in case.readings if reading.stage == "dig"]
    pairs = [(reading.channel, reading.stage) for reading in readings]
    values = np.array([reading.value for reading in readings])
    return Problem(staged.response(pairs), values, np.full(len(pairs), 2e-4), case.parameters)


def _from(problem: Problem, degrees: float, options: GaussNewtonOptions):
    start = [15e9, 8e9, np.radians(degrees), 1.0]
    return identify(problem.begun_at(np.array(start)), [options], lambda _: None)


def test_five_starts_find_the_lowest_minimum_from_anywhere_one_start_from_some_places(problem):
    dips = np.linspace(-88.0, 88.0, 7)
    single = np.array([_from(problem, dip, SINGLE).objective for dip in dips])
    several = [_from(problem, dip, AUTOMATIC) for dip in dips[::4]]
    lowest = min(outcome.objective for outcome in several)
    assert np.count_nonzero(single > lowest + 10.0) >= 2  # a third of them, and converged
    assert all(outcome.objective <= lowest + 1e-6 for outcome in several)
    assert all("dip is an angle" in " ".join(outcome.remarks) for outcome in several)
    np.testing.assert_allclose(several[0].values, list(TRUTH.values()), rtol=0.15)


def test_where_an_angle_is_known_well_enough_one_start_will_do(problem):
    narrow = tuple(
        replace(q, lower=np.radians(-60), upper=np.radians(-20)) if q.name == "dip" else q
        for q in problem.parameters
    )
    outcome = _from(replace(problem, parameters=narrow), -30.0, AUTOMATIC)
    assert outcome.remarks == ()
    assert not any(step.note.startswith("start 2") for step in outcome.iterations)
