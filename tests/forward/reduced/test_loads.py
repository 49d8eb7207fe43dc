"""Loads as sums of few, and stresses of marches as sums of strains: written out."""

from __future__ import annotations

import numpy as np
import pytest
from support.reduced import braced, plane, released, settling, spread

from geoident.forward.reduced.loads import LoadForm, _forms, load_form, monomials
from geoident.forward.reduced.points import MarchPoints
from geoident.forward.reduced.snapshots import Snapshot, settling_strain, stress_turns
from geoident.model.dual import ParameterPoint


def test_coordinates_of_loads_and_their_derivatives():
    """psi of (1, x, x^2 y, y^3 z) with x = p / scale, by hand."""
    scale = np.array([2.0, 5.0, 0.5])
    exponents = np.array([[0, 0, 0], [1, 0, 0], [2, 1, 0], [0, 3, 1]])
    mix = np.array([[1.0, 2.0, -3.0, 0.5], [4.0, 0.0, 1.0, -2.0]])
    form = LoadForm(scale, exponents, mix, np.zeros((4, 0, 2)), (), False)
    values = np.array([[3.0, 4.0, 0.7], [-1.0, 7.0, 0.2]])
    x, y, z = (values / scale).T
    psi, slopes = form.coordinates(values)
    terms = np.stack([np.ones(2), x, x**2 * y, y**3 * z])
    np.testing.assert_allclose(monomials(values / scale, exponents), terms.T, rtol=1e-14)
    np.testing.assert_allclose(psi, (mix @ terms).T, rtol=1e-13)
    nothing = np.zeros(2)
    by = [
        np.stack([nothing, np.ones(2), 2 * x * y, nothing]) / 2.0,
        np.stack([nothing, nothing, x**2, 3 * y**2 * z]) / 5.0,
        np.stack([nothing, nothing, nothing, y**3]) / 0.5,
    ]
    assert slopes.shape == (2, 2, 3)
    for h in range(3):
        np.testing.assert_allclose(slopes[:, :, h], (mix @ by[h]).T, rtol=1e-13)


def test_forms_go_from_sums_to_products_of_three():
    """Of the first, third and fourth parameter."""
    found = [form.tolist() for form in _forms(np.array([True, False, True, True]))]
    linear = [[0, 0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    pairs = [[1, 0, 1, 0], [1, 0, 0, 1], [0, 0, 1, 1]]
    squares = [[2, 0, 0, 0], [0, 0, 2, 0], [0, 0, 0, 2]]
    assert found == [
        linear, linear + pairs, linear + pairs + squares,
        linear + pairs + squares + [[1, 0, 1, 1]],
    ]  # fmt: skip
    one = [form.tolist() for form in _forms(np.array([False, True]))]
    assert one == [[[0, 0], [0, 1]], [[0, 0], [0, 1], [0, 2]]]
    two = [len(form) for form in _forms(np.array([True, True]))]
    assert two == [3, 4, 6]
    assert [form.tolist() for form in _forms(np.zeros(2, dtype=bool))] == [[[0, 0]]]


@pytest.mark.parametrize(("build", "rank"), [(plane, 3), (braced, 3), (released, 6)])
def test_the_form_of_a_case_gives_its_loads(build, rank):
    """In-situ stress, forces of jacks and of stages, at parameters that it was not made of."""
    staged = build()
    march, names = staged.march, staged.names
    values = spread(staged, 40, seed=7)
    last = len(march.sequence.states) - 2
    form = load_form(march, names, values[:-1], last)
    assert form is not None
    assert not form.settles
    assert form.mix.shape[0] <= rank
    assert len(form.forces) == last + 1
    points = MarchPoints(march.systems)
    p = values[-1]
    psi = form.coordinates(p[None])[0][0]
    point = ParameterPoint(dict(zip(names, map(float, p), strict=True)), ())
    in_situ = march.in_situ.columns(point)
    in_situ[:, ~march.systems[0].present] = 0.0
    given = sum(
        march.systems.structures.given(state, point) for state in march.sequence.states
    ) + np.zeros((march.systems.structures.n_rows, 1))
    exact = points.joined(in_situ, given)[..., 0]
    np.testing.assert_allclose(form.stress @ psi, exact, atol=1e-9 * np.abs(exact).max())
    for number, (forces, state) in enumerate(zip(form.forces, march.sequence.states, strict=False)):
        whole = march.actions.forces(number, point)
        if not state.release:
            np.testing.assert_allclose(forces @ psi, whole[:, 0], atol=1e-9 * np.abs(exact).max())


def test_too_few_parameter_vectors_make_no_form():
    """As many as there are monomials, and three to try them: four and three here."""
    staged = plane()
    values = spread(staged, 12, seed=7)
    for count, made in ((6, False), (7, True)):
        form = load_form(staged.march, staged.names, values[:count], 2)
        assert (form is not None) == made


def test_whether_the_virgin_ground_moves():
    for build, moves in ((plane, False), (settling, True)):
        staged = build()
        form = load_form(staged.march, staged.names, spread(staged, 20, seed=7), 1)
        assert form.settles is moves


def test_columns_of_stress_are_those_of_strain_turned():
    """J_r eps T_r, against E u_h + E_h u and what further columns bear, one by one."""
    random = np.random.default_rng(3)
    c = {"rock": np.array([2.0, 3.0]), "clay": np.array([5.0])}
    slopes = {"rock": random.standard_normal((2, 3)), "clay": random.standard_normal((1, 3))}
    further = [((1, 2, 0.0), (0, 3, 0.0)), ((2, 0, 0.75),), ((1, 5, -0.5),)]
    turns = stress_turns(c, slopes, further)
    assert list(turns) == ["rock", "clay"]
    u = random.standard_normal(7)
    for name, T in turns.items():
        assert T.shape == (len(c[name]), 7, 7)
        for r in range(len(c[name])):
            E, E_h = c[name][r], slopes[name][r]
            exact = E * u
            exact[1:4] += E_h * u[0]
            exact[4] += E_h[1] * u[2] + E_h[0] * u[3]
            exact[5] += (E_h[2] - 0.75 * E) * u[0]
            exact[6] += (E_h[1] + 0.5 * E) * u[5]
            np.testing.assert_allclose(u @ T[r], exact, rtol=1e-13)


def test_the_strain_of_settling_brings_the_given_stress_to_where_it_is():
    """sigma = given + E eps and its derivatives, for strains that are given."""
    random = np.random.default_rng(4)
    root = random.standard_normal((4, 4))
    E, E_h = root @ root.T + np.eye(4), random.standard_normal((4, 4, 2))
    strain, given = random.standard_normal((2, 4, 5, 3))
    stress = given + np.einsum("ij,jqk->iqk", E, strain)
    stress[..., 1:] += np.einsum("ijn,jq->iqn", E_h, strain[..., 0])
    np.testing.assert_allclose(settling_strain(stress, given, E, E_h), strain, rtol=1e-8)


def test_what_a_snapshot_keeps_is_counted():
    kept = Snapshot(np.zeros(2), np.zeros((3, 4)), {})
    assert (kept.columns, kept.last, kept.entries) == (4, -1, 0)
    kept.motion += [np.zeros((0, 4)), np.zeros((7, 4)), np.zeros((7, 4))]
    kept.observed += [np.zeros((2, 4)), np.zeros((2, 4))]
    assert (kept.last, kept.entries) == (2, 2 * 28 + 2 * 8)
    kept.settled = np.zeros((4, 5, 4))
    assert kept.entries == 2 * 28 + 2 * 8 + 80
