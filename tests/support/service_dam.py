"""Dam sections in service whose physics is none of the seasonal model's.

The motion follows the water level by a power that is no whole number, a joint that opens, or pore
water that comes late; heat is conducted through slabs between air and water, by finite differences;
creep goes with the logarithm or a power of time; and no sine describes the weather. Readings have a
noise that lasts, another one of each reading, and dates that are not regular.
"""

from dataclasses import dataclass, field

import numpy as np

DAY = 86400.0
YEAR = 365.25
GAUGES = ("P1", "P2", "P3", "P4", "P5")


@dataclass
class Dam:
    """Loads and readings of some years.

    Args:
        days: of the loads, since the beginning.
        level: m.
        air: degC.
        read: gauge to days and readings, mm.
    """

    days: np.ndarray
    level: np.ndarray
    air: np.ndarray
    read: dict = field(default_factory=dict)


def lasting(days, size, time, rng):
    x = np.empty(len(days))
    x[0] = size * rng.standard_normal()
    for k, phi in enumerate(np.exp(-np.diff(days) / time), 1):
        x[k] = phi * x[k - 1] + size * np.sqrt(1 - phi**2) * rng.standard_normal()
    return x


def slab_means(air, water, thickness=8.0, diffusivity=0.09, points=17):
    """Mean temperature and moment of a slab whose faces have given temperatures, day by day."""
    dx = thickness / (points - 1)
    T = np.linspace(air[:365].mean(), water[:365].mean(), points)
    number = int(np.ceil(2.5 * diffusivity / dx**2))
    mean, moment = np.empty(len(air)), np.empty(len(air))
    place = np.linspace(-1.0, 1.0, points)
    for k in range(len(air)):
        for _ in range(number):
            T[0], T[-1] = air[k], water[k]
            T[1:-1] += diffusivity / number / dx**2 * (T[2:] - 2 * T[1:-1] + T[:-2])
        mean[k], moment[k] = T.mean(), (T * place).mean()
    return mean, moment


def dam(seed, years=10.0, every=10.0, changes=None, physics="conduction"):
    """A dam with its readings.

    Args:
        seed: of weather, floods and errors.
        years: of service.
        every: days between readings, about.
        changes: gauge to what is added to its readings, a function of the day, mm.
        physics: a name of `PHYSICS`.
    """
    rng = np.random.default_rng(seed)
    days = np.arange(int(years * YEAR) + 1.0)
    wave = 2 * np.pi * days / YEAR
    air = 10 - 9 * np.cos(wave - 0.35) + lasting(days, 3.0, 5.0, rng)
    water = 8 - 4 * np.cos(wave - 1.2)
    level = 100 + 14 * np.sin(wave - 1.0) + lasting(days, 5.0, 60.0, rng)
    level = np.clip(level, 70.0, 125.0)
    motions, errors = PHYSICS[physics](days, level, air, water, rng)
    found = Dam(days, level, air)
    for number, gauge in enumerate(GAUGES):
        motion = motions(0.4 + 0.2 * number)
        planned = np.arange(0.0, days[-1] - 2, every)
        read = np.unique(np.round(planned + rng.uniform(0, 2.5, len(planned))))
        y = motion[read.astype(int)] + errors(read)
        if changes and gauge in changes:
            y += changes[gauge](read)
        found.read[gauge] = read, y
    return found


def conduction(days, level, air, water, rng):
    """Heat conducted through a slab, a level effect of no whole power, logarithmic creep."""
    mean, moment = slab_means(air, water)

    def motion(share):
        motion = share * 6.0 * ((level - 70.0) / 55.0) ** 2.6
        motion -= (0.25 + 0.1 * share) * (mean - mean.mean()) + 0.3 * share * moment
        return motion + 0.8 * share * np.log1p(days / 120.0)

    def errors(read):
        return 0.15 * rng.standard_normal(len(read)) + lasting(read, 0.2, 25.0, rng)

    return motion, errors


