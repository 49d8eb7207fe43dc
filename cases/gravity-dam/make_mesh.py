"""Makes the mesh of the concrete gravity dam: a section of the dam on its rock.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.5 --order 2 --output fine.msh

The same call makes the same mesh, mostly of quadrilaterals, with some triangles. Needs gmsh
(`pip install gmsh`). Lengths in m, x downstream from the upstream face, y upwards from the base.
"""

import sys
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import QUADRILATERALS, lines, mesh_file, read_options  # noqa: E402

HEIGHT, BASE = 70.0, 54.0
CREST, SHOULDER = 7.0, 61.0  # width of the crest, level where the downstream face begins to lean
SIDE, DEPTH = 180.0, 140.0  # extent of the rock to both sides of the dam, and below it

geo = gmsh.model.geo


def points(*places: tuple[float, float]) -> list[int]:
    """Points in the plane."""
    return [geo.addPoint(x, y, 0) for x, y in places]


def build() -> None:
    """The geometry with its groups."""
    heel, toe = points((0, 0), (BASE, 0))
    crown = points((CREST, SHOULDER), (CREST, HEIGHT), (0, HEIGHT))
    ground = points(
        (BASE + SIDE, 0), (BASE + SIDE, -DEPTH), (-SIDE, -DEPTH), (-SIDE, 0)
    )  # fmt: skip
    base = geo.addLine(heel, toe)
    outline = lines([toe, *crown, heel])
    border = lines([toe, *ground, heel])
    dam = geo.addPlaneSurface([geo.addCurveLoop([base, *outline])])
    rock = geo.addPlaneSurface([geo.addCurveLoop([-line for line in reversed([base, *border])])])
    geo.synchronize()
    for name, surface in {"dam": dam, "rock": rock}.items():
        gmsh.model.addPhysicalGroup(2, [surface], name=name)
    faces = {"upstream-face": outline[3], "reservoir-floor": border[4]}
    edges = {"right": border[1], "bottom": border[2], "left": border[3]}
    for name, line in {**faces, **edges}.items():
        gmsh.model.addPhysicalGroup(1, [line], name=name)


def grade(size: float) -> None:
    """Element sizes: even in the dam, growing with the distance from it in the rock."""
    away = f"sqrt(max(0, -y)^2 + max(0, abs(x - {BASE / 2}) - {BASE / 2})^2)"
    field = gmsh.model.mesh.field
    sizes = field.add("MathEval")
    field.setString(sizes, "F", f"{size} * (1.6 + 0.1 * {away})")
    field.setAsBackgroundMesh(sizes)


def main() -> None:
    options = read_options(__doc__, HERE / "gravity-dam.msh")
    with mesh_file(options, QUADRILATERALS):
        build()
        grade(options.size)


if __name__ == "__main__":
    main()
