"""The public names are typed: a program of a user passes `mypy --strict`, a wrong one does not."""

from pathlib import Path

import pytest

mypy_api = pytest.importorskip("mypy.api")
PROGRAM = Path(__file__).with_name("program.py")
ROOT = PROGRAM.parents[2]
WRONG = """
from geoident import fit, load_case, read_result

result = fit(load_case("case.yaml"), forced=True)
value: str = result.parameters["E"].value
result.plot.fields("bench 1")
read_result("a.h5").grid
"""
FOUND = ("forced", "Incompatible types in assignment", '"fields"', '"grid"')


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What mypy says of both programs, with the cache of the project's own run."""
    wrong = tmp_path_factory.mktemp("wrong") / "wrong.py"
    wrong.write_text(WRONG)
    config = [
        "--config-file",
        str(ROOT / "pyproject.toml"),
        "--cache-dir",
        str(ROOT / ".mypy_cache"),
    ]
    out, err, _ = mypy_api.run(["--strict", *config, str(PROGRAM), str(wrong)])
    assert err == ""
    return out


def test_a_program_passes(said):
    assert [line for line in said.splitlines() if "program.py" in line] == []


@pytest.mark.parametrize("fault", FOUND)
def test_a_wrong_one_does_not(said, fault):
    (line,) = [line for line in said.splitlines() if fault in line and "wrong.py" in line]
    assert ": error: " in line


def test_nothing_else_is_said(said):
    errors = [line for line in said.splitlines() if ": error: " in line]
    assert len(errors) == len(FOUND), said
