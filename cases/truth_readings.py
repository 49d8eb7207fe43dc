"""How the readings of the shipped cases come about: see `make_readings`."""

import csv
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from geoident.workflow.simulate import Simulated, simulate


def make_readings(
    folder: Path,
    *,
    mesh: tuple[object, ...],
    seed: int,
    case: str = "case.yaml",
    changes: tuple[str, ...] = (),
    flags: tuple[str, ...] = (),
) -> None:
    """Writes readings.csv of a case: truth.yaml on a finer mesh of quadratic elements, plus noise.

    The shipped mesh has larger elements, mostly linear ones. So the fit meets readings that its own
    model cannot repeat exactly, as it would on a real site.

    Args:
        folder: of the case.
        mesh: options of make_mesh.py for the finer mesh.
        seed: of the noise, which has the accuracy of each gauge.
        case: name of the case that says what the ground of the truth is.
        changes: texts KEY=VALUE that change it further.
        flags: of `geoident simulate`.
    """
    truth = yaml.safe_load((folder / "truth.yaml").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as scratch:
        fine = Path(scratch) / "fine.msh"
        _python(folder / "make_mesh.py", *mesh, "--order", 2, "--output", fine)
        wanted = [f"mesh.file={fine}", "readings=[]", *changes]
        wanted += [f"parameters.{name}.start={value}" for name, value in truth.items()]
        words = [word for change in wanted for word in ("--set", change)]
        words += [*flags, "--noise", "--seed", str(seed), "--force"]
        place = ("-o", folder / "readings.csv")
        _python("-m", "geoident", "simulate", folder / case, *words, *place)
    _round(folder / "readings.csv")


def simulate_truth(
    folder: Path, *, mesh: tuple[object, ...], change: Callable[[dict[str, Any]], None]
) -> Simulated:
    """What the gauges of a case would read in ground that differs from its model, without noise.

    Args:
        folder: of the case.
        mesh: options of make_mesh.py for the mesh of the truth.
        change: is given the case as a mapping of texts, with the parameters of truth.yaml as start
            values, and changes it into the ground that is really there.
    """
    case = yaml.load((folder / "case.yaml").read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
    truth = yaml.load((folder / "truth.yaml").read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
    for name, value in truth.items():
        case["parameters"][name]["start"] = value
    change(case)
    with tempfile.TemporaryDirectory() as scratch:
        fine, path = Path(scratch) / "fine.msh", Path(scratch) / "case.yaml"
        _python(folder / "make_mesh.py", *mesh, "--output", fine)
        case |= {"mesh": {"file": fine.name}, "readings": []}
        path.write_text(yaml.safe_dump(case, sort_keys=False), encoding="utf-8")
        return simulate(str(path))


def _round(file: Path) -> None:
    """Rounds the values to 0.01 mm, as they would be noted."""
    header, *rows = csv.reader(file.read_text(encoding="utf-8").splitlines())
    lines = [header, *([*row[:2], f"{float(row[2]):.2f}", row[3]] for row in rows)]
    file.write_text("".join(",".join(line) + "\n" for line in lines), encoding="utf-8")


def _python(*words: object) -> None:
    subprocess.run([sys.executable, *map(str, words)], check=True)
