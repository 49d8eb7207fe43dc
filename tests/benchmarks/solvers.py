"""How good the order of the unknowns is, and how fast the solvers are. Read the ratios.

    python tests/benchmarks/solvers.py [SIZE]
    python tests/benchmarks/solvers.py cube [CELLS...]

SIZE (default 1) scales the number of nodes. For three meshes (a box of tet4; a cloud of points as
tet10, with slivers; a graded square of tri6) filled with springs it prints the time of the order
and, against the order that CHOLMOD finds itself (approximate minimum degree), the ratio of the
entries of the factor and of the operations (the sum of squared columns). Below 1 our order is
better. Then, for every installed solver: seconds for the analysis, the factorization, and the
solution of 1 and of 32 right-hand sides, each the best of three, and the relative residual.

``cube`` makes the stiffness of elastic cubes of tet10 instead, of so many cells a side (10 and 18
where none are given: 28,000 and 152,000 unknowns), and tells of every installed solver the seconds
of the clock and of the processors for a factorization (the better of two), the operations a second,
the seconds for 1 and for 32 right-hand sides, and the memory of the process at its largest. Each
is run in a process of its own.
"""

from __future__ import annotations

import itertools
import multiprocessing
import resource
import sys
import time

import numpy as np
import scipy.sparse as sp
from scipy.spatial import Delaunay

from geoident.fem.kinematics import block_geometry, kinematics_of
from geoident.fem.orientation import oriented
from geoident.fem.solvers import pick_solver, solver_report
from geoident.fem.solvers.direct import LowerPattern
from geoident.fem.solvers.factor_cost import factor_cost
from geoident.fem.solvers.ordering import nested_dissection
from geoident.fem.stiffness import group_blocks, node_graph, stiffness_pattern
from geoident.model.case import Analysis
from geoident.model.mesh import ElementBlock, Mesh


def box(n):
    rng = np.random.default_rng(0)
    corners = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    cells = corners[(corners < n).all(axis=1)]
    number = np.array([(n + 1) ** 2, n + 1, 1])
    tets = [
        np.column_stack([cells @ number + sum(number[list(path[:k])]) for k in range(4)])
        for path in itertools.permutations(range(3))
    ]
    return corners + rng.uniform(-0.2, 0.2, corners.shape), np.concatenate(tets)


def cloud(n, dim, power):
    points = np.random.default_rng(0).uniform(-1, 1, (n, dim))
    points = np.sign(points) * np.abs(points) ** power
    return quadratic(points, Delaunay(points).simplices.astype(np.int64))


def quadratic(points, elements):
    pairs = list(itertools.combinations(range(elements.shape[1]), 2))
    edges = np.sort(np.concatenate([elements[:, list(pair)] for pair in pairs]), axis=1)
    edges, which = np.unique(edges, axis=0, return_inverse=True)
    middle = which.reshape(len(pairs), -1).T + len(points)
    return np.vstack([points, points[edges].mean(axis=1)]), np.hstack([elements, middle])


def graph_of(n, elements):
    k = elements.shape[1]
    pairs = np.repeat(elements, k, axis=1).ravel(), np.tile(elements, (1, k)).ravel()
    return sp.csr_array((np.ones(pairs[0].size), pairs), shape=(n, n))


def springs(points, graph):
    """Stiffness of springs along all edges of the graph, each node also held a little."""
    n, dim = points.shape
    edge = sp.coo_array(sp.triu(graph, 1))
    along = points[edge.col] - points[edge.row]
    along /= np.linalg.norm(along, axis=1)[:, None]
    dofs = [end[:, None] * dim + np.arange(dim) for end in (edge.row, edge.col)]
    rows = np.repeat(np.arange(edge.row.size), 2 * dim)
    stretch = sp.csr_array((np.hstack([-along, along]).ravel(), (rows, np.hstack(dofs).ravel())))
    return sp.csr_array(stretch.T @ stretch + 1e-3 * sp.eye_array(n * dim))


def lower(matrix, order):
    triangle = sp.csc_array(sp.tril(matrix[order][:, order]))
    triangle.sort_indices()
    indptr, indices = (np.asarray(a, dtype=np.int64) for a in (triangle.indptr, triangle.indices))
    return LowerPattern(indptr, indices), triangle.data


def columns(graph, order=None):
    """Entries in every column of the factor of a matrix with this graph."""
    from cvxopt import cholmod, matrix, spmatrix  # noqa: PLC0415

    n = graph.shape[0]
    permuted = graph if order is None else graph[order][:, order]
    triangle = sp.coo_array(sp.tril(permuted))
    values = np.where(triangle.row == triangle.col, float(n), -1.0)
    rows, cols = (matrix(a.astype(np.int64)) for a in (triangle.row, triangle.col))
    lower_half = spmatrix(matrix(values), rows, cols, (n, n))
    cholmod.options.update({"supernodal": 0, "nmethods": 0 if order is None else 1})
    given = () if order is None else (matrix(np.arange(n)),)
    factor = cholmod.symbolic(lower_half, *given)
    cholmod.numeric(lower_half, factor)
    return np.diff(np.asarray(cholmod.getfactor(factor).CCS[0]).ravel()).astype(float)


