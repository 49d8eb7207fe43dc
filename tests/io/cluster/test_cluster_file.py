"""Clusters as they are written: an address, a file, a section of a campaign."""

from pathlib import Path

import pytest

from geoident.errors import InputError, Location
from geoident.io.campaign.file import read_campaign
from geoident.io.cluster.file import read_cluster

CAMPAIGN = "format: geoident-campaign/1\ncase: case.yaml\nvariations: {rows: [{run: a}]}\n"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.yaml").write_text("")


@pytest.mark.parametrize(
    ("given", "address"),
    [
        ("tcp://node1:8786", "tcp://node1:8786"),
        ("node1:8786", "tcp://node1:8786"),
        ("tls://[2001:db8::1]:8786", "tls://[2001:db8::1]:8786"),
        ("local", ""),
    ],
)
def test_addresses(given, address):
    found = read_cluster(given)
    assert found.address == address
    assert found.local == (given == "local")


def test_what_is_neither_an_address_nor_a_file_is_refused():
    with pytest.raises(
        InputError, match="'nowhere' is not an address, and there is no file"
    ) as caught:
        read_cluster("nowhere")
    assert "tcp://node1:8786" in str(caught.value)


def test_a_file_of_a_queue_system_keeps_the_keys_of_dask_jobqueue():
    Path("c.yaml").write_text(
        "format: geoident-cluster/1\njobs: 10\npatience: 5 min\n"
        "slurm:\n  cores: 16\n  memory: 64 GB\n  nanny: true\n  walltime: 02:00:00\n"
        "  job_extra_directives: ['--exclusive']\n"
    )
    found = read_cluster("c.yaml")
    assert (found.queue, found.jobs, found.patience) == ("slurm", 10, 300.0)
    assert found.options == {
        "cores": 16, "memory": "64 GB", "nanny": True, "walltime": "02:00:00",
        "job_extra_directives": ["--exclusive"],
    }  # fmt: skip
    assert found.places["memory"] == Location("c.yaml", 6, 11)


def test_a_campaign_has_the_same_as_a_section():
    Path("campaign.yaml").write_text(f"{CAMPAIGN}cluster: {{address: 'node1:8786'}}\n")
    found = read_campaign("campaign.yaml").cluster
    assert found is not None
    assert (found.address, found.place.line) == ("tcp://node1:8786", 4)
    Path("campaign.yaml").write_text(CAMPAIGN)
    assert read_campaign("campaign.yaml").cluster is None


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("address: a:1\nlocal: true", "c.yaml:1:1", "found address and local; one of"),
        ("jobs: 3", "c.yaml:1:1", "found nothing; one of"),
        ("address: a:1\njobs: 3", "c.yaml:3:7", "'jobs' are of a queue system"),
        ("address: 'a b'", "c.yaml:2:10", "'a b' is not an address"),
        ("adress: a:1", "c.yaml:2:1", "Did you mean 'address'?"),
        ("slurm: {}\njobs: 0", "c.yaml:3:7", "'0'"),
        (
            "address: a:1\nsecurity: {ca_file: x, cert: y, key: z}",
            "c.yaml:3:11", "an address that begins with tls://",
        ),
        (
            "address: tls://a:1\nsecurity: {ca_file: x, cert: c.yaml, key: c.yaml}",
            "c.yaml:3:21", "there is no file 'x'",
        ),
    ],
)  # fmt: skip
def test_faults_are_said_where_they_are_written(text, place, said):
    Path("c.yaml").write_text(f"format: geoident-cluster/1\n{text}\n")
    with pytest.raises(InputError) as caught:
        read_cluster("c.yaml")
    assert place in str(caught.value)
    assert said in str(caught.value)
