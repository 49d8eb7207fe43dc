"""Who is there when, on which mesh: states stage by stage, groups, places in arrays."""

from dataclasses import replace

import numpy as np
import pytest
from support.cases import make_case, material
from support.meshes import box, regroup

from geoident.forward.stages import (
    CaseOnMesh,
    element_number,
    group_faults,
    released_by,
    used_groups,
)
from geoident.model.actions import FaceDistance, Pressure, Water
from geoident.model.case import VIRGIN, Stage, Support
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Scalar
from geoident.model.structures import Bars, Beam

# --- states ---


def grid(**changes):
    """Four cells in a row, one group each, and a case of three materials on them."""
    mesh = box("quad4", (4, 1), size=(4.0, 1.0))
    mesh = regroup(mesh, **{n: lambda c, k=k: np.floor(c[:, 0]) == k for k, n in enumerate("abcd")})
    mesh.groups.pop("rock")
    settings = {
        "materials": {name: material(name, 1e9, 0.3) for name in ("clay", "sand", "steel")},
        "groups": {"a": "clay", "b": "sand", "c": None, "d": "clay"},
        "supports": (Support("x0", (0,)), Support("y0", (1,))),
    }
    case = make_case(mesh, **{**settings, **changes})
    return CaseOnMesh(case, mesh)


def bars(force=None):
    prestress = None if force is None else Scalar(force)
    return Bars((((0.0, 0.0), (1.0, 0.0)),), Scalar(1.0), EA=Scalar(1e8), prestress=prestress)


P, Q = Pressure("y1", Scalar(1.0)), Pressure("y1", Scalar(2.0))
WET, WETTER = Water(Scalar(1.0), Scalar(9.81e3)), Water(Scalar(2.0), Scalar(9.81e3))
WARM, HOT = Scalar(10.0), Scalar(20.0)


def test_ground_comes_changes_and_goes():
    found = grid(
        stages=(
            Stage("dig", excavate=("a", "c"), install={"b": "steel"}),
            Stage("fill", install={"c": "sand"}, change={"d": "sand"}),
            Stage("case", excavate=("d",), independent=True),
            Stage("on", install={"a": "clay"}),
            Stage("aside", excavate=("b",), base="dig"),
            Stage("end"),
        )
    ).sequence
    assert found.groups == ("a", "b", "c", "d")
    np.testing.assert_array_equal(found.group_of, [0, 1, 2, 3])
    virgin, dig, fill, case, on, aside, end = found.states
    assert virgin.name == VIRGIN
    assert virgin.materials == {0: "clay", 1: "sand", 3: "clay"}
    assert (virgin.base, virgin.placed, virgin.leaving) == (0, frozenset(), frozenset())
    assert dig.materials == {1: "steel", 3: "clay"}
    assert (dig.placed, dig.leaving) == ({1}, {0})  # `c` was not there
    assert fill.materials == {1: "steel", 2: "sand", 3: "sand"}
    assert (fill.placed, fill.leaving) == ({2}, frozenset())
    assert case.materials == {1: "steel", 2: "sand"}
    assert on.materials == {0: "clay", 1: "steel", 2: "sand", 3: "sand"}
    assert aside.materials == {3: "clay"}
    assert end.materials == aside.materials
    bases = [0, 0, 1, 2, 2, 1, 5]
    assert found.bases.tolist() == bases
    assert [state.base for state in found.states] == bases
    assert found.present(1).tolist() == [False, True, False, True]
    assert found.present(4).all()
    assert found.elements(2).tolist() == [2]
    assert found.materials == ("clay", "sand", "steel")
    built_on = found.built_on
    for state in range(7):
        history, at = {state}, state
        while at:
            at = bases[at]
            history.add(at)
        assert set(np.flatnonzero(built_on[:, state])) == history


