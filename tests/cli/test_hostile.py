"""What hostile or clumsy users tried, and what broke once."""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager

import h5py
import numpy as np
import pytest

from geoident.io.result.file import read_result
from geoident.report.text.csv_tables import csv_text
from geoident.report.text.rows import CsvTable
from geoident.workflow import fit as workflow_fit
from tests.support.commands import said_findings
from tests.support.trench import write_case

HUGE = ["--set", "in_situ.vertical=1e300 Pa"]


@pytest.mark.parametrize(
    "change",
    [HUGE, [*HUGE, "--set", "fit.method=simplex"],
     [*HUGE, "--set", "fit.method=condensation"]],
)  # fmt: skip
def test_a_stress_whose_discrepancy_would_overflow_is_refused_at_its_place(trench, run, change):
    done = run("fit", "case.yaml", "-q", *change)
    assert done.exit_code == 3
    assert "in_situ.vertical: '1e300 Pa' is too large to be computed with" in done.stderr
    assert "\n    " in done.stderr  # a remedy
    assert not (trench / "case.fit.h5").exists()


@pytest.mark.parametrize("seed", ["-1", "99999999999999999999999"])
def test_a_seed_that_is_none(trench, run, seed):
    for command in ("fit", "simulate"):
        assert run(command, "case.yaml", f"--seed={seed}").exit_code == 2


def test_nothing_to_identify(trench, run):
    given = ["--set", "parameters={}", "--set", "materials.rock.E=3 GPa", "--set", "in_situ.K0=1"]
    for command in ("fit", "scan"):
        refused = run(command, "case.yaml", *given)
        assert refused.exit_code == 3
        assert "nothing to " + command in refused.stderr
    assert run("simulate", "case.yaml", *given).exit_code == 0


def test_a_scan_that_would_never_end(trench, run):
    refused = run("scan", "case.yaml", "--set", "fit.scan.points=100000")
    assert refused.exit_code == 3
    assert "10,000,000,000 points" in refused.stderr


def test_a_prediction_does_not_cite_lines_that_the_case_does_not_have(fitted_trench, run):
    (fitted_trench / "trench.inp").rename("moved.inp")
    lost = run("predict", "case.fit.h5")
    assert lost.exit_code == 3
    assert lost.stderr.startswith("case.yaml: mesh.file: there is no file 'trench.inp'")


def test_paths_of_all_kinds(trench, run):
    folder = trench / "Höhle №1 (neu) $x 'a' -q"
    folder.mkdir()
    for name in ("case.yaml", "trench.inp", "readings.csv"):
        shutil.copy(name, folder)
    case = folder / "fall ü 1.yaml"
    (folder / "case.yaml").rename(case)
    assert run("fit", case, "-q").exit_code == 0
    result = folder / "fall ü 1.fit.h5"
    for command in ("show", "predict", "export", "check"):
        done = run(command, case if command == "check" else result)
        assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    ("command", "said"),
    [("check", b"f\xfcr.yaml: Trench\n"),
     pytest.param("fit", b"f\xfcr.fit.h5\n", marks=pytest.mark.slow)],
)  # fmt: skip
def test_a_path_that_is_not_utf_8(trench, command, said):
    if os.name != "posix":
        pytest.skip("needs file names of bytes")
    name = os.fsdecode(b"f\xfcr.yaml")
    shutil.copy("case.yaml", name)
    done = subprocess.run(
        [sys.executable, "-m", "geoident", command, name], capture_output=True, check=False
    )
    assert (done.returncode, done.stdout[: len(said)]) == (0, said), done.stderr


def test_no_input_is_overwritten_even_by_force(fitted_trench, run):
    before = {path.name: path.read_bytes() for path in fitted_trench.iterdir()}
    for arguments in (
        ["simulate", "case.yaml", "-o", "case.yaml"],
        ["simulate", "case.yaml", "-o", "trench.inp"],
        ["fit", "case.yaml", "-o", "readings.csv"],
        ["predict", "case.fit.h5", "-o", "case.fit.h5"],
        ["export", "case.fit.h5", "--table", "gauges", "-o", "case.fit.h5"],
    ):
        refused = run(*arguments, "--force")
        assert refused.exit_code == 6, arguments
        assert "is an input of this command" in refused.stderr
    assert {path.name: path.read_bytes() for path in fitted_trench.iterdir()} == before


@pytest.mark.parametrize("output", ["nowhere/", "nowhere/x.h5", "n" * 300, "readings.csv/x.h5"])
def test_a_place_where_nothing_can_be_written(trench, run, output):
    before = sorted(trench.iterdir())
    for command in ("fit", "scan"):
        refused = run(command, "case.yaml", "-o", output)
        assert refused.exit_code == 6, refused.output
        assert "choose" in refused.stderr
    assert sorted(trench.iterdir()) == before


