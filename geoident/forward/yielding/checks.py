"""What is wrong or to be known of the yield limits of a case, before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from geoident.errors import Fault
from geoident.fem.yielding.domain import empty_domain
from geoident.forward.ground.checks import trials
from geoident.forward.ground.elasticity import material_axes
from geoident.forward.hardening.soils import impossible_soil, isotropic_past, stress_at_rest
from geoident.forward.stages import CaseOnMesh
from geoident.forward.yielding.surfaces import in_principal_stresses, yield_limits, yield_planes
from geoident.model.case import Analysis, Case, KeyPath, Material
from geoident.model.cells import CELLS
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Growth, RandomField, constants
from geoident.model.in_situ import GeostaticStress
from geoident.model.mesh import spans
from geoident.model.parameter import Parameter, Scalar, Values
from geoident.model.yielding import (
    GivenPlanes,
    HoekBrown,
    WeakPlane,
    YieldSurface,
    bounded_surfaces,
)

_ROUNDED_NORMAL = 1e-9
"""Of a unit normal: rounding of the turns of axes, below which a component is zero."""


def n_strain_of(case: Case) -> int:
    """Number of strain components of the analysis."""
    return 6 if case.analysis is Analysis.SOLID else 4


def yield_faults(case: Case) -> list[Fault]:
    """Weak planes oblique to a section, yield planes that leave no stress, strengths below zero."""
    faults = [fault for material in _yielding(case) for fault in _oblique(case, material)]
    faults += [fault for material in _yielding(case) for fault in _field_faults(case, material)]
    if faults:
        return faults
    for material in case.materials.values():
        reason = None if material.soil is None else impossible_soil(material, case.start)
        if reason is not None:
            path: KeyPath = ("materials", material.name, "yield")
            hint = "Change one of them, or the start of its parameter."
            faults.append(case.source.fault(path, "soil", reason, hint))
    for material in _yielding(case):
        fault = _empty(case, material) or _stressed_from_the_start(case, material)
        if fault is not None:
            faults.append(fault)
    return faults


def _ratios_at_rest(case: Case) -> Iterator[tuple[Material, float]]:
    """Soils whose horizontal stress in situ follows from their past, and by the vertical one."""
    point = ParameterPoint(case.start, ())
    for group, name in case.groups.items():
        model = case.in_situ_of.get(group, case.in_situ)
        if name is None or not isinstance(model, GeostaticStress) or isinstance(model.K0, Scalar):
            continue
        material = case.materials[name]
        if material.soil is not None and group not in (model.K0 or {}):
            upright = Dual(point.number(material.soil.p_ref).columns[None])
            yield material, float((stress_at_rest(material, upright, point) / upright).value[0])


def yield_notes(case: Case) -> list[str]:
    """By what each material yields, and cut-offs of tension without effect."""
    start = case.start
    notes = [
        f"'{material.name}' is a {material.soil.description}; E is that of unloading"
        for material in case.materials.values()
        if material.soil is not None
    ]
    notes += dict.fromkeys(
        f"K0 of '{material.name}' is that of its past, {at_rest:.3g} at a vertical stress of p_ref"
        for material, at_rest in _ratios_at_rest(case)
    )
    notes += [
        f"'{material.name}' once bore {past.value(start) / 1e3:.4g} kPa vertically: a cell "
        f"pressure above {isotropic_past(material, start) / 1e3:.4g} kPa is a first loading of the "
        "cap"
        for material in case.materials.values()
        if material.soil is not None and (past := material.soil.preconsolidation_stress) is not None
    ]
    for material in _yielding(case):
        notes.append(f"'{material.name}' yields by {_described(case, material)}")
        varied = {growth.surface for growth in material.growths}
        for number, surface in enumerate(material.yields):
            if number in varied:  # said, point by point, where it is on the mesh
                continue
            limit, tension = surface.apex(start), getattr(surface, "tension", None)
            if limit is not None and tension is not None and tension.value(start) >= limit:
                notes.append(
                    f"the tension of '{material.name}' is not less than {surface.tip}, at the "
                    f"start {limit / 1e6:.4g} MPa: its cut-off has no effect"
                )
        if _outside_at_zero(case, material):
            notes.append(f"'{material.name}' cannot be free of stress: a distance is negative")
    return notes


_MANY = 0.1
"""Part of the elements of ground that yields from which on triangles of first order matter."""


def locking_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Ground that yields on elements that have too few nodes to flow.

    Quadrilaterals and hexahedra of first order do not lock, since they take the mean dilatation.
    """
    mesh, sequence, materials = on_mesh.mesh, on_mesh.sequence, on_mesh.case.materials
    made = [(g, m) for state in sequence.states for g, m in state.materials.items()]
    yielding = np.isin(sequence.group_of, [g for g, m in made if not materials[m].is_elastic])
    counts = {
        block.kind: np.count_nonzero(yielding[span])
        for block, span in spans(mesh.blocks)
        if CELLS[block.kind].order == 1 and CELLS[block.kind].shape.name not in ("quad", "hex")
    }
    number = sum(counts.values())
    if number <= _MANY * np.count_nonzero(yielding):
        return []
    kinds = " and ".join(kind for kind, count in counts.items() if count)
    return [
        f"{number:,} of the {np.count_nonzero(yielding):,} elements of ground that yields are "
        f"linear ({kinds}) and too stiff where it flows: openings in such meshes moved 2 to 30 % "
        "too little in tests, most where elements are large and strengths low; write 'order: 2' "
        "under 'mesh' for nodes on their edges"
    ]


