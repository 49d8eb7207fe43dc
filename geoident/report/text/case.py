"""What the page says of the case in a result: its title, and what its axes are called."""

from __future__ import annotations

from typing import Any

import yaml

from geoident.model.result import Result

AXISYMMETRIC = ("radius r", "height y", "")
CARTESIAN = ("x", "y", "z")


def case_title(result: Result) -> str:
    """The title that the user gave the case; empty if there is none."""
    title = _case(result).get("title", "")
    return title if isinstance(title, str) else ""


def axis_names(result: Result) -> tuple[str, ...]:
    """What the coordinates are called."""
    return AXISYMMETRIC if _case(result).get("analysis") == "axisymmetric" else CARTESIAN


def _case(result: Result) -> dict[str, Any]:
    """The case as texts; empty if there is none that can be read."""
    try:
        case = yaml.load(result.case_resolved, Loader=yaml.BaseLoader)
    except (yaml.YAMLError, RecursionError):
        return {}
    return case if isinstance(case, dict) else {}
