"""Forces in beams and bars, extremes as text; reactions of supports; all of them for JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.result import MemberForces, SupportReactions
from geoident.report.text.layout import TextTable, number
from geoident.report.text.rows import objects

NAME = "Structures"
TITLE = f"{NAME} (kN, kNm; of walls and linings per metre; of bars each; tension positive)"
REACTIONS_TITLE = "Reactions of supports (kN; per metre in plane strain; on the ground)"
_KILO = 1e3
_ROUNDING = 1e-10
"""Part of the largest reaction that is rounding of the forces around."""


def reaction_table(found: SupportReactions | None) -> TextTable:
    """The resultant of each support at each state at which it holds."""
    if found is None:
        return TextTable(("support", "stage"), [])
    axes = "xyz"[: found.force.shape[2]]
    rounding = _ROUNDING * np.abs(np.nan_to_num(found.force)).max(initial=0.0)
    force = np.where(np.abs(found.force) <= rounding, 0.0, found.force)  # of NaN: as it is
    rows = [
        [found.supports[i], found.states[j], *map(_force, force[i, j])] for i, j in found.holding
    ]
    header = ("support", "stage", *(f"R_{axis}" for axis in axes))
    return TextTable(header, rows, right="ll" + "r" * len(axes))


def _force(force: float) -> str:
    return number(float(force) / _KILO) if np.isfinite(force) else "-"


def force_table(found: MemberForces | None) -> TextTable:
    """The extremes of the forces of each structure at each stage at which it stands.

    Hoop forces are shown if there are shells, and the force to which bars were stressed at a stage
    if any were.
    """
    header = ["structure", "stage", "N from", "N to", "|M| up to", "|Q| up to"]
    rows: list[list[str]] = []
    if found is not None:
        shells, stressed = (np.isfinite(x).any() for x in (found.hoop, found.prestress))
        header += ["hoop N from", "hoop N to"] * bool(shells) + ["stressed to"] * bool(stressed)
        for name, members, stage in _present(found):
            row = _row(found, name, members, stage)
            row += _range(found.hoop[members, stage]) if shells else []
            row += _range(found.prestress[members, stage])[:1] if stressed else []
            rows.append(row)
    return TextTable(tuple(header), rows, right="ll" + "r" * (len(header) - 2))


def _range(forces: Floats) -> list[str]:
    """Least and largest force as text, kN; dashes where there is none."""
    if not np.isfinite(forces).all():
        return ["-", "-"]
    return [number(float(force) / _KILO) for force in (forces.min(), forces.max())]


def _row(found: MemberForces, name: str, members: Ints, stage: int) -> list[str]:
    axial = found.axial[members, stage]
    extremes = [float(axial.min()), float(axial.max())]
    if found.per_metre[members[0]]:
        extremes += [
            _largest(found.moment[members, :, stage]),
            _largest(found.shear[members, stage]),
        ]
    cells = [number(force / _KILO) for force in extremes]
    return [name, found.stages[stage], *cells, *["-"] * (4 - len(cells))]


def _largest(forces: Floats) -> float:
    return float(np.abs(forces).max())


def structures_list(found: MemberForces | None) -> list[dict[str, Any]]:
    """One object for each piece of a lining, each bar, and stage at which it stands; SI."""
    if found is None:
        return []
    rows = [(int(i), stage) for _, members, stage in _present(found) for i in members]
    listed = objects(found, "member", "stage", rows=rows)
    return [{**row, "M": row["M"] if row["per_metre"] else None} for row in listed]


def _present(found: MemberForces) -> Iterator[tuple[str, Ints, int]]:
    """Every structure with its members (indices) and each stage at which it stands."""
    names = np.array(found.structures)
    for name in dict.fromkeys(found.structures):
        members = np.flatnonzero(names == name)
        for stage in np.flatnonzero(np.isfinite(found.axial[members[0]])).tolist():
            yield name, members, stage
