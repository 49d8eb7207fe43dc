"""The page on Python is a program that runs and prints what stands below its blocks."""

import contextlib
import io
import re
from pathlib import Path

import pytest

import geoident

PAGE = Path(geoident.__file__).parent / "docs" / "python.md"
BLOCK = re.compile(r"^```(python|text)\n(.*?)^```$", re.M | re.S)


def steps():
    """Every block of code, and what is said to come out of it."""
    blocks = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    for (kind, text), after in zip(blocks, [*blocks[1:], ("", "")], strict=True):
        if kind == "python":
            yield text, after[1] if after[0] == "text" else ""


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What the blocks print, run one after the other in a folder of their own."""
    names, found = {"__name__": "page"}, []
    with contextlib.chdir(tmp_path_factory.mktemp("page")):
        for code, _ in steps():
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(code, str(PAGE), "exec"), names)
            found.append(out.getvalue())
    return found


def test_there_is_something_to_run():
    assert len(list(steps())) > 10
    assert sum(bool(said) for _, said in steps()) > 8


@pytest.mark.parametrize("number", range(len(list(steps()))))
def test_a_block_prints_what_the_page_says(printed, number):
    assert printed[number] == list(steps())[number][1]


def test_every_call_is_named():
    text = PAGE.read_text(encoding="utf-8")
    calls = [name for name in geoident._API if name.islower()]
    missing = [name for name in calls if f"`{name}" not in text and f"{name}(" not in text]
    assert missing == []
