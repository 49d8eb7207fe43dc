"""Walls, linings and bars as lines, shells and interfaces as faces, for VTK's formats."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from geoident.io.result.hdf5 import hdf5_output, texts
from geoident.io.result.vtkhdf import HIDDEN_CELL, with_z, write_cells
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.interfaces import InterfaceStates
from geoident.model.results.result import MemberForces
from geoident.model.results.shells import ShellForces

_LINE, _TRIANGLE, _QUADRILATERAL = 3, 5, 9
"""VTK's numbers of cells of two, three and four points."""

_OF_INTERFACES = {(2, 2): _LINE, (2, 3): 21, (3, 3): _TRIANGLE, (3, 4): _QUADRILATERAL,
                  (3, 7): 34, (3, 9): 28}  # fmt: skip
"""Dimension and number of points of a face to VTK's number: linear, or of second order."""

_UNITS = {
    "N": "N", "M": "N m/m", "Q": "N/m", "n_1": "N/m", "n_2": "N/m", "m_": "N m/m",
    "t_": "Pa", "grout": "N/m", "slips": "", "slip": "m", "opening": "m",
}  # fmt: skip
"""Units of arrays by how their names begin."""


@dataclass(frozen=True)
class StructureCells:
    """The cells of structures or interfaces at a state, n of them, each with points of its own.

    Args:
        points: (k, 3) of the cells, one after the other, m.
        sizes: (n,) points of each.
        types: (n,) VTK's numbers of their kinds.
        at_points: arrays (k, ...).
        of_cells: arrays (n, ...) that change from state to state.
        static: arrays (n, ...) that do not.
        present: (n,) which of them stand.
        names: of the structures or interfaces, by their numbers in ``structure``.
    """

    points: Floats
    sizes: Ints
    types: npt.NDArray[np.uint8]
    at_points: Mapping[str, npt.NDArray[Any]]
    of_cells: Mapping[str, npt.NDArray[Any]]
    static: Mapping[str, npt.NDArray[Any]]
    present: Bools
    names: tuple[str, ...]


def structure_series(
    members: MemberForces | None, shells: ShellForces | None, interfaces: InterfaceStates | None
) -> dict[str, list[StructureCells]]:
    """Lines of structures, faces of shells and interfaces at all states, of what there is."""
    kinds: dict[str, tuple[Any, Callable[[Any, int], StructureCells]]] = {
        "structures": (members, structure_lines),
        "shells": (shells, shell_faces),
        "interfaces": (interfaces, interface_faces),
    }
    return {
        kind: [cells(given, state) for state in range(len(given.stages) + 1)]
        for kind, (given, cells) in kinds.items()
        if given is not None
    }


def structure_lines(forces: MemberForces, state: int) -> StructureCells:
    """The straight pieces of walls, linings and bars at a state; NaN for what there is not.

    Point data: ``N``, ``M``, ``Q`` (per metre where per_metre; of bars N alone) and ``right``, the
    unit vector to whose side M is positive in tension; zero in space and for bars. Cell data:
    ``structure`` (its number, from 0), ``number`` of the piece, ``per_metre``, ``N_hoop``,
    ``stressed_to``; ``grout``, N/m, where there is any.

    Args:
        forces: forces at all stages, N and N m.
        state: 0 is the virgin state, in which nothing stands.
    """
    axial, moment = _at(forces.axial, state), _at(forces.moment, state)
    n = len(forces.structures)
    grout = {} if forces.grout is None else {"grout": _at(forces.grout, state)}
    return StructureCells(
        with_z(forces.ends).reshape(-1, 3),
        np.full(n, 2),
        np.full(n, _LINE, dtype=np.uint8),
        at_points={
            "N": np.repeat(axial, 2),
            "M": moment.ravel(),
            "Q": np.repeat(_at(forces.shear, state), 2),
            "right": np.repeat(_right(forces), 2, axis=0),
        },
        of_cells={
            "N_hoop": _at(forces.hoop, state),
            "stressed_to": _at(forces.prestress, state),
            **grout,
        },
        static={
            "structure": _numbers(forces.structures),
            "number": np.asarray(forces.numbers, dtype=np.int64),
            "per_metre": forces.per_metre.astype(np.int8),
        },
        present=np.isfinite(axial),
        names=tuple(dict.fromkeys(forces.structures)),
    )


