"""Tables of runs: what is read, what is left out and named, what is refused where it stands."""

import time

import numpy as np
import pytest
from support.external import fault_of, faults_of, runs_text, spread_values, write_table_case

from geoident.io.case.file import parse_case, read_case
from geoident.workflow.running.jobs import build_model, load_inputs


def test_runs_are_read_in_si_and_read_again_from_what_is_resolved(tmp_path):
    case = write_table_case(tmp_path, 20)
    loaded = read_case(str(case))
    table = loaded.case.elsewhere
    values = spread_values(20)
    np.testing.assert_allclose(table.values, values, rtol=1e-12)
    assert table.names == ("E", "K0")
    assert table.readings.shape == (20, 2, 3)
    text = runs_text(values).splitlines()[1].split(",")
    assert table.readings[0, 1, 2] == pytest.approx(1e-3 * float(text[-1]), rel=1e-12)
    again = parse_case(loaded.resolved, str(case))
    assert again.case.elsewhere == table
    assert again.resolved == loaded.resolved


def test_other_spellings_mean_the_same(tmp_path):
    case = write_table_case(tmp_path, 20)
    before = read_case(str(case)).case.elsewhere
    runs = tmp_path / "runs.csv"
    text = runs.read_text().replace("E [GPa]", "E (GPa)").replace("run,", "remark,")
    text = "# made by hand\n" + text.replace(",", ";").replace(".", ",").replace("e-", "D-")
    runs.write_text("\ufeff" + text, encoding="utf-8")
    case.write_text(case.read_text().replace("runs.csv}", "runs.csv, ignore: [remark]}"))
    found = read_case(str(case)).case.elsewhere
    np.testing.assert_allclose(found.values, before.values, rtol=1e-12)
    np.testing.assert_allclose(found.readings, before.readings, rtol=1e-12)


def test_at_and_the_sign_for_it_mean_the_same(tmp_path):
    case = write_table_case(tmp_path, 20)
    before = read_case(str(case)).case.elsewhere
    runs = tmp_path / "runs.csv"
    runs.write_text(runs.read_text().replace("H @ open", "H at open").replace("V @ ", "V at "))
    np.testing.assert_array_equal(read_case(str(case)).case.elsewhere.readings, before.readings)


def test_a_gauge_and_a_stage_may_have_the_word_at_in_their_names(tmp_path):
    case = write_table_case(tmp_path, 20)
    before = read_case(str(case)).case.elsewhere
    for file in (case, tmp_path / "runs.csv", tmp_path / "readings.csv"):
        text = file.read_text().replace("open", "open at last")
        file.write_text(text.replace("V @", "V at C @").replace("V:", "V at C:")
                        .replace("\nV,", "\nV at C,"))  # fmt: skip
    np.testing.assert_array_equal(read_case(str(case)).case.elsewhere.readings, before.readings)


def test_all_that_is_wrong_in_a_table_is_said_at_once(tmp_path):
    case = write_table_case(tmp_path, 20)
    also = "  X: {kind: reading, accuracy: 1 mm}\n  D: {kind"
    case.write_text(case.read_text().replace("  D: {kind", also))
    runs = tmp_path / "runs.csv"
    text = runs.read_text().replace("E [GPa]", "E [mm]").replace("V @ open [mm]", "V @ ope [mm]")
    runs.write_text(text.replace("\n3,", "\n3,soft").replace("\n6,", "\n6,,"))
    found = {(f.code, f.location.line) for f in faults_of(case) if f.location.file == str(runs)}
    assert found == {("unit", 1), ("unknown-stage", 1), ("bad-number", 4), ("bad-row", 7)}
    assert {f.path for f in faults_of(case) if f.code == "no-column"} == {"gauges.X"}


def test_a_run_that_failed_is_left_out_and_named(tmp_path):
    case = write_table_case(tmp_path, 30)
    lines = (tmp_path / "runs.csv").read_text().splitlines()
    for number, mark in ((5, "nan"), (7, ""), (9, "failed")):
        lines[number] = ",".join([*lines[number].split(",")[:-1], mark])
    (tmp_path / "runs.csv").write_text("\n".join(lines))
    model = build_model(load_inputs(str(case)))
    assert len(model.case.elsewhere) == 27
    [note] = [note for note in model.notes if "left out" in note]
    assert note.startswith("3 of 30 runs in runs.csv have failed and are left out: line 6 (")
    assert "line 8 (D @ open [mm] is empty)" in note
    assert "line 10 (D @ open [mm] is 'failed')" in note


