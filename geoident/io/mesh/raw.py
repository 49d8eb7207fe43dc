"""What every mesh reader delivers, before anything is known of the analysis.

A reader fills a `RawMesh` with what its file says and raises `Refused` with a sentence when it
cannot; `geoident.io.mesh.build` makes the `Mesh` of it and holds all the checks that formats share.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints


class Refused(Exception):
    """A mesh cannot be used: what was found, and what to do about it.

    Args:
        code: what kind of fault it is, for programs.
        message: what was found.
        hint: what to do about it; empty for nothing to say.
        line: of the file; 0 for none.
    """

    def __init__(self, code: str, message: str, hint: str = "", line: int = 0) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint
        self.line = line


@dataclass(frozen=True)
class RawCells:
    """Cells of one kind, in a row of the file.

    Args:
        kind: a key of `geoident.model.cells.CELLS`, or a name of the reader's own.
        dim: dimension of the cells, 0 to 3.
        nodes: (n_cells, nodes per cell) node indices from 0, in VTK's order.
        numbers: (n_cells,) numbers under which the user knows the cells.
    """

    kind: str
    dim: int
    nodes: Ints
    numbers: Ints

    def __len__(self) -> int:
        return int(self.nodes.shape[0])


@dataclass(frozen=True)
class RawMesh:
    """A mesh as its file has it.

    Args:
        points: (n_nodes, 2 or 3) coordinates in m.
        cells: cells of all dimensions.
        groups: name to indices of cells, counted from 0 over all of ``cells``.
        node_groups: name to indices of nodes.
    """

    points: Floats
    cells: tuple[RawCells, ...]
    groups: Mapping[str, Ints] = field(default_factory=dict)
    node_groups: Mapping[str, Ints] = field(default_factory=dict)


def join(sets: Mapping[str, list[Ints]]) -> dict[str, Ints]:
    """Each name with the sorted union (k,) of its indices; names of empty sets are left out."""
    unions = {name: np.unique(np.concatenate(parts)) for name, parts in sets.items() if parts}
    return {name: union.astype(np.int64) for name, union in unions.items() if len(union)}


def split_by(values: Ints) -> Iterator[tuple[int, Ints]]:
    """Each different value (n,) with the ascending indices (k,) at which it stands.

    >>> [(value, where.tolist()) for value, where in split_by(np.array([7, 3, 7]))]
    [(3, [1]), (7, [0, 2])]
    """
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    for part in np.split(order, np.flatnonzero(np.diff(ordered)) + 1):
        if len(part):
            yield int(values[part[0]]), part


def indices_of(numbers: Ints, wanted: Ints) -> Ints:
    """Positions (k,) in different ``numbers`` (n,) of the ``wanted`` ones (k,); -1 if absent."""
    if len(numbers) == 0:
        return np.full(wanted.shape, -1, dtype=np.int64)
    if numbers[0] == 1 and numbers[-1] == len(numbers) and bool(np.all(np.diff(numbers) == 1)):
        return np.where((wanted >= 1) & (wanted <= len(numbers)), wanted - 1, -1)
    order = np.argsort(numbers, kind="stable")
    place = np.minimum(np.searchsorted(numbers, wanted, sorter=order), len(numbers) - 1)
    indices = order[place]
    return np.where(numbers[indices] == wanted, indices, -1)


def resolve_nodes(numbers: Ints, wanted: Ints, *, cells: Ints) -> Ints:
    """Node indices of the ``wanted`` (n_cells, k) node numbers.

    Args:
        numbers: (n_nodes,) numbers of all nodes.
        wanted: (n_cells, k) the nodes of each cell, by number.
        cells: (n_cells,) numbers of the cells, for the message.

    Raises:
        Refused: a cell names a node that the file does not hold.
    """
    indices = indices_of(numbers, wanted)
    if bool(np.any(indices < 0)):
        row, column = (int(k) for k in np.argwhere(indices < 0)[0])
        raise Refused(
            "mesh-node",
            f"element {cells[row]} uses node {wanted[row, column]}, which the file does not hold",
            "the file is damaged or was cut by hand: write it again from the mesh generator",
        )
    return indices


def check_unique(
    numbers: Ints, what: str = "node", *, code: str = "mesh-node", hint: str = "number nodes once"
) -> None:
    """Refuse a number that is given twice.

    Args:
        numbers: (n,) of all nodes or elements.
        what: they are of.
        code: of the fault.
        hint: the remedy.

    Raises:
        Refused: with the number.
    """
    ordered = np.sort(numbers)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if len(twice):
        raise Refused(code, f"{what} {twice[0]} is defined more than once", hint)


def row_keys(nodes: Ints) -> Ints:
    """(n,) one number for each row of ``nodes``: equal rows have equal numbers.

    Different rows have different ones but for a chance of about 1e-9 in a million rows.
    """
    random = np.random.default_rng(20240229)
    factors = random.integers(1, 2**63 - 1, size=nodes.shape[1], dtype=np.uint64) | np.uint64(1)
    mixed = nodes.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(31))) * np.uint64(0xBF58476D1CE4E5B9)
    keys: Ints = ((mixed ^ (mixed >> np.uint64(29))) * factors).sum(axis=1).view(np.int64)
    return keys


def first_of_equal(keys: Ints) -> tuple[Ints, Bools]:
    """For each entry (n,) the index (n,) of the first equal one, and whether it is that (n,)."""
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    firsts = first[inverse.ravel()].astype(np.int64)
    return firsts, firsts == np.arange(len(keys))
