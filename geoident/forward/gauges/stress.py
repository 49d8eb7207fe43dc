"""Stresses, pressures of cells and of water: what gauges read of the stress at a point.

The stress sigma' of the analysis is that of the skeleton. Together with the water it is
sigma = sigma' - p; that is what an overcoring cell, a flat jack or a pressure cell feels, unless
the case asks for the effective one. Tension is positive; a channel that counts compression reads
the negative.

Principal values lambda_i of a stress S are differentiated by perturbation, with its unit
eigenvectors v_i: dlambda_i = v_i^T dS v_i. Where some coincide their eigenvectors V are not
determined; as each parameter grows they part like the eigenvalues of V^T dS V, in their order.
These one-sided derivatives are taken then, and `StressReadings.coinciding` says where.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.kinematics import Kinematics
from geoident.fem.location import Site, format_point
from geoident.fem.recovery import Recovery, recovery
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.beyond_mesh import beside_fault, is_beside
from geoident.forward.gauges.observation import AnalysisState
from geoident.forward.gauges.placement import Placed, best_site, point_fault
from geoident.forward.in_situ.water import PorePressure
from geoident.forward.stages import CaseOnMesh, ConstructionSequence
from geoident.model.actions import Water
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import ParameterPoint
from geoident.model.gauges import Channel, Reads
from geoident.model.mesh import Mesh

COMPONENTS: Mapping[int, tuple[str, ...]] = {
    4: ("xx", "yy", "zz", "xy"),
    6: ("xx", "yy", "zz", "xy", "yz", "xz"),
}
"""Names of the components of a plane and of a solid, in their order."""

NORMAL_COMPONENTS = 3
"""Number of normal components, which come first."""

_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""Row and column of every component in the tensor."""

_COINCIDE = 1e-9
"""Difference of principal values, relative to the largest, below which they count as one."""


class PoreWater:
    """Pressure of the water at fixed places in the ground.

    Args:
        sequence: the states of construction.
        mesh: for a table with topography.
        positions: (g, dim) places, m.
        groups: g names of the groups in which they lie.
    """

    def __init__(
        self, sequence: ConstructionSequence, mesh: Mesh, positions: Floats, groups: Sequence[str]
    ) -> None:
        self._sequence = sequence
        self._mesh, self._positions, self._groups = mesh, positions, groups
        self._ready: dict[Water, PorePressure] = {}

    def at(self, state: int, point: ParameterPoint) -> Floats:
        """Pressure (g, 1 + n) at a state, Pa; zero where there is no water."""
        water = self._sequence.states[state].water
        if water is None:
            return np.zeros((len(self._groups), point.n_columns))
        if water not in self._ready:
            self._ready[water] = PorePressure(water, self._mesh, self._positions)
        pressure = np.broadcast_to(
            self._ready[water].at(point).columns, (len(self._groups), point.n_columns)
        )
        return np.where(self.wet(state)[:, None], pressure, 0.0)

    def wet(self, state: int) -> Bools:
        """(g,) places in groups with water in their pores at a state."""
        water = self._sequence.states[state].water
        if water is None or water.groups is None:
            return np.full(len(self._groups), water is not None)
        return np.isin(np.array(self._groups, dtype=object), list(water.groups))


@dataclass(frozen=True)
class Reader:
    """What one channel makes of the stress (n_strain, 1 + n + k) at its place.

    Args:
        name: of the channel.
        recovery: of the stress at its place.
        coefficients: (n_strain,) of the components; None for a principal value.
        axes: rows of the tensor whose principal value it is.
        rank: which of them, from the most compressive one on.
        sign: -1 where compression counts.
        total: with the water.
    """

    name: str
    recovery: Recovery
    coefficients: Floats | None
    axes: tuple[int, ...]
    rank: int
    sign: float
    total: bool

    def read(self, stress: Floats) -> Floats:
        """What the channel reads, (1 + n + k,)."""
        if self.coefficients is not None:
            return np.asarray(self.sign * (self.coefficients @ stress))
        values, _ = principal_values(_tensor(stress, self.axes))
        return np.asarray(self.sign * values[self.rank])

    def coincides(self, stress: Floats) -> bool:
        """Whether its principal value, of a stress (n_strain, k), is one of several equal ones."""
        if self.coefficients is not None:
            return False
        return bool(principal_values(_tensor(stress[:, :1], self.axes))[1][self.rank])


