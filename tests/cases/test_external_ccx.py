"""The case that CalculiX computes: its fit is geoident's own, and a script stands in for it."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.calculix import PROGRAM, REMEDY
from support.external import trusted

from geoident.io.case.file import read_case
from geoident.units import read_quantity
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit

CASE = Path(__file__).parents[2] / "cases" / "external-ccx"
TRUTH = yaml.safe_load((CASE / "truth.yaml").read_text())

STAND_IN = """\
import re, sys

text = open(sys.argv[2] + ".inp").read()
rock, wall = (float(x) for x in re.findall(r"\\*ELASTIC\\n(.*), 0.25", text))
across = float(re.findall(r",P3,-(.*)", text)[0])
upwards = float(re.findall(r",P1,-(.*)", text)[0])
nodes = re.findall(r"NSET=GAUGES\\n(.*)", text)[0].split(",")
with open(sys.argv[2] + ".dat", "w") as out:
    out.write("\\n displacements (vx,vy,vz) for set GAUGES and time  0.1000000E+01\\n\\n")
    for n, node in enumerate(nodes):
        far, near = 2.0 + n / 3, 4.0 / (1 + n / 2)
        row = []
        for own, other in ((across, upwards), (across, upwards), (upwards, across)):
            row.append(-far * (own - 0.2 * other) / rock - near * (own - 0.1 * other) / wall)
        out.write(f"{node:>10}" + "".join(f" {value:13.6E}" for value in row) + "\\n")
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A copy of the case, whose runs are not left in the repository."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    shutil.copytree(CASE, tmp_path / "case", ignore=shutil.ignore_patterns("*.runs"))
    return tmp_path / "case"


def fitted(path, *overrides):
    with trusted():
        return fit(plan_fit(Request(str(path), overrides=overrides)), Control()).result


@pytest.mark.slow  # the same keys, with a script in place of CalculiX, below
@pytest.mark.skipif(PROGRAM is None, reason=REMEDY)
def test_its_fit_is_that_of_geoident(folder):
    # a model error is correlated by the places of gauges, and those of a program have none
    found = fitted(folder / "case.yaml", "fit.model_error=none")
    own = fitted(folder / "own.yaml")
    assert found.status == own.status == "converged"
    np.testing.assert_allclose(found.parameters.values, own.parameters.values, rtol=1e-4)
    np.testing.assert_allclose(found.parameters.sd, own.parameters.sd, rtol=1e-3)
    for name, low, high in zip(
        found.parameters.names, found.parameters.lower95, found.parameters.upper95, strict=True
    ):
        assert low <= read_quantity(str(TRUTH[name])).value <= high
    assert found.objective == pytest.approx(own.objective, rel=1e-3)


def test_a_script_that_reads_and_writes_as_calculix_is_identified(folder, monkeypatch):
    """What the case says of deck and listing is right where CalculiX is missing, too."""
    program = folder / "bin" / "ccx"
    program.parent.mkdir()
    program.write_text(f"#!{sys.executable} -IS\n{STAND_IN}")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    deck = (folder / "cube.template").read_text()
    for name, value in TRUTH.items():
        si = read_quantity(str(value)).value
        deck = re.sub(rf"{{{{{name}:[^}}]*}}}}", f"{si:.12e}", deck)
    (folder / "cube.inp").write_text(deck)
    subprocess.run([str(program), "-i", "cube"], cwd=folder, check=True)
    rows = [line.split() for line in (folder / "cube.dat").read_text().splitlines()[3:]]
    lines = ["gauge,stage,value,unit"]
    for row, gauge in zip(rows, read_case(str(folder / "case.yaml")).case.channels, strict=True):
        word = 1 if gauge.name.startswith("X") else 3
        lines.append(f"{gauge.name},open,{1e3 * float(row[word])!r},mm")
    (folder / "readings.csv").write_text("\n".join(lines))
    found = fitted(folder / "case.yaml")
    truth = [read_quantity(str(TRUTH[name])).value for name in found.parameters.names]
    np.testing.assert_allclose(found.parameters.values, truth, rtol=1e-4)


def test_deck_mesh_and_nodes_are_those_that_the_script_makes(folder):
    said = subprocess.run(
        [sys.executable, str(folder / "make_deck.py")], check=True, capture_output=True, text=True
    ).stdout
    for name in ("cube.template", "cube.msh"):
        assert (folder / name).read_bytes() == (CASE / name).read_bytes()
    case = read_case(str(folder / "case.yaml")).case
    found = [
        f"{channel.name}: node {output.how.line[3:].strip()}, word {output.how.word}"
        for channel, output in zip(case.channels, case.elsewhere.outputs, strict=True)
    ]
    assert found == said.splitlines()
    own = read_case(str(folder / "own.yaml")).case
    assert [c.name for c in own.channels] == [c.name for c in case.channels]
    assert [c.accuracy for c in own.channels] == [c.accuracy for c in case.channels]
