"""``--safety``: factors of safety by strength reduction, of a case or with bands of a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geoident.errors import ExitCode, InputError, ModelError, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.forward.safety.search import Search, safety_factors
from geoident.forward.safety.strengths import reducible
from geoident.identify.assessment.scalar_band import scalar_band
from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.problem.scaling import Scaling
from geoident.io.bridges.values import read_values
from geoident.io.result.hdf5 import hdf5_output
from geoident.io.result.vtkhdf import add_principal_stresses, write_fields
from geoident.io.text.atomic import atomic_output
from geoident.io.text.wording import nearest
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.moments import stage_and_time
from geoident.model.results.result import FieldSeries, Result
from geoident.model.results.safety import SafetyFactor, StageSafety, alike, depends_on
from geoident.model.results.times import StageTimes
from geoident.model.results.yielded import Mechanism
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.finished import Finished, job_at_hand
from geoident.workflow.estimating.from_fit import (
    FitTask,
    known_by_fit,
    plan_on_fit,
    read_fit,
    require_same_mesh,
)
from geoident.workflow.factors_at_draws import factors_at_draws
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import (
    NO_READINGS,
    Request,
    build_model,
    job_provenance,
    load_inputs,
    require_stages,
)
from geoident.workflow.running.workers import ModelParts
from geoident.workflow.simulate import values_for, with_starts

DRAWS = 30
"""Draws of the posterior at which a factor is computed."""

_MANY = 20_000
"""Draws at which the surface through them is asked."""


@dataclass(frozen=True)
class SafetyRequest:
    """What is asked.

    Args:
        path: of the case or of the result of a fit.
        stages: names; the last one if empty.
        overrides: ``KEY=VALUE`` in place of what the case says.
        values: path of a table of values of parameters in place of their starts, or None.
        text: of the case where it stands in no file.
        solver: name of the sparse solver, or ``auto``.
        fields: file for the states and the mechanism, as VTKHDF; or None.
        force: replace what stands there.
        draws: of the posterior at which the factor is computed.
        seed: of these; None for that of the fit.
        output: file or folder of the result of a fit; beside it if None.
        fresh: compute again what is up to date.
    """

    path: str
    stages: tuple[str, ...] = ()
    overrides: tuple[str, ...] = ()
    values: str | None = None
    text: str | None = None
    solver: str = "auto"
    fields: str | None = None
    force: bool = False
    draws: int = DRAWS
    seed: int | None = None
    output: str | None = None
    fresh: bool = False


@dataclass(frozen=True)
class Safety:
    """Factors of safety.

    Args:
        path: of the case or fit.
        rows: of its stages.
        names: of the n parameters.
        mechanism: of the smallest factor, or None.
        status: how sure it is: ``done``, ``poor-fit`` or ``not-determined``.
        files_read: paths that no output may replace.
        finished: the result, of a fit.
    """

    path: str
    rows: tuple[StageSafety, ...]
    names: tuple[str, ...]
    mechanism: Mechanism | None
    status: str
    files_read: tuple[str, ...]
    finished: Finished | None = None

    @property
    def poor(self) -> bool:
        """Whether the model of the fit does not fit the readings."""
        return self.status == "poor-fit"

    @property
    def critical(self) -> StageSafety:
        """The stage of the smallest factor."""
        return min(self.rows, key=lambda one: one.value)


@one_thread()
def safety_of_case(asked: SafetyRequest, control: Control) -> Safety:
    """Factors of safety at the start values of the parameters.

    Raises:
        InputError: the case is wrong, or nothing in it has strength that could be divided.
        UsageError: there is no such stage, or the case is not computed stage by stage on a mesh.
        ModelError: the model has no solution even with much more strength.
        OutputError: the fields cannot be written.
    """
    written = () if asked.values is None else read_values(asked.values)
    overrides = [*asked.overrides, NO_READINGS]
    inputs = load_inputs(asked.path, overrides=overrides, text=asked.text)
    require_stages(inputs.case)
    inputs = with_starts(inputs, written)
    model = _staged(build_model(inputs, solver=asked.solver))
    states = _states(model, asked.stages)
    p = values_for(model, written)
    files = inputs.files if asked.values is None else (*inputs.files, asked.values)
    factors = _factors(model, p, states, control)
    rows = tuple(StageSafety.of(one) for one in factors)
    mechanism = _mechanism(factors)
    if asked.fields is not None:
        fields = model.fields_up_to_collapse(p)
        _write_fields(model.case, fields, mechanism, asked, files)
    return Safety(asked.path, rows, model.names, mechanism, "done", files)


@dataclass(frozen=True, kw_only=True)
class SafetyTask(FitTask):
    """Factors of a fit that can be computed.

    Args:
        asked: what was asked for.
    """

    asked: SafetyRequest


def plan_safety(asked: SafetyRequest) -> SafetyTask:
    """Read a fit, and look at what stands where the result goes.

    Raises:
        InputError: the result is no fit, or its mesh has changed.
        OutputError: the result could not be written, or another one would be lost.
    """
    fit, inputs = read_fit(asked.path, "predicted")
    require_same_mesh(fit, inputs, "Run the fit again.")
    request = Request(
        asked.path,
        output=asked.output,
        seed=fit.provenance.seed if asked.seed is None else asked.seed,
        solver=asked.solver,
        force=asked.force,
        fresh=asked.fresh,
    )
    purpose = f"{asked.stages} {asked.draws}"
    return SafetyTask(
        fit=fit, job=plan_on_fit("safety", purpose, request, fit, inputs), asked=asked
    )


@one_thread()
def safety_of_fit(asked: SafetyRequest, control: Control) -> Safety:
    """Factors of safety at the values of a fit, and what their posterior makes of them.

    They are written, beside the fit if nothing else is said; those that are up to date are kept.

    Raises:
        InputError: the result is no fit, or nothing in its case has strength to be divided.
        UsageError: there is no such stage, or the case is not computed stage by stage on a mesh.
        ModelError: the model has no solution even with much more strength.
        OutputError: the result or the fields cannot be written.
    """
    task = plan_safety(asked)
    finished = job_at_hand(task.job)
    if finished is None:
        task.require_free()
        finished = task.write(_result(task, control))
    found = finished.result
    if asked.fields is not None:
        assert found.fields is not None
        case = task.job.inputs.case
        _write_fields(case, found.fields, found.mechanism, asked, task.files_read)
    return Safety(
        asked.path, found.safety, found.parameters.names, found.mechanism, found.status,
        task.files_read, finished,
    )  # fmt: skip


def _result(task: SafetyTask, control: Control) -> Result:
    """The fit with factors of safety in place of what a search ends with."""
    fit, case, asked = task.fit, task.job.inputs.case, task.asked
    model = _staged(build_model(task.job.inputs, solver=asked.solver))
    states = _states(model, asked.stages)
    require_same_modes(fit, model, case, fit.parameters.values)
    order = np.array([fit.parameters.names.index(name) for name in model.names], dtype=np.int64)
    parameters = fit.parameters.picked(order)
    p = parameters.values
    assessment = _assessment(fit, model, case, p)
    parts = ModelParts.of(model, case, asked.solver)
    assert parts is not None  # a staged model has them
    at_draws = partial(factors_at_draws, model, parts, control)
    factors = _factors(model, p, states, control)
    seed = task.job.request.seed
    rows = alike(
        [
            _band(model, p, state, best, assessment, asked.draws, seed, at_draws)
            for state, best in zip(states, factors, strict=True)
        ]
    )
    status = "not-determined" if any(row.undetermined for row in rows) else "done"
    if fit.status == "poor-fit":
        status = "poor-fit"
    return Result(
        kind="safety",
        status=status,
        exit_code=ExitCode.DONE if status == "done" else ExitCode.NOT_CONVERGED,
        method="strength reduction",
        reason=f"Factors of safety from {asked.path} ({fit.status}).",
        objective=fit.objective,
        findings=fit.findings,
        case_text=task.job.inputs.loaded.text,
        case_resolved=task.job.inputs.loaded.resolved,
        provenance=job_provenance(task.job),
        parameters=parameters,
        gauges=fit.gauges,
        counts=model.counts,
        singular_values=fit.singular_values,
        varied=fit.varied,
        fields=model.fields_up_to_collapse(p),
        mechanism=_mechanism(factors),
        safety=rows,
    )


def _mechanism(factors: Sequence[SafetyFactor]) -> Mechanism | None:
    """That of the smallest factor."""
    return min(factors, key=lambda one: one.value).mechanism


def _staged(model: ObservedModel) -> StagedModel:
    """The model, if its strength can be reduced.

    Raises:
        UsageError: it has no mesh.
    """
    if not isinstance(model, StagedModel):
        raise UsageError(
            "Strength is reduced in cases that geoident computes on a mesh, stage by stage; this "
            "one is computed in another way."
        )
    return model


def _states(model: StagedModel, wanted: Sequence[str]) -> list[int]:
    """The numbers of the states whose factors are wanted, ascending.

    Raises:
        UsageError: there is no such stage.
        InputError: nothing in one of them has strength that could be divided.
    """
    case = model.case
    names = [stage.name for stage in case.stages]
    for name in wanted:
        moment = stage_and_time(name, {stage.whole for stage in case.stages if stage.lasts})
        if name not in names and moment is not None:
            raise UsageError(
                f"The case has no moment '{name}'; its states are: {', '.join(names)}. Add "
                f"'moments: [{moment[1]}]' to the stage '{moment[0]}', with other moments that you "
                "want."
            )
        if name not in names:
            near = nearest(name, names)
            more = f" Did you mean '{near}'?" if near else ""
            raise UsageError(
                f"There is no stage '{name}'; the stages are: {', '.join(names)}.{more}"
            )
    states = sorted({1 + names.index(name) for name in wanted or names[-1:]})
    for state in (model.sequence.states[n] for n in states):
        present = [case.materials[name] for name in dict.fromkeys(state.materials.values())]
        parts = (part for part in model.structures.parts if part.joint is not None)
        slips = any(part.structure.yields and part.stands(state) for part in parts)
        if not slips and not any(reducible(material) for material in present):
            planes = any(material.yields for material in present)
            message = f"at stage '{state.name}' no ground and no interface has a strength that "
            message += "could be divided"
            message += ": given planes have no cohesion and friction" if planes else ""
            hint = "Give 'yield: {type: mohr-coulomb, cohesion: ..., friction: ...}' in a material."
            fault = case.source.fault(
                ("materials",), code="no-strength", message=message, hint=hint
            )
            raise InputError([fault])
    return states


def _factors(
    model: StagedModel, p: Floats, states: Sequence[int], control: Control
) -> tuple[SafetyFactor, ...]:
    def tell(words: str) -> None:
        control.stop.check()
        control.monitor.part(words, 0.0)

    return tuple(safety_factors(model, p, states, Search(tell=tell)))


def _assessment(fit: Result, model: StagedModel, case: Case, p: Floats) -> Assessment:
    """How well the fit knows its parameters, in the order of the model."""
    survey = model.survey(p, fields=False, partial=True)
    return known_by_fit(fit, case, model, case, survey, same_case=True, follow=False).assessment


def _drawn(assessment: Assessment, count: int, rng: np.random.Generator) -> Floats:
    """Steps (d, n) of the scaled parameters from the estimate, from the posterior."""
    posterior = assessment.posterior
    shift = posterior.shift[:, rng.choice(len(posterior.weight), count, p=posterior.weight)]
    normal = rng.standard_normal((posterior.factor.shape[1], count))
    return np.asarray((shift + posterior.factor @ normal).T)


def _band(
    model: StagedModel,
    p: Floats,
    state: int,
    best: SafetyFactor,
    assessment: Assessment,
    count: int,
    seed: int,
    at_draws: Callable[[Sequence[Floats], Floats, int, float], tuple[Floats, Ints]],
) -> StageSafety:
    """What a posterior makes of the factor of a stage.

    Raises:
        ModelError: it cannot be computed at most draws.
    """
    rng, scaling = np.random.default_rng([seed, state]), Scaling(model.case.parameters)
    steps = _drawn(assessment, count, rng)
    many = _drawn(assessment, _MANY, rng)
    axes = _axes(many)
    points = [scaling.away(p, step) for step in steps]
    z = steps @ axes
    y, bounded = at_draws(points, z, state, best.value)
    y = np.log(y)
    known = np.isfinite(y)
    if np.count_nonzero(known) < max(3, count // 2):
        raise ModelError(
            f"at {count - np.count_nonzero(known)} of {count} draws of the posterior the model has "
            f"no answer at stage '{best.stage}'",
            "The fit leaves parameters so open that a band means nothing: see `geoident show`.",
        )
    band = scalar_band(z[known], y[known], many @ axes, 0.0, rng)
    lower, median, upper = np.exp(band.quantiles)
    influence = np.asarray(axes @ band.surface.coefficients[1 : 1 + axes.shape[1]])
    influence *= many.std(axis=0)
    unknown = ~(np.array(assessment.determined) | np.array(assessment.from_prior))
    felt = depends_on(model.names, influence)
    return replace(
        StageSafety.of(best),
        lower95=float(lower),
        median=float(median),
        upper95=float(upper),
        below_one=band.below,
        below_one_sd=band.below_sd,
        counted=int(np.count_nonzero(y[known] < 0.0)),
        surface="quadratic" if band.surface.quadratic else "linear",
        left=band.surface.left,
        undetermined=", ".join(
            n for n, open_ in zip(model.names, unknown, strict=True) if open_ and n in felt
        ),
        influence=influence,
        factors=np.exp(y),
        bounded=bounded,
        draws=np.array(points),
    )


def _axes(steps: Floats) -> Floats:
    """(n, r) what makes independent coordinates of the size of one of steps (m, n).

    Directions in which nothing varies are left out.
    """
    sd = steps.std(axis=0)
    varies = sd > 0.0
    size = np.where(varies, sd, 1.0)
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov((steps[:, varies] / size[varies]).T)))
    kept = values > 1e-8 * values.max(initial=0.0)
    axes = np.zeros((steps.shape[1], int(np.count_nonzero(kept))))
    axes[varies] = vectors[:, kept] / np.sqrt(values[kept]) / size[varies, None]
    return axes


def _write_fields(
    case: Case,
    fields: FieldSeries,
    mechanism: Mechanism | None,
    asked: SafetyRequest,
    files_read: Sequence[str],
) -> None:
    """Write the states and the mechanism of the smallest factor."""
    assert asked.fields is not None
    with atomic_output(asked.fields, overwrite=asked.force, inputs=files_read) as temporary:
        times = StageTimes.of(case)
        with hdf5_output(temporary) as written:
            write_fields(
                written,
                fields,
                mechanism=mechanism,
                times=None if times is None else times.series,
            )
            add_principal_stresses(written)
