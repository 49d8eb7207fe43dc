"""What of a case its model elsewhere refers to."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from geoident.io.text.faults import Faults
from geoident.io.text.wording import shorten
from geoident.model.case import KeyPath
from geoident.model.gauges import Channel
from geoident.model.in_service import Series
from geoident.model.parameter import Parameter

FindFile = Callable[[str, KeyPath], str]
"""Path of a file that the case names at a key; notes a fault if it is not there."""


@dataclass(frozen=True)
class ModelContext:
    """What of a case its model elsewhere refers to.

    Args:
        parameters: by name.
        channels: in their order.
        stages: names in their order.
        tied: names of the parameters that gauges use.
        folder: of the case.
        find: finds files.
        faults: is told what is wrong.
        dates: stage to the date of its end, seconds since 1970, where dates are given.
        series: loads that change in time, by name.
        loads: names of all loads, also of those that could not be read.
    """

    parameters: Mapping[str, Parameter]
    channels: Sequence[Channel]
    stages: Sequence[str]
    tied: frozenset[str]
    folder: Path
    find: FindFile
    faults: Faults
    dates: Mapping[str, float] = field(default_factory=dict)
    series: Mapping[str, Series] = field(default_factory=dict)
    loads: Sequence[str] = ()

    def check_inside(self, name: str, path: KeyPath, *, key: bool = False) -> None:
        """Note a name that leads out of the folder of a run.

        Args:
            name: of a file; its folders may stand before it.
            path: of the key with the name.
            key: the name is the key itself.
        """
        parts = re.split(r"[/\\]", name)
        if not name.strip() or name[0] in "/\\~" or ".." in parts or re.match("[A-Za-z]:", name):
            message = f"'{shorten(name)}' leads out of the folder of a run"
            hint = "Write a name, or a path below that folder."
            self.faults.add(path, "outside", message, hint, key=key)
