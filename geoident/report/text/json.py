"""Results as objects for other programs: the contract of ``--json``. All values in SI.

JSON knows no NaN and no infinity: both become null. A parameter that is not determined has the
value null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from geoident.errors import Fault, GeoidentError, InputError, ModelError, worded
from geoident.model.gauges import Channel, Reading
from geoident.model.parameter import Prior
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.result import Grid, ParameterTable, Result
from geoident.model.results.rivals import Evidence
from geoident.model.results.summary import CaseSummary, Identifiability
from geoident.report.text.accuracies import accuracies_list
from geoident.report.text.backtest import backtest_object
from geoident.report.text.errors.model_error import model_error_object
from geoident.report.text.errors.surface import surface_object
from geoident.report.text.gauges import each_reading, moment_text
from geoident.report.text.posterior import posterior_object
from geoident.report.text.residuals import compared_with, diagnostics_object
from geoident.report.text.rivals import models_object, rivals_list
from geoident.report.text.rows import attributes, by_stage, objects
from geoident.report.text.structures import structures_list
from geoident.report.text.varied import varied_list
from geoident.report.text.yielding import certificate_object
from geoident.units import si_unit


def dumps(value: Mapping[str, Any]) -> str:
    """One object on one line."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    """The same without what JSON does not know."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def result_object(
    result: Result, *, case: str, output: str, outdated: Sequence[str] = ()
) -> dict[str, Any]:
    """A result.

    Args:
        result: what was found.
        case: path of the case, as seen from here.
        output: path of the result file.
        outdated: paths of what was made from an earlier fit: of this result, or beside it.
    """
    proof, result = result.certificate, result.for_people
    return {
        "case": case,
        "kind": result.kind,
        "status": result.status,
        "exit_code": int(result.exit_code),
        "method": result.method,
        "reason": result.reason,
        "output": output,
        "objective": result.objective,
        "parameters": parameters_object(result.parameters),
        "gauges": gauges_list(result),
        "predictions": predictions_list(result),
        "readings": readings_list(result),
        "findings": [attributes(finding) for finding in result.findings],
        "notes": result.notes,
        **({"outdated": list(outdated)} if outdated else {}),
        "singular_values": result.singular_values,
        "diagnostics": diagnostics_object(result),
        "counts": asdict(result.counts),
        **(
            {"accuracies": accuracies_list(result.accuracies)}
            if result.accuracies is not None
            else {}
        ),
        **({"rivals": rivals_list(result)} if result.rivals is not None else {}),
        **({"comparison": models_object(result.comparison)} if result.comparison else {}),
        **({"evidence": evidence_object(result.evidence)} if result.evidence else {}),
        **({"backtest": backtest_object(result)} if result.backtest is not None else {}),
        **(
            {"model_error": model_error_object(result.model_error)}
            if result.model_error is not None
            else {}
        ),
        **({"surface": surface_object(result.surface)} if result.surface is not None else {}),
        **({"fields": varied_list(result.varied)} if result.varied else {}),
        **({"certificate": certificate_object(proof)} if proof is not None else {}),
        **({"structures": structures_list(result.members)} if result.members is not None else {}),
        **(
            {
                "reactions": objects(
                    result.reactions, "support", "state", rows=result.reactions.holding
                )
            }
            if result.reactions is not None
            else {}
        ),
        **({"yielded": objects(result.yielded, "state")} if result.yielded is not None else {}),
        **({"posterior": posterior_object(result)} if result.posterior is not None else {}),
        **({"opening": opening_object(result.reaction)} if result.reaction is not None else {}),
        **({"face": face_object(result.advance)} if result.advance is not None else {}),
        **({"grid": grid_object(result.grid)} if result.grid is not None else {}),
    }


def opening_object(reaction: GroundReaction) -> dict[str, Any]:
    """The closed form of an opening, SI; compression and motions inwards are positive.

    Args:
        reaction: its ground reaction curve, and its stages on their way along it.
    """
    curve = ("pressure", "displacement", "plastic_radius")
    return {
        **attributes(reaction),
        "centre": reaction.centre,
        "in_situ": dict(zip(reaction.components, reaction.in_situ, strict=True)),
        "curve": {name: getattr(reaction, name) for name in curve},
        "stages": objects(reaction, "stage"),
        "stresses": {
            "distance": reaction.radii,
            "radial": dict(zip(reaction.stages, reaction.radial, strict=True)),
            "hoop": dict(zip(reaction.stages, reaction.hoop, strict=True)),
        },
    }


def face_object(advance: FaceAdvance) -> dict[str, Any]:
    """An advancing tunnel face, SI: its profile, and what distances to it say of the stages."""
    return {
        **attributes(advance),
        "curve": {"distance": advance.distance, "share": advance.share},
        "stages": objects(advance, "stage"),
        "lost": advance.lost,
    }


def plan_object(case: str, plan: Identifiability) -> dict[str, Any]:
    """What planned gauges could determine, at the start values."""
    return {
        "case": case,
        "readings": plan.readings,
        "parameters": parameters_object(plan.parameters),
        "findings": [attributes(finding) for finding in plan.findings],
        "singular_values": plan.singular_values,
    }


