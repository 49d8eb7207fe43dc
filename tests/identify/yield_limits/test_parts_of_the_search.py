"""Beginnings, restarts and endings of the implicit search, one by one."""

from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats.qmc import Halton
from support.plastic_bars import Frame, PlasticBars

from geoident.errors import CollapseError
from geoident.identify.least_squares.acceptance import Iterate
from geoident.identify.least_squares.descent import Ending
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Linearization, Problem
from geoident.identify.yield_limits import implicit
from geoident.identify.yield_limits.implicit import ImplicitSearch, RestartLook, certificate_at
from geoident.identify.yield_limits.stationarity import StationarityCheck
from geoident.model.methods import ComplementarityOptions
from geoident.model.parameter import Parameter


class Watched(PlasticBars):
    """Bars that note where derivatives were asked for, and look ahead at some parts at a time."""

    at_once, may_be_led = 1, False

    def __init__(self, *given, **options):
        super().__init__(*given, **options)
        self.asked, self.looks, self.turned = [], [], []

    def evaluate(self, p):
        self.asked.append(p.tolist())
        return super().evaluate(p)

    @contextmanager
    def turns(self, looks):
        self.looks.append(looks)
        yield self.turned.append


FRAMES = [
    Frame([1.0, 1.5], [0, None], [2.0]),
    Frame([1.0, 0.7, 0.4], [1, 0, None], [2.5]),
    Frame([2.0, 0.5], [1, None], [1.7]),
]


def searching(
    *, off=0.0, frames=FRAMES, start=(0.9, 1.1), seen=None, lower=0.1, upper=20.0, **given
):
    """A search for two strengths of three frames, the readings of 0.5 and 0.8 off by a part."""
    bars = Watched(frames, 2)
    parameters = tuple(Parameter(f"k{i + 1}", x, lower, upper, "log") for i, x in enumerate(start))
    measured = PlasticBars(FRAMES, 2).readings(np.array([0.5, 0.8]))
    measured = measured * (1.0 + off * np.array([1.0, -1.0, 2.0]))
    problem = Problem(bars, measured, np.full(3, 1e-3), parameters)
    notes = [] if seen is None else seen
    search = ImplicitSearch(problem, ComplementarityOptions(**given), notes.append)
    return search, notes, bars


def weak(frames=FRAMES):
    """Frames without a bar that never yields: they collapse where strengths are small."""
    return [
        Frame(f.stiffness[:-1], f.strength[:-1], [0.7 * load for load in f.loads]) for f in frames
    ]


# Beginnings


def test_a_descent_alone_begins_at_the_start_and_scans_nothing():
    search, notes, bars = searching(restarts=0)
    outcome = search.descend()
    assert outcome.values == pytest.approx([0.5, 0.8], rel=1e-6)
    assert outcome.certificate.kind == "global"
    assert (notes[0].note, notes[0].step, notes[0].method) == ("start", 0.0, "complementarity")
    assert bars.asked[0] == pytest.approx([0.9, 1.1])
    assert {note.note for note in notes} <= {"start", "accepted", "rejected"}
    with pytest.raises(CollapseError):
        searching(frames=weak(), start=(0.2, 0.2))[0].descend()
    first = implicit.descend(search.problem, search.options, lambda entry: None)
    assert first.values == pytest.approx(outcome.values)


def scripted_checks(search, lowers):
    """What the sides of endings say, in turn; and what descents and restarts began at."""
    begun = []
    lowers = iter(lowers)
    search.check = lambda best: StationarityCheck(best.point, 0.0, 0, next(lowers))
    search.descents = [SimpleNamespace(run=lambda start, stuck: fail()) for _ in range(2)]

    def run(start, give_up, leave=None):
        begun.append(("descent", start))
        return Ending(start, "converged", "Done.")

    def improve(start):
        begun.append(("improve", start))
        return Ending(start, "converged", "Improved.")

    search.descents = [SimpleNamespace(run=run, name=n) for n in ("rising", "waiting")]
    search.improve = improve
    return begun


def fail():
    raise AssertionError


def points(search, *factors):
    return [search.evaluator.evaluate(search.scaling.start + np.log(f)) for f in factors]


def test_a_search_goes_on_from_the_lower_side_of_a_kink_for_three_rounds():
    search, _, _ = searching(off=0.3)
    a, b, c, d, e = points(search, 1.0, 0.9, 0.8, 0.7, 0.6)
    begun = scripted_checks(search, [b, None])
    search.descent = search.descents[1]
    best, found = search.settled(Ending(a, "", ""))
    assert [point for _, point in begun] == [b]
    assert (best.point, found.point) == (b, b)
    begun = scripted_checks(search, [b, c, d, e])
    search.descent = search.descents[1]
    best, found = search.settled(Ending(a, "", ""))
    assert [point for _, point in begun] == [b, c, d]
    assert (best.point, found.lower) == (d, e)
    begun = scripted_checks(search, [b])
    search.descent, search.spent = search.descents[1], lambda: True
    assert search.settled(Ending(a, "", ""))[0].point is a
    assert begun == []


