"""Lasting ground follows the rest: with the same states, derivatives and stresses (theory 2.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, rollers
from support.meshes import box, regroup

from geoident.fem.solvers.multifrontal import MultifrontalSolver
from geoident.forward.march import lasting
from geoident.forward.march.march import RunOptions
from geoident.forward.model import staged_model
from geoident.model.actions import PointForce
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Bolts

STAGES = ("first", "second", "third")
P = {"E": 8e9, "sz": -5e6, "nu": 0.25, "E_base": 9e9}
FORCE = (Scalar(0.0), Scalar(0.0), Scalar(-2e6))


@pytest.fixture(scope="module")
def mesh():
    """A block of 512 hexahedra with a drift in three rounds, the first of which gets a lining."""

    def part(low, high):
        return lambda c: (
            (abs(c[:, 0]) < 1) & (abs(c[:, 2] - 4) < 1) & (low < c[:, 1]) & (c[:, 1] < high)
        )

    rounds = {name: part(2 * k, 2 * k + 2) for k, name in enumerate(STAGES)}
    whole = regroup(box("hex8", (8, 8, 8), size=(8.0, 8.0, 8.0)), **rounds)
    base = regroup(whole, base=lambda c: c[:, 2] < 2.0).groups["base"]
    rock = np.setdiff1d(whole.groups["rock"], base)
    return replace(whole, groups=whole.groups | {"rock": rock, "base": base})


def drift(mesh, names=("E", "sz"), *, base="rock", **changes):
    """A drift under a constant stress, with parameters of these names."""

    def number(name):
        return Scalar(1.0, name) if name in names else Scalar(P[name])

    stress = (Scalar(-3e6), Scalar(-3e6), number("sz"), *[Scalar(0.0)] * 3)
    settings = {
        "parameters": tuple(
            Parameter(name, P[name], *sorted((0.5 * P[name], 1.5 * P[name]))) for name in names
        ),
        "materials": {
            "rock": material("rock", number("E"), number("nu"), 2500.0),
            "base": material("base", number("E_base"), 0.25),
            "concrete": material("concrete", 30e9, 0.2),
        },
        "groups": dict.fromkeys(("rock", *STAGES), "rock") | {"base": base},
        "supports": rollers(3),
        "in_situ": ConstantStress(stress, True),
        "stages": (
            Stage("first", excavate=("first",)),
            Stage("second", excavate=("second",)),
            Stage("third", excavate=("third",), install={"first": "concrete"}),
        ),
        "channels": (displacement("roof", (0.0, 1.0, 5.0), (0.0, 0.0, 1.0)),),
    }
    case = make_case(mesh, **(settings | changes))
    return staged_model(mesh, case, solver=MultifrontalSolver())


def states(model):
    """Copies of all states, and the entries of factors that each stage has passed."""
    p = np.array([P[name] for name in model.names])
    counts, found = model.systems.solver_counts, []
    before = counts.passed
    for end in model.at(p).states():
        spent, before = counts.passed - before, counts.passed
        found.append((end.u.copy(), end.stress.copy(), end.members.copy(), spent))
    return found


def alone(model):
    """The same of a model whose lasting ground is solved in every stage."""
    model.march.__dict__["lasting"] = None
    return states(model)


def compare(ours, theirs):
    """That all columns of displacements, stresses and forces of bars are the same."""
    for found, wanted in zip(ours, theirs, strict=True):
        for a, b in zip(found[:3], wanted[:3], strict=True):
            size = np.abs(b).reshape(-1, b.shape[-1]).max(axis=0, initial=0.0)
            # the stress of uniform rock does not depend on its modulus: that column is rounding
            rounding = 1e-13 * np.abs(b[..., :1]).max(initial=0.0) / 8e9
            assert np.all(np.abs(a - b) <= 1e-11 * size + rounding)


@pytest.fixture
def passes(mesh):
    """Entries passed in each stage by a plain drift, whose lasting ground follows, and without."""
    return [s[3] for s in states(drift(mesh))], [s[3] for s in alone(drift(mesh))]


def test_a_stage_passes_what_lasts_once_and_not_four_times(passes):
    """State and derivatives each take two passes; the rest of the factor is a part of it."""
    following, solved = passes
    for ours, whole in zip(following[1:], solved[1:], strict=True):
        assert ours < 0.65 * whole


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"groups": dict.fromkeys(("rock", *STAGES, "base"), "rock"), "gravity": (0.0, 0.0, -9.81)},
        {"names": ("sz",), "base": "base"},
        {
            "structures": {
                "bolts": Bolts((((1.0, 1.0, 5.0), (4.0, 1.0, 8.0)),), EA=Scalar(0.02, "E"))
            },
            "stages": (
                Stage("first", excavate=("first",), build=("bolts",)),
                Stage("second", excavate=("second",)),
                Stage("third", excavate=("third",), install={"first": "concrete"}),
            ),
        },
        {
            "stages": (
                Stage("first", excavate=("first",)),
                Stage("second", excavate=("second",), independent=True),
                Stage("third", excavate=("third",)),
            )
        },
    ],
    ids=["plain", "unbalanced weight", "two lasting materials", "bolts", "branches"],
)
def test_states_are_those_without_following(mesh, changes):
    ours, other = drift(mesh, **changes), drift(mesh, **changes)
    found, wanted = states(ours), alone(other)
    compare(found, wanted)
    assert sum(s[3] for s in found) < 0.8 * sum(s[3] for s in wanted)


def test_out_of_balance_inside_it_follows_from_the_first_stage_on(mesh, monkeypatch):
    """As the rounding of a mesh of other elements may leave it."""
    monkeypatch.setattr(lasting, "_VIRGIN", -1.0)
    found, wanted = states(drift(mesh)), alone(drift(mesh))
    compare(found, wanted)
    solved = [ours[3] == whole[3] for ours, whole in zip(found, wanted, strict=True)]
    assert solved == [True, True, False, False]  # the virgin state takes none


@pytest.mark.parametrize(
    ("names", "base"),
    [(("E", "nu"), "rock"), (("E", "E_base"), "base")],
    ids=["Poisson's ratio", "two moduli"],
)
def test_what_does_not_grow_in_proportion_does_not_follow(mesh, names, base):
    ours, other = drift(mesh, names, base=base), drift(mesh, names, base=base)
    found, wanted = states(ours), alone(other)
    compare(found, wanted)
    assert [s[3] for s in found] == [s[3] for s in wanted]


def test_a_load_on_what_lasts_is_solved_where_it_comes_and_goes(mesh):
    load = PointForce((6.5, 6.5, 8.0), FORCE)
    stages = (
        Stage("first", excavate=("first",)),
        Stage("second", excavate=("second",), loads={"pile": load}),
        Stage("third", excavate=("third",)),
        Stage("fourth", remove=("pile",)),
        Stage("fifth", install={"first": "concrete"}),
    )
    found, wanted = states(drift(mesh, stages=stages)), alone(drift(mesh, stages=stages))
    compare(found, wanted)
    solved = [ours[3] == whole[3] for ours, whole in zip(found, wanted, strict=True)]
    assert solved == [True, False, True, False, True, False]  # the virgin state takes none


@pytest.mark.parametrize(
    "second",
    [
        {"temperature": {"rock": Scalar(12.0)}},
        {"supports": {"z0": Support("z0", (2,), motions=((2, Scalar(-1e-3)),))}},
    ],
    ids=["warmth", "motion"],
)
def test_what_warms_or_moves_what_lasts_is_solved(mesh, second):
    warm = Material(
        "rock", Isotropic(E=Scalar(1.0, "E"), nu=Scalar(0.25)), Scalar(0.0), Scalar(1e-5)
    )
    changes = {
        "materials": {"rock": warm, "concrete": material("concrete", 30e9, 0.2)},
        "stages": (
            Stage("first", excavate=("first",)),
            Stage("second", excavate=("second",), **second),
            Stage("third", excavate=("third",)),
        ),
    }
    found, wanted = states(drift(mesh, **changes)), alone(drift(mesh, **changes))
    compare(found, wanted)
    solved = [ours[3] == whole[3] for ours, whole in zip(found, wanted, strict=True)]
    assert solved == [True, False, True, False]


def test_states_that_are_kept_give_their_stresses_later(mesh):
    kept_in, other = drift(mesh), drift(mesh)
    p = np.array([P[name] for name in kept_in.names])
    kept_in.survey(p, fields=False)
    kept, ends = kept_in.survey(p, fields=True).fields, []
    kept_in.computed(p, lambda end: ends.append(end.stress.copy()))
    wanted = alone(other)
    for state, (_, stress, _, _) in enumerate(wanted):
        np.testing.assert_allclose(ends[state][..., 0], stress[..., 0], rtol=1e-10, atol=1e-3)
    assert np.isfinite(kept.displacement).all()


def test_marches_with_unit_forces_solve_all(mesh):
    """Unit forces act anywhere, also where ground lasts."""
    model = drift(mesh)
    assert model.at(np.array([8e9, -5e6]), RunOptions(traced=True))._following is None
    assert model.at(np.array([8e9, -5e6]))._following is not None
