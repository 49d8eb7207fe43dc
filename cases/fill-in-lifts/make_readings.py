"""Makes readings.csv: plates and piezometers below the fill, by other physics than geoident's.

Run: python make_readings.py

The stress below the fill is Flamant's, of a half-space. In each column below a gauge water flows
up, down and, by finite differences of its own, through the disturbed ground to a drain; rings
around a drain strain freely. The clay is as an oedometer has it: stiff below its preconsolidation
pressure, soft above, stiffer by the logarithm of stress. Its permeability falls with its void
ratio. The lifts come as on a site, fast and slow. No code of geoident's is used.
"""

import csv
from dataclasses import dataclass, field
from datetime import date, timedelta
from pathlib import Path

import numpy as np

BEGIN = date(2024, 3, 4)
PLACED = (
    ((0, 0.0), (2, 0.6), (5, 1.0)),
    ((28, 1.0), (29, 1.4), (36, 2.1), (38, 2.5)),
    ((63, 2.5), (70, 2.8), (74, 4.0)),
    ((119, 4.0), (122, 4.3), (129, 5.0)),
)
"""Days since the beginning, and height of the fill, m, lift by lift."""
DRAINED = 28.0
"""Day on which the drains are in."""
WEIGHT = 19.0
"""Of the fill, kN/m3."""
TOE, SLOPE = 24.0, 2.0
"""Half of the base of the fill, m; run of its slope per metre of height."""
PLATES = {"P1": 0.5, "P2": 5.0, "P3": 10.0, "P4": 13.0}
"""Distance from the middle of the fill, m."""
PIEZOMETERS = {"U1": (0.5, 2.5), "U2": (0.5, 5.0), "U3": (0.5, 7.0), "U4": (10.0, 5.0)}
"""Distance from the middle of the fill and depth, m."""
SD = {"P": 5.0, "U": 1.5}
"""Of a reading, mm and kPa."""


@dataclass(frozen=True)
class Clay:
    """Clay and drains.

    Args:
        thickness: m.
        weight: below water, kN/m3.
        surcharge: stress at its top before the fill, kPa.
        preconsolidation: what its preconsolidation pressure exceeds its stress by, kPa.
        compression, recompression: C_c and C_r by 1 + e_0.
        k: vertical permeability before the fill, m/day.
        ratio: of permeability, horizontal by vertical.
        falls: strain in which permeability falls to a tenth.
        drain, smear, cell: diameters of drain, disturbed ground and ground around a drain, m.
        disturbed: ratio of horizontal permeability, intact by disturbed.
        rings, layers: of the differences.
    """

    thickness: float = 9.0
    weight: float = 6.5
    surcharge: float = 22.0
    preconsolidation: float = 6.0
    compression: float = 0.14
    recompression: float = 0.03
    k: float = 1.0e-9 * 86400.0
    ratio: float = 2.0
    falls: float = 0.35
    drain: float = 0.066
    smear: float = 0.2
    cell: float = 1.05 * 1.4
    disturbed: float = 2.5
    rings: int = 8
    layers: int = 12
    depths: np.ndarray = field(init=False)

    def __post_init__(self):
        edges = np.linspace(0.0, self.thickness, self.layers + 1)
        object.__setattr__(self, "depths", 0.5 * (edges[1:] + edges[:-1]))

    @property
    def stress(self):
        """Before the fill, by layer, kPa."""
        return self.surcharge + self.weight * self.depths

    def strain(self, effective):
        """Strain, and its change with the effective stress, 1/kPa; both (rings, layers)."""
        first, limit = self.stress, self.stress + self.preconsolidation
        below = self.recompression * np.log10(np.minimum(effective, limit) / first)
        above = self.compression * np.log10(np.maximum(effective, limit) / limit)
        index = np.where(effective > limit, self.compression, self.recompression)
        return below + above, index / np.log(10.0) / effective


def height(day):
    """Of the fill on a day, m."""
    days, heights = np.array([point for lift in PLACED for point in lift]).T
    return float(np.interp(day, days, heights))


def stress_below(x, depths, high):
    """Vertical stress (n,), kPa, that a fill of some height makes x m from its middle (Flamant)."""
    s = np.linspace(-TOE, TOE, 4001)
    pressure = WEIGHT * np.minimum(high, (TOE - np.abs(s)) / SLOPE)
    z = depths[:, None]
    return np.trapezoid(pressure * 2.0 * z**3 / np.pi / ((x - s) ** 2 + z**2) ** 2, s, axis=1)


