"""The staged model as stages of arrays: its complementarity system, where it has one (theory 5).

The march does not use this; the formulations of the complementarity method that solve all stages
and parameters at once do. What is not affine in the parameters, and what is more than strain points
under forces, is refused with its reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from geoident.fem.yielding.polyhedral import PolyhedralLaw
from geoident.forward.actions import forces as actions
from geoident.forward.actions import water
from geoident.forward.ground import elasticity as materials
from geoident.forward.ground.elasticity import elasticity, elasticity_slopes
from geoident.forward.in_situ import stress as in_situ
from geoident.forward.in_situ.stress import BALANCED
from geoident.forward.march.stage_equations import numbers
from geoident.forward.staged_system import Affine, LoadStage, PointLaw, PointSet, StagedSystem
from geoident.forward.structures import members as structures
from geoident.forward.structures.members import rigidities
from geoident.forward.yielding.laws import is_smooth, law_slopes, yield_law
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import Point

if TYPE_CHECKING:
    from geoident.forward.model import StagedModel

_SAME = 1e-9
"""Relative difference of derivatives at two parameter vectors that is rounding."""

_AWAY = 1.37
"""The second of them, in parts of the first."""


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


def export_obstacle(model: StagedModel, p: Floats) -> str | None:
    """Why the equations of a model are no `StagedSystem`, a clause, or None if they are one.

    Args:
        model: the model.
        p: (n,) parameters to look at.
    """
    return next(_obstacles(model, model.values(p)), None)


def _obstacles(model: StagedModel, values: Mapping[str, float]) -> Iterator[str]:
    case, free = model.case, frozenset(model.names)
    for stage in case.stages:
        if stage.release:
            yield f"the stage '{stage.name}' releases stress in part"
        if stage.temperature:
            yield f"the stage '{stage.name}' changes temperatures"
    for part in (in_situ, actions, water, structures):
        why = part.affine_obstacle(case, free)
        if why:
            yield why
    for material in case.materials.values():
        why = materials.affine_obstacle(replace(material, yields=()), free)
        if why:
            yield why
        yield from _yield_obstacles(model, material, values)


def _yield_obstacles(
    model: StagedModel, material: Material, values: Mapping[str, float]
) -> Iterator[str]:
    if not material.yields:
        return
    if is_smooth(material):
        yield f"{material.name} yields by a smooth surface, which has no planes (give 'planes')"
        return
    s = model.systems.points.n_strain
    here = law_slopes(material, values, model.names, s)
    away = {name: _AWAY * value for name, value in values.items()}
    there = law_slopes(material, away, model.names, s)
    for name, found in here.items():
        if found.normals is not None and np.any(found.normals):
            yield f"{name} turns the yield planes of {material.name}"
        for key in ("distances", "hardening"):
            one, other = getattr(found, key), getattr(there[name], key)
            if one is not None and not np.allclose(one, other, rtol=_SAME, atol=0.0):
                yield f"the {key} of the yield planes of {material.name} are not linear in {name}"


def export(model: StagedModel, p: Floats, readings: ReadingRows, last: int) -> StagedSystem:
    """The equations of a model up to a state.

    Args:
        model: the model, without obstacle.
        p: (n,) any parameters inside the domain: everything is affine around them.
        readings: what is read.
        last: number of the last state.
    """
    return _Exporter(model, p).system(readings, last)


class _Exporter:
    """Point sets are the groups, and the axial and bending rows of every structure."""

    def __init__(self, model: StagedModel, p: Floats) -> None:
        self.model, self.p = model, p
        self.values = model.values(p)
        self.n = len(model.names)
        self.s = model.systems.points.n_strain
        self.sets: list[PointSet] = []
        self.laws: list[PointLaw] = []
        self.set_of: dict[int, int] = {}
        self.law_of: dict[str, int] = {}
        self.members: list[tuple[str, int, int]] = []

    def system(self, readings: ReadingRows, last: int) -> StagedSystem:
        """All states; the virgin one only where its stress must be balanced first."""
        model = self.model
        virgin, imbalance = model.march.virgin(self.values, model.names)
        self._add_sets(virgin)
        self._add_members()
        first = 1 if imbalance <= BALANCED else 0
        stages = [self._stage(n, first) for n in range(first, last + 1)]
        return StagedSystem(
            tuple(model.names),
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
        points, states = self.model.systems.points, self.model.timeline.states
        for group in sorted({g for state in states for g in state.materials}):
            mine = numbers(self.model.systems.points_of[group], points.n_points)
            rows = (np.arange(self.s)[:, None] * points.n_points + mine).ravel()
            stress = virgin[:, mine]
            if group not in states[0].materials:
                stress = np.zeros_like(stress)
            self.set_of[group] = len(self.sets)
            self.sets.append(
                PointSet(
                    self.model.timeline.groups[group],
                    sp.csr_array(points.compatibility[rows]),
                    points.volume[mine],
                    self.affine(stress),
                )
            )

    def _add_members(self) -> None:
        """Structures: one component, the axial or the bending one, with its modulus."""
        for part in self.model.structures.parts:
            rigidity = rigidities(part.structure, Point(self.values, self.model.names))
            for bending in (False, True):
                chosen = np.flatnonzero(part.members.bending == bending)
                if chosen.size:
                    none = np.zeros((1, chosen.size, 1 + self.n))
                    self.members.append((part.name, len(self.sets), len(self.laws)))
                    C = sp.csr_array(part.members.operator)[chosen]
                    weight = part.members.weight[chosen]
                    self.sets.append(PointSet(part.name, C, weight, self.affine(none)))
                    modulus = np.broadcast_to(rigidity[int(bending)].columns, 1 + self.n)
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
        model = self.model
        state, system = model.timeline.states[number], model.systems[number]
        forces = model.actions.forces(number, self.values, model.names)
        yields = number > 0  # what is out of balance in the virgin state is taken as elastic
        laws = {
            self.set_of[group]: self._law(material, yields=yields)
            for group, material in state.materials.items()
        }
        fresh = {self.set_of[group] for group in state.placed}
        for name, s, law in self.members:
            if name in state.structures:
                laws[s] = law
                fresh |= {s} if name in state.built else set()
        base = -1 if number == first else state.base - first
        return LoadStage(
            state.name, base, laws, frozenset(fresh), system.pattern.dofs, self.affine(forces)
        )

    def _law(self, name: str, *, yields: bool) -> int:
        key = name if yields else f"{name}, elastic"
        if key not in self.law_of:
            material = self.model.case.materials[name]
            if not yields:
                material = replace(material, yields=())
            self.law_of[key] = len(self.laws)
            self.laws.append(self._point_law(material))
        return self.law_of[key]

    def _point_law(self, material: Material) -> PointLaw:
        names = self.model.names
        E = elasticity(material, self.values, self.s)
        slopes = elasticity_slopes(material, self.values, self.s)
        columns = [E, *(slopes.get(name, np.zeros_like(E)) for name in names)]
        elastic = self._elastic(np.stack(columns, axis=-1))
        law = yield_law(material, self.values, E)
        if law is None:
            return elastic
        assert isinstance(law, PolyhedralLaw)
        planes, found = law.planes, law_slopes(material, self.values, names, self.s)
        y = len(planes.distances)
        H = np.zeros((y, y)) if planes.hardening is None else planes.hardening
        k_columns, H_columns = [planes.distances], [H]
        for name in names:
            k, h = _slopes(found.get(name))
            k_columns.append(np.zeros(y) if k is None else k)
            H_columns.append(np.zeros((y, y)) if h is None else h)
        return PointLaw(
            elastic.elasticity,
            planes.normals,
            self.affine(np.stack(k_columns, axis=-1)),
            self.affine(np.stack(H_columns, axis=-1)),
        )


def _slopes(found: object) -> Sequence[Floats | None]:
    return getattr(found, "distances", None), getattr(found, "hardening", None)
