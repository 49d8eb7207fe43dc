"""The sign of the acoustic tensor against what is known of perfect plasticity."""

from __future__ import annotations

import numpy as np
import pytest

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


def test_flow_without_dilation_does_and_hardening_ground_does_not():
    """Rudnicki and Rice 1975: the larger friction less dilation, the more it must harden."""
    tangents = [drucker_prager(0.3, 0.0, H) for H in (0.0, 5.0)]
    assert may_localise(np.array(tangents)).tolist() == [True, False]
    plane = np.ix_([0, 1, 2, 3], [0, 1, 2, 3])
    in_plane = np.array([D[plane] for D in tangents])
    assert may_localise(in_plane).tolist() == [True, False]


@pytest.mark.parametrize("hardening", [0.01, 0.05])
def test_dilation_as_large_as_the_friction_needs_less_hardening(hardening):
    assert not may_localise(drucker_prager(0.3, 0.3, hardening)[None])[0]
    assert may_localise(drucker_prager(0.6, -0.3, hardening)[None])[0]
