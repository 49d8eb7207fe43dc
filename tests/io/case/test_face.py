"""The tunnel face: profiles, distances and zeros by distance, and every way to write them wrong."""

import pytest
import yaml

from geoident.model.actions import FaceProfile
from geoident.model.parameter import Scalar

HEADING = "  - {name: heading, excavate: [heading]}\n"
BENCH = "  - {name: bench 1, excavate: [bench], install: {lining: shotcrete}}\n"
ADVANCE = """\
  - {name: heading, excavate: [heading], distance: 2.5 m}
  - {name: next, distance: 6 m}
"""


@pytest.fixture
def tunnel(changed):
    """The sound case with a face, and one thing in it replaced."""

    def make(face: str = "{profile: panet, radius: 4 m}", old: str = "", new: str = "") -> str:
        text = changed(HEADING, ADVANCE).replace("stages:\n", f"face: {face}\nstages:\n")
        assert text.count(old) == 1 or not old, old
        return text.replace(old, new) if old else text

    return make


def test_a_face_arrives_in_si_units(project, tunnel):
    case = project.read(tunnel()).case
    panet = FaceProfile("panet", ("heading",), Scalar(4.0), (Scalar(0.25), Scalar(0.75)))
    assert case.face == panet
    assert [stage.distance for stage in case.stages] == [Scalar(2.5), Scalar(6.0), None]
    face = "{profile: vlachopoulos-diederichs, radius: 400 cm, plastic_radius: 9 m, "
    face += "groups: [bench], centre: [1, 2 m], conversion: direct}"
    text = tunnel(face, "distance: 2.5 m}", "distance: 2.5 m, release: {heading: 1}}")
    text = text.replace("[heading], distance", "[heading, bench], distance")
    text = text.replace("excavate: [bench], install", "install")
    assert project.read(text).case.face == FaceProfile(
        "vlachopoulos-diederichs", ("bench",), Scalar(4.0), (), Scalar(9.0), (1.0, 2.0), "direct"
    )


def test_what_is_not_said_is_that_of_the_paper(project, tunnel):
    found = project.read(tunnel("{profile: chern, radius: 4 m}")).case.face
    assert found.constants == (Scalar(1.1), Scalar(1.7))


def test_profiles_have_one_spelling(project, tunnel):
    """That of `profile` is that of a weight, in a case and in what a result says of it."""
    face = "{profile: panet, radius: 4 m, averaged_with: {vlachopoulos-diederichs: 0.3}}"
    loaded = project.read(tunnel(face))
    assert [(one.law, w) for one, w in loaded.case.face.averaged] == [
        ("vlachopoulos-diederichs", Scalar(0.3))
    ]
    assert project.read(loaded.resolved).case.face == loaded.case.face


def test_a_gauge_is_zeroed_at_a_distance(project, tunnel):
    text = tunnel(old="zero: heading", new="zero: {distance: 250 cm}")
    loaded = project.read(text)
    assert [c.zero for c in loaded.case.channels] == ["virgin", "heading"]
    again = yaml.safe_load(loaded.resolved)["gauges"]["CV1"]["zero"]
    assert again == {"distance": "250 cm"}
    assert project.read(loaded.resolved).case.channels == loaded.case.channels


