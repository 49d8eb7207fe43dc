"""Makes the mesh of the dam on its joint: a section of the dam on its rock, with the line between.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.5 --order 2 --output fine.msh

The joint has two parts, upstream and downstream of the drains. The same call makes the same mesh.
Needs gmsh (`pip install gmsh`). Lengths in m, x downstream from the heel, y upwards.
"""

import sys
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import TRIANGLES, lines, mesh_file, read_options  # noqa: E402

HEIGHT, BASE, MIDDLE = 50.0, 38.0, 15.0
CREST, SHOULDER = 5.0, 44.0  # width of the crest, level where the downstream face begins to lean
SIDE, DEPTH = 110.0, 90.0  # extent of the rock to both sides of the dam, and below it

geo = gmsh.model.geo


def points(*places: tuple[float, float]) -> list[int]:
    """Points in the plane."""
    return [geo.addPoint(x, y, 0) for x, y in places]


def build() -> None:
    """The geometry with its groups."""
    heel, middle, toe = points((0, 0), (MIDDLE, 0), (BASE, 0))
    crown = points((CREST, SHOULDER), (CREST, HEIGHT), (0, HEIGHT))
    ground = points((BASE + SIDE, 0), (BASE + SIDE, -DEPTH), (-SIDE, -DEPTH), (-SIDE, 0))
    base = lines([heel, middle, toe])
    outline, border = lines([toe, *crown, heel]), lines([toe, *ground, heel])
    dam = geo.addPlaneSurface([geo.addCurveLoop([*base, *outline])])
    around = [-line for line in reversed([*base, *border])]
    rock = geo.addPlaneSurface([geo.addCurveLoop(around)])
    geo.synchronize()
    for name, surface in {"dam": dam, "rock": rock}.items():
        gmsh.model.addPhysicalGroup(2, [surface], name=name)
    faces = {"joint": base, "joint-upstream": base[:1], "joint-downstream": base[1:]}
    faces |= {"upstream-face": outline[3:], "reservoir-floor": border[4:]}
    faces |= {"right": border[1:2], "bottom": border[2:3], "left": border[3:4]}
    for name, parts in faces.items():
        gmsh.model.addPhysicalGroup(1, parts, name=name)


def grade(size: float) -> None:
    """Element sizes: even in the dam and along its base, growing with the distance in the rock."""
    away = f"sqrt(max(0, -y)^2 + max(0, abs(x - {BASE / 2}) - {BASE / 2})^2)"
    field = gmsh.model.mesh.field
    sizes = field.add("MathEval")
    field.setString(sizes, "F", f"{size} * (2 + 0.3 * {away} + 0.1 * max(0, y))")
    field.setAsBackgroundMesh(sizes)


def main() -> None:
    options = read_options(__doc__, HERE / "dam.msh")
    with mesh_file(options, TRIANGLES):
        build()
        grade(options.size)


if __name__ == "__main__":
    main()
