"""All sections at one point, against one dense problem of all unknowns, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2, norm
from support.three_sections import (
    COMMON,
    FURTHER,
    ORDERS,
    SCALE,
    TAU,
    E,
    H,
    Site,
)

from geoident.identify.hierarchical.knowledge import (
    SectionsKnowledge,
    section_misfits,
    total_misfit,
)
from geoident.identify.hierarchical.restricted_likelihood import ScatterPosterior


@pytest.fixture(scope="module")
def site():
    return Site()


@pytest.mark.parametrize("left_out", [(), (0,), (1,), (2,)], ids=str)
@pytest.mark.parametrize("tau", [TAU, np.array([0.05, 0.6]), np.array([0.0, 0.3])], ids=str)
def test_the_posterior_at_a_scatter_is_that_of_one_dense_problem(site, tau, left_out):
    """With all sections, and with one of them without its readings."""
    value, mean, covariance, X = site.dense(tau, left_out)
    linear = site.linear.without(*left_out) if left_out else site.linear
    found = linear.given(tau)
    assert found.minus_two_log == pytest.approx(value, abs=1e-6)
    np.testing.assert_allclose(found.common, mean[:5], rtol=1e-6)
    np.testing.assert_allclose(found.common_covariance, covariance[:5, :5], rtol=1e-6)
    for s, moved in enumerate(X):
        seen = [i for i, q in enumerate(ORDERS[s]) if s not in left_out or q.name not in "nu c"]
        np.testing.assert_allclose(found.sections[s][seen], (moved @ mean)[seen], rtol=1e-6)
        expected = (moved @ covariance @ moved.T)[np.ix_(seen, seen)]
        square = found.covariances[s][np.ix_(seen, seen)]
        np.testing.assert_allclose(square, expected, rtol=1e-5, atol=1e-9)


def natural(x, p, reference):
    """Where x from p is, SI."""
    return p * np.exp(x) if reference is None else p + x * reference


def check(found, values, off, variances, scales, bounds):
    """Values, root mean squares and 95 % ends of normals about estimates."""
    for i, (p, reference, (lower, upper)) in enumerate(zip(values, scales, bounds, strict=True)):
        half = norm.ppf(0.975) * np.sqrt(variances[i])
        size = p if reference is None else reference
        ends = [
            natural(min(off[i] - half, 0.0), p, reference),
            natural(max(off[i] + half, 0.0), p, reference),
        ]
        expected = [p, np.sqrt(off[i] ** 2 + variances[i]) * size, *np.clip(ends, lower, upper)]
        got = [found.value[i], found.sd[i], found.lower95[i], found.upper95[i]]
        np.testing.assert_allclose(got, expected, rtol=1e-6)


def of(order):
    return [SCALE[q.name] for q in order], [(q.lower, q.upper) for q in order]


def test_what_is_known_of_what_is_common_and_of_each_section_at_a_given_scatter(site):
    _, mean, covariance, X = site.dense(TAU)
    known = SectionsKnowledge(site.fit())
    bounds = [(0.1, 4.0), (0.01, 100.0), (-0.2, 0.2), (-70, 70), (-9, 9)]
    variances = np.diag(covariance)
    check(known.common(), site.common, mean, variances, COMMON.values(), bounds)
    for s, order in enumerate(ORDERS):
        off = X[s] @ mean - site.follows(s, order)[2]
        C = X[s] @ covariance @ X[s].T
        check(known.section(s), site.points[s], off, np.diag(C), *of(order))
        sizes = [p if SCALE[q.name] is None else SCALE[q.name]
                 for p, q in zip(site.points[s], order, strict=True)]  # fmt: skip
        expected = (C + np.outer(off, off)) * np.outer(sizes, sizes)
        np.testing.assert_allclose(known.section_covariance(s), expected, rtol=1e-5)
        _, _, cov, others = site.dense(TAU, (s,))
        part = np.diag(C) / np.diag(others[s] @ cov @ others[s].T)
        np.testing.assert_allclose(known.shrinkage(s), part, rtol=1e-5)


def test_a_further_section_has_the_laws_with_their_scatter_and_its_own_priors_or_bounds(site):
    """Own: a prior of nu, the bounds of c; from the law 0.3 and 0.15 beside what is not known."""
    _, mean, covariance, _ = site.dense(TAU)
    known = SectionsKnowledge(site.fit())
    order, law = FURTHER.parameters, site.law(3, site.f)
    Phi, Z, _ = site.follows(3, order)
    C = Phi @ covariance[:5, :5] @ Phi.T + (Z * TAU**2) @ Z.T
    C[1, 1] += np.log(90.0 / 0.2) ** 2 / 12.0
    C[4, 4] += (0.05 / 0.25) ** 2
    values = [law["h"] * SCALE["h"], 2.0, 1.35, np.exp(law["E"]), 0.22]
    found = known.further(FURTHER)
    check(found.interval, values, Phi @ mean[:5], np.diag(C), *of(order))
    np.testing.assert_allclose(found.means, (Phi @ mean[:5])[None], rtol=1e-6)
    np.testing.assert_allclose(found.covariances, C[None], rtol=1e-6)
    Phi = site.follows(3, (E, H))[0]  # the laws themselves, without scatter and bounds
    variances = np.diag(Phi @ covariance[:5, :5] @ Phi.T)
    values = [np.exp(law["E"]), law["h"] * SCALE["h"]]
    free = [(-np.inf, np.inf)] * 2
    check(known.law(FURTHER), values, Phi @ mean[:5], variances, of((E, H))[0], free)


def judged(squares, mean, spread):
    return np.sqrt(squares / mean), chi2(mean**2 / spread).sf(squares * mean / spread)


def test_what_is_left_of_the_sections_is_judged_by_its_two_moments(site):
    _, mean, covariance, X = site.dense(TAU)
    parts = []
    for s, (misfit, _) in enumerate(section_misfits(site.fit())):
        A, b = site.rows(s)
        left = b + A @ site.follows(s, ORDERS[s])[2] - A @ X[s] @ mean
        keep = np.eye(len(A)) - A @ X[s] @ covariance @ X[s].T @ A.T
        parts.append([left @ left, np.trace(keep), np.trace(keep @ keep)])
        assert (misfit.scale, misfit.above) == pytest.approx(judged(*parts[s]), rel=1e-5)
    whole = total_misfit(site.fit())
    expected = judged(*np.sum(parts, axis=0))
    assert (whole.scale, whole.above) == pytest.approx(expected, rel=1e-5)


def test_how_far_a_section_is_from_the_others_is_chi_squared(site):
    """Of its readings only what its own parameters cannot explain, and only what they see."""
    for s, (_, outlying) in enumerate(section_misfits(site.fit())):
        _, mean, covariance, X = site.dense(TAU, (s,))
        A, b = site.rows(s)
        own = [i for i, q in enumerate(ORDERS[s]) if q.name in ("nu", "c")]
        common = [i for i in range(len(ORDERS[s])) if i not in own]
        across = np.eye(len(A)) - A[:, own] @ np.linalg.pinv(A[:, own])
        basis = np.linalg.svd(across @ A[:, common], full_matrices=False)[0]
        d = basis.T @ (b + A @ site.follows(s, ORDERS[s])[2] - A @ X[s] @ mean)
        moved = basis.T @ A[:, common] @ X[s][common]
        V = np.eye(len(d)) + moved @ covariance @ moved.T
        expected = chi2(len(common)).sf(d @ np.linalg.solve(V, d))
        assert outlying == pytest.approx(expected, rel=1e-4)


def test_a_section_that_sees_nothing_of_what_is_common_is_of_any_ground(site):
    """All columns of what is common are zero: what is left is of its own parameters alone."""
    R = site.linear.R.copy()
    R[2][:, [1, 3, 4]] = 0.0
    blind = replace(site.fit(), linear=replace(site.linear, R=R))
    assert np.isnan(section_misfits(blind)[2][1])


def test_sections_at_several_scatters_are_a_mixture_of_normals(site):
    """Ends where a tail of 2.5 % is left, by a search of scipy's; squares add up."""
    nodes = np.array([[0.02, 0.05], [0.4, 0.1], [1.5, 1.1]])
    weights = np.array([0.2, 0.5, 0.3])
    known = SectionsKnowledge(site.fit(), ScatterPosterior(nodes, weights))
    found = known.further(FURTHER)
    for i, q in enumerate(FURTHER.parameters):
        mean, sd, p = found.means[:, i], np.sqrt(found.covariances[:, i, i]), found.values[i]

        def below(t, mean=mean, sd=sd):
            return weights @ norm.cdf(t, mean, sd)

        low, high = (
            natural(brentq(lambda t, p=part: below(t) - p, -60, 60, xtol=1e-13), p, SCALE[q.name])
            for part in (0.025, 0.975)
        )
        expected = np.clip([min(low, p), max(high, p)], q.lower, q.upper)
        got = [found.interval.lower95[i], found.interval.upper95[i]]
        np.testing.assert_allclose(got, expected, rtol=1e-7)
        size = p if SCALE[q.name] is None else SCALE[q.name]
        rms = size * np.sqrt(weights @ (mean**2 + sd**2))
        np.testing.assert_allclose(found.interval.sd[i], rms)
