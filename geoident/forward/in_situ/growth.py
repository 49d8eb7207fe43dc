"""Constants that grow with depth or with the in-situ stress: from a case to its strain points.

The stress is the one in situ as the case gives it, before the first stage: neither the equilibrium
step of the virgin ground nor later stages change stiffness and strength, so elastic ground stays
linear and the derivatives by the numbers of the in-situ stress are exact (theory 10.7).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import format_point
from geoident.forward.ground.elasticity import not_positive
from geoident.forward.in_situ.stress import InSituStress, StressPlaces
from geoident.forward.in_situ.surfaces import Depths
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Growth, PointGrowth, WithDepth, WithStress
from geoident.model.in_situ import Surface
from geoident.model.parameter import Scalar, Values
from geoident.units import in_unit, shown_unit


def point_growths(on_mesh: CaseOnMesh) -> tuple[PointGrowth, ...]:
    """The constants of a case that grow, at the strain points of their materials."""
    made = (_point_growth(on_mesh, growth) for growth in on_mesh.case.growths)
    return tuple(one for one in made if one is not None)


def _point_growth(on_mesh: CaseOnMesh, growth: Growth) -> PointGrowth | None:
    """None where no ground is ever of the material."""
    all_points, points = on_mesh.discretization.points, on_mesh.material_points(growth.material)
    if not len(points):
        return None
    positions, law, outside = all_points.position[points], growth.law, 0
    value: Callable[[ParameterPoint], Dual]
    if isinstance(law, WithDepth):
        depths = Depths(on_mesh.mesh, law.surface, positions)
        scalars: tuple[Surface, ...] = (growth.base, law.gradient, law.surface)
        ties = (s.parameter for s in scalars if isinstance(s, Scalar))
        names = frozenset(name for name in ties if name is not None)
        value, outside = partial(_by_depth, growth.base, law, depths), depths.n_outside
    else:
        groups = on_mesh.sequence.group_of[all_points.element[points]]
        in_situ = InSituStress(on_mesh, StressPlaces(positions, groups))
        names = frozenset(p.name for p in on_mesh.case.parameters if not p.field)
        value, outside = partial(_by_stress, growth.base, law, in_situ), in_situ.n_outside
    with np.errstate(all="ignore"):  # start values that `start_faults` refuses
        size = float(np.abs(value(ParameterPoint(on_mesh.case.start, ())).value).mean())
    typical = size or 1.0
    return PointGrowth(growth, points, positions, names, value, typical, outside)


def _by_depth(base: Scalar, law: WithDepth, depths: Depths, point: ParameterPoint) -> Dual:
    """Base + gradient * depth."""
    return depths.at(point) * point.number(law.gradient) + point.number(base)


def _by_stress(base: Scalar, law: WithStress, in_situ: InSituStress, point: ParameterPoint) -> Dual:
    """Base (p' / pressure)^exponent; below the least p' that one counts, whatever the stress is."""
    pressure = -in_situ.columns(point)[:3].sum(axis=0) / 3.0  # p' (q, 1 + n), Pa
    least = point.number(law.least).columns
    counted = Dual(np.where(pressure[:, :1] > least[0], pressure, least))
    ratio = counted / point.number(law.pressure)
    return ratio.power(point.number(law.exponent)) * point.number(base)


def growth_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Constants that grow with an in-situ stress that is not there."""
    case, sequence = on_mesh.case, on_mesh.sequence
    virgin = sequence.states[0].materials
    faults = []
    for growth in case.growths:
        if isinstance(growth.law, WithDepth):
            continue
        if case.in_situ is None and not case.in_situ_of:
            message, hint = f"{growth.words}, and the case has none", "Add 'in_situ'."
            faults.append(case.source.fault(growth.path, "no-stress", message, hint))
            continue
        later = {
            sequence.groups[g]
            for state in sequence.states
            for g, name in state.materials.items()
            if name == growth.material and g not in virgin
        }
        if later:
            shown = ", ".join(map(repr, sorted(later)))
            message = f"{growth.words}, and {shown} is placed later, with no stress in situ"
            hint = "Give it a material of its own, with a number or growth with depth."
            faults.append(case.source.fault(growth.path, "no-stress", message, hint))
    return faults


def start_faults(case: Case, growths: tuple[PointGrowth, ...]) -> list[Fault]:
    """Constants that are not positive somewhere at the start values."""
    faults = []
    for one in growths:
        law = one.growth.law
        pressure = 1.0 if isinstance(law, WithDepth) else law.pressure.value(case.start)
        least = 1.0 if isinstance(law, WithDepth) else law.least.value(case.start)
        if pressure <= 0.0 or least <= 0.0:
            wrong = "its 'pressure' and 'least' must be positive"
            message = f"{one.growth.words}, and {wrong} at the start values"
            hint = "Correct the start of the parameter."
        else:
            reason = not_positive(one, case.start)
            if reason is None:
                continue
            message = f"{reason} at the start values"
            hint = "Correct the base, the growth, or the surface from which depth is counted."
        path = one.growth.path
        faults.append(case.source.fault(path, "out-of-range", message, hint))
    return faults


def growth_notes(growths: tuple[PointGrowth, ...], values: Values) -> list[str]:
    """From what to what each constant grows, at parameter values."""
    return [_growth_note(one, values) for one in growths]


def _growth_note(one: PointGrowth, values: Values) -> str:
    growth, factors = one.growth, one.value(ParameterPoint(values, ())).value
    low, high = int(np.argmin(factors)), int(np.argmax(factors))
    ends = _shown(factors[low], growth), _shown(factors[high], growth)
    note = f"{growth.words}: at the start values {ends[0]} "
    if ends[0] == ends[1]:
        note += "everywhere"
    else:
        note += f"near {format_point(one.positions[low])} to {ends[1]} near "
        note += format_point(one.positions[high])
    if isinstance(growth.law, WithStress):
        note += _floor(one, growth.law, factors, values)
    return note


def _per_cent(part: float) -> str:
    """A part of a whole: 100 % is all of it.

    >>> _per_cent(0.0234), _per_cent(0.9999), _per_cent(1.0)
    ('2.3 %', '99.9 %', '100 %')
    """
    if part == 1.0:
        return "100 %"
    return f"{min(100.0 * part, 99.9):.{2 if part < 0.99 else 3}g} %"


def _floor(one: PointGrowth, law: WithStress, factors: Floats, values: Values) -> str:
    """How much of the ground has no more than the least stress."""
    least, pressure = law.least.value(values), law.pressure.value(values)
    floor = one.growth.base.value(values) * (least / pressure) ** law.exponent.value(values)
    part = float(np.mean(np.abs(factors - floor) <= 1e-12 * floor))
    if law.exponent.value(values) == 0.0 or part == 0.0:
        return ""
    kPa = 1e-3 * least
    return f"; at {_per_cent(part)} of its points p' is not above {kPa:.4g} kPa, which counts there"


def _shown(value: float, growth: Growth) -> str:
    unit = growth.unit or ("MPa" if value >= 1e6 else "kPa")
    return (
        f"{in_unit(float(value), unit, growth.dimension):.4g} {shown_unit(unit, growth.dimension)}"
    )
