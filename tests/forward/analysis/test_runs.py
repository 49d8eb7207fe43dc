"""Runs of one model do not know of each other: two at once are two one after the other."""

from __future__ import annotations

from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from support.cases import material, model
from support.meshes import box, regroup
from support.yielding import Cavity, constant, mohr, parameters, rock

from geoident.errors import CollapseError
from geoident.forward.analysis.analysis import RunOptions
from geoident.model.actions import PointForce
from geoident.model.case import Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Scalar

CAVITY = Cavity(pressure=10e6)
STAGES = (
    Stage("part", excavate=("core",), release={"core": Scalar(0.6)}),
    Stage("all", release={"core": Scalar(1.0)}),
    Stage("same ground", loads={"p": PointForce((0.0, 2.0), (Scalar(0.0), Scalar(1e4)))}),
)
HERE, THERE = np.array([2e9, 2.5e6]), np.array([3e9, 8e6])


def staged(surface, stages=STAGES):
    mesh = CAVITY.mesh("quad8", n=3, layers=10, reach=8)
    ground = replace(rock(Scalar(1.0, "E"), 0.3, surface))
    return CAVITY.staged(
        mesh, stages=stages, parameters=parameters(E=2e9, c=2.5e6), materials={"rock": ground}
    )


def copies(run):
    """Displacements, stresses and what yields, state by state."""
    for end in run.states():
        yield end.u.copy(), end.stress.copy(), end.yielded.copy()


SURFACES = {
    "elastic": mohr(Scalar(1e3, "c"), 0.5),
    "polyhedral": mohr(Scalar(1.0, "c"), 0.5, planes=12),
    "smooth": mohr(Scalar(1.0, "c"), 0.5),
    "not associated": mohr(Scalar(1.0, "c"), 0.5, psi=0.3),
}


@pytest.mark.parametrize("name", SURFACES)
def test_two_runs_at_once_equal_two_one_after_the_other(name):
    alone = [list(copies(staged(SURFACES[name]).at(p))) for p in (HERE, THERE)]
    model = staged(SURFACES[name])
    runs = [model.at(p) for p in (HERE, THERE)]
    mixed = list(zip_longest(*map(copies, runs)))
    assert len(mixed) == 1 + len(STAGES)
    for states, expected in zip(zip(*mixed, strict=True), alone, strict=True):
        for found, wanted in zip(states, expected, strict=True):
            for one, other in zip(found, wanted, strict=True):
                scale = np.abs(other).max(initial=0.0)
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * scale)
    findings = [run.findings.plastic.planes.activity() for run in runs]
    assert not np.array_equal(findings[0].distances, findings[1].distances)
    for p, found in zip((HERE, THERE), findings, strict=True):
        lone = staged(SURFACES[name]).at(p)
        list(lone.states())
        np.testing.assert_array_equal(found.points, lone.findings.plastic.planes.activity().points)
        np.testing.assert_allclose(
            found.reached, lone.findings.plastic.planes.activity().reached, rtol=1e-9
        )


def test_collapses_belong_to_the_run_that_met_them():
    model = staged(mohr(Scalar(1.0, "c"), 0.0))
    weak, strong = np.array([2e9, 0.05e6]), np.array([2e9, 50e6])
    options = RunOptions(explain=False, partial=True)
    runs = [model.at(p, options) for p in (weak, strong)]
    for _ in zip_longest(*(run.states() for run in runs)):
        pass
    assert len(runs[0].findings.collapses) == 1
    assert isinstance(runs[0].findings.collapses[0], CollapseError)
    assert runs[1].findings.collapses == ()


# --- what a run does with states that are lost ---


def tree():
    """A box of two materials on which six stages build as a tree; E and the stress are free."""
    mesh = regroup(box("quad4", (3, 2), size=(3.0, 2.0)), dug=lambda c: c[:, 0] < 1.0)
    return model(
        mesh,
        parameters=parameters(E=1e9, s=2e5),
        materials={"rock": rock(Scalar(1.0, "E"), 0.3, mohr(1e9, 0.3))},
        groups={"dug": "rock", "rock": "rock"},
        supports=(Support("y0", (1,)), Support("x1", (0,))),
        in_situ=ConstantStress((Scalar(-1.0, "s"), Scalar(-1.0, "s"), *[Scalar(0.0)] * 4)),
        stages=(
            Stage("a", excavate=("dug",)),
            Stage("b", install={"dug": "rock"}),
            Stage("c", independent=True),
            Stage("d", base="a"),
            Stage("e"),
            Stage("f", base="b"),
        ),
    )


