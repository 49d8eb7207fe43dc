"""Anisotropic materials with sound numbers, and tensors turned in the plainest way."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from geoident.fem.elasticity import axes_of_attitude
from geoident.model.dual import Dual
from geoident.model.ground import (
    ENTRIES,
    Anisotropic,
    Attitude,
    Axes,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
)
from geoident.model.parameter import Scalar

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
STRATA = {"E_p": 20e9, "nu_p": 0.22, "E_n": 8e9, "nu_np": 0.18, "G_np": 3.5e9}
LOVE = {"A": 24e9, "C": 11e9, "F": 5e9, "L": 3e9, "N": 8e9}
ORTHOTROPIC = {
    "E_1": 22e9, "E_2": 15e9, "E_3": 9e9, "nu_12": 0.25, "nu_13": 0.3, "nu_23": 0.2,
    "G_12": 7e9, "G_13": 4e9, "G_23": 3e9,
}  # fmt: skip
ATTITUDE = {"dip": 0.6, "dip_direction": 2.1, "rotation": 0.4}


def scalars(numbers: dict[str, float]) -> dict[str, Scalar]:
    return {name: Scalar(value) for name, value in numbers.items()}


def ties(numbers: dict[str, float]) -> dict[str, Scalar]:
    """Every number a parameter of its own name."""
    return {name: Scalar(1.0, name) for name in numbers}


def attitude(dip: float, dip_direction: float = np.pi / 2, rotation: float = 0.0) -> Attitude:
    return Attitude(Scalar(dip), Scalar(dip_direction), Scalar(rotation))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, [1, 0, 2]]


def in_plane(angle: float) -> np.ndarray:
    """Rotation about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def turn_matrix(E: np.ndarray, R: np.ndarray) -> np.ndarray:
    """An elasticity matrix turned as a tensor of fourth order, index by index."""
    C = np.zeros((3, 3, 3, 3))
    for (a, (i, j)), (b, (k, m)) in product(enumerate(PAIRS), repeat=2):
        for p, q in {(i, j), (j, i)}:
            for r, s in {(k, m), (m, k)}:
                C[p, q, r, s] = E[a, b]
    C = np.einsum("ip,jq,kr,ls,pqrs->ijkl", R, R, R, R, C)
    return np.array([[C[i, j, k, m] for k, m in PAIRS] for i, j in PAIRS])


def turn_tensor(sigma: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Voigt vectors (..., 6) of symmetric tensors, turned."""
    index = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
    tensor = R @ sigma[..., index] @ R.T
    return np.stack([tensor[..., i, j] for i, j in PAIRS], axis=-1)


def general(E: np.ndarray) -> Anisotropic:
    """A general anisotropic material with the entries of a matrix (6, 6)."""
    return Anisotropic({n: Scalar(float(E[int(n[1]) - 1, int(n[2]) - 1])) for n in ENTRIES})


def random_definite(rng: np.random.Generator, size: float = 10e9) -> np.ndarray:
    """A positive definite matrix (6, 6) without any symmetry, Pa."""
    half = rng.normal(size=(6, 6))
    return size * (np.eye(6) + 0.1 * half @ half.T)


def every_symmetry(R: np.ndarray) -> dict[str, object]:
    """A material of each symmetry, its axes turned by R (3, 3)."""
    axes = Axes(tuple(R[:, 0]), tuple(R[:, 1]))
    fixed = random_definite(np.random.default_rng(3))
    return {
        "isotropic": Isotropic(E=Scalar(10e9), nu=Scalar(0.2)),
        "strata": TransverselyIsotropic(**scalars(STRATA), frame=axes),
        "love": LoveModuli(**scalars(LOVE), frame=axes),
        "orthotropic": Orthotropic(**scalars(ORTHOTROPIC), frame=axes),
        "anisotropic": general(turn_matrix(fixed, R)),
    }


def each_a_parameter(numbers: dict[str, float]) -> dict[str, Dual]:
    """Numbers with derivatives: each is a parameter of its own, in their order."""
    rows = np.column_stack([list(numbers.values()), np.eye(len(numbers))])
    return {name: Dual(row) for name, row in zip(numbers, rows, strict=True)}


def moduli(formula: Callable[[dict[str, Dual]], Dual], numbers: dict[str, float]) -> np.ndarray:
    """The elasticity matrix (6, 6) of a formula."""
    return formula(each_a_parameter(numbers)).value


def axes(dip: float, dip_direction: float, rotation: float, *, section: bool = False) -> np.ndarray:
    """Material axes (3, 3) of strata."""
    given = each_a_parameter({"a": dip, "b": dip_direction, "c": rotation}).values()
    return axes_of_attitude(*given, section=section).value
