"""Structured meshes of every element kind, made here so that tests need no mesh generator."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product

import numpy as np

from geoident.fem.faces import face_table, patches
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh

KINDS_2D = ("tri3", "tri6", "quad4", "quad8")
KINDS_3D = tuple(
    f"{shape}{n}"
    for shape, counts in (
        ("tet", (4, 10)),
        ("hex", (8, 20)),
        ("wedge", (6, 15)),
        ("pyramid", (5, 13)),
    )
    for n in counts
)
KINDS = KINDS_2D + KINDS_3D
_LINEAR = {"tri6": "tri3", "quad8": "quad4", "tet10": "tet4", "hex20": "hex8"}
_LINEAR |= {"wedge15": "wedge6", "pyramid13": "pyramid5"}


def box(
    kind: str, n: tuple[int, ...], *, size: tuple[float, ...] | None = None, distortion: float = 0.0
) -> Mesh:
    """A rectangle or box of n cells per axis; inner nodes moved at random by parts of a cell."""
    dim = len(n)
    size = size or (1.0,) * dim
    axes = [np.linspace(0, s, k + 1) for s, k in zip(size, n, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, dim)
    if distortion:
        inner = np.all((points > 1e-9) & (points < np.array(size) - 1e-9), axis=1)
        shift = np.random.default_rng(7).uniform(-1, 1, points.shape) * distortion
        points = points + inner[:, None] * shift * np.array(size) / np.array(n)
    return from_grid(kind, points, n)


def from_grid(kind: str, points: np.ndarray, n: tuple[int, ...]) -> Mesh:
    """Elements of a kind on a grid of points (indexed 'ij'), with straight mid-nodes."""
    cells = _cells(n)
    linear = _LINEAR.get(kind, kind)
    if linear == "pyramid5":
        points, cells = _with_centres(points, cells)
    return build(kind, points, split_cells(cells, linear))


def build(kind: str, points: np.ndarray, cells: np.ndarray) -> Mesh:
    """A mesh from linear cells, mid-nodes added for second-order kinds; faces of the box named."""
    cell = CELLS[kind]
    points, nodes = elevate(points, cells, kind) if cell.order == 2 else (points, cells)
    block = ElementBlock(kind, nodes, np.arange(1, len(nodes) + 1))
    return with_outer_faces(Mesh(points, (block,), groups={"all": np.arange(len(nodes))}))


def elevate(points: np.ndarray, cells: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Add the mid-nodes of a second-order kind to linear cells."""
    points, raised = _elevate_all(points, {kind: cells})
    return points, raised[kind]


def with_outer_faces(mesh: Mesh) -> Mesh:
    """Give the outer faces in the planes of the bounding box the names x0, x1, y0, ..."""
    table = face_table(mesh)
    outer = patches(mesh, table, table.free(np.ones(mesh.n_elements, bool)))
    facets = tuple(ElementBlock(p.kind, p.nodes, np.arange(1, len(p.nodes) + 1)) for p in outer)
    groups: dict[str, np.ndarray] = {}
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for axis, end in product(range(mesh.dim), (0, 1)):
        level = (low, high)[end][axis]
        on = [np.all(np.abs(mesh.points[f.nodes][..., axis] - level) < 1e-9, 1) for f in facets]
        groups[f"{'xyz'[axis]}{end}"] = np.flatnonzero(np.concatenate(on))
    everything = np.arange(sum(len(f) for f in facets))
    groups["outer"] = everything
    return Mesh(mesh.points, mesh.blocks, facets, dict(mesh.groups), groups, {}, mesh.file)


