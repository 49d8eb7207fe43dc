"""Tasks in processes: killed, hanging, raising, stopped; none is lost and none stays behind."""

import json
import os
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from geoident.workflow.executing import environment as own
from geoident.workflow.executing.environment import share_of_cores
from geoident.workflow.executing.executor import in_order, usable_cores
from geoident.workflow.executing.processes import LocalProcesses
from tests.support.real_cluster import runs, wait_until
from tests.support.tasks import broken, dying, findable, obedient, squares

ROOT = str(Path(__file__).parents[3])
KILLS = [pytest.param(2), pytest.param(30, marks=pytest.mark.slow)]


def test_answers_are_those_of_their_tasks_whatever_process_gives_them():
    with LocalProcesses(2, squares) as processes:
        found = list(in_order(processes.run(range(40))))
        again = list(in_order(processes.run(range(5))))  # the processes are still there
        pids = processes.processes
    assert [answer.value[0] for answer in found] == [n * n for n in range(40)]
    assert [answer.value[0] for answer in again] == [n * n for n in range(5)]
    assert {answer.value[1] for answer in found} == set(pids)
    assert not any(runs(pid) for pid in pids)


def test_processes_look_for_modules_in_no_current_folder(tmp_path, monkeypatch):
    """Also where who asks does, as every session of Python that is begun there."""
    for name in ("planted", "multiprocessing"):
        (tmp_path / f"{name}.py").write_text(f"open('{name}.mark', 'w').close()\n")
    monkeypatch.chdir(tmp_path)
    path = ["", *sys.path, str(tmp_path)]
    monkeypatch.setattr(sys, "path", path)
    with LocalProcesses(1, findable) as processes:
        (answer,) = processes.run([["planted", "click"]])
    assert answer.value == ["click"]
    assert not list(tmp_path.glob("*.mark"))
    assert sys.path is path
    assert "PYTHONSAFEPATH" not in os.environ


@pytest.mark.parametrize("kills", KILLS)
def test_no_task_is_lost_when_processes_are_killed_at_random(kills):
    """Who asks is a process of its own: were it to end with its workers, it alone would."""
    asked = subprocess.run(
        [sys.executable, "-X", "faulthandler", "-m", "tests.support.killed_at_random", str(kills)],
        env={**os.environ, "PYTHONPATH": ROOT},
        capture_output=True,
        text=True,
        check=False,
    )
    assert asked.returncode == 0, asked.stderr
    told = json.loads(asked.stdout)
    assert told["killed"] == kills
    assert told["answers"] == [n * n for n in range(len(told["answers"]))]
    assert len(told["answers"]) >= 100
    assert told["losses"] > 0 or kills == 2  # two may meet processes between two tasks
    assert len(told["processes"]) > kills
    assert not any(runs(pid) for pid in told["processes"])


def test_a_task_that_kills_three_processes_is_set_aside_and_the_others_go_on(tmp_path):
    words = ["fine", "die", "die once", "also fine"]
    tasks = [(word, tmp_path / word.replace(" ", "-")) for word in words]
    with LocalProcesses(2, obedient) as processes:
        fine, dead, once, also = in_order(processes.run(tasks))
    assert (fine.value, also.value, once.value) == ("fine", "also fine", "die once")
    assert once.losses == ("ended with exit code 3",)
    assert dead.set_aside
    assert dead.losses == ("was killed (SIGKILL; out of memory?)",) * 3
    assert len((tmp_path / "die").read_text().splitlines()) == 3


def test_a_task_that_hangs_is_ended_after_its_time(tmp_path):
    tasks = [("hang", tmp_path / "a"), ("fine", tmp_path / "b")]
    with LocalProcesses(1, obedient, time_limit=0.3, retries=1) as processes:
        hung, fine = in_order(processes.run(tasks))
    assert fine.value == "fine"
    assert hung.set_aside
    assert hung.losses == ("took longer than 0.3 s",) * 2


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are known by /proc")
def test_the_program_of_a_task_that_is_killed_ends_with_it(tmp_path):
    task, program = ("hang with a program", tmp_path / "a"), tmp_path / "a.program"
    with LocalProcesses(1, obedient) as processes:
        asker = threading.Thread(target=lambda: list(processes.run([task])))
        asker.start()
        wait_until(lambda: program.exists() and program.read_text().endswith(" "))
        processes.kill()
        asker.join()
    wait_until(lambda: not runs(int(program.read_text())))


