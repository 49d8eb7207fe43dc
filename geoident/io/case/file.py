"""Reading a case file: from text to a case in SI units, or to all that is wrong with it.

Values may be replaced by overrides: ``parameters.E.start=20 GPa``.

All faults are shown at once: those of the text, of its sections, and of what refers to something
else in the case or its readings, as far as that can be said while sections are wrong. What is left
without the faulty entries goes with them (`FaultyCase`), so that it can be held against the mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from geoident.errors import Fault, InputError
from geoident.io.case.case import (
    CaseSection,
    build_case,
    tied_parameters,
)
from geoident.io.case.external.build import build_elsewhere
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.case.external.table import within_runs
from geoident.io.case.face import with_zero_stages
from geoident.io.case.gauges.channel_errors import described_channels
from geoident.io.case.ladder import names_in_text
from geoident.io.case.readings_by_stage import read_all
from geoident.io.case.references import check_references
from geoident.io.case.site_files.measured_values import with_measured
from geoident.io.case.site_files.point_tables import with_tables
from geoident.io.loaded import LoadedCase
from geoident.io.schema.faults import add_schema_faults, likely_tags, node_at, paths_of
from geoident.io.schema.partial import ValidPart
from geoident.io.schema.values import kind_of, tied_parameter
from geoident.io.text.faults import Faults, Places
from geoident.io.text.head import refuse_no_case
from geoident.io.text.kinds import refuse_other_kind
from geoident.io.text.named_files import named_files
from geoident.io.text.overrides import apply_overrides
from geoident.io.text.text_file import STDIN, decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.io.text.yaml_reader import MAX_BYTES, Node, parse_yaml
from geoident.io.text.yaml_writer import yaml_text
from geoident.model.case import Case, KeyPath
from geoident.model.external import ExternalSource, RunTable
from geoident.model.methods import LOSS_OPTIONS, METHOD_OPTIONS, method_name

STDIN_NAME = "<stdin>"

BLANK = "FILL_IN"
"""Stands in a skeleton for a value that its user is to give: a fault until it is replaced."""

_HINTS = {
    "E": "Young's modulus with its unit, such as 15 GPa, or $NAME of a parameter.",
    "nu": "Poisson's ratio, such as 0.25.",
    "groups": "The name of a material, or absent.",
    "supports": "Groups and the directions in which they are held, such as {bottom: [x, y]}.",
    "stages": "The steps of construction, such as [{name: heading, excavate: [GROUP]}].",
    "gauges": "What is measured; the comment there has examples, `geoident schema` all kinds.",
}


def read_case(path: str, *, overrides: Sequence[str] = ()) -> LoadedCase:
    """Read a case file and its readings; the mesh is not opened.

    Args:
        path: the file, ``-`` for stdin.
        overrides: texts ``path=value`` that replace values of the file, in their order.

    Raises:
        InputError: with all faults found.
    """
    content = read_bytes(path, limit=MAX_BYTES, what="case")
    refuse_no_case(content, path)
    text = decode(content, _shown(path))
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
    refuse_other_kind(document, "case")
    places = apply_overrides(document, overrides)
    idle = _left_idle(document.data, places.data)
    if idle:
        places = apply_overrides(document, [*overrides, *(f"parameters.{n}=null" for n in idle)])
    folder = Path() if path == STDIN else Path(path).parent
    files = named_files([document.data, places.data], folder)
    section, places = _validate(places, folder)
    faults = Faults(places)
    case, paths = _build(section, folder, faults, with_mesh=with_mesh)
    if faults.found:
        left = _left(ValidPart.all_of(places), faults, case, folder)
        raise FaultyCase(faults, left)
    case = replace(case, notes=(*case.notes, *_idle_notes(idle)))
    chain = [method_name(options) for options in case.fit.methods]
    resolved = computed = _resolved_text(section, chain) if with_texts else ""
    if with_texts and section.report is not None:
        computed = _resolved_text(section.model_copy(update={"report": None}), chain)
    return LoadedCase(case, text, resolved, case.mesh_file, paths, files, computed)


def _left_idle(written: object, changed: object) -> list[str]:
    """Parameters of which overrides have taken away all that depended on them.

    Args:
        written: the case as it is written.
        changed: the case with its overrides.
    """
    if not (isinstance(written, Mapping) and isinstance(changed, Mapping)):
        return []
    had, has = written.get("parameters"), changed.get("parameters")
    if not (isinstance(had, Mapping) and isinstance(has, Mapping)):
        return []
    lost = _tied(written) - _tied(changed)
    return [name for name in has if name in lost and name in had]


def _tied(node: object) -> set[str]:
    """Parameters to which numbers of a document are tied, or the changes of its ladder tie them."""
    if isinstance(node, Mapping):
        ladder = names_in_text(str(node.get("ladder", "")))
        return ladder.union(*map(_tied, node.values()))
    if isinstance(node, list):
        return set().union(*map(_tied, node))
    name = tied_parameter(node) if isinstance(node, str) else None
    return set() if name is None else {name}


def _idle_notes(names: Sequence[str]) -> tuple[str, ...]:
    """What is to be known of parameters that overrides have left idle."""
    if not names:
        return ()
    them = "them" if len(names) > 1 else "it"
    word = "are not sought" if len(names) > 1 else "is not sought"
    return (f"{', '.join(names)} {word}: overrides took away what depended on {them}",)


def _build(
    section: CaseSection, folder: Path, faults: Faults, *, with_mesh: bool = True
) -> tuple[Case, tuple[str, ...]]:
    """The case of sections that are right by themselves, and the paths of its readings.

    What is wrong beyond the sections is noted.
    """
    gauges = with_zero_stages(section.gauges, section.stages, faults)
    section = section.model_copy(update={"gauges": gauges})
    mesh_path = None
    if section.mesh is not None and not with_mesh:
        mesh_path = section.mesh.file
    elif section.mesh is not None:
        mesh_path = _find(folder, section.mesh.file, ("mesh", "file"), faults=faults)
    check_references(section, faults)
    read = read_all(section, partial(_find, folder, faults=faults), faults)
    built = build_case(section, faults)
    elsewhere = _elsewhere(section, built, read.dates, folder, faults) if with_mesh else None
    if isinstance(elsewhere, RunTable):
        built = replace(built, parameters=within_runs(built.parameters, elsewhere))
    case = replace(
        read.given_to(built),
        channels=described_channels(built, section, read.zeros, faults),
        mesh_file=mesh_path,
        elsewhere=elsewhere,
    )
    return case, read.paths


def _elsewhere(
    section: CaseSection, case: Case, dates: Mapping[str, float], folder: Path, faults: Faults
) -> ExternalSource | None:
    """The program, function, table or law of a case; None for one of ground."""
    if section.model is None:
        return None
    around = ModelContext(
        parameters={parameter.name: parameter for parameter in case.parameters},
        channels=case.channels,
        stages=case.stage_names[1:],
        tied=tied_parameters(section),
        folder=folder,
        find=partial(_find, folder, faults=faults),
        faults=faults,
        dates=dates,
    )
    return build_elsewhere(section.model, around)


@dataclass(frozen=True)
class PartOfCase:
    """What is left of a faulty case without its faulty entries, to be held against its mesh.

    Args:
        case: that part.
        mesh_path: path of the mesh.
        rest: what was left out, and what therefore cannot be said.
    """

    case: Case
    mesh_path: str
    rest: ValidPart


class FaultyCase(InputError):
    """A case with faults of its text; some of it may be right.

    Args:
        found: the faults.
        sound: what is right, where it is a case with a mesh.
    """

    def __init__(self, found: Faults, sound: PartOfCase | None) -> None:
        self._found, self.sound = found, sound
        super().__init__(found.shown())

    def with_those_of_the_mesh(
        self, further: Iterable[Fault], groups: Iterable[str] = ()
    ) -> InputError:
        """The same with what its mesh has shown to be wrong in what is left.

        Args:
            further: faults of what is left.
            groups: element groups of the mesh.
        """
        stand = self.sound.rest.independent(further) if self.sound else ()
        found = [_with_group(fault, groups) for fault in self._found.found]
        return InputError(Faults(self._found.places, [*found, *stand]).shown())


def _with_group(fault: Fault, groups: Iterable[str]) -> Fault:
    """A fault about a group that the case does not have, with its remedy if the mesh has it."""
    name = next((name for name in groups if f"no group '{name}' " in fault.message), "")
    if fault.code != "unknown-group" or not name:
        return fault
    hint = f"The mesh has it: add '{name}: MATERIAL' to 'groups', or '{name}: absent' for ground "
    return replace(fault, hint=f"{hint}that a stage installs.")


_ROUNDS = 5
"""Times that what is left of a case may show further faults when these are left out as well."""


def _left(rest: ValidPart, faults: Faults, case: Case, folder: Path) -> PartOfCase | None:
    """What is left of a case without all that is wrong in it; None where that is no case.

    Args:
        rest: the case without entries that are wrong by themselves.
        faults: what else was found in it.
        case: what was built of it.
        folder: of the case.
    """
    left = rest
    for _ in range(_ROUNDS):
        paths = faults.of_keys()
        if not paths or not left.sequence_is_known:  # then nothing asks for what they name
            wrong = {fault.location for fault in faults.found}
            sound = tuple(r for r in case.readings if not {r.location, r.when} & wrong)
            case = replace(case, readings=sound)
            mesh = case.mesh_file
            return None if mesh is None else PartOfCase(case, mesh, left)
        fewer = left.without(paths)
        if fewer is None:
            return None
        left, faults = fewer, Faults(fewer.places)
        try:
            section = CaseSection.model_validate(left.places.data, context={})
        except ValidationError:
            return None
        case, _ = _build(section, folder, faults)
    return None


def _shown(path: str) -> str:
    return STDIN_NAME if path == STDIN else path


def _validate(places: Places, folder: Path) -> tuple[CaseSection, Places]:
    """The sections of a case, each right by itself, and the case with the tables of its files.

    Raises:
        InputError: with what is wrong in them or left to fill in, and what else is, whatever these
            should have been.
    """
    faults = Faults(places)
    blanks = list(_blanks(places.data, ()))
    for path in blanks:
        hint = next((_HINTS[str(key)] for key in reversed(path) if str(key) in _HINTS), "")
        faults.add(path, "fill-in", f"{BLANK} is to be replaced", hint or "Give the value.")
    if not isinstance(places.data, dict):
        hint = "Begin with 'format: geoident-case/1'."
        message = f"found {kind_of(places.data)}; a mapping is expected"
        faults.add((), "wrong-kind", message, hint)
        faults.raise_any()
    for read_files in (with_tables, with_measured):
        places = read_files(places, folder, faults)
    paths = faults.of_keys()
    known: dict[int, tuple[str, ...]] = {}
    try:
        section = CaseSection.model_validate(places.data, context=known)
        if not faults.found:
            return section, places
    except ValidationError as error:
        found = error.errors(include_url=False)
        found += _behind_wrong_words(likely_tags(found, places.data), places.data, known)
        errors = [
            one
            for one, path in zip(found, paths_of(found, places.data), strict=True)
            if not any(path[: len(given)] == given for given in paths)
        ]
        add_schema_faults(faults, errors, places.data, known)
        paths += paths_of(errors, places.data)
    left = _further(ValidPart.all_of(places).without(paths), faults, folder)
    raise FaultyCase(faults, left)


def _behind_wrong_words(
    likely: Mapping[KeyPath, str], data: Node, known: dict[int, tuple[str, ...]]
) -> list[ErrorDetails]:
    """What else is wrong in mappings of which the word that says what they are is misspelt.

    Args:
        likely: path of such a word to what was probably meant.
        data: of the case, in which these words are put for the time of this call.
        known: gets the keys of these mappings.
    """
    written = {path: node_at(data, path) for path in likely}
    try:
        for path, word in likely.items():
            _put(data, path, word)
        CaseSection.model_validate(data, context=known)
    except ValidationError as error:
        found = error.errors(include_url=False)
        inside = {path[:-1] for path in likely}
        return [
            one
            for one, path in zip(found, paths_of(found, data), strict=True)
            if any(path[: len(holder)] == holder for holder in inside)
        ]
    finally:
        for path, node in written.items():
            _put(data, path, node)
    return []


def _put(data: Node, path: KeyPath, node: Node) -> None:
    """Put a node in the place of another."""
    holder = node_at(data, path[:-1])
    if isinstance(holder, dict):
        holder[str(path[-1])] = node


def _further(rest: ValidPart | None, faults: Faults, folder: Path) -> PartOfCase | None:
    """Note what is wrong in the rest of a case that has wrong entries; what is left then."""
    if rest is None:
        return None
    try:
        section = CaseSection.model_validate(rest.places.data, context={})
    except ValidationError:
        return None  # what is left is no case
    found = Faults(rest.places)
    case, _ = _build(section, folder, found)
    faults.extend(rest.independent(found.found))
    return _left(rest, found, case, folder)


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
        message = f"there is no file '{shorten(path)}'"
        if _is_folder(path):
            message = f"'{shorten(path)}' is a folder; a file is expected"
        faults.add(key, "missing-file", message, hint)
    return str(path)


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


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
    return yaml_text(_without_empty(data))


def _without_empty(node: Any) -> Any:
    """The same without empty lists and mappings, which stand for missing keys."""
    if isinstance(node, Mapping):
        return {key: _without_empty(value) for key, value in node.items() if value not in ({}, [])}
    if isinstance(node, list):
        return [_without_empty(value) for value in node]
    return node if isinstance(node, str) else str(node).lower()
