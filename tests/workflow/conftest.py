"""What tests of commands share."""

import pytest
from support.executors import LOCAL, InThisProcess
from support.real_cluster import RealCluster


@pytest.fixture(scope="session")
def cluster(tmp_path_factory):
    """A scheduler of dask and two workers, which tests may kill but not end."""
    with RealCluster(tmp_path_factory.mktemp("workers")) as made:
        made.add_node()
        made.add_node()
        yield made


@pytest.fixture
def answered_here(monkeypatch):
    """Processes of this machine are this one: that they answer is for `test_processes.py`."""
    for module in LOCAL:
        monkeypatch.setattr(f"{module}.LocalProcesses", InThisProcess)
