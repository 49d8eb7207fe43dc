"""A scheduler and workers of dask as processes of this machine, which tests may kill."""

import os
import secrets
import signal
import socket
import subprocess
import sys
import time
import uuid
from contextlib import suppress
from pathlib import Path

import geoident

MARK = "GEOIDENT_TEST_CLUSTER"
ROOT = str(Path(geoident.__file__).parents[1])
QUIET = {
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "10s",
    "DASK_DISTRIBUTED__WORKER__PROFILE__INTERVAL": "1s",
}
"""How often processes of dask look at themselves: with its own 20, 500 and 10 ms a cluster of two
workers that has nothing to do takes an eighth of a processor as long as it stands."""

SCHEDULER = """
import os, sys, threading
def end_with_the_tests():
    sys.stdin.buffer.read()
    os._exit(0)
threading.Thread(target=end_with_the_tests, daemon=True).start()
from distributed.cli.dask_scheduler import main
main()
"""
"""Ends when its standard input does, so when the process of the tests is gone, however that ended.
A time without work as its end would be too short for slow tests between two of the cluster."""


def free_port():
    """A port below those that systems give to connections, so that none takes it meanwhile."""
    while True:
        port = secrets.choice(range(20_000, 32_000))
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(condition, seconds=120.0):
    """Ask again and again, for a tenth of the processor at most: some read all of /proc."""
    over = time.monotonic() + seconds
    while True:
        before = time.thread_time()
        if condition():
            return
        assert time.monotonic() < over
        time.sleep(max(0.02, 9.0 * (time.thread_time() - before)))


def marked(mark):
    """Processes that have a text in their environment, and so descend from who was given it."""
    found = []
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            if entry.name.isdigit() and mark.encode() in (entry / "environ").read_bytes():
                found.append(int(entry.name))
    return found


class RealCluster:
    """A scheduler and its workers, each worker with a nanny that starts it again.

    Args:
        folder: for what they write.
        tls: path, without ending, of a certificate and its key; they speak encrypted with it.
    """

    def __init__(self, folder, tls=""):
        self.folder = folder
        self.port = free_port()
        protocol = "tls" if tls else "tcp"
        self.address = f"{protocol}://127.0.0.1:{self.port}"
        self.words = ["--protocol", protocol]
        if tls:
            self.words += ["--tls-ca-file", f"{tls}.pem", "--tls-cert", f"{tls}.pem",
                           "--tls-key", f"{tls}.key"]  # fmt: skip
        self.mark = uuid.uuid4().hex
        self.scheduler = None
        self.nodes = []

    def _start(self, *words, path="", **more):
        paths = os.pathsep.join(part for part in (path, ROOT) if part)
        return subprocess.Popen(
            [sys.executable, *words],
            env={**os.environ, **QUIET, MARK: self.mark, "PYTHONPATH": paths,
                 "OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True, **more,
        )  # fmt: skip

    def start_scheduler(self):
        self.scheduler = self._start(
            "-c", SCHEDULER, "--host", "127.0.0.1", "--port", str(self.port),
            "--no-dashboard", "--dashboard-address", ":0", "--no-show", *self.words,
            stdin=subprocess.PIPE,
        )  # fmt: skip

    def listens(self):
        """Whether the scheduler can be reached."""
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def add_node(self, *words, path=""):
        """A worker and its nanny.

        Args:
            words: more options.
            path: a folder in front of PYTHONPATH.
        """
        node = self._start(
            "-m", "distributed.cli.dask_worker", self.address, "--host", "127.0.0.1",
            "--nthreads", "1", "--no-dashboard", "--memory-limit", "0",
            "--local-directory", str(self.folder), "--death-timeout", "120",
            *self.words, *words, path=path,
        )  # fmt: skip
        self.nodes.append(node)
        return node

    def family(self):
        """Processes that belong to the cluster."""
        return marked(self.mark)

    def children(self):
        """Workers (without their nannies), and the processes in which tasks run."""
        heads = {self.scheduler.pid, *(node.pid for node in self.nodes)}
        return [pid for pid in self.family() if pid not in heads and _is_python(pid)]

    def run_processes(self):
        """The processes in which tasks run: children of workers."""
        own = self.children()
        return [pid for pid in own if parent_of(pid) in own]

    def workers(self):
        """The processes of dask's workers."""
        own = self.children()
        return [pid for pid in own if parent_of(pid) not in own]

    def kill_scheduler(self):
        self.scheduler.kill()
        self.scheduler.communicate()

    def kill_node(self, node):
        """All processes of a worker at once."""
        for pid in self.family():
            with suppress(ProcessLookupError, PermissionError):
                if os.getpgid(pid) == node.pid or _ancestor(pid, node.pid):
                    os.kill(pid, signal.SIGKILL)
        node.wait()
        self.nodes.remove(node)

    def __enter__(self):
        self.start_scheduler()
        wait_until(self.listens)  # beside other tests it may take longer than a command waits
        return self

    def __exit__(self, *_):
        for pid in self.family():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.scheduler.communicate()
        for node in self.nodes:
            node.wait()


def _is_python(pid):
    """A worker of dask, or a process of ours."""
    with suppress(OSError):
        words = Path(f"/proc/{pid}/cmdline").read_bytes()
        return b"spawn_main" in words or b"workflow.executing.worker" in words
    return False


def parent_of(pid):
    with suppress(OSError, IndexError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def _ancestor(pid, of):
    while pid > 1:
        if pid == of:
            return True
        pid = parent_of(pid)
    return False
