"""A pit dug in steps under a levelling of many points, in ground that is not quite as modelled."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np

from geoident.workflow.simulate import simulate
from tests.support.deck import write_grid

STEPS = 6
"""Of digging, each 2.4 m deep."""

CASE = """\
format: geoident-case/1
title: Pit under many points
analysis: plane-strain
mesh: {file: pit.inp}
parameters:
  E_top: {start: 30 MPa, bounds: [5 MPa, 1000 MPa], scale: log}
  E_base: {start: 300 MPa, bounds: [20 MPa, 5000 MPa], scale: log}
  K0: {start: 0.5, bounds: [0.2, 3]}
materials:
  top: {elastic: isotropic, E: $E_top, nu: 0.3, density: 2000 kg/m3}
  base: {elastic: isotropic, E: $E_base, nu: 0.3, density: 2000 kg/m3}
groups: {%s, top: top, base: base}
supports: {left: x, right: x, bottom: [x, y]}
gravity: 9.81 m/s2
in_situ: {model: geostatic, K0: $K0}
stages: [%s]
gauges:
  L:
    kind: levelling
    accuracy: 0.5 mm
    points: {%s}
readings: %s
fit: {method: gauss-newton, stages: [%s]}
"""
TRUTH = ("parameters.E_top.start=50 MPa", "parameters.E_base.start=200 MPa",
         "parameters.K0.start=0.8")  # fmt: skip


def write_many_channels(
    folder: Path, channels: int, stages: int, *, elements: tuple[int, int] = (60, 50)
) -> Path:
    """The case with its mesh and readings of some stages and the next, which is predicted.

    Args:
        folder: that is made.
        channels: points of the levelling.
        stages: that are fitted, at most five.
        elements: along and down.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _write_mesh(folder / "pit.inp", *elements)
    x = np.linspace(17.0, 110.0, channels)
    path = folder / "case.yaml"
    path.write_text(_case(np.linspace(17.0, 110.0, 100), stages, "[]"))
    shown = simulate(str(path), overrides=TRUTH)
    of = {stage.name: [] for stage in shown.case.stages}
    for reading in shown.readings:
        of[reading.stage].append(1e3 * reading.value)
    rng = np.random.default_rng(3)
    lines = ["gauge,stage,value,unit"]
    for stage, values in of.items():
        exact = np.interp(x, np.linspace(17.0, 110.0, 100), values)
        read = exact * (1.0 + 0.1 * np.sin(x / 20.0)) + rng.normal(0.0, 0.5, channels)
        lines += [f"L.P{k},{stage},{value:.3f},mm" for k, value in enumerate(read.tolist())]
    (folder / "readings.csv").write_text("\n".join(lines) + "\n")
    path.write_text(_case(x, stages, "readings.csv"))
    return path


def _case(x: np.ndarray, stages: int, readings: str) -> str:
    every = [f"s{k}" for k in range(1, stages + 2)]
    return CASE % (
        ", ".join(f"dig{k}: top" for k in range(1, STEPS + 1)),
        ", ".join(f"{{name: {name}, excavate: [dig{name[1:]}]}}" for name in every),
        ", ".join(f"P{k}: [{place:.5f} m, 0 m]" for k, place in enumerate(x.tolist())),
        readings,
        ", ".join(every[:-1]),
    )


def _write_mesh(path: Path, nx: int, ny: int) -> None:
    """120 m by 60 m, the pit 16 m by 14.4 m in its upper left corner, as an Abaqus deck."""
    groups = (*(f"dig{k}" for k in range(1, STEPS + 1)), "top", "base")

    def group_of(x: float, y: float) -> str:
        if x < 16 and y > -14.4:
            return f"dig{int(-y // 2.4) + 1}"
        return "top" if y > -15 else "base"

    write_grid(path, (nx, ny), (120, 60), groups, group_of, low=-60)


_RUN = """\
import atexit, resource, sys
atexit.register(
    lambda: print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, file=sys.stderr)
)
from geoident.cli import main
sys.argv[0] = "geoident"
main()
"""


def cost_of_fit(case: Path, *more: str) -> tuple[float, float]:
    """Processor seconds and largest memory, bytes, of a whole fit in a process of its own."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", _RUN, "fit", str(case), "--fresh", "--force", "-q", *more],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, 1024.0 * float(done.stderr.split()[-1])
