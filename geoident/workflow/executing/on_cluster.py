"""A cluster as the place where one command has what it can compute at a time computed.

A campaign sends whole runs there, and the search of one case sends parts of itself: both are tasks
of a `DaskCluster`, begun by the same two steps, and their processes work in a folder of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

from geoident.model.cluster import Cluster
from geoident.workflow.executing.cluster import DaskCluster
from geoident.workflow.executing.connection import require_scheduler
from geoident.workflow.executing.executor import SetUp
from geoident.workflow.executing.parcel import Parcel, own_copy, packed

T = TypeVar("T")
R = TypeVar("R")


class OnCluster:
    """Begins executors of one command on a cluster.

    Args:
        cluster: which one.
        jobs: number of workers, where they are started here; None for the cores there are.
        tell: is told what people should know.

    Attributes:
        used: an executor was begun.
    """

    def __init__(self, cluster: Cluster, jobs: int | None, tell: Callable[[str], None]) -> None:
        self._cluster, self._jobs, self._tell = cluster, jobs, tell
        self.used = False

    def require(self) -> None:
        """Say at once that nobody is there, before anything else is computed.

        Raises:
            InputError: nobody answers at the address.
        """
        require_scheduler(self._cluster)

    def begin(
        self,
        set_up: SetUp[T, R],
        parcel: Parcel | None = None,
        *,
        check: Callable[[], None] = lambda: None,
    ) -> DaskCluster[T, R]:
        """An executor; a context.

        Args:
            set_up: gives, in a process of a worker, the function that answers tasks. It is pickled.
            parcel: files that tasks read; None for none.
            check: is called every moment while somebody waits for an answer; raises to end all.
        """
        self.used = True
        files = packed({}) if parcel is None else parcel
        return DaskCluster(
            self._cluster, partial(in_own_folder, files.here, set_up), files,
            jobs=self._jobs, tell=self._tell, check=check,
        )  # fmt: skip


def in_own_folder(here: str, set_up: SetUp[T, R], unpacked: Path) -> Callable[[T], R]:
    """In a process far away: work in a copy of the files of its own, as if it were here.

    Args:
        here: where paths are meant from, as seen from the folder of the files.
        set_up: gives the function that answers tasks.
        unpacked: folder of the files.
    """
    own_copy(unpacked, here)
    return set_up()
