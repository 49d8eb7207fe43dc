"""A cube of rock with a cavern, as large as asked for: mesh, case and simulated readings.

    python tests/benchmarks/cube.py --dofs 1000000 OUT
    geoident check OUT/case.yaml
    geoident fit OUT/case.yaml

Writes `cube.msh` (tet10, by gmsh), `case.yaml` and `readings.csv` into the folder OUT. A cavern of
20 x 40 x 20 m is taken out of a cube of 100 m in one stage; five parameters are sought: E, nu and
three stresses. The readings are those of known ground on a mesh of another size, with noise, and
the same for every size. Unknowns are within a few per cent of those asked for; the same call makes
the same files. Elements grow from the walls of the cavern to the edge of the cube.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import gmsh
import yaml

ROOT = Path(__file__).resolve().parents[2]
EDGE = 100.0
CAVERN = (20.0, 40.0, 20.0)
GROWTH = 0.18
"""Growth of the elements with the distance from the cavern, m per m."""

MESH_OF_TRUTH = 120_000
"""Unknowns of the mesh by which the readings are made."""

TRUTH = {
    "E": "12 GPa",
    "nu": "0.22",
    "s_across": "-9 MPa",
    "s_along": "-7 MPa",
    "s_vertical": "-6 MPa",
}

DEPTHS = (2.0, 5.0, 12.0)
WALLS = {
    "crown": (0.0, 0.0, 1.0),
    "floor": (0.0, 0.0, -1.0),
    "wall-left": (-1.0, 0.0, 0.0),
    "wall-right": (1.0, 0.0, 0.0),
    "end-front": (0.0, -1.0, 0.0),
    "end-back": (0.0, 1.0, 0.0),
}
OVERCORING = (25.0, -35.0, 20.0)


def heads() -> dict[str, list[float]]:
    """The middle of every wall of the cavern, m."""
    return {
        name: [0.5 * side * out for side, out in zip(CAVERN, normal, strict=True)]
        for name, normal in WALLS.items()
    }


def anchors(wall: str) -> dict[str, list[float]]:
    """Anchors of the extensometer in a wall, by name: places in m."""
    head, normal = heads()[wall], WALLS[wall]
    return {
        f"a{depth:g}": [h + depth * out for h, out in zip(head, normal, strict=True)]
        for depth in DEPTHS
    }


def write_mesh(path: Path, dofs: int) -> int:
    """Mesh with about as many unknowns as asked for; how many it has.

    Args:
        path: of the mesh.
        dofs: three for every node of the rock that stays.
    """
    # the unknowns of a first mesh with this size at the cavern tell the size that is wanted
    size = 2.0 * (60_000 / dofs) ** (1 / 3)
    for attempt in range(4):
        found = _mesh(path, size)
        if abs(found / dofs - 1) < 0.02 or attempt == 3:
            break
        size *= (found / dofs) ** 0.36
    return found


def _mesh(path: Path, size: float) -> int:
    """Write a mesh; three times the number of nodes of the rock that stays."""
    gmsh.initialize(["-nopopup", "-v", "1"])
    try:
        _geometry()
        _sizes(size)
        for name, value in {"Binary": 1, "RandomSeed": 1, "MeshSizeExtendFromBoundary": 0}.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
        return 3 * len(gmsh.model.mesh.getNodesForPhysicalGroup(3, 1)[0])
    finally:
        gmsh.finalize()


def _geometry() -> None:
    """The cube with its cavern; places of gauges are nodes."""
    occ, half = gmsh.model.occ, EDGE / 2
    cube = occ.addBox(-half, -half, -half, EDGE, EDGE, EDGE)
    cavern = occ.addBox(*(-side / 2 for side in CAVERN), *CAVERN)
    places = [place for wall in WALLS for place in (heads()[wall], *anchors(wall).values())]
    points = [(0, occ.addPoint(*place)) for place in (*places, OVERCORING)]
    _, parts = occ.fragment([(3, cube), (3, cavern)], points)
    occ.synchronize()
    inner = [tag for _, tag in parts[1]]
    rock = [tag for _, tag in parts[0] if tag not in inner]
    gmsh.model.addPhysicalGroup(3, rock, 1, name="rock")
    gmsh.model.addPhysicalGroup(3, inner, 2, name="cavern")
    for name, axis in (("left", 0), ("front", 1), ("bottom", 2)):
        low, high = [-2 * half] * 3, [2 * half] * 3
        low[axis], high[axis] = -half - 1e-3, -half + 1e-3
        faces = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, 2)]
        gmsh.model.addPhysicalGroup(2, faces, name=name)


def _sizes(size: float) -> None:
    """Elements of one size at the walls of the cavern that grow with the distance from them."""
    x, y, z = (side / 2 for side in CAVERN)
    away = " + ".join(
        f"max(abs({axis}) - {half}, 0) * max(abs({axis}) - {half}, 0)"
        for axis, half in zip("xyz", (x, y, z), strict=True)
    )
    inside = f"max(min({x} - abs(x), min({y} - abs(y), {z} - abs(z))), 0)"
    field = gmsh.model.mesh.field
    tag = field.add("MathEval")
    field.setString(tag, "F", f"{size} * (1 + {GROWTH} * (sqrt({away}) + {inside}))")
    field.setAsBackgroundMesh(tag)
    for option in ("MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


def case() -> dict[str, object]:
    """The case, as it is written."""
    across = {"s_across": (-7, -30, -1), "s_along": (-8, -30, -1), "s_vertical": (-5, -30, -1)}
    parameters: dict[str, object] = {
        "E": {"start": "20 GPa", "bounds": ["2 GPa", "80 GPa"], "scale": "log"},
        "nu": {"start": 0.28, "bounds": [0.05, 0.45]},
    }
    for name, (start, low, high) in across.items():
        parameters[name] = {"start": f"{start} MPa", "bounds": [f"{low} MPa", f"{high} MPa"]}
    stress = {"xx": "$s_across", "yy": "$s_along", "zz": "$s_vertical"}
    return {
        "format": "geoident-case/1",
        "title": "Cavern in a cube of rock",
        "analysis": "solid",
        "mesh": {"file": "cube.msh"},
        "parameters": parameters,
        "materials": {"rock": {"elastic": "isotropic", "E": "$E", "nu": "$nu"}},
        "groups": {"rock": "rock", "cavern": "rock"},
        "supports": {"left": "x", "front": "y", "bottom": "z"},
        "in_situ": {"model": "constant", **stress},
        "stages": [{"name": "cavern", "excavate": ["cavern"]}],
        "gauges": _gauges(),
        "readings": "readings.csv",
        "fit": {"method": "gauss-newton"},
    }


def _gauges() -> dict[str, object]:
    """Extensometers in all walls, chords across the cavern, and overcoring in virgin rock."""
    gauges: dict[str, object] = {
        f"E-{wall}": {
            "kind": "extensometer",
            "head": _metres(head),
            "anchors": {name: _metres(place) for name, place in anchors(wall).items()},
            "accuracy": "0.2 mm",
        }
        for wall, head in heads().items()
    }
    for one, other in (("crown", "floor"), ("wall-left", "wall-right"), ("end-front", "end-back")):
        between = [_metres(heads()[one]), _metres(heads()[other])]
        gauge = {"kind": "convergence", "between": between, "accuracy": "0.3 mm"}
        gauges[f"C-{one}-{other}"] = gauge
    gauges["overcoring"] = {
        "kind": "stress",
        "point": _metres(OVERCORING),
        "components": ["xx", "yy", "zz"],
        "state": "virgin",
        "accuracy": "0.3 MPa",
    }
    return gauges


def _metres(place: object) -> list[str]:
    return [f"{x:g} m" for x in place]


def write_readings(folder: Path, seed: int = 1) -> None:
    """Readings of known ground on a mesh of its own, with noise.

    Args:
        folder: with the case.
        seed: of the noise.
    """
    with tempfile.TemporaryDirectory() as scratch:
        mesh = Path(scratch) / "truth.msh"
        write_mesh(mesh, MESH_OF_TRUTH)
        changes = [f"mesh.file={mesh}", "readings=[]"]
        changes += [f"parameters.{name}.start={value}" for name, value in TRUTH.items()]
        words = [word for change in changes for word in ("--set", change)]
        made = Path(scratch) / "readings.csv"
        words += ["--noise", "--seed", str(seed), "-o", str(made)]
        case_file = str((folder / "case.yaml").resolve())
        command = [sys.executable, "-m", "geoident", "simulate", case_file, *words]
        # from here it is the geoident beside this file, whatever else is installed
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
        if done.returncode:  # what it says is the reason
            print(done.stderr, file=sys.stderr)
            done.check_returncode()
        shutil.copy(made, folder / "readings.csv")


def write_cube(folder: Path, dofs: int) -> int:
    """Write mesh, case and readings into a folder; how many unknowns the mesh has.

    Args:
        folder: made if it is not there.
        dofs: unknowns wanted.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = write_mesh(folder / "cube.msh", dofs)
    text = yaml.safe_dump(case(), sort_keys=False)
    (folder / "case.yaml").write_text(text, encoding="utf-8")
    write_readings(folder)
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dofs", type=int, default=150_000, help="unknowns of the mesh, about")
    parser.add_argument("folder", type=Path, metavar="OUT")
    given = parser.parse_args()
    found = write_cube(given.folder, given.dofs)
    print(f"{given.folder}: {found} unknowns")


if __name__ == "__main__":
    main()
