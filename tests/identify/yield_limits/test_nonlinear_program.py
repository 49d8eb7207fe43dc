"""The full space from the program to its ending, on a bar that yields beside an elastic one.

u = 2 + 0.4 lam, sigma = 4 - 1.2 lam, s = k - 4 + (1.2 + H) lam: see `support.one_bar`. What
is read is u + 0.5 and 0.3 sigma + 0.1 k - 0.2.
"""

from __future__ import annotations

from dataclasses import replace

import casadi
import numpy as np
import pytest
import scipy.sparse as sp
from support.one_bar import bar_system, bilinear

from geoident.errors import InputError
from geoident.identify.problem.losses import transformed
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.identify.yield_limits import full_space as module
from geoident.identify.yield_limits.condensed_system import condensed
from geoident.identify.yield_limits.full_space import (
    Solution,
    full_space,
    nonlinear_program,
    solver,
)
from geoident.identify.yield_limits.global_bound import global_bound
from geoident.model.methods import (
    ComplementarityOptions,
    HuberOptions,
    SquaredOptions,
    StudentOptions,
)
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity

FULL = ComplementarityOptions(formulation="full-space")
PARAMETERS = (Parameter("k", 2.0, 1.0, 5.0), Parameter("H", 1.0, 0.1, 3.0, "log"))
TRUTH = np.array([2.8, 0.7])
SD = np.array([0.02, 0.05])


class Bar:
    """The bar as a model: by formulas, and by its equations."""

    names = ("k", "H")

    def __init__(self, why=None):
        self.why, self.evaluations = why, 0

    @property
    def counts(self):
        return Counts(evaluations=self.evaluations)

    def admissible(self, p):
        return None

    def readings(self, p):
        return self.evaluate(p)[0]

    def evaluate(self, p):
        self.evaluations += 1
        k, H = p
        lam = max(0.0, (4.0 - k) / (1.2 + H))
        dlam = np.array([-1.0, -lam]) / (1.2 + H) * (lam > 0.0)
        v = np.array([2.5 + 0.4 * lam, 0.3 * (4.0 - 1.2 * lam) + 0.1 * k - 0.2])
        return v, np.array([0.4 * dlam, -0.36 * dlam + [0.1, 0.0]])

    def yields(self):
        return True

    def activity(self, p):
        k, H = p
        lam = max(0.0, (4.0 - k) / (1.2 + H))
        return Activity(
            ("bar",), ("load",), np.array([[int(lam > 0.0)]]), np.array([[0]]),
            np.array([k + H * lam]), np.array([4.0 - 1.2 * lam]), np.array([[1.0, lam]]),
        )  # fmt: skip

    def system_obstacle(self):
        return self.why

    def system(self):
        return bar_system(
            bilinear([0.5, -0.2], [[0.0, 0.0], [0.1, 0.0]], [[1.0, 0.0, 0.0], [0.0, 0.3, 0.0]])
        )


def problem(*, truth=TRUTH, off=(0.0, 0.0), **given):
    measured = Bar().readings(np.array(truth)) + np.array(off)
    return Problem(Bar(), measured, SD, PARAMETERS, **given)


def silent(entry):
    return None


def test_it_finds_what_the_model_confirms():
    seen = []
    given = problem()
    found = full_space(given, FULL, seen.append)
    assert found.values == pytest.approx(TRUTH, rel=1e-4)
    assert (found.status, found.certificate.kind) == ("converged", "global")
    assert found.reason.endswith(
        "with complementarity to 1e-12, and the model confirms its misfit."
    )
    assert found.objective == pytest.approx(Discrepancy(given).objective(found.values))
    notes = [entry.note for entry in seen]
    assert (notes[0], notes[-1]) == ("start", "model")
    assert seen[0].values.tolist() == [2.0, 1.0]
    smoothings = [f"smoothing 1e{k}" for k in ("+00", *(f"-{n:02d}" for n in range(2, 13, 2)))]
    assert list(dict.fromkeys(notes[1:-1])) == smoothings
    assert found.iterations == tuple(seen)
    assert {entry.method for entry in seen} == {"complementarity"}
    assert {entry.step for entry in seen} == {0.0}
    inside = np.array([entry.values for entry in seen])
    assert np.all((inside >= [1.0, 0.1]) & (inside <= [5.0, 3.0]))
    # the last one of the program is where the model is asked
    assert seen[-2].values == pytest.approx(found.values, rel=1e-6)


