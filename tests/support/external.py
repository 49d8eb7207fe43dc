"""Cases whose readings a small script or a function gives: a round opening by Kirsch's formula."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import qmc

from geoident.errors import InputError
from geoident.forward.external.runs import FailedRun
from geoident.workflow.programs.trust import decided_by, trusting
from geoident.workflow.running.jobs import build_model, load_inputs

SCRIPT = '''\
"""Kirsch (1898): what an opening of 2 m in stressed rock adds to displacements."""
import math


def readings(values):
    E, K = values["E"], values["K0"]
    if K > 2.9:
        raise ArithmeticError("no equilibrium")
    return {name: {stage: part * along(E, K, *where) for stage, part in STAGES.items()}
            for name, where in GAUGES.items()}


STAGES = {"half": 0.5, "open": 1.0}
GAUGES = {"H": (0.0, 2.0, 6.0), "V": (90.0, 2.0, 6.0), "D": (45.0, 2.0, 8.0)}


def along(E, K, angle, near, far):
    """The change of the distance of two points on a ray from the centre."""
    return outwards(E, K, angle, far) - outwards(E, K, angle, near)


def outwards(E, K, angle, r, nu=0.25, p=6e6, a=2.0):
    G, t, s = E / (2 * (1 + nu)), math.radians(angle), (a / r) ** 2
    wave = (1 - K) * (4 * (1 - nu) - s) * math.cos(2 * t)
    return -p * a**2 / (4 * G * r) * ((1 + K) - wave)
'''
PROGRAM = (
    SCRIPT
    + """

E, K = (float(line) for line in open("opening.in"))
found = readings({"E": E * 1e9, "K0": K})
with open("out.csv", "w") as out:
    out.write("stage," + ",".join(found) + "\\n")
    for stage in STAGES:
        out.write(",".join([stage, *(repr(1e3 * found[name][stage]) for name in found)]) + "\\n")
"""
)
TEMPLATE = "{{E [GPa]}}\n{{K0:20.14f}}\n"
READINGS = """\
gauge,stage,value,unit
H,half,0.53,mm
H,open,1.03,mm
V,half,0.62,mm
V,open,1.22,mm
D,half,0.63,mm
D,open,1.31,mm
"""
HEAD = """\
parameters:
  E: {start: 6 GPa, bounds: [1 GPa, 50 GPa], scale: log}
  K0: {start: 1.0, bounds: [0.3, 3.0]}
stages: [{name: half}, {name: open}]
gauges:
  H: {kind: reading, accuracy: 0.02 mm}
  V: {kind: reading, accuracy: 0.02 mm}
  D: {kind: reading, accuracy: 0.02 mm}
readings: readings.csv
fit: {backtest: false}
"""
EXTERNAL = f"""\
format: geoident-case/1
model:
  kind: external
  command: [{sys.executable}, -S, opening.py]
  inputs: {{opening.in: opening.template}}
  files: [opening.py]
  outputs:
    - {{file: out.csv, column: "{{gauge}}", row: {{stage: "{{stage}}"}}, unit: mm}}
"""
PYTHON = """\
format: geoident-case/1
model: {kind: python, function: "opening:readings"}
"""
OWN = """\
format: geoident-case/1
analysis: plane-strain
parameters:
  E: {start: 6 GPa, bounds: [1 GPa, 50 GPa], scale: log}
  K0: {start: 1.0, bounds: [0.3, 3.0]}
materials:
  rock: {elastic: isotropic, E: $E, nu: 0.25}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 6 MPa, K0: $K0}
stages:
  - {name: half, excavate: [tunnel], release: {tunnel: 0.5}}
  - {name: open, release: {tunnel: 1.0}}
