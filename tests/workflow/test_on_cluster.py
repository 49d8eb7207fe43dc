"""One case on a cluster: what it computes at a time is computed there, with the bits of here."""

import json
import sys

import numpy as np
import pytest
from support.executors import ClusterHere
from support.external import EXTERNAL, PROGRAM, trusted
from support.external import write_case as write_program
from support.projects import SECTIONS, example
from support.real_cluster import free_port
from support.trench import write_case

from geoident.errors import ExitCode, InputError, Interrupted, ModelError
from geoident.model.cluster import Cluster
from geoident.workflow.executing import connection
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import Answered
from geoident.workflow.fit import fit
from geoident.workflow.programs.workplace import OnCluster
from geoident.workflow.project.plan import ProjectRequest, plan_project
from geoident.workflow.project.run import fit_project
from geoident.workflow.running.control import NOTHING_SENT, Control, Monitor
from geoident.workflow.running.jobs import Request, plan_fit, plan_scan
from geoident.workflow.running.workers import ModelWorkers
from geoident.workflow.sample import SampleRequest, plan_sample, sample
from geoident.workflow.scan import scan


class Hears(Monitor):
    """Keeps what it is told."""

    def __init__(self):
        self.said = []

    def inform(self, message):
        self.said.append(message)


@pytest.fixture(params=["here", pytest.param("real", marks=pytest.mark.slow)])
def somewhere(request, tmp_path_factory):
    """What makes the control of a command on a cluster: one in this process, or a real one.

    That a real one answers as this process does is for the tests of a scan and of a program.
    """
    if request.param == "real":
        cluster = request.getfixturevalue("cluster")
        return lambda: on(cluster)
    where = ClusterHere(tmp_path_factory.mktemp("there") / "files")
    return lambda: Control(Hears(), jobs=None, cluster=where)


def on(cluster):
    hears = Hears()
    where = Cluster(address=cluster.address)
    return Control(hears, jobs=None, cluster=OnCluster(where, None, hears.inform))


def asked(case, folder, *overrides, plan=plan_scan):
    (case.parent / folder).mkdir(exist_ok=True)
    return plan(Request(str(case), overrides, str(case.parent / folder)))


@pytest.fixture
def sent_tasks(monkeypatch):
    """How many parts of a search were sent at a time."""
    sent = []
    evaluate_ahead = ModelWorkers.evaluate_ahead
    monkeypatch.setattr(
        ModelWorkers, "evaluate_ahead",
        lambda self, tasks, *where: sent.append(len(tasks)) or evaluate_ahead(self, tasks, *where),
    )  # fmt: skip
    return sent


def has_the_bits_of_a_serial_run(run, case, plan, said, control):
    here = run(asked(case, "here", *said, plan=plan), Control()).result
    there = run(asked(case, "there", *said, plan=plan), control).result
    control.tell_of_cluster()
    assert NOTHING_SENT not in control.monitor.said
    assert there.parameters.values.tobytes() == here.parameters.values.tobytes()
    for mine, its in zip(here.history, there.history, strict=True):
        assert mine.objective == its.objective
        assert np.array_equal(mine.values, its.values)
    assert there.counts.evaluations == here.counts.evaluations


@pytest.mark.slow  # a fit of the cluster has them, too
def test_a_scan_has_the_bits_of_a_serial_run(tmp_path, cluster, sent_tasks):
    said = ("fit.scan.points=3", "fit.reduced=false")
    has_the_bits_of_a_serial_run(scan, write_case(tmp_path), plan_scan, said, on(cluster))
    assert sent_tasks == [9]


def test_starts_of_a_fit_have_the_bits_of_a_serial_run(tmp_path, somewhere, sent_tasks):
    starts = ("fit.gauss-newton.starts=3", "fit.reduced=false", "fit.model_error=none",
              "fit.backtest=false")  # fmt: skip
    has_the_bits_of_a_serial_run(fit, write_case(tmp_path), plan_fit, starts, somewhere())
    assert sent_tasks == [2]


