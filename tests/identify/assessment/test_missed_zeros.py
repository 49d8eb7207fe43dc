"""Missed zeros of many channels: as dense matrices have them, in far less memory."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.assessment.changed_readings import Linearized
from geoident.identify.assessment.mistakes import Suspects, find_mistakes
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.parameter import Parameter

STAGES = 3


@pytest.fixture
def make_levelling(make_problem):
    """Readings of channels in three stages, linear in two parameters, with an error of each zero.

    The problem, and the channel of each reading (g,).
    """

    def make(channels):
        rng = np.random.default_rng(4)
        channel = np.repeat(np.arange(channels), STAGES)
        stage = np.tile([1.0, 2.0, 3.0], channels)
        matrix = rng.uniform(1.0, 2.0, (len(channel), 2)) * stage[:, None]
        parameters = [Parameter(name, 1.0, -5.0, 5.0, "linear") for name in ("a", "b")]
        measured = matrix @ np.ones(2) + 0.1 * rng.standard_normal(len(channel))
        problem = make_problem(lambda p: matrix @ p, parameters, measured, 0.1)
        return problem, channel

    return make


def of_channels(channel, size):
    """One shared error (g, channels) of each channel."""
    count = np.arange(len(channel))
    return sp.csr_array((np.full(len(channel), size), (count, channel)))


def test_what_zeros_gain_is_that_of_dense_matrices(make_levelling):
    problem, channel = make_levelling(120)
    everywhere = np.full((len(channel), 1), 0.05)
    columns = sp.csr_array(sp.hstack([of_channels(channel, 0.2), everywhere]))
    at = Linearized(replace(problem, shared=SharedErrors(columns)), np.array([1.1, 0.9]))
    W = sp.csc_array(of_channels(channel, 4.0)[:, 20:90])
    pull = W.T @ at.force
    sigma = np.diag(problem.sd**2) + (columns @ columns.T).toarray()
    J = at.slope  # by scaled parameters, too: the start is one, bounds are five
    dense = W.toarray()
    A = dense.T @ np.linalg.solve(sigma + 9.0 * J @ J.T, dense)  # known within three
    fall, size = at.with_normal(W, pull)
    whole = np.eye(W.shape[1]) + A
    assert fall == pytest.approx(pull @ np.linalg.solve(whole, pull))
    assert size == pytest.approx(np.linalg.slogdet(whole)[1])
    np.testing.assert_allclose(at.curvature(W), np.diag(A))


def test_a_zero_that_a_whole_gauge_has_missed_is_found_among_many_channels(make_levelling):
    """A dense matrix of its channels and all readings would take 24 MB, and copies of it more."""
    problem, channel = make_levelling(1000)
    rng = np.random.default_rng(5)
    gauge = channel < 990
    offset = rng.uniform(15.0, 30.0, 1000)[channel]
    problem.measured[gauge] += offset[gauge]
    rows = np.flatnonzero(gauge)
    of_each = (
        Suspects(np.flatnonzero(channel == k), "channel", f"C{k}", np.full(STAGES, k))
        for k in range(990)
    )
    suspects = [Suspects(rows, "gauge", "G", channel[rows]), *of_each]

    def errors(measured, computed):
        return problem.sd, SharedErrors(of_channels(channel, 0.2))

    def refit(changed):
        v, J = changed.response.evaluate(changed.start)
        white = changed.whiten(np.column_stack([J, changed.measured - v]))
        return changed.start + np.linalg.lstsq(white[:, :-1], white[:, -1])[0]

    tracemalloc.start()
    mistakes = find_mistakes(problem, errors, [np.ones(2)], suspects, refit)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2e7
    assert mistakes[0].suspects.name == "G"
    np.testing.assert_allclose(mistakes[0].offset, offset[rows], atol=1.0)
