"""Reading a project file: what it says, or all that is wrong with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from geoident.io.project.formula import parse_formula
from geoident.io.project.sections import ProjectFile, SiteSection
from geoident.io.schema.estimated import NONE
from geoident.io.schema.run_file import open_run_file, require_file, settings_of, validated
from geoident.io.schema.values import CaseNumber
from geoident.io.text.faults import Faults
from geoident.io.text.wording import listing, nearest, shorten
from geoident.model.case import KeyPath
from geoident.model.project.project import Covariate, ParameterLaw, Project, ProjectSection, Scatter
from geoident.units import with_article


def read_project(path: str) -> Project:
    """Read a project file; the cases of its sections are not read.

    Args:
        path: the file.

    Raises:
        InputError: with all faults of its keys and the files that it names; or else with all that
            these say wrong together.
    """
    faults = open_run_file(path, "project")
    folder, data = Path(path).parent, faults.places.data
    listed = data.get("sections") if isinstance(data, dict) else None
    for n, section in enumerate(listed if isinstance(listed, list) else ()):
        if isinstance(section, dict) and isinstance(case := section.get("case"), str):
            require_file(folder / case, ("sections", n, "case"), faults, "project")
    declared = validated(ProjectFile, faults, "project")
    covariates = _covariates(declared, faults)
    names = _names(declared, faults)
    laws = tuple(_law(declared, name, covariates, faults) for name in declared.laws)
    _check_common(declared, faults)
    keys: list[KeyPath] = [("shared",), *(("shared", n) for n in range(len(declared.shared)))]
    for law in declared.laws:
        keys += [("laws", law), ("laws", law, "formula"), ("laws", law, "scatter")]
    project = Project(
        path=path,
        title=declared.title,
        sections=tuple(
            _section(section, name, folder, ("sections", n), faults)
            for n, (section, name) in enumerate(zip(declared.sections, names, strict=True))
        ),
        covariates=covariates,
        shared=tuple(declared.shared),
        laws=laws,
        places={key: faults.places.locate(key) for key in keys},
    )
    faults.raise_any()
    return project


def _covariates(project: ProjectFile, faults: Faults) -> tuple[Covariate, ...]:
    """What is known of every section: the same names, in units of the same dimensions."""
    first: dict[str, CaseNumber] = {}
    for section in project.sections:
        for name, given in section.covariates.items():
            first.setdefault(name, given)
    used = {n for law in project.laws.values() for n in parse_formula(law.formula).names()}
    for n, section in enumerate(project.sections):
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


def _names(project: ProjectFile, faults: Faults) -> list[str]:
    """A name for each section; two of one name are a fault."""
    names: list[str] = []
    for n, section in enumerate(project.sections):
        name = section.name or Path(section.case).stem
        if name in names:
            hint = "Give each section a 'name' of its own."
            message = f"two sections are called '{shorten(name)}'"
            where = ("sections", n, "name" if section.name else "case")
            faults.add(where, "same-name", message, hint)
        names.append(name)
    return names


def _law(
    project: ProjectFile, name: str, covariates: Sequence[Covariate], faults: Faults
) -> ParameterLaw:
    """A law, every name in whose formula is a covariate or a constant of its own."""
    law, at = project.laws[name], ("laws", name)
    formula = parse_formula(law.formula)
    known = {c.name for c in covariates}
    used = dict.fromkeys(formula.names())
    for one in used:
        if one in law.constants or one in known:
            continue
        if one in project.shared or one in project.laws:
            how = "itself" if one == name else f"the parameter '{one}'"
            message = f"the law of '{name}' refers to {how}"
            hint = "A law takes covariates of the sections and constants of its own."
            faults.add((*at, "formula"), "circular-law", message, hint)
        else:
            near = faults.did_you_mean(one, [*law.constants, *known], what="Known")
            message = f"'{one}' is neither a covariate of the sections nor a constant of the law"
            faults.add((*at, "formula"), "unknown-name", message, near)
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


def _scatter(given: CaseNumber) -> Scatter:
    if math.isnan(given.factor):
        return Scatter("estimate")
    if given.text == NONE:
        return Scatter("none")
    return Scatter("given", given.factor, given.dimension)


def _check_common(project: ProjectFile, faults: Faults) -> None:
    """A parameter is shared or follows a law, and all names of what is common differ."""
    if not (project.shared or project.laws):
        message = "nothing is common to the sections: no parameter is shared or has a law"
        hint = "Write 'shared' or 'laws', or fit the cases one by one."
        faults.add(("sections",), "nothing-common", message, hint, key=True)
    if all(section.predict for section in project.sections):
        message = "there is no section to fit"
        faults.add(("sections",), "no-section", message, "Remove 'predict' from some.")
    seen: dict[str, str] = {}
    for n, name in enumerate(project.shared):
        if name in project.laws:
            message = f"'{name}' is shared and has a law"
            faults.add(("shared", n), "two-ways", message, "Remove one of them.")
        elif name in seen:
            faults.add(("shared", n), "same-name", f"'{name}' is given twice", "Remove one.")
        seen[name] = "a shared parameter"
    for law, section in project.laws.items():
        for constant in section.constants:
            if constant in seen:
                message = f"'{constant}' is {seen[constant]}, too"
                where = ("laws", law, "constants", constant)
                hint = "Constants belong to one law: call it otherwise."
                faults.add(where, "same-name", message, hint, key=True)
            seen[constant] = f"a constant of the law of '{law}'"


def _section(
    section: SiteSection, name: str, folder: Path, at: KeyPath, faults: Faults
) -> ProjectSection:
    settings, places = settings_of(section.set, (*at, "set"), faults)
    return ProjectSection(
        name=name,
        case=str(folder / section.case),
        settings=settings,
        places=places,
        place=faults.places.locate(at),
        covariates={c: given.factor for c, given in section.covariates.items()},
        predicted=section.predict,
    )
