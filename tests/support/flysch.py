"""Monitored sections of a tunnel in flysch whose ground is none of geoident's models.

The closure of a wall follows the regression of Hoek and Marinos (2000) over finite element analyses
in the strength of the rock mass, the profile along the tunnel is that of Corbetta et al. (1991),
the ground creeps (Sulem, Panet & Guenot 1987) while the face advances and stops, and a lining that
was closed behind the face yields at its capacity. Sections are oval, each in its own way. Readings
of a tape have errors that drift, and one that all share: that of the first reading.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

RADIUS, GAMMA, UCS, MI = 4.0, 0.026, 20.0, 8.0  # m, MN/m3, MPa, -
FAR = 120.0  # m behind the face, where the last reading is taken
TAPE, DRIFT, FIRST, ROD = 0.5, 0.4, 0.7, 0.3  # mm
ANCHORS = {"EX.a2": 2.0, "EX.a5": 5.0}  # depths, m
COLUMNS = ("H", "V", *ANCHORS)


@dataclass(frozen=True)
class Section:
    """What is known of a section, and what was read there.

    Args:
        mapped: GSI that was mapped at the face.
        cover: m.
        days: (k,) of the readings since the face has passed; the first one is the zero.
        distances: (k,) of the face then, m.
        readings: (k - 1, 4) changes since the first reading, mm: H, V, EX.a2, EX.a5.
        true: the same without errors of the instruments.
    """

    mapped: float
    cover: float
    days: np.ndarray
    distances: np.ndarray
    readings: np.ndarray
    true: np.ndarray


def closure(strength, stress, pressure):
    """Closure by radius of a tunnel in rock that yields (Hoek & Marinos 2000)."""
    part = min(pressure / stress, 0.6)
    return 0.01 * (0.2 - 0.25 * part) * (strength / stress) ** (2.4 * part - 2.0)


def wall(strength, stress, distance, day, *, creep, stiffness, capacity, lined_at, at_lining):
    """Motion of the wall, m, supported from where it was `at_lining`, m, at distance `lined_at`."""
    profile = 0.29 + 0.71 * (1.0 - np.exp(-1.5 * (max(distance, 0.0) / RADIUS) ** 0.7))
    growth = 1.0 + creep * (1.0 - (2.0 / (2.0 + max(day, 0.0))) ** 0.3)

    def moved(pressure):
        return RADIUS * profile * growth * closure(strength, stress, pressure)

    if distance <= lined_at:
        return moved(0.0)
    low, high = at_lining, moved(0.0)
    for _ in range(50):
        middle = 0.5 * (low + high)
        pressure = min(stiffness * max(middle - at_lining, 0.0) / RADIUS, capacity)
        low, high = (middle, high) if moved(pressure) > middle else (low, middle)
    return max(0.5 * (low + high), at_lining)


def advance(rng):
    """Days and distances (k,) of the readings of a section."""
    first = rng.uniform(2.0, 8.0)
    ways = first + np.array([0.0, 3.0, 7.0, 13.0, 24.0])
    rate = rng.uniform(1.0, 2.5)  # m in a day
    stop = rng.integers(2, 5)  # the face stands between these readings
    days = ways / rate + np.where(np.arange(len(ways)) >= stop, rng.uniform(3.0, 15.0), 0.0)
    return np.append(days, days[-1] + FAR / rate), np.append(ways, FAR)


def sections(seed, count=15):
    """Sections of one tunnel.

    Args:
        seed: of the ground, its law and its readings.
        count: how many.
    """
    rng = np.random.default_rng(seed)
    shift, creep = rng.normal(-2.0, 2.0), rng.uniform(0.2, 0.5)
    made = []
    for _ in range(count):
        mapped, cover = round(rng.uniform(28.0, 48.0), 0), round(rng.uniform(120.0, 360.0), 0)
        gsi = mapped + shift + rng.normal(0.0, 2.5)
        ucs = UCS * np.exp(rng.normal(0.0, 0.2))
        strength = 0.0034 * MI**0.8 * ucs * (1.029 + 0.025 * np.exp(-0.1 * MI)) ** gsi
        days, distances = advance(rng)
        lined_at = rng.uniform(1.5, 4.0)
        support = {
            "creep": creep * np.exp(rng.normal(0.0, 0.2)),
            "stiffness": 60.0 * np.exp(rng.normal(0.0, 0.2)),
            "capacity": 0.2,
            "lined_at": lined_at,
        }
        stress = GAMMA * cover

        def motion(distance, day, at_lining=0.0, *, strength=strength, stress=stress, s=support):
            return wall(strength, stress, distance, day, at_lining=at_lining, **s)

        lined_on = lined_at / distances[1] * days[1]
        at_lining = motion(lined_at, lined_on)
        u = 1e3 * np.array([motion(x, t, at_lining) for x, t in zip(distances, days, strict=True)])
        oval, decay = rng.normal(0.0, 0.1), rng.uniform(1.1, 1.6)
        rods = [u * (1.0 - (RADIUS / (RADIUS + depth)) ** decay) for depth in ANCHORS.values()]
        moved = np.column_stack([-2.0 * u * (1.0 + oval), -2.0 * u * (1.0 - oval), *rods])
        true = moved[1:] - moved[0]
        made.append(Section(mapped, cover, days, distances, true + _errors(rng, len(days)), true))
    return made


def _errors(rng, count):
    """Errors (count - 1, 4) of readings, mm."""
    own = np.array([TAPE, TAPE, ROD, ROD]) * rng.normal(size=(count, 4))
    own[0] = 0.0
    drift = np.zeros((count, 4))
    for k in range(1, count):  # from reading to reading, correlated by a half
        drift[k] = 0.5 * drift[k - 1] + np.sqrt(0.75) * DRIFT * rng.normal(size=4)
    drift[:, 2:] = 0.0
    first = np.array([FIRST, FIRST, ROD, ROD]) * rng.normal(size=4)
    return np.round(own + drift + first, 1)[1:]


CASE = """\
format: geoident-case/1
title: A section in flysch
analysis: plane-strain
parameters:
  E: {{start: 0.5 GPa, bounds: [0.01 GPa, 50 GPa], scale: log}}
  w_panet: {{start: 0.333, bounds: [-0.6, 1.6], prior: {{mean: 0.333, sd: 0.47}}}}
  w_chern: {{start: 0.333, bounds: [-0.6, 1.6], prior: {{mean: 0.333, sd: 0.47}}}}
