"""What a worker of dask does with our tasks, on a worker and processes that are played."""

import platform
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from geoident import __version__
from geoident.workflow.executing import relay
from geoident.workflow.executing.executor import Answered
from geoident.workflow.executing.growth import Resumable
from geoident.workflow.executing.parcel import folder_of_process, packed
from geoident.workflow.executing.relay import Order, Relay, WorkerRefused, own_versions, problem_of
from tests.support.cluster_tasks import squares_in


class Pool:
    """One process, whose answers are given; a word in place of one is what it does then."""

    def __init__(self, *answers):
        self.answers, self.tasks, self.said = list(answers), [], []
        self.processes = (7,)

    def run(self, tasks):
        self.tasks += tasks
        answer = self.answers.pop(0)
        if callable(answer):
            answer = answer()
        return () if answer is None else (answer,)

    def kill(self):
        self.said.append("kill")

    def ask_to_stop(self):
        self.said.append("stop")

    def __exit__(self, *_):
        self.said.append("exit")


def lost(why, process=7):
    return Answered(0, None, (why,), process=process)


DONE = Answered(0, "done", process=7)


@pytest.fixture
def parcel(tmp_path):
    (tmp_path / "case").write_text("one")
    return packed({"case": tmp_path / "case"})


@pytest.fixture
def worker(tmp_path):
    state = SimpleNamespace(nthreads=3)
    return SimpleNamespace(state=state, local_directory=str(tmp_path / "local"), plugins={})


def order(files, **changes):
    settled = Order("name", files, own_versions(), squares_in, 1.5, 2)
    return replace(settled, **changes)


def set_up(worker, files, *pools, **changes):
    """A relay on a worker, whose processes are given."""
    made = Relay(order(files, **changes))
    worker.plugins[changes.get("name", "name")] = made
    made.setup(worker)
    coming = iter(pools)
    made._new_pool = lambda: next(coming)
    return made


def answer(made, task="task", key="key"):
    return made.answer(key, 5, task, lambda part: None)


def folder_on(worker, parcel):
    (found,) = Path(worker.local_directory).glob("geoident-*")
    assert found.name == f"geoident-{parcel.digest[:16]}"
    return found


def test_files_lie_there_and_processes_are_set_up_with_them(worker, parcel):
    made = Relay(order(parcel))
    made.setup(worker)
    folder = folder_on(worker, parcel)
    assert (folder / "case").read_text() == "one"
    pool = made._new_pool()
    assert pool._set_up.args == (folder,)
    assert (pool._time_limit, pool._retries, pool._sharing) == (1.5, 0, 3)
    worker.plugins["name"] = made
    assert problem_of("name", worker) == ""
    assert problem_of("other", worker) == ""


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"versions": {**own_versions(), "numpy": "0.1"}}, r"has other versions: numpy .* \(here"),
        ({"versions": {"scipy": "1", "h5py": "2"}}, r"versions: scipy .* \(here 1\), h5py"),
        ({"parcel": packed({}, programs=("no-such",))}, "has no program 'no-such'"),
    ],
)
def test_a_worker_that_cannot_says_why_and_takes_no_task(worker, parcel, changes, said):
    made = set_up(worker, parcel, Pool(DONE), **changes)
    with pytest.raises(WorkerRefused, match=said):
        answer(made)
    assert problem_of("name", worker) == made.problem
    assert not Path(worker.local_directory).exists()


def test_files_that_were_garbled_are_said(worker, parcel):
    garbled = replace(parcel, contents=dict.fromkeys(parcel.contents, b"two"))
    assert "case was garbled on its way" in set_up(worker, garbled).problem


def test_versions_are_those_that_run():
    found = own_versions()
    assert (found["geoident"], found["python"]) == (__version__, platform.python_version())
    assert set(found) == {"geoident", "python", "numpy", "scipy", "h5py"}


def test_a_process_that_has_answered_takes_the_next_task(worker, parcel):
    pool = Pool(DONE, replace(DONE, value="more"))
    made = set_up(worker, parcel, pool)
    assert answer(made) == replace(DONE, number=5)
    assert answer(made, "other").value == "more"
    assert pool.tasks == ["task", "other"]
    assert pool.said == []


