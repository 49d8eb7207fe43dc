"""What of a structure in service does not fit its mesh, its stages or its materials."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import load_patches
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.gauges.observation import AnalysisState
from geoident.forward.model import StagedModel
from geoident.forward.stages import CaseOnMesh
from geoident.model.case import Case, KeyPath
from geoident.model.dual import ParameterPoint
from geoident.model.in_service import StructureInService
from geoident.model.mesh import nodes_in
from geoident.model.parameter import Scalar


def wetted_heights(on_mesh: CaseOnMesh, service: StructureInService) -> tuple[float, float]:
    """Lowest and highest elevation of the wetted faces, m; 0 and 1 where there are none."""
    mesh = on_mesh.mesh
    if not service.wetted:
        return 0.0, 1.0
    nodes = np.concatenate([nodes_in(mesh.facets, mesh.facet_groups[g]) for g in service.wetted])
    up = mesh.points[nodes, -1]
    return float(up.min()), float(up.max())


def service_faults(on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """What of a structure in service does not fit its mesh, its stages or its materials."""
    case, mesh = on_mesh.case, on_mesh.mesh
    service, source = case.service, case.source
    assert service is not None
    number = len(on_mesh.sequence.states) - 1
    state, present = on_mesh.sequence.states[number], on_mesh.sequence.present(number)
    what = "edges" if mesh.dim == 2 else "surfaces"
    sound = True
    acting = {"wetted": service.wetted, "air": service.in_air, "foundation": service.constant}
    places: list[tuple[KeyPath, str]] = [
        (("service", "faces", key, k), group)
        for key, groups in acting.items()
        for k, group in enumerate(groups)
    ]
    places += [
        (("service", "uplift", n, "on", k), group)
        for n, uplift in enumerate(service.uplift)
        for k, group in enumerate(uplift.on)
    ]
    for path, group in places:
        if group not in mesh.facet_groups:
            named, among = f"group of {what} '{group}'", f"groups of {what}"
            yield on_mesh.missing_group(path, named, among, mesh.facet_groups)
            sound = False
        elif load_patches(mesh, on_mesh.table, group, present) is None:
            message = f"not all of '{group}' is a free face at the stage '{state.name}'"
            hint = "Name faces that border the structure on one side only."
            if path[1] == "uplift":
                hint += " Under a dam on its rock: 'pores' with the groups of the rock."
            yield source.fault(path, "no-free-face", message, hint)
            sound = False
    for n, uplift in enumerate(service.uplift):
        there = [on_mesh.sequence.groups[g] for g in state.materials]
        for k, group in enumerate(uplift.pores):
            if group not in there:
                path = ("service", "uplift", n, "pores", k)
                message = f"there is no group '{group}' at the stage '{state.name}'"
                hint = f"Those that are there: {', '.join(there)}."
                yield source.fault(path, "no-ground-there", message, hint)
    if service.level is not None and sound:
        low, high = wetted_heights(on_mesh, service)
        yield from _level_faults(case, service, low, high)
    if service.air is not None:
        for name in dict.fromkeys(state.materials.values()):
            material = case.materials[name]
            if material.heat_capacity is not None and material.specific_heat is not None:
                message = f"'{name}' has 'heat_capacity' and 'specific_heat', which say the same"
                path = ("materials", name, "specific_heat")
                yield source.fault(path, "twice", message, "Keep one of them.")
            elif material.specific_heat is not None and material.density == Scalar(0.0):
                message = f"heat per mass of '{name}' needs its density"
                hint = "Add 'density', or write heat_capacity: 2.2 MJ/m3K."
                path = ("materials", name, "specific_heat")
                yield source.fault(path, "missing-key", message, hint)
            if not material.conducts:
                message = f"temperatures act, and how '{name}' conducts heat is not known"
                hint = "Add conductivity: 2.5 W/mK and heat_capacity: 2.2 MJ/m3K."
                path = ("materials", name)
                yield source.fault(path, "missing-key", message, hint)
        if state.temperature:
            message = f"temperatures of stages still act at '{state.name}', which is in service"
            hint = "End them in the last stage: temperature: {GROUP: 0 K}."
            if any(t != Scalar(0.0) for t in state.temperature.values()):
                yield source.fault(("stages",), "temperature", message, hint)
    for channel in case.channels:
        for key in ("offset", "drift", "drift_per_stage"):
            if getattr(channel, key) is not None:
                message = "in service each gauge has a constant of its own, and so a zero"
                hint = "Remove it; 'service.linear' lets every gauge have a motion that goes on."
                path = ("gauges", channel.gauge, key)
                yield source.fault(path, "own-constant", message, hint)


def _level_faults(
    case: Case, service: StructureInService, low: float, high: float
) -> Iterator[Fault]:
    """The water stays below the top of the wetted faces, and wets them at times."""
    series = service.level
    assert series is not None
    served = series.times >= service.since
    values = series.values[served] if served.any() else series.values
    times = series.times[served] if served.any() else series.times
    faces = ", ".join(service.wetted)
    at = int(np.argmax(values))
    hint = "Check unit and datum of the level, and that the wetted faces reach up to the crest."
    if values[at] > high + 1e-6 * (high - low):
        message = (
            f"the level of {np.datetime64(int(times[at]), 's').item():%Y-%m-%d} is "
            f"{values[at]:.6g} m, above the top of the wetted faces ({faces}) at {high:.6g} m"
        )
        yield case.source.fault(("loads", "level"), "above-crest", message, hint)
    elif values[at] <= low:
        message = (
            f"the level is never above {values[at]:.6g} m, the foot of the wetted faces ({faces}) "
            f"is at {low:.6g} m"
        )
        yield case.source.fault(("loads", "level"), "below-foot", message, hint)


def nonlinear_faults(model: StagedModel) -> Iterator[Fault]:
    """Channels that read no sum of the effects: principal stresses."""
    points = model.discretization.points
    nothing = StageEnd(
        0,
        np.zeros((model.discretization.n_dofs, 1)),
        np.zeros((points.n_strain, points.n_points, 1)),
        np.zeros((model.structures.n_rows, 1)),
        np.zeros(points.n_points, dtype=bool),
    )
    state = AnalysisState(nothing, ParameterPoint(model.case.start, ()), model.structures)
    for row, channel in enumerate(model.case.channels):
        if model.gauges.linear(state, np.array([row])) is None:
            message = f"'{channel.name}' reads a principal stress, which is no sum of effects"
            hint = "In service read components of the stress, or displacements and strains."
            path = ("gauges", channel.gauge)
            yield model.case.source.fault(path, "not-linear", message, hint)
