"""Where the tasks of a campaign are computed, other than in processes of this command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from geoident.errors import Fault, InputError, Location, Term

QUEUES = {"slurm": "SLURMCluster", "pbs": "PBSCluster", "lsf": "LSFCluster", "sge": "SGECluster"}
"""Queue systems by their names in cluster files, and the classes of dask-jobqueue."""

LOCAL = "local"


@dataclass(frozen=True)
class TlsKeys:
    """Files of a cluster with encryption (TLS).

    Args:
        ca_file: certificate of the authority.
        cert: own certificate.
        key: private key of it.
    """

    ca_file: str
    cert: str
    key: str


@dataclass(frozen=True)
class Cluster:
    """A cluster of dask.

    Args:
        address: of a scheduler that runs; empty if there is none yet.
        queue: a key of `QUEUES`, if jobs of a queue system compute; else empty.
        options: of the jobs, as dask-jobqueue names them.
        jobs: number of jobs.
        keys: for encryption, or None.
        patience: seconds that a scheduler which was lost is waited for.
        file: path of the file that says all this; empty where who calls does.
        place: where all this is written.
        places: where each option of the jobs is written.
    """

    address: str = ""
    queue: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    jobs: int = 1
    keys: TlsKeys | None = None
    patience: float = 60.0
    file: str = ""
    place: Location = Location(str(Term.CLUSTER))
    places: Mapping[str, Location] = field(default_factory=dict)

    @property
    def local(self) -> bool:
        """Workers are started on this machine."""
        return not self.address and not self.queue

    def refused(self, code: str, message: str, hint: str) -> InputError:
        """An error of this cluster, where it is written.

        Args:
            code: short name of the kind of fault.
            message: what was found.
            hint: the remedy.
        """
        return InputError([Fault(code, message, hint, self.place)])
