"""Makes runs.csv of what `geoident batch campaign.yaml` has computed. Run: python make_table.py.

A row is a run: its parameters with six digits, its readings to a thousandth of a millimetre, as
programs print them.
"""

import csv
from pathlib import Path

import h5py

HERE = Path(__file__).resolve().parent
PARAMETERS = {"E_dam": ("GPa", 1e9), "E_rock": ("GPa", 1e9), "alpha": ("1/K", 1.0)}

with h5py.File(HERE / "campaign.batch" / "campaign.h5") as file:
    names = file["parameters/parameter"].asstr()[:].tolist()
    values = file["parameters/value"][:]
    gauges, stages = (file[f"readings/{name}"].asstr()[:] for name in ("gauge", "stage"))
    readings = file["readings/value"][:]

columns = [names.index(name) for name in PARAMETERS]
with (HERE / "runs.csv").open("w", newline="", encoding="utf-8") as out:
    table = csv.writer(out, lineterminator="\n")
    head = [f"{name} [{unit}]" for name, (unit, _) in PARAMETERS.items()]
    head += [f"{gauge} @ {stage} [mm]" for gauge, stage in zip(gauges, stages, strict=True)]
    table.writerow(["run", *head])
    for number, (p, row) in enumerate(zip(values, readings, strict=True), 1):
        made_with = [
            f"{p[k] / size:.6g}" for k, (_, size) in zip(columns, PARAMETERS.values(), strict=True)
        ]
        table.writerow([number, *made_with, *(f"{1e3 * value:.3f}" for value in row)])
