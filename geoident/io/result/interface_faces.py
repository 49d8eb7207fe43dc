"""Interfaces as faces with their tractions and jumps, for programs that read VTK's formats."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from geoident.io.result.hdf5 import hdf5_output, texts
from geoident.io.result.vtkhdf import HIDDEN_CELL, LINE, with_z, write_cells
from geoident.io.result.vtu import write_grid
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.interfaces import InterfaceStates

_TYPES: Mapping[tuple[int, int], int] = {
    (2, 2): LINE, (2, 3): 21, (3, 3): 5, (3, 4): 9, (3, 7): 34, (3, 9): 28,
}  # fmt: skip
"""Dimension and number of points of a face to VTK's type: linear, or of second order."""

_UNITS = {"t_n": "Pa", "t_s": "Pa", "opening": "m", "slip": "m"}


class InterfaceFaces:
    """The faces of interfaces, each with points of its own.

    Args:
        states: of all stages.

    Attributes:
        points: (m, 3) m.
        types: (n,) VTK's types of the faces.
        sizes: (n,) numbers of points of the faces.
        interface: (n,) number of the interface of each face, from 0.
    """

    def __init__(self, states: InterfaceStates) -> None:
        self._states, faces = states, states.face_points
        self.points = with_z(states.points)
        self.sizes: Ints = np.array([len(face) for face in faces])
        dim = states.points.shape[1]
        self.types = np.array([_TYPES[dim, size] for size in self.sizes.tolist()], dtype=np.uint8)
        self._first = np.array([face[0] for face in faces])
        self.interface: Ints = np.array(
            [states.names.index(states.interfaces[k]) for k in self._first]
        )

    def present(self, state: int) -> Bools:
        """(n,) faces whose ground is there at a state; none in the virgin state, 0."""
        return np.asarray(np.isfinite(self._at(self._states.normal_traction, state)[self._first]))

    def at_points(self, state: int) -> dict[str, npt.NDArray[Any]]:
        """Arrays (m, ...) at a state.

        ``t_n``, ``t_s``, ``opening``, ``slip``, ``slips``, ``opens``, and ``normal`` from the first
        side to the second.
        """
        states = self._states
        fields = {
            "t_n": states.normal_traction, "t_s": states.shear_traction,
            "opening": states.opening, "slip": states.slip,
        }  # fmt: skip
        arrays: dict[str, npt.NDArray[Any]] = {k: self._at(v, state) for k, v in fields.items()}
        for name, flags in (("slips", states.slips), ("opens", states.parts)):
            arrays[name] = np.nan_to_num(self._at(flags.astype(float), state)).astype(np.int8)
        return arrays | {"normal": with_z(states.normals)}

    @staticmethod
    def _at(values: Floats, state: int) -> Floats:
        return values[:, state - 1] if state else np.full(len(values), np.nan)


def write_interfaces_vtu(states: InterfaceStates, state: int, path: str | Path) -> None:
    """Writes the interfaces that stand at a state, with the arrays of `InterfaceFaces`.

    Args:
        states: of all stages.
        state: 0 is the virgin state, in which nothing is known of them.
        path: the file.
    """
    faces = InterfaceFaces(states)
    present = faces.present(state)
    shown = np.repeat(present, faces.sizes)
    sizes = faces.sizes[present]
    topology: dict[str, npt.NDArray[Any]] = {
        "connectivity": np.arange(sizes.sum(), dtype=np.int64),
        "offsets": np.cumsum(sizes).astype(np.int64),
        "types": faces.types[present],
    }
    at_points = {name: values[shown] for name, values in faces.at_points(state).items()}
    write_grid(
        path, faces.points[shown], topology, at_points, {"interface": faces.interface[present]}
    )


def write_interfaces_vtkhdf(
    states: InterfaceStates, path: str | Path, times: Floats | None = None
) -> None:
    """Writes all states into one VTKHDF file; what does not stand at a state is hidden.

    Args:
        states: of all stages.
        path: the file.
        times: (n_states,) of the states, days; None for their numbers.
    """
    faces, numbers = InterfaceFaces(states), range(len(states.stages) + 1)
    arrays = [faces.at_points(state) for state in numbers]
    hidden = [np.where(faces.present(n), 0, HIDDEN_CELL).astype(np.uint8) for n in numbers]
    with hdf5_output(str(path)) as file:
        group = write_cells(
            file, faces.points, faces.types, faces.sizes,
            points_data={name: np.stack([one[name] for one in arrays]) for name in arrays[0]},
            cells={"vtkGhostType": np.stack(hidden)},
            static={"interface": faces.interface},
            times=times,
        )  # fmt: skip
        attributes = group["CellData/interface"].attrs
        attributes.create("names", texts(states.names), dtype=h5py.string_dtype())
        for name, unit in _UNITS.items():
            group[f"PointData/{name}"].attrs["unit"] = unit
