"""How much of each reading's accuracy the mesh eats: by one uniform refinement (theory 9.4).

A reading of a mesh with edges h errs by about C h^q, so halving the edges changes it by
(1 - 2^-q) of its error: the error is the change by 1 - 2^-q. The order q is that of the elements,
or less where the ground has corners (`fem.refinement.singularity`). Where one refinement is too
large for the memory or the patience, the error is taken from the jumps of the stress between
elements.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import InputError, ModelError
from geoident.fem.refinement.halving import refined
from geoident.fem.refinement.singularity import exponent, openings
from geoident.fem.solvers import pick_solver
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.observation import reads_displacements
from geoident.forward.model import StageByStage, StagedModel, staged_model
from geoident.identify.problem.problem import Outcome, Problem, Scaling
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.cells import CELLS
from geoident.model.gauges import Channel, ErrorParts, ReadingTable
from geoident.model.parameter import Values
from geoident.model.results.mesh_error import MATTERS, NOTICED, MeshError
from geoident.units import in_unit, shown_unit
from geoident.workflow.estimating.recovery import energy_error
from geoident.workflow.running.cost import estimate_cost, refinement_cost
from geoident.workflow.running.readings import times_of

SHARE_OF_MEMORY = 0.6
"""Of what is free, that a refined model may take."""

LEAST_PATIENCE = 2.0
"""Seconds for which a refinement is made beside any fit."""


def mesh_error(
    model: StagedModel, case: Case, p: Floats, *, patience: int | None = None
) -> MeshError:
    """What the mesh does to all readings.

    Args:
        model: of the case.
        case: as it was written, without the modes of fields.
        p: (n,) parameters of the model, SI.
        patience: evaluations of the model for as long as which the refined one may take; None
            for as long as it needs.

    Raises:
        ModelError: the model has no solution there.
    """
    refinement = _refinement(model, case, p, patience)
    computed = model.computed(p)
    if isinstance(refinement, Refinement):
        try:
            return refinement.everywhere(computed)
        except (ModelError, MemoryError) as error:
            refinement = _not_computed(error)
    return _by_recovery(model, p, computed, refinement)


def _refinement(
    model: StagedModel, case: Case, p: Floats, patience: int | None
) -> Refinement | str:
    """The refined model at p (n,), or why there is none, a sentence."""
    why = _too_large(model, patience)
    if why is not None:
        return why
    try:
        fine = staged_model(refined(model.mesh), case, solver=pick_solver(model.solver_name))
    except (InputError, ModelError, MemoryError) as error:
        return _not_computed(error)
    fine.on_state = model.on_state  # the clock is looked at here too
    known = model.values(p)  # fields have their mean
    values = {q.name: known.get(q.name, q.start) for q in fine.case.parameters}
    march = StageByStage(fine, np.array([values[name] for name in fine.names], dtype=np.float64))
    return Refinement(model, fine, march, *orders(model))


def _not_computed(error: Exception) -> str:
    said = str(error).splitlines()[0] if str(error) else "no memory is left"
    return f"The refined mesh cannot be computed with: {said}"


def _too_large(model: StagedModel, patience: int | None) -> str | None:
    """Why the refined model is not computed, a sentence; None if it can be."""
    plain = estimate_cost(model, solver=model.solver_name, rough=True)
    cost = refinement_cost(model, plain)
    free = _free_memory()
    if free is not None and cost.memory > SHARE_OF_MEMORY * free:
        return (
            f"One refinement needs about {cost.memory / 1e9:.1f} GB of memory, of which "
            f"{free / 1e9:.1f} GB are free."
        )
    if patience is not None and cost.seconds > max(patience * plain.seconds, LEAST_PATIENCE):
        return (
            f"One refinement takes about {cost.seconds:.0f} s, longer than the fit itself; "
            "'geoident check --mesh-error' makes it."
        )
    return None


def _free_memory() -> float | None:
    """Bytes of memory that are free; None where the system does not tell."""
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return None


@dataclass(frozen=True)
class Refinement:
    """A model, and the same with every edge of its mesh halved, at the same parameters.

    Args:
        model: of the case.
        fine: with half the edges.
        march: of that.
        order: of convergence of displacements.
        corner: the sharpest opening of the ground, rad.
    """

    model: StagedModel
    fine: StagedModel
    march: StageByStage
    order: float
    corner: float

    def everywhere(self, computed: Floats) -> MeshError:
        """The error of all readings.

        Args:
            computed: (n_channels, n_stages) by the model, SI.

        Raises:
            ModelError: the refined model has no solution there.
        """
        return self._table(computed, self.march.computed() - computed)

    def of_readings(self, values: Values, read: ReadingTable, v: Floats) -> MeshError:
        """The error of the g readings used, for which no later stage is computed.

        Args:
            values: parameters by name, SI.
            read: of the case.
            v: (g,) by the model, SI.

        Raises:
            ModelError: the refined model has no solution there.
        """
        case, pairs = self.model.case, used_pairs(read)
        places = ReadingPlaces.of(case, pairs, ())
        added = self.model.instrument_errors.added
        at_times = ReadingPlaces.of(case, pairs, times_of(read, read.used))
        drift = added(values, (), at_times) - added(values, (), places)
        at = places.rows, places.states - 1
        computed = np.full((len(case.channels), len(case.stages)), np.nan)
        computed[at] = v - drift[:, 0]
        last = int(places.states.max(initial=0))
        return self._table(computed, self.march.computed(last) - computed)

    def _table(self, computed: Floats, change: Floats) -> MeshError:
        model, q = self.model, self.order
        by_channel = np.array(
            [
                q if reads_displacements(channel) else min(q, _order(model))
                for channel in model.case.channels
            ]
        )
        error = change / (1.0 - 2.0 ** -by_channel[:, None])
        return _table(
            model, computed, change, error, "refinement", q,
            (model.mesh.n_elements, self.fine.mesh.n_elements),
            (*_corner_notes(q, self.corner), *_chord_notes(model)),
        )  # fmt: skip


def used_pairs(read: ReadingTable) -> list[tuple[str, str]]:
    """Channel and stage of the readings used (g)."""
    return [pair for pair, used in zip(read.pairs, read.used, strict=True) if used]


def _by_recovery(model: StagedModel, p: Floats, computed: Floats, why: str) -> MeshError:
    part = energy_error(model, p)
    error = computed * part
    notes = (
        why,
        f"The error is taken from the jumps of the stress between elements: {100 * part:.2g} % of "
        "the energy of the change, and so of the motions that make it.",
    )
    unknown = np.full(computed.shape, np.nan)
    n = model.mesh.n_elements
    return _table(model, computed, unknown, error, "recovery", np.nan, (n, n), notes)


def _table(
    model: StagedModel, computed: Floats, change: Floats, error: Floats, how: str, order: float,
    elements: tuple[int, int], notes: tuple[str, ...],
) -> MeshError:  # fmt: skip
    channels = model.case.channels
    return MeshError(
        how=how,
        channels=tuple(channel.name for channel in channels),
        stages=tuple(stage.name for stage in model.case.stages),
        computed=computed,
        change=change,
        error=error,
        accuracy=np.array([channel.accuracy for channel in channels], dtype=np.float64),
        units=tuple(channel.unit for channel in channels),
        dimensions=tuple(channel.dimension for channel in channels),
        order=order,
        elements=elements,
        notes=notes,
    )


def _order(model: StagedModel) -> int:
    """Order of the elements, the lowest where there are several."""
    return min(CELLS[block.kind].order for block in model.mesh.blocks)


def orders(model: StagedModel) -> tuple[float, float]:
    """Order of convergence of displacements, and the sharpest opening of the ground, rad."""
    sequence, sharpest = model.sequence, np.pi
    states = {sequence.present(n).tobytes(): n for n in range(len(sequence.states))}
    for n in states.values():
        found = openings(model.mesh, model.on_mesh.table, sequence.present(n))
        sharpest = max(sharpest, float(found.max(initial=np.pi)))
    return min(_order(model) + 1.0, 2.0 * exponent(min(sharpest, 2.0 * np.pi))), sharpest


def _corner_notes(q: float, corner: float) -> tuple[str, ...]:
    if corner < _SHARP:
        return ()
    return (
        f"Corners of {np.degrees(corner):.0f} degrees make the readings converge with the power "
        f"{q:.2g} of the size of elements only; the error is {1.0 / (1.0 - 2.0**-q):.2g} times the "
        "change by the refinement. Finer elements around the corners help most.",
    )


_SHARP = np.radians(226.0)
"""Opening of the ground from which on a corner is one, and no turn of a curve."""

_TURNS = (np.radians(1.0), np.radians(46.0))
"""Turns of a boundary at which it may be a curve that is drawn by chords."""


def _chord_notes(model: StagedModel) -> tuple[str, ...]:
    """What new nodes on straight edges do not tell of curved walls."""
    if _order(model) == 2:
        return ()
    sequence, typical = model.sequence, 0.0
    states = {sequence.present(n).tobytes(): n for n in range(1, len(sequence.states))}
    for n in states.values():
        turn = openings(model.mesh, model.on_mesh.table, sequence.present(n)) - np.pi
        soft = turn[(turn > _TURNS[0]) & (turn < _TURNS[1])]
        typical = max(typical, float(np.median(soft)) if len(soft) > _MANY else 0.0)
    if not typical:
        return ()
    return (
        "New nodes stand in the middle of straight edges: what chords cut off of a curved wall "
        f"(turns of {np.degrees(typical):.0f} degrees, {100.0 * typical**2 / 6.0:.1g} % of the "
        "opening) is not in these numbers.",
    )


_MANY = 4


def mesh_sentence(found: MeshError, which: Bools) -> str:
    """What the mesh does to some readings (n_channels, n_stages), in one sentence."""
    share = np.where(which, np.nan_to_num(found.share), 0.0)
    if not share.any():
        return "The mesh changes none of the readings."
    i, j = np.unravel_index(int(share.argmax()), share.shape)
    unit = found.units[i], found.dimensions[i]
    size = f"{in_unit(abs(float(found.error[i, j])), *unit):.2g} {shown_unit(*unit)}".rstrip()
    worst = f"{size} at {found.channels[i]} in {found.stages[j]}, {share[i, j]:.2g} accuracies"
    scatter = found.scatter(which)
    if scatter < NOTICED:
        return f"The mesh eats little of the accuracy of the readings (at most {worst})."
    eaten = f"the error of the readings by the mesh is {scatter:.2g} of their accuracy in the mean"
    if scatter < MATTERS:
        return f"The mesh is fine enough: {eaten} (at most {worst})."
    return (
        f"The mesh is too coarse for these readings: {eaten} (at most {worst}). Halve the elements "
        "where the ground moves most, or take elements of second order."
    )


SHIFT = 0.5
"""Shift of a parameter by the mesh, in its standard deviations, from which on the mesh counts."""


@dataclass(frozen=True)
class FittedMesh:
    """What the mesh does to a fit.

    Args:
        found: by channel and stage, at the parameters of the first search.
        used: (n_channels, n_stages) which readings were used.
        shift: of the parameter that the mesh shifts most, in its standard deviations.
        counts: whether the errors of the readings have it.
        whole: ``found`` has all readings, not those alone that a fit has used.
    """

    found: MeshError
    used: Bools
    shift: float
    counts: bool
    whole: bool = True

    @property
    def sentence(self) -> str:
        """What it means for the fit; nothing where it is small."""
        if not self.counts:
            return ""
        said = mesh_sentence(self.found, self.used)
        shown = "(`geoident check CASE.fit.h5 --mesh-error` shows it.)"
        return f"{said} Intervals and bands are widened by it. {shown}"

    @property
    def findings(self) -> tuple[str, ...]:
        """The sentence, where the mesh is too coarse: the user should act."""
        return (self.sentence,) if self.counts and self._coarse else ()

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentence on a mesh that is fine enough, and how its error was found."""
        if not self.counts:
            return ()
        how = () if self.found.how == "refinement" else self.found.notes
        return how if self._coarse else (self.sentence, *how)

    @property
    def _coarse(self) -> bool:
        return self.found.scatter(self.used) >= MATTERS


