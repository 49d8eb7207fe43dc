"""A column of clay that consolidates under a load on its drained top, and Terzaghi's series."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from support.in_stages import write_msh
from support.meshes import from_grid

DAY = 86400.0
CELLS = 20
HEIGHT, LOAD, E, K, GAMMA = 5.0, 100e3, 4e6, 2e-9, 9810.0
"""m, Pa, Pa, m/s, N/m3; Poisson's ratio is 0, so that E is the constrained modulus."""

C_V = K * E / GAMMA
"""m2/s: half of the settlement is over after 0.197 HEIGHT^2 / C_V, 70 days."""

CASE = """\
format: geoident-case/1
title: Fill on a layer of clay
analysis: plane-strain
mesh: {{file: column.msh}}
parameters:
  E: {{start: 3 MPa, bounds: [0.5 MPa, 50 MPa], scale: log}}
  k: {{start: 1e-9 m/s, bounds: [1e-11, 1e-7 m/s], scale: log}}
materials:
  clay: {{E: $E, nu: 0, hydraulic: {{permeability: $k, storage: 1e-9 1/kPa}}}}
groups: {{all: clay}}
supports: {{x0: x, x1: x, y0: [x, y]}}
drained: {{y1: {{}}}}
stages:
{stages}
gauges:
  S1: {{kind: settlement, point: [0, 5 m], accuracy: 0.2 mm}}
{more}fit: {{mesh_error: false, backtest: false{fit}}}
"""

FILL = "loads: {fill: {on: y1, pressure: 100 kPa}}"


def write_column(
    folder: Path, *, stages: str, more: str = "", fit: str = "", name: str = "case.yaml"
) -> Path:
    """Write the case and its mesh.

    Args:
        folder: where to.
        stages: YAML of the list of stages.
        more: further keys, each a line with its end.
        fit: further keys of `fit`, beginning with a comma.
        name: of the case.
    """
    up = HEIGHT * (1.0 - np.linspace(1.0, 0.0, CELLS + 1) ** 2)  # fine at the drained top
    points = np.stack(np.meshgrid([0.0, 1.0], up, indexing="ij"), -1).reshape(-1, 2)
    mesh = from_grid("quad8", points, (1, CELLS))
    write_msh(mesh, folder / "column.msh", ["x0", "x1", "y0", "y1"])
    path = folder / name
    path.write_text(CASE.format(stages=stages, more=more, fit=fit), encoding="utf-8")
    return path


def settlement(t: np.ndarray | float, load: float = LOAD) -> np.ndarray:
    """Settlement (m,) of the top at times (m,) s after the load, m (Terzaghi 1925)."""
    odd = np.arange(1, 400, 2)[:, None]
    factor = C_V * np.atleast_1d(np.asarray(t, dtype=float)) / HEIGHT**2
    left = (8.0 / (np.pi * odd) ** 2 * np.exp(-((np.pi * odd / 2.0) ** 2) * factor)).sum(axis=0)
    return load * HEIGHT / E * np.where(factor > 0.0, 1.0 - left, 0.0)
