"""Builds reduced models of one staged model, from the marches that were made of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.affine import trial_points
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.march.march import March
from geoident.forward.reduced.coverage import reduction_obstacle
from geoident.forward.reduced.loads import load_form
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.moduli import MaterialSpan, span_of
from geoident.forward.reduced.projection import Projection
from geoident.forward.reduced.snapshots import Snapshot
from geoident.forward.reduced.zones import zones_of
from geoident.model.arrays import Floats

_DRAWS = 24
"""Parameter vectors at which moduli and loads are looked at, beside three for each parameter."""

MOST_ENTRIES = 250_000_000
"""Numbers that snapshots may keep: 2 GB."""


class Reduction:
    """The reduced models of a staged model.

    Args:
        march: of the case.
        last: the last state wanted.
        most: how many marches count at most, the newest.
    """

    def __init__(self, march: March, last: int, most: int = 4) -> None:
        self._march, self.last, self.most = march, last, most
        self._names = tuple(q.name for q in march.case.parameters)
        self.snapshots: list[Snapshot] = []
        self._made: tuple[tuple[bytes, ...], ReducedModel | None] = ((), None)
        self._prepared = False
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
            name: span_of(march.case.materials[name], self._names, samples, s)
            for name in materials
        }
        self._zones = zones_of(march.on_mesh)[: self.last + 1]
        return None

    def _samples(self) -> Floats:
        """Parameter vectors spread over the domain (b, n)."""
        march, parameters = self._march, self._march.case.parameters

        def admissible(values: dict[str, float]) -> bool:
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
        if sum(s.entries for s in self.snapshots) > MOST_ENTRIES:
            del self.snapshots[:-1]

    def model(self) -> ReducedModel | None:
        """The model of the marches so far; the moduli at the last of them measure."""
        if not self._prepared and self.obstacle is None:
            self._prepared, self.obstacle = True, self._prepare()
        if self.obstacle is not None or not self.snapshots:
            return None
        key = tuple(s.p.tobytes() for s in self.snapshots)
        if self._made[0] != key:
            reference = self.snapshots[-1].p
            made = Projection(
                self._march, self._zones, self._spans, self._loads, self.snapshots, reference
            ).stages()
            model = None
            if made is not None:
                model = ReducedModel(self._names, reference, self._spans, self._loads, made)
            self._made = key, model
        return self._made[1]
