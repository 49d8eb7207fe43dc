"""The parts of a descent one by one: which trials are taken, the next radius, when it ends."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.identify.least_squares.acceptance import Acceptance, Iterate, Step
from geoident.identify.least_squares.descent import Stopping, gradient_cosines
from geoident.identify.least_squares.gauss_newton import (
    gauss_newton_descent,
    gauss_newton_step,
    phi_after_step,
)
from geoident.identify.least_squares.trust_region import TrustBox
from geoident.identify.problem.problem import Linearization
from geoident.identify.problem.scaling import Scaling
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter


def iterate(x, residual, jacobian=((1.0,), (0.0,))):
    """A point with given residuals; by default one parameter that moves the first of two."""
    x, r, J = (np.array(a, dtype=float) for a in (np.atleast_1d(x), residual, jacobian))
    return Iterate(x, x, Linearization(r, J))


def step(d, *, gain=1.0, length=1.0):
    return Step(np.atleast_1d(np.array(d, dtype=float)), length, gain)


@dataclass
class Case:
    """What is left of the radius after one trial from a point of phi = 101 (residuals 10 and 1)."""

    acceptance: Acceptance
    note: str


def judged(trial, **given):
    acceptance = Acceptance(iterate(0.0, [10.0, 1.0]))
    return Case(acceptance, acceptance.judge(step(-1.0, **given), trial))


# Acceptance


def test_the_first_radius_allows_a_factor_of_four_and_a_half():
    assert np.exp(Acceptance(iterate(0.0, [1.0, 1.0])).radius) == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize(
    ("ratio", "length", "radius"),
    [
        (0.24, 1.2, 0.6),  # the promise was poor: half of the step
        (0.26, 1.2, 1.5),  # neither
        (0.74, 1.5, 1.5),
        (0.76, 1.5, 3.0),  # the promise was kept at the edge of the region: twice as far
        (0.76, 1.36, 3.0),
        (0.76, 1.34, 1.5),  # kept, but the step ended well inside
    ],
)
def test_the_radius_follows_the_ratio_of_gain_and_promise(ratio, length, radius):
    found = judged(iterate(-1.0, [9.0, 1.0]), gain=19.0 / ratio, length=length)
    assert found.note == "accepted"
    assert found.acceptance.radius == pytest.approx(radius)
    assert found.acceptance.point is found.acceptance.best
    assert found.acceptance.best.phi == 82.0


def test_where_there_is_no_solution_the_radius_is_four_tenths_of_the_step():
    found = judged(None, length=1.2)
    assert found.note == "rejected: no solution"
    assert found.acceptance.radius == pytest.approx(0.48)


@pytest.mark.parametrize(
    ("phi", "part"),
    [
        (101.0, 0.5),  # the parabola through slope -20 and no gain is lowest half way
        (121.0, 0.25),
        (160.0, 0.2),  # 20 / (2 (59 + 20)) would be less
    ],
)
def test_a_rejected_step_is_shortened_to_the_minimum_of_a_parabola(phi, part):
    found = judged(iterate(-1.0, [10.0, np.sqrt(phi - 100.0)]), length=1.2)
    assert found.note == "rejected"
    assert found.acceptance.radius == pytest.approx(1.2 * part)
    assert found.acceptance.point.phi == found.acceptance.best.phi == 101.0


@pytest.mark.parametrize(("first", "note"), [(8.99, "accepted: detour"), (9.01, "rejected")])
def test_a_rise_is_taken_where_the_next_correction_is_shorter_by_a_tenth(first, note):
    """J^+ r is the first residual: it was 10."""
    found = judged(iterate(-1.0, [first, 30.0]))
    assert found.note == note
    assert (found.acceptance.point.phi > 101.0) == (note != "rejected")
    assert found.acceptance.best.phi == 101.0


def test_parameters_that_did_not_move_have_no_part_in_that_test():
    """The second parameter could cancel all; it was held."""
    start = iterate([0.0, 0.0], [10.0, 1.0], np.eye(2))
    acceptance = Acceptance(start)
    trial = iterate([-1.0, 0.0], [1.0, 30.0], np.eye(2))
    assert acceptance.judge(step([-1.0, 0.0]), trial) == "accepted: detour"
    both = Acceptance(start)
    assert both.judge(step([-1.0, 1.0]), trial) == "rejected"


def test_a_detour_of_three_steps_ends_at_the_best_point_with_a_quarter_of_its_first_step():
    """Two steps above the best phi are allowed; the third brings the search back."""
    acceptance = Acceptance(iterate(0.0, [10.0, 1.0]))
    assert acceptance.judge(step(-1.0, length=1.2), iterate(-1.0, [8.0, 30.0])) != "rejected"
    assert acceptance.judge(step(-1.0), iterate(-2.0, [6.0, 31.0])) == "accepted: detour"
    assert acceptance.point.phi > 900.0
    assert acceptance.judge(step(-1.0), iterate(-3.0, [4.0, 32.0])) == "rejected"
    assert acceptance.point is acceptance.best
    assert acceptance.radius == pytest.approx(0.25 * 1.2)
    again = iterate(-1.0, [1.0, 30.0])
    assert acceptance.judge(step(-0.1), again) == "rejected"  # needs a new best point first
    lower = iterate(-0.1, [9.9, 1.0])
    assert acceptance.judge(step(-0.1), lower) == "accepted"
    assert acceptance.judge(step(-0.1), iterate(-1.0, [1.0, 30.0])) == "accepted: detour"


def test_a_fall_within_a_detour_that_stays_above_the_best_counts_as_a_step_of_it():
    acceptance = Acceptance(iterate(0.0, [10.0, 1.0]))
    acceptance.judge(step(-1.0), iterate(-1.0, [8.0, 30.0]))
    acceptance.judge(step(-1.0), iterate(-2.0, [7.0, 29.0]))
    acceptance.judge(step(-1.0), iterate(-3.0, [6.0, 28.0]))
    assert acceptance.point is acceptance.best
    assert acceptance.best.phi == 101.0


def test_a_detour_that_comes_out_below_the_best_goes_on_from_there():
    acceptance = Acceptance(iterate(0.0, [10.0, 1.0]))
    acceptance.judge(step(-1.0), iterate(-1.0, [8.0, 30.0]))
    assert acceptance.judge(step(-1.0, gain=900.0), iterate(-2.0, [2.0, 1.0])) == "accepted"
    assert acceptance.best.phi == acceptance.point.phi == 5.0


def test_no_solution_within_a_detour_ends_it():
    acceptance = Acceptance(iterate(0.0, [10.0, 1.0]))
    acceptance.judge(step(-1.0, length=0.8), iterate(-1.0, [8.0, 30.0]))
    acceptance.judge(step(-1.0, length=0.5), None)
    assert acceptance.point is acceptance.best
    assert acceptance.radius == pytest.approx(0.25 * 0.8)


# Stopping


@pytest.fixture
def box():
    return TrustBox(Scaling([Parameter("a", 0.0, -2.0, 2.0), Parameter("b", 2.0, -2.0, 2.0)]))


@pytest.mark.parametrize(("length", "ends"), [(0.9e-6, True), (1e-6, True), (1.1e-6, False)])
def test_a_step_below_the_tolerance_is_none(box, length, ends):
    found = Stopping(box, 1e-6).reason(iterate(0.0, [3.0, 1.0]), step(0.0, length=length))
    assert (found is not None) == ends
    said = "The next step would change no parameter by more than 1e-06, relative."
    assert found == (said if ends else None)


@pytest.mark.parametrize(
    ("phi", "gain", "ends"),
    [
        (4.0, 3.9e-6, True),
        (4.0, 4.1e-6, False),
        (1e6, 0.99999e-2, True),  # of phi, 1e4 counts at most
        (1e6, 1.00001e-2, False),
        (1e20, 0.9e6, True),  # rounding of phi itself
        (1e20, 1.1e6, False),
    ],
)
def test_a_gain_below_the_tolerance_of_phi_is_none(box, phi, gain, ends):
    point = iterate(0.0, [np.sqrt(phi), 0.0])
    found = Stopping(box, 1e-6).reason(point, step(0.0, gain=gain))
    assert (found is not None) == ends
    assert not ends or f"by no more than {gain:.1e}" in (found or "")


@pytest.mark.parametrize(("gain", "ends"), [(3.9e-5, True), (4.1e-5, False)])
def test_the_gain_may_have_a_tolerance_of_its_own(box, gain, ends):
    point = iterate(0.0, [2.0, 0.0])
    assert bool(Stopping(box, 1e-6, 1e-5).reason(point, step(0.0, gain=gain))) == ends


def test_a_descent_by_modes_of_a_field_ends_at_ten_times_the_gain():
    """A gain of 0.9e-7 of phi is promised: too much for a parameter, not for a mode."""

    def ended(parameters, part=0.9e-7):
        problem = SimpleNamespace(
            problem=SimpleNamespace(parameters=parameters),
            scaling=Scaling(parameters),
            noise=lambda: np.zeros(0),
        )
        history = SimpleNamespace(stop=None)
        descent = gauss_newton_descent(problem, GaussNewtonOptions(), history)
        return descent.stopping.reason(iterate(0.0, [2.0, 0.0]), step(0.0, gain=4.0 * part))

    one = Parameter("E", 1.0, 0.1, 10.0)
    mode = replace(one, name="rock.mode-1", field="rock")
    assert ended((one,)) is None
    assert ended((one, mode))
    assert ended((one, mode), 1.1e-7) is None
    assert ended((one,), 0.9e-8)
    assert ended((one,), 1.1e-8) is None


@pytest.mark.parametrize(
    ("gain", "length", "ends"),
    [(0.9e-6, 0.9e-3, True), (1.1e-6, 0.9e-3, False), (0.9e-6, 1.1e-3, False)],
)
def test_only_rounding_rejects_a_short_step_for_little_gain(box, gain, length, ends):
    assert Stopping(box, 1e-6).negligible(step(0.0, gain=gain, length=length)) == ends


@pytest.mark.parametrize(("slope", "flat"), [(0.9e-3, True), (1.1e-3, False)])
def test_residuals_at_right_angles_to_all_columns_are_flat(box, slope, flat):
    J = np.array([[slope, 0.0], [np.sqrt(1.0 - slope**2), 0.0]])
    assert Stopping(box, 1e-6).flat(iterate([0.0, 0.0], [7.0, 0.0], J)) == flat


def test_a_slope_that_only_leads_out_of_the_bounds_is_none(box):
    """The second parameter starts on its upper bound."""
    J = np.array([[3.0, 4.0], [4.0, -3.0]])
    start = Scaling([Parameter("a", 0.0, -2.0, 2.0), Parameter("b", 2.0, -2.0, 2.0)]).start
    outwards = gradient_cosines(box, iterate(start, [-2.0, 0.0], J))
    assert outwards == pytest.approx([0.6, 0.0])
    inwards = gradient_cosines(box, iterate(start, [2.0, 0.0], J))
    assert inwards == pytest.approx([0.6, 0.8])
    assert gradient_cosines(box, iterate(start, [0.0, 0.0], J)).tolist() == [0.0, 0.0]


# The step


def test_the_step_promises_the_gain_of_the_linearised_discrepancy(box):
    J = np.array([[1.0, 0.0], [0.0, 1.0]])
    point = iterate([0.0, 0.0], [0.5, 2.0], J)
    found = gauss_newton_step(box, point, 0.3)
    assert found.d == pytest.approx([-0.5, -0.3])
    assert found.length == pytest.approx(0.3)
    assert found.gain == pytest.approx(0.25 + 4.0 - 1.7**2)


def test_phi_after_the_first_step_of_some_parameters():
    J = np.array([[1.0, 1.0], [0.0, 1.0]])
    wide = TrustBox(Scaling([Parameter(n, 0.0, -np.inf, np.inf) for n in "ab"]))
    point = iterate([0.0, 0.0], [2.0, 1.0], J)
    assert phi_after_step(wide, point, np.array([True, False])) == pytest.approx(0.5**2 + 1.0)
    assert phi_after_step(wide, point, np.array([False, True])) == pytest.approx(2 * 0.5**2)
    assert phi_after_step(wide, point, np.array([False, False])) == 5.0
