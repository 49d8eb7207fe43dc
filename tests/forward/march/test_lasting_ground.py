"""Ground that no stage touches is factorized once for all stages (theory 1.4)."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, make_case, material, rollers
from support.meshes import box, regroup

from geoident.fem.solvers.multifrontal import MultifrontalSolver
from geoident.fem.solvers.splu import SpluSolver
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
