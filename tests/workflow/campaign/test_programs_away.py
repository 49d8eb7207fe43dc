"""Programs and functions as models on a cluster: what they consist of travels, runs come back."""

import json
import shutil
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from support.external import EXTERNAL, PROGRAM, PYTHON, SCRIPT, write_case

import geoident
from geoident.cli.app import geoident as app
from geoident.cli.options import Options
from geoident.cli.several_away import run_cases
from geoident.errors import ExitCode, InputError
from geoident.model.cluster import Cluster
from geoident.report.text.campaign.spreadsheet import runs_csv
from geoident.workflow.campaign.away import AwayRuns, cluster_executor, compute_away, sent
from geoident.workflow.campaign.campaign import compute
from geoident.workflow.campaign.one_run import RunTask
from geoident.workflow.campaign.one_run import compute as compute_run
from geoident.workflow.campaign.plan import plan_campaign, require_trust
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.programs.trust import decided_by, trusting

OPENING = Path(geoident.__file__).parent / "templates" / "opening"
LOCAL = EXTERNAL.replace(f"[{sys.executable}, -S, opening.py]", "[./opening.py]").replace(
    "  files: [opening.py]\n", ""
)
SPLIT = SCRIPT.replace(
    "import math\n", "import math\nfrom pathlib import Path\nfrom rock import nu0\n"
)
SPLIT = SPLIT.replace("nu=0.25", "nu=nu0()")
ROCK = "from pathlib import Path\n\ndef nu0():\n    return float(Path('nu.txt').read_text())\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder of its own; decisions of these tests are not those of who runs them."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def write(command, varied):
    Path("campaign.yaml").write_text(
        f"format: geoident-campaign/1\ncase: case.yaml\ncommand: {command}\n"
        f"variations: {{product: {{{varied}}}}}\n"
    )


def computed(cluster, output="away", *, trust=True):
    plan = plan_campaign("campaign.yaml", output=output)
    permitted = ()
    if trust:
        with decided_by(trusting(trust=True)):
            permitted = require_trust(plan)
    where = Cluster(address=cluster.address)
    with cluster_executor(plan, where, 2, lambda message: None) as executor:
        away = AwayRuns(executor, plan)
        return compute(plan, away, lambda record: None, runs_csv, permitted=permitted)