def shell_faces(forces: ShellForces, state: int) -> StructureCells:
    """The faces of shells at a state, with the means over each.

    Cell data: ``n_11``, ``n_22``, ``n_12``, N/m, and ``m_11``, ``m_22``, ``m_12``, N m/m; the
    principal normal forces and moments ``n_principal``, ``m_principal`` (larger, smaller) and
    ``m_direction``, the unit vector of the larger moment; ``axis_1``, ``axis_2`` and ``inside``,
    unit vectors; ``structure`` (its number, from 0) and ``number`` of the face.

    Args:
        forces: forces at all stages.
        state: 0 is the virgin state, in which nothing stands.
    """
    normal, moment = _at(forces.normal, state), _at(forces.moment, state)
    angle = _at(forces.m_angle, state)
    first, second, inside = forces.axes.transpose(1, 0, 2)
    components = {
        f"{letter}_{part}": each[:, k]
        for letter, each in (("n", normal), ("m", moment))
        for k, part in enumerate(("11", "22", "12"))
    }
    filled = np.isfinite(forces.corners[:, :, 0])
    sizes = filled.sum(axis=1)
    return StructureCells(
        forces.corners[filled],
        sizes,
        np.where(sizes == 3, _TRIANGLE, _QUADRILATERAL).astype(np.uint8),
        at_points={},
        of_cells={
            **components,
            "n_principal": _at(forces.n_principal, state),
            "m_principal": _at(forces.m_principal, state),
            "m_direction": np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second,
        },
        static={
            "axis_1": first,
            "axis_2": second,
            "inside": inside,
            "structure": _numbers(forces.structures),
            "number": np.asarray(forces.numbers, dtype=np.int64),
        },
        present=np.isfinite(normal[:, 0]),
        names=tuple(dict.fromkeys(forces.structures)),
    )


def interface_faces(states: InterfaceStates, state: int) -> StructureCells:
    """The faces of interfaces at a state, with their tractions and jumps.

    Point data: ``t_n``, ``t_s``, ``opening``, ``slip``, ``slips``, ``opens``, and ``normal``, the
    unit vector from the first side to the second. Cell data: ``structure``, the number of the
    interface, from 0.

    Args:
        states: of all stages.
        state: 0 is the virgin state, in which nothing is known of them.
    """
    sizes: Ints = np.array([len(face) for face in states.face_points])
    dim, first = states.points.shape[1], np.array([face[0] for face in states.face_points])
    fields = {
        "t_n": states.normal_traction, "t_s": states.shear_traction,
        "opening": states.opening, "slip": states.slip,
    }  # fmt: skip
    at_points: dict[str, npt.NDArray[Any]] = {k: _at(v, state) for k, v in fields.items()}
    for name, flags in (("slips", states.slips), ("opens", states.parts)):
        at_points[name] = np.nan_to_num(_at(flags.astype(float), state)).astype(np.int8)
    return StructureCells(
        with_z(states.points),
        sizes,
        np.array([_OF_INTERFACES[dim, size] for size in sizes.tolist()], dtype=np.uint8),
        at_points={**at_points, "normal": with_z(states.normals)},
        of_cells={},
        static={"structure": np.array([states.names.index(states.interfaces[k]) for k in first])},
        present=np.isfinite(at_points["t_n"][first]),
        names=states.names,
    )


def write_structures_vtkhdf(
    states: Sequence[StructureCells], path: str | Path, times: Floats | None = None
) -> None:
    """Writes all states into one VTKHDF file; what does not stand at a state is hidden.

    Args:
        states: the same cells at all states, the virgin one first.
        path: the file.
        times: (n_states,) of the states, days; None for their numbers.
    """
    first = states[0]
    series = {
        "vtkGhostType": np.stack(
            [np.where(each.present, 0, HIDDEN_CELL).astype(np.uint8) for each in states]
        ),
        **{name: np.stack([each.of_cells[name] for each in states]) for name in first.of_cells},
    }
    points = {name: np.stack([each.at_points[name] for each in states]) for name in first.at_points}
    with hdf5_output(str(path)) as file:
        group = write_cells(
            file, first.points, first.sizes, first.types,
            points_data=points, cells=series, static=first.static, times=times,
        )  # fmt: skip
        attributes = group["CellData/structure"].attrs
        attributes.create("names", texts(first.names), dtype=h5py.string_dtype())
        for kind in ("PointData", "CellData"):
            for name, array in group[kind].items():
                unit = next((u for start, u in _UNITS.items() if name.startswith(start)), "")
                if unit:
                    array.attrs["unit"] = unit


def _at(values: Floats, state: int) -> Floats:
    """Values (..., n_stages) at a state; NaN in the virgin one."""
    return values[..., state - 1] if state else np.full(values.shape[:-1], np.nan)


def _numbers(structures: tuple[str, ...]) -> Ints:
    """Names of structures, cell by cell, as numbers (n,) in the order of the case."""
    order = list(dict.fromkeys(structures))
    return np.array([order.index(name) for name in structures], dtype=np.int64)


def _right(forces: MemberForces) -> Floats:
    """(n, 3) unit vectors to the right of walls and linings in the plane; zero for others."""
    right = np.zeros((len(forces.ends), 3))
    if forces.ends.shape[2] == 2:
        along = forces.ends[:, 1] - forces.ends[:, 0]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        right[:, 0], right[:, 1] = along[:, 1], -along[:, 0]
        right[~forces.per_metre] = 0.0
    return right
