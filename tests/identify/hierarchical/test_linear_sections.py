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

from geoident.identify.hierarchical.joint_problem import sd_of_bounds
from geoident.identify.hierarchical.knowledge import (
    SectionsKnowledge,
    section_misfits,
    total_misfit,
)
from geoident.identify.hierarchical.restricted_likelihood import ScatterPosterior
from geoident.model.parameter import Parameter


@pytest.fixture(scope="module")
def site():
    return Site()


@pytest.mark.parametrize("tau", [TAU, np.array([0.05, 0.6]), np.array([0.0, 0.3])], ids=str)
def test_the_posterior_at_a_scatter_is_that_of_one_dense_problem(site, tau):
    value, mean, covariance, X = site.dense(tau)
    found = site.linear.given(tau)
    assert found.minus_two_log == pytest.approx(value, abs=1e-6)
    assert site.linear.minus_two_log(tau) == found.minus_two_log
    np.testing.assert_allclose(found.common, mean[:5], rtol=1e-6)
    np.testing.assert_allclose(found.common_covariance, covariance[:5, :5], rtol=1e-6)
    for s, moved in enumerate(X):
        n = len(moved)
        np.testing.assert_allclose(found.sections[s][:n], moved @ mean, rtol=1e-6)
        np.testing.assert_array_equal(found.sections[s][n:], 0.0)
        expected = moved @ covariance @ moved.T
        np.testing.assert_allclose(found.covariances[s][:n, :n], expected, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("left_out", [0, 1, 2])
def test_a_section_without_its_readings_is_that_of_the_dense_problem_without_them(site, left_out):
    others = site.linear.without(left_out)
    value, mean, covariance, X = site.dense(TAU, (left_out,))
    found = others.given(TAU)
    assert found.minus_two_log == pytest.approx(value, abs=1e-6)
    np.testing.assert_allclose(found.common, mean[:5], rtol=1e-6)
    for s, moved in enumerate(X):
        kept = [i for i, q in enumerate(ORDERS[s]) if s != left_out or q.name not in ("nu", "c")]
        np.testing.assert_allclose(found.sections[s][kept], (moved @ mean)[kept], rtol=1e-6)
        expected = (moved @ covariance @ moved.T)[np.ix_(kept, kept)]
        square = found.covariances[s][np.ix_(kept, kept)]
        np.testing.assert_allclose(square, expected, rtol=1e-5, atol=1e-9)


def natural(x, p, reference):
    """Where x from p is, SI."""
    return p * np.exp(x) if reference is None else p + x * reference


def expected_interval(p, off, variance, reference):
    """Value, root mean square and 95 % ends of one normal about an estimate."""
    half = norm.ppf(0.975) * np.sqrt(variance)
    size = p if reference is None else reference
    ends = [
        natural(min(off - half, 0.0), p, reference),
        natural(max(off + half, 0.0), p, reference),
    ]
    return p, np.sqrt(off**2 + variance) * size, *ends


def intervals(found):
    return np.array([found.value, found.sd, found.lower95, found.upper95]).T


def test_what_is_known_of_what_is_common_at_a_given_scatter(site):
    _, mean, covariance, _ = site.dense(TAU)
    found = intervals(SectionsKnowledge(site.fit()).common())
    bounds = {"K0": (0.1, 4.0), "a": (0.01, 100.0), "b": (-0.2, 0.2), "m": (-70, 70), "n": (-9, 9)}
    for k, (name_, reference) in enumerate(COMMON.items()):
        p, sd, *ends = expected_interval(site.common[k], mean[k], covariance[k, k], reference)
        expected = [p, sd, *np.clip(ends, *bounds[name_])]
        np.testing.assert_allclose(found[k], expected, rtol=1e-6, err_msg=name_)


@pytest.mark.parametrize("s", [0, 1, 2])
def test_what_is_known_of_a_section_at_a_given_scatter(site, s):
    _, mean, covariance, X = site.dense(TAU)
    known = SectionsKnowledge(site.fit())
    found, whole = intervals(known.section(s)), known.section_covariance(s)
    off = X[s] @ mean - site.follows(s, ORDERS[s])[2]
    C = X[s] @ covariance @ X[s].T
    sizes = []
    for i, q in enumerate(ORDERS[s]):
        p = site.points[s][i]
        _, sd, *ends = expected_interval(p, off[i], C[i, i], SCALE[q.name])
        np.testing.assert_allclose(
            found[i], [p, sd, *np.clip(ends, q.lower, q.upper)], rtol=1e-6, err_msg=q.name
        )
        sizes.append(p if SCALE[q.name] is None else SCALE[q.name])
    expected = (C + np.outer(off, off)) * np.outer(sizes, sizes)
    np.testing.assert_allclose(whole, expected, rtol=1e-5)


def test_the_laws_at_a_section_are_known_without_its_scatter(site):
    _, mean, covariance, _ = site.dense(TAU)
    found = intervals(SectionsKnowledge(site.fit()).law(FURTHER))
    Phi = site.follows(3, (E, H))[0]
    law = site.law(3, site.f)
    for k, (name_, reference) in enumerate((("E", None), ("h", SCALE["h"]))):
        p = np.exp(law["E"]) if name_ == "E" else law["h"] * reference
        expected = expected_interval(
            p, Phi[k] @ mean[:5], Phi[k] @ covariance[:5, :5] @ Phi[k], reference
        )
        np.testing.assert_allclose(found[k], expected, rtol=1e-6)


def test_a_further_section_has_the_laws_with_their_scatter_and_its_own_priors_or_bounds(site):
    """Own: a prior of nu, the bounds of c; from the law 0.3 and 0.15 beside what is not known."""
    _, mean, covariance, _ = site.dense(TAU)
    found = SectionsKnowledge(site.fit()).further(FURTHER)
    order = FURTHER.parameters
    Phi, Z, _ = site.follows(3, order)
    C = Phi @ covariance[:5, :5] @ Phi.T + (Z * TAU**2) @ Z.T
    C[1, 1] += np.log(90.0 / 0.2) ** 2 / 12.0
    C[4, 4] += (0.05 / 0.25) ** 2
    off = Phi @ mean[:5]
    law = site.law(3, site.f)
    values = [law["h"] * SCALE["h"], 2.0, 1.35, np.exp(law["E"]), 0.22]
    np.testing.assert_allclose(found.values, values, rtol=1e-9)
    np.testing.assert_allclose(found.means, off[None], rtol=1e-6)
    np.testing.assert_allclose(found.covariances, C[None], rtol=1e-6)
    np.testing.assert_array_equal(found.weights, [1.0])
    for i, q in enumerate(order):
        p, sd, *ends = expected_interval(values[i], off[i], C[i, i], SCALE[q.name])
        expected = [p, sd, *np.clip(ends, q.lower, q.upper)]
        np.testing.assert_allclose(intervals(found.interval)[i], expected, rtol=1e-6)


@pytest.mark.parametrize("s", [0, 1, 2])
def test_what_the_others_tell_of_a_section_is_the_part_of_its_variance(site, s):
    whole = [moved @ cov @ moved.T for _, _, cov, X in [site.dense(TAU)] for moved in X]
    others = [m @ cov @ m.T for _, _, cov, X in [site.dense(TAU, (s,))] for m in X]
    expected = np.diag(whole[s]) / np.diag(others[s])
    found = SectionsKnowledge(site.fit()).shrinkage(s)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert np.all((found >= 0.0) & (found < 1.0))


def left_of(site, s):
    """Squares that are left of a section, and the first two moments of what chance leaves."""
    _, mean, covariance, X = site.dense(TAU)
    A, b = site.rows(s)
    left = b + A @ site.follows(s, ORDERS[s])[2] - A @ X[s] @ mean
    keep = np.eye(len(A)) - A @ X[s] @ covariance @ X[s].T @ A.T
    return left @ left, np.trace(keep), np.trace(keep @ keep)


def judged(squares, mean, spread):
    return np.sqrt(squares / mean), chi2(mean**2 / spread).sf(squares * mean / spread)


def test_what_is_left_of_the_sections_is_judged_by_its_two_moments(site):
    parts = [left_of(site, s) for s in range(3)]
    found = section_misfits(site.fit())
    for (one, _), part in zip(found, parts, strict=True):
        assert (one.scale, one.above) == pytest.approx(judged(*part), rel=1e-5)
    whole = total_misfit(site.fit())
    expected = judged(*np.sum(parts, axis=0))
    assert (whole.scale, whole.above) == pytest.approx(expected, rel=1e-5)


def test_how_far_a_section_is_from_the_others_is_chi_squared(site):
    """Of its readings only what its own parameters cannot explain, and only what they see."""
    found = section_misfits(site.fit())
    for s in range(3):
        _, mean, covariance, X = site.dense(TAU, (s,))
        A, b = site.rows(s)
        own = [i for i, q in enumerate(ORDERS[s]) if q.name in ("nu", "c")]
        common = [i for i in range(len(ORDERS[s])) if i not in own]
        across = np.eye(len(A)) - A[:, own] @ np.linalg.pinv(A[:, own])
        basis = np.linalg.svd(across @ A[:, common], full_matrices=False)[0]
        gap = site.follows(s, ORDERS[s])[2]
        d = basis.T @ (b + A @ gap - A @ X[s] @ mean)
        moved = basis.T @ A[:, common] @ X[s][common]
        V = np.eye(len(d)) + moved @ covariance @ moved.T
        expected = chi2(len(common)).sf(d @ np.linalg.solve(V, d))
        assert found[s][1] == pytest.approx(expected, rel=1e-4)


def test_a_section_that_sees_nothing_of_what_is_common_is_of_any_ground(site):
    """All columns of what is common are zero: what is left is of its own parameters alone."""
    R = site.linear.R.copy()
    R[2][:, [1, 3, 4]] = 0.0
    blind = replace(site.fit(), linear=replace(site.linear, R=R))
    assert np.isnan(section_misfits(blind)[2][1])


def test_sections_at_several_scatters_are_a_mixture_of_normals(site):
    """Ends where a tail of 2.5 % is left, by a search of scipy's; squares add up."""
    fit = site.fit()
    nodes = np.array([[0.02, 0.05], [0.4, 0.1], [1.5, 1.1]])
    weights = np.array([0.2, 0.5, 0.3])
    given = tuple(site.linear.given(node) for node in nodes)
    known = SectionsKnowledge(fit, ScatterPosterior(nodes, weights))
    found, own = known.further(FURTHER), known.section(1)
    for interval, values, means, variances, order in (
        (found.interval, found.values, found.means, [np.diag(C) for C in found.covariances],
         FURTHER.parameters),
        (own, site.points[1], [g.sections[1][:3] - site.linear.deviation[1][:3] for g in given],
         [np.diag(g.covariances[1])[:3] for g in given], ORDERS[1]),
    ):  # fmt: skip
        for i, q in enumerate(order):
            mean, sd = np.array([m[i] for m in means]), np.sqrt([v[i] for v in variances])
            ends = []
            for tail in (0.025, 0.975):
                at = brentq(
                    lambda t, mean=mean, sd=sd, tail=tail: weights @ norm.cdf(t, mean, sd) - tail,
                    -60.0, 60.0, xtol=1e-13,
                )  # fmt: skip
                ends.append(natural(at, values[i], SCALE[q.name]))
            expected = np.clip([min(ends[0], values[i]), max(ends[1], values[i])], q.lower, q.upper)
            got = [interval.lower95[i], interval.upper95[i]]
            np.testing.assert_allclose(got, expected, rtol=1e-7)
            size = values[i] if SCALE[q.name] is None else SCALE[q.name]
            np.testing.assert_allclose(interval.sd[i], size * np.sqrt(weights @ (mean**2 + sd**2)))
    square = known.section_covariance(1)
    np.testing.assert_allclose(np.sqrt(np.diag(square)), own.sd, rtol=1e-9)


def test_what_only_bounds_say_is_spread_evenly_between_them():
    """Width by root 12; ten references, or a factor e^10, where there is none."""
    assert sd_of_bounds(E) == pytest.approx(np.log(1e4) / np.sqrt(12.0))
    assert sd_of_bounds(H) == pytest.approx(10.0 / np.sqrt(12.0))
    for scale, lower in (("log", 0.0), ("linear", -np.inf)):
        one = Parameter("x", 7.0, lower, np.inf, scale)
        assert sd_of_bounds(one) == pytest.approx(10.0 / np.sqrt(12.0))