def test_bounds_a_little_beyond_the_runs_are_moved_and_that_is_said(tmp_path):
    case = read_case(str(write_table_case(tmp_path, 40))).case
    E = [E for E, _ in spread_values(40)]
    assert (case.parameters[0].lower, case.parameters[0].upper) == pytest.approx((min(E), max(E)))
    assert any(
        note.startswith("bounds are taken where the runs end: E from 1.")
        for note in case.elsewhere.notes
    )


@pytest.mark.parametrize(
    ("old", "new", "line", "code", "said"),
    [
        ("E [GPa]", "E", 1, "unit", "the column 'E' has no unit, and is a pressure"),
        ("E [GPa]", "E [mm]", 1, "unit", "'mm' is not a unit of a pressure"),
        ("E [GPa]", "E [GPaa]", 1, "unit", "there is no unit 'GPaa'"),
        ("E [GPa]", "Emod [GPa]", 1, "unknown-column", "'Emod' is neither a parameter nor a gauge"),
        ("V @ open [mm]", "V @ ope [mm]", 1, "unknown-stage", "there is no stage 'ope'"),
        ("V @ open [mm]", "V [mm]", 1, "no-stage", "does not say of which stage"),
        ("V @ open [mm]", "H @ open [mm]", 1, "duplicate-column", "two columns hold 'H @ open'"),
        ("V @ open [mm]", "V @ open", 1, "unit", "the column 'V' has no unit, and is a length"),
        ("\n3,", "\n3,,", 4, "bad-row", "10 cells; expected 9"),
        ("\n3,", "\n3,soft", 4, "bad-number", "of 'E' is not a number"),
    ],
)
def test_what_is_wrong_in_a_table_is_said_where_it_stands(tmp_path, old, new, line, code, said):
    case = write_table_case(tmp_path, 20)
    runs = tmp_path / "runs.csv"
    assert old in runs.read_text()
    runs.write_text(runs.read_text().replace(old, new, 1))
    fault = fault_of(case, code, said)
    assert (fault.location.file, fault.location.line) == (str(runs), line)
    assert fault.location.column
    assert fault.hint or code == "unit"


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        ("E [GPa]", "EE [GPa]", "Did you mean 'E'? A column that is not wanted"),
        ("V @ ", "h @ ", "Without a column: V. A column"),
    ],
)
def test_a_hint_names_what_has_no_column_yet(tmp_path, old, new, hint):
    case = write_table_case(tmp_path, 20)
    runs = tmp_path / "runs.csv"
    assert old in runs.read_text()
    runs.write_text(runs.read_text().replace(old, new))
    [fault] = [fault for fault in faults_of(case) if fault.code == "unknown-column"][:1]
    assert fault.hint.startswith(hint)


def column(text, name, make):
    """The table with other numbers in a column."""
    head, *rows = (line.split(",") for line in text.splitlines())
    k = head.index(name)
    for n, row in enumerate(rows):
        row[k] = make(n, row)
    return "\n".join(",".join(row) for row in [head, *rows])


@pytest.mark.parametrize(
    ("change", "line", "code", "said"),
    [
        (lambda t: "\n".join(t.splitlines()[:7]), 7, "too-few",
         "found 6 runs; 2 parameters need 9 at least"),
        (lambda t: t + t.splitlines()[4] + "\n", 22, "duplicate-run", "of the run in line 5"),
        (lambda t: column(t, "K0", lambda n, row: "0.8"), 1, "constant-column",
         "'K0' is the same in all runs"),
        (lambda t: column(t, "H @ open [mm]", lambda n, row: "0.8"), 1, "constant-column",
         "'H @ open [mm]' is the same in all runs"),
        (lambda t: column(t, "K0", lambda n, row: str(0.3 + 0.05 * float(row[1]))), 1,
         "tied-columns", "E, K0 change only together"),
        (lambda t: column(t, "E [GPa]", lambda n, row: str(n - 1)), 1, "out-of-range",
         "has the scale log, and is not positive"),
        (lambda t: "", 0, "empty", "the table is empty"),
    ],
)  # fmt: skip
def test_runs_through_which_no_surface_goes_are_refused(tmp_path, change, line, code, said):
    case = write_table_case(tmp_path, 20)
    runs = tmp_path / "runs.csv"
    runs.write_text(change(runs.read_text()))
    fault = fault_of(case, code, said)
    assert (fault.location.file, fault.location.line) == (str(runs), line)


