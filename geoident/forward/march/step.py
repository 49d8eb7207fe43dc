"""One stage to be solved: what the steps of the march, elastic or not, are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from geoident.forward.march.discretization import StageSystem
from geoident.forward.march.state import Borne
from geoident.forward.stages import State
from geoident.model.arrays import Floats


@dataclass(frozen=True)
class StepTask:
    """One stage to be solved.

    Args:
        number: of the state.
        system: its equations.
        state: what stands.
        values: parameter values.
        names: the parameters to differentiate by.
        laws: elasticity of every material.
        borne: before the stage, without what left; thermal strains are in it. Changed in place.
        forces: (n_dofs, 1 + n + k).
        moduli: (n_rows, 1 + n) of structures.
        thermal: (n_points, 1 + n) normal strains, or None.
    """

    number: int
    system: StageSystem
    state: State
    values: Mapping[str, float]
    names: Sequence[str]
    laws: Mapping[str, Floats]
    borne: Borne
    forces: Floats
    moduli: Floats
    thermal: Floats | None
