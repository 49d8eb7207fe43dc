"""Makes readings.csv: three plates by finite differences. Run: python make_readings.py.

Water flows up and to a drain (radius and depth, free strain), the clay is stiffer by the logarithm
of stress, its permeability falls with its void ratio, and it creeps in log time. No code of
geoident's is used, and none of its laws.
"""

import csv
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path

import numpy as np

_RINGS, _LAYERS = 7, 9

DRAIN = 0.066
"""Diameter of a drain, m."""


@dataclass(frozen=True)
class Ground:
    """Clay, drains and fill.

    Args:
        thickness: of the clay, m; water leaves at its top.
        stress: before the fill, kPa.
        compression: C_c / (1 + e_0).
        c_v: coefficient of consolidation before the fill, m2/day.
        ratio: of permeability, horizontal by vertical.
        falls: C_c / C_k: how permeability falls while the void ratio does.
        creep: strain in a tenfold of time.
        spacing: diameter of the ground around a drain, m.
        lifts: days and loads of the whole fill after them, kPa.
    """

    thickness: float
    stress: float
    compression: float
    c_v: float
    ratio: float
    falls: float
    creep: float
    spacing: float
    lifts: tuple[tuple[float, float], ...]

    @property
    def loaded(self) -> float:
        """Day of the last lift."""
        return self.lifts[-1][0]


def settlement(ground, last=900.0):
    """Days and settlements (m,), m, of a plate since before the first lift."""
    wall, edge, H = 0.5 * DRAIN, 0.5 * ground.spacing, ground.thickness
    r = np.geomspace(wall, edge, _RINGS + 1)
    centre, dz = 0.5 * (r[1:] + r[:-1]), H / _LAYERS
    area = np.pi * (r[1:] ** 2 - r[:-1] ** 2)
    # permeability by the weight of water, in units of c_v m_v before the fill
    m_0 = ground.compression / np.log(10.0) / ground.stress
    k_0 = ground.c_v * m_0
    sideways = 2.0 * np.pi * dz / np.log(centre[1:] / centre[:-1])
    to_drain = 2.0 * np.pi * dz / np.log(centre[0] / wall)
    u = np.zeros((_RINGS, _LAYERS))
    load, time = 0.0, 0.0
    times, settled = [0.0], [0.0]
    pending = list(ground.lifts)
    step = 0.5
    number = np.arange(u.size).reshape(u.shape)
    while time < last:
        if pending and pending[0][0] <= time:
            u += pending[0][1] - load
            load, step = pending.pop(0)[1], 0.05
        until = pending[0][0] if pending else last
        longest = max(5.0, 0.02 * (time - 600.0))
        step = min(1.15 * step, longest, max(until - time, 1e-9))
        effective = ground.stress + load - u
        m = ground.compression / np.log(10.0) / effective
        k = k_0 * (effective / ground.stress) ** -ground.falls
        A = np.zeros((u.size, u.size))
        store = (m * area[:, None] * dz / step).ravel()

        def flow(a, b, g, A=A):
            A[a, a] += g
            A[b, b] += g
            A[a, b] -= g
            A[b, a] -= g

        mean = 0.5 * (k[1:] + k[:-1]) * ground.ratio
        for i in range(_RINGS - 1):
            flow(number[i], number[i + 1], mean[i] * sideways[i])
        between = 0.5 * (k[:, 1:] + k[:, :-1])
        for j in range(_LAYERS - 1):
            flow(number[:, j], number[:, j + 1], between[:, j] * area / dz)
        A[number[0], number[0]] += k[0] * ground.ratio * to_drain
        A[number[:, 0], number[:, 0]] += k[:, 0] * area / (0.5 * dz)
        A[np.diag_indices(u.size)] += store
        u = np.linalg.solve(A, store * u.ravel()).reshape(u.shape)
        time += step
        strain = ground.compression * np.log10((ground.stress + load - u) / ground.stress)
        primary = float(np.sum(strain * area[:, None]) * dz / area.sum())
        crept = ground.creep * H * np.log10(1.0 + max(time - ground.lifts[0][0], 0.0) / 20.0)
        times.append(time)
        settled.append(primary + crept)
    return np.array(times), np.array(settled)


BEGIN = date(2023, 3, 1)
WEIGHT = 19.0  # kN/m3
LIFTS = ((0.0, 1.0), (28.0, 2.0), (56.0, 3.0), (91.0, 4.0), (119.0, 4.5))
"""Day and thickness of the whole fill after it, m."""
THICKNESS = {"P1": 5.0, "P2": 6.5, "P3": 8.0}  # of the clay, m
SD = 4.0  # of a reading, mm


COMMON = {
    "stress": 40.0,
    "compression": 0.2,
    "c_v": 1.2 / 365.25,
    "ratio": 2.0,
    "falls": 0.8,
    "creep": 0.006,
    "spacing": 1.05 * 1.5,
}
"""What is alike at all plates."""


def plates():
    """Days and settlements (m,), m, of each plate."""
    lifts = tuple((day, WEIGHT * height) for day, height in LIFTS)
    return {
        name: settlement(Ground(thickness=H, lifts=lifts, **COMMON), 1200.0)
        for name, H in THICKNESS.items()
    }


if __name__ == "__main__":
    rng = np.random.default_rng(1)
    days = [*range(7, 180, 7), *range(190, 600, 14)]
    with (Path(__file__).parent / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["date", *(f"{name} (mm)" for name in THICKNESS)])
        truth = plates()
        for day in days:
            row = [
                1e3 * np.interp(day, *truth[name]) + SD * rng.standard_normal() for name in truth
            ]
            table.writerow([BEGIN + timedelta(days=day), *(f"{value:.0f}" for value in row)])
