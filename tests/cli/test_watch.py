"""``geoident watch``: files that grow, half-written files, kills, full disks and two watchers."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from openpyxl import Workbook

from geoident.io.result.file import read_result
from tests.support.commands import run_command
from tests.support.growing_tunnel import CASE, HEADER, rows, write_readings, write_tunnel

WATCH = (sys.executable, "-P", "-m", "geoident", "watch")
LONG_AGO = 1e9
PASSED_ON = "import sys; open('alarm.json', 'a').write(sys.stdin.read() + chr(10))"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fitted")
    assert run_command("fit", write_tunnel(folder, "day 1", "day 2"), "-q").exit_code == 0
    return folder


@pytest.fixture
def tunnel(fitted, tmp_path, monkeypatch):
    folder = shutil.copytree(fitted, tmp_path / "tunnel")
    monkeypatch.chdir(folder)
    return folder


def updates(folder):
    history = read_result(folder / "case.fit.h5").updates
    return 0 if history is None else history.last


def once(*more):
    return run_command("watch", "case.yaml", "--once", *more)


def test_a_file_that_has_grown_is_fitted_in(tunnel):
    assert once().stdout == ""
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))
    done = run_command("watch", ".", "--once")
    assert (done.exit_code, done.stdout) == (0, "case.fit.h5\n")
    assert done.stderr.count("\n") == 1
    assert "3 new readings: belong to the model" in done.stderr
    assert updates(tunnel) == 1


def test_a_half_written_text_waits_unless_it_has_been_so_for_long(tunnel):
    path = tunnel / "readings.csv"
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))
    path.write_bytes(path.read_bytes()[:-6])  # 0.4 of 0.4601 mm
    done = once()
    assert (done.exit_code, done.stdout) == (0, "")
    assert "readings.csv ends within a line" in done.stderr
    assert updates(tunnel) == 0
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))
    path.write_bytes(path.read_bytes()[:-1])  # a program that ends no last line
    os.utime(path, (LONG_AGO, LONG_AGO))
    assert once().exit_code == 0
    assert updates(tunnel) == 1


def test_a_half_written_workbook_waits_and_an_open_one_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.yaml").write_text(CASE.replace("readings.csv", "readings.xlsx"), encoding="utf-8")
    book = Workbook()
    for line in [HEADER, *rows("day 1", "day 2")]:
        book.active.append([_cell(text) for text in line.split(",")])
    book.save("readings.xlsx")
    content = Path("readings.xlsx").read_bytes()
    Path("~$readings.xlsx").write_bytes(b"\0" * 165)  # of Excel, while it has the book open
    Path("readings.xlsx").write_bytes(content[: len(content) // 2])
    done = once()
    assert done.exit_code == 0
    assert "readings.xlsx is not written to its end (open in Excel: ~$readings.xlsx)" in done.stderr
    assert not Path("case.fit.h5").exists()
    Path("new.xlsx").write_bytes(content)
    Path("new.xlsx").replace("readings.xlsx")
    assert once().exit_code == 0
    assert Path("case.fit.h5").exists()


def _cell(text):
    try:
        return float(text)
    except ValueError:
        return text


def test_a_file_that_cannot_be_read_is_reported_and_the_result_stays(tunnel):
    before = (tunnel / "case.fit.h5").read_bytes()
    write_readings(tunnel, [*rows("day 1", "day 2"), "CV0,day 4,much,mm"])
    done = once()
    assert (done.exit_code, done.stdout) == (3, "")
    assert "failed, the last result stays: " in done.stderr
    assert "readings.csv:8:11: 'much' is not a number" in done.stderr
    assert (tunnel / "case.fit.h5").read_bytes() == before


@pytest.mark.slow  # starts many processes
def test_a_full_disk_leaves_the_last_result_and_is_tried_again(tunnel):
    before = (tunnel / "case.fit.h5").read_bytes()
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))

    def no_room():
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    command = [*WATCH, "case.yaml", "--once"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=no_room)
    assert (done.returncode, done.stdout) == (6, "")
    assert "cannot be written" in done.stderr
    assert (tunnel / "case.fit.h5").read_bytes() == before
    assert once().exit_code == 0
    assert updates(tunnel) == 1


@pytest.mark.slow  # kills again and again
def test_killed_watchers_leave_a_result_from_which_the_next_goes_on(tunnel):
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))
    for seconds in (0.5, 2.5):
        watch = subprocess.Popen(
            [*WATCH, "case.yaml", "--every", "0.05s"], stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        time.sleep(seconds)
        assert watch.poll() is None
        os.killpg(watch.pid, signal.SIGKILL)
        watch.wait()
        read_result(tunnel / "case.fit.h5")  # whole at any moment
    assert once().exit_code == 0
    assert updates(tunnel) == 1
    assert once().stdout == ""


@pytest.mark.slow  # starts many processes
def test_two_watchers_make_one_update(tunnel):
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))
    both = [
        subprocess.Popen([*WATCH, "case.yaml", "--once"], stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    said = [watch.communicate()[1] for watch in both]
    assert updates(tunnel) == 1
    assert sum("belong to the model" in text for text in said) == 1
    assert {watch.returncode for watch in both} <= {0, 6}
    if 6 in {watch.returncode for watch in both}:
        assert any("another geoident updates it now" in text for text in said)


# Time passes only while the watch waits: a day of looks, 10 min apart. For six hours its
# readings are replaced by rename every hour, then nothing comes; at midnight a signal ends it.
A_DAY = """\
import json, os, signal, subprocess, sys, time
from pathlib import Path
sys.path[:], rows, now = PATH, ROWS, [time.time()]
begin, hours = now[0], 0
def sleep(seconds):
    global hours
    now[0] += seconds
    if now[0] < begin + 3600.0 * (hours + 1):
        return
    hours += 1
    place = Path("/proc/self")
    print(json.dumps([
        hours, int((place / "statm").read_text().split()[1]), len(os.listdir(place / "fd")),
        os.stat("case.fit.h5").st_size, sorted(os.listdir()),
    ]), flush=True)
    if hours <= 6:
        text = rows.replace("HOURS", str(hours))
        Path("new").write_text(text)
        os.replace("new", "readings.csv")
    elif hours == 24:
        os.kill(os.getpid(), signal.SIGTERM)
