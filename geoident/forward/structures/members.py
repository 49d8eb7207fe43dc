"""Beams and bars in the sequence of stages: which stand when, what they bear, derivatives.

A structure works like a group of elements. It is built free of stress, its forces q (see
`fem.structures`) grow with the motion since then, and they end when it is dismantled. In the run

    q <- q + D(p) B du ,      r = f - C^T V sigma - B^T w q

so one more generalized stress is carried from stage to stage, with its derivatives. D holds EA(p)
and EI(p), N/m and N m; bars are smeared over their spacing out of plane. About an axis the members
are those of the whole turn: EA of all bars on it, or per metre of circumference.

A bar is *stressed* in a stage in which its force is given, at building or later: the jack holds the
force P(p) while ground and structures move, so

    q = P ,      D = 0      in that stage.

At its end the bar is locked off, exactly with P, and from the next stage on its stiffness works
again.

An anchor is a bar of its free length, N = EA / L_free times what head and grouted length move
apart. Along the grouted length it gives its force to the ground evenly, as bond is counted on in
design, and that end moves as the ground does there on average. (A bar tied rigidly to the ground
would give off most of the force where the grout begins, the more the finer the mesh.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.sparse as sp

from geoident.fem.shells import ShellMembers
from geoident.fem.stiffness import GroupBlocks
from geoident.fem.structures import (
    Members,
    SectionForces,
    area_shares,
    member_blocks,
    section_forces,
    stiffness_map,
)
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.forward.structures.end_moments import EndMoments, end_moments
from geoident.forward.structures.grouted import PlacedBars, bar_share, parts_of
from geoident.forward.structures.interfaces import InterfacePart, interface_parts
from geoident.forward.structures.placing import (
    bears_on,
    hinged_and_held,
    placed,
    present_throughout,
    toothed,
)
from geoident.model.actions import HeadForce
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar, Values
from geoident.model.structures import (
    Bars,
    Beam,
    GroutedBars,
    PileBending,
    PileContacts,
    Shell,
    Structure,
)

_NEVER_STRESSED = GroutedBars, PileContacts, PileBending
"""Parts of grouted bars that no jack stresses: it stresses their free lengths."""


@dataclass(frozen=True)
class StructureMembers:
    """One structure on the mesh.

    Args:
        name: of the structure.
        structure: what the case says of it.
        members: its members; those of bars are the bars in the order of the case.
        rows: where its rows lie among those of all structures.
        end_moments: of a beam, how moments at the ends of its pieces are found.
        joint: of an interface, where it is; its members are its points.
        whole: the structure of the case of which it is a part; empty where it is all of it.
    """

    name: str
    structure: Structure | Interface
    members: Members
    rows: slice
    end_moments: EndMoments | None = None
    joint: InterfacePart | None = None
    whole: str = ""

    @property
    def given_as(self) -> str:
        """Name of the structure in the case."""
        return self.whole or self.name

    def given(self, case: Case) -> Structure | Interface:
        """What a case of this mesh says of it: interfaces may have other strengths there."""
        return self.structure if self.joint is None else case.interfaces[self.joint.interface]

    def stands(self, state: ConstructionState) -> bool:
        """Whether it stands at a state."""
        if self.joint is not None:
            return self.joint.stands(state)
        return self.given_as in state.structures

    def stressed_in(self, state: ConstructionState) -> bool:
        """Whether its force is given in a state; of grouted bars that of the free lengths is."""
        if isinstance(self.structure, _NEVER_STRESSED):
            return False
        return self.given_as in state.stressed

    def section_forces(self, forces: Floats) -> SectionForces:
        """Forces in the sections of a beam without the teeth of its elements (see `end_moments`).

        Args:
            forces: q (n_rows, ...) of all structures.
        """
        section = section_forces(self.members, forces[self.rows])
        if self.end_moments is None:
            return section
        first, second = self.end_moments.apply(section.first, section.second)
        bent_first, bent_second = self.end_moments.apply(section.bent_first, section.bent_second)
        length = self.members.length.reshape(-1, *(1,) * (forces.ndim - 1))
        rise = (second - first) - (section.second - section.first)
        return replace(
            section,
            first=first,
            second=second,
            shear=section.shear + rise / length,
            bent_first=bent_first,
            bent_second=bent_second,
        )


class Structures:
    """All structures of a case that ever stand.

    `structures.checks` has made sure that each finds its nodes and elements.

    Args:
        on_mesh: the case on its mesh.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._sequence, self._mesh, self._on_mesh = on_mesh.sequence, on_mesh.mesh, on_mesh
        self._dim = on_mesh.mesh.dim
        self._gravity = np.array(on_mesh.case.gravity or (0.0,) * self._dim)
        self.parts = tuple(_placed_structures(on_mesh))
        members = [part.members for part in self.parts]
        operators = [m.operator for m in members] or [sp.csr_array((0, on_mesh.mesh.points.size))]
        self._operator = sp.csr_array(sp.vstack(operators))
        self._transpose = self._operator.T.tocsr()
        self._weight = np.concatenate([m.weight for m in members] or [np.empty(0)])

    @property
    def n_rows(self) -> int:
        """Number of member forces q; 0 if there are no structures."""
        return len(self._weight)

    @property
    def bars_and_beams(self) -> tuple[StructureMembers, ...]:
        """Those that are made of straight pieces."""
        others = Shell, Interface
        return tuple(p for p in self.parts if not isinstance(p.structure, others))

    def bending_of(self, part: StructureMembers) -> StructureMembers | None:
        """The bending of piles, where they bend."""
        own = (one for one in self.parts if isinstance(one.structure, PileBending))
        return next((one for one in own if one.whole == part.name), None)

    @property
    def shells(self) -> tuple[StructureMembers, ...]:
        """Those on faces."""
        return tuple(p for p in self.parts if isinstance(p.structure, Shell))

    @property
    def weight(self) -> Floats:
        """Weight w (n_rows,) with which each member force works."""
        return self._weight

    def key(self, number: int) -> int:
        """Key of a structure in the stiffness pattern, where groups have their indices."""
        return len(self._sequence.groups) + number

    def keys(self, state: ConstructionState) -> frozenset[int]:
        """Keys of the structures that work with their stiffness at a state."""
        return frozenset(self.key(n) for n, _ in self._stiff(state))

    def part(self, name: str) -> StructureMembers:
        """The members of a structure that ever stands."""
        return next(part for part in self.parts if part.name == name)

    def locked(self, state: ConstructionState, point: ParameterPoint) -> Floats:
        """Forces q (n_rows, 1 + n) given at a state, or at which bars were locked off before it."""
        return self._forces_given({**state.locked, **state.stressed}, point)

    def late_nodes(self) -> Ints:
        """Nodes (k,) of beams, which all couple: eliminated last, so that they do not fill in.

        Not of shells: their rotations are unknowns, so that only neighbours couple.
        """
        along = [p.members.operator.indices for p in self.parts if isinstance(p.structure, Beam)]
        dofs = np.concatenate([np.empty(0, dtype=np.int64), *along])
        return np.unique(dofs // self._dim)

    def blocks(self, rank: Ints) -> dict[int, GroupBlocks]:
        """Node-pair blocks by key; rank is the place (n_nodes,) of a node in the elimination."""
        return {
            self.key(n): member_blocks(part.members, rank, self._dim)
            for n, part in enumerate(self.parts)
        }

    def maps(
        self, state: ConstructionState, values: Values, grown: Mapping[str, float]
    ) -> dict[int, Floats]:
        """Stiffness maps (2 dim^2, dim^2) of the structures that stand, by key.

        Args:
            state: what stands.
            values: of the parameters, SI.
            grown: structure to what there is of its stiffness, where that is not all.
        """
        maps, point = {}, ParameterPoint(values, ())
        for n, part in self._stiff(state):
            each = rigidities(part.structure, point)[: part.members.n_rigidities]
            part_grown = grown.get(part.name, 1.0)
            maps[self.key(n)] = stiffness_map(
                [part_grown * float(one.value) for one in each], dim=self._dim
            )
        return maps

    def grown(self, moduli: Floats, grown: Mapping[str, Dual]) -> Floats:
        """D and its derivatives (n_rows, 1 + n), with the part of it that some structures have.

        Args:
            moduli: (n_rows, 1 + n) of all structures at their full stiffness.
            grown: structure to what there is of it.
        """
        if not grown:
            return moduli
        moduli = moduli.copy()
        for part in self.parts:
            if part.name in grown:
                whole = Dual(moduli[part.rows])
                moduli[part.rows] = (whole * Dual(grown[part.name].columns[None])).columns
        return moduli

    def moduli(self, state: ConstructionState, point: ParameterPoint) -> Floats:
        """D and its derivatives (n_rows, 1 + n), zero where nothing stands or forces are given."""
        result = np.zeros((self.n_rows, point.n_columns))
        for _, part in self._stiff(state):
            each = np.stack([one.columns for one in rigidities(part.structure, point)])
            result[part.rows] = each[part.members.rigidity]
        return result

    def loads(
        self, state: ConstructionState
    ) -> Iterator[tuple[str, Callable[[ParameterPoint], Floats]]]:
        """What acts at a state on the structures that stand: a name, its forces (n_dofs, 1 + n).

        Their weight, and forces on the heads of grouted bars.
        """
        for load_name, load in state.loads.items():
            if isinstance(load, HeadForce):
                yield f"the load '{load_name}'", partial(self._on_heads, load)
        for part in self.parts:
            one, stands = part.structure, part.stands(state)
            if stands and isinstance(one, Beam | Shell) and one.has_weight:
                name = f"the weight of the structure '{part.name}'"
                yield name, partial(self._weight_of, part)

    def _on_heads(self, load: HeadForce, point: ParameterPoint) -> Floats:
        """Forces (n_dofs, 1 + n) on first stations, whose motion counts into the ground."""
        bars = self._on_mesh.case.structures[load.structure]
        present = present_throughout(self._sequence, load.structure)
        assert isinstance(bars, GroutedBars)
        assert present is not None
        rows = PlacedBars(self._on_mesh, load.structure, bars, present).rows
        ways = -rows.axes[:, 0] if load.direction is None else np.array(load.direction)
        by_axis = np.einsum("nij,nj->ni", rows.axes, np.broadcast_to(ways, rows.axes[:, 0].shape))
        forces = np.zeros((self._mesh.points.size, point.n_columns))
        force = point.number(load.value) / bar_share(bars, point)
        dofs = rows.nodes[:, :1] * self._dim + np.arange(self._dim)
        forces[dofs] = (rows.extent[:, None] * by_axis)[..., None] * force.columns
        return forces

    def _weight_of(self, part: StructureMembers, point: ParameterPoint) -> Floats:
        """Nodal forces (n_dofs, 1 + n) of the weight of a beam or shell, N."""
        beam, members = part.structure, part.members
        assert isinstance(beam, Beam | Shell)
        size = float(np.linalg.norm(self._gravity))
        if beam.density is not None and beam.thickness is not None:
            pressure = point.number(beam.density) * point.number(beam.thickness)
            pressure = pressure.times(size)
        else:
            pressure = point.constant(0.0) if beam.weight is None else point.number(beam.weight)
        if isinstance(members, ShellMembers):
            shares = members.node_area
        else:
            shares = area_shares(self._mesh, members)
        unit = np.outer(shares, self._gravity / size).ravel()
        return np.outer(unit, pressure.columns)

    def strain(self, u: Floats) -> Floats:
        """Member strains (n_rows, ...) of displacements (n_dofs, ...)."""
        return np.asarray(self._operator @ u)

    def nodal_forces(self, forces: Floats) -> Floats:
        """B^T w q, (n_dofs, k), of member forces (n_rows, k)."""
        return np.asarray(self._transpose @ (self._weight[:, None] * forces))

    def begin(self, state: ConstructionState, forces: Floats, point: ParameterPoint) -> None:
        """Forces (n_rows, 1 + n + k) with which a stage begins.

        What does not stand, or is built only now, carries none; what is stressed, the given force.

        Args:
            state: at the end of the stage.
            forces: (n_rows, 1 + n + k) carried from the stage before, changed in place.
            point: the parameters, and the n of them by which the analysis differentiates.
        """
        forces[self.begins_anew(state)] = 0.0
        if state.stressed:
            forces[:, : point.n_columns] += self.given(state, point)

    def begins_anew(self, state: ConstructionState) -> Bools:
        """(n_rows,) forces that do not come from the stage before."""
        anew = np.zeros(self.n_rows, dtype=bool)
        for part in self.parts:
            stays = part.stands(state) and not self._is_built(part, state)
            anew[part.rows] = not stays or part.stressed_in(state)
        return anew

    def _is_built(self, part: StructureMembers, state: ConstructionState) -> bool:
        """Whether a part that stands at a state did not stand at the one before."""
        if part.joint is None:
            return part.given_as in state.built
        placed = not state.placed.isdisjoint(part.joint.beside)
        return placed or not part.joint.stands(self._sequence.states[state.base])

    @property
    def joints(self) -> tuple[StructureMembers, ...]:
        """The parts that are interfaces."""
        return tuple(part for part in self.parts if part.joint is not None)

    def given(self, state: ConstructionState, point: ParameterPoint) -> Floats:
        """Forces q (n_rows, 1 + n) to which bars are brought at a state; others zero."""
        return self._forces_given(state.stressed, point)

    def _forces_given(self, forces: Mapping[str, Scalar], point: ParameterPoint) -> Floats:
        """Forces q (n_rows, 1 + n) of some bars, structure to the force of one bar; others zero."""
        result = np.zeros((self.n_rows, point.n_columns))
        for part in self.parts:
            name, bars = part.given_as, part.structure
            if name not in forces or isinstance(bars, _NEVER_STRESSED):
                continue
            if isinstance(bars, Bars):
                force = point.number(forces[name]).times(bars.sense)
                result[part.rows] = (force / bar_share(bars, point)).columns
        return result

    def yielding(self, state: ConstructionState) -> list[StructureMembers]:
        """Structures that work with their stiffness at a state, and yield."""
        parts = [part for _, part in self._stiff(state) if part.structure.yields]
        return [part for part in parts if part.joint is None or part.joint.is_limited(state)]

    def _stiff(self, state: ConstructionState) -> Iterator[tuple[int, StructureMembers]]:
        """Parts that stand and whose force is not given."""
        return (
            (n, p) for n, p in enumerate(self.parts) if p.stands(state) and not p.stressed_in(state)
        )


def rigidities(structure: Structure | Interface, point: ParameterPoint) -> tuple[Dual, ...]:
    """EA and EI per metre out of plane (in a solid: EA of a bar), with derivatives.

    About an axis EA of bars is that of all around it, or per metre of circumference. Grouted bars
    have EA and k_grout, what holds piles across themselves or at their toes one spring, their
    bending EI. Those of a shell are four, see `fem.shells`; of an interface k_n and k_s, Pa/m.
    """
    if isinstance(structure, Interface):
        return point.number(structure.k_n), point.number(structure.k_s)
    none = point.constant(0.0)
    if isinstance(structure, Shell):
        nu, t = point.number(structure.nu), point.number(structure.thickness)
        half = (point.number(structure.E) * t).times(0.5)
        membrane, bends = (half / (1.0 - nu), half / (1.0 + nu)), (t * t).times(1 / 12)
        return (*membrane, *(one * bends for one in membrane))
    if isinstance(structure, Beam):
        if structure.EA is not None and structure.EI is not None:
            return point.number(structure.EA), point.number(structure.EI)
        if structure.E is None or structure.thickness is None:
            return none, none
        modulus, t = point.number(structure.E), point.number(structure.thickness)
        if structure.nu is not None:
            nu = point.number(structure.nu)
            modulus = modulus / (1.0 - nu * nu)
        return modulus * t, (modulus * t * t * t).times(1 / 12)
    assert isinstance(structure, Bars)
    share = bar_share(structure, point)
    if isinstance(structure, PileContacts):
        each = point.number(structure.stiffness) / share
        return each, each
    if isinstance(structure, PileBending) and structure.EI is not None:
        return point.number(structure.EI) / share, none
    if structure.EA is not None:
        axial = point.number(structure.EA)
    elif structure.E is not None and structure.diameter is not None:
        diameter = point.number(structure.diameter)
        axial = (point.number(structure.E) * diameter * diameter).times(np.pi / 4)
        if isinstance(structure, PileBending):
            return (axial * diameter * diameter).times(1 / 16) / share, none
    elif structure.E is not None and structure.area is not None:
        axial = point.number(structure.E) * point.number(structure.area)
    else:
        axial = none
    if isinstance(structure, GroutedBars):
        return axial / share, point.number(structure.k_grout) / share
    return axial / share, none


def inadmissible(case: Case, values: Values) -> str | None:
    """Which number of a structure is impossible at parameter values, or None."""
    for name, structure in case.structures.items():
        reason = structure.breach(values)
        if reason:
            return f"of the structure '{name}' {reason}"
    for stage in case.stages:
        for name, scalar in stage.prestress.items():
            if not scalar.value(values) >= 0.0:
                return (
                    f"at stage '{stage.name}' the prestress of the structure '{name}' is "
                    f"{scalar.value(values):.6g}, it must not be negative"
                )
            bars = case.structures[name]
            beyond = bars.overstressed(scalar, values) if isinstance(bars, Bars) else None
            if beyond:
                return f"at stage '{stage.name}' of the structure '{name}' {beyond}"
    return None


def _placed_structures(on_mesh: CaseOnMesh) -> list[StructureMembers]:
    """The structures that ever stand; for beams, also how moments at ends of pieces are found."""
    mesh, first = on_mesh.mesh, 0
    parts = []
    for name, structure in on_mesh.case.structures.items():
        present = present_throughout(on_mesh.sequence, name)
        if present is None:
            continue
        pieces: Iterable[tuple[str, Structure, Members]]
        if isinstance(structure, GroutedBars):
            pieces = parts_of(on_mesh, name, structure, present)
        else:
            pieces = [(name, structure, placed(on_mesh, name, present))]
        for own_name, what, members in pieces:
            rows = slice(first, first + len(members.weight))
            first = rows.stop
            whole = "" if own_name == name else name
            parts.append(StructureMembers(own_name, what, members, rows, whole=whole))
    bearing = [bears_on(mesh, part.members) for part in parts]
    for n, part in enumerate(parts):
        nodes, beam = part.members.nodes, part.structure
        if nodes is None or isinstance(beam, Shell):
            continue
        assert isinstance(beam, Beam)
        hinged, held = hinged_and_held(on_mesh, beam)
        others = [np.zeros(mesh.n_nodes, dtype=bool), *bearing[:n], *bearing[n + 1 :]]
        kinked = np.logical_or.reduce(others)
        of_three = toothed(mesh, beam, nodes)
        moments = end_moments(nodes, part.members.ends, of_three, kinked, held, hinged)
        parts[n] = replace(part, end_moments=moments)
    for joint in interface_parts(on_mesh):
        rows = slice(first, first + len(joint.points.members.weight))
        first = rows.stop
        parts.append(
            StructureMembers(joint.name, joint.given, joint.points.members, rows, joint=joint)
        )
    return parts
