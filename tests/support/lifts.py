"""A pit dug in lifts, read after each of them: a small case with many stages, as files."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geoident.workflow.running.jobs import build_model, load_inputs
from tests.support.deck import write_grid

LIFTS = ("lift 1", "lift 2", "lift 3", "lift 4")

CASE = """\
format: geoident-case/1
title: Pit
analysis: plane-strain
mesh: {file: pit.inp}
parameters:
  E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}
  K0: {start: 1.0, bounds: [0.2, 4]}
materials:
  rock:  {elastic: isotropic, E: $E, nu: 0.25}
groups: {left: rock, right: rock, lift-1: rock, lift-2: rock, lift-3: rock, lift-4: rock}
supports: {west: x, east: x, bottom: [x, y]}
in_situ: {model: heim, vertical: 1 MPa, K0: $K0}
stages:
  - {name: lift 1, excavate: [lift-1]}
  - {name: lift 2, excavate: [lift-2]}
  - {name: lift 3, excavate: [lift-3]}
  - {name: lift 4, excavate: [lift-4]}
gauges:
  CV: {kind: convergence, between: [[4 m, 8 m], [8 m, 8 m]], accuracy: 0.02 mm}
  SL: {kind: settlement, point: [3 m, 8 m], accuracy: 0.02 mm}
  SR: {kind: settlement, point: [9 m, 8 m], accuracy: 0.02 mm}
  XL: {kind: extensometer, head: [4 m, 7 m], anchors: {a: [2 m, 7 m]}, accuracy: 0.02 mm, zero: lift 1}
  XR: {kind: extensometer, head: [8 m, 7 m], anchors: {a: [10 m, 7 m]}, accuracy: 0.02 mm, zero: lift 1}
readings: readings.csv
fit: {method: gauss-newton, model_error: none, mesh_error: false}
"""  # noqa: E501 - a case has lines of any length

SAME = ("parameters.E.start=5 GPa", "parameters.K0.start=1.5")
"""A truth that is of the model."""

TWO_ROCKS = (*SAME, "materials.hard={elastic: isotropic, E: 15 GPa, nu: 0.25}", "groups.right=hard")
"""A truth that the model has no parameters for: one side of the pit is three times as stiff."""

Row = tuple[str, str, float]
"""Channel, stage and value in mm."""

_KNOWN: dict[tuple[object, ...], list[Row]] = {}
"""Readings by all that they follow from: many tests ask for the same."""


def write_case(folder: Path, text: str = CASE) -> Path:
    """The case with its mesh in a folder, without readings."""
    write_mesh(folder / "pit.inp")
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def readings_of(path: Path, truth: Sequence[str], *, seed: int, noise: float = 0.02) -> list[Row]:
    """Readings of another truth than that of the case, with normal errors.

    Args:
        path: of the case.
        truth: overrides that make it the truth.
        seed: of the errors.
        noise: standard deviation of the errors, mm.
    """
    said = path.read_text(), path.with_name("pit.inp").read_text(), *truth, seed, noise
    if said not in _KNOWN:
        _KNOWN[said] = _computed(path, truth, seed, noise)
    return list(_KNOWN[said])


def _computed(path: Path, truth: Sequence[str], seed: int, noise: float) -> list[Row]:
    inputs = load_inputs(str(path), overrides=("readings=[]", *truth))
    model, case = build_model(inputs), inputs.case
    p = np.array([parameter.start for parameter in case.parameters])
    computed = model.survey(p, fields=False).computed
    errors = noise * np.random.default_rng(seed).standard_normal(computed.shape)
    names, stages = [c.name for c in case.channels], [s.name for s in case.stages]
    return [
        (names[i], stages[j], 1e3 * float(computed[i, j]) + float(errors[i, j]))
        for j in range(len(stages))
        for i in range(len(names))
        if np.isfinite(computed[i, j]) and case.channels[i].zero != stages[j]
    ]


def write_readings(folder: Path, rows: Sequence[Row]) -> None:
    """A table of readings in mm."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["gauge", "stage", "value", "unit"])
    writer.writerows((gauge, stage, f"{value:.6f}", "mm") for gauge, stage, value in rows)
    (folder / "readings.csv").write_text(text.getvalue())


def write_mesh(path: Path, *, n: tuple[int, int] = (12, 8)) -> None:
    """A grid of quads over 12 m by 8 m, a pit from 4 to 8 m in four lifts of a metre."""
    groups = ("left", "right", *(f"lift-{k}" for k in range(1, 5)))

    def group_of(x: float, y: float) -> str:
        if 4 < x < 8 and y > 4:
            return f"lift-{int(8 - y) + 1}"
        return "left" if x < 6 else "right"

    write_grid(path, n, (12, 8), groups, group_of, sides=("west", "east", "bottom"))