gauges:
  H: {kind: extensometer, head: [2 m, 0 m], anchors: {a: [6 m, 0 m]}, accuracy: 0.02 mm}
  V: {kind: extensometer, head: [0 m, 2 m], anchors: {a: [0 m, 6 m]}, accuracy: 0.02 mm}
  D:
    kind: extensometer
    head: [1.4142135623730951 m, 1.4142135623730951 m]
    anchors: {a: [5.656854249492381 m, 5.656854249492381 m]}
    accuracy: 0.02 mm
readings: readings.csv
fit:
  method: closed-form
  closed-form: {centre: [0 m, 0 m], radius: 2 m}
  backtest: false
  model_error: none
"""


def write_case(folder: Path, model: str = EXTERNAL, *, script: str = PROGRAM) -> Path:
    """A case with its script, template and readings; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "opening.py").write_text(script)
    (folder / "opening.template").write_text(TEMPLATE)
    (folder / "readings.csv").write_text(READINGS)
    (folder / "case.yaml").write_text(model + HEAD)
    return folder / "case.yaml"


def trusted():
    """Meanwhile every case may run what it names."""
    return decided_by(trusting(trust=True))


class ArrayRuns:
    """Runs of a function of vectors in this process: a model of one stage."""

    has_jacobian = False
    notes = ()

    def __init__(self, function, n, m):
        self.function, self.n_runs = function, 0
        self.seen, self.provided = np.ones(n, bool), np.ones((1, m), bool)

    def require_trust(self):
        """It may always be run."""
        return ""

    def written(self, p):
        """All digits."""
        return p

    def quantum(self, p):
        """Rounding."""
        return 2.3e-16 * np.abs(p)

    at_once = 1

    def each(self, points, check):
        """Readings (1, m) at all points, in turn."""
        for p in points:
            self.n_runs += 1
            made = self.function(p)
            yield made if isinstance(made, FailedRun) else made[None]


TABLE = """\
format: geoident-case/1
model: {kind: table, file: runs.csv}
"""


def gauge_values(E, K0):
    """Gauge and stage to what the formula gives, m."""
    made = {}
    exec(SCRIPT, made)
    found = made["readings"]({"E": E, "K0": K0})
    return {(gauge, stage): v for gauge, stages in found.items() for stage, v in stages.items()}


def spread_values(count, seed=3, lower=1e9):
    """Moduli, Pa, and K0 of a Latin hypercube."""
    points = qmc.LatinHypercube(2, seed=seed).random(count).tolist()
    return [(lower * (50e9 / lower) ** a, 0.3 + 2.55 * b) for a, b in points]


def runs_text(values):
    """A table of runs of the formula, at moduli and K0."""
    rows = [(n, E, K0, gauge_values(E, K0)) for n, (E, K0) in enumerate(values, 1)]
    head = ",".join(f"{gauge} @ {stage} [mm]" for gauge, stage in rows[0][3])
    lines = [f"run,E [GPa],K0,{head}"]
    for n, E, K0, found in rows:
        words = ",".join(repr(1e3 * v) for v in found.values())
        lines.append(f"{n},{E / 1e9!r},{K0!r},{words}")
    return "\n".join(lines) + "\n"


def write_table_case(folder, count=40, *, seed=3, model=TABLE, lower="1 GPa", readings=READINGS):
    """A case with a table of runs; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    values = spread_values(count, seed, 1e9 * float(lower.split()[0]))
    (folder / "runs.csv").write_text(runs_text(values))
    (folder / "readings.csv").write_text(readings)
    head = HEAD.replace("[1 GPa,", f"[{lower},").replace("3.0]", "2.85]")
    (folder / "case.yaml").write_text(model + head)
    return folder / "case.yaml"


def faults_of(case):
    """What is wrong with a case whose model cannot be built."""
    with pytest.raises(InputError) as caught:
        build_model(load_inputs(str(case)))
    return caught.value.faults


def fault_of(case, code, said):
    """The first of these faults that has a code; its message holds what is to be said."""
    found = faults_of(case)
    fault = next((fault for fault in found if fault.code == code), None)
    assert fault is not None, [str(fault) for fault in found]
    assert said in fault.message
    return fault
