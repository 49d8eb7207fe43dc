"""The path along what a bound leaves open, step by step: its points, its end, what they make."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from geoident.identify.assessment import open_path
from geoident.identify.assessment.linearity import Ends, interval_ends
from geoident.identify.assessment.open_path import (
    Answers,
    OpenPath,
    _PathSearch,
    _Point,
    followed,
    open_parameter,
)
from geoident.identify.assessment.posterior import Posterior
from geoident.identify.assessment.uncertainty import _knowledge, assess
from geoident.identify.problem.problem import Problem
from geoident.model.methods import HuberOptions
from geoident.model.parameter import Parameter, Prior

M = np.array(
    [[1.0, 0.3, -0.5], [0.2, 0.8, 0.4], [-0.6, 0.5, 0.9], [0.3, -0.7, 0.2], [0.9, 0.1, 0.6]]
)
LATER = np.array([[0.5, 0.2, 1.0], [-0.4, 1.1, 0.3]])
SD = np.array([0.4, 0.25, 0.3, 0.5, 0.35])
Q = (
    Parameter("E", 2.0, 0.5, 40.0, "log"),
    Parameter("s", 3.0, 1.0, 16.0),
    Parameter("k", 1.0, -6.0, 9.0, prior=Prior(1.2, 0.7)),
)
AT = np.array([2.2, 1.0, 1.1])
"""Its second on its lower bound."""

SCALE = np.array([1.0, 3.0, 1.5])
"""References of s and k: the start, and a tenth of the range; E on its logarithm."""


def curved(p):
    return M @ (np.asarray(p) ** 1.5)


def answers(p, *, matrix=LATER):
    slopes = 1.5 * np.sqrt(p)
    return Answers(curved(p), M * slopes, matrix @ np.asarray(p) ** 1.5, matrix * slopes)


def searching(i=1, evaluate=answers, parameters=Q, at=AT):
    y = curved(at) + np.array([0.3, -0.2, 0.1, 0.4, -0.3])
    problem = Problem(None, y, SD, parameters)
    here = answers(at)
    known = assess(problem, at, here.used_jacobian, here.used)
    return _PathSearch(known, problem, at, here, evaluate, i)


def natural(dx):
    return np.array([AT[0] * np.exp(dx[0]), AT[1] + 3.0 * dx[1], AT[2] + 1.5 * dx[2]])


def judged(search, t, dx):
    """By normal equations: the others after one step of least squares, phi and the density."""
    p = natural(dx)
    slope = np.array([p[0], 3.0, 1.5])
    J = M * (1.5 * np.sqrt(p)) * slope / SD[:, None]
    r = (curved(p) - search.problem.measured) / SD
    A = np.vstack([J, [0.0, 0.0, 1.5 / 0.7]])
    r = np.append(r, (p[2] - 1.2) / 0.7)
    width = np.array([np.log(80.0), 5.0, 10.0])
    others = np.array([0, 2])
    H = A[:, others].T @ A[:, others] + np.diag((10.0 * width[others]) ** -2.0)
    step = np.zeros(3)
    step[others] = -np.linalg.solve(H, A[:, others].T @ r)
    left = r + A @ step
    phi = left @ left
    later = LATER @ p**1.5 + (LATER * 1.5 * np.sqrt(p) * slope) @ step
    first = np.array([AT[0], 3.0, 1.5])
    linear = LATER @ AT**1.5 + (LATER * 1.5 * np.sqrt(AT) * first) @ (dx + step)
    density = -0.5 * np.linalg.slogdet(H)[1] - 0.5 * phi
    return dx + step, phi, density, later - linear


def test_a_point_is_one_step_of_the_others_from_where_the_linearised_model_has_them():
    search = searching()
    C = search.factor @ search.factor.T
    assert search.size == pytest.approx(np.sqrt(C[1, 1]))
    np.testing.assert_allclose(search.slope, C[:, 1] / C[1, 1], rtol=1e-9)
    first = search._point(0.2)
    dx = C[:, 1] / C[1, 1] * 0.2
    moved, phi, density, bend = judged(search, 0.2, dx)
    assert (first.t, first.phi) == (0.2, pytest.approx(phi))
    np.testing.assert_allclose(first.dx, moved, rtol=1e-9)
    assert first.log_density == pytest.approx(density)
    np.testing.assert_allclose(first.bend, bend, rtol=1e-6)
    second = search._point(0.5, first)
    dx = first.dx + C[:, 1] / C[1, 1] * 0.3
    dx[1] = 0.5
    moved, phi, density, bend = judged(search, 0.5, dx)
    np.testing.assert_allclose(second.dx, moved, rtol=1e-9)
    assert second.log_density == pytest.approx(density)
    np.testing.assert_allclose(second.bend, bend, rtol=1e-6)
    here = search.here
    _, _, density, _ = judged(search, 0.0, np.zeros(3))
    r = np.append((curved(AT) - search.problem.measured) / SD, (AT[2] - 1.2) / 0.7)
    assert here.phi == pytest.approx(r @ r)  # without a step, and without it in its density
    assert here.bend.tolist() == [0.0, 0.0]
    H = density + 0.5 * judged(search, 0.0, np.zeros(3))[1]
    assert here.log_density == pytest.approx(H)


def test_points_keep_to_the_bounds_and_to_readings_that_there_are():
    search = searching()
    search.lower, search.upper = np.array([-0.01, 0.0, -0.02]), np.array([0.03, 5.0, 0.01])
    point = search._point(0.6)
    assert np.all((point.dx >= search.lower) & (point.dx <= search.upper))
    assert point.dx[1] == 0.6
    assert np.any(point.dx == search.lower) or np.any(point.dx == search.upper)
    missing = searching()
    missing.evaluate = lambda p: replace(answers(p), used=np.full(5, np.nan))
    assert missing._point(0.2) is None
    missing.evaluate = lambda p: None
    assert missing._point(0.2) is None
    partly = searching()
    partly.evaluate = lambda p: replace(answers(p), all=np.array([np.nan, 1.0]))
    assert partly._point(0.2).bend[0] == 0.0


def test_without_others_there_is_nothing_to_step():
    one = (Parameter("s", 3.0, 1.0, 16.0),)
    matrix = M[:, :1]

    def asked(p):
        return Answers(matrix @ p, matrix, p, np.ones((1, 1)))

    at = np.array([1.0])
    problem = Problem(None, matrix @ at + 0.1, SD, one)
    known = assess(problem, at, matrix, matrix @ at)
    search = _PathSearch(known, problem, at, asked(at), asked, 0)
    point = search._point(0.5)
    r = (matrix @ np.array([2.5]) - problem.measured) / SD
    assert point.dx.tolist() == [0.5]
    assert (point.phi, point.log_density) == (pytest.approx(r @ r), pytest.approx(-0.5 * r @ r))


def scripted(phi, *, ends=(0.0, 3.0), bounds=(0.0, 99.0), linear=False, size=1.0):
    """A search whose points are given by a function of t, and the t that it asked for."""
    search = object.__new__(_PathSearch)
    asked = []
    mixture = SimpleNamespace(interval=lambda low, high: tuple(np.array([e]) for e in ends))
    search.assessment = SimpleNamespace(posterior=SimpleNamespace(of=lambda rows, sd: mixture))
    search.values, search.i, search.size = np.zeros(1), 0, size
    search.lower, search.upper = np.array([bounds[0]]), np.array([bounds[1]])
    search.here = _Point(0.0, np.zeros(1), phi(0.0), 0.0, np.zeros(1))
    search._is_linear = lambda point: linear

    def point(t, before=None):
        asked.append(t)
        value = phi(t)
        return None if value is None else _Point(t, np.full(1, t), value, 0.0, np.zeros(1))

    search._point = point
    return search, asked


def test_the_farthest_point_comes_first_and_may_be_all():
    search, asked = scripted(lambda t: t**2, ends=(-1.0, 3.0), bounds=(-9.0, 99.0), linear=True)
    assert search.points() is None
    assert asked == pytest.approx([3.9])
    search, asked = scripted(lambda t: t**2, ends=(-4.0, 3.0), bounds=(-9.0, 99.0), linear=True)
    assert search.points() is None
    assert asked == pytest.approx([-5.2])
    search, asked = scripted(lambda t: t**2, ends=(0.0, 3.0), bounds=(0.0, 2.0), linear=True)
    search.points()
    assert asked == [2.0]
    for size, some in ((3001.0, False), (2999.0, True)):  # a thousandth of what is known of it
        search, asked = scripted(
            lambda t: t**2, ends=(0.0, 3.0), bounds=(0.0, 3.0), linear=True, size=size
        )
        assert search.points() is None
        assert bool(asked) == some


def test_points_go_on_in_thirds_and_then_farther_until_nothing_is_left():
    """Until phi has grown by nine over the least; after the third by 1.6 of the step before."""
    slow = 0.1
    search, asked = scripted(lambda t: slow * t, ends=(0.0, 3.0))
    found = search.points()
    steps = 1.3 * np.array([1.0, 1.0, 1.0, *(1.6 ** np.arange(1, 9))])
    t = np.cumsum(steps)
    last = np.flatnonzero(slow * t > 9.0)
    expected = t[: min(last[0] + 1 if len(last) else 99, 10)]
    assert asked[1:] == pytest.approx(expected.tolist())
    assert [point.t for point in found] == pytest.approx([0.0, *expected])
    search, asked = scripted(lambda t: 1e-9 * t, ends=(0.0, 3.0), bounds=(0.0, 1e9))
    assert len(search.points()) == 11
    for slope, count in ((9.01 / 2.6, 2), (8.99 / 2.6, 3)):
        search, asked = scripted(lambda t, slope=slope: slope * t, ends=(0.0, 3.0))
        assert len(search.points()) == 1 + count
    # the least so far counts, not the first: -1 at 1.3, then 8.1 at 2.6
    search, asked = scripted(lambda t: {0.0: 5.0, 1.3: -1.0}.get(t, 8.1), ends=(0.0, 3.0))
    assert len(search.points()) == 3
    search, asked = scripted(lambda t: 0.0, ends=(0.0, 3.0), bounds=(0.0, 4.5))
    assert [p.t for p in search.points()] == pytest.approx([0.0, 1.3, 2.6, 3.9, 4.5])
    search, asked = scripted(lambda t: None if t > 2.0 else 0.0, ends=(0.0, 3.0))
    assert [p.t for p in search.points()] == pytest.approx([0.0, 1.3])


def test_both_sides_are_followed():
    search, _ = scripted(lambda t: 0.0, ends=(-1.5, 3.0), bounds=(-2.0, 4.5))
    found = sorted(p.t for p in search.points())
    assert found == pytest.approx([-2.0, -1.95, -1.3, -0.65, 0.0, 1.3, 2.6, 3.9, 4.5])


@pytest.mark.parametrize(
    ("phi", "bend", "linear"),
    [(0.49, 0.0, True), (0.51, 0.0, False), (-0.49, 0.0, True), (-0.51, 0.0, False),
     (0.0, 0.249, True), (0.0, -0.249, True), (0.0, 0.251, False), (0.0, -0.251, False)],
)  # fmt: skip
def test_a_point_is_linear_by_its_phi_and_by_readings_in_their_standard_deviations(
    phi, bend, linear
):
    search = searching()
    search.mean = np.array([0.0, -0.7, 0.0])
    t = 0.9
    grown = (1.6**2 - 0.7**2) / search.size**2
    rows = LATER * (1.5 * np.sqrt(AT)) * np.array([AT[0], 3.0, 1.5])
    sd = np.sqrt(np.diag(rows @ search.assessment.posterior.covariance @ rows.T))
    for k in range(2):
        off = np.zeros(2)
        off[k] = bend * sd[k]
        point = _Point(t, np.zeros(3), search.here.phi + grown + phi, 0.0, off)
        assert search._is_linear(point) == linear


# What is made of the points


def made(density=None):
    """A path of seven points with curved others, and its search."""
    t = np.array([0.0, 0.4, 0.9, 1.5, 2.2, 3.0, 4.1])
    slope = np.array([0.5, 1.0, -0.3])
    dx = t[:, None] * slope + np.outer(t**2, [0.05, 0.0, -0.02])
    log_density = -1.2 * t + 0.1 * t**2 if density is None else density(t)
    here = _Point(0.0, np.zeros(3), 3.0, log_density[0] + 1.5, np.zeros(2))
    log_density = log_density.copy()
    log_density[0] = here.log_density
    bend = np.stack([np.sin(t), 0.3 * t**2], axis=1)
    path = OpenPath(1, t, dx, log_density, bend)
    factor = np.array([[0.5, 0.2, 0.1], [1.0, 0.0, 0.0], [-0.3, 0.1, 0.4]]) * [0.8, 1.0, 1.0]
    search = SimpleNamespace(
        size=0.8, slope=slope, factor=factor, mean=np.array([0.1, -0.2, 0.05]), here=here,
        lower=np.array([-5.0, 0.0, -5.0]), upper=np.array([5.0, 4.1, 5.0]),
    )  # fmt: skip
    return path, search


@pytest.mark.parametrize(
    "density",
    [lambda t: -1.2 * t + 0.1 * t**2, lambda t: -(((t - 2.0) / 0.7) ** 2), lambda t: 0.4 * t],
)
def test_the_posterior_has_the_density_of_the_path(density):
    """Moments of t, and of what follows it, by sums over the interpolated density."""
    path, search = made(density)
    found = open_path._along(path, search)
    t = np.linspace(0.0, 4.1, 20_001)
    weight = np.exp(PchipInterpolator(path.t, density(path.t))(t))
    weight[[0, -1]] *= 0.5
    weight /= weight.sum()
    at = found.shift[1]
    assert found.weight.sum() == pytest.approx(1.0)
    assert np.all((at >= 0.0) & (at <= 4.1))
    for power in (1, 2, 3):
        assert found.weight @ at**power == pytest.approx(weight @ t**power, rel=2e-3)
    # the others: the normal follows by its slope from its mean, the path adds its bend
    slope = search.slope
    bent = PchipInterpolator(path.t, path.dx - path.t[:, None] * slope)(at).T
    straight = search.mean[:, None] + slope[:, None] * (at - search.mean[1])
    np.testing.assert_allclose(found.shift[[0, 2]], (straight + bent)[[0, 2]], atol=1e-9)
    C = search.factor @ search.factor.T
    left = C - np.outer(C[:, 1], C[1]) / C[1, 1]
    np.testing.assert_allclose(found.factor @ found.factor.T, left, atol=1e-12)


def test_what_follows_keeps_to_its_bounds():
    path, search = made()
    search.lower[0], search.upper[2] = 0.0, 0.01
    found = open_path._along(path, search)
    assert found.shift[0].min() >= 0.0
    assert found.shift[2].max() <= 0.01


def test_deviations_are_interpolated_between_the_points_and_stay_beyond_them():
    path, _ = made()
    np.testing.assert_allclose(path.bent(path.t), path.bend.T)
    expected = PchipInterpolator(path.t, path.bend)(np.array([0.2, 1.1])).T
    np.testing.assert_allclose(path.bent(np.array([0.2, 1.1])), expected)
    np.testing.assert_allclose(path.bent(np.array([-3.0, 9.0])), path.bend[[0, -1]].T)


def test_points_at_one_place_are_one():
    points = [_Point(t, np.zeros(1), phi, 0.0, np.zeros(1))
              for t, phi in ((1.0, 1.0), (0.0, 2.0), (1.0, 3.0), (-1.0, 4.0))]  # fmt: skip
    assert [(p.t, p.phi) for p in open_path._distinct(points)] == [(-1, 4), (0, 2), (1, 1)]


@pytest.mark.parametrize(("count", "bent"), [(2, False), (3, True)])
def test_a_path_needs_three_points(count, bent, monkeypatch):
    points = [
        _Point(0.2 * k, np.array([0.0, 0.2 * k, 0.0]), 0.1, -0.3 * k, np.zeros(2))
        for k in range(count)
    ]
    monkeypatch.setattr(_PathSearch, "points", lambda self: points[::-1])
    search = searching()
    found, path = followed(search.assessment, search.problem, AT, answers(AT), answers)
    assert (path is not None) == bent
    assert (found is not search.assessment) == bent
    if bent:
        assert path.parameter == 1
        np.testing.assert_allclose(path.t, [0.0, 0.2, 0.4])
        np.testing.assert_allclose(path.log_density, [0.0, -0.3, -0.6])
        assert (path.dx.shape, path.bend.shape) == ((3, 3), (3, 2))


def test_the_parameter_that_is_open_is_the_one_that_a_bound_cuts_most():
    """On a bound before beyond one; else by its spread in its range; no mode of a field."""
    search = searching()
    problem = search.problem
    spread = np.array([0.2, 0.3, 0.6])
    posterior = Posterior(np.zeros((3, 1)), np.ones(1), np.diag(spread * [np.log(80.0), 5.0, 10.0]))
    none = np.zeros(3, dtype=bool)
    base = replace(search.assessment, posterior=posterior, at_bound=none, beyond_bounds=none)

    def opened(at_bound=(), beyond=(), parameters=Q):
        flags = [np.isin(range(3), one) for one in (at_bound, beyond)]
        known = replace(base, at_bound=flags[0], beyond_bounds=flags[1])
        return open_parameter(known, replace(problem, parameters=parameters), AT)

    assert opened() is None
    assert [opened(beyond=(k,)) for k in range(3)] == [0, 1, 2]
    assert opened(beyond=(0, 1, 2)) == 2
    assert opened(beyond=(0, 1)) == 1
    assert opened(at_bound=(0,), beyond=(0, 1, 2)) == 0
    assert opened(at_bound=(0, 1)) == 1
    held = (Q[0], replace(Q[1], lower=1.0, upper=1.0, start=1.0), Q[2])
    assert opened(at_bound=(1,), parameters=held) is None
    assert opened(at_bound=(1,), beyond=(0,), parameters=held) == 0
    field = (*Q[:2], replace(Q[2], field="E"))
    assert opened(beyond=(1, 2), parameters=field) == 1
    assert opened(beyond=(2,), parameters=field) is None
    # a range without an end is one
    endless = (Q[0], replace(Q[1], upper=np.inf), Q[2])
    wide = replace(base, beyond_bounds=np.array([False, True, True]))
    assert open_parameter(wide, replace(problem, parameters=endless), AT) == 1


# Whether intervals are linear


@pytest.mark.parametrize(
    ("factor", "doubtful"), [(1.19, False), (1.21, True), (1 / 1.19, False), (1 / 1.21, True)]
)
def test_ends_are_doubtful_by_a_fifth(factor, doubtful):
    right = 1.959963984540054**2
    assert Ends(0, right * factor**2, right).doubtful == doubtful
    assert Ends(0, right, right * factor**2).doubtful == doubtful


class Powers:
    def admissible(self, p):
        return None

    def readings(self, p):
        return curved(p)


def test_phi_is_asked_at_the_ends_of_the_least_known_parameter_that_counts():
    """The others follow by their covariance; by relative standard deviations from 0.15 on."""
    at = np.array([2.2, 2.5, 1.1])
    problem = Problem(Powers(), curved(at) + 0.1, SD, Q)
    here = answers(at)
    known = assess(problem, at, here.used_jacobian, here.used)
    every = np.ones(3, dtype=bool)
    known = replace(known, determined=every, beyond_bounds=~every, at_bound=~every)
    C = known.uncut_factor @ known.uncut_factor.T

    def phi(p):
        r = (curved(p) - problem.measured) / SD
        return r @ r + ((p[2] - 1.2) / 0.7) ** 2

    def expected(i):
        step = 1.959963984540054 * C[:, i] / np.sqrt(C[i, i])
        ends = [np.array([at[0] * np.exp(sign * step[0]), at[1] + sign * 3.0 * step[1],
                          at[2] + sign * 1.5 * step[2]]) for sign in (-1.0, 1.0)]  # fmt: skip
        return [phi(end) - phi(at) for end in ends]

    def asked(sd, **more):
        return interval_ends(problem, replace(known, sd=np.array(sd) * at, **more), at)

    for i in range(3):
        sd = np.full(3, 0.2)
        sd[i] = 0.21
        found = asked(sd)
        assert found.parameter == i
        assert [found.below, found.above] == pytest.approx(expected(i))
    assert asked([0.149, 0.1, 0.149]) is None
    assert asked([0.151, 0.1, 0.149]).parameter == 0
    low = every.copy()
    low[0] = False
    assert asked([0.5, 0.2, 0.3], determined=low).parameter == 2
    assert asked([0.5, 0.2, 0.3], beyond_bounds=~low).parameter == 2
    assert asked([0.5, 0.2, 0.3], at_bound=~low) is None
    field = replace(problem, parameters=(replace(Q[0], field="E"), *Q[1:]))
    wide = replace(known, sd=np.array([0.5, 0.2, 0.3]) * at)
    assert interval_ends(field, wide, at).parameter == 2
    zero = np.array([2.2, 2.5, 0.0])
    assert interval_ends(problem, replace(wide, sd=np.array([0.1, 0.1, 9.0])), zero) is None
    minus = np.array([2.2, 2.5, -1.1])
    two = Problem(Powers(), np.zeros(5), SD, Q)
    with np.errstate(invalid="ignore"):
        assert interval_ends(two, replace(wide, sd=np.array([0.1, 0.1, 0.3])), minus).parameter == 2
    assert interval_ends(replace(problem, loss=HuberOptions()), wide, at) is None


def test_priors_of_named_parameters_are_rows_beside_those_of_fields():
    """With the modes left free the rows of the readings are whitened, those of the named stay."""
    rng = np.random.default_rng(4)
    B = rng.normal(size=(6, 4))
    P = np.zeros((3, 4))
    P[0, 1], P[1, 2], P[2, 3] = 2.0, 7.0, 4.0  # of a mode, of the second named, of a mode
    mode = Prior(0.0, 1.0)
    parameters = (
        Q[0],
        Parameter("m1", 0.0, -9.0, 9.0, prior=mode, field="E"),
        Q[2],
        Parameter("m2", 0.0, -9.0, 9.0, prior=mode, field="E"),
    )
    values, width = np.array([2.0, 0.0, 1.0, 0.0]), np.array([3.0, 9.0, 5.0, 9.0])
    flags = np.array([True, False, False, True]), np.array([False, True, True, False])
    found = _knowledge(parameters, values, *flags, B, P, width)
    modes = B[:, [1, 3]] / [2.0, 4.0]
    root = np.linalg.cholesky(np.eye(6) + modes @ modes.T)
    rows = np.linalg.solve(root, B[:, [0, 2]])
    own = np.array([[0.0, 7.0]])
    np.testing.assert_allclose(found.prior_rows, own)
    np.testing.assert_allclose(found.readings.S, np.linalg.svd(rows, compute_uv=False))
    whole = np.vstack([rows, own])
    np.testing.assert_allclose(found.whole.S, np.linalg.svd(whole, compute_uv=False))
    assert found.parameters == (Q[0], Q[2])
    assert (found.values.tolist(), found.width.tolist()) == ([2.0, 1.0], [3.0, 5.0])
    assert (found.at_bound.tolist(), found.from_prior.tolist()) == ([True, False], [False, True])