materials:
  flysch: {{elastic: isotropic, E: $E, nu: 0.25}}
groups: {{rock: flysch, tunnel: flysch}}
in_situ: {{model: heim, vertical: {stress:.4g} MPa, K0: 1.0}}
face:
  profile: vlachopoulos-diederichs
  radius: 4 m
  plastic_radius: 8 m
  averaged_with: {{panet: $w_panet, chern: $w_chern}}
stages:
{stages}
dates: {{{dates}}}
gauges:
  H: {{kind: convergence, between: [[-4, 0 m], [4, 0 m]], accuracy: 0.7 mm, zero: first}}
  V: {{kind: convergence, between: [[0, -4 m], [0, 4 m]], accuracy: 0.7 mm, zero: first}}
  EX:
    kind: extensometer
    head: [4 m, 0 m]
    anchors: {{a2: [6 m, 0 m], a5: [9 m, 0 m]}}
    accuracy: 0.4 mm
    zero: first
readings: {readings}
fit:
  method: closed-form
  closed-form: {{centre: [0, 0 m], radius: 4 m, starts: 1}}
  backtest: false
  model_error: {model_error}
"""
"""A section by the closed form of a round opening, as an engineer would write it."""

LAW = """\
format: geoident-case/1
title: A section in flysch
model:
  kind: convergence-law
  face: {{{face}}}
  sections: {{A: {{chainage: 0 m, excavated: 2024-03-01}}}}
  C_inf: $C
  X: $X
  m: $m
  T: $T
  n: 0.3
parameters:
  C: {{start: 80 mm, bounds: [1 mm, 2000 mm], scale: log}}
  X: {{start: 8 m, bounds: [1 m, 60 m], scale: log}}
  m: {{start: 0.5, bounds: [0, 10]}}
  T: {{start: 3 days, bounds: [0.1 days, 200 days], scale: log}}
dates: {{{dates}}}
gauges:
  H: {{kind: reading, accuracy: 0.7 mm, zero: first}}
  V: {{kind: reading, accuracy: 0.7 mm, zero: first}}
readings: {readings}
fit:
  backtest: false
  model_error: {model_error}
