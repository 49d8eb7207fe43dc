"""Makes loads.csv and readings.csv: ten years of a gravity dam, by physics that is not geoident's.

The dam is a cantilever whose sections stay plane; it stands on an elastic half-plane (Flamant's
solution, summed over the base) from which it lifts where its heel would be in tension. Heat is
conducted through each height by itself, faster where the concrete is wet, from a reservoir that is
warm at the top, and from air and sun. The motion by the water creeps with the logarithm of time.
Weather and floods are drawn. From September 2018 on the rock below the heel softens.

Lengths in m, x downstream from the heel, y upwards from the base; stresses in MPa, loads in MN/m,
temperatures in degC, times in days.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import solve_banded

HERE = Path(__file__).resolve().parent
HEIGHT, BASE, CREST, SHOULDER = 70.0, 54.0, 7.0, 61.0
E_DAM, E_ROCK, NU_DAM, NU, ALPHA = 24_000.0, 15_000.0, 0.2, 0.25, 9e-6  # MPa, -, 1/K
WATER, CONCRETE = 9.81e-3, 23.5e-3  # unit weights, MN/m3
WET, DRY, WET_PART = 0.115, 0.08, 0.3  # diffusivities in m2/d, and how far water has come
HEEL, SOFT_DEPTH = 18.0, 14.0  # breadth and depth of the rock that softens
FIRST, BUILT, SOFTENS = "2011-01-01", -1500.0, "2018-09-01"
YEARS, SOFTENED = 10, 0.5  # part of its stiffness that the rock has lost in the end
NOISE = {  # of a reading by itself, and what lasts some weeks, mm
    "P70": (0.10, 0.08),
    "P45": (0.10, 0.06),
    "P20": (0.08, 0.04),
    "IP": (0.06, 0.04),
    "EH": (0.03, 0.02),
    "ET": (0.03, 0.02),
}
POINTS = {"P70": 69.0, "P45": 45.0, "P20": 20.0}  # height of the pendulum's points above 2 m


def thickness(y):
    """Of the dam at some heights."""
    return np.where(y > SHOULDER, CREST, CREST + (BASE - CREST) * (1.0 - y / SHOULDER))


def lasting(rng, number, size, time):
    """(number,) an error that fades in a time, in steps of one."""
    phi, x = np.exp(-1.0 / time), np.empty(number)
    x[0] = size * rng.standard_normal()
    for k in range(1, number):
        x[k] = phi * x[k - 1] + size * np.sqrt(1.0 - phi**2) * rng.standard_normal()
    return x


# What acts.


def weather(rng, days):
    """Air temperature and water level, day by day."""
    year = 2.0 * np.pi * days / 365.25
    anomaly = np.repeat(rng.normal(0.0, 0.7, YEARS + 1), 366)[: len(days)]
    air = 8.5 - 9.5 * np.cos(year - 0.32) + anomaly + lasting(rng, len(days), 3.2, 4.0)
    level = 52.0 + 9.0 * np.sin(year - 1.35) + lasting(rng, len(days), 4.5, 45.0)
    for start in rng.choice(len(days) - 60, 14, replace=False):  # floods come fast and run off
        level[start:] += rng.uniform(2.0, 7.0) * np.exp(-np.arange(len(days) - start) / 12.0)
    return air, np.clip(level, 24.0, 68.5)


def water_temperature(day, depth):
    """Of the reservoir: below, the year comes later and less, and the mean is lower."""
    mean = 6.0 + 4.0 * np.exp(-0.04 * depth)
    late = 2.15 - 1.3 * np.exp(-0.085 * depth)
    return mean - 8.0 * np.exp(-0.018 * depth) * np.cos(2.0 * np.pi * (day - 25.0) / 365.25 - late)


# Heat.


def heat(days, air, level, heights, points=25):
    """Mean and slope (K/m, from upstream to downstream) of the temperature, (days, heights)."""
    sun = 3.0 - 2.0 * np.cos(2.0 * np.pi * days / 365.25)
    mean, slope = np.empty((2, len(days), len(heights)))
    for number, y in enumerate(heights):
        t = float(thickness(y))
        x = np.linspace(0.0, t, points)
        dx = x[1]
        k = np.where(0.5 * (x[1:] + x[:-1]) < WET_PART * t, WET, DRY) / dx**2
        bands = np.zeros((3, points))
        bands[1, [0, -1]] = 1.0
        bands[0, 2:], bands[2, :-2] = -k[1:], -k[:-1]
        bands[1, 1:-1] = 1.0 + k[1:] + k[:-1]
        weight = np.full(points, dx)
        weight[[0, -1]] *= 0.5
        upstream = np.where(
            level > y, water_temperature(days, np.maximum(level - y, 0.0)), air + 1.0
        )
        downstream = air + sun
        T = np.linspace(upstream[:365].mean(), downstream[:365].mean(), points)
        for turn in range(4):  # years before the first day, so that the inside has its season
            for day in range(365 if turn < 3 else len(days)):
                T[0], T[-1] = upstream[day], downstream[day]
                T = solve_banded((1, 1), bands, T)
                if turn == 3:
                    mean[day, number] = weight @ T / t
                    slope[day, number] = 12.0 * (weight * (x - 0.5 * t)) @ T / t**3
    return mean, slope


# The rock.


def line_load(P, Q, x, z):
    """Motion (downstream, down) in a half-plane, z below a line load of P down and Q downstream.

    Flamant's solution in plane strain, but for a motion of the whole.
    """
    r2, theta, G = x**2 + z**2, np.arctan2(x, z), E_ROCK / (2.0 * (1.0 + NU))
    log, cross, down = (1.0 - NU) * np.log(r2), x * z / r2, z**2 / r2
    along = P * (cross - (1.0 - 2.0 * NU) * theta) - Q * (log + down)
    below = P * (down - log) + Q * (cross + (1.0 - 2.0 * NU) * theta)
    return np.array([along, below]) / (2.0 * np.pi * G)


def base_pressures(level, x):
    """Pressure (number, len(x)) of the dam on the rock, with its weight, less uplift; MPa."""
    heights = np.arange(0.25, HEIGHT, 0.5)
    weights = CONCRETE * thickness(heights) * 0.5
    middle = 0.5 * BASE
    force = weights.sum() - 0.5 * WATER * level * BASE
    moment = -(weights @ (0.5 * thickness(heights) - middle))  # what presses the heel, positive
    moment = moment - WATER * level**3 / 6.0 - 0.5 * WATER * level * BASE * (BASE / 6.0)
    pressure = force[:, None] / BASE - 12.0 * moment[:, None] * (x - middle) / BASE**3
    away = middle + moment / force  # distance of the resultant from the toe
    contact = np.minimum(3.0 * away, BASE)
    opened = away < BASE / 3.0
    inside = np.maximum(x - (BASE - contact[:, None]), 0.0)
    return np.where(
        opened[:, None], 2.0 * force[:, None] * inside / contact[:, None] ** 2, pressure
    )


@dataclass(frozen=True)
class Rock:
    """Motion of the base and of the anchors, by the loads of each level; m, rotation in rad.

    Args:
        along, below, turn: motion of the middle of the base downstream and down, and its rotation
            downstream.
        deep: (number, 3, 2) of points 40 m below the pendulum and 30 m below heel and toe.
    """

    along: np.ndarray
    below: np.ndarray
    turn: np.ndarray
    deep: np.ndarray


def rock(level, soft):
    """How the rock moves under each level since the dam was built.

    Args:
        level: (number,) m.
        soft: (number,) part of its stiffness that the rock below the heel has lost.
    """
    step = 1.0
    x = np.arange(0.5 * step, BASE, step)
    pressure = base_pressures(level, x)
    change = pressure - base_pressures(np.zeros(1), x)
    change = change + WATER * level[:, None] * (1.0 - x / BASE)  # uplift presses the rock, too
    lake = np.arange(-150.0 + 0.5 * step, 0.0, step)
    P = np.hstack([change, np.repeat(WATER * level[:, None], len(lake), axis=1)]) * step
    Q = np.hstack([np.repeat(0.5 * WATER * level[:, None] ** 2 / BASE, len(x), axis=1),
                   np.zeros((len(level), len(lake)))]) * step  # fmt: skip
    at = np.concatenate([x, lake])

    def motion(px, pz):
        """(2, number) of a point."""
        down = line_load(1.0, 0.0, px - at, pz)
        sideways = line_load(0.0, 1.0, px - at, pz)
        return down @ P.T + sideways @ Q.T

    edge = np.arange(step, BASE - 0.5 * step, step)
    surface = np.array([motion(px, 1e-9) for px in edge])  # (m, 2, number)
    at_edge = 0.5 * (pressure[:, 1:] + pressure[:, :-1])
    more = soft[:, None] / (1.0 - soft[:, None]) * at_edge * SOFT_DEPTH * (1.0 - NU**2) / E_ROCK
    below = surface[:, 1].T + np.where(edge < HEEL, more, 0.0)
    arm = edge - 0.5 * BASE
    points = ((3.0, 40.0), (4.0, 30.0), (48.0, 30.0))
    return Rock(
        along=surface[:, 0].mean(axis=0),
        below=below.mean(axis=1),
        turn=below @ arm / (arm @ arm),
        deep=np.array([motion(*point) for point in points]).transpose(2, 0, 1),
    )


# The dam.


def bending(level, y):
    """Motion downstream at some heights (number, len(y)) of the dam, held at its base; m."""
    s = np.arange(0.25, HEIGHT, 0.5)
    t = thickness(s)
    head = np.maximum(level[:, None] - s, 0.0)
    curvature = WATER * head**3 / 6.0 * 12.0 * (1.0 - NU_DAM**2) / (E_DAM * t**3)
    slide = 0.5 * WATER * head**2 * 1.2 * 2.0 * (1.0 + NU_DAM) / (E_DAM * t)
    return (
        0.5
        * np.array(
            [(curvature * np.maximum(one - s, 0.0) + slide * (s < one)).sum(axis=1) for one in y]
        ).T
    )


def warping(slope, heights, y):
    """Motion downstream at some heights by slopes of the temperature (number, heights); m."""
    step = heights[1] - heights[0]
    curvature = -ALPHA * (1.0 + NU_DAM) * slope
    return step * np.array([curvature @ np.maximum(one - heights, 0.0) for one in y]).T


def motions(days, air, level, soft):
    """Gauge to its reading (days,), mm, without errors; pendulums downstream, rods longer."""
    y = np.array([*POINTS.values(), 2.0])
    heights = np.arange(1.75, HEIGHT, 3.5)
    _, slope = heat(days, air, level, heights)
    below = rock(level, soft)
    u = bending(level, y) + warping(slope, heights, y) + below.turn[:, None] * y
    usual = np.array([55.0])
    creeps = 0.09 * (bending(usual, y) + rock(usual, np.zeros(1)).turn * y)
    u = u + creeps * np.log1p((days[:, None] - BUILT) / 250.0)
    read = {name: u[:, k] - u[:, -1] for k, name in enumerate(POINTS)}
    read["IP"] = below.along + u[:, -1] - below.deep[:, 0, 0]
    for number, (name, x) in enumerate({"EH": 4.0, "ET": 48.0}.items(), 1):
        base = below.below + below.turn * (x - 0.5 * BASE)
        read[name] = below.deep[:, number, 1] - base
    return {name: 1e3 * values for name, values in read.items()}


def calendar():
    """Dates of all days."""
    first = np.datetime64(FIRST)
    return np.arange(first, np.datetime64(str(int(FIRST[:4]) + YEARS) + FIRST[4:]))


def service(seed, softens=SOFTENS):
    """Dates, air, level, days of the readings, and the readings of each gauge.

    Args:
        seed: of weather and errors.
        softens: date from which on the rock below the heel softens, within three months; None for
            never.
    """
    rng, dates = np.random.default_rng(seed), calendar()
    days = np.arange(len(dates), dtype=float)
    air, level = weather(rng, days)
    soft = np.zeros(len(days))
    if softens is not None:
        since = (dates - np.datetime64(softens)).astype(float)
        soft = SOFTENED * np.clip(since / 90.0, 0.0, 1.0)
    exact = motions(days, air, level, soft)
    months = np.arange(dates[0], dates[-1], dtype="datetime64[M]")
    planned = np.concatenate([(months.astype("datetime64[D]") + k) for k in (4, 14, 24)])
    read = np.sort((planned - dates[0]).astype(int) + rng.integers(-1, 2, len(planned)))
    readings = {}
    for gauge, (own, lasts) in NOISE.items():
        errors = own * rng.standard_normal(len(read)) + lasting(rng, len(days), lasts, 25.0)[read]
        values = exact[gauge][read] - exact[gauge][read[0]] + errors
        readings[gauge] = np.where(rng.random(len(read)) < 0.02, np.nan, values)
    return dates, air, level, read, readings


def write(folder, seed=4, softens=SOFTENS):
    """Write loads.csv and readings.csv."""
    dates, air, level, read, readings = service(seed, softens)
    with (folder / "loads.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["date", "level (m)", "air (degC)"])
        rows.writerows(
            [day, f"{z:.2f}", f"{t:.1f}"] for day, z, t in zip(dates, level, air, strict=True)
        )
    with (folder / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["date", *(f"{gauge} (mm)" for gauge in readings)])
        for number, day in enumerate(dates[read]):
            values = [readings[gauge][number] for gauge in readings]
            rows.writerow([day, *("" if np.isnan(v) else f"{v:.2f}" for v in values)])


if __name__ == "__main__":
    write(HERE)
