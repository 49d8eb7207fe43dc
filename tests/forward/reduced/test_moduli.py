"""Moduli as sums of few matrices: against Hooke's law written out, and against differences."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as sla

from geoident.forward.reduced import moduli as under_test
from geoident.forward.reduced.moduli import (
    MaterialSpan,
    moment_basis,
    relative_eigenvalues,
    rigidity_span,
    span_of,
)
from geoident.model.case import Material
from geoident.model.ground import Attitude, Isotropic, TransverselyIsotropic
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Bolts

NAMES = ("idle", "first", "second")
VALUES = np.array([[7.0, 3.0e9, 0.31], [5.0, 4.1e9, 0.17], [6.0, 2.2e9, 0.36]])


def _hooke(lame: float, mu: float, s: int) -> np.ndarray:
    E = np.zeros((s, s))
    for i in range(3):
        for j in range(3):
            E[i, j] = lame + 2.0 * mu * (i == j)
    for i in range(3, s):
        E[i, i] = mu
    return E


def _of_young(E: float, nu: float) -> tuple[float, float]:
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


ISOTROPIC = {
    "both": (Isotropic(E=Scalar(1.7, "first"), nu=Scalar(0.8, "second")), 2,
             lambda p: _of_young(1.7 * p[1], 0.8 * p[2])),
    "Young": (Isotropic(E=Scalar(1.7, "first"), nu=Scalar(0.23)), 1,
              lambda p: _of_young(1.7 * p[1], 0.23)),
    "Poisson": (Isotropic(E=Scalar(3e9), nu=Scalar(0.8, "second")), 2,
                lambda p: _of_young(3e9, 0.8 * p[2])),
    "bulk and shear": (Isotropic(K=Scalar(1.3, "first"), G=Scalar(2e9, "second")), 2,
                       lambda p: (1.3 * p[1] - 2 / 3 * 2e9 * p[2], 2e9 * p[2])),
    "one for both": (Isotropic(K=Scalar(1.3, "first"), G=Scalar(0.4, "first")), 1,
                     lambda p: ((1.3 - 2 / 3 * 0.4) * p[1], 0.4 * p[1])),
}  # fmt: skip


@pytest.mark.parametrize("s", [4, 6])
@pytest.mark.parametrize("name", ISOTROPIC)
def test_isotropic_moduli_are_those_of_hooke_with_their_derivatives(name, s):
    elastic, rank, lame = ISOTROPIC[name]
    span = span_of(Material("rock", elastic), NAMES, VALUES, s)
    assert span.rank == rank
    assert span.fixed is None
    assert span.section == (s == 4)
    np.testing.assert_allclose(np.einsum("rij,qij->rq", span.basis, span.basis), np.eye(rank),
                               atol=1e-12)  # fmt: skip
    c, dc = span.coordinates(VALUES)
    assert c.shape == (3, rank)
    assert dc.shape == (3, rank, 3)
    for p, own, slopes in zip(VALUES, c, dc, strict=True):
        E = _hooke(*lame(p), s)
        np.testing.assert_allclose(span.matrix(own), E, atol=1e-12 * E.max())
        for h in range(3):
            step = 1e-4 * p[h]
            ahead, behind = p.copy(), p.copy()
            ahead[h] += step
            behind[h] -= step
            slope = (_hooke(*lame(ahead), s) - _hooke(*lame(behind), s)) / (2 * step)
            np.testing.assert_allclose(
                span.matrix(slopes[:, h]), slope, rtol=1e-5, atol=1e-6 * E.max() / p[h]
            )


STRATA = TransverselyIsotropic(
    Scalar(1.0, "first"), Scalar(0.2), Scalar(0.5, "first"), Scalar(0.1), Scalar(9e8),
    Attitude(Scalar(1.0, "second"), Scalar(0.7), Scalar(0.0)),
)  # fmt: skip


def test_moduli_of_strata_are_sums_of_what_was_seen_and_others_are_refused():
    random = np.random.default_rng(3)
    seen = VALUES.mean(axis=0) * random.uniform(0.6, 1.4, (30, 3))
    material = Material("slate", STRATA)
    span = span_of(material, NAMES, seen, 6)
    p = VALUES[1]
    c, dc = span.coordinates(p[None])
    np.testing.assert_allclose(
        span.matrix(c[0]), under_test.moduli_at(material, NAMES, p, False)[..., 0],
        atol=1e-9 * p[1],
    )  # fmt: skip
    for h in (1, 2):
        step = 1e-5 * p[h] * np.eye(3)[h]
        ahead, behind = span.coordinates(np.stack([p + step, p - step]))[0]
        slope = (ahead - behind) / (2e-5 * p[h])
        np.testing.assert_allclose(dc[0, :, h], slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max())
    assert not dc[0, :, 0].any()
    flat = np.column_stack([seen[:, :2], np.full(30, 0.31)])  # always the same dip
    few = span_of(material, NAMES, flat, 6)
    assert few.rank < span.rank
    few.coordinates(flat[:2])
    with pytest.raises(ValueError, match="the moduli of slate leave the span of those that were"):
        few.coordinates(np.stack([flat[0], p]))


@pytest.mark.parametrize(("part", "fits"), [(0.5, True), (2.0, False)])
def test_what_its_coordinates_may_miss_of_a_matrix(part, fits, monkeypatch):
    """Of a matrix whose least entry is beyond the span: 1e-10 of its largest one."""
    missed = part * under_test.OUTSIDE
    E = np.diag([1.0, 0.5, 0.25, 0.125])
    basis = (E / np.linalg.norm(E))[None]
    changed = E.copy()
    changed[0, 3] = changed[3, 0] = missed
    whole = np.zeros((6, 6, 1 + len(NAMES)))
    whole[:4, :4, 0] = changed
    monkeypatch.setattr(under_test, "moduli_at", lambda *_: whole)
    span = MaterialSpan(Material("slate", STRATA), NAMES, True, basis, None)
    if fits:
        c, _ = span.coordinates(VALUES[:1])
        assert c[0, 0] == pytest.approx(np.linalg.norm(E))
    else:
        with pytest.raises(ValueError, match="leave the span"):
            span.coordinates(VALUES[:1])


@pytest.mark.parametrize(("tilt", "rank"), [(0.5e-12, 1), (4e-12, 2)])
def test_what_counts_as_a_further_matrix(tilt, rank, monkeypatch):
    """Two matrices of any size whose directions are a tilt apart span two ways from 1e-12 on."""
    A, B = np.diag([3.0, 2.0, 1.0, 1.0]), np.diag([-1.0, 1.0, 2.0, -1.0])
    A, B = A / np.linalg.norm(A), B / np.linalg.norm(B)
    assert np.sum(A * B) == pytest.approx(0.0, abs=1e-15)
    given = iter([5.0 * (A + 2 * tilt * B), 900.0 * (A - 2 * tilt * B)])

    def moduli(*_):
        whole = np.zeros((6, 6, 1))
        whole[:4, :4, 0] = next(given)
        return whole

    monkeypatch.setattr(under_test, "moduli_at", moduli)
    assert span_of(Material("slate", STRATA), NAMES, VALUES[:2], 4).rank == rank


def test_moduli_that_no_parameter_moves_are_kept():
    elastic = Isotropic(E=Scalar(3e9), nu=Scalar(0.2))
    span = span_of(Material("steel", elastic), NAMES, VALUES, 4)
    assert span.rank == 1
    c, dc = span.coordinates(VALUES[:2])
    assert c.shape == (2, 1)
    np.testing.assert_array_equal(dc, np.zeros((2, 1, 3)))
    for own in c:
        np.testing.assert_allclose(span.matrix(own), _hooke(*_of_young(3e9, 0.2), 4), rtol=1e-12)
    many = MaterialSpan(span.material, NAMES, True, np.eye(4 * 4)[:3].reshape(3, 4, 4),
                        np.array([2.0, 3.0, 5.0]))  # fmt: skip
    c, dc = many.coordinates(VALUES[:2])
    np.testing.assert_array_equal(c, [[2.0, 3.0, 5.0]] * 2)
    np.testing.assert_array_equal(dc, np.zeros((2, 3, 3)))


WALL = Beam("line", E=Scalar(2.0, "first"), thickness=Scalar(0.5, "second"))


@pytest.mark.parametrize("s", [4, 6])
def test_rigidities_of_a_wall_stand_for_moduli(s):
    """EA = E t and EI = E t^3 / 12, the same of all components."""
    for bending, power, part in ((False, 1, 1.0), (True, 3, 1 / 12)):
        span = rigidity_span(WALL, NAMES, VALUES, s, bending=bending)
        assert (span.rank, span.fixed, span.bending) == (1, None, bending)
        assert moment_basis(span) is span.basis
        c, dc = span.coordinates(VALUES)
        assert c.shape == (3, 1)
        E, t = 2.0 * VALUES[:, 1], 0.5 * VALUES[:, 2]
        for n in range(3):
            D = part * E[n] * t[n] ** power
            np.testing.assert_allclose(span.matrix(c[n]), D * np.eye(s), rtol=1e-12)
            by = [0.0, 2.0 * D / E[n], 0.5 * power * D / t[n]]
            for h in range(3):
                np.testing.assert_allclose(span.matrix(dc[n, :, h]), by[h] * np.eye(s), rtol=1e-12)


def test_rigidities_that_no_parameter_moves_are_kept():
    bolts = Bolts((((0.0, 0.0), (2.0, 1.0)),), Scalar(1.25), EA=Scalar(3e8))
    span = rigidity_span(bolts, NAMES, VALUES, 4, bending=False)
    np.testing.assert_allclose(span.matrix(span.fixed), 3e8 / 1.25 * np.eye(4), rtol=1e-12)
    c, dc = span.coordinates(VALUES)
    np.testing.assert_array_equal(c, np.repeat(span.fixed[None], 3, axis=0))
    np.testing.assert_array_equal(dc, np.zeros((3, 1, 3)))


def test_products_of_moduli_are_sums_of_the_moments_basis():
    random = np.random.default_rng(8)
    isotropic = span_of(Material("rock", ISOTROPIC["both"][0]), NAMES, VALUES, 4)
    one = span_of(Material("rock", ISOTROPIC["Young"][0]), NAMES, VALUES, 4)
    assert moment_basis(isotropic) is isotropic.basis
    assert moment_basis(one) is one.basis
    seen = VALUES.mean(axis=0) * random.uniform(0.6, 1.4, (30, 3))
    strata = span_of(Material("slate", STRATA), NAMES, seen, 4)
    assert strata.rank > 1
    for span in (isotropic, strata):
        A, B, E = (span.matrix(c) for c in span.coordinates(VALUES)[0])
        product = A.T @ np.linalg.solve(E, B)
        basis = moment_basis(span)
        again = np.einsum("rij,rkl,kl->ij", basis, basis, product)
        np.testing.assert_allclose(again, product, atol=1e-9 * np.abs(product).max())
    np.testing.assert_array_equal(moment_basis(strata), np.eye(16).reshape(16, 4, 4))
    alone = MaterialSpan(strata.material, NAMES, True, strata.basis[:1], None)
    assert moment_basis(alone) is alone.basis


def test_eigenvalues_against_a_reference_are_those_of_the_pencil():
    random = np.random.default_rng(2)
    roots = random.standard_normal((3, 5, 5))
    some = roots @ roots.swapaxes(1, 2) + np.eye(5)
    for A, found in zip(some[:2], relative_eigenvalues(some[:2], some[2]), strict=True):
        np.testing.assert_allclose(found, sla.eigh(A, some[2], eigvals_only=True), rtol=1e-10)
