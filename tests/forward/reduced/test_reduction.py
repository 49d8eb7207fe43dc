"""Which marches count, how many columns they leave, where adjoints are: counted by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.reduced import gauged, plane, released, settling, solid
from support.sums import Sum

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.forward.reduced import reduction as under_test
from geoident.forward.reduced.reduction import Reduction, _apart
from geoident.forward.reduced.snapshots import Snapshot


def _reduction(staged, **options):
    states = len(staged.march.sequence.states)
    return Reduction(staged.march, staged.observation, states - 1, **options)


def _snapshot(p, last):
    return Snapshot(np.array(p), np.zeros((1, 1)), {}, motion=[np.zeros((0, 1))] * (1 + last))


def test_the_newest_marches_are_kept_and_each_once():
    made = _reduction(plane(n=4), most=3)
    last = made.last
    assert (last, made.most, made.economical) == (4, 3, True)
    for p in ([1.0], [2.0], [1.0], [3.0]):
        made.add(_snapshot(p, last))
    made.add(_snapshot([9.0], last - 1))  # a march that ended early
    assert [s.p[0] for s in made.snapshots] == [1.0, 2.0, 3.0]
    made.add(_snapshot([4.0], last + 1))
    assert [s.p[0] for s in made.snapshots] == [2.0, 3.0, 4.0]
    assert made.knows(np.array([3.0]))
    assert not made.knows(np.array([1.0]))
    made.order([np.array([4.0]), np.array([7.0]), np.array([2.0])])
    assert [s.p[0] for s in made.snapshots] == [4.0, 2.0]
    assert Reduction(plane(n=4).march, made._observation, 4).most == 4


@pytest.mark.parametrize(("build", "last", "settled"), [(plane, 3, 0), (settling, 4, 4 * 4)])
def test_what_a_march_leaves_is_counted(build, last, settled):
    """Motions, what is seen of them, and the strain of what settled: 12 x 12 cells."""
    staged = build()
    made = Reduction(staged.march, staged.observation, last, economical=False)
    assert made.covers()
    unknowns, seen = 2 * 13 * 13, 4
    whole = last * unknowns + (last + 1) * seen + settled * 144
    for columns in (1, 6):
        assert made._entries(made._affine, columns) == whole * columns


@pytest.mark.parametrize(
    ("columns", "second", "most"),
    [(5.9, None, None), (6.1, False, 1), (11.9, False, 1), (12.1, False, 2), (23.9, False, 3),
     (24.1, True, 1), (59.9, True, 1), (60.1, True, 2), (90.1, True, 3), (500.0, True, 4)],
)  # fmt: skip
def test_how_many_marches_and_columns_fit_into_the_memory(columns, second, most, monkeypatch):
    """Six columns each without second derivatives, 30 with them; these from 24 on."""
    staged = plane()
    one = 4 * 2 * 13 * 13 + 5 * 4
    monkeypatch.setattr(under_test, "MOST_ENTRIES", int(columns * one))
    made = _reduction(staged, economical=False)
    assert made.covers() == (second is not None)
    if second is None:
        assert made.obstacle == "what a march leaves for it does not fit into the memory"
    else:
        assert (made._second, made.most) == (second, most)


def test_a_part_of_stress_that_is_out_of_balance_cannot_be_held():
    staged = released()
    made = _reduction(staged, economical=False)
    assert made.covers()
    case = replace(staged.case, gravity=(0.0, -9.81))
    heavy = staged_model(staged.on_mesh.mesh, case, solver=pick_solver("auto"))
    made = _reduction(heavy, economical=False)
    assert not made.covers()
    assert made.obstacle == (
        "stress is released in part that is not the one in situ: that is out of balance"
    )


@pytest.mark.parametrize(("n", "saves"), [(0.99, False), (1.01, True)])
def test_what_a_reduced_model_costs_and_saves_is_counted(n, saves, monkeypatch):
    """60 n^1.5 of a factorization and 150 of every strain and column, against the projection.

    The projection factorizes, of every zone, rows times the square of its columns twice: three
    times one column and one for every parameter, for each matrix of what its stress is made of and
    one more.
    """
    staged = plane()
    made = _reduction(staged)
    affine = under_test.affine_march(
        staged.march, under_test.zones_of(staged.on_mesh), made.last, staged.observation
    )
    points = staged.discretization.points
    columns = 1 + 5
    ranks = {"rock": 2, "young": 1, "shotcrete": 1}
    marching = projecting = 0.0
    for state in range(1, made.last + 1):
        free = staged.march.systems[state].pattern.lower.n
        marching += 60.0 * free**1.5 + 150.0 * columns * 4 * points.n_points
        for zone in affine.zones[state]:
            segments = zone.history.segments
            terms = {(s.end, s.material) for s in segments}
            terms |= {(s.start, s.material) for s in segments if s.start is not None}
            blocks = 1 + sum(ranks[m] for _, m in terms)
            projecting += 2.0 * 4 * len(zone.points) * (3 * columns * blocks) ** 2
    monkeypatch.setattr(under_test, "PROJECTED", marching / projecting / n)
    assert made._dear(affine.zones, ranks) != saves


def test_in_space_a_factorization_costs_the_square_of_the_unknowns(monkeypatch):
    staged = solid(n=2)
    made = _reduction(staged)
    affine = under_test.affine_march(
        staged.march, under_test.zones_of(staged.on_mesh), made.last, staged.observation
    )
    points, columns = staged.discretization.points, 1 + 4
    marching = projecting = 0.0
    for state in range(1, made.last + 1):
        free = staged.march.systems[state].pattern.lower.n
        marching += 20.0 * free**2 + 150.0 * columns * 6 * points.n_points
        for zone in affine.zones[state]:
            terms = {(state, zone.material)} | {(o, m) for o, m, _ in zone.parts if o}
            blocks = 1 + len(terms)
            projecting += 2.0 * 6 * len(zone.points) * (3 * columns * blocks) ** 2
    for part, saves in ((1.0001, False), (0.9999, True)):
        monkeypatch.setattr(under_test, "PROJECTED", part * marching / projecting)
        ranks = {name: span.rank for name, span in affine.form.spans.items()}
        assert made._dear(affine.zones, ranks) != saves


@pytest.mark.parametrize(("part", "looks"), [(0.9, 1), (1.1, 0)])
def test_moduli_are_not_looked_at_where_zones_of_one_matrix_cost_more(part, looks, monkeypatch):
    """Each zone is of one matrix at least; what its stress is made of is more."""
    looked, look = [], under_test.affine_march
    monkeypatch.setattr(under_test, "affine_march", lambda *given: looked.append(1) or look(*given))
    staged = plane(n=4)
    made = _reduction(staged)
    marching = projecting = 0.0
    for state in range(1, made.last + 1):
        free = staged.march.systems[state].pattern.lower.n
        marching += 60.0 * free**1.5 + 150.0 * 6 * 4 * staged.discretization.points.n_points
        present = sum(len(zone.points) for zone in under_test.zones_of(staged.on_mesh)[state])
        projecting += 2.0 * 4 * present * (3 * 6) ** 2
    monkeypatch.setattr(under_test, "PROJECTED", part * marching / projecting)
    assert not made.covers()
    assert made.obstacle == under_test.DEAR
    assert len(looked) == looks


def test_the_first_marches_of_a_search_leave_more(monkeypatch):
    """24 further columns of the first, 12 of the second, none of later ones."""
    asked = []
    monkeypatch.setattr(
        under_test, "Recorder", lambda affine, observation, p, *, further: asked.append(further)
    )
    for economical, expected in ((True, [24, 12, 0, 0]), (False, [12, 12, 12, 12])):
        made = _reduction(plane(), economical=economical)
        made.obstacle, made._affine, made._second = None, object(), True
        for number in range(4):
            made.number = number
            made.recorder(np.ones(5))
        assert asked == expected
        asked.clear()
        made.number = None
        for count in (0, 1, 2):
            made.snapshots = [object()] * count
            made.recorder(np.ones(5))
        assert asked == expected[:3]
        made._second = False
        made.recorder(np.ones(5))
        assert asked[-1] == 0
        asked.clear()
        made.obstacle = "of something"
        assert made.recorder(np.ones(5)) is None
        assert not asked


def _span(scale):
    basis = np.diag([1.0, 2.0, 3.0, 4.0])[None]
    return Sum(basis, np.zeros(1), np.array([scale]))


def _turned(scales):
    """Moduli diag(p_0^2, p_1^2, ..) times scales."""
    basis = np.stack([np.diag([1.0, 1.0, 0.0, 0.0]), np.diag([0.0, 0.0, 1.0, 1.0])])
    return Sum(basis, np.zeros(2), np.diag(scales))


def test_how_far_moduli_are_apart_with_a_factor_that_all_have_in_common():
    """Ratios of 4 and 1: with the factor 2/5 they are 0.6 / sqrt(1.6) and 0.6 / sqrt(0.4) apart."""
    spans = {"a": _turned([3.0, 5.0])}
    one, other = np.array([2.0, 1.0]), np.array([1.0, 1.0])
    assert _apart(spans, one, other) == pytest.approx(0.6 / np.sqrt(0.4))
    assert _apart(spans, 3.0 * one, other) == pytest.approx(0.6 / np.sqrt(0.4))
    assert _apart(spans, other, one) == pytest.approx(0.6 / np.sqrt(0.4))
    assert _apart(spans, one, one) == pytest.approx(0.0, abs=1e-14)
    alone = {"b": _span([1.0, 0.0])}
    assert _apart(alone, one, other) == pytest.approx(0.0, abs=1e-14)
    lasting = Sum(np.eye(4)[None], np.ones(1), np.zeros((1, 2)), np.ones(1))
    both = {**alone, "c": lasting}
    assert _apart(both, one, other) == pytest.approx(0.6 / np.sqrt(0.4))


def _model(spans, reference):
    return SimpleNamespace(reference=np.array(reference), form=SimpleNamespace(spans=spans))


def test_adjoints_are_known_at_the_reference_and_at_the_farthest_places():
    made = _reduction(plane(n=4))
    spans = {"a": _turned([1.0, 1.0])}
    ratio = np.sqrt([1.0, 1.5, 3.0, 40.0, 900.0])
    made.snapshots = [SimpleNamespace(p=np.array([x, 1.0])) for x in ratio]
    found = made.dual_places(_model(spans, [1.0, 1.0]))
    np.testing.assert_allclose(found, [[1.0, 1.0], [30.0, 1.0], [np.sqrt(40.0), 1.0]])
    assert under_test.MOST_PLACES == 3
    made.snapshots = made.snapshots[:2]
    np.testing.assert_array_equal(made.dual_places(_model(spans, [1.0, 1.0])), [[1.0, 1.0]])


@pytest.mark.parametrize(("apart", "count"), [(0.499, 1), (0.501, 2)])
def test_how_far_another_place_of_adjoints_is(apart, count):
    """With a ratio mu the distance is (mu - 1) / (mu + 1) / sqrt(2 / (1 + mu))."""
    made = _reduction(plane(n=4))
    spans = {"a": _turned([1.0, 1.0])}
    low, high = 1.0, 100.0
    for _ in range(200):
        mu = 0.5 * (low + high)
        far = (mu - 1.0) / (mu + 1.0) / np.sqrt(2.0 / (1.0 + mu))
        low, high = (mu, high) if far < apart else (low, mu)
    made.snapshots = [SimpleNamespace(p=np.array([np.sqrt(low), 1.0]))]
    assert len(made.dual_places(_model(spans, [1.0, 1.0]))) == count


def test_adjoints_are_differentiated_by_what_moves_moduli():
    made = _reduction(plane(n=4))
    still = Sum(np.eye(4)[None], np.ones(1), np.zeros((1, 8)), np.ones(1))
    by = np.zeros((2, 8))
    by[0, [1, 3]] = 1.0
    by[1, [2, 3, 4, 6, 7]] = 0.5
    basis = np.stack([np.diag([1.0, 1.0, 0.0, 0.0]), np.diag([0.0, 0.0, 1.0, 1.0])])
    model = _model({"a": Sum(basis, np.ones(2), by), "b": still}, np.ones(8))
    far = np.ones(8)
    far[1] = 2.0
    made.snapshots = [SimpleNamespace(p=np.ones(8)), SimpleNamespace(p=far)]
    assert made.dual_derivatives(model) == [1, 2, 3, 4, 6, 7]
    assert under_test.MOST_DERIVATIVES == 6
    by[1, 5] = 1.0
    assert made.dual_derivatives(model) == [1, 2, 3, 4, 5, 6]
    made.snapshots = made.snapshots[:1]
    assert made.dual_derivatives(model) == []


@pytest.mark.parametrize(("apart", "some"), [(0.0098, False), (0.0102, True)])
def test_moduli_that_are_nearly_the_same_need_no_derivatives(apart, some):
    """Near to one the distance is half of what the ratio differs by."""
    made = _reduction(plane(n=4))
    p = np.array([np.sqrt(1.0 + 2.0 * apart), 1.0])
    made.snapshots = [SimpleNamespace(p=p)]
    found = made.dual_derivatives(_model({"a": _turned([1.0, 1.0])}, [1.0, 1.0]))
    assert found == ([0, 1] if some else [])


def test_readings_of_motions_and_of_stresses_are_taken_back_apart():
    """Rows of channels, weights of states, and the weights of stresses at points."""
    staged = gauged()
    made = _reduction(staged, economical=False)
    assert made.covers()
    names = list(staged.observation.channels)
    rows = np.array([names.index(name) for name in ("xx", "side", "strut", "roof")])
    weights = np.arange(20.0).reshape(5, 4)
    moved, pressed = made.reads(rows, weights)
    assert moved.readings.tolist() == [1, 3]
    assert pressed.readings.tolist() == [0, 2]
    np.testing.assert_array_equal(moved.weights, weights[:, [1, 3]])
    np.testing.assert_array_equal(pressed.weights, weights[:, [0, 2]])
    exact = staged.observation.operator(rows[[1, 3]])
    np.testing.assert_array_equal(moved.rows.toarray(), exact.toarray())
    assert moved.stresses is None
    assert pressed.rows.shape == (2, staged.discretization.n_dofs)
    assert pressed.rows.nnz == 0
    stresses = made._affine.rows
    places = [stresses.channels.tolist().index(rows[k]) for k in (0, 2)]
    np.testing.assert_array_equal(pressed.stresses, stresses.weights[places])
    (only,) = made.reads(rows[[1]], weights[:, [1]])
    assert only.readings.tolist() == [0]
    (alone,) = made.reads(rows[[2]], weights[:, [2]])
    assert alone.stresses is not None
    (none,) = made.reads(rows[:0], weights[:, :0])
    assert (none.readings.size, none.stresses) == (0, None)
