"""The error of the model as errors that readings share (theory 9).

What a stage adds to a computed reading may be wrong by a part eta of itself, alike where gauges are
near to each other, and three quarters of it alike in all stages:

    C = eta^2 [ (1 - t) sum_j (D_j R D_j + F_j M F_j) + t (sum_j D_j) R (sum_j D_j) + ... ]

D_j are the signed steps, so nothing depends on which direction counts as positive. R is the
correlation of relative errors. F_j M F_j is an error that a reading has however little it changes:
of a field of displacements as large as a tenth of what the gauges feel, at the points of the gauge.

An error is known by its rows: the steps of each reading and where its gauge is. Rows of the
readings used and of later ones together give the columns of shared errors (theory 7), in which
both are one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.forward.gauges.kinds import reads_displacements
from geoident.forward.protocols import CaseModel
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel
from geoident.model.methods import ModelErrorOptions
from geoident.model.structures import Bars

PERSISTENT = 0.75
"""Part t of the variance of a relative error that is the same in all stages."""

ALIGNED = 0.5
"""Part of the correlation that motions in one direction share, and those across do not."""

FLOOR = 0.1
"""Error of a reading that hardly changes, in parts of that of the others."""


@dataclass(frozen=True)
class ReadingSteps:
    """What the model error of g readings is made of.

    Args:
        channels: of each reading.
        states: names of the J states.
        steps: (g, J) what each step adds to each computed reading, SI.
        floors: (g, J) the error at eta = 1 that a reading has of a step in any case, SI.
    """

    channels: tuple[Channel, ...]
    states: tuple[str, ...]
    steps: Floats
    floors: Floats

    def any(self) -> bool:
        """Whether any reading has a model error."""
        return bool(np.any(self.steps))


def reading_steps(
    case: Case,
    model: CaseModel,
    increments: Floats,
    pairs: Sequence[tuple[str, str]],
    length: float,
) -> ReadingSteps:
    """What the model error of some readings is made of.

    Args:
        case: of the model.
        model: tells which steps make a reading.
        increments: (n_states, n_channels) what each step changes in what the channels see, SI.
        pairs: channel and stage of each of the g readings.
        length: over which it is correlated, m.
    """
    found = np.where(_given(case), 0.0, increments)
    number = {channel.name: k for k, channel in enumerate(case.channels)}
    rows = np.array([number[channel] for channel, _ in pairs], dtype=np.int64)
    weight = model.steps(pairs)
    floors = _floors(case.channels, found, length)
    return ReadingSteps(
        tuple(case.channels[k] for k in rows.tolist()),
        case.stage_names,
        (weight * found[:, rows]).T,
        (weight * floors[:, rows]).T,
    )


def _given(case: Case) -> Bools:
    """(n_states, n_channels) what the case gives, so that no model can be wrong there.

    The force to which a jack brings a bar; the pressure of water, which is a table.
    """
    given = np.zeros((len(case.stages) + 1, len(case.channels)), dtype=np.bool_)
    for k, channel in enumerate(case.channels):
        if channel.kind == "piezometer":
            given[:, k] = True
        bars = case.structures.get(channel.structure)
        if channel.kind != "load-cell" or not isinstance(bars, Bars):
            continue
        for j, stage in enumerate(case.stages, start=1):
            locked = channel.structure in stage.prestress
            built = channel.structure in stage.build and bars.prestress is not None
            given[j, k] = locked or built
    return given


def _floors(channels: Sequence[Channel], increments: Floats, length: float) -> Floats:
    """(n_states, n_channels) error at eta = 1 of a channel that a step hardly moves, SI.

    In each step a tenth of the root mean square of what the gauges of one family feel, each in
    proportion to the difference that a field of errors would make between its points.
    """
    floors = np.zeros_like(increments)
    for members in _families(channels):
        _, between = _correlations([channels[k] for k in members], length)
        size = np.sqrt(np.maximum(np.diag(between), 0.0))
        steps = increments[:, members]
        felt = np.divide(steps, size, out=np.zeros_like(steps), where=size > 0.0)
        moved = felt != 0.0
        count = np.maximum(moved.sum(axis=1), 1)
        mean = np.sqrt((felt**2).sum(axis=1) / count)
        floors[:, members] = FLOOR * mean[:, None] * moved
    return floors


def family(channel: Channel) -> str:
    """Channels whose errors have to do with each other: motions; stresses; forces; ..."""
    return "motion" if reads_displacements(channel) else channel.dimension


def _families(channels: Sequence[Channel]) -> list[Ints]:
    """Numbers of the channels of each family."""
    names = [family(channel) for channel in channels]
    return [
        np.flatnonzero([other == name for other in names]).astype(np.int64)
        for name in dict.fromkeys(names)
    ]


def _correlations(channels: Sequence[Channel], length: float) -> tuple[Floats, Floats]:
    """Of m channels of one family: R of relative errors, and M of errors of their points (m, m).

    The kernel is exp(-distance / length) of two points, its mean over the points of two channels,
    normalised; half of it only as far as they move in one direction. M is what a field of
    displacements with that kernel, alike in all directions, makes of the motions of a channel; of
    other readings the kernel itself.
    """
    if family(channels[0]) != "motion":
        points = np.array([channel.second for channel in channels], dtype=np.float64)
        kernel = np.exp(-_distances(points) / length)
        kinds = [(channel.quantity, channel.kind) for channel in channels]
        same = np.array([[a == b for b in kinds] for a in kinds], dtype=np.float64)
        return kernel * (1.0 - ALIGNED + ALIGNED * same), kernel * same
    motions = [(k, *motion) for k, c in enumerate(channels) for motion in c.motions]
    owner = np.array([k for k, _, _ in motions])
    points, point = np.unique(
        np.array([place for _, place, _ in motions]), axis=0, return_inverse=True
    )
    vector = np.array([v for _, _, v in motions], dtype=np.float64)
    size = np.linalg.norm(vector, axis=1)
    unit = vector / np.where(size > 0.0, size, 1.0)[:, None]
    kernel = np.exp(-_distances(points) / length)
    shape = (len(channels), len(points))

    def together(weight: Floats) -> Floats:
        """Of two channels the sum of weight times kernel times weight over their points (m, m)."""
        spread = sp.csr_array((weight, (owner, point.ravel())), shape=shape)
        return np.asarray(spread @ kernel @ spread.T)

    axes = range(vector.shape[1])
    relative = (1.0 - ALIGNED) * together(np.ones(len(owner)))
    for p in axes:
        for q in axes:
            relative = relative + ALIGNED * together(unit[:, p] * unit[:, q])
    root = np.sqrt(np.diag(relative))
    between = np.sum([together(vector[:, p]) for p in axes], axis=0)
    return relative / np.outer(root, root), np.asarray(between)


def _distances(points: Floats) -> Floats:
    """(k, k) of points (k, dim), m."""
    return np.asarray(np.linalg.norm(points[:, None] - points[None], axis=2))


def correlation_length(case: Case, options: ModelErrorOptions) -> float:
    """Over how far the model error is correlated, m.

    Without other word the root mean square distance of the points of the gauges from their middle,
    which is about the size of what is excavated between them.
    """
    if options.length is not None:
        return options.length
    places = [
        place
        for channel in case.channels
        for place in (
            [point for point, _ in channel.motions]
            if reads_displacements(channel)
            else [channel.second]
        )
    ]
    points = np.array(places, dtype=np.float64)
    spread = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
    return max(spread, 1e-6)


def shared_columns(parts: Sequence[ReadingSteps], length: float) -> sp.csr_array:
    """Columns (g, K) of shared errors at eta = 1, for readings of several parts, one below another.

    Readings of one channel at one stage have one row, however many there are.

    Args:
        parts: the readings used, and later ones, maybe of another case.
        length: over which it is correlated, m.
    """
    states = tuple(dict.fromkeys(state for part in parts for state in part.states))
    steps, floors = (
        np.concatenate([_by_state(getattr(part, name), part.states, states) for part in parts])
        for name in ("steps", "floors")
    )
    channels: dict[Channel, int] = {}
    owner = np.array(
        [channels.setdefault(c, len(channels)) for part in parts for c in part.channels]
    )
    table = np.column_stack([owner, steps, floors])
    _, first, place = np.unique(table, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))  # places in the order in which they come
    first, place = np.sort(first), order[place.ravel()]
    steps, floors, owner = steps[first], floors[first], owner[first]
    whole = np.zeros((len(first), len(first)))
    known = tuple(channels)
    for members in _families(known):
        mine = np.flatnonzero(np.isin(owner, members))
        relative, between = _correlations([known[k] for k in members], length)
        number = np.searchsorted(members, owner[mine])
        at = np.ix_(number, number)
        found = _over_stages(steps[mine]) * relative[at] + _over_stages(floors[mine]) * between[at]
        whole[np.ix_(mine, mine)] = found
    return sp.csr_array(_root(whole)[place])


def _by_state(values: Floats, states: Sequence[str], wanted: Sequence[str]) -> Floats:
    """Columns of values (g, J) in the order of other names of states; 0 for those without."""
    found = np.zeros((len(values), len(wanted)))
    found[:, [wanted.index(state) for state in states]] = values
    return found


def _over_stages(steps: Floats) -> Floats:
    """(g, g) of steps (g, J): errors of one stage, and what is alike in all."""
    whole = steps.sum(axis=1)
    return (1.0 - PERSISTENT) * (steps @ steps.T) + PERSISTENT * np.outer(whole, whole)


def _root(matrix: Floats) -> Floats:
    """A root (k, r) of a semidefinite matrix (k, k): matrix = root root^T."""
    scale = np.sqrt(np.diag(matrix))
    here = np.flatnonzero(scale > 0.0)
    inner = matrix[np.ix_(here, here)] / np.outer(scale[here], scale[here])
    size, vectors = np.linalg.eigh(inner)
    kept = size > _NOTHING * size.max(initial=0.0)
    root = np.zeros((len(matrix), int(np.count_nonzero(kept))))
    root[here] = scale[here, None] * vectors[:, kept] * np.sqrt(size[kept])
    return root


_NOTHING = 1e-12
