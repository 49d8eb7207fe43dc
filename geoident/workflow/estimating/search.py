"""The search for the parameters, with the errors of mesh, model and gauges found beside them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geoident.errors import TimeIsUp
from geoident.forward.external.table import TableModel
from geoident.forward.model import StagedModel
from geoident.identify.assessment.variance_components import VarianceComponents
from geoident.identify.problem.ahead import starts_warm
from geoident.identify.problem.methods import continued, descend, identify
from geoident.identify.problem.outcome import LocalMinimum, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.methods import (
    ComplementarityOptions,
    GaussNewtonOptions,
    MethodOptions,
    ScanOptions,
    SquaredOptions,
)
from geoident.model.response import CERTAIN
from geoident.model.results.result import STOPPED
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
from geoident.workflow.estimating.model_error import (
    FittedModelError,
    no_model_error,
)
from geoident.workflow.estimating.model_error_covariance import (
    correlation_length,
    correlation_time,
    errs_in_common,
    reading_steps,
)
from geoident.workflow.estimating.model_error_search import ModelErrorSearch
from geoident.workflow.estimating.rivals import LOWER, kept_up
from geoident.workflow.estimating.setup import (
    Setup,
    kept_response,
    problem_of,
    reduced_in_log,
    used_response,
)
from geoident.workflow.estimating.step_error import (
    FittedSteps,
    fitted_steps,
    judged_steps,
    takes_steps,
    with_step_error,
)
from geoident.workflow.estimating.surface_error import is_steady, with_surface_error
from geoident.workflow.running.cached_response import EXACT, answered_approximately, substituting
from geoident.workflow.running.control import OUT_OF_TIME, Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.readings import used_rows
from geoident.workflow.running.reduced_scan import with_reduced_readings

_SURFACES = 4
"""Times that the error of response surfaces is found again where the answer has moved."""


class SearchState(NamedTuple):
    """How far a search has come.

    Args:
        setup: with what was estimated of the errors of its readings.
        problem: the readings with their errors.
        outcome: of the search for the parameters.
    """

    setup: Setup
    problem: Problem
    outcome: Outcome


def estimated(
    setup: Setup,
    methods: Sequence[MethodOptions],
    log: Log,
    control: Control,
    *,
    start: Floats | None = None,
    near: bool = False,
) -> SearchState:
    """The parameters that meet the readings of a setup, and all that is estimated with them.

    The surrogate answers linearised steps wherever it is `CERTAIN`, and a search that begins where
    another ended wherever it is `EXACT`. At the end the model itself is asked unless it is
    `CERTAIN`.

    Where ground yields, a search that begins where another ended weighs the readings there: what
    they would say without model error is not asked for.

    Everything that is said of an estimate (assessment, diagnostics, predictions) is computed from
    the problem that comes back.

    Args:
        setup: model and selected readings.
        methods: the identifiers to run, one after the other.
        log: takes what is evaluated, and gives it again.
        control: progress, budget and stops.
        start: (n,) where to begin, SI; None for the start values of the case.
        near: another fit of the same model has ended there.

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
        kept, beside = kept_response(setup), reduced_in_log(setup, log)
        problem = with_reduced_readings(problem, used_response(setup), only, kept, beside)
    search = _Search(methods, control)
    linear = all(isinstance(options, GaussNewtonOptions) for options in methods)
    tolerance = EXACT if near else CERTAIN
    weighed = near and starts_warm(problem.response)
    if weighed and no_model_error(setup.case, setup.readings, methods) is None:
        unsearched = _where_it_begins(problem)
        state = search.with_all_errors(SearchState(setup, problem, unsearched))
        if state.outcome is not unsearched:
            return state
    with substituting(problem.response, tolerance) if near or linear else nullcontext():
        first = SearchState(setup, problem, search.identified(problem, methods))
    try:
        return search.with_all_errors(first)
    except TimeIsUp:
        cut = replace(first.outcome, status=STOPPED, reason=OUT_OF_TIME)
        return first._replace(outcome=cut)


def _where_it_begins(problem: Problem) -> Outcome:
    """The start of a problem as if a search had ended there."""
    start = Scaling(problem.parameters)
    values = start.to_natural(start.start)
    phi = Discrepancy(problem).linearize(values).objective
    return Outcome(values, phi, "converged", "Another search has ended here.", ())


