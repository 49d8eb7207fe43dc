"""Where the gauges stand: in which element, from when to when, how far from what is excavated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import FacetPatch, distance_to_faces, patches
from geoident.fem.location import Site, format_point
from geoident.fem.measure import suspected_unit
from geoident.forward.gauges.observation import Observable
from geoident.forward.stages import CaseOnMesh, ConstructionSequence, element_number
from geoident.model.arrays import Bools
from geoident.model.gauges import Channel, Reads, named_channels

_SHOWN = 5  # stages in a hint


@dataclass(frozen=True)
class Placed:
    """Some channels (g) on the mesh.

    Args:
        observable: what they read.
        readable: (g, n_states) when they can be read.
        snapped: names of those with a point just outside the mesh.
        faults: what is wrong with them; then the observable is of no use.
        unreadable: why they cannot be read where they are not, a clause.
        as_built: names of those that count from the placing of their ground on (`best_site`).
    """

    observable: Observable
    readable: Bools
    snapped: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    unreadable: str = "a point of it lies in excavated ground"
    as_built: tuple[str, ...] = ()


def from_zero(on_mesh: CaseOnMesh, channel: Channel) -> Bools:
    """(n_states,) states from the zero of a channel on; all of them where it has none."""
    later = np.arange(len(on_mesh.sequence.states)) >= on_mesh.case.zero_of(channel)
    return later if channel.is_zeroed else np.ones_like(later)


def best_site(
    sites: tuple[Site, ...], sequence: ConstructionSequence, zero: int, *, as_built: bool = True
) -> tuple[Site | None, Bools]:
    """The site that stays for most states from the zero on, the best-lying one among equals.

    Where none is there at the zero, it is one that is placed right after it: what stands there
    then has not moved before, so the change since the zero is all of its motion, what its own
    placing does included ("as built").

    Args:
        sites: elements that hold the point.
        sequence: the states of construction.
        zero: index of the state at which the channel reads zero.
        as_built: whether ground that is placed right after the zero will do.

    Returns:
        The site, None if none is there; (n_states,) the states at which it is there and has been
        there on the way of construction from the zero, with the zero.
    """
    groups = [int(sequence.group_of[site.element]) for site in sites]
    for placed_next in (False, True) if as_built else (False,):
        stays = {
            group: unbroken(
                sequence,
                zero,
                np.array([group in state.materials for state in sequence.states]),
                placed_next=placed_next,
            )
            for group in set(groups)
        }
        pairs = zip(sites, groups, strict=True)
        best, group = max(pairs, key=lambda pair: stays[pair[1]].sum(), default=(None, -1))
        if best is not None and stays[group].any():
            return best, stays[group]
    return None, np.zeros(len(sequence.states), dtype=bool)


def is_placed_after(sequence: ConstructionSequence, zero: int, site: Site) -> bool:
    """Whether the ground of a site is placed only after its zero.

    Args:
        sequence: the states of construction.
        zero: index of the state at which the channel reads zero.
        site: of one of its points.
    """
    return int(sequence.group_of[site.element]) not in sequence.states[zero].materials


def unbroken(
    sequence: ConstructionSequence, zero: int, present: Bools, *, placed_next: bool = False
) -> Bools:
    """(n_states,) states from the zero on to which what is here has been here all the way.

    The way to a state on another branch leads back to where both part: what is not there has been
    built twice, and the motions of the two are not those of one thing.

    Args:
        sequence: the states of construction.
        zero: index of the state at which a channel reads zero.
        present: (n_states,) where it is there.
        placed_next: it is not there at the zero, and placed by the stage that builds on it.
    """
    built_on, states = sequence.built_on, np.arange(len(sequence.states))
    way = built_on ^ built_on[:, [zero]]
    parting = np.where(built_on & built_on[:, [zero]], states[:, None], 0).max(axis=0)
    way[parting, states] = True
    later = states >= zero
    if placed_next:
        way[zero], later = False, later & built_on[zero]
    stays = np.asarray(~(~present[:, None] & way).any(axis=0) & later)
    if placed_next and not stays[zero + 1 :].any():
        return np.zeros_like(stays)
    return stays


def point_fault(
    on_mesh: CaseOnMesh, channel: Channel, point: tuple[float, ...], sites: tuple[Site, ...]
) -> Fault:
    """Why a point of a gauge stands in no ground.

    Args:
        on_mesh: the case on its mesh.
        channel: of the gauge.
        point: (dim,) m.
        sites: elements that hold the point.
    """
    place, sequence = format_point(point), on_mesh.sequence
    if not sites and channel.structure:
        return on_mesh.case.source.fault(
            (*channel.key, "point"),
            "no-ground-behind",
            f"gauge '{channel.name}' finds no ground at {place} that presses on the "
            f"outside of '{channel.structure}' as long as that stands",
            "'towards' is a point on its inside, where ground is excavated",
        )
    if not sites:
        low, high = on_mesh.mesh.points.min(axis=0), on_mesh.mesh.points.max(axis=0)
        return on_mesh.case.source.fault(
            channel.key,
            "gauge-outside",
            f"point {place} of gauge '{channel.name}' lies outside the mesh",
            f"the mesh reaches from {format_point(low)} to {format_point(high)}"
            + (f"; {unit_hint}" if (unit_hint := suspected_unit(low, high)) else ""),
        )
    groups = sorted({sequence.groups[sequence.group_of[site.element]] for site in sites})
    when, hint = "is never there", "correct the point"
    if channel.reads is Reads.VIRGIN:
        when = "is not there before the first stage, when it is read"
    elif channel.is_zeroed:
        when = f"is not there at stage '{channel.zero}', where the gauge is zeroed"
        present = [
            state.name
            for state in sequence.states
            if any(sequence.groups[group] in groups for group in state.materials)
        ]
        hint = "correct the point, or let it be there: 'install' it"
        if present:
            others = ", ".join(map(repr, present[1:_SHOWN]))
            more = f" (it is there at {others}, too)" if others else ""
            hint = f"write 'zero: {present[0]}'{more}, or correct the point"
        placed = _first_placing(sequence, groups)
        if placed is not None:
            own, base = (sequence.states[n].name for n in placed)
            hint = f"set 'zero' to '{own}', which places that ground, or to '{base}' before it: "
            hint += "then what its own placing does counts, too"
    source, written = on_mesh.case.source, ("gauges", channel.gauge, "zero")
    return source.fault(
        written if channel.is_zeroed and written in source.positions else channel.key,
        "gauge-in-absent-ground",
        f"point {place} of gauge '{channel.name}' lies in '{', '.join(groups)}', which " + when,
        hint,
    )


def _first_placing(sequence: ConstructionSequence, groups: Sequence[str]) -> tuple[int, int] | None:
    """The first state that places ground of one of some groups, and that on which it builds."""
    wanted = {sequence.groups.index(name) for name in groups}
    for n, state in enumerate(sequence.states[1:], start=1):
        if wanted & (state.materials.keys() - sequence.states[state.base].materials.keys()):
            return n, state.base
    return None


def zeroed_too_early(on_mesh: CaseOnMesh) -> list[str]:
    """A note on convergences that are zeroed while ground is between their points, and read later.

    No tape can be spanned there: whoever installs it after the excavation and forgets its zero has
    the model count all that the excavation moved before.
    """
    case, states, group_of = on_mesh.case, on_mesh.sequence.states, on_mesh.sequence.group_of
    middles = {
        channel.name: on_mesh.kinematics.in_section(
            tuple(0.5 * (a + b) for a, b in zip(channel.first, channel.second, strict=True))
        )[0]
        for channel in case.channels
        if channel.kind == "convergence" and channel.first is not None
    }
    on_mesh.locator.find(middles.values())
    early: dict[int, list[str]] = {}
    for channel in case.channels:
        if channel.name not in middles:
            continue
        sites = on_mesh.locator.sites(middles[channel.name])
        groups, zero = {int(group_of[site.element]) for site in sites}, case.zero_of(channel)
        buried = [groups <= state.materials.keys() for state in states]  # not along a floor
        if groups and buried[zero] and not all(buried[zero:]):
            early.setdefault(zero, []).append(channel.name)
    return [
        f"convergences zeroed at '{states[zero].name}', when there is still ground between their "
        f"points that is excavated later: {named_channels(names)}; if they were installed after "
        "it, give the stage of the first reading as 'zero'"
        for zero, names in early.items()
    ]


@dataclass(frozen=True)
class Placement:
    """A point of a gauge on the mesh.

    Args:
        channels: names of the channels that end there.
        point: its coordinates, m.
        element: number of its element in the mesh file.
        group: of the element.
        distance: from the outline of all that is ever excavated, m; None if nothing is.
    """

    channels: tuple[str, ...]
    point: tuple[float, ...]
    element: int
    group: str
    distance: float | None


def placements(on_mesh: CaseOnMesh) -> tuple[Placement, ...]:
    """Where the points of all gauges stand, each once, in the order of the case."""
    case, mesh, sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
    outline = _excavation_outline(on_mesh)
    ends: dict[tuple[tuple[float, ...], int], list[str]] = {}
    for channel in case.channels:
        for point, _ in channel.motions:
            ends.setdefault((point, case.zero_of(channel)), []).append(channel.name)
    places = []
    for (point, zero), channels in ends.items():
        place, _ = on_mesh.kinematics.in_section(point)
        site, _ = best_site(on_mesh.locator.sites(place), sequence, zero)
        if site is not None:
            group = sequence.groups[sequence.group_of[site.element]]
            away = distance_to_faces(mesh, outline, np.asarray(place)) if outline else None
            number = element_number(mesh, site.element)
            places.append(Placement(tuple(channels), point, number, group, away))
    return tuple(places)


def _excavation_outline(on_mesh: CaseOnMesh) -> tuple[FacetPatch, ...]:
    """Faces between what is ever excavated and the ground that stays."""
    mesh, table = on_mesh.mesh, on_mesh.table
    dug = np.zeros(mesh.n_elements, dtype=bool)
    for stage in on_mesh.case.stages:
        for name in stage.excavate:
            dug[mesh.groups[name]] = True
    outer, edge = table.free(dug), table.free(np.ones_like(dug))
    inside = ~np.isin(table.face[outer], table.face[edge])
    return patches(mesh, table, outer[inside])
