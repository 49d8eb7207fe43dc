"""Mappings, lists and texts as YAML, as `yaml_reader` reads them again.

PyYAML says how a text is written; what it says of a text on one line is remembered, and the lines
are put together here: PyYAML alone takes ten times as long, which many small runs would feel. A
document with a text that fills several lines is left to it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import TypeAlias

import yaml

Written: TypeAlias = "Mapping[str, Written] | list[Written] | str"

_WIDTH = 100
"""Columns beyond which a text goes on in the next line."""

_PLAIN = re.compile(r"-?[A-Za-z0-9_$/][\w$/.+*%^()-]*(?: [\w$/.+*%^()-]+)*", re.ASCII)
"""Texts that stand for themselves, unless they are a word for nothing."""

_NULL = re.compile(r"(?:~|null|Null|NULL|)$")


class _Dumper(yaml.SafeDumper):
    """Leaves out the quotes wherever `yaml_reader` reads the same text without them."""

    def ignore_aliases(self, data: object) -> bool:
        return True


_Dumper.yaml_implicit_resolvers = {}
_Dumper.add_implicit_resolver("tag:yaml.org,2002:null", _NULL, ["~", "n", "N", ""])


def yaml_text(data: Written) -> str:
    r"""A document in block style, keys in their order.

    Args:
        data: what to write.

    >>> yaml_text({"a": {"b": "1 m", "c": ["x", {"y": "null"}]}})
    "a:\n  b: 1 m\n  c:\n  - x\n  - y: 'null'\n"
    """
    try:
        return "".join(f"{line}\n" for line in _block(data, 0))
    except _NotOnOneLine:
        return _by_pyyaml(data)


def compact_text(data: Written) -> str:
    r"""A document for people: lists and mappings that hold nothing but texts on one line.

    Args:
        data: what to write.

    >>> compact_text({"a": {"b": "1 m", "c": ["x", "y"]}, "d": {"e": "f"}})
    'a:\n  b: 1 m\n  c: [x, y]\nd: {e: f}\n'
    """
    return _by_pyyaml(data, flow=None)


def _by_pyyaml(data: Written, *, flow: bool | None = False) -> str:
    return yaml.dump(
        data,
        Dumper=_Dumper,
        default_flow_style=flow,
        sort_keys=False,
        allow_unicode=True,
        width=_WIDTH,
    )


class _NotOnOneLine(Exception):
    """A text has to be broken."""


def _block(node: Written, indent: int) -> Iterator[str]:
    """The lines of a mapping or a list that is not empty, or the line of anything else."""
    if isinstance(node, Mapping) and node:
        for key, value in node.items():
            yield from _entry(key, value, indent)
    elif isinstance(node, list) and node:
        for value in node:
            lines = _block(value, indent + 2)
            first = next(lines)
            yield f"{' ' * indent}- {first[indent + 2 :]}"
            yield from lines
    else:
        yield _line(" " * indent, node)


def _entry(key: str, value: Written, indent: int) -> Iterator[str]:
    """The lines of a key and its value; a list begins where its key does."""
    if not (key and key.isprintable()):  # written in another way than a value
        raise _NotOnOneLine
    start = f"{_line(' ' * indent, key)}:"
    if isinstance(value, Mapping | list) and value:
        yield start
        yield from _block(value, indent + (2 if isinstance(value, Mapping) else 0))
    else:
        yield _line(f"{start} ", value)


def _line(start: str, node: Written) -> str:
    if isinstance(node, str):
        line = start + (node if _PLAIN.fullmatch(node) and not _NULL.match(node) else _quoted(node))
    else:
        line = start + ("{}" if isinstance(node, Mapping) else "[]")
    if len(line) > _WIDTH:
        raise _NotOnOneLine
    return line


@lru_cache(maxsize=4096)
def _quoted(text: str) -> str:
    """A text as PyYAML writes it.

    Raises:
        _NotOnOneLine: it takes several lines.
    """
    lines = _by_pyyaml([text]).splitlines()
    if len(lines) > 1:
        raise _NotOnOneLine
    return lines[0].removeprefix("- ")
