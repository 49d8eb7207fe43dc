"""The zero of a survey was surveyed too: what later readings share through it."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.model.gauges import Channel, ErrorParts, Reading
from geoident.workflow.running.readings import error_structure

OWN, EPOCH, WALK = 0.3, 0.4, 0.2


def row(name, stage, parts, **more):
    channel = Channel(
        name, "L", "levelling", None, (0.0, 0.0), (0.0, -1.0), 1.0, "virgin", errors=parts, **more
    )
    return channel, Reading(name, stage, 0.0)


def covariance(rows):
    structure = error_structure(rows)
    shared = structure.columns.toarray()
    return np.diag(structure.sd**2) + shared @ shared.T


def test_a_surveyed_zero_gives_its_set_up_to_all_later_readings():
    """Var = own^2 + zero^2 + 2 epoch^2; of points at one epoch 2 epoch^2, at two epoch^2."""
    parts = ErrorParts(OWN, zero=OWN, epoch=EPOCH, zero_surveyed=1.0)
    rows = [row("L.a", "s1", parts), row("L.b", "s1", parts), row("L.b", "s2", parts)]
    both = EPOCH**2
    whole = 2 * OWN**2 + 2 * both
    expected = [
        [whole, 2 * both, both],
        [2 * both, whole, OWN**2 + both],
        [both, OWN**2 + both, whole],
    ]
    np.testing.assert_allclose(covariance(rows), expected, rtol=1e-12)
    assert rows[0][0].sd(rows[0][1]) == pytest.approx(np.sqrt(whole))
    assert parts.total() == pytest.approx(np.sqrt(whole))


def test_a_stated_zero_is_all_of_its_error():
    parts = ErrorParts(OWN, zero=OWN, epoch=EPOCH)
    rows = [row("L.a", "s1", parts), row("L.b", "s2", parts)]
    assert covariance(rows)[0, 1] == 0.0


def test_the_walk_of_the_zero_adds_up_along_the_casing_too():
    parts = ErrorParts(OWN, along=WALK, zero_surveyed=1.0)
    low = row("I.A5", "s1", parts, run="I.A", along=4.0)
    high = row("I.A0", "s2", parts, run="I.A", along=9.0)
    found = covariance([low, high])
    assert found[0, 1] == pytest.approx(WALK**2 * 4.0)
    assert found[1, 1] == pytest.approx(OWN**2 + 2 * WALK**2 * 9.0)


def test_probes_of_one_gauge_share_no_set_up():
    parts = ErrorParts(OWN, epoch=EPOCH)
    rows = [row("L.a", "s1", parts), row("L.S1", "s1", parts, probe="rings")]
    assert covariance(rows)[0, 1] == 0.0
