"""What hostile or clumsy users tried, and what broke once."""

import os
import shutil
import subprocess
import sys

import pytest

HUGE = ["--set", "in_situ.vertical=1e300 Pa"]


@pytest.mark.parametrize(
    "change",
    [HUGE, ["--set", "gauges.CV.accuracy=1e-300 m"], [*HUGE, "--set", "fit.method=simplex"],
     [*HUGE, "--set", "fit.method=condensation"]],
)  # fmt: skip
def test_a_discrepancy_that_overflows_is_not_taken_for_converged(trench, run, change):
    done = run("fit", "case.yaml", "-q", *change)
    assert done.exit_code == 5
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


def test_a_prediction_does_not_cite_lines_that_the_case_does_not_have(trench, run):
    run("fit", "case.yaml", "-q")
    (trench / "trench.inp").rename("moved.inp")
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


def test_a_path_that_is_not_utf_8(trench):
    if os.name != "posix":
        pytest.skip("needs file names of bytes")
    name = os.fsdecode(b"f\xfcr.yaml")
    shutil.copy("case.yaml", name)
    for command, said in (("check", b"f\xfcr.yaml: Trench\n"), ("fit", b"f\xfcr.fit.h5\n")):
        done = subprocess.run(
            [sys.executable, "-m", "geoident", command, name], capture_output=True, check=False
        )
        assert (done.returncode, done.stdout[: len(said)]) == (0, said), done.stderr


def test_no_input_is_overwritten_even_by_force(trench, run):
    run("fit", "case.yaml", "-q")
    before = {path.name: path.read_bytes() for path in trench.iterdir()}
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
    assert {path.name: path.read_bytes() for path in trench.iterdir()} == before


@pytest.mark.parametrize("output", ["nowhere/", "nowhere/x.h5", "n" * 300, "readings.csv/x.h5"])
def test_a_place_where_nothing_can_be_written(trench, run, output):
    before = sorted(trench.iterdir())
    for command in ("fit", "scan"):
        refused = run(command, "case.yaml", "-o", output)
        assert refused.exit_code == 6, refused.output
        assert "choose" in refused.stderr
    assert sorted(trench.iterdir()) == before


def test_a_name_that_is_too_long(trench, run):
    run("fit", "case.yaml", "-q")
    name = "n" * 300
    for arguments in (["export", "case.fit.h5"], ["simulate", "case.yaml"]):
        refused = run(*arguments, "-o", name)
        assert refused.exit_code == 6, refused.output
        assert "choose a shorter name" in refused.stderr
    assert run("show", name).exit_code == 3
