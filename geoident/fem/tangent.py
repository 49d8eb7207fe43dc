"""Changes of the stiffness at single strain points, added to K on its pattern.

Where a point yields, its moduli change from E to T E (theory 5). K is the elastic matrix, which
costs one pass over node pairs (see `stiffness`), plus

    C_i^T V_i (T E - E)_i C_i

over the points that yield: element matrices, scattered to places that are found once for every
element that ever yields. The memory is linear in the number of elements; the work of a tangent in
the number of yielded points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from geoident.fem.elasticity import Moduli, ScaledModuli
from geoident.fem.kinematics import BlockGeometry, Kinematics
from geoident.fem.stiffness import StiffnessPattern
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh

_KEPT_LAW = 1e-14
"""Difference of moduli, relative to E_11, up to which kept matrices of points serve again."""

_CHUNK = 1_000_000  # entries of element matrices held at once


class PointBlocks:
    """Strain points of a mesh by the blocks of its elements.

    Args:
        mesh: the mesh.
        geometries: geometry of its blocks.
        kinematics: what makes strains.
    """

    def __init__(
        self, mesh: Mesh, geometries: tuple[BlockGeometry, ...], kinematics: Kinematics
    ) -> None:
        self.mesh = mesh
        self._geometries = geometries
        self._kinematics = kinematics
        counts = [geometry.volumes.size for geometry in geometries]
        self._first = np.concatenate([[0], np.cumsum(counts)])

    def by_block(self, points: Ints) -> Iterator[tuple[int, slice, Ints]]:
        """Ascending points (q,) by block.

        Yields:
            Number of the block, place in ``points``, and the points' numbers in the block.
        """
        ends = np.searchsorted(points, self._first)
        for block, (start, stop) in enumerate(pairwise(ends)):
            if stop > start:
                part = slice(int(start), int(stop))
                yield block, part, points[part] - self._first[block]

    def chunks(self, block: int, n_points: int, each: int = 1) -> Iterator[slice]:
        """Parts of some points of a block, each of a multiple of so many points."""
        chunk = each * max(1, _CHUNK // (each * self.n_unknowns(block) ** 2))
        for at in range(0, n_points, chunk):
            yield slice(at, min(at + chunk, n_points))

    def n_points(self, block: int) -> int:
        """Strain points of one element."""
        return int(self._geometries[block].volumes.shape[1])

    def n_unknowns(self, block: int) -> int:
        """Displacements of one element."""
        return int(self.mesh.blocks[block].nodes.shape[1]) * self.mesh.dim

    def element(self, block: int, points: Ints) -> Ints:
        """Elements (q,) within a block that hold some of its points."""
        return np.asarray(points // self._geometries[block].volumes.shape[1])

    def compatibility(self, block: int, points: Ints) -> Floats:
        """C of single points of a block, (q, s, n_unknowns), and nothing of other elements."""
        geometry = self._geometries[block]
        gradients = geometry.gradients.reshape(-1, *geometry.gradients.shape[2:])[points]
        adds = self._kinematics.incidence
        full = np.tensordot(gradients, adds, axes=(2, 2))  # (q, n_a, s, dim)
        return np.ascontiguousarray(full.transpose(0, 2, 1, 3)).reshape(
            len(points), adds.shape[0], -1
        )

    def dofs(self, block: int, elements: Ints) -> Ints:
        """Degrees of freedom (n, n_unknowns) of some elements of a block."""
        nodes = self.mesh.blocks[block].nodes[elements]
        dim = self.mesh.dim
        return np.asarray((nodes[:, :, None] * dim + np.arange(dim)).reshape(len(nodes), -1))

    def work(self, points: Ints, stress: Floats) -> sp.csr_array:
        """Work of a stress at every point on displacements: sigma_q^T C_q, (q, n_dofs) sparse.

        Args:
            points: (q,) strain points, ascending.
            stress: (s, q).
        """
        data, indices, counts = [], [], [np.zeros(1, dtype=np.int64)]
        adds = self._kinematics.incidence
        for block, part, local in self.by_block(points):
            gradients = self._geometries[block].gradients
            gradients = gradients.reshape(-1, *gradients.shape[2:])[local]
            pulls = np.tensordot(stress[:, part], adds, axes=(0, 0))  # (q, dim, n_entries)
            data.append(np.matmul(gradients, pulls.transpose(0, 2, 1)).ravel())
            n = self.n_unknowns(block)
            indices.append(self.dofs(block, self.element(block, local)).ravel())
            counts.append(np.full(len(local), n))
        indptr = np.cumsum(np.concatenate(counts))
        if not data:
            return sp.csr_array((0, self.mesh.points.size))
        entries = np.concatenate(data), np.concatenate(indices), indptr
        return sp.csr_array(entries, shape=(len(points), self.mesh.points.size))


class TangentPattern:
    """Where element matrices go in the values of K on one pattern.

    Args:
        blocks: the strain points.
        pattern: the pattern of K.
    """

    def __init__(self, blocks: PointBlocks, pattern: StiffnessPattern) -> None:
        self._blocks = blocks
        lower = pattern.lower
        columns = np.repeat(np.arange(lower.n), np.diff(lower.indptr))
        self._keys = (columns << 32) | lower.indices
        self._unknown = np.full(blocks.mesh.points.size, -1, dtype=np.int64)
        self._unknown[pattern.dofs] = np.arange(lower.n)
        self._slots: dict[int, Ints] = {}
        self._known: dict[int, Bools] = {}

    def added(self, points: Ints, change: Floats, *, symmetric: bool) -> tuple[Floats, Floats]:
        """What changes of moduli at some points add to K.

        Args:
            points: (q,) numbers of strain points, ascending.
            change: (q, s, s) change of the moduli times V, N m or N.
            symmetric: whether the changes are symmetric matrices.

        Returns:
            (nnz,) for the lower triangle and (nnz,) for the upper one, entry by entry its mirror.
        """
        nnz = len(self._keys)
        below, above = np.zeros(nnz + 1), np.zeros(nnz + 1)
        for block, part, local in self._blocks.by_block(points):
            for some in self._blocks.chunks(block, len(local)):
                B = self._blocks.compatibility(block, local[some])
                matrices = np.matmul(B.transpose(0, 2, 1), np.matmul(change[part][some], B))
                slots = self._slots_of(block, self._blocks.element(block, local[some]))
                i, j = np.tril_indices(B.shape[2])
                swapped = slots < 0  # the first of the pair comes earlier in the elimination
                place = np.where(swapped, ~slots, slots).ravel()
                one, other = matrices[:, i, j], matrices[:, j, i]
                below += _sums(place, np.where(swapped, other, one), nnz + 1)
                if not symmetric:
                    above += _sums(place, np.where(swapped, one, other), nnz + 1)
        return below[:-1], (below if symmetric else above)[:-1]

    @property
    def length(self) -> int:
        """Number nnz of values of K."""
        return len(self._keys)

    def places(self, block: int, elements: Ints) -> Ints:
        """Where the lower pairs (q, n_pairs) of symmetric matrices of elements go; nnz: nowhere."""
        slots = self._slots_of(block, elements)
        return np.asarray(np.where(slots < 0, ~slots, slots))

    def _slots_of(self, block: int, elements: Ints) -> Ints:
        """Places (q, n_pairs) of the lower pairs of element matrices; ~place where swapped."""
        if block not in self._slots:
            n_el, n = len(self._blocks.mesh.blocks[block]), self._blocks.n_unknowns(block)
            self._slots[block] = np.empty((n_el, n * (n + 1) // 2), dtype=np.int32)
            self._known[block] = np.zeros(n_el, dtype=bool)
        slots, known = self._slots[block], self._known[block]
        new = np.unique(elements[~known[elements]])
        if len(new):
            slots[new] = self._find(self._unknown[self._blocks.dofs(block, new)])
            known[new] = True
        return slots[elements]

    def _find(self, unknowns: Ints) -> Ints:
        """Places of the pairs of unknowns (n, n_unknowns) of elements, -1 for fixed ones."""
        i, j = np.tril_indices(unknowns.shape[1])
        one, other = unknowns[:, i], unknowns[:, j]
        row, column = np.maximum(one, other), np.minimum(one, other)
        place = np.searchsorted(self._keys, (column << 32) | row)
        place[column < 0] = len(self._keys)
        return np.where(one >= other, place, ~place)


_KEPT_PAIRS = 40_000_000
"""Entries of unit matrices of points that are kept: 0.3 GB."""


@dataclass(frozen=True, eq=False)
class _UnitMatrices:
    """Matrices (q, n_pairs) of points (q,) of a block for moduli (s, s) without size."""

    law: Floats
    points: Ints
    matrices: Floats


class PointwiseStiffness:
    """What moduli that vary from point to point add to K (theory 10.6).

    The sums over elements of `stiffness` are of no use then: K is the sum over the elements of
    C_q^T V_q E_q C_q. Where all points have the same matrix but for a factor, the matrices of the
    points are made once.

    Args:
        blocks: the strain points.
    """

    def __init__(self, blocks: PointBlocks) -> None:
        self._blocks = blocks
        self._units: dict[tuple[str, int], _UnitMatrices] = {}

    def values(
        self, pattern: TangentPattern, name: str, points: Ints, moduli: Moduli, volume: Floats
    ) -> Floats:
        """(nnz,) what some points add to the lower triangle of K.

        Args:
            pattern: of K.
            name: of their material; its unit matrices are kept under it.
            points: (q,) all strain points of some elements, ascending.
            moduli: at these points, Pa.
            volume: (n_points,) V.
        """
        total = np.zeros(pattern.length + 1)
        for block, part, local in self._blocks.by_block(points):
            weight = volume[points[part]]
            n_q = self._blocks.n_points(block)
            elements = self._blocks.element(block, local[::n_q])
            unit = self._unit(name, block, local, moduli)
            if unit is None:
                for some in self._blocks.chunks(block, len(local), each=n_q):
                    places = np.arange(part.start + some.start, part.start + some.stop)
                    change = moduli.matrices(places) * weight[some, None, None]
                    lower = self._element_matrices(block, local[some], change)
                    touched = elements[some.start // n_q : some.stop // n_q]
                    total += _sums(pattern.places(block, touched).ravel(), lower, len(total))
                continue
            assert isinstance(moduli, ScaledModuli)
            size = float(moduli.matrix[0, 0])
            lower = unit * (moduli.factor[part] * weight * size)[:, None]
            if n_q > 1:
                lower = lower.reshape(-1, n_q, lower.shape[1]).sum(axis=1)
            total += _sums(pattern.places(block, elements).ravel(), lower, len(total))
        return total[:-1]

    def _unit(self, name: str, block: int, asked: Ints, moduli: Moduli) -> Floats | None:
        """Lower pairs (q, n_pairs) of C^T J C with J = E / E_11, kept; None where there is no J."""
        n = self._blocks.n_unknowns(block)
        if not isinstance(moduli, ScaledModuli) or len(asked) * n * (n + 1) // 2 > _KEPT_PAIRS:
            return None
        law = moduli.matrix / moduli.matrix[0, 0]
        kept = self._units.get((name, block))
        same = kept is not None and np.allclose(kept.law, law, rtol=0.0, atol=_KEPT_LAW)
        if kept is None or not same or not np.isin(asked, kept.points).all():
            points = np.union1d(kept.points, asked) if kept is not None and same else asked
            kept = _UnitMatrices(law, points, self._unit_matrices(block, points, law))
            self._units[name, block] = kept
        if len(kept.points) == len(asked):
            return kept.matrices
        return np.asarray(kept.matrices[np.searchsorted(kept.points, asked)])

    def _unit_matrices(self, block: int, points: Ints, law: Floats) -> Floats:
        """Lower pairs (q, n_pairs) of C^T J C at some points of a block, J (s, s)."""
        n = self._blocks.n_unknowns(block)
        i, j = np.tril_indices(n)
        matrices = np.empty((len(points), len(i)))
        for some in self._blocks.chunks(block, len(points)):
            B = self._blocks.compatibility(block, points[some])
            matrices[some] = np.matmul(B.transpose(0, 2, 1), law @ B)[:, i, j]
        return matrices

    def _element_matrices(self, block: int, points: Ints, change: Floats) -> Floats:
        """Lower pairs (n_el, n_pairs) of the matrices of whole elements."""
        n_q = self._blocks.n_points(block)
        B = self._blocks.compatibility(block, points)
        _, s, n = B.shape
        moved = np.matmul(change, B).reshape(-1, n_q * s, n)
        full = np.matmul(B.reshape(-1, n_q * s, n).transpose(0, 2, 1), moved)
        i, j = np.tril_indices(n)
        return np.asarray(full[:, i, j])


def _sums(place: Ints, values: Floats, length: int) -> Floats:
    return np.asarray(np.bincount(place, weights=values.ravel(), minlength=length))
