"""Mistakes that a case may hold without being wrong: units and signs that nobody meant."""

import json

import pytest
from support.commands import run_command, said_findings
from support.trench import CASE, READINGS, write_case

from geoident.workflow.check import check


@pytest.fixture
def notes(tmp_path):
    """What `check` notes of the trench with changes."""

    def read(*changes):
        path = write_case(tmp_path)
        text = CASE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
        return " | ".join(check(str(path)).summary.notes)

    return read


def test_an_ordinary_case_is_not_doubted(notes):
    assert "check its unit" not in notes()
    bounded = "K0: {start: 1.0, bounds: [0.2, 4], prior: {mean: 4, sd: 1}}"
    assert "the prior of" not in notes(("K0: {start: 1.0, bounds: [0.2, 4]}", bounded))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("point: [1 m, 4 m], accuracy: 0.01 mm", "point: [1 m, 4 m], accuracy: 0.1 m",
         "The accuracy of S is 100 mm; gauges of the kind settlement have about 0.3 mm"),
        ("{start: 2 GPa, bounds: [0.1 GPa, 50 GPa]", "{start: 2 kPa, bounds: [0.1 kPa, 50 kPa]",
         "E of 'rock' is 2 kPa, softer than any ground: check its unit"),
        ("K0: {start: 1.0, bounds: [0.2, 4]}", "K0: {start: 100, bounds: [20, 400]}",
         "K0 is 100: the horizontal stress is 100 times the vertical one; per cent need"),
        ("K0: {start: 1.0, bounds: [0.2, 4]}",
         "K0: {start: 1.0, bounds: [0.2, 4], prior: {mean: 4.1, sd: 1}}",
         "The mean of the prior of K0 is outside its bounds, which exclude what is likeliest"),
        ("K0: {start: 1.0, bounds: [0.2, 4]}", "K0: {start: 0, bounds: [-1, 4]}",
         "K0 is 0: ground with hardly any horizontal stress is seldom meant"),
        ("nu: 0.25}", "nu: 0.25, density: 19000 kg/m3}",
         "The density of 'rock' is 19000 kg/m3, heavier than any ground: check its unit (a unit "
         "weight of 19 kN/m3 is a density of 1940 kg/m3)"),
        ("excavate: [lower]", "excavate: [lower], release: {lower: 0.7}",
         "70 % of the stress of 'lower' is released in the last stage that names it, and the rest "
         "never: if it is to go, let a later stage say release: {lower: 1}"),
        ("materials:\n", "materials:\n  fault: {elastic: isotropic, E: 1 GPa, nu: 0.3}\n",
         "no group is of the material 'fault': its constants, and parameters that only they"),
        ("vertical: 1 MPa", "vertical: 1 GPa",
         "The vertical in-situ stress is 1 GPa, more than 12 km of rock weigh: check its unit"),
    ],
)  # fmt: skip
def test_a_unit_that_nobody_meant_is_noted(notes, old, new, said):
    assert said in notes((old, new))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("K0: {start: 1.0, bounds: [0.2, 4]}",
         "K0: {start: 1.0, bounds: [0.2, 4], prior: {mean: 4.1, sd: 1}}",
         "The mean of the prior of K0 is outside its bounds, which exclude what is likeliest"),
        ("{start: 2 GPa, bounds: [0.1 GPa, 50 GPa]",
         "{start: 2 GPa, bounds: [1 kPa, 9 GPa], prior: {kind: lognormal, mean: 10 kPa, sd: 9 kPa}",
         "With the mean of the prior of E, E of 'rock' is 10 kPa, softer than any ground: check"),
        ("nu: 0.25}", "nu: 0.25, density: 19000 kg/m3}",
         "The density of 'rock' is 19000 kg/m3, heavier than any ground"),
    ],
)  # fmt: skip
def test_a_fit_and_what_follows_from_it_repeat_what_check_says(tmp_path, notes, old, new, said):
    assert said in notes((old, new))
    case = tmp_path / "case.yaml"
    for command, path in (("fit", case), ("predict", tmp_path / "case.fit.h5")):
        made = json.loads(run_command(command, path, "--json", "-q", "--force").stdout)
        (sentence,) = [f["sentence"] for f in made["findings"] if f["kind"] == "implausible"]
        assert said in sentence


