"""Makes readings.csv: claystone that creeps by powers of stress and strain, plus noise.

A calculation of its own, without code of geoident's and with none of its laws: rings of elements
about the axis; ground that hardens while it creeps (q in MPa, time in days),

    e' = (A q^n)^(1 / m) m e^(1 - 1 / m) ,   under a stress that stays  e = A q^n t^m

a ring of sprayed concrete by the method of rates of flow (Schubert 1988), whose creep depends on
its age; and a face that goes away round by round and then stands. Run: python make_readings.py.
"""

import csv
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import solve_banded

HERE = Path(__file__).resolve().parent
RADIUS, SHELL, PRESSURE = 4.0, 0.2, 5.0  # m, m, MPa
E, NU = 2200.0, 0.3  # MPa
A, N, M = 1.8e-4, 1.3, 0.22
BEGIN = date(2024, 3, 1)  # the section is excavated
ZERO, LINED = 1.0, 2.0  # d: gauges are set, the ring is closed
ADVANCE, STANDS = 4.0, 5.0  # m/d, d: the face goes on, and stands from then on
DAYS = [2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 30, 37, 44, 52, 61, 75, 90, 105, 120]
CHANNELS = {"C0": 0.4, "C45": 0.4, "C90": 0.4, "EX.a3": 0.15, "EX.a10": 0.15, "cell.yy": 0.5}
"""And the standard deviation of a reading: mm, of the cell MPa."""
SEED = 4

EDGES = np.geomspace(RADIUS, 400.0, 121)
MIDDLE, LENGTH = 0.5 * (EDGES[1:] + EDGES[:-1]), np.diff(EDGES)
LAME, SHEAR = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
BY_U = np.stack([[-1 / LENGTH, 1 / LENGTH], [0.5 / MIDDLE, 0.5 / MIDDLE]])  # (rr or tt, node, ring)
STIFF = np.array([[LAME + 2 * SHEAR, LAME], [LAME, LAME + 2 * SHEAR]])
WEIGHT = MIDDLE * LENGTH


def stiffness():
    """The stiffness of the rings by its diagonals; the outer edge is held."""
    blocks = np.einsum("ake,ab,bme,e->kme", BY_U, STIFF, BY_U, WEIGHT)
    diagonals = np.zeros((3, len(EDGES)))
    diagonals[1, :-1] += blocks[0, 0]
    diagonals[1, 1:] += blocks[1, 1]
    diagonals[0, 1:] = diagonals[2, :-1] = blocks[0, 1]
    diagonals[1, -1] *= 1e12
    return diagonals


K = stiffness()


def displacements(crept, wall):
    """Motions (nodes,), m, by creep strains (rr or tt, rings) and a pressure on the wall, MPa."""
    # creep keeps the volume: the stress that holds its strain along the axis acts here as well
    along = -LAME * crept.sum(axis=0)
    pull = np.einsum("ake,ae->ke", BY_U, (STIFF @ crept + along) * WEIGHT)
    forces = np.zeros(len(EDGES))
    forces[:-1] += pull[0]
    forces[1:] += pull[1]
    forces[0] += (wall - PRESSURE) * RADIUS  # what the excavation takes away
    return solve_banded((1, 1), K, forces)


BY_PRESSURE = displacements(np.zeros((2, len(MIDDLE))), PRESSURE + 1.0)[0]  # of the wall, m / MPa


def creep_rates(crept, u):
    """Rates (rr or tt, rings) by day of strains crept so far and motions."""
    strain = np.einsum("ake,ke->ae", BY_U, np.stack([u[:-1], u[1:]]))
    elastic = np.stack([*(strain - crept), crept.sum(axis=0)])
    deviator = 2 * SHEAR * (elastic - elastic.mean(axis=0))
    q = np.sqrt(1.5 * (deviator**2).sum(axis=0)) + 1e-12
    whole = np.stack([*crept, -crept.sum(axis=0)])
    e = np.sqrt(2.0 / 3.0 * (whole**2).sum(axis=0)) + 1e-9
    rate = M * (A * q**N) ** (1 / M) * e ** (1 - 1 / M)
    return 1.5 * rate / q * deviator[:2]


