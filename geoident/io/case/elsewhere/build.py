"""From the key ``model`` of a case to the model, with the templates and files that it names."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from geoident.errors import Fault, InputError, Location
from geoident.io.case.elsewhere.convergence import build_law
from geoident.io.case.elsewhere.section import (
    ConvergenceLawSection,
    ElsewhereSection,
    ExternalModelSection,
    OutputSection,
    TableModelSection,
    TemplateSection,
    seconds_of,
)
from geoident.io.case.elsewhere.surroundings import Surroundings
from geoident.io.case.elsewhere.table import build_table
from geoident.io.elsewhere.imports import imported_files
from geoident.io.elsewhere.templates import MAX_BYTES, read_template
from geoident.io.text.faults import Faults
from geoident.io.text.text_file import decode, read_bytes
from geoident.model.case import KeyPath
from geoident.model.elsewhere import (
    AnyTemplate,
    Elsewhere,
    ExternalProgram,
    Finding,
    FunctionValue,
    Hdf5Value,
    JsonValue,
    LineValue,
    Machine,
    Output,
    PatternValue,
    PythonFunction,
    TableCell,
)
from geoident.model.gauges import Channel
from geoident.units import DIMENSIONLESS, UnitError, normal_unit, size_in, unit_list, with_article

_AT: KeyPath = ("model",)


def build_elsewhere(section: ElsewhereSection, around: Surroundings) -> Elsewhere:
    """The model that a case says, with the texts of its templates; what is wrong is noted.

    Args:
        section: the key ``model``.
        around: what it refers to.
    """
    if isinstance(section, TableModelSection):
        return build_table(section, around)
    if isinstance(section, ConvergenceLawSection):
        return build_law(section, around)
    limit = None if section.time_limit is None else seconds_of(section.time_limit)
    machine = Machine(limit, section.at_once)
    if isinstance(section, ExternalModelSection):
        return _program(section, machine, around)
    path, name = _function(section.function, (*_AT, "function"), around)
    jacobian = ""
    if section.jacobian is not None:
        other, jacobian = _function(section.jacobian, (*_AT, "jacobian"), around)
        if other != path:
            message = "the derivatives are in another file than the readings"
            around.faults.add((*_AT, "jacobian"), "other-file", message, "Put both in one file.")
    read = tuple(around.find(file, (*_AT, "files", n)) for n, file in enumerate(section.files))
    return PythonFunction(path, name, jacobian, machine, (*imported_files(path), *read))


def _function(text: str, path: KeyPath, around: Surroundings) -> tuple[str, str]:
    """Path of a file and the name of a function in it."""
    module, _, name = text.rpartition(":")
    file = module if module.endswith(".py") else f"{module.replace('.', '/')}.py"
    before = len(around.faults.found)
    found = around.find(file, path)
    if len(around.faults.found) == before:
        _require_name(found, name, path, around.faults)
    return found, name


def _require_name(file: str, name: str, path: KeyPath, faults: Faults) -> None:
    """A file of Python must be one, and have something of a name; nothing of it is run."""
    try:
        tree = ast.parse(decode(read_bytes(file, limit=MAX_BYTES, what="module"), file))
    except InputError as error:
        faults.extend(error.faults)
        return
    except SyntaxError as error:
        place = Location(file, error.lineno or 1, error.offset or 1)
        faults.extend([Fault("not-python", f"this is not Python: {error.msg}", "", place)])
        return
    names = list(_names(tree))
    if name not in names and "*" not in names:
        hint = faults.did_you_mean(name, names, what="What it has")
        faults.add(path, "no-function", f"{Path(file).name} has no function '{name}'", hint)


def _names(tree: ast.Module) -> Iterator[str]:
    """What a module calls by a name at its top."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)
        elif isinstance(node, ast.If | ast.Try):
            yield "*"


def _program(
    section: ExternalModelSection, machine: Machine, around: Surroundings
) -> ExternalProgram:
    templates, faults = list[AnyTemplate](), around.faults
    for target, given in section.inputs.items():
        path: KeyPath = (*_AT, "inputs", target)
        in_jinja = isinstance(given, TemplateSection) and given.engine == "jinja"
        source = given.template if isinstance(given, TemplateSection) else given
        path = path if isinstance(given, str) else (*path, "template")
        before = len(faults.found)
        found = around.find(source, path)
        if len(faults.found) > before:
            continue
        try:
            if in_jinja:
                template, wrong = _jinja(found, target, around)
            else:
                template, wrong = read_template(found, target, around.parameters)
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
    _check_targets(section, faults)
    outputs = tuple(_outputs(section.outputs, around))
    if len(templates) == len(section.inputs):
        _check_fields(templates, around)
    found_by = {o.how.path: None for o in outputs if isinstance(o.how, FunctionValue)}
    code = [file for path in found_by for file in (path, *imported_files(path))]
    local = section.command[0]
    if ("/" in local or "\\" in local) and not Path(local).is_absolute():
        place = around.folder / local
        if place.is_file():
            code.append(str(place))
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


def _jinja(source: str, target: str, around: Surroundings) -> tuple[AnyTemplate, list[Fault]]:
    """A template in Jinja, and what is wrong in it.

    Raises:
        ImportError: the library that fills it is missing.
        InputError: it cannot be read.
    """
    from geoident.io.elsewhere.jinja_templates import read_jinja  # noqa: PLC0415 - optional

    return read_jinja(source, target, around.parameters, limit=MAX_BYTES)