def test_draws_of_a_posterior_are_those_of_a_serial_run(tmp_path, somewhere, monkeypatch):
    case, asked_there = write_case(tmp_path), []
    for kind in (DaskCluster, ClusterHere):
        monkeypatch.setattr(
            kind, "run",
            lambda self, tasks, run=kind.run: asked_there.append(len(tasks)) or run(self, tasks),
        )  # fmt: skip
    said = ("fit.reduced=false", "fit.model_error=none", "fit.backtest=false")
    fit(asked(case, "out", *said, plan=plan_fit), Control())
    found = []
    for place, control in (("here", Control()), ("there", somewhere())):
        (tmp_path / place).mkdir()
        request = Request(str(tmp_path / "out" / "case.fit.h5"), output=str(tmp_path / place))
        found.append(
            sample(plan_sample(SampleRequest(request, draws=60, effective=30)), control).result
        )
        assert bool(asked_there) == (place == "there")
    control.tell_of_cluster()
    assert NOTHING_SENT not in control.monitor.said
    here, there = found
    assert here.posterior.values.tobytes() == there.posterior.values.tobytes()
    assert here.posterior.log_density.tobytes() == there.posterior.log_density.tobytes()
    assert here.prediction.mean.tobytes() == there.prediction.mean.tobytes()
    assert here.counts.evaluations == there.counts.evaluations > 30


def test_a_fit_that_has_nothing_to_compute_at_a_time_says_so(tmp_path):
    case, where = write_case(tmp_path), Cluster()
    control = Control(Hears(), cluster=OnCluster(where, None, print))
    fit(asked(case, "out", "fit.backtest=false", plan=plan_fit), control)
    control.tell_of_cluster()
    assert NOTHING_SENT in control.monitor.said


def test_runs_of_a_program_are_made_there_and_logged_here(tmp_path, cluster):
    script = PROGRAM.replace(
        "E, K = (", "from pathlib import Path\nPath('ran').touch()\nE, K = (", 1
    )
    model = EXTERNAL.replace(f"[{sys.executable}, -S, opening.py]", "[./opening.py]")
    found, known = [], []
    for place, control in (("here", Control(jobs=None)), ("there", on(cluster))):
        case = write_program(tmp_path / place, model, script=f"#!{sys.executable} -S\n{script}")
        (case.parent / "opening.py").chmod(0o755)
        with trusted():
            grid = ("fit.scan.grid={E: {from: 5 GPa, to: 7 GPa, points: 3}, "
                    "K0: {from: 1, to: 2.95, points: 2}}")  # fmt: skip
            found.append(scan(asked(case, "out", grid), control).result)
        lines = (case.parent / "case.runs" / "runs.jsonl").read_text().splitlines()
        runs = [json.loads(line) for line in lines]
        assert len({run["key"] for run in runs}) == len(runs)
        failed = [run for run in runs if "failed" in run]
        assert len(failed) >= 3
        known.append({run["key"] for run in runs})
        for run in failed:  # what it has left came back
            folder = run["folder"]
            assert (case.parent / "case.runs" / folder.rpartition("/")[2] / "ran").exists()
            assert folder.startswith(str(case.parent))
        kept = [path for path in (case.parent / "case.runs").iterdir() if path.is_dir()]
        assert len(kept) == len(failed)
    assert known[0] == known[1]
    assert found[0].grid.objective.tobytes() == found[1].grid.objective.tobytes()


def test_a_program_among_the_arguments_travels_with_what_it_imports(tmp_path, cluster):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    script = PROGRAM.replace("nu=0.25", "nu=NU").replace(
        "E, K = (", "open('where', 'w').write(__file__)\nE, K = (", 1
    )
    (elsewhere / "prog.py").write_text(f"from ground import NU\n{script}")
    (elsewhere / "ground.py").write_text("NU = 0.25\n")
    model = EXTERNAL.replace("opening.py]\n  inputs", f"{elsewhere / 'prog.py'}]\n  inputs")
    model = model.replace("  files: [opening.py]\n", "  keep: all\n")
    case = write_program(tmp_path / "case", model)
    with trusted():
        scan(asked(case, "out", "fit.scan.points=2"), on(cluster))
    ran = [path.read_text() for path in (tmp_path / "case" / "case.runs").glob("*/where")]
    assert len(ran) >= 4
    assert all(place.endswith("/elsewhere/prog.py") for place in ran)
    assert str(elsewhere / "prog.py") not in ran  # what travelled is what runs


