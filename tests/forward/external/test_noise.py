"""Noise and steps by their definitions, one number after the other, and the moves of parameters."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from support.external import ArrayRuns

from geoident.errors import ModelError
from geoident.forward.external.differences import Differences
from geoident.forward.external.noise import line_of, noise_of, steps_of
from geoident.forward.external.runs import FailedRun
from geoident.model.parameter import Parameter


def noise_by_definition(values):
    """Of seven numbers: levels of six orders, and the lowest of three that agree within four."""
    levels = []
    for k in range(1, 7):
        weights = [(-1) ** j * comb(k, j) for j in range(k + 1)]
        found = [sum(w * values[i + j] for j, w in enumerate(weights)) for i in range(7 - k)]
        levels.append(np.sqrt(np.mean(np.square(found)) / comb(2 * k, k)))
    size = levels[-1]
    for start in range(4):
        three = levels[start : start + 3]
        if max(three) <= 4.0 * min(three):
            size = three[0]
            break
    return max(size, 1e-15 * max(map(abs, values)))


def test_noise_is_that_of_its_definition():
    """Numbers with noise, smooth ones, both together, and such of which no three orders agree."""
    rng = np.random.default_rng(5)
    x = np.arange(7.0)[:, None]
    parts = [
        rng.standard_normal((7, 60)),
        3.0 + np.exp(0.3 * x * rng.random(60)) + 1e-4 * rng.standard_normal((7, 60)),
        np.sin(x * rng.random(60) * 2.0),
        rng.standard_normal((7, 60)) * 10.0 ** rng.integers(-4, 1, (7, 60)),
        np.full((7, 1), -5.0),
    ]
    values = np.concatenate(parts, axis=1)
    found = noise_of(values)
    exact = [noise_by_definition(column) for column in values.T.tolist()]
    np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-15)
    assert found[-1] == pytest.approx(5e-15, rel=1e-12)


def test_steps_balance_noise_and_curvature():
    noise, values = np.array([3e-8, 4e-8]), np.array([0.6, 0.8])
    for weights, part in (
        (np.ones(2), 5e-8),
        (np.array([2.0, 0.0]), 5e-8),
        (np.array([1.0, 3.0]), np.hypot(3e-8, 12e-8) / np.hypot(0.6, 2.4)),
    ):
        forward, central = steps_of(noise, values, weights)
        assert forward == pytest.approx(2.0 * part**0.5, rel=1e-12)
        assert central == pytest.approx((3.0 * part) ** (1 / 3), rel=1e-12)
    one = np.ones(1)
    least = 2.0 * 1e-15**0.5, 3e-15 ** (1 / 3)
    assert steps_of(0.0 * one, one, one) == pytest.approx(least, rel=1e-12)
    assert steps_of(one, 0.0 * one, one) == pytest.approx(least, rel=1e-12)
    assert steps_of(0.5 * one, one, one) == (0.1, 0.1)
    assert steps_of(1e-3 * one, one, one) == pytest.approx((2.0 * 1e-3**0.5, 0.1))


def test_the_line_goes_where_there_is_room():
    """Up, down, nowhere for want of room, nowhere since it stays; and just so far as it fits."""
    p = np.array([2.0, 5.0, 1.0, 3.0, 4.0, 4.0])
    sizes = np.array([10.0, 5.0, 9.0, 0.0, 4.0, 4.0])
    lower = np.array([0.0, 0.0, 0.99, 0.0, 0.0, 4.0 - 0.24])
    upper = np.array([9.0, 5.1, 1.01, 9.0, 4.0 + 0.24, 4.0 + 0.239])
    points = line_of(p, sizes, lower, upper, 0.01)
    assert len(points) == 7
    step = np.array([0.1, -0.05, 0.0, 0.0, 0.04, -0.04])
    for k, point in enumerate(points):
        np.testing.assert_allclose(point, p + k * step, rtol=1e-14)


PARAMETERS = (
    Parameter("E", 5.0, 1.0, 50.0, scale="log"),
    Parameter("small", 0.1, -4.0, 6.0),
    Parameter("large", 50.0, 45.0, 55.0),
    Parameter("open", -3.0, -np.inf, np.inf),
    Parameter("none", 0.0, -np.inf, np.inf),
    Parameter("unseen", 1.0, 0.0, 2.0),
)
SIZES = np.array([7.0, 1.0, 10.0, 3.0, 1.0, 1.0])
"""By which relative steps are multiplied at P: the value, a tenth of the width, all of it."""
P = np.array([7.0, 0.5, 49.0, -2.0, 0.3, 1.0])


def sizes_at(p):
    """Of E, on a log scale, its own value."""
    return np.array([p[0], *SIZES[1:]])


SEEN = np.array([True, True, True, True, True, False])


def function(p):
    E, a, b, c, d = p[:5]
    return np.array([a * b / E + c, c * d * E + a**2, b * d - 3.0 * c + E**2])


def exact(p):
    E, a, b, c, d = p[:5]
    return np.array(
        [
            [-a * b / E**2, b / E, a / E, 1.0, 0.0, 0.0],
            [c * d, 2.0 * a, 0.0, d * E, c * E, 0.0],
            [2.0 * E, 0.0, d, -3.0, b, 0.0],
        ]
    )


WEIGHTS = np.array([1.0, 20.0, 3.0])


def made(run=None, *, quantum=None, parameters=PARAMETERS, written=lambda p: p):
    """Differences of the function, and the points at which it was run, one list for each call."""
    asked = []

    def of_all(points):
        if len(points):
            asked.append([p.copy() for p in points])
        return [(run or function)(p) for p in points]

    runs = ArrayRuns(function, 6, 3)
    quantum = runs.quantum if quantum is None else quantum
    return Differences(of_all, parameters, SEEN, WEIGHTS, quantum, written), asked


def test_steps_are_parts_of_the_sizes_of_the_parameters():
    found, asked = made()
    linear = found.linear(P)
    np.testing.assert_allclose(linear.dv_dp, exact(P), rtol=1e-5, atol=1e-5)
    itself, line, forward = asked
    assert len(itself) == 1
    steps = np.array(line) - P
    np.testing.assert_allclose(
        steps, np.arange(1, 7)[:, None] * 1e-3 * np.where(SEEN, SIZES, 0.0), rtol=1e-9
    )
    h = steps_of(found.noise, linear.v, WEIGHTS)
    np.testing.assert_allclose(
        np.array(forward) - P, np.diag(h[0] * SIZES)[SEEN], rtol=1e-6, atol=1e-15
    )
    assert found.doubt(P).shape == (3, 6)
    np.testing.assert_allclose(found.doubt(P), 3.0 * found.noise[:, None] / (h[1] * SIZES))
    sharp = found.exact(P)
    np.testing.assert_allclose(sharp.dv_dp, exact(P), rtol=1e-9, atol=1e-9)
    central = np.array(asked[-1]) - P
    both = np.repeat(np.diag(h[1] * SIZES)[SEEN], 2, axis=0)
    both[1::2] *= -1.0
    np.testing.assert_allclose(central, both, rtol=1e-6, atol=1e-12)
    assert found.linear(P) is sharp
    assert found.is_exact(P)
    assert not found.is_exact(P + 1e-3)


def test_steps_are_at_least_sixteen_of_the_changes_that_are_seen():
    found, asked = made(quantum=lambda p: np.array([1.0, 1.0, 10.0, 3.0, 1.0, 1.0]) * 1e-3)
    found.linear(P)
    step = 16e-3 * np.array([1.0, 1.0, 10.0, 3.0, 1.0, 1.0])
    np.testing.assert_allclose(np.array(asked[-1]) - P, np.diag(step)[SEEN], rtol=1e-9, atol=1e-15)


def test_steps_stay_within_half_of_the_wider_side_and_turn_where_there_is_no_room():
    at = P.copy()
    at[2] = 52.0  # 3 to the upper bound, 7 to the lower one
    found, asked = made(quantum=lambda p: np.array([1.0, 1.0, 1.0, 3.0, 1.0, 1.0]))
    found.linear(at)
    steps = (np.array(asked[-1]) - at).max(axis=1) + (np.array(asked[-1]) - at).min(axis=1)
    np.testing.assert_allclose(steps, [16.0, 2.75, -3.5, 48.0, 16.0], rtol=1e-9)


def test_what_is_not_seen_changes_no_derivative():
    found, asked = made()
    first = found.linear(P)
    other = found.linear(P + np.array([0, 0, 0, 0, 0, 0.5]))
    np.testing.assert_array_equal(other.dv_dp, first.dv_dp)
    assert (len(asked), other.updates) == (4, 0)
    found, asked = made(lambda p: function(p) + 1e3 * p[5])  # though it makes a difference
    first = found.linear(P)
    other = found.linear(P + np.array([0, 0, 0, 0, 0, 0.5]))
    np.testing.assert_array_equal(other.dv_dp, first.dv_dp)
    assert len(asked) == 4


def test_an_update_explains_the_change_by_the_smallest_change_of_derivatives():
    """Broyden's, in the sizes of the parameters; the nearest point is that in the same sizes."""
    found, _ = made()
    first = found.linear(P)
    move = SIZES * [0.02, -0.01, 0.03, 0.01, 0.02, 0.0]
    second = found.linear(P + move)
    by = sizes_at(P + move)
    s = move / by
    surprise = function(P + move) - function(P) - first.dv_dp @ move
    expected = first.dv_dp + np.outer(surprise, s / by) / (s @ s)
    np.testing.assert_allclose(second.dv_dp, expected, rtol=1e-12, atol=1e-13)
    assert (first.updates, second.updates) == (0, 1)
    on = move + SIZES * [0.015, 0.0, 0.0, -0.01, 0.0, 0.0]
    third = found.linear(P + on)
    assert third.updates == 2
    by = sizes_at(P + on)
    s = (on - move) / by
    surprise = function(P + on) - function(P + move) - second.dv_dp @ (on - move)
    np.testing.assert_allclose(
        third.dv_dp, second.dv_dp + np.outer(surprise, s / by) / (s @ s), rtol=1e-12, atol=1e-13
    )


