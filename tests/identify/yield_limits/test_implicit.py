"""The rules of the implicit search one by one, on bars whose answers are known by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.plastic_bars import Frame, PlasticBars

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Iterate, Step
from geoident.identify.least_squares.descent import Ending
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Linearization, Problem
from geoident.identify.yield_limits import implicit
from geoident.identify.yield_limits.implicit import ImplicitSearch, certificate_at, is_better
from geoident.model.methods import ComplementarityOptions
from geoident.model.parameter import Parameter


def searching(*, n=3, readings=6, lower=0.1, upper=20.0, start=2.0, **options):
    """Frames of one bar that yields and one that does not, n strengths."""
    frames = [Frame([1.0, 1.0], [i % n, None], [2.0]) for i in range(readings)]
    bars = PlasticBars(frames, n)
    parameters = tuple(Parameter(f"k{i + 1}", start, lower, upper, "log") for i in range(n))
    measured = bars.readings(np.full(n, 0.8))
    problem = Problem(bars, measured, np.full(len(measured), 1e-3), parameters)
    return ImplicitSearch(problem, ComplementarityOptions(**options), lambda entry: None)


def of_phi(phi):
    return Iterate(
        np.zeros(1), np.zeros(1), Linearization(np.array([np.sqrt(phi)]), np.zeros((1, 1)))
    )


def ending(phi):
    return Ending(of_phi(phi), "converged", "")


@pytest.mark.parametrize(
    ("phi", "restarts"),
    [(3.0, 3), (10.3, 3), (10.4, 18), (1e-9, 3), (1e4, 18)],
)
def test_restarts_go_on_longer_where_residuals_are_not_explained(phi, restarts):
    """Six readings of three strengths: phi is 3 +- sqrt(6), three of them to both sides."""
    assert searching().patience(ending(phi)) == restarts


def test_restarts_go_on_longer_where_readings_are_more_exact_than_stated():
    """40 readings of 2 strengths: 38 +- 8.7."""
    search = searching(n=2, readings=40)
    assert search.patience(ending(11.8)) == 3 * 3
    assert search.patience(ending(12.0)) == 2
    assert searching(n=1, readings=1).patience(ending(1.0)) == 2
    assert searching(n=1, readings=1).patience(ending(5.2)) == 2
    assert searching(n=1, readings=1).patience(ending(5.3)) == 3 * 2


@pytest.mark.parametrize(("phi", "better"), [(0.9991, False), (0.9989, True)])
def test_a_thousandth_less_is_no_better(phi, better):
    assert is_better(of_phi(phi), of_phi(1.0)) == better


@pytest.mark.parametrize(
    ("number", "radius", "stuck"), [(0, 1e-6, False), (1, 1.1e-5, False), (1, 0.9e-5, True)]
)
def test_short_steps_go_back_and_forth_over_a_kink(number, radius, stuck):
    assert searching().stuck(number, radius, 1.0) == stuck


def test_the_budget_counts_the_evaluations_of_this_search():
    search = searching(max_evaluations=2)
    assert not search.spent()
    for count in (1, 2):
        search.evaluator.evaluate(search.scaling.start)
        assert search.spent() == (count == 2)
    assert search.stuck(0, 1.0, 1.0)


def test_readings_met_to_a_ten_thousandth_are_met_exactly():
    assert searching().exact == pytest.approx(6 * 1e-8)


def test_a_weakened_point_has_its_strengths_half_way_to_the_weak_side():
    search = searching()
    point = search.evaluator.evaluate(search.scaling.to_scaled(np.full(3, 0.8)))
    weak = search.scaling.to_natural(search.weakened(point))
    assert weak == pytest.approx(np.full(3, np.sqrt(2.0 * 0.1)))
    endless = searching(lower=0.0)
    point = endless.evaluator.evaluate(endless.scaling.to_scaled(np.full(3, 0.8)))
    assert endless.scaling.to_natural(endless.weakened(point)) == pytest.approx(np.full(3, 2.0))


def test_an_unreached_plane_is_brought_to_a_millionth_of_where_it_is_reached():
    """The bars carry 1 each of a load of 2; at a strength of 2 none yields."""
    search = searching()
    point = search.evaluator.evaluate(search.scaling.start)
    assert point.unreached.all()
    assert point.p == pytest.approx(np.full(3, 1.0 + 2e-6), abs=1e-9)
    assert np.all(point.p > 1.0)


def test_an_unreached_plane_that_is_as_near_stays():
    search = searching()
    p = np.array([1.0 + 4e-7, 1.0 + 8e-7, 1.5])
    point = search.evaluator.evaluate(search.scaling.to_scaled(p))
    assert point.unreached.all()
    assert point.p == pytest.approx([*p[:2], 1.0 + 1.5e-6], rel=0.0, abs=1e-10)


def test_unreached_planes_rise_with_each_step_or_wait():
    search = searching()
    point = search.evaluator.evaluate(search.scaling.start)
    rising, waiting = (descent.propose(point, 1.0) for descent in search.descents)
    assert rising.d == pytest.approx(np.full(3, 0.5))
    assert waiting.d == pytest.approx(np.zeros(3))
    assert rising.length == waiting.length == 0.0


def test_a_restart_that_stays_far_off_is_given_up():
    """After three steps phi must be below ten times the best, and there are twelve at most."""
    search = searching()
    seen = []

    class Recorder:
        def run(self, start, give_up, leave):
            seen.extend(
                give_up(number, 1.0, lowest)
                for number, lowest in ((2, 1e9), (3, 10.1), (3, 9.9), (11, 1.0), (12, 1.0))
            )

    search.descents = [Recorder(), Recorder()]
    start = search.evaluator.evaluate(search.scaling.to_scaled(np.full(3, 0.9)))

    class Around:
        def around(self, best, unit):
            return best.x

    scaled = Linearization(start.model.residual / np.sqrt(start.phi), start.model.jacobian)
    best = type(start)(start.x, start.p, scaled, start.unreached, start.activity)
    search.restart(best.x, best, 0)
    assert seen == [False, True, False, False, True]


@pytest.mark.parametrize(
    ("phi", "length", "promised", "left"),
    [
        (8.9, 0.29, 7.98, True),
        (9.1, 0.29, 7.98, False),  # not there yet
        (7.99, 0.29, 7.98, False),  # lower than the best
        (8.9, 0.31, 7.98, False),  # far from where it goes
        (8.9, 0.29, 7.97, False),  # three thousandths less are worth looking for
        (8.9, 0.29, 8.5, True),
    ],
)
def test_a_restart_that_ends_no_lower_than_the_best_point_is_left(phi, length, promised, left):
    """The best has 8, of 10 readings less one parameter: within 1 of it is beside it."""
    search, asked = searching(n=1, readings=10), []
    start = search.evaluator.evaluate(search.scaling.start)

    class Recorder:
        def run(self, start, give_up, leave):
            asked.append(leave(of_phi(phi), Step(np.zeros(1), length, phi - promised)))

    search.descents = [Recorder(), Recorder()]
    search.restart(start.x, of_phi(8.0), 0)
    assert asked == [left]


def test_where_residuals_are_not_explained_beside_is_farther():
    search, asked = searching(n=1, readings=10), []
    start = search.evaluator.evaluate(search.scaling.start)

    class Recorder:
        def run(self, start, give_up, leave):
            asked.extend(
                leave(of_phi(phi), Step(np.zeros(1), 0.1, phi - 90.0)) for phi in (99.9, 100.1)
            )

    search.descents = [Recorder(), Recorder()]
    search.restart(start.x, of_phi(90.0), 0)
    assert asked == [True, False]


def test_one_reading_to_spare_is_the_least_that_counts():
    """As many readings as strengths: 90 is unexplained, and what is within twice of it beside."""
    search, asked = searching(n=1, readings=1), []
    start = search.evaluator.evaluate(search.scaling.start)

    class Recorder:
        def run(self, start, give_up, leave):
            asked.extend(
                leave(of_phi(phi), Step(np.zeros(1), 0.1, phi - 90.0)) for phi in (179.0, 181.0)
            )

    search.descents = [Recorder(), Recorder()]
    search.restart(start.x, of_phi(90.0), 0)
    assert asked == [True, False]


class Ways:
    """Stands for descents; each says which one it was and ends where it is told."""

    def __init__(self, name, seen, end=None):
        self.name, self.seen, self.end = name, seen, end

    def run(self, start, give_up, leave=None):
        self.seen.append(self.name)
        return self.end or Ending(start, "converged", "")


def test_restarts_go_down_the_two_ways_in_turn():
    """First and third with planes rising, the others waiting; at last as the last restart did."""
    search, seen = searching(restarts=3, max_evaluations=100), []
    search.descents = [Ways("rising", seen), Ways("waiting", seen)]
    start = search.evaluator.evaluate(search.scaling.to_scaled(np.full(3, 0.9)))
    search.improve(start)
    assert seen == ["rising", "rising", "waiting", "rising", "rising"]
    assert search.tried == 3
    seen.clear()
    search.improve(start)
    assert seen == ["rising", "waiting", "rising", "waiting", "waiting"]


def test_fruitless_restarts_are_counted_in_a_row(monkeypatch):
    """Two in a row may be fruitless here; 0.05 % less is kept, but bears no fruit."""
    search = searching(restarts=50, max_evaluations=100)
    start = search.evaluator.evaluate(search.scaling.to_scaled(np.full(3, 0.9)))
    size = np.sqrt(np.array([0.9, None, 0.9 * 0.9995, 0.4, 0.5, 0.4, 0.5, 0.4, 0.1]).astype(float))
    factors = iter(size)

    def restart(x, best, number):
        factor = next(factors)
        if np.isnan(factor):
            return None
        scaled = Linearization(factor * start.model.residual, factor * start.model.jacobian)
        return Ending(
            type(start)(start.x, start.p, scaled, start.unreached, start.activity), "", ""
        )

    search.descents = [Ways("rising", []), Ways("waiting", [])]
    monkeypatch.setattr(search, "restart", restart)
    monkeypatch.setattr(search, "patience", lambda best: 2)
    first = search.improve(start)
    assert first.point.phi == pytest.approx(0.9 * 0.9995 * start.phi)
    assert search.tried == 3
    second = search.improve(start)
    assert second.point.phi == pytest.approx(0.4 * start.phi)
    assert search.tried == 6
    third = search.improve(second.point)
    assert third.point.phi == second.point.phi
    assert search.tried == 8


def elsewhere(search, point, better=None):
    """What is begun by plain descents from elsewhere, and how it ends."""
    seen, improved = [], []
    there = better or of_phi(point.phi)
    search.plain = SimpleNamespace(
        evaluator=SimpleNamespace(start=lambda x, note: seen.append((note, x)) or there),
        run=lambda start, give_up: Ending(start, "", ""),
    )
    search.improve = lambda start: improved.append(start) or Ending(start, "improved", "")
    return search.from_elsewhere(Ending(point, "first", "")), seen, improved


def unreached_and_not(search, phi=4.0):
    """A point with an unreached plane and one without, of a given discrepancy."""
    point = search.evaluator.evaluate(search.scaling.start)
    size = np.sqrt(phi / point.phi)
    scaled = Linearization(size * point.model.residual, size * point.model.jacobian)
    return [
        type(point)(point.x, point.p, scaled, unreached, point.activity)
        for unreached in (np.array([False, True, False]), np.zeros(3, dtype=bool))
    ]


def test_elsewhere_is_looked_only_where_a_strength_ended_unreached():
    """From the start and from the weakened point, while there are readings and evaluations left."""
    for options, phi, which, looked in (
        ({}, 4.0, 0, 2),
        ({}, 4.0, 1, 0),
        ({}, 0.9e-8 * 6, 0, 0),
        ({"max_evaluations": 1}, 4.0, 0, 0),
    ):
        search = searching(**options)
        point = unreached_and_not(search, phi)[which]
        found, seen, improved = elsewhere(search, point)
        assert (found.status, improved) == ("first", [])
        assert len(seen) == looked, (options, phi, which)
    search = searching()
    point = unreached_and_not(search)[0]
    _, seen, _ = elsewhere(search, point)
    assert [note for note, _ in seen] == ["plain descent"] * 2
    assert seen[0][1] == pytest.approx(search.scaling.start)
    assert seen[1][1] == pytest.approx(search.weakened(point))


def test_what_is_better_elsewhere_is_improved_from_there():
    search = searching()
    point = unreached_and_not(search)[0]
    x = search.scaling.to_scaled(np.full(3, 0.9))
    lower = Iterate(x, np.full(3, 0.9), of_phi(3.9).model)
    found, _, improved = elsewhere(search, point, lower)
    assert found.status == "improved"
    assert [one.p for one in improved] == [pytest.approx(np.full(3, 0.9))] * 2


@pytest.mark.parametrize(
    ("strengths", "exact", "scanned"), [(True, 0.0, True), (False, 0.0, False), (True, 1e9, False)]
)
@pytest.mark.parametrize("lower", [None, "the best of the scan"])
def test_strengths_are_scanned_unless_the_start_meets_all_readings(
    monkeypatch, strengths, exact, scanned, lower
):
    search, asked = searching(), []
    search.exact = exact

    def scan(evaluator, which, start):
        asked.append((which.tolist(), start))
        return lower

    monkeypatch.setattr(implicit, "strengths", lambda activity, slope: np.full(3, strengths))
    monkeypatch.setattr(implicit, "strength_scan", scan)
    found = search.begin()
    if scanned:
        ((which, start),) = asked
        assert which == [True] * 3
        assert found is (lower or start)
    assert (found == lower) == (scanned and lower is not None)
    assert len(asked) == scanned


def test_where_no_start_has_a_solution_the_first_says_why():
    bars = PlasticBars([Frame([1.0], [0], [5.0])], 1)
    parameters = (Parameter("k1", 1.0, 0.1, 4.0, "log"),)
    problem = Problem(bars, np.array([1.0]), np.array([1e-3]), parameters)
    notes = []
    search = ImplicitSearch(problem, ComplementarityOptions(), lambda e: notes.append(e.note))
    with pytest.raises(ModelError, match="cannot carry the load"):
        search.run()
    assert notes == ["start: no solution", *["rescue: no solution"] * 9]
    assert certificate_at(problem, np.array([1.0]), History("test", bars, lambda e: None)) is None


@pytest.mark.parametrize(
    ("tried", "said"),
    [
        (0, "Done."),
        (1, "Done. One further descent found nothing better."),
        (3, "Done. 3 further descents found nothing better."),
    ],
)
def test_further_descents_are_told_where_there_are_any(tried, said):
    search = searching()
    search.tried = tried
    best, proof = Ending(of_phi(1.0), "converged", "Done."), SimpleNamespace(kind="stationary")
    assert search.ending(best, proof) == ("converged", said)
