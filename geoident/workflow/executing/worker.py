"""The other end of `processes`: a process that answers tasks until nobody asks any more.

It hears SIGTERM as the wish to end its task soon (`STOP`), and not Ctrl-C: who asks passes that on.
It ends when its asker is gone, however that ended.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from types import FrameType
from typing import Any

from geoident.errors import ExitCode
from geoident.workflow.executing.family import end_descendants
from geoident.workflow.executing.stop import StopRequest

STOP = StopRequest()
"""The wish to end the task that runs; whoever computes long asks it."""

READY = "ready"
VALUE = "value"
RAISED = "raised"

_HELD = (signal.SIGINT, signal.SIGTERM)


def serve(connection: Connection, set_up: bytes) -> None:
    """Answer tasks that come through a connection, until it is closed.

    Args:
        connection: tasks in, pairs of a word and a value out.
        set_up: pickled, what gives the function that answers them. It is loaded here, since that
            imports what it consists of.
    """
    _listen_to_signals()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    sys.stdout = sys.stderr  # what libraries print is no answer
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        function = _made(connection, set_up)
        while function is not None:
            task = connection.recv()
            STOP.exit_code = None
            try:
                connection.send((VALUE, function(task)))
            except (BrokenPipeError, ConnectionResetError):
                raise
            except BaseException as error:
                connection.send((RAISED, error))


def _made(connection: Connection, set_up: bytes) -> Callable[[Any], Any] | None:
    try:
        set_up_function = pickle.loads(set_up)
        function: Callable[[Any], Any] = set_up_function()
    except BaseException as error:
        connection.send((RAISED, error))
        return None
    connection.send((READY, None))
    return function


def _listen_to_signals() -> None:
    def ask(number: int, frame: FrameType | None) -> None:
        STOP.ask(ExitCode.TERMINATED)

    if hasattr(os, "setsid"):
        os.setsid()  # Ctrl-C reaches only who asks
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, ask)
    if hasattr(signal, "pthread_sigmask"):  # who started us has held them back until now
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _HELD)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        end_descendants(os.getpid())
        os._exit(int(ExitCode.TERMINATED))
