"""Bars that grout ties to the ground along their length, and that slip in it; piles also bend.

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

A pile that bends has further unknowns, the motions v_j of its stations across itself, along each
axis n at right angles to it. Of them are the rows

    contact                 s = (v_0 + v_1) / 2 - n . u(middle)      weight h     p = k_lateral s
    curvature               k = (v_0 - 2 v_1 + v_2) / h^2            weight h     M = EI k

the first of the middle of each piece, the second of each station between two pieces (of a clamped
head k = 2 (v_1 - v_0) / h^2, weight h / 2). This is a chain of rigid links and springs (Hencky
1920; the central differences of EI d4v/ds4 = -p): M has an error of order h^2, head and toe that
turn freely have M = 0, and Q = dM/ds is constant in each piece.

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
        heads: what holds the first stations, where they move with the ground; None where they do
            not.

    Attributes:
        nodes: (n, pieces + 1) of the mesh that are the stations.
        axes: (n, dim, dim) unit vectors: from head to toe, and across the bar; in the plane to the
            left of it.
    """

    def __init__(
        self,
        mesh: Mesh,
        first: int,
        points: Floats,
        extent: Floats,
        heads: Sequence[Sequence[Site]] | None = None,
    ) -> None:
        self._mesh, self._points, self.extent, self._heads = mesh, points, extent, heads
        n, count = points.shape[:2]
        start = mesh.n_nodes - len(mesh.stations_by) + first
        self.nodes: Ints = start + np.arange(n * count).reshape(n, count)
        self.axes = np.stack([bar_axes(bar[-1] - bar[0]) for bar in points])
        self._lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)

    def motion(self, nodes: Ints, axis: int = 0) -> sp.csr_array:
        """(m, n_dofs) w or v of some stations (m,), by their nodes."""
        entries = np.ones(len(nodes)), (np.arange(len(nodes)), nodes * self._mesh.dim + axis)
        return sp.csr_array(entries, shape=(len(nodes), self._mesh.points.size))

    def ground(self, sites: Sequence[Sequence[Site]], bars: Ints, axis: int = 0) -> sp.csr_array:
        """(m, n_dofs) t . u or n . u of the ground at places (m,), each on one of the bars (m,).

        A place is a point, or several around the shaft of which the mean counts.
        """
        dim = self._mesh.dim
        each = [
            (row, site, self.axes[bar, axis] / len(held))
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

    def ends_of_pieces(self, axis: int = 0) -> tuple[sp.csr_array, sp.csr_array]:
        """(m, n_dofs) w or v of the first and of the second ends of all pieces, bar by bar."""
        n, count = self.nodes.shape
        first, second = self.nodes[:, :-1].ravel(), self.nodes[:, 1:].ravel()
        before, after = self.motion(first, axis), self.motion(second, axis)
        if self._heads is not None:
            held = np.zeros((n, count - 1))
            held[:, 0] = 1.0
            at_head = sp.csr_array(
                (np.ones(n), (np.flatnonzero(held), np.arange(n))), shape=(held.size, n)
            )
            own = sp.diags_array(1.0 - held.ravel())
            on_ground = self.ground(self._heads, np.arange(n), axis)
            before = sp.csr_array(own @ before + at_head @ on_ground)
        return before, after

    def grouted(self, middles: Sequence[Sequence[Site]]) -> Members:
        """The grouted lengths: rows e of all pieces, then their slips.

        Args:
            middles: what holds the middles of all pieces, bar by bar.
        """
        before, after = self.ends_of_pieces()
        strain = sp.diags_array(1 / self._lengths.ravel()) @ (after - before)
        slip = self._against_ground(middles, 0)
        return self._of_pieces([strain, slip], [0, 1])

    def contacts(self, middles: Sequence[Sequence[Site]]) -> Members:
        """What holds piles across themselves: motions against the ground, axis by axis."""
        axes = range(1, self._mesh.dim)
        return self._of_pieces([self._against_ground(middles, k) for k in axes], [0 for _ in axes])

    def bending(self, *, clamped: bool) -> Members:
        """Curvatures of piles at the heads of all pieces, axis by axis.

        Args:
            clamped: the heads do not turn; else no moment acts there, and those rows are empty.
        """
        first = np.zeros(self._lengths.shape)
        first[:, 0] = 1.0
        follows = sp.diags_array(1.0 - first.ravel())
        before_it = follows @ sp.eye_array(first.size, k=-1)
        rows, weights = [], np.where(first, 0.5, 1.0)
        at = (weights * self._lengths).ravel()
        for axis in range(1, self._mesh.dim):
            before, after = self.ends_of_pieces(axis)
            slope = sp.diags_array(1 / self._lengths.ravel()) @ (after - before)
            turned = slope if clamped else follows @ slope
            rows.append(sp.diags_array(1 / at) @ (turned - before_it @ slope))
        return self._of_pieces(rows, [0 for _ in rows], weights)

    def _against_ground(self, middles: Sequence[Sequence[Site]], axis: int) -> sp.csr_array:
        """(m, n_dofs) motions of the middles of pieces against the ground there."""
        before, after = self.ends_of_pieces(axis)
        n, pieces = self._lengths.shape
        on_ground = self.ground(middles, np.repeat(np.arange(n), pieces), axis)
        return sp.csr_array(0.5 * (before + after) - on_ground)

    def _of_pieces(
        self,
        rows: Sequence[sp.csr_array],
        rigidity: Sequence[int],
        part: Floats | float = 1.0,
    ) -> Members:
        """Members that are the pieces, each with its part of the length as the weight of a row."""
        weight = (part * self._lengths * self.extent[:, None]).ravel()
        ends = np.stack([self._points[:, :-1], self._points[:, 1:]], axis=2)
        return Members(
            sp.csr_array(sp.vstack(rows)),
            np.tile(weight, len(rows)),
            np.repeat(rigidity, len(weight)),
            ends.reshape(len(weight), 2, -1),
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


def bar_axes(along: Floats) -> Floats:
    """Unit vectors (dim, dim) along a bar and across it; in the plane to the left of it."""
    t = along / np.linalg.norm(along)
    if len(t) == 2:
        return np.array([t, [-t[1], t[0]]])
    first = np.cross(t, np.eye(3)[np.argmin(np.abs(t))])
    first /= np.linalg.norm(first)
    return np.array([t, first, np.cross(t, first)])
