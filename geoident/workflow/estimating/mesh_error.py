"""How much of each reading's accuracy is lost to mesh error: one uniform refinement (theory 9.4).

A reading of a mesh with edges h errs by about C h^q, so halving the edges changes it by
(1 - 2^-q) of its error: the error is the change by 1 - 2^-q. The order q is that of the elements,
or less where the ground has corners (`fem.refinement.singularity`). Where one refinement is too
large for the memory or the patience, elements of second order on the same edges may not be, which
err by about 4^-q of what those of first order do; else the error is taken from the jumps of the
stress between elements.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import InputError, ModelError
from geoident.fem.refinement.finer import halved, raised
from geoident.fem.refinement.singularity import exponent, openings
from geoident.fem.solvers import pick_solver
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.kinds import reads_displacements
from geoident.forward.model import StagedModel, staged_model
from geoident.forward.staged import ResumableRun
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.cells import CELLS
from geoident.model.gauges import ReadingTable
from geoident.model.parameter import Values
from geoident.model.results.computed_error import MATTERS, NOTICED
from geoident.model.results.mesh_error import MeshError
from geoident.model.results.summary import CostEstimate
from geoident.workflow.estimating.recovery import EnergyError, reading_errors
from geoident.workflow.running.cost import (
    estimate_cost,
    free_memory,
    order_step_cost,
    refinement_cost,
)
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
    finer = refinement(model, case, p, patience)
    if isinstance(finer, Refinement):
        computed = model.computed(p)
        try:
            return finer.everywhere(computed)
        except (ModelError, MemoryError) as error:
            finer = not_computed(error)
    return by_recovery(model, p, finer)


def refinement(model: StagedModel, case: Case, p: Floats, patience: int | None) -> Refinement | str:
    """The model on a finer mesh at p (n,), or why there is none, a sentence.

    Args:
        model: of the case.
        case: without the modes of fields.
        p: (n,) parameters, SI.
        patience: evaluations of the model for as long as which it may take; None for any.
    """
    plain = estimate_cost(model, solver=model.solver_name, rough=True)
    why = _too_large(refinement_cost(model, plain), plain, patience)
    if why is None:
        return _finer("refinement", model, case, p)
    if _order(model) == 1 and model.mesh.dim == 3:
        raised_cost = order_step_cost(model, plain)
        if _too_large(raised_cost, plain, patience) is None:
            instead = "Elements of second order on the same edges were taken instead."
            return _finer("order", model, case, p, f"{why} {instead}")
    return why


def _finer(how: str, model: StagedModel, case: Case, p: Floats, *notes: str) -> Refinement | str:
    mesh_of = halved if how == "refinement" else raised
    try:
        fine = staged_model(
            mesh_of(model.on_mesh.unsplit.mesh), case, solver=pick_solver(model.solver_name)
        )
    except (InputError, ModelError, MemoryError) as error:
        return not_computed(error)
    fine.on_state = model.on_state  # the clock is looked at here too
    known = model.values(p)  # fields have their mean
    values = {q.name: known.get(q.name, q.start) for q in fine.case.parameters}
    at = np.array([values[name] for name in fine.names], dtype=np.float64)
    # bands of shear are as wide as elements: what they move is no error of the mesh
    options = RunOptions(derivatives=False, partial=True, explain=False, strict=True)
    analysis = ResumableRun(fine, at, options, keeps_ends=False)
    return Refinement(how, model, fine, analysis, *orders(model), notes)


def not_computed(error: Exception) -> str:
    """Why there is no finer model, a sentence."""
    reason = str(error).splitlines()[0] if str(error) else "no memory is left"
    return f"The refined mesh cannot be computed with: {reason}"


def _too_large(cost: CostEstimate, plain: CostEstimate, patience: int | None) -> str | None:
    """Why a finer model is not computed, a sentence; None if it can be.

    Args:
        cost: of one evaluation of it.
        plain: of one of the model.
        patience: evaluations of the model for as long as which it may take.
    """
    free = free_memory()
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


@dataclass(frozen=True)
class Refinement:
    """A model, and the same on a finer mesh, at the same parameters.

    Args:
        how: as of a `MeshError`.
        model: of the case.
        fine: with half the edges, or elements of second order.
        analysis: of that.
        order: of convergence of displacements.
        corner: the sharpest opening of the ground, rad.
        notes: why it is not another, sentences.
    """

    how: str
    model: StagedModel
    fine: StagedModel
    analysis: ResumableRun
    order: float
    corner: float
    notes: tuple[str, ...] = ()

    def everywhere(self, computed: Floats) -> MeshError:
        """The error of all readings.

        Args:
            computed: (n_channels, n_stages) by the model, SI.

        Raises:
            ModelError: the refined model has no solution there.
        """
        return self._table(computed, self.analysis.computed(len(self.fine.bases) - 1) - computed)

    def of_readings(self, values: Values, read: ReadingTable, v: Floats) -> MeshError:
        """The error of the g readings used, for which no later stage is computed.

        Args:
            values: parameters by name, SI.
            read: of the case.
            v: (g,) by the model, SI.

        Raises:
            ModelError: the refined model has no solution there.
        """
        case, pairs = self.model.case, read.used_pairs
        places = ReadingPlaces.of(case, pairs, ())
        added = self.model.instrument_errors.added
        at_times = ReadingPlaces.of(case, pairs, times_of(read, read.used))
        drift = added(values, (), at_times) - added(values, (), places)
        at = places.rows, places.states - 1
        computed = np.full((len(case.channels), len(case.stages)), np.nan)
        computed[at] = v - drift[:, 0]
        last = int(places.states.max(initial=0))
        return self._table(computed, self.analysis.computed(last) - computed)

    def _table(self, computed: Floats, change: Floats) -> MeshError:
        model, q = self.model, self.order
        by_channel = np.array(
            [
                q if reads_displacements(channel) else min(q, _order(model))
                for channel in model.case.channels
            ]
        )
        left = _left(self.how, by_channel)[:, None]
        return replace(
            _table(
                model, computed, change, change / (1.0 - left), self.how, q,
                (model.mesh.n_elements, self.fine.mesh.n_elements),
                (*self.notes, *_corner_notes(self.how, q, self.corner), *_chord_notes(model)),
            ),
            cost=self.fine.counts,
        )  # fmt: skip


def _left(how: str, q: Floats) -> Floats:
    """Part of the error that is left on the finer mesh, at orders q (k,) of convergence."""
    return np.asarray((2.0 if how == "refinement" else 4.0) ** -q)


_LARGE = 0.25
"""Part of what is computed from which on jumps underestimate the error of a mesh."""


def by_recovery(model: StagedModel, p: Floats, why: str) -> MeshError:
    """The error of all readings from the jumps of the stress.

    Args:
        model: of the case.
        p: (n,) parameters, SI.
        why: there is no finer mesh, a sentence.
    """
    error = reading_errors(model, p)
    if error is None:
        jumps = EnergyError(model, p)
        computed = model.computed(p, jumps.add)
        part = jumps.relative
        error = computed * part
        how = (
            f"The error is taken from the jumps of the stress between elements: {100 * part:.2g} % "
            "of the energy of the change, and so of the motions that make it. Single readings may "
            "err several times as much, most of all beside weak zones."
        )
    else:
        computed = model.computed(p)
        how = (
            "The error of each reading is taken from the jumps of the stress between elements, "
            "each weighted by its effect on that reading."
        )
        wrong, whole = (
            float(np.linalg.norm(np.nan_to_num(values / model.case.accuracies)))
            for values in (error, computed)
        )
        if wrong > _LARGE * whole > 0.0:
            how += (
                f" It is {100 * wrong / whole:.2g} % of the readings themselves: on so coarse a "
                "mesh this is a lower bound."
            )
    notes = why, how
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
        accuracy=model.case.accuracies,
        units=tuple(channel.unit for channel in channels),
        dimensions=tuple(channel.dimension for channel in channels),
        order=order,
        elements=elements,
        notes=notes,
        first_order=_order(model) == 1,
    )


def _order(model: StagedModel) -> int:
    """Order of the elements, the lowest where there are several."""
    return min(CELLS[block.kind].order for block in model.mesh.blocks)


def orders(model: StagedModel) -> tuple[float, float]:
    """Order of convergence of displacements, and the sharpest opening of the ground, rad."""
    sequence, sharpest = model.sequence, np.pi
    states = {sequence.present(n).tobytes(): n for n in range(len(sequence.states))}
    for n in states.values():
        angles = openings(model.mesh, model.on_mesh.table, sequence.present(n))
        sharpest = max(sharpest, float(angles.max(initial=np.pi)))
    return min(_order(model) + 1.0, 2.0 * exponent(min(sharpest, 2.0 * np.pi))), sharpest


def _corner_notes(how: str, q: float, corner: float) -> tuple[str, ...]:
    if corner < _SHARP:
        return ()
    return (
        f"Corners of {np.degrees(corner):.0f} degrees make the readings converge with the power "
        f"{q:.2g} of the size of elements only; the error is "
        f"{1.0 / (1.0 - float(_left(how, np.array(q)))):.2g} times the change on the finer mesh. "
        "Finer elements around the corners help most.",
    )


_SHARP = np.radians(226.0)
"""Opening of the ground from which on a corner is one, and no turn of a curve."""

_TURNS = (np.radians(1.0), np.radians(46.0))
"""Turns of a boundary at which it may be a curve that is drawn by chords."""


def _chord_notes(model: StagedModel) -> tuple[str, ...]:
    """Why new nodes on straight edges miss the error of curved walls."""
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
        "New nodes lie in the middle of straight edges: this does not include the area that chords "
        f"cut off at a curved wall (turns of {np.degrees(typical):.0f} degrees, "
        f"{100.0 * typical**2 / 6.0:.1g} % of the opening).",
    )


_MANY = 4


def mesh_sentence(mesh_error: MeshError, which: Bools) -> str:
    """What the mesh does to some readings (n_channels, n_stages), in one sentence."""
    worst = mesh_error.largest(which)
    if not worst:
        return "The mesh changes none of the readings."
    scatter = mesh_error.scatter(which)
    if scatter < NOTICED:
        return f"Little of the accuracy of the readings is lost to mesh error (at most {worst})."
    error = f"the mesh error of the readings is on average {scatter:.2g} times their accuracy"
    if scatter < MATTERS:
        return f"The mesh is fine enough: {error} (at most {worst})."
    instead = ""
    if mesh_error.first_order:
        instead = ", or write 'order: 2' under 'mesh' for elements of second order"
    return (
        f"The mesh is too coarse for these readings: {error} (at most {worst}). Halve the elements "
        f"where the ground moves most{instead}."
    )
