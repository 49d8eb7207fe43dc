"""Ctrl-C and termination: the first finishes the running evaluation, the second stops at once."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import Protocol

from geoident.errors import ExitCode

CODES = {signal.SIGINT: ExitCode.INTERRUPTED, signal.SIGTERM: ExitCode.TERMINATED}

_SAID = "Stopping after the current evaluation; a second signal stops at once.\n"


class Stopper(Protocol):
    """Something that can be asked to stop, as `workflow.executing.stop.StopRequest`."""

    def ask(self, exit_code: ExitCode) -> None:
        """Wish the stop."""


@contextmanager
def stop_on_signals(stop: Stopper) -> Iterator[None]:
    """Turn the first signal into a wish to stop, and leave the second to the system."""

    def ask(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        stop.ask(CODES[signal.Signals(number)])
        with suppress(OSError):  # the lock of a stream may be held: write past it
            os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, _SAID.encode())

    with handled_signals(ask):
        yield


class Stoppable(Protocol):
    """Many runs at a time, as `workflow.executing.executor.Executor`."""

    def ask_to_stop(self) -> None:
        """Begin no more, and let those that run end soon."""

    def kill(self) -> None:
        """End all at once."""


@dataclass
class SignalLog:
    """The signal that was heard first.

    Args:
        code: with which the command is to end; None while there was no signal.
    """

    code: ExitCode | None = None


@contextmanager
def stop_runs_on_signals(runs: Stoppable) -> Iterator[SignalLog]:
    """The same for many runs: the first signal lets those end that run, the second ends them."""
    log = SignalLog()

    def ask(number: int, frame: FrameType | None) -> None:
        if log.code is not None:
            runs.kill()
            return
        log.code = CODES[signal.Signals(number)]
        runs.ask_to_stop()
        with suppress(OSError):
            os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, _SAID.encode())

    with handled_signals(ask):
        yield log


@contextmanager
def handled_signals(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Let a handler take the signals of `CODES` meanwhile; outside the main thread nothing does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in CODES}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
