"""Whether predicted stages load the ground beyond what the fitted ones have tested (theory 13.4).

An elastic model says the same of every stress. That it meets the readings of the fitted stages says
nothing of stresses that none of them reached. So the stresses of both are compared, where the
readings come from: in the elastic ground near the gauges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.forward.stages import ConstructionSequence
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.gauges import Channel
from geoident.model.results.findings import Finding
from geoident.model.results.result import FieldSeries

WORTH_SAYING = 0.1
"""Excess of the stresses of a predicted stage over those of the fitted ones that is said.

Where rock begins to yield, less than this changes little (theory 13.4)."""

SHARE = 0.95
"""Part of the volume that bears less than the stress that counts: corners do not."""


@dataclass(frozen=True)
class StressLevels:
    """Stresses that 95 % of the ground near the gauges stay below, state by state.

    Args:
        deviatoric: (n_states,) of sqrt(3 J2), Pa; NaN where there is no such ground.
        compression: (n_states,) of the largest compression, Pa.
    """

    deviatoric: Floats
    compression: Floats

    def excess(self, last: int) -> tuple[Floats, Floats]:
        """By how much, relative, every state exceeds those up to one.

        Args:
            last: state of the last fitted stage.

        Returns:
            (n_states,), (n_states,) of deviatoric stress and of compression; NaN for fitted states.
        """
        return _excess(self.deviatoric, last), _excess(self.compression, last)


def _excess(level: Floats, last: int) -> Floats:
    known = level[: last + 1]
    tested = np.nanmax(known, initial=0.0)
    excess = np.full(len(level), np.nan)
    if tested > 0.0:
        excess[last + 1 :] = level[last + 1 :] / tested - 1.0
    return excess


def stress_levels(
    model: ObservedModel, case: Case, fields: FieldSeries | None
) -> StressLevels | None:
    """The stresses of the elastic ground near the gauges; None without a mesh or such ground.

    Args:
        model: of the case.
        case: the case.
        fields: stresses of its states.
    """
    if fields is None or not isinstance(model, StagedModel) or not case.channels:
        return None
    points = model.discretization.points
    volume = np.bincount(points.element, weights=points.volume, minlength=fields.mesh.n_elements)
    near = near_gauges(_centres(fields), case.channels)
    ground = _elastic_ground(case, model.sequence, fields.mesh.n_elements)
    levels = np.full((len(model.sequence.states), 2), np.nan)
    for state, stress in enumerate(fields.stress):
        counted = near & ground[state] & fields.present[state] & np.isfinite(stress).all(axis=1)
        if counted.any():
            both = _measures(stress[counted])
            levels[state] = [_quantile(one, volume[counted]) for one in both]
    return StressLevels(levels[:, 0], levels[:, 1]) if np.isfinite(levels).any() else None


def near_gauges(centres: Floats, channels: tuple[Channel, ...]) -> Bools:
    """Which places (m, dim) readings come from.

    Those that are not farther from the line between the two points of a gauge than its length:
    what a pair of opposite unit forces at these points strains, by which ground acts on the
    reading, falls with the square of the distance from there (Saint-Venant). A gauge that reads
    the motion of one point counts with the longest of these lengths; if there is none, all places
    count.
    """
    lengths = [_length(channel) for channel in channels]
    longest = max(lengths)
    if longest <= 0.0:
        return np.ones(len(centres), dtype=np.bool_)
    near = np.zeros(len(centres), dtype=np.bool_)
    for channel, length in zip(channels, lengths, strict=True):
        second = np.array(channel.second)
        first = second if channel.first is None else np.array(channel.first)
        near |= _distance(centres, first, second) <= (length or longest)
    return near


def _length(channel: Channel) -> float:
    if channel.first is None:
        return 0.0
    return float(np.linalg.norm(np.subtract(channel.first, channel.second)))


def _distance(places: Floats, first: Floats, second: Floats) -> Floats:
    """Of places (m, dim) from a segment, (m,)."""
    along = second - first
    square = float(along @ along)
    part = np.clip((places - first) @ along / square, 0.0, 1.0) if square else np.zeros(len(places))
    return np.asarray(np.linalg.norm(places - first - part[:, None] * along, axis=1))


def _centres(fields: FieldSeries) -> Floats:
    """(n_elements, dim) means of the nodes of the elements."""
    mesh = fields.mesh
    return np.concatenate([mesh.points[block.nodes].mean(axis=1) for block in mesh.blocks])


def _elastic_ground(case: Case, sequence: ConstructionSequence, n_elements: int) -> Bools:
    """(n_states, n_elements) ground that was there before construction, neither yields nor hardens.

    What is installed (a lining, a fill) is no ground that earlier stages have tested.
    """
    placed = {name for stage in case.stages for name in (*stage.install, *stage.change)}
    first = sequence.states[0].materials
    ground = [group for group in first if sequence.groups[group] not in placed]
    elastic = np.zeros((len(sequence.states), n_elements), dtype=np.bool_)
    for n, state in enumerate(sequence.states):
        for group in ground:
            name = state.materials.get(group)
            material = None if name is None else case.materials[name]
            if material is not None and not material.yields and material.soil is None:
                elastic[n, sequence.elements(group)] = True
    return elastic


def _measures(stress: Floats) -> tuple[Floats, Floats]:
    """sqrt(3 J2) and the largest compression (m,) of stresses (m, 6), xx yy zz xy yz xz."""
    xx, yy, zz, xy, yz, xz = stress.T
    tensor = np.stack([np.stack(r, -1) for r in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], -2)
    principal = np.linalg.eigvalsh(tensor)
    deviator = principal - principal.mean(axis=1, keepdims=True)
    return np.sqrt(1.5 * np.sum(deviator**2, axis=1)), np.maximum(-principal[:, 0], 0.0)


def _quantile(values: Floats, volume: Floats) -> float:
    """What the values (m,) of 95 % of the volume (m,) do not exceed."""
    order = np.argsort(values)
    below = np.cumsum(volume[order])
    return float(values[order][np.searchsorted(below, SHARE * below[-1])])


def extrapolation_findings(
    levels: StressLevels | None, case: Case, last: int, states: Bools
) -> tuple[Finding, ...]:
    """A finding if predicted stages load elastic ground more than the fitted ones did.

    Args:
        levels: of the ground near the gauges.
        case: names of the stages.
        last: state of the last fitted stage.
        states: (n_states,) which are predicted.
    """
    if levels is None:
        return ()
    both = [np.where(states, excess, np.nan) for excess in levels.excess(last)]
    worst = [np.nanmax(excess, initial=-1.0) for excess in both]
    if not max(worst) > WORTH_SAYING:
        return ()
    kind = int(np.argmax(worst))
    name = case.stage_names[int(np.nanargmax(both[kind]))]
    what = ("deviatoric stress", "compression")[kind]
    sentence = (
        f"Computed stresses at {name} exceed those of the fitted stages by {100 * worst[kind]:.0f} "
        f"% ({what} in the ground near the gauges): an elastic model has not been tested there."
    )
    return (Finding("extrapolation", name, sentence, {"excess": float(worst[kind])}),)
