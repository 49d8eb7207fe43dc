"""The page on Python is a program that runs and prints what stands below its blocks.

`python tests/docs/test_python_page.py` writes what they print now into the page.
"""

import contextlib
import io
import re
import tempfile
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
def faults():
    from support import scripts  # noqa: PLC0415 - a program by itself lacks it

    return scripts.faults


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    from support.pictures import draw_names_only  # noqa: PLC0415 - a program by itself lacks it

    with pytest.MonkeyPatch.context() as patch:
        draw_names_only(patch)
        return run(tmp_path_factory.mktemp("page"))


def run(folder):
    """What the blocks print, run one after the other in a folder of their own."""
    names, found = {"__name__": "page"}, []
    with contextlib.chdir(folder):
        for code, _ in steps():
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(code, str(PAGE), "exec"), names)
            found.append(out.getvalue())
    return found


def test_there_is_something_to_run():
    assert len(list(steps())) > 10
    assert sum(bool(said) for _, said in steps()) > 8


def test_blocks_ask_for_nothing_that_is_not_there(faults):
    """Without running them: what they print, the slow ones compare."""
    assert [fault for code, _ in steps() for fault in faults(code)] == []


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("from geoident import fit, fitt", "geoident has no public fitt"),
        ("from geoident.model import case", "geoident.model has no public case"),
        ("x = 1\nfit(case, outptu=1)", "fit, line 2: got an unexpected keyword argument 'outptu'"),
        ("predict()", "predict, line 1: missing a required argument: 'fitted'"),
        ("fit(case, output=1)\nprint(case)", None),
    ],
)
def test_what_a_script_asks_in_vain(faults, source, said):
    assert faults(source) == ([] if said is None else [said])


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(list(steps()))))
def test_a_block_prints_what_the_page_says(printed, number):
    assert printed[number] == list(steps())[number][1]


def test_every_call_is_named():
    text = PAGE.read_text(encoding="utf-8")
    calls = [name for name in geoident._API if name.islower()]
    missing = [name for name in calls if f"`{name}" not in text and f"{name}(" not in text]
    assert missing == []


def renewed(text, printed):
    """The page with what its blocks print now, where it says what they print."""
    blocks = list(BLOCK.finditer(text))
    codes = [n for n, block in enumerate(blocks) if block[1] == "python"]
    for n, said in reversed(list(zip(codes, printed, strict=True))):
        below = blocks[n + 1] if n + 1 < len(blocks) else None
        if below is not None and below[1] == "text":
            text = text[: below.start(2)] + said + text[below.end(2) :]
    return text


def test_the_page_is_renewed_where_it_is_out_of_date():
    text = "```python\nprint(1)\n```\n\n```text\n2\n```\n\n```python\nx = 1\n```\n"
    assert renewed(text, ["1\n", ""]) == text.replace("2\n", "1\n")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8"), run(place)), encoding="utf-8")
