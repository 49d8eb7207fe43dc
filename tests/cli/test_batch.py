"""``geoident batch`` with real processes: killed, stopped, gone on with."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import uuid
from pathlib import Path
from types import SimpleNamespace

import pytest

import geoident
from geoident.cli.campaign import Progress
from geoident.cli.options import Options
from geoident.model.results.many.campaign import RunRecord
from geoident.workflow.campaign.one_run import RunTask, compute
from geoident.workflow.campaign.plan import plan_campaign
from geoident.workflow.campaign.runs import read_runs
from tests.support.real_cluster import marked, wait_until

OPENING = Path(geoident.__file__).parent / "templates" / "opening"
CAMPAIGN = """\
format: geoident-campaign/1
case: case.yaml
command: simulate
variations:
  sample:
    count: 24
    values: {parameters.E_rock.start: {from: 0.3 GPa, to: 15 GPa, scale: log}}
"""
MARK = "GEOIDENT_TEST_MARK"
on_linux = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs /proc")


@pytest.fixture
def here(tmp_path, monkeypatch):
    for path in OPENING.iterdir():
        shutil.copy(path, tmp_path)
    (tmp_path / "campaign.yaml").write_text(CAMPAIGN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def begin(*words):
    mark = uuid.uuid4().hex
    root = str(Path(geoident.__file__).parents[1])
    process = subprocess.Popen(
        [sys.executable, "-m", "geoident", "batch", "campaign.yaml", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, MARK: mark, "PYTHONPATH": root, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    return process, mark


def ended():
    try:
        return len(Path("campaign.batch/runs.jsonl").read_text().splitlines()) - 1
    except OSError:
        return 0


def numbers(record):
    return [(reading.gauge, reading.stage, reading.value) for reading in record.readings]


@pytest.mark.slow  # lost workers: `tests/workflow/executing`; the end of the family: below
@on_linux
def test_workers_and_command_are_killed_and_the_same_command_ends_it(here, run):
    process, mark = begin("-j", "2")
    chance = random.Random(5)
    wait_until(lambda: ended() >= 3)
    workers = sorted(set(marked(mark)) - {process.pid})
    os.kill(chance.choice(workers), signal.SIGKILL)
    wait_until(lambda: ended() >= 10)
    process.kill()
    process.communicate()
    wait_until(lambda: not marked(mark), 20.0)  # nobody stays behind
    known = ended()
    done = run("batch", "campaign.yaml", "-j", "1", "--json")
    assert done.exit_code == 0
    assert len(done.stdout.splitlines()) == 24
    assert f"{24 - known} runs computed, {known} up to date." in done.stderr
    plan = plan_campaign("campaign.yaml", output="serial")
    plan.folder.mkdir()
    serial = {
        one.name: numbers(compute(RunTask(plan.campaign, plan.folder, one)))
        for one in plan.runs[:8]
    }
    killed = {run.name: numbers(run) for run in read_runs("campaign.batch").runs}
    assert {name: killed[name] for name in serial} == serial  # bit for bit
    again = run("batch", "campaign.yaml")
    assert "0 runs computed, 24 up to date." in again.stderr


@on_linux
def test_ctrl_c_ends_the_family_and_says_how_to_go_on(here, run):
    process, mark = begin("-j", "1")
    wait_until(lambda: ended() >= 3)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "have not ended; the same command continues" in stderr
    wait_until(lambda: not marked(mark), 20.0)
    assert 3 <= len(read_runs("campaign.batch").runs) < 24
    shown = run("show", "campaign.batch", "--json")
    assert [json.loads(line)["status"] for line in shown.stdout.splitlines()][:3] == ["done"] * 3


def test_a_dry_run_lists_the_runs_and_writes_nothing(here, run):
    told = run("batch", "campaign.yaml", "--dry-run")
    assert told.exit_code == 0
    assert "24 runs of simulate, 24 to be computed" in told.stdout
    assert "0024  parameters.E_rock.start=" in told.stdout
    assert not Path("campaign.batch").exists()


def test_all_faults_of_a_campaign_are_said_at_once(here, run):
    Path("campaign.yaml").write_text(
        "format: geoident-campaign/1\n"
        "command: simulte\n"
        "case: cse.yaml\n"
        "time_limit: 3 parsecs\n"
        "retris: 1\n"
        "variations:\n"
        "  table: runs.csv\n"
    )
    Path("runs.csv").write_text("run,a..b\nx,1\n")
    failed = run("batch", "campaign.yaml")
    assert failed.exit_code == 3
    for place in (
        "campaign.yaml:2:10", "campaign.yaml:3:7", "campaign.yaml:4:13", "campaign.yaml:5:1",
        "runs.csv:1:5",
    ):  # fmt: skip
        assert place in failed.stderr
    assert "5 faults" in failed.stderr


def test_the_live_line_names_the_slowest_run_and_the_last_that_failed(monkeypatch):
    said, parts = [], []
    terminal = SimpleNamespace(inform=said.append, part=lambda *told: parts.append(told))
    progress = Progress(Options(), terminal, 8, lambda: 2)
    for number, seconds in enumerate([0.2, 7.0, 1.0, 0.1, 3.0, 0.3, 0.2], start=1):
        good = number in (1, 2, 4)
        record = RunRecord(f"000{number}", "", (), "done" if good else "failed", 0 if good else 5,
                           "no solution", file="a.h5" if good else "", seconds=seconds)  # fmt: skip
        progress(record)
    assert parts[1][0] == "2 of 8 runs ended, 0 failed, 2 running, slowest 0002 (7.00 s)"
    assert parts[3][0].startswith("4 of 8 runs ended, 1 failed (0003), 2 running, slowest 0002")
    assert "4 failed (..., 0005, 0006, 0007), 1 running" in parts[-1][0]
    assert parts[-1][1] == 7 / 8  # from which the terminal tells the time that is left
    assert said[0] == "0003: failed: no solution"
    assert len(said) == 4


@pytest.mark.usefixtures("in_this_process", "plain_pictures")
def test_the_page_and_the_progress_of_a_campaign(here, run):
    text = CAMPAIGN.replace("count: 24", "count: 3")
    Path("campaign.yaml").write_text(text)
    done = run("batch", "campaign.yaml", "-j", "1", "-v")
    assert done.exit_code == 0
    assert "2 of 3 runs ended, 0 failed, 1 running, slowest 000" in done.stderr
    written = run("report", "campaign.batch")
    assert written.stdout == "campaign.batch/report.html\n"
    page = Path("campaign.batch/report.html").read_text()
    assert "3 of 3 runs done" in page
    assert page.count("<svg") >= 1
    assert run("report", "campaign.batch").exit_code == 0  # its own page gives way
    assert "3 of 3 runs done" in run("show", "campaign.batch").stdout
    assert run("show", "campaign.batch", "--csv").stdout.count("\n") == 4
