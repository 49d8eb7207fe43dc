"""Condensing a system of vectors that is known by hand: a bar that yields beside an elastic one.

With the elongation u, the force sigma of the bar that yields and its plastic elongation lam,

    sigma + 3 u = 10,    sigma = 2 (u - lam),    s = p0 - sigma + p1 lam,    v = u

so u = 2 + 0.4 lam and s = p0 - 4 + 1.2 lam + p1 lam.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.condensed_system import (
    condensed,
    condensing_obstacle,
    determined_unknowns,
    sizes_of_kinds,
)
from geoident.model.equations import Bilinear, BilinearSystem
from geoident.model.parameter import Parameter, Prior

PARAMETERS = (Parameter("k", 2.0, 1.0, 5.0, prior=Prior(4.0, 2.0)), Parameter("H", 1.0, 0.0, 3.0))


def bilinear(constant, by_p, by_x, products=None):
    found = {h: sp.csr_array(np.array(A, dtype=float)) for h, A in (products or {}).items()}
    arrays = (np.array(a, dtype=float) for a in (constant, by_p, by_x))
    constant, by_p, by_x = arrays
    return Bilinear(constant, by_p, sp.csr_array(by_x), found)


def bars(beside=3.0):
    return BilinearSystem(
        names=("k", "H"),
        equations=bilinear([-10.0, 0.0], np.zeros((2, 2)), [[beside, 1.0, 0.0], [-2.0, 1.0, 2.0]]),
        slacks=bilinear([0.0], [[1.0, 0.0]], [[0.0, -1.0, 0.0]], {1: [[0.0, 0.0, 1.0]]}),
        readings=bilinear([0.5], [[0.0, 0.0]], [[1.0, 0.0, 0.0]]),
        multipliers=np.array([2]),
        stiffness=np.array([2.0]),
        work=np.array([7.0]),
        kind_of_unknown=np.array([0, 1, -1]),
        kind_of_equation=np.array([-1, 1]),
        kind_of_slack=np.array([1]),
    )


def test_displacements_are_eliminated_as_by_hand():
    found = condensed(Problem(None, np.array([1.5]), np.array([0.1]), PARAMETERS), bars())
    S, L, ref = 4.0, 2.0, [5.0, 3.0]
    assert found.reference.tolist() == ref
    assert found.lower == pytest.approx([0.2, 0.0])
    assert found.upper == pytest.approx([1.0, 1.0])
    assert found.slack == pytest.approx([-4.0 / S])
    assert found.slack_by_p[0] == pytest.approx([ref[0] / S, 0.0])
    assert found.slack_by_lam[0] == pytest.approx([1.2 * L / S])
    assert found.products[1][0] == pytest.approx([ref[1] * L / S])
    assert found.misfit == pytest.approx([(2.0 + 0.5 - 1.5) / 0.1, -4.0 / 2.0])
    assert found.misfit_by_p[0] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert found.misfit_by_p[1] == pytest.approx([ref[0] / 2.0, 0.0])
    assert found.misfit_by_lam[:, 0] == pytest.approx([0.4 * L / 0.1, 0.0])
    assert found.work == pytest.approx([7.0 * S * L])
    assert found.multiplier_size == pytest.approx([L])


def test_the_sizes_of_parameters_count_in_the_size_of_a_stress():
    """A load of 10 + 5 k: the elastic force is 4 + 2 k, and k may be 5."""
    given = bars()
    pulled = replace(given.equations, by_p=np.array([[-5.0, 0.0], [0.0, 0.0]]))
    problem = Problem(None, np.array([1.5]), np.array([0.1]), PARAMETERS)
    found = condensed(problem, replace(given, equations=pulled))
    assert found.multiplier_size == pytest.approx([(4.0 + 2.0 * 5.0) / 2.0])


def test_a_kind_of_nothing_but_zeros_takes_the_size_of_the_slacks():
    sizes = sizes_of_kinds(bars(), np.array([0.0, -8.0, 99.0]))
    assert sizes.tolist() == [8.0, 8.0]
    assert sizes_of_kinds(bars(), np.zeros(3)).tolist() == [1.0, 1.0]


def test_equations_that_determine_nothing_are_an_error():
    system = bars(beside=-2.0)
    with pytest.raises(ModelError, match="singular"):
        determined_unknowns(system, system.equations.by_x, np.ones((2, 1)))


def test_numbers_of_very_different_size_do_not_spoil_the_elimination():
    """The second unknown in a unit 1e13 times as small."""
    given, wide = bars(), np.diag([1.0, 1e13, 1.0])
    matrix = sp.csr_array(np.diag([1e-6, 1e9]) @ given.equations.by_x.toarray() @ wide)
    x = determined_unknowns(given, matrix, np.array([[-1e-5], [0.0]]))
    assert x[:, 0] == pytest.approx([2.0, 4e-13, 0.0], rel=1e-14)


def test_what_cannot_be_condensed_is_said():
    given = bars()
    assert condensing_obstacle(given) is None
    free = replace(given.equations, products={0: sp.csr_array(np.eye(2, 3))})
    assert "k changes a modulus" in (condensing_obstacle(replace(given, equations=free)) or "")
    softening = replace(given.slacks, products={1: sp.csr_array([[0.0, 0.0, -1.0]])})
    why = condensing_obstacle(replace(given, slacks=softening)) or ""
    assert "no convex energy" in why
    fixed = replace(given.slacks, by_x=sp.csr_array([[0.0, -1.0, -0.1]]))
    assert "no convex energy" in (condensing_obstacle(replace(given, slacks=fixed)) or "")
