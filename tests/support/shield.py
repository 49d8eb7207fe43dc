"""A shield tunnel in a round piece of ground, as files: a mesh of gmsh and a case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.fem.faces import face_table, patches
from geoident.model.mesh import ElementBlock, Mesh
from support.meshes import opening


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
