"""Tasks on a real cluster of dask on this machine: killed, lost, hanging, refused; none is lost."""

import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress

import dask
import pytest
from tornado.tcpclient import TCPClient

from geoident.errors import InputError, LostCluster
from geoident.io.cluster.file import read_cluster
from geoident.model.cluster import Cluster
from geoident.workflow.executing import connection
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import in_order
from geoident.workflow.executing.parcel import packed
from tests.support.cluster_tasks import Lines, lines, reader, worker_killer
from tests.support.real_cluster import MARK, ROOT, RealCluster, free_port, runs, wait_until
from tests.support.tasks import obedient, squares

NOTHING = packed()
KILLS = [3, 30]


def at(cluster, **given):
    return Cluster(address=cluster.address, **given)


def answers(executor, tasks):
    return list(in_order(executor.run(tasks)))


def test_files_travel_to_each_worker_and_answers_come_back(cluster, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "deep").mkdir()
    for name, text in (("a", "one"), ("b", "two"), ("c", "one")):
        (tmp_path / "deep" / name).write_text(text)
    parcel = packed([f"deep/{name}" for name in "abc"])
    said = []
    with DaskCluster(at(cluster), reader, parcel, tell=said.append) as executor:
        found = answers(executor, [f"deep/{name}" for name in "abcabcabcabc"])
        folders = {answer.value[1] for answer in found}
        assert all(os.path.isdir(folder) for folder in folders)  # noqa: PTH112
    assert [answer.value[0] for answer in found] == ["one", "two", "one"] * 4
    assert len(folders) <= 2
    wait_until(lambda: not any(os.path.isdir(folder) for folder in folders))  # noqa: PTH112
    wait_until(lambda: not cluster.run_processes())


def test_what_kills_its_process_hangs_or_raises_is_told_apart(cluster, tmp_path):
    words = ["fine", "die", "die once", "hang"]
    *tasks, hanging = [(word, str(tmp_path / word.replace(" ", "-"))) for word in words]
    with DaskCluster(at(cluster), obedient, NOTHING, time_limit=0.5, retries=1) as executor:
        (hung,) = answers(executor, [hanging])
    with DaskCluster(at(cluster), obedient, NOTHING, retries=1) as executor:
        fine, dead, once = answers(executor, tasks)
        with pytest.raises(ZeroDivisionError, match="nobody thought"):
            answers(executor, [("raise", str(tmp_path / "raise"))])
    assert (fine.value, once.value) == ("fine", "die once")
    assert once.losses == ("ended with exit code 3",)
    assert dead.set_aside
    assert dead.losses == ("was killed (SIGKILL; out of memory?)",) * 2
    assert hung.losses == ("took longer than 0.5 s",) * 2


def test_a_task_that_kills_two_workers_of_dask_is_set_aside_and_others_go_on(cluster, tmp_path):
    tasks = [("kill the worker", str(tmp_path / "a")), ("fine", str(tmp_path / "b"))]
    with DaskCluster(at(cluster), worker_killer, NOTHING, retries=1) as executor:
        killer, fine = answers(executor, tasks)
    assert fine.value == "fine"
    assert killer.set_aside
    assert len(killer.losses) == 2
    assert "ended with its worker tcp://127.0.0.1" in killer.losses[0]


