"""The search for the parameters, with the errors of mesh, model and gauges found beside them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace

import numpy as np

from geoident.errors import TimeIsUp
from geoident.forward.model import StagedModel
from geoident.identify import descend, identify
from geoident.identify.assessment.variance_components import VarianceComponents
from geoident.identify.problem.errors import ErrorStructure
from geoident.identify.problem.methods import continued
from geoident.identify.problem.problem import STOPPED, LocalMinimum, Outcome, Problem
from geoident.model.arrays import Floats
from geoident.model.methods import (
    ComplementarityOptions,
    MethodOptions,
    ScanOptions,
    SquaredOptions,
)
from geoident.workflow.estimating.accuracies import (
    accuracy_table,
    after,
    weighed,
    with_accuracies,
    with_scatter,
)
from geoident.workflow.estimating.fitted_mesh import (
    FittedMesh,
    everywhere,
    fitted_mesh,
    judged_mesh,
    with_mesh_error,
)
from geoident.workflow.estimating.mesh_error import used_pairs
from geoident.workflow.estimating.model_error import (
    FittedModelError,
    no_model_error,
)
from geoident.workflow.estimating.model_error_covariance import (
    correlation_length,
    reading_steps,
)
from geoident.workflow.estimating.model_error_search import ModelErrorSearch
from geoident.workflow.estimating.rivals import LOWER, kept_up
from geoident.workflow.estimating.setup import (
    Setup,
    problem_of,
    structure_of_used,
    used_response,
    used_rows,
)
from geoident.workflow.running.control import OUT_OF_TIME, Control
from geoident.workflow.running.errors import gauge_errors
from geoident.workflow.running.evaluation_log import Log, known_nearly, led
from geoident.workflow.running.readings import (
    reading_table,
)
from geoident.workflow.running.reduced_scan import with_reduced_readings


def estimated(
    setup: Setup,
    methods: Sequence[MethodOptions],
    log: Log,
    control: Control,
    *,
    start: Floats | None = None,
    near: bool = False,
) -> tuple[Setup, Problem, Outcome]:
    """The parameters that meet the readings of a setup, and all that is estimated with them.

    A search that begins where another ended is led by the reduced model, if there is one that is
    `EXACT` there; the model itself is asked at the end of it.

    Everything that is said of an estimate (assessment, diagnostics, predictions) is computed from
    the problem that comes back.

    Args:
        setup: model and selected readings.
        methods: the identifiers to run, one after the other.
        log: takes what is evaluated, and gives it again.
        control: progress, budget and stops.
        start: (n,) where to begin, SI; None for the start values of the case.
        near: another fit of the same model has ended there.

    Returns:
        The setup with the accuracies that were estimated, the problem, and the outcome.

    Raises:
        Interrupted: a stop was asked for.
    """
    setup = setup.as_stated()  # what was estimated may be of other readings
    problem = problem_of(setup, log, control)
    if start is not None:
        problem = problem.begun_at(start)
    only = methods[0] if len(methods) == 1 else None
    staged = isinstance(setup.model, StagedModel) and setup.case.fit.reduced
    if isinstance(only, ScanOptions) and staged:
        problem = with_reduced_readings(problem, used_response(setup), only)
    with led(problem.response) if near else nullcontext():
        first = _search(problem, methods, control)
    try:
        return _with_all_errors(setup, problem, first, methods, control)
    except TimeIsUp:
        return setup, problem, replace(first, status=STOPPED, reason=OUT_OF_TIME)


def _with_all_errors(
    setup: Setup,
    problem: Problem,
    first: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with the errors of the mesh, of the gauges and of the model.

    Raises:
        TimeIsUp: the time ended within an evaluation that they need.
        Interrupted: a stop was asked for.
    """
    with led(problem.response):
        setup, weighted, begun = _with_mesh(setup, problem, first, methods, control)
        found, final, outcome = _with_errors(setup, weighted, begun, methods, control)
        mesh = _mesh_beside_accuracies(found, problem, outcome)
        if mesh is not None:
            setup, weighted, begun = _counted(setup, mesh, problem, begun, methods, control)
            found, final, outcome = _with_errors(setup, weighted, begun, methods, control)
    outcome = _confirmed(final, outcome, methods, control)
    if final is problem or not first.minima:
        return found, final, outcome
    # the weights are others now, and so are the minima

    def again(elsewhere: Problem) -> Outcome:
        return _descent(elsewhere, methods, control)

    outcome = kept_up(final, outcome, first.minima, again)
    lowest = outcome.minima[0] if outcome.minima else None
    if lowest is None or lowest.objective >= outcome.objective - LOWER:
        return found, final, outcome
    # what was estimated with the parameters belongs to another minimum
    former = LocalMinimum(outcome.values, outcome.objective)
    moved = weighted.begun_at(lowest.values)
    found, final, outcome = _with_errors(setup, moved, again(moved), methods, control)
    return found, final, kept_up(final, outcome, [former, *first.minima], again)


