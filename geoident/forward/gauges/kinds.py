"""What the gauges of each kind read, and all gauges of a case on its mesh."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from geoident.errors import Fault
from geoident.forward.gauges.bar_displacement import bar_displacements
from geoident.forward.gauges.beam_tilt import tilts_of_beams
from geoident.forward.gauges.beyond_mesh import beside_fault
from geoident.forward.gauges.joint_meter import joint_meters
from geoident.forward.gauges.lining_pressure import pressures_on_linings
from geoident.forward.gauges.member_forces import member_readings
from geoident.forward.gauges.motion import relative_displacements
from geoident.forward.gauges.observation import PlacedGauges
from geoident.forward.gauges.placement import Placed, point_fault
from geoident.forward.gauges.pore_pressure import pore_pressures
from geoident.forward.gauges.shell_forces import shell_readings, tilts_of_shells
from geoident.forward.gauges.strain import strains
from geoident.forward.gauges.stress import stresses
from geoident.forward.gauges.thermometer import thermometers
from geoident.forward.gauges.zeros import WEIGHTS
from geoident.forward.stages import CaseOnMesh
from geoident.model.case import Case, format_path
from geoident.model.gauges import Channel
from geoident.model.structures import Shell

Placing = Callable[[Sequence[Channel], CaseOnMesh], Placed]

OBSERVABLES: Mapping[str, Placing] = {
    "extensometer": relative_displacements,
    "convergence": relative_displacements,
    "displacement": relative_displacements,
    "settlement": relative_displacements,
    "strain": strains,
    "stress": stresses,
    "pressure-cell": stresses,
    "piezometer": pore_pressures,
    "thermometer": thermometers,
    "inclinometer": relative_displacements,
    "target": relative_displacements,
    "tilt": relative_displacements,
    "levelling": relative_displacements,
    "line-of-sight": relative_displacements,
    "joint-meter": joint_meters,
}
"""What the gauges of a kind read in the ground."""

ON_STRUCTURES: Mapping[str, Placing] = {
    "load-cell": member_readings,
    "strain": member_readings,
    "pressure-cell": pressures_on_linings,
    "tilt": tilts_of_beams,
    "bar-displacement": bar_displacements,
}
"""What they read on a beam or on bars."""

ON_SHELLS: Mapping[str, Placing] = {
    "load-cell": shell_readings,
    "strain": shell_readings,
    "pressure-cell": pressures_on_linings,
    "tilt": tilts_of_shells,
}
"""What they read on a shell."""


def _in_ground(channel: Channel) -> Placing:
    """How a channel in the ground is placed: by its kind, and whether points move in it."""
    return relative_displacements if channel.terms else OBSERVABLES[channel.kind]


def _placing_of(channel: Channel, case: Case) -> Placing:
    """How a channel is placed: by its kind, and where it sits."""
    if not channel.structure:
        return _in_ground(channel)
    is_shell = isinstance(case.structures[channel.structure], Shell)
    return (ON_SHELLS if is_shell else ON_STRUCTURES)[channel.kind]


def reads_displacements(channel: Channel) -> bool:
    """Whether a channel reads displacements of points and nothing else."""
    moves = not channel.structure and _in_ground(channel) is relative_displacements
    return moves and not channel.turns


def place_gauges(on_mesh: CaseOnMesh) -> tuple[PlacedGauges, list[Fault]]:
    """The gauges of a case on its mesh, and what is wrong with them."""
    channels = on_mesh.case.channels
    readable = np.zeros((len(channels), len(on_mesh.sequence.states)), dtype=bool)
    reasons = [""] * len(channels)
    parts, snapped, as_built, faults = [], set[str](), set[str](), list[Fault]()
    placing = [_placing_of(channel, on_mesh.case) for channel in channels]
    for place in dict.fromkeys(placing):
        rows = np.flatnonzero([other is place for other in placing])
        placed = place([channels[row] for row in rows], on_mesh)
        parts.append((rows, placed.observable))
        readable[rows] = placed.readable
        for row in rows:
            reasons[row] = placed.unreadable
            if channels[row].branch:
                on_branch = on_mesh.sequence.built_on[on_mesh.case.zero_of(channels[row])]
                reasons[row] = reasons[row] if on_branch.all() else "it does not build on its zero"
                readable[row] &= on_branch
        faults += placed.faults
        snapped |= set(placed.snapped)
        as_built |= set(placed.as_built)
    names = tuple(channel.name for channel in channels)
    gauges = PlacedGauges(
        channels=names,
        zero=np.array([on_mesh.case.zero_of(channel) for channel in channels], np.int64),
        weights=np.array([WEIGHTS[channel.reads] for channel in channels]).reshape(-1, 2).T,
        readable=readable.T,
        parts=tuple(parts),
        reasons=tuple(reasons),
        snapped=tuple(name for name in names if name in snapped),
        as_built=tuple(name for name in names if name in as_built),
    )
    return gauges, faults


def gauges_outside(on_mesh: CaseOnMesh) -> list[Fault]:
    """Gauges in the ground with a point that lies outside the mesh, whatever ground is there when.

    Each point of a gauge is said once: the end of a casing is that of all its channels.
    """
    faults: dict[tuple[str, tuple[float, ...]], Fault] = {}
    for channel in on_mesh.case.channels:
        if channel.structure:
            continue
        moving = _in_ground(channel) is relative_displacements
        points = [point for point, _ in channel.motions] if moving else [channel.second]
        for point in points:
            sites = on_mesh.locator.sites(on_mesh.kinematics.in_section(point)[0])
            beside = beside_fault(on_mesh, channel, point, sites)
            if beside is not None or not sites:
                fault = beside or point_fault(on_mesh, channel, point, sites)
                faults.setdefault((channel.gauge, point), fault)
    return list(faults.values())


def reading_faults(
    case: Case, gauges: PlacedGauges, of_gauges: Sequence[Fault] = ()
) -> list[Fault]:
    """Readings that were taken when the gauge could not be read.

    Args:
        case: the case.
        gauges: those of the case, on its mesh.
        of_gauges: what is wrong with these; readings of faulty ones are not judged.
    """
    sound = {}
    for row, channel in enumerate(case.channels):
        key = format_path(channel.key)
        parts = f"{key}.", f"{key}["
        if not any(f.path == key or f.path.startswith(parts) for f in of_gauges):
            sound[channel.name] = row
    faults = []
    for reading in case.readings:
        if reading.channel not in sound:  # that of a faulty gauge, or of one that is left out
            continue
        state = case.stage_names.index(reading.stage)
        reason = gauges.unreadable(sound[reading.channel], state)
        if reading.value is not None and reason and not reading.bad:
            faults.append(
                Fault(
                    "unreadable-gauge",
                    f"gauge '{reading.channel}' can't have been read at stage "
                    f"'{reading.stage}': {reason}",
                    "leave the value blank, or correct the stage, the gauge's 'zero' or its points",
                    reading.location,
                )
            )
    return faults