def test_a_stop_lets_tasks_end_and_begins_no_more(tmp_path):
    tasks = [("wait for the wish", tmp_path / str(n)) for n in range(5)]
    with LocalProcesses(2, obedient) as processes:
        timer = threading.Thread(target=_stop_when_begun, args=(processes, tmp_path))
        timer.start()
        found = list(processes.run(tasks))
        timer.join()
    begun = len(list(tmp_path.iterdir()))
    assert [a.value for a in found if not a.stopped] == ["wished"] * begun
    assert 1 <= begun <= 2


def _stop_when_begun(processes, folder):
    while not list(folder.iterdir()):
        time.sleep(0.01)
    processes.ask_to_stop()


def test_what_a_task_raises_is_raised_and_leaves_no_process(tmp_path):
    tasks = [("raise", tmp_path / "a"), ("hang", tmp_path / "b")]
    with LocalProcesses(2, obedient) as processes:
        with pytest.raises(ZeroDivisionError, match="nobody thought"):
            list(processes.run(tasks))
        pids = processes.processes
    assert not any(runs(pid) for pid in pids)


@pytest.mark.parametrize(
    ("set_up", "error"), [(broken, OSError), (dying, RuntimeError)], ids=["raises", "dies"]
)
def test_processes_that_cannot_begin_are_not_started_for_ever(set_up, error):
    with LocalProcesses(1, partial(set_up)) as processes, pytest.raises(error):
        list(processes.run([1]))


def test_processes_that_are_killed_before_they_begin_are_started_again():
    """As by who frees memory: three in a row are no reason to give up."""
    killed = []

    def killer(processes):
        while len(killed) < 4:
            for pid in set(processes.processes) - set(killed):
                os.kill(pid, 9)
                killed.append(pid)
            time.sleep(0.01)

    with LocalProcesses(1, squares) as processes:
        thread = threading.Thread(target=killer, args=(processes,))
        thread.start()
        (answer,) = processes.run([3])
        thread.join()
    assert answer.value[0] == 9


def test_answers_that_nobody_waits_for_are_not_those_of_later_tasks(tmp_path):
    with LocalProcesses(2, squares) as processes:
        first = processes.run(range(50))
        next(first)
        first.close()
        found = list(in_order(processes.run([7, 8])))
    assert [answer.value[0] for answer in found] == [49, 64]


ORPHAN = """
from geoident.workflow.executing.processes import LocalProcesses
from tests.support.tasks import obedient
with LocalProcesses(1, obedient) as processes:
    list(processes.run([("hang with a program", {file!r})]))
"""


def test_a_process_that_hangs_ends_with_who_asks_even_if_that_is_killed(tmp_path):
    begun = tmp_path / "begun"
    asker = subprocess.Popen(
        [sys.executable, "-c", ORPHAN.format(file=str(begun))],
        env={**os.environ, "PYTHONPATH": ROOT},
    )
    program = Path(f"{begun}.program")
    wait_until(lambda: program.exists() and program.read_text().endswith(" "))
    pids = int(begun.read_text()), int(program.read_text())
    assert all(map(runs, pids))
    asker.kill()
    asker.wait()
    wait_until(lambda: not any(map(runs, pids)))


@pytest.mark.parametrize("omp", [None, "1"])
def test_each_process_has_its_share_of_the_cores_or_what_is_said(monkeypatch, omp):
    """With OMP_NUM_THREADS one process has the bits of several; no library goes past it."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "GEOIDENT_CORES")
    for name in names:
        monkeypatch.delenv(name, raising=False)
    if omp:
        monkeypatch.setenv("OMP_NUM_THREADS", omp)
    monkeypatch.setattr(own, "usable_cores", lambda: 8)
    found = share_of_cores(2)
    assert [found[name] for name in names] == [omp or "4"] * 3 + ["4"]


def test_a_share_of_the_cores_is_all_that_may_be_used(monkeypatch):
    monkeypatch.setenv("GEOIDENT_CORES", "1")
    assert usable_cores() == 1
    monkeypatch.setenv("GEOIDENT_CORES", "many")
    assert usable_cores() >= 1
