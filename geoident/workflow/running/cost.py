"""What a case will cost in memory and time, told from the patterns of its stages."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from geoident.fem.refinement.finer import n_raised
from geoident.fem.solvers import AUTO, BEYOND, INDEFINITE, ITERATED, is_beyond, picked
from geoident.fem.solvers.factor_cost import FactorCost, factor_cost
from geoident.forward.analysis.march import MOST_KEPT
from geoident.forward.analysis.stages_in_time import moments_of, of_each_length, steps_of
from geoident.forward.model import StagedModel
from geoident.model.methods import (
    ClosedFormOptions,
    ComplementarityOptions,
    CondensationOptions,
    EnsembleSmootherOptions,
    GaussNewtonOptions,
    MethodOptions,
    ScanOptions,
    SimplexOptions,
    method_name,
)
from geoident.model.results.summary import CostEstimate

_FLOPS = {"pardiso": 90e9, "cholmod": 60e9, "splu": 3e9}
"""Multiplications and additions a second in a factorization: two cores of 2.5 GHz, measured."""

_BYTES = {"pardiso": 9.0, "cholmod": 8.0, "splu": 24.0}
"""Memory for an entry of the factor; splu keeps L and U with an index each."""

_ITERATED_BYTES = 40.0
"""Memory of conjugate gradients for each entry of the lower triangle: K twice, its levels."""

_PRODUCT_FLOPS = 2.5e9  # a second, in products with sparse matrices
_ITERATED_COLUMNS = 8  # right-hand sides in `ITERATED`
_SOLVE_FLOPS = 1.5e9  # a second, in the triangular solves, which wait for the memory
_MAKING_SECONDS = 3e-5  # an unknown of a finer mesh: its model, order and patterns
_POINT_SECONDS = 3e-7  # a strain point, stage and column: stresses, forces, their derivatives
_NEWTON_STEPS = 10  # a stage in which ground yields, from a start that is not near
_NEWTON_STEPS_IN_TIME = 2  # a part of a step in time: it begins with what the last one needed
_YIELD_SECONDS = 2.5e-6  # a strain point and Newton step: trial stresses to the yield surface
_HARDENING_STEPS = 35  # a stage of hardening soil: ten parts, three or four steps each
_HARDENING_STEPS_IN_TIME = 4  # a part of a step in time of it
_HARDENING_SECONDS = 4e-5  # a strain point and Newton step of it
_HARDENING_CALL = 1.2e-2  # a soil and Newton step of it, however few its points
_YIELD_BYTES = 7e3  # a strain point: tangents, projections, displacements of near parameters
_PORES = 1.3  # what pressures of water add to the entries and operations of a factor
_PORE_BYTES = 250.0  # an entry of K: the matrices of the water, beside their factor
_CREEP_SECONDS = 5.5e-7  # a strain point, part of a step and column: what creeps in it
_ANALYSIS_SECONDS = 1e-5  # an unknown: the matrix of water and creep, its order before each factor
_PROGRAM = 120e6  # bytes of Python and its libraries
_PATTERNS = 9  # values and places of the entries of K that are there at once, in patterns


def estimate_cost(
    model: StagedModel, *, solver: str, columns: float | None = None, rough: bool = False
) -> CostEstimate:
    """The cost of one evaluation: all stages with the derivatives, and the memory for it.

    The entries of the factors and the operations are exact counts, the seconds are those of the
    computer on which the rates were measured. Where ground yields, the Newton steps are a guess.

    Args:
        model: of the case.
        solver: name of the sparse solver, or ``auto``.
        columns: right-hand sides of a stage; None for one more than there are parameters.
        rough: every stage is taken for the one with most unknowns, which alone is counted.
    """
    costs = _like_the_largest(model) if rough else _stage_costs(model)
    columns = 1 + len(model.names) if columns is None else columns
    points = model.discretization.points.n_points
    steps = _NEWTON_STEPS if model.yields else 1
    steps = _HARDENING_STEPS if model.case.hardens else steps
    flops = steps * sum(c.flops for c in costs)
    entries = sum(c.entries for c in costs)
    most = max((c.flops for c in costs), default=0.0)
    in_time = [*_in_time(model, costs, columns)]
    largest = max((c.entries for c in costs), default=0)
    nonzeros = max((_nonzeros(model, n) for n in _states(model)), default=0)
    if solver == AUTO:
        solver = BEYOND if is_beyond(FactorCost(largest, most), nonzeros) else picked()
    if solver == BEYOND:
        flops = steps * len(costs) * ITERATED * nonzeros * columns / _ITERATED_COLUMNS
        seconds = flops / _PRODUCT_FLOPS
    else:
        seconds = flops / _FLOPS[solver] + 4.0 * entries * columns / _SOLVE_FLOPS
    seconds += _POINT_SECONDS * points * columns * len(costs)
    newton = steps * len(costs) + sum(stage.newton for stage in in_time)
    seconds += newton * _yield_seconds(model)
    seconds += sum(stage.seconds for stage in in_time)
    flops += sum(stage.flops for stage in in_time)
    solved = _ITERATED_BYTES * nonzeros if solver == BEYOND else largest * _BYTES[solver]
    memory = _PROGRAM + solved + _memory_beside(model, columns)
    memory += max((stage.memory for stage in in_time), default=0.0)
    marched = sum(stage.steps for stage in in_time)
    constant = newton * _yield_seconds(model, 0.0)
    yielding = model.case.what_yields
    return CostEstimate(
        solver, largest, flops, float(memory), seconds, steps, marched, constant, yielding
    )


def _yield_seconds(model: StagedModel, times: float = 1.0) -> float:
    """Of a Newton step: what yields returns to its limit, on a mesh of so many times the points."""
    points = times * model.discretization.points.n_points
    soils = sum(material.soil is not None for material in model.case.materials.values())
    if soils:
        return _HARDENING_CALL * soils + _HARDENING_SECONDS * points
    return _YIELD_SECONDS * points if model.yields else 0.0


class _InTime(NamedTuple):
    """What the steps in time of a stage cost, beyond one equilibrium.

    Args:
        steps: their number.
        flops: of their factorizations.
        seconds: estimate of the time.
        memory: bytes of the matrices and factors that it keeps from part to part.
        newton: Newton steps of what yields; the time of its points is not in ``seconds``.
    """

    steps: int
    flops: float
    seconds: float
    memory: float
    newton: int = 0


def _in_time(model: StagedModel, costs: Sequence[FactorCost], columns: float) -> Iterator[_InTime]:
    """The cost of each stage that takes steps in time.

    Args:
        model: of the case.
        costs: of one equilibrium of each state.
        columns: right-hand sides of one equilibrium.
    """
    states, points = model.sequence.states, model.discretization.points.n_points
    by = picked() if picked() in INDEFINITE else "splu"
    for n, cost in zip(_states(model), costs, strict=True):
        water = model.analysis.pores.consolidates(states[n])
        creeps = model.case.creeps and states[n].lasts is not None
        if model.case.conducts and states[n].lasts and not states[n].goes_on:
            heat = _heat(model, n, cost, columns, by)
            yield heat._replace(steps=0) if water or creeps else heat  # steps are told once
        if not (water or creeps) or states[n].goes_on:
            continue
        steps = steps_of(states, n, of_each_length(model.case, water=water))
        solved, pores = 2.0 * len(steps) * columns, _PORES if water else 1.0
        factors = 2 * len(steps) if model.case.ages else len({step.share for step in steps})
        seconds, newton = 0.0, 0
        if water and creeps:
            factors *= 2
            seconds += factors * _ANALYSIS_SECONDS * model.n_dofs[n]
        if water and model.yields:
            hardens = model.case.hardens
            of_part = _HARDENING_STEPS_IN_TIME if hardens else _NEWTON_STEPS_IN_TIME
            newton = 2 * len(steps) * of_part
            factors += newton
            seconds += newton * _ANALYSIS_SECONDS * model.n_dofs[n]
        flops = factors * pores * cost.flops
        at_points = _POINT_SECONDS + (_CREEP_SECONDS if creeps else 0.0)
        seconds += solved * (4.0 * pores * cost.entries / _SOLVE_FLOPS + at_points * points)
        memory = 0.0
        if water:
            both = creeps or model.yields or 0.0 in moments_of(states, n)
            each = _BYTES[by] * pores * cost.entries + _PORE_BYTES * _nonzeros(model, n)
            memory = (MOST_KEPT if both else 1) * each
        yield _InTime(len(steps), flops, seconds + flops / _FLOPS[by], memory, newton)


def _heat(model: StagedModel, n: int, cost: FactorCost, columns: float, by: str) -> _InTime:
    """The cost of the temperatures of a stage: one unknown a node, in place of one for each axis.

    Args:
        model: of the case.
        n: state that begins the stage.
        cost: of one equilibrium of it.
        columns: right-hand sides of one equilibrium.
        by: solver that factorizes.
    """
    dim = model.mesh.dim
    steps = steps_of(model.sequence.states, n, of_each_length(model.case, water=True))
    flops = len({step.share for step in steps}) * cost.flops / dim**3
    seconds = 2.0 * len(steps) * columns * 4.0 * cost.entries / dim**2 / _SOLVE_FLOPS
    memory = _BYTES[by] * cost.entries / dim**2 + _PORE_BYTES * _nonzeros(model, n) / dim**2
    return _InTime(len(steps), flops, seconds + flops / _FLOPS[by], memory)


def _memory_beside(model: StagedModel, columns: float) -> float:
    """Bytes of what is there beside the factor: patterns and values of K, states."""
    stiffness = max((_pattern_bytes(model, n) for n in _states(model)), default=0)
    points = model.discretization.points
    state = 8.0 * points.n_points * columns * (points.n_strain + 2)
    state += _YIELD_BYTES * points.n_points / 4 if model.yields else 0
    return _PATTERNS * stiffness + 4 * state


def refinement_cost(model: StagedModel, cost: CostEstimate) -> CostEstimate:
    """About what one evaluation on the refined mesh costs: four or eight times the unknowns.

    With nested dissection the entries of the factor grow with n log n in the plane and with n^4/3
    in space, the operations with n^3/2 and n^2 (George 1973); conjugate gradients grow with n, and
    are what ``auto`` takes where these entries and operations of the finer mesh are too many.

    Args:
        model: of the case.
        cost: of one evaluation on its own mesh.
    """
    space = model.mesh.dim == 3
    entries, flops, rest = (16.0, 64.0, 8.0) if space else (4.6, 8.0, 4.0)
    if cost.solver == BEYOND:  # what conjugate gradients take grows with n
        entries = flops = rest
    elif model.solver_name == AUTO and _is_beyond(model, cost, entries, flops, rest):
        return _iterated(model, cost, rest)
    grows = cost.seconds - cost.constant
    return replace(
        cost,
        memory=_PROGRAM + (cost.memory - _PROGRAM) * (entries if space else rest),
        seconds=cost.constant + grows * (flops if space else 0.5 * (flops + rest)),
    )


def _is_beyond(
    model: StagedModel, cost: CostEstimate, entries: float, flops: float, rest: float
) -> bool:
    """Whether a finer mesh is one for conjugate gradients.

    Args:
        model: of the case.
        cost: of one evaluation on its own mesh.
        entries: how many times the entries its factors have.
        flops: how many times the operations they take.
        rest: how many times the nodes it has.
    """
    number = cost.newton_steps * len(_states(model))
    nonzeros = max((_nonzeros(model, n) for n in _states(model)), default=0)
    finer = FactorCost(
        int(entries * cost.factor_entries), flops * cost.factor_flops / max(number, 1)
    )
    return is_beyond(finer, rest * nonzeros)


def _iterated(model: StagedModel, cost: CostEstimate, rest: float) -> CostEstimate:
    """What one evaluation by conjugate gradients costs on a mesh of so many times the nodes.

    The making of the model, which serves that one evaluation, is in it: it takes as long.
    """
    columns, points = 1 + len(model.names), model.discretization.points.n_points
    nonzeros = rest * max((_nonzeros(model, n) for n in _states(model)), default=0)
    each = cost.newton_steps * len(_states(model))
    flops = each * ITERATED * nonzeros * columns / _ITERATED_COLUMNS
    seconds = flops / _PRODUCT_FLOPS + _POINT_SECONDS * rest * points * columns * each
    seconds += _yield_seconds(model, rest) * each
    seconds += _MAKING_SECONDS * rest * max(model.n_dofs, default=0)
    memory = _PROGRAM + _ITERATED_BYTES * nonzeros + rest * _memory_beside(model, columns)
    return replace(cost, solver=BEYOND, factor_flops=flops, memory=memory, seconds=seconds)


def order_step_cost(model: StagedModel, cost: CostEstimate) -> CostEstimate:
    """About what one evaluation costs with elements of second order on the same edges, in space.

    As on a refined mesh, with k times the nodes; those on edges have half as many neighbours more.

    Args:
        model: of the case, with elements of first order.
        cost: of one evaluation on its own mesh.
    """
    k = n_raised(model.mesh) / model.mesh.n_nodes
    entries, flops = (1.0, 1.0) if cost.solver == BEYOND else (4.0 / 3.0, 2.0)
    if cost.solver != BEYOND and model.solver_name == AUTO:
        grown = _DENSER * k**entries, _DENSER * k**flops, _DENSER * k
        if _is_beyond(model, cost, *grown):
            return _iterated(model, cost, _DENSER * k)
    return replace(
        cost,
        memory=_PROGRAM + (cost.memory - _PROGRAM) * _DENSER * k**entries,
        seconds=cost.constant + (cost.seconds - cost.constant) * _DENSER * k**flops,
    )


_DENSER = 1.5


def evaluations_text(methods: Sequence[MethodOptions], n: int, *, yields: bool) -> str:
    """About how many evaluations a fit takes, a sentence for each of its methods.

    Args:
        methods: options of the methods, in their order.
        n: number of parameters that the case names.
        yields: ground yields.
    """
    return " ".join(_evaluations(options, n, yields=yields) for options in methods)


def _evaluations(options: MethodOptions, n: int, *, yields: bool) -> str:
    name, plain = method_name(options), "evaluations without derivatives."
    match options:
        case ComplementarityOptions():
            takes = "20 to 60 evaluations, most of them close to an earlier one, with two to four "
            takes += "steps per stage."
        case ScanOptions():
            return f"A scan takes {options.points**n} {plain}"
        case EnsembleSmootherOptions():
            takes = f"{options.ensemble * options.assimilations} {plain}"
        case SimplexOptions():
            takes = f"some {40 * n} {plain}"
        case ClosedFormOptions():
            takes = "none."
        case CondensationOptions():
            takes = "5 to 10 evaluations, each with twice the factorizations."
        case GaussNewtonOptions():
            many = options.starts not in (1, "automatic")
            takes = f"5 to 10 evaluations{', from each of its starts' if many else ''}."
            if yields:
                takes += " Later ones begin near an earlier one, with fewer steps."
    return f"A fit by {name} takes {takes}"


def _states(model: StagedModel) -> range:
    return range(1, len(model.sequence.states))


def _like_the_largest(model: StagedModel) -> list[FactorCost]:
    """The cost of the stage with most unknowns, once for each stage."""
    unknowns = model.n_dofs
    largest = max(_states(model), key=unknowns.__getitem__, default=None)
    if largest is None:
        return []
    return [_stage_cost(model, largest)] * len(_states(model))


def _stage_cost(model: StagedModel, state: int) -> FactorCost:
    systems, dim = model.systems, model.mesh.dim
    system, known = systems[state], systems.factor_costs
    if system.key not in known:  # asked by a fit for its processes and for its finer mesh
        known[system.key] = factor_cost(system.pattern.lower, system.pattern.dofs // dim)
    return known[system.key]


def _stage_costs(model: StagedModel) -> list[FactorCost]:
    """The cost of each stage; stages with the same ground have the same."""
    known: dict[frozenset[int], FactorCost] = {}
    costs = []
    for n in _states(model):
        groups = model.systems[n].groups
        if groups not in known:
            known[groups] = _stage_cost(model, n)
        costs.append(known[groups])
    return costs


def _nonzeros(model: StagedModel, state: int) -> int:
    return len(model.systems[state].pattern.lower.indices)


def _pattern_bytes(model: StagedModel, state: int) -> int:
    pattern = model.systems[state].pattern
    return pattern.lower.indices.nbytes + sum(a.nbytes for a in pattern.above.values())


def free_memory() -> float | None:
    """Bytes of memory that are free; None where the system does not tell.

    Of Linux with what it has lent to files and takes back.
    """
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * float(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return None
