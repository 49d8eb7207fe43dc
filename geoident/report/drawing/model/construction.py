"""What a model is made of and when: materials by colour, stages by number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case, Material
from geoident.model.cells import CELLS
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.mesh import Mesh, element_centres, spans
from geoident.model.parameter import Parameter, Scalar, Values
from geoident.model.results.result import ParameterTable
from geoident.report.text.layout import number, with_interval
from geoident.units import in_unit, shown_unit

Colour = tuple[float, float, float]

_PALETTE = (
    "#ece4cf", "#a9c0cf", "#c08a5e", "#64805a", "#e3c4bd", "#4f5b78", "#d9cf7e", "#8c6a5a",
    "#b9d8c2", "#a383a8", "#5f7f74", "#c9c9c9",
)  # fmt: skip
"""Colours of materials in the order of the case; the first six differ in grey too."""
_MOST_PLACES = 24


def material_colours(case: Case) -> dict[str, Colour]:
    """The colour of every material of a case: the same in all its pictures."""
    colours = {}
    for k, name in enumerate(case.materials):
        text, round_ = _PALETTE[k % len(_PALETTE)], k // len(_PALETTE)
        red, green, blue = (int(text[i : i + 2], 16) / 255 * 0.82**round_ for i in (1, 3, 5))
        colours[name] = (red, green, blue)
    return colours


@dataclass(frozen=True)
class Construction:
    """What each of the elements of a mesh goes through.

    Args:
        materials: names, in the order of the case.
        material: (n_elements,) number of the material that stands there last; of one that is only
            excavated, the one that was there; -1 where there is never any.
        dug: (n_elements,) number of the stage, from 1, in which it is excavated for good; 0: never.
        placed: (n_elements,) number of the stage in which it is placed last; 0: never.
        present: (n_stages + 1, n_elements) in the initial state and after every stage, one after
            the other.
    """

    materials: tuple[str, ...]
    material: Ints
    dug: Ints
    placed: Ints
    present: Bools

    @property
    def moved(self) -> Bools:
        """(n_elements,) excavated or placed at some stage."""
        return np.asarray((self.dug > 0) | (self.placed > 0))


def construction_of(case: Case, mesh: Mesh) -> Construction:
    """What happens to the elements of a mesh in the stages of a case."""
    names = tuple(case.materials)
    material = np.full(mesh.n_elements, -1)
    dug, placed = np.zeros(mesh.n_elements, np.int64), np.zeros(mesh.n_elements, np.int64)
    for group, name in case.groups.items():
        if name is not None:
            material[mesh.groups[group]] = names.index(name)
    present = [material >= 0]
    for n, stage in enumerate(case.stages, start=1):
        now = present[-1].copy()
        for group in stage.excavate:
            dug[mesh.groups[group]], placed[mesh.groups[group]] = n, 0
            now[mesh.groups[group]] = False
        for group, name in stage.install.items():
            elements = mesh.groups[group]
            material[elements], placed[elements], dug[elements] = names.index(name), n, 0
            now[elements] = True
        present.append(now)
    return Construction(names, material, dug, placed, np.array(present))


def marked_places(mesh: Mesh, made: Construction) -> Iterator[tuple[str, Floats]]:
    """For every connected part that moves, its stage and places (k, dim) inside, m, the best first.

    ``3`` is what is excavated in the third stage, ``+3`` what is placed in it.
    """
    middles = element_centres(mesh)
    for stages, sign in ((made.dug, ""), (made.placed, "+")):
        for n in np.unique(stages[stages > 0]):
            for part in _connected(mesh, np.flatnonzero(stages == n)):
                own = middles[part]
                order = np.linalg.norm(own - own.mean(axis=0), axis=1).argsort(kind="stable")
                first = min(len(order), _MOST_PLACES)
                spread = np.unique(np.linspace(0, 0.7 * (len(order) - 1), first).astype(int))
                yield f"{sign}{n}", own[order[spread]]


def _connected(mesh: Mesh, members: Ints) -> list[Ints]:
    """Elements (k,) in parts that share corners."""
    rows, corners = [], []
    for block, span in spans(mesh.blocks):
        nodes = block.nodes[:, : CELLS[block.kind].n_corners]
        rows.append(np.repeat(np.arange(span.start, span.stop), nodes.shape[1]))
        corners.append(nodes.ravel())
    ends = np.concatenate(rows), np.concatenate(corners)
    shape = mesh.n_elements, mesh.n_nodes
    incidence = csr_array((np.ones(len(ends[0])), ends), shape=shape)[members]
    part = connected_components(incidence @ incidence.T)[1]
    return [members[part == k] for k in range(part.max(initial=-1) + 1)]


def material_label(
    material: Material, parameters: tuple[Parameter, ...], identified: ParameterTable | None
) -> str:
    """A material with the constants that are identified, and its stiffness.

    Args:
        material: of the case.
        parameters: of the case.
        identified: their values; None where they are to be identified.
    """
    units = {p.name: (p.unit, p.dimension) for p in parameters}
    parts = []
    grown = {growth.constant for growth in material.growths}
    for name, scalar in constants(material):
        if name in grown:
            continue
        if scalar.parameter is not None and scalar.parameter in units:
            parts.append(f"{name} = {_identified(scalar, identified, *units[scalar.parameter])}")
        elif isinstance(scalar, RockMassModulus):
            parts.append(f"{name} = {stress_text(scalar.value(values_of(parameters, identified)))}")
        elif name.startswith("E") and scalar.parameter is None:
            parts.append(f"{name} = {stress_text(scalar.value({}))}")
    parts += [f"{name} grows" for name in sorted(grown)]
    varies = [field.constant for field in material.fields]
    parts += [
        f"{name} varies" for name in varies if not any(s.startswith(f"{name} ") for s in parts)
    ]
    parts = list(dict.fromkeys(parts))  # GSI may be that of strength and stiffness
    shown = ", ".join(parts[:4]) + (", ..." if len(parts) > 4 else "")
    return f"{material.name}: {shown}" if shown else material.name


def constants(record: Any) -> Iterator[tuple[str, Scalar]]:
    """All numbers of a material, by name, also those of its elasticity and of its strength."""
    for entry in fields(record):
        value = getattr(record, entry.name)
        if isinstance(value, Scalar):
            yield entry.name, value
            yield from value.parts.items() if isinstance(value, RockMassModulus) else ()
        elif is_dataclass(value) and not isinstance(value, type):
            yield from constants(value)
        elif isinstance(value, tuple) and entry.name == "yields":
            for part in value:
                yield from constants(part)


def _identified(
    scalar: Scalar, identified: ParameterTable | None, unit: str, dimension: str
) -> str:
    """The value of a constant that is tied to a parameter."""
    assert scalar.parameter is not None
    tie = "" if scalar.factor == 1.0 else f"{number(scalar.factor)} x "
    if identified is None or scalar.parameter not in identified.names:
        return f"{tie}{scalar.parameter}"
    k = identified.names.index(scalar.parameter)
    ends = (identified.values[k], identified.lower95[k], identified.upper95[k])
    low, high = sorted(in_unit(scalar.factor * end, unit, dimension) for end in ends[1:])
    value = in_unit(scalar.factor * ends[0], unit, dimension)
    text = with_interval(value, low, high)[0]
    shown = f"{text} {shown_unit(unit, dimension)}".rstrip()
    return shown if identified.determined[k] else f"{shown} (not determined)"


def stress_text(value: float) -> str:
    """A stress or a modulus in a unit in which it is no long number.

    >>> stress_text(1.5e10), stress_text(-2.5e5)
    ('15 GPa', '-250 kPa')
    """
    for size, unit in ((1e9, "GPa"), (1e6, "MPa")):
        if abs(value) >= size:
            return f"{number(value / size, 3)} {unit}"
    return f"{number(value / 1e3, 3)} kPa"


def values_of(parameters: tuple[Parameter, ...], identified: ParameterTable | None) -> Values:
    """Parameters as found, SI; those that were not, as they start."""
    values = {parameter.name: parameter.start for parameter in parameters}
    if identified is not None:
        values |= dict(zip(identified.names, identified.values.tolist(), strict=True))
    return values
