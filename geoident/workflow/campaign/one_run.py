"""One run of a campaign, in a process of its own: its command, and what is kept of its end."""

from __future__ import annotations

import math
import platform
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from geoident.errors import ExitCode, GeoidentError, Interrupted
from geoident.io.result.file import write_result
from geoident.io.text.atomic import names_may_be_lost, refuse_link
from geoident.model.campaign import Campaign
from geoident.model.results.many.campaign import (
    FAILED,
    INTERRUPTED,
    NAN,
    RunParameter,
    RunReading,
    RunRecord,
)
from geoident.model.results.result import STOPPED, Result
from geoident.workflow.campaign.plan import PlannedRun
from geoident.workflow.estimating.diagnosis import bare_parameter_table
from geoident.workflow.estimating.finished import Finished
from geoident.workflow.executing.worker import STOP
from geoident.workflow.fit import fit
from geoident.workflow.predict import PredictRequest, plan_prediction, predict
from geoident.workflow.programs.trust import decided_by, trusting
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit, plan_scan, provenance
from geoident.workflow.running.readings import reading_table
from geoident.workflow.scan import scan
from geoident.workflow.simulate import ComputedBy, Noise, simulate


@dataclass(frozen=True)
class RunTask:
    """What a process is told of a run.

    Args:
        campaign: that it is of, without its runs.
        folder: for its result.
        run: the run.
        fresh: what is known of it does not count.
        trust: what its case names as its model may be run.
        permitted: `Execution.portable` of what may be run in any case.
    """

    campaign: Campaign
    folder: Path
    run: PlannedRun
    fresh: bool = False
    trust: bool = False
    permitted: tuple[str, ...] = ()

    @property
    def result(self) -> Path:
        """Path of the result."""
        return self.folder / f"{self.run.name}.{self.campaign.command}.h5"

    @property
    def checkpoint(self) -> Path:
        """Path of the evaluations of a run that was cut short."""
        return self.result.with_suffix(".checkpoint")

    @property
    def log(self) -> Path:
        """Path of the details of a bug."""
        return self.folder / f"{self.run.name}.log"


def set_up() -> Callable[[RunTask], RunRecord]:
    """What a process does with its tasks."""
    return compute


def compute(task: RunTask, *, remembered: bool = True) -> RunRecord:
    """Run one variation; whatever happens, there is a record of it.

    Args:
        task: the run.
        remembered: that its model may be run is written down beside the case.
    """
    began = time.monotonic()
    decide = trusting(trust=task.trust, permitted=task.permitted)
    try:
        refuse_link(task.result)
        refuse_link(task.log)
        with decided_by(decide, remembered=remembered), names_may_be_lost():
            finished = _finished(task)
        record = _record(task.run, finished.result, Path(finished.paths[0]).name)
    except Interrupted as error:
        cut = error.exit_code == ExitCode.NOT_CONVERGED
        record = without_result(
            task.run, STOPPED if cut else INTERRUPTED, error.exit_code, str(error)
        )
    except GeoidentError as error:
        record = without_result(task.run, FAILED, error.exit_code, str(error))
    except MemoryError:
        record = without_result(task.run, FAILED, ExitCode.BUG, "out of memory")
    except Exception as error:
        reason = f"a bug in geoident: {type(error).__name__}: {error}".splitlines()[0]
        with suppress(OSError):
            task.log.write_text("".join(traceback.format_exception(error)), encoding="utf-8")
            reason = f"{reason} (details in {task.log.name})"
        record = without_result(task.run, FAILED, ExitCode.BUG, reason)
    return replace(record, seconds=time.monotonic() - began, host=platform.node())


def without_result(run: PlannedRun, status: str, code: int, reason: str) -> RunRecord:
    """The record of a run that has left no result.

    Args:
        run: the run.
        status: how it ended.
        code: exit code of its command.
        reason: why it ended so.
    """
    return RunRecord(run.name, run.key, run.varied, status, int(code), reason)


