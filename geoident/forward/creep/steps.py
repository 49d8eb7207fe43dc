"""Creep and ageing of the ground in the steps of an analysis (theory 18.4).

A step of a size is a stage of other moduli: what the past makes creep is taken from the stress that
is carried, the step is solved with the stiffness that the size has, and the strains of the elements
follow from the change of stress.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from geoident.fem.creep import CreepStep, scaled, scaling_matrices
from geoident.fem.elasticity import Moduli, PointwiseModuli, ScaledModuli, UniformModuli
from geoident.forward.creep.chain import ChainMaker, grown
from geoident.forward.ground.elasticity import MaterialModuli, ModeSlopes, ModuliAt
from geoident.forward.stages import CaseOnMesh, Index, as_index, numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.creep import Ageing
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import constants
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Shell


@dataclass
class CreepStrains:
    """What creeping ground carries beside its stress, changed in place.

    Args:
        points: material to its strain points (q,), ascending, of all stages.
        strains: material to the strains of its elements as stress (k, s, q, c), Pa.
        at_rest: (s, n_points, c) stress under which the ground does not creep, Pa.
        placed: (n_points,) when the ground was placed, s; minus infinity for virgin ground.
        built: structure to when it was built, s.
        time: since the virgin state, s.
    """

    points: Mapping[str, Ints]
    strains: dict[str, Floats]
    at_rest: Floats
    placed: Floats
    built: dict[str, float] = field(default_factory=dict)
    time: float = 0.0

    def clear(self, points: Bools | Ints | slice) -> None:
        """Points (n_points,), or (k,) by number, that are gone or placed anew begin as new."""
        self.at_rest[:, points] = 0.0
        self.begin(points)

    def begin(self, points: Bools | Ints | slice) -> None:
        """Points whose material is another from now on: it has not crept yet."""
        self.placed[points] = self.time
        chosen = np.zeros(len(self.placed), dtype=bool)
        chosen[points] = True
        for material, strains in self.strains.items():
            strains[:, :, chosen[self.points[material]]] = 0.0

    def copy(self) -> CreepStrains:
        """A copy of its own."""
        return CreepStrains(
            self.points,
            {material: strains.copy() for material, strains in self.strains.items()},
            self.at_rest.copy(),
            self.placed.copy(),
            self.built.copy(),
            self.time,
        )


@dataclass(frozen=True, eq=False)
class StepModuli:
    """Moduli of a step: those of the ground, less what creeps in it.

    Args:
        ground: of the materials.
        stiffness: material to r, (2,) of shear and volume, or (q, 2) at its points.
        names: parameters by which r has derivatives.
    """

    ground: ModuliAt
    stiffness: Mapping[str, Dual]
    names: tuple[str, ...]
    _made: dict[str, MaterialModuli] = field(default_factory=dict)

    def moduli(self, material: str, points: Index | None = None) -> MaterialModuli:
        """R E at strain points of a material with its derivatives, as `ModuliAt` has E."""
        r = self.stiffness.get(material)
        if r is None:
            return self.ground.moduli(material, points)
        if material not in self._made:
            elastic = self.ground.moduli(material, points)
            slopes = {name: _product(slope, r.value) for name, slope in elastic.slopes.items()}
            for n, name in enumerate(self.names):
                change = r.slope(n)
                if change is not None:
                    more = _product(elastic.value, change)
                    slopes[name] = _sum(slopes[name], more) if name in slopes else more
            modes = tuple(
                ModeSlopes(_product(one.moduli, r.value), one.field, one.places)
                for one in elastic.modes
            )
            value = _product(elastic.value, r.value)
            self._made[material] = MaterialModuli(value, slopes, modes)
        return self._made[material]


def _product(moduli: Moduli, r: Floats) -> Moduli:
    """R E of moduli and numbers (2,) of shear and volume, or (q, 2)."""
    pointwise, alike = r.ndim > 1, np.array_equal(r[..., 0], r[..., 1])
    if isinstance(moduli, PointwiseModuli):
        R = scaling_matrices(r, len(moduli.entries))
        R = R if pointwise else R[None]
        return PointwiseModuli(np.einsum("qab,bcq->acq", R, moduli.entries))
    assert isinstance(moduli, UniformModuli | ScaledModuli)
    matrix = moduli.matrix
    if not pointwise:
        scaled_matrix = scaling_matrices(r, len(matrix)) @ matrix
        return replace(moduli, matrix=scaled_matrix)
    factor = moduli.factor if isinstance(moduli, ScaledModuli) else np.ones(len(r))
    if alike:
        return ScaledModuli(matrix, r[:, 0] * factor)
    return PointwiseModuli(
        np.einsum("qab,bc,q->acq", scaling_matrices(r, len(matrix)), matrix, factor)
    )


def _sum(one: Moduli, other: Moduli) -> Moduli:
    """The sum of moduli at the same points."""
    if isinstance(one, UniformModuli) and isinstance(other, UniformModuli):
        return UniformModuli(one.matrix + other.matrix)
    if (
        isinstance(one, ScaledModuli)
        and isinstance(other, ScaledModuli)
        and one.factor is other.factor
    ):
        return ScaledModuli(one.matrix + other.matrix, one.factor)
    q = next(_count(each) for each in (one, other) if not isinstance(each, UniformModuli))
    every = np.arange(q)
    both = one.matrices(every) + other.matrices(every)
    return PointwiseModuli(np.ascontiguousarray(np.moveaxis(both, 0, -1)))


def _count(moduli: Moduli) -> int:
    """At how many points moduli stand that vary."""
    if isinstance(moduli, ScaledModuli):
        return len(moduli.factor)
    assert isinstance(moduli, PointwiseModuli)
    return int(moduli.entries.shape[-1])


def _places(every: Ints, some: Ints) -> Index:
    """Where some points (p,) stand among every point (q,) of a material, both ascending."""
    return as_index(np.isin(every, some))


@dataclass(frozen=True, eq=False)
class CreepingPoints:
    """Strain points of a material that creeps, in one step.

    Args:
        points: (q,) those that are there.
        places: (q,) where they stand among all of the material.
        step: of its chain.
        driving: (s, q, c) stress that makes it creep at the beginning of the step, Pa.
    """

    points: Index
    places: Index
    step: CreepStep
    driving: Floats


@dataclass(frozen=True, eq=False)
class CreepInStep:
    """What creeps in one step, between its beginning and its end.

    Args:
        moduli: of the step.
        key: what they depend on beside the ground: steps of one key have one stiffness.
        h: its size, s.
        members: structure to what there is of its stiffness, on average over the step.
        creeping: material to what of it creeps.
    """

    moduli: StepModuli
    key: Hashable
    h: float
    members: Mapping[str, Dual]
    creeping: Mapping[str, CreepingPoints]

    def end(self, stress: Floats, carried: CreepStrains) -> None:
        """Bring the strains of the elements to the end of the step.

        Args:
            stress: (s, n_points, c) there.
            carried: changed in place.
        """
        for material, one in self.creeping.items():
            change = stress[:, one.points] - carried.at_rest[:, one.points] - one.driving
            strains, places = carried.strains[material], one.places
            strains[:, :, places] = one.step.advanced(strains[:, :, places], one.driving, change)
        if np.isfinite(self.h):
            carried.time += self.h


class CreepSteps:
    """Makes the steps of an analysis at one parameter vector.

    Args:
        on_mesh: the case on its mesh.
        point: the parameters, and those to differentiate by in the run.
        ground: moduli of all materials; it may know derivatives by more parameters.
    """

    def __init__(self, on_mesh: CaseOnMesh, point: ParameterPoint, ground: ModuliAt) -> None:
        self._on_mesh, self._point, self._ground = on_mesh, point, ground
        case = on_mesh.case
        used = [case.materials[name] for name in on_mesh.sequence.materials]
        longest = sum(one.lasts or 0.0 for one in case.stages if not one.goes_on)
        makers = {m.name: ChainMaker(m, case.parameters, longest) for m in used if m.creep}
        self._chains = {name: maker.chain(point) for name, maker in makers.items()}
        self._ageing: dict[str, tuple[Ageing, Scalar | None]] = {
            m.name: (m.ageing, constants(m.elastic).get("E")) for m in used if m.ageing is not None
        }
        self._beams = {
            name: (one.ageing, one.E)
            for name, one in case.structures.items()
            if isinstance(one, Beam | Shell) and one.ageing is not None
        }

    def at_rest(self, stress: Floats) -> CreepStrains:
        """What is carried at the beginning, under the virgin stress (s, n_points, c)."""
        points = {name: self._on_mesh.material_points(name) for name in self._chains}
        strains = {
            name: np.zeros((len(chain.parts), len(stress), len(points[name]), stress.shape[2]))
            for name, chain in self._chains.items()
        }
        placed = np.full(stress.shape[1], -np.inf)
        return CreepStrains(points, strains, stress.copy(), placed)

    def begin(
        self,
        stress: Floats,
        carried: CreepStrains,
        points_of: Mapping[str, Index],
        structures: Collection[str],
        h: float,
    ) -> CreepInStep:
        """Begin a step: what the past makes creep in it is taken from the stress, in place.

        Args:
            stress: (s, n_points, c) at its beginning.
            carried: what creeping ground carries there.
            points_of: material to its points that are there.
            structures: names of those that stand.
            h: size, s; infinite for all the time that creep takes.
        """
        stiffness: dict[str, Dual] = {}
        creeping: dict[str, CreepingPoints] = {}
        key: list[Hashable] = [h]
        for name, points in points_of.items():
            growth = self._growth(name, carried, points, h)
            if growth is not None:
                key.append(growth.value.tobytes())
            if name in self._chains:
                step = self._chains[name].step(h)
                places = _places(carried.points[name], numbers(points, stress.shape[1]))
                driving = stress[:, points] - carried.at_rest[:, points]
                past = step.history(driving, carried.strains[name][:, :, places])
                stiffness[name] = step.stiffness(growth)
                stress[:, points] -= scaled(stiffness[name].columns, past)
                creeping[name] = CreepingPoints(points, places, step, driving)
            elif growth is not None:
                stiffness[name] = Dual(np.repeat(growth.columns[:, None], 2, axis=1))
        members = {
            name: self._grown(law, np.array([carried.time - carried.built[name]]), h)[0]
            for name, law in self._beams.items()
            if name in structures
        }
        key += [float(growth.value) for growth in members.values()]
        return CreepInStep(
            StepModuli(self._ground, stiffness, self._point.names), tuple(key), h, members, creeping
        )

    def _growth(self, name: str, carried: CreepStrains, points: Index, h: float) -> Dual | None:
        """What there is of the stiffness of a material at its points (q,); None for all."""
        if name not in self._ageing:
            return None
        return self._grown(self._ageing[name], carried.time - carried.placed[points], h)

    def _grown(self, law: tuple[Ageing, Scalar | None], ages: Floats, h: float) -> Dual:
        # a step without end is one of old ground alone: younger is refused with the case
        return grown(*law, self._point, ages, h if np.isfinite(h) else 0.0)
