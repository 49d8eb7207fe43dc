"""In-situ stress sigma_0 and its derivatives (theory 2).

The formulas are written with dual numbers, so every number of a model may be a parameter: stresses,
unit weights, K0 in both directions, the azimuth, the level of the surface. Depth is counted
downwards from the surface; where the surface is a level that crosses strain points, the stress has
a kink there, and the derivative by the level is one-sided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Protocol

import numpy as np

from geoident.errors import Fault
from geoident.forward.in_situ.surfaces import Depths
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Water
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case, KeyPath
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.in_situ import ConstantStress, HeimStress, InSitu, ProfileStress, Surface
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar

NEGLIGIBLE_IMBALANCE = 1e-9
"""Largest out-of-balance force, relative to the forces at work, that counts as equilibrium."""

_N_STRAIN = {2: 4, 3: 6}  # xx yy zz xy (yz xz) of the strain points


class InSituStress:
    """The in-situ stress of a case at fixed positions: levels of surfaces are sought once.

    Args:
        on_mesh: the case on its mesh.
        positions: (m, dim) m.
        groups: (m,) group index of each position.
    """

    def __init__(self, on_mesh: CaseOnMesh, positions: Floats, groups: Ints) -> None:
        case, mesh, names = on_mesh.case, on_mesh.mesh, on_mesh.sequence.groups
        self._shape = (_N_STRAIN[mesh.dim], len(positions))
        own = np.isin(groups, [names.index(g) for g in case.in_situ_of])
        zones = [(case.in_situ, ~own)]
        zones += [(model, groups == names.index(g)) for g, model in case.in_situ_of.items()]
        self._zones = [
            (_STRESSES[type(model)](model, mesh, positions[here]), np.flatnonzero(here))
            for model, here in zones
            if model is not None and here.any()
        ]
        self.n_outside = sum(zone.n_outside for zone, _ in self._zones)

    def columns(self, point: ParameterPoint) -> Floats:
        """Stress and its derivatives, (n_strain, m, 1 + n), Pa, tension positive."""
        result = np.zeros((*self._shape, point.n_columns))
        for zone, here in self._zones:
            for row, dual in enumerate(zone.components(point)[: len(result)]):
                result[row, here] = dual.columns
        return result


def edges_held(model: InSitu | None) -> bool:
    """Whether tractions on the edges of the model hold the stress (`model.in_situ`).

    A stress that is the same everywhere can't vanish at the surface: the ground that continues
    beyond the edges of the model holds it.
    """
    return model is not None and model.is_held


def in_situ_models(case: Case) -> Iterator[tuple[KeyPath, InSitu]]:
    """Every in-situ model of a case with its key."""
    if case.in_situ is not None:
        yield ("in_situ",), case.in_situ
    for group, model in case.in_situ_of.items():
        yield ("in_situ", "groups", group), model


def surface_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Surfaces of the in-situ stress and tables of the water that the mesh does not have."""
    case, mesh = on_mesh.case, on_mesh.mesh
    wanted: list[tuple[KeyPath, Surface]] = [
        ((*path, "surface"), model.surface)
        for path, model in in_situ_models(case)
        if model.surface is not None
    ]
    waters: list[tuple[KeyPath, Water | None]] = [(("water",), case.water)]
    waters += [(("stages", n, "water"), stage.water) for n, stage in enumerate(case.stages)]
    wanted += [((*path, "table"), water.table) for path, water in waters if water is not None]
    return [
        on_mesh.missing_group(
            path, f"group of faces '{surface}'", "groups of faces", mesh.facet_groups
        )
        for path, surface in wanted
        if isinstance(surface, str) and surface not in mesh.facet_groups
    ]


