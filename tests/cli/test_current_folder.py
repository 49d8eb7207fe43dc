"""Nothing is imported from the current folder, nor from that of a case."""

import subprocess
import sys
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest

from tests.support.external import EXTERNAL, PROGRAM, PYTHON, SCRIPT
from tests.support.external import write_case as write_elsewhere
from tests.support.trench import write_case

NAMES = sorted(
    {
        name
        for name in chain(sys.stdlib_module_names, packages_distributions())
        if name.isidentifier()
    }
    - {"geoident"}
    | {"sitecustomize", "usercustomize"}
)
"""All that a program could import: what belongs to Python, and what is installed."""


def plant(folder, kind):
    """Put modules of all names into a folder; where they leave a mark when they are imported."""
    marks = folder.parent / "marks"
    marks.mkdir()
    for name in NAMES:
        file = folder / f"{name}.py" if kind == "files" else folder / name / "__init__.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"open({str(marks / name)!r}, 'w').close()\n")
    return marks


@pytest.fixture(params=["packages", pytest.param("files", marks=pytest.mark.slow)])
def hostile(request, tmp_path, monkeypatch):
    """A folder with two cases and such modules, which is the current one; runs commands there."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("PYTHONPATH", raising=False)
    script = tmp_path / "bin" / "geoident"  # as pip writes it
    script.parent.mkdir()
    script.write_text(
        "import sys\nfrom geoident.cli import main\nif __name__ == '__main__':\n    main()\n"
    )
    folder = tmp_path / "here"
    folder.mkdir()
    for name in ("case.yaml", "other.yaml"):
        write_case(folder, name)
    monkeypatch.chdir(folder)
    marks = plant(folder, request.param)

    def ran(*words, python=(str(script),), exit_code=0):
        command = [sys.executable, *python, *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (sorted(p.name for p in marks.iterdir()), done.returncode) == ([], exit_code), (
            done.stderr
        )
        return done

    return ran


def test_processes_import_nothing_from_the_current_folder(hostile):
    given = ("fit.backtest=false", "fit.model_error=none")
    hostile("fit", "case.yaml", "other.yaml", "-q", "-j", "1", *(f"--set={one}" for one in given))


def test_python_m_imports_no_more_from_there_than_python_itself_does(hostile):
    """What finds the module is looked for in the current folder before anything of ours runs."""
    said = hostile(
        "print(*sys.modules)", python=("-P", "-c", "import runpy, sys; exec(sys.argv[1])")
    )
    for name in {module.partition(".")[0] for module in said.stdout.split()}:
        for planted in (Path(name), Path(f"{name}.py")):
            if planted.exists():
                planted.rename(f"{name}.spared")
    hostile("check", "case.yaml", "-q", python=("-m", "geoident"))


CAMPAIGN = """\
format: geoident-campaign/1
case: case.yaml
command: simulate
variations: {product: {parameters.E.start: [3 GPa, 4 GPa]}}
"""


@pytest.mark.parametrize(
    "cluster",
    [
        pytest.param((), id="here", marks=pytest.mark.slow),  # it is seen above
        pytest.param(("--cluster", "local"), id="dask", marks=pytest.mark.slow),
    ],
)
def test_neither_do_those_of_a_campaign_or_of_a_cluster(hostile, cluster):
    Path("campaign.yaml").write_text(CAMPAIGN)
    hostile("batch", "campaign.yaml", "-j", "1", *cluster)
    if not cluster:
        hostile("report", "campaign.batch")


@pytest.mark.slow
def test_neither_does_a_report_that_is_drawn_in_processes(hostile):
    Path("matplotlibrc").write_text("backend: module://antigravity\ntext.usetex: True\n")
    hostile("fit", "case.yaml", "-q")
    hostile("report", "case.fit.h5")
    hostile("predict", "case.fit.h5", "-q")


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [(), ("--cluster", "local")], ids=["here", "dask"])
@pytest.mark.parametrize("model", [EXTERNAL, PYTHON], ids=["program", "function"])
def test_neither_does_a_model_elsewhere(hostile, model, cluster):
    """But for what the function imports from beside it: that is the user's, and trusted with it."""
    write_elsewhere(Path(), model, script=SCRIPT if model == PYTHON else PROGRAM)
    for beside in (Path("math"), Path("math.py")):
        if beside.exists():
            beside.rename("not_the_point")
    hostile("fit", "case.yaml", "--trust", "-q", "-j", "2", *cluster)
