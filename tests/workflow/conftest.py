"""What tests of commands share."""

import pytest
from support.real_cluster import RealCluster


@pytest.fixture(scope="session")
def cluster(tmp_path_factory):
    """A scheduler of dask and two workers, which tests may kill but not end."""
    with RealCluster(tmp_path_factory.mktemp("workers")) as made:
        made.add_node()
        made.add_node()
        yield made
