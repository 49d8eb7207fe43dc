"""Reading a cluster: an address, ``local``, a file, or a section of a campaign."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.cluster.sections import ClusterFileSection, ClusterSection
from geoident.io.schema.faults import add_schema_faults
from geoident.io.schema.values import kind_of
from geoident.io.text.faults import Faults, Places
from geoident.io.text.kinds import refuse_other_kind
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
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
        address = given if "://" in given else f"tcp://{given}"
        return Cluster(address=address, place=Location(f"{Term.CLUSTER} {given}"))
    try:
        is_file = Path(given).is_file()
    except (OSError, ValueError):
        is_file = False
    if not is_file:
        message = f"'{shorten(given)}' is not an address, and there is no file of that name"
        raise InputError([Fault("no-cluster", message, _HINT, Location(str(Term.CLUSTER)))])
    return _of_file(given)


def _of_file(path: str) -> Cluster:
    document = parse_yaml(decode(read_bytes(path, limit=MAX_BYTES, what="cluster"), path), path)
    refuse_other_kind(document, "cluster")
    faults = Faults(Places(document, document.data))
    if not isinstance(document.data, dict):
        message = f"found {kind_of(document.data)}; a mapping is expected"
        faults.add((), "wrong-kind", message, "Begin with 'format: geoident-cluster/1'.")
        faults.raise_any()
    known: dict[int, tuple[str, ...]] = {}
    try:
        section = ClusterFileSection.model_validate(document.data, context=known)
    except ValidationError as error:
        add_schema_faults(faults, error.errors(include_url=False), document.data, known)
        faults.raise_any()
        raise
    cluster = cluster_of(section, (), Path(path).parent, faults)
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
    locate = faults.places.locate
    if section.address is not None and not _ADDRESS.fullmatch(section.address):
        message = f"'{shorten(section.address)}' is not an address"
        faults.add((*at, "address"), "bad-address", message, "Write it like tcp://node1:8786.")
    queue = next((name for name in QUEUES if getattr(section, name) is not None), "")
    options = {name: _plain(value) for name, value in (getattr(section, queue, None) or {}).items()}
    key = queue or ("address" if section.address else LOCAL)
    return Cluster(
        address=_with_protocol(section.address),
        queue=queue,
        options=options,
        jobs=section.jobs or 1,
        keys=_keys(section, at, folder, faults),
        patience=section.patience,
        file=faults.places.document.file,
        place=locate((*at, key)),
        places={name: locate((*at, queue, name)) for name in options},
    )


def _with_protocol(address: str | None) -> str:
    return "" if address is None else address if "://" in address else f"tcp://{address}"


def _keys(section: ClusterSection, at: KeyPath, folder: Path, faults: Faults) -> TlsKeys | None:
    given = section.security
    if given is None:
        return None
    paths = {name: folder / getattr(given, name) for name in ("ca_file", "cert", "key")}
    for name, path in paths.items():
        if not path.is_file():
            message = f"there is no file '{shorten(path)}'"
            hint = "Paths are meant from the folder of this file."
            faults.add((*at, "security", name), "missing-file", message, hint)
    return TlsKeys(**{name: str(path) for name, path in paths.items()})


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
