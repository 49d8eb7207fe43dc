"""What processes are asked to do in tests of executors."""

import os
import signal
import subprocess
import time
from importlib.util import find_spec
from pathlib import Path

import geoident.workflow.executing.worker as own


def nothing():
    return _same


def _same(task):
    return task


def squares():
    return _square


def _square(number):
    time.sleep(0.003)
    return number * number, os.getpid()


def obedient():
    """Each task is a word that says what to do, and a file that counts how often it was begun."""
    return _obey


def _obey(task):
    word, file = task
    with Path(file).open("a") as begun:
        begun.write(f"{os.getpid()}\n")
    if word == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if word == "die once" and len(Path(file).read_text().splitlines()) == 1:
        os._exit(3)
    if word == "hang with a program":
        program = subprocess.Popen(["sleep", "600"], start_new_session=True)
        Path(f"{file}.program").write_text(f"{program.pid} ")
        word = "hang"
    if word == "hang":
        time.sleep(600)
    if word == "wait for the wish":
        while own.STOP.exit_code is None:
            time.sleep(0.01)
        return "wished"
    if word == "raise":
        raise ZeroDivisionError("nobody thought of it")
    return word


def findable():
    return _findable


def _findable(names):
    return [name for name in names if find_spec(name) is not None]


def broken():
    raise OSError("no model here")


def dying():
    os._exit(5)