@pytest.mark.parametrize("whom", ["own", "worker"])
def test_what_a_lost_worker_has_computed_comes_back_and_is_gone_on_from(
    cluster, tmp_path, monkeypatch, whom
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(DaskCluster, "journals_every", 0.1)
    task = Lines({}, "lines.txt", str(tmp_path / "mark"), whom)
    with DaskCluster(at(cluster), lines, NOTHING) as executor:
        (found,) = answers(executor, [task])
    assert found.value == (11, "".join(f"{n}\n" for n in range(12)))
    assert len(found.losses) == 1
    assert (tmp_path / "lines.txt").read_text().splitlines()[:11] == [str(n) for n in range(11)]


def test_a_program_that_workers_lack_is_said_before_anything_is_computed(cluster):
    parcel = packed(programs=("no-such-program",))
    with (
        pytest.raises(InputError, match="has no program 'no-such-program'") as caught,
        DaskCluster(at(cluster), squares, parcel) as executor,
    ):
        answers(executor, range(3))
    assert "search path (PATH) of the workers" in str(caught.value)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificates")
def test_a_cluster_file_with_certificates_reaches_a_scheduler_that_asks_for_them(tmp_path):
    for name in ("own", "other"):
        subprocess.run(
            ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256",
             "-nodes", "-days", "2", "-subj", f"/CN={name}", "-keyout", f"{name}.key",
             "-out", f"{name}.pem"],
            cwd=tmp_path, check=True, capture_output=True,
        )  # fmt: skip
    with RealCluster(tmp_path, tls=str(tmp_path / "own")) as cluster:

        def written(name):
            (tmp_path / "cluster.yaml").write_text(
                f"format: geoident-cluster/1\naddress: {cluster.address}\n"
                f"security: {{ca_file: {name}.pem, cert: {name}.pem, key: {name}.key}}\n"
            )
            return read_cluster(str(tmp_path / "cluster.yaml"))

        with DaskCluster(written("own"), squares, NOTHING) as executor:
            assert executor._link.client.scheduler.address.startswith("tls://")
        own = str(tmp_path / "own")
        told = {"ca-file": f"{own}.pem", "client.cert": f"{own}.pem", "client.key": f"{own}.key"}
        told = {f"distributed.comm.tls.{name}": path for name, path in told.items()}
        with (
            dask.config.set(told),  # as DASK_DISTRIBUTED__COMM__TLS__CA_FILE does, and so on
            DaskCluster(at(cluster), squares, NOTHING) as executor,
        ):
            assert executor._link.client.scheduler.address.startswith("tls://")
        for where, said in (
            (written("other"), "no scheduler of dask answers at tls://"),
            (at(cluster), "needs certificates, and none are given"),
        ):
            with pytest.raises(InputError, match=said), DaskCluster(where, squares, NOTHING):
                pass


@contextmanager
def killed_meanwhile(cluster, kills):
    """Kill workers, processes of tasks and whole nodes at random; tells how many are dead."""
    chance, over, dead = random.Random(kills), threading.Event(), []

    def kill():
        while not over.is_set() and len(dead) < kills:
            time.sleep(chance.uniform(0.2, 0.8))
            what = chance.choice(["worker", "process", "node"])
            if what == "node":
                cluster.kill_node(chance.choice(cluster.nodes))
                cluster.add_node()
                dead.append(what)
                continue
            pids = cluster.workers() if what == "worker" else cluster.run_processes()
            with suppress(ProcessLookupError, IndexError):
                os.kill(chance.choice(pids), signal.SIGKILL)
                dead.append(what)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        yield dead
    finally:
        over.set()
        thread.join()


@pytest.mark.slow  # one death of each kind: the tests above, and of a scheduler below
@pytest.mark.parametrize("kills", KILLS)
def test_no_task_is_lost_when_workers_and_nodes_are_killed_at_random(cluster, kills):
    def tasks():
        number = 0
        while len(dead) < kills or number < 100:
            yield number
            number += 1

    with (
        DaskCluster(at(cluster), squares, NOTHING, retries=1000) as executor,
        killed_meanwhile(cluster, kills) as dead,
    ):
        found = answers(executor, tasks())
    assert len(dead) == kills
    assert [answer.value[0] for answer in found] == [n * n for n in range(len(found))]


def test_a_stop_lets_tasks_end_and_begins_no_more(cluster, tmp_path):
    tasks = [("wait for the wish", str(tmp_path / str(n))) for n in range(20)]
    with DaskCluster(at(cluster), obedient, NOTHING) as executor:
        timer = threading.Thread(target=_stop_when_begun, args=(executor, tmp_path))
        timer.start()
        found = answers(executor, tasks)
        timer.join()
    begun = len(list(tmp_path.iterdir()))
    assert 1 <= begun <= 2
    assert [a.value for a in found if not a.stopped] == ["wished"] * begun


def _stop_when_begun(executor, folder):
    wait_until(lambda: list(folder.iterdir()))
    executor.ask_to_stop()


