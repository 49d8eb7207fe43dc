"""A trench dug in two stages: the smallest case that has everything, as files."""

from __future__ import annotations

from pathlib import Path

from tests.support.deck import write_grid

CASE = """\
format: geoident-case/1
title: Trench
analysis: plane-strain
mesh: {file: trench.inp}
parameters:
  E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}
  K0: {start: 1.0, bounds: [0.2, 4]}
materials:
  rock: {elastic: isotropic, E: $E, nu: 0.25}
groups: {rock: rock, upper: rock, lower: rock}
supports: {left: x, right: x, bottom: [x, y]}
in_situ: {model: heim, vertical: 1 MPa, K0: $K0}
stages:
  - {name: first, excavate: [upper]}
  - {name: second, excavate: [lower]}
gauges:
  CV: {kind: convergence, between: [[2 m, 3.5 m], [4 m, 3.5 m]], accuracy: 0.01 mm}
  S:  {kind: settlement, point: [1 m, 4 m], accuracy: 0.01 mm}
  X:  {kind: extensometer, head: [2 m, 3 m], anchors: {a: [1 m, 3 m]}, accuracy: 0.01 mm}
readings: readings.csv
fit: {method: gauss-newton, stages: [first], mesh_error: false}
"""

READINGS = """\
gauge,stage,value,unit
CV,first,-0.598,mm
S,first,-0.1226,mm
X.a,first,0.0627,mm
CV,second,-1.077,mm
S,second,0.0376,mm
X.a,second,0.282,mm
"""
"""Of the model at E = 5 GPa, K0 = 1.5, with noise."""


def write_case(folder: Path, name: str = "case.yaml") -> Path:
    """The case with its mesh and its readings in a folder."""
    write_mesh(folder / "trench.inp")
    (folder / "readings.csv").write_text(READINGS)
    (folder / name).write_text(CASE)
    return folder / name


def write_mesh(path: Path, *, n: tuple[int, int] = (6, 4)) -> None:
    """A grid of quads over 6 m by 4 m, as an Abaqus deck."""

    def group_of(x: float, y: float) -> str:
        return "rock" if not 2 < x < 4 or y < 2 else "upper" if y > 3 else "lower"

    write_grid(path, n, (6, 4), ("rock", "upper", "lower"), group_of)


PLANES = """E: 5 GPa, nu: 0.25, yield: {type: planes, planes: [
    {name: shear, normal: [0.7071067811865476, -0.7071067811865476, 0], distance: $k1},
    {name: push, normal: [-1, 0, 0], distance: $k2}]}"""


def write_yielding_case(folder: Path) -> Path:
    """The trench in ground that yields by two planes, whose distances k1 and k2 are sought."""
    case = write_case(folder)
    text = case.read_text()
    for old, new in (
        (
            "E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa]",
            "k1: {start: 0.7 MPa, bounds: [0.3 MPa, 2 MPa]",
        ),
        (
            "K0: {start: 1.0, bounds: [0.2, 4]",
            "k2: {start: 2 MPa, bounds: [1 MPa, 5 MPa], scale: log",
        ),
        ("E: $E, nu: 0.25", PLANES),
        ("K0: $K0", "K0: 1.5"),
        ("method: gauss-newton, ", ""),
        ("stages: [first], ", ""),
    ):
        text = text.replace(old, new)
    case.write_text(text)
    return case
