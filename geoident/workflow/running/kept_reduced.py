"""Reduced models that results keep: made at the end of a fit, asked by later commands.

A kept model answers for the case and the mesh of which it was made (theory 14.7). What no
computation of readings sees may be another: start values, bounds and priors of parameters (between
its own bounds), readings, accuracies, how to fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from geoident.errors import Fault, InputError, Location
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.forward.reduced.case_model import ReducedCaseModel
from geoident.forward.reduced.kept import RestoredModel, kept_model
from geoident.forward.reduced.stress_rows import beyond_reduction
from geoident.forward.reducible import ReducibleResponse
from geoident.io.case.file import parse_case
from geoident.io.result.file import read_result
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.arrays import Floats
from geoident.model.case import Case, KeyPath, format_path
from geoident.model.moments import with_states
from geoident.model.parameter import Parameter
from geoident.model.results.reduced import FORM, KeptReducedModel
from geoident.model.results.result import ParameterTable, Result
from geoident.workflow.running.answers import readable
from geoident.workflow.running.computed import accuracies
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import NO_READINGS, Inputs
from geoident.workflow.running.reduced_answers import CLOSE, MOST_ANALYSES, reduced_around
from geoident.workflow.running.result_files import case_path

_UNSEEN = frozenset({"title", "report", "fit", "readings", "parameters", "gauges"})
"""Sections of a case that a kept model does not ask for, or of which only parts."""

_OF_GAUGES = frozenset({"accuracy", "errors"})
"""What is said of a gauge and of no number that it reads."""

_DRAWS = 40
_WIDER = 1.5
"""How much wider draws are spread than the approximation of the posterior."""

NONE = "No reduced model is kept: {}."


def spread_around(table: ParameterTable, parameters: Sequence[Parameter]) -> Floats:
    """Some draws (k, n) of the approximation of the posterior at a fit, half again as wide.

    What the fit does not know is spread over its bounds.

    Args:
        table: of the fit.
        parameters: the n of them.
    """
    rng = np.random.default_rng(0)
    p, n = table.values, len(table.values)
    known = np.isfinite(np.diag(table.covariance))
    covariance = np.where(known[:, None] & known, table.covariance, 0.0)
    steps = _WIDER * rng.multivariate_normal(
        np.zeros(n), covariance, size=_DRAWS, method="svd", check_valid="ignore"
    )  # numbers of parameters on their own paths need not make one posterior
    log = np.array([q.scale == "log" for q in parameters])
    size = np.where(log, p, 1.0)
    grown = p * np.exp(np.clip(steps / size, -3.0, 3.0))
    ends = np.array([(q.lower, q.upper) for q in parameters])
    points = np.clip(np.where(log, grown, p + steps), ends[:, 0], ends[:, 1])
    for k in np.flatnonzero(~known):
        low, high = np.log(ends[k]) if log[k] else ends[k]
        even = low + (high - low) * rng.random(_DRAWS)
        points[:, k] = np.exp(even) if log[k] else even
    return points


def made_to_keep(
    model: ObservedModel,
    case: Case,
    table: ParameterTable,
    control: Control,
    others: Sequence[Floats] = (),
) -> KeptReducedModel | str:
    """The reduced model of a fit, of all that its gauges can read; else why there is none.

    Args:
        model: of the case.
        case: the case.
        table: what the fit found.
        control: says whether there is time.
        others: (n,) parameters of its other minima: there it is exact, too.
    """
    if not isinstance(model, StagedModel):
        return NONE.format("the case is a closed form and needs none")
    places = readable(model, case)
    linear = [
        beyond_reduction(model.analysis, model.gauges, places[k : k + 1, 0]) is None
        for k in range(len(places))
    ]
    pairs = [(case.channels[i].name, case.stages[j].name) for i, j in places[linear].tolist()]
    if not pairs:
        return NONE.format("no gauge reads what it covers")
    response = model.response(pairs)
    assert isinstance(response, ReducibleResponse)
    training = spread_around(table, case.parameters)
    reduced = reduced_around(response, table.values, training, MOST_ANALYSES, also=others)
    if reduced is None:
        why = "no time was left to make it" if control.over() else "the model has no solution near"
        return NONE.format(response.surrogate_obstacle() or why)
    return kept_model(reduced, model, response.visited())


def restored_of(fit: Result, case: Case) -> RestoredModel | None:
    """The reduced model that a result keeps, with its case; None where it keeps none of this form.

    Args:
        fit: the result.
        case: of the result.
    """
    if fit.reduced is None or fit.reduced.form != FORM:
        return None
    return RestoredModel(fit.reduced, case)


def restored_alone(result: Result, path: str) -> RestoredModel | None:
    """The same from the result alone: its mesh and its readings need not be there.

    Args:
        result: of a fit.
        path: of its file.

    Raises:
        InputError: the case in it cannot be read as this version reads it.
    """
    if result.reduced is None:
        return None
    where = case_path(path, result.provenance.case_file)
    loaded = parse_case(
        result.case_resolved, where, overrides=[NO_READINGS], with_mesh=False, with_texts=False
    )
    return restored_of(result, with_states(loaded.case, result.gauges.stages))


def restored_for(path: str, inputs: Inputs) -> RestoredModel:
    """The reduced model that a result keeps, for a case that is the same in all that it computes.

    Args:
        path: of the result.
        inputs: the case.

    Raises:
        InputError: it keeps none, or that of another case or mesh; says which.
    """
    result = read_result(path)
    why, hint = _refusal(result, inputs)
    if why:
        raise InputError([Fault("no-reduced-model", why, hint, Location(path))])
    restored = restored_of(result, inputs.case)
    assert restored is not None
    return restored


def _refusal(result: Result, inputs: Inputs) -> tuple[str, str]:
    """Why a result has no reduced model for a case, and what to do; empty if it has."""
    if result.reduced is None:
        why = next((f.sentence for f in result.findings if f.kind == "no-reduced-model"), "")
        hint = "Leave it out." if why else "Write 'reduced: keep' under 'fit' and fit again."
        return why or "the result keeps no reduced model", hint
    again = "Write 'reduced: keep' under 'fit' and fit this case, or leave the reduced model out."
    if result.reduced.form != FORM:
        return f"its reduced model is of the form {result.reduced.form!r}, not {FORM!r}", again
    if result.provenance.mesh_sha256 != inputs.mesh_sha256:
        return "its reduced model is of another mesh: the file has changed since", again
    now = parse_yaml(inputs.loaded.resolved, inputs.path).data
    before = parse_yaml(result.case_resolved, inputs.path).data
    differs = _first_difference(_seen(before), _seen(now), ())
    if differs is None:
        if tuple(channel.name for channel in inputs.case.channels) != result.reduced.channels:
            return "its reduced model is of gauges in another order", again
        return "", ""
    path, one, other = differs
    return (
        f"its reduced model is of another case: {format_path(path)} was {_said(one)}, "
        f"it is {_said(other)}",
        again,
    )


def _seen(case: object) -> dict[str, object]:
    """What readings depend on, but for the values of parameters."""
    assert isinstance(case, Mapping)
    seen = {key: value for key, value in case.items() if key not in _UNSEEN}
    seen["parameters"] = dict.fromkeys(case.get("parameters", {}), "sought")
    gauges = case.get("gauges", {})
    seen["gauges"] = {
        name: {k: v for k, v in one.items() if k not in _OF_GAUGES}
        if isinstance(one, Mapping)
        else one
        for name, one in gauges.items()
    }
    return seen


def _first_difference(
    before: object, now: object, path: KeyPath
) -> tuple[KeyPath, object, object] | None:
    """The first key with two values; None where all is the same."""
    if path == ("mesh", "file"):  # what is in it is compared
        return None
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys((*before, *now)):
            difference = _first_difference(before.get(key), now.get(key), (*path, key))
            if difference is not None:
                return difference
        return None
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for n, (one, other) in enumerate(zip(before, now, strict=True)):
            difference = _first_difference(one, other, (*path, n))
            if difference is not None:
                return difference
        return None
    return None if before == now else (path, before, now)


def _said(value: object) -> str:
    if value is None:
        return "not there"
    return "something else" if isinstance(value, Mapping | list) else str(value)


def answered(
    restored: RestoredModel, case: Case, build: Callable[[], ObservedModel]
) -> ReducedCaseModel:
    """A case whose readings are those of a kept reduced model where that is close enough.

    Args:
        restored: the reduced model.
        case: with the accuracies that count.
        build: makes the model on the mesh.
    """
    return ReducedCaseModel(restored, CLOSE * accuracies(case), build)


def answer_note(model: ReducedCaseModel, path: str) -> str:
    """Whose the readings are, a sentence.

    Args:
        model: that was asked.
        path: of the result that keeps the reduced model.
    """
    if not model.by_reduced:
        return (
            f"The reduced model kept in {path} is not estimated to be close enough there: all is "
            "computed by the full model."
        )
    rest = "" if not model.by_model else f"; {model.by_model} are of the full model"
    times = "one parameter vector" if model.by_reduced == 1 else f"{model.by_reduced} vectors"
    return (
        f"The readings at {times} are those of the reduced model kept in {path}, "
        f"estimated to be off by at most {_percent(CLOSE * model.worst)} of their accuracies{rest}."
    )


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %" if part >= 1e-4 else "0.01 %"
