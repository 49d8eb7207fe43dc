"""Several cases, in processes that share the cores: a case that dies takes nobody with it."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import click

from geoident.cli.error_boundary import combined, guarded, say_error
from geoident.cli.jobs import run_case
from geoident.cli.options import Options
from geoident.cli.signals import stop_runs_on_signals
from geoident.cli.terminal import Terminal
from geoident.cli.trust import asked
from geoident.errors import ExitCode
from geoident.io.result.file import read_result
from geoident.report.text.json import dumps, result_object
from geoident.workflow.backtest import backtest
from geoident.workflow.executing.executor import Executor, usable_cores
from geoident.workflow.executing.processes import LocalProcesses
from geoident.workflow.executing.worker import STOP
from geoident.workflow.fit import fit
from geoident.workflow.programs.workplace import cluster_given
from geoident.workflow.running.jobs import plan_backtest, plan_fit
from geoident.workflow.running.outputs import known, target

WORDS = {
    ExitCode.DONE: "done",
    ExitCode.BUG: "failed by a bug",
    ExitCode.INVALID_INPUT: "invalid input",
    ExitCode.NOT_CONVERGED: "finished, but not converged or determined, or poorly fitted",
    ExitCode.NO_SOLUTION: "the model has no solution",
    ExitCode.OUTPUT: "the output cannot be written",
    ExitCode.INTERRUPTED: "interrupted",
    ExitCode.TERMINATED: "interrupted",
}
FINISHED = (ExitCode.DONE, ExitCode.NOT_CONVERGED)


@dataclass(frozen=True)
class CaseEnd:
    """How a case ended.

    Args:
        code: exit code of its command.
        stdout: what it said there.
        stderr: what it said there.
        up_to_date: nothing was computed.
    """

    code: int
    stdout: str = ""
    stderr: str = ""
    up_to_date: bool = False

    @property
    def words(self) -> str:
        """In a few words."""
        outcome = WORDS.get(ExitCode(self.code), str(self.code))
        if not self.up_to_date:
            return outcome
        return "up to date" if self.code == ExitCode.DONE else f"up to date: {outcome}"


def run_cases(
    command: str, cases: Sequence[str], options: Options, *, cluster: str | None = None
) -> int:
    """Fit or backtest several cases; their stdout comes in the order of the cases.

    Args:
        command: ``fit`` or ``backtest``.
        cases: their paths.
        options: as given.
        cluster: address, ``local`` or file of a cluster; None for processes of this machine.

    Returns:
        The exit code: 7 if some have failed.
    """
    refuse_ambiguous(cases, options)
    ends = _Ends(cases, options)
    for number, case in enumerate(cases):
        if options.fresh and not options.dry_run:
            # forgotten once: a case whose process is lost goes on from its own
            with suppress(OSError):  # whoever computes the case says what is wrong
                place = target(case, command, output=options.output)
                place.checkpoint.unlink(missing_ok=True)
        elif not options.dry_run and (end := _up_to_date(command, case, options)):
            ends.add(number, end)
    left = [number for number in range(len(cases)) if number not in ends.of]
    stopped = _compute(command, left, ends, options, cluster) if left else None
    codes = [ends.of[n].code if n in ends.of else ExitCode.TERMINATED for n in range(len(cases))]
    if not options.quiet:
        finished = [end for end in ends.of.values() if end.code in FINISHED]
        known = sum(end.up_to_date for end in finished)
        parts = f"{len(finished) - known} computed, {known} up to date"
        say_error(f"{codes.count(ExitCode.DONE)} of {len(cases)} cases done ({parts})", 0)
    return int(stopped or combined(codes))


def _up_to_date(command: str, case: str, options: Options) -> CaseEnd | None:
    """A case whose result is up to date, as the checksums of its files tell."""
    result = known(
        case, command, output=options.output, overrides=options.overrides, seed=options.seed
    )
    if result is None:
        return None
    place, identity = result
    path = line = str(place.path)
    if options.as_json:
        line = dumps(result_object(read_result(path), case=case, output=path))
    return CaseEnd(identity.exit_code, f"{line}\n", up_to_date=True)


def _compute(
    command: str, left: Sequence[int], ends: _Ends, options: Options, cluster: str | None
) -> ExitCode | None:
    """Compute cases in processes; the exit code of the signal that has ended this, if one has."""
    terminal = Terminal(options)
    cases = [ends.cases[n] for n in left]
    with (
        _executor(command, cases, options, terminal, cluster) as executor,
        stop_runs_on_signals(executor) as log,
        terminal.live(f"{len(left)} cases"),
    ):
        for done, answer in enumerate(executor.run(cases), start=1):
            end = answer.value
            if end is None and answer.stopped:
                end = CaseEnd(ExitCode.TERMINATED)
            elif end is None:
                end = CaseEnd(ExitCode.BUG, stderr=f"set aside: {answer.why_set_aside}")
            ends.add(left[answer.number], end)
            terminal.part(f"{done} of {len(left)} cases done", done / len(left))
    return log.code


@contextmanager
def _executor(
    command: str, cases: Sequence[str], options: Options, terminal: Terminal, cluster: str | None
) -> Iterator[Executor[str, CaseEnd]]:
    """What computes the cases: processes of this machine, or a cluster."""
    if cluster is None:
        jobs = min(options.jobs or usable_cores(), len(cases))
        with LocalProcesses[str, CaseEnd](jobs, partial(_set_up, command, options)) as processes:
            yield processes
        return
    # with dask, which is an extra
    from geoident.cli.several_away import AwayCases, cases_on  # noqa: PLC0415
    from geoident.cli.several_away import run_cases as cases_that_run  # noqa: PLC0415

    if any(Path(path).is_absolute() for path in (*cases, options.output or "")):
        raise click.UsageError("With --cluster, name cases and -o as seen from this folder.")
    where = cluster_given(cluster)
    run = cases_that_run(cases, options)
    permitted = tuple(one.permitted for one in run.values() if one.permitted)
    set_up = partial(_set_up, command, options, permitted)
    with cases_on(where, cases, options, set_up, terminal.inform, run) as away:
        yield AwayCases(away, command, options, tuple(run))


def _set_up(
    command: str, options: Options, permitted: tuple[str, ...] | None = None
) -> Callable[[str], CaseEnd]:
    """In a process of its own: what runs a case there, and keeps what it says.

    Args:
        command: ``fit`` or ``backtest``.
        options: as given.
        permitted: on another machine, `Execution.portable` of what cases may run.
    """
    plan, run = (plan_fit, fit) if command == "fit" else (plan_backtest, backtest)
    quiet = replace(options, quiet=not options.verbose, jobs=1)

    def run_one(case: str) -> CaseEnd:
        out, err = io.StringIO(), io.StringIO()
        with (
            redirect_stdout(out),
            redirect_stderr(err),
            asked(trust=quiet.trust, as_json=quiet.as_json, permitted=permitted),
        ):
            code = guarded(lambda: run_case(case, quiet, plan=plan, run=run, stop=STOP, begun=True))
        return CaseEnd(code, out.getvalue(), err.getvalue())

    return run_one


@dataclass
class _Ends:
    """How cases have ended: said on stderr as they do, and their stdout in their order.

    Args:
        cases: all of them.
        options: as given.
        of: number of a case to its end.
        shown: cases whose stdout has been shown.
    """

    cases: Sequence[str]
    options: Options
    of: dict[int, CaseEnd] = field(default_factory=dict)
    shown: int = 0

    def add(self, number: int, end: CaseEnd) -> None:
        self.of[number] = end
        if end.code != ExitCode.DONE or not self.options.quiet:
            lines = "".join(f"\n    {line}" for line in end.stderr.splitlines())
            say_error(f"{self.cases[number]}: {end.words}{lines}", end.code)
        while (first := self.of.get(self.shown)) is not None:
            click.echo(first.stdout, nl=False)
            self.shown += 1


def refuse_ambiguous(cases: Sequence[str], options: Options) -> None:
    """Refuse several cases that cannot have results of their own.

    Raises:
        click.UsageError: why they cannot.
    """
    if "-" in cases:
        raise click.UsageError("stdin (-) cannot be one of several cases.")
    if options.output is not None and not Path(options.output).is_dir():
        raise click.UsageError("With several cases, -o must be an existing folder.")
    names = [
        Path(case).stem if options.output else str(Path(case).with_suffix("")) for case in cases
    ]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise click.UsageError(f"Several cases would write the same result: {', '.join(twice)}.")
