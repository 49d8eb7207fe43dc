"""Values that a skeleton leaves to its user: each is a fault until it is replaced."""

from __future__ import annotations

from collections.abc import Iterator

from geoident.io.text.faults import Faults, Places
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath

BLANK = "FILL_IN"
"""Stands for a value that is still to be given."""

_HINTS = {
    "E": "Young's modulus with its unit, such as 15 GPa, or $NAME of a parameter.",
    "nu": "Poisson's ratio, such as 0.25.",
    "groups": "The name of a material, or absent.",
    "supports": "Groups and the directions in which they are fixed, such as {bottom: [x, y]}.",
    "stages": "The steps of construction, such as [{name: heading, excavate: [GROUP]}].",
    "gauges": "What is measured; the comment there has an example of each kind.",
}


def refuse_blanks(places: Places) -> None:
    """Raise `InputError` with all values that are left to fill in."""
    faults = Faults(places)
    for path in _blanks(places.data, ()):
        hint = next((_HINTS[str(key)] for key in reversed(path) if str(key) in _HINTS), "")
        faults.add(path, "fill-in", f"{BLANK} is to be replaced", hint or "Give the value.")
    faults.raise_any()


def _blanks(node: Node, path: KeyPath) -> Iterator[KeyPath]:
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _blanks(value, (*path, key))
    elif isinstance(node, list):
        for n, value in enumerate(node):
            yield from _blanks(value, (*path, n))
    elif node == BLANK:
        yield path