def test_a_name_that_is_too_long(fitted_trench, run):
    name = "n" * 300
    for arguments in (["export", "case.fit.h5"], ["simulate", "case.yaml"]):
        refused = run(*arguments, "-o", name)
        assert refused.exit_code == 6, refused.output
        assert "choose a shorter name" in refused.stderr
    assert run("show", name).exit_code == 3


@pytest.mark.parametrize(
    "change",
    ["accuracy=1e19 mm", "accuracy=1e-300 m", "accuracy={reading: 1e19 mm, zero: 1 mm}",
     "accuracy={reading: 1 mm, zero: 1e19 mm}"],
)  # fmt: skip
def test_accuracies_beyond_all_measure_are_refused(trench, run, change):
    refused = run("fit", "case.yaml", "--set", f"gauges.CV.{change}")
    assert refused.exit_code == 3
    assert "implausible" in refused.stderr


@pytest.mark.parametrize("accuracy", ["1e19", "1e-30"])
def test_an_accuracy_beyond_all_measure_in_a_file_of_readings(trench, run, accuracy):
    rows = (trench / "readings.csv").read_text().splitlines()
    rows = [rows[0] + ",accuracy", rows[1] + f",{accuracy}", *(row + "," for row in rows[2:])]
    (trench / "readings.csv").write_text("\n".join(rows) + "\n")
    refused = run("fit", "case.yaml")
    assert refused.exit_code == 3
    said = f"readings.csv:2:20: the accuracy '{accuracy}' is implausible for a gauge"
    assert said in refused.stderr


def what_is_no_file(tmp_path, device):
    """Folders of a case of which one file is a pipe or a device."""
    for what in ("readings.csv", "trench.inp", "case.yaml"):
        for kind in ("pipe", "device"):
            folder = tmp_path / f"{kind} for {what}"
            folder.mkdir()
            write_case(folder)
            (folder / what).unlink()
            if kind == "pipe":
                os.mkfifo(folder / what)
            else:
                (folder / what).symlink_to(device)
            yield folder


@contextmanager
def at_most(seconds):
    """Raise where something hangs."""

    def late(number, frame):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
def test_pipes_and_devices_are_no_files(tmp_path, monkeypatch, run):
    """A device that ends, for who reads it all the same is to fail and not to fill the memory."""
    for folder in what_is_no_file(tmp_path, os.devnull):
        monkeypatch.chdir(folder)
        with at_most(60):
            refused = run("fit", "case.yaml")
        assert refused.exit_code == 3
        said = " ".join(refused.stderr.split())
        assert f"is a {folder.name.split()[0]}, not a file" in said


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
def test_readings_are_not_written_into_a_pipe(tmp_path, run):
    """What stands there was read first, without end."""
    write_case(tmp_path)
    os.mkfifo(tmp_path / "r.csv")
    with at_most(60):
        refused = run("simulate", tmp_path / "case.yaml", "-o", tmp_path / "r.csv")
    assert refused.exit_code == 6
    assert "not a regular file" in refused.stderr


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
def test_pipes_and_devices_do_not_hang(tmp_path):
    """In a process of its own, which can be ended if one does."""
    folders = list(what_is_no_file(tmp_path, "/dev/zero"))
    script = (
        "import os, sys\nfrom click.testing import CliRunner\n"
        "from geoident.cli.app import geoident\nfor folder in sys.argv[1:]:\n"
        "    os.chdir(folder)\n    done = CliRunner().invoke(geoident, ['fit', 'case.yaml'])\n"
        "    print(done.exit_code, ' '.join(done.stderr.split()))"
    )
    done = subprocess.run([sys.executable, "-c", script, *map(str, folders)], timeout=120,
                          stdout=subprocess.PIPE, text=True, check=True)  # fmt: skip
    for folder, said in zip(folders, done.stdout.splitlines(), strict=True):
        assert said.startswith("3 "), said
        assert f"is a {folder.name.split()[0]}, not a file" in said


@pytest.mark.usefixtures("fitted_trench")
def test_a_result_whose_parameters_are_no_numbers_is_damaged(run):
    with h5py.File("case.fit.h5", "r+") as file:
        file["parameters/value"][0] = np.nan
    for command in ("predict", "show"):
        refused = run(command, "case.fit.h5")
        assert refused.exit_code == 3
        assert "damaged: the value of the parameter 'E' is not a finite number" in refused.stderr


def test_two_fits_of_the_same_input_at_once(trench, run, monkeypatch):
    """Another run puts the result in its place while this one computes."""
    assert run("fit", "case.yaml", "-q", "-o", "other.fit.h5").exit_code == 0

    def meanwhile(*args):
        shutil.copy("other.fit.h5", "case.fit.h5")
        return describe(*args)

    describe = workflow_fit._result
    monkeypatch.setattr(workflow_fit, "_result", meanwhile)
    second = run("fit", "case.yaml")
    assert second.exit_code == 0
    assert (trench / "case.fit.h5").read_bytes() == (trench / "other.fit.h5").read_bytes()
    # a result of other input that appears meanwhile is still nobody's to replace
    (trench / "case.fit.h5").unlink()
    refused = run("fit", "case.yaml", "--set", "parameters.E.start=3 GPa")
    assert refused.exit_code == 6


