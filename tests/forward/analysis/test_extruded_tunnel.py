"""A tunnel driven in rounds through a mesh that gmsh extrudes: wedges near it, hexahedra around."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import gmsh
import numpy as np
import pytest
from support.cases import material, model, rollers
from support.meshes import gaping_box, mixed_box

from geoident.fem.faces import face_table, load_patches
from geoident.fem.kinematics import SOLID
from geoident.fem.loads import pressure_forces
from geoident.fem.location import Locator
from geoident.io.mesh.file import read_mesh
from geoident.model.actions import Pressure
from geoident.model.case import Stage
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Scalar

RADIUS, ROUND, DRIVEN, SOLID_ROUNDS, SIDE = 2.0, 2.0, 3, 2, 14.0
LENGTH = ROUND * (DRIVEN + SOLID_ROUNDS)
PLACES = ((RADIUS, 0, 1.0), (0, RADIUS, 1.0), (0, RADIUS, 3.0), (1.44, 1.44, 3.0), (3.5, 0, 5.0))
OUTLINE = {
    "centre": (0, 0), "a": (RADIUS, 0), "b": (0, RADIUS), "c": (5, 0), "d": (5, 5), "e": (0, 5),
    "f": (SIDE, 0), "g": (SIDE, SIDE), "h": (0, SIDE),
}  # fmt: skip


def section(*, layered: bool) -> dict[str, int]:
    """Surfaces of the cross section in gmsh: a quarter of the tunnel and three parts around it."""
    geo = gmsh.model.geo
    points = {name: geo.addPoint(*xy, 0) for name, xy in OUTLINE.items()}
    ends = ["centre a", "b centre", "a c", "c d", "d e", "e b", "c f", "f g", "g d", "g h", "h e"]
    lines = {pair: geo.addLine(*(points[end] for end in pair.split())) for pair in ends}
    arc = geo.addCircleArc(points["a"], points["centre"], points["b"])
    loops = {
        "tunnel": [lines["centre a"], arc, lines["b centre"]],
        "near": [lines["a c"], lines["c d"], lines["d e"], lines["e b"], -arc],
        "right": [lines["c f"], lines["f g"], lines["g d"], -lines["c d"]],
        "top": [-lines["g d"], lines["g h"], lines["h e"], -lines["d e"]],
    }
    faces = {name: geo.addPlaneSurface([geo.addCurveLoop(loop)]) for name, loop in loops.items()}
    for pair in ("c d", "d e", "f g", "g h", "c f", "g d", "h e"):
        geo.mesh.setTransfiniteCurve(lines[pair], 5)
    for name in ("right", "top"):
        geo.mesh.setTransfiniteSurface(faces[name])
        if layered:
            geo.mesh.setRecombine(2, faces[name])
    return faces


def extrude(faces: dict[str, int], layers: int, *, layered: bool) -> None:
    """Rounds of the tunnel one behind the other; groups for rounds, rock, surface and sides."""
    rock: list[int] = []
    surface: list[int] = []
    current = [(2, face) for face in faces.values()]
    for number in range(1, DRIVEN + SOLID_ROUNDS + 1):
        made = gmsh.model.geo.extrude(current, 0, 0, ROUND, numElements=[layers], recombine=layered)
        volumes = [n for n, (dim, _) in enumerate(made) if dim == 3]
        current = [made[n - 1] for n in volumes]  # gmsh lists the far end, the volume, the sides
        tunnel = made[volumes[0]][1]
        rock += [made[n][1] for n in volumes[1:]]
        if number > DRIVEN:
            rock.append(tunnel)
            continue
        gmsh.model.geo.addPhysicalGroup(3, [tunnel], name=f"round {number}")
        surface.append(made[volumes[0] + 2][1])  # over the second line of the tunnel, the arc
        if number == DRIVEN:
            surface.append(current[0][1])
    gmsh.model.geo.addPhysicalGroup(3, rock, name="rock")
    gmsh.model.geo.addPhysicalGroup(2, surface, name="surface")
    gmsh.model.geo.synchronize()
    for name, (axis, level) in {"x0": (0, 0.0), "y0": (1, 0.0), "z0": (2, 0.0)}.items():
        low, high = [-1.0] * 3, [SIDE + 1, SIDE + 1, LENGTH + 1]
        low[axis], high[axis] = level - 1e-3, level + 1e-3
        on = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, 2)]
        gmsh.model.addPhysicalGroup(2, on, name=name)


@cache
def tunnel(order: int, size: float, *, layered: bool):
    """The mesh of a tunnel with an element size (m), as gmsh writes and geoident reads it."""
    gmsh.initialize(interruptible=False)
    try:
        option = gmsh.option.setNumber
        option("General.Terminal", 0)
        extrude(section(layered=layered), round(ROUND / size), layered=layered)
        option("Mesh.MeshSizeMin", size)
        option("Mesh.MeshSizeMax", size)
        option("Mesh.SecondOrderIncomplete", 1)
        option("Mesh.ElementOrder", order)
        gmsh.model.mesh.generate(3)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "tunnel.msh"
            gmsh.write(str(path))
            return read_mesh(str(path), dim=3)
    finally:
        gmsh.finalize()


def driven(mesh) -> np.ndarray:
    """Displacements (n_states, n_places, 3) of points at the wall, with air in the open tunnel."""
    zero = Scalar(0.0)
    staged = model(
        mesh,
        materials={"rock": material("rock", 4e9, 0.25)},
        groups=dict.fromkeys(mesh.groups, "rock"),
        supports=rollers(3),
        in_situ=ConstantStress((Scalar(-6e6), Scalar(-9e6), Scalar(-7e6), zero, zero, zero)),
        stages=(
            *(Stage(f"round {k}", excavate=(f"round {k}",)) for k in range(1, DRIVEN + 1)),
            Stage("air", loads={"air": Pressure("surface", Scalar(1e6))}),
        ),
    )
    fields = staged.survey(np.empty(0), fields=True).fields
    locator = Locator(staged.mesh)
    found = []
    for place in PLACES:
        site = next(s for s in locator.sites(place) if fields.present[-1, s.element])
        found.append(np.einsum("a,sai->si", site.shapes, fields.displacement[:, site.nodes]))
    return np.stack(found, axis=1)


def kinds(mesh) -> set[str]:
    return {block.kind for block in mesh.blocks}


@pytest.mark.slow  # on coarse meshes: the next
def test_a_tunnel_through_wedges_moves_as_one_through_tetrahedra():
    tets, second = tunnel(2, 1.0, layered=False), tunnel(2, 1.0, layered=True)
    coarse, fine = (tunnel(1, size, layered=True) for size in (2.0, 1.0))
    assert kinds(tets) == {"tet10"}
    assert kinds(second) == {"wedge15", "hex20"}
    assert kinds(coarse) == kinds(fine) == {"wedge6", "hex8"}
    peer = driven(tets)
    errors = [np.abs(driven(m) - peer).max() / np.abs(peer).max() for m in (coarse, fine, second)]
    assert errors[0] > 2 * errors[1] > 8 * errors[2]
    assert errors[2] < 0.02  # at the edge of the face, where the stress has no bound


def test_wedges_of_both_orders_move_alike_on_coarse_meshes():
    coarse, second = (driven(tunnel(order, 2.0, layered=True)) for order in (1, 2))
    assert np.abs(coarse - second).max() < 0.3 * np.abs(second).max()


def test_a_pressure_acts_on_triangles_and_quadrilaterals():
    mesh = tunnel(1, 1.0, layered=True)
    present = np.ones(mesh.n_elements, dtype=bool)
    for k in range(1, DRIVEN + 1):
        present[mesh.groups[f"round {k}"]] = False
    patches = load_patches(mesh, face_table(mesh), "surface", present)
    assert patches is not None
    assert {patch.kind for patch in patches} == {"tri3", "quad4"}
    force = sum(pressure_forces(mesh, patch, SOLID) for patch in patches).reshape(-1, 3).sum(axis=0)
    # On the quarter of a cylinder the projections count: radius times length; on its end the area
    # of the polygon with corners on the circle.
    face = next(patch for patch in patches if patch.kind == "tri3")
    a, b, c = mesh.points[face.nodes].swapaxes(0, 1)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    np.testing.assert_allclose(force, [12.0, 12.0, area], rtol=1e-9)
    assert 0.95 * np.pi < area < np.pi


def test_hexahedra_against_tetrahedra_are_said():
    def notes(mesh):
        staged = model(
            mesh,
            materials={"rock": material("rock", 4e9, 0.25)},
            groups=dict.fromkeys(mesh.groups, "rock"),
            supports=rollers(3),
            stages=(Stage("nothing"),),
        )
        return [note for note in staged.notes if "triangles" in note]

    (note,) = notes(gaping_box())
    assert note.startswith(
        "1 quadrilateral face lies against triangles, near (0.5, 0.5, 0.5) m: elements that do"
    )
    assert "put pyramids between hexahedra and tetrahedra" in note
    assert notes(mixed_box(1)) == []
    (note,) = notes(gaping_box(2))
    assert note.startswith("2 quadrilateral faces lie against triangles, the first near (0.5, ")
