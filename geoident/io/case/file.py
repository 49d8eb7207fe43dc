"""Reading a case file: from text to a case in SI units, or to all that is wrong with it.

Values may be replaced by overrides: ``parameters.E.start=20 GPa``.

Faults are shown in two rounds, each complete: the text, its sections, and what refers to something
else in the case or its readings, as far as that can be said while sections are wrong; and later,
elsewhere, what needs the mesh.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import yaml
from pydantic import BaseModel, ValidationError

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.case.case import CaseSection, ReportSection, build_case, check_references
from geoident.io.case.field import with_measured
from geoident.io.case.gauges.accuracy import described_channels
from geoident.io.case.readings_by_stage import read_all
from geoident.io.case.temperature_file import with_temperatures
from geoident.io.schema.faults import add_schema_faults, paths_of
from geoident.io.schema.partial import Rest, without
from geoident.io.schema.values import kind_of
from geoident.io.text.faults import OVERRIDES, Faults, Places
from geoident.io.text.text_file import STDIN, decode, read_bytes
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.io.text.yaml_reader import MAX_BYTES, Document, Node, parse_yaml
from geoident.model.case import Case, KeyPath, format_path
from geoident.model.methods import LOSS_OPTIONS, METHOD_OPTIONS, method_name
from geoident.model.results.head import ReportHead

STDIN_NAME = "<stdin>"
_STEP = re.compile(r"""\.?(?:([^.\[\]="']+)|\[([0-9]{1,6})\]|\[?"([^"]+)"\]?)""")
_MAY_BE_NEW = {"fit", "report"}
_MOST_KEYS = 16

BLANK = "FILL_IN"
"""Stands in a skeleton for a value that its user is to give: a fault until it is replaced."""

_HINTS = {
    "E": "Young's modulus with its unit, such as 15 GPa, or $NAME of a parameter.",
    "nu": "Poisson's ratio, such as 0.25.",
    "groups": "The name of a material, or absent.",
    "supports": "Groups and the directions in which they are fixed, such as {bottom: [x, y]}.",
    "stages": "The steps of construction, such as [{name: heading, excavate: [GROUP]}].",
    "gauges": "What is measured; the comment there has examples, `geoident schema` all kinds.",
}


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
        computed: what is resolved, without what no computation sees; the same as resolved if empty.
    """

    case: Case
    text: str
    resolved: str
    mesh_path: str | None
    readings_paths: tuple[str, ...]
    files: tuple[str, ...] = ()
    computed: str = ""


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


def parse_case(
    text: str,
    path: str,
    *,
    overrides: Sequence[str] = (),
    with_mesh: bool = True,
    with_texts: bool = True,
) -> LoadedCase:
    """Read the text of a case as if it stood in a file, which need not be there any more.

    Args:
        text: the case.
        path: of that file, for the files that the case names; ``-`` for stdin.
        overrides: see `read_case`.
        with_mesh: whether the file of the mesh has to be there.
        with_texts: whether the case is also wanted as YAML, `resolved` and `computed`.

    Raises:
        InputError: with all faults found.
    """
    document = parse_yaml(text, _shown(path))
    places = apply_overrides(document, overrides)
    refuse_blanks(places)
    folder = Path() if path == STDIN else Path(path).parent
    files = dict.fromkeys((*named_files(document.data, folder), *named_files(places.data, folder)))
    places = with_measured(with_temperatures(places, folder), folder)
    section = _validate(places, folder)
    faults = Faults(places)
    mesh_path = None
    if section.mesh is not None and not with_mesh:
        mesh_path = section.mesh.file
    elif section.mesh is not None:
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
    plain = section.model_copy(update={"report": None})
    resolved, computed = (
        _resolved_text(one, chain) if with_texts else "" for one in (section, plain)
    )
    return LoadedCase(case, text, resolved, mesh_path, read.paths, tuple(files), computed)


class _OnlyReport(BaseModel):
    """The one section of a case of which a report speaks."""

    report: ReportSection | None = None


def read_report_head(text: str, path: str) -> ReportHead:
    """What a case says of its report, whatever else is right or wrong in it.

    Args:
        text: the case.
        path: where it stands or stood; its logo is looked for beside it.

    Raises:
        InputError: the text is no YAML, or its section ``report`` is wrong.
    """
    places = apply_overrides(parse_yaml(text, _shown(path)), ())
    if not isinstance(places.data, dict):
        return ReportHead()
    faults, known = Faults(places), dict[int, tuple[str, ...]]()
    try:
        found = _OnlyReport.model_validate(places.data, context=known).report
    except ValidationError as error:
        add_schema_faults(faults, error.errors(include_url=False), places.data, known)
        faults.raise_any()
        raise
    if found is None:
        return ReportHead()
    logo = str(Path(path).parent / found.logo) if found.logo else ""
    return ReportHead(
        project=found.project,
        author=found.author,
        client=found.client,
        revision=found.revision,
        date=found.date,
        logo=logo,
    )


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


def _validate(places: Places, folder: Path) -> CaseSection:
    """The sections of a case, each right by itself.

    Raises:
        InputError: with what is wrong in them, and what else is, whatever these should have been.
    """
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
            errors = error.errors(include_url=False)
            add_schema_faults(faults, errors, places.data, known)
            faults.extend(_further(without(places, paths_of(errors, places.data)), folder))
        faults.raise_any()
        raise


def _further(rest: Rest | None, folder: Path) -> list[Fault]:
    """What is wrong in the rest of a case that has wrong entries."""
    if rest is None:
        return []
    try:
        section = CaseSection.model_validate(rest.places.data, context={})
    except ValidationError:
        return []  # what is left is no case
    faults = Faults(rest.places)
    if section.mesh is not None:
        _find(folder, section.mesh.file, ("mesh", "file"), faults=faults)
    check_references(section, faults)
    read_all(section, partial(_find, folder, faults=faults), faults)
    return rest.independent(faults.found)


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


def apply_overrides(document: Document, overrides: Sequence[str]) -> Places:
    """A document with overrides, and where its keys are written.

    Args:
        document: the case as written.
        overrides: texts ``path=value``; the value is YAML. A section that is not in the case is
            only made for ``fit`` and ``report``.

    Raises:
        InputError: faulty overrides, located at `OVERRIDES`.
    """
    data = deepcopy(document.data) if overrides else document.data
    faults: list[Fault] = []
    paths: list[KeyPath] = []
    for override in overrides:
        path: KeyPath = ()
        try:
            path, value = _parse(override)
            _set(data, path, value)
            paths.append(path)
        except Refusal as error:
            message = f"'{shorten(override)}': {error.message}"
            location = Location(OVERRIDES)
            faults.append(Fault(error.code, message, error.hint, location, format_path(path)))
    if faults:
        raise InputError(faults)
    return Places(document, data, frozenset(paths))


def _parse(override: str) -> tuple[KeyPath, Node]:
    name, equals, value = override.partition("=")
    if not equals:
        raise Refusal("bad-override", "it has no '='", f"Write {Term.OVERRIDE}.")
    return parse_path(name.strip()), _parse_value(value)


def parse_path(text: str) -> KeyPath:
    """The path of a key as users write it.

    >>> parse_path("stages[1].excavate[0]")
    ('stages', 1, 'excavate', 0)

    Raises:
        Refusal: it is none.
    """
    keys: list[str | int] = []
    at = 0
    while at < len(text):
        step = _STEP.match(text, at)
        if step is None or (at == 0) == text.startswith((".", "["), at):
            break
        keys.append(int(step[2]) if step[2] else step[1] or step[3])
        at = step.end()
    if not keys or at < len(text) or len(keys) > _MOST_KEYS:
        hint = "Write it like parameters.E.start or stages[1].name."
        raise Refusal("bad-override", f"'{shorten(text)}' is not the path of a key", hint)
    return tuple(keys)


def _parse_value(text: str) -> Node:
    try:
        return parse_yaml(text.encode("utf-8").decode("utf-8"), OVERRIDES).data
    except UnicodeEncodeError as error:
        raise Refusal("not-text", "the value is not UTF-8 text") from error
    except InputError as error:
        fault = error.faults[0]
        if fault.code == "empty":
            return None
        raise Refusal(fault.code, f"the value: {fault.message}", fault.hint) from error


def _set(data: Node, path: KeyPath, value: Node) -> None:
    holder = data
    for n, key in enumerate(path[:-1]):
        _require(holder, path[: n + 1], new=path[0] in _MAY_BE_NEW)
        if isinstance(holder, dict):
            if holder.get(str(key)) is None and path[0] in _MAY_BE_NEW:
                holder[str(key)] = {}
            holder = holder[str(key)]
        else:
            holder = cast("list[Node]", holder)[int(key)]
    _require(holder, path, new=True)
    if isinstance(holder, dict) and value is None and path[:-1] == ("parameters",):
        holder.pop(str(path[-1]), None)  # a parameter that is left out
    elif isinstance(holder, dict):
        holder[str(path[-1])] = value
    else:
        cast("list[Node]", holder)[int(path[-1])] = value


def _require(holder: Node, path: KeyPath, *, new: bool) -> None:
    """Refuse a path whose last key its holder does not have, or cannot have."""
    key, outer = path[-1], format_path(path[:-1]) or "the case"
    if isinstance(holder, list) and isinstance(key, int):
        if key >= len(holder):
            message = f"{outer} has {len(holder)} entries, counted from 0; there is no [{key}]"
            hint = f"The last one is [{len(holder) - 1}]." if holder else "It is empty."
            raise Refusal("bad-override", message, hint)
    elif isinstance(holder, dict) and not isinstance(key, int):
        if key not in holder and not new:
            raise Refusal("bad-override", f"{outer} has no '{key}'", did_you_mean(key, holder))
    else:
        kinds = {"dict": "a mapping", "list": "a list"}
        kind = kinds.get(type(holder).__name__, "no mapping and no list")
        raise Refusal("bad-override", f"{outer} is {kind}, '{key}' cannot be set in it")


def refuse_blanks(places: Places) -> None:
    """Raise `InputError` with all values that are left to fill in."""
    faults = Faults(places)
    for path in _blanks(places.data, ()):
        hint = next((_HINTS[str(key)] for key in reversed(path) if str(key) in _HINTS), "")
        faults.add(path, "fill-in", f"{BLANK} is to be replaced", hint or "Give the value.")
    faults.raise_any()


def _blanks(node: Node, path: KeyPath) -> Iterator[KeyPath]:
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _blanks(value, (*path, key))
    elif isinstance(node, list):
        for n, value in enumerate(node):
            yield from _blanks(value, (*path, n))
    elif node == BLANK:
        yield path


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
