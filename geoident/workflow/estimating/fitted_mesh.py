"""What the mesh does to a fit: whether its error counts, and counts beside those of the readings.

The finer mesh is asked at the end of the first search, as far as its readings go; for all stages
only where the mesh counts (theory 9.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ModelError
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.model import StagedModel
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, ErrorParts, ReadingTable
from geoident.model.results.computed_error import MATTERS, ComputedError
from geoident.model.results.costs import NO_COST, Counts
from geoident.model.results.findings import Finding
from geoident.model.results.mesh_error import MeshError
from geoident.workflow.estimating.mesh_error import (
    Refinement,
    by_recovery,
    mesh_error,
    mesh_sentence,
    not_computed,
    refinement,
)

SHIFT = 0.5
"""Shift of a parameter by the mesh, in its standard deviations, from which on the mesh counts."""


@dataclass(frozen=True)
class FittedMesh:
    """What the mesh does to a fit.

    Args:
        table: by channel and stage, at the parameters of the first search.
        used: (n_channels, n_stages) which readings were used.
        shift: of the parameter that the mesh shifts most, in its standard deviations.
        counts: whether the errors of the readings have it.
        whole: ``table`` has all readings, not those alone that a fit has used.
        spent: what it has cost this fit, beside its evaluations.
    """

    table: MeshError
    used: Bools
    shift: float
    counts: bool
    whole: bool = True
    spent: Counts = NO_COST

    @property
    def sentence(self) -> str:
        """What it means for the fit; nothing where it is small."""
        if not self.counts:
            return ""
        sentence = mesh_sentence(self.table, self.used)
        shown = "(`geoident check CASE.fit.h5 --mesh-error` shows it.)"
        return f"{sentence} Intervals and bands allow for it. {shown}"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The sentence, where the mesh is too coarse: the user should act."""
        if not (self.counts and self._coarse):
            return ()
        return (Finding("mesh-error", "", self.sentence, {"part": self.table.scatter(self.used)}),)

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentence on a mesh that is fine enough, and how its error was found."""
        if not self.counts:
            return self._untold
        how = () if self.table.how == "refinement" else self.table.notes
        return (*(() if self._coarse else (self.sentence,)), *how, *self._untold)

    @property
    def _untold(self) -> tuple[str, ...]:
        """A sentence on stages in which the finer mesh collapses, and so tells nothing."""
        lost = np.any(self.used & ~np.isfinite(self.table.error), axis=0)
        stages = [f"'{self.table.stages[n]}'" for n in np.flatnonzero(lost)]
        if not stages:
            return ()
        return (
            f"On the finer mesh the ground finds no equilibrium in {', '.join(stages)}: what the "
            "mesh does to the readings there is not known, and is not counted in their accuracies.",
        )

    @property
    def _coarse(self) -> bool:
        return self.table.scatter(self.used) >= MATTERS


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
    before, of_response = model.counts, problem.response.counts
    try:
        if known is None:
            fitted = _of_used(model, problem, read, outcome)
        else:
            fitted = _of_known(known, model, problem, read.used_pairs, outcome)
    except ModelError:
        return None
    aside = (model.counts - before) - (problem.response.counts - of_response)
    return replace(fitted, spent=aside + fitted.table.cost)


def _of_known(
    known: FittedMesh,
    model: StagedModel,
    problem: Problem,
    pairs: Sequence[tuple[str, str]],
    outcome: Outcome,
) -> FittedMesh:
    """What another fit has found; the finer mesh is asked where that does not tell enough.

    Raises:
        ModelError: the model has no solution there.
    """
    v, _ = problem.response.evaluate(outcome.values)
    places = ReadingPlaces.of(model.case, pairs, ())
    table = _in_proportion(known.table, v, problem.sd, (places.rows, places.states - 1))
    if table is not None:
        judged = judged_mesh(table, problem, pairs, outcome)
        if known.whole or not judged.counts:
            return replace(judged, whole=known.whole)
    return judged_mesh(everywhere(model, problem, outcome), problem, pairs, outcome)


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
    p, pairs = outcome.values, read.used_pairs
    finer = refinement(model, _plain(model), p, _patience(problem))
    if isinstance(finer, Refinement):
        v, _ = problem.response.evaluate(p)
        try:
            table = finer.of_readings(model.values(p), read, v)
            judged = judged_mesh(table, problem, pairs, outcome)
            if not judged.counts:
                return replace(judged, whole=False)
            return replace(judged, table=finer.everywhere(model.computed(p)))
        except (ModelError, MemoryError) as error:
            finer = not_computed(error)
    table = by_recovery(model, p, finer)
    return judged_mesh(table, problem, pairs, outcome)


def _in_proportion(
    table: MeshError, v: Floats, sd: Floats, at: tuple[Ints, Ints]
) -> MeshError | None:
    """The error found at other parameters, in proportion to what is computed there; or None.

    Args:
        table: the error there.
        v: (g,) what is computed now, SI.
        sd: (g,) of the readings, SI.
        at: numbers of the channels and stages of these.
    """
    if not np.isfinite(table.error[at]).all():
        return None
    now, before = v / sd, table.computed[at] / sd
    size = float(before @ before)
    part = float(before @ now) / size if size else 1.0
    return replace(
        table, computed=part * table.computed, change=part * table.change, error=part * table.error,
        cost=NO_COST,
    )  # fmt: skip


def judged_mesh(
    table: MeshError, problem: Problem, pairs: Sequence[tuple[str, str]], outcome: Outcome
) -> FittedMesh:
    """Whether errors of the mesh count beside those of the readings.

    Args:
        table: by channel and stage, with the accuracies of the readings.
        problem: the g used readings, without errors of mesh and model.
        pairs: channel and stage of each.
        outcome: of a search.

    Raises:
        ModelError: the model has no solution there.
    """
    used, shift = used_and_shift(table, problem, pairs, outcome)
    return FittedMesh(table, used, shift, shift > SHIFT or table.scatter(used) > MATTERS)


def used_and_shift(
    table: ComputedError, problem: Problem, pairs: Sequence[tuple[str, str]], outcome: Outcome
) -> tuple[Bools, float]:
    """Which readings (n_channels, n_stages) were used, and what their errors shift.

    The shift is that of the parameter that they shift most, in its standard deviations. For the
    arguments see `judged_mesh`.

    Raises:
        ModelError: the model has no solution there.
    """
    _, jacobian = problem.response.evaluate(outcome.values)
    number = {channel: k for k, channel in enumerate(table.channels)}
    i = np.array([number[channel] for channel, _ in pairs], dtype=np.int64)
    j = np.array([table.stages.index(stage) for _, stage in pairs], dtype=np.int64)
    used = np.zeros(table.error.shape, dtype=np.bool_)
    used[i, j] = True
    error = np.nan_to_num(table.error[i, j])
    return used, _shift(problem, outcome.values, jacobian, error)


def _shift(problem: Problem, values: Floats, jacobian: Floats, error: Floats) -> float:
    """Largest shift of a parameter by errors (g,) of readings, in its standard deviations."""
    scaling = Scaling(problem.parameters)
    rows = np.concatenate(
        [problem.whiten(jacobian * scaling.dp_dx(values)), scaling.prior_jacobian(values)]
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


def with_mesh_error(case: Case, table: MeshError) -> Case:
    """A case whose channels have the error of the mesh among what their readings share."""
    rows = zip(case.channels, table.error, table.doubt, strict=True)
    return replace(
        case,
        channels=tuple(
            replace(channel, errors=_with_mesh(channel, table.stages, error, doubt))
            for channel, error, doubt in rows
        ),
    )


def _with_mesh(channel: Channel, stages: Sequence[str], error: Floats, doubt: Floats) -> ErrorParts:
    parts = channel.error_parts
    each = zip(stages, error.tolist(), doubt.tolist(), strict=True)
    return replace(parts, mesh=tuple((s, e, d) for s, e, d in each if d != 0.0))
