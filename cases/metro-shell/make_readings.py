"""Makes readings.csv: the truth with a lining of elements on another mesh, plus noise.

Hoop force and moment of that lining come from its stress at two depths, between which it is linear.
Needs gmsh. Run: python make_readings.py
"""

import csv
import sys
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from truth_readings import simulate_truth  # noqa: E402

from geoident.workflow.simulate import with_noise  # noqa: E402

RADIUS, THICKNESS = 3.4, 0.3
DEPTHS = {"in": 0.5 + sqrt(1 / 12), "out": 0.5 - sqrt(1 / 12)}  # Gauss points, in parts of it
CELLS = {"N-crown": ("xx", 0.0, 1.0), "N-wall": ("zz", 1.0, 0.0), "M-crown": ("xx", 0.0, 1.0)}
ACCURACY = {"N": 30e3, "M": 3e3}  # N/m and N, as in case.yaml
SEED = 3


def line_with_elements(case: dict[str, Any]) -> None:
    """Puts sprayed concrete in place of the soil along the wall, and stress cells into it."""
    del case["structures"]
    case["materials"]["concrete"] = {"elastic": "isotropic", "E": "$E_lining", "nu": "0.2"}
    for stage in case["stages"]:
        (dug,) = stage["excavate"]
        stage["excavate"].append(f"lining-{dug}")
        case["groups"][f"lining-{dug}"] = "soil"
        for name in stage.pop("build", []):
            group = name if name == "lining-approach" else name.replace("lining", "lining-round")
            stage["install"] = {group: "concrete"}
    for name, (component, x, z) in CELLS.items():
        del case["gauges"][name]
        for end, depth in DEPTHS.items():
            r = RADIUS - depth * THICKNESS
            case["gauges"][f"{name}-{end}"] = {
                "kind": "stress",
                "point": [f"{r * x} m", "2 m", f"{r * z} m"],
                "components": [component],
                "accuracy": "1 kPa",
            }


def main() -> None:
    mesh = ("--size", 0.8, "--order", 2, "--solid")
    truth = simulate_truth(HERE, mesh=mesh, change=line_with_elements)
    cells = {name: component for name, (component, _, _) in CELLS.items()}
    ends = {f"{name}-{end}.{part}" for name, part in cells.items() for end in DEPTHS}
    exact = {(r.channel, r.stage): r.value or 0.0 for r in truth.readings}
    moved = [r for r in truth.readings if r.channel not in ends]
    table = [(r.channel, r.stage, 1e3 * (r.value or 0.0), "mm")
             for r in with_noise(truth.case, moved, seed=SEED)]  # fmt: skip
    noise = np.random.default_rng(SEED + 1)
    for stage in ("round 2", "round 3", "round 4"):
        for name, part in cells.items():
            inner, outer = (exact[f"{name}-{end}.{part}", stage] for end in DEPTHS)
            value = THICKNESS * (inner + outer) / 2
            if name.startswith("M"):
                value = THICKNESS**2 * (inner - outer) * sqrt(3) / 12
            print(name, stage, value)
            value += ACCURACY[name[0]] * noise.standard_normal()
            table.append((name, stage, 1e-3 * value, "kN/m" if name[0] == "N" else "kNm/m"))
    with (HERE / "readings.csv").open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("gauge", "stage", "value", "unit"))
        rows.writerows((name, stage, f"{value:.2f}", unit) for name, stage, value, unit in table)


if __name__ == "__main__":
    main()
