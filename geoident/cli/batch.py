"""Several cases, one process each, so that a case that dies takes nobody with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import FrameType

import click

from geoident.cli.error_boundary import combined, say_error
from geoident.cli.options import Options
from geoident.cli.signals import CODES, handled_signals
from geoident.errors import ExitCode

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


class Batch:
    """The processes of several cases.

    Args:
        command: that every process runs.
        options: as given.
    """

    def __init__(self, command: str, options: Options) -> None:
        self._command = command
        self._options = options
        self._running: set[subprocess.Popen[str]] = set()
        self._stopped: ExitCode | None = None
        self._lock = threading.RLock()

    def run(self, cases: Sequence[str]) -> int:
        """Run all cases; their stdout comes in the order of the cases."""
        refuse_ambiguous(cases, self._options)
        codes: list[int] = []
        with handled_signals(self._forward), ThreadPoolExecutor(self._options.jobs) as pool:
            for code, stdout in pool.map(self._run_case, cases):
                codes.append(code)
                if stdout:
                    click.echo(stdout, nl=False)
        self._say_total(codes)
        return int(self._stopped or combined(codes))

    def _run_case(self, case: str) -> tuple[int, str]:
        if self._stopped is not None:
            return int(self._stopped), ""
        arguments = [sys.executable, "-m", "geoident", self._command, *flags(self._options)]
        with self._lock:
            process = subprocess.Popen(
                [*arguments, "--", case],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env=self._environment(),
                start_new_session=True,  # Ctrl-C reaches us only, and we pass it on once
            )
            self._running.add(process)
        stdout, stderr = process.communicate()
        with self._lock:
            self._running.discard(process)
        code = process.returncode
        self._say_end(case, code, stderr)
        return _exit_code(code), stdout

    def _environment(self) -> dict[str, str]:
        """Share the cores out, so that the processes do not get in each other's way."""
        threads = max(1, (os.cpu_count() or 1) // self._options.jobs)
        return {"OMP_NUM_THREADS": str(threads), "MKL_NUM_THREADS": str(threads), **os.environ}

    def _say_end(self, case: str, code: int, stderr: str) -> None:
        if code < 0:
            words = f"ended by signal {-code}"
        else:
            words = WORDS[ExitCode(code)] if code in WORDS else str(code)
        if code != ExitCode.DONE or not self._options.quiet:
            lines = "".join(f"\n    {line}" for line in stderr.splitlines())
            say_error(f"{case}: {words}{lines}", code)

    def _say_total(self, codes: Sequence[int]) -> None:
        if not self._options.quiet:
            done = sum(code == ExitCode.DONE for code in codes)
            say_error(f"{done} of {len(codes)} cases done", 0)

    def _forward(self, number: int, frame: FrameType | None) -> None:
        self._stopped = CODES[signal.Signals(number)]
        for process in tuple(self._running):
            with suppress(OSError):
                process.send_signal(number)


def _exit_code(code: int) -> int:
    """The exit code of a process; one that was killed counts as interrupted or as a bug."""
    killed = {-number: stopped for number, stopped in CODES.items()}
    return code if code >= 0 else int(killed.get(code, ExitCode.BUG))


def refuse_ambiguous(cases: Sequence[str], options: Options) -> None:
    """Refuse several cases that cannot have results of their own.

    Raises:
        click.UsageError: why they cannot.
    """
    if "-" in cases:
        raise click.UsageError("stdin (-) cannot be one of several cases.")
    if options.output is not None and not Path(options.output).is_dir():
        raise click.UsageError("With several cases, -o must be an existing folder.")
    names = [_result_name(case, options) for case in cases]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise click.UsageError(f"Several cases would write the same result: {', '.join(twice)}.")


def _result_name(case: str, options: Options) -> str:
    return Path(case).stem if options.output else str(Path(case).with_suffix(""))


def flags(options: Options) -> list[str]:
    """The flags that give one process the same options; it says only what goes wrong."""
    words = [f"--set={override}" for override in options.overrides]
    words += [f"--seed={options.seed}", f"--solver={options.solver}"]
    words += [f"--output={options.output}"] if options.output is not None else []
    words += [f"--max-time={options.max_time:.6f}s"] if options.max_time is not None else []
    switches = {
        "--dry-run": options.dry_run,
        "--force": options.force,
        "--fresh": options.fresh,
        "--json": options.as_json,
        "--trust": options.trust,
        "--verbose": options.verbose,
        "--quiet": not options.verbose,
    }
    return words + [flag for flag, on in switches.items() if on]
