"""Whether the equations are affine in the parameters: asked of everything that they are made of.

At given displacements the equations of all stages (theory 4.1) consist of moduli, in-situ stresses,
nodal forces, thermal stresses, forces held by partial release and rigidities of structures. Each of
these comes with its exact derivatives. They are evaluated at a few parameter vectors spread over
the bounds; where a derivative by h is not the same at all of them, the part is not affine in h.
Which parameter it changes with is found by moving one at a time: if only another one, k, does it,
the part contains the product of h and k. That is a test and no proof: a kink between two of these
vectors that leaves all slopes the same, or within a millionth of the way from a bound, is not seen.

Products over stages, of a modulus and the stress that the stages before left, are no obstacle: the
displacements are unknowns of their own (theory 4.1). The products that remain within one stage are
parts of their own here: modulus, expansion and temperature; released fraction and stress.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.forward.actions.edges import HELD_EDGES
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.in_situ.stress import NEGLIGIBLE_IMBALANCE, in_situ_models
from geoident.forward.structures.members import rigidities
from geoident.forward.yielding.surfaces import yield_planes
from geoident.model.actions import WaterPressure
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case, Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.ground import (
    Isotropic,
    TransverselyIsotropic,
    angles,
    constants,
    elastic_scalars,
)
from geoident.model.in_situ import GeostaticStress, HeimStress
from geoident.model.parameter import Parameter, Scalar, Values
from geoident.model.structures import Structure

_SLOPE_TOLERANCE = 1e-9
"""Relative difference of derivatives at two parameter vectors that is rounding."""

_VALUE_ROUNDING = 1e-13
"""Change of the value, relative to it, below which a derivative is rounding."""

_PLACES = (1e-6, 0.518, 1.0 - 1e-6)
"""Where the trial points lie between the bounds: at both ends, where fits may end, and between.

Not on a bound itself, since a kink there (a strength that ends at zero) does no harm.
"""

_TURNS = ((0, 1, 2), (2, 0, 1), (1, 2, 0), (0, 2, 1), (1, 0, 2), (2, 1, 0))
"""In which order the parameters take these places, so that they do not move all together."""

_DRAWS = 20
"""How often a point outside the domain is drawn halfway to the start."""


@dataclass(frozen=True)
class EquationPart:
    """Something the equations are made of.

    Args:
        name: what it is, as the subject of a sentence.
        columns: its value and derivatives (..., 1 + n) at a point.
        explain: says of some parameters, in each of which alone the part is not linear, what
            they do there and what to do instead; None to leave it at that.
    """

    name: str
    columns: Callable[[ParameterPoint], Floats]
    explain: Callable[[Collection[str]], str | None] = lambda _: None


def condensation_obstacle(analysis: StagedAnalysis) -> str | None:
    """Why the equations are not affine in displacements and parameters, or None if they are."""
    case = analysis.case
    for name in analysis.sequence.materials:
        if not case.materials[name].is_elastic:
            return f"{name} yields: its stresses are not linear in the displacements"
    for name, structure in case.structures.items():
        if structure.yields:
            return f"the structure '{name}' yields: its forces are not linear in the displacements"
    return affine_obstacle(analysis)


def affine_obstacle(analysis: StagedAnalysis) -> str | None:
    """Why the elastic equations are not affine in the parameters, a clause; None if they are."""
    case = analysis.case
    if case.in_steps is not None:
        return case.in_steps
    for name in case.interfaces:
        return f"the interface '{name}' is no term of these equations"
    for field in analysis.on_mesh.fields:
        return f"{field.constant} of {field.material} is a field: it is not linear in its modes"
    for growth in case.growths:
        return f"{growth.words}: its equations are not made as sums"
    moved = analysis.motions.moved()
    if moved is not None:
        return f"the support '{moved}' is moved: its motion times a modulus is a load"
    for stage in case.stages:
        if stage.supports:
            return f"the stage '{stage.name}' changes what is held"
    admissible = partial(_is_admissible, analysis)
    return first_obstacle(_parts(analysis), case.parameters, admissible)


def affine_yield_obstacle(analysis: StagedAnalysis, material: Material) -> str | None:
    """Why distances and hardening of a material's yield planes are not affine, or None."""
    parts = _yield_parts(material, analysis.systems.discretization.points.n_strain)
    return first_obstacle(parts, analysis.case.parameters, partial(_is_admissible, analysis))


