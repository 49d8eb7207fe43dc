"""A reduced model of random sums: small, of unequal sizes, without a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.forward.reduced.affine_analysis import AffineForm
from geoident.forward.reduced.loads import LoadForm
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.projection import ReducedStage, ZoneResidual
from geoident.forward.reduced.stress_rows import StageForces
from geoident.model.case import Material
from geoident.model.ground import Anisotropic, Isotropic

S = 4
"""Components of a strain."""

NAMES = ("one", "two")
SCALE = np.array([2.0, 5.0])
REFERENCE = np.array([1.5, 4.0])
CHANNELS = 3


ANY = Material("any", Anisotropic())


@dataclass(frozen=True, eq=False)
class Sum:
    """Moduli that are sums of matrices by squares of the parameters: what a span is."""

    basis: np.ndarray
    constant: np.ndarray
    by: np.ndarray
    fixed: np.ndarray | None = None
    material: Material = ANY

    @property
    def rank(self) -> int:
        return len(self.basis)

    def coordinates(self, values):
        """(b, r) and (b, r, n)."""
        c = self.constant + values**2 @ self.by.T
        return c, 2.0 * values[:, None, :] * self.by

    def matrix(self, coordinates):
        """(..., s, s)."""
        return np.tensordot(coordinates, self.basis, axes=1)


def definite(random: np.random.Generator, s: int = S) -> np.ndarray:
    """A symmetric, positive definite matrix."""
    root = random.standard_normal((s, s))
    return root @ root.T + np.eye(s)


def spans(random: np.random.Generator) -> dict[str, Sum]:
    """Three materials: of two matrices, of isotropic ones, and one that stays as it is."""
    some = np.stack([definite(random), definite(random)])
    volumetric = np.zeros((S, S))
    volumetric[:3, :3] = 1.0
    shear = np.diag([2.0] * 3 + [1.0] * (S - 3))
    deviator = shear - volumetric * np.sum(volumetric * shear) / np.sum(volumetric**2)
    whole = np.stack([volumetric / 3.0, deviator / np.linalg.norm(deviator)])
    own = np.array([[0.3, 0.0], [0.2, 0.1]])
    lasts = definite(random)[None]
    lasts /= np.linalg.norm(lasts)
    return {
        "rock": Sum(some / np.linalg.norm(some, axis=(1, 2))[:, None, None], np.array([2.0, 3.0]),
                    own),
        "clay": Sum(whole, np.array([4.0, 1.5]), own[::-1],
                    material=Material("clay", Isotropic())),
        "steel": Sum(lasts, np.array([1.7]), np.zeros((1, 2)), np.array([1.7])),
    }  # fmt: skip


def loads(random: np.random.Generator, *, settles: bool = False) -> LoadForm:
    """Three loads of four monomials."""
    exponents = np.array([[0, 0], [1, 0], [0, 2], [1, 1]])
    return LoadForm(SCALE, exponents, random.standard_normal((3, 4)), np.zeros((S, 0, 3)), (),
                    settles)  # fmt: skip


def stage(random, number, base, sizes, terms, rests, changes=()) -> ReducedStage:
    """A state of random arrays.

    Args:
        random: where from.
        number: of the state.
        base: on which it builds.
        sizes: unknowns N of every state.
        terms: states and materials with their ranks, of which its equations are made.
        rests: number of self-equilibrated stresses.
        changes: materials that changed.
    """
    N = sizes[number]
    matrices = {}
    for (state, material), rank in terms.items():
        block = 0.3 * random.standard_normal((rank, N, sizes[state]))
        if state == number:
            block = np.stack([definite(random, N) for _ in range(rank)])
        matrices[state, material] = block
    zones = tuple(
        ZoneResidual(
            material,
            random.standard_normal((7, 3)),
            random.standard_normal((7, rests)),
            {key: random.standard_normal((7, rank, sizes[key[0]])) for key, rank in terms.items()},
        )
        for material in ("rock", "clay", "rock")
    )
    normal = {}
    for zone in zones:
        normal[zone.material] = normal.get(zone.material, 0.0) + zone.rest.T @ zone.rest
    forces = StageForces(
        np.array([2, 0]),
        random.standard_normal((2, 3)),
        {key: random.standard_normal((rank, 2, sizes[key[0]])) for key, rank in terms.items()},
    )
    return ReducedStage(base, random.standard_normal((CHANNELS, N)), matrices,
                        random.standard_normal((N, 3)), zones, normal, changes, forces)  # fmt: skip


def empty(number_of_loads: int = 3) -> ReducedStage:
    """The virgin state, of which nothing moves."""
    nothing = StageForces(np.array([2, 0]), np.array([[1.0, -2.0, 3.0], [0.5, 0.0, 4.0]]), {})
    return ReducedStage(0, np.zeros((CHANNELS, 0)), {}, np.zeros((0, number_of_loads)), (), {}, (),
                        nothing)  # fmt: skip


def summed_model(seed: int = 1) -> ReducedModel:
    """Three states after the virgin one; the last builds on the first, where rock turns to clay."""
    random = np.random.default_rng(seed)
    sizes = (0, 3, 2, 4)
    one = {(1, "rock"): 2, (1, "clay"): 2}
    two = {(1, "rock"): 2, (2, "clay"): 2, (2, "rock"): 2}
    last = {(3, "rock"): 2, (3, "steel"): 1, (1, "rock"): 2, (3, "clay"): 2}
    made = spans(random)
    stages = (
        empty(),
        stage(random, 1, 0, sizes, one, 2),
        stage(random, 2, 1, sizes, two, 0),
        stage(random, 3, 1, sizes, last, 3, (("rock", "clay"), ("rock", "steel"))),
    )
    return ReducedModel(AffineForm(NAMES, made, loads(random)), REFERENCE, stages)
