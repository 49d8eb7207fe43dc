"""Makes km-*.csv: readings of sections whose law is known, plus noise.

ln E scatters by 0.25 about ln (0.6 GPa) + 0.045 GSI; K0 is 1.4 in all sections.
"""

import csv
import math
from pathlib import Path

import numpy as np

from geoident.workflow.simulate import Noise, simulate

HERE = Path(__file__).resolve().parent
SECTIONS = {  # GSI, vertical stress in MPa
    "km-1": (34, 6.5),
    "km-2": (52, 7.8),
    "km-3": (45, 8.4),
    "km-4": (60, 9.0),
    "km-5": (39, 7.0),
    "km-6": (56, 6.2),
    "km-7": (48, 8.8),
    "km-8": (64, 7.4),
    "km-9": (42, 8.0),
    "km-10": (57, 8.6),
}

rng = np.random.default_rng(7)
for number, (name, (gsi, stress)) in enumerate(SECTIONS.items()):
    modulus = 0.6 * math.exp(0.045 * gsi + 0.25 * rng.normal())
    said = [
        f"parameters.E_rock.start={modulus:.6g} GPa",
        "parameters.K0.start=1.4",
        f"in_situ.vertical={stress} MPa",
    ]
    found = simulate(
        str(HERE / "section.yaml"), overrides=said, noise=Noise.ACCURACY, draw=False, seed=number
    )
    with (HERE / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["gauge", "stage", "value", "unit"])
        for reading in found.readings:
            writer.writerow([reading.channel, reading.stage, f"{1e3 * reading.value:.2f}", "mm"])
