"""The sign of the acoustic tensor against what is known of perfect plasticity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoident.fem.yielding.localisation import may_localise


def drucker_prager(friction: float, dilation: float, hardening: float) -> np.ndarray:
    """Tangent (6, 6) under pure shear xx = -yy, by hand: D = E - E g f E / (f E g + H)."""
    lame, shear = 1.0, 1.0
    E = np.diag([2.0 * shear] * 3 + [shear] * 3)
    E[:3, :3] += lame
    deviator = np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0]) / np.sqrt(2.0)
    volume = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    f, g = deviator + friction * volume, deviator + dilation * volume
    return E - np.outer(E @ g, E @ f) / (f @ E @ g + hardening)


def test_elastic_ground_does_not():
    assert not may_localise(drucker_prager(0.0, 0.0, 1e9)[None]).any()


PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def turned(tangent: np.ndarray, R: np.ndarray) -> np.ndarray:
    """A tangent (6, 6) in axes that are turned by R (3, 3), by the tensor of fourth order."""
    full = np.empty((3, 3, 3, 3))
    for (i, j), row in zip(PAIRS, tangent, strict=True):
        for (m, n), value in zip(PAIRS, row, strict=True):
            full[[i, i, j, j], [j, j, i, i], [m, n, m, n], [n, m, n, m]] = value
    full = np.einsum("ai,bj,ck,dl,ijkl->abcd", R, R, R, R, full)
    return np.array([[full[i, j, m, n] for m, n in PAIRS] for i, j in PAIRS])


def critical_hardening(friction: float, dilation: float) -> float:
    """Rudnicki and Rice 1975, equation 20, in the scale of `drucker_prager`, whose nu is 1/4."""
    mu, beta, nu = 3.0 * friction / np.sqrt(2.0), 3.0 * dilation / np.sqrt(2.0), 0.25
    of_difference = (1.0 + nu) / (9.0 * (1.0 - nu)) * (beta - mu) ** 2
    return float(2.0 * (of_difference - 0.5 * (1.0 + nu) * ((beta + mu) / 3.0) ** 2))


@pytest.mark.parametrize(("friction", "dilation"), [(0.3, 0.0), (0.6, -0.3), (0.3, 0.1)])
def test_critical_hardening_in_any_axes(friction, dilation):
    """However the axes lie, a band is found up to what its normal, tried in steps, may miss."""
    critical = critical_hardening(friction, dilation)
    for axes, missed in (
        (Rotation.random(24, random_state=1).as_matrix(), 0.025),
        (Rotation.from_rotvec(np.outer(np.arange(0.0, 3.2, 0.13), [0, 0, 1])).as_matrix(), 2e-3),
    ):
        for hardening, bands in ((critical - missed, True), (critical + missed, False)):
            tangent = drucker_prager(friction, dilation, hardening)
            tangents = np.array([turned(tangent, R) for R in axes])
            if missed < 0.025:
                tangents = tangents[:, :4, :4]
            assert np.all(may_localise(tangents) == bands)


def test_ground_without_any_stiffness_does():
    """As at the tip of a cone, where the determinant is zero to the last bit."""
    assert may_localise(np.zeros((1, 4, 4)))[0]
    assert may_localise(np.zeros((1, 6, 6)))[0]