def test_what_acts_is_known_with_the_state_since_which_it_does():
    first, second = Support("x0", (0,)), Support("y0", (1,))
    moved = Support("x0", (0,), motions=((0, Scalar(0.01)),))
    found = grid(
        loads={"p": P, "q": P},
        water=WET,
        stages=(
            Stage("more", loads={"r": P, "q": Q}, temperature={"a": WARM, "d": WARM}),
            Stage("less", remove=("p",), water=WETTER, supports={"x0": moved}),
            Stage("dig", excavate=("a",), install={"d": "sand"}, supports={"y0": None}),
            Stage("warm", temperature={"d": HOT}, loads={"r": Q}),
        ),
    ).sequence.states
    virgin, more, less, dig, warm = found
    assert (virgin.loads, virgin.loads_since) == ({"p": P, "q": P}, {"p": 0, "q": 0})
    assert (virgin.supports, virgin.held_since) == ({"x0": first, "y0": second}, {"x0": 0, "y0": 0})
    assert (more.loads, more.loads_since) == ({"p": P, "q": Q, "r": P}, {"p": 0, "q": 1, "r": 1})
    assert (less.loads, less.loads_since) == ({"q": Q, "r": P}, {"q": 1, "r": 1})
    assert (warm.loads, warm.loads_since) == ({"q": Q, "r": Q}, {"q": 1, "r": 4})
    assert [state.water for state in found] == [WET, WET, WETTER, WETTER, WETTER]
    temperatures = [state.temperature for state in found]
    assert temperatures == [{}, {0: WARM, 3: WARM}, {0: WARM, 3: WARM}, {}, {3: HOT}]
    assert (less.supports, less.held_since) == (
        {"y0": second, "x0": moved}, {"y0": 0, "x0": 2}
    )  # fmt: skip
    assert (dig.supports, dig.held_since) == ({"x0": moved}, {"x0": 2})
    assert virgin.held == {("x0", (0,)), ("y0", (1,))}
    assert dig.held == {("x0", (0,))}


def test_structures_are_built_pulled_locked_and_taken_away():
    found = grid(
        structures={"tie": bars(5e4), "strut": bars(), "wall": Beam("y1", E=Scalar(1e9))},
        stages=(
            Stage("build", build=("tie", "wall")),
            Stage("on", build=("strut",)),
            Stage("pull", prestress={"tie": Scalar(7e4), "strut": Scalar(1e4)}),
            Stage("rest"),
            Stage("again", dismantle=("tie",), build=("strut",)),
            Stage("end"),
        ),
    ).sequence.states
    _, build, on, pull, rest, again, end = found
    first, second, third = Scalar(5e4), Scalar(7e4), Scalar(1e4)
    assert (build.structures, build.built) == ({"tie", "wall"}, {"tie", "wall"})
    assert (build.stressed, build.locked) == ({"tie": first}, {})
    assert (on.stressed, on.locked) == ({}, {"tie": first})
    assert (pull.stressed, pull.locked) == ({"tie": second, "strut": third}, {})
    assert (rest.stressed, rest.locked) == ({}, {"tie": second, "strut": third})
    assert (again.structures, again.built) == ({"wall", "strut"}, {"strut"})
    assert (again.stressed, again.locked) == ({}, {})  # what is built anew has no force
    assert end.locked == {}


def test_what_is_released_counts_until_the_group_leaves_again():
    half, most, whole = Scalar(0.5), Scalar(0.8), Scalar(1.0)
    found = grid(
        stages=(
            Stage("half", excavate=("a", "b"), release={"a": half, "b": most}),
            Stage("back", install={"a": "sand"}),
            Stage("out", excavate=("a",)),
            Stage("whole", release={"b": whole}),
        )
    ).sequence.states
    assert [state.release for state in found] == [
        {}, {0: half, 1: most}, {0: half, 1: most}, {1: most}, {1: whole}
    ]  # fmt: skip


def test_the_distance_to_the_face_releases_its_groups_unless_a_stage_says_otherwise():
    on_mesh = grid()
    stage = Stage("on", distance=Scalar(3.0), release={"b": Scalar(0.5)})
    assert released_by(stage, on_mesh.case) == {"b": Scalar(0.5)}
    face = type("Face", (), {"groups": ("a", "b")})()
    case = replace(on_mesh.case, face=face)
    assert released_by(stage, case) == {"a": FaceDistance(Scalar(3.0)), "b": Scalar(0.5)}
    assert released_by(Stage("off"), case) == {}


# --- groups and places ---


def test_groups_are_those_of_the_case_with_the_key_that_names_them_first():
    case = grid(
        groups={"a": "clay"},
        stages=(
            Stage("one", excavate=("a", "b"), install={"c": "sand"}),
            Stage("two", change={"c": "clay", "d": "clay"}, temperature={"e": WARM, "b": WARM}),
        ),
    ).case
    assert used_groups(case) == {
        "a": ("groups", "a"),
        "b": ("stages", 0, "excavate", 1),
        "c": ("stages", 0, "install", "c"),
        "d": ("stages", 1, "change", "d"),
        "e": ("stages", 1, "temperature", "e"),
    }


def test_groups_that_the_mesh_lacks_are_named_with_those_that_it_has():
    on_mesh = grid(groups={"a": "clay", "z": "sand"}, stages=(Stage("s", excavate=("y",)),))
    first, second = group_faults(on_mesh)
    assert (first.code, first.path) == ("missing-group", "groups.z")
    assert first.message == f"the mesh {on_mesh.mesh.file} has no element group 'z'"
    assert first.hint == "its element groups: a, b, c, d"
    assert second.path == "stages[0].excavate[0]"