class There:
    """A cluster in this process whose tasks end as they are told."""

    used, workers = False, 2

    def __init__(self, end):
        self.end = end

    def require(self):
        pass

    def begin(self, set_up, parcel=None, *, check=None):
        self.check, self.used = check, True
        return self

    def __enter__(self):
        return self

    def __exit__(self, *told):
        pass

    def ask_to_stop(self):
        pass

    def run(self, tasks):
        for number, _ in enumerate(tasks):
            self.check()
            yield self.end(number)


def test_a_run_that_three_workers_were_lost_over_has_failed_by_name(tmp_path):
    case = write_program(tmp_path / "case")
    where = There(
        lambda n: Answered(n, None, ("ended with its worker tcp://node7:41 on node7",) * 3)
    )
    lost = pytest.raises(ModelError, match="ended with its worker tcp://node7:41 on node7")
    with trusted(), lost:
        scan(asked(case, "out", "fit.scan.points=2"), Control(cluster=where))
    runs = (case.parent / "case.runs" / "runs.jsonl").read_text().splitlines()
    assert len(runs) >= 4
    assert all("it has cost 3 processes" in run for run in runs)


def test_a_stop_ends_runs_on_a_cluster_and_the_same_command_goes_on(tmp_path):
    case = write_program(tmp_path / "case")
    control = Control()
    control.cluster = There(
        lambda n: control.stop.ask(ExitCode.INTERRUPTED) or Answered(n, None, (), True)
    )
    with trusted(), pytest.raises(Interrupted, match="continues from there") as caught:
        scan(asked(case, "out", "fit.scan.points=2"), control)
    assert caught.value.exit_code == ExitCode.INTERRUPTED


def test_a_cluster_that_is_not_there_is_said_before_the_model_is_built(tmp_path, monkeypatch):
    monkeypatch.setattr(connection, "REACH", 0.2)
    case = write_case(tmp_path)
    where = Cluster(address=f"tcp://127.0.0.1:{free_port()}")
    control = Control(cluster=OnCluster(where, None, print))
    for run, plan in ((fit, plan_fit), (scan, plan_scan)):
        monkeypatch.setattr(
            "geoident.workflow.estimating.estimate.prepare", lambda job: pytest.fail("built")
        )
        with pytest.raises(InputError, match="no scheduler of dask answers at tcp://127"):
            run(asked(case, "out", plan=plan), control)


def test_sections_of_a_project_are_fitted_there(tmp_path, somewhere):
    """Each by itself and all together, as here; the files of their cases travel."""
    path, results = example(tmp_path, SECTIONS), []
    for control, request in (
        (Control(), ProjectRequest(path, jobs=1)),
        (somewhere(), ProjectRequest(path, fresh=True)),
    ):
        results.append(fit_project(plan_project(request), control).result)
        control.tell_of_cluster()
    assert NOTHING_SENT not in control.monitor.said
    here, there = results
    assert [row.name for row in there.common] == [row.name for row in here.common]
    for one, other in zip(here.common, there.common, strict=True):
        np.testing.assert_allclose(one.value, other.value, rtol=1e-9)
        np.testing.assert_allclose(one.sd, other.sd, rtol=1e-6)
    assert not list(tmp_path.glob("*checkpoint*"))


@pytest.mark.slow
def test_programs_of_sections_run_there_and_are_logged_here(tmp_path, cluster):
    script = PROGRAM.replace(
        "E, K = (", "from pathlib import Path\nPath('ran').touch()\nE, K = (", 1
    )
    model = EXTERNAL.replace(f"[{sys.executable}, -S, opening.py]", "[./opening.py]")
    for name in "AB":
        case = write_program(tmp_path / name, model, script=f"#!{sys.executable} -S\n{script}")
        (case.parent / "opening.py").chmod(0o755)
        case.write_text(
            case.read_text().replace("backtest: false", "backtest: false, model_error: none")
        )
    (tmp_path / "project.yaml").write_text(
        "format: geoident-project/1\ntitle: twice\nsections:\n"
        "  - {name: A, case: A/case.yaml}\n  - {name: B, case: B/case.yaml}\nshared: [E, K0]\n"
    )
    control = on(cluster)
    with trusted():
        fit_project(plan_project(ProjectRequest(str(tmp_path / "project.yaml"))), control)
    control.tell_of_cluster()
    assert NOTHING_SENT not in control.monitor.said
    assert not list(tmp_path.rglob("ran"))
    assert list(tmp_path.rglob("runs.jsonl"))
