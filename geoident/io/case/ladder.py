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
from typing import Annotated, Any, Literal

from pydantic import Field, Tag

from geoident.io.case.ground import MaterialSection
from geoident.io.case.parameters import ParameterSection
from geoident.io.schema.section import Context, Section
from geoident.io.schema.values import NAME_PATTERN, TEXT_OR_MAPPING, Angle, CaseNumber, Name, Text
from geoident.io.text.wording import listing
from geoident.model.case import Analysis, KeyPath, Rung, format_path

Symmetry = Literal["isotropic", "transversely-isotropic", "orthotropic"]

_APART = 1.2
"""Moduli that begin from one value start this factor to both sides of it: of equal ones the
attitude of the strata has no effect, and so no slope."""


class RungSection(Section):
    """A model of the ladder: a name with changes to the case, or a symmetry of a material."""

    name: Name | None = Field(None, description="Of the model; that of the symmetry if missing.")
    elastic: Symmetry | None = Field(None, description="Symmetry of the elasticity of a material.")
    material: Name | None = Field(
        None, description="Which; the one whose moduli are parameters if missing."
    )
    dip: Angle | None = Field(
        None, description="Of strata or axes; that of the material, or sought, if missing."
    )
    dip_direction: Angle | None = Field(None, description="Likewise, in a solid.")
    set: dict[Text, Any] = Field(
        {},
        description="Path of a key to its value for this model, as with --set; a parameter whose "
        "value is null is left out.",
        examples=[{"in_situ.K0_across": "$K0_across"}],
    )


LadderEntry = Annotated[
    Annotated[Symmetry, Tag("text")] | Annotated[RungSection, Tag("mapping")],
    TEXT_OR_MAPPING,
]


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
    ladder = _Ladder(materials, parameters, tuple(ties))
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
        symmetric = ladder.symmetric(section, place) if section.elastic is not None else _PLAIN
        changes = tuple(f"{path}={json.dumps(value)}" for path, value in section.set.items())
        idle = ladder.idle(symmetric.replaced, section.set, (*symmetric.overrides, *changes))
        rungs.append(Rung(name, (*symmetric.overrides, *idle, *changes), symmetric.origins))
    return tuple(rungs)


def names_of_sets(entries: Sequence[Symmetry | RungSection]) -> set[str]:
    """Parameters that the changes of a ladder name."""
    sets = [entry.set for entry in entries if isinstance(entry, RungSection)]
    return {name for given in sets for name in names_in_text(json.dumps(given))}


Origins = Mapping[str, tuple[tuple[str, float], ...]]


@dataclass(frozen=True)
class _Changes:
    """Overrides, and where new parameters begin: names of others, and factors."""

    overrides: tuple[str, ...] = ()
    origins: Origins | None = None
    replaced: str = ""  # path of what they replace


_PLAIN = _Changes()


