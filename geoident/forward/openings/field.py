"""The closed forms of an opening in the terms of a case: stages, parameters, channels.

What is derived from the case: the ground at the wall with its elastic constants and strength, the
in-situ stress at the centre, and the pressure inside at every state,

    p = (1 - released part) p0 + pressures on the wall.

The far stress is rarely the same all round. Its mean is p0; what deviates, d = (xx - yy) / 2 and
xy, moves the ground as in Kirsch's elastic solution (G. Kirsch 1898; Brady & Brown, Rock Mechanics
for Underground Mining, section 7.2). In elastic ground that is exact, in ground that yields an
approximation, and it is said how large the deviation is.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from geoident.errors import ModelError
from geoident.forward.gauges.kinds import reads_displacements
from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.in_situ.stress import InSituStress, StressPlaces
from geoident.forward.openings.advance import AdvancingFace
from geoident.forward.openings.closed_forms import GroundState
from geoident.forward.openings.load import OpeningLoad
from geoident.forward.openings.site import OpeningSite
from geoident.forward.stages import CaseOnMesh, ConstructionSequence, ConstructionState
from geoident.forward.yielding.hoek_brown import equivalent_notes
from geoident.model.actions import Pressure
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis, Case, Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.gauges import Channel
from geoident.model.ground import Isotropic
from geoident.model.in_situ import GeostaticStress, InSitu
from geoident.model.parameter import Values
from geoident.model.yielding import HoekBrown, MohrCoulomb

UNEVEN = 0.01
"""Deviation from an all-round stress, in parts of it, from which on it is said."""

_INSIDE = 0.95
"""A point nearer than this to the centre, in radii, is inside the opening; others on its wall."""


NO_SECTION = "its formulas are those of plane strain"


def unsuitable(case: Case, material: str, *, has_mesh: bool) -> str | None:
    """Why a case has no closed form, a clause, or None if it has one.

    Args:
        case: the case.
        material: name of the ground around the opening.
        has_mesh: whether surfaces may be groups of faces.
    """
    ground, in_situ = case.materials[material], case.in_situ
    if case.analysis is not Analysis.PLANE_STRAIN:
        return NO_SECTION
    if not isinstance(ground.elastic, Isotropic):
        return f"'{material}' is not isotropic"
    if why := _unknown_limit(ground):
        return why
    if ground.fields or ground.growths:
        return f"'{material}' varies from place to place"
    if case.in_situ_of:
        return "groups have in-situ stresses of their own"
    return None if has_mesh else _needs_mesh(in_situ)


def _unknown_limit(ground: Material) -> str | None:
    """Why there is no closed form of how a material yields, a clause, or None if there is one."""
    of_one = all(isinstance(s, MohrCoulomb | HoekBrown) for s in ground.yields)
    if len(ground.yields) > 1 or not of_one:
        return f"'{ground.name}' has other yield limits than one of Mohr-Coulomb or Hoek-Brown"
    if any(isinstance(s, HoekBrown) and s.dilation is None for s in ground.yields):
        return f"'{ground.name}' flows along the normals of Hoek-Brown; with 'dilation' it has one"
    return None


def _needs_mesh(in_situ: InSitu | None) -> str | None:
    """Why an in-situ stress can't be had without a mesh, a clause, or None if it can."""
    if isinstance(in_situ, GeostaticStress):
        return "the geostatic stress is the weight of the layers of a mesh"
    if isinstance(getattr(in_situ, "surface", None), str):
        return "the depth is counted from a group of faces, which needs a mesh"
    return None


