"""Collects the state of the whole mesh during an analysis: fields, reactions, what yields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.forward.actions.supports import support_nodes
from geoident.forward.analysis.stage import StageEnd
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.members import Structures
from geoident.forward.yielding.extent import YieldRecorder
from geoident.model.arrays import Bools, Floats
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, motions_of_nodes
from geoident.model.results.result import FieldSeries, LastStates, SupportReactions
from geoident.model.results.yielded import YieldedGround


class MeshRecorder:
    """All that is recorded of the whole mesh, state by state.

    Args:
        on_mesh: the case on its mesh.
        structures: those of the case.

    Attributes:
        fields: displacements and stresses.
        reactions: of the supports.
    """

    def __init__(self, on_mesh: CaseOnMesh, structures: Structures) -> None:
        self.fields = FieldRecorder(on_mesh)
        self.reactions = ReactionRecorder(on_mesh, structures)
        yields = any(material.yields for material in on_mesh.case.materials.values())
        self._yielded = YieldRecorder(on_mesh) if yields else None

    def add(self, end: StageEnd) -> None:
        """Record a state."""
        self.fields.add(end)
        self.reactions.add(end)
        if self._yielded is not None:
            known = bool(np.isfinite(end.u[:, 0]).all())
            self._yielded.add(end.number, end.yielded, known=known)

    def yielded_ground(self) -> YieldedGround | None:
        """How far ground yields; None where nothing can."""
        return None if self._yielded is None else self._yielded.table()


@dataclass(frozen=True)
class _Shown:
    """A state of the mesh: (n_nodes, dim), (n_elements, 6) and (n_elements,)."""

    displacement: Floats
    stress: Floats
    yielded: Bools


class FieldRecorder:
    """Copies displacements and mean element stresses, state by state.

    Args:
        on_mesh: the case on its mesh.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._mesh, self._sequence = on_mesh.mesh, on_mesh.sequence
        self._points = on_mesh.discretization.points
        self._displacement: list[Floats] = []
        self._stress: list[Floats] = []
        self._yielded: list[Bools] = []
        self._temperature: list[Floats] = []
        self._excess: dict[int, Floats] = {}
        self._last: dict[int, _Shown] = {}

    def add(self, end: StageEnd) -> None:
        """Record a state (column 0 of its arrays)."""
        shown = self._shown(end.number, end.u[:, 0], end.stress[..., 0], end.yielded)
        self._displacement.append(shown.displacement)
        self._stress.append(shown.stress)
        self._yielded.append(shown.yielded)
        if end.temperatures is not None:
            self._temperature.append(end.temperatures[:, 0].copy())
        if end.pores is not None:
            self._excess[end.number] = end.pores[:, 0].copy()  # a step goes on in it
        if not np.isfinite(shown.displacement).all():
            self._last[end.number] = self._last_found(end)
            shown.yielded[:] = False

    def series(self) -> FieldSeries:
        """All that was recorded."""
        n = len(self._displacement)
        present = np.stack([self._sequence.present(state) for state in range(n)])
        return FieldSeries(
            self._mesh, np.stack(self._displacement), np.stack(self._stress), present,
            np.stack(self._yielded), self._last_states(),
            np.stack(self._temperature) if self._temperature else None,
            self._excess_of(n),
        )  # fmt: skip

    def _excess_of(self, n: int) -> Floats | None:
        """(n, n_nodes) excess pressures, linear along edges; None where there are none."""
        if not any(np.any(each) for each in self._excess.values()):
            return None
        excess = np.zeros((n, self._mesh.n_nodes))
        for state, each in self._excess.items():
            excess[state] = each
        return _between_corners(self._mesh, excess)

    def _shown(self, state: int, u: Floats, stress: Floats, yielded: Bools) -> _Shown:
        """A state of displacements (n_dofs,), stresses (n_strain, n_points) and what yields."""
        mean = self._element_means(stress)
        mean[~self._sequence.present(state)] = np.nan
        moved = motions_of_nodes(self._mesh, u)
        return _Shown(moved, mean, self._yielded_so_far(state, yielded))

    def _last_found(self, end: StageEnd) -> _Shown:
        """What was found on the way to a state without equilibrium; else where it began."""
        if end.last is not None:
            return self._shown(end.number, end.last.u, end.last.stress, end.last.yielded)
        base = self._at(self._sequence.states[end.number].base)
        present = self._sequence.present(end.number)
        stress = np.where(np.isnan(base.stress), 0.0, base.stress)  # what is placed bears nothing
        stress[~present] = np.nan
        placed = np.isin(self._sequence.group_of, list(self._sequence.states[end.number].placed))
        return _Shown(base.displacement, stress, base.yielded & present & ~placed)

    def _at(self, state: int) -> _Shown:
        """A state as it is shown."""
        recorded = self._displacement[state], self._stress[state], self._yielded[state]
        return self._last.get(state, _Shown(*recorded))

    def _last_states(self) -> LastStates | None:
        if not self._last:
            return None
        states = list(self._last.values())
        return LastStates(
            np.array(list(self._last), dtype=np.int64),
            np.stack([one.displacement for one in states]),
            np.stack([one.stress for one in states]),
            np.stack([one.yielded for one in states]),
        )

    def _yielded_so_far(self, number: int, yielded: Bools) -> Bools:
        """(n_elements,) elements that yield in this state, or did in those it builds on.

        What is placed anew has not yielded yet.
        """
        state = self._sequence.states[number]
        so_far = np.zeros(self._mesh.n_elements, dtype=bool)
        so_far[self._points.element[yielded]] = True
        if number:
            placed = np.isin(self._sequence.group_of, list(state.placed))
            so_far |= self._yielded[state.base] & ~placed
        return so_far & self._sequence.present(number)

    def _element_means(self, stress: Floats) -> Floats:
        """(n_elements, 6) means weighted with volume of stresses (n_strain, n_points)."""
        n = self._mesh.n_elements
        element, volume = self._points.element, self._points.volume
        total = np.bincount(element, weights=volume, minlength=n)
        mean = np.zeros((n, 6))
        for component, values in enumerate(stress):
            weighted = np.bincount(element, weights=volume * values, minlength=n)
            mean[:, component] = weighted / total
        return mean