@dataclass(frozen=True)
class _Ladder:
    """What the symmetries of a ladder are made from."""

    materials: Mapping[str, MaterialSection]
    parameters: Mapping[str, ParameterSection]
    ties: tuple[tuple[KeyPath, CaseNumber], ...]

    def symmetric(self, section: RungSection, place: Context) -> _Changes:
        """The changes that give a material another symmetry."""
        name = self._material(section, place)
        if name is None:
            return _PLAIN
        written = self.materials[name]
        symmetry = str(getattr(written, "elastic", "isotropic"))
        if symmetry == section.elastic and section.dip is None and section.dip_direction is None:
            return _PLAIN
        constants = _constants(written)
        if constants is None:
            message = f"the material '{name}' is neither isotropic by E and nu, "
            message += "transversely isotropic by engineering constants, nor orthotropic"
            hint = "Write this model with 'set': {'materials." + name + "': {...}}."
            place.refuse("bad-ladder", message, hint)
            return _PLAIN
        return self._changed(name, constants, section, place)

    def _material(self, section: RungSection, place: Context) -> str | None:
        if section.material is not None:
            if section.material in self.materials:
                return section.material
            message = f"there is no material '{section.material}'; there are "
            place.refuse("unknown-material", message + listing(self.materials), "")
            return None
        sought = [
            name
            for name, written in self.materials.items()
            if any(n.parameter and n.dimension == "pressure" for n in written.numbers)
        ]
        if len(sought) == 1:
            return sought[0]
        what = f"several materials have ({', '.join(sought)})" if sought else "no material has"
        hint = "Name the material: {elastic: ..., material: NAME}."
        place.refuse("bad-ladder", f"{what} moduli that are parameters", hint)
        return None

    def _changed(
        self, name: str, have: Mapping[str, str], section: RungSection, place: Context
    ) -> _Changes:
        new = _New(self.parameters, have)
        attitude = self._attitude(name, section, new, place)
        wanted: dict[str, Any]
        if section.elastic == "isotropic":
            wanted = {"E": have["E_1"], "nu": have["nu_12"]}
        elif section.elastic == "transversely-isotropic":
            wanted = {
                "E_p": new.modulus("E_p", "E_1", _APART if "E_3" not in have else 1.0),
                "nu_p": have["nu_12"],
                "E_n": new.modulus("E_n", "E_3", 1.0 / _APART if "E_3" not in have else 1.0),
                "nu_np": have.get("nu_13", have["nu_12"]),
                "G_np": new.shear("G_np", "G_13"),
                **attitude,
            }
        else:
            wanted = {**new.orthotropic(solid=place.analysis is Analysis.SOLID), **attitude}
        if new.refused:
            place.refuse("bad-ladder", new.refused, "Write this model with 'set'.")
            return _PLAIN
        written = self.materials[name].model_dump(by_alias=True, exclude_none=True)
        material: dict[str, Any] = {"elastic": str(section.elastic), **wanted}
        for key in ("density", "expansion", "yield"):
            if key in written:
                material[key] = written[key]
        overrides = [f'materials["{name}"]={json.dumps(material)}']
        overrides += [f"parameters.{key}={json.dumps(text)}" for key, text in new.made.items()]
        return _Changes(tuple(overrides), new.origins, format_path(("materials", name)))

    def _attitude(
        self, name: str, section: RungSection, new: _New, place: Context
    ) -> dict[str, Any]:
        """How the strata or axes lie: as the model says, as written, or sought."""
        given = {
            key: value.text
            for key in ("dip", "dip_direction")
            if (value := getattr(section, key)) is not None
        }
        written = self.materials[name].model_dump(by_alias=True, exclude_none=True)
        lying = ("dip", "dip_direction", "rotation", "normal", "axis_1", "axis_2")
        if section.elastic == "isotropic":
            return {}
        if given or any(key in written for key in lying):
            kept = {key: written[key] for key in lying if key in written}
            return given or kept
        if place.analysis is Analysis.PLANE_STRAIN:
            return {"dip": new.dip()}
        if place.analysis is Analysis.AXISYMMETRIC:
            return {"dip": "0 deg"}
        message = f"the material '{name}' has no orientation of strata"
        hint = "Write {elastic: " + str(section.elastic) + ", dip: ..., dip_direction: ...}."
        place.refuse("missing-key", message, hint)
        return {}

    def idle(self, replaced: str, given: Mapping[str, Any], overrides: Sequence[str]) -> list[str]:
        """Changes that leave out the parameters of which nothing is made any more.

        Args:
            replaced: path of what the model replaces; empty for nothing.
            given: other paths that it replaces.
            overrides: its changes.
        """
        gone = [path for path in (replaced, "fit.ladder", *given) if path]
        still = {
            tie.parameter
            for path, tie in self.ties
            if not any(_below(format_path(path), other) for other in gone)
        }
        for override in overrides:
            still |= names_in_text(override)
        named = {path.removeprefix("parameters.") for path in given}
        return [
            f"parameters.{name}=null"
            for name in self.parameters
            if name not in still and name not in named
        ]


def _below(path: str, other: str) -> bool:
    """Whether a path is another one, or below it."""
    return path == other or path.startswith((f"{other}.", f"{other}["))


def names_in_text(text: str) -> set[str]:
    """Parameters that a text refers to by ``$NAME``."""
    return set(re.findall(rf"\$({NAME_PATTERN})", text))