class OpeningField:
    """An opening through all stages of a case.

    Args:
        on_mesh: the case, for which `unsuitable` finds nothing, on its mesh or on an empty one.
        site: where the opening is.
        face: what turns distances to the face into released parts.
    """

    def __init__(self, on_mesh: CaseOnMesh, site: OpeningSite, face: AdvancingFace) -> None:
        self._face = face
        case, sequence = on_mesh.case, on_mesh.sequence
        self._case, self._sequence, self._site = case, sequence, site
        virgin = sequence.states[0]
        self._material = case.materials[virgin.materials[site.ground]]
        a, (x, y) = site.radius, site.centre
        around = np.array([[x, y], [x - a, y], [x + a, y], [x, y - a], [x, y + a]])
        groups = np.full(len(around), site.ground)
        self._in_situ = InSituStress(on_mesh, StressPlaces(around, groups))
        ends = max((len(c.motions) for c in case.channels), default=0)
        self._ends = [_End(site, case.channels, which) for which in range(ends)]
        own = [_obstacle(sequence, site, state) for state in sequence.states]
        self.obstacles = [_first(own, sequence, n) for n in range(len(own))]
        open_ = [not site.groups & state.materials.keys() for state in sequence.states]
        self.open: Bools = np.array(open_, dtype=np.bool_)
        hidden = np.zeros(len(case.channels), dtype=np.bool_)
        for end in self._ends:
            hidden |= end.inside
        closed_form = np.array([reason is None for reason in self.obstacles], dtype=np.bool_)
        # (n_states, n_channels)
        self.covered: Bools = closed_form[:, None] & ~(self.open[:, None] & hidden)
        self._moves = np.array([reads_displacements(c) for c in case.channels], dtype=np.bool_)
        self.covered &= self._moves

    def why_uncovered(self, state: int, channel: int) -> str | None:
        """Why a channel has no closed form at a state, a clause, or None if it has."""
        if self.obstacles[state] is not None:
            return self.obstacles[state]
        if not self._moves[channel]:
            return "it reads something else than displacements"
        if not self.covered[state, channel]:
            return "a point of it stands in ground that is no longer there"
        return None

    def admissible(self, values: Values) -> str | None:
        """Why the parameters are outside the domain, or None."""
        return inadmissible(self._material, values)

    def observed(
        self,
        values: Values,
        names: Sequence[str],
        *,
        wanted: Collection[int] | None = None,
        failures: list[ModelError] | None = None,
    ) -> Floats:
        """Relative displacements of all channels since the virgin state.

        Args:
            values: parameters by name, SI.
            names: the n of them to differentiate by.
            wanted: the states that are; None for all.
            failures: takes what is raised, and the states that it concerns are NaN; None to raise.

        Returns:
            (n_states, n_channels, 1 + n); NaN where there is no closed form.

        Raises:
            ModelError: the ground has no equilibrium, or none in closed form.
        """
        shape = (len(self._sequence.states), len(self._case.channels), 1 + len(names))
        table = np.full(shape, np.nan)
        load = self._load(values, names)
        for n in range(len(table)) if wanted is None else wanted:
            try:
                if self.obstacles[n] is None:
                    table[n] = self._moved(load, n, shape[1:])
            except ModelError as error:
                if failures is None:
                    raise
                failures.append(error)
        return table

    def _moved(self, load: OpeningLoad, n: int, shape: tuple[int, ...]) -> Floats:
        """Relative displacements (n_channels, 1 + n) at a state."""
        moved = np.zeros(shape)
        if self.open[n]:
            state, released = load.at(n)
            for end in self._ends:
                moved += end.moved(state, released, load).columns
        return moved

    def remarks(self, values: Values) -> tuple[str, ...]:
        """What is to be known of the closed form at some parameters, sentences without a stop."""
        load = self._load(values, ())
        return (*self.notes(values), *self._yielded(load))

    def notes(self, values: Values) -> tuple[str, ...]:
        """The same without what the ground does."""
        (x, y), a, name = self._site.centre, self._site.radius, self._material.name
        place = f"closed form of a circular opening of radius {a:.4g} m about ({x:.4g}, {y:.4g}) m"
        sentences = [
            f"{place} in '{name}'",
            *self._site.remarks,
            *self._uneven(self._load(values, ())),
        ]
        if any(isinstance(s, MohrCoulomb) and s.planes for s in self._material.yields):
            sentences.append("the closed form takes the smooth surface for the polyhedron")
        stress = self._load(values, ()).stress.value
        sentences += equivalent_notes(self._material, stress[:, :1], values)
        return tuple(sentences)

    def _uneven(self, load: OpeningLoad) -> list[str]:
        """How far the in-situ stress is from the same all round, at the centre and the wall."""
        p0, (xx, yy, _, xy) = float(load.rock.pressure.value), -load.stress.value
        off = float(np.abs([xx - p0, yy - p0, xy]).max())
        if off <= UNEVEN * abs(p0):
            return []
        how = f"{100 * off / abs(p0):.0f} %" if p0 else f"{off:.3g} Pa"
        sentence = (
            f"the in-situ stress around the opening is up to {how} off its mean at the centre"
        )
        if load.opening.strength is not None:
            sentence += "; the closed form takes that part as if the ground were elastic"
        return [sentence]

    def _yielded(self, load: OpeningLoad) -> list[str]:
        """How far the ground yields in the last state with a closed form."""
        states = self.open_stages
        try:
            state = load.at(states[-1])[0] if states else None
        except ModelError:
            return []
        if state is None or state.plastic_radius is None:
            return []
        name = self._sequence.states[states[-1]].name
        text = f"at stage '{name}' the ground yields up to {float(state.plastic_radius.value):.3g} "
        return [text + "m from the centre"]

    def load(self, values: Values) -> OpeningLoad:
        """The ground at some parameters, by name."""
        return self._load(values, ())

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the opening, m."""
        return self._site.centre

    @property
    def open_stages(self) -> tuple[int, ...]:
        """Numbers of the states with the opening that have a closed form."""
        return tuple(n for n, why in enumerate(self.obstacles) if why is None and self.open[n])

    def stage_name(self, number: int) -> str:
        """Name of a state."""
        return self._sequence.states[number].name

    def _load(self, values: Values, names: Sequence[str]) -> OpeningLoad:
        point = ParameterPoint(values, names)
        stress = Dual(self._in_situ.columns(point))
        return OpeningLoad(self._sequence, self._site, self._material, stress, point, self._face)


class _End:
    """One point of every channel: where it lies around the opening, and what of it is read.

    Attributes:
        inside: (n_channels,) the end lies where the opening is going to be.
    """

    def __init__(self, site: OpeningSite, channels: Sequence[Channel], which: int) -> None:
        # a channel of fewer points has one more that lies anywhere: its motion is not read
        nowhere = (site.centre[0] + site.radius, site.centre[1]), (0.0, 0.0)
        motions = [c.motions[which] if which < len(c.motions) else nowhere for c in channels]
        given = [point for point, _ in motions]
        fixed = np.array([motion is nowhere for motion in motions], dtype=np.bool_)
        x = np.array(given, dtype=np.float64).reshape(-1, 2) - np.array(site.centre)
        r = np.linalg.norm(x, axis=1)
        self.inside: Bools = (r < _INSIDE * site.radius) & ~fixed
        self._r = np.maximum(r, site.radius)
        angle = np.arctan2(x[:, 1], x[:, 0])
        self._cosine, self._sine = np.cos(2.0 * angle), np.sin(2.0 * angle)
        outwards = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        around = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        read = np.array([vector for _, vector in motions]).reshape(-1, 2)
        self._outwards, self._around = (read * outwards).sum(axis=1), (read * around).sum(axis=1)

    def moved(self, state: GroundState, released: Dual, load: OpeningLoad) -> Dual:
        """What this end adds to the channels, (n_channels,)."""
        rock, a = load.rock, load.opening.radius
        s = (a / self._r) ** 2
        size = released * a * a / (2.0 * rock.shear * self._r)
        along = load.deviation * self._cosine + load.shear * self._sine
        across = load.deviation * self._sine - load.shear * self._cosine
        radial = state.displacement(self._r) - size * along * (4.0 * (1.0 - rock.nu) - s)
        hoop = size * across * (2.0 - 4.0 * rock.nu + s)
        read: Dual = radial * self._outwards + hoop * self._around
        return read


def _first(reasons: Sequence[str | None], sequence: ConstructionSequence, n: int) -> str | None:
    """The first reason on the way to a state."""
    way = [0, *map(int, np.flatnonzero(sequence.built_on[:, n]))]
    return next((reasons[k] for k in way if reasons[k] is not None), None)


def _obstacle(
    sequence: ConstructionSequence, site: OpeningSite, state: ConstructionState
) -> str | None:
    """Why what happens at a state has no closed form, a clause, or None if it has one."""
    reasons = (part(sequence, site, state) for part in (_excavation, _ground, _other, _loads))
    return next((reason for reason in reasons if reason is not None), None)


def _excavation(_: ConstructionSequence, site: OpeningSite, state: ConstructionState) -> str | None:
    there = site.groups & state.materials.keys()
    if there and there != site.groups:
        return f"at stage '{state.name}' only a part of the opening is excavated"
    if not there and len({state.release.get(g) for g in site.groups}) > 1:
        return f"at stage '{state.name}' parts of the opening are released differently"
    return None


def _ground(
    sequence: ConstructionSequence, site: OpeningSite, state: ConstructionState
) -> str | None:
    if state.placed:
        return f"stage '{state.name}' installs '{sequence.groups[min(state.placed)]}'"
    virgin = sequence.states[0].materials
    for g in sorted((virgin.keys() | state.materials.keys()) - site.groups):
        if state.materials.get(g) != virgin.get(g):
            group = sequence.groups[g]
            return f"stage '{state.name}' changes '{group}', which is not part of the opening"
    return None


def _other(sequence: ConstructionSequence, _: OpeningSite, state: ConstructionState) -> str | None:
    for name, support in state.supports.items():
        if support.moves:
            return f"the support '{name}' is moved by what is given"
    if state.held != sequence.states[0].held:
        return f"stage '{state.name}' changes what is held"
    if state.structures:
        return f"'{min(state.structures)}' supports the ground at stage '{state.name}'"
    if state.temperature:
        return f"the temperature of '{sequence.groups[min(state.temperature)]}' changes"
    return None if state.water is None else "there is water in the pores"


def _loads(_: ConstructionSequence, site: OpeningSite, state: ConstructionState) -> str | None:
    for name, load in state.loads.items():
        at_wall = isinstance(load, Pressure) and (site.walls is None or load.group in site.walls)
        if not at_wall:
            return f"the load '{name}' is no pressure on the wall of the opening"
        if site.groups & state.materials.keys():
            return f"the load '{name}' acts before the opening is excavated"
    return None
