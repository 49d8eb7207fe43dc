"""Linings and bolts in a case: what they become, and what is refused."""

import pytest

from geoident.model.parameter import Scalar
from geoident.model.structures import (
    Anchors,
    Beam,
    BoltPattern,
    Bolts,
    Ribs,
    Ring,
    Struts,
    SupportLine,
)

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
            "wall", E=Scalar(15e9), nu=Scalar(0.2), thickness=Scalar(0.2), clamped_on=("left",)
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
        ({"shell": "«{kind: beam, on: wall, E: 15 GPa}"}, "wrong-pair", "found E; expected"),
        ({"shell": "«{kind: beam, on: wall, E: 15 GPa, thickness: 1 m, EA: 1 GN/m}"},
         "wrong-pair", "found E, thickness and EA"),
        ({"shell": "{kind: beam, on: wall, E: 15 GPa, thickness: «-0.2 m}"},
         "out-of-range", "it must be positive"),
        ({"shell": "{kind: beam, on: wall, EA: «4 GPa, EI: 30 MNm2/m}"}, "unit", "a line load"),
        ({"shell": "{kind: «rope, on: wall}"}, "not-listed", "rope"),
        ({"bolt": "{kind: bolt, EA: 1 MN, spacing: 1 m, ends: [[[3, 0 m], «[3, 0 m]]]}"},
         "zero-length", "begins and ends at one point"),
        ({"bolt": "{kind: bolt, EA: 1 MN, spacing: 1 m, ends: [[«[3 m], [7, 1 m]]]}"},
         "wrong-dimension", "found 1; expected 2 components"),
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


def test_beams_stand_in_plane_models_only(project, built):
    solid = built().replace("plane-strain", "solid")
    found = {f.path: f.message for f in project.faults(solid) if f.code == "wrong-analysis"}
    assert found == {
        "structures.shell.kind": "beams in solid analysis; they are available in plane-strain or "
        "axisymmetric analysis only"
    }


def test_nu_of_a_shell_of_revolution_is_a_number(project, built):
    shell = SHELL.replace("nu: 0.2", "nu: «$nu")
    text = built(shell).replace("plane-strain", "axisymmetric")
    text = text.replace("parameters:\n", "parameters:\n  nu: {start: 0.2, bounds: [0, 0.4]}\n")
    fault = project.only_fault(text)
    assert (fault.code, fault.message) == (
        "bad-tie",
        "nu of a shell of revolution couples its meridian and hoops; it cannot be a parameter",
    )


def test_hinges_and_weight_of_a_beam(project, built):
    shell = SHELL.replace("}", ", hinges: [[3, 1 m], joint], density: 2500 kg/m3}")
    found = project.read(built(shell)).case.structures["shell"]
    assert found.hinges == ((3.0, 1.0), "joint")
    assert found.density == Scalar(2500.0)
    shell = "{kind: beam, on: wall, EA: 1 GN/m, EI: 30 MNm2/m, weight: 8 kN/m2}"
    assert project.read(built(shell)).case.structures["shell"].weight == Scalar(8e3)


@pytest.mark.parametrize(
    ("more", "code", "message"),
    [
        ("density: 2500 kg/m3, weight: 8 kN/m2", "wrong-pair",
         "found density and weight; expected density with a thickness, or weight"),
        ("weight: «-8 kN/m2", "out-of-range", "'-8 kN/m2' is negative"),
        ("density: «-2500 kg/m3", "out-of-range", "'-2500 kg/m3' is negative"),
        ("hinges: [«[3 m]]", "wrong-dimension",
         "found 1; expected 2 components (x, y)"),
    ],
)  # fmt: skip
def test_wrong_beams_are_refused(project, built, more, code, message):
    shell = SHELL.replace("}", f", {more}}}")
    if "«" not in more:
        shell = "«" + shell
    fault = project.only_fault(built(shell))
    assert (fault.code, fault.message) == (code, message)


STRUT = (
    "{kind: strut, EA: 2000 MN, spacing: 3 m, ends: [[[3, 0 m], [0, 0 m]]], second_end: symmetry}"
)
ANCHOR = "{kind: anchor, E: 195 GPa, area: 600 mm2, spacing: 2 m, grouted: 4 m, prestress: 300 kN, "
ANCHOR += "ends: [[[3, 0 m], [12, -2 m]]]}"


def test_struts_and_anchors(project, built):
    found = project.read(built(bolt=STRUT)).case.structures["bolts"]
    ends = (((3.0, 0.0), (0.0, 0.0)),)
    assert found == Struts(ends, Scalar(3.0), EA=Scalar(2e9), second_end="symmetry")
    found = project.read(built(bolt=ANCHOR)).case.structures["bolts"]
    assert found == Anchors(
        (((3.0, 0.0), (12.0, -2.0)),), Scalar(2.0), E=Scalar(195e9), area=Scalar(600e-6),
        prestress=Scalar(3e5), grouted=4.0,
    )  # fmt: skip