def logged(folder="case.runs"):
    lines = (Path(folder) / "runs.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


def function_case(here):
    write_case(here, PYTHON.replace("}", ", files: [nu.txt]}"), script=SPLIT)
    (here / "rock.py").write_text(ROCK)
    (here / "nu.txt").write_text("0.25")


@pytest.mark.slow  # a function is fitted there below, in one of several cases
def test_a_function_with_what_it_imports_and_reads_is_fitted_there_as_here(here, cluster):
    function_case(here)
    write("fit", "parameters.E.start: [3 GPa]")
    table = computed(cluster)
    assert [run.status for run in table.runs] == ["converged"]
    made = logged()
    assert len({(run["key"]) for run in made}) == len(made) > 20  # none was lost, none made twice
    plan = plan_campaign("campaign.yaml", output="here")
    plan.folder.mkdir()
    for run, one in zip(plan.runs, table.runs, strict=True):
        mine = compute_run(
            RunTask(plan.campaign, plan.folder, run)
        )  # the permission is remembered here, with the runs
        assert repr(mine.parameters) == repr(one.parameters)
    assert logged() == made  # what was made there is known here
    (here / "nu.txt").write_text("0.3")
    assert len(plan_campaign("campaign.yaml", output="away").remaining) == 1


def test_a_program_beside_the_case_runs_there_and_what_failed_comes_back(here, cluster):
    write_case(here, LOCAL, script=f"#!{sys.executable} -S\n{PROGRAM}")
    (here / "opening.py").chmod(0o755)
    write("simulate", "parameters.K0.start: [1.0, 2.95]")
    good, bad = computed(cluster).runs
    assert good.status == "done"
    assert bad.status == "failed"
    failed = [run for run in logged() if "failed" in run]
    assert len(failed) == 1
    assert "no equilibrium" in (here / failed[0]["folder"] / "stderr.txt").read_text()
    assert failed[0]["folder"] in bad.reason


def ends_there(permitted):
    """How the runs of the campaign end in a process elsewhere."""
    plan = plan_campaign("campaign.yaml", output="out")
    tasks = [RunTask(plan.campaign, Path("out"), run, permitted=permitted) for run in plan.runs]
    return [compute_away(sent(task, "case.runs")).end for task in tasks]


def test_nothing_is_run_there_that_nobody_has_permitted(here):
    function_case(here)
    other = "\n\ndef others(values):\n    return readings(values)\n"
    (here / "opening.py").write_text(SPLIT + other)
    write("simulate", "'model.function': ['opening:readings', 'opening:others']")
    with decided_by(trusting(trust=True), remembered=False):
        permitted = require_trust(plan_campaign("campaign.yaml"))
    assert [run.exit_code for run in ends_there(())] == [ExitCode.INVALID_INPUT] * 2
    one, varied = ends_there(permitted)
    assert one.exit_code == ExitCode.DONE
    assert varied.exit_code == ExitCode.INVALID_INPUT
    assert "it is not trusted yet" in varied.reason
    assert not Path("case.runs/trusted.json").exists()


@pytest.mark.slow  # test_cluster.py asks the same of lines in a file
def test_what_a_lost_process_has_run_is_not_run_again(here, cluster, monkeypatch):
    monkeypatch.setattr(DaskCluster, "journals_every", 0.2)
    ends = f"""
    import os, time
    from pathlib import Path
    count, mark = Path({str(here / "count")!r}), Path({str(here / "mark")!r})
    with count.open("a") as file:
        file.write("x")
    if count.stat().st_size == 12:
        time.sleep(1.0)
        os.kill(os.getppid(), 9)
"""
    script = SCRIPT.replace(
        '    E, K = values["E"], values["K0"]\n', f'{ends}    E, K = values["E"], values["K0"]\n'
    )
    write_case(here, PYTHON.replace("}", ", at_once: 1}"), script=script)
    write("fit", "parameters.E.start: [3 GPa]")
    (run,) = computed(cluster).runs
    assert run.status == "converged"
    assert len(run.losses) == 1
    made = logged()
    assert len({run["key"] for run in made}) == len(made)
    assert len(made) <= (here / "count").stat().st_size <= len(made) + 1


def test_the_journal_of_a_run_is_what_it_writes(here):
    for path in OPENING.iterdir():
        shutil.copy(path, here)
    write("fit", "parameters.E_rock.start: [3 GPa]")
    text = Path("campaign.yaml").read_text()
    Path("campaign.yaml").write_text(f"{text}max_time: 0.001 s\n")
    plan = plan_campaign("campaign.yaml", output="out")
    away = sent(RunTask(plan.campaign, Path("out"), plan.runs[0]), "")
    end = compute_away(away)
    assert away.journals == (away.checkpoint,)
    assert Path(away.checkpoint).name in end.files


def test_a_file_of_the_model_that_is_named_by_its_place_here_is_refused(here):
    function_case(here)
    case = Path("case.yaml")
    case.write_text(case.read_text().replace("[nu.txt]", f"[{here / 'nu.txt'}]"))
    write("simulate", "parameters.K0.start: [1.0]")
    plan = plan_campaign("campaign.yaml")
    with pytest.raises(InputError, match="is not in this place on a cluster"):
        cluster_executor(plan, Cluster(), 1, lambda message: None)


def test_several_cases_that_are_run_are_fitted_there(here, cluster):
    write_case(here / "one")
    script = SPLIT.replace("from rock", "from lib.rock")
    write_case(here / "two", PYTHON, script=script)
    (here / "two" / "lib").mkdir()
    (here / "two" / "lib" / "rock.py").write_text("def nu0():\n    return 0.25\n")
    cases = ["one/case.yaml", "two/case.yaml"]
    assert [one.permitted for one in run_cases(cases, Options()).values()] == ["", ""]
    command = ["fit", *cases, "--cluster", cluster.address, "--trust"]
    found = CliRunner().invoke(app, command)
    assert found.exit_code == 0, found.stderr
    assert found.stdout.split() == ["one/case.fit.h5", "two/case.fit.h5"]
    for name in ("one", "two"):
        made = logged(f"{name}/case.runs")
        assert len({run["key"] for run in made}) == len(made) > 10