@pytest.mark.parametrize("loss", [SquaredOptions(), HuberOptions(1.2), StudentOptions(3.0)])
def test_shared_errors_count_as_in_the_discrepancy(loss):
    """By the covariance for the squared loss; as unknowns of the program for others."""
    columns = np.array([[0.05, 0.0, 0.02], [0.03, 0.04, 0.0]])
    given = problem(off=(0.1, -0.2), loss=loss, shared=SharedErrors(sp.csr_array(columns)))
    program = nonlinear_program(given, given.response.system())
    robust = not isinstance(loss, SquaredOptions)
    beyond = 2 * len(SD) if isinstance(loss, HuberOptions) else 0
    more = 3 * robust + beyond
    assert program.variables.numel() == 5 + more
    assert program.start[5:].tolist() == [0.0] * more
    assert program.lower[5:].tolist() == [-np.inf] * (3 * robust) + [0.0] * beyond
    assert program.upper[5:].tolist() == [np.inf] * more
    function = casadi.Function("f", [program.variables], [program.objective])
    p = np.array([3.0, 0.5])
    lam = 1.0 / 1.7
    z = [3.0 / 2.0, 0.5, (2.0 + 0.4 * lam) / 2.0, (4.0 - 1.2 * lam) / 4.0, lam / 2.0]
    gap = Bar().readings(p) - given.measured
    if robust:
        shared = np.array([0.4, -1.3, 0.7])
        own = (gap - columns @ shared) / SD
        f, _ = transformed(loss, own)
        parts = []
        if isinstance(loss, HuberOptions):  # of own beyond delta, up and down
            parts = np.maximum(np.concatenate([own, -own]) - loss.delta, 0.0)
        assert float(function([*z, *shared, *parts])) == pytest.approx(f @ f + shared @ shared)
    else:
        sigma = np.diag(SD**2) + columns @ columns.T
        assert float(function(z)) == pytest.approx(gap @ np.linalg.solve(sigma, gap))
    found = full_space(given, FULL, silent)
    nearby = [found.values * (1.0 + d) for d in 0.02 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])]
    phi = Discrepancy(given).objective
    assert found.objective == pytest.approx(phi(found.values))
    assert all(phi(p) >= found.objective * (1.0 - 1e-9) for p in nearby)


def test_the_program_is_solved_to_the_smoothed_complementarity():
    """a + b - sqrt(a^2 + b^2 + 2 mu) = 0 is a b = mu."""
    given = problem(truth=(3.2, 0.4))
    program = nonlinear_program(given, given.response.system())
    told = []

    def watch(x, objective):
        told.append((x.copy(), objective))
        return False

    solve = solver(program, watch)
    found = solve(program.start, 1e-2)
    assert found.success
    assert found.word == "Solve_Succeeded"
    k, H = found.z[:2] * program.reference
    lam, sigma = 2.0 * found.z[4], 4.0 * found.z[3]
    assert (k - sigma + H * lam) / 4.0 * (lam / 2.0) == pytest.approx(1e-2, rel=1e-5)
    assert told[-1][1] == pytest.approx(found.objective, abs=1e-8)
    assert np.all([len(x) == 5 for x, _ in told])
    stopped = solver(program, lambda x, objective: True)(program.start, 1e-2)
    assert not stopped.success
    assert stopped.word == "User_Requested_Stop"


def test_what_somebody_raises_in_the_middle_is_raised():
    given = problem()
    program = nonlinear_program(given, given.response.system())

    def watch(x, objective):
        raise KeyError("somebody")

    with pytest.raises(KeyError, match="somebody"):
        solver(program, watch)(program.start, 1.0)


