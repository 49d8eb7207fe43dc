"""In-situ stress sigma_0 and its derivatives (theory 2).

The formulas are written with dual numbers, so every number of a model may be a parameter: stresses,
unit weights, K0 in both directions, the azimuth, the level of the surface. Depth is counted
downwards from the surface; where the surface is a level that crosses strain points, the stress has
a kink there, and the derivative by the level is one-sided.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.forward.hardening.soils import stress_at_rest
from geoident.forward.in_situ.overburden import GroundAbove, Overburden
from geoident.forward.in_situ.surfaces import Depths
from geoident.forward.in_situ.water import PorePressure, is_wet
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Water
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case, KeyPath
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import WithDepth
from geoident.model.in_situ import (
    ConstantStress,
    GeostaticStress,
    HeimStress,
    InSitu,
    ProfileStress,
    StressRatio,
    Surface,
)
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar

NEGLIGIBLE_IMBALANCE = 1e-9
"""Largest out-of-balance force, relative to the forces at work, that counts as equilibrium."""

_N_STRAIN = {2: 4, 3: 6}  # xx yy zz xy (yz xz) of the strain points


@dataclass(frozen=True)
class StressPlaces:
    """Where a stress is asked for.

    Args:
        positions: (m, dim) m.
        groups: (m,) group index of each position.
        elements: (m,) the elements on whose border the positions lie; None: they lie inside.
    """

    positions: Floats
    groups: Ints
    elements: Ints | None = None

    def of(self, mask: Bools) -> StressPlaces:
        """Some of them, by a mask (m,)."""
        elements = None if self.elements is None else self.elements[mask]
        return StressPlaces(self.positions[mask], self.groups[mask], elements)


class InSituStress:
    """The in-situ stress of a case at fixed positions: levels of surfaces are sought once.

    Args:
        on_mesh: the case on its mesh.
        places: the positions.

    Attributes:
        n_outside: positions beside the faces that give the level of a surface.
    """

    def __init__(self, on_mesh: CaseOnMesh, places: StressPlaces) -> None:
        case, mesh, names = on_mesh.case, on_mesh.mesh, on_mesh.sequence.groups
        positions, groups = places.positions, places.groups
        self._shape = (_N_STRAIN[mesh.dim], len(positions))
        own = np.isin(groups, [names.index(g) for g in case.in_situ_of])
        zones = [(case.in_situ, ~own)]
        zones += [(model, groups == names.index(g)) for g, model in case.in_situ_of.items()]
        self._zones: list[tuple[_Components, Ints]] = []
        self.n_outside = 0
        for model, mask in zones:
            if model is not None and mask.any():
                components, n_outside = _STRESSES[type(model)](model, on_mesh, places.of(mask))
                self._zones.append((components, np.flatnonzero(mask)))
                self.n_outside += n_outside

    def columns(self, point: ParameterPoint) -> Floats:
        """Stress and its derivatives, (n_strain, m, 1 + n), Pa, tension positive."""
        result = np.zeros((*self._shape, point.n_columns))
        for components, rows in self._zones:
            for row, dual in enumerate(components(point)[: len(result)]):
                result[row, rows] = dual.columns
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
    """Surfaces of in-situ stress and growth, and tables of water, that the mesh does not have."""
    case, mesh = on_mesh.case, on_mesh.mesh
    wanted: list[tuple[KeyPath, Surface]] = [
        ((*path, "surface"), model.surface)
        for path, model in in_situ_models(case)
        if model.surface is not None
    ]
    wanted += [
        ((*growth.path, "surface"), growth.law.surface)
        for growth in case.growths
        if isinstance(growth.law, WithDepth)
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
            "absent-group",
            f"'{group}' is not present in the virgin state, so it has no in-situ stress",
            "remove the entry, or correct 'groups'",
        )
        for group in case.in_situ_of
        if group not in virgin
    ]


class CoverAndSurcharge:
    """What lies on the ground at places with no ground above, and above all places below.

    The cover between the top of the mesh and the surface, and the surcharge.

    Args:
        model: the in-situ stress.
        mesh: for a surface with topography.
        positions: (m, dim) m.
        above: what stands above them.
    """

    def __init__(
        self, model: GeostaticStress, mesh: Mesh, positions: Floats, above: GroundAbove
    ) -> None:
        self._model, self._n = model, len(positions)
        self._tolerance = max(1e3 * above.tolerance, 1e-9)
        tops = np.column_stack([positions[:, :-1], above.top])
        surface = model.surface
        self._cover = None if surface is None else Depths(mesh, surface, tops)
        self.n_outside = 0 if self._cover is None else self._cover.n_outside

    def thickness(self, point: ParameterPoint) -> Dual:
        """Of the cover, (m,) m; negative where the mesh ends above the surface."""
        none = point.constant(np.zeros(self._n))
        if self._cover is None:
            return none
        thickness = none + self._cover.at(point)
        return Dual(
            np.where(np.abs(thickness.columns[:, :1]) > self._tolerance, thickness.columns, 0.0)
        )

    def pressure(self, point: ParameterPoint) -> Dual:
        """Vertical pressure (m,), Pa."""
        total = point.constant(np.zeros(self._n))
        if self._model.surcharge is not None:
            total = total + point.number(self._model.surcharge)
        if self._model.cover is not None:
            thick = self.thickness(point).positive_part()
            total = total + thick * point.number(self._model.cover)
        return total


_Components = Callable[[ParameterPoint], list[Dual]]
"""xx, yy, zz, xy, yz, xz at m positions, each (m,) or the same everywhere, Pa."""

_Prepared = tuple[_Components, int]
"""A stress at m positions, and how many of them lie beside the footprint of its surface."""


def _uniform(model: ConstantStress, on_mesh: CaseOnMesh, places: StressPlaces) -> _Prepared:
    return lambda point: [point.number(scalar) for scalar in model.components], 0


def _profile(model: ProfileStress, on_mesh: CaseOnMesh, places: StressPlaces) -> _Prepared:
    """Stress that changes linearly with depth, also above the surface."""
    depths = Depths(on_mesh.mesh, model.surface, places.positions)

    def components(point: ParameterPoint) -> list[Dual]:
        depth = depths.at(point)
        return [
            depth * point.number(slope) + point.number(start)
            for start, slope in zip(model.at_surface, model.gradient, strict=True)
        ]

    return components, depths.n_outside


def _heim(model: HeimStress, on_mesh: CaseOnMesh, places: StressPlaces) -> _Prepared:
    """Vertical stress that is given or by depth, horizontal stresses as parts of it."""
    n = len(places.positions)
    depths = None
    if model.surface is not None:
        depths = Depths(on_mesh.mesh, model.surface, places.positions)

    def components(point: ParameterPoint) -> list[Dual]:
        if model.vertical is not None:
            vertical = point.constant(np.full(n, -1.0)) * point.number(model.vertical)
        else:
            assert model.unit_weight is not None
            assert depths is not None
            vertical = -depths.at(point).positive_part() * point.number(model.unit_weight)
        along = vertical * point.number(model.K0)
        across = vertical * point.number(model.K0 if model.K0_across is None else model.K0_across)
        return _components(model, vertical, along, across, point, on_mesh.mesh.dim)

    return components, 0 if depths is None else depths.n_outside


def _geostatic(model: GeostaticStress, on_mesh: CaseOnMesh, places: StressPlaces) -> _Prepared:
    """The weight of what stands above, less the pressure of the water, and parts of it."""
    case, mesh, names = on_mesh.case, on_mesh.mesh, on_mesh.sequence.groups
    positions, groups = places.positions, places.groups
    above = Overburden(on_mesh).above(positions, places.elements)
    cover = CoverAndSurcharge(model, mesh, positions, above)
    pores = None if case.water is None else PorePressure(case.water, mesh, positions)
    wet = is_wet(case.water, groups, names).astype(np.float64)

    def ratio(stated: StressRatio, point: ParameterPoint) -> Dual:
        """A ratio of stresses, the same everywhere or (m,) by groups."""
        if isinstance(stated, Scalar):
            return point.number(stated)
        columns = np.zeros((len(groups), point.n_columns))
        for group, number in stated.items():
            columns[groups == names.index(group)] = point.number(number).columns
        return Dual(columns)

    stated = model.K0 if model.K0 is not None else {}
    of_past = [
        (case.materials[material], groups == group)
        for group, material in on_mesh.sequence.states[0].materials.items()
        if not isinstance(stated, Scalar) and names[group] not in stated
    ]

    def components(point: ParameterPoint) -> list[Dual]:
        vertical = -(above.weight(case, point) + cover.pressure(point))
        if pores is not None:
            vertical = vertical + pores.at(point).times(wet)
        along = vertical * ratio(stated, point)
        for material, rows in of_past:
            if rows.any():
                along.columns[rows] = -stress_at_rest(material, -vertical[rows], point).columns
        across = along
        if model.K0_across is not None:
            across = vertical * ratio(model.K0_across, point)
        return _components(model, vertical, along, across, point, mesh.dim)

    return components, cover.n_outside


_STRESSES: Mapping[type, Callable[..., _Prepared]] = {
    ConstantStress: _uniform,
    HeimStress: _heim,
    ProfileStress: _profile,
    GeostaticStress: _geostatic,
}


def _components(
    model: HeimStress | GeostaticStress,
    vertical: Dual,
    along: Dual,
    across: Dual,
    point: ParameterPoint,
    dim: int,
) -> list[Dual]:
    """Components of a vertical and two horizontal stresses, and of the tectonic stress.

    In space ``along`` acts in the azimuth, clockwise from y; in a section along x.
    """
    none = point.constant(np.zeros(vertical.value.shape))
    if dim == 2:
        components = [along, vertical, across, none, none, none]
    elif model.azimuth is None:
        components = [along, across, vertical, none, none, none]
    else:
        azimuth = point.number(model.azimuth)
        east, north = azimuth.sine(), azimuth.cosine()
        xx = along * (east * east) + across * (north * north)
        yy = along * (north * north) + across * (east * east)
        components = [xx, yy, vertical, (along - across) * (east * north), none, none]
    if model.tectonic is None:
        return components
    return [
        dual + point.number(more) for dual, more in zip(components, model.tectonic, strict=True)
    ]