def _check_targets(section: ExternalModelSection, faults: Faults) -> None:
    """Two files of a run must not have one name."""
    taken: dict[str, str] = {}
    names: list[tuple[KeyPath, str]] = [
        ((*_AT, "inputs", target), target) for target in section.inputs
    ]
    names += [((*_AT, "files", n), Path(file).name) for n, file in enumerate(section.files)]
    for path, name in names:
        key = str(Path(name)).casefold()
        if key in taken:
            message = f"two files of a run would be '{name}'; the first is {taken[key]}"
            faults.add(path, "same-file", message, "Rename one.")
        taken.setdefault(key, ".".join(map(str, path)))


def _check_fields(templates: Sequence[AnyTemplate], around: Surroundings) -> None:
    """Every parameter is written somewhere, or belongs to a gauge."""
    seen = {field.parameter for template in templates for field in template.fields}
    for name in around.parameters:
        if name not in seen | around.tied:
            message = f"the parameter '{name}' has no field in any template"
            hint = f"Write {{{{{name}}}}} where the program reads it, or remove the parameter."
            around.faults.add(("parameters", name), "unused-parameter", message, hint, key=True)


def _outputs(sections: Sequence[OutputSection], around: Surroundings) -> Iterator[Output]:
    """What is found, reading by reading."""
    rows = {channel.name: n for n, channel in enumerate(around.channels)}
    columns = {name: n for n, name in enumerate(around.stages)}
    by: dict[tuple[int, int], int] = {}
    for number, section in enumerate(sections):
        path: KeyPath = (*_AT, "outputs", number)
        code = None
        if section.function is not None:
            code = FunctionValue(*_function(section.function, (*path, "function"), around))
        gauges = _named(section.gauges, rows, (*path, "gauges"), "gauge", around.faults)
        stages = _named(section.stages, columns, (*path, "stages"), "stage", around.faults)
        for gauge in gauges:
            channel = around.channels[rows[gauge]]
            size = _unit(section, channel, path, around.faults)
            if size is None:
                break
            for stage in stages:
                place = rows[gauge], columns[stage]
                if place in by:
                    message = f"'{gauge}' at '{stage}' is found by outputs[{by[place]}] already"
                    hint = "Say by 'gauges' and 'stages' which readings each of them finds."
                    around.faults.add(path, "found-twice", message, hint)
                    break
                by[place] = number
                how = code or _how(section, gauge, stage, columns[stage] + 1)
                file = _named_by(section.file or "", gauge, stage, columns[stage] + 1)
                yield Output(*place, file, how, size)
    for name, row in rows.items():
        if not any(place[0] == row for place in by):
            message = f"nothing in 'model.outputs' finds the readings of '{name}'"
            hint = "Add an entry for it, or remove the gauge."
            around.faults.add(("gauges", name), "no-output", message, hint, key=True)


def _named(
    given: Sequence[str] | None,
    known: Mapping[str, int],
    path: KeyPath,
    kind: str,
    faults: Faults,
) -> list[str]:
    if given is None:
        return list(known)
    for n, name in enumerate(given):
        if name not in known:
            faults.add_unknown((*path, n), kind, name, known)
    return [name for name in dict.fromkeys(given) if name in known]


def _unit(section: OutputSection, channel: Channel, path: KeyPath, faults: Faults) -> float | None:
    """Size of the unit of an output; None, with a fault, where it is none of its channel."""
    dimension = channel.dimension
    if section.unit is None:
        if dimension == DIMENSIONLESS:
            return 1.0
        message = f"no unit is given, and '{channel.name}' reads {with_article(dimension)}"
        faults.add(path, "unit", message, f"Add 'unit: ...'. Its units: {unit_list(dimension)}.")
        return None
    try:
        size = size_in(normal_unit(section.unit, dimension), dimension)
    except UnitError as error:
        faults.add((*path, "unit"), "unit", error.message, error.hint)
        return None
    if size is None:
        message = f"'{section.unit}' is no unit of {with_article(dimension)}, which "
        message += f"'{channel.name}' reads"
        faults.add((*path, "unit"), "unit", message, f"Its units: {unit_list(dimension)}.")
    return size


def _named_by(text: str, gauge: str, stage: str, number: int) -> str:
    """A text with its reading in place of ``{gauge}``, ``{stage}`` and ``{number}``."""
    for mark, word in (("{gauge}", gauge), ("{stage}", stage), ("{number}", str(number))):
        text = text.replace(mark, word)
    return text


def _how(section: OutputSection, gauge: str, stage: str, number: int) -> Finding:
    """Where the number of a reading stands, if no function finds it."""

    def named(text: str) -> str:
        return _named_by(text, gauge, stage, number)

    def matched(text: str) -> str:
        return _named_by(text, re.escape(gauge), re.escape(stage), number)

    if section.column is not None:
        row = section.row if section.row is not None else -1
        rows = row if isinstance(row, int) else tuple((k, named(v)) for k, v in row.items())
        return TableCell(named(section.column), rows)
    if section.pointer is not None:
        return JsonValue(named(section.pointer))
    if section.dataset is not None:
        return Hdf5Value(named(section.dataset), tuple(section.index or ()))
    if section.line is not None:
        line = section.line if isinstance(section.line, int) else matched(section.line)
        first, last = section.columns or (0, 0)
        return LineValue(line, section.after or 0, section.word or 0, (first, last))
    assert section.find is not None
    return PatternValue(matched(section.find), section.occurrence or 1)
