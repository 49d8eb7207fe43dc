"""``--safety``: factors of safety by strength reduction, of a case or with bands of a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from geoident.errors import InputError, ModelError, UsageError
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
from geoident.model.results.result import Result
from geoident.model.results.safety import SafetyBand, SafetyFactor
from geoident.model.results.times import StageTimes
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.from_fit import known_by_fit, read_fit, require_same_mesh
from geoident.workflow.factors_at_draws import factors_at_draws
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import NO_READINGS, build_model, load_inputs, require_stages
from geoident.workflow.running.result_files import files_of_result
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


@dataclass(frozen=True)
class Safety:
    """Factors of safety.

    Args:
        path: of the case or fit.
        case: the case.
        factors: of its stages.
        bands: of the same, where there is a fit.
        poor: the model of the fit does not fit the readings.
        files_read: paths that no output may replace.
    """

    path: str
    case: Case
    factors: tuple[SafetyFactor, ...]
    bands: tuple[SafetyBand, ...]
    poor: bool
    files_read: tuple[str, ...]

    @property
    def status(self) -> str:
        """How sure it is: ``done``, ``poor-fit`` or ``not-determined``."""
        if self.poor:
            return "poor-fit"
        return "not-determined" if any(band.left_open for band in self.bands) else "done"

    @property
    def critical(self) -> SafetyFactor:
        """The smallest factor."""
        return min(self.factors, key=lambda one: one.value)


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
    found = Safety(asked.path, model.case, factors, (), False, files)
    if asked.fields is not None:
        _write_fields(model, p, found, asked)
    return found


@one_thread()
def safety_of_fit(asked: SafetyRequest, control: Control) -> Safety:
    """Factors of safety at the values of a fit, and what their posterior makes of them.

    Raises:
        InputError: the result is no fit, or nothing in its case has strength to be divided.
        UsageError: there is no such stage, or the case is not computed stage by stage on a mesh.
        ModelError: the model has no solution even with much more strength.
        OutputError: the fields cannot be written.
    """
    fit, inputs = read_fit(asked.path, "predicted")
    require_same_mesh(fit, inputs, "Run the fit again.")
    model = _staged(build_model(inputs, solver=asked.solver))
    case, p = inputs.case, fit.parameters.values
    states = _states(model, asked.stages)
    require_same_modes(fit, model, case, p)
    order = np.array([fit.parameters.names.index(name) for name in model.names], dtype=np.int64)
    p = p[order]
    assessment = _assessment(fit, model, case, p)
    parts = ModelParts.of(model, case, asked.solver)
    assert parts is not None  # a staged model has them
    at_draws = partial(factors_at_draws, model, parts, control)
    factors = _factors(model, p, states, control)
    seed = fit.provenance.seed if asked.seed is None else asked.seed
    bands = tuple(
        _band(model, p, state, best, assessment, asked.draws, seed, at_draws)
        for state, best in zip(states, factors, strict=True)
    )
    files = (*files_of_result(fit, asked.path), *inputs.files)
    found = Safety(asked.path, case, factors, bands, fit.status == "poor-fit", files)
    if asked.fields is not None:
        _write_fields(model, p, found, asked)
    return found


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
) -> SafetyBand:
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
    return SafetyBand(
        best=best,
        lower95=float(lower),
        median=float(median),
        upper95=float(upper),
        below_one=band.below,
        below_one_sd=band.below_sd,
        names=model.names,
        draws=np.array(points),
        factors=np.exp(y),
        bounded=bounded,
        surface="quadratic" if band.surface.quadratic else "linear",
        left=band.surface.left,
        influence=np.asarray(axes @ band.surface.coefficients[1 : 1 + axes.shape[1]])
        * many.std(axis=0),
        undetermined=tuple(
            name
            for name, known_, prior in zip(
                model.names, assessment.determined, assessment.from_prior, strict=True
            )
            if not (known_ or prior)
        ),
        counted=int(np.count_nonzero(y[known] < 0.0)),
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


def _write_fields(model: StagedModel, p: Floats, found: Safety, asked: SafetyRequest) -> None:
    """Write the states and the mechanism of the smallest factor."""
    assert asked.fields is not None
    with atomic_output(asked.fields, overwrite=asked.force, inputs=found.files_read) as temporary:
        fields, times = model.fields_up_to_collapse(p), StageTimes.of(model.case)
        with hdf5_output(temporary) as written:
            write_fields(
                written,
                fields,
                mechanism=found.critical.mechanism,
                times=None if times is None else times.series,
            )
            add_principal_stresses(written)
