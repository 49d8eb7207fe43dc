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
from geoident.model.results.columns import ROW
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.result import GaugeTable, Grid, ParameterTable, Result
from geoident.model.results.rivals import Evidence
from geoident.model.results.summary import CaseSummary, Identifiability
from geoident.model.yielding import Certificate
from geoident.report.text.accuracies import accuracies_list
from geoident.report.text.alarms import alarms_list
from geoident.report.text.backtest import backtest_object
from geoident.report.text.errors.surface import surface_object
from geoident.report.text.gauges import each_reading, predicted_readings
from geoident.report.text.in_service import judged_readings, seasonal_object
from geoident.report.text.layout import moment_text
from geoident.report.text.plan import plan_object
from geoident.report.text.posterior import posterior_object
from geoident.report.text.residuals import compared_readings, diagnostics_object
from geoident.report.text.rivals import models_object, rivals_list
from geoident.report.text.rows import attributes, objects
from geoident.report.text.safety import safety_list
from geoident.report.text.structures import structures_list
from geoident.report.text.trough import troughs
from geoident.report.text.updates import updates_object
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
        "gauges": objects(compared_readings(result), ROW),
        "predictions": objects(predicted_readings(result), ROW),
        **({"times": times_list(result.gauges)} if result.gauges.times else {}),
        "readings": objects(each_reading(result.gauges), ROW),
        "findings": [attributes(finding) for finding in result.findings],
        "notes": result.notes,
        **({"outdated": list(outdated)} if outdated else {}),
        "singular_values": result.singular_values,
        "diagnostics": diagnostics_object(result),
        "counts": asdict(result.counts),
        **{name: value for name, value in _parts(result, proof).items() if value is not None},
    }


def times_list(gauges: GaugeTable) -> list[dict[str, Any]]:
    """When the stages that last and their moments are: dates, and times in s."""
    rows = zip(gauges.stages, objects(gauges.times, "stage"), strict=True)
    return [{"stage": name, **row} for name, row in rows]


def _parts(result: Result, proof: Certificate | None) -> dict[str, Any]:
    """What only some results have; None where this one has it not."""
    names, reactions, fields = result.parameters.names, result.reactions, result.varied or None
    shells, joints = result.shells, result.interfaces
    return {
        "accuracies": result.accuracies and accuracies_list(result.accuracies),
        "rivals": result.rivals and rivals_list(result.rivals, names),
        "comparison": result.comparison and models_object(result.comparison),
        "evidence": result.evidence and evidence_object(result.evidence),
        "backtest": result.backtest and backtest_object(result),
        "model_error": result.model_error and attributes(result.model_error),
        "surface": result.surface and surface_object(result.surface),
        "left_out": result.left_out and objects(result.left_out, "left_out"),
        "fields": fields and varied_list(fields),
        "certificate": proof and certificate_object(proof),
        "structures": result.members and structures_list(result.members),
        "shells": shells and objects(shells, "stage", "face", rows=shells.standing),
        "interfaces": joints and objects(joints, "stage", "joint", rows=joints.standing),
        "reactions": reactions and objects(reactions, "support", "state", rows=reactions.standing),
        "yielded": result.yielded and objects(result.yielded, "state"),
        "alarms": result.alarms and alarms_list(result),
        "decisions": result.decisions and objects(result.decisions, ROW),
        "telling_readings": result.telling and objects(result.telling, ROW),
        "convergence": result.convergence and objects(result.convergence, ROW),
        "settlement": result.settlement and objects(result.settlement, ROW),
        "troughs": objects(troughs(result), ROW) or None,
        "posterior": result.posterior and posterior_object(result),
        "opening": result.reaction and opening_object(result.reaction),
        "face": result.advance and face_object(result.advance),
        "safety": safety_list(result.safety, result.parameters.names) or None,
        "plan": result.plan and plan_object(result.plan),
        "seasonal": seasonal_object(result),
        "judged": result.judged and objects(judged_readings(result), ROW),
        "changes": objects(result.changes, ROW) or None,
        "parameter_changes": objects(result.parameter_changes, ROW) or None,
        "updates": updates_object(result),
        "power": result.power and objects(result.power, ROW),
        "grid": result.grid and grid_object(result.grid),
    }


def opening_object(reaction: GroundReaction) -> dict[str, Any]:
    """The closed form of an opening, SI; compression and motions inwards are positive.

    Args:
        reaction: its ground reaction curve, and its stages on their way along it.
    """
    curve = ("pressure", "displacement", "plastic_radius")
    keys = ("support", "stage", "support_pressure", "support_capacity")
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
        "supports": [
            {key: entry[key] for key in keys}
            for entry in objects(reaction, "support", "stage", rows=reaction.standing)
        ],
    }


def face_object(advance: FaceAdvance) -> dict[str, Any]:
    """An advancing tunnel face, SI: its profile, and what distances to it say of the stages."""
    return {
        **attributes(advance),
        "curve": {"distance": advance.distance, "share": advance.share},
        "stages": objects(advance, "stage"),
        "lost": advance.lost,
    }


def identifiability_object(case: str, plan: Identifiability) -> dict[str, Any]:
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
