"""Endings of the search: what it began with, where it was stopped, where it does not settle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.sections import quiet
from support.three_sections import HEAD, MODULUS, ORDERS, Site

from geoident.identify.hierarchical import search
from geoident.identify.hierarchical.search import SectionsStart, fit_sections
from geoident.model.project.project import Scatter

ESTIMATED = (
    replace(MODULUS, scatter=Scatter("estimate")),
    replace(HEAD, scatter=Scatter("given", 1.5)),
)


@pytest.fixture(scope="module")
def site():
    return Site()


def searched(site, on_iteration=quiet, laws=ESTIMATED, **more):
    return fit_sections(site.sections, ("K0",), laws, site.models, on_iteration, **more)


def test_a_settled_search_ends_at_the_minimum_at_the_most_likely_scatter(site):
    """Begun at its end, or from elsewhere, it finds the same; given scatters stay."""
    fit = searched(site)
    assert fit.outcome.status == "converged"
    assert fit.free.tolist() == [True, False]
    assert fit.tau[1] == pytest.approx(0.15)
    assert [step.number for step in fit.outcome.iterations] == list(
        range(len(fit.outcome.iterations))
    )
    points = tuple(fit.joint.points(fit.outcome.values).values())
    again = searched(site, begin=SectionsStart(fit.outcome.values[:5], points, fit.tau))
    elsewhere = searched(site, begin=SectionsStart(tau=np.array([0.01, 99.0])))
    for other in (again, elsewhere):
        np.testing.assert_allclose(other.tau, fit.tau, rtol=1e-4)
        np.testing.assert_allclose(other.outcome.values, fit.outcome.values, rtol=1e-4)
    likely = fit.linear.minus_two_log(fit.tau)
    assert all(fit.linear.minus_two_log(fit.tau * [f, 1.0]) > likely for f in (0.9, 1.1))


def test_a_search_may_begin_elsewhere(site):
    """Common values as given; of points what is a number, the rest from what is common."""
    common = np.array([1.4, 1.5, 0.03, 3.0, 0.7])
    points = tuple(np.full(len(order), np.nan) for order in ORDERS)
    points[0][0], points[2][0] = 8.0, 3.3
    seen = []

    def stop(iteration):
        seen.append(iteration.values)
        return "Enough."

    fit = searched(site, stop, begin=SectionsStart(common=common, points=points))
    assert (fit.outcome.status, fit.outcome.reason) == ("out-of-budget", "Enough.")
    start = dict(zip([q.name for q in fit.joint.unknowns], seen[0], strict=True))
    np.testing.assert_allclose(seen[0][:5], common)
    assert (start["E of S0"], start["c of S2"]) == pytest.approx((8.0, 3.3))
    assert start["E of S1"] == pytest.approx(1.5 * np.exp(0.03 * 47.0))
    assert start["h of S2"] == pytest.approx(3.0 + 0.7 * 3.2)
    assert start["nu of S0"] == pytest.approx(0.22)


def test_a_scatter_that_does_not_settle_is_said(site, monkeypatch):
    monkeypatch.setattr(search, "_ROUNDS", 2)
    found = searched(site)
    assert found.outcome.status == "not-converged"
    assert found.outcome.reason == "The scatter about the laws was not settled after 2 rounds."