_ANGLES = ("friction", "dilation")


def _field_faults(case: Case, material: Material) -> Iterator[Fault]:
    """Fields with which a yield surface would not stay similar to itself from point to point.

    The law of a point is that of the means with one factor on all strengths, and one on the moduli.
    """
    entries: tuple[RandomField | Growth, ...] = (*material.fields, *material.growths)
    for field in entries:
        if field.surface is None:
            moduli = [name for name in constants(material.elastic) if not name.startswith("nu")]
            if moduli != [field.constant]:
                others = ", ".join(name for name in moduli if name != field.constant)
                message = f"{field.constant} of '{material.name}' varies from place to place, but "
                message += f"{others} not, and it yields: its elasticity must vary as a whole"
                hint = "Give E and nu and let E vary, or leave out 'yield' or what varies."
                yield case.source.fault(field.path, "field", message, hint)
        elif field.constant in _ANGLES:
            message = (
                f"{field.constant} of '{material.name}' is an angle, which cannot be a field: "
            )
            message += (
                "it makes the shape of the yield surface, which is the same at all points of "
            )
            message += "a material"
            hint = "Let the cohesion vary, or give places of another angle a material of their own."
            yield case.source.fault(field.path, "field", message, hint)
        else:
            yield from _other_strengths(case, material, field)
    if entries and any(_hardens(surface) for surface in material.yields):
        message = f"'{material.name}' hardens, and {entries[0].constant} varies from place to place"
        hint = "Leave out the hardening, or let nothing vary: the hardening would have to as well."
        path = entries[0].path
        yield case.source.fault(path, "field", message, hint)


def _other_strengths(
    case: Case, material: Material, field: RandomField | Growth
) -> Iterator[Fault]:
    """Strengths that do not vary with the one that does.

    Where cohesion or tension grows, the other one is free, unless it is a field (`varied`).
    """
    assert field.surface is not None
    free = {(field.surface, field.constant)}
    if isinstance(field, Growth) and not isinstance(material.yields[field.surface], HoekBrown):
        free |= {(field.surface, name) for name in ("cohesion", "tension")}
        free -= {(one.surface, one.constant) for one in material.fields}
    for number, surface in enumerate(material.yields):
        if isinstance(surface, GivenPlanes):
            others = [f"the plane '{plane.name}'" for plane in surface.planes]
        else:
            others = [
                name
                for name, strength in surface.strengths.items()
                if name not in (*_ANGLES, "hardening", *surface.dimensionless)
                and (strength.factor or strength.parameter)
                and (number, name) not in free
            ]
        if others:
            message = f"{field.constant} of '{material.name}' varies from place to place, but "
            message += f"{', '.join(others)} of its surface {number + 1} "
            message += "does not" if len(others) == 1 else "do not"
            message += ": a yield surface can grow and shrink from place to place, but not change "
            message += "its shape"
            how = "a field" if isinstance(field, RandomField) else "growth"
            hint = f"Leave out {others[0]}, or give {field.constant} without {how}."
            yield case.source.fault(field.path, "field", message, hint)


def _hardens(surface: YieldSurface) -> bool:
    hardening = surface.strengths.get("hardening")
    return hardening is not None and bool(hardening.factor or hardening.parameter)


def no_stress_left(case: Case, material: Material, values: Values) -> str | None:
    """Why the yield planes of a material leave no stress, a sentence, or None if they do.

    Where no distance is negative, the stress-free state is inside.

    Args:
        case: the case.
        material: one of its materials.
        values: parameters by name, SI.
    """
    if not any(isinstance(surface, GivenPlanes) for surface in material.yields):
        return None
    planes = yield_planes(material, ParameterPoint(values, ()), n_strain_of(case))
    if planes.distances.value.min() >= 0.0:
        return None
    contradicting = empty_domain(planes.normals.value, planes.distances.value)
    if contradicting is None:
        return None
    names = " and ".join(f"'{planes.names[k]}'" for k in contradicting)
    return f"no stress satisfies the yield planes {names} of {material.name} together"


def _yielding(case: Case) -> Iterator[Material]:
    return (material for material in case.materials.values() if material.yields)