class _New:
    """Parameters that a richer symmetry needs.

    Args:
        parameters: of the case.
        have: constants of the material as it is written, by the names of orthotropy.
    """

    def __init__(self, parameters: Mapping[str, ParameterSection], have: Mapping[str, str]) -> None:
        self._parameters, self._have = parameters, have
        self.made: dict[str, dict[str, Any]] = {}
        self.origins: dict[str, tuple[tuple[str, float], ...]] = {}
        self.refused = ""
        tie = have["E_1"].strip()
        self._source = tie.removeprefix("$")
        if not tie.startswith("$") or self._source not in parameters:
            self.refused = f"its Young's modulus is '{tie}'; one parameter alone is expected there"
            self._source = ""
        self._rest = self._source.removeprefix("E")
        nu = have["nu_12"].strip()
        self._ratio = 0.4 if nu.startswith("$") else 0.5 / (1.0 + float(nu))

    def modulus(self, name: str, like: str, factor: float) -> str:
        """The tie of a Young's modulus: that which is written, or a new parameter."""
        if like in self._have and factor == 1.0:
            return self._have[like]
        return self._make(name, factor, 1.0, (("E_p", 1.0 if name != "E_n" else 0.0),))

    def shear(self, name: str, like: str) -> str:
        """The tie of a shear modulus, which begins as in isotropic ground."""
        if like in self._have:
            return self._have[like]
        return self._make(name, self._ratio, self._ratio, (("G_np", 1.0),))

    def dip(self) -> str:
        """The tie of an inclination that is sought."""
        name = f"dip{self._rest}"
        self.made[name] = {"start": "10 deg", "bounds": ["-89 deg", "89 deg"]}
        self.origins[name] = ((name, 1.0),)
        return f"${name}"

    def orthotropic(self, *, solid: bool) -> dict[str, str]:
        """All nine constants; what a plane section hardly feels is tied to the others."""
        have, strata = self._have, "E_3" in self._have
        first = have["E_1"] if strata else self._make("E_1", 1.0, 1.0, (("E_p", 1.0),))
        third = have["E_3"] if strata else self._make("E_3", 1.0 / _APART, 1.0, (("E_n", 1.0),))
        second = self._make("E_2", _APART, 1.0, (("E_p", 1.0 / _APART),))
        across = have.get("nu_13", have["nu_12"])
        shear = self.shear("G_13", "G_13")
        return {
            "E_1": first,
            "E_2": second,
            "E_3": third,
            "nu_12": have["nu_12"],
            "nu_13": across,
            "nu_23": across,
            "G_12": f"{self._ratio:.6g} {first}",
            "G_13": shear,
            "G_23": self._make("G_23", self._ratio, self._ratio, (("G_np", 1.0),))
            if solid
            else shear,
        }

    def _make(
        self, name: str, start: float, size: float, before: Sequence[tuple[str, float]]
    ) -> str:
        """A new parameter with the bounds and prior of the one that is written, times a size.

        Args:
            name: its name.
            start: where it begins, in parts of the one that is written.
            size: factor on bounds and prior.
            before: parameters of simpler models from which it begins, with factors.
        """
        if not self._source:
            return "$" + name
        section, full = self._parameters[self._source], f"{name}{self._rest}"
        low, high = (bound.factor * size for bound in section.bounds)
        begin = min(max(section.start.factor * start, low), high)
        made: dict[str, Any] = {
            "start": _pressure(begin),
            "bounds": [_pressure(low), _pressure(high)],
            "scale": section.scale,
        }
        if section.prior is not None:
            prior = section.prior
            made["prior"] = {
                "mean": _pressure(prior.mean.factor * size),
                "sd": _pressure(prior.sd.factor * size),
                "kind": prior.kind,
            }
        self.made[full] = made
        simpler = [(f"{other}{self._rest}", factor) for other, factor in before if factor]
        self.origins[full] = ((full, 1.0), *simpler, (self._source, start))
        return f"${full}"


def _pressure(value: float) -> str:
    return f"{1e-9 * value:.9g} GPa"


def _constants(written: MaterialSection) -> dict[str, str] | None:
    """The constants of a material by the names of orthotropy; None where they are of other kind."""
    texts = written.model_dump(by_alias=True, exclude_none=True)
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
