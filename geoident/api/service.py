"""A structure in service: new readings held against a fit, as by the command."""

from __future__ import annotations

import os
from collections.abc import Sequence

from geoident.api.calling import AnyPath, spoken
from geoident.api.results import ControlResult, ResultFile
from geoident.api.runs import path_of
from geoident.workflow.in_service.control import (
    ControlRequest,
    plan_control,
    time_between,
)
from geoident.workflow.in_service.control import control as run_control
from geoident.workflow.running.control import Control


@spoken
def control(
    fitted: ResultFile | AnyPath,
    *,
    readings: AnyPath | None = None,
    false_alarms: str = "1 per 10 years",
    power: Sequence[str] = (),
    output: AnyPath | None = None,
    seed: int = 0,
    force: bool = False,
    fresh: bool = False,
) -> ControlResult:
    """Hold new readings of a structure in service against its fit.

    Args:
        fitted: what `fit` found of a seasonal model, or the path of its file.
        readings: file of new readings, laid out as that of the case; None for those of the case
            that are later than the fit.
        false_alarms: how often chance alone may raise an alarm, of all gauges together.
        power: changes of which is asked whether they would be seen, and how late, such as
            ``P2 drifts 1 mm/year``, ``P1, P2 step 2 mm``, ``all soften 20 %``, or on a mesh
            ``E_rock falls 20 %``; they need no new readings.
        output: file or existing folder of the result; ``CASE.control.h5`` beside the fit if None.
        seed: of the simulated noise from which the threshold follows.
        force: overwrite a result of other input.
        fresh: compute again what is up to date.

    Raises:
        InputError: the readings or the loads are wrong, or the fit is of no structure in service.
        OutputError: the result cannot be written, or would replace one of other input.
        UsageError: there is no such rate of false alarms, or the words of a change are wrong.
    """
    request = ControlRequest(
        result=path_of(fitted),
        readings=None if readings is None else os.fspath(readings),
        false_alarms=time_between(false_alarms),
        power=tuple(power),
        output=None if output is None else os.fspath(output),
        seed=seed,
        force=force,
        fresh=fresh,
    )
    finished = run_control(plan_control(request), Control())
    return ControlResult(finished.result, finished.paths[0], finished.up_to_date)
