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
