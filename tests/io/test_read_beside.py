"""A case that is read in a forked process is the one that this process would read."""

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from geoident import forked
from geoident.errors import InputError
from geoident.forked import WorkBeside, may_fork
from geoident.io.case.file import read_case
from geoident.io.read_beside import case_read_beside
from geoident.workflow.running.jobs import Request, load_inputs, plan_fit

CASES = Path(__file__).parents[2] / "cases"
NAMES = ("cavern-field", "pressure-tunnel", "tunnel-3d")

pytestmark = pytest.mark.skipif(not may_fork(), reason="forks on Linux only, of one thread")


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    monkeypatch.setattr(forked, "processors", lambda: 2)
    monkeypatch.setattr(forked, "may_fork", may_fork)


def gone(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.parametrize("name", NAMES)
def test_the_case_that_is_read_beside_is_that_which_is_read_here(name):
    path = str(CASES / name / "case.yaml")
    overrides = ["title=another"]
    with case_read_beside(path, overrides) as beside:
        found = beside.found()
    here = read_case(path, overrides=overrides)
    assert found is not None
    assert found.case.title == "another"
    assert repr(found) == repr(here)
    assert found.case.source.locate(("parameters",)) == here.case.source.locate(("parameters",))


def test_who_was_given_a_case_reads_none(monkeypatch):
    path = str(CASES / "shaft" / "case.yaml")
    plain = plan_fit(Request(path))
    with case_read_beside(path, ()) as beside:
        monkeypatch.setitem(sys.modules, "geoident.io.case.file", None)  # cannot be imported
        job = plan_fit(Request(path), beside=beside)
    assert job.inputs.files == plain.inputs.files
    assert job.identity == plain.identity


def test_faults_and_models_elsewhere_are_left_to_who_asks(tmp_path, capfd):
    wrong = tmp_path / "case.yaml"
    wrong.write_text("format: geoident-case/1\nanalysis: round\n")
    with case_read_beside(str(wrong), ()) as beside, pytest.raises(InputError, match="round"):
        load_inputs(str(wrong), beside=beside)
    with case_read_beside(str(tmp_path / "none.yaml"), ()) as beside:
        assert beside.found() is None
    with case_read_beside(str(CASES / "external-ccx" / "case.yaml"), ()) as beside:
        assert beside.found() is None
    assert capfd.readouterr() == ("", "")


def test_what_comes_on_stdin_is_left_there():
    with case_read_beside("-", ()) as beside:
        assert beside is None


def test_nothing_is_forked_where_it_would_not_help(monkeypatch):
    monkeypatch.setattr(os, "fork", None)
    for name, value in (("processors", 1), ("may_fork", False)):
        with monkeypatch.context() as patch:
            patch.setattr(forked, name, lambda value=value: value)
            with WorkBeside(lambda: 3) as beside:
                assert beside.found() is None


def test_a_process_that_nobody_asks_is_ended():
    with WorkBeside(lambda: time.sleep(60)) as beside:
        process = beside._process
        assert not gone(process)
    assert gone(process)


@pytest.mark.parametrize(
    "work",
    [
        lambda: None,
        lambda: 1 / 0,
        lambda: sys.exit(0),
        lambda: os.kill(os.getpid(), signal.SIGKILL),
        lambda: lambda: 1,  # cannot be pickled
    ],
)
def test_what_fails_there_is_nothing_here(work, capfd):
    with WorkBeside(work) as beside:
        assert beside.found() is None
        assert beside.found() is None
    assert capfd.readouterr() == ("", "")


def test_large_answers_come_back_whole_and_once():
    with WorkBeside(lambda: b"x" * 5_000_000) as beside:
        process = beside._process
        assert beside.found() == b"x" * 5_000_000
        assert gone(process)
        assert beside.found() is None


@pytest.fixture
def pipes(monkeypatch):
    """File descriptors of all pipes that are made."""
    made, plain = [], os.pipe

    def recorded():
        made.extend(ends := plain())
        return ends

    monkeypatch.setattr(os, "pipe", recorded)
    return made


def is_open(descriptor):
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


@pytest.mark.parametrize("call", ["pipe", "fork"])
def test_where_no_process_can_be_had_nothing_is_lost(monkeypatch, pipes, call):
    def refuse():
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(os, call, refuse)
    with WorkBeside(lambda: 3) as beside:
        assert beside.found() is None
    assert len(pipes) == (2 if call == "fork" else 0)
    assert not any(map(is_open, pipes))


@pytest.mark.parametrize("asked", [True, False])
def test_no_file_is_left_open(pipes, asked):
    with WorkBeside(lambda: 3) as beside:
        assert not asked or beside.found() == 3
    assert len(pipes) == 2
    assert not any(map(is_open, pipes))