def _is_admissible(analysis: StagedAnalysis, values: Values) -> bool:
    return inadmissible_numbers(analysis.case, analysis.sequence, values) is None


def first_obstacle(
    parts: Iterable[EquationPart],
    parameters: Sequence[Parameter],
    admissible: Callable[[Values], bool] = lambda _: True,
) -> str | None:
    """The first part that is not affine in the parameters, and why, a clause; None for none.

    Args:
        parts: what is looked at, in this order.
        parameters: the n free parameters.
        admissible: whether parameter values by name are inside the domain of the model.
    """
    if not parameters:
        return None
    points = trial_points(parameters, admissible)
    obstacles = (_obstacle(part, points) for part in parts)
    return next((why for why in obstacles if why is not None), None)


def trial_points(
    parameters: Sequence[Parameter], admissible: Callable[[Values], bool]
) -> list[ParameterPoint]:
    """Three points in the bounds, two of them at their ends.

    Points outside the domain of the model are drawn towards the start, which is inside.
    """
    names = tuple(p.name for p in parameters)
    points = []
    for turn in range(len(_PLACES)):
        values = {p.name: _place(p, turn, k) for k, p in enumerate(parameters)}
        for _ in range(_DRAWS):
            if admissible(values):
                break
            values = {p.name: 0.5 * (p.start + values[p.name]) for p in parameters}
        points.append(ParameterPoint(values, names))
    return points


def _place(parameter: Parameter, turn: int, k: int) -> float:
    """The value of the k-th parameter at a trial point."""
    part = _PLACES[_TURNS[k % len(_TURNS)][turn]]
    if 0.1 < part < 0.9:  # no ratio of offsets is a simple number
        part += 0.01 * ((1 + k + 7 * turn) * 0.6180339887498949 % 1.0 - 0.5)
    size = abs(parameter.start) or 1.0
    low, high = parameter.lower, parameter.upper
    low = low if np.isfinite(low) else min(parameter.start - 0.5 * size, high)
    high = high if np.isfinite(high) else max(parameter.start + 0.5 * size, low)
    if parameter.scale == "log" and low > 0.0:
        return float(low * (high / low) ** part)
    return float(low + part * (high - low))


def _obstacle(part: EquationPart, points: Sequence[ParameterPoint]) -> str | None:
    """Why a part is not affine over some points, or None if it is."""
    names, base = points[0].names, points[0].values
    first = _Slopes(part, points[0])
    changes = np.any([first.differ(part, other) for other in points[1:]], axis=0)
    if not changes.any():
        return None
    moved = [{**base, name: points[1].values[name]} for name in names]
    by = [first.differ(part, ParameterPoint(values, names)) for values in moved]
    with_itself = [name for h, name in enumerate(names) if by[h][h]]
    pairs = [(h, k) for h in range(len(names)) for k in range(h + 1, len(names)) if by[k][h]]
    if with_itself or not pairs:
        bent = with_itself or [names[int(np.argmax(changes))]]
        return part.explain(bent) or f"{part.name} is not linear in {bent[0]}"
    one, other = (names[h] for h in pairs[0])
    return f"{part.name} contains the product of {one} and {other}, and both are free"


class _Slopes:
    """Derivatives of a part at a point, to be compared with those at others."""

    def __init__(self, part: EquationPart, point: ParameterPoint) -> None:
        columns = _table(part, point)
        self._slopes = columns[:, 1:]
        numbers = np.array([point.values[name] for name in point.names])
        value = np.abs(columns[:, 0]).max(initial=0.0)
        self._rounding = _VALUE_ROUNDING * value / np.maximum(np.abs(numbers), np.finfo(float).tiny)

    def differ(self, part: EquationPart, point: ParameterPoint) -> Bools:
        """(n,) which derivatives are others at another point, by more than rounding."""
        one, other = self._slopes, _table(part, point)[:, 1:]
        size = np.maximum(np.abs(one), np.abs(other)).max(axis=0, initial=0.0)
        limit = np.maximum(_SLOPE_TOLERANCE * size, self._rounding)
        return np.asarray(np.abs(one - other).max(axis=0, initial=0.0) > limit)


def _table(part: EquationPart, point: ParameterPoint) -> Floats:
    """Value and derivatives (m, 1 + n) of a part."""
    return np.asarray(part.columns(point).reshape(-1, point.n_columns))


