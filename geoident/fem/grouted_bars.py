"""Bars that grout ties to the ground along their length, and that slip in it.

A bar has unknowns of its own: the motion w_j of its stations along itself, from head to toe. They
need no nodes of the ground there (`Mesh.stations_by`); the ground moves by the shape functions of
the element that holds a point. With t the direction of the bar, each of its pieces, of length h,
is a member with two rows, both of its middle:

    axial strain    e = (w_1 - w_0) / h                     weight h     N = EA e
    slip            s = (w_0 + w_1) / 2 - t . u(middle)     weight h     q = k_grout s = dN/ds

So equilibrium at the stations makes N linear in each piece, with the slope q, and without jumps.
Taken in the middle the slip of a long bar in rigid ground has exactly the stiffness of the closed
form, EA lambda with lambda^2 = k_grout / EA, however long the pieces are; the decay of N has an
error of (lambda h)^2 / 12.

A pile of a diameter takes the mean motion around its shaft in place of that on its axis: a load on
a line would sink in without end as the mesh gets finer.

A free length between a plate at the head and the grout is a piece with an axial strain alone, and
the toe of a pile is a spring against the ground below it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.fem.location import Site
from geoident.fem.structures import Members
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import Mesh


def stations(ends: Floats, free: float, pieces: int) -> Floats:
    """Stations (n, pieces + 1, dim) of bars from the beginning of the grout to the toe, m.

    Args:
        ends: (n, 2, dim) head and toe, m.
        free: length at the head without grout, m, shorter than every bar.
        pieces: of each bar.
    """
    along = ends[:, 1] - ends[:, 0]
    part = free / np.linalg.norm(along, axis=1)
    at = part[:, None] + (1.0 - part)[:, None] * np.linspace(0.0, 1.0, pieces + 1)
    return np.asarray(ends[:, :1] + at[..., None] * along[:, None])


class GroutedRows:
    """Rows of grouted bars on a mesh.

    Args:
        mesh: with unknowns for the stations.
        first: number of the first station among those of the mesh; they go by bar, head to toe.
        points: (n, pieces + 1, dim) of the stations, m.
        extent: (n,) to what the stiffness of each bar is multiplied, or 1.

    Attributes:
        nodes: (n, pieces + 1) of the mesh that are the stations.
        direction: (n, dim) unit vectors from head to toe.
    """

    def __init__(self, mesh: Mesh, first: int, points: Floats, extent: Floats) -> None:
        self._mesh, self._points, self.extent = mesh, points, extent
        n, count = points.shape[:2]
        start = mesh.n_nodes - len(mesh.stations_by) + first
        self.nodes: Ints = start + np.arange(n * count).reshape(n, count)
        along = points[:, -1] - points[:, 0]
        self.direction = along / np.linalg.norm(along, axis=1)[:, None]

    def motion(self, nodes: Ints) -> sp.csr_array:
        """(m, n_dofs) w of some stations (m,), by their nodes."""
        entries = np.ones(len(nodes)), (np.arange(len(nodes)), nodes * self._mesh.dim)
        return sp.csr_array(entries, shape=(len(nodes), self._mesh.points.size))

    def ground(self, sites: Sequence[Sequence[Site]], bars: Ints) -> sp.csr_array:
        """(m, n_dofs) t . u of the ground at places (m,), each on one of the bars (m,).

        A place is a point, or several around the shaft of which the mean counts.
        """
        dim = self._mesh.dim
        each = [
            (row, site, self.direction[bar] / len(held))
            for row, (held, bar) in enumerate(zip(sites, bars, strict=True))
            for site in held
        ]
        parts = [np.outer(site.shapes, along) for _, site, along in each]
        columns = [site.nodes[:, None] * dim + np.arange(dim) for _, site, _ in each]
        rows = np.repeat([row for row, _, _ in each], [part.size for part in parts])
        entries = (
            np.concatenate([part.ravel() for part in parts]),
            (rows, np.concatenate([column.ravel() for column in columns])),
        )
        return sp.csr_array(entries, shape=(len(sites), self._mesh.points.size))

    def grouted(
        self, middles: Sequence[Sequence[Site]], heads: Sequence[Sequence[Site]] | None
    ) -> Members:
        """The grouted lengths: rows e of all pieces, then their slips.

        Args:
            middles: what holds the middles of all pieces, bar by bar.
            heads: what holds the heads, where they move with the ground; None where they do not.
        """
        n, count = self.nodes.shape
        before, after = self.motion(self.nodes[:, :-1].ravel()), self.motion(
            self.nodes[:, 1:].ravel()
        )  # fmt: skip
        if heads is not None:
            held = np.zeros((n, count - 1))
            held[:, 0] = 1.0
            at_head = sp.csr_array(
                (np.ones(n), (np.flatnonzero(held), np.arange(n))), shape=(held.size, n)
            )
            own = sp.diags_array(1.0 - held.ravel())
            before = sp.csr_array(own @ before + at_head @ self.ground(heads, np.arange(n)))
        lengths = np.linalg.norm(np.diff(self._points, axis=1), axis=2).ravel()
        bars = np.repeat(np.arange(n), count - 1)
        strain = sp.diags_array(1 / lengths) @ (after - before)
        slip = 0.5 * (before + after) - self.ground(middles, bars)
        weight = np.tile(lengths * self.extent[bars], 2)
        ends = np.stack([self._points[:, :-1], self._points[:, 1:]], axis=2)
        return Members(
            sp.csr_array(sp.vstack([strain, slip])),
            weight,
            np.repeat([0, 1], len(lengths)),
            ends.reshape(len(lengths), 2, -1),
        )

    def free_lengths(self, heads: Sequence[Sequence[Site]], at: Floats) -> Members:
        """Bars from the ground at their heads (n, dim), m, to the first stations."""
        n = len(self.nodes)
        length = np.linalg.norm(self._points[:, 0] - at, axis=1)
        apart = self.motion(self.nodes[:, 0]) - self.ground(heads, np.arange(n))
        ends = np.stack([at, self._points[:, 0]], axis=1)
        operator = sp.csr_array(sp.diags_array(1 / length) @ apart)
        return Members(operator, length * self.extent, np.zeros(n, dtype=np.int64), ends)

    def toes(self, sites: Sequence[Sequence[Site]]) -> Members:
        """Springs from the last stations to the ground there, stretched where these lift off."""
        n = len(self.nodes)
        apart = self.ground(sites, np.arange(n)) - self.motion(self.nodes[:, -1])
        ends = self._points[:, -2:]
        return Members(sp.csr_array(apart), self.extent, np.zeros(n, dtype=np.int64), ends)
