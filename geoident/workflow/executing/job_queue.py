"""Workers of dask as jobs of a queue system: what dask-jobqueue makes of a cluster file."""

from __future__ import annotations

import inspect
import signal
import sys
import threading
from contextlib import suppress
from difflib import get_close_matches
from typing import Any

import dask
from distributed import Status

from geoident.errors import Fault, InputError
from geoident.model.cluster import QUEUES, Cluster

_OURS = {"self", "name", "n_workers", "asynchronous", "loop", "config_name", "scheduler",
         "scheduler_cls", "job_cls"}  # fmt: skip
"""Arguments that are not for a file."""


def known_options(queue: str) -> tuple[str, ...]:
    """Names of the options of jobs, as dask-jobqueue has them.

    Args:
        queue: a key of `QUEUES`.
    """
    options: dict[str, None] = {}
    cluster = _class_of(queue)
    for kind in (*cluster.job_cls.__mro__, *cluster.__mro__):
        if kind.__module__.startswith("dask_jobqueue"):
            parameters = inspect.signature(kind.__init__).parameters.values()
            kept = [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD,
                                                             p.KEYWORD_ONLY)]  # fmt: skip
            options |= dict.fromkeys(name for name in kept if name not in _OURS)
    return tuple(options)


def check_options(cluster: Cluster) -> None:
    """Refuse options that dask-jobqueue does not know.

    Raises:
        InputError: with all of them, where they are written.
    """
    known = known_options(cluster.queue)
    faults = []
    for name in cluster.options:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"Did you mean '{near[0]}'?" if near else f"Known are {', '.join(known)}."
            message = f"{QUEUES[cluster.queue]} of dask-jobqueue has no key '{name}'"
            place = cluster.places.get(name, cluster.place)
            faults.append(Fault("unknown-key", message, hint, place, f"{cluster.queue}.{name}"))
    if faults:
        raise InputError(faults)


def job_queue(cluster: Cluster) -> Any:
    """A scheduler in this process, and jobs for its workers, which are kept at their number.

    Args:
        cluster: which queue system, and its options.

    Raises:
        InputError: the options are not right.
    """
    check_options(cluster)
    made: Any = None
    try:
        made = _class_of(cluster.queue)(**_options(cluster))
        for _ in range(cluster.jobs):  # as made.scale, which would not tell what goes wrong
            made.worker_spec.update(made.new_worker_spec())
        made.sync(made._correct_state)
    except (TypeError, ValueError, OSError, RuntimeError) as error:
        if made is not None:
            for worker in made.workers.values():  # they have not come about
                worker.status = Status.failed
            made.workers.clear()
            made.worker_spec.clear()
            with suppress(Exception):
                made.close(timeout=5.0)
        raise _wrong(cluster, error) from error
    made.adapt(minimum_jobs=cluster.jobs, maximum_jobs=cluster.jobs)
    return made


def _options(cluster: Cluster) -> dict[str, Any]:
    """The options of jobs, with a page of dask at a port that is free.

    Python is begun with ``-P``: a job begins in the folder from which it is submitted, and is to
    import nothing that lies there.
    """
    options = dict(cluster.options)
    ours = {"dashboard_address": ":0"}
    of_scheduler = options.get("scheduler_options") or {}
    if not isinstance(of_scheduler, dict):
        raise TypeError("scheduler_options are no mapping")
    python = options.get("python") or dask.config.get(f"jobqueue.{cluster.queue}.python", None)
    return {
        **options,
        "python": f"{python or sys.executable} -P",
        "scheduler_options": ours | of_scheduler,
    }


def _wrong(cluster: Cluster, error: Exception) -> InputError:
    hint = "The keys are those of dask-jobqueue; cores and memory of a job are always needed."
    return cluster.refused("bad-cluster", _said(error), hint)


def _said(error: Exception) -> str:
    """What went wrong, in one line: that of the queue system, if it has said something."""
    text = str(error)
    _, _, heard = text.partition("stderr:\n")
    lines = (heard if heard.strip() else text).strip().splitlines()
    return f"the jobs cannot be submitted: {lines[0] if lines else type(error).__name__}"


def job_script(cluster: Cluster) -> str:
    """What would be given to the queue system for each job; nothing is begun, nothing written.

    Options that do not stand in the script, such as those of the scheduler, follow it.

    Args:
        cluster: which queue system, and its options.

    Raises:
        InputError: the options are not right.
    """
    check_options(cluster)
    kind = _class_of(cluster.queue)
    from dask_jobqueue.core import JobQueueCluster  # noqa: PLC0415 - see there

    of_scheduler = set(inspect.signature(JobQueueCluster.__init__).parameters)
    apart = of_scheduler - {"interface", "protocol"} | {"log_directory"}  # which would be made
    try:
        of_job = {name: value for name, value in _options(cluster).items() if name not in apart}
        script = kind.job_cls("tcp://SCHEDULER:PORT", name="NAME", **of_job).job_script()
    except (TypeError, ValueError) as error:
        raise _wrong(cluster, error) from error
    others = [f"{name}: {value}" for name, value in cluster.options.items() if name in apart]
    return "\n".join([str(script).rstrip(), *others])


def _class_of(queue: str) -> Any:
    before = signal.getsignal(signal.SIGINT)
    import dask_jobqueue  # noqa: PLC0415 - it takes Ctrl-C to itself

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, before)
    return getattr(dask_jobqueue, QUEUES[queue])
