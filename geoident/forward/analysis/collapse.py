"""Collapse: how much of a stage's change of load is carried (`collapse_message` says it).

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

Non-associated flow has no such arc: there t is found by halving.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.forward.analysis.equilibrium import LARGE_STRAIN, follow_slope, solve
from geoident.forward.analysis.stage_equations import (
    ELASTIC_PARTS,
    Iterate,
    NoEquilibrium,
    StageEquations,
)
from geoident.forward.analysis.viscous_path import StepBudget
from geoident.model.arrays import Floats

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

_MOST_ON_ARC = 2000
"""Newton steps of an arc that explains a collapse; no arc of the tests comes near."""

_ON_SURFACE = 1e-9
"""Relative error of the prescribed measure alpha of the displacements that is rounding."""

_FIRST_MEASURE = 0.25
"""alpha at which the arc begins, as part of that of the elastic answer to the whole load."""

_RESOLUTION = 1 / 512
"""To which the part of a load that is carried is known with non-associated flow."""

_PARTS = 80
"""Newton steps for the part that could be balanced, where collapse is not proven."""


@dataclass(frozen=True)
class CarriedPart:
    """The part of a stage's change of load that is carried.

    Args:
        fraction: t, at most 1.
        end: equilibrium under it; None where only t = 0 was brought to equilibrium.
        failure: how more of it fails; proven where the arc reached a limit load.
    """

    fraction: float
    end: Iterate | None
    failure: NoEquilibrium


def carried_part(
    equations: StageEquations, failure: NoEquilibrium, most_steps: int = _MOST_ON_ARC
) -> CarriedPart:
    """The largest part of the change of load of a stage that can be carried.

    Args:
        equations: of the stage.
        failure: how the whole load fails.
        most_steps: Newton steps after which an arc counts as lost.
    """
    if equations.associated:
        return _end_of_arc(equations, failure, StepBudget(most_steps))
    return _halved(equations, failure)


def collapses(equations: StageEquations, most_steps: int) -> bool:
    """Whether associated ground is proven to collapse.

    Args:
        equations: of the stage, with associated flow.
        most_steps: Newton steps after which an arc counts as lost.
    """
    try:
        solve(equations, [np.zeros_like(equations.forces)])
    except NoEquilibrium as failure:
        return failure.proven or carried_part(equations, failure, most_steps).failure.proven
    return False


def _end_of_arc(
    equations: StageEquations, failure: NoEquilibrium, budget: StepBudget
) -> CarriedPart:
    """Where the arc ends: at the whole load, at a limit load, or where it is lost."""
    unloaded = equations.under(equations.carried_forces())
    load = (equations.forces - unloaded.forces)[equations.dofs]
    start = unloaded.at(np.zeros_like(equations.forces))
    compliance = float(load @ unloaded.tangent(start).solve(load))
    alpha, growth, reached = _FIRST_MEASURE * compliance, 2.0, 0.0
    t, du, is_limit = 0.0, start.du, True
    flow, unknown = failure.mechanism, failure.mechanism is None or not failure.mechanism.any()
    while alpha <= 2.0**_MOST_DOUBLINGS * compliance:
        following = _controlled(unloaded, load, alpha, t, du, budget)
        if following is None:
            if growth < _LEAST_GROWTH or not reached:
                is_limit = False
                break
            growth = float(np.sqrt(growth))
            alpha = growth * reached
            continue
        t_next, du_next = following
        if unknown:
            flow = du_next - du
        softer = alpha > _SOFTER * compliance * t_next
        if softer and unloaded.largest_strain(du_next).max() > LARGE_STRAIN:
            break
        if t_next >= 1.0:
            t, du, is_limit = 1.0, du_next, False
            break
        grown = t_next - t
        if grown > 0.0:
            t, du = following
        if alpha > compliance and grown <= _STANDS_STILL * t * np.log2(growth):
            break
        reached, growth = alpha, min(growth**2, 2.0)
        alpha *= growth
    proven = failure.proven or is_limit
    return CarriedPart(t, equations.at(du), NoEquilibrium(flow, proven=proven))


def _controlled(
    unloaded: StageEquations,
    load: Floats,
    alpha: float,
    t: float,
    du: Floats,
    budget: StepBudget,
) -> tuple[float, Floats] | None:
    """Load factor t and displacements (n_dofs,) at a measure alpha of these; None if not found.

    Steps on the surface of alpha follow the slope of the potential there; f - f_0 does no work on
    them.

    Args:
        unloaded: the equations under f_0.
        load: f - f_0 (n,) at the unknowns.
        alpha: the measure.
        t: load factor of the last equilibrium.
        du: (n_dofs,) its displacements.
        budget: steps that are left to the whole arc.
    """
    dofs, iterate = unloaded.dofs, unloaded.at(du)
    for _ in range(_MOST_STEPS):
        unbalanced = iterate.residual + t * load
        short = alpha - float(load @ iterate.du[dofs])
        on_surface = abs(short) <= _ON_SURFACE * alpha
        scale = max(iterate.scale, abs(t) * float(np.abs(load).max()))
        if on_surface and np.abs(unbalanced).max() <= _BALANCED * scale:
            return t, iterate.du
        if not budget.take():
            return None
        tangent = unloaded.tangent(iterate, least=ELASTIC_PARTS[1])  # flowing ground is singular
        free, ahead = tangent.factor.solve(np.column_stack([unbalanced, load])).T
        step = unloaded.spread(free + (short - load @ free) / (load @ ahead) * ahead)
        end = unloaded.at(iterate.du + step)
        iterate = follow_slope(unloaded, iterate, step, end)[0] if on_surface else end
        t = -float(iterate.residual @ load) / float(load @ load)
    return None


def _halved(equations: StageEquations, failure: NoEquilibrium) -> CarriedPart:
    """The part that is carried by non-associated flow.

    Where no collapse is proven only diffuse flow is looked for, with few steps: each part beyond
    the last would be lost where the whole is.
    """
    strict = not failure.proven
    budget = StepBudget(_PARTS) if strict else None
    f_0, iterate = equations.carried_forces(), None
    at_rest = np.zeros_like(f_0)
    least, most = 0.0, 1.0
    while most - least > _RESOLUTION and (budget is None or budget.left > 0):
        part = 0.5 * (least + most)
        under = equations.under(f_0 + part * (equations.forces - f_0))
        starts = [at_rest, at_rest if iterate is None else iterate.du]
        try:
            balance = solve(under, starts, strict=strict, budget=budget, most_strain=LARGE_STRAIN)
            least, iterate = part, balance.end
        except NoEquilibrium as error:
            most = part
            if error.mechanism is not None and (error.proven or not failure.proven):
                failure = error
    return CarriedPart(least, iterate, failure)
