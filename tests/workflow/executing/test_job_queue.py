"""Jobs of queue systems: the scripts that are submitted, and a queue of one machine."""

import os
from pathlib import Path

import pytest

from geoident.errors import InputError, Location
from geoident.model.cluster import Cluster
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.executor import in_order
from geoident.workflow.executing.job_queue import job_script
from geoident.workflow.executing.parcel import packed
from tests.support.tasks import squares

COMMON = {"cores": 4, "processes": 4, "memory": "8 GB", "interface": "lo"}
SCRIPTS = {
    "slurm": (
        {"queue": "long", "account": "tunnels", "walltime": "02:00:00"},
        ["#SBATCH -p long", "#SBATCH -A tunnels", "#SBATCH --cpus-per-task=4", "#SBATCH --mem=8G",
         "#SBATCH -t 02:00:00"],
    ),
    "pbs": (
        {"queue": "long", "walltime": "02:00:00"},
        ["#PBS -q long", "#PBS -l select=1:ncpus=4:mem=7630MB", "#PBS -l walltime=02:00:00"],
    ),
    "lsf": (
        {"queue": "long", "walltime": "02:00"},
        ["#BSUB -q long", "#BSUB -n 4", "#BSUB -W 02:00"],
    ),
    "sge": (
        {"queue": "long", "resource_spec": "m_mem_free=8G", "walltime": "02:00:00"},
        ["#$ -q long", "#$ -l m_mem_free=8G", "#$ -l h_rt=02:00:00"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("queue", SCRIPTS)
def test_the_script_of_a_job_says_what_the_file_says(queue):
    options, expected = SCRIPTS[queue]
    prologue = {"job_script_prologue": ["module load python"]}
    lines = job_script(Cluster(queue=queue, options=COMMON | options | prologue)).splitlines()
    for line in (*expected, "module load python"):
        assert line in lines
    assert "--nthreads 1" in lines[-1]
    assert "--nworkers 4" in lines[-1]


def test_keys_that_dask_jobqueue_does_not_know_are_refused_all_at_once():
    options = {"coers": 4, "queue": "long", "walltme": "02:00:00"}
    places = {"coers": Location("c.yaml", 3, 3), "walltme": Location("c.yaml", 5, 3)}
    with pytest.raises(InputError) as caught:
        job_script(Cluster(queue="slurm", options=options, places=places))
    said = str(caught.value)
    assert "c.yaml:3:3: slurm.coers: SLURMCluster of dask-jobqueue has no key 'coers'" in said
    assert "Did you mean 'cores'?" in said
    assert "c.yaml:5:3" in said


@pytest.fixture
def queue(tmp_path, monkeypatch):
    """Commands of Slurm that run jobs at once, here."""
    folder = tmp_path / "bin"
    folder.mkdir()

    def command(name, text):
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)

    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    jobs = tmp_path / "jobs"
    jobs.mkdir()
    run = f'f=$(mktemp {jobs}/XXXXXX); cp "$1" $f; exec 3>&1; sh $f >/dev/null 2>&1 3>&- &'
    command("sbatch", f'{run}\necho "Submitted batch job $!"')
    command("scancel", 'for p in "$@"; do kill $(ps -o pid= --ppid $p) $p; done 2>/dev/null; true')
    return command


def test_tasks_are_computed_by_jobs(queue):
    said = []
    slurm = Cluster(queue="slurm", options=COMMON | {"cores": 1, "processes": 1})
    with DaskCluster(slurm, squares, packed(), tell=said.append) as executor:
        found = list(in_order(executor.run(range(10))))
    assert [answer.value[0] for answer in found] == [n * n for n in range(10)]
    assert said[0] == "Waiting for the jobs of slurm to start."


def test_what_a_queue_system_refuses_is_said(queue):
    queue("sbatch", "echo 'sbatch: error: invalid partition specified: x' >&2; exit 1")
    place = Location("c.yaml", 2, 8)
    with (
        pytest.raises(InputError, match="sbatch: error: invalid partition") as caught,
        DaskCluster(Cluster(queue="slurm", options=COMMON, place=place), squares, packed()),
    ):
        pass
    assert "c.yaml:2:8" in str(caught.value)
