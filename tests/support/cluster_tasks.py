"""What workers of a cluster are asked to do in tests."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

from geoident.workflow.executing.resumable import Resumable
from tests.support.tasks import obedient


def reader():
    """Tells the content of a file of the parcel, and where it was read."""

    def read(name):
        time.sleep(0.01)
        return Path(name).read_text(), str(Path.cwd())

    return read


def worker_killer():
    """As `obedient`, and a word that kills the worker of dask."""
    obey = obedient()

    def act(task):
        if task[0] == "kill the worker":
            time.sleep(0.1)
            os.kill(os.getppid(), 9)
            time.sleep(60)
        return obey(task)

    return act


@dataclass(frozen=True)
class Lines(Resumable):
    """Write lines bit by bit; whoever begins it first ends a process at the eleventh.

    Before, it waits until all that it has written has come back.

    Args:
        file: for them, as seen from where the process works.
        mark: a file that tells that it was begun before, where the client works.
        whom: ``own`` process or that of the ``worker``.
    """

    file: str
    mark: str
    whom: str

    @property
    def journals(self):
        """The file."""
        return (self.file,)


def _await_lines(file, number):
    """Wait until lines up to a number have come back to where the client works."""
    over = time.monotonic() + 60.0
    while not (file.exists() and len(file.read_bytes().splitlines()) > number):
        assert time.monotonic() < over
        time.sleep(0.02)


def lines():
    """Answers `Lines` with the number of lines that were there at its last beginning."""

    def write(task):
        path = Path(task.file)
        if not path.exists():
            path.write_bytes(task.kept.get(task.file, b""))
        known = len(path.read_bytes().splitlines())
        for number in range(known, 12):
            with path.open("a") as file:
                file.write(f"{number}\n")
            if number == 10 and not Path(task.mark).exists():
                Path(task.mark).touch()
                _await_lines(Path(task.mark).with_name(task.file), number)
                os.kill(os.getpid() if task.whom == "own" else os.getppid(), 9)
                time.sleep(60)
        return known, path.read_text()

    return write
