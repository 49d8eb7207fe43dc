"""What workers of a cluster are asked to do in tests."""

import os
import time
from pathlib import Path

from tests.support.tasks import obedient, squares


def squares_in(folder):
    """As `squares`, wherever the files are."""
    return squares()


def obedient_in(folder):
    """As `obedient`."""
    return obedient()


def reader_in(folder):
    """Tells the content of a file of the parcel, and where it was read."""

    def read(name):
        time.sleep(0.01)
        return (Path(folder) / name).read_text(), str(folder), os.getpid()

    return read


def nothing():
    return abs


def nothing_in(folder):
    return abs


def bytes_of():
    """A task is any thing and a number: so many bytes come back."""
    return _bytes


def _bytes(task):
    return bytes(task[1])


def bytes_in(folder):
    """As `bytes_of`."""
    return _bytes


def worker_killer_in(folder):
    """As `obedient`, and a word that kills the worker of dask."""
    obey = obedient()

    def act(task):
        if task[0] == "kill the worker":
            time.sleep(0.1)
            os.kill(os.getppid(), 9)
            time.sleep(60)
        return obey(task)

    return act