def test_stressed_again_by_a_later_stage_and_by_a_parameter(project, built):
    again = "\n  - {name: jack, prestress: {bolts: 2 $P}}\ngauges:\n"
    text = built(bolt=STRUT).replace("\ngauges:\n", again)
    text = text.replace("parameters:\n", "parameters:\n  P: {start: 100 kN, bounds: [0, 1 MN]}\n")
    case = project.read(text).case
    assert case.stages[2].prestress == {"bolts": Scalar(2.0, "P")}
    assert case.stages[1].prestress == {}


@pytest.mark.parametrize(
    ("bolt", "code", "said"),
    [
        (ANCHOR.replace("4 m", "14 m").replace("[[[3", "[«[[3"),
         "zero-length", "the anchor is 9.21954 m long, of which '14 m' are grouted: no free length "
         "is left"),
        (ANCHOR.replace("300 kN", "«-300 kN"), "out-of-range", "'-300 kN' is negative"),
        (ANCHOR.replace("300 kN", "«300 kPa"), "unit", "expected a force"),
        (ANCHOR.replace("600 mm2", "«600 mm"), "unit", "expected an area"),
        (ANCHOR.replace(" grouted: 4 m,", ""), "missing-key", "grouted"),
        (STRUT.replace("symmetry}", "«mirror}"), "not-listed", "mirror"),
        (STRUT.replace("spacing", "«number: 6, spacing"), "wrong-analysis",
         "'number' in plane-strain analysis, which has no axis"),
    ],
)  # fmt: skip
def test_wrong_bars_are_refused(project, built, bolt, code, said):
    fault = project.only_fault(built(bolt=bolt))
    assert fault.code == code
    assert said in fault.message, fault.message


@pytest.mark.parametrize(
    ("does", "code", "message"),
    [
        ("build: [shell], prestress: {«bolts: 10 kN}", "no-such-structure",
         "'bolts' cannot be stressed at stage 'bench 1': it does not stand then"),
        ("build: [shell, bolts], prestress: {«bolt: 10 kN}", "unknown-structure",
         "there is no structure 'bolt'"),
        ("build: [shell, bolts], prestress: {«shell: 10 kN}", "wrong-structure",
         "'shell' is a beam, which is not prestressed"),
        ("build: [shell, bolts], prestress: {bolts: «-10 kN}", "out-of-range",
         "'-10 kN' is negative"),
    ],
)  # fmt: skip
def test_prestress_that_cannot_be_is_refused(project, built, does, code, message):
    fault = project.only_fault(built(does=does))
    assert fault.code == code
    assert fault.message == message


def test_bars_about_an_axis_need_their_number_or_spacing(project, built):
    def faults(bolt):
        text = built(bolt=bolt).replace("plane-strain", "axisymmetric")
        found = project.faults(text.replace("EA: 4 GN", "EA: 4 MPa"))
        return {f.code: f.message for f in found if f.path.startswith("structures.bolts")}

    assert project.read(built().replace("plane-strain", "axisymmetric")).case.structures["bolts"]
    ring = BOLT.replace("spacing: 1.5 m", "number: 12")
    case = project.read(built(bolt=ring).replace("plane-strain", "axisymmetric")).case
    assert case.structures["bolts"].number == Scalar(12.0)
    assert faults(BOLT.replace("spacing: 1.5 m", "number: 12, spacing: 1 m")) == {
        "wrong-pair": "found both; expected either number or spacing of the bolts around the axis"
    }
    assert faults(BOLT.replace("spacing: 1.5 m, ", "")) == {
        "wrong-pair": "found neither; expected either number or spacing of the bolts "
        "around the axis"
    }
    assert faults(BOLT.replace("[7, 1 m]", "[-7, 1 m]")) == {
        "negative-radius": "the end lies at the negative radius -7 m"
    }
    assert faults(BOLT.replace("[3, 0 m]", "[0, 0 m]")) == {
        "zero-length": "the first end lies on the axis, where bars have no spacing"
    }


OPENING = """\
format: geoident-case/1
analysis: plane-strain
parameters:
  E: {start: 1.5 GPa, bounds: [0.2 GPa, 20 GPa], scale: log}
  k: {start: 80 MPa/m, bounds: [1 MPa/m, 900 MPa/m], scale: log}
materials:
  rock: {E: $E, nu: 0.25}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 12 MPa, K0: 1.0}
face: {profile: panet}
structures:
  shotcrete: {kind: ring, E: 20 GPa, thickness: 20 cm, strength: 25 MPa, hardening_distance: 6 m}
  ribs: {kind: ribs, E: 210 GPa, area: 54 cm2, spacing: 1 m, strength: 355 MPa}
  bolts: {kind: bolting, E: 210 GPa, diameter: 25 mm, length: 4 m, spacing: 1.5 m,
          capacity: 180 kN, head_stiffness: 7 MN/m}
  line: {kind: support-line, stiffness: $k, capacity: 0.6 MPa}
stages:
  - {name: open, excavate: [tunnel], distance: 2 m}
  - {name: lined, distance: 9 m, build: [shotcrete, ribs, bolts, line]}
gauges:
  CV: {kind: convergence, between: [[-2.5, 0 m], [2.5, 0 m]], accuracy: 0.2 mm, zero: open}
fit: {method: closed-form, closed-form: {centre: [0, 0 m], radius: 2.5 m}}
"""


