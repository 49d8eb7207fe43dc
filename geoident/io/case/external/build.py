"""From the key ``model`` of a case to the model, with the templates and files that it names."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from geoident.errors import Fault, InputError
from geoident.io.case.external.convergence import build_law
from geoident.io.case.external.function import function_of
from geoident.io.case.external.outputs import build_outputs
from geoident.io.case.external.section import (
    ConvergenceLawSection,
    ElsewhereSection,
    ExternalModelSection,
    TableModelSection,
    TemplateSection,
)
from geoident.io.case.external.settlement import build_settlement
from geoident.io.case.external.settlement_section import SettlementLawSection
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.case.external.table import build_table
from geoident.io.case.in_service.seasonal import SeasonalModelSection, build_seasonal
from geoident.io.external.imports import imported_files, is_program, words_of
from geoident.io.external.templates import MAX_BYTES, read_template
from geoident.model.case import KeyPath
from geoident.model.external import (
    AnyTemplate,
    ExternalProgram,
    ExternalSource,
    FunctionValue,
    Machine,
    PythonFunction,
)

_AT: KeyPath = ("model",)


def build_elsewhere(section: ElsewhereSection, around: ModelContext) -> ExternalSource:
    """The model that a case says, with the texts of its templates; what is wrong is noted.

    Args:
        section: the key ``model``.
        around: what it refers to.
    """
    if isinstance(section, TableModelSection):
        return build_table(section, around)
    if isinstance(section, ConvergenceLawSection):
        return build_law(section, around)
    if isinstance(section, SettlementLawSection):
        return build_settlement(section, around)
    if isinstance(section, SeasonalModelSection):
        return build_seasonal(section, around.series, around.loads, around.faults)
    machine = Machine(section.time_limit, section.at_once)
    if isinstance(section, ExternalModelSection):
        return _program(section, machine, around)
    path, name = function_of(section.function, (*_AT, "function"), around)
    jacobian = ""
    if section.jacobian is not None:
        other, jacobian = function_of(section.jacobian, (*_AT, "jacobian"), around)
        if other != path:
            message = "the derivatives are in another file than the readings"
            around.faults.add((*_AT, "jacobian"), "other-file", message, "Put both in one file.")
    read = tuple(around.find(file, (*_AT, "files", n)) for n, file in enumerate(section.files))
    return PythonFunction(path, name, jacobian, machine, (*imported_files(path), *read))


def _program(
    section: ExternalModelSection, machine: Machine, around: ModelContext
) -> ExternalProgram:
    templates, faults = list[AnyTemplate](), around.faults
    for target, given in section.inputs.items():
        path: KeyPath = (*_AT, "inputs", target)
        in_jinja = isinstance(given, TemplateSection) and given.engine == "jinja"
        source = given.template if isinstance(given, TemplateSection) else given
        path = path if isinstance(given, str) else (*path, "template")
        before = len(faults.found)
        template_file = around.find(source, path)
        if len(faults.found) > before:
            continue
        try:
            if in_jinja:
                template, wrong = _jinja(template_file, target, around)
            else:
                template, wrong = read_template(template_file, target, around.parameters)
        except InputError as error:
            faults.extend(error.faults)
            continue
        except ImportError:
            hint = 'Install the library that fills it: pip install "geoident[jinja]".'
            faults.add(path, "no-package", "a template in Jinja needs jinja2", hint)
            continue
        faults.extend(wrong)
        templates.append(template)
    files = tuple(around.find(file, (*_AT, "files", n)) for n, file in enumerate(section.files))
    _check_targets(section, around)
    outputs = tuple(build_outputs(section.outputs, around))
    if len(templates) == len(section.inputs):
        _check_fields(templates, around)
    found_by = {o.how.path: None for o in outputs if isinstance(o.how, FunctionValue)}
    code = [file for path in found_by for file in (path, *imported_files(path))]
    local = section.command[0]
    if ("/" in local or "\\" in local) and not Path(local).is_absolute():
        place = around.folder / local
        if place.is_file():
            code += [str(place), *imported_files(str(place))]
    code.extend(_run_by(section.command[1:], around.folder))
    return ExternalProgram(
        command=tuple(section.command),
        templates=tuple(templates),
        files=files,
        outputs=outputs,
        machine=machine,
        keep_all=section.keep == "all",
        folder=str(around.folder),
        code=tuple(dict.fromkeys(code)),
    )


def _run_by(arguments: Sequence[str], folder: Path) -> Iterator[str]:
    """Files among the arguments of a command, with what scripts of Python among them import.

    Args:
        arguments: as a shell or an option may have them, too: ``--deck=FILE``.
        folder: of the case, below which is that of the runs, in which each has its own.
    """
    words = list(dict.fromkeys(word for one in arguments for word in words_of(one)))
    seen_from = [folder, folder / "case.runs" / "run"]
    named = [place for word in words for place in _places(seen_from, word) if place.is_dir()]
    for word in words:
        files = [place for place in _places(seen_from, word) if place.is_file()]
        for name in (word, f"{word}.py", f"{word}/__main__.py"):  # cd FOLDER && ./PROGRAM
            files += [place for place in _places(named, name) if is_program(place)]
        for place in files:
            yield from (str(place), *imported_files(str(place)))


def _places(folders: Sequence[Path], name: str) -> list[Path]:
    """What is there of a name, seen from several folders."""
    places = dict.fromkeys(Path(os.path.normpath(folder / name)) for folder in folders)
    with suppress(OSError, ValueError):  # too long or strange for a name
        return [place for place in places if place.exists()]
    return []


def _jinja(source: str, target: str, around: ModelContext) -> tuple[AnyTemplate, list[Fault]]:
    """A template in Jinja, and what is wrong in it.

    Raises:
        ImportError: the library that fills it is missing.
        InputError: it cannot be read.
    """
    from geoident.io.external.jinja_templates import read_jinja  # noqa: PLC0415 - optional

    return read_jinja(source, target, around.parameters, limit=MAX_BYTES)


def _check_targets(section: ExternalModelSection, around: ModelContext) -> None:
    """All inputs stay in the folder of a run, and no two of its files have one name."""
    for target in section.inputs:
        around.check_inside(target, (*_AT, "inputs", target), key=True)
    taken: dict[str, str] = {}
    names: list[tuple[KeyPath, str]] = [
        ((*_AT, "inputs", target), target) for target in section.inputs
    ]
    names += [((*_AT, "files", n), Path(file).name) for n, file in enumerate(section.files)]
    for path, name in names:
        key = str(Path(name)).casefold()
        if key in taken:
            message = f"two files of a run would be '{name}'; the first is {taken[key]}"
            around.faults.add(path, "same-file", message, "Rename one.")
        taken.setdefault(key, ".".join(map(str, path)))


def _check_fields(templates: Sequence[AnyTemplate], around: ModelContext) -> None:
    """Every parameter is written somewhere, or belongs to a gauge."""
    seen = {field.parameter for template in templates for field in template.fields}
    for name in around.parameters:
        if name not in seen | around.tied:
            message = f"the parameter '{name}' has no field in any template"
            hint = f"Write {{{{{name}}}}} where the program reads it, or remove the parameter."
            around.faults.add(("parameters", name), "unused-parameter", message, hint, key=True)
