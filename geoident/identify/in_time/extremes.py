"""How far readings of the coming time may go (theory 16.5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.identify.in_time.noise import PROCESSES, Noise
from geoident.identify.in_time.regression import GaugeState
from geoident.model.arrays import Floats
from geoident.model.in_service import YEAR


def simulated_readings(
    state: GaugeState,
    likely: Sequence[Noise],
    times: Floats,
    columns: Floats,
    number: int,
    rng: np.random.Generator,
) -> Floats:
    """(number, m) readings of a gauge that may come, SI.

    Each has loads, coefficients, errors and a noise of its own, from what may be.

    Args:
        state: what is known of the gauge.
        likely: noises, all as likely.
        times: (m,) s, increasing, after that.
        columns: (c, m, q) what explains the readings under each of c possible loads.
        number: of simulations.
        rng: random numbers.
    """
    size = len(state.mean)
    drawn = state.mean + state.drawn(rng.standard_normal((number, size)).T).T
    load = rng.integers(len(columns), size=number)
    readings = np.einsum("smq,sq->sm", columns[load], drawn[:, :-PROCESSES])
    noise = [likely[k] for k in rng.integers(len(likely), size=number)]
    parts = [(one.white, one.lasting, one.time, one.drift) for one in noise]
    white, lasting, fades, drift = np.array(parts).T
    x, s = drawn[:, -PROCESSES:].T
    for k, elapsed in enumerate(np.diff(times, prepend=state.time)):
        phi = np.exp(-elapsed / fades)
        own, eps, eta = rng.standard_normal((3, number))
        x = phi * x + lasting * np.sqrt(1.0 - phi**2) * eps
        s = s + drift * np.sqrt(elapsed / YEAR) * eta
        readings[:, k] += x + s + white * own
    return np.asarray(readings)