@pytest.mark.parametrize(
    ("face", "old", "new", "code", "said"),
    [
        ("{profile: panet}", "face:", "«face:", "missing-key", "radius"),
        ("{profile: «lunardi, radius: 4 m}", "", "", None, "lunardi"),
        ("{profile: panet, radius: «0 m}", "", "", "out-of-range", "positive"),
        ("{profile: panet, radius: 4 m, alpha: «1.2}", "", "", "out-of-range", "less than 1"),
        ("{profile: panet, radius: 4 m, «reach: 1.2}", "", "", None, "reach"),
        (
            "{profile: panet, radius: 4 m, averaged_with: {«panet: 0.5, chern: 0.2}}",
            "", "", None, "panet",
        ),
        (
            "{profile: panet, radius: 4 m, averaged_with: «{}}",
            "", "", "wrong-pair", "expected vlachopoulos-diederichs (with chern), or chern",
        ),
        (
            "{profile: chern, radius: 4 m, averaged_with: {«vlachopoulos_diederichs: 0.3}}",
            "", "", None, "vlachopoulos-diederichs",
        ),
        (
            "{profile: chern, radius: 4 m, averaged_with: {panet: 0.3}}",
            "distance: 2.5 m", "distance: «-1 m", "out-of-range", "ahead of the face",
        ),
        ("{profile: chern, radius: 4 m, conversion: «arch}", "", "", None, "reaction-curve"),
        ("{profile: chern, radius: 4 m, groups: [«roof]}", "", "", "unknown-group", "roof"),
        (
            "{profile: vlachopoulos-diederichs, radius: 4 m, plastic_radius: «3 m}",
            "", "", "out-of-range", "within the tunnel",
        ),
        (None, "distance: 2.5 m", "distance: «-1 m", "out-of-range", "ahead of the face"),
        (None, "distance: 6 m", "distance: «2 m", "face-order", "after 2.5 m"),
        (None, "distance: 6 m", "distance: «6 MPa", "unit", "length"),
        (
            None, "distance: 6 m}", "distance: 6 m, release: {«heading: 1}}",
            "contradiction", "follows from the distance",
        ),
        (None, "[heading], distance: 2.5 m", "[heading]", None, "no stress of 'heading' is held"),
        (
            None, "zero: heading", "zero: {distance: «3 m}", "unknown-stage",
            "at no stage is the face 3 m away",
        ),
    ],
)  # fmt: skip
def test_faults_are_at_their_place(project, tunnel, face, old, new, code, said):
    text = tunnel(face, old, new) if face else tunnel(old=old, new=new)
    if "no stress" in said:
        text = text.replace("radius: 4 m", "radius: 4 m, groups: [heading]")
        text = text.replace("distance: 6 m", "«distance: 6 m")
    fault = project.only_fault(text)
    assert said in f"{fault.message} {fault.hint}"
    assert code is None or fault.code == code
    assert fault.hint


def test_a_distance_needs_a_face(project, changed):
    faults = project.faults(changed(HEADING, ADVANCE))
    assert {fault.code for fault in faults} == {"no-face"}
    assert "face: {profile:" in faults[0].hint


def test_bounds_of_what_is_sought_are_judged(project, tunnel):
    text = tunnel("{profile: panet, radius: 4 m, alpha: $a}")
    text = text.replace("parameters:\n", "parameters:\n  a: {start: 0.3, bounds: «[0.1, 1.1]}\n")
    assert project.only_fault(text).code == "out-of-range"


def test_a_face_is_for_sections(project, tunnel):
    text = tunnel().replace("plane-strain", "axisymmetric")
    fault = next(f for f in project.faults(text) if f.code == "wrong-analysis")
    assert "a part of the model" in fault.message
    none = tunnel().replace(", distance: 2.5 m", "").replace(", distance: 6 m", "")
    assert project.only_fault(none).code == "no-distance"


OPENING = """\
format: geoident-case/1
analysis: plane-strain
parameters: {E: {start: 2 GPa, bounds: [0.1 GPa, 20 GPa]}}
materials: {rock: {elastic: isotropic, E: $E, nu: 0.25}}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 5 MPa, K0: 1.0}
face: {profile: chern, conversion: «mesh}
stages: [{name: first, excavate: [tunnel], distance: 2 m}, {name: far, distance: 40 m}]
gauges: {H: {kind: convergence, between: [[-3, 0 m], [3, 0 m]], accuracy: 1 mm, zero: first}}
readings: [{stage: far, gauge: H, value: -4 mm}]
fit: {method: closed-form, closed-form: {centre: [0, 0 m], radius: 3 m}}
"""


def test_a_case_without_mesh_has_no_wall_to_ask(project):
    fault = project.only_fault(OPENING)
    assert (fault.code, fault.path) == ("no-mesh", "face.conversion")
    assert "the case has no mesh" in fault.message
    assert "Leave 'conversion' out" in fault.hint
    sound = OPENING.replace(", conversion: «mesh", "")
    assert project.read(sound).case.face.radius == Scalar(3.0)
