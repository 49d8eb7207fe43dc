"""What lies in the folder of a stranger does nothing: links, results, checkpoints, campaigns."""

import ast
from pathlib import Path

import h5py
import numpy as np
import pytest

import geoident
from geoident.errors import ExitCode
from tests.support.external import PYTHON, SCRIPT
from tests.support.external import write_case as write_elsewhere

CAMPAIGN = """\
format: geoident-campaign/1
title: $(run this)
case: case.yaml
command: simulate
variations: {product: {parameters.E.start: [3 GPa]}}
"""
PACKAGE = Path(geoident.__file__).parent


@pytest.fixture
def mine(tmp_path_factory):
    """A file outside of the folder, which nothing there may change."""
    file = tmp_path_factory.mktemp("home") / ".bashrc"
    file.write_text("mine\n")
    yield file
    assert file.read_text() == "mine\n"


@pytest.mark.usefixtures("trench", "in_this_process")
@pytest.mark.parametrize("name", ["runs.jsonl", ".lock", "runs.csv", "campaign.h5"])
def test_a_campaign_writes_through_no_link(run, mine, name):
    Path("campaign.yaml").write_text(CAMPAIGN)
    assert run("batch", "campaign.yaml").exit_code == ExitCode.DONE
    place = Path("campaign.batch") / name
    place.unlink(missing_ok=True)
    place.symlink_to(mine)
    refused = run("batch", "campaign.yaml", "--fresh")
    assert refused.exit_code == ExitCode.OUTPUT, refused.output
    assert f"{place}: is a symbolic link" in refused.stderr


@pytest.mark.usefixtures("trench")
def test_a_fit_keeps_no_checkpoint_behind_a_link(run, mine):
    Path("case.fit.checkpoint").symlink_to(mine)
    done = run("fit", "case.yaml")
    assert done.exit_code == ExitCode.DONE
    assert "case.fit.checkpoint: no checkpoint is kept" in done.stderr


def test_runs_are_logged_behind_no_link(run, mine, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(mine.parent / "state"))
    case = write_elsewhere(tmp_path, PYTHON, script=SCRIPT)
    (tmp_path / "case.runs").mkdir()
    for name in ("runs.jsonl", "trusted.json"):
        (tmp_path / "case.runs" / name).symlink_to(mine)
    refused = run("simulate", case, "--trust")
    assert refused.exit_code == ExitCode.OUTPUT
    assert "runs.jsonl: is a symbolic link" in refused.stderr


def outside(file, name, secret):
    """Have a table of a result lie in another file."""
    given = file[name]
    shape, dtype = given.shape, given.dtype
    del file[name]
    file.create_dataset(name, shape, dtype, external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def linked(file, name, secret):
    """Have a table of a result be one of another file."""
    with h5py.File(secret.with_suffix(".h5"), "w") as other:
        other["secret"] = file[name][()]
    del file[name]
    file[name] = h5py.ExternalLink(str(secret.with_suffix(".h5")), "secret")


@pytest.mark.parametrize("elsewhere", [outside, linked])
def test_a_result_shows_nothing_of_other_files(fitted_trench, run, tmp_path_factory, elsewhere):
    secret = tmp_path_factory.mktemp("home") / "secret"
    secret.write_bytes(np.full(100, 42.0).tobytes())
    with h5py.File("case.fit.h5", "r+") as file:
        elsewhere(file, "parameters/value", secret)
    refused = run("show", "case.fit.h5")
    assert refused.exit_code == ExitCode.INVALID_INPUT
    assert "parameters/value lies in another file" in refused.stderr


def test_a_result_says_nothing_to_the_terminal(fitted_trench, run):
    with h5py.File("case.fit.h5", "r+") as file:
        file.attrs["reason"] = "done\x1b[2J\x07 "
        for names in ("name", "parameter"):
            file[f"parameters/{names}"][0] = "E\x1b]0;title\x07"
    shown = run("show", "case.fit.h5")
    assert shown.exit_code == ExitCode.DONE, shown.output
    assert r"E\x1b]0;title\x07" in shown.output
    assert not set("\x1b\x07") & set(shown.output)


RUNS_CODE = {"eval", "exec", "compile", "execfile", "__import__"}
OWN_PROCESSES = {
    "workflow/executing/processes.py",
    "workflow/executing/worker.py",
    "workflow/programs/function_process.py",
}
"""Modules that read what another process of the same command has pickled, never a file."""


def calls_that_run(path):
    """Calls in a module by which data could run."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        said, safe = ast.unparse(node.func), {k.arg: ast.unparse(k.value) for k in node.keywords}
        name = path.relative_to(PACKAGE).as_posix()
        if said in RUNS_CODE or (
            said in ("pickle.load", "pickle.loads") and name not in OWN_PROCESSES
        ):
            yield f"{name}: {said}"
        if said in ("np.load", "numpy.load") and safe.get("allow_pickle") != "False":
            yield f"{name}: {said}"
        if said in ("yaml.load", "yaml.load_all", "yaml.unsafe_load", "yaml.full_load") and (
            safe.get("Loader") != "_LOADER"
        ):
            yield f"{name}: {said}"


def test_nothing_that_is_read_from_a_file_can_run():
    assert not [call for path in PACKAGE.rglob("*.py") for call in calls_that_run(path)]
    for path in PACKAGE.rglob("*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("_LOADER"):
                assert "Safe" in line or "CBaseLoader" in line
