"""Runs of one model do not know of each other: two at once are two one after the other."""

from __future__ import annotations

from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from support.cases import material, model, rollers
from support.meshes import box, regroup
from support.yielding import Cavity, constant, mohr, parameters, rock

from geoident.errors import CollapseError
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.plastic_step import PlasticSteps
from geoident.forward.analysis.stage import LastEquilibrium
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


def test_a_run_that_another_overtakes_factorizes_anew():
    """Two stages on the same ground share a factor, unless the other run took its place."""
    elastic = mohr(Scalar(1e3, "c"), 0.5)
    model = staged(elastic)
    model = CAVITY.staged(
        model.mesh, stages=STAGES, parameters=parameters(E=2e9, c=2.5e6),
        materials={"rock": rock(Scalar(1.0, "E"), 0.3)},
    )  # fmt: skip
    first, second = (model.at(p) for p in (HERE, THERE))
    before = model.counts.factorizations
    list(first.states())
    alone = model.counts.factorizations - before
    mixed = list(zip_longest(copies(model.at(HERE)), copies(second)))
    spent = model.counts.factorizations - before - alone
    assert alone < len(STAGES)
    assert 2 * alone <= spent <= 2 * len(STAGES)
    expected = list(copies(model.at(HERE)))
    for (found, _), wanted in zip(mixed, expected, strict=True):
        np.testing.assert_array_equal(found[0], wanted[0])


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


@pytest.fixture
def losing(monkeypatch):
    """Loses state 2 (`b`), on the way to which an equilibrium is told."""
    told = LastEquilibrium(np.full(24, 0.5), np.ones((4, 24)), np.arange(24) == 3)
    step = PlasticSteps.step

    def lost(self, task):
        if task.number == 2:
            error = CollapseError("lost", "", stage="b", fraction=0.2)
            error.reached = told
            raise error
        return step(self, task)

    monkeypatch.setattr(PlasticSteps, "step", lost)
    return told


def test_states_that_build_on_a_lost_one_are_lost_and_the_others_go_on(losing):
    found, run = {}, tree().at(np.array([1e9, 2e5]), RunOptions(partial=True))
    for end in run.states():
        found[end.state] = end.u.copy(), end.stress.copy(), end.yielded.copy(), end.last, end.forces
    known = {n: bool(np.isfinite(parts[0]).all()) for n, parts in found.items()}
    assert known == {0: True, 1: True, 2: False, 3: False, 4: True, 5: True, 6: False}
    for n in (2, 3, 6):
        u, stress, yielded, last, forces = found[n]
        assert np.isnan(u).all()
        assert np.isnan(stress).all()
        assert not yielded.any()
        assert forces is None
        assert (last is not None) == (n == 2)
    # that was found from the displacements of `a` on, without those of nodes that are new
    np.testing.assert_allclose(found[2][3].u, found[1][0][:, 0] + losing.u)
    assert found[2][3].stress is losing.stress
    assert [error.stage for error in run.findings.collapses] == ["b"]
    # `d` builds on `a`, and nothing happens in it
    np.testing.assert_allclose(found[4][0][:, 0], found[1][0][:, 0], atol=1e-12)


def test_a_lost_state_ends_a_run_that_is_to_be_whole(losing):
    run = tree().at(np.array([1e9, 2e5]))
    states = run.states()
    assert [next(states).state for _ in range(2)] == [0, 1]
    with pytest.raises(CollapseError):
        next(states)
    assert run.findings.collapses == ()
    assert losing is not None


@pytest.mark.parametrize(("last", "count"), [(None, 7), (0, 1), (3, 4), (6, 7)])
def test_a_run_ends_with_the_last_state_that_is_wanted(last, count):
    ends = list(tree().at(np.array([1e9, 2e5]), RunOptions(last=last)).states())
    assert [end.state for end in ends] == list(range(count))


def test_columns_are_those_of_the_parameters_that_are_asked_for():
    p = np.array([1e9, 2e5])
    for options, columns in ((RunOptions(), 3), (RunOptions(derivatives=False), 1)):
        run = tree().at(p, options)
        for end in run.states():
            assert end.u.shape[1] == end.stress.shape[2] == end.members.shape[1] == columns
            assert end.forces.shape[1] == columns
        assert len(run.point.names) == columns - 1
        assert run.given.names == ("E", "s")
        assert run.traces == []


def test_a_traced_run_keeps_what_adjoints_need():
    mesh = box("quad4", (2, 2))
    staged = model(
        mesh, parameters=parameters(E=1e9, s=2e5),
        materials={"rock": material("rock", Scalar(1.0, "E"), 0.3)}, groups={"all": "rock"},
        supports=rollers(2),
        in_situ=ConstantStress((Scalar(-1.0, "s"), Scalar(-2.0, "s"), *[Scalar(0.0)] * 4)),
        stages=(Stage("a"), Stage("b", loads={"p": PointForce((1.0, 1.0), (Scalar(1e4, "E"),
                                                                          Scalar(0.0)))})),
    )  # fmt: skip
    run = staged.at(np.array([1e9, 2e5]), RunOptions(traced=True))
    for end in run.states():
        assert end.u.shape[1] == 1
    assert [trace.task.number for trace in run.traces] == [0, 1, 2]
    assert [trace.stepped for trace in run.traces] == [False, True, True]
    virgin, *rest = run.traces
    np.testing.assert_allclose(virgin.in_situ[0], np.tile([0.0, -1.0], (16, 1)))
    np.testing.assert_allclose(virgin.in_situ[1], np.tile([0.0, -2.0], (16, 1)))
    assert all(trace.in_situ is None for trace in rest)
    top = np.flatnonzero((mesh.points == 1.0).all(axis=1))[0]
    assert rest[1].slopes[2 * top, 0] - rest[0].slopes[2 * top, 0] == pytest.approx(1e4)
    assert run.factors.find(staged.sequence.states[2]) is not None
    plain = staged.at(np.array([1e9, 2e5]))
    list(plain.states())
    assert plain.factors.find(staged.sequence.states[2]) is None
    assert plain.traces == []


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
    assert staged.analysis.imbalance(both, forces) == pytest.approx([1.0, 1.0])
    forces[2 * node + 1] = [1e6, 0.0]
    assert staged.analysis.imbalance(both, forces) == pytest.approx([1.0, 0.0])
    low = int(np.flatnonzero((staged.mesh.points == (2.0, 0.0)).all(axis=1))[0])
    forces[:] = 0.0
    forces[2 * low + 1] = 1e6  # what a support bears is no imbalance
    assert staged.analysis.imbalance(0.0 * both, forces) == pytest.approx([0.0, 0.0])


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


def test_half_of_the_ground_is_not_most():
    mesh = regroup(box("quad4", (2, 2)), dug=lambda c: c[:, 0] < 0.5)
    staged = model(
        mesh, materials={"rock": material("rock", 1e9, 0.3)},
        groups={"dug": "rock", "rock": "rock"}, supports=rollers(2),
        in_situ=constant(-1e5, 0.0), in_situ_of={"dug": constant(1e5, 0.0)}, stages=(Stage("s"),),
    )  # fmt: skip
    assert not staged.analysis.virgin_tension({})
