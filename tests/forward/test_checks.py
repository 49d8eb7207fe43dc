"""What is noted of a case on its mesh, with its numbers, and ground that nothing holds."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, model, rollers
from support.force_gauges import gauge
from support.meshes import box, regroup
from support.yielding import mohr, rock

from geoident.errors import InputError, ModelError
from geoident.forward.checks import (
    check_on_mesh,
    imbalance_notes,
    inadmissible_numbers,
    notes_on_mesh,
)
from geoident.model.actions import Water
from geoident.model.case import Analysis, Stage, Support
from geoident.model.parameter import Scalar

ROCK = material("rock", 1e9, 0.2)
QUIET = {"edges_held": False, "n_outside": 0, "in_tension": False}


def notes(mesh=None, *, said=QUIET, **changes):
    mesh = box("quad4", (3, 2)) if mesh is None else mesh
    settings = {
        "materials": {"rock": ROCK},
        "groups": {"all": "rock"},
        "supports": rollers(mesh.dim),
    }
    on_mesh, gauges = check_on_mesh(make_case(mesh, **{**settings, **changes}), mesh)
    return notes_on_mesh(on_mesh, gauges, **said)


def test_a_plain_case_has_no_notes():
    assert notes() == []


def test_what_is_told_is_noted():
    """Each of the three by itself."""
    (held,) = notes(said={**QUIET, "edges_held": True})
    assert held == (
        "the in-situ stress is held at the edges of the model by tractions (in_situ: held: true)"
    )
    (outside,) = notes(said={**QUIET, "n_outside": 7})
    assert outside.startswith("7 strain points lie beside the faces that give the level")
    (tension,) = notes(said={**QUIET, "in_tension": True})
    assert tension.startswith("at the start values the virgin ground is in tension: stresses are")


def test_a_density_that_is_sought_needs_gravity():
    sought = {"rock": replace(ROCK, density=Scalar(1.0, "rho"))}
    (note,) = notes(materials=sought)
    assert note.startswith("the density of 'rock' follows from rho and has no effect")
    assert notes(materials=sought, gravity=(0.0, -9.81)) == []
    assert notes(materials={"rock": replace(ROCK, density=Scalar(2600.0))}) == []


def test_nodes_on_the_axis_are_counted():
    axisymmetric = {"analysis": Analysis.AXISYMMETRIC, "supports": rollers(2)[1:]}
    (note,) = notes(box("quad8", (3, 2)), **axisymmetric)
    assert note == "5 nodes on the axis of revolution x = 0 are held radially (u_r = 0)"
    mesh = box("quad4", (3, 2))
    beside = replace(mesh, points=mesh.points + np.array([0.5, 0.0]))
    assert notes(beside, **axisymmetric) == []


def test_water_in_any_stage_makes_stresses_effective():
    said = "there is water in the pores: all stresses are effective stresses"
    water = Water(Scalar(0.5), Scalar(1e4))
    assert notes(water=water) == [said]
    assert notes(stages=(Stage("dry"), Stage("wet", water=water))) == [said]
    assert notes(stages=(Stage("dry"),)) == []


def test_points_just_outside_and_gauges_built_with_their_ground_are_named():
    near = displacement("near", (1.00001, 0.5), (1.0, 0.0))
    inside = displacement("inside", (0.4, 0.5), (1.0, 0.0))
    (note,) = notes(channels=(near, inside))
    assert note.startswith("points just outside the mesh, taken by the nearest element: ")
    assert "near" in note.rpartition(": ")[2]
    assert "inside" not in note.rpartition(": ")[2]


def test_tapes_through_ground_that_is_excavated_later_are_named():
    """Along the floor of an excavation, in ground that stays, and after it there is nothing odd."""
    mesh = regroup(
        box("quad4", (6, 4), size=(6.0, 4.0)),
        upper=lambda c: (np.abs(c[:, 0] - 3.0) < 1.0) & (c[:, 1] > 3.0),
        lower=lambda c: (np.abs(c[:, 0] - 3.0) < 1.0) & (abs(c[:, 1] - 2.5) < 0.5),
    )
    trench = {
        "groups": {"rock": "rock", "upper": "rock", "lower": "rock"},
        "stages": (Stage("first", excavate=("upper",)), Stage("second", excavate=("lower",))),
    }

    def tape(name, height, zero="virgin", kind="convergence"):
        return gauge(
            kind, name, (4.0, height), first=(2.0, height), direction=(1.0, 0.0), zero=zero,
            dimension="length", unit="mm",
        )  # fmt: skip

    right = (tape("top", 3.5, "first"), tape("floor", 3.0, "first"), tape("deep", 1.5),
             tape("low", 2.5, "second"), tape("rod", 3.5, kind="extensometer"))  # fmt: skip
    assert notes(mesh, **trench, channels=right) == []
    wrong = (tape("T", 3.5), tape("F", 3.0), tape("L", 2.5, "first"))
    of_virgin, of_first = notes(mesh, **trench, channels=(*right, *wrong))
    said = "when there is still ground between their points that is excavated later:"
    assert of_virgin.startswith(f"convergences zeroed at 'virgin', {said} T, F; if")
    assert of_first.startswith(f"convergences zeroed at 'first', {said} L; if")


def test_gravity_without_a_weight_and_meshes_in_millimetres():
    gravity = {"gravity": (0.0, -9.81)}
    said = "there is gravity, but no material has a density: nothing weighs"
    assert notes(**gravity) == [said]
    heavy = material("rock", 1e9, 0.2, 2e3)
    assert notes(**gravity, materials={"rock": heavy}) == []
    # one that nothing is made of does not count, one of several does
    unused = "no group is of the material 'lead': its constants, and parameters that only they "
    unused += "follow, have no effect"
    two = {"rock": ROCK, "lead": replace(heavy, name="lead")}
    assert notes(**gravity, materials=two) == [said, unused]
    mesh = regroup(box("quad4", (3, 2)), low=lambda c: c[:, 1] < 0.5)
    two = {"materials": {"rock": ROCK, "lead": replace(heavy, name="lead")},
           "groups": {"rock": "rock", "low": "lead"}}  # fmt: skip
    assert notes(mesh, **gravity, **two) == []
    (said,) = notes(box("quad4", (3, 2), size=(6000.0, 10.0)))
    assert said.startswith("the mesh is 6000 m by 10 m large")


def test_imbalance_is_noted_from_a_billionth_on():
    assert imbalance_notes(0.9e-9) == imbalance_notes(1e-9) == []
    (note,) = imbalance_notes(1.1e-9)
    assert note.startswith("the in-situ stress is out of balance by 1.1e-07 % of the largest nodal")
    assert imbalance_notes(0.0345)[0].startswith("the in-situ stress is out of balance by 3.45 %")


def test_materials_that_nothing_is_made_of_may_have_any_numbers():
    bad = material("bad", Scalar(1.0, "E"), 0.2)
    case = make_case(box("quad4", (1, 1)), materials={"rock": ROCK, "bad": bad})
    values = {"E": -1.0}
    used, unused = SimpleNamespace(materials=("rock", "bad")), SimpleNamespace(materials=("rock",))
    assert inadmissible_numbers(case, unused, values) is None
    assert inadmissible_numbers(case, used, {"E": 1e9}) is None
    assert inadmissible_numbers(case, used, values).startswith("E of bad is -1")
    weak = rock(1e9, 0.2, mohr(Scalar(1.0, "c"), 0.5))
    case = replace(case, materials={"rock": weak})
    assert inadmissible_numbers(case, unused, {"c": 1.0}) is None
    assert "cohesion of rock" in inadmissible_numbers(case, unused, {"c": -1.0})


def blocks():
    """Two squares of four elements each, one on the other, in three groups."""
    mesh = box("quad4", (2, 4), size=(2.0, 4.0))
    return regroup(mesh, low=lambda c: c[:, 1] < 1, mid=lambda c: c[:, 1] < 2)


HELD = (Support("y0", (0, 1)),)
ALL = {"low": "rock", "mid": "rock", "rock": "rock"}


def refused(*stages, groups=None, supports=HELD):
    with pytest.raises(ModelError) as caught:
        model(blocks(), materials={"rock": ROCK}, groups=groups or ALL, supports=supports,
              stages=stages)  # fmt: skip
    return caught.value.fault


def test_a_piece_that_a_stage_cuts_loose():
    fault = refused(Stage("wait"), Stage("cut", excavate=("mid",)))
    assert fault.message == (
        "at stage 'cut' 4 elements of 'rock' near (1, 3) m can move along x and y freely: nothing "
        "holds the piece"
    )
    assert fault.path == "stages[1]"
    assert fault.hint.startswith("See whether what this stage takes away cuts the piece loose")


@pytest.mark.parametrize(
    ("supports", "how"),
    [
        ((Support("y0", (1,)),), "move along x"),
        ((Support("x0", (0,)),), "move along y"),
        ((Support("middle", (0, 1), at=(1.0, 2.0)),), "turn"),
        ((), "move along x and y"),
    ],
)
def test_ground_that_is_not_held_from_the_beginning(supports, how):
    fault = refused(supports=supports)
    assert fault.message == (
        f"at stage 'virgin' 8 elements of 'low', 'mid', 'rock' near (1, 2) m can {how} freely: "
        "nothing holds the piece"
    )
    assert fault.path == "supports"
    assert fault.hint.startswith("Hold it by 'supports': groups on its edge")


def test_one_element_is_one_element():
    mesh = regroup(box("quad4", (1, 3), size=(1.0, 3.0)), low=lambda c: c[:, 1] < 1,
                   mid=lambda c: c[:, 1] < 2)  # fmt: skip
    with pytest.raises(ModelError, match=r"'cut' 1 element of 'rock' near \(0.5, 2.5\) m can"):
        model(mesh, materials={"rock": ROCK}, groups=ALL, supports=HELD,
              stages=(Stage("cut", excavate=("mid",)),))  # fmt: skip


def test_support_that_lets_go_is_a_mechanism_of_its_stage():
    fault = refused(Stage("wait"), Stage("go", supports={"y0": None}))
    assert fault.message.startswith("at stage 'go' 8 elements")
    fault = refused(Stage("go", supports={"y0": None}), Stage("again", supports={"y0": HELD[0]}))
    assert fault.path == "stages[0]"


def test_fill_on_a_rigid_base_and_ground_that_never_is():
    none = dict.fromkeys(ALL)
    fill = Stage("fill", install={"low": "rock"})
    made = model(blocks(), materials={"rock": ROCK}, groups=none, supports=HELD,
                 stages=(Stage("wait"), fill))  # fmt: skip
    assert len(made.sequence.states) == 3
    for stages, place in (
        ((), "groups"),
        ((Stage("wait"),), "groups"),
        ((Stage("wait"), fill, Stage("dig", excavate=("low",))), "stages[2]"),
    ):
        with pytest.raises(InputError) as caught:
            model(blocks(), materials={"rock": ROCK}, groups=none, supports=HELD, stages=stages)
        (fault,) = [f for f in caught.value.faults if f.code == "no-ground"]
        assert fault.path == place


def test_a_group_that_the_mesh_lacks_is_said_with_points_outside():
    mesh = blocks()
    far = displacement("far", (9.0, 9.0), (1.0, 0.0))
    settings = {"materials": {"rock": ROCK}, "groups": ALL, "supports": HELD, "channels": (far,)}
    lacking = make_case(mesh, **{**settings, "groups": {**ALL, "roof": "rock"}})
    with pytest.raises(InputError) as caught:
        check_on_mesh(lacking, mesh)
    codes = [fault.code for fault in caught.value.faults]
    assert "missing-group" in codes
    assert len(codes) == 2  # and the gauge