"""
"""The same by the convergence law; positive where the wall closes."""

OPENING_PROJECT = """\
format: geoident-project/1
title: Sections in flysch
sections:
{sections}
shared: [w_panet, w_chern]
laws:
  E:
    formula: a * exp(b * (mapped - 38) + c * log(cover / 250))
    constants:
      a: {{start: 0.5 GPa, bounds: [0.01 GPa, 20 GPa], scale: log}}
      b: {{start: 0.05, bounds: [-0.1, 0.3]}}
      c: {{start: 0, bounds: [-4, 4]}}
    scatter: estimate
"""

LAW_PROJECT = """\
format: geoident-project/1
title: Sections in flysch
sections:
{sections}
shared: [X, m, T]
laws:
  C:
    formula: a * exp(b * (mapped - 38) + c * log(cover / 250))
    constants:
      a: {{start: 80 mm, bounds: [1 mm, 1000 mm], scale: log}}
      b: {{start: -0.05, bounds: [-0.3, 0.1]}}
      c: {{start: 1, bounds: [-2, 6]}}
    scatter: estimate
"""


def write_project(
    folder: Path,
    ground: list[Section],
    *,
    opening=True,
    early=(),
    predicted=(),
    first=2,
    model_error="estimate",
):
    """The files of a project; the path of its file.

    Args:
        folder: where to.
        ground: the sections.
        opening: by the closed form of a round opening; else by the convergence law.
        early: numbers of those of which only the first readings are used.
        predicted: numbers of those that are left out.
        first: how many readings these are.
        model_error: what the cases say of it.
    """
    rows = []
    for n, one in enumerate(ground):
        name = f"S{n + 1}"
        names = ["first", *(f"r{k}" for k in range(1, len(one.days) - 1)), "far"]
        start = np.datetime64("2024-03-01T00:00")
        dates = [start + np.timedelta64(int(60 * 24 * t), "m") for t in one.days]
        excavate = "excavate: [tunnel], "
        stages = [
            f"  - {{name: {stage}, {excavate * (stage == 'first')}distance: {x:.3f} m}}"
            for stage, x in zip(names, one.distances, strict=True)
        ]
        text = (CASE if opening else LAW).format(
            stress=GAMMA * one.cover,
            stages="\n".join(stages),
            face=", ".join(f"{a}: {x:.3f} m" for a, x in zip(names, one.distances, strict=True)),
            dates=", ".join(
                f"{a}: {str(b).replace('T', ' ')}" for a, b in zip(names, dates, strict=True)
            ),
            readings=f"{name}.csv",
            model_error=model_error,
        )
        text += f"  stages: [{', '.join(names[1 : 1 + first])}]\n" if n in early else ""
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["gauge", "stage", "value", "unit"])
            for gauge, column in zip(COLUMNS if opening else "HV", one.readings.T, strict=False):
                for stage, value in zip(names[1:], column, strict=True):
                    writer.writerow([gauge, stage, f"{value if opening else -value:.1f}", "mm"])
        left = ", predict: true" if n in predicted else ""
        known = f"mapped: {one.mapped:g}, cover: {one.cover:g} m"
        rows.append(f"  - {{name: {name}, case: {name}.yaml, covariates: {{{known}}}{left}}}")
    path = folder / "project.yaml"
    text = (OPENING_PROJECT if opening else LAW_PROJECT).format(sections="\n".join(rows))
    path.write_text(text, encoding="utf-8")
    return path


TABLE = """\
format: geoident-case/1
title: A section in flysch by runs of another program
model: {{kind: table, file: runs.csv}}
parameters:
  E: {{start: 1 GPa, bounds: [0.2 GPa, 5 GPa], scale: log}}
  c: {{start: 0.2 MPa, bounds: [0.05 MPa, 0.8 MPa], scale: log}}
dates: {{{dates}}}
stages: [{stages}]
gauges:
  H: {{kind: reading, accuracy: 0.7 mm}}
  V: {{kind: reading, accuracy: 0.7 mm}}
  a2: {{kind: reading, accuracy: 0.4 mm}}
  a5: {{kind: reading, accuracy: 0.4 mm}}
