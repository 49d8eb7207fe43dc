"""Forces in beams and bars, extremes as text; reactions of supports; all of them for JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.result import MemberForces, SupportReactions
from geoident.model.results.sections import SectionUse
from geoident.model.results.shells import ShellForces
from geoident.report.text.layout import TextTable, number
from geoident.report.text.rows import objects

NAME = "Structures"
LININGS_TITLE = "Walls and linings (kN/m, kNm/m; tension positive)"
SHELLS_TITLE = "Shells (kN/m, kNm/m; n tension positive, m with tension on the inside)"
BARS_TITLE = "Struts, anchors and bolts (kN each; tension positive)"
TITLE = f"{NAME} (kN, kNm; of walls and linings per metre; of bars each; tension positive)"
REACTIONS_TITLE = "Reactions of supports (kN; per metre in plane strain; on the ground)"
_KILO = 1e3
_MOST_COLUMNS = 8  # of reactions across a page
_ROUNDING = 1e-10
"""Part of the largest force that is rounding of the forces around."""


def reaction_table(reactions: SupportReactions | None) -> TextTable:
    """The resultant of each support at each state at which it holds."""
    if reactions is None:
        return TextTable(("support", "stage"), [])
    axes, force = "xyz"[: reactions.force.shape[2]], _without_rounding(reactions)
    rows = [
        [reactions.supports[i], reactions.states[j], *map(_force, force[i, j])]
        for i, j in reactions.standing
    ]
    header = ("support", "stage", *(f"R_{axis}" for axis in axes))
    return TextTable(header, rows, right="ll" + "r" * len(axes))


def reaction_tables_by_stage(reactions: SupportReactions | None) -> list[TextTable]:
    """A row for each state, a column for each component that a support holds, for a page."""
    if reactions is None:
        return []
    force = _without_rounding(reactions)
    held = np.argwhere(np.isfinite(force).any(axis=1)).tolist()  # supports and components
    tables = []
    for first in range(0, len(held), _MOST_COLUMNS):
        part = held[first : first + _MOST_COLUMNS]
        header = ("stage", *(f"{reactions.supports[i]} R_{'xyz'[axis]}" for i, axis in part))
        rows = [
            [state, *(_force(force[i, j, axis]) for i, axis in part)]
            for j, state in enumerate(reactions.states)
        ]
        tables.append(TextTable(header, rows, right="l" + "r" * len(part)))
    return tables


def _without_rounding(reactions: SupportReactions) -> Floats:
    """The forces (n_supports, n_states, dim), N, with zero for rounding; NaN stays."""
    rounding = _ROUNDING * np.abs(np.nan_to_num(reactions.force)).max(initial=0.0)
    return np.where(np.abs(reactions.force) <= rounding, 0.0, reactions.force)


def _force(force: float) -> str:
    return number(float(force) / _KILO) if np.isfinite(force) else "-"


def force_table(forces: MemberForces | None, *, per_metre: bool | None = None) -> TextTable:
    """The extremes of the forces of each structure at each stage at which it stands.

    Args:
        forces: of all structures; None without any.
        per_metre: only walls and linings, or only bars; None for all structures.

    Hoop forces are shown if there are shells, the force to which bars were stressed at a stage if
    any were, the part of the strength of linings that is used if the case gives it, and the force
    per length with which grout holds bars, kN/m.
    """
    header = ["structure", "stage", "N from", "N to", "|M| up to", "|Q| up to"]
    rows: list[list[str]] = []
    if forces is not None:
        shells, stressed = (np.isfinite(x).any() for x in (forces.hoop, forces.prestress))
        used, grout = forces.utilisation, forces.grout
        header += ["hoop N from", "hoop N to"] * bool(shells) + ["stressed to"] * bool(stressed)
        header += ["strength used"] * (used is not None) + ["|grout| up to"] * (grout is not None)
        for name, members, stage in _present(forces):
            if per_metre is not None and forces.per_metre[members[0]] != per_metre:
                continue
            row = _row(forces, name, members, stage)
            row += _range(forces.hoop[members, stage]) if shells else []
            row += _range(forces.prestress[members, stage])[:1] if stressed else []
            row += [] if used is None else [percent_used(used[members, stage])]
            row += [] if grout is None else _range(np.abs(grout[members, stage]))[1:]
            rows.append(row)
    return TextTable(tuple(header), rows, right="ll" + "r" * (len(header) - 2))


def shell_table(forces: ShellForces | None) -> TextTable:
    """The extremes over the faces of each shell at each stage at which it stands."""
    header = ["structure", "stage", "n_11 from", "to", "n_22 from", "to", "|n_12| up to"]
    header += [f"|m_{part}| up to" for part in ("11", "22", "12")]
    if forces is None:
        return TextTable(tuple(header), [])
    names, rows = np.array(forces.structures), []
    greatest = [_largest(np.nan_to_num(each)) for each in (forces.normal, forces.moment)]
    for name in dict.fromkeys(forces.structures):
        faces = np.flatnonzero(names == name)
        for stage in np.flatnonzero(np.isfinite(forces.normal[faces[0], 0])).tolist():
            n, m = (
                np.where(np.abs(part) > _ROUNDING * scale, part, 0.0)
                for part, scale in zip(
                    (forces.normal[faces, :, stage], forces.moment[faces, :, stage]),
                    greatest,
                    strict=True,
                )
            )
            cells = [*_range(n[:, 0]), *_range(n[:, 1]), _force(_largest(n[:, 2]))]
            cells += [_force(_largest(m[:, part])) for part in range(3)]
            rows.append([name, forces.stages[stage], *cells])
    return TextTable(tuple(header), rows, right="ll" + "r" * 8)


STRENGTH_NOTE = (
    "Used is the part of N and M that grows to the limit of the section, both by the same factor. "
    "Where the case gives yield limits it is they, and 100 % is where it yields; else that of the "
    "rectangular section: a block of compressive strength on one side, of tensile strength (none "
    "if the case gives none) on the other. Strengths as the case gives them, without further "
    "factors."
)


def strength_table(uses: Sequence[SectionUse]) -> TextTable:
    """For each structure with a strength and each stage: where most of it is used, and by what."""
    header = ("structure", "stage", "used", "N (kN/m)", "M (kNm/m)", "at (m)")
    rows = []
    for use in uses:
        for stage in np.flatnonzero(~np.isnan(use.most)).tolist():
            k = int(np.argmax(np.nan_to_num(use.used[:, stage], nan=-1.0)))
            place = ", ".join(number(float(x), 3) for x in use.places[k, stage])
            cells = [number(float(each[k, stage]) / _KILO) for each in (use.axial, use.moment)]
            share = percent_used(use.used[:, stage])
            rows.append([use.name, use.stages[stage], share, *cells, place])
    return TextTable(header, rows, right="llrrrr")


def strength_sentence(uses: Sequence[SectionUse]) -> str:
    """How much of the strength of linings is used; empty where no strength is given."""
    if not uses:
        return ""
    use = max(uses, key=lambda one: float(np.fmax.reduce(one.most)))
    stage = int(np.argmax(np.nan_to_num(use.most, nan=-1.0)))
    if np.isinf(use.most[stage]):
        return ""  # a finding says it
    share = percent_used(use.most[[stage]])
    return (
        f"N and M use at most {share} of the strength of the linings "
        f"({use.name}, {use.stages[stage]})."
    )


def percent_used(utilisation: Floats) -> str:
    """The largest utilisation (n,) of pieces of a lining in words; a dash where none is known."""
    largest = float(np.fmax.reduce(utilisation))
    if np.isinf(largest):
        return "no capacity"
    return "-" if np.isnan(largest) else f"{100.0 * largest:.0f} %"


def _range(forces: Floats) -> list[str]:
    """Least and largest force as text, kN; dashes where there is none."""
    if not np.isfinite(forces).all():
        return ["-", "-"]
    return [number(float(force) / _KILO) for force in (forces.min(), forces.max())]


def _row(forces: MemberForces, name: str, members: Ints, stage: int) -> list[str]:
    axial, rounding = forces.axial[members, stage], _ROUNDING * _greatest(forces)
    extremes = [float(axial.min()), float(axial.max())]
    if forces.per_metre[members[0]]:
        extremes += [
            _largest(forces.moment[members, :, stage]),
            _largest(forces.shear[members, stage]),
        ]
    cells = [number(force / _KILO if abs(force) > rounding else 0.0) for force in extremes]
    return [name, forces.stages[stage], *cells, *["-"] * (4 - len(cells))]


def _greatest(forces: MemberForces) -> float:
    """The largest force, N, or moment, Nm, of all, which is what rounding goes by."""
    every = (forces.axial, forces.moment, forces.shear)
    return max(_largest(np.nan_to_num(each)) for each in every)


def _largest(forces: Floats) -> float:
    return float(np.abs(forces).max(initial=0.0))


def structures_list(forces: MemberForces | None) -> list[dict[str, Any]]:
    """One object for each piece of a lining, each bar, and stage at which it stands; SI."""
    if forces is None:
        return []
    rows = [(int(i), stage) for _, members, stage in _present(forces) for i in members]
    listed = objects(forces, "member", "stage", rows=rows)
    return [{**row, "M": row["M"] if row["per_metre"] else None} for row in listed]


def _present(forces: MemberForces) -> Iterator[tuple[str, Ints, int]]:
    """Every structure with its members (indices) and each stage at which it stands."""
    names = np.array(forces.structures)
    for name in dict.fromkeys(forces.structures):
        members = np.flatnonzero(names == name)
        for stage in np.flatnonzero(np.isfinite(forces.axial[members[0]])).tolist():
            yield name, members, stage