def parameters_object(parameters: ParameterTable) -> dict[str, Any]:
    """Name to value, interval and what else is known."""
    quantities = {"parameter": list(zip(parameters.units, parameters.dimensions, strict=True))}
    rows = objects(parameters, "parameter", quantities=quantities)
    return {
        row.pop("parameter"): {**row, **_prior_object(prior)}
        for row, prior in zip(rows, parameters.priors, strict=True)
    }


def _prior_object(prior: Prior | None) -> dict[str, Any]:
    return {
        "prior": None if prior is None else str(prior),
        "prior_kind": None if prior is None else prior.kind,
        "prior_mean": None if prior is None else prior.mean,
        "prior_sd": None if prior is None else prior.sd,
    }


def gauges_list(result: Result) -> list[dict[str, Any]]:
    """One object for every reading that is measured or computed, stage by stage.

    In a backtest ``computed`` and ``sd`` are those of the prediction by the last fit before.
    """
    gauges, (computed, sd) = result.gauges, compared_with(result)
    known = np.isfinite(gauges.measured) | np.isfinite(computed)
    return [
        {
            "gauge": gauges.channels[i],
            "stage": gauges.stages[j],
            "measured": gauges.measured[i, j],
            "computed": computed[i, j],
            "sd": sd[i, j],
            "used": bool(gauges.used[i, j]),
            "bad": bool(gauges.bad[i, j]),
            "unit": si_unit(gauges.dimensions[i]),
        }
        for i, j in by_stage(known)
    ]


def readings_list(result: Result) -> list[dict[str, Any]]:
    """One object for every reading, in the order of the files, with the reason why it is unused."""
    readings = each_reading(result.gauges)
    units = [si_unit(reading.pop("shown")[1]) for reading in readings]
    return [{**reading, "unit": unit} for reading, unit in zip(readings, units, strict=True)]


def predictions_list(result: Result) -> list[dict[str, Any]]:
    """One object for every predicted reading, stage by stage; sd null where not determined."""
    prediction, gauges = result.prediction, result.gauges
    if prediction is None:
        return []
    places = by_stage(np.isfinite(prediction.mean))
    return [
        {
            "gauge": gauges.channels[i],
            "stage": gauges.stages[j],
            **row,
            "measured": gauges.measured[i, j],
            "determined": bool(prediction.known[i, j]),
            "unit": si_unit(gauges.dimensions[i]),
        }
        for (i, j), row in zip(
            places, objects(prediction, "gauge", "stage", rows=places), strict=True
        )
    ]


def evidence_object(evidence: Evidence) -> dict[str, Any]:
    """How well the model explains the readings."""
    return {**attributes(evidence), "log_occam": evidence.log_occam}


def grid_object(grid: Grid) -> dict[str, Any]:
    """A scan: null where the model has no solution."""
    return {
        "axes": dict(zip(grid.names, grid.axes, strict=True)),
        "objective": grid.objective,
    }


def simulation_object(
    readings: Sequence[Reading], channels: Sequence[Channel], *, case: str, output: str | None
) -> dict[str, Any]:
    """Readings of the model, SI.

    Args:
        readings: of the model.
        channels: of the case.
        case: path of the case.
        output: path of the file that was written, or None.
    """
    dimensions = {channel.name: channel.dimension for channel in channels}
    return {
        "case": case,
        "kind": "simulate",
        "status": "done",
        "exit_code": 0,
        "output": output,
        "readings": [
            {
                "gauge": reading.channel,
                "stage": reading.stage,
                "value": reading.value,
                "unit": si_unit(dimensions[reading.channel]),
            }
            for reading in readings
        ],
    }


def failure_object(error: GeoidentError, *, case: str) -> dict[str, Any]:
    """A command that ended without a result: the keys of one, and what was wrong."""
    faults = _faults(error)
    return {
        "case": case,
        "status": "failed",
        "exit_code": int(error.exit_code),
        "method": None,
        "reason": str(error),
        "output": None,
        "objective": None,
        "parameters": {},
        "gauges": [],
        "counts": {},
        "faults": [fault_object(fault) for fault in faults],
    }


def _faults(error: GeoidentError) -> tuple[Fault, ...]:
    if isinstance(error, ModelError):
        return (error.fault,)
    return error.faults if isinstance(error, InputError) else ()


def fault_object(fault: Fault) -> dict[str, Any]:
    """One thing that is wrong with the input."""
    place = fault.location
    return {
        "code": fault.code,
        "message": worded(fault.message),
        "hint": worded(fault.hint),
        "file": worded(place.file),
        "line": place.line,
        "column": place.column,
        "path": fault.path,
        **({"cell": f"{place.sheet}!{place.cell}"} if place.sheet and place.line else {}),
    }


def summary_object(summary: CaseSummary) -> dict[str, Any]:
    """A case that was checked."""
    when_read = [
        {
            **asdict(stage),
            **{key: _moment(getattr(stage, key)) for key in ("complete", "first", "last")},
        }
        for stage in summary.when_read
    ]
    own: dict[str, Any] = {"unused": dict(summary.unused), "when_read": when_read}
    fields = asdict(summary)
    del fields["resolved"], fields["surface"]
    if summary.surface is not None:
        own["surface"] = surface_object(summary.surface)
    return {"status": "valid", "exit_code": 0, **fields, **own}


def _moment(seconds: float | None) -> str | None:
    return None if seconds is None else moment_text(seconds)
