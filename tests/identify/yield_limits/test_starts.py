"""Where descents for yield limits begin, on points whose discrepancy is given."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.identify.least_squares.trust_region import TrustBox
from geoident.identify.problem.problem import Linearization
from geoident.identify.problem.scaling import Scaling
from geoident.identify.yield_limits.starts import Restarts, raised, strength_scan
from geoident.identify.yield_limits.yield_points import YieldIterate
from geoident.model.parameter import Parameter

STRENGTHS = (
    Parameter("c", 2.0, 1.0, 10.0, "log"),
    Parameter("k", 2.0, 0.5, 20.0),
    Parameter("E", 3.0, 1.0, 9.0, "log"),
)


def point(scaling, x, phi, jacobian=None, unreached=None):
    """A point with one residual, by default one that no parameter moves."""
    n = len(scaling)
    J = np.zeros((1, n)) if jacobian is None else np.array(jacobian, dtype=float)
    residual = np.zeros(len(J))
    residual[0] = np.sqrt(phi)
    idle = np.zeros(n, dtype=bool) if unreached is None else np.array(unreached)
    return YieldIterate(x, scaling.to_natural(x), Linearization(residual, J), idle, None)


class Scripted:
    """Stands for an evaluator whose points have given discrepancies, None for no solution."""

    def __init__(self, parameters, phis, stop_after=None):
        self.scaling = Scaling(parameters)
        self.box = TrustBox(self.scaling)
        self.phis, self.seen, self.stop_after = list(phis), [], stop_after

    @property
    def history(self):
        stopped = self.stop_after is not None and len(self.seen) >= self.stop_after
        return SimpleNamespace(stop="enough" if stopped else None)

    def start(self, x, note):
        self.seen.append((note, self.scaling.to_natural(x)))
        phi = self.phis[min(len(self.seen), len(self.phis)) - 1]
        return None if phi is None else point(self.scaling, x, phi)


def scanned(phis, *, parameters=STRENGTHS[:2], start=None, stop_after=None):
    given = Scripted(parameters, phis, stop_after)
    strength = np.array([q.name != "E" for q in parameters])
    begin = None if start is None else point(given.scaling, given.scaling.start, start)
    return given, strength_scan(given, strength, begin)


FALLING = [100.0 - k for k in range(30)]


def test_strengths_come_down_together_from_their_upper_to_their_lower_bounds():
    given, best = scanned(FALLING, parameters=STRENGTHS)
    values = np.array([p for _, p in given.seen])
    steps = int(np.ceil(np.log(40.0) / np.log(1.5)))  # k comes down by a factor of 40
    assert len(values) == steps + 1 == 11
    np.testing.assert_allclose(values[:, 0], np.geomspace(10.0, 1.0, steps + 1))
    np.testing.assert_allclose(values[:, 1], np.geomspace(20.0, 0.5, steps + 1))
    np.testing.assert_allclose(values[:, 2], 3.0)
    assert [note for note, _ in given.seen][:2] == ["strength 1", "strength 2"]
    assert best.phi == pytest.approx(FALLING[steps])


def test_a_scan_has_thirteen_points_at_most_and_ends_at_a_fiftieth():
    given, _ = scanned(FALLING, parameters=(Parameter("c", 2.0, 0.0, 10.0),))
    values = np.array([p[0] for _, p in given.seen])
    np.testing.assert_allclose(values, np.geomspace(10.0, 0.2, 11))
    given, _ = scanned(FALLING, parameters=(Parameter("c", 2.0, 1e-9, 10.0, "log"),))
    assert len(given.seen) == 11
    wide = (Parameter("c", 2.0, 1e-3, np.inf, "log"),)
    given, _ = scanned(FALLING, parameters=wide)
    assert given.seen[0][1][0] == pytest.approx(2.0 * np.sqrt(50.0))


def test_a_single_step_where_the_bounds_are_near():
    given, _ = scanned(FALLING, parameters=(Parameter("c", 2.0, 1.9, 2.0),))
    assert [p[0] for _, p in given.seen] == pytest.approx([2.0, 1.9])


@pytest.mark.parametrize(("phi", "ends"), [(9.9, True), (10.1, False)])
def test_a_tenth_of_the_strongest_ground_is_near_enough(phi, ends):
    given, best = scanned([100.0, 50.0, phi, phi - 0.01])
    assert (len(given.seen) == 3) == ends
    assert not ends or best.phi == pytest.approx(phi)


@pytest.mark.parametrize(("phi", "ends"), [(201.0, True), (199.0, False)])
def test_four_times_the_lowest_is_a_clear_rise(phi, ends):
    given, best = scanned([100.0, 50.0, phi, 49.0, 48.0])
    assert (len(given.seen) == 3) == ends
    assert not ends or best.phi == pytest.approx(50.0)


def test_two_points_above_the_lowest_in_a_row_are_a_clear_rise():
    given, best = scanned([100.0, 50.0, 50.0, 51.0, 1.0])
    assert len(given.seen) == 4
    assert best.phi == pytest.approx(50.0)
    given, _ = scanned([100.0, 50.0, 51.0, 49.0, 60.0, 48.0, 47.9, 47.8, 47.7, 47.6, 47.5])
    assert len(given.seen) == 11


def test_collapse_ends_the_scan_with_the_best_so_far():
    given, best = scanned([100.0, 60.0, None])
    assert len(given.seen) == 3
    assert best.phi == pytest.approx(60.0)
    assert scanned([None])[1] is None
    assert scanned([None], start=7.0)[1].phi == pytest.approx(7.0)


def test_a_start_that_is_as_near_needs_no_scan():
    given, best = scanned([100.0, 5.0], start=9.0)
    assert len(given.seen) == 1
    assert best.phi == pytest.approx(9.0)
    given, best = scanned([100.0, 5.0], start=11.0)
    assert len(given.seen) == 2
    assert best.phi == pytest.approx(5.0)


def test_the_observer_ends_the_scan():
    given, best = scanned(FALLING, stop_after=2)
    assert len(given.seen) == 2
    assert best.phi == pytest.approx(FALLING[1])


# Restarts


N = 1000
LOOSE = Scaling([Parameter(n, 1.0, 1e-9, 1e9, "log") for n in "abc"])


def drawn(jacobian, phi, *, strength, unreached=(False,) * 3, unit=1.0):
    best = point(LOOSE, np.zeros(3), phi, jacobian, unreached)
    restarts = Restarts(np.array(strength), seed=3)
    return np.array([restarts.around(best, np.full(3, unit)) for _ in range(N)])


STIFF = 1e9 * np.eye(3)


def test_new_starts_change_the_readings_by_about_as_much_as_they_are_off():
    J = np.diag([10.0, 100.0, 1e-3])
    x = drawn(J, 4.0, strength=[False] * 3)
    assert x[:, 0].std() == pytest.approx(2.0 / 10.0, rel=0.05)
    assert x[:, 1].std() == pytest.approx(2.0 / 100.0, rel=0.05)
    assert np.abs(x[:, 2]).max() == pytest.approx(0.4)  # no further than this
    inside = np.abs(x[:, 2]) < 0.4
    assert inside.mean() == pytest.approx(0.818, abs=0.04)  # of a normal one of 0.3
    assert np.abs(x.mean(axis=0)).max() < 0.02


def test_a_direction_that_the_readings_do_not_see_at_all_is_drawn_as_well():
    x = drawn([[1e9, 0.0, 0.0]], 4.0, strength=[False] * 3)
    assert np.abs(x[:, 0]).max() < 1e-6
    assert x[:, 1].std() > 0.2
    assert x[:, 2].std() > 0.2


def test_unreached_planes_come_down_a_little_or_go_up():
    x = drawn(STIFF, 1.0, strength=[True, True, False], unreached=[True, False, False])
    down, up = x[:, 0] < -1e-6, x[:, 0] > 1e-6
    assert down.mean() == pytest.approx(0.7, abs=0.03)
    assert (down | up).mean() == pytest.approx(1.0, abs=0.01)
    assert x[:, 0].min() == pytest.approx(-0.1, abs=2e-3)
    assert x[:, 0].max() == pytest.approx(0.3, abs=2e-2)
    assert x[down, 0].mean() == pytest.approx(-0.05, abs=5e-3)


def test_reached_planes_go_up_now_and_then_and_other_parameters_do_not():
    x = drawn(STIFF, 1.0, strength=[True, True, False], unreached=[True, False, False])
    up = x[:, 1] > 1e-6
    assert up.mean() == pytest.approx(0.3, abs=0.03)
    assert x[:, 1].min() > -1e-6
    assert x[up, 1].mean() == pytest.approx(0.15, abs=0.01)
    assert np.abs(x[:, 2]).max() < 1e-6


def test_steps_are_in_the_units_of_the_parameters():
    one = drawn(STIFF, 1.0, strength=[True] * 3)
    two = drawn(STIFF, 1.0, strength=[True] * 3, unit=2.0)
    np.testing.assert_allclose(two, 2.0 * one, atol=1e-6)


def test_strengths_are_raised_ever_more_as_far_as_their_bounds():
    """By 1.1, its square, the square of that; the bound of the one ends what the other may do."""
    parameters = (
        Parameter("k1", 1.0, 0.1, 1.3, "log"),
        Parameter("k2", 2.0, 0.1, 3.0, "linear"),
        Parameter("E", 5.0, 1.0, 9.0, "log"),
    )
    scaling = Scaling(parameters)
    found = [scaling.to_natural(x) for x in raised(scaling, np.array([True, True, False]))]
    factors = [1.1, 1.1**2, 1.1**4, 1.1**8]
    expected = [[min(f, 1.3), min(2.0 * f, 3.0), 5.0] for f in factors]
    np.testing.assert_allclose(found, expected)