def test_a_scan_says_what_check_says(tmp_path):
    path = write_case(tmp_path)
    path.write_text(CASE.replace("nu: 0.25}", "nu: 0.25, density: 19000 kg/m3}"))
    said = "The density of 'rock' is 19000 kg/m3, heavier than any ground: check its unit"
    assert said in run_command("scan", path).stderr
    assert said in run_command("show", tmp_path / "case.scan.h5").stdout


def test_an_in_situ_stress_with_the_sign_of_compression_positive_is_noted(notes):
    constant = "{model: constant, xx: 1 MPa, yy: -1 MPa, zz: -1 MPa}"
    heim = "{model: heim, vertical: 1 MPa, K0: $K0}"
    said = notes((heim, constant), ("  K0: {start: 1.0, bounds: [0.2, 4]}\n", ""))
    assert "has 1 MPa of tension: compression is negative here, check the signs" in said


def test_a_reading_in_metres_is_noted_once_for_its_gauge(tmp_path):
    """The points are 2 m apart, those of the extensometer 1 m; a settlement has one."""
    path = write_case(tmp_path)
    rows = ["CV,first,-2.1,m", "CV,second,1.5,m", "X.a,first,-0.49,m", "S,first,7,m"]
    rows += ["X.a,second,0.51,m"]
    path.with_name("readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows]))
    said = [note for note in check(str(path)).summary.notes if "check its unit" in note]
    assert [note.partition(" (")[0] for note in said] == [
        "X.a at second reads 0.51 m between points that are 1 m apart",
        "CV at first reads -2.1 m between points that are 2 m apart",
    ]
    assert "readings.csv:2:1)" in said[1]


def findings(tmp_path, readings, case=CASE):
    path = write_case(tmp_path)
    path.write_text(case)
    (tmp_path / "readings.csv").write_text(readings)
    told = run_command("fit", str(path), "--json", "-q", "--force")
    return " | ".join(said_findings(json.loads(told.stdout)))


def test_readings_with_the_other_sign_are_found(tmp_path):
    said = findings(tmp_path, READINGS)
    assert "sign" not in said
    header, *rows = READINGS.splitlines()
    cells = [row.split(",") for row in rows]
    rows = [f"{gauge},{stage},{-float(value)},{unit}" for gauge, stage, value, unit in cells]
    turned = "\n".join([header, *rows]) + "\n"
    said = findings(tmp_path, turned)
    assert "All readings of the file 'readings.csv' have the wrong sign" in said
    assert "channels: {CV: {sign: -1}, S: {sign: -1}, X.a: {sign: -1}}}" in said


def test_one_reading_with_the_other_sign_is_found(tmp_path):
    """Alone, it can have its gauge for itself: the model must clearly move the other way."""
    case = CASE.replace("stages: [first]", "stages: [first, second]")
    kept = READINGS.replace("CV,first,-0.598,mm\n", "")
    turned = findings(tmp_path, kept.replace("CV,second,-", "CV,second,"), case)
    assert "readings.csv:4:1: 1.077 mm) has the wrong sign: -1.077 mm fits the others" in turned
    assert "sign" not in findings(tmp_path, kept, case)


NEAR = (
    CASE.replace("stages: [first]", "stages: [first, second]")
    .replace("start: 2 GPa", "start: 5 GPa")
    .replace("K0: {start: 1.0", "K0: {start: 1.5")
)
"""All readings, and the start values with which they were made."""


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("mm", ""),
        ("cm", "millimetres read as centimetres"),  # 10 times too large
    ],
)
def test_readings_in_another_unit_are_suspected(tmp_path, unit, words):
    path = write_case(tmp_path)
    path.write_text(NEAR)
    (tmp_path / "readings.csv").write_text(READINGS.replace(",mm\n", f",{unit}\n"))
    said = " | ".join(check(str(path)).summary.notes)
    assert ("have the pattern of the model" in said) == bool(words)
    assert words in said
    assert not words or "readings.csv:2:1" in said