readings: readings.csv
fit: {{stages: [{fitted}], backtest: false, model_error: {model_error}}}
"""
"""A section whose model is a table of runs."""


def write_table(folder: Path, one: Section, rng, *, runs=150, fitted=3, model_error="estimate"):
    """A case whose model is a table of runs of `characteristic_lines`; the path of its file.

    Args:
        folder: where to.
        one: the section; its stages after the first few are predicted.
        rng: of the Latin hypercube.
        runs: how many.
        fitted: stages that are used.
        model_error: what the case says of it.
    """
    cube = (np.array([rng.permutation(runs) for _ in range(2)]).T + 0.5) / runs
    E = 0.2 * (5.0 / 0.2) ** (1.02 * cube[:, 0] - 0.01)
    c = 0.05 * (0.8 / 0.05) ** (1.02 * cube[:, 1] - 0.01)
    names = [*(f"r{k}" for k in range(1, len(one.days) - 1)), "far"]
    gauges = ("H", "V", "a2", "a5")
    start = np.datetime64("2024-03-01T00:00")
    dates = [start + np.timedelta64(int(60 * 24 * t), "m") for t in one.days[1:]]
    text = TABLE.format(
        stages=", ".join(f"{{name: {name}}}" for name in names),
        fitted=", ".join(names[:fitted]),
        dates=", ".join(
            f"{a}: {str(b).replace('T', ' ')}" for a, b in zip(names, dates, strict=True)
        ),
        model_error=model_error,
    )
    with (folder / "runs.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        columns = [f"{gauge} @ {name} [mm]" for gauge in gauges for name in names]
        writer.writerow(["run", "E [GPa]", "c [MPa]", *columns])
        for k in range(runs):
            u = 1e3 * characteristic_lines(1e3 * E[k], c[k], GAMMA * one.cover, one.distances)
            moved = u[1:] - u[0]
            rods = [moved * (1.0 - RADIUS / (RADIUS + depth)) for depth in ANCHORS.values()]
            values = np.concatenate([2.0 * moved, 2.0 * moved, *rods])
            writer.writerow([k + 1, f"{E[k]:.6g}", f"{c[k]:.6g}", *(f"{v:.6g}" for v in values)])
    with (folder / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["gauge", "stage", "value", "unit"])
        for gauge, column in zip(gauges, np.abs(one.readings.T), strict=True):
            for name, value in zip(names, column, strict=True):
                writer.writerow([gauge, name, f"{value:.1f}", "mm"])
    path = folder / "case.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def characteristic_lines(E, c, stress, distances, *, friction=24.0, nu=0.25, lined_at=3.0):
    """Motions (k,) of the wall of a tunnel, m, by convergence and confinement.

    Duncan Fama (1993) for the ground, Vlachopoulos & Diederichs (2009) for the profile, and a
    lining with a stiffness and a capacity.

    Args:
        E: MPa.
        c: cohesion, MPa.
        stress: in the ground, MPa.
        distances: (k,) of the face, m.
        friction: degrees.
        nu: Poisson's ratio.
        lined_at: distance at which the lining is closed, m.
    """
    sine = np.sin(np.radians(friction))
    k, strength = (1.0 + sine) / (1.0 - sine), 2.0 * c * np.cos(np.radians(friction)) / (1.0 - sine)
    critical = (2.0 * stress - strength) / (1.0 + k)

    def ground(p):
        """Motion of the wall and plastic radius by that of the tunnel."""
        elastic = RADIUS * (1.0 + nu) / E * (stress - p)
        if p >= critical:
            return elastic, 1.0
        held = (k - 1.0) * p + strength
        reach = (2.0 * (stress * (k - 1.0) + strength) / ((1.0 + k) * held)) ** (1.0 / (k - 1.0))
        lost = 2.0 * (1.0 - nu) * (stress - critical) * reach**2
        return RADIUS * (1.0 + nu) / E * (lost - (1.0 - 2.0 * nu) * (stress - p)), reach

    last, reach = ground(0.0)
    at_face = np.exp(-0.15 * reach) / 3.0

    def under(aim, line=lambda u: 0.0):
        """Motion at which ground and support are in balance with a part of the stress."""
        low, high = 0.0, stress
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if ground(middle)[0] < aim else (middle, high)
        face = low
        low, high = 0.0, stress - face
        for _ in range(40):
            middle = 0.5 * (low + high)
            more = line(ground(face + middle)[0]) > middle
            low, high = (middle, high) if more else (low, middle)
        return ground(face + low)[0]

    def free(x):
        return last * (1.0 - (1.0 - at_face) * np.exp(-1.5 * x / (RADIUS * reach)))

    lined = free(lined_at)

    def lining(u):
        return min(60.0 * max(u - lined, 0.0) / RADIUS, 0.2)

    return np.array([under(free(x), lining) if x > lined_at else free(x) for x in distances])
