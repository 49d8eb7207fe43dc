"""Builds reduced models of one staged model, from the marches that were made of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sp

from geoident.forward.affine import trial_points
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.observation import Observation
from geoident.forward.march.march import March, Run
from geoident.forward.reduced.coverage import reduction_obstacle
from geoident.forward.reduced.duals import DualMarch, ReadingDuals
from geoident.forward.reduced.loads import load_form
from geoident.forward.reduced.model import ReducedModel, ReducedStates
from geoident.forward.reduced.moduli import MaterialSpan, span_of
from geoident.forward.reduced.projection import GalerkinProjection, parts_of
from geoident.forward.reduced.recorder import MOST_SECOND, Recorder
from geoident.forward.reduced.snapshots import Snapshot
from geoident.forward.reduced.zones import Zone, zones_of
from geoident.model.arrays import Floats
from geoident.model.parameter import Values

_DRAWS = 24
"""Parameter vectors at which moduli and loads are looked at, beside three for each parameter."""

_WITH_SECOND = 2
"""Marches that are recorded with second derivatives: a search seldom leaps from a third."""

PROJECTED = 5.0
"""How much slower an operation of the projection is than one of a factorization, with repetitions.

Measured on `cases/cavern`: whole fits took a seventh longer with the reduced model than without.
"""

MOST_ENTRIES = 200_000_000
"""Numbers that snapshots may keep: 1.6 GB."""


class Reduction:
    """The reduced models of a staged model.

    Args:
        march: of the case.
        observation: its gauges.
        last: the last state wanted.
        most: how many marches count at most, the newest.
        economical: have none where it costs more than the marches that a search saves, and second
            derivatives only in its first marches.

    Attributes:
        number: of the next march in a search; None to count those that are kept.
        economical: as given.
    """

    def __init__(
        self,
        march: March,
        observation: Observation,
        last: int,
        *,
        most: int = 4,
        economical: bool = True,
    ) -> None:
        self._march, self._observation = march, observation
        self.last, self.most, self.economical = last, most, economical
        self._names = tuple(q.name for q in march.case.parameters)
        self.snapshots: list[Snapshot] = []
        self._made: tuple[tuple[bytes, ...], ReducedModel | None] = ((), None)
        self._projection: GalerkinProjection | None = None
        self._prepared = self._second = False
        self.number: int | None = None
        self.obstacle = reduction_obstacle(march)

    def _prepare(self) -> str | None:
        march = self._march
        samples = self._samples()
        s = march.systems.discretization.points.n_strain
        loads = load_form(march, self._names, samples, self.last)
        if loads is None:
            return "its loads are no polynomials of degree two in the parameters"
        self._loads = loads
        materials = march.sequence.materials
        self._spans: dict[str, MaterialSpan] = {
            name: span_of(march.case.materials[name], self._names, samples, s) for name in materials
        }
        self._zones = zones_of(march.on_mesh)[: self.last + 1]
        columns = 1 + len(self._names)
        if self._entries(columns) > MOST_ENTRIES:
            return "what a march leaves for it does not fit into the memory"
        # second derivatives need up to three times as much beside, and room for another march
        self._second = self._entries(4 * columns) <= MOST_ENTRIES
        largest = columns + MOST_SECOND if self._second else columns
        self.most = max(1, min(self.most, MOST_ENTRIES // self._entries(largest)))
        return self._dear() if self.economical else None

    def _entries(self, columns: int) -> int:
        """Numbers that a march leaves: strains and stresses of all states."""
        points = self._march.systems.discretization.points
        states = self.last + int(self._loads.settles)
        return 2 * states * points.n_strain * points.n_points * columns

    def _dear(self) -> str | None:
        """Why a reduced model would cost more than the marches that it saves; None if it does not.

        Counted are multiplications and additions: of a factorization by nested dissection, about
        60 n^1.5 in the plane and 20 n^2 in space; of the triangular factors of the columns of two
        marches, which are of long thin matrices and made anew with every march (`PROJECTED`).
        """
        march, n = self._march, len(self._names)
        points, columns = march.systems.discretization.points, 3 * (1 + n)
        projecting = marching = 0.0
        for state in range(1, self.last + 1):
            unknowns = float(march.systems[state].pattern.lower.n)
            factor = 60.0 * unknowns**1.5 if points.n_strain < 6 else 20.0 * unknowns**2
            size = points.n_strain * points.n_points
            marching += factor + 150.0 * (1 + n) * size
            for zone in self._zones[state]:
                terms = {(other, material) for other, material, _ in parts_of(zone) if other}
                blocks = 1 + sum(self._spans[material].rank for _, material in terms)
                rows = points.n_strain * len(zone.points)
                projecting += 2.0 * rows * (columns * blocks) ** 2
        if PROJECTED * projecting <= marching:
            return None
        return "for a mesh of this size it costs more than the marches that it saves"

    def _samples(self) -> Floats:
        """Parameter vectors spread over the domain (b, n)."""
        march, parameters = self._march, self._march.case.parameters

        def admissible(values: Values) -> bool:
            return inadmissible_numbers(march.case, march.sequence, values) is None

        points = trial_points(parameters, admissible)
        corners = np.array([[point.values[name] for name in self._names] for point in points])
        start = np.array([q.start for q in parameters])
        random, found = np.random.default_rng(0), [*corners]
        low, high = corners.min(axis=0), corners.max(axis=0)
        while len(found) < _DRAWS + 3 * len(start):
            p = low + (high - low) * random.random(len(start))
            for _ in range(20):
                if admissible(dict(zip(self._names, map(float, p), strict=True))):
                    break
                p = 0.5 * (p + start)
            found.append(p)
        return np.array(found)

    def covers(self) -> bool:
        """Whether there is nothing against it; loads and moduli are looked at once."""
        if not self._prepared and self.obstacle is None:
            self._prepared, self.obstacle = True, self._prepare()
        return self.obstacle is None

    def knows(self, p: Floats) -> bool:
        """Whether the march at p (n,) is kept."""
        return any(np.array_equal(s.p, p) for s in self.snapshots)

    def order(self, wanted: Sequence[Floats]) -> None:
        """Keep the marches at some parameter vectors (n,) only, in that order."""
        places = {p.tobytes(): n for n, p in enumerate(wanted)}
        kept = [s for s in self.snapshots if s.p.tobytes() in places]
        self.snapshots = sorted(kept, key=lambda s: places[s.p.tobytes()])

    def add(self, snapshot: Snapshot) -> None:
        """A march that was made to the last state; older ones than count are forgotten."""
        if snapshot.last < self.last or self.knows(snapshot.p):
            return
        self.snapshots = [*self.snapshots, snapshot][-self.most :]

    def recorder(self, p: Floats) -> Recorder | None:
        """What records a march at p (n,); None where the case has no reduced model."""
        if not self.covers():
            return None
        parts = self._zones, self._spans, self._loads
        number = len(self.snapshots) if self.number is None else self.number
        second = number < _WITH_SECOND or not self.economical
        second = second and self._second
        return Recorder(self._march, self._observation, *parts, p, second=second)

    def model(self, reference: Floats | None = None) -> ReducedModel | None:
        """The model of the marches so far.

        Args:
            reference: (n,) parameters whose moduli measure; None for those of the last march.
        """
        if self.obstacle is not None or not self.snapshots:
            return None
        reference = self.snapshots[-1].p if reference is None else reference
        key = (*(s.p.tobytes() for s in self.snapshots), reference.tobytes())
        if self._made[0] != key:
            parts = self._zones, self._spans, self._loads
            self._projection = GalerkinProjection(self._march, *parts, self.snapshots, reference)
            made = self._projection.stages()
            model = None
            if made is not None:
                model = ReducedModel(self._names, reference, self._spans, self._loads, made)
            self._made = key, model
        return self._made[1]

    def duals(self, run: Run, rows: sp.csr_array, weights: Floats) -> ReadingDuals:
        """Adjoints of readings (g) at the reference of the model.

        Args:
            run: a traced run there, all its states done.
            rows: G', (g, n_dofs).
            weights: (n_states, g) how often a reading counts the displacements of a state.
        """
        model = self._made[1]
        assert model is not None
        assert self._projection is not None
        parts = self._zones, self._spans, self._loads
        back = DualMarch(self._march, *parts, self.snapshots, self._projection, run)
        return ReadingDuals(model, back.stages(rows, weights))

    def stresses(
        self, model: ReducedModel, found: ReducedStates, state: int
    ) -> Iterator[tuple[Zone, Floats]]:
        """Zones of a state with their stress (s, q) at the first of the parameter vectors, Pa.

        Args:
            model: the one that was made last.
            found: its states.
            state: which.
        """
        assert self._projection is not None
        at, turn = found.at, self._projection.turn
        for zone in self._zones[state]:
            mine = zone.points
            stress = np.zeros((self._loads.stress.shape[0], len(mine)))
            if zone.history.virgin is not None:
                stress += self._loads.stress[:, mine] @ at.loads[0]
            for other, material, sign in parts_of(zone):
                if other not in turn:
                    continue
                coordinates = turn[other] @ found.states[other][0, :, 0]
                raw = np.concatenate([s.strain[other][:, mine] for s in self.snapshots], axis=-1)
                E = model.spans[material].matrix(at.moduli[material][0])
                stress += sign * (E @ (raw @ coordinates))
            yield zone, stress