class StressReadings:
    """Stresses at points, Pa.

    Args:
        readers: what each of the channels (g,) makes of the stress there.
        water: in the pores, at these points.
    """

    rows = None  # E(p) stands between the displacements and the stress, and the in-situ stress too

    def __init__(self, readers: Sequence[Reader], water: PoreWater) -> None:
        self._readers, self._water = readers, water

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows | None:
        """Components are linear in the stress; principal values are not."""
        n_strain, n_points, _ = state.end.stress.shape
        rows = [np.empty(0, np.int64)]
        columns, values = [np.empty(0, np.int64)], [np.empty(0)]
        for row, reader in enumerate(self._readers):
            if not wanted[row]:
                continue
            if reader.coefficients is None:
                return None
            places = np.arange(n_strain)[:, None] * n_points + reader.recovery.points
            columns.append(places.ravel())
            weights = np.outer(reader.sign * reader.coefficients, reader.recovery.weights)
            values.append(weights.ravel())
            rows.append(np.full(weights.size, row))
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        shape = len(self._readers), n_strain * n_points
        return LinearRows(stress=sp.csr_array(entries, shape=shape))

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, Pa."""
        readings = [reader.read(stress) for reader, stress in self._stresses(state)]
        return np.array(readings).reshape(len(readings), state.end.stress.shape[2])

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """Names of channels whose principal value is one of several equal ones there."""
        return tuple(r.name for r, stress in self._stresses(state) if r.coincides(stress))

    def _stresses(self, state: AnalysisState) -> Iterator[tuple[Reader, Floats]]:
        pressure = self._water.at(state.end.state, state.point)
        for reader, own in zip(self._readers, pressure, strict=True):
            stress = reader.recovery.at(state.end.stress)
            if reader.total:
                stress[:NORMAL_COMPONENTS, : len(own)] -= own
            yield reader, stress


class PorePressures:
    """Pressure of the water in the pores, Pa, compression positive.

    Args:
        water: in the pores, at the places of the channels (g,).
    """

    rows = None  # no displacement in it

    def __init__(self, water: PoreWater) -> None:
        self._water = water

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """Nothing of the state is in it."""
        return LinearRows()

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, Pa."""
        pressure = self._water.at(state.end.state, state.point)
        more = state.end.u.shape[1] - pressure.shape[1]
        return np.pad(pressure, ((0, 0), (0, more)))

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """None: there are no principal values."""
        return ()


def principal_values(tensor: Floats) -> tuple[Floats, Bools]:
    """Eigenvalues with their derivatives, the most compressive first, and which are equal ones.

    Args:
        tensor: (d, d, 1 + n) symmetric, tension positive, and its derivatives.

    Returns:
        (d, 1 + n), and (d,) which coincide with another one.
    """
    values, vectors = np.linalg.eigh(tensor[..., 0])
    result = np.empty((len(values), tensor.shape[2]))
    result[:, 0] = values
    apart = np.diff(values) > _COINCIDE * np.abs(values).max()
    equal = np.zeros(len(values), dtype=np.bool_)
    turned = np.einsum("ia,ijc,jb->cab", vectors, tensor[..., 1:], vectors)
    for own in np.split(np.arange(len(values)), np.flatnonzero(apart) + 1):
        equal[own] = len(own) > 1
        block = turned[:, own[:, None], own]
        result[own, 1:] = np.linalg.eigvalsh(block).T if len(own) > 1 else block[:, 0, 0]
    return result, equal


def _tensor(stress: Floats, axes: tuple[int, ...]) -> Floats:
    """Rows and columns of the stress tensor, (d, d, k), of components (n_strain, k)."""
    full = np.zeros((3, 3, stress.shape[1]))
    for component, (i, j) in zip(stress, _PLACES, strict=False):
        full[i, j] = full[j, i] = component
    return np.asarray(full[np.ix_(axes, axes)])


