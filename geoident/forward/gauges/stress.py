"""Stresses at a point, and what cells and flat jacks read of them.

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

from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.fem.recovery import Recovery
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.ground_points import GONE, GroundPoint, GroundPoints
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.placement import Placed
from geoident.forward.gauges.pore_pressure import PoreWater
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.gauges import Channel

COMPONENTS: Mapping[int, tuple[str, ...]] = {
    4: ("xx", "yy", "zz", "xy"),
    6: ("xx", "yy", "zz", "xy", "yz", "xz"),
}
"""Names of the components of a plane and of a solid, in their order."""

_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""Row and column of every component in the tensor."""

PRINCIPAL: Mapping[str, tuple[tuple[int, ...], int]] = {
    "major": ((0, 1, 2), 0),
    "intermediate": ((0, 1, 2), 1),
    "minor": ((0, 1, 2), 2),
    "plane-major": ((0, 1), 0),
    "plane-minor": ((0, 1), 1),
}
"""Principal values by name: of which rows of the tensor, and which, the most compressive first.

Those of the plane are of the section of a plane model, and of a horizontal plane in a solid."""

_COINCIDE = 1e-9
"""Difference of principal values, relative to the largest, below which they count as one."""


@dataclass(frozen=True)
class StressReader:
    """What one channel makes of the stress (n_strain, 1 + n + k) at its point.

    Args:
        channel: of the case.
        recovery: of the stress at its point.
        weights: (n_strain,) of the components; of no use for a principal value.
    """

    channel: Channel
    recovery: Recovery
    weights: Floats

    @classmethod
    def of(cls, point: GroundPoint) -> StressReader:
        """That of the channel of a point."""
        n_strain = point.on_mesh.kinematics.n_strain
        if point.channel.quantity in PRINCIPAL:
            weights = np.zeros(n_strain)
        else:
            weights = component_weights(point.channel, point.signs, n_strain)
        return cls(
            point.channel, point.recovery(), -weights if point.channel.compression else weights
        )

    def read(self, stress: Floats) -> Floats:
        """What the channel reads, (1 + n + k,)."""
        if self.channel.quantity not in PRINCIPAL:
            return np.asarray(self.weights @ stress)
        axes, rank = PRINCIPAL[self.channel.quantity]
        value = principal_values(_tensor(stress, axes))[0][rank]
        return np.asarray(-value if self.channel.compression else value)

    def coincides(self, stress: Floats) -> bool:
        """Whether its principal value, of a stress (n_strain, k), is one of several equal ones."""
        if self.channel.quantity not in PRINCIPAL:
            return False
        axes, rank = PRINCIPAL[self.channel.quantity]
        return bool(principal_values(_tensor(stress[:, :1], axes))[1][rank])


class StressReadings(Observable):
    """Stresses at points, Pa.

    Displacements alone do not give them: E(p) stands between, and the in-situ stress too.

    Args:
        points: of the channels (g,).
        on_mesh: the case on its mesh.
    """

    def __init__(self, points: Sequence[GroundPoint], on_mesh: CaseOnMesh) -> None:
        self._readers = [StressReader.of(point) for point in points]
        self._water = PoreWater(points, on_mesh)

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows | None:
        """Components are linear in the stress; principal values are not."""
        n_strain, n_points, _ = state.end.stress.shape
        rows = sp.lil_array((len(self._readers), n_strain * n_points))
        for row in np.flatnonzero(wanted):
            reader = self._readers[row]
            if reader.channel.quantity in PRINCIPAL:
                return None
            columns = np.arange(n_strain)[:, None] * n_points + reader.recovery.points
            rows[row, columns.ravel()] = np.outer(reader.weights, reader.recovery.weights).ravel()
        return LinearRows(stress=sp.csr_array(rows))

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, Pa."""
        readings = [reader.read(stress) for reader, stress in self._stresses(state)]
        return np.array(readings).reshape(len(readings), state.end.stress.shape[2])

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """Names of channels whose principal value is one of several equal ones there."""
        return tuple(r.channel.name for r, stress in self._stresses(state) if r.coincides(stress))

    def _stresses(self, state: AnalysisState) -> Iterator[tuple[StressReader, Floats]]:
        """Every reader with the stress at its point, total or effective as it reads it."""
        pressures = self._water.at(state)
        for reader, pressure in zip(self._readers, pressures, strict=True):
            stress = reader.recovery.at(state.end.stress)
            if not reader.channel.effective:
                stress[:NORMAL_COMPONENTS, : len(pressure)] -= pressure
            yield reader, stress


def stresses(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the stress at a point, while its ground is there."""
    placed = GroundPoints.of(channels, on_mesh)
    observable = StressReadings(placed.points, on_mesh)
    return Placed(observable, placed.readable, placed.snapped, placed.faults, GONE)


def component_weights(channel: Channel, signs: Floats, n_strain: int) -> Floats:
    """What stress components are multiplied with for the one that a channel reads, (n_strain,).

    Args:
        channel: reads a component, or n . S n with the direction n.
        signs: (dim,) of the axes in the section: across the axis of revolution x is turned.
        n_strain: number of components.
    """
    if channel.quantity in COMPONENTS[n_strain]:
        place = COMPONENTS[n_strain].index(channel.quantity)
        i, j = _ENTRIES[place]
        turned = np.pad(signs, (0, NORMAL_COMPONENTS - len(signs)), constant_values=1.0)
        return np.asarray(np.eye(n_strain)[place] * turned[i] * turned[j])
    n = np.pad(np.array(channel.direction) * signs, (0, NORMAL_COMPONENTS - len(signs)))
    products = [n[i] * n[j] * (1.0 if i == j else 2.0) for i, j in _ENTRIES]
    return np.array(products[:n_strain])


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
    for same in np.split(np.arange(len(values)), np.flatnonzero(apart) + 1):
        equal[same] = len(same) > 1
        block = turned[:, same[:, None], same]
        result[same, 1:] = np.linalg.eigvalsh(block).T if len(same) > 1 else block[:, 0, 0]
    return result, equal


def _tensor(stress: Floats, axes: tuple[int, ...]) -> Floats:
    """Rows and columns of the stress tensor, (d, d, k), of components (n_strain, k)."""
    full = np.zeros((3, 3, stress.shape[1]))
    for component, (i, j) in zip(stress, _ENTRIES, strict=False):
        full[i, j] = full[j, i] = component
    return np.asarray(full[np.ix_(axes, axes)])
