"""Linings and bolts in a case: what they become, and what is refused."""

import pytest

from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Bolts

BENCH = "  - {name: bench 1, excavate: [bench], install: {lining: shotcrete}}"
STAGES = "stages:\n"
SHELL = "{kind: beam, on: wall, E: 15 GPa, nu: 0.2, thickness: 0.2 m, clamped_on: [left]}"
BOLT = "{kind: bolt, E: 200 GPa, diameter: 25 mm, spacing: 1.5 m, ends: [[[3, 0 m], [7, 1 m]]]}"


@pytest.fixture
def built(changed):
    """The sound case with structures, built by its second stage."""

    def make(shell=SHELL, bolt=BOLT, does="build: [shell, bolts]"):
        text = changed(BENCH, f"  - {{name: bench 1, excavate: [bench], {does}}}")
        text = text.replace(STAGES, f"structures:\n  shell: {shell}\n  bolts: {bolt}\nstages:\n")
        return text + "\n"

    return make


def test_linings_and_bolts(project, built):
    case = project.read(built()).case
    assert case.structures == {
        "shell": Beam(
            "wall",
            E=Scalar(15e9),
            nu=Scalar(0.2),
            thickness=Scalar(0.2),
            clamped_on=("left",),
        ),
        "bolts": Bolts(
            (((3.0, 0.0), (7.0, 1.0)),), Scalar(1.5), E=Scalar(200e9), diameter=Scalar(0.025)
        ),
    }
    assert case.stages[1].build == ("shell", "bolts")


def test_stiffness_as_it_enters_and_parameters(project, built):
    shell = "{kind: beam, on: wall, EA: 0.5 $EA, EI: 30 MNm2/m}"
    bolt = "{kind: bolt, EA: 98 MN, spacing: 1 m, ends: [[[3, 0 m], [7, 1 m]]]}"
    text = built(shell, bolt).replace(
        "parameters:\n", "parameters:\n  EA: {start: 4 GN/m, bounds: [1, 9 GN/m]}\n"
    )
    case = project.read(text).case
    assert case.structures["shell"] == Beam("wall", EA=Scalar(0.5, "EA"), EI=Scalar(30e6))
    assert case.structures["bolts"].EA.factor == 98e6


def test_dismantled_and_built_again(project, built):
    again = "\n  - {name: off, dismantle: [shell]}\n  - {name: on, build: [shell]}\ngauges:\n"
    text = built().replace("\ngauges:\n", again)
    stages = project.read(text).case.stages
    assert [stage.dismantle for stage in stages] == [(), (), ("shell",), ()]


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        ({"shell": "«{kind: beam, on: wall, E: 15 GPa}"}, "wrong-pair", "found E; E and thickness"),
        ({"shell": "«{kind: beam, on: wall, E: 15 GPa, thickness: 1 m, EA: 1 GN/m}"},
         "wrong-pair", "found E and EA and thickness"),
        ({"shell": "{kind: beam, on: wall, E: 15 GPa, thickness: «-0.2 m}"},
         "out-of-range", "it must be positive"),
        ({"shell": "{kind: beam, on: wall, EA: «4 GPa, EI: 30 MNm2/m}"}, "unit", "a line load is"),
        ({"shell": "{kind: «rope, on: wall}"}, "not-listed", "rope"),
        ({"bolt": "{kind: bolt, EA: 1 MN, spacing: 1 m, ends: [[[3, 0 m], «[3, 0 m]]]}"},
         "zero-length", "begins and ends at one point"),
        ({"bolt": "{kind: bolt, EA: 1 MN, spacing: 1 m, ends: [[«[3 m], [7, 1 m]]]}"},
         "wrong-dimension", "the end has 1 components; 2 expected"),
        ({"does": "build: [«shel, bolts]"}, "unknown-structure", "there is no structure 'shel'"),
        ({"does": "build: [shell, «shell]"}, "built-twice", "is already built"),
        ({"does": "dismantle: [«bolts]"}, "no-such-structure",
         "no structure 'bolts' exists at this stage"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_at_its_place(project, built, change, code, said):
    fault = project.only_fault(built(**change))
    assert fault.code == code, str(fault)
    assert said in fault.message, fault.message


def test_bolts_in_plane_strain_need_a_spacing(project, built):
    bolt = "{kind: bolt, EA: 1 MN, ends: [[[3, 0 m], [7, 1 m]]]}"
    fault = project.only_fault(built(bolt=bolt))
    assert (fault.code, fault.path) == ("missing-key", "structures.bolts")


def test_beams_stand_in_plane_strain_only(project, built):
    faults = project.faults(built().replace("plane-strain", "axisymmetric"))
    found = {f.path: f.message for f in faults if f.code == "wrong-analysis"}
    assert found.keys() == {"structures.shell.kind", "structures.bolts.kind"}
    assert "beams in axisymmetric analysis" in found["structures.shell.kind"]
