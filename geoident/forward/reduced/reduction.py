"""Builds reduced models of one staged model, from the marches that were made of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.forward.gauges.observation import Observation
from geoident.forward.march.march import March, Run
from geoident.forward.reduced.affine_march import AffineMarch, affine_march
from geoident.forward.reduced.coverage import reduction_obstacle
from geoident.forward.reduced.duals import DualMarch, ReadingDuals
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.projection import GalerkinProjection
from geoident.forward.reduced.recorder import MOST_SECOND, Recorder
from geoident.forward.reduced.snapshots import Snapshot
from geoident.model.arrays import Floats

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
        snapshots: the marches that are kept.
        projection: what made the last model.
        number: of the next march in a search; None to count those that are kept.
        economical: as given.
        obstacle: why there is no reduced model, a clause, or None as far as is known.
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
        self.snapshots: list[Snapshot] = []
        self._affine: AffineMarch | None = None  # found when the first march is to be recorded
        self._second = False
        self._made: tuple[tuple[bytes, ...], ReducedModel | None] | None = None
        self.projection: GalerkinProjection | None = None
        self.number: int | None = None
        self.obstacle = reduction_obstacle(march)

    def _prepare(self) -> str | None:
        """Look at moduli and loads; why there is no reduced model, a clause, or None."""
        affine = self._affine = affine_march(self._march, self.last)
        if affine is None:
            return "its loads are no polynomials of degree two in the parameters"
        columns = 1 + len(affine.form.names)
        if self._entries(affine, columns) > MOST_ENTRIES:
            return "what a march leaves for it does not fit into the memory"
        # second derivatives need up to three times as much beside, and room for another march
        self._second = self._entries(affine, 4 * columns) <= MOST_ENTRIES
        largest = columns + MOST_SECOND if self._second else columns
        self.most = max(1, min(self.most, MOST_ENTRIES // self._entries(affine, largest)))
        return self._dear(affine) if self.economical else None

    def _entries(self, affine: AffineMarch, columns: int) -> int:
        """Numbers that a march leaves: motions, what is seen of them, and how ground settled."""
        points, n_dofs = affine.points, self._march.systems.discretization.n_dofs
        settled = points.n_strain * points.n_points if affine.form.loads.settles else 0
        seen = (self.last + 1) * len(self._observation.channels)
        return (self.last * n_dofs + seen + settled) * columns

    def _dear(self, affine: AffineMarch) -> str | None:
        """Why a reduced model would cost more than the marches that it saves; None if it does not.

        Counted are multiplications and additions: of a factorization by nested dissection, about
        60 n^1.5 in the plane and 20 n^2 in space; of the triangular factors of the columns of two
        marches, which are of long thin matrices and made anew with every march (`PROJECTED`).
        """
        march, n = self._march, len(affine.form.names)
        points, columns = march.systems.discretization.points, 3 * (1 + n)
        projecting = marching = 0.0
        for state in range(1, self.last + 1):
            unknowns = float(march.systems[state].pattern.lower.n)
            factor = 60.0 * unknowns**1.5 if points.n_strain < 6 else 20.0 * unknowns**2
            size = points.n_strain * points.n_points
            marching += factor + 150.0 * (1 + n) * size
            for zone in affine.zones[state]:
                terms = {(other, material) for other, material, _ in zone.parts if other}
                blocks = 1 + sum(affine.form.spans[material].rank for _, material in terms)
                rows = points.n_strain * len(zone.points)
                projecting += 2.0 * rows * (columns * blocks) ** 2
        if PROJECTED * projecting <= marching:
            return None
        return "for a mesh of this size it costs more than the marches that it saves"

    def covers(self) -> bool:
        """Whether there is nothing against it; loads and moduli are looked at once."""
        if self._affine is None and self.obstacle is None:
            self.obstacle = self._prepare()
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
        if not self.covers() or self._affine is None:
            return None
        number = len(self.snapshots) if self.number is None else self.number
        second = self._second and (number < _WITH_SECOND or not self.economical)
        return Recorder(self._affine, self._observation, p, second=second)

    def model(self, reference: Floats | None = None) -> ReducedModel | None:
        """The model of the marches so far.

        Args:
            reference: (n,) parameters whose moduli measure; None for those of the last march.
        """
        affine = self._affine
        if affine is None or self.obstacle is not None or not self.snapshots:
            return None
        reference = self.snapshots[-1].p if reference is None else reference
        key = (*(s.p.tobytes() for s in self.snapshots), reference.tobytes())
        if self._made is None or self._made[0] != key:
            self.projection = GalerkinProjection(affine, self.snapshots, reference)
            stages = self.projection.stages()
            model = None if stages is None else ReducedModel(affine.form, reference, stages)
            self._made = key, model
        return self._made[1]

    def duals(
        self, model: ReducedModel, run: Run, rows: sp.csr_array, weights: Floats
    ) -> ReadingDuals:
        """Adjoints of readings (g) at the reference of the model that was made last.

        Args:
            model: that one.
            run: a traced run there, all its states done.
            rows: G', (g, n_dofs).
            weights: (n_states, g) how often a reading counts the displacements of a state.
        """
        assert self.projection is not None
        return ReadingDuals(model, DualMarch(self.projection, run).stages(rows, weights))