def test_a_descent_that_stays_at_a_kink_is_improved_by_restarts():
    search, _, _ = searching(off=0.3)
    b, c, d, e = points(search, 0.9, 0.8, 0.7, 0.6)
    begun = scripted_checks(search, [b, c, d, e, None])
    search.outcome = lambda best, found: (best, found)
    best, found = search.descend()
    assert [kind for kind, _ in begun] == ["descent"] * 4 + ["improve"]
    assert begun[-1][1] is best.point is e
    assert (best.reason, found.lower) == ("Improved.", None)
    assert search.descent is search.descents[1]
    begun = scripted_checks(search, [b, c, d, e])
    search.spent = lambda: len(begun) >= 4
    assert search.descend()[1].lower is e
    assert [kind for kind, _ in begun] == ["descent"] * 4


def test_where_the_start_collapses_its_strengths_are_raised():
    search, notes, _ = searching(frames=weak(), start=(1.0, 1.0), upper=9.0)
    point = search.begin()
    assert notes[0].note == "start: no solution"
    assert notes[0].objective == np.inf
    assert notes[1].note == "rescue"  # the strongest ground, to know what is a strength
    assert notes[1].values == pytest.approx([9.0, 9.0])
    raised = [entry for entry in notes if entry.note.startswith("stronger")]
    factors = [1.1, 1.21, 1.4641]
    assert [entry.values.tolist() for entry in raised] == [
        pytest.approx([f, f]) for f in factors[: len(raised)]
    ]
    assert [entry.note for entry in raised] == ["stronger: no solution"] * (len(raised) - 1) + [
        "stronger"
    ]
    assert search.remarks[0].startswith(
        "The search began elsewhere than at the start: the bars cannot carry the load"
    )
    assert len(search.remarks) == 1
    assert point.phi < np.inf
    assert not search.retreat(np.zeros(2, dtype=bool))
    search.spent = lambda: True
    before = len(notes)
    assert search.retreat(np.ones(2, dtype=bool)) is None
    assert len(notes) == before


def test_retreat_ends_at_the_upper_bounds():
    search, notes, _ = searching(frames=weak(), start=(0.3, 0.3), upper=0.36)
    assert search.retreat(np.ones(2, dtype=bool)) is None
    assert [entry.values[0] for entry in notes] == pytest.approx([0.33, 0.36])


def test_the_strongest_ground_is_tried_before_other_places():
    """Where a bound is infinite, the start takes its place; then Halton's points."""
    search, notes, _ = searching(frames=weak(), start=(0.9, 1.2), upper=np.inf)
    first = search.fallback()
    assert notes[0].values == pytest.approx([0.9, 1.2])
    natural = [entry.values.tolist() for entry in notes]
    low, high = np.log([0.1, 0.1]), np.log([0.9, 1.2]) + 2.0
    share = Halton(2, scramble=False).random(8)[1:]
    expected = np.exp(low + share * (high - low))
    np.testing.assert_allclose(natural[1:], expected)
    assert notes[-1].note == "rescue"
    assert first.p == pytest.approx([1.4, 1.19], rel=1e-5)  # what it takes to stand


# Restarts


def test_a_restart_apart_asks_what_a_restart_asks():
    """The same points, in the same order, with the rule of its number."""
    for number in (0, 1):
        search, _, bars = searching(off=0.05)
        best = search.evaluator.evaluate(np.log([0.6, 0.9]))
        known = Iterate(best.x, best.p, best.model)
        x = np.log([0.75, 0.7])
        bars.asked.clear()
        search.restart(x, known, number)
        asked = bars.asked.copy()
        bars.asked.clear()
        RestartLook(implicit.apart(search.problem), search.options, x, known, number)(bars)
        assert bars.asked == asked
        assert len(asked) > 2


def test_restarts_are_told_ahead_as_they_will_come():
    search, _, bars = searching(off=0.05, seed=4)
    bars.at_once = 3
    best = search.evaluator.evaluate(np.log([0.6, 0.9]))
    search.tried = 5
    restarts = implicit.Restarts(np.ones(2, dtype=bool), 4)
    begun = []
    search.restart = lambda x, known, number: begun.append((x, known, number)) or "end"
    assert list(search.restarted(restarts, best, 2)) == ["end"] * 2
    assert list(search.restarted(restarts, best, 9)) == ["end"] * 3
    assert search.tried == 10
    told = [look for looks in bars.looks for look in looks]
    assert [len(looks) for looks in bars.looks] == [2, 3]
    assert bars.turned == [0, 1, 0, 1, 2]
    assert [look.number for look in told] == [number for *_, number in begun] == [5, 6, 7, 8, 9]
    for look, (x, known, _) in zip(told, begun, strict=True):
        np.testing.assert_array_equal(look.x, x)
        assert look.best is known or look.best == known
        assert look.options is search.options
    same = implicit.Restarts(np.ones(2, dtype=bool), 4)
    again = [search.place(same, best) for _ in range(5)]
    np.testing.assert_array_equal(again, [x for x, *_ in begun])
    assert known.phi == best.phi


