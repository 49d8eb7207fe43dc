"""Collapse: how much of a stage's change of load is carried, how the ground moves, what is said.

The arc of equilibria is followed under displacement control: the forces f_0 + t (f - f_0), with f_0
those of the stage before, act, and the load factor t follows from a prescribed work-like measure
of the displacements,

    C^T V P(sigma_old + E C du) = f_0 + t (f - f_0) ,      (f - f_0)^T du = alpha .

t grows with alpha towards the limit load (Cermak, Haslinger, Kozubek, Sysala 2015, "Discretization
and numerical realization of contact problems for elastic-perfectly plastic bodies", part II). Given
alpha the problem is convex again and has a solution. alpha is doubled until t stands still, or 1
is reached; where Newton's method does not get there, it grows by less. Meshes that lock under flow
without change of volume have no limit load (Nagtegaal, Parks, Rice 1974, Comput. Methods Appl.
Mech. Eng. 4): there the arc ends where the ground has become ten thousand times softer and its
strains large.

Flow without potential has no such arc: there t is found by halving.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.errors import CollapseError
from geoident.fem.location import format_point
from geoident.forward.analysis.bands import ShearBand
from geoident.forward.analysis.equilibrium import LARGE_STRAIN, follow_slope, solve
from geoident.forward.analysis.stage import LastEquilibrium, StageTask
from geoident.forward.analysis.stage_equations import (
    ELASTIC_PARTS,
    Balance,
    NoEquilibrium,
    StageEquations,
    Trial,
)
from geoident.forward.analysis.systems import StageSystem
from geoident.forward.analysis.viscous_path import StepBudget
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.results.yielded import Mechanism

_BALANCED = 1e-7
"""Unbalanced force, of the largest, at which a prescribed displacement is in equilibrium."""

_STANDS_STILL = 2e-4
"""Relative growth of t over a doubling of the displacement that counts as the limit."""

_SOFTER = 1e4
"""How much softer than elastic the ground is when it counts as flowing, at large strains."""

_MOST_DOUBLINGS = 24
"""Of the elastic displacement: far beyond, where `_SOFTER` and `LARGE_STRAIN` end the search."""

_LEAST_GROWTH = 1.05
"""Of the displacement, from one equilibrium to the next: the search ends below it."""

_MOST_STEPS = 40
"""Of Newton at one displacement; where it converges, it takes 5 to 15."""

_RESOLUTION = 1 / 512
"""To which the part of a load that is carried is known where there is no potential."""

_PARTS = 80
"""Newton steps for the part that could be balanced, where collapse is not proven."""

_HALF = 0.5
"""Part of the largest rate of shear from which on a mechanism shears strongly."""


@dataclass(frozen=True)
class CarriedPart:
    """The part of a stage's change of load that is carried.

    Args:
        fraction: t, at most 1.
        trial: equilibrium under it; None where only t = 0 was brought to equilibrium.
        error: how more of it fails.
    """

    fraction: float
    trial: Trial | None
    error: NoEquilibrium


def carried_part(equations: StageEquations, error: NoEquilibrium) -> CarriedPart:
    """The largest part of the change of load of a stage that can be carried.

    Args:
        equations: of the stage.
        error: how the whole load fails.
    """
    if equations.associated:
        fraction, du = _end_of_arc(equations)
        return CarriedPart(fraction, equations.at(du), error)
    return _halved(equations, error)


def _end_of_arc(equations: StageEquations) -> tuple[float, Floats]:
    """Load factor t, at most 1, and displacement step (n_dofs,) where the arc ends."""
    before = equations.under(equations.before())
    load = (equations.forces - before.forces)[equations.dofs]
    rest = before.at(np.zeros_like(equations.forces))
    compliance = float(load @ before.tangent(rest).solve(load))
    alpha, growth, reached = 0.25 * compliance, 2.0, 0.0
    t, du = 0.0, rest.du
    while alpha <= 2.0**_MOST_DOUBLINGS * compliance:
        following = _controlled(before, load, alpha, t, du)
        if following is None:
            if growth < _LEAST_GROWTH or not reached:
                break
            growth = float(np.sqrt(growth))
            alpha = growth * reached
            continue
        t_next, du_next = following
        softer = alpha > _SOFTER * compliance * t_next
        if softer and np.abs(before.operators.strain(du_next)).max() > LARGE_STRAIN:
            break
        if t_next >= 1.0:
            return 1.0, du_next
        grown = t_next - t
        if grown > 0.0:
            t, du = following
        if alpha > compliance and grown <= _STANDS_STILL * t * np.log2(growth):
            break
        reached, growth = alpha, min(growth**2, 2.0)
        alpha *= growth
    return t, du


def _controlled(
    before: StageEquations, load: Floats, alpha: float, t: float, du: Floats
) -> tuple[float, Floats] | None:
    """Load factor t and displacements (n_dofs,) at a measure alpha of these; None if not found.

    Steps on the surface of alpha follow the slope of the potential there; f - f_0 does no work on
    them.

    Args:
        before: the equations under f_0.
        load: f - f_0 (n,) at the unknowns.
        alpha: the measure.
        t: load factor of the last equilibrium.
        du: (n_dofs,) its displacements.
    """
    dofs, trial = before.dofs, before.at(du)
    for _ in range(_MOST_STEPS):
        rest = trial.residual + t * load
        short = alpha - float(load @ trial.du[dofs])
        on_surface = abs(short) <= 1e-9 * alpha
        scale = max(trial.scale, abs(t) * float(np.abs(load).max()))
        if on_surface and np.abs(rest).max() <= _BALANCED * scale:
            return t, trial.du
        tangent = before.tangent(trial, least=ELASTIC_PARTS[1])  # flowing ground is singular
        free, ahead = tangent.factor.solve(np.column_stack([rest, load])).T
        step = before.spread(free + (short - load @ free) / (load @ ahead) * ahead)
        end = before.at(trial.du + step)
        trial = follow_slope(before, trial, step, end)[0] if on_surface else end
        t = -float(trial.residual @ load) / float(load @ load)
    return None


def _halved(equations: StageEquations, error: NoEquilibrium) -> CarriedPart:
    """The part that is carried by flow without potential.

    Where no collapse is proven only even flow is looked for, with few steps: each part beyond the
    last would be lost where the whole is.
    """
    even_only = not error.proven
    budget = StepBudget(_PARTS) if even_only else None
    before, trial = equations.before(), None
    rest = np.zeros_like(before)
    least, most = 0.0, 1.0
    while most - least > _RESOLUTION and (budget is None or budget.left > 0):
        part = 0.5 * (least + most)
        under = equations.under(before + part * (equations.forces - before))
        starts = [rest, rest if trial is None else trial.du]
        try:
            balance = solve(
                under, starts, even_only=even_only, budget=budget, most_strain=LARGE_STRAIN
            )
            least, trial = part, balance.trial
        except NoEquilibrium as failed:
            most = part
            if failed.mechanism is not None and (failed.proven or not error.proven):
                error = failed
    return CarriedPart(least, trial, error)


def collapse_error(
    on_mesh: CaseOnMesh,
    task: StageTask,
    fraction: float,
    mechanism: Floats | None,
    *,
    proven: bool = True,
    ended: Balance | None = None,
    band: ShearBand | None = None,
    reached: LastEquilibrium | None = None,
) -> CollapseError:
    """What is said of a stage without equilibrium.

    Args:
        on_mesh: the case on its mesh.
        task: the stage.
        fraction: part of the change of load that is carried, or NaN.
        mechanism: (n_dofs,) how the ground moves, or None.
        proven: whether the load is beyond what can be carried; else none was found.
        ended: where the even flow ended, or None.
        band: the mode that has lost its stability there, or None.
        reached: equilibrium under the part that is carried, or None.
    """
    msg = f"at stage '{task.state.name}' the ground cannot carry the loads: plastic collapse"
    hint = "Raise the strengths (their start values or bounds), or see whether the stage "
    hint += "lacks support or loads more than is meant."
    if not proven:
        msg = f"at stage '{task.state.name}' no equilibrium was found: flow with a dilation so "
        msg += "far below the friction shears in bands on this mesh, or the ground collapses"
        hint = "See whether a larger dilation, or associated flow, or larger elements "
        hint += "where it shears carry the stage: then the ground does not lack strength."
    if band is not None and ended is not None and not proven:
        mechanism = band.mode
        msg = f"at stage '{task.state.name}' no equilibrium was found: even flow ends where the "
        msg += f"ground still keeps {100 * ended.viscosity:.2g} % of its overstress, and a band "
        msg += f"has lost its stability, with half of its strain in {band.points} of the "
        msg += f"{band.yielding} strain points that yield"
        hint = "With a dilation so far below the friction, shear goes into bands as wide as the "
        hint += "elements. See whether support that acts in this stage, a larger dilation, or "
        hint += "larger elements where it shears carry it: then it does not lack strength."
    if np.isfinite(fraction):
        carried = "is carried" if proven else "was brought to equilibrium"
        msg += f"; {100 * fraction:.3g} % of the change of load of this stage {carried}"
    motion = None
    if mechanism is not None:
        msg += describe_mechanism(on_mesh, task.system, mechanism)
        mechanism = mechanism / (np.abs(mechanism).max() or 1.0)
        motion = mechanism_on_mesh(on_mesh, task, mechanism, fraction)
    return CollapseError(
        msg,
        hint,
        stage=task.state.name,
        fraction=fraction,
        mechanism=mechanism,
        motion=motion,
        reached=reached,
    )


def describe_mechanism(on_mesh: CaseOnMesh, system: StageSystem, u: Floats) -> str:
    """Where a mechanism shears most, and how far it reaches, for a message.

    Args:
        on_mesh: the case on its mesh.
        system: the equations of the stage.
        u: (n_dofs,) velocities.
    """
    points, mesh, sequence = on_mesh.discretization.points, on_mesh.mesh, on_mesh.sequence
    rate = np.where(system.volume > 0.0, _shear(points.strain(u)), 0.0)
    most = int(np.argmax(rate))
    if not rate[most] > 0.0:
        node = int(np.argmax(np.linalg.norm(u.reshape(-1, mesh.dim), axis=1)))
        return f" near {format_point(mesh.points[node])}"
    group = sequence.groups[sequence.group_of[points.element[most]]]
    position = points.position.round(3)
    where = position[rate > _HALF * rate[most]]
    text = f"; it shears most in group '{group}' near {format_point(position[most])}"
    ends = (format_point(where.min(axis=0)), format_point(where.max(axis=0)))
    return f"{text}, and strongly between {ends[0]} and {ends[1]}"


def mechanism_on_mesh(
    on_mesh: CaseOnMesh, task: StageTask, u: Floats, fraction: float
) -> Mechanism:
    """A mechanism as it is drawn.

    Args:
        on_mesh: the case on its mesh.
        task: the stage.
        u: (n_dofs,) velocities.
        fraction: part of the change of load that is carried.
    """
    points, mesh = on_mesh.discretization.points, on_mesh.mesh
    rate = np.where(task.system.volume > 0.0, _shear(points.strain(u)), 0.0)
    shear = np.zeros(mesh.n_elements)
    np.maximum.at(shear, points.element, rate)
    return Mechanism(
        task.state.name,
        task.number,
        fraction,
        mesh,
        on_mesh.sequence.present(task.number),
        u.reshape(mesh.n_nodes, mesh.dim).copy(),
        shear / (shear.max(initial=0.0) or 1.0),
    )


def _shear(strain: Floats) -> Floats:
    """(m,) size of the part of strains (s, m) that changes shapes; shears are counted double."""
    normal, shear = strain[:3], strain[3:]
    apart = normal - normal.mean(axis=0)
    return np.asarray(np.sqrt((apart**2).sum(axis=0) + 0.5 * (shear**2).sum(axis=0)))
