"""The least stable mode of a tangent, against dense eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from support.cases import model
from support.meshes import box
from support.yielding import NOTHING, constant, mohr, rock

from geoident.forward.analysis import plastic_step
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.bands import band_at
from geoident.forward.analysis.stage_equations import Iterate, StageEquations
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar

PRESSURE, PHI = 1e5, 0.95


def sheared(monkeypatch, psi: float) -> tuple[StageEquations, Iterate]:
    """A box far beyond its limit, all of which flows: strained evenly in its plane.

    No equilibrium is needed to ask for the stability of a tangent.
    """
    ends = []
    solved = plastic_step.solve

    def spied(equations, *args, **kwargs):
        ends.append(equations)
        return solved(equations, *args, **kwargs)

    monkeypatch.setattr(plastic_step, "solve", spied)
    soil = rock(3e7, 0.3, mohr(1e2, PHI, psi=psi), name="soil")
    mesh = box("quad8", (4, 4), distortion=0.2)
    staged = model(
        mesh,
        materials={"soil": soil},
        groups={"all": "soil"},
        supports=(Support("y0", (0, 1)),),
        in_situ=constant(*(-PRESSURE,) * 3),
        stages=(Stage("load", loads={"top": Traction("y1", (Scalar(0.0), Scalar(-1.0)))}),),
    )
    list(staged.at(NOTHING, RunOptions(derivatives=False)).states())
    x, y = mesh.points.T
    strained = np.column_stack([0.028 * x + 0.03 * y + 0.004 * x * y, -0.03 * y]).ravel()
    (equations,) = ends
    return equations, equations.at(equations.spread(strained[equations.dofs]))


Pencil = tuple[StageEquations, Iterate, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def pencil() -> Pencil:
    """A state with eigenvalues l and modes of K_T x = l K x, dense, both by the residual alone."""
    with pytest.MonkeyPatch.context() as patch:
        equations, trial = sheared(patch, 0.0)
    n, h = len(equations.dofs), 1e-9

    def residuals(du: np.ndarray, size: float) -> np.ndarray:
        moved = (equations.at(du + equations.spread(size * column)) for column in np.eye(n))
        return np.column_stack([one.residual for one in moved])

    tangent = (residuals(trial.du, -h) - residuals(trial.du, h)) / (2.0 * h)
    rest = equations.at(0.0 * trial.du)
    assert not rest.flowing
    elastic = (rest.residual[:, None] - residuals(rest.du, h)) / h
    values, modes = scipy.linalg.eig(tangent, elastic)
    return equations, trial, values, modes


@pytest.mark.parametrize("viscosity", [0.0, 0.02])
def test_the_least_stable_mode_is_that_of_dense_eigenvalues(pencil, viscosity):
    """Those of the ground itself, with whatever viscosity its state was found."""
    equations, trial, values, modes = pencil
    near = np.argsort(np.abs(viscosity + (1.0 - viscosity) * values))[:4]
    least = near[np.argmin(values[near].real)]
    assert values[least].real < 0.0
    viscous = equations.viscous(viscosity)
    band = band_at(viscous, viscous.at(trial.du))
    assert band is not None
    expected = equations.spread(modes[:, least].real)
    cosine = expected @ band.mode / np.linalg.norm(expected) / np.linalg.norm(band.mode)
    assert abs(cosine) > 1.0 - 1e-5
    assert np.abs(band.mode).max() == pytest.approx(1.0)
    strain = equations.operators.strain(expected)
    held = np.einsum("sm,sm,m->m", strain, strain, equations.volume)
    most = held.argsort()[::-1]
    assert held[most[: band.points]].sum() >= 0.5 * held.sum()
    assert held[most[: band.points - 1]].sum() < 0.5 * held.sum()
    assert band.points < band.yielding / 4
    assert band.yielding == 144


def test_associated_flow_is_stable(monkeypatch):
    equations, trial = sheared(monkeypatch, PHI)
    assert band_at(equations, trial) is None
