"""Projects of sections by formulas, in a folder."""

import math
import shutil
from pathlib import Path

from geoident.workflow.simulate import simulate

from . import trench

CASES = Path(__file__).parents[2] / "cases"
EXAMPLE = CASES / "several-sections"

SECTIONS = """\
format: geoident-project/1
title: Two sections
sections:
  - {name: A, case: section.yaml, set: {readings: km-1.csv}, covariates: {GSI: 34}}
  - {name: B, case: section.yaml, set: {readings: km-2.csv}, covariates: {GSI: 52}}
  - {name: C, case: section.yaml, covariates: {GSI: 45}, predict: true}
shared: [K0]
laws:
  E_rock:
    formula: a * exp(b * GSI)
    constants:
      a: {start: 1 GPa, bounds: [0.01 GPa, 20 GPa], scale: log}
      b: {start: 0.03, bounds: [-0.1, 0.2]}
    scatter: none
"""


def without(*names):
    """The text of the shipped project without some of its sections."""
    lines = (EXAMPLE / "project.yaml").read_text(encoding="utf-8").splitlines(keepends=True)
    left = [line for line in lines if not any(f"{{name: {name}," in line for name in names)]
    assert len(lines) - len(left) == len(names)
    return "".join(left)


def example(folder, text=None):
    """A copy of the shipped project; the path of its file.

    Args:
        folder: where to.
        text: of the project in place of its own.
    """
    for path in EXAMPLE.glob("*"):
        if path.suffix in (".yaml", ".csv"):
            shutil.copy(path, folder)
    section = folder / "section.yaml"  # from two starting points in place of ten
    text_of_section = section.read_text(encoding="utf-8")
    assert "radius: 2.5 m}" in text_of_section
    section.write_text(text_of_section.replace("radius: 2.5 m}", "radius: 2.5 m, starts: 2}"))
    project = folder / "project.yaml"
    if text is not None:
        project.write_text(text, encoding="utf-8")
    return str(project)


MESHED = """\
format: geoident-project/1
sections:
  - {name: A, case: fe.yaml, set: {readings: A.csv}, covariates: {GSI: 34}}
  - {name: B, case: fe.yaml, set: {readings: B.csv, in_situ.vertical: 5 MPa}, covariates: {GSI: 52}}
shared: [K0]
laws:
  E:
    formula: a * exp(b * GSI)
    constants:
      a: {start: 1 GPa, bounds: [0.01 GPa, 20 GPa], scale: log}
      b: {start: 0.03, bounds: [-0.1, 0.2]}
    scatter: none
"""


def meshed(folder):
    """A project of two sections on the mesh of the pressure tunnel, elastic; the path of its file.

    Args:
        folder: in which case, mesh and readings are written.
    """
    text = (CASES / "pressure-tunnel" / "case.yaml").read_text()
    shutil.copy(CASES / "pressure-tunnel" / "tunnel.msh", folder)
    head = text[: text.index("parameters:")]
    gauges = text[text.index("gauges:") : text.index("  EX0:")].replace(
        "zero: excavation", "zero: face"
    )
    (folder / "fe.yaml").write_text(
        head + "parameters:\n"
        "  E: {start: 3 GPa, bounds: [0.3 GPa, 60 GPa], scale: log}\n"
        "  K0: {start: 1.0, bounds: [0.3, 3.0]}\n"
        "materials: {rock: {elastic: isotropic, E: $E, nu: 0.25}}\n"
        "groups: {core: rock, rock: rock}\n"
        "supports: {far: [x, y]}\n"
        "in_situ: {model: heim, vertical: 8 MPa, K0: $K0}\n"
        "stages:\n"
        "  - {name: face, excavate: [core], release: {core: 0.6}}\n"
        "  - {name: far on, release: {core: 1.0}}\n"
        + gauges
        + "readings: []\nfit: {model_error: none, mesh_error: false}\n"
    )
    return _read_in_both(folder)


def trenches(folder):
    """The same on the small mesh of `trench.py`.

    Args:
        folder: in which case, mesh and readings are written.
    """
    trench.write_mesh(folder / "trench.inp")
    text = trench.CASE.replace("vertical: 1 MPa", "vertical: 8 MPa")
    fit = "fit: {model_error: none, mesh_error: false, backtest: false}"
    head = text[: text.index("readings:")]
    (folder / "fe.yaml").write_text(f"{head}readings: []\n{fit}\n")
    return _read_in_both(folder)


def _read_in_both(folder):
    for name, gsi, stress in (("A", 34, 8), ("B", 52, 5)):
        said = [
            f"parameters.E.start={0.6 * math.exp(0.045 * gsi)} GPa", "parameters.K0.start=1.4",
            f"in_situ.vertical={stress} MPa",
        ]  # fmt: skip
        found = simulate(str(folder / "fe.yaml"), overrides=said)
        rows = [f"{r.channel},{r.stage},{1e3 * r.value:.6f},mm\n" for r in found.readings]
        (folder / f"{name}.csv").write_text("gauge,stage,value,unit\n" + "".join(rows))
    project = folder / "project.yaml"
    project.write_text(MESHED)
    return str(project)
