"""Writes the deck of CalculiX and the same mesh for geoident. Run: python make_deck.py.

An eighth of a cube of rock of 40 m with a cavern of 10 m in its middle, elements with 20 nodes.
Where rock is elastic, taking the in-situ stress off the wall is all that the excavation does, so
the deck pulls at the wall with that stress and needs no initial state.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
LINES = (0.0, 2.5, 5.0, 7.5, 11.0, 20.0)  # m, alike in x, y and z
CAVERN, WALL = 5.0, 7.5  # m
GAUGES = {  # direction, place
    "X5": (0, (5.0, 0.0, 0.0)),
    "Z5": (2, (0.0, 0.0, 5.0)),
    "X5u": (0, (5.0, 0.0, 2.5)),
    "Z5s": (2, (2.5, 0.0, 5.0)),
    "X7": (0, (7.5, 0.0, 0.0)),
    "Z7": (2, (0.0, 0.0, 7.5)),
    "X11": (0, (11.0, 0.0, 0.0)),
    "Z11": (2, (0.0, 0.0, 11.0)),
}
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
OF_CALCULIX = (
    (0, 1),
    (1, 2),
    (2, 3),
    (3, 0),
    (4, 5),
    (5, 6),
    (6, 7),
    (7, 4),
    (0, 4),
    (1, 5),
    (2, 6),
    (3, 7),
)
OF_GMSH = (
    (0, 1),
    (0, 3),
    (0, 4),
    (1, 2),
    (1, 5),
    (2, 3),
    (2, 6),
    (3, 7),
    (4, 5),
    (4, 7),
    (5, 6),
    (6, 7),
)
FACES = {(0, 0): "P6", (1, 0): "P3", (2, 0): "P1"}  # of an element, towards the cavern


class Mesh:
    """Nodes on a grid with the middles of its edges, numbered where they are first met."""

    def __init__(self, split: int) -> None:
        ends = np.array(LINES)
        parts = [np.linspace(a, b, split, endpoint=False) for a, b in pairwise(ends)]
        self.lines = np.append(np.concatenate(parts), ends[-1])
        self.nodes: dict[tuple[float, ...], int] = {}
        n = len(self.lines) - 1
        self.cells = [(i, j, k) for i in range(n) for j in range(n) for k in range(n)]

    def node(self, place: np.ndarray) -> int:
        return self.nodes.setdefault(tuple(np.round(place, 9).tolist()), len(self.nodes) + 1)

    def corners(self, cell: tuple[int, ...]) -> np.ndarray:
        return np.array([self.lines[np.add(cell, corner)] for corner in CORNERS])

    def hexahedron(self, cell: tuple[int, ...], edges: tuple[tuple[int, int], ...]) -> list[int]:
        at = self.corners(cell)
        return [self.node(x) for x in at] + [self.node((at[a] + at[b]) / 2) for a, b in edges]

    def group(self, cell: tuple[int, ...]) -> str:
        middle = self.corners(cell).mean(axis=0).max()
        return "cavern" if middle < CAVERN else "wall" if middle < WALL else "rock"

    def sides(self) -> list[tuple[str, list[int]]]:
        """Faces on the six sides of the cube, with the middles of their edges."""
        found = []
        for cell in self.cells:
            at = self.corners(cell)
            for axis in range(3):
                for end, place in enumerate((self.lines[0], self.lines[-1])):
                    here = [m for m, x in enumerate(at) if x[axis] == place]
                    if len(here) == 4:
                        a, b, c, d = (at[m] for m in (here[0], here[1], here[3], here[2]))
                        ring = [a, b, c, d] if _is_ring(a, b, c, d) else [a, b, d, c]
                        middles = [
                            (p + q) / 2 for p, q in zip(ring, [*ring[1:], ring[0]], strict=True)
                        ]
                        found.append(
                            (f"{'xyz'[axis]}{end}", [self.node(x) for x in (*ring, *middles)])
                        )
        return found


def _is_ring(*points: np.ndarray) -> bool:
    """Whether four corners of a rectangle stand in their order."""
    return bool(np.allclose(points[0] + points[2], points[1] + points[3]))


def deck(mesh: Mesh) -> str:
    """The deck of CalculiX with fields for the parameters."""
    solids = [(n, cell) for n, cell in enumerate(mesh.cells, 1) if mesh.group(cell) != "cavern"]
    nodes = {n: mesh.hexahedron(cell, OF_CALCULIX) for n, cell in solids}
    out = [
        "** An eighth of a cube of rock with a cavern; written by make_deck.py",
        "*NODE, NSET=ALL",
    ]
    used = {node for row in nodes.values() for node in row}
    places = {number: place for place, number in mesh.nodes.items()}
    out += [f"{k}," + ",".join(f"{x:g}" for x in places[k]) for k in sorted(used)]
    for group in ("rock", "wall"):
        out.append(f"*ELEMENT, TYPE=C3D20, ELSET={group.upper()}")
        for n, cell in solids:
            if mesh.group(cell) == group:
                row = nodes[n]
                out += [f"{n}," + ",".join(map(str, row[:12])) + ",", ",".join(map(str, row[12:]))]
    for name in ("rock", "wall"):
        out += [f"*MATERIAL, NAME={name.upper()}", "*ELASTIC", f"{{{{E_{name}:.12e}}}}, 0.25"]
        out.append(f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL={name.upper()}")
    out.append("*BOUNDARY")
    for k in sorted(used):
        out += [
            f"{k},{axis + 1},{axis + 1}"
            for axis, x in enumerate(places[k])
            if x in (0.0, LINES[-1])
        ]
    out += [
        "*NSET, NSET=GAUGES",
        ",".join(str(node_of(mesh, place)) for _, place in GAUGES.values()),
    ]
    out += ["*STEP", "*STATIC", "*DLOAD"]
    for n, cell in solids:
        low = mesh.corners(cell).min(axis=0)
        for axis in range(3):
            others = np.delete(low, axis)
            if low[axis] == CAVERN and others.max() < CAVERN:
                field = "6e6" if axis == 2 else "{{sigma_h:.12e}}"
                out.append(f"{n},{FACES[axis, 0]},-{field}")
    return "\n".join([*out, "*NODE PRINT, NSET=GAUGES", "U", "*END STEP", ""])


def node_of(mesh: Mesh, place: tuple[float, ...]) -> int:
    return mesh.nodes[tuple(place)]


def gmsh(mesh: Mesh) -> str:
    """The mesh with the cavern and the sides of the cube, in Gmsh's format 2.2."""
    names = ["rock", "wall", "cavern", "x0", "x1", "y0", "y1", "z0", "z1"]
    rows = [(17, mesh.group(cell), mesh.hexahedron(cell, OF_GMSH)) for cell in mesh.cells]
    rows += [(16, name, nodes) for name, nodes in mesh.sides()]
    out = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    out += [f'{3 if n < 3 else 2} {n + 1} "{name}"' for n, name in enumerate(names)]
    out += ["$EndPhysicalNames", "$Nodes", str(len(mesh.nodes))]
    out += [f"{k} " + " ".join(f"{x:g}" for x in place) for place, k in mesh.nodes.items()]
    out += ["$EndNodes", "$Elements", str(len(rows))]
    for n, (kind, name, nodes) in enumerate(rows, 1):
        tag = names.index(name) + 1
        out.append(f"{n} {kind} 2 {tag} {tag} " + " ".join(map(str, nodes)))
    return "\n".join([*out, "$EndElements", ""])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", type=int, default=1, help="elements in place of one")
    parser.add_argument("--output", default=HERE / "cube.msh", help="the mesh of geoident")
    given = parser.parse_args()
    made = Mesh(given.split)
    text = deck(made)
    Path(given.output).write_text(gmsh(made), encoding="utf-8")
    if given.split == 1:
        (HERE / "cube.template").write_text(text, encoding="utf-8")
        for name, (axis, place) in GAUGES.items():
            print(f"{name}: node {node_of(made, place)}, word {axis + 2}")