def fitted_mesh(
    model: StagedModel,
    problem: Problem,
    read: ReadingTable,
    outcome: Outcome,
    known: FittedMesh | None,
) -> FittedMesh | None:
    """What the mesh does to the readings of a fit; None where that cannot be told.

    The refined model is computed with up to the last stage that was used. Only if the mesh counts,
    or another fit on it has asked before, for other readings, all stages follow.

    Args:
        model: of the case.
        problem: the g used readings.
        read: all of them.
        outcome: of the search.
        known: what another fit has found at its parameters.
    """
    pairs = used_pairs(read)
    try:
        v, _ = problem.response.evaluate(outcome.values)
        places = ReadingPlaces.of(model.case, pairs, ())
        found = _known(known, v, problem.sd, (places.rows, places.states - 1))
        if known is not None and found is not None:
            judged = judged_mesh(found, problem, pairs, outcome)
            if known.whole or not judged.counts:
                return replace(judged, whole=known.whole)
        if known is not None:
            return judged_mesh(everywhere(model, problem, outcome), problem, pairs, outcome)
        return _of_used(model, problem, read, outcome)
    except ModelError:
        return None


def everywhere(model: StagedModel, problem: Problem, outcome: Outcome) -> MeshError:
    """What the mesh does to all readings, those that were not used too, at the end of a search.

    Args:
        model: of the case.
        problem: of the search.
        outcome: of the search.

    Raises:
        ModelError: the model has no solution there.
    """
    return mesh_error(model, _plain(model), outcome.values, patience=_patience(problem))