@pytest.mark.parametrize(("part", "renewed"), [(0.19, False), (0.21, True)])
def test_derivatives_are_renewed_where_a_fifth_of_the_change_was_not_foretold(part, renewed):
    """A bend: beyond P the function changes by so much more that this part is a surprise."""

    def bent(p):
        value = 1e3 * (p[1] - P[1])
        return np.array([value if value <= 50.0 else value / (1.0 - part), 0.0, 1.0])

    found, asked = made(bent)
    found.linear(P)
    calls = len(asked)
    found.linear(P + np.array([0.0, 0.2, 0.0, 0.0, 0.0, 0.0]))
    assert len(asked) == calls + 1 + renewed


def test_derivatives_are_renewed_after_twice_as_many_updates_as_parameters_and_one():
    """Five are seen: after eleven updates in a row they are taken anew."""
    found, asked = made()
    found.linear(P)
    counts, at = [], P
    for _ in range(13):
        at = at + 1e-2 * SIZES * [1.0, 0.5, -0.7, 0.3, 0.4, 0.0]
        counts.append(found.linear(at).updates)
    assert counts == [*range(1, 12), 0, 1]
    assert len(asked) == 3 + 13 + 1


def test_noise_within_three_deviations_is_no_surprise():
    for times, kept in ((2.9, True), (3.1, False)):
        off = np.zeros(3)
        found, _ = made(lambda p, off=off: function(p) + off)
        first = found.linear(P)
        found.noise = np.array([2e-3, 1e-3, 1e-3])
        off[0] = times * np.linalg.norm(WEIGHTS * found.noise) / WEIGHTS[0]
        second = found.linear(P + np.array([0.0, 0.0, 0.0, 1e-9, 0.0, 0.0]))
        assert np.array_equal(second.dv_dp, first.dv_dp) == kept