def test_a_unit_that_no_parameters_within_their_bounds_meet_is_named(tmp_path):
    path = write_case(tmp_path)
    path.write_text(NEAR)
    (tmp_path / "readings.csv").write_text(READINGS.replace(",mm\n", ",m\n"))
    said = " | ".join(check(str(path)).summary.notes)
    assert "All readings of the file 'readings.csv' are 1000 times too large (mm read as m)" in said
    assert "channels: {CV: {unit: mm}, S: {unit: mm}, X.a: {unit: mm}}}" in said


def test_a_start_value_that_is_off_is_no_unit(tmp_path):
    path = write_case(tmp_path)
    for start in ("1 GPa", "3 GPa", "20 GPa", "25 GPa"):
        path.write_text(NEAR.replace("start: 5 GPa", f"start: {start}"))
        assert "read as" not in " | ".join(check(str(path)).summary.notes), start


def test_a_fit_says_of_which_readings_the_unit_is_suspected(tmp_path):
    path = write_case(tmp_path)
    path.write_text(NEAR)
    (tmp_path / "readings.csv").write_text(READINGS.replace(",mm\n", ",cm\n"))
    done = run_command("fit", str(path), "--json")
    assert "millimetres read as centimetres? Check their unit" in done.stdout


def test_a_parameter_of_a_material_without_a_group_is_said_to_have_no_effect(tmp_path):
    """And no reading is called influential for it, even where a prior gives it a number."""
    fault = "  fault: {elastic: isotropic, E: $E_fault, nu: 0.3}\n"
    for prior in ("", ", prior: {mean: 1 GPa, sd: 0.5 GPa}"):
        sought = f"  E_fault: {{start: 1 GPa, bounds: [0.1 GPa, 9 GPa], scale: log{prior}}}\n"
        case = CASE.replace("materials:\n", f"materials:\n{fault}")
        said = findings(tmp_path, READINGS, case.replace("  K0:", f"{sought}  K0:"))
        assert "do not determine E_fault" in said
        assert "no reading depends on it: no group is of the material 'fault'" in said
        assert "without it E_fault" not in said


WET = [
    ("nu: 0.25}", "nu: 0.25, density: 1900 kg/m3}"),
    ("in_situ: {model: heim, vertical: 1 MPa, K0: $K0}",
     "gravity: 9.81 m/s2\nwater: {table: 4 m}\nin_situ: {model: geostatic, K0: $K0}"),
]  # fmt: skip


def test_a_water_table_that_lifts_the_ground_is_noted(notes):
    """The ground ends at 4 m; of the table at 7 m the weight of 3 m of water is missing."""
    assert "the water lifts the ground" not in notes(*WET)
    said = notes(*WET, ("table: 4 m", "table: 7 m"))
    assert "the water lifts the ground: at the start values the vertical effective in-situ" in said
    assert "If the table is above the ground, its weight on the ground is missing" in said
    assert "Heim" not in said
    # 3.106 m below the table near the top: 9.81 (3 m + z) - (19 - 9.81) z
    assert "up to 27.6 kPa" in said
    weight = "in_situ: {model: geostatic, K0: $K0, surcharge: 29.43 kPa}"
    lake = [
        (WET[0]),
        (WET[1][0], WET[1][1].replace("in_situ: {model: geostatic, K0: $K0}", weight)),
    ]
    assert "the water lifts" not in notes(*lake, ("table: 4 m", "table: 7 m"))
