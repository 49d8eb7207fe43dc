"""Overrides, ``parameters.E.start=20 GPa``: values in place of those of a case."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from copy import deepcopy
from typing import Any, cast

from geoident.errors import Fault, InputError, Location, Term
from geoident.io.text.faults import OVERRIDES, Places
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.io.text.yaml_reader import Document, Node, parse_yaml
from geoident.model.case import KeyPath, format_path

_STEP = re.compile(r"""\.?(?:([^.\[\]="']+)|\[([0-9]{1,6})\]|\[?"([^"]+)"\]?)""")
_MAY_BE_NEW = {"fit", "report"}
_MOST_KEYS = 16


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


def written_value(value: Any) -> str:
    """A value of a file as an override has it: texts as they are, all else as JSON, which is YAML.

    >>> written_value("8 MPa"), written_value([1, 2])
    ('8 MPa', '[1, 2]')
    """
    if value is None:
        return "null"
    if isinstance(value, str) and _stays(value):
        return value
    return json.dumps(value, ensure_ascii=False)


def _stays(text: str) -> bool:
    """Whether a text is the same when it is read as YAML."""
    try:
        return parse_yaml(text, "").data == text
    except InputError:
        return False


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
        message = f"{outer} is {kind}, '{key}' cannot be set in it"
        raise Refusal("bad-override", message, _remedy(holder, path))


def _remedy(holder: Node, path: KeyPath) -> str:
    """How the key of a list, of a mapping or of a single value is written."""
    key, outer = path[-1], path[:-1]
    if isinstance(holder, list):
        names = [entry.get("name") if isinstance(entry, dict) else None for entry in holder]
        number = names.index(key) if key in names else 0
        if isinstance(key, str) and key.isdecimal() and int(key) < len(holder):
            number = int(key)
        text = f"Write {format_path((*outer, number))}: entries of a list are counted from 0"
        return f"{text}, in brackets."
    if isinstance(holder, dict):
        return did_you_mean(str(key), holder)
    return f"Set it as a whole: {format_path(outer)}=VALUE."
