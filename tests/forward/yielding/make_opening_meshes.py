"""Meshes of `test_little_dilation`: a quarter of a round opening in unstructured triangles.

Run this file to make ``opening_meshes.npz`` anew (gmsh 4.15). Kept are corners and connectivity;
the nodes in the middle of edges follow from them.
"""

from pathlib import Path

import gmsh
import numpy as np

REACH, FAR, GROWTH = 40.0, 6.0, 0.14
SIZES = (0.15, 0.10, 0.05, 0.03)
FILE = Path(__file__).with_name("opening_meshes.npz")


def triangles(size: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 2) and triangles (m, 3) of a mesh with a size of elements at the wall."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ, mesh = gmsh.model.occ, gmsh.model.mesh
    disks = [(2, occ.addDisk(0, 0, 0, r, r)) for r in (REACH, 1.0)]
    parts, _ = occ.fragment(disks[:1], disks[1:])
    quarter, _ = occ.intersect(parts, [(2, occ.addRectangle(0, 0, 0, 2 * REACH, 2 * REACH))])
    occ.fragment(quarter, [])
    occ.synchronize()
    near, far, least = (mesh.field.add(kind) for kind in ("MathEval", "MathEval", "Min"))
    mesh.field.setString(near, "F", f"{size}+{GROWTH}*abs(sqrt(x*x+y*y)-1)")
    mesh.field.setString(far, "F", f"{FAR}")
    mesh.field.setNumbers(least, "FieldsList", [near, far])
    mesh.field.setAsBackgroundMesh(least)
    for option in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.option.setNumber("Mesh.RandomSeed", 2)
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    mesh.generate(2)
    tags, xyz, _ = mesh.getNodes()
    places = np.zeros(int(tags.max()) + 1, dtype=int)
    places[tags] = np.arange(len(tags))
    cells = places[np.concatenate([mesh.getElementsByType(2, tag)[1] for _, tag in quarter])]
    gmsh.finalize()
    used, corners = np.unique(cells, return_inverse=True)
    return xyz.reshape(-1, 3)[used, :2], corners.reshape(-1, 3)


if __name__ == "__main__":
    kept = {}
    for one in SIZES:
        points, cells = triangles(one)
        kept |= {f"points {one:.2f}": points, f"cells {one:.2f}": cells.astype(np.int16)}
    np.savez_compressed(FILE, **kept)
