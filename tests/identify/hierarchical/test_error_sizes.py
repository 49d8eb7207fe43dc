"""Sizes of the errors of sections that are followed in time, against dense matrices."""

import numpy as np
import pytest
from scipy.stats import chi2

from geoident.identify.assessment.model_error import PRIOR_SD
from geoident.identify.hierarchical.error_sizes import (
    CommonCourse,
    SectionResiduals,
    SizesLikelihood,
    accuracies_off,
    correlation,
    likeliest_sizes,
)

COMMON = CommonCourse(np.linspace(0.0, 3.0, 10), 2)
SIZES = np.array([0.1, 1.3, 0.7, 0.2, 0.25, 1.1])
RIGHT = np.array([0.005, 1.0, 0.05, 0.005, 0.005, 1.0])
ALL, COURSE_ALONE = np.full(6, True), np.arange(6) == 3


def section(rng, *, readings=8, unknowns=3, scatter=1.0, course=0.0, accuracy=1.0):
    """Ten times as many accuracies as the gauges state have moved, in a smooth way.

    Args:
        rng: of all that is drawn.
        readings: of each of two kinds.
        unknowns: of all sections.
        scatter: of the readings, in accuracies.
        course: standard deviation of the course, in parts of the motion.
        accuracy: what the case states.
    """
    moments = np.tile(np.sort(rng.uniform(0.0, 3.0, readings)), 2)
    kinds = np.repeat([0, 1], readings)
    moved = np.sin(0.5 * moments) * np.where(kinds, 300.0, -200.0)
    k = correlation(moments, moments, 1.0) * (kinds[:, None] == kinds) + 1e-9 * np.eye(2 * readings)
    gap = scatter * rng.normal(size=2 * readings)
    gap += course * moved * (np.linalg.cholesky(k) @ rng.normal(size=2 * readings))
    gauges = accuracy**2 * np.eye(2 * readings)
    zeros = accuracy**2 * (kinds[:, None] == kinds)
    jacobian = 10.0 * rng.normal(size=(2 * readings, unknowns))
    model = np.outer(moved, moved) * (0.5 + 0.5 * k)
    return SectionResiduals(
        gap, jacobian, gauges, zeros, model, 0.0 * model, moved, moments, kinds
    )  # fmt: skip


def likelihood(sections, common=COMMON):
    unknowns = sections[0].jacobian.shape[1]
    return SizesLikelihood(sections, common, (np.zeros((0, unknowns)), np.zeros(0)))


def dense(sections, sizes):
    """-2 log L of sizes by the covariance of the readings of all sections."""
    eta, s, z, of_course, of_common, memory = sizes
    moments, kinds, moved, gap = (
        np.concatenate([getattr(one, name) for one in sections])
        for name in ("moments", "kinds", "moved", "gap")
    )
    J = np.concatenate([one.jacobian for one in sections])
    number = np.repeat(np.arange(len(sections)), [len(one.gap) for one in sections])
    same = number[:, None] == number
    own = np.zeros(same.shape)
    for k, one in enumerate(sections):
        at = np.ix_(number == k, number == k)
        own[at] = s**2 * (one.gauges + z**2 * one.zeros) + eta**2 * one.model
    k = np.exp(-np.abs(moments[:, None] - moments) / memory)
    course = k * np.outer(moved, moved) * (kinds[:, None] == kinds)
    basis = moved[:, None] * COMMON.basis(moments, kinds, memory)
    sigma = own + of_course**2 * same * course + of_common**2 * basis @ basis.T
    white = np.linalg.solve(np.linalg.cholesky(sigma), np.column_stack([J, gap]))
    A, r = white[:, :-1], white[:, -1]
    left = r - A @ np.linalg.lstsq(A, r)[0]
    return np.linalg.slogdet(sigma)[1] + np.linalg.slogdet(A.T @ A)[1] + left @ left


def test_the_likelihood_is_that_of_dense_matrices():
    rng = np.random.default_rng(0)
    sections = [section(rng, readings=n) for n in (3, 5, 4)]
    given, other = likelihood(sections), 2.0 * SIZES
    rise = given.value(other) - given.value(SIZES)
    assert rise == pytest.approx(dense(sections, other) - dense(sections, SIZES), rel=1e-6)


def test_what_sections_have_in_common_is_as_smooth_as_what_each_has():
    """Ten nodes are enough for it to have nearly the covariance of the others."""
    moments, kinds = np.linspace(0.0, 3.0, 40), np.zeros(40, dtype=np.int64)
    basis = COMMON.basis(moments, kinds, 1.0)
    np.testing.assert_allclose(basis @ basis.T, correlation(moments, moments, 1.0), atol=0.17)


@pytest.mark.parametrize("truth", [0.05, 0.3])
def test_the_size_of_the_course_is_found(truth):
    rng = np.random.default_rng(2)
    sections = [section(rng, course=truth) for _ in range(20)]
    found = likeliest_sizes(likelihood(sections), SIZES, ALL)
    assert found[3] == pytest.approx(truth, rel=0.35)
    assert found[4] < 0.6 * truth + 0.03
    assert found[1] == pytest.approx(1.0, abs=0.15)


def test_a_course_of_which_no_reading_tells_has_the_size_that_is_usual():
    """As many unknowns as readings."""
    sections = [section(np.random.default_rng(3), readings=2, unknowns=4)]
    start = np.array([0.1, 1.0, 1.0, 0.05, 0.005, 1.0])
    found = likeliest_sizes(likelihood(sections), start, COURSE_ALONE)
    assert found[3] == pytest.approx(PRIOR_SD, rel=0.01)


@pytest.mark.parametrize(("stated", "factor"), [(0.1, 10.0), (10.0, 0.1)])
def test_a_section_whose_accuracies_are_off_is_named(stated, factor):
    """One of ten states accuracies ten times too good, or ten times too bad."""
    rng = np.random.default_rng(4)
    sections = [section(rng) for _ in range(9)]
    sections.insert(5, section(rng, accuracy=stated))
    given = likelihood(sections)
    off = accuracies_off(given, likeliest_sizes(given, SIZES, ALL), chi2.isf(1e-4, 1))
    assert list(off) == [5]
    assert off[5].factor == pytest.approx(factor, rel=0.6)
    assert not off[5].or_model


def test_sound_sections_are_not_accused():
    accused = 0
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        sections = [section(rng, readings=4, course=0.05) for _ in range(8)]
        start = np.array([0.05, 1.0, 0.3, 0.05, 0.05, 1.0])
        accused += len(accuracies_off(likelihood(sections), start, chi2.isf(1e-4, 1)))
    assert accused == 0
