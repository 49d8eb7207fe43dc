"""Projects of sections by formulas, in a folder."""

import shutil
from pathlib import Path

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


def example(folder, text=None):
    """A copy of the shipped project; the path of its file.

    Args:
        folder: where to.
        text: of the project in place of its own.
    """
    for path in EXAMPLE.glob("*"):
        if path.suffix in (".yaml", ".csv"):
            shutil.copy(path, folder)
    project = folder / "project.yaml"
    if text is not None:
        project.write_text(text, encoding="utf-8")
    return str(project)