def _with_mesh(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with the error of the mesh among those of the readings, where it matters."""
    case, model = setup.case, setup.model
    asked = case.fit.mesh_error and not any(c.errors and c.errors.mesh for c in case.channels)
    plain = not isinstance(methods[-1], ScanOptions) and not _proves(methods[-1])
    if not (asked and plain and isinstance(model, StagedModel)) or outcome.status == STOPPED:
        return setup.not_asked_of_the_mesh(), problem, outcome
    found = fitted_mesh(model, problem, setup.readings, outcome, setup.mesh)
    if found is None or not found.counts:
        return replace(setup, mesh=found), problem, outcome
    return _counted(setup, found, problem, outcome, methods, control)


def _mesh_beside_accuracies(found: Setup, problem: Problem, outcome: Outcome) -> FittedMesh | None:
    """The mesh, where it counts beside the accuracies that were estimated and not before.

    Gauges that turn out to be better than stated notice a mesh that was fine enough before.

    Args:
        found: with the accuracies that were estimated.
        problem: the readings, without errors of mesh and model.
        outcome: of the search.
    """
    mesh, case = found.mesh, found.case
    if mesh is None or mesh.counts or found.accuracies is None or outcome.status == STOPPED:
        return None
    structure = gauge_errors(used_rows(case, found.readings.used))
    sd, shared = structure.at(np.zeros(len(structure.names)))
    accuracy = np.array([channel.accuracy for channel in case.channels], dtype=np.float64)
    estimated = replace(mesh.found, accuracy=accuracy)
    again = replace(problem, sd=sd, shared=shared)
    judged = judged_mesh(estimated, again, used_pairs(found.readings), outcome)
    if not judged.counts:
        return None
    if mesh.whole or not isinstance(found.model, StagedModel):
        return replace(judged, spent=mesh.spent)
    before = found.model.counts
    whole = everywhere(found.model, problem, outcome)
    spent = mesh.spent + (found.model.counts - before) + whole.cost
    return replace(judged, found=replace(whole, accuracy=accuracy), spent=spent)


def _counted(
    setup: Setup,
    found: FittedMesh,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with the error of the mesh among those of the readings."""
    case = with_mesh_error(setup.case, found.found)
    structure = structure_of_used(case, setup.readings.used)
    assert structure is not None  # the mesh is in it
    sd, shared = structure.at(np.zeros(len(structure.names)))
    problem = replace(problem, sd=sd, shared=shared).begun_at(outcome.values)
    again = after(outcome, _descent(problem, methods, control))
    table = reading_table(case, setup.readings.reason)
    return replace(setup, case=case, readings=table, mesh=found), problem, again


def _proves(options: MethodOptions) -> bool:
    """Whether a method proves a bound, of the problem as it is given."""
    return isinstance(options, ComplementarityOptions) and options.formulation == "global"


def _with_errors(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with all errors that are estimated: those of the model and those of the gauges."""
    if no_model_error(setup.case, setup.readings, methods) is None:
        found = _with_model_error(setup, problem, outcome, methods, control)
        if found is not None:
            return found
    return _with_accuracies(setup, problem, outcome, methods, control)


def _confirmed(
    problem: Problem, outcome: Outcome, methods: Sequence[MethodOptions], control: Control
) -> Outcome:
    """An outcome that the model itself has confirmed, where the reduced model led to it.

    Raises:
        Interrupted: a stop was asked for.
    """
    if outcome.status == STOPPED or not known_nearly(problem.response, outcome.values):
        return outcome
    return after(outcome, _descent(problem.begun_at(outcome.values), methods, control))


def _descent(problem: Problem, methods: Sequence[MethodOptions], control: Control) -> Outcome:
    """One descent from where a problem begins, by the last method's steps.

    Raises:
        Interrupted: a stop was asked for.
    """
    outcome = descend(problem, methods[-1], control.observe)
    control.stop.check()
    return outcome


def _with_model_error(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome] | None:
    """The same with the model error, and with accuracies that the case wants estimated.

    None where no reading can have a model error.
    """
    case, readings = setup.case, setup.readings
    length = correlation_length(case, case.fit.model_error)
    rows = used_rows(case, readings.used)
    pairs = [pair for pair, taken in zip(readings.pairs, readings.used, strict=True) if taken]

    structure = gauge_errors(rows)
    search = ModelErrorSearch(
        case.fit.model_error,
        length,
        structure,
        tuple(channel for channel, _ in rows),
        lambda increments: reading_steps(case, setup.model, increments, pairs, length),
        lambda again: _descent(again, methods, control),
        isinstance(case.fit.loss, SquaredOptions),
    )
    found = search.run(problem, outcome)
    if found is None:
        return None
    again = replace(setup, model_error=found.found)
    if structure.names:
        again = _sized(again, structure, found.components)
    elif search.scatters:
        again = _scattering(again, found.found)
    channels = tuple(channel for channel, _ in used_rows(again.case, readings.used))
    again = replace(again, model_error=found.found.of_channels(channels))
    return again, found.problem, found.outcome


def _scattering(setup: Setup, found: FittedModelError) -> Setup:
    """The setup with the errors of gauges that were found with the model error."""
    case = with_scatter(setup.case, found.factor, found.zero)
    table = reading_table(case, setup.readings.reason)
    return replace(setup, case=case, readings=table, stated=setup.case)


def _sized(setup: Setup, structure: ErrorStructure, found: VarianceComponents) -> Setup:
    """The setup with the accuracies that were estimated."""
    root = np.exp(0.5 * found.log_factor)
    factors = dict(zip(structure.names, map(float, root), strict=True))
    sized = with_accuracies(setup.case, factors)
    return replace(
        setup,
        case=sized,
        readings=reading_table(sized, setup.readings.reason),
        accuracies=accuracy_table(setup.case, structure.names, found),
    )


def _with_accuracies(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with the accuracies that the case wants estimated; as it is where there are none."""
    case, used = setup.case, setup.readings.used
    structure = structure_of_used(case, used)
    if structure is None or not structure.names:
        return setup, problem, outcome
    found = weighed(
        problem, structure, outcome, lambda again: _search(again, continued(methods), control)
    )
    return _sized(setup, structure, found.components), found.problem, found.outcome


def _search(problem: Problem, methods: Sequence[MethodOptions], control: Control) -> Outcome:
    """Run the identifiers, one after the other.

    Raises:
        Interrupted: a stop was asked for.
    """
    outcome = identify(problem, methods, control.observe)
    control.stop.check()
    return outcome