def _parts(analysis: StagedAnalysis) -> Iterator[EquationPart]:
    """Everything of which the elastic equations of a model are made."""
    case = analysis.case
    section = case.analysis.dim == 2
    for name in analysis.sequence.materials:
        yield stiffness_part(case.materials[name], section=section)
    yield EquationPart(
        "the in-situ stress", analysis.in_situ.columns, lambda n: _explain_in_situ(case, n)
    )
    for name, structure in case.structures.items():
        yield _rigidity_part(name, structure)
    yield from _prestress_parts(analysis)
    yield from _force_parts(analysis)
    yield from _thermal_parts(analysis)
    yield from _release_parts(analysis)


def stiffness_part(material: Material, *, section: bool) -> EquationPart:
    """The elasticity (6, 6) of a material.

    Args:
        material: the material.
        section: the model is a plane section.
    """
    return EquationPart(
        f"the stiffness of {material.name}",
        lambda point: elastic_matrix(material.elastic, point, section=section).columns,
        lambda names: _explain_stiffness(material, names),
    )


def _explain_stiffness(material: Material, names: Collection[str]) -> str | None:
    elastic = material.elastic
    tied = [
        name for name, s in elastic_scalars(elastic).items() if not s.parameters.isdisjoint(names)
    ]
    for name in tied:
        if name.startswith("nu") or name in angles(elastic):
            remedy = " (K and G enter linearly)" if isinstance(elastic, Isotropic) else ""
            return f"{name} of {material.name} enters the stiffness nonlinearly{remedy}"
    young = [name for name in constants(elastic) if name.startswith("E")]
    first = next((name for name in young if name in tied), None)
    if first is None:
        return None
    if isinstance(constants(elastic)[first], RockMassModulus):
        return f"{first} of {material.name} follows from its GSI or D, which is not linear"
    # At fixed ratios between them the matrix grows in proportion to all Young's moduli.
    remedy = f"unless {', '.join(young)} are all tied to one parameter"
    if isinstance(elastic, TransverselyIsotropic):
        remedy += " (Love's A, C, F, L and N enter linearly)"
    return f"{first} of {material.name} enters the stiffness nonlinearly {remedy}"


def _yield_parts(material: Material, n_strain: int) -> Iterator[EquationPart]:
    """Distances and hardening of the yield planes of a material that yields."""
    name = f"of the yield planes of {material.name}"
    yield EquationPart(
        f"the distance {name}",
        lambda point: yield_planes(material, point, n_strain).distances.columns,
    )

    def hardening(point: ParameterPoint) -> Floats:
        rate = yield_planes(material, point, n_strain).hardening
        return np.zeros((0, point.n_columns)) if rate is None else rate.columns

    yield EquationPart(f"the hardening {name}", hardening)


def _explain_in_situ(case: Case, names: Collection[str]) -> str | None:
    for _, model in in_situ_models(case):
        if not isinstance(model, HeimStress | GeostaticStress):
            continue
        if isinstance(model.surface, Scalar) and model.surface.parameter in names:
            return f"the in-situ stress ends at the level {model.surface.parameter} of the surface"
        if model.azimuth is not None and model.azimuth.parameter in names:
            return f"the horizontal stress turns with the azimuth {model.azimuth.parameter}"
    return None


def _rigidity_part(name: str, structure: Structure) -> EquationPart:
    """The rigidities of a structure, (2,) or (4,)."""

    def columns(point: ParameterPoint) -> Floats:
        return np.stack([number.columns for number in rigidities(structure, point)])

    def explain(names: Collection[str]) -> str | None:
        for key, scalar in structure.numbers.items():
            if scalar.parameter in names and key in ("thickness", "nu", "diameter", "spacing"):
                return f"{key} of the structure '{name}' enters its stiffness nonlinearly"
        return None

    return EquationPart(f"the stiffness of the structure '{name}'", columns, explain)


def _prestress_parts(analysis: StagedAnalysis) -> Iterator[EquationPart]:
    """Forces at which bars are locked off, as they act on the ground: spread over a spacing."""
    for state in analysis.sequence.states:
        for name in state.stressed:
            one = replace(state, stressed={name: state.stressed[name]}, locked={})
            yield EquationPart(
                f"the prestress of the structure '{name}' at stage '{state.name}'",
                partial(analysis.systems.structures.locked, one),
            )


