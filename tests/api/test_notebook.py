"""The notebook runs cell by cell, shows what it ends with, and needs the public names alone."""

import ast
import contextlib
import importlib.util
import io
import json
import re
from pathlib import Path

import pytest
from support.pictures import draw_names_only
from support.scripts import faults

import geoident

CASES = Path(__file__).parents[2] / "cases"
SCRIPT = (CASES / "notebook.py").read_text(encoding="utf-8")


def maker():
    spec = importlib.util.spec_from_file_location("make_notebook", CASES / "make_notebook.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def run():
    """What every cell printed, and what it showed at its end, as Jupyter does.

    The figures of the report at the end are their names alone; those of the cells are drawn.
    """
    names, shown = {"__name__": "notebook"}, []
    out = io.StringIO()
    with contextlib.redirect_stdout(out), pytest.MonkeyPatch.context() as patch:
        draw_names_only(patch)
        for kind, text in maker().cells(SCRIPT):
            if kind == "code":
                shown.append(value_of(text, names))
    return out.getvalue(), [value for value in shown if value is not None]


def value_of(text, names):
    """Run a cell; the value of its last line if that is an expression."""
    body = ast.parse(text).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "<cell>", "exec"), names)
    return None if last is None else eval(ast.unparse(last), names)


@pytest.mark.slow
def test_it_prints_what_it_says(run):
    told, _ = run
    assert re.search(r"E_rock is \d+\.\d+ GPa \(95 %: ", told)
    assert "EX-P.w1 after bench 1" in told
    assert "from 60 GPa the modulus changes by" in told
    assert "farthest off: " in told


@pytest.mark.slow
def test_what_a_cell_ends_with_is_shown(run):
    _, shown = run
    kinds = [type(value).__name__ for value in shown]
    assert kinds == [
        "CaseFile", "Drawing", "FitResult", "DataFrame", "Drawing", "ResultTable",
        "ModelChoice", "Drawing", "DataFrame",
    ]  # fmt: skip
    for value in shown:
        assert len(value._repr_html_()) > 100


def test_it_needs_the_public_names_alone():
    """And gives their functions no argument that they do not take; the slow ones run it."""
    assert faults(SCRIPT) == []
    imported = []
    for node in ast.walk(ast.parse(SCRIPT)):
        if isinstance(node, ast.ImportFrom | ast.Import):
            module = getattr(node, "module", None)
            names = [alias.name for alias in node.names]
            assert not any(name.startswith("geoident") for name in names if module is None)
            assert module is None or not module.startswith("geoident.")
            imported += names if module == "geoident" else []
    assert imported
    assert set(imported) <= set(geoident._API)


def test_the_one_for_jupyter_is_the_same():
    """Else run `python cases/make_notebook.py`."""
    made = maker().notebook(SCRIPT)
    assert (CASES / "notebook.ipynb").read_text(encoding="utf-8") == made
    cells = json.loads(made)["cells"]
    assert cells[0]["source"][0] == "# Rock around a cavern from its extensometers\n"
    assert {cell["cell_type"] for cell in cells} == {"markdown", "code"}
