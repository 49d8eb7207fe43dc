"""Derivatives by differences: their steps, their updates, their number of runs, their errors."""

import numpy as np
import pytest
from support.external import ArrayRuns

from geoident.errors import ModelError
from geoident.forward.external.differences import Differences
from geoident.forward.external.noise import noise_of
from geoident.forward.external.runs import FailedRun
from geoident.model.parameter import Parameter

PARAMETERS = (
    Parameter("E", start=5.0, lower=1.0, upper=50.0, scale="log"),
    Parameter("K", start=1.0, lower=0.3, upper=3.0),
)
P = np.array([5.0, 1.0])


def smooth(p):
    E, K = p
    return np.array([(1 + K) / E, (1 + 3 * K**2) / E, np.exp(K) / E**2])


def slopes(p):
    E, K = p
    return np.array(
        [
            [-(1 + K) / E**2, 1 / E],
            [-(1 + 3 * K**2) / E**2, 6 * K / E],
            [-2 * np.exp(K) / E**3, np.exp(K) / E**2],
        ]
    )


def differences(function, parameters=PARAMETERS, digits=None, quantum=None, seen=(True, True)):
    runs = ArrayRuns(function, 2, 3)

    def run(points):
        return [r if isinstance(r, FailedRun) else r[0] for r in runs.each(points, None)]

    def written(p):
        return p if digits is None else np.array([float(f"{x:.{digits}e}") for x in p])

    if quantum is None:
        quantum = runs.quantum if digits is None else lambda p: 10.0**-digits * np.abs(p)
    return Differences(run, parameters, np.array(seen), np.full(3, 100.0), quantum, written), runs


def test_noise_is_that_which_was_added():
    rng = np.random.default_rng(1)
    found = [
        noise_of(np.exp(1e-3 * np.arange(7.0))[:, None] + 1e-6 * rng.standard_normal((7, 1)))[0]
        for _ in range(200)
    ]
    assert np.median(found) == pytest.approx(1e-6, rel=0.3)
    assert np.quantile(found, [0.02, 0.98]) == pytest.approx([1e-6, 1e-6], rel=3.0)


@pytest.mark.parametrize(("digits", "forward", "central"), [(16, 1e-5, 1e-8), (7, 1e-2, 1e-3)])
def test_derivatives_are_as_good_as_the_digits_allow(digits, forward, central):
    def printed(p):
        return np.array([float(f"{x:.{digits}g}") for x in smooth(p)])

    found, _ = differences(printed)
    first = found.linear(P)
    np.testing.assert_allclose(first.dv_dp, slopes(P), rtol=forward)
    assert np.abs(first.dv_dp - slopes(P)).max() > 0.0
    np.testing.assert_allclose(found.exact(P).dv_dp, slopes(P), rtol=central)


def test_coarsely_written_parameters_do_not_spoil_derivatives():
    def reads_few_digits(p):
        return smooth([float(f"{x:.4e}") for x in p])

    found, _ = differences(reads_few_digits, digits=4)
    at = np.array([5.00003, 1.00004])
    np.testing.assert_allclose(found.exact(at).dv_dp, slopes(P), rtol=1e-4)


def test_runs_are_counted_and_updates_cost_none():
    found, runs = differences(smooth)
    found.linear(P)
    assert runs.n_runs == 1 + 6 + 2  # itself, the noise once, one for each parameter
    found.linear(P)
    assert runs.n_runs == 9
    near = np.array([5.2, 1.05])
    updated = found.linear(near)
    assert runs.n_runs == 10
    move = near - P
    np.testing.assert_allclose(updated.dv_dp @ move, smooth(near) - smooth(P), rtol=1e-12)
    found.linear(np.array([30.0, 2.5]))  # far: all parameters are moved again
    assert runs.n_runs == 13
    found.exact(near)
    assert runs.n_runs == 13 + 1 + 4


def test_steps_stay_inside_the_bounds():
    corner = np.array([50.0, 0.3])
    seen = []

    def watched(p):
        seen.append(np.array(p))
        return smooth(p)

    found, _ = differences(watched)
    np.testing.assert_allclose(found.exact(corner).dv_dp, slopes(corner), rtol=1e-7)
    assert len(seen) == 1 + 6 + 4
    assert all(1.0 <= p[0] <= 50.0 and 0.3 <= p[1] <= 3.0 for p in seen)


@pytest.mark.parametrize("end", [0.0, 1.0, 0.5])
def test_where_bounds_limit_the_steps_no_run_is_beyond_them(end):
    """A straight line has the same slope over any two points, those of steps that just fit, too.

    Twice half of the room is all of it but for a rounding, and then the second step is shorter.
    """
    rng = np.random.default_rng(11)
    beyond = []

    def line(p):
        beyond.append(not (low <= p[1] <= high))
        return 1e3 * np.array([p[1], 2.0 * p[1] - p[0], p[0]])

    for _ in range(40):
        low, high = sorted(rng.normal(size=2))
        value = min(low + end * (high - low), high)
        narrow = (PARAMETERS[0], Parameter("K", start=value, lower=low, upper=high))
        found, _ = differences(line, narrow, quantum=np.ones_like)
        slope = found.exact(np.array([5.0, value])).dv_dp[:, 1]
        np.testing.assert_allclose(slope, [1e3, 2e3, 0.0], rtol=1e-9, atol=1e-6)
    assert not any(beyond)


def test_a_failed_side_is_gone_around_and_two_are_an_error():
    def above(p):
        return FailedRun("no", "00007") if p[1] > 1.0 else smooth(p)

    np.testing.assert_allclose(differences(above)[0].exact(P).dv_dp, slopes(P), rtol=1e-1)

    def only_here(p):
        return smooth(p) if p[1] == 1.0 else FailedRun("no", "00007")

    with pytest.raises(ModelError, match=r"run of the model failed: no \(00007\)"):
        differences(only_here)[0].exact(P)


def test_a_forward_step_that_fails_is_made_the_other_way_where_there_is_room():
    def below(limit):
        return lambda p: smooth(p) if p[1] <= limit else FailedRun("no")

    found, _ = differences(below(P[1]))
    np.testing.assert_allclose(found.linear(P).dv_dp, slopes(P), rtol=1e-2)
    lowest = np.array([5.0, 0.3])
    with pytest.raises(ModelError, match="there is no room for a step"):
        differences(below(0.3))[0].linear(lowest)


def test_what_is_not_seen_changes_no_derivative():
    found, runs = differences(lambda p: smooth(p) + 1e3 * p[1], seen=(True, False))
    first = found.linear(P)
    assert (first.dv_dp[:, 1] == 0.0).all()
    count = runs.n_runs
    other = found.linear(P + np.array([0.0, 0.5]))
    np.testing.assert_array_equal(other.dv_dp, first.dv_dp)
    assert runs.n_runs == count + 1
