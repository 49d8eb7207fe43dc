"""What a yield law costs in the inner loop of Newton, against a QP solver called for each point.

Run: python tests/benchmarks/projection.py [points]

`first` computes the faces that are met, `again` knows them: Newton calls ten to twenty times a
stage with the same law. `ratio` is the time of piqp (dense, its default accuracy of 1e-8, set up
once and updated for each point) for the yielding points over `again`. Read the ratios, not the
seconds: those depend on the machine and on what else it does.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np
import piqp

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.plastic import (
    Planes,
    coulomb,
    definite,
    isotropic,
    polyhedral,
    principal,
    random_planes,
)

from geoident.fem.yielding.plane_laws import PolyhedralLaw, PrincipalLaw

YIELDING = 0.3
SAMPLE = 300


def seconds(work: Callable[[], object]) -> float:
    begin = perf_counter()
    work()
    return perf_counter() - begin


def yielding(law: PolyhedralLaw | PrincipalLaw, trial: np.ndarray) -> np.ndarray:
    """Trial stresses scaled so that a share of them lies outside."""
    low, high = 0.0, 100.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        share = (law.excess(middle * trial) > 0.0).any(axis=0).mean()
        low, high = (low, middle) if share > YIELDING else (middle, high)
    return high * trial


def by_piqp(elasticity: np.ndarray, planes: Planes, trial: np.ndarray) -> float:
    """Seconds a point of projections (s, SAMPLE) by piqp."""
    inverse = np.linalg.inv(elasticity)
    count = len(planes.normals)
    solver = piqp.DenseSolver()
    solver.setup(
        np.asfortranarray(inverse), np.zeros(len(inverse)), None, None,
        np.asfortranarray(planes.normals), np.full(count, -1e30), planes.distances,
    )  # fmt: skip

    def run() -> None:
        for point in range(trial.shape[1]):
            solver.update(c=-inverse @ trial[:, point])
            solver.solve()

    return seconds(run) / trial.shape[1]


def line(
    name: str, make: Callable[[], PolyhedralLaw | PrincipalLaw], trial: np.ndarray
) -> tuple[PolyhedralLaw | PrincipalLaw, np.ndarray, float]:
    """Print the times of one law."""
    law = make()
    trial = yielding(law, trial)

    def work() -> object:
        projection = law.project(trial)
        return projection.stress, projection.multipliers

    first = seconds(work)
    again = min(seconds(work) for _ in range(7))
    projection = law.project(trial)
    tangent = seconds(lambda: projection.reduction)
    print(
        f"{name:34s} {trial.shape[1]:7d} {projection.yielded.size:7d}"
        f" {1e3 * first:9.1f} {1e3 * again:9.1f} {1e3 * tangent:9.1f}",
        end="",
    )
    return law, trial[:, projection.yielded], again


def polyhedron(count: int, size: int, points: int, hardening: float = 0.0) -> None:
    """One line for random planes, with the ratio to piqp."""
    rng = np.random.default_rng(count)
    planes = random_planes(rng, count, size, hardening=hardening)
    elasticity = definite(rng, size)
    name = f"{count} planes, s = {size}" + (", hardening" if hardening else "")
    trial = rng.normal(size=(size, points))
    _, outside, again = line(name, lambda: polyhedral(elasticity, planes), trial)
    other = by_piqp(elasticity, planes, outside[:, :SAMPLE]) * outside.shape[1]
    print(f" {other / again:9.0f}")


def smooth(size: int, points: int, dilation: float | None) -> None:
    """One line for Mohr-Coulomb in principal stresses."""
    planes = coulomb(0.6, 0.8, tension=0.3, dilation=dilation)
    elasticity = isotropic(1.3, 0.9, size)
    trial = np.random.default_rng(size).normal(size=(size, points))
    name = f"Mohr-Coulomb, s = {size}" + ("" if dilation is None else ", no dilation")
    line(name, lambda: principal(elasticity, planes), trial)
    print()


def main() -> None:
    """Print the table."""
    points = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    print(f"{'':34s} {'points':>7s} {'yield':>7s} {'first ms':>9s} {'again ms':>9s}", end="")
    print(f" {'tangent':>9s} {'ratio':>9s}")
    for count, size in ((4, 3), (12, 4), (16, 4), (40, 4), (24, 6), (100, 6)):
        polyhedron(count, size, points)
    polyhedron(16, 4, points, hardening=0.01)
    for size in (4, 6):
        for dilation in (None, 0.0):
            smooth(size, points, dilation)


if __name__ == "__main__":
    main()
