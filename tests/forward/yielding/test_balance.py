"""Equilibrium where ground yields: the potential, and what is left of a load."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement
from support.derivatives import assert_exact
from support.tunnels import walled
from support.yielding import NOTHING, Cavity, mohr, parameters, rock

from geoident.forward.analysis import equilibrium, plastic_step, viscous_path
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.stage_equations import StageEquations
from geoident.model.case import Stage
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam

CAVITY = Cavity()


def equations_of_lined_stage(monkeypatch: pytest.MonkeyPatch) -> tuple[StageEquations, np.ndarray]:
    """The equations of the stage in which the lining is loaded, and their solution."""
    seen, solved = [], plastic_step.solve

    def kept(equations, *args, **kwargs):
        balance = solved(equations, *args, **kwargs)
        seen.append((equations, balance.trial.du))
        return balance

    monkeypatch.setattr(plastic_step, "solve", kept)
    lining = Beam("wall", EA=Scalar(5e9), EI=Scalar(1e6), clamped_on=("x0", "y0"))
    stages = (
        Stage("open", excavate=("core",), release={"core": Scalar(0.7)}),
        Stage("line", build=("lining",), release={"core": Scalar(0.9)}),
        Stage("load", release={"core": Scalar(1.0)}),
    )
    mesh = walled("quad8", n=2, layers=8, radius=CAVITY.radius, reach=6)
    staged = CAVITY.staged(mesh, mohr(3e6, 0.5), stages=stages, structures={"lining": lining})
    assert len(list(staged.at(NOTHING).states())) == 4
    return seen[-1]


def test_residual_is_the_slope_of_the_potential(monkeypatch):
    """By differences, with ground that yields and a lining that bears already."""
    equations, solution = equations_of_lined_stage(monkeypatch)
    rng, size = np.random.default_rng(1), np.abs(solution).max()
    for _ in range(5):
        du, step = np.zeros_like(solution), np.zeros_like(solution)
        du[equations.dofs], step[equations.dofs] = rng.normal(size=(2, len(equations.dofs)))
        at = solution + 0.3 * size * du
        h = 1e-4 * size
        change = equations.distance(equations.at(at + h * step))
        change -= equations.distance(equations.at(at - h * step))
        trial = equations.at(at)
        assert trial.flowing
        slope = -trial.residual @ step[equations.dofs]
        assert change / (2 * h) == pytest.approx(slope, rel=1e-5)


def test_potential_is_lowest_at_equilibrium(monkeypatch):
    equations, solution = equations_of_lined_stage(monkeypatch)
    lowest = equations.distance(equations.at(solution))
    rng = np.random.default_rng(2)
    for size in (1e-2, 1e-1, 1.0):
        other = solution.copy()
        other[equations.dofs] += (
            size * np.abs(solution).max() * rng.normal(size=len(equations.dofs))
        )
        assert equations.distance(equations.at(other)) > lowest


@pytest.mark.parametrize("balanced", [True, False])
def test_what_is_left_of_a_load_is_the_largest_force_out_of_balance(monkeypatch, balanced):
    """Flow without dilation under friction of 45 degrees: Newton's steps are lost among bands.

    The path of viscous grounds leads on; where it is cut off, what is left is said.
    """
    if not balanced:
        monkeypatch.setattr(viscous_path, "_POWERS", ())
        monkeypatch.setattr(equilibrium, "_LITTLE_VISCOUS", 0.0)
        monkeypatch.setattr(viscous_path, "_FIRST", 2e-3)
    mesh = CAVITY.mesh("tri6", n=3, layers=10, reach=8)
    staged, again = (CAVITY.staged(mesh, mohr(1e6, np.pi / 4, psi=0.0)) for _ in range(2))
    run = staged.at(NOTHING, RunOptions(derivatives=False))
    stresses = [end.stress.copy() for end in run.states()]
    system, points = staged.analysis.systems[1], staged.discretization.points
    forces = staged.analysis.actions.forces(1, run.point)
    out_of_balance = [
        np.abs((forces - points.forces(stress, system.volume))[system.pattern.dofs]).max()
        for stress in stresses
    ]
    part = out_of_balance[1] / out_of_balance[0]
    notes = [n for n in again.survey(NOTHING, fields=False).notes if "not balanced" in n]
    if balanced:
        assert run.findings.plastic.unbalanced == {}
        assert part < 1e-8
        assert notes == []
    else:
        assert run.findings.plastic.unbalanced == {"open": pytest.approx(part, rel=1e-6)}
        assert part > 1e-4
        expected = f"at stage 'open' {100 * part:.2g} % of the change of load is not balanced:"
        assert [note.startswith(expected) for note in notes] == [True]


def only_one_step(monkeypatch, mu):
    """Ground that keeps a part mu of its overstress is all that the path has."""
    monkeypatch.setattr(viscous_path, "_POWERS", ())
    monkeypatch.setattr(viscous_path, "_FIRST", mu)
    monkeypatch.setattr(equilibrium, "PATIENCE", 0)


def test_where_the_even_flow_folds_back_the_rest_of_the_overstress_is_said(monkeypatch):
    only_one_step(monkeypatch, 1e-3)
    mesh = CAVITY.mesh("tri6", n=3, layers=10, reach=8)
    staged = CAVITY.staged(mesh, mohr(1e6, np.pi / 4, psi=0.0))
    run = staged.at(NOTHING, RunOptions(derivatives=False))
    _, end = run.states()
    system, points = staged.analysis.systems[1], staged.discretization.points
    forces = staged.analysis.actions.forces(1, run.point)
    rest = (forces - points.forces(end.stress, system.volume))[system.pattern.dofs]
    assert np.abs(rest).max() < 1e-7 * np.abs(forces).max() + 1e-7 * 30e6  # all of it is carried
    assert run.findings.plastic.unbalanced == {}
    assert run.findings.plastic.overstressed == {"open": 1e-3}
    assert run.findings.plastic.localising["open"].part == pytest.approx(1.0, abs=0.2)
    (note,) = (n for n in staged.survey(NOTHING, fields=False).notes if "keeps" in n)
    assert note.startswith("at stage 'open' the ground keeps 0.1 % of the stress beyond the yield")
    assert "the acoustic tensor has no positive determinant at 1" in note
    bands = run.findings.plastic.localising["open"]
    assert f"(motions are short by {100 * bands.short:.1g} % of the largest" in note
    where = f"{100 * bands.part:.0f} % of the strain points that yield"
    band = f", and {bands.band}" if bands.band else ""
    assert note.endswith(f"at {where}{band}. A larger dilation (or associated flow) has an exact "
                         "solution")  # fmt: skip


def test_derivatives_with_a_rest_of_overstress_are_exact(monkeypatch):
    only_one_step(monkeypatch, 2e-3)
    ground = rock(Scalar(1.0, "E"), CAVITY.nu, mohr(Scalar(1.0, "c"), Scalar(1.0, "phi"), psi=0.0))
    mesh = CAVITY.mesh("quad8", n=2, layers=10, reach=8)
    stages = (
        Stage("half", excavate=("core",), release={"core": Scalar(0.8)}),
        Stage("whole", release={"core": Scalar(1.0)}),
    )
    staged = CAVITY.staged(
        mesh,
        parameters=parameters(E=CAVITY.E, c=3e6, phi=0.5),
        materials={"rock": ground},
        channels=(displacement("wall", (1.0, 0.0), (1.0, 0.0)),),
        stages=stages,
    )
    pairs = [("wall", "half"), ("wall", "whole")]
    assert_exact(
        staged.response(pairs), np.array([CAVITY.E, 3e6, 0.5]), ("E", "c", "phi"),
        step=1e-4, rtol=1e-5,
    )  # fmt: skip


def test_what_has_yielded_stays_so_in_later_fields():
    mesh = CAVITY.mesh("quad8", n=2, layers=8, reach=6)
    stages = (Stage("open", excavate=("core",)), Stage("rest"))
    staged = CAVITY.staged(mesh, mohr(3e6, 0.5), stages=stages)
    yielded = staged.survey(NOTHING, fields=True).fields.yielded
    assert yielded[1].any()
    np.testing.assert_array_equal(yielded[2], yielded[1])
