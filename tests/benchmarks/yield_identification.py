"""How surely and at what cost yield limits are identified, beside the simplex search.

    python tests/benchmarks/yield_identification.py --truths 20 --free 1 2 4 9 --elements 500 2000

For every site, number of free distances and size: random truths, random starts, readings in three
stages. Without noise an identification succeeds if it meets the readings to a ten-thousandth of
their accuracy; with noise of the size of the accuracies (2 % of the largest reading) if its
discrepancy is at most 1 % above that of the truth. The table has the successes, the median and the
largest number of factorizations, and the median time.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.yield_sites import Site, Task, deep_opening, notched_plate, task

from geoident.errors import ModelError
from geoident.identify.problem.methods import identify
from geoident.model.methods import ComplementarityOptions, MethodOptions, SimplexOptions

SITES: dict[str, Callable[..., Site]] = {"opening": deep_opening, "plate": notched_plate}
METHODS: dict[str, MethodOptions] = {
    "complementarity": ComplementarityOptions(),
    "full-space": ComplementarityOptions(formulation="full-space"),
    "simplex": SimplexOptions(),
}
EXACT = 1e-4
WORSE = 1.01


@dataclass(frozen=True)
class AnalysisRun:
    """One identification."""

    success: bool
    factorizations: int
    seconds: float
    excess: float


def attempt(given: Task, options: MethodOptions, *, noise: float) -> AnalysisRun:
    """Identify once; a model without solution anywhere is a failure."""
    counts, begin = given.problem.response.counts, time.perf_counter()
    try:
        phi = identify(given.problem, [options], lambda iteration: None).objective
    except ModelError:
        phi = np.inf
    used = given.problem.response.counts.factorizations - counts.factorizations
    limit = WORSE * given.objective if noise else EXACT**2 * len(given.problem.measured)
    return AnalysisRun(phi <= limit, used, time.perf_counter() - begin, phi / limit)


def runs(site: Site, options: MethodOptions, *, truths: int, noise: float) -> Iterator[AnalysisRun]:
    """One after the other, each with its own truth."""
    for seed in range(truths):
        yield attempt(task(site, seed, noise=noise), options, noise=noise)


def line(label: str, found: list[AnalysisRun]) -> str:
    """A row of the table."""
    good = sum(run.success for run in found)
    factorizations = [run.factorizations for run in found]
    return (
        f"| {label} | {good}/{len(found)} | {np.median(factorizations):.0f} "
        f"| {max(factorizations)} | {np.median([run.seconds for run in found]):.2f} |"
    )


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", type=int, default=20)
    parser.add_argument("--free", type=int, nargs="+", default=[1, 2, 4, 9])
    parser.add_argument("--elements", type=int, nargs="+", default=[500])
    parser.add_argument("--sites", nargs="+", default=list(SITES), choices=list(SITES))
    parser.add_argument("--methods", nargs="+", default=["complementarity"], choices=list(METHODS))
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 1.0])
    parser.add_argument("--layered", action="store_true", help="nine distances in three layers")
    given = parser.parse_args()
    print("| method, site, elements, distances, noise | success | median | most | seconds |")
    print("|---|---|---|---|---|", flush=True)
    for elements in given.elements:
        for free in given.free:
            for name in given.sites:
                layered = given.layered and free == 9
                site = SITES[name](free, elements=elements, layered=layered)
                for noise in given.noise:
                    for method in given.methods:
                        label = f"{method}, {name}, {elements}, {free}, {2.0 * noise:.0f} %"
                        found = list(runs(site, METHODS[method], truths=given.truths, noise=noise))
                        print(line(label, found), flush=True)


if __name__ == "__main__":
    main()