def best(action, repeats=3):
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = action()
        seconds.append(time.perf_counter() - start)
    return result, min(seconds)


def run(name, points, elements):
    graph = graph_of(len(points), elements)
    links = graph.indptr.astype(np.int64), graph.indices.astype(np.int64)
    order, seconds = best(lambda: nested_dissection(points, *links))
    print(f"\n{name}: {len(points)} nodes, {graph.nnz} links, ordered in {seconds:.3f} s")
    if any(info.name == "cholmod" and info.available for info in solver_report()):
        ours, theirs = columns(graph, order), columns(graph)
        entries, work = ours.sum() / theirs.sum(), (ours**2).sum() / (theirs**2).sum()
        print(f"  against minimum degree: entries {entries:.2f}, operations {work:.2f}")
    dim = points.shape[1]
    matrix = springs(points, graph)
    dofs = (order[:, None] * dim + np.arange(dim)).ravel()
    for info in solver_report():
        if info.available:
            time_solver(info.name, matrix[dofs][:, dofs], *lower(matrix, dofs))


def time_solver(name, matrix, pattern, values):
    rhs = np.random.default_rng(0).normal(size=(pattern.n, 32))
    analysis, analyse = best(lambda: pick_solver(name).analyse(pattern))
    factor, factorize = best(lambda: analysis.factorize(values))
    _, one = best(lambda: factor.solve(rhs[:, :1]))
    solution, many = best(lambda: factor.solve(rhs))
    error = np.abs(matrix @ solution - rhs).max() / np.abs(matrix).max() / np.abs(solution).max()
    print(
        f"  {name:8s} {pattern.n} unknowns: analyse {analyse:.3f}, factorize {factorize:.3f}, "
        f"solve 1 {one:.3f}, 32 {many:.3f} s, residual {error:.0e}"
    )


def cube_system(cells):
    """Pattern and values of an elastic cube of tet10 on rollers, E = 10 GPa, nu = 0.25."""
    points, elements = quadratic(*box(cells))
    elements = elements[:, [0, 1, 2, 3, 4, 7, 5, 6, 8, 9]]  # middles of edges in VTK's order
    mesh = Mesh(points, (ElementBlock("tet10", elements, np.arange(len(elements))),))
    kinematics = kinematics_of(Analysis.SOLID)
    mesh = oriented(mesh, kinematics)
    order = nested_dissection(points, *node_graph(mesh))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    geometry = (block_geometry(mesh.points, mesh.blocks[0], kinematics),)
    blocks = {0: group_blocks(mesh, geometry, np.arange(len(elements)), rank)}
    fixed = (points < 0.3).ravel()
    pattern = stiffness_pattern(blocks, node_of_rank=order, fixed=fixed, dim=3)
    shear, lame = 4e9, 4e9
    moduli = np.diag(np.repeat([2.0, 1.0], 3)) * shear
    moduli[:3, :3] += lame
    return pattern.lower, pattern.values(blocks, {0: kinematics.stiffness_map(moduli)})


def cube_solver(cells, name):
    """One solver on one cube; prints a line."""
    pattern, values = cube_system(cells)
    solver = pick_solver(name)
    rhs = np.random.default_rng(0).normal(size=(pattern.n, 32))
    analysis = solver.analyse(pattern)
    work = factor_cost(pattern, np.arange(pattern.n) // 3).flops
    taken = []
    for _ in range(2):
        start, busy = time.perf_counter(), time.process_time()
        factor = analysis.factorize(values)
        taken.append((time.perf_counter() - start, time.process_time() - busy))
    seconds, busy = min(taken)
    _, one = best(lambda: factor.solve(rhs[:, :1]), 2)
    _, many = best(lambda: factor.solve(rhs), 2)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"  {name:8s} factorize {seconds:.2f} s (processors {busy:.2f} s), "
        f"{work / seconds / 1e9:.0f} GFlop/s, solve 1 {one:.2f}, 32 {many:.2f} s, "
        f"{peak:.2f} GB",
        flush=True,
    )


def cubes(sizes):
    installed = [info.name for info in solver_report() if info.available]
    names = [name for name in installed if name != "splu"]
    for cells in sizes:
        pattern, _ = cube_system(cells)
        work = factor_cost(pattern, np.arange(pattern.n) // 3)
        print(
            f"\ncube of {cells}^3 cells: {pattern.n} unknowns, {work.flops / 1e9:.1f} GFlop, "
            f"{work.entries / 1e6:.0f} million entries",
            flush=True,
        )
        # SuperLU takes ten times as long as the others.
        for name in (*names, *(["splu"] if work.flops < 2e10 else [])):
            process = multiprocessing.get_context("spawn").Process(
                target=cube_solver, args=(cells, name)
            )
            process.start()
            process.join()


def main():
    if sys.argv[1:2] == ["cube"]:
        cubes([int(cells) for cells in sys.argv[2:]] or [10, 18])
        return
    size = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    run("box of tet4", *box(round(20 * size ** (1 / 3))))
    run("cloud of tet10", *cloud(round(1200 * size), 3, 1.0))
    run("graded square of tri6", *cloud(round(6000 * size), 2, 1.7))


if __name__ == "__main__":
    main()