def test_supports_of_an_opening_without_mesh(project):
    assert project.read(OPENING).case.structures == {
        "shotcrete": Ring(
            Scalar(20e9), Scalar(0.2), strength=Scalar(25e6), hardening_distance=Scalar(6.0)
        ),
        "ribs": Ribs(Scalar(210e9), Scalar(54e-4), Scalar(1.0), Scalar(355e6)),
        "bolts": BoltPattern(
            Scalar(210e9), Scalar(0.025), Scalar(4.0), Scalar(1.5),
            capacity=Scalar(180e3), head_stiffness=Scalar(7e6),
        ),
        "line": SupportLine(Scalar(1.0, "k"), Scalar(0.6e6)),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "path", "said"),
    [
        ("distance: 6 m}", "distance: 6 m, hardening_time: 2 day}", "structures.shotcrete",
         "found hardening_time and hardening_distance"),
        ("strength: 25 MPa", "strength: 0 MPa", "structures.shotcrete.strength", "'0 MPa'"),
        ("stiffness: $k", "stiffness: $E", "structures.line.stiffness",
         "pressure (start: 1.5 GPa)"),
        ("build: [", "prestress: {bolts: 9 kN}, build: [", "stages[1].prestress.bolts",
         "'bolts' is of kind 'bolting', which is not prestressed"),
        ("gauges:\n", "gauges:\n  N: {kind: load-cell, structure: ribs, accuracy: 5 kN}\n",
         "gauges.N", "which gives displacements only"),
    ],
)  # fmt: skip
def test_wrong_supports_of_an_opening_are_refused(project, old, new, path, said):
    assert OPENING.count(old) == 1
    text = OPENING.replace(old, new)
    if "$E" in new:
        text = text.replace(
            "  k: {start: 80 MPa/m, bounds: [1 MPa/m, 900 MPa/m], scale: log}\n", ""
        )
    fault = project.only_fault(text)
    assert fault.path == path
    assert said in fault.message


def test_on_a_mesh_the_beam_or_bolts_to_write_are_named(project, built):
    fault = project.only_fault(built(shell="{kind: ring, E: 15 GPa, thickness: 0.2 m}"))
    assert fault.path == "structures.shell.kind"
    assert "and there is a mesh" in fault.message
    assert "write 'shell: {kind: beam, on: LINES, E: 15 GPa" in fault.hint


def test_ends_of_bolts_from_a_file(project, built, tmp_path):
    """One file for several structures: each takes the rows that bear its name."""
    table = "x1 [m], y1 [m], x2 [m], y2 [m], structure\n3,0,7,1,bolts\n3,1,4,5,shell\n"
    table += "3,2,7,200e-2,bolts\n"
    (tmp_path / "bolts.csv").write_text(table)
    bolt = BOLT.replace("[[[3, 0 m], [7, 1 m]]]", "bolts.csv")
    found = project.read(built(bolt=bolt)).case.structures["bolts"]
    assert found.ends == (((3.0, 0.0), (7.0, 1.0)), ((3.0, 2.0), (7.0, 2.0)))


PILES = "{kind: pile, EA: 1 GN, EI: 90 MNm2, spacing: 2 m, k_shaft: 60 MPa, k_lateral: 40 MPa, "
PILES += "head: free, ends: [[[5, 1 m], [5, -2 m]], [[7, 1 m], [7, -2 m]]]}"
PUSH = "build: [shell, bolts], loads: {H: {on: bolts, push: 20 kN, direction: [3, 4]}}"


def test_piles_that_bend_are_pushed_aside_and_their_bar_is_found_by_the_point(project, built):
    gauge = "\n  M: {kind: load-cell, structure: bolts, quantity: M, point: [7, 0 m], "
    gauge += "towards: [0, 0 m], accuracy: 1 kNm}"
    text = built(bolt=PILES, does=PUSH).replace("\ngauges:", "\ngauges:" + gauge)
    case = project.read(text).case
    assert case.structures["bolts"].bends
    assert case.structures["bolts"].numbers["EI"] == Scalar(90e6)
    assert case.stages[1].loads["H"].direction == pytest.approx((0.6, 0.8))
    (channel,) = (c for c in case.channels if c.name == "M")
    assert (channel.member, channel.dimension, channel.towards) == (1, "moment", (0.0, 0.0))


def test_piles_on_an_axis_do_not_bend(project, built):
    text = built(bolt=PILES.replace("spacing: 2 m", "number: 4"))
    faults = project.faults(text.replace("plane-strain", "axisymmetric"))
    assert any("bending of piles in axisymmetric analysis" in f.message for f in faults)
