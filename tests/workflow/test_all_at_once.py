"""Faults of a case and its readings are said in one round, those of its mesh in the next."""

import itertools

import pytest
from support.trench import CASE, READINGS, write_case

from geoident.errors import GeoidentError, InputError
from geoident.workflow.check import check

ROWS = {"unknown gauge": ("CV,second", "CW,second"), "unknown unit": ("0.0376,mm", "0.0376,mmm")}
TEXT = {
    "bad number": ("nu: 0.25", "nu: 0.75"),
    "unknown key": ("title: Trench", "titel: Trench"),
    "unknown stage": ("stages: [first]", "stages: [frist]"),
    "to fill in": ("vertical: 1 MPa", "vertical: FILL_IN"),
    "unknown zero": ("accuracy: 0.01 mm}\n  X", "accuracy: 0.01 mm, zero: frist}\n  X"),
    "analysis": ("plane-strain", "plain-strain"),
    "faulty stage": ("name: first, excavate", "name: first, excavat"),
    "faulty group": ("groups: {rock: rock,", "groups: {rock: rokc,"),
}
ON_MESH = {
    "unknown edge": ("bottom: [x, y]", "botom: [x, y]", "has no group 'botom'"),
    "point outside": ("point: [1 m, 4 m]", "point: [1 m, 14 m]", "(1, 14) m of gauge 'S' lies"),
    "cell outside": (
        "readings: r",
        "  P: {kind: stress, point: [9 m, 1 m], components: [xx], accuracy: 1 kPa}\nreadings: r",
        "(9, 1) m of gauge 'P.xx' lies",
    ),
}


def faults_of(tmp_path, changes, rows=()):
    write_case(tmp_path)
    case, readings = CASE, READINGS
    for old, new, *_ in changes:
        assert old in case
        case = case.replace(old, new)
    for old, new in rows:
        assert old in readings
        readings = readings.replace(old, new)
    (tmp_path / "case.yaml").write_text(case)
    (tmp_path / "readings.csv").write_text(readings)
    with pytest.raises(InputError) as caught:
        check(str(tmp_path / "case.yaml"))
    return caught.value.faults


@pytest.mark.parametrize("wrong", TEXT)
def test_the_mesh_is_judged_once_the_text_is_right(tmp_path, wrong):
    (fault,) = faults_of(tmp_path, [TEXT[wrong], *ON_MESH.values()])
    assert fault.location.file.endswith("case.yaml")
    told = "\n".join(map(str, faults_of(tmp_path, ON_MESH.values())))
    for _, _, words in ON_MESH.values():
        assert words in told


def test_a_round_has_all_faults_of_text_and_readings(tmp_path):
    between = [TEXT["unknown stage"], TEXT["unknown zero"], TEXT["faulty group"]]
    faults = faults_of(tmp_path, between, ROWS.values())
    assert len(faults) == len(between) + len(ROWS)
    lines = [(fault.location.file, fault.location.line) for fault in faults]
    assert lines == sorted(lines)
    inside = [way for way in TEXT.values() if way not in between]
    assert len(faults_of(tmp_path, inside)) == len(inside)


def test_points_and_readings_that_do_not_fit_the_mesh_are_said_together(tmp_path):
    """A point in what is dug out, one outside, and a reading of ground that is gone."""
    gone = (
        "anchors: {a: [1 m, 3 m]}, accuracy: 0.01 mm}",
        "anchors: {a: [1 m, 3 m], b: [3 m, 3.5 m]}, accuracy: 0.01 mm}\n"
        "  Y: {kind: settlement, point: [3 m, 3.5 m], zero: first, accuracy: 1 mm}",
    )
    faults = faults_of(
        tmp_path, [gone, ON_MESH["point outside"]], [("X.a,second", "X.b,first,1,mm\nX.a,second")]
    )
    assert {fault.code for fault in faults} == {
        "gauge-in-absent-ground", "gauge-outside", "unreadable-gauge"
    }  # fmt: skip


def test_nothing_is_said_of_the_mesh_that_follows_from_a_wrong_entry(tmp_path):
    """Where stages or groups are wrong, nobody knows which ground is there."""
    gauge = ("point: [1 m, 4 m]", "point: [3 m, 3.5 m], zero: second")
    for wrong in ("faulty stage", "faulty group"):
        (fault,) = faults_of(tmp_path, [TEXT[wrong], gauge], [("S,first,-0.1226,mm\n", "")])
        assert fault.code in {"unknown-key", "unknown-material"}
    (absent,) = faults_of(tmp_path, [gauge], [("S,first,-0.1226,mm\n", "")])
    assert absent.code == "gauge-in-absent-ground"


def test_every_pair_of_faults_ends_in_faults(tmp_path):
    """Whatever is left of a case, judging it raises nothing else."""
    write_case(tmp_path)
    path = tmp_path / "case.yaml"
    cuts = [line for line in CASE.splitlines() if line[:1].isalpha()]
    for one, other in itertools.combinations(cuts, 2):
        text = CASE
        for line in (one, other):
            key = line.partition(":")[0]
            text = text.replace(line, f"{key}: [3 furlong]")
        with pytest.raises(GeoidentError):
            check(str(path), text=text)


def test_a_material_whose_parameter_is_missing_is_not_judged_beside_a_faulty_stage(tmp_path):
    gone = "parameters:\n  E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}\n"
    changes = [(gone, "parameters:\n"), ("excavate: [upper]", "excavate: {}")]
    paths = {fault.path for fault in faults_of(tmp_path, changes)}
    assert {"materials.rock.E", "stages[0].excavate"} <= paths


def test_a_group_that_the_mesh_has_and_the_case_lacks_is_told_from_a_misspelt_one(tmp_path):
    left_out = (
        "groups: {rock: rock, upper: rock, lower: rock}",
        "groups: {rock: rock, upper: rock}",
    )
    (fault,) = faults_of(tmp_path, [left_out])
    assert "no group 'lower'" in fault.message
    assert "If the mesh has it, add 'lower: MATERIAL' to 'groups'" in fault.hint
    (fault,) = faults_of(tmp_path, [("excavate: [lower]", "excavate: [lowe]")])
    assert fault.hint == "Did you mean 'lower'?"
