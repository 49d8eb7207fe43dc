"""Faults in rounds: sections, then what takes several of them; rows of a file said once."""

import pytest
from support.trench import CASE, READINGS, write_case

from geoident.errors import InputError
from geoident.io.case.file import read_case


def faults_of(tmp_path, case=CASE, readings=READINGS):
    write_case(tmp_path)
    (tmp_path / "case.yaml").write_text(case)
    (tmp_path / "readings.csv").write_text(readings)
    with pytest.raises(InputError) as caught:
        read_case(str(tmp_path / "case.yaml"))
    return caught.value.faults


def changed(*pairs):
    text = CASE
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def test_what_takes_several_sections_is_said_beside_a_wrong_one_that_it_does_not_need(tmp_path):
    pairs = (
        ("nu: 0.25", "nu: 0.75"),  # by itself
        ("K0: $K0", "K0: 1.1"),  # so K0 is of no use, unless the materials use it
        ("mesh: {file: trench.inp}", "mesh: {file: french.inp}"),
        ("excavate: [lower]", "excavate: [upper]"),  # a second time
        ("stages: [first]", "stages: [frist]"),
    )
    readings = READINGS.replace("CV,second", "CW,second")
    between = {"missing-file", "absent-group", "unknown-stage", "unknown-gauge"}
    faults = faults_of(tmp_path, changed(*pairs), readings)
    assert {fault.code for fault in faults} == {"out-of-range", *between}
    assert "0.75" in " ".join(fault.message for fault in faults)
    faults = faults_of(tmp_path, changed(*pairs[1:]), readings)
    assert {fault.code for fault in faults} == {"unused-parameter", *between}


def test_a_round_has_the_faults_of_all_sections(tmp_path):
    """Bounds of no sense, a gauge of three coordinates in a plane, a number of no unit."""
    case = changed(
        ("bounds: [0.2, 4]", "bounds: [4, 0.2]"),
        ("point: [1 m, 4 m]", "point: [1 m, 4 m, 0 m]"),
        ("vertical: 1 MPa", "vertical: 1"),
    )
    assert {fault.path for fault in faults_of(tmp_path, case)} == {
        "parameters.K0.bounds", "gauges.S.point", "in_situ.vertical"
    }  # fmt: skip


def test_nothing_is_said_that_follows_from_a_wrong_entry(tmp_path):
    for old, new in (
        ("rock: {elastic: isotropic, E: $E, nu: 0.25}", "rock: {elastic: isotropic, E: $E}"),
        ("rock: {elastic: isotropic, E: $E, nu: 0.25}", "rock: {elastic: isotropic, E: $E, v: 1}"),
        ("{name: first, excavate: [upper]}", "{name: first, excavat: [upper]}"),
        ("CV: {kind: convergence,", "CV: {kind: convergenze,"),
        ("K0: {start: 1.0, bounds: [0.2, 4]}", "K0: {start: 1.0, bounds: [0.2]}"),
        ("in_situ: {model: heim, vertical: 1 MPa,", "in_situ: {model: heim, vertical: 1,"),
        ("groups: {rock: rock, upper: rock,", "groups: {rock: rock, upper: 3 m/s: rock,"),
        ("parameters:", "parametres:"),
        ("accuracy: 0.01 mm}\n  S:", "acuracy: 0.01 mm}\n  S:"),
        ("mesh: {file: trench.inp}", "mesh: {fil: trench.inp}"),
        ("supports: {left: x,", "supports: {left: w,"),
        ("readings: readings.csv", "readings: [3]"),
        ("stages: [first]", "stages: first"),
    ):
        places = {f.location.line for f in faults_of(tmp_path, changed((old, new)))}
        before = CASE[: CASE.index(old)].count("\n") + 1
        assert places <= {before, before + 1, before + 2}, (new, places)


def test_a_fault_of_many_rows_is_one(tmp_path):
    rows = "".join(f"CV,frist,{n}.5,mm\n" for n in range(30))
    rows += "".join(f"CW,first,{n}.5,mm\n" for n in range(3))
    (stage, gauge) = faults_of(tmp_path, readings=f"gauge,stage,value,unit\n{rows}")
    assert stage.location.line == 2
    assert "there is no stage 'frist' (in 30 rows: 2, 3, 4, 5, 6, ...)" in stage.message
    assert "first" in stage.hint
    assert gauge.location.line == 32
    assert "there is no gauge 'CW' to read (in 3 rows: 32, 33, 34)" in gauge.message


def test_a_unit_and_a_date_that_are_wrong_all_the_way_down_are_few(tmp_path):
    rows = "".join(f"CV,first,{n}.5,furlong\n" for n in range(30))
    (unit,) = faults_of(tmp_path, readings=f"gauge,stage,value,unit\n{rows}")
    assert "(in 30 rows: 2, 3, 4, 5, 6, ...)" in unit.message
    rows = "".join(f"CV,03/{n:02}/2024,1.5,mm\n" for n in range(1, 31))
    dated = faults_of(
        tmp_path,
        changed(("readings: readings.csv", "dates: {first: 2024-03-01}\nreadings: readings.csv")),
        f"gauge,date,value,unit\n{rows}",
    )
    assert len(dated) == 11
    assert "and 20 more of this kind, in the rows 12, 13, 14, 15, 16, ..." in dated[-1].message
