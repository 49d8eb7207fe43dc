"""How long the reduced model of a case takes for many evaluations, with estimates of its errors.

    python tests/benchmarks/reduced_evaluations.py CASE RESULT [--count 100000]

The reduced model is that of `geoident sample`: of analyses at the fit's answer and, one after the
other, where its error is largest among draws around it. Prints one line of JSON:
seconds to make it and to evaluate it, and how many readings are estimated to be off by no more than
2 % of their accuracy; factorizations before and, none, after it was made.
"""

from __future__ import annotations

import argparse
import json
import time

import h5py
import numpy as np

from geoident.workflow.running.jobs import build_model, load_inputs
from geoident.workflow.running.readings import select_readings
from geoident.workflow.running.reduced_answers import CLOSE, reduced_around

TRAINING = 200
"""Draws among which the analyses of the reduced model are placed."""

AT_ONCE = 500


def run(case: str, result: str, count: int) -> dict[str, float]:
    """Make the reduced model and evaluate it.

    Raises:
        ValueError: the case has none.
    """
    inputs = load_inputs(case)
    model = build_model(inputs)
    readings = select_readings(inputs.case, model)
    used = np.flatnonzero(readings.used)
    response = model.response([readings.pairs[k] for k in used])
    accuracy = {channel.name: channel.accuracy for channel in inputs.case.channels}
    limit = CLOSE * np.array([accuracy[readings.pairs[k][0]] for k in used])
    with h5py.File(result) as file:
        centre = file["parameters/value"][...]
        covariance = file["parameters/covariance"][...]
    random = np.random.default_rng(0)
    points = random.multivariate_normal(centre, covariance, TRAINING + count)
    low, high = (np.array([getattr(p, end) for p in inputs.case.parameters])
                 for end in ("lower", "upper"))  # fmt: skip
    points = np.clip(points, low, high)
    start = time.perf_counter(), time.process_time()
    reduced = reduced_around(response, centre, points[:TRAINING])
    if reduced is None:
        msg = "the case has no reduced model"
        raise ValueError(msg)
    made, factorized = (time.perf_counter(), time.process_time()), model.counts.factorizations
    close = 0
    for first in range(TRAINING, TRAINING + count, AT_ONCE):
        _, error = reduced.estimated(points[first : min(first + AT_ONCE, TRAINING + count)])
        close += int(np.count_nonzero(error <= limit))
    done = time.perf_counter(), time.process_time()
    return {
        "made": made[0] - start[0],
        "made_cpu": made[1] - start[1],
        "seconds": done[0] - made[0],
        "cpu": done[1] - made[1],
        "close": close / (count * len(limit)),
        "factorizations": factorized,
        "factorizations_after": model.counts.factorizations - factorized,
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("case")
    parser.add_argument("result")
    parser.add_argument("--count", type=int, default=100_000)
    given = parser.parse_args()
    print(json.dumps(run(given.case, given.result, given.count)))


if __name__ == "__main__":
    main()