def _plain(model: StagedModel) -> Case:
    """The case of a model as it was written, without the modes of fields."""
    case = model.case
    return replace(case, parameters=tuple(q for q in case.parameters if not q.field))


def _patience(problem: Problem) -> int:
    """As many evaluations as the search took, or as one takes without a reduced model.

    What is said of the mesh must not depend on how few evaluations the way took.
    """
    return max(problem.response.counts.evaluations, _USUAL)


_USUAL = 6
"""Evaluations of a search by linearised steps."""


def _of_used(
    model: StagedModel, problem: Problem, read: ReadingTable, outcome: Outcome
) -> FittedMesh:
    """What the mesh does to the readings used, and to all where it counts.

    Raises:
        ModelError: the model has no solution there.
    """
    p, pairs = outcome.values, used_pairs(read)
    refinement = _refinement(model, _plain(model), p, _patience(problem))
    if isinstance(refinement, Refinement):
        v, _ = problem.response.evaluate(p)
        try:
            found = refinement.of_readings(model.values(p), read, v)
            judged = judged_mesh(found, problem, pairs, outcome)
            if not judged.counts:
                return replace(judged, whole=False)
            return replace(judged, found=refinement.everywhere(model.computed(p)))
        except (ModelError, MemoryError) as error:
            refinement = _not_computed(error)
    found = _by_recovery(model, p, model.computed(p), refinement)
    return judged_mesh(found, problem, pairs, outcome)


