"""Where the numbers of a case are tied to its parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pydantic import BaseModel

from geoident.io.case.schema import CaseSection
from geoident.io.case.values import Given
from geoident.io.text.faults import Faults
from geoident.model.case import KeyPath
from geoident.units import with_article


def check_ties(section: CaseSection, faults: Faults) -> None:
    """Note ties to unknown parameters or of another dimension, and parameters without any use."""
    used = set()
    for path, given in _numbers(section, ()):
        if given.parameter is not None:
            used.add(given.parameter)
            _check_tie(section, path, given, faults)
    for name in section.parameters:
        if name not in used:
            message = f"the parameter '{name}' is declared, but nothing depends on it"
            hint = f"Write ${name} where it stands, or remove it."
            faults.add(("parameters", name), "unused-parameter", message, hint, key=True)


def _numbers(node: object, path: KeyPath) -> Iterator[tuple[KeyPath, Given]]:
    """Every number of the case with its path."""
    if isinstance(node, Given):
        yield path, node
    elif isinstance(node, BaseModel):
        for name, info in type(node).model_fields.items():
            yield from _numbers(getattr(node, name), (*path, info.alias or name))
    elif isinstance(node, Mapping):
        for key, value in node.items():
            yield from _numbers(value, (*path, key))
    elif isinstance(node, list):
        for n, value in enumerate(node):
            yield from _numbers(value, (*path, n))


def _check_tie(section: CaseSection, path: KeyPath, given: Given, faults: Faults) -> None:
    parameter = section.parameters.get(given.parameter or "")
    if parameter is None:
        message = f"there is no parameter '{given.parameter}'"
        hint = faults.did_you_mean(given.parameter or "", section.parameters, what="Parameters")
        faults.add(path, "unknown-parameter", message, hint)
    elif parameter.start.dimension != given.dimension:
        message = f"'{given.text}' is {with_article(parameter.start.dimension)} "
        message += f"(start: {parameter.start.text}); {with_article(given.dimension)} is expected"
        hint = "Change the unit of its start, or use another parameter."
        faults.add(path, "unit", message, hint)
