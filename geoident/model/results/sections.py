"""How far N and M use the strength of sections, of walls and linings and of shells alike."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.result import MemberForces
from geoident.model.results.shells import SECTIONS, ShellForces, along


@dataclass(frozen=True)
class SectionUse:
    """The sections of a structure of given strength: k pieces of a lining, or faces of a shell.

    Args:
        structure: its name.
        direction: of N, of a shell, such as ``along axis 1``; empty for a lining.
        stages: names of the stages.
        used: (k, n_stages) the part of the strength that is used; infinite where no strength could
            bear N and M, NaN while it does not stand.
        axial: (k, n_stages) N, N per metre, tension positive.
        moment: (k, n_stages) M where most is used, N m per metre.
        places: (k, n_stages, dim) m.
    """

    structure: str
    direction: str
    stages: tuple[str, ...]
    used: Floats
    axial: Floats
    moment: Floats
    places: Floats

    @property
    def name(self) -> str:
        """The structure and the direction."""
        return f"{self.structure} {self.direction}".strip()

    @property
    def most(self) -> Floats:
        """(n_stages,) the largest part that is used; NaN while it does not stand."""
        return np.asarray(np.fmax.reduce(self.used))


def section_uses(members: MemberForces | None, shells: ShellForces | None) -> list[SectionUse]:
    """Those of all structures whose strength the case gives."""
    uses = [] if members is None else [*_of_linings(members)]
    uses += [] if shells is None else [*_of_shells(shells)]
    return [use for use in uses if not np.isnan(use.used).all()]


def _of_linings(forces: MemberForces) -> Iterator[SectionUse]:
    """Of both ends of a piece that with the larger moment counts."""
    if forces.utilisation is None:
        return
    end = np.abs(np.nan_to_num(forces.moment)).argmax(axis=1)
    moment = np.take_along_axis(forces.moment, end[:, None], axis=1)[:, 0]
    places = np.take_along_axis(forces.ends, end[:, :, None], axis=1)
    names = np.array(forces.structures)
    for name in dict.fromkeys(forces.structures):
        own = names == name
        parts = (forces.utilisation, forces.axial, moment, places)
        yield SectionUse(name, "", forces.stages, *(part[own] for part in parts))


def _of_shells(forces: ShellForces) -> Iterator[SectionUse]:
    if forces.utilisation is None or forces.used_angle is None:
        return
    names = np.array(forces.structures)
    angles = np.zeros_like(forces.used_angle), np.full_like(forces.used_angle, np.pi / 2)
    for name in dict.fromkeys(forces.structures):
        own = names == name
        places = np.repeat(forces.centres[own, None], len(forces.stages), axis=1)
        for k, angle in enumerate((*angles, forces.used_angle)):
            yield SectionUse(
                name,
                SECTIONS[k],
                forces.stages,
                forces.utilisation[own, k],
                along(forces.normal[own], angle[own]),
                along(forces.moment[own], angle[own]),
                places,
            )