def zone_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Groups with an in-situ stress of their own that are not in the ground at the beginning."""
    case, sequence = on_mesh.case, on_mesh.sequence
    virgin = {sequence.groups[g] for g in sequence.states[0].materials}
    return [
        case.source.fault(
            ("in_situ", "groups", group),
            code="absent-group",
            message=f"'{group}' is not present in the virgin state, so it has no in-situ stress",
            hint="remove the entry, or correct 'groups'",
        )
        for group in case.in_situ_of
        if group not in virgin
    ]


class _StressAtPositions(Protocol):
    """A stress at m positions; `n_outside` of them lie beyond the footprint of its surface."""

    n_outside: int

    def components(self, point: ParameterPoint) -> list[Dual]:
        """xx, yy, zz, xy, yz, xz, each (m,) or the same everywhere, Pa."""


class _Uniform:
    """Stress that is the same at all positions."""

    n_outside = 0

    def __init__(self, model: ConstantStress, mesh: Mesh, positions: Floats) -> None:
        self._components = model.components

    def components(self, point: ParameterPoint) -> list[Dual]:
        """xx, yy, zz, xy, yz, xz."""
        return [point.number(scalar) for scalar in self._components]


class _Heim:
    """Stress by Heim's rule."""

    def __init__(self, model: HeimStress, mesh: Mesh, positions: Floats) -> None:
        self._model = model
        self._dim = positions.shape[1]
        self._n = len(positions)
        surface = model.surface
        self._depths = None if surface is None else Depths(mesh, surface, positions)
        self.n_outside = 0 if self._depths is None else self._depths.n_outside

    def components(self, point: ParameterPoint) -> list[Dual]:
        """xx, yy, zz, xy, yz, xz."""
        model = self._model
        vertical = -self._overburden(point)
        along = vertical * point.number(model.K0)
        across = vertical * point.number(model.K0 if model.K0_across is None else model.K0_across)
        none = point.constant(np.zeros(self._n))
        if self._dim == 2:
            found = [along, vertical, across, none, none, none]
        else:
            xx, yy, xy = _turned(along, across, model.azimuth, point)
            found = [xx, yy, vertical, xy, none, none]
        if model.tectonic is None:
            return found
        return [dual + point.number(more) for dual, more in zip(found, model.tectonic, strict=True)]

    def _overburden(self, point: ParameterPoint) -> Dual:
        """Vertical pressure (m,), compression positive."""
        model = self._model
        if model.vertical is not None:
            return point.constant(np.ones(self._n)) * point.number(model.vertical)
        if model.unit_weight is None or self._depths is None:
            msg = "Heim's stress needs a vertical stress, or a unit weight and the surface"
            raise ValueError(msg)
        return self._depths.at(point).positive_part() * point.number(model.unit_weight)


class _Profile:
    """Stress that changes linearly with depth."""

    def __init__(self, model: ProfileStress, mesh: Mesh, positions: Floats) -> None:
        self._model = model
        self._depths = Depths(mesh, model.surface, positions)
        self.n_outside = self._depths.n_outside

    def components(self, point: ParameterPoint) -> list[Dual]:
        """xx, yy, zz, xy, yz, xz."""
        depth = self._depths.at(point)
        return [
            depth * point.number(slope) + point.number(start)
            for start, slope in zip(self._model.at_surface, self._model.gradient, strict=True)
        ]


_STRESSES: Mapping[type, Callable[..., _StressAtPositions]] = {
    ConstantStress: _Uniform,
    HeimStress: _Heim,
    ProfileStress: _Profile,
}


def _turned(
    along: Dual, across: Dual, azimuth: Scalar | None, point: ParameterPoint
) -> tuple[Dual, Dual, Dual]:
    """xx, yy, xy of principal stresses: ``along`` acts in the azimuth, clockwise from y."""
    if azimuth is None:
        return along, across, point.constant(np.zeros(along.value.shape))
    angle = point.number(azimuth)
    east = angle.through(np.sin, np.cos)
    north = angle.through(np.cos, lambda a: -np.sin(a))
    xx = along * (east * east) + across * (north * north)
    yy = along * (north * north) + across * (east * east)
    return xx, yy, (along - across) * (east * north)
