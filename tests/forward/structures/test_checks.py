"""What is said of structures that do not find their mesh or their ground, word by word."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import make_case, material, rollers
from support.meshes import box, regroup
from support.tunnels import with_lines

from geoident.errors import InputError
from geoident.forward.checks import check_on_mesh
from geoident.forward.structures.checks import structure_notes
from geoident.forward.structures.members import inadmissible
from geoident.model.case import Analysis, Stage, Support
from geoident.model.parameter import Scalar
from geoident.model.structures import Anchors, Beam, Bolts, Struts

ONE = Scalar(1e8)
BUILT = (Stage("wait"), Stage("build", build=("it",)), Stage("go on", excavate=("pit",)))


def _mesh():
    """Six by four cells of a metre with a pit of two at the left top, and a line along y = 2."""
    mesh = regroup(
        box("quad4", (6, 4), size=(6.0, 4.0)), pit=lambda x: (x[:, 0] < 2.0) & (x[:, 1] > 3.0)
    )
    x, y = mesh.points.T

    def line(nodes, by):
        nodes = nodes[np.argsort(mesh.points[nodes, by])]
        return np.stack([nodes[:-1], nodes[1:]], axis=1)

    found = with_lines(mesh, "middle", line(np.flatnonzero(np.abs(y - 2.0) < 0.1), 0))
    found = with_lines(found, "roof", line(np.flatnonzero(y > 3.9), 0))
    found = with_lines(found, "axis", line(np.flatnonzero(x < 0.1), 1)[1:3])
    return replace(found, node_groups={"corner": np.array([0])})


def _case(mesh, structures, **changes):
    settings = {"materials": {"rock": material("rock", 1e9, 0.25)},
                "groups": {"rock": "rock", "pit": "rock"}, "supports": rollers(2),
                "structures": structures, "stages": BUILT}  # fmt: skip
    return make_case(mesh, **{**settings, **changes})


def _faults(structure, **changes):
    mesh = _mesh()
    with pytest.raises(InputError) as error:
        check_on_mesh(_case(mesh, {"it": structure}, **changes), mesh)
    return [(f.code, f.path, f.message, f.hint) for f in error.value.faults]


PLACE = "correct the place, or 'dismantle' the structure before its ground is gone"


@pytest.mark.parametrize(
    ("structure", "path", "where", "stage"),
    [
        (Beam("roof", EA=ONE, EI=ONE), "on", "2 nodes, the first near (0, 4) m, lie", "go on"),
        (Bolts((((1.5, 2.5), (3.0, 2.5)), ((3.0, 1.0), (1.0, 3.5))), EA=ONE, spacing=Scalar(1.0)),
         "ends[1][1]", "the end (1, 3.5) m lies", "go on"),
        (Struts((((9.0, 1.0), (3.0, 3.5)),), EA=ONE, spacing=Scalar(1.0)),
         "ends[0][0]", "the end (9, 1) m lies", "build"),
        (Struts((((3.0, 1.0), (9.0, 3.5)),), EA=ONE, spacing=Scalar(1.0), second_end="fixed"),
         None, None, None),
        (Anchors((((1.5, 3.5), (4.0, 1.0)),), EA=ONE, spacing=Scalar(1.0), grouted=1.0),
         "ends[0][0]", "the head (1.5, 3.5) m lies", "go on"),
        (Anchors((((3.0, 1.0), (3.0, -1.0)),), EA=ONE, spacing=Scalar(1.0), grouted=1.0),
         "ends[0][1]", "the grouted length at (3, -0.", "build"),
    ],
)  # fmt: skip
def test_structures_whose_ground_is_gone(structure, path, where, stage):
    if path is None:
        mesh = _mesh()
        check_on_mesh(_case(mesh, {"it": structure}), mesh)
        return
    ((code, key, message, hint),) = _faults(structure)
    assert (code, key, hint) == ("no-ground-there", f"structures.it.{path}", PLACE)
    assert message.startswith(f"at stage '{stage}' the structure 'it' stands, but ")
    assert message.endswith(" in no ground that is present")
    assert where in message


def test_a_bar_needs_the_same_ground_as_long_as_it_stands():
    """The ground at its end is there at every stage, but it is another each time."""
    mesh = regroup(
        box("quad4", (6, 4), size=(6.0, 4.0)),
        left=lambda x: (x[:, 0] < 2.0) & (x[:, 1] > 3.0),
        right=lambda x: (x[:, 0] > 2.0) & (x[:, 0] < 3.0) & (x[:, 1] > 3.0),
    )
    bolt = Bolts((((4.0, 1.0), (2.0, 3.5)),), EA=ONE, spacing=Scalar(1.0))
    case = _case(
        mesh, {"it": bolt}, groups={"rock": "rock", "left": "rock", "right": None},
        stages=(Stage("build", build=("it",)),
                Stage("swap", excavate=("left",), install={"right": "rock"})),
    )  # fmt: skip
    with pytest.raises(InputError) as error:
        check_on_mesh(case, mesh)
    (fault,) = error.value.faults
    assert fault.message == (
        "the end (2, 3.5) m lies in no ground that is present at all stages at which the structure "
        "'it' stands: build, swap"
    )


def test_hinges_and_groups_that_are_not_on_the_beam():
    beam = Beam("middle", EA=ONE, EI=ONE, clamped_on=("x0", "nothing"),
                hinges=((3.0, 2.0), (3.2, 2.1), "y0", "none"))  # fmt: skip
    mesh = _mesh()
    hint = "its groups: " + ", ".join(sorted({*mesh.facet_groups, *mesh.node_groups, *mesh.groups}))
    found = _faults(beam)
    name = mesh.file
    assert found == [
        ("missing-group", "structures.it.clamped_on[1]", f"the mesh {name} has no group 'nothing'",
         hint),
        ("missing-group", "structures.it.hinges[3]", f"the mesh {name} has no group 'none'", hint),
    ]  # fmt: skip
    assert _faults(replace(beam, group="walls", clamped_on=(), hinges=())) == [
        ("missing-group", "structures.it.on", f"the mesh {name} has no group 'walls' of lines",
         "its groups: " + ", ".join(sorted(mesh.facet_groups))),
    ]  # fmt: skip
    where = "a hinge stands at a node of the beam, where two of its pieces meet"
    assert _faults(replace(beam, clamped_on=("x0",), hinges=beam.hinges[:3])) == [
        ("no-hinge-there", "structures.it.hinges[1]",
         "the hinge (3.2, 2.1) m is at no node of the beam 'it'; its nearest node is (3, 2) m",
         where),
        ("no-hinge-there", "structures.it.hinges[2]",
         "no node of the group 'y0' lies on the beam 'it'", where),
    ]  # fmt: skip


def test_a_shell_on_the_axis_itself_and_a_weight_where_nothing_weighs():
    found = _faults(Beam("axis", EA=ONE, EI=ONE, nu=Scalar(0.2)), analysis=Analysis.AXISYMMETRIC)
    assert [f for f in found if f[0] == "on-the-axis"] == [
        ("on-the-axis", "structures.it.on",
         "2 pieces of the beam 'it' lie on the axis x = 0, where a shell of revolution has no "
         "radius", "let the group end at the axis"),
    ]  # fmt: skip
    for key, beam in (
        ("density", Beam("middle", E=ONE, thickness=Scalar(0.3), density=Scalar(2400.0))),
        ("weight", Beam("middle", EA=ONE, EI=ONE, weight=Scalar(2400.0))),
    ):
        for gravity in (None, (0.0, 0.0)):
            assert _faults(beam, gravity=gravity) == [
                ("no-gravity", f"structures.it.{key}",
                 "the beam 'it' has a weight, but there is no gravity",
                 f"Add 'gravity: 9.81 m/s2', or leave out '{key}'."),
            ]  # fmt: skip
        mesh = _mesh()
        check_on_mesh(_case(mesh, {"it": beam}, gravity=(0.0, -9.81)), mesh)


def test_notes_of_linings_that_turn_freely_at_supports():
    """Both ends of the line are held; where it is clamped, or on the axis, nothing is said."""
    mesh = _mesh()

    def notes(*clamped, **changes):
        beams = {"it": Beam("middle", EA=ONE, EI=ONE, nu=Scalar(0.2), clamped_on=clamped),
                 "idle": Beam("roof", EA=ONE, EI=ONE)}  # fmt: skip
        on_mesh, _ = check_on_mesh(_case(mesh, beams, **changes), mesh)
        return structure_notes(on_mesh)

    idle = (
        "no stage builds the structure 'idle', so it supports nothing: name it under 'build' of a "
        "stage"
    )

    def free(count):
        return (
            f"the lining 'it' ends at {count} nodes that supports hold, and turns freely there; on "
            "a plane of symmetry name the group under 'clamped_on'"
        )

    sides = (*rollers(2), Support("x1", (1,)))
    assert notes() == [free(1), idle]
    assert notes(supports=sides) == [free(2), idle]
    assert notes("x1", supports=sides) == [free(1), idle]
    assert notes("x0", "x1", supports=sides) == [idle]
    assert notes(analysis=Analysis.AXISYMMETRIC, supports=sides) == [free(1), idle]
    assert notes(supports=(Support("y0", (0, 1)),)) == [idle]


BAR = (((1.0, 1.0), (3.0, 2.0)),)


def test_numbers_that_cannot_be_are_said_of_structures_and_stages():
    def said(EA, jack):
        case = SimpleNamespace(
            structures={"good": Bolts(BAR, EA=Scalar(1.0)), "bad": Bolts(BAR, EA=Scalar(EA))},
            stages=(
                Stage("first"),
                Stage("second", prestress={"bad": Scalar(0.0), "good": Scalar(jack, "a")}),
            ),
        )
        return inadmissible(case, {"a": 3.0})

    assert said(1.0, 2.0) is None
    assert said(1.0, 0.0) is None
    assert said(-2.5, 1.0) == "of the structure 'bad' EA is -2.5, it must be positive"
    assert said(1.0, -1.5) == (
        "at stage 'second' the prestress of the structure 'good' is -4.5, it must not be negative"
    )