def _between_corners(mesh: Mesh, values: Floats) -> Floats:
    """Values (n, n_nodes) that are known at corners of elements, with their means on the edges."""
    filled = values.copy()
    for block in mesh.blocks:
        kind = CELLS[block.kind]
        for middle, ends in enumerate(kind.shape.edges if kind.order == 2 else (), kind.n_corners):
            corners = block.nodes[:, list(ends)]
            filled[:, block.nodes[:, middle]] = values[:, corners].mean(axis=-1)
    return filled


class ReactionRecorder:
    """Adds up, state by state, what supports exert on the ground: C^T V sigma - f where they hold.

    What two supports hold counts for the first of them, so that all reactions and all loads are in
    balance. Tractions that hold the edges of the model (`in_situ: held`) are loads.

    Args:
        on_mesh: the case on its mesh.
        structures: those of the case.
    """

    def __init__(self, on_mesh: CaseOnMesh, structures: Structures) -> None:
        self._on_mesh, self._structures = on_mesh, structures
        self._states = on_mesh.sequence.states
        self._names = list(dict.fromkeys(n for state in self._states for n in state.supports))
        self._forces: list[Floats] = []

    def add(self, end: StageEnd) -> None:
        """Record a state (column 0 of its arrays)."""
        mesh, discretization = self._on_mesh.mesh, self._on_mesh.discretization
        forces = np.full((len(self._names), mesh.dim), np.nan)
        self._forces.append(forces)
        supports = self._states[end.number].supports
        if end.forces is None or not supports:
            return
        present = self._on_mesh.sequence.present(end.number)
        stress, members = end.stress[..., 0], end.members[:, :1]
        rest = discretization.points.forces(stress, discretization.volume(present))
        if self._structures.n_rows:
            rest += self._structures.nodal_forces(members)[:, 0]
        rest = (rest - end.forces[:, 0]).reshape(mesh.n_nodes, mesh.dim)
        free = np.ones(rest.shape, dtype=bool)
        for name, support in supports.items():
            nodes = support_nodes(mesh, support)
            for component in support.components:
                free_nodes = nodes[free[nodes, component]]
                forces[self._names.index(name), component] = rest[free_nodes, component].sum()
                free[free_nodes, component] = False

    def table(self) -> SupportReactions:
        """All that was recorded."""
        names = tuple(state.name for state in self._states[: len(self._forces)])
        return SupportReactions(tuple(self._names), names, np.stack(self._forces, axis=1))
