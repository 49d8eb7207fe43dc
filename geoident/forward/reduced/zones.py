"""Of what the stress of every strain point is made: the history of the ground (theory 14).

With u_j the displacements of the end of state j, counted as the run counts them, the stress at a
point of an elastic case is

    sigma_j = sigma_0 + E_0 C d_0 + sum_k E_k C (u_end(k) - u_start(k))

over the *segments* of its history: from where it was placed, or its material changed, to where that
ended or to now. sigma_0 and d_0, the in-situ stress and the motion that balances it, belong to
ground that has been there since the virgin state. Points of one history make a zone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.reduced.points import AnalysisPoints
from geoident.forward.stages import CaseOnMesh, numbers
from geoident.model.arrays import Ints

StressTerm = tuple[int, str]
"""State and material: E_material C u_state is part of the stress of a zone."""


@dataclass(frozen=True)
class Segment:
    """Strain that met one material.

    Args:
        material: its name.
        start: state whose displacements it counts from; None for none.
        end: state at whose displacements it ends.
    """

    material: str
    start: int | None
    end: int


@dataclass(frozen=True)
class StressHistory:
    """What a group went through.

    Args:
        virgin: its material in the virgin state, if it has been there since then, else None.
        segments: in their order.
        given: its stress began with one that is given: in situ, or by a jack.
    """

    virgin: str | None
    segments: tuple[Segment, ...]
    given: bool = False

    def went_on(self, material: str, base: int, state: int) -> StressHistory:
        """The same one state later.

        Args:
            material: of which the group is now.
            base: the state before.
            state: the one later.
        """
        before = self.segments[-1:]
        if before and before[0].material == material:
            return replace(self, segments=(*self.segments[:-1], replace(before[0], end=state)))
        return replace(self, segments=(*self.segments, Segment(material, base or None, state)))


@dataclass(frozen=True)
class Zone:
    """Strain points of one history.

    Args:
        points: (q,) their numbers, ascending.
        material: of which they are now.
        before: of which they were in the state on which this one builds; the same where they
            were placed since.
        history: what they went through.
    """

    points: Ints
    material: str
    before: str
    history: StressHistory

    @property
    def parts(self) -> list[tuple[int, str, float]]:
        """States whose displacements are part of its stress, with material and sign.

        Of the virgin state it is the motion that balanced it.
        """
        parts: list[tuple[int, str, float]] = []
        if self.history.virgin is not None:
            parts.append((0, self.history.virgin, 1.0))
        for segment in self.history.segments:
            parts.append((segment.end, segment.material, 1.0))
            if segment.start is not None:
                parts.append((segment.start, segment.material, -1.0))
        return parts


def zones_of(on_mesh: CaseOnMesh) -> tuple[tuple[Zone, ...], ...]:
    """The zones of every state."""
    sequence, discretization = on_mesh.sequence, on_mesh.discretization
    n_points = discretization.points.n_points
    of_state: list[dict[int, StressHistory]] = []
    of_states = []
    for number, state in enumerate(sequence.states):
        before = {} if number == 0 else of_state[state.base]
        histories: dict[int, StressHistory] = {}
        for group, material in state.materials.items():
            if number == 0:
                histories[group] = StressHistory(material, (), given=True)
            elif group in state.placed or group not in before:
                new = Segment(material, state.base or None, number)
                histories[group] = StressHistory(None, (new,))
            else:
                histories[group] = before[group].went_on(material, state.base, number)
        of_state.append(histories)
        made_of = sequence.states[state.base].materials
        alike: dict[tuple[str, str, StressHistory], list[Ints]] = {}
        for group, history in histories.items():
            material = state.materials[group]
            old = material if group in state.placed else made_of.get(group, material)
            points = numbers(discretization.points_of[group], n_points)
            if len(points):  # a mesh may name groups without elements
                alike.setdefault((material, old, history), []).append(points)
        zones = [Zone(np.sort(np.concatenate(points)), *kind) for kind, points in alike.items()]
        of_states.append(tuple(zones))
    return tuple(of_states)


def member_zones(analysis: StagedAnalysis, points: AnalysisPoints) -> tuple[tuple[Zone, ...], ...]:
    """The zones of every state that are members: those of a structure with one rigidity.

    Bars that a jack or a press holds in a state work without stiffness: they are no zone of it, and
    begin from there.

    Args:
        analysis: of the case.
        points: of the analysis.
    """
    of_state: list[dict[str, StressHistory]] = []
    of_states = []
    for number, state in enumerate(analysis.sequence.states):
        before = {} if number == 0 else of_state[state.base]
        histories: dict[str, StressHistory] = {}
        zones = []
        for part in analysis.systems.structures.parts:
            if not part.stands(state):
                continue
            if part.stressed_in(state):
                histories[part.name] = StressHistory(None, (), given=True)
                continue
            if part.given_as in state.built or part.name not in before:
                history = StressHistory(None, (Segment(part.name, state.base or None, number),))
            else:
                history = before[part.name].went_on(part.name, state.base, number)
            histories[part.name] = history
            for which in range(part.members.n_rigidities):
                rows = np.flatnonzero(part.members.rigidity == which)
                if len(rows):
                    rigidity = rigidity_name(part.name, which)
                    segments = tuple(replace(s, material=rigidity) for s in history.segments)
                    at = points.n_ground + part.rows.start + rows
                    zones.append(Zone(at, rigidity, rigidity, replace(history, segments=segments)))
        of_state.append(histories)
        of_states.append(tuple(zones))
    return tuple(of_states)


def rigidity_name(structure: str, number: int) -> str:
    """What stands for a material where members of a structure are a zone."""
    return f"{('EA', 'EI', 'third', 'fourth')[number]} of {structure}"
