"""A page for people with all keys of a file, made from its schema."""

from __future__ import annotations

import json
import re
import textwrap
from collections import Counter
from typing import Any

from geoident.io.docs.schema import REF, Schema, paragraphs, referred_sections, schema_of
from geoident.io.schema.section import Section

_SUFFIX = "Section"
_LONG = 60  # characters of a meaning that is given once


def key_page(head: str, name: str, schema: Schema) -> str:
    """A page of keys: one part for the file, and one for every section in the order of its use.

    What several parts would repeat stands in one of them, to which the others refer: keys that
    sections inherit have a part of their own, and a key with the same entry elsewhere has a link.

    Args:
        head: above it.
        name: heading of the first part.
        schema: of the file.
    """
    classes = _classes_by_name(Section)
    names = _in_order(schema)
    heirs = Counter(base for one in names for base in _lineage(classes[one]))
    shared = {one: schema_of(classes[one], one) for one, number in heirs.items() if number > 1}
    sections: dict[str, Any] = {one: s for one, s in shared.items() if s.get("properties")}
    sections |= schema["$defs"]
    headings = {one: f"Shared keys: {title(one).lower()}" for one in sections}
    headings |= {one: title(one) for one in names}
    known = {one: [b for b in _lineage(classes[one]) if b in sections] for one in sections}
    places: dict[tuple[str, str, str], str] = {}  # where an entry is described
    parts = [head, _part(name, paragraphs(schema), _entries(schema))]
    for one in dict.fromkeys(part for name in names for part in reversed(known[name])):
        about, entries = paragraphs(sections[one]), _entries(sections[one])
        for base in known[one][1:2]:
            inherited = _entries(sections[base])
            entries = [entry for entry in entries if entry not in inherited]
            about = [text for text in about if text not in paragraphs(sections[base])]
            about.append(f"Further keys under {_link(headings[base])}.")
        for k, (key, allowed, meaning) in enumerate(entries):
            place = places.setdefault((key, allowed, meaning), headings[one])
            if place != headings[one] and len(meaning) > _LONG:
                entries[k] = (key, allowed, f"As in {_link(place)}.")
        parts.append(_part(headings[one], about, entries))
    return "\n".join(parts)


def _classes_by_name(root: type[Section]) -> dict[str, type[Section]]:
    """All classes below one, by their names."""
    below = {sub.__name__: sub for sub in root.__subclasses__()}
    return below | {k: v for sub in below.values() for k, v in _classes_by_name(sub).items()}


def _lineage(section: type[Section]) -> list[str]:
    """Names of a class and of those that it inherits keys from, the nearest first."""
    bases = [one for one in section.__mro__ if issubclass(one, Section) and one is not Section]
    return [one.__name__ for one in bases]


def title(name: str) -> str:
    """The heading of a section.

    >>> title("GaussNewtonOptionsSection")
    'Gauss newton options'
    >>> title("GaugeBase")
    'Gauge'
    """
    words = name.strip("_").removesuffix(_SUFFIX).removesuffix("Base")
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", words).capitalize()


def _in_order(schema: Schema) -> list[str]:
    """Sections as a reader of the case comes upon them, what is inside right after."""
    order: dict[str, None] = {}

    def visit(node: object) -> None:
        for name in referred_sections(node):
            if name not in order:
                order[name] = None
                visit(schema["$defs"][name])

    visit({key: value for key, value in schema.items() if key != "$defs"})
    return list(order)


def _part(heading: str, about: list[str], entries: list[tuple[str, str, str]]) -> str:
    """A heading, what the section is, and a list of its keys."""
    rows = [wrapped(f"- {k} ({v}): {m}" if m else f"- {k} ({v})", "  ") for k, v, m in entries]
    return "\n\n".join([f"## {heading}", *map(wrapped, about), "\n".join(rows)]).rstrip() + "\n"


def _entries(section: Schema) -> list[tuple[str, str, str]]:
    """Each key with what is allowed and what it means."""
    required = (*section.get("required", ()), *section.get("else", {}).get("required", ()))
    head = paragraphs(section)[:1]
    entries = []
    for name, key in section.get("properties", {}).items():
        default = "" if name in required else _default(key)
        meaning = _about(key)
        repeated = "const" in key and [meaning] == head  # of a key that chooses the section
        entries.append(
            (
                f"**`{name}`**" if name in required else f"`{name}`",
                _value(key) + (f", default {default}" if default else ""),
                "" if repeated else meaning,
            )
        )
    return entries


def _about(key: Schema) -> str:
    generic = key.get("patternErrorMessage", "")  # holds the example of its dimension
    shown = [_yaml(example) for example in key.get("examples", ())]
    examples = ", ".join(f"`{text}`" for text in shown if f"such as {text}" not in generic)
    text = " ".join(key.get("description", "").split())
    return f"{text} Example: {examples}." if examples else text


def _default(key: Schema) -> str:
    default = key.get("default")
    return "" if default in (None, "", [], {}) else f"`{_yaml(default)}`"


def _yaml(value: object) -> str:
    """A value as users write it."""
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    return value if isinstance(value, str) else json.dumps(value)


def _link(heading: str) -> str:
    """A link to a part."""
    return f"[{heading}](#{heading.lower().replace(':', '').replace(' ', '-')})"


def _value(node: Schema) -> str:
    """What is allowed there."""
    if "$ref" in node:
        return _link(title(str(node["$ref"]).removeprefix(REF)))
    for key in ("anyOf", "oneOf"):
        if key in node:
            words = [_value(n) for n in node[key] if n.get("type") != "null"]
            return " or ".join(dict.fromkeys(words))
    if "const" in node:
        return f"`{node['const']}`"
    if "enum" in node:
        return ", ".join(f"`{_yaml(value)}`" for value in node["enum"])
    kind = node.get("type", "")
    if kind == "array":
        return f"list of {_value(node.get('items', {}))}"
    if kind == "object":
        values = node.get("additionalProperties", {})
        return f"names to {_value({} if values is True else values)}"
    if "x-quantity" in node:
        return str(node["x-quantity"])
    names = {"string": "text", "integer": "whole number", "boolean": "`true` or `false`"}
    return names.get(str(kind), str(kind) or "anything")


def wrapped(text: str, indent: str = "") -> str:
    """Text on lines of at most 100 characters; what stands between backticks is not parted."""
    whole = re.sub(r"`[^`]*`", lambda code: code[0].replace(" ", "\0"), text)
    lines = textwrap.wrap(
        whole, 100, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return "\n".join(lines).replace("\0", " ")