def _force_parts(analysis: StagedAnalysis) -> Iterator[EquationPart]:
    """Nodal forces of every kind in every state."""
    levels = {level for level in _water_levels(analysis.case) if level is not None}

    def explain(names: Collection[str]) -> str | None:
        level = next((name for name in names if name in levels), None)
        if level is None:
            return None
        return f"the water ends at the level {level}, so its pressure is not linear in it"

    for n, state in enumerate(analysis.sequence.states):
        parts = list(analysis.actions.parts(n))
        # what holds the edges is made of what is looked at before it
        for name, forces in sorted(parts, key=lambda part: part[0] == HELD_EDGES):
            yield EquationPart(f"{name} at stage '{state.name}'", forces, explain)


def _water_levels(case: Case) -> Iterator[str | None]:
    """Parameters that are a level of the water somewhere."""
    for water in (case.water, *(stage.water for stage in case.stages)):
        if water is not None and isinstance(water.table, Scalar):
            yield water.table.parameter
            yield None if water.falls is None else water.falls.level.parameter
    for loads in (case.loads, *(stage.loads for stage in case.stages)):
        for load in loads.values():
            if isinstance(load, WaterPressure):
                yield load.level.parameter
                yield None if load.falls is None else load.falls.level.parameter


def _thermal_parts(analysis: StagedAnalysis) -> Iterator[EquationPart]:
    """Thermal stresses: a modulus times the expansion times the temperature."""
    for n, state in enumerate(analysis.sequence.states):
        for group in analysis.thermal.warmed(n):
            yield EquationPart(
                f"the thermal stress of {state.materials[group]}",
                partial(_thermal_stress, analysis, n, group),
            )


def _thermal_stress(
    analysis: StagedAnalysis, state: int, group: int, point: ParameterPoint
) -> Floats:
    """E eps_0 (6, k, 1 + n) that a state imposes on the k points of a group."""
    material = analysis.case.materials[analysis.sequence.states[state].materials[group]]
    moduli = elastic_matrix(
        material.elastic, point, section=analysis.case.analysis.dim == 2
    ).columns
    per_strain = Dual(moduli[:, :NORMAL_COMPONENTS].sum(axis=1)[:, None])
    return (per_strain * analysis.thermal.strain(state, group, point)).columns


def _release_parts(analysis: StagedAnalysis) -> Iterator[EquationPart]:
    """What groups that left still hold: a fraction of forces that depend on parameters."""
    for n, state in enumerate(analysis.sequence.states):
        for group, fraction in state.release.items():
            if isinstance(fraction, Scalar) and fraction.parameter is None:
                continue
            part = partial(analysis.release.part, n, group)
            name = f"what '{analysis.sequence.groups[group]}' still holds at stage '{state.name}'"
            for columns in _support_of(analysis, n, group):
                yield EquationPart(name, partial(_held, part, columns))


def _held(
    fraction: Callable[[ParameterPoint], Dual],
    columns: Callable[[ParameterPoint], Floats],
    point: ParameterPoint,
) -> Floats:
    """What is not released of something (..., 1 + n)."""
    return ((1.0 - fraction(point)) * Dual(columns(point))).columns


def _support_of(
    analysis: StagedAnalysis, state: int, group: int
) -> Iterator[Callable[[ParameterPoint], Floats]]:
    """What the forces of a group that left are made of: its loads, and its stress.

    The stress is the in-situ one and, where the ground has moved, moduli times strains; less the
    thermal one.
    """
    case, sequence = analysis.case, analysis.sequence
    left = next(
        n for n, before in enumerate(sequence.states)
        if group in before.leaving and (n == state or sequence.built_on[n, state])
    )  # fmt: skip
    base = sequence.states[left].base
    yield lambda point: analysis.actions.carried(base, {group}, point)
    points = analysis.systems.discretization.points_of[group]
    yield lambda point: analysis.in_situ.columns(point)[:, points]
    way = [int(n) for n in np.flatnonzero(sequence.built_on[:, base])]
    start = ParameterPoint(case.start, ())
    if base or analysis.virgin(start)[1].max() > NEGLIGIBLE_IMBALANCE:
        made_of = [sequence.states[n].materials.get(group) for n in (0, *way)]
        for name in dict.fromkeys(name for name in made_of if name is not None):
            yield stiffness_part(case.materials[name], section=case.analysis.dim == 2).columns
    for n in way:
        if group in analysis.thermal.warmed(n):
            yield partial(_thermal_stress, analysis, n, group)
