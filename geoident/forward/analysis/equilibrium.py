"""Equilibrium of one stage with yielding points: a semismooth Newton method (theory 5).

The displacements du of a stage minimise

    Pi(du) = sum_i V_i w(sigma_old + E C du)_i  -  f^T du ,

where w is half the square of the elastic trial stress less that of its distance to the yield
surface, in the norm of E^-1. Pi is convex and once differentiable; with the projection P

    r = -grad Pi = f - C^T V P(sigma_old + E C du) = 0 .

Newton's method takes the consistent tangent K_T = C^T V T E C as derivative of P. Polyhedra make P
piecewise linear, so it ends, exactly, once the pieces are found; along each step the slope of Pi
is followed to near its zero, which makes it converge from everywhere. Where K_T is singular, a
little of the elastic stiffness is left in it.

In a large model a few places, corners mostly, are far from equilibrium long after all else is near:
a step that is right for the ground around is then far too long there. So the worst places after a
step are brought to equilibrium by themselves, all else kept (`fem.patches`): nonlinear elimination
(Lanzkron, Rose & Wilkes 1996, SIAM J. Sci. Comput. 17, 538-559). It lowers Pi, and takes factors of
a few hundred unknowns.

A load beyond collapse has no minimum: Pi falls without end along a mechanism d. That is found
by the slope of Pi far out along the steps (the kinematic theorem of limit analysis): if it is
still falling there, d dissipates less than the loads give, and no equilibrium exists.

In a part of a step in time pressures p of water are unknown as well (theory 18.6):

    r_u = f + Q p - C^T V sigma = 0 ,    r_p = w + Q^T du + C p = 0 ,    C = S + h H .

With p eliminated by the second, which is linear, Pi + (w + Q^T du)^T C^-1 (w + Q^T du) / 2 is again
convex. The first step is taken as a whole, after which r_p = 0; steps keep that, and r_u^T d is
the slope of the potential without its elimination. So all of the above holds.

Non-associated flow has no potential; its steps are judged by the next ones, and where they are
lost in ground a path of viscous grounds leads to the solution (`viscous_path`).

Cost: one factorization for every step, one for the derivatives if the last was made elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from geoident.fem.yielding.domain import EmptyDomain, NoProjection
from geoident.forward.analysis.balanced_overstress import ROUGH, SOUND, diffuse_flow, unbalanced
from geoident.forward.analysis.line_search import HARDLY_RISEN, zero_along
from geoident.forward.analysis.stage_equations import (
    Balance,
    Iterate,
    NoEquilibrium,
    Patches,
    StageEquations,
    Tangent,
)
from geoident.forward.analysis.viscous_path import (
    BALANCED,
    NO_LOWER,
    StepBudget,
    first_points,
    follow_path,
    newton,
)
from geoident.model.arrays import Floats

LARGE = 10_000
"""Unknowns from which on a factorization costs more than a few places solved by themselves."""

MOST_STEPS = 60
"""Newton steps at most; a stage rarely takes more than fifteen."""

PATIENCE = 10
"""Newton steps after which non-associated flow of ground takes the path of viscous grounds.

Newton's method that wanders longer may end in bands of shear although there is a diffuse flow.
"""

LARGE_STRAIN = 1.0
"""Strain of yielding points in one stage beyond which small strains describe nothing.

