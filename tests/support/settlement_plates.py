"""Settlement plates whose truth is consolidation and creep, by a model that knows neither.

The model is a convergence law far behind the face with an exponent of one, which is a hyperbola in
time: C_inf m t / (t + T).
"""

from datetime import date, timedelta

import numpy as np

from geoident.api import fit, load_case

BEGIN = date(2022, 3, 1)
SD = 5e-3
"""Of a reading, m."""


def terzaghi(Tv):
    """Mean degree of consolidation of a layer (Terzaghi) at time factors Tv."""
    M = 0.5 * np.pi * (2.0 * np.arange(60) + 1.0)
    return 1.0 - np.sum(2.0 / M**2 * np.exp(-(M**2) * np.asarray(Tv)[..., None]), axis=-1)


def settlement(rng):
    """A plate: its settlement, m, as a function of days."""
    size, c_v = np.exp(rng.normal(0.0, 0.3)), np.exp(rng.normal(0.0, 0.7)) / 300.0
    creep, begin = rng.uniform(0.02, 0.10), rng.uniform(20.0, 100.0)
    return lambda t: size * (terzaghi(c_v * t) + creep * np.log10(1.0 + t / begin))


def hyperbola(final=1.2, half=120.0):
    """A plate that the model describes rightly."""
    return lambda t: final * t / (half + t)


def days_of(rng, count=24):
    """Days of reading, irregular, over a year and a half."""
    return np.unique(np.round(rng.uniform(3.0, 500.0, count)))


def measured(rng, truth, days):
    """Readings of a plate, m."""
    return truth(days) + SD * rng.standard_normal(len(days))


def write_plate(folder, days, readings, *, fitted, more="", plates=("P",)):
    """A case of plates (n,) with readings (n_days, n), m, of which the first days are fitted."""
    names = [f"d{day:.0f}" for day in days]
    dates = {
        name: BEGIN + timedelta(days=float(day)) for name, day in zip(names, days, strict=True)
    }
    columns = np.reshape(readings, (len(days), -1))
    rows = [
        f"{plate},{name},{1e3 * value:.3f},mm"
        for name, row in zip(names, columns.tolist(), strict=True)
        for plate, value in zip(plates, row, strict=True)
    ]
    (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    gauges = [
        f"  {plate}: {{kind: reading, accuracy: {1e3 * SD:g} mm, zero: begin}}" for plate in plates
    ]
    path = folder / "case.yaml"
    path.write_text(f"""\
format: geoident-case/1
model:
  kind: convergence-law
  face: {{begin: 1000 km, {", ".join(f"{name}: 1000 km" for name in names)}}}
  sections:
    A: {{chainage: 0 m, excavated: {BEGIN}}}
  C_inf: 1 m
  X: 1 m
  m: $m
  T: $T
  n: 1
parameters:
  m: {{start: 1, bounds: [0.05, 10], scale: log}}
  T: {{start: 100 days, bounds: [1 days, 3000 days], scale: log}}
dates: {{begin: {BEGIN}, {", ".join(f"{name}: {day}" for name, day in dates.items())}}}
gauges:
{chr(10).join(gauges)}
readings: readings.csv
fit: {{stages: [{", ".join(names[:fitted])}], backtest: false{more}}}
""")
    return path


def inside_later(result):
    """Later readings inside their bands, how many there are, and the mean half width, m."""
    later = ~result.gauges.used & np.isfinite(result.gauges.measured)
    low, high = (getattr(result.prediction, end)[later] for end in ("lower95", "upper95"))
    value = result.gauges.measured[later]
    return int(np.sum((low <= value) & (value <= high))), len(value), float(np.mean(high - low) / 2)


def predicted(folder, truth, seed, *, more="", part=0.5):
    """The fit of the first part of the readings of a plate, with bands of the others."""
    rng = np.random.default_rng(seed)
    days = days_of(rng)
    readings = measured(rng, truth, days)
    path = write_plate(folder, days, readings, fitted=int(part * len(days)), more=more)
    return fit(load_case(str(path)), force=True).data
