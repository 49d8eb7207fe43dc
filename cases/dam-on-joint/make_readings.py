"""Makes readings.csv: the truth with a joint that is not the same everywhere, plus noise.

Upstream of the drains its friction and stiffness are higher than downstream, where the numbers of
truth.yaml are those in between. The mesh is finer, of the second order. Noise has all that the
`accuracy` of the case says. Needs gmsh. Run: python make_readings.py
"""

import csv
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from truth_readings import simulate_truth  # noqa: E402

from geoident.workflow.simulate import with_noise  # noqa: E402

PARTS = {"upstream": (1.2, 1.1), "downstream": (0.85, 0.95)}  # of k_s and of phi, of the mean
SEED = 3


def uneven(case: dict[str, Any]) -> None:
    """Two joints in place of one."""
    joint = case["interfaces"].pop("joint")
    phi = float(case["parameters"].pop("phi")["start"].split()[0])
    for side, (stiff, steep) in PARTS.items():
        case["interfaces"][side] = joint | {
            "along": f"joint-{side}",
            "k_n": f"{3 * stiff:g} $k_s",
            "k_s": f"{stiff:g} $k_s",
            "friction": f"{steep * phi:g} deg",
        }
    for stage in case["stages"][1:]:
        stage["water"]["groups"] = list(PARTS)
    for gauge in case["gauges"].values():
        if gauge["kind"] == "joint-meter":
            first = float(gauge["point"][0].split()[0]) < 15.0
            gauge["interface"] = "upstream" if first else "downstream"


def main() -> None:
    truth = simulate_truth(HERE, mesh=("--size", 0.5, "--order", 2), change=uneven)
    with (HERE / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["gauge", "stage", "value", "unit"])
        for reading in with_noise(truth.case, truth.readings, seed=SEED):
            if reading.value is not None:
                value = f"{1e3 * reading.value:.3f}"
                table.writerow([reading.channel, reading.stage, value, "mm"])


if __name__ == "__main__":
    main()
