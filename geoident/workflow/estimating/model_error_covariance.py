"""The error of the model as errors that readings share (theory 9).

What a stage adds to a computed reading may be wrong by a part eta of itself, alike where gauges are
near to each other, and three quarters of it alike in all stages:

    C = eta^2 [ (1 - t) sum_j (D_j R D_j + F_j M F_j) + t (sum_j D_j) R (sum_j D_j) + ... ]

D_j are the signed steps, so nothing depends on which direction counts as positive. R is the
correlation of relative errors. F_j M F_j is an error that a reading has however little it changes:
of a field of displacements as large as a tenth of what the gauges feel, at the points of the gauge.

Where readings follow a process in time, an error is rather of the reading itself, and lasts:

    C = eta^2 (D R D + F M F) x exp(-|tau - tau'|) ,      tau = log(1 + t / T) ,

D and F the sums over all steps since the zero, t the time since then. Behind a tunnel face the
course in time may be wrong as well, alike in all channels: R + course^2 in place of R.

An error is known by its rows: the steps of each reading and where its gauge is. Rows of the
readings used and of later ones together give the columns of shared errors (theory 7), in which
both are one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular

from geoident.forward.gauges.kinds import reads_displacements
from geoident.forward.observed import ObservedModel
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel
from geoident.model.methods import ModelErrorOptions
from geoident.model.settlement import SettlementLaw
from geoident.model.structures import Bars

PERSISTENT = 0.75
"""Part t of the variance of a relative error that is the same in all stages."""

ALIGNED = 0.5
"""Part of the correlation that motions in one direction share, and those across do not."""

FLOOR = 0.1
"""Error of a reading that hardly changes, in parts of that of the others."""

NOWHERE = 0.5
"""Correlation of the relative errors of two channels of which the case does not say where they are.
"""

_IN_THE_END = 10.0
"""When all water has drained, in parts of the time that has dates: it counts by its logarithm."""

TIMES = 3.0
"""How often the correlation time goes into the time of the readings, without other word."""


@dataclass(frozen=True)
class CorrelationTime:
    """Over how long the model error is correlated.

    Args:
        size: in this unit.
        unit: ``s``, or ``stages`` where these have no dates.
    """

    size: float
    unit: str = "s"


@dataclass(frozen=True)
class ReadingSteps:
    """What the model error of g readings is made of.

    Args:
        channels: of each reading.
        states: names of the J states.
        steps: (g, J) what each step adds to each computed reading, SI.
        floors: (g, J) the error at eta = 1 that a reading has of a step in any case, SI.
        moments: (g,) log(1 + t / T) of the time of each reading since its zero; None where the
            errors are those of the steps, whatever time they take.
    """

    channels: tuple[Channel, ...]
    states: tuple[str, ...]
    steps: Floats
    floors: Floats
    moments: Floats | None = None

    def any(self) -> bool:
        """Whether any reading has a model error."""
        return bool(np.any(self.steps))


def reading_steps(
    case: Case,
    model: ObservedModel,
    increments: Floats,
    pairs: Sequence[tuple[str, str]],
    length: float,
    time: CorrelationTime | None = None,
) -> ReadingSteps:
    """What the model error of some readings is made of.

    Args:
        case: of the model.
        model: tells which steps make a reading.
        increments: (n_states, n_channels) what each step changes in what the channels see, SI.
        pairs: channel and stage of each of the g readings.
        length: over which it is correlated, m.
        time: over which it is, or None; see `correlation_time`.
    """
    computed = np.where(_prescribed(case), 0.0, increments)
    number = {channel.name: k for k, channel in enumerate(case.channels)}
    rows = np.array([number[channel] for channel, _ in pairs], dtype=np.int64)
    weight = model.steps(pairs)
    floors = _floors(case.channels, computed, length)
    return ReadingSteps(
        tuple(case.channels[k] for k in rows.tolist()),
        case.stage_names,
        (weight * computed[:, rows]).T,
        (weight * floors[:, rows]).T,
        None if time is None else np.log1p(_elapsed(case, pairs) / time.size),
    )


def _prescribed(case: Case) -> Bools:
    """(n_states, n_channels) what the case gives, so that no model can be wrong there.

    The force to which a jack brings a bar; the pressure of water, which is a table; temperatures,
    in which the stiffness of the ground has no part.
    """
    prescribed = np.zeros((len(case.stages) + 1, len(case.channels)), dtype=np.bool_)
    if case.elsewhere is not None:  # all of which is computed
        return prescribed
    for k, channel in enumerate(case.channels):
        if channel.kind in ("piezometer", "thermometer"):
            prescribed[:, k] = True
        bars = case.structures.get(channel.structure)
        if channel.kind != "load-cell" or not isinstance(bars, Bars):
            continue
        for j, stage in enumerate(case.stages, start=1):
            locked = channel.structure in stage.prestress
            built = channel.structure in stage.build and bars.prestress is not None
            prescribed[j, k] = locked or built
    return prescribed


def _floors(channels: Sequence[Channel], increments: Floats, length: float) -> Floats:
    """(n_states, n_channels) error at eta = 1 of a channel that a step hardly moves, SI.

    In each step a tenth of the root mean square of what the gauges of one family feel, each in
    proportion to the difference that a field of errors would make between its points.
    """
    floors = np.zeros_like(increments)
    for members in _families(channels):
        size = _Kernel([channels[k] for k in members], length).size
        steps = increments[:, members]
        felt = np.divide(steps, size, out=np.zeros_like(steps), where=size > 0.0)
        moved = felt != 0.0
        count = np.maximum(moved.sum(axis=1), 1)
        mean = np.sqrt((felt**2).sum(axis=1) / count)
        floors[:, members] = FLOOR * mean[:, None] * moved
    return floors


def family(channel: Channel) -> str:
    """Channels whose errors have to do with each other: motions; stresses; forces; ..."""
    return "motion" if channel.second and reads_displacements(channel) else channel.dimension


def _families(channels: Sequence[Channel]) -> list[Ints]:
    """Numbers of the channels of each family."""
    names = np.array([family(channel) for channel in channels])
    return [np.flatnonzero(names == name) for name in dict.fromkeys(names.tolist())]


class _Kernel:
    """Of channels of one family: R of relative errors, and M of errors of their points.

    The kernel is exp(-distance / length) of two points, its mean over the points of two channels,
    normalised; half of it only as far as they move in one direction. M is what a field of
    displacements with that kernel, alike in all directions, makes of the motions of a channel; of
    other readings the kernel itself. Where the case does not say of all channels where they are,
    two of them have the same correlation, whichever they are. Of n channels only those parts are
    made that are asked for.

    Args:
        channels: of one family.
        length: over which the error is correlated, m.
    """

    def __init__(self, channels: Sequence[Channel], length: float) -> None:
        self._length = length
        self._motions = family(channels[0]) == "motion"
        self._somewhere = all(channel.second for channel in channels)
        if not self._somewhere:
            self._whole: tuple[Floats, Floats] | None = None
            self._root = self.size = np.ones(len(channels))
            return
        if self._motions:
            motions = [(k, *motion) for k, c in enumerate(channels) for motion in c.motions]
            owner = np.array([k for k, _, _ in motions])
            self._points, point = np.unique(
                np.array([place for _, place, _ in motions]), axis=0, return_inverse=True
            )
            vector = np.array([v for _, _, v in motions], dtype=np.float64)
            size = np.linalg.norm(vector, axis=1)
            unit = vector / np.where(size > 0.0, size, 1.0)[:, None]
            axes = range(vector.shape[1])
            shape = (len(channels), len(self._points))

            def spread(weight: Floats) -> sp.csr_array:
                return sp.csr_array((weight, (owner, point.ravel())), shape=shape)

            self._between = [spread(vector[:, p]) for p in axes if vector[:, p].any()]
            pairs = [unit[:, p] * unit[:, q] for p in axes for q in axes]
            aligned = [ALIGNED**0.5 * spread(pair) for pair in pairs if pair.any()]
            self._relative = [(1.0 - ALIGNED) ** 0.5 * spread(np.ones(len(owner))), *aligned]
        else:
            self._points = np.array([channel.second for channel in channels], dtype=np.float64)
            kinds: dict[tuple[str, str], int] = {}
            kind = [kinds.setdefault((c.quantity, c.kind), len(kinds)) for c in channels]
            self._kind = np.array(kind)
        parts = [
            np.arange(k, min(k + _TOGETHER, len(channels)))
            for k in range(0, len(channels), _TOGETHER)
        ]
        blocks = [self._plain(part, part) for part in parts]
        squares = [[np.diag(each) for each in block] for block in blocks]
        relative, between = (np.concatenate(each) for each in zip(*squares, strict=True))
        self._whole = blocks[0] if len(blocks) == 1 else None  # of few channels
        self._root = np.sqrt(relative)
        self.size = np.sqrt(np.maximum(between, 0.0))

    def parts(self, one: Ints, other: Ints) -> tuple[Floats, Floats]:
        """Of R and M those (m, n) of some channels (m,) with others (n,)."""
        if self._whole is None:
            relative, between = self._plain(one, other)
        else:
            relative, between = (each[np.ix_(one, other)] for each in self._whole)
        return relative / np.outer(self._root[one], self._root[other]), between

    def _plain(self, one: Ints, other: Ints) -> tuple[Floats, Floats]:
        """The same, R not normalised."""
        if not self._somewhere:
            alike = np.where(one[:, None] == other, 1.0, NOWHERE)
            return alike, alike
        if not self._motions:
            kernel = self._kernel(self._points[one], self._points[other])
            same = self._kind[one][:, None] == self._kind[other]
            return kernel * (1.0 - ALIGNED + ALIGNED * same), kernel * same
        lines, near = (np.unique(self._between_points(rows)) for rows in (one, other))
        kernel = self._kernel(self._points[lines], self._points[near])

        def together(spreads: Sequence[sp.csr_array]) -> Floats:
            """Sums of weight times kernel times weight over the points of two channels (m, n)."""
            total = np.zeros((len(one), len(other)))
            for spread in spreads:
                left, right = spread[one][:, lines], spread[other][:, near]
                total += left @ np.asarray((right @ kernel.T).T)
            return total

        return together(self._relative), together(self._between)

    def _between_points(self, channels: Ints) -> Ints:
        """Numbers of the points of some channels."""
        return np.asarray(self._relative[0][channels].indices)

    def _kernel(self, points: Floats, others: Floats) -> Floats:
        """(m, n) of points (m, dim) and others (n, dim), m."""
        square = sum(
            (one[:, None] - other) ** 2 for one, other in zip(points.T, others.T, strict=True)
        )
        return np.asarray(np.exp(np.sqrt(square) / -self._length))


_TOGETHER = 256
"""Channels of which the kernel is made at once where each is looked at by itself."""


def correlation_length(case: Case, options: ModelErrorOptions) -> float:
    """Over how far the model error is correlated, m; NaN where no gauge has a place.

    Without other word the root mean square distance of the points of the gauges from their middle,
    which is about the size of what is excavated between them.
    """
    channels = [channel for channel in case.channels if channel.second]
    if not channels:
        return math.nan
    if options.length is not None:
        return options.length
    places = [
        place
        for channel in channels
        for place in (
            [point for point, _ in channel.motions]
            if reads_displacements(channel)
            else [channel.second]
        )
    ]
    points = np.array(places, dtype=np.float64)
    spread = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
    return max(spread, 1e-6)


def correlation_time(
    case: Case, options: ModelErrorOptions, pairs: Sequence[tuple[str, str]]
) -> CorrelationTime | None:
    """Over how long the model error is correlated; None where steps have errors of their own.

    Without other word the latter holds for the steps of construction that a model of the ground
    analyses. Other models say what is read from time to time, each as a whole: then it is a third
    of the time of the readings. So it is behind a tunnel face, where stages are one motion at
    several times, and where stages last.

    Args:
        case: of the model.
        options: what it says of the model error.
        pairs: channel and stage of each reading that is used.
    """
    if options.time is not None:
        return CorrelationTime(options.time)
    goes_on = any(stage.lasts for stage in case.stages)  # more than no time
    if case.elsewhere is None and case.face is None and not goes_on:
        return None
    span = float(_elapsed(case, pairs).max(initial=1e-6))
    return CorrelationTime(span / TIMES, "s" if has_dates(case) else "stages")


def _elapsed(case: Case, pairs: Sequence[tuple[str, str]]) -> Floats:
    """(g,) time from the zero of each reading to its stage: seconds, or stages without dates."""
    names, clock = case.stage_names, stage_clock(case)
    zero = {channel.name: clock[case.zero_of(channel)] for channel in case.channels}
    state = dict(zip(names, clock.tolist(), strict=True))
    since = [state[stage] - zero[channel] for channel, stage in pairs]
    return np.maximum(np.array(since, dtype=np.float64), 0.0)


def stage_clock(case: Case) -> Floats:
    """(n_states,) when each state is, s; their numbers where not all of them have dates."""
    names = case.stage_names
    if not has_dates(case):
        return np.arange(len(names), dtype=np.float64)
    known = [case.times[name] for name in names[1:] if name in case.times]
    begin = case.times.get(names[0], min(known))
    end = begin + _IN_THE_END * (max(known) - begin)
    return np.array([begin, *(case.times.get(name, end) for name in names[1:])])


def errs_in_common(case: Case) -> bool:
    """Whether the course in time may be wrong alike in all channels.

    Behind a tunnel face another profile does that, on a fill another curve than that of the law:
    what is wrong with it at one plate is so at the next.
    """
    several = isinstance(case.elsewhere, SettlementLaw) and len(case.channels) > 1
    return case.face is not None or several


def has_dates(case: Case) -> bool:
    """Whether dates, or durations, say when all stages are.

    A stage without duration beside stages that last is the end of all flow: it has no date.
    """
    timed = [stage for stage in case.stages if stage.lasts is not None or not case.lasts]
    return all(stage.name in case.times for stage in timed)


@dataclass
class ErrorModes:
    """What the columns of a model error were made after, and what they leave out.

    The next columns are made after the same rows: so what is left out, where there are many
    readings, changes as little as the readings do.

    Args:
        rows: numbers of the pivots.
        left: (g,) own standard deviation that each reading takes at eta = 1 for what the columns
            leave out, SI; zeros unless there are more readings than `MOST_MODES`. What is left out
            is alike in the readings around a pivot, so that their mean must keep it.
    """

    rows: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    left: Floats = field(default_factory=lambda: np.zeros(0))


def shared_columns(
    parts: Sequence[ReadingSteps],
    length: float,
    modes: ErrorModes | None = None,
    *,
    course: float = 0.0,
) -> sp.csr_array:
    """Columns (g, K) of shared errors at eta = 1, for readings of several parts, one below another.

    Readings of one channel at one stage have one row, however many there are.

    Args:
        parts: the readings used, and later ones, maybe of another case.
        length: over which it is correlated, m.
        modes: of columns made before for the same readings at other parameters; it is told those
            of these.
        course: error of the course in time that all channels share, in parts of eta.
    """
    states = tuple(dict.fromkeys(state for part in parts for state in part.states))
    steps, floors = (
        np.concatenate([_by_state(getattr(part, name), part.states, states) for part in parts])
        for name in ("steps", "floors")
    )
    in_time = [part.moments for part in parts if part.moments is not None]
    moments = np.concatenate(in_time) if in_time else None
    if moments is not None:  # each reading as a whole
        steps, floors = (each.sum(axis=1, keepdims=True) for each in (steps, floors))
    channels: dict[Channel, int] = {}
    alike: dict[int, int] = {}  # to compare channels takes long where there are many
    every = [c for part in parts for c in part.channels]
    for channel in {id(c): c for c in every}.values():
        alike[id(channel)] = channels.setdefault(channel, len(channels))
    owner = np.array([alike[id(c)] for c in every], dtype=np.int64)
    table = np.column_stack([owner, steps, floors, *([] if moments is None else [moments])])
    _, first, place = np.unique(table, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))  # places in the order in which they come
    first, place = np.sort(first), order[place.ravel()]
    steps, floors, owner = steps[first], floors[first], owner[first]
    moments = None if moments is None else moments[first]
    known = tuple(channels)
    kernels = list[_Kernel]()
    number, kind = np.zeros((2, len(known)), dtype=np.int64)
    for members in _families(known):
        number[members], kind[members] = np.arange(len(members)), len(kernels)
        kernels.append(_Kernel([known[k] for k in members], length))
    number, kind = number[owner], kind[owner]

    def part(one: Ints, other: Ints) -> Floats:
        """The covariance (m, n) of some rows (m,) with others (n,)."""
        covariance = np.zeros((len(one), len(other)))
        for k, kernel in enumerate(kernels):
            rows_a, rows_b = (np.flatnonzero(kind[rows] == k) for rows in (one, other))
            a, b = one[rows_a], other[rows_b]
            (channels_a, at_a), (channels_b, at_b) = (
                np.unique(number[rows], return_inverse=True) for rows in (a, b)
            )
            relative, between = kernel.parts(channels_a, channels_b)
            at = np.ix_(at_a, at_b)
            of_rows = (
                _over_stages(steps[a], steps[b]) * (relative[at] + course**2)
                + _over_stages(floors[a], floors[b]) * between[at]
            )
            if moments is not None:
                of_rows *= np.exp(-np.abs(moments[a][:, None] - moments[b]))
            covariance[np.ix_(rows_a, rows_b)] = of_rows
        return covariance

    size = np.array([kernels[f].size[n] for f, n in zip(kind, number, strict=True)])
    diagonal = (1.0 + course**2) * _own(steps) + _own(floors) * size**2
    accuracy = np.array([known[k].accuracy for k in owner])
    modes = modes or ErrorModes()
    root = _root(part, diagonal, accuracy, modes)
    modes.left = modes.left[place] * np.sqrt(len(place) / max(1, root.shape[1]))
    return _as_sparse(root if len(place) == len(root) else root[place])


def columns_of_motions(channels: Sequence[Channel], motions: Floats, length: float) -> Floats:
    """(n, r) columns of shared errors at eta = 1 of whole motions (n,) of channels, SI.

    Args:
        channels: of the motions.
        motions: with their signs.
        length: over which the error is correlated, m.
    """
    floors = _floors(channels, motions[None], length)
    part = ReadingSteps(tuple(channels), ("motion",), motions[:, None], floors.T)
    return shared_columns([part], length).toarray()


def _as_sparse(dense: Floats) -> sp.csr_array:
    """A matrix (m, n) most of which is not zero."""
    m, n = dense.shape
    column = np.tile(np.arange(n, dtype=np.int32), m)
    begin = np.arange(0, m * n + 1, max(n, 1)) if n else np.zeros(m + 1, dtype=np.int64)
    return sp.csr_array((dense.ravel(), column, begin), shape=dense.shape)


def _by_state(values: Floats, states: Sequence[str], wanted: Sequence[str]) -> Floats:
    """Columns of values (g, J) in the order of other names of states; 0 for those without."""
    columns = np.zeros((len(values), len(wanted)))
    columns[:, [wanted.index(state) for state in states]] = values
    return columns


def _own(steps: Floats) -> Floats:
    """(m,) the diagonal of `_over_stages`."""
    alike = steps.sum(axis=1) ** 2
    return np.asarray((1.0 - PERSISTENT) * np.sum(steps**2, axis=1) + PERSISTENT * alike)


def _over_stages(steps: Floats, others: Floats) -> Floats:
    """(m, n) of steps (m, J) and others (n, J): errors of one stage, and what is alike in all."""
    alike = np.outer(steps.sum(axis=1), others.sum(axis=1))
    return (1.0 - PERSISTENT) * (steps @ others.T) + PERSISTENT * alike


MOST_MODES = 800
"""Columns of the model error at most; so many distinct readings have it as theory says."""

MOST_ENTRIES = 16_000_000
"""Of all columns together (200 MB): of more readings than 20,000 there are fewer columns."""


def most_modes(readings: int) -> int:
    """How many columns the model error of so many readings has at most."""
    return max(1, min(readings, MOST_MODES, MOST_ENTRIES // max(readings, 1)))


def _root(
    part: Callable[[Ints, Ints], Floats], diagonal: Floats, accuracy: Floats, kept: ErrorModes
) -> Floats:
    """A root (k, r) of a semidefinite matrix (k, k): matrix = root root^T.

    Cholesky's, with pivots where what is left is largest beside the accuracy, up to as many as
    `most_modes` allows: of more readings what is left then is far below their accuracy, since the
    error is alike where gauges are near to each other. Pivots are taken some at a time, from those
    with at least half as much left as the largest has.

    Args:
        part: the matrix (m, n) of some rows (m,) and columns (n,).
        diagonal: (k,) of it.
        accuracy: (k,) standard deviations beside which it counts.
        kept: has the pivots that are taken, and then those that were.
    """
    k, most = len(diagonal), most_modes(len(diagonal))
    root, taken = np.zeros((k, most)), np.zeros(0, dtype=np.int64)
    left, least = diagonal.copy(), _NOTHING * diagonal
    known = kept.rows if most < k else taken  # of all rows any order says the same
    while (r := len(taken)) < most:
        weight = np.where(left > least, left / accuracy**2, 0.0)
        pool = known[r : r + _BLOCK] if r < len(known) else _candidates(weight)
        pool = pool[weight[pool] > 0.0]
        if not len(pool):
            if not len(known):
                break
            known = known[:0]  # what is left is told of by others now
            continue
        inner = part(pool, pool) - root[pool, :r] @ root[pool, :r].T
        chosen = _pivots(inner, least[pool], accuracy[pool], most - r, all_of=r < len(known))
        pivots = pool[chosen]
        L = np.linalg.cholesky(inner[np.ix_(chosen, chosen)])
        new = slice(r, r + len(pivots))
        for rows in np.array_split(np.arange(k), -(-k // _ROWS)):
            columns = part(rows, pivots) - root[rows, :r] @ root[pivots, :r].T
            root[rows, new] = solve_triangular(L, columns.T, lower=True).T
        left -= np.sum(root[:, new] ** 2, axis=1)
        left[pivots] = 0.0
        taken = np.concatenate([taken, pivots])
    kept.rows, kept.left = taken, np.sqrt(np.where(left > least, left, 0.0))
    return root[:, : len(taken)]


def _candidates(weight: Floats) -> Ints:
    """Rows (m,) of which pivots may be taken: those of the largest weights, and some of the others.

    Args:
        weight: (k,) what is left of each row beside its accuracy; 0 for nothing.
    """
    order = np.argsort(-weight, kind="stable")
    order = order[: np.count_nonzero(weight > 0.5 * weight[order[0]])]
    others = order[_FIRST:]
    return np.concatenate([order[:_FIRST], others[:: max(1, -(-len(others) // _POOL))]])


def _pivots(inner: Floats, least: Floats, accuracy: Floats, most: int, *, all_of: bool) -> Ints:
    """Pivots (p,) of a matrix (m, m), each where most is left, down to half of the first or all."""
    left, root, chosen = np.diag(inner).copy(), np.zeros((len(inner), 0)), list[int]()
    first = 0.0
    while len(chosen) < min(most, _BLOCK):
        weight = np.where(left > least, left / accuracy**2, 0.0)
        k = int(weight.argmax())
        first = max(first, float(weight[k]))
        if weight[k] <= (0.0 if all_of else 0.5 * first):
            break
        column = (inner[:, k] - root @ root[k]) / np.sqrt(left[k])
        root = np.column_stack([root, column])
        left -= column**2
        left[k] = 0.0
        chosen.append(k)
    return np.array(chosen, dtype=np.int64)


_FIRST, _POOL, _BLOCK, _ROWS = 100, 900, 128, 8192
"""Candidates with most left, further ones, pivots taken at a time, rows made at a time."""

_NOTHING = 1e-12
"""Part of the error of a reading below which nothing of it is left."""
