"""The JSON schema of case files and the page of all their keys, from the code that validates them.

``python -m geoident.io.docs.case_schema`` prints the schema, with ``--markdown`` the page.
"""

from __future__ import annotations

import json
import sys
from functools import cache
from typing import Any

from geoident.io.case.case import CaseSection
from geoident.io.docs.key_page import key_page, wrapped
from geoident.io.docs.schema import schema_of
from geoident.units import DIMENSIONS, units_of

_HEAD = """\
# All keys of a case file

Made from the code that reads cases (`geoident schema --markdown`). Each key is followed, in
parentheses, by what it may hold and by its default. Bold keys are required. A quantity carries its
unit (`15 GPa`). Where `$parameter` is allowed, a parameter of the case may replace the number, also
with a factor (`0.6 $E_rock`).
"""
_UNITS = """\
## Units

Powers and products may also be written `m³`, `m^3`, `kN·m`, `kN m`, and `µ` for `u`. A unit in
several rows takes the dimension that the key expects. `tsf` counts short tons, `mH2O` is a head of
water of 1000 kg/m3, and `mm/m` of an angle is its tangent. The first unit is that of SI.
"""


@cache
def case_schema() -> dict[str, Any]:
    """The schema of case files, made once: not to be changed.

    >>> case_schema()["title"]
    'geoident case'
    """
    return schema_of(CaseSection, "geoident case")


def case_schema_text() -> str:
    """The schema as it is in ``schemas/case.schema.json``."""
    return json.dumps(case_schema(), indent=2, ensure_ascii=False) + "\n"


def key_page_text() -> str:
    """The page of all keys as it is in ``geoident/docs/keys.md``."""
    return "\n".join([key_page(_HEAD, "Case", case_schema()), _units()])


def _units() -> str:
    """The units of each dimension, that of SI first."""
    rows = [
        wrapped(f"- {dimension}: {', '.join(f'`{unit}`' for unit in units if unit)}", "  ")
        for dimension, si in DIMENSIONS.items()
        for units in (dict.fromkeys((si, *units_of(dimension))),)
    ]
    return "\n".join([_UNITS, *rows, ""])


if __name__ == "__main__":
    sys.stdout.write(key_page_text() if "--markdown" in sys.argv[1:] else case_schema_text())
