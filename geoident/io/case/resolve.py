"""Writing a validated case back as YAML, with overrides and defaults filled in."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from geoident.io.case.schema import CaseSection
from geoident.model.methods import LOSS_OPTIONS, METHOD_OPTIONS


def resolved_text(section: CaseSection, chain: Sequence[str]) -> str:
    """The case as YAML, without empty sections and options of methods and losses not used.

    Quantities stay as they were written, so that the text can be read as a case again.

    Args:
        section: the case.
        chain: names of the methods, those that stand for a missing one among them.
    """
    data = section.model_dump(by_alias=True, exclude_none=True)
    fit: dict[str, Any] = {"method": chain[0], **data["fit"]}
    data["fit"] = fit
    for name in (METHOD_OPTIONS.keys() | LOSS_OPTIONS.keys()) - {*chain, section.fit.loss}:
        fit.pop(name, None)
    return yaml.dump(
        _without_empty(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100
    )


def _without_empty(node: Any) -> Any:
    """The same without empty lists and mappings, which stand for missing keys."""
    if isinstance(node, Mapping):
        return {key: _without_empty(value) for key, value in node.items() if value not in ({}, [])}
    if isinstance(node, list):
        return [_without_empty(value) for value in node]
    return node if isinstance(node, str) else str(node).lower()


class _Dumper(yaml.SafeDumper):
    """Leaves out the quotes wherever `yaml_reader` reads the same text without them."""

    def ignore_aliases(self, data: object) -> bool:
        return True


_NULL = re.compile(r"(?:~|null|Null|NULL|)$")
_Dumper.yaml_implicit_resolvers = {}
_Dumper.add_implicit_resolver("tag:yaml.org,2002:null", _NULL, ["~", "n", "N", ""])
