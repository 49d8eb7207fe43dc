"""The staged model as stages of arrays: its complementarity system, where it has one (theory 5).

The analysis does not use this; the formulations of the complementarity method that solve all stages
and parameters at once do. What is not affine in the parameters, and what is more than strain points
under forces, is refused with its reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.forward.affine import affine_obstacle, affine_yield_obstacle
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.equation_arrays import Affine, EquationArrays, LoadStage, PointLaw, PointSet
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.in_situ.stress import NEGLIGIBLE_IMBALANCE
from geoident.forward.stages import numbers
from geoident.forward.structures.members import StructureMembers, rigidities
from geoident.forward.yielding.surfaces import curved_surface, in_principal_stresses, yield_planes
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import ParameterPoint


@dataclass(frozen=True)
class ReadingRows:
    """What is read of the motion.

    Args:
        rows: G, (g, n_dofs).
        active: (n_states, g) weight of the step of a state in a reading.
        offset: (g, 1 + n) what instruments add, with its derivatives, at the parameters given.
    """

    rows: sp.csr_array
    active: Floats
    offset: Floats


def export_obstacle(analysis: StagedAnalysis, point: ParameterPoint) -> str | None:
    """Why the equations of a model cannot be `EquationArrays`, a clause; None if they can.

    Args:
        analysis: the staged model.
        point: the parameters to look at, and their names.
    """
    return next(_obstacles(analysis, point), None)


def _obstacles(analysis: StagedAnalysis, point: ParameterPoint) -> Iterator[str]:
    case = analysis.case
    for stage in case.stages:
        if stage.release or stage.distance is not None:
            yield f"the stage '{stage.name}' releases stress in part"
        if stage.temperature:
            yield f"the stage '{stage.name}' changes temperatures"
    why = affine_obstacle(analysis)
    if why:
        yield why
    for name, structure in case.structures.items():
        if structure.yields:
            yield f"the structure '{name}' yields, whose rotations are no unknowns of the equations"
    for material in case.materials.values():
        yield from _yield_obstacles(analysis, material, point)


def _yield_obstacles(
    analysis: StagedAnalysis, material: Material, point: ParameterPoint
) -> Iterator[str]:
    if not material.yields:
        return
    if in_principal_stresses(material):
        remedy = "" if curved_surface(material) else " (give 'planes')"
        yield f"{material.name} yields by an exact surface, which has no planes{remedy}"
        return
    n_strain = analysis.systems.discretization.points.n_strain
    normals = yield_planes(material, point, n_strain).normals
    for column, name in enumerate(point.names):
        if normals.slope(column) is not None:
            yield f"{name} turns the yield planes of {material.name}"
    why = affine_yield_obstacle(analysis, material)
    if why:
        yield why


def export(
    analysis: StagedAnalysis, point: ParameterPoint, readings: ReadingRows, last: int
) -> EquationArrays:
    """The equations of a model up to a state.

    Args:
        analysis: the staged model, without obstacle.
        point: any parameters inside the domain, all n: everything is affine around them.
        readings: what is read.
        last: number of the last state.
    """
    return _Exporter(analysis, point).system(readings, last)


class _Exporter:
    """Point sets are the groups, and the axial and bending rows of every structure."""

    def __init__(self, analysis: StagedAnalysis, point: ParameterPoint) -> None:
        self.analysis, self.point, self.n = analysis, point, len(point.names)
        self.p = np.array([point.values[name] for name in point.names])
        self.s = analysis.systems.discretization.points.n_strain
        self.ground = ModuliAt(analysis.on_mesh, self.point, self.s)
        self.sets: list[PointSet] = []
        self.laws: list[PointLaw] = []
        self.set_of: dict[int, int] = {}
        self.law_of: dict[str, int] = {}
        self.members: list[tuple[StructureMembers, int, int]] = []

    def system(self, readings: ReadingRows, last: int) -> EquationArrays:
        """All states; the virgin one only where its stress must be balanced first."""
        virgin, imbalance = self.analysis.virgin(self.point)
        self._add_sets(virgin)
        self._add_members()
        first = 1 if imbalance.max() <= NEGLIGIBLE_IMBALANCE else 0
        stages = [self._stage(n, first) for n in range(first, last + 1)]
        return EquationArrays(
            self.point.names,
            tuple(self.sets),
            tuple(self.laws),
            tuple(stages),
            readings.rows,
            readings.active[first : last + 1],
            self.affine(readings.offset),
        )

    def affine(self, columns: Floats) -> Affine:
        """An affine array from its value and derivatives (..., 1 + n) at the parameters."""
        slopes = columns[..., 1:]
        return Affine(np.asarray(columns[..., 0] - slopes @ self.p), slopes)

    def _add_sets(self, virgin: Floats) -> None:
        discretization, states = self.analysis.systems.discretization, self.analysis.sequence.states
        points = discretization.points
        for group, index in discretization.points_of.items():
            own = numbers(index, points.n_points)
            stress = virgin[:, own]
            if group not in states[0].materials:
                stress = np.zeros_like(stress)
            self.set_of[group] = len(self.sets)
            self.sets.append(
                PointSet(
                    self.analysis.sequence.groups[group],
                    points.compatibility(own),
                    points.volume[own],
                    self.affine(stress),
                )
            )

    def _add_members(self) -> None:
        """Structures: one component for each of their rigidities, with it as modulus."""
        for part in self.analysis.systems.structures.parts:
            for number, rigidity in enumerate(rigidities(part.structure, self.point)):
                chosen = np.flatnonzero(part.members.rigidity == number)
                if chosen.size:
                    none = np.zeros((1, chosen.size, 1 + self.n))
                    self.members.append((part, len(self.sets), len(self.laws)))
                    C = sp.csr_array(part.members.operator)[chosen]
                    weight = part.members.weight[chosen]
                    self.sets.append(PointSet(part.name, C, weight, self.affine(none)))
                    modulus = np.broadcast_to(rigidity.columns, 1 + self.n)
                    self.laws.append(self._elastic(modulus[None, None]))

    def _elastic(self, columns: Floats) -> PointLaw:
        s, n = len(columns), self.n
        return PointLaw(
            self.affine(columns),
            np.zeros((0, s)),
            Affine(np.zeros(0), np.zeros((0, n))),
            Affine(np.zeros((0, 0)), np.zeros((0, 0, n))),
        )

    def _stage(self, number: int, first: int) -> LoadStage:
        state, system = self.analysis.sequence.states[number], self.analysis.systems[number]
        forces = self.analysis.actions.forces(number, self.point)
        if state.stressed or state.locked:
            # Strains of a bar count from where it was locked off; the force it had then acts on.
            structures = self.analysis.systems.structures
            forces = forces - structures.nodal_forces(structures.locked(state, self.point))
        yields = number > 0  # what is out of balance in the virgin state is taken as elastic
        laws = {
            self.set_of[group]: self._law(material, yields=yields)
            for group, material in state.materials.items()
        }
        fresh = {self.set_of[group] for group in state.placed}
        for part, s, law in self.members:
            if part.stands(state) and not part.stressed_in(state):
                laws[s] = law
                fresh |= {s} if part.given_as in state.built else set()
        base = -1 if number == first else state.base - first
        return LoadStage(state.name, base, laws, frozenset(fresh), system.dofs, self.affine(forces))

    def _law(self, name: str, *, yields: bool) -> int:
        key = name if yields else f"{name}, elastic"
        if key not in self.law_of:
            self.law_of[key] = len(self.laws)
            self.laws.append(self._point_law(name, yields=yields))
        return self.law_of[key]

    def _point_law(self, name: str, *, yields: bool) -> PointLaw:
        elastic = self._elastic(self.ground.elastic_matrix(name).columns)
        material = self.analysis.case.materials[name]
        if not (yields and material.yields):
            return elastic
        planes = yield_planes(material, self.point, self.s)
        none = np.zeros((len(planes), len(planes), 1 + self.n))
        hardening = none if planes.hardening is None else planes.hardening.columns
        return PointLaw(
            elastic.elasticity,
            np.ascontiguousarray(planes.normals.value),
            self.affine(planes.distances.columns),
            self.affine(hardening),
        )
