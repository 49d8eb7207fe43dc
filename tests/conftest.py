"""What all tests share."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Generator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import settings
from manual.records import Recorder
from support.pictures import draw_names_only

# What has passed passes again; long runs of tests/fuzz look for what is new.
settings.register_profile("tests", derandomize=not os.environ.get("GEOIDENT_FUZZ_EXAMPLES"))
settings.load_profile("tests")

LONGEST = (
    "tests/workflow/executing/test_cluster.py",
    "tests/workflow/test_on_cluster.py",
    "tests/workflow/campaign/",
    "tests/workflow/executing/test_processes.py",
    "tests/cases/",
    "tests/identification/",
)
"""Files and folders with tests of ten seconds and more: they are begun first.

Processes take tests from each other, those at the end first, until few are left: who has begun a
long one last keeps the others waiting. Tests on the one cluster stand together, so that mostly one
process makes it.
"""


LAST = "tests/api/test_types.py"
"""What waits for the types that are checked beside the tests (tests/run): it takes their cache."""


@pytest.hookimpl(wrapper=True)
def pytest_collect_file() -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Looks for examples in the docstrings of the package only; tests have none."""
    found = yield
    return [one for one in found if not isinstance(one, DoctestModule)]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest; the order stays otherwise."""

    def place(item: pytest.Item) -> int:
        if item.nodeid.startswith(LAST):
            return len(LONGEST) + 1
        found = (n for n, name in enumerate(LONGEST) if item.nodeid.startswith(name))
        return next(found, len(LONGEST))

    items.sort(key=place)


@pytest.fixture(scope="session", autouse=True)
def disk_that_is_not_waited_for() -> Generator[None]:
    """No test pulls the plug: what is to reach the disk at once is handed to the system only.

    Waiting took a tenth of a small command. Processes that tests start wait as users do; that the
    program asks for it, and what it does where it fails, `tests/io/text/test_atomic.py` sees.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", os.fstat)  # an error still where there is no such file
        yield


_FOLDERS = itertools.count()


@pytest.fixture
def tmp_path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of the test's own, where pytest makes its own.

    That looks at the folders of all tests before it to find the next number: milliseconds a test
    when there are thousands.
    """
    name = re.sub(r"\W", "_", request.node.name)[:30]
    folder = tmp_path_factory.getbasetemp() / f"{name}-{next(_FOLDERS)}"
    folder.mkdir(mode=0o700)
    return folder


@pytest.fixture
def verification(request: pytest.FixtureRequest) -> Recorder:
    """Takes the numbers of a comparison for the verification manual."""
    return Recorder(request.node.nodeid)


@pytest.fixture
def plain_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every figure of a report is its name alone: for what is not asked of figures."""
    draw_names_only(monkeypatch)
