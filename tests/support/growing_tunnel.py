"""A round tunnel in elastic rock (Kirsch) whose readings come day by day."""

from pathlib import Path

import numpy as np

CASE = """\
format: geoident-case/1
title: A round tunnel whose face moves away
analysis: plane-strain
parameters:
  E: {start: 10 GPa, bounds: [1 GPa, 100 GPa], scale: log}
materials:
  rock: {elastic: isotropic, E: $E, nu: 0.25}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 6 MPa, K0: 1.0}
face: {profile: panet}
stages:
  - {name: day 0, excavate: [tunnel], distance: 1 m}
  - {name: day 1, distance: 3 m}
  - {name: day 2, distance: 6 m}
  - {name: day 4, distance: 12 m}
  - {name: day 8, distance: 25 m}
gauges:
  CV0: {kind: convergence, between: [[-3, 0 m], [3, 0 m]], accuracy: 0.1 mm, zero: day 0}
  CV90: {kind: convergence, between: [[0, -3 m], [0, 3 m]], accuracy: 0.1 mm, zero: day 0}
  EX:
    kind: extensometer
    head: [3 m, 0 m]
    anchors: {a3: [6 m, 0 m]}
    accuracy: 0.05 mm
    zero: day 0
readings: readings.csv
fit:
  method: closed-form
  closed-form: {centre: [0, 0 m], radius: 3 m}
  model_error: none
"""
DAYS = {"day 1": 3.0, "day 2": 6.0, "day 4": 12.0, "day 8": 25.0}
HEADER = "gauge,stage,value,unit"


def rows(*days, seed=1, off=None):
    """Lines of readings of a rock of 8 GPa by the closed form, with errors of the gauges.

    Args:
        days: names of their stages.
        seed: of the errors.
        off: name of a channel to what its readings are off, mm.
    """
    lines = []
    for day in days:
        rng = np.random.default_rng([seed, list(DAYS).index(day)])
        share = _panet(DAYS[day]) - _panet(1.0)
        wall = share * 6.0 * 3.0 * 1.25 / 8000.0 * 1000.0  # mm, p a (1 + nu) / E
        # the far anchor, twice the radius away from the centre, has moved half of it
        exact = {"CV0": -2.0 * wall, "CV90": -2.0 * wall, "EX.a3": 0.5 * wall}
        for channel, motion in exact.items():
            sd = 0.05 if channel == "EX.a3" else 0.1
            value = motion + rng.normal(0.0, sd) + (off or {}).get(channel, 0.0)
            lines.append(f"{channel},{day},{value:.4f},mm")
    return lines


def _panet(x):
    """Share of the motion that the wall has made at a distance behind the face (Panet 1995)."""
    return 0.25 + 0.75 * (1.0 - (0.75 * 3.0 / (0.75 * 3.0 + x)) ** 2)


def write_readings(folder, lines):
    text = "\n".join([HEADER, *lines]) + "\n"
    (Path(folder) / "readings.csv").write_text(text, encoding="utf-8")


def write_tunnel(folder, *days, **more):
    (Path(folder) / "case.yaml").write_text(CASE, encoding="utf-8")
    write_readings(folder, rows(*days, **more))
    return Path(folder) / "case.yaml"
