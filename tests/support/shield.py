"""A shield tunnel in a round piece of ground, as files: a mesh of gmsh and a case."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from geoident.fem.faces import face_table, patches
from geoident.model.mesh import ElementBlock, Mesh
from support.meshes import opening

_GMSH = {"quad8": 16, "line3": 8}


def ring(n: int, *, layers: int | None = None, reach: float = 8.0, whole: bool = False) -> Mesh:
    """An opening of radius 2 with the groups `wall` and `rim` of lines at both ends."""
    mesh = opening("quad8", 2, n=n, layers=layers or 2 * n, radius=2.0, reach=reach, whole=whole)
    table = face_table(mesh)
    lines, groups = list(mesh.facets), dict(mesh.facet_groups)
    core = np.zeros(mesh.n_elements, dtype=bool)
    core[mesh.groups["core"]] = True
    r = np.linalg.norm(mesh.points, axis=1)
    for name, inside, radius in (("wall", core, 2.0), ("rim", core | True, reach)):
        faces = [p.nodes for p in patches(mesh, table, table.free(inside))]
        found = np.vstack([f[np.all(np.abs(r[f] - radius) < 1e-9, axis=1)] for f in faces])
        first = sum(len(b) for b in lines)
        lines.append(ElementBlock("line3", found, np.arange(len(found))))
        groups[name] = first + np.arange(len(found))
    return replace(mesh, facets=tuple(lines), facet_groups=groups)


def write_mesh(path: Path, mesh: Mesh) -> None:
    """A mesh of one block as MSH 2.2, with its wall, its rim and its ground."""
    (block,) = mesh.blocks
    names = {"wall": 1, "rim": 1, "core": 2, "rock": 2}
    numbers = {name: n for n, name in enumerate(names, start=1)}
    rows = []
    lines = mesh.facets[-2:]
    for name, part in zip(("wall", "rim"), lines, strict=True):
        rows += [(part.kind, numbers[name], nodes) for nodes in part.nodes]
    for name in ("core", "rock"):
        rows += [(block.kind, numbers[name], block.nodes[k]) for k in mesh.groups[name]]
    text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    text += [f'{dim} {numbers[name]} "{name}"' for name, dim in names.items()]
    text += ["$EndPhysicalNames", "$Nodes", str(mesh.n_nodes)]
    text += [f"{n} {x:.12g} {y:.12g} 0" for n, (x, y) in enumerate(mesh.points, start=1)]
    text += ["$EndNodes", "$Elements", str(len(rows))]
    for n, (kind, group, nodes) in enumerate(rows, start=1):
        text.append(f"{n} {_GMSH[kind]} 2 {group} {group} {' '.join(str(k + 1) for k in nodes)}")
    path.write_text("\n".join([*text, "$EndElements", ""]))


CASE = """\
format: geoident-case/1
title: Shield tunnel
analysis: plane-strain
mesh: {file: mesh.msh}
parameters:
  V: {start: 0.5 %, bounds: [0 %, 5 %]}
  E: {start: 30 MPa, bounds: [5 MPa, 500 MPa], scale: log}
  u: {start: 0 mm, bounds: [-5 mm, 5 mm]}
materials:
  soil: {E: $E, nu: 0.3}
groups: {rock: soil, core: soil}
supports: {rim: fixed}
stages:
  - {name: drive, excavate: [core], supports: {wall: {contraction: $V}}}
  - {name: shift, supports: {rim: {x: $u, y: fixed}}}
  - {name: grout, supports: {wall: free}, loads: {grout: {on: wall, pressure: 200 kPa}}}
gauges:
  roof: {kind: displacement, point: [0, 3 m], direction: [0, 1], accuracy: 0.1 mm}
  side: {kind: displacement, point: [3, 0 m], direction: [1, 0], accuracy: 0.1 mm}
  far: {kind: displacement, point: [-4, 3 m], direction: [1, 0], accuracy: 0.1 mm}
readings: readings.csv
"""
