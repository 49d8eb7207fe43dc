"""Reading a case file: from text to a case in SI units, or to all that is wrong with it.

Faults are shown in three rounds, each complete: the text and its sections; what refers to something
else in the case or its readings; and later, elsewhere, what needs the mesh.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from geoident.errors import InputError
from geoident.io.case.accuracy import described_channels
from geoident.io.case.case import CaseSection, build_case
from geoident.io.case.overrides import apply_overrides
from geoident.io.case.readings_by_stage import read_all
from geoident.io.case.references import check_references
from geoident.io.case.temperature_file import with_temperatures
from geoident.io.schema.faults import add_schema_faults
from geoident.io.schema.values import kind_of
from geoident.io.text.blanks import refuse_blanks
from geoident.io.text.faults import Faults, Places
from geoident.io.text.text_file import STDIN, decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.io.text.yaml_reader import MAX_BYTES, Node, parse_yaml
from geoident.model.case import Case, KeyPath
from geoident.model.methods import LOSS_OPTIONS, METHOD_OPTIONS, method_name

STDIN_NAME = "<stdin>"


@dataclass(frozen=True)
class LoadedCase:
    """A case and the texts that it comes from.

    Args:
        case: the case.
        text: the file verbatim.
        resolved: the same as YAML with overrides and defaults filled in, without comments.
        mesh_path: path of the mesh, relative paths against the folder of the case; None for none.
        readings_paths: paths of the files of readings, in their order.
        files: paths of all files that the case names, with overrides or without, and that exist.
    """

    case: Case
    text: str
    resolved: str
    mesh_path: str | None
    readings_paths: tuple[str, ...]
    files: tuple[str, ...] = ()


def read_case(path: str, *, overrides: Sequence[str] = ()) -> LoadedCase:
    """Read a case file and its readings; the mesh is not opened.

    Args:
        path: the file, ``-`` for stdin.
        overrides: texts ``path=value`` that replace values of the file, in their order.

    Raises:
        InputError: with all faults found.
    """
    text = decode(read_bytes(path, limit=MAX_BYTES, what="case"), _shown(path))
    return parse_case(text, path, overrides=overrides)


def parse_case(text: str, path: str, *, overrides: Sequence[str] = ()) -> LoadedCase:
    """Read the text of a case as if it stood in a file, which need not be there any more.

    Args:
        text: the case.
        path: of that file, for the files that the case names; ``-`` for stdin.
        overrides: see `read_case`.

    Raises:
        InputError: with all faults found.
    """
    document = parse_yaml(text, _shown(path))
    places = apply_overrides(document, overrides)
    refuse_blanks(places)
    folder = Path() if path == STDIN else Path(path).parent
    files = dict.fromkeys((*named_files(document.data, folder), *named_files(places.data, folder)))
    places = with_temperatures(places, folder)
    section = _validate(places)
    faults = Faults(places)
    mesh_path = None
    if section.mesh is not None:
        mesh_path = _find(folder, section.mesh.file, ("mesh", "file"), faults=faults)
    check_references(section, faults)
    read = read_all(section, partial(_find, folder, faults=faults), faults)
    built = build_case(section, faults)
    case = replace(
        built,
        channels=described_channels(built, section, read.zeros, faults),
        mesh_file=mesh_path,
        readings=read.readings,
        dates=read.dates,
        notes=read.notes,
        when_read=read.by_stage,
    )
    faults.raise_any()
    chain = [method_name(options) for options in case.fit.methods]
    resolved = _resolved_text(section, chain)
    return LoadedCase(case, text, resolved, mesh_path, read.paths, tuple(files))


def files_of_text(text: str, path: str) -> tuple[str, ...]:
    """Paths of the files that the text of a case names and that exist; none of a faulty text.

    Args:
        text: the case.
        path: where it stands or stood.
    """
    try:
        return tuple(named_files(parse_yaml(text, path).data, Path(path).parent))
    except InputError:
        return ()


def named_files(data: Node, folder: Path) -> Iterator[str]:
    """Paths of the files that a case names: of every text in it that is the name of a file.

    Args:
        data: the case as mappings, lists and texts.
        folder: against which its paths are meant.
    """
    if isinstance(data, dict | list):
        for part in data.values() if isinstance(data, dict) else data:
            yield from named_files(part, folder)
    elif data is not None:
        with suppress(OSError, ValueError):  # too long or strange for a name
            if (folder / data).is_file():
                yield str(folder / data)


def _shown(path: str) -> str:
    return STDIN_NAME if path == STDIN else path


def _validate(places: Places) -> CaseSection:
    """The sections of a case, each right by itself."""
    faults = Faults(places)
    known: dict[int, tuple[str, ...]] = {}
    try:
        if not isinstance(places.data, dict):
            hint = "Begin with 'format: geoident-case/1'."
            message = f"found {kind_of(places.data)}; a mapping is expected"
            faults.add((), "wrong-kind", message, hint)
        return CaseSection.model_validate(places.data, context=known)
    except ValidationError as error:
        if not faults.found:
            add_schema_faults(faults, error.errors(include_url=False), places.data, known)
        faults.raise_any()
        raise


def _find(folder: Path, name: str, key: KeyPath, *, faults: Faults) -> str:
    """Path of a file that the case names; a fault if it is not there."""
    path = folder / name
    try:
        missing = not path.exists() or path.is_dir()
        beside = [p.name for p in path.parent.iterdir() if p.suffix == path.suffix and missing]
    except (OSError, ValueError):
        missing, beside = True, []
    if missing:
        what = f"Files *{path.suffix} in the folder {path.parent}"
        hint = faults.did_you_mean(path.name, beside, what=what)
        faults.add(key, "missing-file", f"there is no file '{shorten(path)}'", hint)
    return str(path)


def _resolved_text(section: CaseSection, chain: Sequence[str]) -> str:
    """The case as YAML, without empty sections and options of methods and losses not used.

    Quantities stay as they were written, so that the text can be read as a case again.

    Args:
        section: the case.
        chain: names of the methods, those that stand for a missing one among them.
    """
    data = section.model_dump(by_alias=True, exclude_none=True)
    fit: dict[str, Any] = {"method": chain[0], **data["fit"]}
    data["fit"] = fit
    for name in (METHOD_OPTIONS.keys() | LOSS_OPTIONS.keys()) - {*chain, section.fit.loss}:
        fit.pop(name, None)
    return yaml.dump(
        _without_empty(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100
    )


def _without_empty(node: Any) -> Any:
    """The same without empty lists and mappings, which stand for missing keys."""
    if isinstance(node, Mapping):
        return {key: _without_empty(value) for key, value in node.items() if value not in ({}, [])}
    if isinstance(node, list):
        return [_without_empty(value) for value in node]
    return node if isinstance(node, str) else str(node).lower()


class _Dumper(yaml.SafeDumper):
    """Leaves out the quotes wherever `yaml_reader` reads the same text without them."""

    def ignore_aliases(self, data: object) -> bool:
        return True


_NULL = re.compile(r"(?:~|null|Null|NULL|)$")
_Dumper.yaml_implicit_resolvers = {}
_Dumper.add_implicit_resolver("tag:yaml.org,2002:null", _NULL, ["~", "n", "N", ""])
