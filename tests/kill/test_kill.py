"""kill -9 at random moments: what stood there stays readable, and the next run completes.

The runs are forks of one process that has imported everything, so that the moments fall into the
work and not into the start of Python.
"""

import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from geoident.forward.reduced.response import ReducedResponse
from geoident.forward.reducible import ReducibleResponse
from geoident.io.result.file import read_result
from geoident.io.result.vtkhdf import sidecar_target
from tests.support.commands import run_command
from tests.support.trench import write_case

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

MOMENTS = [pytest.param(3), pytest.param(50, marks=pytest.mark.slow)]
INPUTS = {"case.yaml", "readings.csv", "trench.inp"}
RESULTS = {"case.fit.h5", "case.fit.vtkhdf"}

NURSERY = """
import json, os, signal, sys, time
import geoident.cli.commands.fit, geoident.cli.jobs, geoident.workflow.fit, geoident.io.case.file
import geoident.forward.model, geoident.io.result.file, geoident.io.mesh.file, geoident.fem.solvers
import geoident.fem.solvers.iterative, geoident.cli.trust
from contextlib import suppress
with suppress(ImportError):
    import geoident.fem.solvers.cholmod
with suppress(ImportError):
    import geoident.fem.solvers.pardiso
from geoident.cli.app import geoident as program
if sys.argv[1:] == ["report"]:
    import geoident.report.page.html
for line in sys.stdin:
    folder, seconds, words = json.loads(line)
    begun = time.monotonic()
    pid = os.fork()
    if pid == 0:
        os.chdir(folder)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nothing, stream)
        try:
            program.main(words, prog_name="geoident")
        except SystemExit as end:
            os._exit(int(end.code or 0))
        os._exit(99)
    if seconds is not None:
        time.sleep(seconds)
        os.kill(pid, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    print(json.dumps([code, time.monotonic() - begun]), flush=True)
"""


class Nursery:
    """A process that forks runs and kills them.

    Args:
        kind: ``report`` to have its parts imported.
    """

    def __init__(self, *kind):
        one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", NURSERY, *kind], text=True, bufsize=1,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, **one_thread},
        )  # fmt: skip

    def run(self, words, *, seconds=None):
        """Run something in the current folder.

        Exit code (-9 if it was killed after some seconds) and duration.
        """
        self._process.stdin.write(json.dumps([str(Path.cwd()), seconds, words]) + "\n")
        return json.loads(self._process.stdout.readline())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()


@pytest.fixture(scope="module")
def nursery():
    """One that many tests ask."""
    with Nursery() as made:
        yield made


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A case of which little is computed: what is written is asked for."""
    case = write_case(tmp_path)
    text, little = case.read_text(), "mesh_error: false, model_error: none, backtest: false"
    assert "mesh_error: false" in text
    case.write_text(text.replace("mesh_error: false", little))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(folder):
    """Names of all files, and those of temporaries apart."""
    found = {path.name for path in folder.iterdir() if path.is_file()}
    parts = {name for name in found if name.startswith(".") and name.endswith(".part")}
    return found - parts, parts


def values(path):
    return tuple(read_result(path).parameters.values)


def moments(count):
    """Parts of a run's duration after which to kill: most of them late, where files are written."""
    chance = random.Random(4)
    return [chance.uniform(0.0, 1.05) ** 0.5 for _ in range(count)]


@pytest.mark.parametrize("count", MOMENTS)
def test_fit(here, nursery, count):
    words = ["fit", "case.yaml", "--force"]
    other = [*words, "--set", "in_situ.vertical=1.1 MPa"]
    duration = min(nursery.run([*words, "--fresh"])[1] for _ in range(2))
    first = values("case.fit.h5")
    assert nursery.run(other)[0] == 0
    second = values("case.fit.h5")
    assert first != second
    killed = 0
    for number, part in enumerate(moments(count)):
        fresh = ["--fresh"] if number % 3 else []
        run = [*(words, other)[number % 2], *fresh]
        code, seconds = nursery.run(run, seconds=part * duration)
        if code == -9:
            killed += 1
        else:  # the machine is quicker now than when the duration was measured
            duration = min(duration, seconds)
        assert code in (-9, 0)
        whole, _ = names(here)
        assert INPUTS | RESULTS <= whole <= INPUTS | RESULTS | {"case.fit.checkpoint"}
        assert values("case.fit.h5") in (first, second)
        assert sidecar_target("case.fit.vtkhdf") == "case.fit.h5"
    assert killed >= count // 2
    for last, expected in ((words, first), (other, second)):
        assert nursery.run(last)[0] == 0
        assert values("case.fit.h5") == expected
    assert names(here) == (INPUTS | RESULTS, set())


