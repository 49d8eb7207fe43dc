"""What a march records beside itself: which columns, and that each is in equilibrium."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import material
from support.reduced import PAIRS_GAUGED, PAIRS_PLANE, gauged, plane, settling, spread

from geoident.forward.reduced.recorder import MOST_FURTHER, MOST_SECOND, ORDERS, Recorder
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar


def chained(**changes):
    """The plane case with one modulus that no other goes with, and two loads that are sought."""
    materials = {
        "rock": material("rock", Scalar(1.0, "E"), 0.25, 2500.0),
        "young": material("young", 3e9, 0.2, 2500.0),
        "shotcrete": material("shotcrete", 1e10, 0.2, 2500.0),
    }
    parameters = (
        Parameter("E", 8e9, 2e9, 3e10, "log"),
        Parameter("sv", 5e6, 2e6, 1e7),
        Parameter("sh", 4e6, 2e6, 1e7),
    )
    in_situ = ConstantStress(
        (Scalar(-1.0, "sh"), Scalar(-1.0, "sv"), Scalar(-0.4, "sh"), *(Scalar(0.0),) * 3)
    )
    return plane(**{"materials": materials, "parameters": parameters, "in_situ": in_situ,
                    **changes})  # fmt: skip


def _recorder(moduli, slopes, exponents, psi, scale, *, settles=False, volumes=()):
    """A recorder of which only what it chooses columns by is there."""
    made = Recorder.__new__(Recorder)
    made._moduli = {m: np.array(c, dtype=float) for m, c in moduli.items()}
    made._slopes = {m: np.array(dc, dtype=float) for m, dc in slopes.items()}
    made._psi = np.array(psi, dtype=float)
    made._scale = np.array([1.0, *scale])
    made._loads = SimpleNamespace(
        scale=np.array(scale), exponents=np.array(exponents), settles=settles
    )
    made._spans = {
        m: SimpleNamespace(matrix=lambda c: np.diag([c[0], 2.0 * c[0], 5.0 * c[0]]))
        if len(c) == 1
        else SimpleNamespace(matrix=lambda c: np.diag([c[0], c[1], c[1]]))
        for m, c in moduli.items()
    }
    made._points = SimpleNamespace(volume=np.array([v for _, v in volumes]))
    made._zones = [
        (), tuple(SimpleNamespace(points=np.array([n]), material=m) for n, (m, _) in
                  enumerate(volumes)),
    ]  # fmt: skip
    return made


TWO = ({"a": [2.0, 3.0], "b": [5.0]}, {"a": [[1.0, 0, 0, 0], [0.5, 0, 0, 0]],
                                      "b": [[0, 4.0, 0, 0]]})  # fmt: skip
LOADS = [[0, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
PSI = [[7.0, 0, 0, 7.0, 0], [3.0, 0, 0, 0, 3.0]]


def test_second_derivatives_by_pairs_of_parameters():
    """The first two move moduli; the others loads. Each pair once, the first of it moving."""
    found = _recorder(*TWO, LOADS, PSI, [2.0, 3.0, 5.0, 7.0]).further_columns(MOST_SECOND)
    pairs = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3)]
    assert found == [((h, 1 + k, 0.0), (k, 1 + h, 0.0)) for h, k in pairs]
    fewer = _recorder(*TWO, LOADS, PSI, [2.0, 3.0, 5.0, 7.0]).further_columns(3)
    assert fewer == found[:3]
    more = _recorder(*TWO, LOADS, PSI, [2.0, 3.0, 5.0, 7.0]).further_columns(MOST_FURTHER)
    assert more == found


def test_no_more_second_derivatives_than_are_kept():
    n = 8
    slopes = np.diag(np.arange(1.0, n + 1))
    made = _recorder({"a": np.ones(n)}, {"a": slopes}, np.zeros((1, n), int),
                     np.ones((1, 1 + n)), np.ones(n))  # fmt: skip
    assert len(made.further_columns(MOST_FURTHER)) == MOST_SECOND == 12
    assert len(made.further_columns(5)) == 5


def test_parameters_of_loads_and_common_factors_take_no_part():
    """One by which all moduli grow alike needs none; nor has one that moves loads, too."""
    alike = {"a": [[2.0, 0.5], [3.0, 0.0]], "b": [[5.0, 0.0]]}
    moduli = {"a": [2.0, 3.0], "b": [5.0]}
    made = _recorder(moduli, alike, [[0, 0]], np.ones((1, 3)), [2.0, 3.0])
    assert made.further_columns(MOST_SECOND) == [
        ((1, 1, 0.0), (0, 2, 0.0)), ((1, 2, 0.0), (1, 2, 0.0)),
    ]  # fmt: skip
    loaded = _recorder(moduli, alike, [[0, 0], [0, 1]], np.ones((1, 3)), [2.0, 3.0])
    assert loaded.further_columns(MOST_SECOND) == []
    settles = _recorder(*TWO, LOADS, PSI, np.ones(4), settles=True)
    assert settles.further_columns(MOST_SECOND) == []


@pytest.mark.parametrize(("part", "alike"), [(0.5e-9, True), (2e-9, False)])
def test_how_far_moduli_may_be_from_growing_alike(part, alike):
    """Relative to the largest that grows."""
    slopes = {"a": [[2.0, 0.0], [-3.0 * (1 + part), 0.0]], "b": [[40.0, 0.0]]}
    slopes["a"][1][0] = 3.0 * (1.0 - part * 40.0 / 3.0)
    made = _recorder({"a": [2.0, 3.0], "b": [40.0]}, slopes, [[0, 0]], np.ones((1, 3)), [1.0, 1.0])
    assert made._grow_alike(0) == alike
    down = {m: -np.array(s) for m, s in slopes.items()}
    made = _recorder({"a": [2.0, 3.0], "b": [40.0]}, down, [[0, 0]], np.ones((1, 3)), [1.0, 1.0])
    assert made._grow_alike(0) == alike


ONE = ({"a": [2.0, 8.0], "b": [5.0]}, {"a": [[6.0, 0, 0], [1.0, 0, 0]], "b": [[0, 0, 0]]})
ONLY = [[0, 0, 0], [0, 1, 0], [0, 0, 1]]
SEEN = [[7.0, 0.0, 7.0, 0.0], [3.0, 0.0, 0.0, 3.0]]
GROUND = (("b", 1.0), ("a", 2.0), ("b", 1.5), ("a", 0.25))


def test_one_modulus_alone_acts_on_each_load_again_and_again():
    """Two loads: columns in twos, each of the two before; shifted to the middle of its ratios."""
    made = _recorder(*ONE, ONLY, SEEN, [0.5, 4.0, 5.0], volumes=GROUND)
    found = made.further_columns(MOST_FURTHER)
    # most ground is of b, which does not move with it: no shift
    assert found == [((0, 2 + n, 0.0),) for n in range(2 * ORDERS)]
    heavy = _recorder(*ONE, ONLY, SEEN, [0.5, 4.0, 5.0], volumes=(*GROUND, ("a", 0.5)))
    shift = 0.5 * (0.5 * 6.0 / 2.0 + 0.5 * 1.0 / 8.0)
    assert heavy.further_columns(MOST_FURTHER) == [
        ((0, 2 + n, pytest.approx(shift)),) for n in range(2 * ORDERS)
    ]
    assert ORDERS == 8
    assert len(heavy.further_columns(13)) == 12
    assert len(heavy.further_columns(14)) == 14
    assert heavy.further_columns(MOST_SECOND) == [
        ((0, 1, 0.0), (0, 1, 0.0)), ((0, 2, 0.0), (1, 1, 0.0)), ((0, 3, 0.0), (2, 1, 0.0)),
    ]  # fmt: skip


def test_chains_start_from_loads_that_make_all_others():
    """Where loads move by themselves only; each is its own sum of the parameters."""
    scale = [0.5, 4.0, 5.0]

    def loading(psi, free=(1, 2), exponents=ONLY):
        return _recorder(*ONE, exponents, psi, scale, volumes=GROUND)._loading(free)

    assert loading(SEEN) == [2, 3]
    assert loading([[7.0, 0, 7.0, 2.0], [3.0, 0, 1.0, 3.0]]) == [2, 3]
    assert loading([[7.0, 0, 7.0, 0.0]]) == [2]  # the last one moves nothing
    assert loading([[7.0, 0, 0, 7.0]]) == [3]
    assert loading([[7.0, 0, 7.0, 7.0]]) == []  # two of one
    assert loading([[7.0, 0, 7.0, 0], [3.0, 0, 0, 0]]) == []  # one load stays as it is
    assert loading([[7.0, 0, 7.0, 0], [0.0, 0, 0, 0]]) == [2]  # one that is none
    assert loading([[0.0, 0, 0, 0]]) == []
    assert loading(SEEN, free=()) == []
    assert loading([[7e6, 0, 7e6, 0.0], [3.0, 0.0, 0.0, 3.0]]) == [2, 3]


@pytest.mark.parametrize(("apart", "whole"), [(2e-10, False), (1e-8, True)])
def test_loads_that_are_nearly_one(apart, whole):
    psi = [[1.0, 0.0, 1.0, 1.0], [1.0, 0.0, 1.0, 1.0 + apart]]
    made = _recorder(*ONE, ONLY, psi, [1.0, 1.0, 1.0], volumes=GROUND)
    assert made._loading((1, 2)) == ([2, 3] if whole else [])


def test_without_a_chain_of_loads_second_derivatives_are_taken():
    three = [[7.0, 0, 7.0, 0], [3.0, 0, 0, 0]]
    found = _recorder(*ONE, ONLY, three, np.ones(3), volumes=GROUND).further_columns(MOST_FURTHER)
    assert found == [((0, 1 + k, 0.0), (k, 1, 0.0)) for k in range(3)]


def _marched(build, pairs):
    """A case and what is kept of one march, where `_start` is."""
    staged = build()
    response = staged.response(pairs)
    response.keep_marches(economical=False)
    response.evaluate(_start(staged))
    return staged, response.reduction


def _start(staged):
    return spread(staged, 1, seed=5, part=0.4)[0]


@pytest.mark.parametrize(
    ("build", "pairs"),
    [(chained, PAIRS_PLANE), (settling, PAIRS_PLANE), (gauged, PAIRS_GAUGED)],
)
def test_every_recorded_column_is_in_equilibrium_with_its_loads(build, pairs):
    """Stresses of a column balance the in-situ stress and forces of its psi, where it can move."""
    staged, reduction = _marched(build, pairs)
    assert reduction.model() is not None
    projection, march = reduction.projection, staged.march
    points, form = projection.affine.points, projection.affine.form.loads
    psi = np.hstack([s.psi for s in reduction.snapshots])
    for number in range(1, reduction.last + 1):
        system = march.systems[number]
        stress = np.zeros((points.n_strain, points.n_points, psi.shape[1]))
        for zone in projection.affine.zones[number]:
            stress[:, zone.points] = projection.stresses(zone, zone.points)
            if zone.history.given:
                stress[:, zone.points] += form.stress[:, zone.points] @ psi
        jacked = projection.affine.jacked(number)
        stress[:, jacked] = form.stress[:, jacked] @ psi
        inner, outer = points.forces(stress, system), form.forces[number] @ psi
        dofs = system.pattern.dofs
        scale = np.abs(inner).max(axis=0) + np.abs(outer).max(axis=0)
        part = np.abs(inner - outer)[dofs].max(axis=0)
        assert np.all(part < 1e-7 * np.maximum(scale, 1e-6 * scale.max())), number


@pytest.mark.parametrize(("build", "pairs"), [(plane, PAIRS_PLANE), (gauged, PAIRS_GAUGED)])
def test_what_is_recorded_are_states_and_derivatives_in_the_sizes_of_parameters(build, pairs):
    staged, reduction = _marched(build, pairs)
    snapshot = reduction.snapshots[0]
    p, n = snapshot.p, len(staged.names)
    np.testing.assert_array_equal(p, _start(staged))
    scale = reduction._affine.form.loads.scale
    run = staged.at(p)
    for end in run.states():
        if end.state == 0:
            assert snapshot.motion[0].shape == (0, snapshot.columns)
            assert not snapshot.observed[0].any()
            continue
        if end.state > reduction.last:
            break
        u = end.u.copy()
        u[:, 1:] *= scale
        found = snapshot.motion[end.state][:, : 1 + n]
        np.testing.assert_allclose(found, u, atol=1e-9 * np.abs(u).max())
        seen = np.full((len(staged.observation.channels), snapshot.columns), np.nan)
        for mine, observable in staged.observation.parts:
            if observable.rows is not None:
                seen[mine] = observable.rows @ snapshot.motion[end.state]
        np.testing.assert_allclose(snapshot.observed[end.state], seen, rtol=1e-12)
    assert snapshot.columns > 1 + n
    assert not snapshot.psi[:, 1 + n :].any()
    at = reduction._affine.form.at(p[None])
    np.testing.assert_allclose(snapshot.psi[:, 0], at.loads[0], rtol=1e-12)
    np.testing.assert_allclose(snapshot.psi[:, 1 : 1 + n], at.load_slopes[0] * scale, rtol=1e-12)
