"""Running one command that leaves a result: how it goes on, what came out, or what it would do."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import replace
from datetime import datetime
from functools import partial
from typing import Any

import click

from geoident.cli.collapse import mechanism_drawn
from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import Options
from geoident.cli.signals import stop_on_signals
from geoident.cli.terminal import Terminal
from geoident.cli.watch import Watch, alarm_command, passed_on
from geoident.errors import ExitCode
from geoident.model.results.many.project import ProjectResult
from geoident.report.text.case import case_text
from geoident.report.text.json import dumps, result_object, summary_object
from geoident.report.text.project.json import project_object
from geoident.report.text.project.tables import project_summary
from geoident.report.text.result import summary_text
from geoident.report.text.updates import update_sentence
from geoident.workflow.check import summarize
from geoident.workflow.estimating.finished import Finished, FinishedRun
from geoident.workflow.estimating.setup import prepare
from geoident.workflow.executing.stop import StopRequest
from geoident.workflow.in_service.control import ControlRequest, control, plan_control
from geoident.workflow.plan import PlanRequest, make_plan, plan_gauges
from geoident.workflow.predict import PredictRequest, plan_prediction, predict
from geoident.workflow.programs.workplace import on_cluster
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Job, Planned, Request
from geoident.workflow.running.outputs import Existing
from geoident.workflow.running.result_files import outdated_beside, outdated_sentence
from geoident.workflow.sample import SampleRequest, plan_sample, sample
from geoident.workflow.updating.update import UpdateRequest, update, updating

PlanJob = Callable[[Request], Job]
RunJob = Callable[[Job, Control], Finished]


def request_of(case: str, options: Options) -> Request:
    """What is to be done with a case, or with a result.

    Args:
        case: its path.
        options: of the command.
    """
    return Request(
        case=case,
        overrides=options.overrides,
        output=options.output,
        seed=options.seed,
        solver=options.solver,
        force=options.force,
        fresh=options.fresh,
        reduced=options.reduced,
    )


def run_case(
    case: str,
    options: Options,
    *,
    plan: PlanJob,
    run: RunJob,
    stop: StopRequest | None = None,
    cluster: str | None = None,
    begun: bool = False,
) -> int:
    """Plan a case, run it, and say what came out.

    Args:
        case: path of the case.
        options: of the command.
        plan: makes the job.
        run: does it.
        stop: the wish to stop; None for that of the signals that arrive.
        cluster: address, ``local`` or file of a cluster; None for processes of this machine.
        begun: its checkpoint is of this very command, and is gone on from.

    Returns:
        The exit code.
    """
    with failures_as_json(case, options), mechanism_drawn(case, options):
        job = plan(replace(request_of(case, options), begun=begun))
        if options.dry_run:
            # the model is built, nothing is solved
            setup = prepare(job)
            summary = summarize(job.inputs, setup.model, setup.readings)
            return say_plan(job, case_text(summary), summary_object(summary), options)
        terminal = Terminal(options, job.inputs.case.parameters)
        return run_and_say(
            partial(run, job), terminal, options, title=case, case=case, stop=stop, cluster=cluster
        )


def run_prediction(asked: PredictRequest, options: Options) -> int:
    """Make a prediction, and say what came out."""
    task = plan_prediction(asked)
    case, work = task.job.inputs.path, partial(predict, task)
    with mechanism_drawn(case, options):
        return run_and_say(work, Terminal(options), options, title=asked.request.case, case=case)


def run_control(request: ControlRequest, options: Options, *, on_alarm: str | None = None) -> int:
    """Judge new readings of a structure in service, say what came out, and pass an alarm on.

    Args:
        request: what to hold against which fit.
        options: of the command.
        on_alarm: command line of a program for a new alarm; None for none.

    Returns:
        The exit code.
    """
    command = alarm_command(on_alarm, options)
    task, done = plan_control(request), list[Finished]()
    case, terminal = task.job.inputs.path, Terminal(options)

    about = dict[str, Any]()

    def work(controlling: Control) -> Finished:
        done.append(control(task, controlling))
        about["nothing_new"] = done[0].up_to_date
        return done[0]

    code = run_and_say(work, terminal, options, title=request.result, case=case, also=about)
    if command and code == ExitCode.ALARM and not done[0].up_to_date:
        found = result_object(done[0].result, case=case, output=done[0].paths[0])
        if failed := passed_on(command, found, StopRequest()):
            terminal.warn(failed)
    return code


def run_update(request: UpdateRequest, options: Options) -> int:
    """Bring a fit up to date, and say what came out.

    Returns:
        The exit code: that of an alarm where the new readings do not belong to the model.
    """
    with updating(request) as task:
        case, about = task.job.inputs.path, dict[str, Any]()

        def work(control: Control) -> Finished:
            updated = update(task, control)
            about["nothing_new"], about["alarm"] = updated.nothing_new, updated.alarm
            finished = updated.finished
            sentence = update_sentence(finished.result) or "First fit."
            about["update"] = finished.remarks[0] if updated.nothing_new else sentence
            return finished

        terminal = Terminal(options, task.job.inputs.case.parameters)
        with mechanism_drawn(case, options):
            code = run_and_say(work, terminal, options, title=request.path, case=case, also=about)
    if about["nothing_new"]:
        return ExitCode.DONE
    return ExitCode.ALARM if about["alarm"] else code


def run_watch(path: str, options: Options, *, every: float | None, on_alarm: str | None) -> int:
    """Look at cases until a signal, or once.

    Args:
        path: of a case or folder.
        options: of the command.
        every: seconds from look to look; None to look once.
        on_alarm: command line of a program for new alarms; None for none.

    Returns:
        The exit code of the only look.

    Raises:
        Interrupted: a signal came.
    """

    def say(case: str, words: str, error: bool) -> None:
        if error or not options.quiet:
            with suppress(OSError):  # a full disk under a log ends no watch
                click.echo(f"{datetime.now():%Y-%m-%d %H:%M:%S} {case}: {words}", err=True)

    def on_result(about: Mapping[str, Any]) -> None:
        click.echo(dumps(about) if options.as_json else about["output"])

    stop = StopRequest()
    words = alarm_command(on_alarm, options)
    watch = Watch(path, say, on_result, stop, words, trust=options.trust)
    with stop_on_signals(stop):
        while True:
            code = watch.look()
            if every is None:
                return code
            again = time.monotonic() + every
            while (left := again - time.monotonic()) > 0.0:
                stop.check()
                time.sleep(min(left, 0.2))


def run_plan(request: PlanRequest, options: Options) -> int:
    """Choose gauges, and say what came out."""
    task = plan_gauges(request)
    case, work = task.job.inputs.path, partial(make_plan, task)
    with mechanism_drawn(case, options):
        return run_and_say(work, Terminal(options), options, title=case, case=case)


def run_sample(asked: SampleRequest, options: Options, *, cluster: str | None = None) -> int:
    """Draw from a posterior, and say what came out.

    Args:
        asked: what to draw.
        options: of the command.
        cluster: address, ``local`` or file of a cluster; None for processes of this machine.

    Returns:
        The exit code.
    """
    task = plan_sample(asked)
    case, work = task.job.inputs.path, partial(sample, task)
    with mechanism_drawn(case, options):
        return run_and_say(
            work, Terminal(options), options, title=asked.request.case, case=case, cluster=cluster
        )


def run_and_say(
    work: Callable[[Control], Finished] | Callable[[Control], FinishedRun[ProjectResult]],
    terminal: Terminal,
    options: Options,
    *,
    title: str,
    case: str,
    stop: StopRequest | None = None,
    cluster: str | None = None,
    also: Mapping[str, Any] | None = None,
) -> int:
    """Do it; then the path or the JSON object on stdout, the rest on stderr.

    Args:
        work: to be done.
        terminal: where to say how it goes on, and how it ended.
        options: of the command.
        title: of the live line.
        case: path of the case or project.
        stop: the wish to stop; None for that of the signals that arrive.
        cluster: address, ``local`` or file of a cluster; None for processes of this machine.
        also: further entries of the JSON object, complete when the work is done.

    Returns:
        The exit code.
    """
    control = Control(
        terminal, stop or StopRequest(), max_time=options.max_time, jobs=options.jobs,
        cluster=on_cluster(cluster, options.jobs, terminal.inform),
    )  # fmt: skip
    listening = stop_on_signals(control.stop) if stop is None else nullcontext()
    with terminal.live(title), listening:
        finished = work(control)
    result, path = finished.result, finished.paths[0]
    for remark in finished.remarks:
        terminal.inform(remark)
    if not finished.up_to_date:
        control.tell_of_cluster()
    else:
        terminal.inform(f"{path} is up to date; --fresh computes it again")
    if isinstance(result, ProjectResult):
        terminal.inform(project_summary(result))
        outdated: tuple[str, ...] = ()
    else:
        terminal.inform(summary_text(result))
        outdated = outdated_beside(result, path)
    if result.exit_code != ExitCode.DONE and options.quiet:
        terminal.warn(f"{case}: {result.status}: {result.reason}")
    if outdated:
        terminal.inform(outdated_sentence(outdated))
    for other in finished.paths[1:]:
        terminal.detail(f"also written: {other}")
    if not options.as_json:
        click.echo(path)
    elif isinstance(result, ProjectResult):
        click.echo(dumps(project_object(result, project=case, output=path)))
    else:
        about = result_object(result, case=case, output=path, outdated=outdated)
        click.echo(dumps({**about, **(also or {})}))
    return int(result.exit_code)


def say_plan(job: Planned, text: str, as_object: dict[str, Any], options: Options) -> int:
    """What would be done, on stdout.

    Args:
        job: what was planned.
        text: what it is made of, for people.
        as_object: the same for programs.
        options: of the command.
    """
    path = str(job.place.path)
    if options.as_json:
        click.echo(dumps({**as_object, "output": path, "up_to_date": job.up_to_date}))
        return ExitCode.DONE
    click.echo(text)
    click.echo(f"\n{path} is up to date" if job.up_to_date else f"\nWould write {path}")
    if job.existing is Existing.OTHER and not options.force:
        click.echo("and keep what stands there beside it")
    return ExitCode.DONE
