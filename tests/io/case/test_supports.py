"""Supports that move: what they become, and every way to write them wrong."""

import pytest

from geoident.model.actions import Contraction, MotionField
from geoident.model.case import Support
from geoident.model.parameter import Scalar

SUPPORTS = "{left: x, right: x, bottom: [x, y]}"
HEADING = "{name: heading, excavate: [heading]}"


def test_motions_arrive_in_si_units(project, changed):
    text = changed(SUPPORTS, "{left: {x: 1 mm, y: fixed}, right: {y: -2 $K0}, bottom: [x, y]}")
    assert project.read(text.replace("-2 $K0", "1 cm")).case.supports == (
        Support("left", (0, 1), motions=((0, Scalar(1e-3)),)),
        Support("right", (1,), motions=((1, Scalar(0.01)),)),
        Support("bottom", (0, 1)),
    )
    text = changed(
        SUPPORTS, "{left: {contraction: 1.5 %, centre: [1, 2 m]}, probe: {at: [1, 2 m], x: 1 mm}}"
    )
    assert project.read(text).case.supports == (
        Support("left", (0, 1), contraction=Contraction(Scalar(0.015), (1.0, 2.0))),
        Support("probe", (0,), at=(1.0, 2.0), motions=((0, Scalar(1e-3)),)),
    )


def test_stages_begin_change_and_let_go(project, changed):
    stage = HEADING.replace("}", ", supports: {left: {x: 2 mm}, right: free, wall: fixed}}")
    (first, _) = project.read(changed(HEADING, stage)).case.stages
    assert first.supports == {
        "left": Support("left", (0,), motions=((0, Scalar(2e-3)),)),
        "right": None,
        "wall": Support("wall", (0, 1)),
    }


MEASURED = MotionField(((0.0, 0.0), (0.0, 2.0)), (0, 1), ((1e-3, 0.0), (2e-3, 5e-4)))


def test_measured_motions_come_from_the_case_or_a_file(project, changed):
    points = "{points: [[0, 0 m], [0, 2 m]], x: [1, 2 mm], y: [0, 0.5 mm]}"
    text = changed(SUPPORTS, f"{{left: {{measured: {points}}}}}")
    assert project.read(text).case.supports == (Support("left", (0, 1), measured=MEASURED),)
    table = project.folder / "moved.csv"
    table.write_text("x [m], y [m], ux [mm], uy [mm]\n0, 0, 1, 0\n0, 2, 2, 0.5\n")
    text = changed(SUPPORTS, "{left: {measured: {file: moved.csv}}}")
    assert project.read(text).case.supports == (Support("left", (0, 1), measured=MEASURED),)


@pytest.mark.parametrize(
    ("supports", "code", "said"),
    [
        ("{left: {x: «1 MPa}}", "unit", "length"),
        ("{left: {x: «1}}", "unit", ""),
        ("{left: «{at: [0, 0 m]}}", "no-motion", "no direction"),
        ("{left: {z: «1 mm}}", "wrong-dimension", "no direction z"),
        ("{left: {x: 1 mm, contraction: «1 %}}", "wrong-pair", "all of the motion"),
        ("{left: {x: 1 mm, centre: «[0, 0 m]}}", "wrong-pair", "belongs to"),
        ("{left: {contraction: «150 %}}", "out-of-range", "not a part"),
        ("{left: {contraction: 1 %, axis: «x}}", "wrong-dimension", "only a solid"),
        ("{left: {measured: «{points: [[0, 0 m]]}}}", "wrong-pair", "or a file"),
        ("{left: {measured: {points: [[0, 0 m]], x: «[1, 2 mm]}}}", "wrong-number", "2 motions"),
        (
            "{left: {x: «1 mm, measured: {points: [[0, 0 m]], x: [1 mm]}}}",
            "wrong-pair",
            "by 'measured'",
        ),
        ("{left: «free}", None, ""),
    ],
)
def test_faults_are_at_their_place(project, changed, supports, code, said):
    fault = project.only_fault(changed(SUPPORTS, supports))
    assert said in fault.message
    if code is not None:
        assert fault.code == code


def test_faults_of_a_table_of_motions_are_at_their_cells(project, changed):
    (project.folder / "motions.csv").write_text("x [m], y [m], ux [mm]\n1, 2, 3\n4, 5, six\n")
    (fault,) = project.faults(changed(SUPPORTS, "{left: {measured: {file: motions.csv}}}"))
    assert (fault.location.line, fault.location.column) == (3, 7)
    assert fault.message == "'six' is not a number (ux)"


def test_what_does_not_hold_cannot_let_go(project, changed):
    stage = HEADING.replace("}", ", supports: {roof: «free}}")
    fault = project.only_fault(changed(HEADING, stage))
    assert fault.code == "no-such-support"
    assert "no support 'roof' holds" in fault.message
