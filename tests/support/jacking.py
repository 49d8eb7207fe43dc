"""A block of rock that is pushed and sheared on its faces in turn, as in a jacking test: files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh
from geoident.model.mesh import Mesh

from .meshes import box

MODULUS = "{start: 10 GPa, bounds: [1 GPa, 60 GPa], scale: log}"
SHEAR = "{start: 4 GPa, bounds: [0.4 GPa, 24 GPa], scale: log}"
LYING = "dip: 35 deg, dip_direction: 120 deg"
MATERIALS = {
    "isotropic": "{elastic: isotropic, E: $E, nu: 0.25}",
    "transversely-isotropic": "{elastic: transversely-isotropic, E_p: $E_p, nu_p: 0.25, E_n: $E_n, "
    f"nu_np: 0.25, G_np: $G_np, {LYING}}}",
    "orthotropic": "{elastic: orthotropic, E_1: $E_1, E_2: $E_2, E_3: $E_3, nu_12: 0.25, "
    f"nu_13: 0.25, nu_23: 0.25, G_12: 0.4 $E_1, G_13: $G_13, G_23: $G_23, {LYING}}}",
}
PARAMETERS = {
    "isotropic": ("E",),
    "transversely-isotropic": ("E_p", "E_n", "G_np"),
    "orthotropic": ("E_1", "E_2", "E_3", "G_13", "G_23"),
}
TRUTHS = {
    "isotropic": {"E": 10e9},
    "transversely-isotropic": {"E_p": 12e9, "E_n": 8e9, "G_np": 4e9},
    "orthotropic": {"E_1": 13e9, "E_2": 10e9, "E_3": 8e9, "G_13": 3.6e9, "G_23": 4.4e9},
}
LADDER = (
    "[isotropic, "
    + ", ".join(f"{{elastic: {name}, {LYING}}}" for name in tuple(MATERIALS)[1:])
    + "]"
)
POINTS = tuple(product((0.5, 1.5), repeat=3))


def write_case(
    folder: Path,
    *,
    rock: str = "isotropic",
    points: Sequence[tuple[float, float, float]] = POINTS,
    accuracy: str = "0.03 mm",
    fit: str = "{}",
    name: str = "case.yaml",
) -> Path:
    """The case and its mesh in a folder, without readings."""
    write_block(box("hex8", (2, 2, 2), size=(2.0, 2.0, 2.0)), folder / "block.msh")
    loads = {
        "push-z": "{on: z1, pressure: 4 MPa}",
        "push-x": "{on: x1, pressure: 4 MPa}",
        "push-y": "{on: y1, pressure: 4 MPa}",
        "shear-zx": "{on: z1, traction: [2 MPa, 0 MPa, 0 MPa]}",
        "shear-zy": "{on: z1, traction: [0 MPa, 2 MPa, 0 MPa]}",
        "shear-xy": "{on: x1, traction: [0 MPa, 2 MPa, 0 MPa]}",
    }
    kinds = {q: SHEAR if q.startswith("G") else MODULUS for q in PARAMETERS[rock]}
    lines = [
        "format: geoident-case/1", "title: Jacking test", "analysis: solid",
        "mesh: {file: block.msh}", "parameters:",
        *(f"  {key}: {text}" for key, text in kinds.items()),
        f"materials:\n  rock: {MATERIALS[rock]}",
        "groups: {all: rock}", "supports: {x0: x, y0: y, z0: z}", "stages:",
        *(f"  - {{name: {k}, independent: true, loads: {{q: {q}}}}}" for k, q in loads.items()),
        "gauges:",
        *(
            f"  p{k}{axis}: {{kind: displacement, point: [{x} m, {y} m, {z} m], "
            f"direction: {[float(i == n) for i in range(3)]}, accuracy: {accuracy}}}"
            for k, (x, y, z) in enumerate(points)
            for n, axis in enumerate("xyz")
        ),
        "readings: readings.csv", f"fit: {fit}",
    ]  # fmt: skip
    (folder / name).write_text("\n".join(lines) + "\n")
    return folder / name


def write_block(mesh: Mesh, path: Path) -> None:
    """Hexahedra and their outer faces with names, in gmsh's format 2.2."""
    hexes, (faces,) = mesh.blocks[0].nodes + 1, mesh.facets
    names = [name for name in mesh.facet_groups if name != "outer"]
    number = {name: n for n, name in enumerate(names, start=2)}
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names) + 1)]
    lines += ['3 1 "all"', *(f'2 {number[name]} "{name}"' for name in names), "$EndPhysicalNames"]
    lines += ["$Nodes", str(len(mesh.points))]
    lines += [f"{n} {x!r} {y!r} {z!r}" for n, (x, y, z) in enumerate(mesh.points.tolist(), 1)]
    elements = [f"5 2 1 1 {' '.join(map(str, nodes))}" for nodes in hexes]
    for name in names:
        nodes = faces.nodes[mesh.facet_groups[name]] + 1
        elements += [f"3 2 {number[name]} {number[name]} {' '.join(map(str, f))}" for f in nodes]
    lines += ["$EndNodes", "$Elements", str(len(elements))]
    lines += [f"{n} {text}" for n, text in enumerate(elements, start=1)]
    path.write_text("\n".join([*lines, "$EndElements"]) + "\n")


def write_readings(case: Path, truth: Mapping[str, float], seed: int) -> Path:
    """Readings of a case at a truth, with errors of their accuracy, beside it."""
    path = case.parent / "readings.csv"
    path.write_text("gauge,stage,value,unit\n")
    loaded = read_case(str(case))
    mesh = read_mesh(str(loaded.mesh_path), dim=3)
    model = staged_model(mesh, loaded.case, solver=pick_solver("auto"))
    pairs = [(c.name, s.name) for s in loaded.case.stages for c in loaded.case.channels]
    p = np.array([truth[q.name] for q in loaded.case.parameters])
    values = model.response(pairs).readings(p)
    sd = loaded.case.channels[0].accuracy
    values = values + sd * np.random.default_rng(seed).standard_normal(len(values))
    rows = [
        f"{channel},{stage},{1e3 * value:.9f},mm"
        for (channel, stage), value in zip(pairs, values.tolist(), strict=True)
    ]
    path.write_text("\n".join(["gauge,stage,value,unit", *rows]) + "\n")
    return path
