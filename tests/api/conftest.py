"""A fit that many tests of the Python interface look at."""

from contextlib import contextmanager
from pathlib import Path

import pytest

from geoident import fit, load_case, scan
from geoident.api import campaigns
from geoident.workflow.campaign.one_run import compute
from geoident.workflow.executing.executor import Answered
from tests.support.trench import write_case


@pytest.fixture(scope="session")
def fitted(tmp_path_factory):
    """A fit of the trench; nobody changes it."""
    return fit(load_case(write_case(tmp_path_factory.mktemp("trench"))))


@pytest.fixture(scope="session")
def scanned(fitted):
    """A scan, which has few figures."""
    case = load_case(Path(fitted.path).with_name("case.yaml"))
    return scan(case.with_values({"fit.scan.points": 3}))


@pytest.fixture
def case(tmp_path):
    """A case whose folder is the test's own."""
    return load_case(write_case(tmp_path))


class Here:
    """An executor in this process."""

    def __enter__(self):
        return self

    def __exit__(self, *told):
        pass

    def run(self, tasks):
        for number, task in enumerate(tasks):
            yield Answered(number, compute(task), seconds=0.1)


@pytest.fixture
def here(monkeypatch):
    """Campaigns run in this process; how many processes were asked for."""
    asked = []

    @contextmanager
    def executor(plan, cluster, jobs, tell):
        asked.append(jobs)
        yield Here(), lambda: 1

    monkeypatch.setattr(campaigns, "run_executor", executor)
    return asked
