"""A fit whose process or worker is lost goes on from what it had evaluated, with the same bits."""

import io
import os
import shutil
import signal
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from support.real_cluster import parent_of
from support.trench import write_case

from geoident.cli import several
from geoident.cli.options import Options
from geoident.cli.several import run_cases
from geoident.io.result import checkpoint as log_of_evaluations
from geoident.io.result.checkpoint import EvaluationLog
from geoident.io.result.file import read_result
from geoident.model.cluster import Cluster
from geoident.report.text.campaign.spreadsheet import runs_csv
from geoident.workflow.campaign.away import AwayRuns, cluster_executor
from geoident.workflow.campaign.campaign import compute
from geoident.workflow.campaign.one_run import RunTask
from geoident.workflow.campaign.plan import plan_campaign
from geoident.workflow.executing import cluster as own
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import Answered
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit

CAVERN = Path(__file__).parents[2] / "cases" / "cavern"


class InThisProcess:
    """An executor whose process was lost once: it has left a checkpoint."""

    left: ClassVar[list[bool]] = []

    @classmethod
    def __class_getitem__(cls, kinds):
        return cls

    def __init__(self, jobs, set_up):
        self.answer = set_up()

    def __enter__(self):
        return self

    def __exit__(self, *told):
        pass

    def ask_to_stop(self):
        pass

    kill = ask_to_stop

    def run(self, tasks):
        for number, case in enumerate(tasks):
            self.left.append(checkpoint(case).exists())
            leave(case)
            yield Answered(number, self.answer(case))


def checkpoint(case):
    return plan_fit(Request(str(case))).place.checkpoint


def leave(case):
    """What a process has evaluated that was lost."""
    job = plan_fit(Request(str(case)))
    with EvaluationLog.open(job.place.checkpoint, job.identity) as log:
        log.add("readings", np.ones(2), {"v": np.zeros(3)})


def test_fresh_forgets_once_and_a_case_that_is_begun_again_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(several, "LocalProcesses", InThisProcess)
    monkeypatch.setattr(InThisProcess, "left", [])
    cases = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        cases.append(str(write_case(tmp_path / name)))
    leave(cases[0])
    assert run_cases("fit", cases, Options(fresh=True, verbose=True)) in (0, 4)
    assert InThisProcess.left == [False, False]
    assert capsys.readouterr().err.count("Going on from") == 2


@pytest.mark.slow
def test_a_fit_of_a_mesh_goes_on_where_its_worker_was_killed(tmp_path, cluster, monkeypatch):
    """The worker is killed when its first evaluations have come back; none is made again."""
    shutil.copytree(CAVERN, tmp_path / "cavern", ignore=shutil.ignore_patterns("case.*.h5"))
    monkeypatch.chdir(tmp_path / "cavern")
    made = []
    monkeypatch.setattr(
        EvaluationLog, "add",
        lambda self, kind, p, arrays, add=EvaluationLog.add: made.append((kind, p.tobytes()))
        or add(self, kind, p, arrays),
    )  # fmt: skip
    alone = fit(plan_fit(Request("case.yaml", output=str(tmp_path / "alone.h5"))), Control()).result
    Path("campaign.yaml").write_text(
        "format: geoident-campaign/1\ncase: case.yaml\ncommand: fit\n"
        "variations: {product: {parameters.E_rock.start: [20 GPa]}}\n"
    )
    monkeypatch.setattr(DaskCluster, "journals_every", 0.05)
    plan = plan_campaign("campaign.yaml")
    place = RunTask(plan.campaign, Path("campaign.batch"), plan.runs[0]).checkpoint
    contents, killed = [], []
    keep = own.add_part

    def kept(file, content, *, at):
        keep(file, content, at=at)
        contents.append(place.read_bytes())
        if not killed and len(evaluations(contents[-1])) >= 2:
            (head,) = {parent_of(pid) for pid in cluster.run_processes()}
            os.kill(head, signal.SIGKILL)
            killed.append(len(contents) - 1)

    monkeypatch.setattr(own, "add_part", kept)
    where = Cluster(address=cluster.address)
    with cluster_executor(plan, where, 1, lambda message: None) as executor:
        table = compute(plan, AwayRuns(executor, plan), lambda record: None, runs_csv)
    (run,) = table.runs
    assert len(run.losses) == 1
    assert "ended with its worker tcp://127.0.0.1" in run.losses[0]
    assert len(killed) == 1
    logged = evaluations(contents[-1])
    assert len(logged) > len(evaluations(contents[killed[0]])) >= 2
    assert logged == made[: len(logged)]  # each once, as if there had been one process
    assert contents[-1].startswith(contents[killed[0]])
    found = read_result(plan.folder / run.file)
    assert found.parameters.values.tobytes() == alone.parameters.values.tobytes()
    assert found.parameters.covariance.tobytes() == alone.parameters.covariance.tobytes()
    assert found.prediction.mean.tobytes() == alone.prediction.mean.tobytes()
    assert found.counts.evaluations == alone.counts.evaluations


def evaluations(content):
    """Kinds and parameters in a checkpoint, in their order."""
    file, found = io.BytesIO(content), []
    magic = len(b"geoident-evaluations/1\n")
    for place, payload in log_of_evaluations._records(file, magic):
        if found or place > magic + 12:  # the first record is the identity
            kind, p, _ = log_of_evaluations._unpack(payload)
            found.append((kind, p.tobytes()))
    return found
