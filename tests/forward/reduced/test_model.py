"""States, what is seen of them and bounds of a reduced model: each sum written out."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sla
from support.sums import CHANNELS, REFERENCE, summed_model

from geoident.forward.reduced.model import EnergyBounds, ReducedModel

VALUES = np.array([[1.1, 4.6], [2.3, 3.1], [1.5, 4.0]])


def _psi(model, p):
    form = model.form.loads
    products = [np.prod((p / form.scale) ** e) for e in form.exponents]
    return form.mix @ np.array(products)


def _solved(model, p):
    """Q of every state, by loops."""
    c = {name: span.coordinates(p[None])[0][0] for name, span in model.form.spans.items()}
    found = []
    for number, stage in enumerate(model.stages):
        K, right = np.zeros((stage.size, stage.size)), stage.load @ _psi(model, p)
        for (state, material), matrices in stage.matrices.items():
            whole = sum(c[material][r] * M for r, M in enumerate(matrices))
            if state == number:
                K = K + whole
            else:
                right = right - whole @ found[state]
        found.append(np.linalg.solve(K, right) if stage.size else np.zeros(0))
    return c, found


def _seen(model, p):
    c, q = _solved(model, p)
    seen = np.zeros((len(model.stages), CHANNELS))
    for number, stage in enumerate(model.stages):
        seen[number] = stage.observed @ q[number]
        for place, channel in enumerate(stage.forces.channels):
            value = stage.forces.loads[place] @ _psi(model, p)
            for (state, material), terms in stage.forces.terms.items():
                for r in range(len(terms)):
                    value += c[material][r] * (terms[r, place] @ q[state])
            seen[number, channel] = value
    return seen


def _slopes(function, p):
    found = []
    for h in range(len(p)):
        step = 1e-5 * np.eye(len(p))[h]
        found.append((function(p + step) - function(p - step)) / 2e-5)
    return np.stack(found, axis=-1)


def test_states_solve_their_equations_with_exact_derivatives():
    model = summed_model()
    found = model.states(VALUES)
    alone = model.states(VALUES, derivatives=False)
    assert [q.shape for q in found.states] == [(3, N, 3) for N in (0, 3, 2, 4)]
    assert [q.shape for q in alone.states] == [(3, N, 1) for N in (0, 3, 2, 4)]
    for n, p in enumerate(VALUES):
        _, q = _solved(model, p)
        for state in range(4):
            own = found.states[state][n]
            np.testing.assert_allclose(own[:, 0], q[state], rtol=1e-10)
            np.testing.assert_allclose(alone.states[state][n, :, 0], q[state], rtol=1e-10)
            slope = _slopes(lambda x, state=state: _solved(model, x)[1][state], p)
            np.testing.assert_allclose(own[:, 1:], slope, rtol=1e-5, atol=1e-7)


def test_moduli_and_loads_go_with_their_states():
    model = summed_model()
    at = model.states(VALUES).at
    for n, p in enumerate(VALUES):
        np.testing.assert_allclose(at.loads[n], _psi(model, p), rtol=1e-12)
        slope = _slopes(lambda x: _psi(model, x), p)
        np.testing.assert_allclose(at.load_slopes[n], slope, rtol=1e-7, atol=1e-9)
    assert list(at.moduli) == list(at.slopes) == ["rock", "clay", "steel"]


def test_what_is_seen_is_that_of_motions_and_of_stresses():
    model = summed_model()
    for derivatives in (True, False):
        found = model.observed(model.states(VALUES, derivatives=derivatives))
        assert found.shape == (4, CHANNELS, 3, 3 if derivatives else 1)
        for n, p in enumerate(VALUES):
            np.testing.assert_allclose(found[:, :, n, 0], _seen(model, p), rtol=1e-9)
            if derivatives:
                slope = _slopes(lambda x: _seen(model, x), p)
                np.testing.assert_allclose(found[:, :, n, 1:], slope, rtol=1e-5, atol=1e-6)


def test_bounds_are_the_least_distances_and_what_stages_carry_on():
    model = summed_model()
    bounds = model.bounds(model.states(VALUES, derivatives=False))
    spans = model.form.spans
    for n, p in enumerate(VALUES):
        c, q = _solved(model, p)
        at_reference = {m: span.coordinates(REFERENCE[None])[0][0] for m, span in spans.items()}
        E = {m: span.matrix(c[m]) for m, span in spans.items()}
        E0 = {m: span.matrix(at_reference[m]) for m, span in spans.items()}
        mu = {m: sla.eigh(E[m], E0[m], eigvals_only=True) for m in E}
        for m in E:
            np.testing.assert_allclose(bounds.moduli[m][n], mu[m], rtol=1e-9)
        whole = [0.0]
        for number, stage in enumerate(model.stages[1:], start=1):
            rows, targets = [], []
            for zone in stage.residuals:
                y = zone.loads @ _psi(model, p)
                for (state, material), columns in zone.terms.items():
                    for r in range(columns.shape[1]):
                        y = y - c[material][r] * (columns[:, r] @ q[state])
                root = np.sqrt(1.0 / mu[zone.material][0])
                rows.append(root * zone.rest)
                targets.append(root * y)
            A, b = np.concatenate(rows), np.concatenate(targets)
            h = np.linalg.lstsq(A, -b, rcond=None)[0] if A.shape[1] else np.zeros(0)
            squared = np.sum((A @ h + b) ** 2)
            assert bounds.residual[number, n] == pytest.approx(np.sqrt(squared), rel=1e-9)
            pairs = [sla.eigh(E[a], E[b], eigvals_only=True)[-1] for a, b in stage.changes]
            growth = max([1.0, *pairs])
            assert np.ravel(model.growth(stage, model.form.at(VALUES)) * np.ones(3))[n] == (
                pytest.approx(growth, rel=1e-9)
            )
            whole.append(squared + growth * whole[stage.base])
            assert bounds.stress[number, n] == pytest.approx(np.sqrt(whole[-1]), rel=1e-9)
            energy = sum(
                c[m][r] * (q[number] @ M @ q[number])
                for (state, m), matrices in stage.matrices.items()
                if state == number
                for r, M in enumerate(matrices)
            )
            assert bounds.size[number, n] == pytest.approx(np.sqrt(energy), rel=1e-9)
    assert not bounds.residual[0].any()
    assert not bounds.stress[0].any()
    relative = bounds.stress.max(axis=0) / bounds.size.max(axis=0)
    np.testing.assert_allclose(bounds.relative, relative, rtol=1e-12)


def test_a_change_to_stiffer_ground_brings_no_energy():
    """The largest of both eigenvalues, and never less than one."""
    model = summed_model()
    at, stage = model.form.at(VALUES), model.stages[3]
    E = {m: span.matrix(at.moduli[m]) for m, span in model.form.spans.items()}
    for changes in ((("rock", "steel"),), (("rock", "rock"),), (("clay", "rock"),)):
        (a, b), = changes  # fmt: skip
        stage_of = type(stage)(**{**stage.__dict__, "changes": changes})
        found = model.growth(stage_of, at)
        for n in range(3):
            expected = max(1.0, sla.eigh(E[a][n], E[b][n], eigvals_only=True)[-1])
            assert found[n] == pytest.approx(expected, rel=1e-9)
    assert model.growth(model.stages[1], at) == 1.0


def test_a_state_in_which_nothing_moves_has_no_energy_to_compare_with():
    size = np.array([[0.0, 0.0, 0.25], [0.0, 3.0, 0.5]])
    stress = np.array([[2.0, 0.0, 0.0], [1.0, 6.0, 4.0]])
    bounds = EnergyBounds(stress, stress, size, {})
    np.testing.assert_array_equal(bounds.relative, [2.0, 2.0, 8.0])


def test_a_virgin_state_that_settles_counts_as_one_that_carries_nothing():
    """Its own distance alone, whatever it builds on."""
    model = summed_model()
    settling = ReducedModel(
        model.form, model.reference, (type(model.stages[1])(**model.stages[1].__dict__),)
    )
    stage = settling.stages[0]
    matrices = {(0, m): block for (_, m), block in stage.matrices.items()}
    zones = tuple(
        type(z)(z.material, z.loads, z.rest, {(0, m): t for (_, m), t in z.terms.items()})
        for z in stage.residuals
    )
    own = type(stage)(**{**stage.__dict__, "matrices": matrices, "residuals": zones,
                         "forces": model.stages[0].forces})  # fmt: skip
    alone = ReducedModel(model.form, model.reference, (own,))
    found = alone.bounds(alone.states(VALUES))
    np.testing.assert_array_equal(found.stress, found.residual)
    reference = model.bounds(model.states(VALUES))
    np.testing.assert_allclose(found.residual[0], reference.residual[1], rtol=1e-12)
