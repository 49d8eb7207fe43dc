"""From the errors of pydantic to faults of the case: where, what was found, what would be right."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from pydantic_core import ErrorDetails

from geoident.errors import Term
from geoident.io.schema.section import SECTION_FAULTS, Section, SectionFault
from geoident.io.schema.values import kind_of
from geoident.io.text.faults import Faults
from geoident.io.text.wording import Refusal, listing, shorten
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath
from geoident.units import UnitError

Sections = Mapping[int, type[Section]]
"""Identity of a mapping of the file to the section that it is."""

_QUOTED = re.compile(r"'([^']*)'")
_WHOLE = re.compile(r"[-+]?[0-9]+")
_MISSING_HINTS = {
    "bounds": "Bounds are required: write 'bounds: [LOWER, UPPER]'.",
    "format": "Write 'format: geoident-case/1' in the first line.",
    "type": "Say which yield surface: 'type: mohr-coulomb' with cohesion, friction and dilation, "
    "or tresca, hoek-brown, drucker-prager, weak-plane, planes.",
    "accuracy": "Write the standard deviation of one reading, such as 'accuracy: 0.1 mm'.",
}
_KINDS = {
    "string_type": "a text",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_pattern_mismatch": "a name of letters, digits and underscores",
}
_HINTS = {
    "a text": "Write one word or a text in quotes.",
    "a list": "Write it in brackets, [A, B], or one entry a line with '- ' before it.",
    "a mapping": "Write {KEY: VALUE}, or one 'KEY: VALUE' a line, indented.",
    "true or false": "Write true or false, without quotes.",
    "a name of letters, digits and underscores": "Begin it with a letter; write 'E_rock'.",
}


def add_schema_faults(
    faults: Faults, errors: list[ErrorDetails], data: Node, sections: Sections
) -> None:
    """Note what pydantic found as faults of the case.

    Args:
        faults: takes them.
        errors: what pydantic found.
        data: what was read.
        sections: of the mappings of the file, for hints.
    """
    resolved = [(error, *_resolve(error, data)) for error in errors]
    cut = {
        path: place
        for error, path, _, _ in resolved
        if error["type"] == "extra_forbidden" and (place := _cut_before(path, data))
    }
    for error, path, node, is_key in resolved:
        if path in cut:
            before = cut[path]
            whole, name = node_at(data, before), shorten(before[-1])
            message = f"a comma separates '{shorten(path[-1])}' from '{name}: {whole}'"
            hint = f"Write '{name}: {whole}.{shorten(path[-1])}' with a decimal point."
            faults.add(path, "unknown-key", message, hint, key=True)
        elif path not in cut.values():
            _add(faults, error, path, node, sections, is_key=is_key)


def paths_of(errors: list[ErrorDetails], data: Node) -> list[KeyPath]:
    """Where pydantic found something, as far as it stands in the file.

    Args:
        errors: what pydantic found.
        data: what was read.
    """
    return [_resolve(error, data)[0] for error in errors]


def _resolve(error: ErrorDetails, data: Node) -> tuple[KeyPath, Node, bool]:
    """Path in the file, the node there, and whether the error is about the key itself.

    The locations of pydantic hold more than the keys of the file: tags of the ways in which a key
    can be written, and ``[key]``. They are recognised by not being in the file.
    """
    path: KeyPath = ()
    node, is_key = data, False
    for part in error["loc"]:
        if isinstance(node, dict) and part in node:
            node, path = node[str(part)], (*path, part)
        elif isinstance(node, list) and isinstance(part, int) and part < len(node):
            node, path = node[part], (*path, part)
        elif part == "[key]":
            is_key = True
    return path, node, is_key


def _add(
    faults: Faults,
    error: ErrorDetails,
    path: KeyPath,
    node: Node,
    sections: Sections,
    *,
    is_key: bool,
) -> None:
    context: dict[str, Any] = error.get("ctx", {})
    kind = error["type"]
    if kind == SECTION_FAULTS:
        section_faults: list[SectionFault] = context["found"]
        for fault in section_faults:
            faults.add((*path, *fault.path), fault.code, fault.message, fault.hint)
    elif kind == "value_error":
        _add_refused(faults, path, context["error"], is_key=is_key)
    elif kind == "extra_forbidden":
        _add_unknown_key(faults, path, sections)
    elif kind == "missing":
        name = str(error["loc"][-1])
        hint = _MISSING_HINTS.get(name, f"Add '{name}: ...'.")
        faults.add(path, "missing-key", f"'{name}' is missing", hint, key=True)
    elif kind.startswith("union_tag"):
        _add_wrong_tag(faults, path, node, context)
    else:
        _add_other(faults, error, path, node, context)


def _add_refused(faults: Faults, path: KeyPath, error: Exception, *, is_key: bool) -> None:
    if isinstance(error, Refusal):
        faults.add(path, error.code, error.message, error.hint, key=is_key)
    elif isinstance(error, UnitError):
        faults.add(path, "unit", error.message, error.hint, key=is_key)
    else:
        faults.add(path, "bad-value", str(error), key=is_key)


def _add_unknown_key(faults: Faults, path: KeyPath, sections: Sections) -> None:
    key = str(path[-1])
    holder = node_at(faults.places.data, path[:-1])
    section = sections.get(id(holder), Section)
    hint = section.not_here.get(key) or faults.did_you_mean(
        key, section.key_names(), what="Keys here"
    )
    name, colon, value = key.partition(":")
    if colon and name and value:
        hint = f"Write a space after the colon: '{shorten(name)}: {shorten(value)}'."
    elif key[:1].isdigit():
        hint = "If there is a comma in a number before it, write a decimal point."
    faults.add(path, "unknown-key", f"the key '{shorten(key)}' is not known here", hint, key=True)


def _cut_before(path: KeyPath, data: Node) -> KeyPath | None:
    """The key whose number a comma has cut, of which the rest became a key: ``a: 0,1 mm``."""
    holder = node_at(data, path[:-1])
    if not isinstance(holder, dict) or not str(path[-1])[:1].isdigit() or holder[str(path[-1])]:
        return None
    names = list(holder)
    before = names[names.index(str(path[-1])) - 1] if names[0] != path[-1] else ""
    whole = holder.get(before)
    return (*path[:-1], before) if isinstance(whole, str) and _WHOLE.fullmatch(whole) else None


def _add_wrong_tag(faults: Faults, path: KeyPath, node: Node, context: dict[str, Any]) -> None:
    # The key that tells the ways apart, or a function that is named after it.
    name = str(context.get("discriminator", "")).strip("'").removesuffix("()")
    if not isinstance(node, dict):
        message = f"found {kind_of(node)}; expected a mapping with the key '{name}'"
        faults.add(path, "wrong-kind", message, f"Write {{{name}: ...}}.")
    elif "tag" in context:
        _add_not_listed(faults, (*path, name), str(context["tag"]), context["expected_tags"])
    else:
        hint = _MISSING_HINTS.get(name, f"Add '{name}: ...'.")
        faults.add(path, "missing-key", f"'{name}' is missing", hint, key=True)


def _add_not_listed(faults: Faults, path: KeyPath, written: str, expected: str) -> None:
    choices = _QUOTED.findall(expected)
    message = f"found '{shorten(written)}'; expected {listing(choices)}"
    hint = faults.did_you_mean(written, choices)
    faults.add(
        path, "not-listed", message, hint if hint.startswith("Did") else "Write one of them."
    )


def _add_other(
    faults: Faults, error: ErrorDetails, path: KeyPath, node: Node, context: dict[str, Any]
) -> None:
    kind = error["type"]
    if kind == "literal_error":
        if isinstance(node, str):
            _add_not_listed(faults, path, node, context["expected"])
            return
        message = f"found {kind_of(node)}; expected {context['expected']}"
        hint = "Write one of them."
    elif kind in _KINDS:
        message = f"found {kind_of(node)}; expected {_KINDS[kind]}"
        hint = _HINTS[_KINDS[kind]]
    elif kind in {"too_short", "too_long"}:
        number = context.get("min_length", context.get("max_length", 0))
        limit = "at least" if kind == "too_short" else "at most"
        message = f"found {_entries(context['actual_length'])}; expected {limit} {number}"
        hint = f"Write {limit} {number}, or remove the key if it need not be there."
    else:
        message, hint = error["msg"], f"{Term.KEYS} lists what is allowed here."
    faults.add(path, "wrong-kind", message, hint)


def _entries(number: int) -> str:
    return f"{number} {'entry' if number == 1 else 'entries'}"


def node_at(data: Node, path: KeyPath) -> Node:
    """What stands at a path."""
    for key in path:
        if isinstance(data, dict):
            data = data.get(str(key))
        elif isinstance(data, list):
            data = data[int(key)]
    return data
