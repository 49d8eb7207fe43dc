"""What only a process of its own can show: imports, signals, pipes."""

import os
import signal
import subprocess
import sys
import time

import pytest

from geoident.cli.error_boundary import combined
from geoident.io.result.file import read_result
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_scan
from geoident.workflow.scan import scan

GEOIDENT = [sys.executable, "-m", "geoident"]
HEAVY = ("numpy", "scipy", "pydantic", "h5py", "rich", "yaml", "meshio", "importlib.metadata")
GRID = ["--set", "fit.scan.points=16", "--set", "fit.reduced=false"]
posix_only = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def start(*arguments, **streams):
    return subprocess.Popen(
        [*GEOIDENT, *arguments],
        text=True,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        **streams,
    )


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["fit", "--help"]])
def test_help_imports_nothing_heavy(arguments):
    code = (
        "import sys, geoident.cli.app as app\n"
        "try: app.geoident.main(sys.argv[1:])\n"
        "except SystemExit: pass\n"
        "print('|', *sys.modules)\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    modules = told.stdout.rpartition("|")[2].split()
    assert not [name for name in modules if name in HEAVY]
    assert len(modules) < 200


NEEDLESS = (
    "scipy.optimize", "scipy.interpolate", "scipy.stats",
    "meshio", "openpyxl", "matplotlib", "rich", "arviz", "distributed",
    "geoident.workflow.predict", "geoident.workflow.sample",
)  # fmt: skip
"""What neither a check nor a simulation of a case with a mesh of its own needs."""


def test_what_is_computed_without_a_fit_imports_nothing_needless(trench):
    code = (
        "import sys\n"
        "from geoident.cli import main\n"
        "for command in ('check', 'simulate'):\n"
        "    sys.argv = ['geoident', command, 'case.yaml', '-q']\n"
        "    try: main()\n"
        "    except SystemExit as ended: assert ended.code == 0, command\n"
        "print('|', *sys.modules)\n"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    modules = printed.rpartition("|")[2].split()
    assert "geoident.forward.model" in modules
    assert [name for name in NEEDLESS if name in modules] == []


def wait_for(condition, process):
    for _ in range(3000):
        if condition():
            return
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.02)
    raise AssertionError("waited too long")


def stop_amid(trench, number):
    """Start a scan and stop it when some evaluations are kept; its exit code and stderr."""
    log = trench / "case.scan.checkpoint"
    process = start("scan", "case.yaml", *GRID)
    wait_for(lambda: log.exists() and log.stat().st_size > 8_000, process)
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=120)
    assert stdout == ""
    return process.returncode, stderr


@posix_only
def test_an_interrupted_run_goes_on_to_the_result_of_an_uninterrupted_one(trench, run):
    code, stderr = stop_amid(trench, signal.SIGINT)
    assert code == 130
    assert "The same command continues from there" in stderr
    assert "Traceback" not in stderr
    assert not (trench / "case.scan.h5").exists()
    rest = run("scan", "case.yaml", *GRID)
    assert (rest.exit_code, rest.stdout) == (0, "case.scan.h5\n")
    assert "Going on from case.scan.checkpoint" in rest.stderr
    assert not (trench / "case.scan.checkpoint").exists()
    request = Request(
        "case.yaml", overrides=("fit.scan.points=16", "fit.reduced=false"), output="whole.h5"
    )
    whole = scan(plan_scan(request), Control()).result
    resumed = read_result("case.scan.h5")
    assert resumed.counts.evaluations == whole.counts.evaluations
    assert resumed.objective == whole.objective
    assert (resumed.grid.objective == whole.grid.objective).all()


@pytest.mark.slow  # which signals stop a run: `tests/cli/test_signals.py`
@posix_only
def test_termination_leaves_a_checkpoint(trench):
    assert stop_amid(trench, signal.SIGTERM)[0] == 143
    assert (trench / "case.scan.checkpoint").exists()


@posix_only
def test_a_reader_that_goes_away_is_no_error(after):
    after(("fit", "case.yaml"))
    with start("show", *["case.fit.h5"] * 100) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 141


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")  # noqa: PTH110
def test_stdout_on_a_full_disk(after):
    after(("fit", "case.yaml"))
    with open("/dev/full", "w") as full:  # noqa: PTH123
        told = subprocess.run(
            [*GEOIDENT, "show", "case.fit.h5"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert told.returncode == 6
    assert "No space left" in told.stderr
    assert "Traceback" not in told.stderr


@pytest.mark.slow  # in the process of the tests: `test_a_case_may_come_from_stdin`
def test_stdin_is_read(trench):
    process = start("check", "-", "--json", stdin=subprocess.PIPE)
    stdout, _ = process.communicate((trench / "case.yaml").read_text(), timeout=120)
    assert process.returncode == 0
    assert '"case": "-"' in stdout


@pytest.mark.parametrize(
    ("codes", "together"),
    [([0, 0], 0), ([0, 4], 4), ([0, 3], 7), ([5], 5), ([3, 3], 7), ([0, 130, 3], 130)],
)
def test_the_exit_code_of_several_cases(codes, together):
    assert combined(codes) == together