time.time = time.monotonic = lambda: now[0]
time.sleep = sleep
from geoident.cli.app import main
main()
"""


@pytest.mark.slow  # a minute; other looks: the tests above
def test_a_day_of_looks_takes_no_more_memory_and_no_more_files(tunnel):
    """144 looks by the clock that the command sees, and what six updates add to the result."""
    if not Path("/proc/self/statm").exists():
        pytest.skip("the memory of another process is read from /proc")
    first, *others = rows("day 1", "day 2")
    text = "\n".join([HEADER, first.replace(",mm", "HOURS,mm"), *others, ""])
    program = A_DAY.replace("PATH", repr(sys.path)).replace("ROWS", repr(text))
    day = subprocess.run(
        [sys.executable, "-c", program, "watch", ".", "--every", "10min"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert day.returncode == 143, day.stderr
    assert day.stderr.count("1 reading has changed since the last result") == 6, day.stderr
    lines = day.stdout.splitlines()
    hours = [json.loads(line) for line in lines if line.startswith("[")]
    assert (len(hours), lines.count("case.fit.h5")) == (24, 6)
    assert updates(tunnel) == 6
    _, pages, opened, sizes, files = zip(*hours, strict=True)
    assert max(pages[2:]) < pages[1] + 300  # of 4 KiB
    assert max(opened[2:]) <= opened[1]
    assert files[-1] == files[1]
    assert sizes[-1] == sizes[6]
    assert sizes[6] - sizes[1] < 5 * 3_000  # 1 kB an update, and what the format adds now and then


def test_an_alarm_is_passed_on_once_and_again_if_that_fails(tunnel):
    command = f'{sys.executable} -c "{PASSED_ON}"'
    refused = once("--on-alarm", command)
    assert refused.exit_code == 2
    assert "--trust" in refused.stderr
    write_readings(tunnel, [*rows("day 1", "day 2"), *rows("day 4", off={"CV0": 3.0})])
    done = once("--trust", "--on-alarm", f"{sys.executable} -c 1/0")
    assert done.exit_code == 8
    assert "ended with exit code 1: ZeroDivisionError" in done.stderr
    assert once("--trust", "--on-alarm", command).exit_code == 0  # of the update before
    (alarm,) = map(json.loads, Path("alarm.json").read_text(encoding="utf-8").splitlines())
    assert alarm["updates"]["steps"][-1]["alarm"]
    assert [one["subject"] for one in alarm["findings"] if one["kind"] == "new-readings"] == ["CV0"]
    once("--trust", "--on-alarm", command)
    assert len(Path("alarm.json").read_text(encoding="utf-8").splitlines()) == 1


def test_a_folder_without_cases_and_a_path_that_is_not_there_are_refused(tmp_path):
    done = run_command("watch", tmp_path, "--once")
    assert done.exit_code == 3
    assert "there is no case in this folder" in done.stderr
    assert run_command("watch", tmp_path / "nothing.yaml", "--once").exit_code == 2
