"""Runs of one model do not know of each other: two at once are two one after the other."""

from __future__ import annotations

from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from support.yielding import Cavity, mohr, parameters, rock

from geoident.errors import CollapseError
from geoident.forward.march.march import RunOptions
from geoident.model.actions import PointForce
from geoident.model.case import Stage
from geoident.model.parameter import Scalar

CAVITY = Cavity(pressure=10e6)
STAGES = (
    Stage("part", excavate=("core",), release={"core": Scalar(0.6)}),
    Stage("all", release={"core": Scalar(1.0)}),
    Stage("same ground", loads={"p": PointForce((0.0, 2.0), (Scalar(0.0), Scalar(1e4)))}),
)
HERE, THERE = np.array([2e9, 2.5e6]), np.array([3e9, 8e6])


def staged(surface, stages=STAGES):
    mesh = CAVITY.mesh("quad8", n=3, layers=10, reach=8)
    ground = replace(rock(Scalar(1.0, "E"), 0.3, surface))
    return CAVITY.staged(
        mesh, stages=stages, parameters=parameters(E=2e9, c=2.5e6), materials={"rock": ground}
    )


def copies(run):
    """Displacements, stresses and what yields, state by state."""
    for end in run.states():
        yield end.u.copy(), end.stress.copy(), end.yielded.copy()


SURFACES = {
    "elastic": mohr(Scalar(1e3, "c"), 0.5),
    "polyhedral": mohr(Scalar(1.0, "c"), 0.5, planes=12),
    "smooth": mohr(Scalar(1.0, "c"), 0.5),
    "not associated": mohr(Scalar(1.0, "c"), 0.5, psi=0.3),
}


@pytest.mark.parametrize("name", SURFACES)
def test_two_runs_at_once_equal_two_one_after_the_other(name):
    alone = [list(copies(staged(SURFACES[name]).at(p))) for p in (HERE, THERE)]
    model = staged(SURFACES[name])
    runs = [model.at(p) for p in (HERE, THERE)]
    mixed = list(zip_longest(*map(copies, runs)))
    assert len(mixed) == 1 + len(STAGES)
    for states, expected in zip(zip(*mixed, strict=True), alone, strict=True):
        for found, wanted in zip(states, expected, strict=True):
            for one, other in zip(found, wanted, strict=True):
                scale = np.abs(other).max(initial=0.0)
                np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * scale)
    findings = [run.findings.plastic.planes.activity() for run in runs]
    assert not np.array_equal(findings[0].distances, findings[1].distances)
    for p, found in zip((HERE, THERE), findings, strict=True):
        lone = staged(SURFACES[name]).at(p)
        list(lone.states())
        np.testing.assert_array_equal(found.points, lone.findings.plastic.planes.activity().points)
        np.testing.assert_allclose(
            found.reached, lone.findings.plastic.planes.activity().reached, rtol=1e-9
        )


def test_a_run_that_another_overtakes_factorizes_anew():
    """Two stages on the same ground share a factor, unless the other run took its place."""
    elastic = mohr(Scalar(1e3, "c"), 0.5)
    model = staged(elastic)
    model = CAVITY.staged(
        model.mesh, stages=STAGES, parameters=parameters(E=2e9, c=2.5e6),
        materials={"rock": rock(Scalar(1.0, "E"), 0.3)},
    )  # fmt: skip
    first, second = (model.at(p) for p in (HERE, THERE))
    before = model.counts.factorizations
    list(first.states())
    alone = model.counts.factorizations - before
    mixed = list(zip_longest(copies(model.at(HERE)), copies(second)))
    spent = model.counts.factorizations - before - alone
    assert alone < len(STAGES)
    assert 2 * alone <= spent <= 2 * len(STAGES)
    expected = list(copies(model.at(HERE)))
    for (found, _), wanted in zip(mixed, expected, strict=True):
        np.testing.assert_array_equal(found[0], wanted[0])


def test_collapses_belong_to_the_run_that_met_them():
    model = staged(mohr(Scalar(1.0, "c"), 0.0))
    weak, strong = np.array([2e9, 0.05e6]), np.array([2e9, 50e6])
    options = RunOptions(explain=False, partial=True)
    runs = [model.at(p, options) for p in (weak, strong)]
    for _ in zip_longest(*(run.states() for run in runs)):
        pass
    assert len(runs[0].findings.collapses) == 1
    assert isinstance(runs[0].findings.collapses[0], CollapseError)
    assert runs[1].findings.collapses == ()
