"""Reading a case file: from text to a case in SI units, or to all that is wrong with it.

Values may be replaced by overrides: ``parameters.E.start=20 GPa``.

Faults come in rounds. Every section is judged by itself first. A check that takes several sections,
or the readings, runs once those that it needs are valid; the mesh is opened for a valid case only.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from geoident.errors import InputError
from geoident.io.case.case import LEFT_OUT, CaseSection, build_case, tied_parameters
from geoident.io.case.days import with_days
from geoident.io.case.durations import Timetable
from geoident.io.case.external.build import build_elsewhere
from geoident.io.case.external.settlement_section import SettlementLawSection
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.case.external.table import within_runs
from geoident.io.case.face import with_zero_stage
from geoident.io.case.gauges.channel_errors import described_channels
from geoident.io.case.in_service.series import (
    DIMENSION_OF,
    SeriesSection,
    gap_notes,
    read_series,
    rows_of_shared_files,
)
from geoident.io.case.in_service.structure import (
    WATER_TEMPERATURE,
    ReservoirSection,
    build_service,
)
from geoident.io.case.laboratory import with_tests
from geoident.io.case.ladder import names_in_text
from geoident.io.case.readings_by_stage import ReadReadings, read_all
from geoident.io.case.references import check_references
from geoident.io.case.site_files.point_tables import with_tables
from geoident.io.case.timetable import (
    check_durations,
    in_moments,
    moments_by_stage,
    stages_of,
    timetable_of,
    until_of,
    with_moment_names,
)
from geoident.io.loaded import LoadedCase
from geoident.io.mesh.shipped import SHIPPED, shipped_meshes
from geoident.io.schema.faults import add_schema_faults, paths_of
from geoident.io.schema.section import Context, Section
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
from geoident.model.case import Analysis, Case, KeyPath
from geoident.model.external import ExternalSource, RunTable
from geoident.model.in_service import SeasonalModel, Series
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
    section, faults = _validate(places, folder)
    case, paths = _build(section, folder, faults, with_mesh=with_mesh)
    faults.raise_any()
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


_OF_READINGS = {"gauges", "structures", "stages", "dates", "readings", "bad"}


def _build(
    section: CaseSection,
    folder: Path,
    faults: Faults,
    wrong: Collection[str] = (),
    *,
    with_mesh: bool = True,
) -> tuple[Case, tuple[str, ...]]:
    """The case of sections that are right by themselves, and the paths of its readings.

    Args:
        section: the case.
        folder: of the case.
        faults: takes what is wrong beyond single sections.
        wrong: sections that are left out because they are wrong. What needs them is not checked, so
            the case is not complete then.
        with_mesh: whether the file of the mesh has to be there.
    """
    if isinstance(section.model, SettlementLawSection) and _OF_READINGS.isdisjoint(wrong):
        section = with_days(section, section.model, partial(_find, folder), faults)
    if "stages" not in wrong:
        gauges = {
            name: with_zero_stage(gauge, section.stages, ("gauges", name), faults)
            for name, gauge in section.gauges.items()
        }
        section = section.model_copy(update={"gauges": gauges})
    times = Timetable(stages_of(section))
    before, times_wrong = len(faults.found), not {"stages", "dates"}.isdisjoint(wrong)
    if not times_wrong:
        check_durations(section, faults)
        times = timetable_of(section, faults)
        times_wrong = bool(times.lasts) and len(faults.found) > before
    if not times_wrong:
        section = with_moment_names(section, times, faults)
    mesh_path = None if section.mesh is None else section.mesh.file
    of_tests = mesh_path is not None and mesh_path.startswith(SHIPPED)
    if mesh_path is not None and of_tests:
        shipped = shipped_meshes()
        if mesh_path not in shipped:
            faults.add_unknown(("mesh", "file"), "mesh", mesh_path, shipped)
        mesh_path = shipped.get(mesh_path)
    elif mesh_path is not None and with_mesh:
        mesh_path = _find(folder, mesh_path, ("mesh", "file"), faults=faults)
    check_references(section, faults, wrong)
    if "analysis" in wrong:
        raise InputError(faults.shown())  # nobody knows the axes
    before = len(faults.of_keys())
    built = build_case(section, times, faults, {*wrong, "stages"} if times_wrong else wrong)
    # of a gauge that cannot be built nobody knows the channels
    gauges_wrong = any(path[0] == "gauges" for path in faults.of_keys()[before:])
    read = ReadReadings()
    if _OF_READINGS.isdisjoint(wrong) and not (gauges_wrong or times_wrong):
        find = partial(_find, folder, faults=faults)
        named = moments_by_stage(_named(section, built), times)
        read = read_all(section, times, built.channels, named, find, faults)
    if wrong:
        faults.raise_any()
    series = _series(section, folder, faults) if with_mesh else {}
    elsewhere = (
        _elsewhere(section, built, read.dates, folder, series, faults) if with_mesh else None
    )
    service = None
    if section.service is not None and with_mesh and not wrong:
        water = section.loads.get(WATER_TEMPERATURE)
        formula = water if isinstance(water, ReservoirSection) else None
        context = Context(("service",), Analysis(section.analysis), faults)
        service = build_service(section.service, series, formula, context)
    if isinstance(elsewhere, RunTable):
        built = replace(built, parameters=within_runs(built.parameters, elsewhere))
    in_time = elsewhere if isinstance(elsewhere, SeasonalModel) else service
    if in_time is not None:
        read.notes += gap_notes({one.name: one for one in in_time.series})
    until = None if times_wrong else until_of(section, times, faults)
    case = replace(
        in_moments(read.given_to(built), times, read.moments, until),
        channels=described_channels(built, section, read.zeros, faults),
        mesh_file=mesh_path,
        of_tests=of_tests,
        elsewhere=elsewhere,
        service=service,
    )
    return case, tuple(read.paths)


def _named(section: CaseSection, case: Case) -> list[str]:
    """The names by which a case speaks of states: stages and moments."""
    names = [channel.zero for channel in case.channels]
    names += [decision.condition.stage for decision in case.decisions]
    return [*names, *(section.fit.stages or ()), *(e.stage for e in section.bad if e.stage)]


def _elsewhere(
    section: CaseSection,
    case: Case,
    dates: Mapping[str, float],
    folder: Path,
    series: Mapping[str, Series],
    faults: Faults,
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
        series=series,
        loads=tuple(section.loads),
    )
    return build_elsewhere(section.model, around)


def _series(section: CaseSection, folder: Path, faults: Faults) -> dict[str, Series]:
    """The loads of a case that change in time."""
    loads: dict[str, tuple[str, SeriesSection]] = {}
    for name, load in section.loads.items():
        if isinstance(load, SeriesSection) and name in DIMENSION_OF:
            before = len(faults.found)
            path = _find(folder, load.file, ("loads", name, "file"), faults=faults)
            if len(faults.found) == before:
                loads[name] = path, load
    rows = rows_of_shared_files(loads)
    read = {
        name: read_series(name, load, path, ("loads", name), faults, rows.get(name))
        for name, (path, load) in loads.items()
    }
    return {name: series for name, series in read.items() if series is not None}


def _shown(path: str) -> str:
    return STDIN_NAME if path == STDIN else path


def _validate(places: Places, folder: Path) -> tuple[CaseSection, Faults]:
    """The sections of a case, each right by itself, and what takes further faults.

    Raises:
        InputError: with what is wrong in them or left to fill in, and with what is wrong between
            sections that are right.
    """
    faults = Faults(places)
    for path in _blanks(places.data, ()):
        hint = next((_HINTS[str(key)] for key in reversed(path) if str(key) in _HINTS), "")
        faults.add(path, "fill-in", f"{BLANK} is to be replaced", hint or "Give the value.")
    if not isinstance(places.data, dict):
        hint = "Begin with 'format: geoident-case/1'."
        message = f"found {kind_of(places.data)}; expected a mapping"
        faults.add((), "wrong-kind", message, hint)
        faults.raise_any()
    places = with_tests(with_tables(places, folder, faults), faults)
    data = places.data
    assert isinstance(data, dict)
    noted = faults.of_keys()  # what pydantic finds there has been said
    wrong = {str(path[0]) for path in noted}
    sections: dict[int, type[Section]] = {}
    try:
        section = CaseSection.model_validate(data, context=sections)
        if not faults.found:
            return section, Faults(places)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        paths = paths_of(errors, data)
        errors = [
            one
            for one, path in zip(errors, paths, strict=True)
            if not any(path[: len(key)] == key for key in noted)
        ]
        faults = Faults(places, faults.found)
        add_schema_faults(faults, errors, data, sections)
        wrong |= {str(one["loc"][0]) if one["loc"] else "" for one in errors}
    # an unknown key may hold what other sections refer to, and without 'model' nobody knows whether
    # there is ground: nothing more is said then
    if wrong <= CaseSection.model_fields.keys() - {"format", "model"}:
        left = {key: node for key, node in data.items() if key not in wrong}
        with suppress(ValidationError):
            section = CaseSection.model_validate(left, context={LEFT_OUT: wrong})
            _build(section, folder, faults, wrong)
    raise InputError(faults.shown())


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
        if key[:1] == ("readings",):
            hint += " Leave 'readings' out until there are any."
        message = f"there is no file '{shorten(path)}'"
        if _is_folder(path):
            message = f"'{shorten(path)}' is a folder; expected a file"
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


def _without_empty(node: Any, *, entries: bool = False) -> Any:
    """The same without empty lists and mappings, which stand for missing keys.

    Args:
        node: of a case.
        entries: it is one whose entries say something though they are empty.
    """
    if isinstance(node, Mapping):
        return {
            key: _without_empty(value, entries=key == "drained")
            for key, value in node.items()
            if entries or value not in ({}, [])
        }
    if isinstance(node, list):
        return [_without_empty(value) for value in node]
    return node if isinstance(node, str) else str(node).lower()
