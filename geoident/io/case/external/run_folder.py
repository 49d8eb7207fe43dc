"""Names of files in the folder of a run: none leads out of it."""

from __future__ import annotations

import re

from geoident.io.text.faults import Faults
from geoident.io.text.wording import shorten
from geoident.model.case import KeyPath


def check_inside(name: str, path: KeyPath, faults: Faults, *, key: bool = False) -> None:
    """Note a name that leads out of the folder of a run.

    Args:
        name: of a file; its folders may stand before it.
        path: of the key with the name.
        faults: is told.
        key: the name is the key itself.
    """
    parts = re.split(r"[/\\]", name)
    if not name.strip() or name[0] in "/\\~" or ".." in parts or re.match("[A-Za-z]:", name):
        message = f"'{shorten(name)}' leads out of the folder of a run"
        hint = "Write a name, or a path below that folder."
        faults.add(path, "outside", message, hint, key=key)
