"""How ground moves that cannot carry the loads of a stage."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.arrays import Bools, Floats
from geoident.model.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Mechanism:
    """The velocities with which ground moves under a load that it does not carry.

    Args:
        stage: name of the stage.
        state: number of its state; the virgin state is 0.
        fraction: part of the change of load of the stage that is carried; NaN where not known.
        mesh: the mesh.
        present: (n_elements,) what is there.
        velocity: (n_nodes, dim), the largest component 1.
        shear: (n_elements,) largest rate of shear in each element, in parts of the largest of all.
    """

    stage: str
    state: int
    fraction: float
    mesh: Mesh
    present: Bools
    velocity: Floats
    shear: Floats
