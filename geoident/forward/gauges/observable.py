"""What gauges read of the states of a march: one class and one function a quantity.

An observable turns a state of the march into values with derivatives. What a channel reads is its
value there less that at the zero of the channel, and what the instrument adds by itself
(`instrument_errors`). A new quantity is one class more, which says what it makes of displacements,
stresses and member forces, and one function, which places its channels, finds from when to when
they can be read, and stands in the table `observation.OBSERVABLES` under the kinds that read it.

Condensation and the formulations that solve all stages at once act on the ground with unit forces
along the readings (theory 4.1). An observable that is linear in the displacements alone, whatever
the parameters, gives its rows G' for that; any other has none, and these methods refuse it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.location import Site, format_point
from geoident.fem.measure import suspected_unit
from geoident.forward.gauges.beyond_mesh import beside_fault, is_beside
from geoident.forward.march.stage import LinearRows, StageEnd
from geoident.forward.stages import CaseOnMesh, ConstructionSequence
from geoident.forward.structures.members import Structures
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import ParameterPoint
from geoident.model.gauges import Channel, Reads
from geoident.model.mesh import Mesh


@dataclass(frozen=True)
class MarchState:
    """A state of the march, as observables see it.

    Args:
        end: displacements, stresses and member forces; columns are the value, n derivatives and k
            responses to unit forces.
        point: the parameters, and the n of them by which the march differentiates.
        structures: linings and bolts.
    """

    end: StageEnd
    point: ParameterPoint
    structures: Structures


class Observable(Protocol):
    """What some channels (g) read."""

    def linear(self, state: MarchState, wanted: Bools) -> LinearRows | None:
        """The derivative of the values by the state.

        Args:
            state: only its parameters and the sizes of its arrays count.
            wanted: (g,) the channels that are asked for; rows of others may be empty.

        Returns:
            None where a wanted channel is not linear in the state.
        """

    def values(self, state: MarchState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI, and their derivatives."""

    @property
    def rows(self) -> sp.csr_array | None:
        """G' (g, n_dofs) with values G' u; None where they are not linear in u alone."""


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
    unreadable: str = "a point of it stands in ground that is no longer there"
    as_built: tuple[str, ...] = ()