def column(clay, x, last, longest=4.0):
    """Days (n,), settlements (n,), m, and pressures between drains (n, layers), kPa, at x."""
    rings, layers = clay.rings, clay.layers
    wall, edge, dz = 0.5 * clay.drain, 0.5 * clay.cell, clay.thickness / clay.layers
    disturbed = rings // 2
    r = np.concatenate(
        [
            np.geomspace(wall, 0.5 * clay.smear, disturbed + 1),
            np.geomspace(0.5 * clay.smear, edge, rings - disturbed + 1)[1:],
        ]
    )
    area = np.pi * np.diff(r**2)[:, None]
    centre = np.sqrt(r[1:] * r[:-1])
    across = np.where(np.arange(rings) < disturbed, 1.0 / clay.disturbed, 1.0)[:, None] * clay.ratio
    number = np.arange(rings * layers).reshape(rings, layers)
    whole = [stress_below(x, clay.depths, high) for high in np.linspace(0.0, 5.0, 21)]

    def load(day):
        high = height(day)
        return np.array(
            [np.interp(high, np.linspace(0.0, 5.0, 21), q) for q in np.transpose(whole)]
        )

    u, q, day, step = np.zeros((rings, layers)), np.zeros(layers), 0.0, 0.25
    changes = sorted({d for lift in PLACED for d, _ in lift} | {DRAINED, last})
    days, settled, pressures = [0.0], [0.0], [u[-1]]
    while day < last - 1e-9:
        until = next(d for d in changes if d > day + 1e-9)
        placing = any(lift[0][0] <= day < lift[-1][0] for lift in PLACED)
        step = min(0.25 if placing else 1.1 * step, longest + 0.01 * day, until - day)
        new = load(day + step)
        u, q = u + (new - q), new
        strain, compliance = clay.strain(clay.stress + q - u)
        k = clay.k * 10.0 ** (-strain / clay.falls)
        A = np.zeros((u.size, u.size))

        def flow(a, b, by, A=A):
            A[a, a] += by
            A[b, b] += by
            A[a, b] -= by
            A[b, a] -= by

        # resistance of each half ring by its own permeability; 9.81 kN/m3 is water
        side = 2.0 * np.pi * dz * k * across / 9.81
        outer = np.log(r[1:] / centre)[:, None] / side
        inner = np.log(centre / r[:-1])[:, None] / side
        for i in range(rings - 1):
            flow(number[i], number[i + 1], 1.0 / (outer[i] + inner[i + 1]))
        up = k * area / 9.81 / dz
        for j in range(layers - 1):
            flow(number[:, j], number[:, j + 1], 0.5 * (up[:, j] + up[:, j + 1]))
        if day >= DRAINED:
            A[number[0], number[0]] += 1.0 / inner[0]
        for j in (0, layers - 1):  # to the fill and to the sand
            A[number[:, j], number[:, j]] += 2.0 * up[:, j]
        store = (compliance * area * dz / step).ravel()
        A[np.diag_indices(u.size)] += store
        u = np.linalg.solve(A, store * u.ravel()).reshape(u.shape)
        day += step
        strain, _ = clay.strain(clay.stress + q - u)
        days.append(day)
        settled.append(float((strain * area).sum() * dz / area.sum()))
        pressures.append(u[-1])
    return np.array(days), np.array(settled), np.array(pressures)


def truth(clay=None, last=420.0):
    """What each gauge reads without errors: days (n,) and values (n,), mm and kPa.

    A plate reads its settlement since the beginning, a piezometer between drains the pressure of
    the water, that at rest and the excess.
    """
    clay = clay or Clay()
    distances = sorted({*PLATES.values(), *(x for x, _ in PIEZOMETERS.values())})
    columns = {x: column(clay, x, last) for x in distances}
    read = {name: (columns[x][0], 1e3 * columns[x][1]) for name, x in PLATES.items()}
    for name, (x, depth) in PIEZOMETERS.items():
        days, _, pressures = columns[x]
        excess = np.array([np.interp(depth, clay.depths, row) for row in pressures])
        read[name] = days, 9.81 * depth + excess
    return read


def reading_days():
    """Days on which plates and piezometers are read: weekly, later every three weeks."""
    return [*range(3, 130, 7), *range(143, 420, 21)]


def readings(seed, known):
    """Rows of the file: date, then the gauges.

    Args:
        seed: of the errors.
        known: what the gauges read without errors.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for day in reading_days():
        row = [(BEGIN + timedelta(days=day)).isoformat()]
        for name, (days, values) in known.items():
            value = np.interp(day, days, values) + SD[name[0]] * rng.standard_normal()
            missing = name[0] == "U" and day < DRAINED + 2.0  # placed after the drains
            row.append("" if missing else f"{value:.0f}" if name[0] == "P" else f"{value:.1f}")
        rows.append(row)
    return rows


if __name__ == "__main__":
    with (Path(__file__).parent / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        units = {"P": "mm", "U": "kPa"}
        known = truth()
        table.writerow(["date", *(f"{name} ({units[name[0]]})" for name in known)])
        table.writerows(readings(1, known))
