"""The same back analysis as a user would script it: least squares, finite differences, CalculiX.

    python tests/benchmarks/scripted_loop.py CASE FOLDER [--solver "ITERATIVE CHOLESKY"]

Writes the input of CalculiX for every parameter vector, runs it, reads the displacements at the
nodes where the instruments are, and lets `scipy.optimize.least_squares` vary the five parameters of
the cube (see `cube.py`, which puts nodes at all instruments). Prints one line of JSON: evaluations,
seconds, parameters. CalculiX's conjugate gradients leave errors of 1e-4, so differences are taken
over 2 % of a parameter; with the direct solver less would do, and every run would take longer.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[1]))

from support import calculix

from geoident.fem.solvers import pick_solver
from geoident.forward.model import StagedModel, staged_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh


class Loop:
    """Residuals of the cube by CalculiX."""

    def __init__(self, staged: StagedModel, folder: Path, solver: str) -> None:
        self.staged, self.folder, self.solver = staged, folder, solver
        self.parameters = staged.case.parameters
        self.channels = {channel.name: channel for channel in staged.case.channels}
        self.readings = staged.case.readings
        self.evaluations = 0

    def residuals(self, scaled: np.ndarray) -> np.ndarray:
        """Computed less measured, each in its accuracy, for parameters in parts of their starts."""
        self.evaluations += 1
        values = {p.name: float(x) * p.start for p, x in zip(self.parameters, scaled, strict=True)}
        path = self.folder / "loop.inp"
        calculix.write_first_stage(self.staged, path, values=values, solver=self.solver)
        rows = calculix.solve(path, threads=os.cpu_count() or 1)
        moved = {int(row[0]) - 1: row[1:] for row in rows}
        return np.array([self._residual(r, moved, values) for r in self.readings])

    def _residual(self, reading, moved, values) -> float:
        channel = self.channels[reading.channel]
        if channel.kind == "stress":  # of virgin rock: a parameter itself
            name = {"xx": "s_across", "yy": "s_along", "zz": "s_vertical"}[channel.name[-2:]]
            computed = values[name]
        else:
            motion = moved[self._node(channel.second)] - moved[self._node(channel.first)]
            computed = float(np.dot(channel.direction, motion))
        return (computed - reading.value) / channel.accuracy

    def _node(self, point: tuple[float, ...]) -> int:
        away = np.linalg.norm(self.staged.mesh.points - np.array(point), axis=1)
        return int(away.argmin())


def run(case: str, folder: Path, solver: str) -> dict[str, object]:
    """The whole fit, and what it took."""
    loaded = read_case(case)
    mesh = read_mesh(loaded.mesh_path, dim=3)
    loop = Loop(staged_model(mesh, loaded.case, solver=pick_solver()), folder, solver)
    lower = [p.lower / p.start for p in loop.parameters]
    upper = [p.upper / p.start for p in loop.parameters]
    bounds = np.minimum(lower, upper), np.maximum(lower, upper)
    start = time.perf_counter()
    found = least_squares(loop.residuals, np.ones(len(lower)), bounds=bounds, diff_step=0.02)
    named = {p.name: float(x) * p.start for p, x in zip(loop.parameters, found.x, strict=True)}
    return {
        "evaluations": loop.evaluations,
        "seconds": time.perf_counter() - start,
        "parameters": named,
        "cost": float(found.cost),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("case")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--solver", default="ITERATIVE CHOLESKY")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    print(json.dumps(run(given.case, given.folder, given.solver)))


if __name__ == "__main__":
    main()