def _key(case: Case, material: Material, surface: YieldSurface) -> KeyPath:
    """Where a surface is written: under `yield`, or as one of its list."""
    path: KeyPath = ("materials", material.name, "yield")
    listed = (*path, next(n for n, s in enumerate(material.yields) if s is surface))
    inside = any(key[: len(listed)] == listed for key in case.source.positions)
    return listed if inside else path


def _oblique(case: Case, material: Material) -> Iterator[Fault]:
    """Weak planes on which the ground would slide out of the section."""
    if case.analysis is Analysis.SOLID:
        return
    for surface in material.yields:
        if not isinstance(surface, WeakPlane):
            continue
        points = [ParameterPoint(values, ()) for values in trials(case.parameters)]
        axes = [material_axes(surface.frame, point, section=True).value for point in points]
        normals = np.array(axes)[:, :, 2]
        if np.abs(normals[:, 2]).max() > _ROUNDED_NORMAL:
            message = f"the weak planes of '{material.name}' are oblique to the section, or may "
            message += "turn so in the fit, so the ground would also slide out of the plane"
            hint = "Use analysis: solid, or give a strike normal to the section."
        elif (
            case.analysis is Analysis.AXISYMMETRIC
            and np.abs(normals[:, 0] * normals[:, 1]).max() > _ROUNDED_NORMAL
        ):
            message = f"weak planes of '{material.name}' that dip are not the same all around "
            message += "the axis"
            hint = "Use 'dip: 0 deg', or analysis: solid."
        else:
            continue
        path = _key(case, material, surface)
        yield case.source.fault(path, "antiplane", message, hint)


def _empty(case: Case, material: Material) -> Fault | None:
    message = no_stress_left(case, material, case.start)
    if message is None:
        return None
    surface = next(s for s in material.yields if isinstance(s, GivenPlanes))
    path = (*_key(case, material, surface), "planes")
    if _empty_in_the_box(surface, case.parameters, n_strain_of(case)):
        message += ", wherever the parameters are within their bounds"
        hint = "Turn a normal round, or change the bounds: planes that face each other need a "
        hint += "positive sum of distances."
    else:
        message += " at the start of the parameters"
        hint = "Enlarge a distance: planes that face each other need a positive sum of distances."
    return case.source.fault(path, "empty-domain", message, hint)


def _empty_in_the_box(
    surface: GivenPlanes, parameters: tuple[Parameter, ...], n_strain: int
) -> bool:
    """Whether no parameters within their bounds leave a stress.

    The distances are linear in the parameters, so these join the stresses as unknowns.
    """
    start = {p.name: p.start for p in parameters}
    tied = [p for p in parameters if any(q.distance.parameter == p.name for q in surface.planes)]
    point = ParameterPoint(start, tuple(p.name for p in tied))
    distances = np.stack([point.number(plane.distance).columns for plane in surface.planes])
    offsets, slopes = distances[:, 0], distances[:, 1:]
    normals = np.array([plane.normal[:n_strain] for plane in surface.planes])
    box = np.hstack(
        [np.zeros((2 * len(tied), n_strain)), np.vstack([c * np.eye(len(tied)) for c in (1, -1)])]
    )
    edges = [p.upper - p.start for p in tied] + [p.start - p.lower for p in tied]
    rows = np.vstack([np.hstack([normals, -slopes]), box])
    return empty_domain(rows, np.concatenate([offsets, edges])) is not None


def _outside_at_zero(case: Case, material: Material) -> bool:
    surfaces = bounded_surfaces(material.yields, material.growths)
    bounded = replace(material, yields=surfaces)
    planes = yield_limits(bounded, ParameterPoint(case.start, ()), n_strain_of(case))
    return bool(planes.distances.value.min() < 0.0)


def _stressed_from_the_start(case: Case, material: Material) -> Fault | None:
    """A material that enters free of stress, where that is outside its yield surface."""
    if not _outside_at_zero(case, material):
        return None
    stage = next((s.name for s in case.stages if material.name in s.install.values()), None)
    virgin = case.in_situ is None and not case.in_situ_of
    if stage is None and not (virgin and material.name in case.groups.values()):
        return None
    when = f"is installed free of stress at stage '{stage}'" if stage else "begins free of stress"
    message = f"'{material.name}' {when}, which is outside its yield surface"
    hint = "Make all its distances positive at the start of the parameters."
    path: KeyPath = ("materials", material.name, "yield")
    return case.source.fault(path, "outside-at-zero", message, hint)


def _described(case: Case, material: Material) -> str:
    kinds = " and ".join(surface.description for surface in material.yields)
    if in_principal_stresses(material):
        return kinds
    count = len(yield_planes(material, ParameterPoint(case.start, ()), n_strain_of(case)).names)
    return f"{kinds}: {count} plane{'s' * (count > 1)}, with associated flow"