def at_face(t):
    """What the ground ahead and the face bear of the pressure, and its rate by day, MPa.

    Half of it when the section is excavated, and next to nothing when the face stands, at 20 m.
    """
    distance, speed = (ADVANCE * t, ADVANCE) if t < STANDS else (ADVANCE * STANDS, 0.0)
    left = 0.5 * PRESSURE * np.exp(-distance / (1.1 * RADIUS))
    return left, -left * speed / (1.1 * RADIUS)


def modulus(age):
    """Of the sprayed concrete, MPa."""
    return 27000.0 * np.sqrt(age / (4.2 + 0.85 * age))


def flow_rate(age):
    """By which it flows under 1 MPa, by day: the whole is 7e-5 age^(1/3)."""
    return 7e-5 / 3 * age ** (-2 / 3)


DELAYED, WITHIN = 1.5e-5, 3.0  # of its delayed elasticity: 1 / MPa, d
NU_RING = 0.2


def rates(t, y):
    """Of creep strains, hoop stress of the ring (MPa, compression) and its delayed strain."""
    crept, stress, delayed = y[:-2].reshape(2, -1), float(y[-2]), float(y[-1])
    face, face_rate = at_face(t)
    wall = stress * SHELL / RADIUS + face
    creeping = creep_rates(crept, displacements(crept, wall))
    free = displacements(creeping, PRESSURE)[0] + BY_PRESSURE * face_rate
    if t < LINED:
        return np.array([*creeping.ravel(), 0.0, 0.0])
    age = max(t - LINED, 1 / 12)
    later = (DELAYED * stress - delayed) / WITHIN
    flows = flow_rate(age) * stress + later
    E_ring = modulus(age) / (1 - NU_RING**2)
    soft = 1 / E_ring + BY_PRESSURE * SHELL / RADIUS**2
    return np.array([*creeping.ravel(), (-free / RADIUS - flows) / soft, later])


def history(moments):
    """Motions (nodes,), m, and hoop stress of the ring, MPa, at moments in days."""
    y, seen = np.zeros(2 * len(MIDDLE) + 2), {}
    for begin, end in pairwise(sorted({0.0, ZERO, LINED, STANDS, *moments})):
        y = solve_ivp(rates, (begin, end), y, "LSODA", rtol=1e-6, atol=1e-9).y[:, -1]
        wall = float(y[-2]) * SHELL / RADIUS + at_face(end)[0]
        seen[end] = displacements(y[:-2].reshape(2, -1), wall), float(y[-2])
    return seen


def readings():
    """What the channels (days, channels) read since their zero, without noise: mm, MPa."""
    seen, rows = history([float(day) for day in DAYS]), []
    for day in DAYS:
        u = 1e3 * (seen[day][0] - seen[ZERO][0])
        anchors = np.interp([RADIUS + 3, RADIUS + 10], EDGES, u)
        rows.append([*[2 * u[0]] * 3, *(anchors - u[0]), -seen[day][1]])
    return np.array(rows)


def write(path, exact, seed):
    """A file of readings with noise."""
    noise = np.random.default_rng(seed).normal(0.0, list(CHANNELS.values()), exact.shape)
    units = {name: "MPa" if name.startswith("cell") else "mm" for name in CHANNELS}
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["date", *(f"{name} ({unit})" for name, unit in units.items())])
        for day, row in zip(DAYS, exact + noise, strict=True):
            values = [f"{value:.2f}" for value in row]
            if day <= LINED:
                values[-1] = ""  # there is no ring
            table.writerow([BEGIN + timedelta(days=day), *values])


if __name__ == "__main__":
    write(HERE / "readings.csv", readings(), SEED)
