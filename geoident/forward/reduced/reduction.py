"""Whether a staged model has a reduced one, the analyses that are recorded for it, and the model.

Covered: elastic ground of every symmetry, with ratios and angles of its axes among the parameters;
excavation, installation, changes of material; walls, linings, bolts, struts and anchors, stressed
once at most; independent load cases; in-situ stress, weights, loads and water whose forces are
polynomials of low degree in the parameters; partial release of ground whose stress is the one in
situ, so that what is held is such a force too; readings that are motions, forces or stresses.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from geoident.forward.analysis.analysis import KnownDisplacements, StagedAnalysis
from geoident.forward.gauges.observation import PlacedGauges
from geoident.forward.reduced.affine_analysis import AffineAnalysis, affine_analysis
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.projection import GalerkinProjection
from geoident.forward.reduced.recorder import MOST_FURTHER, Recorder, Snapshot
from geoident.forward.reduced.zones import zones_of
from geoident.model.arrays import Floats
from geoident.model.response import CERTAIN

PROJECTED = 5.0
"""How much slower an operation of the projection is than one of a factorization, with repetitions.

Measured on `cases/cavern`: whole fits took a seventh longer with the reduced model than without.
"""

DEAR = "for a mesh of this size it costs more than the analyses that it saves"

MOST_ENTRIES = 200_000_000
"""Numbers that snapshots may keep: 1.6 GB."""


class Reduction:
    """The reduced models of a staged model.

    Args:
        analysis: of the case.
        gauges: those of the case, on its mesh.
        last: the last state wanted.
        most: how many analyses are kept at most, the newest.
        economical: have none where it costs more than the analyses that a search saves.

    Attributes:
        snapshots: the analyses that are recorded, by the bytes of their parameters.
        obstacle: why there is no reduced model, a clause, or None as far as is known.
    """

    def __init__(
        self,
        analysis: StagedAnalysis,
        gauges: PlacedGauges,
        last: int,
        *,
        most: int = 4,
        economical: bool = True,
    ) -> None:
        self._analysis, self._gauges = analysis, gauges
        self.last, self.most, self.economical = last, most, economical
        self.snapshots: dict[bytes, Snapshot] = {}
        self._affine: AffineAnalysis | None = None  # found when the first run is to be recorded
        self._further = 0
        self._made: tuple[tuple[bytes, ...], ReducedModel | None, GalerkinProjection] | None = None
        self.obstacle = reduction_obstacle(analysis)

    def _prepare(self) -> str | None:
        """Look at moduli and loads; why there is no reduced model, a clause, or None."""
        analysis, points = self._analysis, self._analysis.systems.discretization.points
        if self.economical and points.n_strain < 6:
            return DEAR  # factorizations in the plane are cheap
        affine = affine_analysis(analysis, zones_of(analysis.on_mesh), self.last, self._gauges)
        if affine is None:
            return "its loads are no polynomials of low degree in the parameters"
        settles = affine.form.loads.settles
        if settles and any(state.release for state in analysis.sequence.states):
            return "stress is released in part that is not the one in situ: that is out of balance"
        if self.economical and self._dear(affine):
            return DEAR
        # numbers that an analysis leaves by each column: motions, what is seen, how ground settled
        own = points.n_strain * points.n_points if settles else 0
        n_dofs, seen = analysis.systems.discretization.n_dofs, len(self._gauges.channels)
        each = self.last * n_dofs + (self.last + 1) * seen + own
        columns = 1 + len(affine.form.names)
        if each * columns > MOST_ENTRIES:
            return "what an analysis leaves for it does not fit into the memory"
        # further ones need as much again beside, while they are made
        further = MOST_FURTHER
        self._further = further if 2 * each * (columns + further) <= MOST_ENTRIES else 0
        self.most = max(1, min(self.most, MOST_ENTRIES // (each * (columns + self._further))))
        self._affine = affine
        return None

    def _dear(self, affine: AffineAnalysis) -> bool:
        """Whether a reduced model would cost more than the analyses that it saves, in space.

        Counted are multiplications and additions: of a factorization by nested dissection, about
        20 n^2; of the triangular factors of the columns of two analyses.
        """
        columns = 3 * (1 + len(affine.form.names))
        projecting = factorizing = 0.0
        for state in range(1, self.last + 1):
            factorizing += 20.0 * float(self._analysis.systems[state].pattern.lower.n) ** 2
            for zone in affine.zones[state]:
                terms = {(other, material) for other, material, _ in zone.parts if other}
                blocks = 1 + sum(len(affine.form.spans[material].basis) for _, material in terms)
                projecting += 12.0 * len(zone.points) * (columns * blocks) ** 2
        return PROJECTED * projecting > factorizing

    def knows(self, p: Floats) -> bool:
        """Whether the analysis at p (n,) is recorded."""
        return p.tobytes() in self.snapshots

    def recorded(self) -> list[Floats]:
        """Parameters (n,) of the analyses that are recorded, in their order."""
        return [snapshot.p for snapshot in self.snapshots.values()]

    def prefer(self, wanted: Sequence[Floats]) -> None:
        """Forget the analyses at some parameter vectors (n,) last."""
        for p in wanted:
            if self.knows(p):
                self.snapshots[p.tobytes()] = self.snapshots.pop(p.tobytes())

    def add(self, snapshot: Snapshot) -> None:
        """An analysis that went to the last state; older ones than count are forgotten."""
        if snapshot.last < self.last:
            return
        self.snapshots[snapshot.p.tobytes()] = snapshot
        while len(self.snapshots) > self.most:
            del self.snapshots[next(iter(self.snapshots))]

    def recorder(self, p: Floats) -> Recorder | None:
        """What records an analysis at p (n,); None where the case has no reduced model."""
        if self._affine is None and self.obstacle is None:  # moduli and loads are looked at once
            self.obstacle = self._prepare()
        if self._affine is None:
            return None
        # of a search the first analysis is to reach as far as its end
        further = 0 if self.economical and self.snapshots else self._further
        return Recorder(self._affine, self._gauges, p, further=further)

    def model(
        self, visited: Sequence[Floats], reference: Floats | None = None
    ) -> ReducedModel | None:
        """The model of some analyses that are recorded; None where these span not all loads.

        Args:
            visited: (n,) their parameters, in their order.
            reference: (n,) parameters whose moduli measure; None for those of the last.
        """
        affine = self._affine
        if affine is None or self.obstacle is not None or not len(visited):
            return None
        reference = visited[-1] if reference is None else reference
        key = (*(p.tobytes() for p in visited), reference.tobytes())
        if self._made is None or self._made[0] != key:
            snapshots = [self.snapshots[p.tobytes()] for p in visited]
            projection = GalerkinProjection(affine, snapshots, reference)
            stages = projection.stages()
            model = None if stages is None else ReducedModel(affine.form, reference, stages)
            self._made = key, model, projection
        return self._made[1]

    def displacements(self, p: Floats) -> KnownDisplacements | None:
        """Displacements of the states at p (n,) by the model that was made last.

        None where that is not as good as an analysis, or where the virgin ground settles, whose
        motion is forgotten.
        """
        _, model, projection = self._made or ((), None, None)
        if model is None or projection is None or model.form.loads.settles:
            return None
        try:
            states = model.states(p[None])
            if not model.errors(states)[0] <= CERTAIN:
                return None
        except (ValueError, np.linalg.LinAlgError):
            return None

        def known(state: int) -> Floats | None:
            if state > self.last:
                return None
            return projection.displacements(state, states.states[state][0])

        return known


def reduction_obstacle(analysis: StagedAnalysis) -> str | None:
    """Why the analysis of a case has no reduced model, a clause, or None if it may have one.

    Whether its loads have the form that is needed is found by trying, see `loads.load_form`.
    """
    return next(_obstacles(analysis), None)


def _obstacles(analysis: StagedAnalysis) -> Iterator[str]:
    case, states = analysis.case, analysis.sequence.states
    if not case.parameters:
        yield "nothing is sought"
    for name in analysis.sequence.materials:
        if case.materials[name].yields:
            yield f"{name} yields: its stresses are not linear in the displacements"
    for name in case.interfaces:
        yield f"the interface '{name}' is none of its parts"
    for name, structure in case.structures.items():
        if structure.yields:
            yield f"the structure '{name}' yields: its forces are not linear in the displacements"
    for field in analysis.on_mesh.fields:
        yield f"{field.constant} of {field.material} is a field"
    for growth in case.growths:
        yield growth.words
    for name, count in Counter(name for state in states for name in state.stressed).items():
        if count > 1:
            yield f"the bars of '{name}' are stressed more than once"
    moved = analysis.motions.moved()
    if moved is not None:
        yield f"the support '{moved}' is moved"
    for stage in case.stages:
        if stage.supports:
            yield f"the stage '{stage.name}' changes what is held"
        if stage.temperature:
            yield f"the stage '{stage.name}' changes temperatures"
    for state in states:
        if state.base and state.release.keys() & state.leaving:
            yield (
                f"the stage '{state.name}' releases in part the stress of ground that other stages "
                "have changed before"
            )
