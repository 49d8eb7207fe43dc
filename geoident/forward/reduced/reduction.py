"""Builds reduced models of one staged model, from the marches that were made of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp

from geoident.forward.gauges.observation import Observation
from geoident.forward.march.march import March, Run
from geoident.forward.reduced.affine_march import AffineMarch, affine_march
from geoident.forward.reduced.coverage import reduction_obstacle, releases
from geoident.forward.reduced.duals.basis import DualBasis
from geoident.forward.reduced.duals.march import DualMarch, ReadRows
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.moduli import Span, relative_eigenvalues
from geoident.forward.reduced.projection import GalerkinProjection
from geoident.forward.reduced.recorder import MOST_FURTHER, MOST_SECOND, Recorder
from geoident.forward.reduced.snapshots import Snapshot
from geoident.forward.reduced.zones import Zone, zones_of
from geoident.model.arrays import Floats, Ints

PROJECTED = 5.0
"""How much slower an operation of the projection is than one of a factorization, with repetitions.

Measured on `cases/cavern`: whole fits took a seventh longer with the reduced model than without.
"""

DEAR = "for a mesh of this size it costs more than the marches that it saves"

FAR = 0.5
"""Moduli further apart than this, see `_apart`, are a further place of adjoints."""

SAME = 0.01
"""Moduli as close as this need no derivatives of adjoints."""

MOST_PLACES = 3
"""Places of adjoints at most: each costs a march and its way back."""

MOST_DERIVATIVES = 6
"""Derivatives of adjoints at most."""

MOST_ENTRIES = 200_000_000
"""Numbers that snapshots may keep: 1.6 GB."""


class Reduction:
    """The reduced models of a staged model.

    Args:
        march: of the case.
        observation: its gauges.
        last: the last state wanted.
        most: how many marches count at most, the newest.
        economical: have none where it costs more than the marches that a search saves.

    Attributes:
        snapshots: the marches that are recorded, by the bytes of their parameters.
        projection: what made the last model.
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
        self.snapshots: dict[bytes, Snapshot] = {}
        self._affine: AffineMarch | None = None  # found when the first march is to be recorded
        self._second = False
        self._made: tuple[tuple[bytes, ...], ReducedModel | None] | None = None
        self._used: list[Snapshot] = []  # of which it was made
        self.projection: GalerkinProjection | None = None
        self.obstacle = reduction_obstacle(march)

    def _prepare(self) -> str | None:
        """Look at moduli and loads; why there is no reduced model, a clause, or None."""
        ground = zones_of(self._march.on_mesh)
        if self.economical and self._dear(ground, {}):
            return DEAR  # whatever the moduli are: they only add to it
        affine = self._affine = affine_march(self._march, ground, self.last, self._observation)
        if affine is None:
            return "its loads are no polynomials of low degree in the parameters"
        if affine.form.loads.settles and releases(self._march):
            return "stress is released in part that is not the one in situ: that is out of balance"
        columns = 1 + len(affine.form.names)
        if self._entries(affine, columns) > MOST_ENTRIES:
            return "what a march leaves for it does not fit into the memory"
        # second derivatives need up to three times as much beside, and room for another march
        self._second = self._entries(affine, 4 * columns) <= MOST_ENTRIES
        largest = columns + MOST_FURTHER if self._second else columns
        self.most = max(1, min(self.most, MOST_ENTRIES // self._entries(affine, largest)))
        ranks = {name: span.rank for name, span in affine.form.spans.items()}
        return DEAR if self.economical and self._dear(affine.zones, ranks) else None

    def _entries(self, affine: AffineMarch, columns: int) -> int:
        """Numbers that a march leaves: motions, what is seen of them, and how ground settled."""
        points, n_dofs = affine.points, self._march.systems.discretization.n_dofs
        settled = points.n_strain * points.n_points if affine.form.loads.settles else 0
        seen = (self.last + 1) * len(self._observation.channels)
        return (self.last * n_dofs + seen + settled) * columns

    def _dear(self, zones: Sequence[Sequence[Zone]], ranks: Mapping[str, int]) -> bool:
        """Whether a reduced model would cost more than the marches that it saves.

        Args:
            zones: of every state.
            ranks: matrices of which the moduli of each material are made; none are none.

        Counted are multiplications and additions: of a factorization by nested dissection, about
        60 n^1.5 in the plane and 20 n^2 in space; of the triangular factors of the columns of two
        marches, which are of long thin matrices and made anew with every march (`PROJECTED`).
        """
        march, n = self._march, len(self._march.case.parameters)
        points, columns = march.systems.discretization.points, 3 * (1 + n)
        projecting = marching = 0.0
        for state in range(1, self.last + 1):
            unknowns = float(march.systems[state].pattern.lower.n)
            factor = 60.0 * unknowns**1.5 if points.n_strain < 6 else 20.0 * unknowns**2
            size = points.n_strain * points.n_points
            marching += factor + 150.0 * (1 + n) * size
            for zone in zones[state]:
                terms = {(other, material) for other, material, _ in zone.parts if other}
                blocks = 1 + sum(ranks.get(material, 0) for _, material in terms)
                rows = points.n_strain * len(zone.points)
                projecting += 2.0 * rows * (columns * blocks) ** 2
        return PROJECTED * projecting > marching

    def covers(self) -> bool:
        """Whether there is nothing against it; loads and moduli are looked at once."""
        if self._affine is None and self.obstacle is None:
            self.obstacle = self._prepare()
        return self.obstacle is None

    def knows(self, p: Floats) -> bool:
        """Whether the march at p (n,) is recorded."""
        return p.tobytes() in self.snapshots

    def recorded(self) -> list[Floats]:
        """Parameters (n,) of the marches that are recorded, in their order."""
        return [snapshot.p for snapshot in self.snapshots.values()]

    def prefer(self, wanted: Sequence[Floats]) -> None:
        """Forget the marches at some parameter vectors (n,) last."""
        for p in wanted:
            if self.knows(p):
                self.snapshots[p.tobytes()] = self.snapshots.pop(p.tobytes())

    def add(self, snapshot: Snapshot) -> None:
        """A march that was made to the last state; older ones than count are forgotten."""
        if snapshot.last < self.last:
            return
        self.snapshots[snapshot.p.tobytes()] = snapshot
        while len(self.snapshots) > self.most:
            del self.snapshots[next(iter(self.snapshots))]

    def recorder(self, p: Floats) -> Recorder | None:
        """What records a march at p (n,); None where the case has no reduced model."""
        if not self.covers() or self._affine is None:
            return None
        # of a search the first march is to reach as far as its end: with third derivatives a fit of
        # `cases/tunnel-3d` takes 20 s, with second ones as long as without a surrogate, 30 s
        first = self.economical and not self.snapshots
        further = (MOST_FURTHER if first else MOST_SECOND) if self._second else 0
        return Recorder(self._affine, self._observation, p, further=further)

    def model(
        self, visited: Sequence[Floats], reference: Floats | None = None
    ) -> ReducedModel | None:
        """The model of some marches that are recorded.

        Args:
            visited: (n,) their parameters, in their order.
            reference: (n,) parameters whose moduli measure; None for those of the last march.
        """
        affine = self._affine
        if affine is None or self.obstacle is not None or not len(visited):
            return None
        reference = visited[-1] if reference is None else reference
        key = (*(p.tobytes() for p in visited), reference.tobytes())
        if self._made is None or self._made[0] != key:
            self._used = [self.snapshots[p.tobytes()] for p in visited]
            self.projection = GalerkinProjection(affine, self._used, reference)
            stages = self.projection.stages()
            model = None if stages is None else ReducedModel(affine.form, reference, stages)
            self._made = key, model
        return self._made[1]

    def dual_places(self, model: ReducedModel) -> list[Floats]:
        """Where adjoints of readings are to be known (n,): at the reference, and far from it.

        The marches are where the model will be asked, or around; one at which the adjoints of the
        places before are `FAR` from those there is a further place.
        """
        places, spans = [model.reference], model.form.spans
        while len(places) < MOST_PLACES:
            far = [min(_apart(spans, s.p, p) for p in places) for s in self._used]
            if max(far) <= FAR:
                break
            places.append(self._used[int(np.argmax(far))].p)
        return places

    def dual_derivatives(self, model: ReducedModel) -> list[int]:
        """Parameters by which adjoints are differentiated: those that move moduli.

        None where the marches have the same moduli, up to a factor that all have in common.
        """
        spans = model.form.spans
        if all(_apart(spans, s.p, model.reference) <= SAME for s in self._used):
            return []
        slopes = [span.coordinates(model.reference[None])[1][0] for span in spans.values()]
        moves = np.any([np.any(slope, axis=0) for slope in slopes], axis=0)
        return [int(h) for h in np.flatnonzero(moves)[:MOST_DERIVATIVES]]

    def dual_basis(self, run: Run, place: Floats, by: Sequence[int], reads: ReadRows) -> DualBasis:
        """Adjoints of readings (g) at a parameter vector, for the model that was made last.

        Args:
            run: a traced run there, all its states done.
            place: (n,) the parameter vector.
            by: parameters by which they are differentiated.
            reads: what they see.
        """
        assert self.projection is not None
        return DualMarch(self.projection, run, place, by).basis(reads)

    def reads(self, rows: Ints, weights: Floats) -> list[ReadRows]:
        """What readings (g) see, those of displacements and those of stresses apart.

        Args:
            rows: (g,) their channels.
            weights: (n_states, g) how often they count what is seen of a state.
        """
        assert self._affine is not None
        stresses, n_dofs = self._affine.rows, self._march.systems.discretization.n_dofs
        place = stresses.of(rows)
        moved, pressed = np.flatnonzero(place < 0), np.flatnonzero(place >= 0)
        found = []
        if len(moved) or not len(rows):
            operator = self._observation.operator(rows[moved])
            found.append(ReadRows(moved, operator, weights[:, moved]))
        if len(pressed):
            nothing = sp.csr_array((len(pressed), n_dofs))
            seen = stresses.weights[place[pressed]]
            found.append(ReadRows(pressed, nothing, weights[:, pressed], seen))
        return found


def _apart(spans: Mapping[str, Span], one: Floats, other: Floats) -> float:
    """How far the moduli at two parameter vectors (n,) are apart, a common factor aside.

    The largest of |1 - tau mu| / sqrt(mu) over the eigenvalues mu of one against the other, with
    the best factor tau: 0 for the same, 1 where they are about four to one.
    """
    found = []
    for span in spans.values():
        if span.fixed is not None:
            found.append(np.ones(1))
            continue
        matrices = span.matrix(span.coordinates(np.stack([one, other]))[0])
        found.append(relative_eigenvalues(matrices[:1], matrices[1])[0])
    mu = np.concatenate(found)
    tau = 2.0 / (mu.min() + mu.max())
    return float(np.max(np.abs(1.0 - tau * mu) / np.sqrt(tau * mu)))
