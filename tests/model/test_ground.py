"""The bounds on elastic constants against the eigenvalues of the matrices that they make."""

from __future__ import annotations

import numpy as np
import pytest
from support.anisotropy import LOVE, ORTHOTROPIC, STRATA, attitude, general, moduli, scalars

from geoident.fem.elasticity import love
from geoident.model.ground import (
    Anisotropic,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    breach,
    constants,
)
from geoident.model.parameter import Scalar

FLAT = attitude(0.0)


def compliance(E, nu, G):
    """S (6, 6) of three axes: E_1..3; nu_12, nu_13, nu_23; G_12, G_23, G_13."""
    S = np.diag([*(1 / np.array(E)), *(1 / np.array(G))])
    for (i, j), ratio in zip(((0, 1), (0, 2), (1, 2)), nu, strict=True):
        S[i, j] = S[j, i] = -ratio / E[i]
    return S


def definite(matrix) -> bool:
    return bool(np.linalg.eigvalsh(matrix).min() > 0)


def test_orthotropic_bounds_are_those_of_positive_eigenvalues():
    rng = np.random.default_rng(1)
    found = []
    for _ in range(800):
        E, G, nu = rng.uniform(1, 20, 3), rng.uniform(1, 5, 3), rng.uniform(-1.2, 1.2, 3)
        names = ("E_1", "E_2", "E_3", "nu_12", "nu_13", "nu_23", "G_12", "G_23", "G_13")
        material = Orthotropic(
            **scalars(dict(zip(names, map(float, [*E, *nu, *G]), strict=True))), frame=FLAT
        )
        found.append(breach(material, {}))
        assert (found[-1] is None) == definite(compliance(E, nu, G))
    assert {b.constant for b in found if b} == {"nu_12", "nu_13", "nu_23"}
    assert 25 < sum(b is None for b in found) < 775


def test_strata_bounds_are_those_of_positive_eigenvalues():
    rng = np.random.default_rng(2)
    found = []
    for _ in range(600):
        E_p, E_n, G = rng.uniform(1, 20, 3)
        nu_p, nu_np = rng.uniform(-1.3, 1.3, 2)
        material = TransverselyIsotropic(*map(Scalar, (E_p, nu_p, E_n, nu_np, G)), frame=FLAT)
        across = nu_np * E_p / E_n
        S = compliance((E_p, E_p, E_n), (nu_p, across, across), (E_p / 2 / (1 + nu_p), G, G))
        found.append(breach(material, {}))
        assert (found[-1] is None) == definite(S)
    assert {b.constant for b in found if b} == {"nu_p", "nu_np"}


def test_love_bounds_are_those_of_positive_eigenvalues():
    rng = np.random.default_rng(3)
    found = []
    for _ in range(600):
        numbers = dict(zip("ACFLN", map(float, rng.uniform(-0.2, 3, 5)), strict=True))
        found.append(breach(LoveModuli(**scalars(numbers), frame=FLAT), {}))
        assert (found[-1] is None) == definite(moduli(love, numbers))
    assert {b.constant for b in found if b} == set("ACFLN")


def test_general_bounds_are_those_of_positive_eigenvalues():
    rng = np.random.default_rng(4)
    found = []
    for _ in range(500):
        half = rng.normal(size=(6, 6))
        matrix = half @ half.T + rng.uniform(-1, 0.5) * np.eye(6)
        found.append(breach(general(matrix), {}))
        assert (found[-1] is None) == definite(matrix)
    assert {b.constant for b in found if b} >= {"c44", "c55", "c66"}


@pytest.mark.parametrize(
    ("material", "constant", "limit"),
    [
        (Isotropic(E=Scalar(1e9), nu=Scalar(0.5)), "nu", "between -1 and 0.5"),
        (Isotropic(K=Scalar(1e9), G=Scalar(0.0)), "G", "positive"),
        (
            TransverselyIsotropic(**scalars({**STRATA, "nu_np": 0.9}), frame=FLAT),
            "nu_np",
            "with E_n/E_p = 0.4 and nu_p = 0.22 it must be between -0.395 and 0.395",
        ),
        (
            LoveModuli(**scalars({**LOVE, "F": 20e9}), frame=FLAT),
            "F",
            "with these A, C and N it must be between -1.327e+10 and 1.327e+10 Pa",
        ),
        (
            Orthotropic(**scalars({**ORTHOTROPIC, "nu_12": 1.5}), frame=FLAT),
            "nu_12",
            "with E_1/E_2 = 1.467 it must be between -1.211 and 1.211",
        ),
        (
            Anisotropic(scalars({"c11": 4.0, "c12": 3.0, "c22": 2.0, "c33": 1.0, "c44": 1.0})),
            "c22",
            "with the entries above and left of it, it must exceed 2.25 Pa",
        ),
    ],
)
def test_the_bound_is_named(material, constant, limit):
    found = breach(material, {})
    assert found.constant == constant
    assert limit in found.limit
    assert constant in constants(material)