def test_a_stop_ends_the_smoothings_and_the_model_is_asked_once_more():
    stop = {3: "Enough."}
    found = full_space(problem(), FULL, lambda entry: stop.get(entry.number))
    assert (found.status, found.reason) == ("out-of-budget", "Enough.")
    assert [e.note for e in found.iterations][-1] == "model"
    assert len(found.iterations) == 5


def test_models_that_show_no_equations_are_refused():
    given = replace(problem(), response=Bar("the ground hardens"))
    with pytest.raises(InputError, match="not possible here: for the formulation full-space, the"):
        full_space(given, FULL, silent)


@pytest.mark.parametrize(
    ("off", "success", "said"),
    [
        (0.9e-3, True, "and the model confirms its misfit"),
        (-1.1e-3, True, "use the formulation implicit"),
        (0.0, False, "The nonlinear program was not solved (Failed)"),
    ],
)
def test_what_the_solver_ends_with_is_held_against_the_model(monkeypatch, off, success, said):
    """To a thousandth of one; where it failed, the better of start and end is the answer."""
    end = Solution(np.array([*TRUTH / [2.0, 1.0], 1.0, 1.0, 0.0]), off, success, "Failed")
    monkeypatch.setattr(module, "solver", lambda program, watch: lambda z, mu: end)
    found = full_space(problem(), FULL, silent)
    assert (found.status == "converged") == (off > 0.0)
    assert said in found.reason
    np.testing.assert_allclose(found.values, TRUTH)
    bad = replace(end, z=np.array([0.5, 3.0, 1.0, 1.0, 0.0]))
    monkeypatch.setattr(module, "solver", lambda program, watch: lambda z, mu: bad)
    np.testing.assert_allclose(full_space(problem().begun_at(TRUTH), FULL, silent).values, TRUTH)


@pytest.mark.parametrize("prior", [None, Prior(2.5, 0.1)])
def test_the_condensed_system_answers_as_the_model(prior):
    """Slack and misfit by scaled parameters and multipliers, at points that yield or do not."""
    shared = SharedErrors(sp.csr_array(np.array([[0.05], [0.03]])))
    given = replace(
        problem(off=(0.1, -0.2), shared=shared),
        parameters=(replace(PARAMETERS[0], prior=prior), PARAMETERS[1]),
    )
    found = condensed(given, given.response.system())
    for p in np.array([[2.0, 0.5], [3.3, 2.0], [4.5, 1.0]]):
        lam = max(0.0, (4.0 - p[0]) / (1.2 + p[1]))
        x, y = p / found.reference, lam / found.multiplier_size
        grown = found.slack_by_lam + sum(x[h] * A for h, A in found.products.items())
        s = found.slack + found.slack_by_p @ x + grown @ y
        slack = p[0] - 4.0 + (1.2 + p[1]) * lam
        assert s * 2.0 * found.multiplier_size == pytest.approx([slack], abs=1e-12)
        r = found.misfit + found.misfit_by_p @ x + found.misfit_by_lam @ y
        np.testing.assert_allclose(r @ r, Discrepancy(given).objective(p))
        assert np.all((x >= found.lower) == (p >= [1.0, 0.1]))
        assert found.misfit.shape == (2 + (prior is not None),)
    assert found.work == pytest.approx(7.0 * 2.0 * found.multiplier_size**2)


def test_the_proven_optimum_is_that_of_the_other_formulations():
    """A prior on k far from what is read: the lowest of a grid, with its bound."""
    given = replace(
        problem(off=(0.02, 0.0)), parameters=(PARAMETERS[0], replace(PARAMETERS[1], upper=0.5))
    )
    options = ComplementarityOptions(formulation="global", gap=1e-3)
    found = global_bound(given, options, silent)
    grid = [
        Discrepancy(given).objective(np.array([k, H]))
        for k in np.linspace(1.0, 5.0, 81)
        for H in np.linspace(0.1, 0.5, 9)
    ]
    assert isinstance(found, Outcome)
    assert (found.status, found.certificate.kind) == ("converged", "global")
    assert found.certificate.bound <= found.objective <= min(grid)
    assert found.certificate.gap <= 1e-3 * 1.001
    assert full_space(given, FULL, silent).objective == pytest.approx(found.objective, rel=1e-3)
