"""Numbers of a case in words: as written, and with what was identified in place of parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from geoident.model.results.result import ParameterTable
from geoident.report.text.layout import with_interval
from geoident.report.text.parameters import unknown_words
from geoident.units import in_unit, shown_unit

CaseTexts = Mapping[str, Any]
"""What a key of a case holds: texts, lists and mappings of texts."""

_TIE = re.compile(r"^\s*(?:([-+.\deE]+)\s*\*?\s*)?\$\{?([A-Za-z_]\w*)\}?\s*$")

_NUMBERED = re.compile(r"^(.*?)(\d{1,9})$")


@dataclass(frozen=True)
class ShownNumbers:
    """How the numbers of a case are shown.

    Args:
        parameters: the parameters of the case, as it gives them.
        identified: the parameters as identified; None before a fit.
    """

    parameters: CaseTexts
    identified: ParameterTable | None = None

    def text(self, value: object) -> str:
        """A value of the case in words.

        >>> ShownNumbers({"E": {"start": "20 GPa"}}).text("0.5 $E")
        '0.5 E (start 20 GPa)'
        >>> ShownNumbers({}).text({"mean": "3 GPa", "sd": "20 %"})
        'mean 3 GPa, sd 20 %'
        >>> ShownNumbers({}).text(["x", "y"])
        'x, y'
        """
        if isinstance(value, Mapping):
            return ", ".join(f"{key} {self.text(part)}" for key, part in value.items())
        if isinstance(value, list):
            parts = [f"[{self.text(p)}]" if isinstance(p, list) else self.text(p) for p in value]
            return ", ".join(parts)
        text = str(value)
        tie = _TIE.match(text)
        return self._tied(float(tie[1] or 1.0), tie[2]) if tie else text

    def _tied(self, factor: float, name: str) -> str:
        """A parameter, or a multiple of one."""
        times = "" if factor == 1.0 else f"{factor:g} "
        table = self.identified
        if table is None or name not in table.names:
            start = self.parameters.get(name)
            start = start.get("start") if isinstance(start, Mapping) else None
            return f"{times}{name}" + (f" (start {start})" if start else "")
        i = table.names.index(name)
        if not table.determined[i]:
            return f"{times}{name} ({unknown_words(table, i)})"
        unit = table.units[i], table.dimensions[i]
        columns = table.values, table.lower95, table.upper95
        value, *ends = (factor * in_unit(float(column[i]), *unit) for column in columns)
        estimate, low, high = with_interval(value, min(ends), max(ends))
        words = f"{estimate} {shown_unit(*unit)}".rstrip()
        return words if low == "-" else f"{words} ({low} to {high})"


def entries(case: CaseTexts, key: str) -> CaseTexts:
    """What a key of a case holds by name; empty where it is missing or of another kind."""
    entry = case.get(key)
    return entry if isinstance(entry, Mapping) else {}


def ranged(names: Sequence[str]) -> str:
    """Names in a row, with those that only count on drawn together.

    >>> ranged(["rock", "lift-1", "lift-2", "lift-3", "top 1", "top 2"])
    'rock, lift-1 to 3, top 1, top 2'
    """
    runs: list[list[str]] = []
    for name in names:
        before = _NUMBERED.match(runs[-1][-1]) if runs else None
        now = _NUMBERED.match(name)
        follows = before and now and before[1] == now[1] and int(before[2]) + 1 == int(now[2])
        if follows:
            runs[-1].append(name)
        else:
            runs.append([name])
    parts: list[str] = []
    for run in runs:
        last = _NUMBERED.match(run[-1])
        parts += [f"{run[0]} to {last[2]}"] if last and len(run) > 2 else run
    return ", ".join(parts)


def listed(value: object) -> list[str]:
    """A list of names; empty where there is none."""
    return [str(name) for name in value] if isinstance(value, list) else []
