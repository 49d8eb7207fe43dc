"""No output ever replaces an input of its command, with --force or not, under whatever name."""

import os
import shutil
from pathlib import Path

import pytest

from tests.support.commands import run_command
from tests.support.trench import write_case

OTHER = "gauge,stage,value,unit\nCV,first,-0.6,mm\nS,first,-0.12,mm\n"
WARM = "x [m], y [m], change [K]\n0, 0, 1\n6, 0, 1\n0, 4, 1\n6, 4, 1\n"
INPUTS = ("case.yaml", "trench.inp", "nodes.inc", "readings.csv", "warm.csv", "sub/more.csv")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The folder of a case with every kind of file that it may name, and a fit of it."""
    trench = write_case(tmp_path_factory.mktemp("site")).parent
    head, _, rest = (trench / "trench.inp").read_text().partition("*ELEMENT")
    (trench / "nodes.inc").write_text(head)
    (trench / "trench.inp").write_text(f"*INCLUDE, INPUT=nodes.inc\n*ELEMENT{rest}")
    (trench / "warm.csv").write_text(WARM)
    (trench / "sub").mkdir()
    rows = (trench / "readings.csv").read_text().splitlines(keepends=True)
    (trench / "readings.csv").write_text("".join(rows[:-1]))
    (trench / "sub" / "more.csv").write_text(rows[0] + rows[-1])
    text = (trench / "case.yaml").read_text()
    text = text.replace("readings: readings.csv", "readings: [readings.csv, sub/more.csv]")
    text = text.replace("nu: 0.25}", "nu: 0.25, expansion: 1e-5 1/K}")
    text = text.replace(
        "excavate: [lower]}", "excavate: [lower], temperature: {rock: {file: warm.csv}}}"
    )
    (trench / "case.yaml").write_text(text)
    assert run_command("fit", trench / "case.yaml").exit_code == 0
    return trench


@pytest.fixture
def site(fitted, tmp_path, monkeypatch):
    """A copy of it, which is the current folder."""
    shutil.copytree(fitted, tmp_path / "site")
    monkeypatch.chdir(tmp_path / "site")
    return tmp_path / "site"


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(done):
    """The command ended with 6, and said why."""
    assert done.exit_code == 6, (done.exit_code, done.stderr)
    assert "is an input of this command" in done.stderr
    assert "is never replaced" in done.stderr


COMMANDS = {
    "simulate": ("simulate", "case.yaml"),
    "simulate without readings": ("simulate", "case.yaml", "--set", "readings=[]"),
    "fit": ("fit", "case.yaml"),
    "scan": ("scan", "case.yaml"),
    "predict": ("predict", "case.fit.h5"),
    "report": ("report", "case.fit.h5"),
    "export": ("export", "case.fit.h5", "--table", "gauges"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_replaces_a_file_that_its_case_names(site, run, command):
    before = contents(site)
    refused(run(*COMMANDS[command], "-o", INPUTS[0]))
    for name in INPUTS:
        refused(run(*COMMANDS[command], "-o", name, "--force"))
    assert contents(site) == before


def by_symlink(path, place):
    place.symlink_to(path)


def by_hard_link(path, place):
    place.hardlink_to(path)


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_replaces_an_input_through_a_link(site, run, command):
    """Links of the one kind and of the other by turns; which files are inputs is asked above."""
    for number, name in enumerate((*INPUTS[:2], "case.fit.h5")):
        if name.endswith(".h5") and COMMANDS[command][1] == "case.yaml":
            continue  # no input of these
        suffix = ".csv" if "simulate" in command else ".h5"
        place = site / f"out-{number}{suffix}"
        (by_symlink, by_hard_link)[number % 2](site / name, place)
        before = contents(site)
        refused(run(*COMMANDS[command], "-o", place.name, "--force"))
        assert contents(site) == before


@pytest.mark.parametrize("spelling", ["./case.yaml", "sub/../case.yaml", "absolute", "linked"])
def test_other_spellings_of_a_path_do_not_help(site, run, spelling):
    (site / "linked").symlink_to(site, target_is_directory=True)
    place = {"absolute": str(site / "case.yaml"), "linked": "linked/case.yaml"}
    before = contents(site)
    for name in ("simulate", "fit", "export"):
        refused(run(*COMMANDS[name], "-o", place.get(spelling, spelling), "--force"))
    assert contents(site) == before


def test_a_result_is_not_replaced_by_what_is_made_of_it(site, run):
    before = contents(site)
    for command in ("predict", "report", "export"):
        refused(run(*COMMANDS[command], "-o", "case.fit.h5", "--force"))
    assert contents(site) == before


def test_the_case_of_a_prediction_is_kept_like_that_of_the_fit(site, run):
    text = (site / "case.yaml").read_text()
    (site / "other.yaml").write_text(text.replace("[readings.csv, sub/more.csv]", "other.csv"))
    (site / "other.csv").write_text(OTHER)
    before = contents(site)
    for name in ("other.yaml", "other.csv", "case.yaml", "readings.csv"):
        done = run("predict", "case.fit.h5", "--case", "other.yaml", "-o", name, "--force")
        refused(done)
    assert contents(site) == before


@pytest.mark.parametrize("suffix", ["vtkhdf", "checkpoint"])
def test_neither_sidecar_nor_checkpoint_replaces_an_input(site, run, suffix):
    os.link(site / "readings.csv", site / f"new.{suffix}")
    before = contents(site)
    for command in ("fit", "predict"):
        if command == "predict" and suffix == "checkpoint":
            continue  # it keeps none
        refused(run(*COMMANDS[command], "-o", "new.h5", "--force", "--fresh"))
    assert contents(site) == before


@pytest.mark.usefixtures("plain_pictures")
def test_pictures_and_folders_of_figures_and_tables_replace_no_input(site, run):
    os.link(site / "readings.csv", site / "picture.svg")
    before = contents(site)
    refused(run("check", "case.yaml", "--picture", "picture.svg", "--force"))
    assert contents(site) == before
    assert run("report", "case.fit.h5", "--no-page", "--figures", "figures").exit_code == 0
    assert run("export", "case.fit.h5", "--format", "csv", "--format", "vtu").exit_code == 0
    for folder in ("figures", "case.fit.export"):
        for number, file in enumerate(sorted((site / folder).iterdir())):
            file.unlink()
            os.link(site / INPUTS[number % len(INPUTS)], file)
    before = contents(site)
    refused(run("report", "case.fit.h5", "--no-page", "--figures", "figures", "--force"))
    for kind in ("csv", "vtu"):
        refused(run("export", "case.fit.h5", "--format", kind, "--force"))
    assert contents(site) == before


def test_init_does_not_replace_the_mesh_that_it_begins_with(site, run):
    (site / "new").mkdir()
    for name in ("trench.inp", "nodes.inc"):
        (site / "new" / "case.yaml").unlink(missing_ok=True)
        os.link(site / name, site / "new" / "case.yaml")
        before = contents(site)
        refused(run("init", "new", "--from", "trench.inp", "--force"))
        assert contents(site) == before


def test_what_is_no_input_is_replaced_on_demand(site, run):
    Path("old.csv").write_text("old")
    done = run("simulate", "case.yaml", "-o", "old.csv")
    assert done.exit_code == 6
    assert "--force replaces it" in done.stderr
    assert run("simulate", "case.yaml", "-o", "old.csv", "--force").exit_code == 0
    assert Path("old.csv").read_text().startswith("gauge,stage,value,unit")
    Path("readings.csv").unlink()  # what is not there yet may be made
    assert run("simulate", "case.yaml", "-o", "readings.csv").exit_code == 0


def test_the_hint_of_simulate_names_no_file_that_is_there(site, run):
    for place in ("simulated.csv", "simulated-2.csv", "simulated-3.csv"):
        done = run("simulate", "case.yaml")
        assert f"-o {place}" in done.stderr
        assert run("simulate", "case.yaml", "-o", place).exit_code == 0
