"""A thin ring on springs in elastic ground that is unloaded, in closed form: it slips."""

from __future__ import annotations

import numpy as np


def slipping_ring(
    K: float, EA: float, EI: float, k_n: float, k_s: float,
    *, p: float, radius: float, E: float, nu: float,
) -> tuple[float, float, float]:  # fmt: skip
    """N is the first less or more the second times cos 2a, M the third times it.

    The springs have the in-situ tractions t_0 and part by (t - t_0) / k. Mean stress: p R^2 / EA =
    (p0 - p) (R / (2 G) + 1 / k_n). With cos 2a Michell's A / r^2 + B in the ground. Without shear
    stiffness it is the full slip of Einstein and Schwartz (1979).

    Args:
        K, p: of the in-situ stress, p upright.
        EA, EI: of the ring, per metre.
        k_n, k_s: of the springs, Pa/m.
        radius: m.
        E, nu: of the ground.
    """
    G, R, S = E / (2 * (1 + nu)), radius, p * (1 - K) / 2
    load = np.array([[-6 / R**4, -4 / R**2], [-6 / R**4, -2 / R**2]])  # of A and B
    motion = np.array([[2 / R**3, 4 * (1 - nu) / R], [2 / R**3, -(2 - 4 * nu) / R]]) / (2 * G)
    stretch, bend = np.array([1.0, 2.0]) / R, np.array([-4.0, -2.0]) / R**2
    ring = EA * np.outer(stretch, stretch) + EI * np.outer(bend, bend)
    more = np.eye(2) + ring @ np.diag([1 / k_n, 1 / k_s])
    state = np.linalg.solve(ring @ motion - more @ load, np.array([S, -S]))
    moved = motion @ state - load @ state / [k_n, k_s]
    mean = -p * (1 + K) / 2 * R / (1 + R * R / EA / (R / (2 * G) + 1 / k_n))
    return mean, float(EA * stretch @ moved), float(EI * bend @ moved)
