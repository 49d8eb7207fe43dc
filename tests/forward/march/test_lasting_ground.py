"""Ground that no stage touches is factorized once for all stages (theory 1.4)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, rollers
from support.meshes import box, regroup

from geoident.fem.solvers.multifrontal import MultifrontalSolver
from geoident.fem.solvers.splu import SpluSolver
from geoident.forward.march import systems
from geoident.forward.model import staged_model
from geoident.model.case import Stage
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar

STAGES = ("first", "second", "third")


@pytest.fixture(scope="module")
def mesh():
    """A block of 512 hexahedra with a drift in three rounds, the last of which gets a lining."""

    def part(low, high):
        return lambda c: (
            (abs(c[:, 0]) < 1) & (abs(c[:, 2] - 4) < 1) & (low < c[:, 1]) & (c[:, 1] < high)
        )

    rounds = {name: part(2 * k, 2 * k + 2) for k, name in enumerate(STAGES)}
    return regroup(box("hex8", (8, 8, 8), size=(8.0, 8.0, 8.0)), **rounds)


def tunnel(mesh, solver, *, nu=None):
    """A drift under a constant stress; E and sigma_z are parameters, nu too if it is given."""
    free = {"E": 8e9, "sz": -5e6} | ({} if nu is None else {"nu": nu})
    stress = (Scalar(-3e6), Scalar(-3e6), Scalar(1.0, "sz"), *[Scalar(0.0)] * 3)
    case = make_case(
        mesh,
        parameters=tuple(
            Parameter(name, start, *sorted((0.5 * start, 1.5 * start)))
            for name, start in free.items()
        ),
        materials={
            "rock": material("rock", Scalar(1.0, "E"), 0.25 if nu is None else Scalar(1.0, "nu")),
            "concrete": material("concrete", 30e9, 0.2),
        },
        groups=dict.fromkeys(("rock", *STAGES), "rock"),
        supports=rollers(3),
        in_situ=ConstantStress(stress, True),
        stages=(
            Stage("first", excavate=("first",)),
            Stage("second", excavate=("second",)),
            Stage("third", excavate=("third",), install={"first": "concrete"}),
        ),
        channels=(displacement("roof", (0.0, 1.0, 5.0), (0.0, 0.0, 1.0)),),
    )
    return staged_model(mesh, case, solver=solver)


def readings(model, p):
    """Values (3,) and derivatives (3, n) of the reading at all stages."""
    return model.response([("roof", stage) for stage in STAGES]).evaluate(np.array(p))


def test_later_stages_cost_a_small_part_of_the_first(mesh):
    solver = MultifrontalSolver()
    model = tunnel(mesh, solver)
    run = model.at(np.array([8e9, -5e6]))
    spent = []
    for _ in run.states():
        spent.append(solver.counts.flops)
    first, second, third = np.diff(spent)
    assert second < 0.35 * first
    assert third < 0.35 * first


def test_a_modulus_that_scales_what_lasts_costs_no_factorization_of_it(mesh):
    solver = MultifrontalSolver()
    model = tunnel(mesh, solver, nu=0.25)
    cost = []
    for p in ([8e9, -5e6, 0.25], [7e9, -5e6, 0.25], [7e9, -6e6, 0.25], [7e9, -6e6, 0.2]):
        before = solver.counts.flops
        readings(model, p)
        cost.append(solver.counts.flops - before)
    assert cost[1] == cost[2] < 0.6 * cost[0]
    assert cost[3] == cost[0]


PLACES = ([8e9, -5e6, 0.25], [6e9, -4e6, 0.25], [6e9, -4e6, 0.31])


@pytest.fixture(scope="module")
def of_another_solver(mesh):
    other = tunnel(mesh, SpluSolver(), nu=0.25)
    return [readings(other, p) for p in PLACES]


@pytest.mark.parametrize("single", [False, True])
def test_readings_and_derivatives_are_those_of_another_solver(mesh, of_another_solver, single):
    ours = tunnel(mesh, MultifrontalSolver(single=single), nu=0.25)
    for p, others in zip(PLACES, of_another_solver, strict=True):
        for found, wanted in zip(readings(ours, p), others, strict=True):
            np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-12 * np.abs(wanted).max())


def test_a_solver_that_keeps_nothing_gets_the_order_of_least_work(mesh):
    assert tunnel(mesh, SpluSolver()).systems[1].pattern.lower.lasting == 0
    assert tunnel(mesh, MultifrontalSolver()).systems[1].pattern.lower.lasting > 0


@pytest.mark.parametrize(
    ("given", "first"),
    [
        ({}, 3),
        ({"each": 90}, 0),  # 30 + 3 x 90 operations against 3 x 100
        ({"once": 33}, 0),
        ({"once": 32}, 3),
        ({"stages": 2, "each": 84}, 3),
        ({"stages": 2, "each": 85}, 0),
        ({"stages": 1, "once": 1, "each": 1}, 0),
        ({"changes": 5}, 0),
        ({"most": 100}, 3),
        ({"most": 99}, 0),
        ({"whole": 99, "once": 0, "each": 0}, 0),
        ({"whole": 101}, 3),
        ({"keeps_from": float("inf"), "most": float("inf"), "whole": float("inf")}, 0),
    ],
)
@pytest.mark.parametrize("dim", [2, 3])
def test_what_lasts_comes_first_where_that_saves_operations(monkeypatch, given, first, dim):
    """Only for a solver that keeps it, and where a factorization is worth the count."""
    table = {"stages": 3, "changes": 2, "most": 500, "whole": 100, "once": 30, "each": 89,
             "keeps_from": 100} | given  # fmt: skip
    points, graph = np.zeros((5, dim)), ("pointers", "neighbours")
    mesh = SimpleNamespace(points=points, dim=dim)
    changes = np.arange(5) >= 5 - table["changes"]
    plain, sorted_out = np.array([4, 2, 0, 1, 3]), np.array([0, 1, 2, 4, 3])

    def flops(*args):
        *about, order, dimension, lasting = args
        assert (tuple(about), dimension) == (graph, dim)
        if lasting:
            assert (order is sorted_out, lasting) == (True, 3)
            return table["once"], table["each"]
        assert order is plain
        return 0, table["whole"]

    def most(n, *, plane):
        assert (n, plane) == (5 * dim, dim == 2)
        return table["most"]

    monkeypatch.setattr(systems, "node_graph", lambda given: graph)
    monkeypatch.setattr(systems, "nested_dissection", lambda *given: plain)
    monkeypatch.setattr(systems, "lasting_first", lambda *given: sorted_out)
    monkeypatch.setattr(systems, "elimination_flops", flops)
    monkeypatch.setattr(systems, "flops_at_most", most)
    found = object.__new__(systems.StageSystems)
    found._mesh, found._solver = mesh, SimpleNamespace(keeps_from=table["keeps_from"])
    order, count = found._elimination_order(changes, table["stages"])
    assert count == first
    assert order is (sorted_out if first else plain)