def test_a_failed_run_beside_is_gone_around():
    """On the side that is left the difference is of the first order; the others stay central."""
    for sign in (1.0, -1.0):

        def half(p, sign=sign):
            return FailedRun("no") if sign * (p[3] - P[3]) > 1e-12 else function(p)

        found, _ = made(half)
        result = found.exact(P)
        np.testing.assert_allclose(result.dv_dp, exact(P), rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(result.dv_dp[:, 3], exact(P)[:, 3], rtol=1e-9)  # linear
    # where the line for the noise fails nothing is known of digits
    for beyond in (1e-3, 16e-3):  # all points of the line, and its last one
        found, _ = made(lambda p, x=beyond: FailedRun("no") if p[3] > P[3] + x else function(p))
        result = found.linear(P)
        np.testing.assert_allclose(found.noise, 1e-7 * np.abs(function(P)), rtol=1e-12)
    np.testing.assert_allclose(result.dv_dp, exact(P), rtol=1e-2, atol=1e-2)


def test_a_forward_step_that_fails_is_made_the_other_way_where_there_is_room():
    def above(p):
        return FailedRun("no") if p[3] > P[3] else function(p)

    found, asked = made(above)
    result = found.linear(P)
    np.testing.assert_allclose(result.dv_dp, exact(P), rtol=1e-2, atol=1e-2)
    (again,) = asked[-1]
    assert again[3] < P[3]
    at = P.copy()
    at[2] = 45.0  # at its bound: no other side

    def fails(p):
        return FailedRun("no") if p[2] > 45.0 else function(p)

    with pytest.raises(ModelError, match="there is no room for a step"):
        made(fails)[0].linear(at)


def test_steps_are_those_of_the_digits_that_are_written():
    """A program that reads three digits: the difference is over what it has seen."""

    def written(p):
        return np.array([float(f"{x:.2e}") for x in p])

    found, asked = made(
        lambda p: function(written(p)), quantum=lambda p: 1e-2 * np.abs(p) / 16.0, written=written
    )
    at = P * [1.0004, 1, 1.0002, 1, 1, 1]
    linear = found.linear(at)
    for point in asked[-1]:
        moved = np.abs(written(point) - written(at)) > 0
        assert moved.sum() == 1
    slopes = []
    for point in asked[-1]:
        (j,) = np.flatnonzero(written(point) != written(at))
        seen = (written(point) - written(at))[j]
        slopes.append((function(written(point)) - function(written(at))) / seen)
    np.testing.assert_allclose(linear.dv_dp[:, SEEN], np.transpose(slopes), rtol=1e-9, atol=1e-12)
