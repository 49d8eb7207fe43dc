"""The cases that the package brings along, to begin with."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files

TEMPLATES: Mapping[str, str] = {
    "cavern": "a heading and two benches with extensometers, plane strain",
    "tunnel": "four rounds with shotcrete, in three dimensions",
    "squeezing": "a tunnel in rock that yields, released in parts, plane strain",
    "opening": "a circular tunnel in rock that yields, by formulas, no mesh",
    "twin-tunnels": "two shallow tunnels in soft ground, with a tutorial",
    "dam": "four lifts of rockfill with a core, plane strain",
}
"""Name to what it is about."""


def template_files(name: str) -> dict[str, bytes]:
    """File name to contents: the case, its mesh with the geometry if it has one, its readings."""
    folder = files("geoident") / "templates" / name
    return {item.name: item.read_bytes() for item in folder.iterdir() if item.is_file()}
