"""Plates under a staged fill on clay with drains, by other physics than the settlement laws.

That of `cases/fill-on-clay/make_readings.py`: finite differences, permeability that
falls with the void ratio, creep in log time.
"""

import importlib.util
import sys
from datetime import date, timedelta
from functools import cache
from pathlib import Path

import numpy as np

CASE = Path(__file__).parents[2] / "cases" / "fill-on-clay"
_spec = importlib.util.spec_from_file_location("make_fill_on_clay", CASE / "make_readings.py")
made = sys.modules[_spec.name] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(made)

BEGIN = date(2021, 3, 1)
SD = 5e-3
"""Of a reading, m."""
Ground = made.Ground
settlement = cache(made.settlement)


def random_ground(rng):
    """A fill as they are: three to five lifts in two to five months."""
    count = int(rng.integers(3, 6))
    days = np.round(np.linspace(5.0, rng.uniform(60.0, 150.0), count))
    load = rng.uniform(40.0, 90.0)
    parts = np.cumsum(rng.uniform(0.5, 1.5, count))
    return Ground(
        thickness=rng.uniform(4.0, 12.0),
        stress=rng.uniform(25.0, 60.0),
        compression=rng.uniform(0.12, 0.3),
        c_v=np.exp(rng.uniform(np.log(0.5), np.log(4.0))) / 365.0,
        ratio=rng.uniform(1.0, 3.0),
        falls=rng.uniform(0.5, 1.2),
        creep=rng.uniform(0.003, 0.012),
        spacing=1.05 * rng.uniform(1.2, 2.2),
        lifts=tuple(zip(days.tolist(), (load * parts / parts[-1]).tolist(), strict=True)),
    )


def plate(seed, *, span=1.2, last=3650.0):
    """A plate: its ground, days of reading, readings, m, and the truth as a function of days."""
    rng = np.random.default_rng(seed)
    ground = random_ground(rng)
    times, settled = settlement(ground, last)

    def truth(day):
        return np.interp(day, times, settled)

    # read until most has come, as sites are
    total = truth(last)
    end = ground.loaded + span * (np.interp(0.8 * total, settled, times) - ground.loaded)
    end = max(end, ground.loaded + 120.0)
    days = np.unique(np.round(np.arange(1.0, end, max(5.0, end / 60.0)) + rng.uniform(-2, 2)))
    days = days[days > 0.0]
    return ground, days, truth(days) + SD * rng.standard_normal(len(days)), truth


def day_text(day):
    """The date of a day."""
    return (BEGIN + timedelta(days=float(day))).isoformat()


CURVE = """\
format: geoident-case/1
model:
  kind: settlement-law
  law: {law}
  since: {since}
  S: $S
  T: $T
{asked}
parameters:
  S: {{start: 0.3 m, bounds: [5 mm, 10 m], scale: log}}
  T: {{start: 100 days, bounds: [3 days, 5000 days], scale: log}}
  before: {{start: 0.3 m, bounds: [-1 m, 10 m]}}
gauges:
  P: {{kind: reading, accuracy: 5 mm, offset: $before}}
readings: readings.csv
fit: {{until: {until}, backtest: false{more}}}
"""

CONSOLIDATION = """\
format: geoident-case/1
model:
  kind: settlement-law
  law: consolidation
  fill: [{lifts}]
  stress: {stress:.3f} kPa
  S: $S
  drains: {{c_h: $c_h, spacing: {spacing:.4f} m, diameter: 66 mm}}
  c_v: 0.5 $c_h
  path: {path:.3f} m
  creep: $C
  creep_time: 20 days
{asked}
parameters:
  S: {{start: 1 m, bounds: [0.02 m, 10 m], scale: log}}
  c_h: {{start: 3 m2/year, bounds: [0.05 m2/year, 200 m2/year], scale: log}}
  C: {{start: 0.05, bounds: [0, 0.3], prior: {{mean: 0.04, sd: 0.03}}}}
gauges:
  P: {{kind: reading, accuracy: 5 mm, zero: {zero}}}
readings: readings.csv
fit: {{until: {until}, backtest: false{more}}}
"""


def write_plate(folder, law, ground, days, readings, until, *, asked=None, more=""):
    """The case of a plate, of which readings until a day are fitted; its path."""
    asked = {"until": "2061-01-01"} if asked is None else asked
    rows = [f"P,{day_text(day)},{1e3 * s:.2f},mm" for day, s in zip(days, readings, strict=True)]
    (folder / "readings.csv").write_text("\n".join(["gauge,date,value,unit", *rows, ""]))
    text = CONSOLIDATION if law == "consolidation" else CURVE
    lifts = [f"{{date: {day_text(day)}, load: {q:.3f} kPa}}" for day, q in ground.lifts]
    path = folder / "case.yaml"
    path.write_text(
        text.format(
            law=law,
            since=day_text(ground.loaded),
            zero=day_text(0),
            until=day_text(until),
            lifts=", ".join(lifts),
            stress=ground.stress,
            spacing=ground.spacing / 1.05,
            path=ground.thickness,
            asked="\n".join(f"  {key}: {value}" for key, value in asked.items()),
            more=more,
        )
    )
    return path


def half_of(ground, days):
    """Days since the end of loading, and the last of the first half of these."""
    since = days[days >= ground.loaded]
    return since, since[len(since) // 2 - 1]


def by_hand(law, days, readings):
    """What practice draws: (t - t_0) / (s - s_0) over t, or Asaoka's line, by least squares.

    Returns:
        The settlement as a function of days.
    """
    t, s = days - days[0], readings
    if law == "hyperbola":
        slope, start = np.polyfit(t[1:], t[1:] / (s[1:] - s[0]), 1)
        return lambda day: s[0] + (day - days[0]) / (start + slope * (day - days[0]))
    even = np.linspace(0.0, t[-1], len(t))
    steps = np.interp(even, t, s)
    slope, start = np.polyfit(steps[:-1], steps[1:], 1)
    if not 0.0 < slope < 1.0:
        return lambda day: np.full(np.shape(day), np.nan)
    final, time = start / (1.0 - slope), -even[1] / np.log(slope)
    decay = np.exp(-t / time)
    left = np.sum((final - s) * decay) / np.sum(decay**2)
    return lambda day: final - left * np.exp(-(day - days[0]) / time)
