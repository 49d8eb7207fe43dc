"""Plugin of pytest: which lines of geoident every test reaches, and how long the test takes.

`python -m pytest -p reached` leaves `reached.coverage` (contexts are names of tests) and
`reached.json` (seconds of the tests that passed) in the folder that `MUTATION_FOLDER` names. Lines
are counted in the packages that `MUTATION_PACKAGES` lists.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import coverage
import pytest

DATA = "reached.coverage"
SECONDS = "reached.json"


class Reached:
    """Counts lines under the name of the test that runs."""

    def __init__(self, folder: Path, packages: list[str]) -> None:
        self.folder = folder
        self.seconds: dict[str, float] = {}
        self.coverage = coverage.Coverage(
            data_file=str(folder / DATA),
            source=[str(Path("geoident", package).resolve()) for package in packages],
            messages=False,
            config_file=False,
        )
        quiet = ["module-not-measured", "module-not-imported", "no-data-collected"]
        self.coverage.set_option("run:disable_warnings", quiet)
        self.coverage.start()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Name the lines after the test, its fixtures included."""
        self.coverage.switch_context(item.nodeid)
        start = time.perf_counter()
        self.seconds[item.nodeid] = 0.0
        result = yield
        if item.nodeid in self.seconds:
            self.seconds[item.nodeid] = time.perf_counter() - start
        self.coverage.switch_context("")
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Forget a test that does not pass: it cannot tell one code from the other."""
        if not report.passed:
            self.seconds.pop(report.nodeid, None)

    def pytest_sessionfinish(self) -> None:
        """Write what was counted."""
        self.coverage.stop()
        self.coverage.save()
        (self.folder / SECONDS).write_text(json.dumps(self.seconds, indent=0))


def pytest_configure(config: pytest.Config) -> None:
    """Start counting."""
    packages = os.environ["MUTATION_PACKAGES"].split(os.pathsep)
    config.pluginmanager.register(Reached(Path(os.environ["MUTATION_FOLDER"]), packages))
