"""Readings of one gauge in time, with a noise that lasts."""

import numpy as np

from geoident.identify.in_time.noise import Noise

DAY = 86400.0
TRUTH = Noise(0.3, 0.5, 40.0 * DAY)
DRIFTING = Noise(0.3, 0.5, 40.0 * DAY, drift=0.4)
B = np.array([1.0, 2.0, 3.0, 4.0])


def times(m, rng):
    return np.sort(rng.choice(3650, m, replace=False)) * DAY


def effects(t):
    year = 2.0 * np.pi * t / (365.25 * DAY)
    return np.column_stack([np.ones(len(t)), t / (3650.0 * DAY), np.cos(year), np.sin(year)])


def covariance(noise, t):
    lasting = noise.lasting**2 * np.exp(-np.abs(t[:, None] - t) / noise.time)
    drift = noise.drift**2 * (1.0 + (np.minimum(t[:, None], t) - t[0]) / (365.25 * DAY))
    return noise.white**2 * np.eye(len(t)) + lasting + drift


def drawn(m, rng, noise=TRUTH):
    t = times(m, rng)
    root = np.linalg.cholesky(covariance(noise, t))
    return t, effects(t) @ B + root @ rng.standard_normal(m)
