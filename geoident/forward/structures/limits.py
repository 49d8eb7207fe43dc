"""What structures bear before they yield, as planes of generalised stresses (theory 5.13).

A member is one strain point of weight L. Its stresses are

    s = (N, M, Q L / sqrt(12)) ,     E = diag(EA, EI, EI) ,

M at mid-length, so that its work is that of the rows N, M and Q of `fem.structures`. M varies
linearly along it, with M -+ Q L / 2 = s_2 -+ sqrt(3) s_3 at its ends. There it is held against what
the section bears: each limit of M gives one plane for each end. Plastic strain along the normal of
such a plane is a hinge at that end, so that what a chain of members bears under loads at its nodes
is exact.

The limit of a rectangular section, ideally plastic with the strengths f_c and f_t, is a parabola,

    |M| / M_p + ((N - N_0) / N_p)^2 = 1 ,
    N_0 = (f_t - f_c) h / 2 ,   N_p = (f_c + f_t) h / 2 ,   M_p = (f_c + f_t) h^2 / 8 ,

as `capacity` has it. Chords between `_CHORDS` + 1 points of it are the planes, which are exact at
these points and elsewhere at most M_p / 64 on the safe side. A bar has the one stress N, a grouted
one s = (N, q) with E = diag(EA, k_grout), |N| <= capacity and |q| <= bond; the toe of a pile
presses, -base_capacity <= N <= 0, and the ground beside it bears |p| <= lateral_resistance in all
directions, in a solid a polygon of `_SIDES` sides of the same size on average.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from geoident.fem.yielding.coulomb_cone import CoulombCone
from geoident.fem.yielding.law import YieldLimits
from geoident.fem.yielding.plane_laws import PolyhedralLaw
from geoident.fem.yielding.planes import YieldPlanes
from geoident.forward.structures.grouted import bar_share
from geoident.forward.structures.interface_limits import as_it_closes, coulomb_cone
from geoident.forward.structures.members import rigidities
from geoident.forward.yielding.facets import polygon_shrinkage
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint, stacked
from geoident.model.interfaces import Interface
from geoident.model.structures import (
    Bars,
    Beam,
    GroutedBars,
    Interaction,
    PileContacts,
    PileToes,
    Structure,
    Struts,
)

_CHORDS = 8
"""Chords of the parabola of a section from pure tension to pure compression."""

_SIDES = 16
"""Of the polygon in place of a circle."""

_END = np.sqrt(3.0)
"""M at an end less M in the middle, per third stress."""


def limits(structure: Structure, point: ParameterPoint, n_strain: int) -> YieldPlanes:
    """The planes of a structure that yields, with their derivatives.

    Args:
        structure: it yields.
        point: the parameters.
        n_strain: components of a stress of the ground, to which those of members are filled up.
    """
    if isinstance(structure, Bars):
        planes = _of_bars(structure, point, solid=n_strain == _SOLID)
    else:
        planes = _of_section(structure, point)

    normals = np.zeros((len(planes), n_strain, point.n_columns))
    normals[:, : planes.normals.columns.shape[1]] = planes.normals.columns
    return replace(planes, normals=Dual(normals))


class StructureLaws:
    """Yield laws of structures at one parameter vector, each made once.

    Args:
        structures: those that yield, by the names that they have on the mesh.
        point: the parameters.
        n_strain: components of a stress of the ground.
    """

    def __init__(
        self,
        structures: Mapping[str, Structure | Interface],
        point: ParameterPoint,
        n_strain: int,
    ) -> None:
        self._structures = structures
        self._point, self._n_strain = point, n_strain
        self._laws: dict[str, PolyhedralLaw | CoulombCone] = {}

    @cached_property
    def limits(self) -> dict[str, YieldLimits]:
        """Limits of all structures that yield."""
        return {name: self.law(name).planes for name in self._structures}

    def law(self, name: str) -> PolyhedralLaw | CoulombCone:
        """The law of a structure that yields."""
        if name not in self._laws:
            structure, point = self._structures[name], self._point
            if isinstance(structure, Interface):
                n_slips = 2 if self._n_strain == _SOLID else 1
                self._laws[name] = coulomb_cone(structure, point, n_slips)
            else:
                planes = limits(structure, point, self._n_strain)
                self._laws[name] = PolyhedralLaw(self.elasticity(name), planes)
        return self._laws[name]

    def elasticity(self, name: str) -> Dual:
        """E (s, s) of its members; components that they do not have are as stiff as others."""
        axial, bending = rigidities(self._structures[name], self._point)
        bears = [axial, bending, bending]
        if isinstance(self._structures[name], Bars):
            bears = bears[
                : 2 if isinstance(self._structures[name], GroutedBars | PileContacts) else 1
            ]
        columns = np.zeros((self._n_strain, self._n_strain, self._point.n_columns))
        for k in range(self._n_strain):
            columns[k, k] = bears[k].columns if k < len(bears) else 0.0
            columns[k, k, 0] = bears[min(k, len(bears) - 1)].value
        return Dual(columns)


_SOLID = 6
"""Components of a strain of a solid."""


def given_back(
    structure: Structure | Interface, point: ParameterPoint, plastic: Floats
) -> Floats | None:
    """What comes back as gaps close (n, 1 + n + k): tractions of an interface, forces of struts.

    None of structures that have no gaps.

    Args:
        structure: it yields.
        point: the parameters.
        plastic: (components, n, 1 + n + k) elastic tractions (Pa) or forces per metre of a step
            less those at its end.
    """
    if isinstance(structure, Interface):
        return as_it_closes(structure, point, plastic)
    if isinstance(structure, Struts) and structure.compression_only:
        return np.where(plastic[0, :, :1] > 0.0, plastic[0], 0.0)
    return None


def _ways() -> list[list[float]]:
    """Normals of a polygon in place of the unit circle, of the same size on average."""
    turns = 2 * np.pi * np.arange(_SIDES) / _SIDES
    longer = 1 / polygon_shrinkage(_SIDES, "best")
    return [[longer * np.cos(turn), longer * np.sin(turn)] for turn in turns]


def _of_bars(bars: Bars, point: ParameterPoint, *, solid: bool) -> YieldPlanes:
    """|N| <= capacity and |q| <= bond, of the forces that are carried per metre."""
    share = bar_share(bars, point)
    normals: list[list[float]] = []
    distances: list[Dual] = []
    names: list[str] = []
    if isinstance(bars, PileToes):
        normals, distances, names = [[1.0]], [point.constant(0.0)], ["lifting off"]
        if bars.strength is not None:
            normals.append([-1.0])
            distances.append(point.number(bars.strength) / share)
            names.append("sinking in")
    elif isinstance(bars, PileContacts) and bars.strength is not None:
        ways = _ways() if solid else [[1.0], [-1.0]]
        normals, names = ways, [f"ground beside {n}" for n in range(1, 1 + len(ways))]
        distances = [point.number(bars.strength) / share] * len(ways)
    grouted = isinstance(bars, GroutedBars)
    presses_only = isinstance(bars, Struts) and bars.compression_only
    if presses_only:
        normals, distances, names = [[1.0]], [point.constant(0.0)], ["opening"]
    if bars.capacity is not None:
        for name, sense in (("tension", 1.0), ("compression", -1.0))[presses_only:]:
            normals.append([sense, *[0.0] * grouted])
            distances.append(point.number(bars.capacity) / share)
            names.append(name)
    if isinstance(bars, GroutedBars) and bars.bond is not None:
        normals += [[0.0, 1.0], [0.0, -1.0]]
        distances += [point.number(bars.bond) / share] * 2
        names += ["slip to the toe", "slip to the head"]
    directions = Dual.constant(np.array(normals), point.n_columns - 1)
    return YieldPlanes(directions, stacked(distances), names=tuple(names))


def _of_section(structure: Structure, point: ParameterPoint) -> YieldPlanes:
    """Planes a N +- M <= k at the first and at the second ends of members, and those of N alone."""
    assert isinstance(structure, Beam)
    given = structure.limits
    assert given is not None
    N, M, shift = given.N, given.M, point.constant(0.0)
    axial, moment = (None if one is None else point.number(one) for one in (N, M))
    if given.compressive_strength is not None and structure.thickness is not None:
        h = point.number(structure.thickness)
        f_c, f_t = point.number(given.compressive_strength), point.number(given.tensile_strength)
        axial, moment = ((f_c + f_t) * h).times(0.5), ((f_c + f_t) * h * h).times(0.125)
        shift = ((f_t - f_c) * h).times(0.5)
    zero, one = point.constant(0.0), point.constant(1.0)
    normals: list[Dual] = []
    distances: list[Dual] = []
    names: list[str] = []
    if moment is not None:
        slope, chords = zero, [(0.0, 1.0)]  # a N_p / M_p of each chord, and k / M_p
        if axial is not None and given.interaction != "none":
            slope, chords = moment / axial, _chords(given.interaction)
        for part, reach in chords:
            along = slope.times(part)
            for sign, word in ((1.0, "M+"), (-1.0, "M-")):
                for end, at in ((-1.0, "first"), (1.0, "second")):
                    normals.append(stacked([along, one.times(sign), one.times(sign * end * _END)]))
                    distances.append(moment.times(reach) + along * shift)
                    beside = f", N/N_p about {part / 2:.3g}" if len(chords) > 1 else ""
                    names.append(f"{word} at {at} ends{beside}")
    if axial is not None and (moment is None or given.interaction == "none"):
        normals += [stacked([one.times(sign), zero, zero]) for sign in (1.0, -1.0)]
        distances += [axial, axial]
        names += ["tension", "compression"]
    return YieldPlanes(stacked(normals), stacked(distances), names=tuple(names))


def _chords(interaction: Interaction) -> list[tuple[float, float]]:
    """Chords |M| / M_p + a N / N_p <= k of the curve on which N and M use up a section: a and k."""
    if interaction == "linear":
        return [(1.0, 1.0), (-1.0, 1.0)]
    n = np.linspace(-1.0, 1.0, _CHORDS + 1).tolist()
    return [(one + two, 1.0 + one * two) for one, two in pairwise(n)]
