"""One level, sections that scatter about it, linear: restricted likelihood in closed form.

Searle, Casella & McCulloch (1992), Variance Components, 4.8: the balanced one-way layout with the
variance within the groups given.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2, t
from support.sections import Formulas, Z, level, linear_model, name, quiet, section

from geoident.identify.hierarchical.knowledge import SectionsKnowledge, section_misfits
from geoident.identify.hierarchical.search import fit_sections

SD = 0.4
N = 5


def layout(tau, S=8, seed=1):
    rng = np.random.default_rng(seed)
    z = 2.0 + tau * rng.normal(size=S)
    return z[:, None] + SD * rng.normal(size=(S, N))


def fitted(y, **law):
    sections = [section(f"S{s}", (Z,), row, SD) for s, row in enumerate(y)]
    models = Formulas(tuple(linear_model(np.ones((N, 1))) for _ in y))
    return fit_sections(sections, (), (level(**law),), models, quiet)


def by_hand(y):
    means = y.mean(axis=1)
    between = N * np.sum((means - means.mean()) ** 2) / (len(y) - 1)
    tau2 = max(0.0, (between - SD**2) / N)
    kept = tau2 / (tau2 + SD**2 / N)
    return np.sqrt(tau2), means.mean(), means.mean() + kept * (means - means.mean())


def test_scatter_level_and_sections_are_those_of_the_closed_form():
    y = layout(0.7)
    tau, m, z = by_hand(y)
    fit = fitted(y)
    assert fit.outcome.status == "converged"
    np.testing.assert_allclose(fit.tau * fit.joint.law_scaling.reference, tau, rtol=1e-5)
    np.testing.assert_allclose(fit.outcome.values, [m, *z], rtol=1e-5)


def test_a_scatter_that_the_sections_do_not_show_is_zero():
    y = layout(0.0)
    y += (y.mean() - y.mean(axis=1))[:, None] * 0.9  # nearer to each other than by chance
    fit = fitted(y)
    assert by_hand(y)[0] == 0.0
    assert fit.tau[0] == 0.0
    assert not fit.joint.scattering.any()
    np.testing.assert_allclose(fit.outcome.values, [y.mean()], rtol=1e-7)
    low, high = SectionsKnowledge(fit).scatter.interval(0)
    assert low == 0.0
    assert high > 0.0


def test_intervals_know_that_the_scatter_is_known_poorly():
    """With a uniform density of tau and no noise the level has a t distribution."""
    y = np.repeat(layout(0.7, S=6).mean(axis=1)[:, None], N, axis=1)
    sections = [section(f"S{s}", (Z,), row, 1e-4) for s, row in enumerate(y)]
    models = Formulas(tuple(linear_model(np.ones((N, 1))) for _ in y))
    fit = fit_sections(sections, (), (level(),), models, quiet)
    knowledge = SectionsKnowledge(fit)
    # the density of tau is tau^-(S-1) exp(-SS / 2 tau^2): t with S - 2 degrees of freedom
    means = y.mean(axis=1)
    half = t.ppf(0.975, 4) * np.sqrt(np.sum((means - means.mean()) ** 2) / 4 / 6)
    low, high = knowledge.common().lower95[0], knowledge.common().upper95[0]
    np.testing.assert_allclose(high - low, 2 * half, rtol=0.01)
    # tau^2 = SS / chi2 with S - 2: the quantiles of its posterior hold 95 %
    low, high = np.array(knowledge.scatter.interval(0)) * fit.joint.law_scaling.reference[0]
    inside = np.diff(chi2.cdf(np.sum((means - means.mean()) ** 2) / np.array([high, low]) ** 2, 4))
    np.testing.assert_allclose(inside, 0.95, atol=0.003)


def test_a_law_without_scatter_that_leaves_the_bounds_of_a_section_keeps_a_little():
    """All sections are alike, and read less than the least that their parameter may be."""
    y = np.repeat(layout(0.0).mean(axis=1)[:, None], N, axis=1)
    bounded = replace(Z, lower=float(y.mean()) + 0.2, start=3.0)
    sections = [section(f"S{s}", (bounded,), row, SD) for s, row in enumerate(y)]
    models = Formulas(tuple(linear_model(np.ones((N, 1))) for _ in y))
    fit = fit_sections(sections, (), (level(),), models, quiet)
    assert fit.outcome.status == "converged"
    np.testing.assert_allclose(fit.outcome.values[1:], bounded.lower, rtol=1e-6)
    assert 0.0 < fit.tau[0] < 0.01 * fit.joint.largest[0]


def test_a_section_of_other_ground_is_found():
    y = layout(0.3, S=7)
    y[4] += 4.0
    found = [outlying for _, outlying in section_misfits(fitted(y))]
    assert found[4] < 1e-4
    assert min(found[:4] + found[5:]) > 0.01


def test_a_section_whose_readings_do_not_agree_is_found():
    y = layout(0.5)
    y[2] += [0.0, 3.0, -3.0, 2.0, -2.0]
    above = [misfit.above for misfit, _ in section_misfits(fitted(y))]
    assert above.pop(2) < 1e-6
    assert min(above) > 0.01


def test_two_laws_that_have_nothing_to_do_with_each_other_are_two_layouts():
    first, second = layout(0.7, S=5, seed=1), layout(1.5, S=5, seed=2)
    both = np.hstack([first, second])
    matrix = np.kron(np.eye(2), np.ones((N, 1)))
    other = replace(level(), parameter="y", formula=name("l"))
    other = replace(other, constants=(replace(other.constants[0], name="l"),))
    parameters = (Z, replace(Z, name="y"))
    sections = [section(f"S{s}", parameters, row, SD) for s, row in enumerate(both)]
    models = Formulas(tuple(linear_model(matrix) for _ in both))
    fit = fit_sections(sections, (), (level(), other), models, quiet)
    known = [by_hand(first), by_hand(second)]
    sizes = fit.tau * fit.joint.law_scaling.reference
    np.testing.assert_allclose(sizes, [known[0][0], known[1][0]], rtol=1e-4)
    np.testing.assert_allclose(fit.outcome.values[:2], [known[0][1], known[1][1]], rtol=1e-5)
    alone = SectionsKnowledge(fitted(second)).common()
    joint = SectionsKnowledge(fit).common()
    np.testing.assert_allclose(joint.sd[1], alone.sd[0], rtol=0.05)
    ends = np.array(SectionsKnowledge(fit).scatter.interval(1))
    apart = np.array(SectionsKnowledge(fitted(second)).scatter.interval(0))
    np.testing.assert_allclose(ends, apart, rtol=0.05)
