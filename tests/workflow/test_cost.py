"""The memory and time that `check` tells, against what Python was seen to take."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from support.cases import model, rollers
from support.in_stages import model_at, write_msh
from support.meshes import box, regroup
from support.specimen import element, pressed

from geoident.fem import solvers
from geoident.forward.model import StagedModel
from geoident.model.case import Material, Stage
from geoident.model.ground import Isotropic
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.workflow.running import cost

START = {"E": 8e9, "nu": 0.3, "sx": -9e6, "sy": -6e6}


def excavation(free: int) -> StagedModel:
    """A hole in a square of 1,600 quads, dug in two stages, with so many unknown parameters."""
    names = list(START)[:free]

    def number(name: str) -> Scalar:
        return Scalar(1.0, name) if name in names else Scalar(START[name])

    def half(side: int):
        return lambda c: (
            (abs(c[:, 0] - 4) < 1) & (abs(c[:, 1] - 4) < 1) & (side * (c[:, 0] - 4) > 0)
        )

    mesh = regroup(box("quad8", (40, 40), size=(8.0, 8.0)), left=half(-1), right=half(1))
    stress = (number("sx"), number("sy"), Scalar(-7e6), *[Scalar(0.0)] * 3)
    return model(
        mesh,
        parameters=tuple(
            Parameter(name, START[name], *sorted((START[name] / 1.5, START[name] * 1.5)))
            for name in names
        ),
        materials={
            "rock": Material("rock", Isotropic(E=number("E"), nu=number("nu")), Scalar(0.0))
        },
        groups=dict.fromkeys(("rock", "left", "right"), "rock"),
        supports=rollers(2),
        in_situ=ConstantStress(stress, True),
        stages=(Stage("left", excavate=("left",)), Stage("right", excavate=("right",))),
    )


@pytest.mark.parametrize("free", [1, 4])
def test_memory_beside_the_factor_is_what_an_evaluation_takes(free):
    """All that numpy takes is counted by Python; the factor of splu, in C, is not."""
    staged = excavation(free)
    told = cost.estimate_cost(staged, solver="splu")
    arrays = told.memory - 120e6 - 24.0 * told.factor_entries
    p = np.array(list(START.values())[:free])
    tracemalloc.start()
    try:
        staged.survey(p, fields=False)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 0.55 * arrays < peak < arrays


CLAY = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
time_steps: 1
parameters:
  E: {start: 10 MPa, bounds: [1 MPa, 100 MPa]}
  k: {start: 1e-8 m/s, bounds: [1e-9 m/s, 1e-6 m/s]}
materials:
  clay: {E: $E, nu: 0.3, hydraulic: {permeability: $k}}
groups: {all: clay}
supports: {x0: x, x1: x, y0: fixed}
drained: {y1: {}}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 100 kPa}}, lasts: 100 d}
gauges:
  S: {kind: settlement, point: [3 m, 10 m], accuracy: 0.1 mm}
"""


def test_memory_of_consolidation_counts_what_a_march_keeps(tmp_path, monkeypatch):
    """The matrices of the water beside K; factors are not numpy's."""
    monkeypatch.setattr(cost, "_BYTES", dict.fromkeys(cost._BYTES, 0.0))
    write_msh(
        box("quad8", (40, 40), size=(20.0, 10.0)), tmp_path / "m.msh", ["x0", "x1", "y0", "y1"]
    )
    (tmp_path / "case.yaml").write_text(CLAY)
    staged = model_at(tmp_path / "case.yaml")
    arrays = cost.estimate_cost(staged, solver=solvers.picked()).memory - 120e6
    tracemalloc.start()
    try:
        staged.survey(np.array([1e7, 1e-8]), fields=False)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 0.55 * arrays < peak < arrays


def test_operations_are_those_of_all_stages_and_entries_those_of_the_largest():
    """Without the first half there is less to factorize; time grows with the operations."""
    staged = excavation(1)
    both = cost.estimate_cost(staged, solver="splu")
    each = [
        cost.factor_cost(s.pattern.lower, s.pattern.dofs // 2)
        for s in map(staged.systems.__getitem__, (1, 2))
    ]
    assert both.factor_flops == sum(one.flops for one in each)
    assert both.factor_entries == max(one.entries for one in each)
    quick = cost.estimate_cost(staged, solver="cholmod")
    assert both.seconds > quick.seconds
    assert both.memory - quick.memory == pytest.approx((24.0 - 8.0) * both.factor_entries)


def test_iterations_are_reckoned_with_where_a_factor_takes_too_much(monkeypatch):
    staged = excavation(1)
    factor = cost.estimate_cost(staged, solver="auto")
    monkeypatch.setattr(solvers, "MOST_ENTRIES", 1000)
    told = cost.estimate_cost(staged, solver="auto")
    assert (factor.solver == "iterative", told.solver) == (False, "iterative")
    assert told.factor_entries == factor.factor_entries
    twice = cost.estimate_cost(staged, solver="auto", columns=4)
    assert twice.seconds == pytest.approx(2 * told.seconds)  # two columns for one parameter
    # all grows with the unknowns: four times as many in a halved plane mesh
    finer = cost.refinement_cost(staged, told)
    assert finer.seconds == pytest.approx(4 * told.seconds)


def test_one_element_of_hardening_soil_takes_the_time_of_its_calls(tmp_path):
    """Which more elements share: halved ones take hardly longer."""
    law = "E50: 20 MPa, m: 0.5, cohesion: 1 kPa, friction: 35 deg"
    staged = model_at(element(tmp_path, law, pressed(0.002, 0.006), side=100e3))
    told = cost.estimate_cost(staged, solver="splu")
    assert told.seconds > 0.1
    assert cost.refinement_cost(staged, told).seconds < 1.5 * told.seconds
    assert told.yielding == ("ground",)
