"""Makes the meshes and the readings of the templates of `geoident init`.

The readings come from the truth below on a finer mesh of quadratic elements, with noise of each
gauge's accuracy. Needs gmsh (`pip install gmsh`). Run: python cases/make_templates.py
"""

import csv
import tempfile
from pathlib import Path

import gmsh
from click.testing import CliRunner

from geoident.cli.app import geoident

TEMPLATES = Path(__file__).resolve().parents[1] / "geoident" / "templates"
DIMENSIONS = {"cavern": 2, "dam": 2, "tunnel": 3, "squeezing": 2, "twin-tunnels": 2}
FINE = {"cavern": 0.5, "dam": 0.6, "tunnel": 0.75, "squeezing": 0.5, "twin-tunnels": 0.6}
ORDER = {"squeezing": 2, "twin-tunnels": 2}  # where ground yields, linear triangles are too stiff
TRUTH = {
    "cavern": {"E_rock": "9 GPa", "K0": "1.5"},
    "dam": {"E_shell": "60 MPa", "E_core": "25 MPa"},
    "tunnel": {"E_rock": "4.5 GPa", "K0": "0.7"},
    "squeezing": {"E_rock": "1.8 GPa", "c": "1.3 MPa"},
    "twin-tunnels": {"E_clay": "80 MPa", "s_u": "80 kPa", "K0_clay": "0.9", "ahead": "0.45"},
    "opening": {"E_rock": "2.4 GPa", "c": "1.1 MPa", "phi": "29 deg"},  # formulas, no mesh
}
# where the ground of the truth is of another kind: here strength that grows with depth
OTHER_GROUND = {
    "twin-tunnels": {
        "materials.clay.yield": "{type: mohr-coulomb, cohesion: 0.7 $s_u, friction: 5 deg}"
    },
}


def make_mesh(geometry: Path, mesh: Path, *, dim: int, size: float = 1.0, order: int = 1) -> None:
    """Meshes a geometry; ``size`` is the factor on its element sizes."""
    gmsh.initialize(["-nopopup", "-v", "2", "-setnumber", "size", str(size)])
    gmsh.open(str(geometry))
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)  # quad8 and hex20
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.model.mesh.generate(dim)
    gmsh.model.mesh.setOrder(order)
    gmsh.write(str(mesh))
    gmsh.finalize()


def make_readings(name: str, mesh: Path | None) -> None:
    """Simulates the truth, on a mesh if one is given, and rounds to 0.01 mm, as would be noted."""
    folder = TEMPLATES / name
    values = [f"parameters.{key}.start={value}" for key, value in TRUTH[name].items()]
    values += [f"{key}={value}" for key, value in OTHER_GROUND.get(name, {}).items()]
    changes = [f"--set={change}" for change in ("readings=[]", *values)]
    changes += [f"--set=mesh.file={mesh}"] if mesh else []
    command = ["simulate", str(folder / "case.yaml"), *changes, "--noise", "--seed", "1"]
    done = CliRunner().invoke(geoident, command)
    if done.exit_code:
        raise SystemExit(done.output)
    header, *rows = csv.reader(done.stdout.splitlines())
    lines = [header, *([*row[:2], f"{float(row[2]):.2f}", row[3]] for row in rows)]
    text = "".join(",".join(line) + "\n" for line in lines)
    (folder / "readings.csv").write_text(text, encoding="utf-8")


def main() -> None:
    for name, dim in DIMENSIONS.items():
        geometry = TEMPLATES / name / f"{name}.geo"
        make_mesh(geometry, geometry.with_suffix(".msh"), dim=dim, order=ORDER.get(name, 1))
        with tempfile.TemporaryDirectory() as scratch:
            fine = Path(scratch) / "fine.msh"
            make_mesh(geometry, fine, dim=dim, size=FINE[name], order=2)
            make_readings(name, fine)
    make_readings("opening", None)


if __name__ == "__main__":
    main()
