"""Forces in linings and bolts: extremes as text, all of them for JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from geoident.model.arrays import Ints
from geoident.model.result import MemberForces
from geoident.report.text.layout import number, table

TITLE = "Structures (kN, kNm; of linings per metre out of plane; tension positive)"
HEADER = ["structure", "stage", "N from", "N to", "|M| up to", "|Q| up to"]
SIDES = "llrrrr"


def members_text(found: MemberForces | None) -> str:
    """One line for each structure and stage at which it stands: the extremes of its forces."""
    rows = extremes(found)
    return table(HEADER, rows, right=SIDES) if rows else ""


def extremes(found: MemberForces | None) -> list[list[str]]:
    """The cells of these lines, kN and kNm."""
    if found is None:
        return []
    rows = []
    for name, mine, stage in _standing(found):
        axial = found.axial[mine, stage] / 1e3
        cells = [float(axial.min()), float(axial.max())]
        if found.per_metre[mine[0]]:
            cells += [_largest(found.moment[mine, :, stage]), _largest(found.shear[mine, stage])]
        texts = [number(cell) for cell in cells] + ["-"] * (4 - len(cells))
        rows.append([name, found.stages[stage], *texts])
    return rows


def members_list(found: MemberForces | None) -> list[dict[str, Any]]:
    """One object for each piece of a lining, each bolt, and stage at which it stands; SI."""
    if found is None:
        return []
    return [_member(found, int(i), stage) for _, mine, stage in _standing(found) for i in mine]


def _member(found: MemberForces, i: int, stage: int) -> dict[str, Any]:
    bent = bool(found.per_metre[i])
    return {
        "structure": found.structures[i],
        "number": int(found.numbers[i]),
        "stage": found.stages[stage],
        "ends": found.ends[i].tolist(),
        "N": found.axial[i, stage],
        "M": found.moment[i, :, stage].tolist() if bent else None,
        "Q": found.shear[i, stage] if bent else None,
        "per_metre": bent,
    }


def _standing(found: MemberForces) -> Iterator[tuple[str, Ints, int]]:
    """Every structure with its members and each stage at which it stands."""
    names = np.array(found.structures)
    for name in dict.fromkeys(found.structures):
        mine = np.flatnonzero(names == name)
        for stage in range(len(found.stages)):
            if np.isfinite(found.axial[mine[0], stage]):
                yield name, mine, stage


def _largest(forces: Any) -> float:
    return float(np.abs(forces).max()) / 1e3