def _known(
    known: FittedMesh | None, v: Floats, sd: Floats, at: tuple[Ints, Ints]
) -> MeshError | None:
    """The error found at other parameters, in proportion to what is computed there; or None.

    Args:
        known: what was found.
        v: (g,) what is computed now, SI.
        sd: (g,) of the readings, SI.
        at: numbers of the channels and stages of these.
    """
    if known is None or not np.isfinite(known.found.error[at]).all():
        return None
    now, before = v / sd, known.found.computed[at] / sd
    size = float(before @ before)
    part = float(before @ now) / size if size else 1.0
    found = known.found
    return replace(
        found, computed=part * found.computed, change=part * found.change, error=part * found.error
    )


def judged_mesh(
    found: MeshError, problem: Problem, pairs: Sequence[tuple[str, str]], outcome: Outcome
) -> FittedMesh:
    """Whether errors of the mesh count beside those of the readings.

    Args:
        found: by channel and stage, with the accuracies of the channels.
        problem: the g used readings, without errors of mesh and model.
        pairs: channel and stage of each.
        outcome: of a search.

    Raises:
        ModelError: the model has no solution there.
    """
    _, jacobian = problem.response.evaluate(outcome.values)
    i = np.array([found.channels.index(channel) for channel, _ in pairs], dtype=np.int64)
    j = np.array([found.stages.index(stage) for _, stage in pairs], dtype=np.int64)
    used = np.zeros(found.error.shape, dtype=np.bool_)
    used[i, j] = True
    error = np.nan_to_num(found.error[i, j])
    shift = _shift(problem, outcome.values, jacobian, error)
    return FittedMesh(found, used, shift, shift > SHIFT or found.scatter(used) > MATTERS)


def _shift(problem: Problem, values: Floats, jacobian: Floats, error: Floats) -> float:
    """Largest shift of a parameter by errors (g,) of readings, in its standard deviations."""
    scaling = Scaling(problem.parameters)
    rows = np.concatenate(
        [problem.whiten(jacobian * scaling.slope(values)), scaling.prior_jacobian(values)]
    )
    right = np.zeros(len(rows))
    right[: len(error)] = problem.whiten(error)
    U, S, Vt = np.linalg.svd(rows, full_matrices=False)
    seen = _UNSEEN * S.max(initial=0.0) < S
    moved = Vt[seen].T @ ((U.T @ right)[seen] / S[seen])
    sd = np.sqrt(np.sum((Vt[seen].T / S[seen]) ** 2, axis=1))
    parts = np.divide(np.abs(moved), sd, out=np.zeros_like(sd), where=sd > 0.0)
    return float(parts.max(initial=0.0))


_UNSEEN = 1e-8


def with_mesh_error(case: Case, found: MeshError) -> Case:
    """A case whose channels have the error of the mesh among what their readings share."""
    return replace(
        case,
        channels=tuple(
            replace(channel, errors=_with_mesh(channel, found.stages, row))
            for channel, row in zip(case.channels, found.error, strict=True)
        ),
    )


def _with_mesh(channel: Channel, stages: Sequence[str], row: Floats) -> ErrorParts:
    parts = channel.errors or ErrorParts(channel.accuracy)
    mesh = tuple((s, float(e)) for s, e in zip(stages, row, strict=True) if np.isfinite(e) and e)
    return replace(parts, mesh=mesh)
