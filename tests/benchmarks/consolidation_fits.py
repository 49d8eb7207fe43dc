"""What a fit in time costs beside a stationary one, on one mesh with one thread.

    python tests/benchmarks/consolidation_fits.py [--cells 158] [--model-error]

A strip load on a layer of clay: with water that leaves it (E, k and kh from two gauges at six
times), and without time (nu and E of two layers from six gauges). Readings are those of a truth
with noise; fits begin off it. With 158 by 158 elements there are 150,000 displacements and 25,000
pressures, and 55 steps in time.

Prints one line of JSON for each of the two: seconds of processor time of `geoident fit`, and of one
evaluation with derivatives on a model that is made and has been evaluated once. Then their ratios.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from support.in_stages import model_at, write_msh
from support.meshes import box, regroup

from geoident.workflow.running.jobs import build_model, load_inputs

DAYS = (3, 10, 30, 100, 300, 1000)
PLACES = (1, 3, 5, 7, 10, 15)  # m
SD = 0.1e-3  # m
HEAD = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
groups: {upper: clay, rock: DEEP}
supports: {x0: x, x1: x, y0: fixed}
readings: readings.csv
"""
CONSOLIDATING = """\
parameters:
  E: {start: 10 MPa, bounds: [1 MPa, 100 MPa]}
  k: {start: 1e-8 m/s, bounds: [1e-9 m/s, 1e-6 m/s], scale: log}
  kh: {start: 2e-8 m/s, bounds: [1e-9 m/s, 1e-6 m/s], scale: log}
materials:
  clay: {E: $E, nu: 0.3, hydraulic: {permeability: [$kh, $k]}}
drained: {y1: {}}
stages:
  - {name: load, loads: {q: {on: strip, pressure: 100 kPa}}, lasts: 1000 d}
"""
STATIONARY = """\
parameters:
  E: {start: 10 MPa, bounds: [1 MPa, 100 MPa]}
  E2: {start: 20 MPa, bounds: [1 MPa, 100 MPa]}
  nu: {start: 0.3, bounds: [0.1, 0.45]}
materials:
  clay: {E: $E, nu: $nu}
  deep: {E: $E2, nu: $nu}
stages:
  - {name: load, loads: {q: {on: strip, pressure: 100 kPa}}}
"""
CASES = {
    "consolidating": (CONSOLIDATING, (3.0, 10.0), {"load": [86400.0 * d for d in DAYS[:-1]]}),
    "stationary": (STATIONARY, PLACES, {}),
}
OFF = np.array([1.3, 0.8, 1.2])
"""The truth by the start values."""


def write_case(folder: Path, name: str, cells: int, error: bool) -> Path:
    """A case with its mesh and its readings."""
    text, places, moments = CASES[name]
    head = HEAD.replace("DEEP", "clay" if moments else "deep")
    mesh = box("quad8", (cells, cells), size=(20.0, 10.0))
    mesh = regroup(mesh, upper=lambda centres: centres[:, 1] > 5.0)
    x, y = np.moveaxis(mesh.points[np.concatenate([facets.nodes for facets in mesh.facets])], -1, 0)
    under = (y > 10.0 - 1e-9) & (x < 5.0 + 20.0 / cells)
    mesh.facet_groups["strip"] = np.flatnonzero(under.all(axis=1))
    write_msh(mesh, folder / "m.msh", ["x0", "x1", "y0", "y1", "strip"])
    gauges = [f"  S{x:g}: {{kind: settlement, point: [{x} m, 10 m], accuracy: 0.1 mm}}\n"
              for x in places]  # fmt: skip
    path = folder / "case.yaml"
    rest = "" if error else "fit: {model_error: none}\n"
    path.write_text(head.replace("readings: readings.csv\n", "") + text + "gauges:\n"
                    + "".join(gauges))  # fmt: skip
    model = model_at(path, moments)
    start = np.array([parameter.start for parameter in model.case.parameters])
    values = model.computed(OFF * start)
    values = values + np.random.default_rng(0).normal(0.0, SD, values.shape)
    stages = [f"load + {d} d" for d in DAYS[:-1]] if moments else []
    rows = ["gauge,stage,value,unit"]
    for channel, of_channel in zip(model.case.channels, values, strict=True):
        rows += [
            f"{channel.name},{stage},{1e3 * value:.4f},mm"
            for stage, value in zip([*stages, "load"], of_channel, strict=True)
        ]
    (folder / "readings.csv").write_text("\n".join([*rows, ""]))
    path.write_text(head + rest + text + "gauges:\n" + "".join(gauges))
    return path


def run(name: str, cells: int, error: bool) -> dict[str, float]:
    """Processor time of a fit and of an evaluation, s."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_case(Path(folder), name, cells, error)
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        subprocess.run([sys.executable, "-m", "geoident", "fit", "-q", "-j", "1", str(path)],
                       check=True, stdout=subprocess.DEVNULL)  # fmt: skip
        fit = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        model = build_model(load_inputs(str(path)))
        pairs = [(c.name, s) for c in model.case.channels for s in model.case.stage_names[1:]]
        response = model.response(pairs)
        start = np.array([parameter.start for parameter in model.case.parameters])
        response.evaluate(start)
        since = time.process_time()
        response.evaluate(1.01 * start)
        return {"fit": fit, "evaluation": time.process_time() - since}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=158)
    parser.add_argument("--model-error", action="store_true", help="with the errors of the mesh")
    given = parser.parse_args()
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    found = {name: run(name, given.cells, given.model_error) for name in CASES}
    for name, one in found.items():
        print(json.dumps({"case": name, **one}))
    ratios = {key: found["consolidating"][key] / value
              for key, value in found["stationary"].items()}  # fmt: skip
    print(json.dumps({"ratio": ratios}))


if __name__ == "__main__":
    main()