def cracked(days, level, air, water, rng):
    """A joint that opens from a level on, a thin part and a thick one of other diffusivity.

    Creep by a power of time; errors that fade in a week and in five months, half of them of all
    gauges together.
    """
    thin, _ = slab_means(air, water, thickness=4.0, diffusivity=0.05)
    thick, moment = slab_means(air, water, thickness=16.0, diffusivity=0.12)
    common = lasting(days, 0.1, 8.0, rng) + lasting(days, 0.1, 150.0, rng)

    def motion(share):
        x = (level - 70.0) / 55.0
        motion = share * (4.0 * x + 5.0 * np.maximum(x - 0.55, 0.0))
        motion -= 0.1 * (thin - thin.mean()) + 0.25 * share * (thick - thick.mean())
        return motion - 0.3 * share * moment + 0.9 * share * (days / YEAR) ** 0.3

    def errors(read):
        own = lasting(read, 0.1, 8.0, rng) + lasting(read, 0.1, 150.0, rng)
        return common[read.astype(int)] + own + 0.15 * rng.standard_normal(len(read))

    return motion, errors


def ageing(days, level, air, water, rng):
    """Pore water that follows the level late, concrete that softens by half a percent a year.

    A reservoir that is warmer in some years, creep by the root of time, an error of all gauges
    together, and instruments that wander.
    """
    warm = lasting(days, 1.5, 60.0, rng)
    mean, moment = slab_means(air, water + warm, thickness=10.0, diffusivity=0.07)
    late = np.empty(len(level))
    late[0] = level[0]
    for k in range(1, len(level)):
        late[k] = late[k - 1] + (level[k] - late[k - 1]) / 20.0
    common = lasting(days, 0.12, 30.0, rng)

    def motion(share):
        x = (0.7 * level + 0.3 * late - 70.0) / 55.0
        motion = share * 5.0 * x**2.2 * (1.0 + 0.005 * days / YEAR)
        motion -= 0.25 * share * (mean - mean.mean()) + 0.25 * moment
        return motion + 0.5 * share * np.sqrt(days / YEAR)

    def errors(read):
        wander = np.cumsum(0.05 * np.sqrt(np.diff(read, prepend=read[0]) / YEAR)
                           * rng.standard_normal(len(read)))  # fmt: skip
        own = lasting(read, 0.12, 30.0, rng) + 0.15 * rng.standard_normal(len(read))
        return common[read.astype(int)] + own + wander

    return motion, errors


PHYSICS = {"conduction": conduction, "cracked": cracked, "ageing": ageing}
"""What moves a dam: functions of loads that give the motion of a share, and errors of readings."""


def write(folder, dam, *, fitted_years=6.0, model="level: 3\n  season: 2\n  air: [3 d, 25 d]"):
    """The case of a dam, with its files."""
    first = np.datetime64("2010-01-01")

    def date(day):
        return str(first + int(day))

    folder.mkdir(parents=True, exist_ok=True)
    loads = [
        f"{date(d)},{z:.3f},{t:.2f}" for d, z, t in zip(dam.days, dam.level, dam.air, strict=True)
    ]
    (folder / "loads.csv").write_text("date,level (m),air (degC)\n" + "\n".join(loads) + "\n")
    rows = [
        f"{gauge},{date(d)},{v:.3f},mm"
        for gauge, (read, y) in dam.read.items()
        for d, v in zip(read, y, strict=True)
    ]
    (folder / "readings.csv").write_text("gauge,date,value,unit\n" + "\n".join(rows) + "\n")
    gauges = "\n".join(f"  {gauge}: {{kind: reading, accuracy: 0.2 mm}}" for gauge in dam.read)
    air = "\n  air: {file: loads.csv}" if "air:" in model else ""
    (folder / "dam.yaml").write_text(
        f"""format: geoident-case/1
title: A dam in service
model:
  kind: seasonal
  since: 2010-01-01
  {model}
  settling: [300 d]
  linear: true
loads:
  level: {{file: loads.csv}}{air}
gauges:
{gauges}
readings: readings.csv
fit: {{until: {date(fitted_years * YEAR)}}}
"""
    )
    return folder / "dam.yaml"