def test_a_group_of_edges_or_nodes_is_no_ground():
    on_mesh = grid(groups={"a": "clay", "wall": "sand", "pin": "sand"})
    some = np.array([0])
    mesh = replace(on_mesh.mesh, facet_groups={"wall": some}, node_groups={"pin": some})
    wall, pin = group_faults(replace(on_mesh, mesh=mesh))
    assert "'wall' is a group of edges of the mesh" in wall.hint
    assert "{kind: beam, on: wall," in wall.hint
    assert pin.hint.startswith("'pin' is a group of nodes of the mesh")


def test_elements_in_no_group_and_in_several_are_counted_and_listed():
    """Elements keep the numbers of the user; five of them are listed."""
    mesh = box("quad4", (8, 1))
    numbered = ElementBlock("quad4", mesh.blocks[0].nodes, np.arange(11, 19))
    groups = {"a": np.array([0, 1]), "b": np.array([1, 0]), "spare": np.arange(3, 8)}
    mesh = replace(mesh, blocks=(numbered,), groups=groups)
    case = make_case(mesh, groups={"a": "clay", "b": "clay"})
    none, several = group_faults(CaseOnMesh(case, mesh))
    absent = "; a group that is never present is written 'NAME: absent'"
    assert {none.code, several.code} == {"group-coverage"}
    assert {none.path, several.path} == {"groups"}
    assert none.message == (
        f"6 elements of {mesh.file} are in none of the groups of the case (in the mesh they are "
        "in: spare); first: 13, 14, 15, 16, 17"
    )
    assert none.hint == f"list their group under 'groups'{absent}"
    assert CaseOnMesh(case, mesh).sequence.group_of[2:].tolist() == [-1] * 6
    assert several.message == (
        f"2 elements of {mesh.file} are in several groups of the case (in the mesh they are in: "
        "a, b); first: 11, 12"
    )
    assert several.hint == f"give every element to one group{absent}"
    nameless = replace(mesh, groups={"a": np.array([0, 1]), "b": np.arange(2, 7)})
    (fault,) = group_faults(CaseOnMesh(case, nameless))
    assert "1 elements" in fault.message
    assert "in the mesh" not in fault.message


def test_elements_are_numbered_block_by_block():
    points = np.zeros((4, 2))
    triangles = ElementBlock("tri3", np.zeros((3, 3), dtype=int), np.array([7, 5, 9]))
    squares = ElementBlock("quad4", np.zeros((2, 4), dtype=int), np.array([40, 30]))
    mesh = Mesh(points, (triangles, squares))
    assert [element_number(mesh, e) for e in range(5)] == [7, 5, 9, 40, 30]
    with pytest.raises(IndexError, match=r"^no such element$"):
        element_number(mesh, 5)


def test_a_point_is_in_ground_of_a_material_or_it_is_said_where_it_is():
    on_mesh = grid(stages=(Stage("fill", install={"c": "steel"}),))
    assert on_mesh.not_in("clay", (0.5, 0.5)) is None
    assert on_mesh.not_in("steel", (2.5, 0.5)) is None
    assert on_mesh.not_in("clay", (1.5, 0.5)) == "lies in the group 'b'"
    assert on_mesh.not_in("clay", (1.0, 0.5)) is None  # on the line between them
    assert on_mesh.not_in("sand", (4.5, 0.5)) == f"is not in the mesh {on_mesh.mesh.file}"
    made_of = {m: on_mesh.material_points(m) for m in ("clay", "sand", "steel")}
    element = on_mesh.discretization.points.element
    assert {m: sorted(set(element[p].tolist())) for m, p in made_of.items()} == {
        "clay": [0, 3], "sand": [1], "steel": [2]
    }  # fmt: skip
    assert on_mesh.material_points("clay") is made_of["clay"]


def test_boundaries_are_those_of_all_ground_of_a_material():
    """Cells of 1 m: clay has two pieces with four sides each, sand one; nothing is of steel."""
    on_mesh = grid()
    sides = {m: sum(len(p.nodes) for p in parts) for m, parts in on_mesh.boundaries.items()}
    assert sides == {"clay": 8, "sand": 4}
    assert sum(len(patch.nodes) for patch in on_mesh.outline) == 10
    nowhere = CaseOnMesh(on_mesh.case, replace(on_mesh.mesh, blocks=()))
    assert nowhere.boundaries == {}


def test_points_of_absent_elements_have_no_volume():
    on_mesh = grid(stages=(Stage("dig", excavate=("a",)),))
    ground = on_mesh.discretization
    volume = ground.volume(on_mesh.sequence.present(1))
    assert volume.sum() == pytest.approx(2.0)
    assert volume[ground.points.element == 0].sum() == 0.0
    assert set(ground.points_of) == {0, 1, 3}
    assert ground.n_dofs == 20