@dataclass(frozen=True)
class _Search:
    """Methods of a search, and what it obeys. All that runs may be interrupted.

    Args:
        methods: the identifiers to run, one after the other.
        control: progress, budget and stops.
    """

    methods: Sequence[MethodOptions]
    control: Control

    def identified(self, problem: Problem, methods: Sequence[MethodOptions]) -> Outcome:
        """Run identifiers, one after the other."""
        outcome = identify(problem, methods, self.control.on_iteration)
        self.control.stop.check()
        return outcome

    def descent(self, problem: Problem) -> Outcome:
        """One descent from where a problem begins, by the last method's steps."""
        outcome = descend(problem, self.methods[-1], self.control.on_iteration)
        self.control.stop.check()
        return outcome

    def with_all_errors(self, first: SearchState) -> SearchState:
        """The same with the errors of the mesh, of the gauges and of the model.

        Raises:
            TimeIsUp: the time ended within an evaluation that they need.
        """
        problem, minima = first.problem, first.outcome.minima
        with substituting(problem.response):
            begun = self._with_steps(self._with_mesh(self._with_surfaces(first)))
            state = self._with_errors(begun)
            mesh = _mesh_beside_accuracies(state.setup, problem, state.outcome)
            steps = _steps_beside_accuracies(state.setup, problem, state.outcome)
            if mesh is not None or steps is not None:
                begun = begun._replace(problem=problem)
                if mesh is not None:
                    begun = self._counted(begun, mesh)
                if steps is not None:
                    begun = self._counted_steps(begun, steps)
                state = self._with_errors(begun)
        state = self._confirmed(state)
        if state.problem is problem or not minima:
            return state
        # the weights are others now, and so are the minima
        outcome = kept_up(state.problem, state.outcome, minima, self.descent)
        lowest = outcome.minima[0] if outcome.minima else None
        if lowest is None or lowest.objective >= outcome.objective - LOWER:
            return state._replace(outcome=outcome)
        # what was estimated with the parameters belongs to another minimum
        former = LocalMinimum(outcome.values, outcome.objective)
        moved = begun.problem.begun_at(lowest.values)
        state = self._with_errors(SearchState(begun.setup, moved, self.descent(moved)))
        outcome = kept_up(state.problem, state.outcome, [former, *minima], self.descent)
        return state._replace(outcome=outcome)

    def _with_surfaces(self, at: SearchState) -> SearchState:
        """The same with the error of the response surfaces of a table, as it is at the answer."""
        model = at.setup.model
        if not isinstance(model, TableModel) or at.outcome.status == STOPPED:
            return at
        for _ in range(_SURFACES):
            before, case = (
                at.setup.case,
                with_surface_error(at.setup.case, model, at.outcome.values),
            )
            at = self._weighed(at, case)
            if is_steady(before, case):
                break
        surface = model.surface_table(at.outcome.values)
        return at._replace(setup=replace(at.setup, surface=surface))

    def _weighed(self, at: SearchState, case: Case) -> SearchState:
        """The same with the errors of another version of the case, from where it has come."""
        setup, problem, outcome = at
        setup = setup.with_case(case)
        sd, shared = setup.errors.stated
        problem = replace(problem, sd=sd, shared=shared).begun_at(outcome.values)
        if isinstance(self.methods[-1], ScanOptions):
            again = self.identified(problem, self.methods)
        else:
            again = after(outcome, self.descent(problem))
        return SearchState(setup, problem, again)

    def _with_mesh(self, at: SearchState) -> SearchState:
        """The same with the error of the mesh among those of the readings, where it matters."""
        setup, problem, outcome = at
        case, model, last = setup.case, setup.model, self.methods[-1]
        asked = case.fit.mesh_error and not any(c.errors and c.errors.mesh for c in case.channels)
        plain = not isinstance(last, ScanOptions) and not _proves(last)
        if not (asked and plain and isinstance(model, StagedModel)) or outcome.status == STOPPED:
            return at._replace(setup=setup.not_asked_of_the_mesh())
        mesh = fitted_mesh(model, problem, setup.readings, outcome, setup.mesh)
        if mesh is None or not mesh.counts:
            return at._replace(setup=replace(setup, mesh=mesh))
        return self._counted(at, mesh)

    def _counted(self, at: SearchState, mesh: FittedMesh) -> SearchState:
        """The same with the error of the mesh among those of the readings."""
        weighed = self._weighed(at, with_mesh_error(at.setup.case, mesh.table))
        return weighed._replace(setup=replace(weighed.setup, mesh=mesh))

    def _with_steps(self, at: SearchState) -> SearchState:
        """The same with the error by the steps in time among those of the readings."""
        setup, outcome, last = at.setup, at.outcome, self.methods[-1]
        model, known = setup.model, any(c.errors and c.errors.steps for c in setup.case.channels)
        plain = not isinstance(last, ScanOptions) and not _proves(last)
        asked = plain and not known and takes_steps(setup.case) and outcome.status != STOPPED
        if not asked or not isinstance(model, StagedModel):
            return at._replace(setup=setup.not_asked_of_the_steps())
        pairs = setup.readings.used_pairs
        steps = fitted_steps(model, at.problem, pairs, outcome, setup.steps)
        if steps is None or not steps.counts:
            return at._replace(setup=replace(setup, steps=steps))
        return self._counted_steps(at, steps)

    def _counted_steps(self, at: SearchState, steps: FittedSteps) -> SearchState:
        """The same with the error by the steps in time among those of the readings."""
        weighed = self._weighed(at, with_step_error(at.setup.case, steps.table))
        return weighed._replace(setup=replace(weighed.setup, steps=steps))

    def _with_errors(self, at: SearchState) -> SearchState:
        """The same with all errors that are estimated: those of the model and of the gauges."""
        state = None
        if no_model_error(at.setup.case, at.setup.readings, self.methods) is None:
            state = self._with_model_error(at)
        return self._with_accuracies(at) if state is None else state

    def _confirmed(self, at: SearchState) -> SearchState:
        """The same, confirmed by the model itself where the surrogate has answered nearly."""
        _, problem, outcome = at
        if outcome.status == STOPPED or not answered_approximately(
            problem.response, outcome.values
        ):
            return at
        again = self.descent(problem.begun_at(outcome.values))
        return at._replace(outcome=after(outcome, again))

    def _with_model_error(self, at: SearchState) -> SearchState | None:
        """The same with the model error, and with accuracies that the case wants estimated.

        None where no reading can have a model error.
        """
        setup = at.setup
        case, readings = setup.case, setup.readings
        length = correlation_length(case, case.fit.model_error)
        rows = used_rows(case, readings.used)
        pairs = readings.used_pairs
        time = correlation_time(case, case.fit.model_error, pairs)
        structure = setup.errors
        search = ModelErrorSearch(
            case.fit.model_error,
            length,
            time,
            structure,
            tuple(channel for channel, _ in rows),
            lambda increments: reading_steps(case, setup.model, increments, pairs, length, time),
            self.descent,
            isinstance(case.fit.loss, SquaredOptions),
            errs_in_common(case),
        )
        fitted = search.run(at.problem, at.outcome)
        if fitted is None:
            return None
        again = replace(setup, model_error=fitted.model_error)
        if structure.names:
            again = _sized(again, structure, fitted.components)
        elif search.scatters:
            again = _scattering(again, fitted.model_error)
        known = fitted.model_error.of_readings(used_rows(again.case, readings.used))
        again = replace(again, model_error=known)
        return SearchState(again, fitted.problem, fitted.outcome)

    def _with_accuracies(self, at: SearchState) -> SearchState:
        """The same with the accuracies that the case wants estimated, if it wants any."""
        structure = at.setup.errors
        if not structure.names:
            return at
        onwards = continued(self.methods)
        fitted = weighed(
            at.problem, structure, at.outcome, lambda again: self.identified(again, onwards)
        )
        setup = _sized(at.setup, structure, fitted.components)
        return SearchState(setup, fitted.problem, fitted.outcome)