def _finished(task: RunTask) -> Finished:
    """Do what the command of the campaign does with one case."""
    campaign, run = task.campaign, task.run
    control = Control(stop=STOP, max_time=campaign.max_time)
    if campaign.command == "simulate":
        return _simulated(task)
    request = Request(
        case=campaign.case,
        overrides=run.overrides,
        output=str(task.result),
        seed=run.seed,
        solver=campaign.solver,
        fresh=task.fresh,
        begun=True,
    )
    if campaign.command == "predict":  # over what stands there: the folder is the campaign's own
        on_fit = replace(request, case=campaign.result, force=True)
        asked = PredictRequest(on_fit, campaign.stages, campaign.case)
        return predict(plan_prediction(asked), control)
    if campaign.command == "scan":
        return scan(plan_scan(request), control)
    return fit(plan_fit(request), control)


def _simulated(task: RunTask) -> Finished:
    """Simulate readings, and write them as a result."""
    campaign, run = task.campaign, task.run
    began = time.monotonic()
    simulated = simulate(
        campaign.case,
        overrides=run.overrides,
        noise=Noise.ACCURACY if campaign.noise else Noise.NONE,
        draw=campaign.draw,
        seed=run.seed,
        by=ComputedBy(campaign.solver),
    )
    case = replace(simulated.case, readings=simulated.readings)
    table = reading_table(case, ["simulated, not measured"] * len(case.readings))
    channels = {channel.name: i for i, channel in enumerate(case.channels)}
    stages = {stage.name: j for j, stage in enumerate(case.stages)}
    computed = [simulated.computed[channels[r.channel], stages[r.stage]] for r in case.readings]
    readings = replace(table, computed=np.array(computed, dtype=np.float64))
    inputs = simulated.inputs
    origin = provenance(
        inputs, command="simulate", identity=run.key, seed=run.seed, output=task.result
    )
    result = Result(
        kind="simulate",
        status="done",
        exit_code=ExitCode.DONE,
        method="",
        reason="",
        objective=math.nan,
        findings=(),
        case_text=inputs.loaded.text,
        case_resolved=inputs.loaded.resolved,
        provenance=replace(origin, seconds=time.monotonic() - began),
        parameters=bare_parameter_table(case.parameters, simulated.values),
        gauges=gauge_table(case, readings, simulated.computed),
        counts=simulated.counts,
        history=(),
        notes=case.notes,
    )
    write_result(result, task.result, overwrite=True, inputs=simulated.files_read)
    return Finished(result, (str(task.result),))


def _record(run: PlannedRun, result: Result, file: str) -> RunRecord:
    plain = result.for_people
    return RunRecord(
        name=run.name,
        key=run.key,
        settings=run.varied,
        status=plain.status,
        exit_code=int(plain.exit_code),
        reason=plain.reason,
        file=file,
        objective=float(plain.objective),
        parameters=_parameters(plain),
        readings=_readings(plain),
        counts=plain.counts,
    )


def _parameters(result: Result) -> tuple[RunParameter, ...]:
    table = result.parameters
    return tuple(
        RunParameter(
            name,
            float(table.values[i]) if table.determined[i] or table.sd[i] == table.sd[i] else NAN,
            float(table.sd[i]),
            float(table.lower95[i]),
            float(table.upper95[i]),
            table.units[i],
            table.dimensions[i],
        )
        for i, name in enumerate(table.names)
    )


def _readings(result: Result) -> tuple[RunReading, ...]:
    """What a run is asked for: simulated readings, or predicted ones with their bands."""
    gauges = result.gauges
    if result.kind == "simulate":
        rows = gauges.readings
        owner = {name: i for i, name in enumerate(gauges.channels)}
        return tuple(
            RunReading(
                channel, stage, float(value), NAN, NAN,
                gauges.units[owner[channel]], gauges.dimensions[owner[channel]],
            )
            for channel, stage, value in zip(rows.channel, rows.stage, rows.value, strict=True)
        )  # fmt: skip
    prediction = result.prediction
    if result.kind != "predict" or prediction is None:
        return ()
    return tuple(
        RunReading(
            gauges.channels[i], gauges.stages[j], float(prediction.mean[i, j]),
            float(prediction.lower95[i, j]), float(prediction.upper95[i, j]),
            gauges.units[i], gauges.dimensions[i],
        )
        for i, j in np.argwhere(np.isfinite(prediction.mean)).tolist()
    )  # fmt: skip
