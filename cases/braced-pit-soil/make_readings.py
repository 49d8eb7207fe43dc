"""Makes readings.csv: the truth in ground of another kind and on a finer mesh, plus noise.

The ground of the truth is of Mohr-Coulomb: elastic below its strength with one modulus for loading
and unloading, which grows with depth. Its wall slips as the case says. Noise has all that the
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

# moduli of the slices of ../braced-pit/make_mesh.py, in parts of the mean, downwards
GROWTH = {"clay": (0.7, 0.9, 1.1, 1.3), "sand": (0.8, 0.95, 1.2)}
STRENGTH = {
    "clay": {"cohesion": "10 kPa", "friction": "27 deg", "dilation": "0 deg"},
    "sand": {"cohesion": "1 kPa", "friction": "36 deg", "dilation": "6 deg"},
}
SEED = 2


def yielding(case: dict[str, Any]) -> None:
    """Mohr-Coulomb in slices, each with a modulus of its own, in place of hardening soil."""
    materials, groups, ratios = case["materials"], case["groups"], case["in_situ"]["K0"]
    for layer, parts in GROWTH.items():
        base, ratio = materials.pop(layer), ratios.pop(layer)
        del groups[layer]

        for n, part in enumerate(parts, 1):
            slice_ = f"{layer}-{n}"
            law = {"yield": {"type": "mohr-coulomb", **STRENGTH[layer]}}
            materials[slice_] = {**base, **law, "E": f"{3 * part:.6g} $E50_{layer}", "nu": "0.3"}
            groups[slice_], ratios[slice_] = slice_, ratio
            dug = f"dig-{n + 1}"
            if layer == "clay" and dug in groups:
                groups[dug] = slice_
        case["interfaces"][f"wall-{layer}"]["of"] = f"{layer}-1"


def main() -> None:
    mesh = ("--size", 0.6, "--triangles", "--slices")
    truth = simulate_truth(HERE, mesh=mesh, change=yielding)
    with (HERE / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["gauge", "stage", "value", "unit"])
        for reading in with_noise(truth.case, truth.readings, seed=SEED):
            if reading.value is not None:
                cell = reading.channel.startswith("LC")
                value = f"{1e-3 * reading.value:.1f}" if cell else f"{1e3 * reading.value:.2f}"
                unit = "kN" if cell else "mm"
                table.writerow([reading.channel, reading.stage, value, unit])


if __name__ == "__main__":
    main()
