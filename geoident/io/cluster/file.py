"""Reading a cluster: an address, ``local``, a file, or a section of a campaign."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.cluster.sections import ClusterFileSection, ClusterSection
from geoident.io.schema.run_file import is_file, open_run_file, require_file, validated
from geoident.io.text.faults import Faults
from geoident.io.text.wording import shorten
from geoident.model.case import KeyPath
from geoident.model.cluster import LOCAL, QUEUES, Cluster, TlsKeys

_ADDRESS = re.compile(r"(?:[a-z]+://)?(?:\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_.-]+):[0-9]{1,5}")
_HINT = "Give an address such as tcp://node1:8786, the word local, or a cluster file."


def read_cluster(given: str) -> Cluster:
    """What ``--cluster`` says.

    Args:
        given: an address, ``local``, or the path of a file.

    Raises:
        InputError: with all faults found.
    """
    if given == LOCAL:
        return Cluster()
    if _ADDRESS.fullmatch(given):
        return Cluster(address=_with_protocol(given), place=Location(f"{Term.CLUSTER} {given}"))
    if not is_file(Path(given)):
        message = f"'{shorten(given)}' is not an address, and there is no file of that name"
        raise InputError([Fault("no-cluster", message, _HINT, Location(str(Term.CLUSTER)))])
    faults = open_run_file(given, "cluster")
    section = validated(ClusterFileSection, faults, "cluster")
    cluster = cluster_of(section, (), Path(given).parent, faults)
    faults.raise_any()
    return cluster


def cluster_of(section: ClusterSection, at: KeyPath, folder: Path, faults: Faults) -> Cluster:
    """A cluster for the executor.

    Args:
        section: of a file.
        at: where it stands there.
        folder: of the file.
        faults: takes what is wrong, and knows the places.
    """
    locate, address = faults.places.locate, section.address or ""
    if section.address is not None and not _ADDRESS.fullmatch(address):
        message = f"'{shorten(address)}' is not an address"
        faults.add((*at, "address"), "bad-address", message, "Write it like tcp://node1:8786.")
    queue = next((name for name in QUEUES if getattr(section, name) is not None), "")
    options = {name: _plain(value) for name, value in (getattr(section, queue, None) or {}).items()}
    keys = None
    if section.security is not None:
        files = {name: folder / file for name, file in section.security}
        for name, file in files.items():
            require_file(file, (*at, "security", name), faults, "campaign" if at else "cluster")
        keys = TlsKeys(**{name: str(file) for name, file in files.items()})
    return Cluster(
        address=_with_protocol(address),
        queue=queue,
        options=options,
        jobs=section.jobs or 1,
        keys=keys,
        patience=section.patience,
        file=faults.places.document.file,
        place=locate((*at, queue or ("address" if address else LOCAL))),
        places={name: locate((*at, queue, name)) for name in options},
    )


def _with_protocol(address: str) -> str:
    return f"tcp://{address}" if address and "://" not in address else address


def _plain(value: Any) -> Any:
    """A value as dask-jobqueue takes it: whole numbers and yes or no are no texts.

    >>> _plain({"port": "8786"}), _plain("64 GB"), _plain(["-l true"])
    ({'port': 8786}, '64 GB', ['-l true'])
    """
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if isinstance(value, str):
        words = {"true": True, "false": False, "null": None}
        return int(value) if value.isdecimal() else words.get(value, value)
    return value
