"""Bending moments at the nodes of beams, free of the teeth that quadratic elements leave.

The stress of quadratic elements bears on the three nodes of an edge with weights of 1 : 4 : 1, a
uniform pressure p on the two straight pieces of a beam there would with 1 : 2 : 1. What is too much
in the middle bends the beam to and fro from node to node: with h the length of a piece,

    M  is off by up to  +- p h^2 / 12 at the nodes,        Q by  +- p h / 6 in the pieces

if the beam is stiff against the ground. In a lining, whose M is that of the *unequal* part of the
pressure, this is more than M itself on usual meshes. At the middles of the pieces the teeth
cancel, so moments at the nodes are interpolated from there along the beam:

    between plain nodes     cubic in the lengths of arc, of two pieces on either side; or linear
    at a kink               mean of the parabolas through three middles on either side, so
                            that the peak of M is kept (at a
                            strut, another beam, a corner of this one)
    at an end that is held  the line through the two middles next to it
    at a free end, a hinge  what the beam has: zero
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.model.arrays import Bools, Floats, Ints

_CORNER = np.cos(np.radians(40.0))
"""Of the angle between pieces from which on a beam has a corner."""

_MOST = 3
"""Middles on one side of a kink from which a moment is extrapolated; two elsewhere."""

_Middle = tuple[int, float, float]
"""A piece, the sign of its moment as seen from another, and how far away its middle is."""


@dataclass(frozen=True)
class EndMoments:
    """Moments at the ends of pieces from those at their middles; linear.

    Args:
        kept: (n, 2) ends whose moment stays as it is.
        weights: (2 n, n) of the middles for the first ends of all pieces, then the second ends;
            zero where they are kept.
    """

    kept: Bools
    weights: sp.csr_array

    def apply(self, first: Floats, second: Floats) -> tuple[Floats, Floats]:
        """Moments (n, ...) at the first and second ends, of those that the pieces bear there."""
        moments = self.weights @ ((first + second) / 2).reshape(len(first), -1)
        at_first, at_second = moments.reshape(2, *first.shape)
        shape = (-1, *(1,) * (first.ndim - 1))
        return (
            np.where(self.kept[:, 0].reshape(shape), first, at_first),
            np.where(self.kept[:, 1].reshape(shape), second, at_second),
        )


class _Joints:
    """Pieces of a beam and how they meet."""

    def __init__(self, nodes: Ints, ends: Floats, kinked: Bools, hinged: Bools) -> None:
        self.nodes = nodes.tolist()
        along = ends[:, 1] - ends[:, 0]
        self.length = np.linalg.norm(along, axis=1)
        self._along = along / self.length[:, None]
        self.at: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for piece, pair in enumerate(self.nodes):
            for end, node in enumerate(pair):
                self.at[node].append((piece, end))
        self._kinked, self.hinged = kinked, hinged

    def sign(self, node: int) -> float:
        """-1 if both pieces at a node of two begin or end there, so that their sides differ."""
        (_, one), (_, other) = self.at[node]
        return 1.0 if one != other else -1.0

    def plain(self, node: int) -> bool:
        """Two pieces meet and M is smooth."""
        if len(self.at[node]) != 2 or self._kinked[node] or self.hinged[node]:
            return False
        (first, _), (second, _) = self.at[node]
        turn = self.sign(node) * float(self._along[first] @ self._along[second])
        return bool(turn > _CORNER)

    def side(self, piece: int, end: int) -> list[_Middle]:
        """The middle of a piece as seen from one of its ends, and of the next while M is smooth."""
        sign, distance = 1.0, self.length[piece] / 2
        middles = [(piece, sign, distance)]
        while len(middles) < _MOST:
            node = self.nodes[piece][1 - end]
            if not self.plain(node):
                break
            one, other = self.at[node]
            following, at = other if one[0] == piece else one
            sign *= self.sign(node)
            distance += (self.length[piece] + self.length[following]) / 2
            piece, end = following, at
            middles.append((piece, sign, distance))
        return middles


def end_moments(
    nodes: Ints, ends: Floats, toothed: Bools, kinked: Bools, held: Bools, hinged: Bools
) -> EndMoments:
    """How moments at the ends of the pieces of a beam follow from those at their middles.

    Args:
        nodes: (n, 2) nodes of the pieces.
        ends: (n, 2, 2) of the pieces, m.
        toothed: (n,) they lie on edges of quadratic elements.
        kinked: (n_nodes,) something else than the ground bears on the beam there.
        held: (n_nodes,) the beam does not turn there.
        hinged: (n_nodes,) its pieces turn against each other.
    """
    pieces = _Joints(nodes, ends, kinked, hinged)
    kept = np.ones((len(nodes), 2), dtype=bool)
    weights = sp.lil_array((2 * len(nodes), len(nodes)))
    for node, meeting in pieces.at.items():
        if hinged[node] or not all(toothed[piece] for piece, _ in meeting):
            continue
        if len(meeting) > 2 or (len(meeting) == 1 and not held[node]):
            continue
        sides = [pieces.side(piece, end) for piece, end in meeting]
        for seen, (piece, end) in enumerate(meeting):
            weighted = _weights(sides, seen, pieces, node)
            if weighted is None:
                continue
            kept[piece, end] = False
            for other, weight in weighted:
                weights[piece + end * len(nodes), other] += weight
    return EndMoments(kept, sp.csr_array(weights))


def _weights(
    sides: Sequence[Sequence[_Middle]], seen: int, pieces: _Joints, node: int
) -> list[tuple[int, float]] | None:
    """Pieces and weights of their middles for M at a node as one of its pieces sees it."""
    if len(sides) == 1:
        return _lagrange(sides[0][:2], 1.0) if len(sides[0]) > 1 else None
    across = pieces.sign(node)
    signs = [1.0 if k == seen else across for k in range(2)]
    if not pieces.plain(node) and all(len(side) > 1 for side in sides):
        return [
            (piece, 0.5 * weight)
            for side, sign in zip(sides, signs, strict=True)
            for piece, weight in _lagrange(side, sign)
        ]
    reach = min(2, *(len(side) for side in sides)) if pieces.plain(node) else 1
    known = [
        (piece, sign * own, distance if k == 0 else -distance)
        for k, (side, sign) in enumerate(zip(sides, signs, strict=True))
        for piece, own, distance in side[:reach]
    ]
    return _lagrange(known, 1.0)


def _lagrange(known: Sequence[_Middle], sign: float) -> list[tuple[int, float]]:
    """Weights of a polynomial through all that is known, at the distance zero."""
    return [
        (piece, sign * own * float(np.prod([b / (b - a) for m, (_, _, b) in enumerate(known)
                                            if m != k])))
        for k, (piece, own, a) in enumerate(known)
    ]  # fmt: skip
