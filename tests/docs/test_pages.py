"""Pages that are run: what a page says is compared, and nothing that is not worth comparing."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from manual.pages import Page, cut, difference, page_name, pages_that_are_run, read_page
from manual.transcript import faults, given_files, run_command, run_page

RUN = pages_that_are_run()
OUTPUT = "Head\nof it\n\nGroups\na  1\nb  2\nc  3\n\nNotes\n- one\n"


@pytest.mark.parametrize("path", RUN, ids=page_name)
def test_commands_of_a_page_may_be_typed_and_its_case_is_valid(tmp_path, path):
    """What can be told of a page without its fits: `test_manual` knows its commands and flags."""
    page = read_page(path)
    assert page.commands
    shells = [c.line for c in page.commands if re.search(r'"[^"]*[$`!][^"]*"', c.line)]
    assert shells == [], "a shell would replace what stands in double quotes"
    run = run_page(begun(page), tmp_path)
    assert run.codes == (0,) * len(run.codes), run.outputs


def begun(page):
    """Its meshes, and what its fits are asked on its last files: checked, not computed."""
    meshes = [c.line for c in page.commands if c.line.startswith("gmsh ")]
    fits = [c.line.split(" -o ")[0] for c in page.commands if c.line.startswith("geoident fit ")]
    checks = [line.replace(" fit ", " check ", 1) for line in dict.fromkeys(fits)]
    assert meshes or page.like
    assert checks
    files = "".join(
        f"<!-- file: {name} -->\n```yaml\n{text}```\n\n" for name, text in page.files.items()
    )
    lines = "\n".join(f"$ {line}" for line in (*meshes, *checks))
    like = f"<!-- like: {os.path.relpath(page.like, page.path.parent)} -->\n" if page.like else ""
    return Page(page.path, f"{like}{files}```console\n{lines}\n```\n")


@pytest.mark.slow
@pytest.mark.usefixtures("plain_pictures")
@pytest.mark.parametrize("path", RUN, ids=page_name)
def test_a_page_does_what_it_says(tmp_path, path):
    page = read_page(path)
    remedy = f"run: sh tests/manual/renew {page_name(path)}"
    assert faults(page, run_page(page, tmp_path, long=False)) == [], remedy


LONG = [path for path in RUN if any(command.long for command in read_page(path).commands)]


@pytest.mark.slow
@pytest.mark.usefixtures("plain_pictures")
@pytest.mark.parametrize("path", LONG, ids=page_name)
def test_what_takes_long_is_as_a_page_says_too(tmp_path, path):
    page = read_page(path)
    assert faults(page, run_page(page, tmp_path)) == []


def test_these_are_run():
    names = {page_name(path) for path in RUN}
    assert {"tutorials/cavern", "tutorials/dam", "tutorials/tunnel"} <= names


@pytest.mark.parametrize("path", RUN, ids=page_name)
def test_files_beside_a_page_are_those_that_it_shows(path):
    page = read_page(path)
    for name, text in page.files.items():
        assert (page.folder / name).read_text(encoding="utf-8") == text
    linked = [file.name for file in given_files(page) if f"({path.stem}/{file.name})" in page.text]
    assert linked == [file.name for file in given_files(page)]


@pytest.mark.parametrize(
    ("show", "expected"),
    [
        (None, OUTPUT.strip()),
        (("nothing",), ""),
        (("first",), "Head\nof it\n..."),
        (("Groups 2",), "...\nGroups\na  1\n..."),
        (("Groups", "Notes"), "...\nGroups\na  1\nb  2\nc  3\n\nNotes\n- one"),
    ],
)
def test_an_output_is_cut_to_what_is_shown(show, expected):
    assert cut(OUTPUT, show) == expected


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("E  12.21 GPa", "E   12.30\nGPa"),
        ("residual -0.01", "residual 0.00"),
        ("in 3 s", "in 41 s"),
        ("no more than 9.1e-13.", "no more than 2.2e-11."),
        ("x: 12.2, 3", "x: 12.3, 3"),
    ],
)
def test_numbers_that_are_close_are_the_same(old, new):
    assert difference(old, new) == ""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("E  12.21 GPa", "E  12.51 GPa"),
        ("E  12.21 GPa", "E  12.21 MPa"),
        ("7 of 8 inside", "6 of 8 inside"),
        ("band -1.2", "band 1.2"),
        ("inside", "inside outside"),
        ("", "a word"),
    ],
)
def test_other_differences_are_told(old, new):
    assert difference(old, new)


PAGE = """\
<!-- file: case.yaml -->
```yaml
a: 1
```

<!-- exit: 3 -->
<!-- show: case.yaml 2 -->
```console
$ geoident check case.yaml
{output}
```
"""


def page_of(tmp_path, output):
    return Page(tmp_path / "page.md", PAGE.format(output=output))


def test_outputs_are_renewed_and_then_agree(tmp_path):
    page = page_of(tmp_path, "what it once said")
    run = run_page(page, tmp_path)
    (told,) = faults(page, run)
    assert "'what' has become" in told
    renewed = Page(page.path, page.with_outputs(run.outputs))
    assert renewed.text.startswith(PAGE.split("{output}", maxsplit=1)[0])
    assert "\n...\n" in renewed.text
    assert faults(renewed, run) == []


def test_an_exit_code_and_a_picture_are_missed(tmp_path):
    page = page_of(tmp_path, "")
    other = Page(page.path, page.text.replace("exit: 3", "exit: 0") + "\n![It](page/it.png)\n")
    told = faults(other, run_page(other, tmp_path))
    assert [line.partition(":")[0] for line in told] == [
        "geoident check case.yaml",
        "no command makes it.png",
    ]
    assert "exit code 3" in told[0]


def test_what_takes_long_is_left_out_where_it_is_not_asked_for(tmp_path):
    page = page_of(tmp_path, "what it once said")
    page = Page(
        page.path, page.text.replace("<!-- exit: 3 -->", "<!-- exit: 3 -->\n<!-- run: long -->")
    )
    run = run_page(page, tmp_path, long=False)
    assert run.outputs == ()
    assert faults(page, run) == []
    assert len(faults(page, run_page(page, tmp_path))) == 1


def test_only_these_programs_are_run(tmp_path):
    with pytest.raises(ValueError, match="may run geoident and gmsh"):
        run_command("rm -r .", Path(tmp_path))