def test_restarts_begin_within_the_bounds():
    search, _, _ = searching(off=0.05, lower=0.55, upper=0.95)
    best = search.evaluator.evaluate(np.log([0.6, 0.9]))
    restarts = implicit.Restarts(np.ones(2, dtype=bool), 1)
    x = np.array([search.place(restarts, best) for _ in range(40)])
    assert np.all((x >= np.log(0.55)) & (x <= np.log(0.95)))
    assert np.any(x == np.log(0.95))


def lower(point, factor):
    scaled = Linearization(factor * point.model.residual, factor * point.model.jacobian)
    return Ending(replace(point, model=scaled), "converged", "")


@pytest.mark.parametrize(
    ("restarts", "patience", "asked"),
    [(9, 4, [4]), (3, 4, [3]), (0, 4, []), (9, 12, [9])],
)
def test_no_more_restarts_are_told_ahead_than_may_be_made(restarts, patience, asked):
    search, _, _ = searching(off=0.05, restarts=restarts)
    start = points(search, 1.0)[0]
    seen = []

    def restarted(drawn, best, most):
        seen.append(most)
        yield from [None] * most

    search.descents = [SimpleNamespace(run=lambda start, stuck: Ending(start, "", ""))] * 2
    search.restarted = restarted
    search.patience = lambda best: patience
    search.improve(start)
    assert seen == asked


def test_what_moves_no_plane_is_not_weakened():
    """Of three parameters the second moves nothing; the third has no lower bound to go to."""
    frames = [Frame([1.0, 1.5], [0, None], [2.0]), Frame([2.0, 0.5], [2, None], [1.7])]
    bars = Watched(frames, 3)
    parameters = tuple(
        Parameter(f"k{i + 1}", x, low, 20.0)
        for i, (x, low) in enumerate(((0.9, 0.3), (1.1, 0.1), (1.3, -np.inf)))
    )
    problem = Problem(bars, np.array([1.0, 0.9]), np.full(2, 1e-3), parameters)
    search = ImplicitSearch(problem, ComplementarityOptions(), lambda entry: None)
    point = search.evaluator.evaluate(search.scaling.to_scaled(np.array([0.5, 0.7, 0.8])))
    weak = search.scaling.to_natural(search.weakened(point))
    assert weak == pytest.approx([0.6, 0.7, 1.3])


def test_enough_is_what_is_spent_or_met_or_fruitless():
    search, _, _ = searching(off=0.05)
    best = Ending(points(search, 1.0)[0], "", "")
    search.patience = lambda best: 4
    assert [search.enough(best, fruitless) for fruitless in (0, 3, 4, 5)] == [
        False,
        False,
        True,
        True,
    ]
    search.exact = best.point.phi
    assert search.enough(best, 0)
    search.exact = 0.999 * best.point.phi
    assert not search.enough(best, 0)
    search.spent = lambda: True
    assert search.enough(best, 0)


def test_a_lower_point_is_gone_on_from_at_once_and_a_better_one_counts_anew():
    search, _, _ = searching(off=0.05, restarts=20)
    start = points(search, 1.0)[0]
    seen = []
    batches = iter([[None, lower(start, 0.9), None], [None, lower(start, 0.89999)], [None] * 9])

    def restarted(drawn, best, most):
        seen.append((best.phi / start.phi, most))
        yield from next(batches)[:most]

    search.descents = [SimpleNamespace(run=lambda start, stuck: Ending(start, "", ""))] * 2
    search.restarted = restarted
    search.patience = lambda best: 5
    end = search.improve(start)
    # the second is 0.002 % lower only: kept, as the third fruitless one
    assert [most for _, most in seen] == [5, 5, 3]
    assert [phi for phi, _ in seen] == pytest.approx([1.0, 0.81, 0.89999**2])
    assert end.point.phi == pytest.approx(0.89999**2 * start.phi)


# Endings


def proof(kind, *remarks):
    return SimpleNamespace(kind=kind, remarks=remarks)