@pytest.mark.parametrize(("last", "count"), [(None, 7), (0, 1), (3, 4), (6, 7)])
def test_a_run_ends_with_the_last_state_that_is_wanted(last, count):
    ends = list(tree().at(np.array([1e9, 2e5]), RunOptions(last=last)).states())
    assert [end.number for end in ends] == list(range(count))


def test_columns_are_those_of_the_parameters_that_are_asked_for():
    p = np.array([1e9, 2e5])
    for options, columns in ((RunOptions(), 3), (RunOptions(derivatives=False), 1)):
        run = tree().at(p, options)
        for end in run.states():
            assert end.u.shape[1] == end.stress.shape[2] == end.members.shape[1] == columns
            assert end.forces.shape[1] == columns
        assert len(run.point.names) == columns - 1
        assert run.full_point.names == ("E", "s")
        assert run.traces == []


# --- the virgin state ---


def virgin(*stress, held=None, **changes):
    mesh = regroup(box("quad4", (3, 2), size=(3.0, 2.0)), dug=lambda c: c[:, 0] < 1.0)
    settings = {
        "materials": {"rock": material("rock", 1e9, 0.3)},
        "groups": {"dug": "rock", "rock": "rock"},
        "supports": (Support("y0", (1,)), Support("x1", (0,))),
        "in_situ": constant(*stress, held=held),
        "stages": (Stage("s"),),
    }
    return model(mesh, **{**settings, **changes})


def test_the_imbalance_is_the_largest_free_force_in_parts_of_those_at_work():
    """-2 MPa along x, free at x = 0: nodes there bear 1 m or half of it, of cells of 1 m."""
    staged = virgin(-2e6, 0.0, held=False)
    stress, part = staged.analysis.virgin(ParameterPoint({}, ()))
    np.testing.assert_allclose(stress[0], -2e6)
    assert part == pytest.approx([1.0])  # the forces inside cancel
    held = virgin(-2e6, 0.0)
    assert held.analysis.virgin(ParameterPoint({}, ()))[1] == pytest.approx([0.0], abs=1e-12)
    forces = np.zeros((24, 2))
    node = int(np.flatnonzero((staged.mesh.points == (2.0, 1.0)).all(axis=1))[0])
    forces[2 * node + 1] = [8e6, -1e6]
    both = np.concatenate([stress, 0.0 * stress], axis=2)
    # in parts of the largest force: that of the load, or the 2 MN inside
    none = np.empty((0, 2))  # tractions on interfaces
    assert staged.analysis.imbalance(both, forces, none) == pytest.approx([1.0, 1.0])
    forces[2 * node + 1] = [1e6, 0.0]
    assert staged.analysis.imbalance(both, forces, none) == pytest.approx([1.0, 0.0])
    low = int(np.flatnonzero((staged.mesh.points == (2.0, 0.0)).all(axis=1))[0])
    forces[:] = 0.0
    forces[2 * low + 1] = 1e6  # what a support bears is no imbalance
    assert staged.analysis.imbalance(0.0 * both, forces, none) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(
    ("rock_stress", "dug", "groups", "pulled"),
    [
        (-1e5, 2e5, {"dug": "rock", "rock": "rock"}, False),  # a third of the ground is
        (1e5, -2e5, {"dug": "rock", "rock": "rock"}, True),
        (-1e5, 2e5, {"dug": None, "rock": "rock"}, False),
        (0.0, 0.0, {"dug": "rock", "rock": "rock"}, False),
    ],
)
def test_most_of_the_virgin_ground_may_be_pulled(rock_stress, dug, groups, pulled):
    """By the sum of the three normal stresses, whatever the shear."""
    zones = {"dug": constant(dug, 0.0, 0.0, -9e9)} if groups["dug"] else {}
    staged = virgin(
        0.5 * rock_stress, 2.0 * rock_stress, -1.5 * rock_stress, -9e9,
        in_situ_of=zones, groups=groups,
    )  # fmt: skip
    assert staged.analysis.virgin_tension({}) == pulled
