"""Cases of ground that creeps: a round tunnel, and a bar, as files; readings at moments."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.model import StagedModel
from geoident.model.mesh import ElementBlock
from support.in_stages import write_msh
from support.meshes import box, from_grid, regroup

DAY = 86400.0

TUNNEL = """\
format: geoident-case/1
title: Round tunnel in ground that creeps
analysis: axisymmetric
mesh: {file: tunnel.msh}
parameters: {}
materials:
  rock: {K: 3 GPa, G: 1 GPa, creep: CREEP}
  ring: {E: 20 GPa, nu: 0.2}
groups: {core: rock, shell: rock, rock: rock}
supports: {y0: y, y1: y}
in_situ: {model: constant, xx: -5 MPa, yy: -5 MPa, zz: -5 MPa, held: true}
stages:
  - {name: dig, excavate: [core, shell], lasts: 10 d}
  - {name: line, install: {shell: ring}, lasts: 3640 d}
gauges:
  wall: {kind: displacement, point: [5 m, 0 m], direction: [-1, 0], accuracy: 0.1 mm}
  ring: {kind: stress, point: [4.99 m, 0.1 m], components: [xx], accuracy: 1 kPa}
"""
RADIUS, SHELL, REACH = 5.0, 0.25, 400.0


def write_tunnel(folder: Path, text: str, *, cells: int = 24) -> Path:
    """A disc of ground of unit thickness about the axis of a tunnel, of quads in one row.

    Args:
        folder: for the files.
        text: of the case.
        cells: between the wall and the edge.
    """
    radii = [0.0, 2.5, RADIUS - SHELL, RADIUS, *np.geomspace(RADIUS, REACH, cells + 1)[1:]]
    points = np.stack(np.meshgrid(radii, [0.0, 0.2], indexing="ij"), -1).reshape(-1, 2)
    mesh = from_grid("quad8", points, (len(radii) - 1, 1))
    groups = regroup(
        mesh, core=lambda x: x[:, 0] < RADIUS - SHELL, shell=lambda x: x[:, 0] < RADIUS
    )
    ends = [(RADIUS, y) for y in (0.0, 0.2, 0.1)]
    on_wall = [int(np.linalg.norm(mesh.points - end, axis=1).argmin()) for end in ends]
    wall = ElementBlock("line3", np.array([on_wall]), np.ones(1, dtype=np.int64))
    n = sum(len(block) for block in groups.facets)
    groups = replace(
        groups,
        facets=(*groups.facets, wall),
        facet_groups={**groups.facet_groups, "wall": np.array([n])},
    )
    write_msh(groups, folder / "tunnel.msh", ["y0", "y1", "wall"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


BAR = """\
format: geoident-case/1
title: A bar
analysis: plane-strain
mesh: {file: bar.msh}
parameters: {}
materials:
  bar: {E: 10 GPa, nu: 0.2, creep: CREEP}
groups: {all: bar}
supports: {x0: x, y0: y}
stages:
  - {name: load, loads: {pull: {on: x1, traction: [1 MPa, 0 MPa]}}, lasts: 100 d}
gauges:
  end: {kind: displacement, point: [1 m, 0 m], direction: [1, 0], accuracy: 1 um}
  side: {kind: displacement, point: [0 m, 1 m], direction: [0, 1], accuracy: 1 um}
  s: {kind: stress, point: [0.5 m, 0.5 m], components: [xx], accuracy: 1 kPa}
"""


def write_bar(folder: Path, text: str) -> Path:
    """A square of one element, a metre wide, which stands for a bar or a wall."""
    write_msh(box("quad4", (1, 1)), folder / "bar.msh", ["x0", "x1", "y0", "y1"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def computed(model: StagedModel, *, finer: int = 1) -> np.ndarray:
    """What all channels see (n_channels, n_states), the virgin state first, at the start."""
    p = np.array([parameter.start for parameter in model.case.parameters])
    run = model.at(p, RunOptions(derivatives=False, finer=finer))
    return np.array([model.see(end, run)[:, 0] for end in run.states()]).T