CLIENT = """
from geoident.model.cluster import Cluster
from geoident.workflow.executing import connection
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.parcel import packed
from tests.support.tasks import obedient
if __name__ == "__main__":
    where = Cluster(address={address!r})
    with DaskCluster(where, obedient, packed(), jobs=1) as executor:
        list(executor.run([("hang", {file!r})]))
"""


@pytest.mark.parametrize(
    "local", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["scheduler", "local"]
)
def test_tasks_end_with_a_client_that_is_killed(cluster, tmp_path, local):
    begun, script = tmp_path / "begun", tmp_path / "client.py"
    script.write_text(CLIENT.format(address="" if local else cluster.address, file=str(begun)))
    env = {**os.environ, "PYTHONPATH": ROOT, MARK: str(tmp_path)}
    client = subprocess.Popen([sys.executable, str(script)], env=env)
    wait_until(lambda: begun.exists() and begun.read_text().strip())
    pid = int(begun.read_text())
    assert runs(pid)
    client.kill()
    client.wait()
    wait_until(lambda: not runs(pid))


@pytest.mark.slow  # a scheduler and its workers begin three times
def test_a_scheduler_that_is_killed_and_started_again_is_gone_on_with(tmp_path):
    said = []
    with RealCluster(tmp_path) as cluster:
        cluster.add_node("--no-nanny")
        where = at(cluster, patience=60.0)
        with DaskCluster(where, squares, NOTHING, tell=said.append) as executor:
            coming = executor.run(range(60))
            found = [next(coming) for _ in range(5)]
            cluster.kill_scheduler()
            cluster.start_scheduler()
            cluster.add_node("--no-nanny")
            found += coming
            assert sorted(answer.number for answer in found) == list(range(60))
            assert all(answer.value[0] == answer.number**2 for answer in found)
            assert any("is lost; waiting for it" in text for text in said)
            more = executor.run(range(1000))
            next(more)
            cluster.kill_scheduler()
            executor._link._where = at(cluster, patience=0.5)
            with pytest.raises(LostCluster, match="continues with the rest"):
                list(more)


@contextmanager
def somebody_else():
    """A server that takes calls and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_who_does_not_answer_leaves_no_socket_open(monkeypatch):
    """On a busy machine the time is over in the very moment in which a connection comes about."""
    create, streams = TCPClient._create_stream, []

    def busy(*given, **options):
        made = create(*given, **options)
        streams.append(made[0])
        time.sleep(0.05)
        return made

    monkeypatch.setattr(TCPClient, "_create_stream", busy)
    with somebody_else() as port, pytest.raises(TimeoutError):
        connection._answers(f"tcp://127.0.0.1:{port}", None, 0.02)
    assert streams
    assert all(stream.closed() for stream in streams)


@pytest.mark.parametrize("silent", [False, True], ids=["nobody", "somebody else"])
def test_a_cluster_that_is_not_there_is_said_within_ten_seconds(silent, monkeypatch):
    assert connection.REACH < 10.0
    monkeypatch.setattr(connection, "REACH", 1.0)  # dask itself waits for half a minute, or ever
    with somebody_else() as port:
        address = f"tcp://127.0.0.1:{port if silent else free_port()}"
        with (
            pytest.raises(
                InputError, match=r"no scheduler of dask answers .* within 1 s"
            ) as caught,
            DaskCluster(Cluster(address=address), squares, NOTHING),
        ):
            pass
    assert address in str(caught.value)
    assert "dask scheduler" in str(caught.value)


def test_a_worker_with_other_versions_is_refused_whenever_it_comes(tmp_path):
    info = tmp_path / "path" / "numpy-0.1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 0.1\n")
    said = r"worker tcp://127.0.0.1.* has other versions: numpy 0\.1 \(here"
    with RealCluster(tmp_path / "workers") as cluster:
        with DaskCluster(at(cluster), squares, NOTHING) as executor:  # nobody is there yet
            cluster.add_node("--no-nanny", path=str(tmp_path / "path"))
            with pytest.raises(InputError, match=said):
                list(executor.run(range(3)))
        with pytest.raises(InputError, match=said):
            DaskCluster(at(cluster), squares, NOTHING).__enter__()
