"""Where a result comes from, in words that its reader can check."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from geoident import __version__
from geoident.io.text.text_file import STDIN, seen_from
from geoident.model.result import Provenance
from geoident.workflow.running.inputs import Inputs
from geoident.workflow.running.jobs import Job

LIBRARIES = ("numpy", "scipy", "h5py", "meshio", "pyyaml", "pydantic")


def provenance(
    inputs: Inputs, *, command: str, identity: str, seed: int, output: Path
) -> Provenance:
    """The provenance of a result that goes to ``output``.

    Args:
        inputs: the case and its mesh.
        command: its name.
        identity: hash of all that the result depends on.
        seed: of random numbers.
        output: path of the result.
    """
    return Provenance(
        command=command,
        versions=versions(),
        seed=seed,
        # relative to the folder of the result, so that both may move
        case_file=seen_from(output.parent, "stdin" if inputs.path == STDIN else inputs.path),
        case_sha256=inputs.case_sha256,
        mesh_sha256=inputs.mesh_sha256,
        readings_sha256=inputs.readings_sha256,
        identity=identity,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
    )


def job_provenance(job: Job) -> Provenance:
    """The provenance of the result of a job."""
    return provenance(
        job.inputs,
        command=job.command,
        identity=job.identity,
        seed=job.request.seed,
        output=job.place.path,
    )


def versions() -> dict[str, str]:
    """Versions of geoident, of Python and of the libraries that numbers go through."""
    found = {"geoident": __version__, "python": platform.python_version()}
    return found | {name: version(name) for name in LIBRARIES}