def test_every_ending_has_its_words():
    search, _, _ = searching(max_evaluations=50)
    best = Ending(points(search, 1.0)[0], "converged", "Done.")
    assert search.ending(best, proof("global", "Met.")) == ("converged", "Met.")
    status, reason = search.ending(best, proof("not stationary"))
    assert status == "not-converged"
    assert reason.startswith("The search ended at a kink of the response near which points are")
    left = replace(best, abandoned=True)
    status, reason = search.ending(left, proof("strongly stationary"))
    assert status == "converged"
    assert reason.startswith("The search ended at a kink of the response, where points begin")
    assert search.ending(best, proof("strongly stationary")) == ("converged", "Done.")
    search.spent = lambda: True
    assert search.ending(best, proof("global", "Met.")) == ("converged", "Met.")
    status, reason = search.ending(best, proof("strongly stationary"))
    assert (status, reason[:57]) == (
        "not-converged",
        "The search was not finished in 50 evaluations: raise max_",
    )


def test_the_outcome_has_the_certificate_of_its_point():
    search, notes, _ = searching(off=0.1)
    point = search.evaluator.evaluate(np.log([0.6, 0.9]))
    search.remarks = ["One.", "Two."]
    checked = StationarityCheck(point, 0.2, 4, None)
    found = search.outcome(Ending(point, "converged", "Done."), checked)
    assert (found.objective, found.values.tolist()) == (point.phi, point.p.tolist())
    assert found.remarks == ("One.", "Two.")
    assert (found.certificate.kind, found.certificate.gradient) == (
        "stationary on the active pieces",
        0.2,
    )
    # both strengths are reached; raised to their bound the readings exclude each of them
    assert found.certificate.open_above == ()
    assert [entry.note for entry in notes] == ["from above"] * 2
    search.exact = 1e9
    met = search.outcome(Ending(point, "converged", "Done."), checked)
    assert met.certificate.kind == "global"
    assert len(notes) == 2


def test_strengths_that_the_readings_do_not_hold_from_above_are_named():
    """With accuracies of 1 nothing excludes anything; an unreached one is not asked for."""
    search, notes, _ = searching()
    loose = replace(search.problem, sd=np.full(3, 1.0))
    search = ImplicitSearch(loose, ComplementarityOptions(), notes.append)
    point = search.evaluator.evaluate(np.log([0.5, 3.0]))
    assert point.unreached.tolist() == [False, True]
    assert search.open_above(point) == ["k1"]
    both = search.evaluator.evaluate(np.log([0.5, 0.8]))
    assert search.open_above(both) == ["k1", "k2"]
    search.spent = lambda: True
    assert search.open_above(both) == []


def test_sides_are_looked_at_with_the_tolerance_and_the_budget_of_the_search(monkeypatch):
    search, _, _ = searching(tolerance=1e-5)
    point = points(search, 1.0)[0]
    seen = []
    monkeypatch.setattr(implicit, "check", lambda *given, **named: seen.append((given, named)))
    search.check(Ending(point, "", ""))
    search.exact = point.phi
    search.check(Ending(point, "", ""))
    assert [given for given, _ in seen] == [(search.evaluator, point)] * 2
    assert [named["exact"] for _, named in seen] == [False, True]
    assert [named["least"] for _, named in seen] == [1e-5] * 2
    assert seen[0][1]["spent"] == search.spent


def test_the_end_of_another_search_is_judged_by_the_same_rules():
    search, _, bars = searching()
    exact = certificate_at(search.problem, np.array([0.5, 0.8]), quiet(bars))
    assert (exact.kind, exact.bound) == ("global", 0.0)
    seen = []
    history = History("test", bars, lambda entry: seen.append(entry.note))
    off = certificate_at(search.problem, np.array([0.6, 0.9]), history)
    assert off.kind == "not stationary"
    assert set(seen) == {"probe"}
    assert len(seen) == 6
    stopped = History("test", bars, lambda entry: "Enough.")
    certificate_at(search.problem, np.array([0.6, 0.9]), stopped)
    assert len(stopped.iterations) == 1


def quiet(bars):
    return History("test", bars, lambda entry: None)


def test_a_stop_of_the_observer_spends_the_search():
    search, _, _ = searching()
    assert not search.spent()
    search.history.stop = "Enough."
    assert search.spent()


def test_a_rising_plane_goes_as_far_as_its_bound():
    """Half of itself in each step; planes that are reached take the step itself."""
    search, _, _ = searching(upper=3.3)
    point = search.evaluator.evaluate(np.log([0.6, 2.6]))
    assert point.unreached.tolist() == [False, True]
    rising, waiting = (descent.propose(point, 0.2) for descent in search.descents)
    assert rising.d[0] == waiting.d[0] != 0.0
    assert rising.d[1] == pytest.approx(min(0.5, np.log(3.3) - point.x[1]))
    assert waiting.d[1] == 0.0
    assert rising.gain == waiting.gain
    near = search.evaluator.evaluate(np.log([0.6, 0.9]))
    one, other = (descent.propose(near, 0.2) for descent in search.descents)
    np.testing.assert_array_equal(one.d, other.d)
