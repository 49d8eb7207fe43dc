"""A ladder of models: the same case with other ground, from the simplest on, and one fit each.

A rung is written as changes to the case (`set`, as on the command line), or as the symmetry of the
elasticity of one material: then the constants that the material lacks become parameters, with the
bounds of those that it has.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field

from geoident.io.case.ground import MaterialSection
from geoident.io.case.parameters import ParameterSection
from geoident.io.schema.section import Context, Section, optional
from geoident.io.schema.values import NAME_PATTERN, Angle, CaseNumber, Name, Text, TextOrMapping
from geoident.io.text.wording import listing
from geoident.model.case import Analysis, KeyPath, Rung, format_path

Symmetry = Literal["isotropic", "transversely-isotropic", "orthotropic"]

_APART = 1.2
"""Moduli that begin from one value start this factor to both sides of it: of equal ones the
attitude of the strata has no effect, and so no slope."""


class RungSection(Section):
    """A model of the ladder: a name with changes to the case, or a symmetry of a material."""

    name: Name | None = optional("Of the model; that of the symmetry if missing.")
    elastic: Symmetry | None = optional("Symmetry of the elasticity of a material.")
    material: Name | None = optional("Which; the one whose moduli are parameters if missing.")
    dip: Angle | None = optional("Of strata or axes; that of the material, or sought, if missing.")
    dip_direction: Angle | None = optional("Likewise, in a solid.")
    set: dict[Text, Any] = Field(
        {},
        description="Path of a key to its value for this model, as with --set; a parameter whose "
        "value is null is left out.",
        examples=[{"in_situ.K0_across": "$K0_across"}],
    )


LadderEntry = TextOrMapping[Symmetry, RungSection]


def build_ladder(
    entries: Sequence[Symmetry | RungSection],
    materials: Mapping[str, MaterialSection],
    parameters: Mapping[str, ParameterSection],
    ties: Iterable[tuple[KeyPath, CaseNumber]],
    context: Context,
) -> tuple[Rung, ...]:
    """The rungs as changes to the case; what is wrong with one is noted as a fault.

    Args:
        entries: as the case has them.
        materials: name to section.
        parameters: name to section.
        ties: where parameters stand in the case.
        context: of the key `fit.ladder`.
    """
    if not (materials and parameters):
        return ()  # there is nothing that could be simpler
    tied = [(format_path(path), tie.parameter) for path, tie in ties]
    rungs: list[Rung] = []
    for n, entry in enumerate(entries):
        place = context.at(n)
        section = RungSection(elastic=entry) if isinstance(entry, str) else entry
        name = section.name or section.elastic
        if name is None:
            hint = "Write {name: ..., set: {...}}, or a symmetry such as isotropic."
            place.refuse("missing-key", "a model of the ladder needs a name", hint)
            continue
        if any(rung.name == name for rung in rungs):
            place.refuse("duplicate-rung", f"two models of the ladder are named '{name}'")
        changes, gone = _Changes(), ["fit.ladder", *section.set]
        material = None if section.elastic is None else _material(section, materials, place)
        if material is not None:
            changes = _symmetric(section, material, materials[material], parameters, place)
        if changes.overrides and material is not None:
            gone.append(format_path(("materials", material)))
        sets = [f"{path}={json.dumps(value)}" for path, value in section.set.items()]
        # parameters of which nothing is made any more are left out
        used = {tie for path, tie in tied if not any(_below(path, other) for other in gone)}
        used.update(*map(names_in_text, (*changes.overrides, *sets)))
        used.update(path.removeprefix("parameters.") for path in section.set)
        idle = [f"parameters.{key}=null" for key in parameters if key not in used]
        rungs.append(Rung(name, (*changes.overrides, *idle, *sets), changes.origins))
    return tuple(rungs)


def names_of_sets(entries: Sequence[Symmetry | RungSection]) -> set[str]:
    """Parameters that the changes of a ladder name."""
    sets = [entry.set for entry in entries if isinstance(entry, RungSection)]
    return {name for given in sets for name in names_in_text(json.dumps(given))}


@dataclass(frozen=True)
class _Changes:
    """Overrides, and where new parameters begin: names of others, and factors."""

    overrides: tuple[str, ...] = ()
    origins: Mapping[str, tuple[tuple[str, float], ...]] | None = None


def _material(
    section: RungSection, materials: Mapping[str, MaterialSection], place: Context
) -> str | None:
    """Name of the material whose symmetry changes; None, with a fault, where that is not clear."""
    if section.material is not None:
        if section.material in materials:
            return section.material
        message = f"there is no material '{section.material}'; there are {listing(materials)}"
        place.refuse("unknown-material", message)
        return None
    sought = [
        name
        for name, written in materials.items()
        if any(n.parameter and n.dimension == "pressure" for n in written.numbers)
    ]
    if len(sought) == 1:
        return sought[0]
    what = f"several materials have ({', '.join(sought)})" if sought else "no material has"
    hint = "Name the material: {elastic: ..., material: NAME}."
    place.refuse("bad-ladder", f"{what} moduli that are parameters", hint)
    return None


def _symmetric(
    section: RungSection,
    name: str,
    material: MaterialSection,
    parameters: Mapping[str, ParameterSection],
    place: Context,
) -> _Changes:
    """The changes that give a material another symmetry; none, with a fault, where they cannot be.

    Args:
        section: the symmetry, and how the strata lie.
        name: of the material.
        material: as it is written.
        parameters: name to section.
        place: of the rung.
    """
    given = {
        key: value.text
        for key in ("dip", "dip_direction")
        if (value := getattr(section, key)) is not None
    }
    if material.elastic == section.elastic and not given:
        return _Changes()
    written = material.model_dump(by_alias=True, exclude_none=True)
    have = _constants(written)
    if have is None:
        message = f"the material '{name}' is neither isotropic by E and nu, "
        message += "transversely isotropic by engineering constants, nor orthotropic"
        hint = "Write this model with 'set': {'materials." + name + "': {...}}."
        place.refuse("bad-ladder", message, hint)
        return _Changes()
    tie = have["E_1"].strip()
    if not tie.startswith("$") or tie[1:] not in parameters:
        message = f"its Young's modulus is '{tie}'; expected one parameter alone there"
        place.refuse("bad-ladder", message, "Write this model with 'set'.")
        return _Changes()
    new = _NewParameters(tie[1:], parameters[tie[1:]])
    lying: Mapping[str, Any] = {}
    if section.elastic != "isotropic":
        lying = given or {key: written[key] for key in _LYING if key in written}
        lying = lying or _unknown_dip(section, name, new, place)
    solid = place.analysis is Analysis.SOLID
    constants = _constants_of(str(section.elastic), have, new, solid=solid)
    kept: dict[str, Any] = {
        key: written[key] for key in ("density", "expansion", "yield") if key in written
    }
    changed: dict[str, Any] = {"elastic": section.elastic, **constants, **lying, **kept}
    overrides = [f'materials["{name}"]={json.dumps(changed)}']
    overrides += [f"parameters.{key}={json.dumps(text)}" for key, text in new.made.items()]
    return _Changes(tuple(overrides), new.origins)


_LYING = ("dip", "dip_direction", "rotation", "normal", "axis_1", "axis_2")
"""Keys that say how strata or axes lie."""


def _unknown_dip(
    section: RungSection, name: str, new: _NewParameters, place: Context
) -> dict[str, str]:
    """The dip of strata of which nothing is said: sought in the plane."""
    if place.analysis is Analysis.PLANE_STRAIN:
        return {"dip": new.dip()}
    if place.analysis is Analysis.AXISYMMETRIC:
        return {"dip": "0 deg"}
    message = f"the material '{name}' has no orientation of strata"
    hint = "Write {elastic: " + str(section.elastic) + ", dip: ..., dip_direction: ...}."
    place.refuse("missing-key", message, hint)
    return {}


def _constants_of(
    symmetry: str, have: Mapping[str, str], new: _NewParameters, *, solid: bool
) -> dict[str, Any]:
    """The elastic constants of a symmetry: ties to parameters that are written, or new ones.

    Args:
        symmetry: of the elasticity.
        have: constants that are written, by the names of orthotropy.
        new: makes parameters.
        solid: whether the model is one; a plane section hardly feels G_12 and G_23.
    """
    nu = have["nu_12"]
    across = have.get("nu_13", nu)
    if symmetry == "isotropic":
        return {"E": have["E_1"], "nu": nu}
    # a shear modulus begins as in isotropic ground
    ratio = 0.4 if nu.strip().startswith("$") else 0.5 / (1.0 + float(nu))
    strata = "E_3" in have
    if symmetry == "transversely-isotropic":
        return {
            "E_p": have["E_1"] if strata else new.make("E_p", _APART),
            "nu_p": nu,
            "E_n": have["E_3"] if strata else new.make("E_n", 1.0 / _APART),
            "nu_np": across,
            "G_np": have.get("G_13") or new.make("G_np", ratio, ratio),
        }
    first = have["E_1"] if strata else new.make("E_1", 1.0, before=("E_p", 1.0))
    third = have["E_3"] if strata else new.make("E_3", 1.0 / _APART, before=("E_n", 1.0))
    second = new.make("E_2", _APART, before=("E_p", 1.0 / _APART))
    shear = have.get("G_13") or new.make("G_13", ratio, ratio, ("G_np", 1.0))
    return {
        "E_1": first,
        "E_2": second,
        "E_3": third,
        "nu_12": nu,
        "nu_13": across,
        "nu_23": across,
        "G_12": f"{ratio:.6g} {first}",
        "G_13": shear,
        "G_23": new.make("G_23", ratio, ratio, ("G_np", 1.0)) if solid else shear,
    }


def _below(path: str, other: str) -> bool:
    """Whether a path is another one, or below it."""
    return path == other or path.startswith((f"{other}.", f"{other}["))


def names_in_text(text: str) -> set[str]:
    """Parameters that a text refers to by ``$NAME``."""
    return set(re.findall(rf"\$({NAME_PATTERN})", text))


class _NewParameters:
    """Parameters that a richer symmetry needs, named like the one that is written.

    Args:
        name: of the parameter that Young's modulus is.
        source: its section.
    """

    def __init__(self, name: str, source: ParameterSection) -> None:
        self._name, self._source = name, source
        self._rest = name.removeprefix("E")
        self.made: dict[str, dict[str, Any]] = {}
        self.origins: dict[str, tuple[tuple[str, float], ...]] = {}

    def dip(self) -> str:
        """The tie of an inclination that is sought."""
        name = f"dip{self._rest}"
        self.made[name] = {"start": "10 deg", "bounds": ["-89 deg", "89 deg"]}
        self.origins[name] = ((name, 1.0),)
        return f"${name}"

    def make(
        self, name: str, start: float, size: float = 1.0, before: tuple[str, float] | None = None
    ) -> str:
        """The tie of a new parameter, with the bounds and prior of the written one, times a size.

        Args:
            name: its name.
            start: where it begins, in parts of the one that is written.
            size: factor on bounds and prior.
            before: parameter of a simpler model from which it begins, with a factor.
        """
        section, full = self._source, f"{name}{self._rest}"
        low, high = (bound.factor * size for bound in section.bounds)
        begin = min(max(section.start.factor * start, low), high)
        self.made[full] = {
            "start": _pressure(begin),
            "bounds": [_pressure(low), _pressure(high)],
            "scale": section.scale,
        }
        if section.prior is not None:
            self.made[full]["prior"] = {
                "mean": _pressure(section.prior.mean.factor * size),
                "sd": _pressure(section.prior.sd.factor * size),
                "kind": section.prior.kind,
            }
        simpler = [] if before is None else [(f"{before[0]}{self._rest}", before[1])]
        self.origins[full] = ((full, 1.0), *simpler, (self._name, start))
        return f"${full}"


def _pressure(value: float) -> str:
    return f"{1e-9 * value:.9g} GPa"


def _constants(texts: Mapping[str, Any]) -> dict[str, str] | None:
    """The constants of a material by the names of orthotropy; None where they are of other kind."""
    kinds = (
        {"E_1": "E", "nu_12": "nu"},
        {"E_1": "E_p", "nu_12": "nu_p", "E_3": "E_n", "nu_13": "nu_np", "G_13": "G_np"},
        {"E_1": "E_1", "nu_12": "nu_12", "E_3": "E_3", "nu_13": "nu_13", "G_13": "G_13"},
    )
    for keys in kinds:
        constants = {name: texts[key] for name, key in keys.items() if key in texts}
        if len(constants) == len(keys) and all(
            isinstance(text, str) for text in constants.values()
        ):
            return constants
    return None
