"""How the readings of the shipped cases come about: see `make_readings`."""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml


def make_readings(folder: Path, *, mesh: tuple[object, ...], seed: int) -> None:
    """Writes readings.csv of a case: truth.yaml on a finer mesh of quadratic elements, plus noise.

    The shipped mesh has larger elements, mostly linear ones. So the fit meets readings that its own
    model cannot repeat exactly, as it would on a real site.

    Args:
        folder: of the case.
        mesh: options of make_mesh.py for the finer mesh.
        seed: of the noise, which has the accuracy of each gauge.
    """
    truth = yaml.safe_load((folder / "truth.yaml").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as scratch:
        fine = Path(scratch) / "fine.msh"
        _python(folder / "make_mesh.py", *mesh, "--order", 2, "--output", fine)
        changes = [f"mesh.file={fine}", "readings=[]"]
        changes += [f"parameters.{name}.start={value}" for name, value in truth.items()]
        flags = [word for change in changes for word in ("--set", change)]
        flags += ["--noise", "--seed", seed, "--force", "-o", folder / "readings.csv"]
        _python("-m", "geoident", "simulate", folder / "case.yaml", *flags)
    _round(folder / "readings.csv")


def _round(file: Path) -> None:
    """Rounds the values to 0.01 mm, as they would be noted."""
    header, *rows = csv.reader(file.read_text(encoding="utf-8").splitlines())
    lines = [header, *([*row[:2], f"{float(row[2]):.2f}", row[3]] for row in rows)]
    file.write_text("".join(",".join(line) + "\n" for line in lines), encoding="utf-8")


def _python(*words: object) -> None:
    subprocess.run([sys.executable, *map(str, words)], check=True)
