"""Reading a project file: what it says, or all that is wrong with it."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from geoident.errors import Fault, InputError
from geoident.io.project.formula import parse_formula
from geoident.io.project.sections import LawSection, ProjectFile, SiteSection
from geoident.io.schema.estimated import NONE
from geoident.io.schema.faults import add_schema_faults, paths_of
from geoident.io.schema.values import CaseNumber, kind_of
from geoident.io.text.faults import Faults, Places
from geoident.io.text.kinds import refuse_other_kind
from geoident.io.text.overrides import is_path, parse_path, written_value
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import Refusal, listing, nearest, shorten
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
from geoident.model.case import KeyPath
from geoident.model.project.project import Covariate, ParameterLaw, Project, ProjectSection, Scatter
from geoident.units import with_article


class FaultyProject(InputError):
    """A project with faults of its own text.

    Args:
        faults: they.
        sound: the sections at which nothing is wrong, whose cases can be read.
    """

    def __init__(self, faults: Iterable[Fault], sound: Sequence[ProjectSection]) -> None:
        self.sound = tuple(sound)
        super().__init__(faults)


def read_project(path: str) -> Project:
    """Read a project file; the cases of its sections are not read.

    Args:
        path: the file.

    Raises:
        FaultyProject: with all faults found.
    """
    text = decode(read_bytes(path, limit=MAX_BYTES, what="project"), path)
    document = parse_yaml(text, path)
    refuse_other_kind(document, "project")
    faults = Faults(Places(document, document.data))
    folder = Path(path).parent
    _check_paths(folder, faults)
    found, wrong = _validated(faults)
    if found is None:
        raise FaultyProject(faults.shown(), ())
    known = Faults(faults.places)
    project = _project(found, path, known)
    spoiled = {path[:2] for path in wrong}
    faults.extend(
        fault
        for fault, key in zip(known.found, known.of_keys(), strict=True)
        if key[:2] not in spoiled and not (wrong and fault.code in _OF_ALL)
    )
    if not faults.found:
        return project
    keys = {key[:2] for key in (*faults.of_keys(), *known.of_keys(), *wrong)}
    left = [s for n, s in enumerate(project.sections) if ("sections", n) not in keys]
    raise FaultyProject(faults.shown(), left)


_OF_ALL = ("nothing-common", "no-section", "missing-covariate", "unknown-name", "unused-constant")
"""Faults that may only follow from what was left out because it is wrong."""


def _project(found: ProjectFile, path: str, faults: Faults) -> Project:
    """What a project says; what is wrong beyond its sections is noted."""
    covariates = _covariates(found, faults)
    names = _names(found, faults)
    laws = tuple(_law(found, name, covariates, faults) for name in found.laws)
    _check_common(found, faults)
    if not (found.shared or found.laws):
        message = "nothing is common to the sections: no parameter is shared or has a law"
        hint = "Write 'shared' or 'laws', or fit the cases one by one."
        faults.add(("sections",), "nothing-common", message, hint, key=True)
    if all(section.predict for section in found.sections):
        faults.add(("sections",), "no-section", "there is no section to fit",
                   "Remove 'predict' from some.")  # fmt: skip
    folder, locate = Path(path).parent, faults.places.locate
    sections = tuple(
        _section(section, name, folder, ("sections", n), faults.places)
        for n, (section, name) in enumerate(zip(found.sections, names, strict=True))
    )
    keys: list[KeyPath] = [("shared",), *(("shared", n) for n in range(len(found.shared)))]
    for law in found.laws:
        keys += [("laws", law), ("laws", law, "formula"), ("laws", law, "scatter")]
    return Project(
        path=path,
        title=found.title,
        sections=sections,
        covariates=covariates,
        shared=tuple(found.shared),
        laws=laws,
        places={key: locate(key) for key in keys},
    )


def _check_paths(folder: Path, faults: Faults) -> None:
    """Look at the files and paths that the sections name, whatever else is wrong."""
    data = faults.places.data
    listed = data.get("sections") if isinstance(data, dict) else None
    for n, section in enumerate(listed if isinstance(listed, list) else ()):
        if not isinstance(section, dict):
            continue
        if isinstance(case := section.get("case"), str) and not _is_file(folder / case):
            hint = "Paths are meant from the folder of the project file."
            message = f"there is no file '{shorten(folder / case)}'"
            faults.add(("sections", n, "case"), "missing-file", message, hint)
        given = section.get("set")
        for name in given if isinstance(given, dict) else ():
            try:
                parse_path(name)
            except Refusal as error:
                message = f"'{shorten(name)}' is not the path of a value of a case"
                faults.add(("sections", n, "set", name), error.code, message, error.hint, key=True)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _validated(faults: Faults) -> tuple[ProjectFile | None, list[KeyPath]]:
    """The sections without what is wrong in them, which is noted, and where that is.

    None where too little is left.
    """
    data = faults.places.data
    if not isinstance(data, dict):
        hint = "Begin with 'format: geoident-project/1'."
        faults.add((), "wrong-kind", f"found {kind_of(data)}; a mapping is expected", hint)
        return None, []
    known: dict[int, tuple[str, ...]] = {}
    try:
        return ProjectFile.model_validate(data, context=known), []
    except ValidationError as error:
        errors = error.errors(include_url=False)
        add_schema_faults(faults, errors, data, known)
        wrong = paths_of(errors, data)
    try:
        return ProjectFile.model_validate(_without(data, wrong), context={}), wrong
    except ValidationError:
        return None, wrong


def _without(data: Mapping[str, Any], wrong: Iterable[KeyPath]) -> dict[str, Any]:
    """A project without its wrong entries; its sections keep their places."""
    left: dict[str, Any] = copy.deepcopy(dict(data))
    for path in wrong:
        match path:
            case ("sections", int(n), str(key), *_):
                left["sections"][n].pop(key, None)
            case ("sections", int(n)):
                given = left["sections"][n]
                left["sections"][n] = given if isinstance(given, dict) else {}
            case ("laws", law, *_):
                left["laws"].pop(law, None)
            case (key, *_):
                left.pop(str(key), None)
    left["format"] = "geoident-project/1"
    for n, section in enumerate(left.get("sections", ())):
        section.setdefault("case", f"?{n}")
    return left


def _covariates(found: ProjectFile, faults: Faults) -> tuple[Covariate, ...]:
    """What is known of every section: the same names, in units of the same dimensions."""
    first: dict[str, CaseNumber] = {}
    for section in found.sections:
        for name, given in section.covariates.items():
            first.setdefault(name, given)
    used = {n for law in found.laws.values() for n in parse_formula(law.formula).names()}
    for n, section in enumerate(found.sections):
        at = ("sections", n)
        missing = [c for c in first if c in used and c not in section.covariates]
        if missing:
            where = (*at, "covariates") if section.covariates else at
            message = f"{listing(missing)} is not given for this section"
            near = nearest(missing[0], [c for c in section.covariates if c not in used])
            hint = f"Write '{missing[0]}' in place of '{near}'; the laws" if near else "The laws"
            faults.add(where, "missing-covariate", message, f"{hint} need it of every section.")
        for name, given in section.covariates.items():
            if given.dimension != first[name].dimension:
                message = f"'{given.text}' is {with_article(given.dimension)}; elsewhere {name} is "
                message += with_article(first[name].dimension)
                hint = "Write all in units of one dimension."
                faults.add((*at, "covariates", name), "unit", message, hint)
    return tuple(Covariate(name, one.dimension, one.unit) for name, one in first.items())


def _names(found: ProjectFile, faults: Faults) -> list[str]:
    """A name for each section; two of one name are a fault."""
    names: list[str] = []
    for n, section in enumerate(found.sections):
        name = section.name or Path(section.case).stem
        if name in names:
            hint = "Give each section a 'name' of its own."
            message = f"two sections are called '{shorten(name)}'"
            where = ("sections", n, "name" if section.name else "case")
            faults.add(where, "same-name", message, hint)
        names.append(name)
    return names


def _law(
    found: ProjectFile, name: str, covariates: Sequence[Covariate], faults: Faults
) -> ParameterLaw:
    law, at = found.laws[name], ("laws", name)
    formula = parse_formula(law.formula)
    known = {c.name for c in covariates}
    used = list(dict.fromkeys(formula.names()))
    _check_names(found, name, law, used, known, faults)
    for constant in law.constants:
        where = (*at, "constants", constant)
        if constant not in used:
            message = f"the formula '{shorten(law.formula)}' has no '{constant}'"
            faults.add(where, "unused-constant", message, "Remove it, or use it.", key=True)
        if constant in known:
            message = f"'{constant}' is a covariate of the sections, too"
            faults.add(where, "same-name", message, "Call one of them otherwise.", key=True)
    return ParameterLaw(
        parameter=name,
        text=law.formula.strip(),
        formula=formula,
        constants=tuple(section.parameter(c) for c, section in law.constants.items()),
        scatter=_scatter(law.scatter),
    )


def _check_names(
    found: ProjectFile,
    name: str,
    law: LawSection,
    used: Sequence[str],
    known: set[str],
    faults: Faults,
) -> None:
    """Every name in a formula is a covariate or a constant of the law."""
    where = ("laws", name, "formula")
    parameters = {*found.shared, *found.laws}
    for one in used:
        if one in law.constants or one in known:
            continue
        if one in parameters:
            how = "itself" if one == name else f"the parameter '{one}'"
            message = f"the law of '{name}' refers to {how}"
            hint = "A law takes covariates of the sections and constants of its own."
            faults.add(where, "circular-law", message, hint)
            continue
        near = faults.did_you_mean(one, [*law.constants, *known], what="Known")
        message = f"'{one}' is no covariate of the sections and no constant of the law"
        faults.add(where, "unknown-name", message, near)


def _scatter(given: CaseNumber) -> Scatter:
    if math.isnan(given.factor):
        return Scatter("estimate")
    if given.text == NONE:
        return Scatter("none")
    return Scatter("given", given.factor, given.dimension)


def _check_common(found: ProjectFile, faults: Faults) -> None:
    """A parameter is shared or follows a law, and all names of what is common differ."""
    seen: dict[str, str] = {}
    for n, name in enumerate(found.shared):
        if name in found.laws:
            message = f"'{name}' is shared and has a law"
            faults.add(("shared", n), "two-ways", message, "Remove one of them.")
        elif name in seen:
            faults.add(("shared", n), "same-name", f"'{name}' stands there twice", "Remove one.")
        seen[name] = "a shared parameter"
    for law, section in found.laws.items():
        for constant in section.constants:
            if constant in seen:
                message = f"'{constant}' is {seen[constant]}, too"
                where = ("laws", law, "constants", constant)
                hint = "Constants belong to one law: call it otherwise."
                faults.add(where, "same-name", message, hint, key=True)
            seen[constant] = f"a constant of the law of '{law}'"


def _section(
    section: SiteSection, name: str, folder: Path, at: KeyPath, places: Places
) -> ProjectSection:
    paths = [path for path in section.set if is_path(path)]
    return ProjectSection(
        name=name,
        case=str(folder / section.case),
        overrides=tuple(f"{path}={written_value(section.set[path])}" for path in paths),
        covariates={c: given.factor for c, given in section.covariates.items()},
        predicted=section.predict,
        place=places.locate(at),
        places=tuple(places.locate((*at, "set", path)) for path in paths),
    )