@pytest.mark.parametrize(
    ("old", "new", "path", "code", "said"),
    [
        ("[1 GPa,", "[0.5 GPa,", "parameters.E.bounds[0]", "beyond-runs",
         "the bound 0.5 GPa is beyond the runs of runs.csv, which go from"),
        ("2.85]", "4.0]", "parameters.K0.bounds[1]", "beyond-runs", "the bound 4 is beyond"),
        ("stages:", "  nu: {start: 0.2, bounds: [0.1, 0.4]}\nstages:", "parameters.nu",
         "no-column", "the parameter 'nu' has no column in runs.csv"),
        ("  D: {kind", "  X: {kind: reading, accuracy: 1 mm}\n  D: {kind", "gauges.X",
         "no-column", "'X' has no column in runs.csv"),
        ("runs.csv}", "run.csv}", "model.file", "missing-file", "there is no file"),
        ("runs.csv}", "runs.csv, surface: spline}", "model.surface", "not-listed", "'spline'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_case_is_said_in_the_case(tmp_path, old, new, path, code, said):
    case = write_table_case(tmp_path, 20)
    assert old in case.read_text()
    case.write_text(case.read_text().replace(old, new))
    fault = fault_of(case, code, said)
    assert (fault.location.file, fault.path) == (str(case), path)
    assert fault.location.line


def test_a_column_to_be_passed_over_must_be_there(tmp_path):
    case = write_table_case(tmp_path, 20)
    case.write_text(case.read_text().replace("runs.csv}", "runs.csv, ignore: [remark]}"))
    [fault] = faults_of(case)
    assert fault.message == "there is no column 'remark' that 'ignore' of the case names"


def test_thousands_of_columns_that_nobody_knows_are_refused_soon(tmp_path):
    """Each once had all of the header read again: 1,600 took 8 s."""
    case = write_table_case(tmp_path, 20)
    runs = tmp_path / "runs.csv"
    head, *rest = runs.read_text().splitlines()
    more = [f"x{k} [mm]" for k in range(5000)]
    runs.write_text("\n".join([",".join([head, *more]), *rest]) + "\n")
    begun = time.process_time()
    faults = faults_of(case)
    assert time.process_time() - begun < 5.0
    assert {fault.code for fault in faults} <= {"unknown-column", "bad-row"}
    assert faults[0].message == "the column 'x0' is neither a parameter nor a gauge"


def test_of_one_stage_a_column_need_not_name_it(tmp_path):
    case = write_table_case(tmp_path, 20)
    runs = tmp_path / "runs.csv"
    head, *rows = runs.read_text().splitlines()
    keep = [0, 1, 2, 4]
    lines = [",".join(np.array(line.split(","))[keep]) for line in (head, *rows)]
    runs.write_text("\n".join(lines).replace("H @ open", "H"))
    case.write_text(
        "format: geoident-case/1\nmodel: {kind: table, file: runs.csv}\n"
        "parameters:\n  E: {start: 6 GPa, bounds: [1 GPa, 50 GPa], scale: log}\n"
        "  K0: {start: 1.0, bounds: [0.3, 2.85]}\n"
        "gauges: {H: {kind: reading, accuracy: 0.1 mm}}\n"
        "readings: [{gauge: H, value: 9 km}]\n"
    )
    model = build_model(load_inputs(str(case)))
    [note] = [note for note in model.notes if note.startswith("readings beyond")]
    assert "H at end (9e+06 mm; the runs gave " in note
