"""How near the ground is to yielding, and what yielded: from stresses, strains and strengths."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.fem.kinematics import block_geometry, kinematics_of, strain_points
from geoident.forward.ground.elasticity import elastic_matrix
from geoident.forward.yielding.hoek_brown import hoek_brown, hoek_brown_share
from geoident.forward.yielding.surfaces import curved_surface, in_principal_stresses, yield_planes
from geoident.forward.yielding.varied import common_surface, factor_and_shift
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case, Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Growth, RandomField
from geoident.report.drawing.fields.panels import (
    ColouredField,
    add_levels,
    colour_bar,
    common_bands,
    draw_lines,
    field_figure,
    finish,
    ground_of,
    panel_figure,
    shade,
)
from geoident.report.drawing.model.construction import construction_of, values_of
from geoident.report.drawing.scene import Scene, SheetView, principal_stresses
from geoident.report.drawing.style import Picture, key

_MOST = 1.2  # of the strength; nothing but rounding and means over elements goes beyond 1
_ZONE = "#7a1f00"


def strength_pictures(view: SheetView) -> tuple[Picture, ...]:
    """Utilisation where strengths are known, and yielded zones where anything yields."""
    scene, pictures = view.scene, []
    if scene.case is not None and any(m.yields for m in scene.case.materials.values()):
        words = (
            "Shear stress by the shear strength at the same mean stress, with the strengths that "
            "were found: 100 % yields. Mean stresses of elements."
        )
        title = f"Utilisation of the strength{view.where}"
        draw = partial(utilisation_figure, view)
        pictures.append(Picture(f"{view.tag}utilisation", title, words, draw))
    if scene.fields.yielded.any():
        words = "Line: the zone that has yielded up to this stage."
        if _has_strain(scene):
            words += (
                " Colours: equivalent plastic strain, the square root of 2/3 of the squares of the "
                "plastic strains; total strains without the elastic ones."
            )
        title, draw = f"Yielded zones{view.where}", partial(yielded_figure, view)
        pictures.append(Picture(f"{view.tag}yielded", title, words, draw))
    return tuple(pictures)


def utilisation_figure(view: SheetView) -> Figure:
    """Utilisation at the key states."""
    scene, corners = view.scene, view.sheet.corners

    def at(view: SheetView, state: int) -> Floats:
        known = np.isfinite(values := utilisation(scene, state))
        return view.sheet.of_corners(corners.average(100.0 * values, known))

    return field_figure(view, ColouredField("utilisation (%)", at, "YlOrRd"), scene.key_states)


def utilisation(scene: Scene, state: int) -> Floats:
    """(n_elements,) share of the shear strength at the mean stress; NaN where there is none."""
    case = scene.case
    shares = np.full(scene.fields.mesh.n_elements, np.nan)
    if case is None:
        return shares
    point = ParameterPoint(values_of(case.parameters, scene.result.parameters), ())
    stress = scene.fields.stress[state]
    for material, elements in _materials_at(scene, case, state):
        if material.yields:
            common, moved = _common(scene, material, point, elements, stress[elements])
            shares[elements] = _share(common, point, moved, scene.solid)
    return np.asarray(np.clip(shares, 0.0, _MOST))


def _common(
    scene: Scene, material: Material, point: ParameterPoint, elements: Ints, stress: Floats
) -> tuple[Material, Floats]:
    """A material of one surface, and stresses (k, 6) as near to it as the given ones to theirs.

    Where strengths vary, by their estimates at the elements (`forward.yielding.varied`).
    """
    each: tuple[RandomField | Growth, ...] = (*material.fields, *material.growths)
    varied = [one for one in each if one.surface is not None]
    if not varied:
        return material, stress
    number, known = varied[0].surface, {one.name: one for one in scene.result.varied}
    strengths = {}
    assert number is not None
    for one in varied:
        if one.name not in known:  # a result without estimates
            return material, np.full_like(stress, np.nan)
        values = np.full(scene.fields.mesh.n_elements, np.nan)
        values[known[one.name].elements] = known[one.name].values
        strengths[one.constant] = Dual(values[elements, None])
    sizes = {name: float(np.nanmean(values.value)) for name, values in strengths.items()}
    common = common_surface(material, number, sizes, point.values)
    factor, shift = factor_and_shift(
        material.yields[number], common.yields[number], strengths, point
    )
    moved = stress.copy()
    moved[:, :3] -= shift.value[:, None]
    return common, moved / factor.value[:, None]


def _share(material: Material, point: ParameterPoint, stress: Floats, solid: bool) -> Floats:
    """(k,) by which the deviators of stresses (k, 6) reach the surface, seen from their mean."""
    mean = stress[:, :3].mean(axis=1)
    principal = principal_stresses(stress)[:, ::-1]
    curved = curved_surface(material)
    if curved is not None:
        return hoek_brown_share(hoek_brown(curved, point), mean, principal - mean[:, None])
    planes = yield_planes(material, point, 6 if solid else 4)
    normals, distances = planes.normals.value, planes.distances.value
    shown = principal if in_principal_stresses(material) else stress[:, : normals.shape[1]]
    isotropic = np.zeros(normals.shape[1])
    isotropic[:3] = 1.0
    deviator = shown - mean[:, None] * isotropic
    room = distances[None] - mean[:, None] * (normals @ isotropic)[None]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(room > 0, (deviator @ normals.T) / room, np.inf)
    return np.asarray(share.max(axis=1))


def _materials_at(scene: Scene, case: Case, state: int) -> list[tuple[Material, Ints]]:
    """The materials that stand in a state, with their elements (k,)."""
    mesh = scene.fields.mesh
    number = np.full(mesh.n_elements, -1)
    names = list(case.materials)
    for group, name in case.groups.items():
        if name is not None:
            number[mesh.groups[group]] = names.index(name)
    for stage in scene.history(state):
        now = case.stages[stage - 1]
        for group, name in {**now.install, **now.change}.items():
            number[mesh.groups[group]] = names.index(name)
    number[~scene.fields.present[state]] = -1
    return [
        (case.materials[names[k]], np.flatnonzero(number == k)) for k in np.unique(number) if k >= 0
    ]


def _has_strain(scene: Scene) -> bool:
    """Whether plastic strains can be told from the others: nothing strains without stress."""
    return scene.case is not None and not any(stage.temperature for stage in scene.case.stages)


def plastic_strain(scene: Scene) -> Floats | None:
    """(n_states, n_elements) equivalent plastic strain; NaN where it cannot be told.

    Total strains, means over elements, without the elastic strains of the change of stress. Told
    of ground that yields, stands from the beginning and keeps its material, and has the same
    elasticity everywhere.

    Args:
        scene: what is drawn.
    """
    case, fields = scene.case, scene.fields
    if case is None or not _has_strain(scene):
        return None
    kinematics = kinematics_of(case.analysis)
    geometries = tuple(
        block_geometry(fields.mesh.points, b, kinematics) for b in fields.mesh.blocks
    )
    points = strain_points(fields.mesh, geometries, kinematics)
    n_elements, s = fields.mesh.n_elements, points.n_strain
    volume = np.bincount(points.element, points.volume, minlength=n_elements)
    point = ParameterPoint(values_of(case.parameters, scene.result.parameters), ())
    made = construction_of(case, fields.mesh)
    changed = {group for stage in case.stages for group in stage.change}
    steady = made.placed == 0
    for group in changed:
        steady[fields.mesh.groups[group]] = False
    strains = np.full((scene.n_states, n_elements), np.nan)
    for state in (0, *scene.reached.tolist()):
        strain = points.strain(scene.displacement(state).ravel())
        total = np.array([np.bincount(points.element, e * points.volume, minlength=n_elements)
                          for e in strain]) / volume  # fmt: skip
        change = (fields.stress[state] - fields.stress[0]).T[:s]
        for material, elements in _materials_at(scene, case, state):
            here = elements[steady[elements]]
            varied: tuple[RandomField | Growth, ...] = (*material.fields, *material.growths)
            uniform = all(one.surface is not None for one in varied)  # its elasticity
            if material.yields and uniform and len(here):
                stiffness = elastic_matrix(material.elastic, point, section=not scene.solid).value
                elastic = np.linalg.solve(stiffness[:s, :s], change[:, here])
                plastic = total[:, here] - elastic
                squares = (plastic[:3] ** 2).sum(axis=0) + 0.5 * (plastic[3:] ** 2).sum(axis=0)
                strains[state, here] = np.sqrt(2.0 / 3.0 * squares)
    return strains


def yielded_figure(view: SheetView) -> Figure:
    """Plastic strain in colours and the outline of what has yielded, stage by stage."""
    scene, strains = view.scene, plastic_strain(view.scene)
    states = [s for s in scene.states if scene.fields.yielded[s].any()] or list(scene.states[-1:])
    figure, panels = panel_figure(view, len(states), extra=1.0)
    values = [_strain_at(view, strains, state) for state in states]
    scale = common_bands(view, states, values, "Oranges")
    for axes, state, value in zip(panels, states, values, strict=True):
        shading = shade(axes, view, state, value, scale)
        draw_lines(axes, view, state)
        _draw_zone(axes, view, state)
        finish(axes, view, state)
    if strains is not None:
        colour_bar(figure, shading, panels, "equivalent plastic strain (%)")
    figure.legend(handles=[key("yielded zone", color=_ZONE, lw=1.4)], loc="outside upper center")
    return figure


def _strain_at(view: SheetView, strains: Floats | None, state: int) -> Floats:
    """(n,) plastic strain at the points of a sheet, %; zero where the ground is elastic."""
    fields, sheet = view.scene.fields, view.sheet
    value = np.zeros(fields.mesh.n_elements) if strains is None else 100.0 * strains[state]
    value = np.where(fields.yielded[state], np.nan_to_num(value), 0.0)
    return sheet.of_corners(sheet.corners.average(value, fields.present[state]))


def _draw_zone(axes: Axes, view: SheetView, state: int) -> None:
    """The line inside which elements have yielded."""
    fields, sheet = view.scene.fields, view.sheet
    share = sheet.corners.average(fields.yielded[state].astype(float), fields.present[state])
    ground = ground_of(view, state)
    if ground is not None:
        share = np.nan_to_num(sheet.of_corners(share))
        add_levels(axes, ground, share, [0.5], colors=_ZONE, linewidths=1.1)