def test_a_process_whose_function_raised_is_ended(worker, parcel):
    def broken():
        raise ZeroDivisionError

    pools = Pool(broken), Pool(DONE)
    made = set_up(worker, parcel, *pools)
    with pytest.raises(ZeroDivisionError):
        answer(made)
    assert pools[0].said == ["exit"]
    assert answer(made).value == "done"


@pytest.mark.parametrize(("times", "value"), [(2, "done"), (3, None)])
def test_a_task_is_begun_again_as_often_as_it_may(worker, parcel, times, value):
    """Two retries: the third loss sets it aside."""
    pool = Pool(*(lost(f"loss {n}") for n in range(times)), DONE)
    found = answer(set_up(worker, parcel, pool))
    assert (found.value, found.number) == (value, 5)
    assert found.losses == tuple(f"loss {n}" for n in range(times))
    assert len(pool.tasks) == 3


class Grown(Resumable):
    growing = ("points.h5",)


def test_what_a_lost_process_has_written_goes_on(worker, parcel):
    def lose():
        mine.mkdir()
        (mine / "points.h5").write_bytes(b"half")
        return lost("gone")

    pool = Pool(lose, DONE)
    made = set_up(worker, parcel, pool)
    mine = folder_of_process(folder_on(worker, parcel), 7)
    assert answer(made, Grown({})).value == "done"
    assert [task.kept for task in pool.tasks] == [{}, {"points.h5": b"half"}]
    assert not mine.exists()


def test_a_task_that_nobody_waits_for_ends_with_its_process(worker, parcel):
    def drop(start, finish, key):
        def happens():
            made.transition(key, start, finish)
            return lost("was killed")

        return happens

    spared = [("executing", "memory"), ("ready", "released")]
    for start, finish in spared:
        pool = Pool(drop(start, finish, "key"), DONE)
        made = set_up(worker, parcel, pool)
        assert answer(made).value == "done"
        assert pool.said == []
    for finish in ("released", "cancelled", "forgotten"):
        pool = Pool(drop("executing", finish, "other"), drop("executing", finish, "key"))
        made = set_up(worker, parcel, pool)
        assert answer(made).losses == ("was killed",) * 2
        assert pool.said == ["kill", "exit"]


@pytest.mark.parametrize("at_once", [False, True])
def test_a_stop_reaches_the_tasks_that_run_and_no_other_is_begun(worker, parcel, at_once):
    def stopped():
        made.stop(at_once=at_once)

    idle, busy = Pool(DONE), Pool(stopped)
    made = set_up(worker, parcel, busy)
    made._pools.idle.append(idle)
    made._pools.idle.insert(0, busy)
    assert answer(made, key="first").value == "done"  # the one that answered last goes first
    made._pools.idle.reverse()
    found = answer(made)
    assert (found.number, found.value, found.stopped) == (5, None, True)
    assert busy.said == (["kill", "exit"] if at_once else ["stop", "exit"])
    assert idle.said == (["kill", "exit"] if at_once else [])
    assert answer(made) == Answered(5, None, stopped=True)


def test_files_go_with_the_last_executor_that_has_them(worker, parcel):
    one, two = (set_up(worker, parcel, name=name) for name in ("one", "two"))
    folder = folder_on(worker, parcel)
    (folder.parent / f"{folder.name}.of.7").mkdir()
    one.teardown(worker)
    assert list(folder.parent.iterdir()) == [folder]
    del worker.plugins["one"]
    two.teardown(worker)
    assert list(folder.parent.iterdir()) == []


def test_a_task_is_told_to_have_begun_and_where(worker, parcel, monkeypatch):
    made = set_up(worker, parcel, Pool(DONE))
    events = []
    worker.address = "tcp://there"
    worker.log_event = lambda topic, event: events.append((topic, event))
    worker.get_current_task = lambda: "key"
    monkeypatch.setattr(relay, "get_worker", lambda: worker)
    assert relay.relayed("name", 5, "task") == replace(DONE, number=5)
    begun = {"begun": 5, "key": "key", "worker": "tcp://there", "host": platform.node()}
    assert events == [("name", begun)]
    with pytest.raises(relay.Reschedule):
        relay.relayed("unknown", 5, "task")
    assert made._pools.busy == {}
