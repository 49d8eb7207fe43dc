"""How readings are found in what a program leaves, and what is said where they are not."""

import json

import h5py
import pytest

from geoident.io.external.outputs import NotFound, RunFiles
from geoident.model.external import (
    FunctionValue,
    Hdf5Value,
    JsonValue,
    LineValue,
    Output,
    PatternValue,
    TableCell,
)

TEXT = "step 1\n U= 1.5E-03 ok\nstep 2\n U=-2.5D-03 ok\n   4   0.25   7\n0001 2.5 mm\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "t.csv").write_text("stage;gauge;u\none;A;1.5\none;B;2.5\ntwo;A;3.5\n")
    (tmp_path / "t.json").write_text(json.dumps({"a/b": [{"u": 1.5}], "s": "4.5", "t": True}))
    (tmp_path / "t.txt").write_text(TEXT)
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["u/two"] = [[1.0, 2.0], [3.0, 4.0]]
        file["one"] = 7.0
    return tmp_path


def found(folder, file, how, size=1.0):
    files = RunFiles(folder, lambda path, name, *rest: {"nan": float("nan")}.get(name, 3.0))
    return files.number(Output(0, 0, file, how, size), "A", "one")


@pytest.mark.parametrize(
    ("file", "how", "value"),
    [
        ("t.csv", TableCell("u", 2), 2.5),
        ("t.csv", TableCell("u", -1), 3.5),
        ("t.csv", TableCell("u", (("stage", "one"), ("gauge", "B"))), 2.5),
        ("t.json", JsonValue("/a~1b/0/u"), 1.5),
        ("t.json", JsonValue("/s"), 4.5),
        ("t.h5", Hdf5Value("u/two", (1, 0)), 3.0),
        ("t.h5", Hdf5Value("one", ()), 7.0),
        ("t.txt", PatternValue(r"U= *([-+.\dEeDd]+)", 1), 1.5e-3),
        ("t.txt", PatternValue(r"U= *([-+.\dEeDd]+)", -1), -2.5e-3),
        ("t.txt", LineValue("step 2", 2, 2), 0.25),
        ("t.txt", LineValue(-2, 0, 3), 7.0),
        ("t.txt", LineValue(6, 0, 0, (6, 8)), 2.5),
        ("", FunctionValue("x.py", "f"), 3.0),
    ],
)
def test_numbers_are_found(folder, file, how, value):
    assert found(folder, file, how) == value


def test_they_are_taken_to_si(folder):
    assert found(folder, "t.csv", TableCell("u", 1), 1e-3) == pytest.approx(1.5e-3, rel=1e-15)


@pytest.mark.parametrize(
    ("file", "how", "said"),
    [
        ("no.csv", TableCell("u", 1), "there is no file 'no.csv'"),
        ("t.csv", TableCell("v", 1), r"no column 'v' \(its columns: stage, gauge, u\)"),
        ("t.csv", TableCell("u", 4), "has 3 rows, and row 4 is requested"),
        ("t.csv", TableCell("u", (("stage", "one"),)), "2 rows with stage = one; expected one"),
        ("t.csv", TableCell("gauge", 1), "'A' is not a number"),
        ("t.json", JsonValue("/a~1b/1/u"), "'1' is not there"),
        ("t.json", JsonValue("/a~1b/\u00b2/u"), "'\u00b2' is not there"),
        ("t.json", JsonValue("/t"), "is not a number"),
        ("t.h5", Hdf5Value("v", ()), "no dataset 'v'"),
        ("t.h5", Hdf5Value("u/two", (2, 0)), "is 2 x 2"),
        ("t.txt", PatternValue("U= (x)", 1), "is found 0 times"),
        ("t.txt", LineValue("step 3", 0, 1), "has no line with 'step 3'"),
        ("t.txt", LineValue(1, 0, 3), "has 2 words; word 3"),
        ("t.txt", LineValue(6, 1, 1), "has 6 lines"),
        ("", FunctionValue("x.py", "nan"), "the reading of 'A' at 'one' is nan"),
    ],
)
def test_what_is_not_there_is_said(folder, file, how, said):
    with pytest.raises(NotFound, match=said):
        found(folder, file, how)


def test_a_link_out_of_the_folder_is_not_followed(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other") / "o.csv"
    other.write_text("u\n1\n")
    (folder / "o.csv").symlink_to(other)
    with pytest.raises(NotFound, match="leads out of the folder"):
        found(folder, "o.csv", TableCell("u", 1))
