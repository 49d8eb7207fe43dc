"""The other end of `ChildProcess`: a process that answers tasks until its parent closes its input.

SIGTERM asks it to end its task soon (`STOP`). Ctrl-C does not reach it: the parent passes that on.
It ends with its parent, however that ends.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
from pathlib import Path
from queue import SimpleQueue
from types import FrameType
from typing import BinaryIO

from geoident.errors import ExitCode
from geoident.workflow.executing.descendants import kill_descendants
from geoident.workflow.executing.stop import StopRequest

STOP = StopRequest()
"""The request to end the task that runs; whoever computes long checks it."""

READY, VALUE, RAISED = "ready", "value", "raised"
"""First words of what comes out of the process; a value or an exception follows."""


def serve() -> None:
    """Answer tasks from standard input, after what sets the process up; all of it is pickled."""

    def ask(number: int, frame: FrameType | None) -> None:
        STOP.ask(ExitCode.TERMINATED)

    signal.signal(signal.SIGTERM, ask)
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)  # what tasks start reads no tasks
    os.dup2(2, 1)  # what libraries print is no answer
    sys.stdout = sys.stderr
    pending: SimpleQueue[bytes | None] = SimpleQueue()
    busy = threading.Event()
    threading.Thread(target=_receive, args=(requests, pending, busy), daemon=True).start()

    def send(word: str, value: object) -> None:
        answer = pickle.dumps((word, value))
        busy.clear()
        answers.write(answer)
        answers.flush()

    function = None
    while (request := pending.get()) is not None:
        try:
            if function is None:
                function = pickle.loads(request)()
                send(READY, None)
            else:
                send(VALUE, function(pickle.loads(request)))
        except BrokenPipeError:
            return
        except BaseException as error:
            send(RAISED, error)


def _receive(requests: BinaryIO, pending: SimpleQueue[bytes | None], busy: threading.Event) -> None:
    """Take requests; at their end, the process ends even in the middle of a task."""
    try:
        while True:
            request = pickle.load(requests)
            busy.set()
            pending.put(request)
    except EOFError:
        pending.put(None)
    if busy.is_set():
        kill_descendants(os.getpid())
        os._exit(int(ExitCode.TERMINATED))