class RelativeDisplacements:
    """Motions of points against each other or against fixed ground: sums of vector . u, SI.

    Args:
        rows: G', (g, n_dofs).
    """

    def __init__(self, rows: sp.csr_array) -> None:
        self.rows = rows

    def linear(self, state: MarchState, wanted: Bools) -> LinearRows:
        """G' itself."""
        return LinearRows(u=self.rows)

    def values(self, state: MarchState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI."""
        return np.asarray(self.rows @ state.end.u)


def relative_displacements(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the motion of a point, or of two against each other.

    They can be read while their points stand in ground that has been there since the zero, on the
    way of construction from one to the other; or that is placed right after the zero: what has
    moved before is then no motion of theirs, and the readings count from the placing on.
    """
    kinematics, mesh, rows, readable = on_mesh.kinematics, on_mesh.mesh, [], []
    snapped: list[str] = []
    as_built: list[str] = []
    faults: list[Fault] = []
    nowhere: set[tuple[str, tuple[float, ...], str]] = set()
    ends_of_all = (point for channel in channels for point, _ in channel.motions)
    on_mesh.locator.find(kinematics.in_section(point)[0] for point in ends_of_all)
    for channel in channels:
        ends, stays = [], [from_zero(on_mesh, channel)]
        for point, vector in channel.motions:
            place, turned = kinematics.in_section(point)
            sites = on_mesh.locator.sites(place)
            site, there = best_site(sites, on_mesh.sequence, on_mesh.case.zero_of(channel))
            beside = beside_fault(on_mesh, channel, point, sites)
            if site is None or beside is not None:
                refused = (channel.gauge, point, channel.zero)
                if refused not in nowhere:  # said once of the end of a casing that all refer to
                    faults.append(beside or point_fault(on_mesh, channel, point, sites))
                nowhere.add(refused)
                continue
            moved = np.outer(site.shapes, turned * np.array(vector))
            if channel.turns:
                moved = site.gradients @ (np.array(channel.turns) * np.outer(turned, turned)).T
            ends.append((site, moved))
            stays.append(there)
            if is_beside(site):
                snapped.append(channel.name)
            if is_placed_after(on_mesh.sequence, on_mesh.case.zero_of(channel), site):
                as_built.append(channel.name)
        rows.append(_row(mesh, ends))
        readable.append(np.all(stays, axis=0))
    operator = sp.csr_array(sp.vstack(rows)) if rows else sp.csr_array((0, mesh.n_nodes * mesh.dim))
    when = np.array(readable, bool).reshape(-1, len(on_mesh.sequence.states))
    return Placed(
        RelativeDisplacements(operator),
        when,
        tuple(dict.fromkeys(snapped)),
        tuple(faults),
        as_built=tuple(dict.fromkeys(as_built)),
    )


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
    for before in (False, True) if as_built else (False,):
        best, longest = None, np.zeros(len(sequence.states), dtype=bool)
        known: dict[int, Bools] = {}  # all elements of a group stay as long
        for site in sites:
            group = int(sequence.group_of[site.element])
            if group not in known:
                known[group] = _stays(sequence, zero, group, before=before)
            stays = known[group]
            if stays.sum() > longest.sum():
                best, longest = site, stays
        if best is not None:
            break
    return best, longest


def is_placed_after(sequence: ConstructionSequence, zero: int, site: Site) -> bool:
    """Whether the ground of a site is placed only after its zero.

    Args:
        sequence: the states of construction.
        zero: index of the state at which the channel reads zero.
        site: of one of its points.
    """
    return int(sequence.group_of[site.element]) not in sequence.states[zero].materials


def _stays(sequence: ConstructionSequence, zero: int, group: int, *, before: bool) -> Bools:
    """(n_states,) states from the zero on to which no stage without the group leads.

    Args:
        sequence: the states of construction.
        zero: index of the state at which the channel reads zero.
        group: index of a group of elements.
        before: the group is placed by a stage that builds on the zero.
    """
    gone = np.array([group not in state.materials for state in sequence.states])
    built_on = sequence.built_on
    way = built_on ^ built_on[:, [zero]]
    way[zero] = not before
    later = np.arange(len(sequence.states)) >= zero
    stays = np.asarray(~(gone[:, None] & way).any(axis=0) & later)
    return stays if not before or stays[zero + 1 :].any() else np.zeros_like(stays)


def _row(mesh: Mesh, ends: list[tuple[Site, Floats]]) -> sp.csr_array:
    """One row of G', from points and what their nodes add to it, (n_a, dim)."""
    columns, values = [np.empty(0, np.int64)], [np.empty(0)]
    for site, moved in ends:
        columns.append((site.nodes[:, None] * mesh.dim + np.arange(mesh.dim)).ravel())
        values.append(moved.ravel())
    column = np.concatenate(columns)
    return sp.csr_array(
        (np.concatenate(values), (np.zeros_like(column), column)),
        shape=(1, mesh.n_nodes * mesh.dim),
    )


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
            code="no-ground-behind",
            message=f"gauge '{channel.name}' finds no ground at {place} that presses on the "
            f"outside of '{channel.structure}' as long as that stands",
            hint="'towards' is a point on its inside, where ground is excavated",
        )
    if not sites:
        low, high = on_mesh.mesh.points.min(axis=0), on_mesh.mesh.points.max(axis=0)
        return on_mesh.case.source.fault(
            channel.key,
            code="gauge-outside",
            message=f"point {place} of gauge '{channel.name}' lies outside the mesh",
            hint=f"the mesh reaches from {format_point(low)} to {format_point(high)}"
            + (f"; {said}" if (said := suspected_unit(low, high)) else ""),
        )
    groups = sorted({sequence.groups[sequence.group_of[site.element]] for site in sites})
    when, hint = "is never there", "correct the point"
    if channel.reads is Reads.VIRGIN:
        when = "is not there before the first stage, when it is read"
    elif channel.is_zeroed:
        when = f"is not there at stage '{channel.zero}', where the gauge is zeroed"
        hint = "set 'zero' to a stage at which that ground is present, or correct the point"
        placed = _first_placing(sequence, groups)
        if placed is not None:
            own, base = (sequence.states[n].name for n in placed)
            hint = f"set 'zero' to '{own}', which places that ground, or to '{base}' before it: "
            hint += "then what its own placing does counts, too"
    return on_mesh.case.source.fault(
        channel.key,
        code="gauge-in-absent-ground",
        message=f"point {place} of gauge '{channel.name}' stands in '{', '.join(groups)}', which "
        + when,
        hint=hint,
    )


def _first_placing(sequence: ConstructionSequence, groups: Sequence[str]) -> tuple[int, int] | None:
    """The first state that places ground of one of some groups, and that on which it builds."""
    wanted = {sequence.groups.index(name) for name in groups}
    for n, state in enumerate(sequence.states[1:], start=1):
        if wanted & (state.materials.keys() - sequence.states[state.base].materials.keys()):
            return n, state.base
    return None
