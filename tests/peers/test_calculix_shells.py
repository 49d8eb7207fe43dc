"""Shells against those of CalculiX, an independent program, on the same mesh.

CalculiX makes solids of second order of its shells of eight nodes (S8R), which overlap where three
of them meet in a corner and strain in shear.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import calculix
from support.cases import material, model
from support.meshes import box

from geoident.forward.model import StagedModel
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import nodes_in, rows_in
from geoident.model.parameter import Scalar
from geoident.model.structures import Shell

SIDE, THICKNESS = 4.0, 0.2
SOIL, CONCRETE = (50e6, 0.3), (30e9, 0.2)
ALONG = {"x0": (0.0, 1.0, 0.0), "y0": (1.0, 0.0, 0.0), "z0": (1.0, 0.0, 0.0)}
MIRRORED = {"x0": ("y1",), "y0": ("x1",), "z0": ("x1", "y1")}
IN_CALCULIX = {"x0": (1, 0, 3), "y0": (0, 1, 3), "z0": (0, 1, 3)}
"""Which of xx, yy, zz, xy, xz, yz, in axes of the shell, are 11, 22, 12 of ours (12 up to sign)."""


def corner(n: int) -> StagedModel:
    """A quarter of a bin: two walls and a floor around soil that is pressed from above.

    The floor rests on its rim below the walls.
    """
    mesh = box("hex20", (n, n, n), size=(SIDE,) * 3)
    x, y, z = mesh.points.T
    rim = np.flatnonzero((z == 0.0) & ((x == 0.0) | (y == 0.0)))
    E, nu = map(Scalar, CONCRETE)
    shells = {
        face: Shell(face, E, Scalar(THICKNESS), nu, along, mirrored_on=MIRRORED[face])
        for face, along in ALONG.items()
    }
    press = Traction("z1", (Scalar(0.0), Scalar(0.0), Scalar(-50e3)))
    return model(
        replace(mesh, node_groups={**mesh.node_groups, "rim": rim}),
        materials={"soil": material("soil", *SOIL)},
        groups={"all": "soil"},
        supports=(Support("x1", (0,)), Support("y1", (1,)), Support("rim", (2,))),
        structures=shells,
        stages=(Stage("press", build=tuple(shells), loads={"fill": press}),),
    )


def write(staged: StagedModel, path: Path) -> None:
    """The same for CalculiX, with the forces that geoident has at the nodes."""
    mesh = staged.mesh
    (solids,) = mesh.blocks
    faces = [
        nodes
        for shell in ALONG
        for block, rows in rows_in(mesh.facets, mesh.facet_groups[shell])
        for nodes in block.nodes[rows]
    ]
    points = mesh.points[: mesh.n_places]
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k + 1}," + ",".join(f"{v:.12e}" for v in x) for k, x in enumerate(points)]
    for kind, elset, elements, first in (
        ("C3D20", "SOIL", solids.nodes, 1),
        ("S8R", "SHELL", faces, len(solids) + 1),
    ):
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET={elset}")
        for number, nodes in enumerate(elements, first):
            words = [str(number), *(str(k + 1) for k in nodes)]
            lines += [",".join(words[:12]) + "," * (len(words) > 12), ",".join(words[12:])]
    for name, (E, nu) in (("SOIL", SOIL), ("SHELL", CONCRETE)):
        lines += [f"*MATERIAL, NAME={name}", "*ELASTIC", f"{E},{nu}"]
    lines += ["*SOLID SECTION, ELSET=SOIL, MATERIAL=SOIL"]
    lines += ["*SHELL SECTION, ELSET=SHELL, MATERIAL=SHELL", f"{THICKNESS}", "*BOUNDARY"]
    of_shells = np.unique(faces)
    for axis, group in enumerate(("x1", "y1")):
        held = nodes_in(mesh.facets, mesh.facet_groups[group])
        lines += [f"{k + 1},{axis + 1},{axis + 1}" for k in held]
        turns = [4 + other for other in range(3) if other != axis]
        lines += [f"{k + 1},{t},{t}" for k in np.intersect1d(held, of_shells) for t in turns]
    lines += [f"{k + 1},3,3" for k in mesh.node_groups["rim"]]
    forces = staged.actions.forces(1, ParameterPoint({}, ()))[:, 0]
    lines += ["*STEP", "*STATIC", "*CLOAD"]
    lines += [f"{d // 3 + 1},{d % 3 + 1},{forces[d]:.12e}" for d in np.flatnonzero(forces)]
    lines += ["*NODE PRINT, NSET=ALL", "U", "*EL PRINT, ELSET=SHELL", "S", "*END STEP"]
    path.write_text("\n".join([line for line in lines if line] + [""]))


def forces(printed: Path) -> np.ndarray:
    """Means of n and m over the faces (n_faces, 2, 6), from the stresses at two by two by two."""
    words = (line.split() for line in printed.read_text().splitlines())
    rows = [[float(x) for x in row[:8]] for row in words if len(row) == 9 and row[0].isdigit()]
    inner, outer = np.array(rows)[:, 2:].reshape(-1, 2, 4, 6).mean(axis=2).swapaxes(0, 1)
    bent = (outer - inner) / 2 * np.sqrt(3.0) * THICKNESS**2 / 6
    return np.stack([(inner + outer) / 2 * THICKNESS, bent], axis=1)


# Shear and the overlap in the corner are of the order of the thickness by the side, 5 %.
@pytest.mark.slow  # 3 s; closed forms of plates and rings are quick
@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
def test_a_corner_of_walls_and_a_floor_equals_calculix(tmp_path, verification):
    staged = corner(6)
    write(staged, tmp_path / "corner.inp")
    moved = calculix.solve(tmp_path / "corner.inp", threads=1)
    theirs = forces(tmp_path / "corner.dat")
    survey = staged.survey(np.empty(0), fields=True)
    u = survey.fields.displacement[-1]
    node = moved[:, 0].astype(int) - 1
    assert np.abs(u[node] - moved[:, 1:]).max() < 0.003 * np.abs(u).max()
    ours = np.stack([survey.shells.normal[..., 0], survey.shells.moment[..., 0]], axis=1)
    largest = np.abs(ours).max(axis=(0, 2))
    for face, parts in IN_CALCULIX.items():
        own = np.array(survey.shells.structures) == face
        found, exact = ours[own], theirs[own][:, :, parts]
        signs = np.sign((found * exact).sum(axis=0))  # of the normal, and of axis 2
        assert abs(signs[:, :2].sum(axis=1)).tolist() == [2.0, 2.0]
        off = np.abs(found - signs * exact).max(axis=(0, 2)) / largest
        assert (off < (0.01, 0.04)).all()
    x, y, z = survey.shells.centres.T
    row = np.flatnonzero((z < 1e-9) & (y > SIDE - SIDE / 6))  # of the floor, the last of them
    verification("calculix-shells", "", x[row], exact=theirs[row, 1, 0] * signs[1, 0],
                 found=ours[row, 1, 0])  # fmt: skip