@pytest.mark.parametrize("count", MOMENTS)
def test_first_fit(here, nursery, count):
    """Nothing stands there before: there is a whole result or none."""
    words = ["fit", "case.yaml"]
    duration = nursery.run(words)[1]
    expected = values("case.fit.h5")
    for part in moments(count):
        for name in (*RESULTS, "case.fit.checkpoint"):
            (here / name).unlink(missing_ok=True)
        nursery.run(words, seconds=part * duration)
        if (here / "case.fit.h5").exists():
            assert values("case.fit.h5") == expected
        assert nursery.run(words)[0] == 0
        assert values("case.fit.h5") == expected
    assert names(here) == (INPUTS | RESULTS, set())


SCAN = ["scan", "case.yaml", "--set", "fit.scan.points=11"]


def scanned(words, *, at=None):
    """What a scan in a process of its own computes: analyses, and answers of the reduced model.

    It kills itself when it has computed so many of a kind.
    """
    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        for number, (of, name) in enumerate(WORK):
            setattr(of, name, counting(number, getattr(of, name), writer, at))
        code = run_command(*words).exit_code
        os._exit(code)
    os.close(writer)
    with os.fdopen(reader, "rb") as counts:
        done = counts.read()
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return code, [done.count(bytes([number])) for number in range(len(WORK))]


WORK = [(ReducibleResponse, "evaluation"), (ReducedResponse, "estimated")]


def counting(number, function, writer, at):
    done = []

    def counted(*given, **named):
        if at == (number, len(done)):
            os.kill(os.getpid(), signal.SIGKILL)
        found = function(*given, **named)
        done.append(1)
        os.write(writer, bytes([number]))
        return found

    return counted


@pytest.mark.parametrize(
    ("words", "at"),
    [
        pytest.param([], (1, 60), id="among answers of the reduced model"),
        pytest.param(["-j", "2"], (1, 60), id="in two processes", marks=pytest.mark.slow),
        pytest.param(
            ["--set", "fit.reduced=false"],
            (0, 60),
            id="without a reduced model",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_scan_goes_on_where_it_was_killed(here, words, at):
    """What the model has computed is not computed again; the reduced model is made once."""
    words = [*SCAN, *words]
    code, whole = scanned(words)
    assert code == 0
    expected = read_result("case.scan.h5")
    (here / "case.scan.h5").unlink()
    code, before = scanned(words, at=at)
    assert code == -signal.SIGKILL
    assert before[at[0]] == at[1]
    code, after = scanned(words)
    assert code == 0
    assert before[0] + after[0] == whole[0]
    found = read_result("case.scan.h5")
    np.testing.assert_array_equal(found.grid.objective, expected.grid.objective)
    assert found.counts.evaluations == expected.counts.evaluations
    assert names(here) == (INPUTS | {"case.scan.h5"}, set())


@pytest.mark.slow
def test_report(here):
    pytest.importorskip("matplotlib", reason="needs matplotlib")
    assert run_command("fit", "case.yaml", "-q").exit_code == 0
    words = ["report", "case.fit.h5", "--figures", "figures", "--force"]
    page = Path("case.fit.html")
    with Nursery("report") as nursery:
        code, duration = nursery.run(words)
        assert code == 0
        expected = page.read_bytes()
        figures = {path.name for path in Path("figures").iterdir()}
        killed = 0
        for part in moments(50):
            page.write_bytes(b"the old page")
            killed += nursery.run(words, seconds=part * duration)[0] == -9
            assert page.read_bytes() in (b"the old page", expected)
            whole, _ = names(Path("figures"))
            assert whole == figures
            for name in whole:
                ElementTree.parse(Path("figures") / name)
        assert killed > 25
        assert nursery.run(words)[0] == 0
    assert page.read_bytes() == expected
    assert names(Path("figures")) == (figures, set())
    assert names(here)[1] == set()
