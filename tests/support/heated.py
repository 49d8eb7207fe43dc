"""Cases of ground that conducts heat in stages, as files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from geoident.model.mesh import ElementBlock, Mesh
from support.in_stages import write_msh
from support.meshes import box, from_grid, regroup

DAY = 86400.0

BLOCK = """\
format: geoident-case/1
title: A block of concrete
analysis: plane-strain
mesh: {file: block.msh}
parameters: PARAMETERS
materials:
  concrete: {E: 30 GPa, nu: 0.2, expansion: 1e-5 1/K, conductivity: 2e4 W/mK,
    heat_capacity: 2.4 MJ/m3K, hydration: {rise: 40 K, time: 1.5 d}}
groups: {all: absent}
supports: {x0: x, x1: x, y0: y, y1: y}
initial_temperature: 10 degC
stages:
  - {name: cast, install: {all: concrete}, placed_at: {all: 18 degC}, lasts: 10 d}
gauges:
  T: {kind: thermometer, point: [0.2 m, 0.2 m], accuracy: 0.1 degC}
  s: {kind: stress, point: [0.2 m, 0.2 m], components: [xx], accuracy: 1 kPa}
"""
"""Held on all sides; conductivity is so large that it has one temperature."""


def write_block(folder: Path, text: str, kind: str = "quad8") -> Path:
    """A square of 0.4 m.

    Args:
        folder: for the files.
        text: of the case.
        kind: of its elements.
    """
    mesh = box(kind, (2, 2), size=(0.4, 0.4))
    write_msh(mesh, folder / "block.msh", ["x0", "x1", "y0", "y1"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


SLAB = """\
format: geoident-case/1
title: A slab that is cooled on one side
analysis: plane-strain
mesh: {file: slab.msh}
parameters: {}
materials:
  rock: {E: 10 GPa, nu: 0.2, expansion: 1e-5 1/K, conductivity: 2.4 W/mK, heat_capacity: 2.4 MJ/m3K}
groups: {all: rock}
supports: {x1: x, y0: y, y1: y}
initial_temperature: 10 degC
stages:
  - {name: cool, heat: {x0: {temperature: -20 degC}}, lasts: 20 d}
gauges:
  T1: {kind: thermometer, point: [0.5 m, 0.5 m], accuracy: 0.1 degC}
  T2: {kind: thermometer, point: [1.5 m, 0.5 m], accuracy: 0.1 degC}
  u: {kind: displacement, point: [0 m, 0.5 m], component: x, accuracy: 0.1 mm}
  s: {kind: stress, point: [0.5 m, 0.5 m], components: [yy], accuracy: 1 kPa}
"""
THICKNESS = 8.0


def write_slab(folder: Path, text: str, cells: int = 32) -> Path:
    """A slab 8 m thick along x, and 1 m wide, in one row of quad8 that are thin at x = 0."""
    x = THICKNESS * np.linspace(0.0, 1.0, cells + 1) ** 1.7
    points = np.stack(np.meshgrid(x, [0.0, 1.0], indexing="ij"), -1).reshape(-1, 2)
    write_msh(from_grid("quad8", points, (cells, 1)), folder / "slab.msh", ["x0", "x1", "y0", "y1"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


LIFTS = """\
format: geoident-case/1
title: Two lifts on rock
analysis: plane-strain
mesh: {file: lifts.msh}
parameters: PARAMETERS
materials:
  rock: {E: 20 GPa, nu: 0.25, expansion: 0.8e-5 1/K, conductivity: $k_rock,
    heat_capacity: 2.2 MJ/m3K}
  concrete: {E: $E, nu: 0.2, density: 2400 kg/m3, expansion: $alpha, conductivity: $k,
    specific_heat: $c, hydration: {rise: $rise, time: $time}MORE}
groups: {rock: rock, lift1: absent, lift2: absent}
supports: {x0: x, x1: x, y0: [x, y]}
initial_temperature: $T0
heat: {y0: {temperature: 9 degC}}
stages:
  - {name: lift 1, install: {lift1: concrete}, placed_at: {lift1: $placed}, lasts: 4 d,
     heat: {top1: {temperature: {0 d: 12 degC, 2 d: $air, 3 d: 8 degC}, film: $film}}}
  - {name: lift 2, install: {lift2: concrete}, lasts: 12 d,
     heat: {y1: {temperature: $air, film: $film}}}
gauges:
  T1: {kind: thermometer, point: [1 m, 2.7 m], accuracy: 0.1 degC}
  T2: {kind: thermometer, point: [1 m, 3.6 m], accuracy: 0.1 degC}
  s: {kind: stress, point: [1 m, 2.6 m], components: [xx, zz], accuracy: 1 kPa}
  u: {kind: displacement, point: [1 m, 3 m], component: y, accuracy: 0.1 mm, zero: lift 1}
"""
PARAMETERS = {
    "k": "2.3 W/mK",
    "k_rock": "2.9 W/mK",
    "c": "950 J/kgK",
    "alpha": "1.1e-5 1/K",
    "E": "28 GPa",
    "rise": "36 K",
    "time": "1.1 d",
    "T0": "10 degC",
    "placed": "17 degC",
    "air": "14 degC",
    "film": "9 W/m2K",
}


def parameters_of(names: dict[str, str]) -> str:
    """YAML of parameters, with bounds at a half and twice their start."""
    lines = []
    for name, start in names.items():
        number, unit = start.split()
        low, high = 0.5 * float(number), 2.0 * float(number)
        lines.append(f"{name}: {{start: {start}, bounds: [{low:g}, {high:g} {unit}]}}")
    return "{" + ", ".join(lines) + "}"


def write_lifts(folder: Path, text: str, *, cells: int = 1, kind: str = "quad8") -> Path:
    """Rock of 2 m, and two lifts of 1 m on it, 2 m wide.

    Args:
        folder: for the files.
        text: of the case.
        cells: in a metre.
        kind: of the elements, quad8 or tri6.
    """
    mesh = box(kind, (2 * cells, 4 * cells), size=(2.0, 4.0))
    mesh = regroup(mesh, lift2=lambda x: x[:, 1] > 3.0, lift1=lambda x: x[:, 1] > 2.0)
    mesh = _with_line(mesh, "top1", 3.0)
    write_msh(mesh, folder / "lifts.msh", ["x0", "x1", "y0", "y1", "top1"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


def _with_line(mesh: Mesh, name: str, y: float) -> Mesh:
    """The same with a group of the edges of its elements on a line across it."""
    (block,) = mesh.blocks
    n = 4 if block.kind == "quad8" else 3  # corners, then the middles of the edges
    sides = [block.nodes[:, [k, (k + 1) % n, n + k]] for k in range(n)]
    edges = np.vstack(sides)
    edges = edges[np.all(np.isclose(mesh.points[edges][..., 1], y), axis=1)]
    edges = edges[np.unique(edges[:, 2], return_index=True)[1]]
    line = ElementBlock("line3", edges, np.arange(1, len(edges) + 1))
    first = sum(len(one) for one in mesh.facets)
    groups = {**mesh.facet_groups, name: first + np.arange(len(edges))}
    return replace(mesh, facets=(*mesh.facets, line), facet_groups=groups)
