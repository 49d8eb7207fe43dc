"""The equations of a stage on arrays, against loops, another solver's projections, differences."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from support.array_model import Operators
from support.plastic import Planes, definite, polyhedral, projection_by_piqp, random_planes

from geoident.fem.elasticity import UniformModuli
from geoident.fem.patches import Patch
from geoident.forward.analysis.constitutive import MaterialPoints
from geoident.forward.analysis.stage_equations import (
    StageEquations,
)

S, M, D = 3, 7, 9
"""Strain components, points, degrees of freedom."""

RNG = np.random.default_rng(12)
C = RNG.normal(size=(S * M, D))
VOLUME = RNG.uniform(0.5, 2.0, M)
BEFORE = 0.2 * RNG.normal(size=(S, M))
BARS = 0.3 * definite(RNG, D)
LOCKED = RNG.normal(size=D)
DOFS = np.array([7, 0, 2, 5, 3])
FORCES = RNG.normal(size=D)
E = {name: definite(RNG, S) for name in ("hard", "plain", "soft")}
PLANES = {
    "hard": random_planes(RNG, 4, S, hardening=0.4),
    "soft": Planes(*(random_planes(RNG, 3, S).__dict__[n] for n in ("normals", "distances"))),
}
HARDENED = RNG.uniform(0.0, 0.3, (4, 3))
BEGIN = RNG.bit_generator.state


@pytest.fixture(autouse=True)
def same_draws():
    """Each test draws the same numbers, whatever ran before it."""
    RNG.bit_generator.state = BEGIN


def grounds(*, flow=False):
    """Two that yield and an elastic one between them; points in runs and one by one."""
    soft = polyhedral(E["soft"], PLANES["soft"])
    if flow:  # said to have no potential
        soft = SimpleNamespace(associated=False, project=soft.project, hardens=False)
    return [
        MaterialPoints("hard", np.array([1, 3, 6]), UniformModuli(E["hard"]),
               polyhedral(E["hard"], PLANES["hard"]), HARDENED),
        MaterialPoints("plain", np.array([0, 5]), UniformModuli(E["plain"])),
        MaterialPoints("soft", slice(2, 5, 2), UniformModuli(E["soft"]), soft),
    ]  # fmt: skip


def equations(**changes):
    settings = {
        "volume": VOLUME, "dofs": DOFS, "grounds": grounds(), "stress": BEFORE, "forces": FORCES,
        "solver": None, "members": lambda du: LOCKED + BARS @ du,
    }  # fmt: skip
    return StageEquations(Operators(sp.csr_array(C), M), **(settings | changes))


def stresses(du, *, viscosity=0.0):
    """What the grounds bear, point by point, by an interior-point method."""
    strain = (C @ du).reshape(S, M)
    found = np.zeros((S, M))
    for name, points in (("hard", [1, 3, 6]), ("plain", [0, 5]), ("soft", [2, 4])):
        for place, k in enumerate(points):
            trial = BEFORE[:, k] + E[name] @ strain[:, k]
            found[:, k] = trial
            if name in PLANES:
                hardened = HARDENED[:, place] if name == "hard" else None
                borne = projection_by_piqp(E[name], PLANES[name], trial, hardened)
                found[:, k] = borne + viscosity * (trial - borne)
    return found


def internal(stress):
    return np.einsum("smd,sm,m->d", C.reshape(S, M, D), stress, VOLUME)


DU = 0.4 * RNG.normal(size=D)


@pytest.mark.parametrize("viscosity", [0.0, 0.3])
def test_a_trial_is_what_the_grounds_bear(viscosity):
    stage = equations().viscous(viscosity)
    trial = stage.at(DU)
    wanted = stresses(DU, viscosity=viscosity)
    np.testing.assert_allclose(trial.stress, wanted, atol=1e-6)
    acting = internal(trial.stress) + LOCKED + BARS @ DU
    np.testing.assert_allclose(trial.residual, (FORCES - acting)[DOFS], atol=1e-12)
    assert trial.scale >= np.abs(acting).max()
    assert trial.imbalance == pytest.approx(np.abs(trial.residual).max() / trial.scale)
    assert [flow is None for flow in trial.responses] == [False, True, False]
    assert len(trial.flowing) == 2
    assert stage.viscous(viscosity) is stage
    np.testing.assert_array_equal(stage.stress, BEFORE)


def test_the_residual_is_the_slope_of_the_potential():
    stage, h = equations(), 1e-5
    for du in (DU, -0.7 * DU, 0.01 * DU):
        trial = stage.at(du)
        for k, dof in enumerate(DOFS):
            unit = h * np.eye(D)[dof]
            ends = [stage.distance(stage.at(du + sign * unit)) for sign in (1, -1)]
            slope = (ends[0] - ends[1]) / (2 * h)
            assert slope == pytest.approx(-trial.residual[k], abs=1e-5)
    without = equations(members=None)
    ends = [without.distance(without.at(DU + sign * h * np.eye(D)[2])) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / (2 * h) == pytest.approx(-without.at(DU).residual[2], abs=1e-5)
    loose = equations(grounds=grounds(flow=True))
    assert not loose.associated
    assert loose.distance(loose.at(DU)) == loose.at(DU).imbalance
    assert equations().associated


def test_a_patch_moves_as_the_whole_with_all_else_still():
    """Its residual is that of the whole at its unknowns, of points and bars alike."""
    points = np.array([1, 2, 4, 5])
    rows = np.concatenate([c * M + points for c in range(S)])
    dofs = np.array([0, 2, 3, 4, 6, 7])
    unknowns = np.array([0, 1, 2, 4])  # 7, 0, 2, 3
    places = np.searchsorted(dofs, DOFS[unknowns])
    local = C.copy()
    others = np.setdiff1d(np.arange(D), dofs)
    local[np.ix_(rows, others)] = 0.0  # the points of the patch are strained by its own nodes
    mine = np.zeros(S * M, dtype=bool)
    mine[rows] = True
    local[np.ix_(~mine, DOFS[unknowns])] = 0.0  # and its unknowns strain no others
    stage = replace(equations(), operators=Operators(sp.csr_array(local), M))
    patch = Patch(points, dofs, unknowns, places, sp.csr_array(local[np.ix_(rows, dofs)]))
    own = stage.on_patch(patch, "solver", DU)
    assert own.solver == "solver"
    assert [ground.name for ground in own.grounds] == ["hard", "plain", "soft"]
    assert [ground.points.tolist() for ground in own.grounds] == [[0], [3], [1, 2]]
    for step in (0.0, 0.3, -0.5):
        moved = DU.copy()
        moved[DOFS[unknowns]] += step * RNG.normal(size=4)
        whole, part = stage.at(moved), own.at(moved[dofs])
        np.testing.assert_allclose(part.residual, whole.residual[unknowns], atol=1e-12)
        np.testing.assert_allclose(part.stress, whole.stress[:, points], atol=1e-12)
    bare = replace(stage, members=None).on_patch(patch, "solver", DU)
    assert bare.members is None
    none = replace(stage, grounds=stage.grounds[:1]).on_patch(
        replace(patch, points=np.array([0, 2, 4, 5])), "solver", DU
    )
    assert none.grounds == []


# --- which planes are reached ---
