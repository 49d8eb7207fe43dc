"""What each new reading says that those before it did not (theory 16.3).

After the readings that a regression rests on, its coefficients, the lasting error and the drift
have a mean and a covariance. A filter carries them from reading to reading and gives of each the
innovation

    e_k = (y_k - prediction before k) / its standard deviation ,

independent of all others and of variance one as long as model and noise are what they were. The
filter is linear: what a step or a drift that begins with some reading does to the innovations after
it follows with the same gains, from zero.
"""

from __future__ import annotations

import numpy as np

from geoident.identify.in_time.noise import PROCESSES, Noise
from geoident.identify.in_time.regression import GaugeState
from geoident.model.arrays import Bools, Floats


class Filter:
    """Gains for readings of one gauge at given times, whatever they will be.

    Args:
        state: what is known of the gauge before.
        times: (m,) s, increasing, after that.
        X: (m, q) what explains the new readings.
        skipped: (m,) readings that are predicted, but tell nothing; None for none.

    Attributes:
        sd: (m,) standard deviations of a reading about its prediction, SI.
    """

    def __init__(
        self, state: GaugeState, times: Floats, X: Floats, skipped: Bools | None = None
    ) -> None:
        self.times, self.columns, self.state = times, X, state
        self.skipped = np.zeros(len(times), dtype=np.bool_) if skipped is None else skipped
        P, noise = state.P.copy(), state.noise
        elapsed = np.diff(times, prepend=state.time)
        self._phi = noise.remaining(elapsed)
        self._H = np.column_stack([X, np.ones((len(times), PROCESSES))])
        own = slice(X.shape[1], None)  # of the state: the processes
        diagonal = np.arange(X.shape[1], self._H.shape[1])
        self._gain = np.zeros_like(self._H)
        self.sd: Floats = np.zeros(len(times))
        steps = zip(self._phi, noise.added(elapsed), self._H, strict=True)
        for k, (phi, added, h) in enumerate(steps):
            P[own] *= phi[:, None]
            P[:, own] *= phi
            P[diagonal, diagonal] += added
            Ph = P @ h
            variance = max(float(h @ Ph), 0.0) + noise.white**2  # rounding may leave less
            self.sd[k] = np.sqrt(variance)
            if not self.skipped[k]:
                self._gain[k] = Ph / variance
                P -= np.outer(Ph, self._gain[k])
        self._P = P

    def predicted(self, y: Floats) -> Floats:
        """(m,) what each of the readings y (m,) was expected to be before it was taken, SI."""
        return y - self._run(y[:, None], self.state.mean[:, None])[0][:, 0]

    def end(self, y: Floats) -> GaugeState:
        """What is known of the gauge after readings y (m,), SI."""
        mean = self._run(y[:, None], self.state.mean[:, None])[1][:, 0]
        return GaugeState(self.state.noise, float(self.times[-1]), mean, self._P)

    def effects(self, changes: Floats) -> Floats:
        """What changes (m, c) of the readings, SI, do to the innovations, (m, c).

        Nothing to those of readings that are skipped.
        """
        start = np.zeros((self._H.shape[1], changes.shape[1]))
        g = self._run(changes, start)[0] / self.sd[:, None]
        g[self.skipped] = 0.0
        return g

    def _run(self, columns: Floats, state: Floats) -> tuple[Floats, Floats]:
        """Columns (m, c) less what is expected, and the last state (q + 2, c), of a first one."""
        left = np.empty_like(columns)
        state = state.copy()
        for k, (phi, h, gain) in enumerate(zip(self._phi, self._H, self._gain, strict=True)):
            state[-PROCESSES:] *= phi[:, None]
            left[k] = columns[k] - h @ state
            state += np.outer(gain, left[k])
        return left, state


def whitening(noise: Noise, times: Floats) -> Filter:
    """The filter whose `effects` of errors (m, c), SI, are L^-1 of them, with Sigma = L L^T.

    Args:
        noise: of the gauge.
        times: (m,) s, increasing.
    """
    start = GaugeState(noise, float(times[0]), np.zeros(PROCESSES), np.diag(noise.at_first))
    return Filter(start, times, np.zeros((len(times), 0)))


def single_wrong(state: GaugeState, times: Floats, X: Floats, y: Floats, far: float) -> Bools:
    """(m,) readings that are far off alone: those after them are as if they had not been.

    A reading that begins a step is none of them. Of the last one nobody knows.

    Args:
        state: what is known of the gauge before.
        times: (m,) s, increasing.
        X: (m, q) what explains them.
        y: (m,) readings, SI.
        far: innovation from which on a reading is looked at.
    """
    wrong = np.zeros(len(y), dtype=np.bool_)
    first = 0
    while True:
        filtered = Filter(state, times, X, wrong)
        e = (y - filtered.predicted(y)) / filtered.sd
        e[wrong] = 0.0
        far_off = np.flatnonzero(np.abs(e[first:-1]) > far)
        if not far_off.size:
            return wrong
        k = first + int(far_off[0])
        alone, onward = np.zeros((2, len(y)))
        alone[k], onward[k:] = 1.0, 1.0
        g = filtered.effects(np.column_stack([alone, onward]))
        z2 = (g.T @ e) ** 2 / (g**2).sum(axis=0)
        wrong[k] = z2[0] > z2[1]
        first = k + 1
