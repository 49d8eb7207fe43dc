"""Makes readings.csv: salt that creeps by a power of its stress, plus noise.

A computation of its own: rings of elements about the axis, elastic and incompressible in creep
(Norton, de/dt = 3/2 A q^(n-1) s), and a thin ring of shotcrete that hardens by Eurocode 2. Nothing
of it is in the program. Run: python make_readings.py.
"""

import csv
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import solve_banded

HERE = Path(__file__).resolve().parent
RADIUS, SHELL, PRESSURE = 4.0, 0.25, 14e6  # m, m, Pa
E, NU = 18e9, 0.3
A, N = 1.5e-8, 3  # per day and MPa^3
SHOTCRETE, NU_SHOTCRETE, CEMENT, LINED = 27e9, 0.2, 0.2, 3.0  # Pa, -, -, day
DAYS = [2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 24, 30, 37, 44, 51, 61]
SEED = 4

EDGES = np.geomspace(RADIUS, 400.0, 161)
MIDDLE, LENGTH = 0.5 * (EDGES[1:] + EDGES[:-1]), np.diff(EDGES)
LAME, SHEAR = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
BY_U = np.stack([[-1 / LENGTH, 1 / LENGTH], [0.5 / MIDDLE, 0.5 / MIDDLE]])  # (rr or tt, node, ring)
STIFF = np.array([[LAME + 2 * SHEAR, LAME], [LAME, LAME + 2 * SHEAR]])
WEIGHT = MIDDLE * LENGTH


def banded() -> np.ndarray:
    """The stiffness of the rings by its diagonals; the outer edge is held."""
    blocks = np.einsum("ake,ab,bme,e->kme", BY_U, STIFF, BY_U, WEIGHT)
    diagonals = np.zeros((3, len(EDGES)))
    diagonals[1, :-1] += blocks[0, 0]
    diagonals[1, 1:] += blocks[1, 1]
    diagonals[0, 1:] = diagonals[2, :-1] = blocks[0, 1]
    diagonals[1, -1] *= 1e12
    return diagonals


K = banded()


def displacements(crept: np.ndarray, wall: float) -> np.ndarray:
    """Of creep strains (rr, tt) and a pressure on the wall, since the virgin state."""
    forces = np.zeros(len(EDGES))
    pull = np.einsum("ake,ab,be,e->ke", BY_U, STIFF, crept, WEIGHT)
    # creep keeps the volume: its strain along the axis is held by a stress that acts here as well
    along = LAME * -(crept[0] + crept[1])
    pull += np.einsum("ake,e,e->ke", BY_U, along, WEIGHT)
    forces[:-1] += pull[0]
    forces[1:] += pull[1]
    forces[0] += (wall - PRESSURE) * RADIUS  # what the excavation takes away
    return solve_banded((1, 1), K, forces)


UNIT = displacements(np.zeros((2, len(MIDDLE))), PRESSURE + 1.0)[0]  # of the wall, by 1 Pa on it


def creep_rates(crept: np.ndarray, wall: float) -> np.ndarray:
    """Rates (rr, tt) by day."""
    u = displacements(crept, wall)
    strain = np.einsum("ake,ke->ae", BY_U, np.stack([u[:-1], u[1:]]))
    elastic = np.stack([*(strain - crept), crept[0] + crept[1]])
    stress = LAME * elastic.sum(axis=0) + 2 * SHEAR * elastic
    deviator = (stress - stress.mean(axis=0)) / 1e6
    q = np.sqrt(1.5 * (deviator**2).sum(axis=0))
    return 1.5 * A * q ** (N - 1) * deviator[:2]


def rate(t: float, y: np.ndarray) -> np.ndarray:
    """Rates of the creep strains and of the pressure of the lining on the wall."""
    crept, wall = y[:-1].reshape(2, -1), float(y[-1])
    rates = creep_rates(crept, wall)
    free = displacements(rates, PRESSURE)[0]  # motion of the wall by the creep alone
    rise = 0.0
    if t >= LINED:
        age = max(t - LINED, 1 / 24)
        modulus = SHOTCRETE * np.exp(CEMENT * (1 - np.sqrt(28 / age))) ** 0.3
        ring = modulus / (1 - NU_SHOTCRETE**2) * SHELL / RADIUS**2
        rise = -ring * free / (1 + ring * UNIT)
    return np.append(rates.ravel(), rise)


def main() -> None:
    y, seen = np.zeros(2 * len(MIDDLE) + 1), {}
    days = [0.0, 1.0, 2.0, LINED, *(d for d in DAYS if d > LINED)]
    for begin, end in pairwise(days):
        y = solve_ivp(rate, (begin, end), y, "LSODA", rtol=1e-7, atol=1e-10).y[:, -1]
        seen[end] = displacements(y[:-1].reshape(2, -1), float(y[-1]))
    rng = np.random.default_rng(SEED)
    with (HERE / "readings.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(
            ["date", *(f"{name} (mm)" for name in ("C0", "C45", "C90", "EX.a2", "EX.a8"))]
        )
        for day in DAYS:
            u = 1e3 * (seen[day] - seen[1.0])
            wall, at = u[0], np.interp([6.0, 12.0], EDGES, u)
            values = [2 * wall, 2 * wall, 2 * wall, *(at - wall)]
            noise = rng.normal(0.0, [0.3, 0.3, 0.3, 0.1, 0.1])
            when = date(2024, 3, 1) + timedelta(day)
            table.writerow([when, *(f"{v:.2f}" for v in values + noise)])
            print(day, np.round(values, 2))
    print(f"pressure on the lining at the end: {y[-1] / 1e6:.2f} MPa")


if __name__ == "__main__":
    main()