def _mesh_beside_accuracies(setup: Setup, problem: Problem, outcome: Outcome) -> FittedMesh | None:
    """The mesh, where it counts beside the accuracies that were estimated and not before.

    Gauges that turn out to be better than stated notice a mesh that was fine enough before.

    Args:
        setup: with the accuracies that were estimated.
        problem: the readings, without errors of mesh and model.
        outcome: of the search.
    """
    mesh, case = setup.mesh, setup.case
    if mesh is None or mesh.counts or setup.accuracies is None or outcome.status == STOPPED:
        return None
    sd, shared = setup.errors.stated
    accuracy = case.accuracies
    estimated = replace(mesh.table, accuracy=accuracy)
    again = replace(problem, sd=sd, shared=shared)
    judged = judged_mesh(estimated, again, setup.readings.used_pairs, outcome)
    if not judged.counts:
        return None
    if mesh.whole or not isinstance(setup.model, StagedModel):
        return replace(judged, spent=mesh.spent)
    before = setup.model.counts
    whole = everywhere(setup.model, problem, outcome)
    spent = mesh.spent + (setup.model.counts - before) + whole.cost
    return replace(judged, table=replace(whole, accuracy=accuracy), spent=spent)


def _steps_beside_accuracies(
    setup: Setup, problem: Problem, outcome: Outcome
) -> FittedSteps | None:
    """The steps in time, where they count beside estimated accuracies and not before; likewise."""
    steps, case = setup.steps, setup.case
    if steps is None or steps.counts or setup.accuracies is None or outcome.status == STOPPED:
        return None
    sd, shared = setup.errors.stated
    again = replace(problem, sd=sd, shared=shared)
    table = replace(steps.table, accuracy=case.accuracies)
    judged = judged_steps(table, case, again, setup.readings.used_pairs, outcome)
    return replace(judged, spent=steps.spent) if judged.counts else None


def _proves(options: MethodOptions) -> bool:
    """Whether a method proves a bound, of the problem as it is given."""
    return isinstance(options, ComplementarityOptions) and options.formulation == "global"


def _scattering(setup: Setup, model_error: FittedModelError) -> Setup:
    """The setup with the errors of gauges that were found with the model error."""
    case = with_scatter(setup.case, model_error.factor, model_error.zero)
    return replace(setup.with_case(case), stated=setup.case)


def _sized(setup: Setup, structure: ErrorStructure, components: VarianceComponents) -> Setup:
    """The setup with the accuracies that were estimated."""
    root = np.exp(0.5 * components.log_factor)
    factors = dict(zip(structure.names, map(float, root), strict=True))
    sized = with_accuracies(setup.case, factors)
    table = accuracy_table(setup.case, structure.names, components)
    return replace(setup.with_case(sized), accuracies=table)
