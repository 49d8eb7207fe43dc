"""What a connection to a cluster makes of what it finds there; the cluster is played."""

from types import SimpleNamespace

import pytest

from geoident.errors import InputError, LostCluster
from geoident.model.cluster import Cluster
from geoident.workflow.executing import connection
from geoident.workflow.executing.connection import Connection

VERSIONS = {"geoident": "0.9", "python": "3.11.7", "numpy": "2.4"}


class Client:
    """A client of dask with workers that have threads and versions."""

    status = "running"
    scheduler = SimpleNamespace(address="tcp://there:8786")

    def __init__(self, threads=(), **theirs):
        self.threads, self.asked = dict(threads), 0
        self.theirs = {"python": "3.11.7.final.0", "geoident": "0.9", "numpy": "2.4", **theirs}

    def nthreads(self):
        self.asked += 1
        return self.threads

    def get_versions(self, packages):
        assert sorted(packages) == ["geoident", "numpy"]
        packages = {name: self.theirs[name] for name in packages}
        worker = {"host": {"python": self.theirs["python"]}, "packages": packages}
        ours = {"packages": {"geoident": "0.9", "numpy": "2.4"}}
        return {"workers": {"tcp://a": worker}, "client": ours}


@pytest.fixture
def clock(monkeypatch):
    """Time that passes where a test says so, or where somebody sleeps."""
    now = [1000.0]

    def sleep(seconds):
        now[0] += seconds

    played = SimpleNamespace(monotonic=lambda: now[0], sleep=sleep)
    monkeypatch.setattr(connection, "time", played)
    return now


def linked(client, *, where=None, **words):
    said = []
    where = where or Cluster(address="tcp://there:8786", **words)
    made = Connection(where, SimpleNamespace(name="name", versions=VERSIONS), 3, None, said.append)
    made.client = client
    return made, said


def test_threads_of_all_workers_are_counted_now_and_then(clock, monkeypatch):
    asked = []
    monkeypatch.setattr(connection, "_answers", lambda *given: asked.append(given[0]) or True)
    client = Client({"tcp://a": 2, "tcp://b": 3})
    made, _ = linked(client)
    assert (made.threads, made.direct) == (0, None)
    made.look()
    assert (made.threads, made.direct, asked) == (5, True, ["tcp://a"])
    client.threads = {"tcp://b": 1}
    clock[0] += 1.9
    made.look()
    assert (made.threads, client.asked) == (5, 1)
    clock[0] += 0.2
    made.look()
    assert (made.threads, client.asked, asked) == (1, 2, ["tcp://a"])


def test_who_waits_for_workers_says_so_and_that_they_have_come(clock):
    client = Client()
    made, said = linked(client)
    made.direct = False
    made._say_waiting()
    made.look()
    assert len(said) == 1
    assert "scheduler at tcp://there:8786 has no workers yet" in said[0]
    clock[0] += 3.0
    client.threads = {"tcp://a": 1}
    made.look()
    clock[0] += 3.0
    made.look()
    assert said[1:] == ["Workers have come."]


def test_own_workers_are_known_before_they_are_counted():
    made, _ = linked(None, where=Cluster())
    assert made.threads == 3
    assert not made.alive


@pytest.mark.parametrize(
    ("theirs", "said"),
    [
        ({}, ""),
        (
            {"python": "3.11.8.final.0"},
            r"worker tcp://a has other versions: python 3\.11\.8 \(here",
        ),
        ({"numpy": "2.3"}, r"numpy 2\.3 \(here 2\.4\)"),
        ({"geoident": None}, r"geoident missing \(here 0\.9\)"),
    ],
)
def test_workers_of_other_versions_are_refused(theirs, said):
    made, _ = linked(Client(**theirs))
    if not said:
        made._require_same_versions()
        return
    with pytest.raises(InputError, match=said) as caught:
        made._require_same_versions()
    assert "same versions as here" in str(caught.value)


def test_what_a_refusal_asks_for_is_what_is_missing():
    made, _ = linked(None)
    assert "Install it there" in str(made.refused("the worker a has no program 'x'"))
    assert "same versions" in str(made.refused("the worker a is odd"))


def test_a_scheduler_that_comes_back_is_gone_on_with(clock, monkeypatch):
    """It is tried until the patience is over, each time for eight seconds at most."""
    made, said = linked(Client(), patience=20.0)
    tried = []

    def connect(seconds):
        tried.append((clock[0] - 1000.0, seconds))
        clock[0] += seconds
        if len(tried) < 3:
            raise OSError("nobody")
        made.client, made.threads = Client(), 2

    monkeypatch.setattr(made, "_connect", connect)
    made.come_back(lambda: False)
    assert tried == [(0.0, 8.0), (8.5, 8.0), (17.0, 3.0)]
    assert made.alive
    assert said == [
        "The scheduler at tcp://there:8786 is lost; waiting for it.",
        "It is back; what was running there is begun again.",
    ]


def test_a_scheduler_that_does_not_come_back_is_lost(clock, monkeypatch):
    made, _ = linked(Client(), patience=5.0)

    def refuse(seconds):
        clock[0] += seconds
        raise OSError("nobody")

    monkeypatch.setattr(made, "_connect", refuse)
    with pytest.raises(LostCluster):
        made.come_back(lambda: False)
    assert 1005.0 < clock[0] < 1008.0
    assert made.client is None


def test_who_wants_to_stop_waits_for_nobody(clock, monkeypatch):
    made, said = linked(Client())
    monkeypatch.setattr(made, "_connect", None)
    made.come_back(lambda: True)
    assert (made.client, said, clock) == (None, [], [1000.0])


def test_a_scheduler_of_this_command_does_not_come_back():
    made, _ = linked(Client(), where=Cluster())
    with pytest.raises(LostCluster, match="scheduler of this command has ended"):
        made.come_back(lambda: False)
