"""The page of the result file names what is in one, with its axes, and nothing that is not."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import pytest
from manual.pages import DOCS

import geoident
from geoident.io.result.file import write_result
from geoident.model.results.columns import slots
from geoident.model.results.many.project import ProjectResult
from geoident.model.results.result import Result
from tests.io.result.conftest import make_result
from tests.support.commands import run_command
from tests.support.results import example_result
from tests.support.trench import write_case

TEXT = (DOCS / "result_file.md").read_text(encoding="utf-8")
SOURCES = [*(Path(geoident.__file__).parent / "io" / "result").glob("*.py")]
NOT_LISTED = ("VTKHDF", "mesh")


def documented():
    """Group and dataset to the axes that the page names."""
    found = {}
    for part in TEXT.split("\n## /")[1:]:
        groups = re.findall(r"\w+", part.splitlines()[0].replace(" and ", " ").replace("/", " "))
        for row in re.findall(r"^\| (`[^|]*`) \|([^|]*)\|", part, re.M):
            for name in re.findall(r"`(\w+)`", row[0]):
                found |= {(group, name): row[1].strip() for group in groups}
    return found


def written(path):
    """Group and dataset to its axes; axes themselves, and fields by number, left out."""
    found = {}

    def visit(name, node):
        group = name.partition("/")[0]
        if isinstance(node, h5py.Dataset) and not node.is_scale and group not in NOT_LISTED:
            axes = [axis.keys()[0] for axis in node.dims if len(axis)]
            found[group, name.rpartition("/")[2]] = ", ".join(axes)

    with h5py.File(path) as file:
        file.visititems(visit)
        attributes = set(file.attrs)
    return found, attributes


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    write_result(example_result(2, yielded=True), folder / "example.fit.h5", overwrite=False)
    write_result(make_result(), folder / "full.fit.h5", overwrite=False)
    write_case(folder)
    case = str(folder / "case.yaml")
    for command in ("fit", "scan", "backtest"):
        assert run_command(command, case, "--set", "fit.scan.points=3").exit_code in (0, 4)
    assert run_command("predict", folder / "case.fit.h5").exit_code == 0
    return sorted(folder.glob("*.h5"))


def test_every_dataset_is_on_the_page_with_its_axes(files):
    page = documented()
    assert len(files) >= 4
    for file in files:
        for key, axes in written(file)[0].items():
            if key[0] == "grid":
                assert key[1] == "objective"
            else:
                assert page.get(key) == axes, (file.name, key, axes)


def test_every_attribute_is_on_the_page(files):
    part = TEXT.split("## Attributes of the file\n", 1)[1].split("\n## ", 1)[0]
    named = set(re.findall(r"`(\w+)`", part))
    for file in files:
        assert written(file)[1] <= named


def test_nothing_is_on_the_page_that_is_not_written():
    code = "".join(path.read_text(encoding="utf-8") for path in SOURCES)
    names = {name.removeprefix("parameter_") for _, name in documented()}
    declared = [*slots(Result), *slots(ProjectResult)]
    names -= {name for slot in declared for name in (slot.name, slot.group)}
    stale = [name for name in names if not re.search(rf"\b{name}\b", code)]
    assert stale == []
