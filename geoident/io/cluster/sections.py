"""The keys of a cluster: a scheduler that runs, this machine, or jobs of a queue system."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from geoident.io.schema.duration import GivenTime
from geoident.io.schema.section import Section, SectionFaults, optional
from geoident.io.schema.values import Count, Flag, Name, Text

CHOICES = ("address", "local", "slurm", "pbs", "lsf", "sge")
_QUEUE = (
    "Jobs of {0}: the keys of {1} of dask-jobqueue, such as `cores`, `processes`, `memory`, "
    "`queue`, `walltime`, `job_script_prologue`. They need trust before they are submitted."
)
_EXAMPLE = {"queue": "normal", "cores": 16, "processes": 16, "memory": "64 GB"}
_Jobs = dict[Name, Any]


class SecuritySection(Section):
    """Encryption between this command, the scheduler and the workers (TLS)."""

    ca_file: Text = Field(description="Path of the certificate of the authority.")
    cert: Text = Field(description="Path of the certificate of this command.")
    key: Text = Field(description="Path of its private key.")


class ClusterSection(Section):
    """Where runs are computed: a scheduler of dask, this machine, or jobs of a queue system."""

    address: Text | None = optional(
        "Address of a scheduler that runs, which can run any program here as you; "
        "it needs trust before it is connected to.",
        examples=["tcp://node1:8786"],
    )
    local: Flag = Field(False, description="A scheduler and workers on this machine.")
    slurm: _Jobs | None = optional(_QUEUE.format("Slurm", "SLURMCluster"), examples=[_EXAMPLE])
    pbs: _Jobs | None = optional(_QUEUE.format("PBS", "PBSCluster"))
    lsf: _Jobs | None = optional(_QUEUE.format("LSF", "LSFCluster"))
    sge: _Jobs | None = optional(_QUEUE.format("SGE", "SGECluster"))
    jobs: Annotated[int, Count()] | None = optional(
        "Number of jobs of the queue system; by default 1.", examples=[10]
    )
    security: SecuritySection | None = optional(
        "Of a scheduler at an address `tls://...`: the files for encryption."
    )
    patience: GivenTime = Field(
        60.0, description="Time that a scheduler which was lost is waited for.", examples=["10 min"]
    )

    def check(self, faults: SectionFaults) -> None:
        """Exactly one place to compute, and keys that suit it."""
        given = [name for name in CHOICES if getattr(self, name) not in (None, False)]
        if len(given) != 1:
            message = f"found {' and '.join(given) or 'nothing'}; one of {', '.join(CHOICES)} is "
            faults.add((), "wrong-pair", f"{message}expected", "Write {address: tcp://host:8786}.")
        elif self.jobs is not None and given[0] in ("address", "local"):
            message = "'jobs' are of a queue system"
            faults.add(("jobs",), "wrong-key", message, "Remove it, or name a queue system.")
        elif self.security is not None and not (self.address or "").startswith("tls://"):
            message = "'security' needs an address that begins with tls://"
            faults.add(("security",), "wrong-key", message, "Correct the address, or remove it.")


class ClusterFileSection(ClusterSection):
    """A cluster file for geoident: where runs are computed."""

    format: Literal["geoident-cluster/1"] = Field(description="Type and version of this file.")
