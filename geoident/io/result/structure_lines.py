"""Walls, linings and bars as lines with their forces, for programs that read VTK's formats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from geoident.io.result.hdf5 import hdf5_output, texts
from geoident.io.result.vtkhdf import HIDDEN_CELL, with_z, write_lines
from geoident.model.arrays import Bools, Floats
from geoident.model.results.result import MemberForces


@dataclass(frozen=True)
class StructureLines:
    """The straight pieces of all structures at a state, n of them with two points each.

    Args:
        points: (2 n, 3) first and second end of each piece, m.
        at_points: arrays (2 n, ...): ``N``, ``M``, ``Q`` (per metre where per_metre; of bars N
            alone) and ``right``, the unit vector to whose side M is positive in tension; zero in
            space and for bars.
        of_cells: arrays (n,): ``structure`` (its number, from 0), ``number`` of the piece,
            ``per_metre``, ``N_hoop``, ``stressed_to``; ``grout`` where there is any.
        present: (n,) which of them stand.
    """

    points: Floats
    at_points: Mapping[str, npt.NDArray[Any]]
    of_cells: Mapping[str, npt.NDArray[Any]]
    present: Bools


def structure_lines(forces: MemberForces, state: int) -> StructureLines:
    """The pieces with their forces in N and N m at a state; NaN for what there is not.

    Args:
        forces: forces at all stages.
        state: 0 is the virgin state, in which nothing stands.
    """

    def at(values: Floats) -> Floats:
        return values[..., state - 1] if state else np.full(values.shape[:-1], np.nan)

    moment = at(forces.moment)
    names = list(dict.fromkeys(forces.structures))
    at_points: dict[str, npt.NDArray[Any]] = {
        "N": np.repeat(at(forces.axial), 2),
        "M": moment.ravel(),
        "Q": np.repeat(at(forces.shear), 2),
        "right": np.repeat(_right(forces), 2, axis=0),
    }
    of_cells: dict[str, npt.NDArray[Any]] = {
        "structure": np.array([names.index(name) for name in forces.structures], dtype=np.int64),
        "number": np.asarray(forces.numbers, dtype=np.int64),
        "per_metre": forces.per_metre.astype(np.int8),
        "N_hoop": at(forces.hoop),
        "stressed_to": at(forces.prestress),
    }
    if forces.grout is not None:
        of_cells["grout"] = at(forces.grout)
    points = with_z(forces.ends).reshape(-1, 3)
    return StructureLines(points, at_points, of_cells, np.isfinite(at(forces.axial)))


def _right(forces: MemberForces) -> Floats:
    """(n, 3) unit vectors to the right of walls and linings in the plane; zero for others."""
    right = np.zeros((len(forces.ends), 3))
    if forces.ends.shape[2] == 2:
        along = forces.ends[:, 1] - forces.ends[:, 0]
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        right[:, 0], right[:, 1] = along[:, 1], -along[:, 0]
        right[~forces.per_metre] = 0.0
    return right


def write_structures_vtkhdf(
    forces: MemberForces, path: str | Path, times: Floats | None = None
) -> None:
    """Writes all states into one VTKHDF file; what does not stand at a state is hidden.

    Args:
        forces: forces at all stages.
        path: the file.
        times: (n_states,) of the states, days; None for their numbers.
    """
    states = [structure_lines(forces, state) for state in range(len(forces.stages) + 1)]
    first = states[0]
    static = ("structure", "number", "per_metre")
    cells = {name: first.of_cells[name] for name in static}
    series = {
        "vtkGhostType": np.stack(
            [np.where(each.present, 0, HIDDEN_CELL).astype(np.uint8) for each in states]
        ),
        **{
            name: np.stack([each.of_cells[name] for each in states])
            for name in first.of_cells
            if name not in static
        },
    }
    points = {name: np.stack([each.at_points[name] for each in states]) for name in first.at_points}
    with hdf5_output(str(path)) as file:
        group = write_lines(
            file, first.points, points_data=points, cells=series, static=cells, times=times
        )
        names = texts(tuple(dict.fromkeys(forces.structures)))
        attributes = group["CellData/structure"].attrs
        attributes.create("names", names, dtype=h5py.string_dtype())
        for name, unit in (("N", "N"), ("M", "N m/m"), ("Q", "N/m")):
            group[f"PointData/{name}"].attrs["unit"] = unit