def test_texts_of_tables_are_no_formulas(trench, run):
    text = (trench / "case.yaml").read_text().replace("  S:  {", "  '=1+1': {")
    (trench / "case.yaml").write_text(text)
    rows = (trench / "readings.csv").read_text().replace("\nS,", "\n=1+1,")
    (trench / "readings.csv").write_text(rows)
    assert run("fit", "case.yaml", "-q").exit_code == 0
    lines = run("export", "case.fit.h5", "--table", "gauges").stdout.splitlines()
    assert any(line.startswith("'=1+1,first,") for line in lines)
    assert not any(line.startswith("=") for line in lines)
    assert ",-0.598," in next(line for line in lines if line.startswith("CV,first"))
    table = CsvTable(("-a", "b"), (("@x", "-0.5"), ("+1e3", "-"), ("\tx", -1.0)))
    assert csv_text(table) == "'-a,b\n'@x,-0.5\n+1e3,'-\n'\tx,-1\n"


def test_what_is_known_from_its_prior_has_the_number_that_is_used(trench, run, run_json):
    change = ["--set", "gauges.S.accuracy=1 m", "--set", "gauges.CV.accuracy=1 m",
              "--set", "gauges.X.accuracy=1 m",
              "--set", "parameters.K0.prior={mean: 1.2, sd: 0.1}",
              "--set", "parameters.E.prior={mean: 4 GPa, sd: 0.5 GPa}"]  # fmt: skip
    (found,) = run_json("fit", "case.yaml", *change)
    K0 = found["parameters"]["K0"]
    assert (K0["value"], K0["sd"]) == pytest.approx((1.2, 0.1), rel=1e-3)
    assert not K0["determined"]
    assert found["exit_code"] == 0
    assert any("known only from its prior" in finding for finding in said_findings(found))
    estimate = read_result("case.fit.h5").parameters
    assert np.all(np.isfinite(estimate.sd))
    table = run("export", "case.fit.h5", "--table", "parameters").stdout.splitlines()
    assert table[2].startswith("K0,1.2")


def test_an_empty_cell_of_the_column_bad_may_be_a_dash(trench, run_json):
    rows = (trench / "readings.csv").read_text().splitlines()
    marks = ["-", "n/a", "—", "none", "No", "-"]
    rows = [rows[0] + ",bad", *(f"{row},{mark}" for row, mark in zip(rows[1:], marks, strict=True))]
    (trench / "readings.csv").write_text("\n".join(rows) + "\n")
    (found,) = run_json("fit", "case.yaml", "--set", "fit.stages=[first, second]")
    assert all(row["used"] and not row["bad"] for row in found["gauges"])


def test_predict_keeps_the_reason_why_a_reading_is_bad(trench, run, run_json):
    rows = (trench / "readings.csv").read_text().splitlines()
    rows = [
        rows[0] + ",bad",
        rows[1] + ",",
        rows[2] + ",hit by a truck",
        *(r + "," for r in rows[3:]),
    ]
    (trench / "readings.csv").write_text("\n".join(rows) + "\n")
    assert run("fit", "case.yaml", "-q").exit_code == 4  # two readings leave K0 open
    for change in ([], ["--case", "case.yaml"]):
        (found,) = run_json("predict", "case.fit.h5", *change, "--force")
        assert any("hit by a truck" in note for note in found["notes"])
    assert "hit by a truck" in run("show", "case.predict.h5").stdout


def test_offsets_from_utc_are_not_dropped(trench, run, run_json):
    """Two loggers, one of them on UTC: both on the clock of the first, which is said."""
    rows = ["gauge,date,value,unit", "CV,2024-03-01T10:00+02:00,-0.598,mm",
            "S,2024-03-01 07:30Z,-0.1226,mm", "X.a,2024-03-01T23:30Z,0.0627,mm"]  # fmt: skip
    (trench / "r.csv").write_text("\n".join(rows) + "\n")
    text = (trench / "case.yaml").read_text()
    dates = "dates: {first: 2024-03-01, second: 2024-03-02}\nreadings: r.csv"
    (trench / "case.yaml").write_text(text.replace("readings: readings.csv", dates))
    (found,) = run_json("check", "case.yaml")
    said = "Dates of 'r.csv' are taken as local time of the site at UTC+02:00; those at UTC+00:00 "
    assert f"{said}are converted to it." in found["notes"]
    first, second = (entry for entry in found["when_read"] if entry["stage"] != "virgin")
    assert (first["first"], first["last"]) == ("2024-03-01T09:30:00", "2024-03-01T10:00:00")
    assert second["first"] == "2024-03-02T01:30:00"  # half past eleven in the evening of Greenwich
    refused = run("check", "case.yaml", "--set", "dates.first=2024-03-01T00:00+01:00")
    assert refused.exit_code == 3
    assert "has an offset from UTC; expected the local time of the site" in refused.stderr
