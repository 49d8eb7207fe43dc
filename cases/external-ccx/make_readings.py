"""Makes readings.csv: truth on a finer mesh, plus noise. Run: python make_readings.py."""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml

HERE = Path(__file__).resolve().parent

truth = yaml.safe_load((HERE / "truth.yaml").read_text(encoding="utf-8"))
with tempfile.TemporaryDirectory() as scratch:
    fine = Path(scratch) / "fine.msh"
    make = [sys.executable, HERE / "make_deck.py", "--split", "2", "--output", fine]
    subprocess.run(list(map(str, make)), check=True)
    changes = [f"mesh.file={fine}", "readings=[]"]
    changes += [f"parameters.{name}.start={value}" for name, value in truth.items()]
    words = [word for change in changes for word in ("--set", change)]
    place = ["--noise", "--seed", "1", "--force", "-o", HERE / "readings.csv"]
    command = [sys.executable, "-m", "geoident", "simulate", HERE / "own.yaml", *words, *place]
    subprocess.run(list(map(str, command)), check=True)

rows = list(csv.reader((HERE / "readings.csv").read_text(encoding="utf-8").splitlines()))
lines = [[gauge, stage, f"{float(mm):.2f}", unit] for gauge, stage, mm, unit in rows[1:9]]
with (HERE / "readings.csv").open("w", newline="", encoding="utf-8") as out:
    csv.writer(out, lineterminator="\n").writerows([rows[0], *lines])