def regroup(mesh: Mesh, **tests: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    """Element groups by tests on the centres of the elements, each element in the first that holds.

    The rest is called ``rock``.
    """
    centres = np.vstack([mesh.points[b.nodes].mean(axis=1) for b in mesh.blocks])
    free = np.ones(len(centres), bool)
    groups = {}
    for name, test in tests.items():
        mine = free & test(centres)
        free &= ~mine
        groups[name] = np.flatnonzero(mine)
    groups["rock"] = np.flatnonzero(free)
    return Mesh(mesh.points, mesh.blocks, mesh.facets, groups, mesh.facet_groups, mesh.node_groups)


def opening(
    kind: str, dim: int, *, n: int, layers: int, radius: float, reach: float, whole: bool = False
) -> Mesh:
    """A quarter (octant) of a round opening, filled, in a round domain; curved mid-nodes.

    Args:
        kind: quad8 and the like; any kind of that dimension.
        dim: 2 or 3.
        n: cells along the side of the core of a quarter; its wall has dim n^(dim-1) faces.
        layers: rings of elements from the wall to the outer edge, growing geometrically.
        radius: of the opening.
        reach: of the domain.
        whole: all quarters (octants), for ground without planes of symmetry.
    """
    steps = np.arange(-n if whole else 0, n + 1) / n
    grid = np.stack(np.meshgrid(*[steps] * dim, indexing="ij"), -1).reshape(-1, dim)
    cells = _cells((len(steps) - 1,) * dim)
    linear = _LINEAR.get(kind, kind)
    radii = np.geomspace(1, reach / radius, layers + 1)
    core = Mesh(grid, (ElementBlock({2: "quad4", 3: "hex8"}[dim], cells, cells[:, 0]),))
    table = face_table(core)
    (skin,) = patches(core, table, table.free(np.ones(len(cells), bool)))
    wall = skin.nodes[np.any(np.all(np.isclose(np.abs(grid[skin.nodes]), 1.0), axis=1), axis=1)]
    points, all_cells = grid, [cells]
    inner = wall
    for r in radii[1:]:
        nodes = np.unique(wall)
        index = np.zeros(len(grid), int)
        index[nodes] = len(points) + np.arange(len(nodes))
        points = np.vstack([points, grid[nodes] * r])
        outer = index[wall]
        all_cells.append(np.hstack([inner if dim == 3 else inner[:, ::-1], outer]))
        inner = outer
    joined = np.vstack(all_cells)
    if linear == "tet4":
        points, joined = cut_by_centres(points, joined)
    joined = split_cells(joined, linear)
    if kind != linear:
        points, joined = elevate(points, joined, kind)
    block = ElementBlock(kind, joined, np.arange(1, len(joined) + 1))
    points = _rounded(points) * radius
    mesh = Mesh(points, (block,), groups={"all": np.arange(len(joined))})
    mesh = with_outer_faces(mesh)
    corners = points[joined[:, : CELLS[kind].n_corners]]
    inside = np.linalg.norm(corners, axis=2).max(axis=1) < radius * (1 + 1e-9)
    groups = {"core": np.flatnonzero(inside), "rock": np.flatnonzero(~inside)}
    return Mesh(points, mesh.blocks, mesh.facets, groups, mesh.facet_groups, {})


def _rounded(x: np.ndarray) -> np.ndarray:
    """Square rings to round ones: fully from the wall (ring 1) on, gradually inside."""
    ring = np.abs(x).max(axis=1, keepdims=True)
    safe = np.where(ring > 0, ring, 1.0)
    angles = np.tan(np.pi / 4 * x / safe)  # even spacing along the arcs
    round_ = angles / np.maximum(np.linalg.norm(angles, axis=1, keepdims=True), 1e-12) * ring
    weight = np.minimum(ring, 1.0) ** 2
    return weight * round_ + (1 - weight) * 0.75 * x


def _cells(n: tuple[int, ...]) -> np.ndarray:
    """Quads or hexahedra of a grid, in VTK's order."""
    corners = {2: [(0, 0), (1, 0), (1, 1), (0, 1)]}
    corners[3] = [(*c, 0) for c in corners[2]] + [(*c, 1) for c in corners[2]]
    start = np.stack(np.meshgrid(*[np.arange(k) for k in n], indexing="ij"), -1).reshape(-1, len(n))
    strides = np.array([np.prod([k + 1 for k in n[a + 1 :]], dtype=int) for a in range(len(n))])
    return np.stack([(start + np.array(c)) @ strides for c in corners[len(n)]], axis=1)


def split_cells(cells: np.ndarray, kind: str) -> np.ndarray:
    """Cells as they are, or cut into triangles or (Kuhn's) tetrahedra."""
    if kind == "tri3":
        return np.vstack([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    if kind == "tet4" and cells.shape[1] == 8:
        corner = {(0, 0, 0): 0, (1, 0, 0): 1, (1, 1, 0): 2, (0, 1, 0): 3}
        corner |= {(0, 0, 1): 4, (1, 0, 1): 5, (1, 1, 1): 6, (0, 1, 1): 7}
        tets = []
        for p in permutations(range(3)):
            path = [np.zeros(3, int)]
            for axis in p:
                path.append(path[-1] + np.eye(3, dtype=int)[axis])
            t = [corner[tuple(int(v) for v in x)] for x in path]
            even = np.linalg.det(np.eye(3)[list(p)]) > 0
            tets.append(cells[:, t if even else [t[0], t[2], t[1], t[3]]])
        return np.vstack(tets)
    if kind == "wedge6":
        return np.vstack([cells[:, [0, 1, 2, 4, 5, 6]], cells[:, [0, 2, 3, 4, 6, 7]]])
    if kind == "pyramid5":  # cells of nine nodes, the last one in the middle
        inwards = [face[::-1] for face in CELLS["hex8"].faces]
        return np.vstack([cells[:, [*face, 8]] for face in inwards])
    return cells


def _with_centres(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells with a node in their middle."""
    middles = len(points) + np.arange(len(cells))
    return np.vstack([points, points[cells].mean(axis=1)]), np.column_stack([cells, middles])


def cut_by_centres(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hexahedra to 24 tetrahedra each, by centres of cells and faces: conforming on any grid."""
    faces = CELLS["hex8"].faces
    corners = cells[:, faces]
    keys, place = np.unique(np.sort(corners, axis=2).reshape(-1, 4), axis=0, return_inverse=True)
    face_nodes = len(points) + place.reshape(len(cells), 6)
    cell_nodes = len(points) + len(keys) + np.arange(len(cells))
    points = np.vstack([points, points[keys].mean(axis=1), points[cells].mean(axis=1)])
    tets = [
        np.stack([corners[:, f, (k + 1) % 4], corners[:, f, k], face_nodes[:, f], cell_nodes], 1)
        for f in range(6)
        for k in range(4)
    ]
    return points, np.vstack(tets)


def mixed_box(order: int, *, distortion: float = 0.0) -> Mesh:
    """A unit cube of wedges, hexahedra, pyramids and tetrahedra that share their faces.

    Layers across x: wedges, hexahedra, and twice cells with a node in their middle, from which to
    each face goes a pyramid, but two tetrahedra between the last two layers and at x = 1.
    """
    grid = box("hex8", (4, 3, 2), distortion=distortion)
    cells, layer = grid.blocks[0].nodes, np.repeat(np.arange(4), 6)
    points, centred = _with_centres(grid.points, cells[layer >= 2])
    last = layer[layer >= 2] == 3
    pyramids, tets = [], []
    for side, face in enumerate(CELLS["hex8"].faces):
        inwards = centred[:, [*face[::-1], 8]]
        cut = {3: np.ones_like(last), 5: last}.get(side, np.zeros_like(last))  # x = 1, x = -1
        pyramids.append(inwards[~cut])
        first = np.argmin(inwards[cut, :4], axis=1)  # both sides cut through their lowest node
        ring = [inwards[cut, (first + k) % 4] for k in range(4)]
        top = inwards[cut, 4]
        tets += [np.stack([ring[0], ring[k], ring[k + 1], top], axis=1) for k in (1, 2)]
    linear = {
        "wedge6": split_cells(cells[layer == 0], "wedge6"),
        "hex8": cells[layer == 1],
        "pyramid5": np.vstack(pyramids),
        "tet4": np.vstack(tets),
    }
    blocks = linear if order == 1 else {}
    if order == 2:
        raised = {second: linear[first] for second, first in _LINEAR.items() if first in linear}
        points, blocks = _elevate_all(points, raised)
    numbers = np.cumsum([0, *map(len, blocks.values())])
    mesh = Mesh(
        points,
        tuple(
            ElementBlock(kind, nodes, first + 1 + np.arange(len(nodes)))
            for (kind, nodes), first in zip(blocks.items(), numbers[:-1], strict=True)
        ),
        groups={"all": np.arange(numbers[-1])},
    )
    return with_outer_faces(mesh)


def gaping_box(rows: int = 1) -> Mesh:
    """Pairs of bricks along x, a hexahedron and six tetrahedra each without pyramids between.

    The unit cube has so many of these pairs side by side along y.
    """
    grid = box("hex8", (2, rows, 1))
    bricks = grid.blocks[0].nodes
    left = grid.points[bricks].mean(axis=1)[:, 0] < 0.5
    tets = split_cells(bricks[~left], "tet4")
    blocks = (
        ElementBlock("hex8", bricks[left], np.arange(1, 1 + rows)),
        ElementBlock("tet4", tets, np.arange(1 + rows, 1 + 7 * rows)),
    )
    return with_outer_faces(Mesh(grid.points, blocks, groups={"all": np.arange(7 * rows)}))


def _elevate_all(
    points: np.ndarray, cells: dict[str, np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Mid-nodes of second-order kinds, one for each edge of all of them."""
    pairs = [np.sort(rows[:, CELLS[kind].edges], axis=2) for kind, rows in cells.items()]
    flat = np.concatenate([part.reshape(-1, 2) for part in pairs])
    unique, inverse = np.unique(flat, axis=0, return_inverse=True)
    ends = np.cumsum([part.shape[0] * part.shape[1] for part in pairs])[:-1]
    added = np.split(len(points) + inverse.ravel(), ends)
    raised = {
        kind: np.hstack([rows, new.reshape(len(rows), -1)])
        for (kind, rows), new in zip(cells.items(), added, strict=True)
    }
    return np.vstack([points, points[unique].mean(axis=1)]), raised