def normal_coefficients(direction: Floats, n_strain: int) -> Floats:
    """What the components are multiplied with for n . S n, (n_strain,).

    Args:
        direction: n, (dim,) unit vector.
        n_strain: number of components.
    """
    n = np.pad(direction, (0, NORMAL_COMPONENTS - len(direction)))
    twice = [1.0 if i == j else 2.0 for i, j in _PLACES]
    products = [f * n[i] * n[j] for f, (i, j) in zip(twice, _PLACES, strict=True)]
    return np.array(products[:n_strain])


def stresses(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the stress at a point, while its ground is there."""
    spots = Spots.of(channels, on_mesh)
    observable = StressReadings(readers_of(spots, on_mesh), spots.water(on_mesh))
    return Placed(observable, spots.readable, spots.snapped, spots.faults, GONE)


def readers_of(spots: Spots, on_mesh: CaseOnMesh) -> list[Reader]:
    """What channels at some places make of the stress there; none of those without ground."""
    kinematics = on_mesh.kinematics
    return [
        _reader(spot, spot.site, on_mesh, kinematics)
        for spot in spots.found
        if spot.site is not None
    ]


def pore_pressures(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the pressure of the water at a point, while its ground has water."""
    spots = Spots.of(channels, on_mesh)
    water = spots.water(on_mesh)
    readable, faults = spots.readable.copy(), list(spots.faults)
    if not faults:
        wet = np.array([water.wet(state) for state in range(readable.shape[1])]).T
        for row, channel in enumerate(channels):
            if not wet[row].any():
                faults.append(_dry_fault(on_mesh, channel))
        readable &= wet
    why = "there is no water in the pores of its ground then"
    return Placed(PorePressures(water), readable, spots.snapped, tuple(faults), why)


GONE = "the ground at its point is not there then"


@dataclass(frozen=True)
class _Spot:
    """The place of one channel: its element, and when its ground is there."""

    channel: Channel
    place: Floats
    signs: Floats
    site: Site | None
    there: Bools


@dataclass(frozen=True)
class Spots:
    """The places of some channels (g,) in the ground.

    Args:
        found: of each channel.
        readable: (g, n_states) when it can be read.
        snapped: names of those just outside the mesh.
        faults: of those that stand in no ground.
    """

    found: tuple[_Spot, ...]
    readable: Bools
    snapped: tuple[str, ...]
    faults: tuple[Fault, ...]

    @classmethod
    def of(
        cls,
        channels: Sequence[Channel],
        on_mesh: CaseOnMesh,
        given: Sequence[tuple[Site, ...]] | None = None,
        *,
        as_built: bool = False,
    ) -> Spots:
        """The places of channels.

        Args:
            channels: some channels (g,), each read at its second point.
            on_mesh: the case on its mesh.
            given: g times the elements that count as holding the point; None: all that do.
            as_built: whether ground that is placed right after the zero will do.
        """
        kinematics = on_mesh.kinematics
        spots, faults = [], []
        for row, channel in enumerate(channels):
            place, signs = kinematics.in_section(channel.second)
            sites = on_mesh.locator.sites(place) if given is None else given[row]
            site, there = _site(channel, sites, on_mesh, as_built=as_built)
            spots.append(_Spot(channel, np.array(place), signs, site, there))
            beside = None if given else beside_fault(on_mesh, channel, channel.second, sites)
            if site is None or beside is not None:
                faults.append(beside or point_fault(on_mesh, channel, channel.second, sites))
        snapped = (s.channel.name for s in spots if s.site is not None and is_beside(s.site))
        readable = np.array([spot.there for spot in spots], dtype=np.bool_)
        shape = (len(spots), len(on_mesh.sequence.states))
        return cls(tuple(spots), readable.reshape(shape), tuple(snapped), tuple(faults))

    def water(self, on_mesh: CaseOnMesh) -> PoreWater:
        """The water in the pores at these places."""
        sequence = on_mesh.sequence
        in_ground = [spot for spot in self.found if spot.site is not None]
        positions = np.array([spot.place for spot in in_ground]).reshape(-1, on_mesh.mesh.dim)
        groups = [
            sequence.groups[sequence.group_of[spot.site.element]]
            for spot in in_ground
            if spot.site is not None
        ]
        return PoreWater(sequence, on_mesh.mesh, positions, groups)


def _site(
    channel: Channel, sites: tuple[Site, ...], on_mesh: CaseOnMesh, *, as_built: bool
) -> tuple[Site | None, Bools]:
    """The element that holds the point of a channel, and (n_states,) when it can be read there.

    A change needs ground that stays from its zero on; a value needs it when it is read.
    """
    sequence = on_mesh.sequence
    if channel.is_zeroed:
        return best_site(sites, sequence, on_mesh.case.zero_of(channel), as_built=as_built)
    states = range(len(sequence.states))
    best, longest = None, np.zeros(len(sequence.states), dtype=np.bool_)
    for site in sites:
        there = np.array([bool(sequence.present(n)[site.element]) for n in states])
        if channel.reads is Reads.VIRGIN:
            there = np.full_like(there, there[0])
        if there.sum() > longest.sum():
            best, longest = site, there
    return best, longest


def _reader(spot: _Spot, site: Site, on_mesh: CaseOnMesh, kinematics: Kinematics) -> Reader:
    channel, group_of = spot.channel, on_mesh.sequence.group_of
    group = group_of == group_of[site.element]
    recovered = recovery(on_mesh.mesh, kinematics, site.element, group, spot.place)
    sign = -1.0 if channel.compression else 1.0
    total = not channel.effective
    if channel.quantity in PRINCIPAL:
        axes, rank = PRINCIPAL[channel.quantity]
        return Reader(channel.name, recovered, None, axes, rank, sign, total)
    weights = component_weights(channel, spot.signs, kinematics.n_strain)
    return Reader(channel.name, recovered, weights, (), 0, sign, total)


def component_weights(channel: Channel, signs: Floats, n_strain: int) -> Floats:
    """What stress components are multiplied with for the one that a channel reads, (n_strain,).

    Args:
        channel: reads a component, or what is normal to a plane.
        signs: (dim,) of the axes in the section: across the axis of revolution x is turned.
        n_strain: number of components.
    """
    if channel.quantity in COMPONENTS[n_strain]:
        place = COMPONENTS[n_strain].index(channel.quantity)
        i, j = _PLACES[place]
        turned = np.pad(signs, (0, NORMAL_COMPONENTS - len(signs)), constant_values=1.0)
        return np.asarray(np.eye(n_strain)[place] * turned[i] * turned[j])
    return normal_coefficients(np.array(channel.direction) * signs, n_strain)


PRINCIPAL: Mapping[str, tuple[tuple[int, ...], int]] = {
    "major": ((0, 1, 2), 0),
    "intermediate": ((0, 1, 2), 1),
    "minor": ((0, 1, 2), 2),
    "plane-major": ((0, 1), 0),
    "plane-minor": ((0, 1), 1),
}
"""Principal values by name: of which rows of the tensor, and which, the most compressive first.

Those of the plane are of the section of a plane model, and of a horizontal plane in a solid."""


def _dry_fault(on_mesh: CaseOnMesh, channel: Channel) -> Fault:
    """No water is ever in the pores where a gauge reads its pressure."""
    waters = [state.water for state in on_mesh.sequence.states if state.water is not None]
    named = sorted({name for water in waters for name in water.groups or ()})
    where = f"only in {', '.join(map(repr, named))}" if named else "nowhere"
    return on_mesh.case.source.fault(
        channel.key,
        code="no-water-there",
        message=f"gauge '{channel.name}' reads the pressure of the water in the pores at "
        f"{format_point(channel.second)}, but the case has such water {where}",
        hint="give 'water' with the level of its table, or correct its 'groups' or the point",
    )