Meshes that lock under flow without change of volume let pressures grow without end: where all else
flows, Newton's method finds equilibria kilometres away (Nagtegaal, Parks, Rice 1974).
"""

_SUSPICIOUS = 4
"""Steps after which a mechanism is looked for; most stages have converged by then."""

SEARCH = 120
"""Newton steps along the path of viscous grounds: the hardest known that ends well takes 105."""

_HARDLY_VISCOUS = 3e-4
"""Part of the overstress that may stay where only diffuse flow counts (`strict`)."""

FAR_OUT = 1e6
"""Steps along a mechanism after which only its dissipation counts, no more the elastic strains."""

_NO_POWER = 1e-6
"""Part of the power of the loads on a mechanism that the slope of Pi far out must exceed."""

_QUICK = 0.1
"""Part of the out-of-balance force that a good step leaves."""

_WORST = (0.03, 0.1, 0.3)
"""Parts of the largest out-of-balance force from which on places are solved by themselves."""

_PATCH = 0.1
"""Part of the unknowns that they are at most."""

_PATCH_STEPS = 10
"""Newton steps there at most."""

_SETTLED = 1e-3
"""Part of the out-of-balance force that is left there."""


def solve(
    equations: StageEquations,
    guesses: Iterable[Floats],
    *,
    strict: bool = False,
    budget: StepBudget | None = None,
    at_start: float = BALANCED,
    most_strain: float = np.inf,
    most_steps: int = MOST_STEPS,
) -> Balance:
    """The equilibrium of a stage.

    Args:
        equations: of the stage.
        guesses: (n_dofs,) displacement steps; the nearest one is the start (`distance`).
        strict: of non-associated flow only the diffuse one (not localised in bands) counts.
        budget: steps that are left where there is no potential; None for a search of its own.
        at_start: out-of-balance force up to which the start is in equilibrium.
        most_strain: of yielding points in this stage; an equilibrium beyond it counts as none.
        most_steps: Newton steps where there is a potential.

    Raises:
        NoEquilibrium: see there.
        NotPositiveDefinite: the elastic stiffness itself is singular.
    """
    start = _nearest(equations, guesses)
    if equations.associated:
        balance = _minimise(equations, start, at_start, most_steps)
    else:
        budget = budget or StepBudget(SEARCH)
        balance = _non_associated(equations, start, budget, at_start, strict=strict)
    if overstrained(equations, balance.end, most_strain):
        raise NoEquilibrium(balance.end.du)
    return balance


def overstrained(equations: StageEquations, end: Iterate, most: float) -> bool:
    """Whether points that yield have a strain beyond a limit."""
    strain = equations.largest_strain(end.du)
    return any(strain[response.points].max() > most for response in end.flowing)


def _nearest(equations: StageEquations, guesses: Iterable[Floats]) -> Iterate:
    """The guess nearest to equilibrium, of those whose stresses can be returned.

    An extrapolated guess may be far outside the yield surface where another one serves.

    Raises:
        NoEquilibrium, NoProjection, EmptyDomain: of the last guess, where none can be.
    """
    iterates, failure = [], None
    for guess in guesses:
        try:
            iterates.append(equations.at(guess))
        except (NoEquilibrium, NoProjection, EmptyDomain) as error:
            failure = error
    if not iterates and failure is not None:
        raise failure
    return min(iterates, key=equations.distance)


def _minimise(
    equations: StageEquations, iterate: Iterate, at_start: float, most_steps: int
) -> Balance:
    """Newton's method for the minimum of Pi.

    Raises:
        NoEquilibrium: Pi falls without end, or no minimum was found.
    """
    tangent: Tangent | None = None
    for step in range(most_steps):
        if iterate.imbalance <= (at_start if tangent is None else BALANCED):
            return Balance(_refined(equations, iterate, tangent), tangent)
        tangent = equations.tangent(iterate)
        d = equations.spread(tangent.solve(iterate.residual))
        if equations.n_pressures and not step:
            following, whole = equations.at(iterate.du + d), False
        else:
            following, whole = _step(equations, iterate, d)
        if following.imbalance >= iterate.imbalance and iterate.imbalance <= NO_LOWER:
            return Balance(iterate, tangent)
        if whole and step >= _SUSPICIOUS:
            _refuse_mechanism(equations, following, d)
        iterate = following
    if iterate.imbalance <= BALANCED:
        return Balance(iterate, tangent)
    raise NoEquilibrium(iterate.du)


def _refined(equations: StageEquations, iterate: Iterate, tangent: Tangent | None) -> Iterate:
    """One more step with the same factor where structures yield.

    Their forces are the largest at work: balance relative to them leaves soft ground a millionth
    off.
    """
    if tangent is None or equations.of_ground.all():
        return iterate
    last = equations.at(iterate.du + equations.spread(tangent.solve(iterate.residual)))
    return last if last.imbalance < iterate.imbalance else iterate


def _step(equations: StageEquations, iterate: Iterate, d: Floats) -> tuple[Iterate, bool]:
    """Follow a step d (n_dofs,), in a large model with its worst places settled by themselves.

    Returns:
        Where it ended, and whether the whole step was taken.
    """
    end = equations.at(iterate.du + d)
    quick = end.imbalance <= _QUICK * iterate.imbalance
    if equations.patches is not None and len(equations.dofs) >= LARGE and not quick:
        settled = _settled(equations, equations.patches, end)
        if settled is not None and _hardly_risen(equations, iterate, settled):
            return settled, True
    return follow_slope(equations, iterate, d, end)


def follow_slope(
    equations: StageEquations, iterate: Iterate, d: Floats, end: Iterate
) -> tuple[Iterate, bool]:
    """Follow a step to near the zero of the slope of Pi, which is monotone.

    A whole step at whose end Pi still falls, or has hardly risen, is taken as it is.

    Args:
        equations: of the stage.
        iterate: where the step begins.
        d: (n_dofs,) the step.
        end: where the whole step ends.

    Returns:
        Where it ended, and whether the whole step was taken.
    """
    if _hardly_risen(equations, iterate, end):
        return end, True
    free = d[equations.dofs]

    def at(share: float) -> Iterate:
        return equations.at(iterate.du + share * d)

    def descent(there: Iterate) -> float:
        return float(there.residual @ free)

    return zero_along(at, descent, descent(iterate), descent(end)), False


def _hardly_risen(equations: StageEquations, iterate: Iterate, end: Iterate) -> bool:
    """Whether Pi falls on the way to another iterate, and has hardly turned to rise at its end."""
    way = (end.du - iterate.du)[equations.dofs]
    descent = float(iterate.residual @ way)
    return descent > 0.0 and float(end.residual @ way) >= -HARDLY_RISEN * descent


def _settled(equations: StageEquations, patches: Patches, iterate: Iterate) -> Iterate | None:
    """The same with the places that are farthest from equilibrium brought there, all else kept.

    None where they are too many.
    """
    rest = np.abs(iterate.residual)
    worst, most = float(rest.max(initial=0.0)), int(_PATCH * rest.size)
    around = (patches.around(np.flatnonzero(rest > part * worst), most) for part in _WORST)
    patch = next((one for one in around if one is not None), None)
    if patch is None:
        return None
    own = equations.on_patch(patch, patches.solver(patch), iterate.du)
    local = own.at(iterate.du[patch.dofs])
    for _ in range(_PATCH_STEPS):
        if np.abs(local.residual).max() <= _SETTLED * worst:
            break
        local, _ = _step(own, local, own.spread(own.tangent(local).solve(local.residual)))
    du = iterate.du.copy()
    du[patch.dofs] = local.du
    return equations.at(du)


def _refuse_mechanism(equations: StageEquations, iterate: Iterate, d: Floats) -> None:
    """Raise where Pi falls without end along a step d (n_dofs,).

    Raises:
        NoEquilibrium: it does.
    """
    far, free = equations.at(iterate.du + FAR_OUT * d), d[equations.dofs]
    power = float(np.abs(equations.forces[equations.dofs] * free).sum())
    if float(far.residual @ free) > _NO_POWER * power:
        raise NoEquilibrium(d, proven=True)


def _non_associated(
    equations: StageEquations, start: Iterate, budget: StepBudget, at_start: float, *, strict: bool
) -> Balance:
    """Newton's method, and where its steps are lost, the path of viscous grounds.

    Where the diffuse flow folds back there are only bands of shear beyond, whose place is that of
    the elements. What then follows is `balanced_overstress`.

    Raises:
        NoEquilibrium: neither leads to an end; with the last equilibrium on the path.
    """
    ground = equations.ground_flows_aside
    most = PATIENCE if ground else MOST_STEPS
    direct = newton(equations, start, budget, at_start=at_start, most=most)
    if direct.converged:
        return direct
    if not (ground or start.du.any()):  # structures have no viscosity: all would be as it was
        raise NoEquilibrium(direct.end.du - start.du)
    points: list[Balance] = []
    flow: Balance | None = None
    for point in first_points(equations, budget):
        points.append(point)
        if len(points) == 1:
            continue
        flow = diffuse_flow(equations, point, budget) or flow
        if flow is not None and flow.viscosity == 0.0:
            return flow
        if flow is not None and not strict and flow.residual <= SOUND:
            return flow
    if not points:
        raise NoEquilibrium(direct.end.du - start.du)
    if flow is not None and not strict and flow.residual <= ROUGH:
        raise NoEquilibrium(flow.end.du, diffuse=flow)
    path = follow_path(equations, points[0], budget)
    last = path.balance
    if last.viscosity == 0.0:
        return last
    last = unbalanced(equations, last, path.promised)
    if path.runs_away is not None:
        raise NoEquilibrium(path.runs_away, diffuse=last, runs_away=True)
    if strict and last.viscosity <= _HARDLY_VISCOUS:
        return last
    raise NoEquilibrium(last.end.du, diffuse=last)
