"""Systems of vectors made dense, or a nonlinear program: a bar that yields beside an elastic one.

See `support.one_bar`; its u is read.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import casadi
import numpy as np
import pytest
import scipy.sparse as sp
from support.one_bar import bar_system, bilinear

from geoident.errors import ModelError
from geoident.identify.problem.losses import transformed
from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.condensed_system import (
    condensed,
    condensing_obstacle,
    determined_unknowns,
)
from geoident.identify.yield_limits.full_space import nonlinear_program
from geoident.identify.yield_limits.mixed_program import solve_box
from geoident.identify.yield_limits.parameter_boxes import ParameterBox
from geoident.model.methods import HuberOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.response import BilinearSystem

PARAMETERS = (Parameter("k", 2.0, 1.0, 5.0, prior=Prior(4.0, 2.0)), Parameter("H", 1.0, 0.0, 3.0))


def bars(beside=3.0):
    return bar_system(bilinear([0.5], [[0.0, 0.0]], [[1.0, 0.0, 0.0]]), beside=beside)


def two_bars():
    """Bars of 2 and 1.5 that yield beside one of 3 under 10; the second hardens by 0.3 lam."""
    return BilinearSystem(
        names=("k1", "k2"),
        equations=bilinear(
            [-10.0, 0.0, 0.0],
            np.zeros((3, 2)),
            [[3, 1, 1, 0, 0], [-2, 1, 0, 2, 0], [-1.5, 0, 1, 0, 1.5]],
        ),
        slacks=bilinear([0.0, 0.0], np.eye(2), [[0, -1, 0, 0, 0], [0, 0, -1, 0, 0.3]]),
        readings=bilinear([0.5, 0.0], [[0.0, 0.0], [0.2, 0.0]], [[1, 0, 0, 0, 0], [0, 0, 1, 0, 0]]),
        multipliers=np.array([3, 4]),
        stiffness=np.array([2.0, 1.5]),
        work=np.array([7.0, 9.0]),
        kind_of_unknown=np.array([0, 1, 1, -1, -1]),
        kind_of_equation=np.array([-1, 1, 1]),
        kind_of_slack=np.array([1, 1]),
    )


@pytest.mark.parametrize("lam", [[0.0, 0.0], [0.4, 0.0], [0.0, 0.7], [0.3, 0.9]])
def test_two_multipliers_act_on_each_other(lam):
    """u = (10 + 2 lam1 + 1.5 lam2) / 6.5, and the forces from it."""
    parameters = (Parameter("k1", 2.0, 1.0, 5.0), Parameter("k2", 1.0, 0.5, 3.0))
    measured, sd = np.array([1.5, 2.0]), np.array([0.1, 0.25])
    found = condensed(Problem(None, measured, sd, parameters), two_bars())
    lam, p = np.array(lam), np.array([1.7, 2.3])
    u = (10.0 + 2.0 * lam[0] + 1.5 * lam[1]) / 6.5
    force = np.array([2.0, 1.5]) * (u - lam)
    S = 2.0 * 10.0 / 6.5  # the largest force without multipliers
    x, y = p / found.reference, lam / found.multiplier_size
    assert found.multiplier_size == pytest.approx(S / np.array([2.0, 1.5]))
    assert found.reference.tolist() == [5.0, 3.0]
    s = found.slack + found.slack_by_p @ x + found.slack_by_lam @ y
    assert s * S == pytest.approx(p - force + [0.0, 0.3 * lam[1]])
    r = found.misfit + found.misfit_by_p @ x + found.misfit_by_lam @ y
    assert r == pytest.approx((np.array([u + 0.5, force[1] + 0.2 * p[0]]) - measured) / sd)
    assert found.work == pytest.approx(np.array([7.0, 9.0]) * S * S / [2.0, 1.5])
    program = nonlinear_program(Problem(None, measured, sd, parameters), two_bars())
    z = np.concatenate([p / [2.0, 1.0], [u / (10.0 / 6.5)], force / S, y])
    objective, g = evaluated(program, z, 0.0)
    assert objective == pytest.approx(r @ r)
    assert g[:3] == pytest.approx([0.0, 0.0, 0.0], abs=1e-14)
    a = (p - force + [0.0, 0.3 * lam[1]]) / S
    assert g[3:] == pytest.approx(a + y - np.hypot(a, y))


def test_equations_that_determine_nothing_are_an_error():
    system = bars(beside=-2.0)
    with pytest.raises(ModelError) as caught:
        determined_unknowns(system, system.equations.by_x, np.ones((2, 1)))
    assert caught.value.message == "the stiffness matrix of a stage is singular"
    assert "supports hold all of the ground" in caught.value.hint


@pytest.mark.parametrize("unit", [1.0, 1e-17])
@pytest.mark.parametrize("turned", [False, True])
def test_rows_and_columns_are_balanced_before_pivots_are_chosen(unit, turned):
    """x + 1e17 y = 1e17 and x + y = 2: x = y = 1.

    With 1 as first pivot the second equation would be lost to rounding, and x with it.
    """
    given = bars()
    rows, right = np.array([[1.0, 1e17], [1.0, 1.0]]), np.array([1e17, 2.0])
    if turned:
        rows, right = rows.T, np.array([2.0, 1e17])
    matrix = sp.csr_array(np.hstack([unit * rows, np.zeros((2, 1))]))
    x = determined_unknowns(given, matrix, -unit * right[:, None])
    assert x[:2, 0] == pytest.approx([1.0, 1.0], rel=1e-12)


@pytest.mark.parametrize("lost", [0, 1])
def test_an_unknown_in_no_equation_is_an_error_and_no_division_by_zero(lost):
    given = bars()
    matrix = given.equations.by_x.toarray()
    for axis in (0, 1):
        cut = matrix.copy()
        cut[(slice(None), lost) if axis else (lost, slice(None))] = 0.0
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(ModelError, match="singular"):
                determined_unknowns(given, sp.csr_array(cut), np.ones((2, 1)))


def test_what_cannot_be_condensed_is_said():
    given = bars()
    assert condensing_obstacle(given) is None
    free = replace(given.equations, products={0: sp.csr_array(np.eye(2, 3))})
    assert condensing_obstacle(replace(given, equations=free)) == (
        "k changes a modulus (it multiplies unknowns of the equations), so displacements can't be "
        "eliminated"
    )
    softening = replace(given.slacks, products={1: sp.csr_array([[0.0, 0.0, -1.0]])})
    why = condensing_obstacle(replace(given, slacks=softening)) or ""
    assert why == "hardening that one plane takes from another has no convex energy here"
    fixed = replace(given.slacks, by_x=sp.csr_array([[0.0, -1.0, -0.1]]))
    assert "no convex energy" in (condensing_obstacle(replace(given, slacks=fixed)) or "")
    stored = sp.csr_array(([-1.0, 0.0], ([0, 0], [1, 2])), shape=(1, 3))  # a zero that is kept
    assert condensing_obstacle(replace(given, slacks=replace(given.slacks, by_x=stored))) is None


# The nonlinear program in the full space


def evaluated(program, z, mu):
    """Objective and constraints at z, by casadi."""
    function = casadi.Function(
        "program", [program.variables, program.mu], [program.objective, program.constraints]
    )
    objective, constraints = function(z, mu)
    return float(objective), np.array(constraints).ravel()


def program_of(loss=None, priors=(None, None)):
    parameters = tuple(replace(q, prior=p) for q, p in zip(PARAMETERS, priors, strict=True))
    loss = SquaredOptions() if loss is None else loss
    return nonlinear_program(
        Problem(None, np.array([1.5]), np.array([0.1]), parameters, loss), bars()
    )


@pytest.mark.parametrize("loss", [SquaredOptions(), HuberOptions(2.0), StudentOptions(3.0)])
@pytest.mark.parametrize("u", [1.1, 1.05])
def test_the_objective_is_the_discrepancy(loss, u):
    """The reading is u + 0.5; residuals of 2 and of 12 standard deviations."""
    priors = (Prior(4.0, 2.0), Prior(0.4, 0.1, "lognormal"))
    z = np.array([1.5, 0.5, u / 2.0, 0.7, 0.3])
    own = (u + 0.5 - 1.5) / 0.1
    # Huber's loss has unknowns of its own: the parts of the residual beyond delta, up and down.
    parts = np.maximum([own - loss.delta, -own - loss.delta], 0.0) if hasattr(loss, "delta") else []
    found, _ = evaluated(program_of(loss, priors), np.concatenate([z, parts]), 0.0)
    f, _ = transformed(loss, np.array([own]))
    prior = ((3.0 - 4.0) / 2.0) ** 2 + (np.log(0.5 / 0.4) * 0.4 / 0.1) ** 2
    assert found == pytest.approx(float(f @ f) + prior)


@pytest.mark.parametrize("known", [1.5, 2.0, 2.8])
def test_branch_and_bound_lets_hardening_grow_with_the_multiplier(known):
    """A reading of 2.9 is lam = 1, so s = 0 there: k + H = 2.8, and the prior tells k."""
    pytest.importorskip("pyscipopt")
    parameters = (replace(PARAMETERS[0], prior=Prior(known, 0.1)), PARAMETERS[1])
    system = condensed(Problem(None, np.array([2.9]), np.array([0.001]), parameters), bars())
    box = ParameterBox(system.lower, system.upper, 0.0, np.arange(1))
    found = solve_box(system, box, None, best=100.0, gap=1e-9)
    assert found.complete
    assert found.p * system.reference == pytest.approx([known, 2.8 - known], abs=0.01)
    assert found.bound == pytest.approx(0.0, abs=1e-3)
