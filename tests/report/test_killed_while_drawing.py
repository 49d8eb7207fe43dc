"""Processes that draw end with the command that has begun them, however that ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

DRAWS = """
import os, sys, time
from geoident.report.saving import side_by_side

def draw(item):
    open(os.path.join(sys.argv[1], str(os.getpid())), "w").close()
    time.sleep(0.2)
    return bytes(5_000_000)  # more than a pipe holds

side_by_side.side_by_side(draw, range(400))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="figures are drawn side by side on Linux only")
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs a machine of two cores")
def test_no_process_that_draws_outlives_a_command_that_is_killed(tmp_path):
    command = subprocess.Popen([sys.executable, "-c", DRAWS, str(tmp_path)])
    until = time.monotonic() + 30
    while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
        time.sleep(0.05)
    os.kill(command.pid, signal.SIGKILL)
    command.wait()
    drawing = [path.name for path in tmp_path.iterdir()]
    assert len(drawing) >= 2
    until = time.monotonic() + 10
    while time.monotonic() < until and any(Path("/proc", pid).exists() for pid in drawing):
        time.sleep(0.1)
    assert not [pid for pid in drawing if Path("/proc", pid).exists()]
