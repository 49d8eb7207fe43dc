"""The key `model`: what is wrong in it is said at its place, before anything is run."""

import jsonschema
import pytest
import yaml
from support.external import EXTERNAL, PYTHON, SCRIPT, TEMPLATE, fault_of, faults_of, write_case

from geoident.io.case.file import parse_case, read_case
from geoident.io.docs.case_schema import case_schema


def test_a_case_is_read_and_read_again_from_what_is_resolved(tmp_path):
    case = write_case(tmp_path)
    loaded = read_case(str(case))
    assert loaded.case.elsewhere.seen == {"E", "K0"}
    assert len(loaded.case.elsewhere.outputs) == 6
    again = parse_case(loaded.resolved, str(case))
    assert again.case.elsewhere == loaded.case.elsewhere
    assert again.resolved == loaded.resolved


def test_the_schema_takes_it_too(tmp_path):
    schema = jsonschema.Draft202012Validator(case_schema())
    for model in (EXTERNAL, PYTHON):
        schema.validate(yaml.safe_load(write_case(tmp_path, model).read_text()))
    assert not schema.is_valid({"format": "geoident-case/1"})


ROW = 'column: "{gauge}", row: {stage: "{stage}"}'


@pytest.mark.parametrize(
    ("old", "new", "line", "code", "said"),
    [
        ("[K0 line]", "", 11, "unused-parameter", "'K0' has no field in any template"),
        (", unit: mm", "", 8, "unit", "no unit is given, and 'H' reads a length"),
        ("unit: mm", "unit: kPa", 8, "unit", "'kPa' is not a unit of a length"),
        (ROW, ROW + ", gauges: [H, V]", 16, "no-output", "finds the readings of 'D'"),
        (ROW, ROW + ", gauges: [H, V, D, X]", 8, "unknown-gauge", "no gauge 'X'"),
        (ROW, ROW + ", find: (x)", 8, "wrong-pair", "found file, column, row and find; expected"),
        (ROW, "find: x", 8, "bad-pattern", "found 0 groups in the expression; expected one"),
        (ROW, "find: (x", 8, "bad-pattern", "is not a regular expression"),
        (ROW, "line: 3", 8, "wrong-pair", "found file and line; expected"),
        (ROW, "pointer: u", 8, "bad-pointer", "does not begin with /"),
        ("file: out.csv", "file: ../out.csv", 8, "outside", "leads out of the folder"),
        ("{opening.in:", "{/elsewhere/opening.in:", 5, "outside", "leads out of the folder"),
        ("{opening.in:", "{opening.py:", 6, "same-file", "two files of a run would be"),
        ("opening.template}", "opening.tmplate}", 5, "missing-file", "there is no file"),
        ("files: [opening.py]", "files: [opning.py]", 6, "missing-file", "there is no file"),
        ("kind: external", "kind: extern", 3, "not-listed", "found 'extern'"),
        ("format: geoident-case/1", "format: geoident-case/1\nsupports: {a: x}", 2, "no-ground",
         "the model is external"),
        ("{name: open}", "{name: open, excavate: [t]}", 12, "no-ground", "would change nothing"),
        ("H: {kind: reading,", "H: {kind: convergence, between: [[0 m, 0 m], [1 m, 0 m]],", 14,
         "no-place", "cannot place a gauge 'convergence'"),
        ("H: {kind: reading, accuracy: 0.02 mm}", "H: {kind: reading, accuracy: estimate}", 14,
         "no-size", "nothing is known of the usual accuracy"),
        ("H: {kind: reading,", "H: {kind: reading, offset: 1 kPa,", 14, "unit", "is a pressure"),
        ("H: {kind: reading,", "H: {kind: reading, offset: $E,", 14, "unit", "is a pressure"),
        ("files: [opening.py]", "files: [opening.py]\n  time_limit: soon", 7, "bad-time",
         "'soon' is not a time"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_where_it_stands(tmp_path, old, new, line, code, said):
    case = write_case(tmp_path)
    if old == "[K0 line]":
        (tmp_path / "opening.template").write_text(TEMPLATE.splitlines()[0])
    else:
        text = case.read_text()
        assert old in text
        case.write_text(text.replace(old, new))
    fault = fault_of(case, code, said)
    assert (fault.location.file, fault.location.line) == (str(case), line)


@pytest.mark.parametrize("form", ["{{E [MPa]:6.4f}}", "{{E [MPa]:8.2f}}"])
def test_a_field_into_which_a_bound_does_not_fit_is_said_before_anything_is_run(tmp_path, form):
    case = write_case(tmp_path)
    (tmp_path / "opening.template").write_text(TEMPLATE.replace("{{E [GPa]}}", form))
    if form == "{{E [MPa]:8.2f}}":  # 50000.00 fits
        assert read_case(str(case)).case.elsewhere.seen == {"E", "K0"}
        return
    [fault] = faults_of(case)
    assert str(fault.location) == f"{tmp_path / 'opening.template'}:1:1"
    assert "a field of 6 characters is too narrow for E within its bounds: '50000.0000'" in (
        fault.message
    )


def test_a_gauge_whose_output_is_wrong_is_not_said_to_have_none(tmp_path):
    case = write_case(tmp_path)
    text = case.read_text()
    for old, new in ((", unit: mm", ""), (ROW, ROW + ", gauges: [H, V, X]")):
        case.write_text(text.replace(old, new))
        assert [fault.code for fault in faults_of(case)] == (
            ["unit"] if old == ", unit: mm" else ["unknown-gauge"]
        )


def test_a_field_without_parameter_is_said_in_its_template(tmp_path):
    case = write_case(tmp_path)
    (tmp_path / "opening.template").write_text(TEMPLATE + "{{nu}}\n")
    [fault] = faults_of(case)
    assert str(fault.location) == f"{tmp_path / 'opening.template'}:3:1"
    assert fault.message == "there is no parameter 'nu'"


@pytest.mark.parametrize(
    ("command", "said", "hint"),
    [
        ("[no-such-program-1]", "no program 'no-such-program-1' on the search path", "Install it"),
        ("[./openin.py]", "there is no program", "opening.py"),
        ("[opening.py]", "on the search path", "'./opening.py'"),
        ("[./opening.py]", "may not be executed", "chmod +x"),
    ],
)
def test_a_command_that_does_not_exist_is_refused(tmp_path, command, said, hint):
    case = write_case(tmp_path)
    text = case.read_text()
    line = next(line for line in text.splitlines() if "command:" in line)
    case.write_text(text.replace(line, f"  command: {command}"))
    [fault] = faults_of(case)
    assert said in fault.message
    assert hint in fault.hint
    assert (fault.location.line, fault.path) == (4, "model.command[0]")


def test_functions_are_looked_for_without_running_anything(tmp_path):
    case = write_case(tmp_path, PYTHON.replace("readings", "reading"), script=SCRIPT)
    [fault] = faults_of(case)
    assert fault.message == "opening.py has no function 'reading'"
    assert "readings" in fault.hint
    case = write_case(tmp_path, PYTHON, script="def readings(:\n")
    [fault] = faults_of(case)
    assert fault.location.file == str(tmp_path / "opening.py")
    assert "this is not Python" in fault.message


def test_plain_readings_need_a_model_elsewhere(tmp_path):
    case = tmp_path / "case.yaml"
    case.write_text(
        "format: geoident-case/1\nanalysis: solid\nmaterials: {r: {elastic: isotropic, E: 1 GPa, "
        "nu: 0.2}}\ngroups: {r: r}\ngauges: {A: {kind: reading, accuracy: 1 mm}}\n"
    )
    found = faults_of(case)
    assert "no-place" in [fault.code for fault in found]


def test_without_a_model_the_ground_is_still_required(tmp_path):
    case = tmp_path / "case.yaml"
    case.write_text("format: geoident-case/1\ngroups: {}\n")
    said = [fault.message for fault in faults_of(case)]
    assert "'analysis' is missing" in said
    assert "'materials' is missing" in said
    assert any("expected at least 1" in text for text in said)


ONE_STAGE = """\
parameters:
  E: {start: 6 GPa, bounds: [1 GPa, 50 GPa], scale: log}
  K0: {start: 1.0, bounds: [0.3, 3.0]}
gauges: {H: {kind: reading, accuracy: 0.02 mm}}
readings:
  - {gauge: H, value: 1.03 mm}
  - {gauge: H, stage: end, value: 1.04 mm, accuracy: 0.1 mm}
"""


def test_with_one_stage_a_reading_need_not_name_it(tmp_path):
    case = write_case(tmp_path, PYTHON)
    case.write_text(PYTHON + ONE_STAGE.replace("  - {gauge: H, stage", "#"))
    [reading] = read_case(str(case)).case.readings
    assert (reading.channel, reading.stage) == ("H", "end")
    case.write_text(PYTHON + "stages: [{name: half}, {name: end}]\n" + ONE_STAGE)
    [fault] = faults_of(case)
    assert (fault.message, fault.code) == ("'stage' is missing", "missing-key")
    assert (fault.location.line, fault.path) == (9, "readings[0]")


WRONG = {
    "[opening.in]": ("{opening.in:", "{../opening.in:"),
    "[out.csv]": ("file: out.csv", "file: ../out.csv"),
    "[way]": (ROW, "line: 3"),
    "[command]": ("command: [", "command: [{}, "),
    "[input]": ("{opening.in: opening.template}", "{opening.in: opening.template, b.in: [3]}"),
    "[files]": ("files: [opening.py]", "files: opening.py"),
    "[time]": ("files: [opening.py]", "files: [opening.py]\n  time_limit: soon"),
    "[key]": ("files: [opening.py]", "files: [opening.py]\n  tmie_limit: 1 s"),
    "[gauge]": ("H: {kind: reading, accuracy: 0.02 mm}", "H: {kind: reading, accuracy: soon}"),
}
"""Wrong entries: what is there, what is written instead."""


@pytest.mark.parametrize("name", WRONG)
def test_nothing_is_said_that_follows_from_a_wrong_entry_of_the_model(tmp_path, name):
    case = write_case(tmp_path)
    right = case.read_text()
    case.write_text(right.replace(*WRONG[name]))
    alone = faults_of(case)
    assert len(alone) == 1, [str(fault) for fault in alone]
    (tmp_path / "opening.template").write_text(TEMPLATE + "{{Q}}\n")
    readings = tmp_path / "readings.csv"
    readings.write_text(readings.read_text().replace("V,half", "VV,half"))
    assert {f.message for f in alone} <= {f.message for f in faults_of(case)}
    case.write_text(right)
    assert {"unknown-parameter", "unknown-gauge"} <= {f.code for f in faults_of(case)}


def test_of_a_model_that_is_wrong_as_a_whole_nothing_more_is_said(tmp_path):
    case = write_case(tmp_path)
    text = case.read_text()
    for old, new in (("kind: external", "kind: extern"), ("outputs:", "output:")):
        case.write_text(text.replace(old, new))
        assert {fault.path.partition(".")[0] for fault in faults_of(case)} == {"model"}
