"""What a field costs: many modes against two parameters, on cases/cavern. Read the ratios.

    python tests/benchmarks/fields.py [MODES ...]

Young's modulus of the rock is a field (sd 30 %, length 20 m) with MODES (default 100 and 200) modes
beside E_rock and K0, which alone are the parameters of the case it is compared with. In turn, so
that both meet the same machine: seconds of the processor, the least of several, for one evaluation
(readings of the fitted stages with their Jacobian), for the survey of all stages, and for a whole
Gauss-Newton fit with its survey; then the same evaluation by tangents, the largest memory so far,
and which functions take the time of an evaluation.
"""

from __future__ import annotations

import cProfile
import pstats
import resource
import sys
import time
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.model.ground import Attitude, RandomField
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Scalar
from geoident.workflow.running.jobs import load_inputs, load_mesh

CASE = Path(__file__).parents[2] / "cases" / "cavern" / "case.yaml"
KEPT = ("E_rock", "K0")
TURNS = 5


def with_numbers(given, values):
    """The same with parameters replaced by numbers."""
    if isinstance(given, Scalar) and given.parameter in values:
        return Scalar(given.factor * values[given.parameter])
    if isinstance(given, dict):
        return {key: with_numbers(one, values) for key, one in given.items()}
    if is_dataclass(given) and not isinstance(given, type):
        parts = {f.name: with_numbers(getattr(given, f.name), values) for f in fields(given)}
        return replace(given, **parts)
    return given


def of_two_parameters(case):
    values = {p.name: p.start for p in case.parameters if p.name not in KEPT}
    return replace(
        case,
        parameters=tuple(p for p in case.parameters if p.name in KEPT),
        materials=with_numbers(case.materials, values),
        in_situ=with_numbers(case.in_situ, values),
    )


def with_field(case, modes):
    rock = case.materials["rock"]
    flat = Attitude(Scalar(0.0), Scalar(np.pi / 2))
    field = RandomField("rock", "E", rock.elastic.E, 0.3, (20.0,), flat, modes=modes)
    return replace(case, materials={**case.materials, "rock": replace(rock, fields=(field,))})


class Fit:
    """A case with what is timed of it."""

    def __init__(self, case, mesh):
        self.model = staged_model(mesh, case, solver=pick_solver("auto"))
        read = [r for r in case.readings if r.stage in case.fit.stages and r.value is not None]
        self.response = self.model.response([(r.channel, r.stage) for r in read])
        sd = {channel.name: channel.accuracy for channel in case.channels}
        self.measured = np.array([r.value for r in read])
        self.sd = np.array([sd[r.channel] for r in read])
        self.start = np.array([p.start for p in self.model.case.parameters])

    def evaluate(self):
        self.response.evaluate(self.start)

    def tangents(self):
        self.response.by_tangents(self.start)

    def survey(self):
        self.model.survey(self.start, fields=True)

    def fit(self):
        parameters = self.model.case.parameters
        problem = Problem(self.response, self.measured, self.sd, parameters)
        outcome = gauss_newton(problem, GaussNewtonOptions(), lambda iteration: None)
        self.model.survey(outcome.values, fields=True)


def least(jobs, turns=TURNS):
    """Seconds of the processor (k,) of some jobs done in turn."""
    best = np.full(len(jobs), np.inf)
    for _ in range(turns):
        for k, job in enumerate(jobs):
            start = time.process_time()
            job()
            best[k] = min(best[k], time.process_time() - start)
    return best


def table(counts):
    """Lines of the table in markdown."""
    inputs = load_inputs(str(CASE))
    case, mesh = of_two_parameters(inputs.case), load_mesh(inputs, inputs.loaded.mesh_path)
    yield "| seconds of | 2 parameters | modes | field | ratio |"
    yield "|---|---|---|---|---|"
    for count in counts:
        plain, field = Fit(case, mesh), Fit(with_field(case, count), mesh)
        for name, turns in (("evaluate", TURNS), ("survey", 3), ("fit", 2)):
            one, other = least([getattr(plain, name), getattr(field, name)], turns)
            yield f"| {name} | {one:.3f} | {count} | {other:.3f} | {other / one:.2f} |"
        tangents = least([field.tangents], 1)[0]
        yield f"| evaluate by tangents | | {count} | {tangents:.3f} | |"
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        yield f"| (largest memory so far, GB) | | {count} | {peak:.2f} | |"


def show_profile(count):
    """Which functions take the time of an evaluation."""
    inputs = load_inputs(str(CASE))
    case, mesh = of_two_parameters(inputs.case), load_mesh(inputs, inputs.loaded.mesh_path)
    field = Fit(with_field(case, count), mesh)
    profile = cProfile.Profile(time.process_time)
    profile.runcall(field.evaluate)
    pstats.Stats(profile).sort_stats("tottime").print_stats(8)


if __name__ == "__main__":
    MODES = [int(argument) for argument in sys.argv[1:]] or [100, 200]
    for line in table(MODES):
        print(line, flush=True)
    show_profile(MODES[-1])
