"""Every combination of keys that the page of keys names is one that a case can be read with.

The keys, the kinds of their values and the ways of which one is taken ("Exactly one of: ...") come
from the page as it is installed, so that what is documented tomorrow is tried without a line here:
each way with all subsets of its optional keys in all orders, each alternative of each other key. A
trial counts as read if one kind of analysis takes it. The tables below say only what a plausible
value is, and what a key goes with, where no kind tells.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from geoident.errors import Fault, InputError
from geoident.io.case.file import parse_case

PAGE = Path(__file__).parents[3] / "geoident" / "docs" / "keys.md"
PLACES = ("materials", "in_situ", "loads", "structures", "gauges", "supports", "water", "face")
"""Keys of a case whose sections are tried. Others name files, or say how a case is computed."""
OF_FILES = ("Series", "Reservoir")
"""Parts of the page that name a file, or belong to a structure in service."""
OF_OPENINGS = ("ring", "ribs", "bolting", "support-line")
"""Kinds of structures of a case without mesh."""
KEY = r"`([\w-]+)`"
NAMED = ("materials", "loads", "structures", "gauges", "supports")
"""Those under which there are sections by name: many trials make one case."""


def at(dim: int, *numbers: float) -> list[str]:
    """A point of a model."""
    return [f"{x} m" for x in (*numbers, 0, 0)[:dim]]


def east(dim: int) -> list[str]:
    return ["1", "0", "0"][:dim]


WORDS = {
    "pressure": "2 GPa", "length": "2 m", "angle": "30 deg", "number": "0.2", "force": "300 kN",
    "density": "2000 kg/m3", "expansion": "1e-5 1/K", "unit weight": "20 kN/m3",
    "area": "600 mm2", "line load": "2 GN/m", "bending stiffness": "3 MNm2/m",
    "flexural rigidity": "3 MNm2",
    "moment per length": "150 kNm/m", "velocity": "1 mm/month",
    "pressure rate": "2 kPa/month", "angle rate": "1 mrad/month",
    "strain rate": "2 microstrain/month", "strain": "5 microstrain", "temperature": "10 K",
    "quantity": "2 mm", "whole number": "48", "flag": "true", "estimate": "estimate",
    "text": "heading", "time": "3 day", "conductivity": "2.5 W/mK", "heat capacity": "2 MJ/m3K",
    "specific heat": "900 J/kgK", "viscosity": "5e14 Pa s", "compressibility": "1e-9 1/Pa",
    "diffusivity": "2 m2/year", "temperature rate": "0.1 K/month",
    "stiffness per area": "20 MPa/m",
}  # fmt: skip
"""A value of each kind."""
POINTS: dict[str, Callable[[int], Any]] = {
    "list of list of list of length": lambda dim: [[at(dim, 3, 0), at(dim, 7, 0)]],
    "list of list of length": lambda dim: [at(dim, -1, 0), at(dim, 1, 0)],
    "list of length": lambda dim: at(dim, 1, 0),
    "list of number": lambda dim: ["0.6", "0.8", "0"][:dim],
}
"""Bars, lines, points and directions."""
PARAMETERS = {
    "pressure": ("3 GPa", "[1 GPa, 4 GPa]"), "length": ("2 m", "[1 m, 3 m]"),
    "angle": ("20 deg", "[0 deg, 40 deg]"), "number": ("0.2", "[0.1, 0.3]"),
    "force": ("200 kN", "[100 kN, 300 kN]"), "density": ("2000 kg/m3", "[1000, 3000 kg/m3]"),
    "expansion": ("1e-5 1/K", "[1e-6, 2e-5 1/K]"),
    "unit weight": ("20 kN/m3", "[10, 30 kN/m3]"), "area": ("600 mm2", "[100, 900 mm2]"),
    "line load": ("2 GN/m", "[1, 3 GN/m]"), "bending stiffness": ("3 MNm2/m", "[1, 4 MNm2/m]"),
    "flexural rigidity": ("3 MNm2", "[1, 4 MNm2]"),
    "moment per length": ("150 kNm/m", "[50, 400 kNm/m]"),
    "pressure rate": ("0 kPa/day", "[-1, 1 kPa/day]"),
    "angle rate": ("0 mrad/day", "[-1, 1 mrad/day]"),
    "strain rate": ("0 microstrain/day", "[-1, 1 microstrain/day]"),
    "velocity": ("0 mm/day", "[-1, 1 mm/day]"), "strain": ("0 microstrain", "[-9, 9 microstrain]"),
    "quantity": ("0 mm", "[-9, 9 mm]"), "time": ("3 day", "[1 day, 9 day]"),
    "conductivity": ("2 W/mK", "[1, 3 W/mK]"), "heat capacity": ("2 MJ/m3K", "[1, 3 MJ/m3K]"),
    "specific heat": ("900 J/kgK", "[500, 1500 J/kgK]"),
    "viscosity": ("5e14 Pa s", "[1e14, 9e14 Pa s]"),
    "compressibility": ("1e-9 1/Pa", "[1e-10, 1e-8 1/Pa]"),
    "diffusivity": ("2 m2/year", "[1, 3 m2/year]"), "temperature": ("10 K", "[0, 20 K]"),
    "temperature rate": ("0 K/day", "[-1, 1 K/day]"),
    "stiffness per area": ("20 MPa/m", "[10, 30 MPa/m]"),
}  # fmt: skip
"""Start and bounds of a parameter of each kind."""
OF_GAUGES: dict[str, dict[str, str]] = {
    **{
        part: {"pressure": "2 kPa", "quantity": "2 kPa", "Errors.along": "2 kPa/sqrt(m)"}
        for part in ("Stress gauge", "Pressure cell", "Piezometer")
    },
    "Load cell": {"quantity": "2 kN", "Errors.along": "2 kN/sqrt(m)"},
    "Thermometer": {"temperature": "2 K", "quantity": "2 K", "Errors.along": "2 K/sqrt(m)"},
    "Strain": {"quantity": "5 microstrain", "Errors.along": "2 microstrain/sqrt(m)"},
    "Tilt": {"angle": "0.1 mrad", "quantity": "0.1 mrad", "Errors.along": "1 mrad/sqrt(m)"},
}
"""Kind of gauge to values of its accuracy."""

FIELDS = ("Modulus field", "Angle field")
GIVEN: dict[tuple[str, str], list[Any]] = {
    ("Yield plane", "normal"): [lambda dim: ["0.6", "0", "0.8", "0", "0", "0"][: 3 * dim - 3]],
    ("Orthotropic", "axis_2"): [lambda dim: ["-0.8", "0.6", "0"][:dim]],
    ("Along", "axis_2"): [lambda dim: ["-0.8", "0.6", "0"][:dim]],
    ("Modulus field", "measured"): [
        ["tests.csv"],
        [{"file": "tests.csv"}],
        lambda dim: [{"at": at(dim, 1, 0), "value": "2 GPa", "accuracy": "5 %"}],
    ],
    ("Angle field", "measured"): [lambda dim: [{"at": at(dim, 1, 0), "value": "30 deg"}]],
    **{(field, "sd"): ["30 %"] for field in FIELDS},
    **{(field, "length"): ["20 m", ["20 m", "5 m"], ["20", "5 m"]] for field in FIELDS},
    **{(field, "smoothness"): ["1.5"] for field in FIELDS},
    ("Hardening soil", "gamma_07"): ["2e-4"],
    ("Hoek brown", "GSI"): ["45"],
    ("Hoek diederichs", "GSI"): ["45"],
    **{
        (part, "yield"): [{"type": "tresca", "strength": "2 MPa", "planes": "48"}]
        for part in ("Transversely isotropic", "Orthotropic", "Anisotropic")
    },
    **{
        (part, key): [value]
        for part in ("Transversely isotropic", "Orthotropic", "Anisotropic")
        for key, value in (("creep", {"share": "0.2", "time": "3 d"}), ("ageing", {"code": "fib"}))
    },
    **{("Transversely isotropic", key): ["6 GPa", "3 $p_pressure"] for key in "AC"},
    ("Transversely isotropic", "F"): ["0.5 GPa", "0.2 $p_pressure"],
    **{
        ("Anisotropic", f"c{i}{j}"): ["0.1 GPa", "0.02 $p_pressure"]
        for i, j in itertools.combinations(range(1, 7), 2)
    },
    **{
        ("Geostatic", key): ["0.5", "$p_number", {"rock": "0.5", "heading": "$p_number"}]
        for key in ("K0", "K0_across")
    },
    ("Load", "traction"): [lambda dim: ["$p_pressure", "2 kPa", "3 kPa"][:dim]],
    ("Load", "force"): [lambda dim: ["$p_force", "2 kN", "3 kN"][:dim]],
    ("Load", "line_force"): [["1", "2 kN/m"], ["1 kN/m", "$p_line_load"]],
    ("Load", "seismic"): [lambda dim: ["0.1", "$p_number", "0"][:dim]],
    ("Fall", "to"): [lambda dim: at(dim, 9, 0)],
    ("Drain", "at"): [lambda dim: at(dim, 4, 0)],
    ("Support", "axis"): ["z"],
    ("Ageing", "curve"): [{"1 d": "12 GPa", "28 d": "2 $p_pressure"}],
    ("Hydration", "curve"): [{"1 d": "20 K", "28 d": "2 $p_temperature"}],
    ("Creep", "kelvin"): [{"G": "200 MPa", "viscosity": "2 $p_viscosity"}],
    ("Vertical drains", "spacing"): ["5 m", "9 $p_length"],
    ("Vertical drains", "permeability"): ["1e-9 m/s"],
    ("Measured motion", "points"): [lambda dim: [at(dim, 1, 0), at(dim, 2, 1)]],
    **{("Measured motion", axis): [["1 mm", "2 mm"]] for axis in "xyz"},
    ("Measured motion", "file"): ["motions.csv"],
    ("Errors", "along"): ["0.2 mm/sqrt(m)"],
    ("First reading", "distance"): ["2 m"],
    ("Extensometer", "anchors"): [lambda dim: {"a5": at(dim, 5, 0)}],
    ("Levelling", "points"): [lambda dim: {"a": at(dim, 1, 0), "b": at(dim, 2, 1)}],
    ("Levelling", "relative_to"): ["ground", "a"],
    ("Levelling", "distortions"): [{"accuracy": "0.1 mrad", "pairs": [["a", "b"]]}],
    ("Line of sight", "sensor"): [lambda dim: at(dim, 50, 90)],
    **{
        (part, "relative_to"): ["ground", lambda dim: at(dim, 9, 1)]
        for part in ("Displacement", "Settlement", "Target", "Line of sight")
    },
    ("Hardening soil", "OCR"): ["1.5"],
    ("Load cell", "offset"): ["2 kN", "$p_force"],
    ("Load cell", "quantity"): ["N", "M", "Q"],  # those of shells: `tests/io/case`
    ("Joint meter", "interface"): ["joint"],
    ("Load cell", "drift_per_stage"): ["2 kN", "$p_force"],
    ("Load cell", "drift"): ["2 kN/month"],
    ("Plain reading", "drift"): ["2 mm/month"],
    ("Plain reading", "accuracy"): ["0.1 mm", {"reading": "0.1 mm", "epoch": "0.2 mm"}],
    ("Load cell", "structure"): ["bolts"],
    **{(part, "structure"): ["tied"] for part in ("Strain", "Bar displacement")},
    **{(part, "bar"): ["1"] for part in ("Load cell", "Strain", "Bar displacement")},
    **{(part, "point"): [lambda dim: at(dim, 4, 0)] for part in ("Strain", "Bar displacement")},
    **{(part, "pieces"): ["40"] for part in ("Bolt", "Pile")},
    **{(part, "on"): ["wall"] for part in ("Pressure cell", "Tilt")},
    ("Target", "chainage"): ["1 m"],
    ("Target", "beside"): [["1 m", "0 m"]],
    ("Vlachopoulos diederichs", "plastic_radius"): ["6 m", "3 $p_length"],
    ("Strain", "at"): [["1 m"]],
    ("Inclinometer", "casing"): [
        lambda dim: [["1 m", "0 m", "0 m"][-dim:], ["1 m", "0 m", "-9 m"][-dim:]],
        lambda dim: [at(dim, 1, 9), at(dim, 1, 0)],
    ],
    ("Inclinometer", "A"): [east],
    ("Inclinometer", "depths"): [["2 m", "4 m"]],
    ("Inclinometer", "rings"): [["3 m"]],
}
"""Values that the kind alone does not tell."""

WITH: dict[tuple[str, str], dict[str, Any]] = {
    **{(part, "fit"): {"planes": "48"} for part in ("Tresca", "Mohr coulomb", "Drucker prager")},
    **{(part, "cover"): {"surface": "300 m"} for part in ("Geostatic", "Geostatic model")},
    **{
        ("Load", kind): {"on": "top"}
        for kind in ("pressure", "traction", "water", "force", "line_force")
    },
    ("Load", "pull"): {"on": "tied"},
    ("Load", "push"): {"on": "piles"},
    **{("Bolt", key): {"k_grout": "2 GPa"} for key in ("bond", "free", "head", "pieces")},
    ("Pile", "base_capacity"): {"k_base": "2 GN/m"},
    **{
        ("Pile", key): {"k_lateral": "40 MPa", "EI": "250 MNm2"}
        for key in ("lateral_resistance", "EI", "k_lateral", "head")
    },
    ("Load", "direction"): {"push": "20 kN"},
    ("Bar displacement", "direction"): {"structure": "piles", "point": lambda dim: at(dim, 4, 0)},
    ("Beam", "tensile_strength"): {"compressive_strength": "20 MPa"},
    ("Shell", "tensile_strength"): {"compressive_strength": "20 MPa"},
    ("Beam yield", "interaction"): {"M": "150 kNm/m"},
    ("Strain", "fibre"): {"structure": "wall"},
    ("Load cell", "point"): {"structure": "wall"},
    ("Load cell", "quantity"): {"structure": "wall", "point": lambda dim: at(dim, 1, 0)},
    **{
        ("Hardening soil", key): {"E50": "2 GPa", "Eoed": "2 GPa"}
        for key in ("K0nc", "OCR", "POP", "preconsolidation_stress")
    },
    **{("Hardening soil", key): {"E50": "2 GPa"} for key in ("Eoed", "Rf")},
    ("Hardening soil", "G0"): {"gamma_07": "1e-4"},
    ("Hardening soil", "gamma_07"): {"G0": "20 GPa"},
    ("Joint meter", "direction"): {"towards": lambda dim: at(dim, 2, 0)},
    ("Joint meter", "towards"): {"direction": east},
    ("Inclinometer", "casing"): {"A": east},
    ("Inclinometer", "rings"): {"ring_accuracy": "1 mm"},
    ("Inclinometer", "ring_accuracy"): {"rings": ["3 m"]},
    ("Load", "at"): {"line_force": ["1", "2 kN/m"]},
    ("Target", "components"): {"along": east},
    ("Vertical drains", "smear"): {"smear_ratio": "0.2"},
    ("Vertical drains", "smear_ratio"): {"smear": "2 m"},
}
"""Keys that another one goes with, as its description says."""

BASE: dict[tuple[str, str], list[str]] = {
    ("Support", ""): ["x"],
    ("Support", "measured"): [],
    ("Support", "contraction"): [],
    ("Support", "centre"): ["contraction"],
    ("Support", "axis"): ["contraction", "centre"],
    ("Measured motion", ""): ["points", "x"],
    ("Measured motion", "file"): [],
    ("Load", "on"): ["force"],
    ("Load", "at"): [],
    ("Geostatic", ""): ["K0"],  # hardening soil needs none
    ("Geostatic model", ""): ["K0"],
}
"""Keys that stand with one in place of the first of all ways; with an empty name, in all trials."""


class Page:
    """The parts of a page of keys: their keys, kinds of values and ways."""

    def __init__(self, text: str) -> None:
        plain = re.sub(
            r"(?<=\S)\n(?:  (?=\S)|(?=[^\s#-]))", " ", text
        )  # one line an entry or paragraph
        self.parts = {part.partition("\n")[0]: part for part in plain.split("\n## ")[1:]}
        self.words = WORDS
        self.factor = self.number = ""

    @cache  # noqa: B019 - a page lives as long as a test
    def keys(self, part: str) -> dict[str, tuple[bool, str]]:
        """Key to whether it is required, and what the page says is allowed."""
        row = r"^- (\**)`([\w-]+)`\** \((.*?)(?:, default `[^`]*`)?\)(?:: .*)?$"
        own = {
            key: (bool(bold), allowed)
            for bold, key, allowed in re.findall(row, self.parts[part], re.MULTILINE)
        }
        return {**(self.keys(base) if (base := self.base(part)) else {}), **own}

    def base(self, part: str) -> str:
        """The part that has further keys of this one, or nothing."""
        further = re.search(r"Further keys under \[([^\]]*)\]", self.parts[part])
        return further[1] if further else ""

    @cache  # noqa: B019
    def choices(self, part: str) -> list[list[tuple[list[str], list[str]]]]:
        """For each "Exactly one of": the ways, each with needed and optional keys."""
        base = self.base(part)
        found = list(self.choices(base)) if base else []
        for sentence in re.findall(r"Exactly one of: (.*?)\.(?: |\n)", self.parts[part]):
            ways = []
            for way in sentence.split(", or "):
                needed, _, optional = way.partition(" (with ")
                ways.append((re.findall(KEY, needed), re.findall(KEY, optional)))
            found.append(ways)
        return found

    def of(self, part: str, dim: int) -> list[dict[str, Any]]:
        """All trials of a part that stands at a key of a case."""
        words = WORDS | OF_GAUGES.get(part, {})
        number = re.compile(r"^[0-9][0-9.e-]*")
        self.words = {k: number.sub(self.number or r"\g<0>", v) for k, v in words.items()}
        return list(self.trials(part, dim, set()))

    def trials(self, part: str, dim: int, seen: set[str]) -> Iterator[dict[str, Any]]:
        """Mappings that the page allows: each way of each choice, each value of each other key."""
        keys, choices = self.keys(part), self.choices(part)
        required = [key for key, (bold, _) in keys.items() if bold]
        first = [ways[0][0] for ways in choices]
        for n, ways in enumerate(choices or [[(BASE.get((part, ""), []), [])]]):
            others = [key for k, one in enumerate(first) if k != n for key in one]
            for needed, optional in ways:
                for some in subsets(optional):
                    for order in orders([*needed, *some]):
                        yield self.filled(part, [*required, *others, *order], dim)
        if part in seen:
            return
        seen.add(part)
        for key, (_, allowed) in keys.items():
            usual = BASE.get((part, ""), [])
            for ways in choices:
                usual = [*usual, *next((w[0] for w in ways if key in (*w[0], *w[1])), ways[0][0])]
            base = [*required, *BASE.get((part, key), usual)]
            for value in self.values(part, key, allowed, dim, seen):
                yield self.filled(part, [k for k in base if k != key], dim, {key: value})

    def filled(
        self, part: str, names: list[str], dim: int, more: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        """These keys with the first value of each, in this order, and some that are given."""
        allowed = self.keys(part)
        found = {
            key: next(iter(self.values(part, key, allowed[key][1], dim, set(self.parts))))
            for key in names
        } | (more or {})
        for key in list(found):
            also = {k: v(dim) if callable(v) else v for k, v in WITH.get((part, key), {}).items()}
            found |= {k: v for k, v in also.items() if k not in (more or {})}
        return found

    def values(self, part: str, key: str, allowed: str, dim: int, seen: set[str]) -> Iterator[Any]:
        """Values of each kind that the page allows for a key."""
        given = self.words.get(f"{part}.{key}")
        if given is not None or (part, key) in GIVEN:
            many = GIVEN[part, key] if given is None else [given]
            yield from (one(dim) if callable(one) else one for one in many)
        else:
            kinds = allowed.replace("`true` or `false`", "flag").split(" or ")
            yield from self.of_kinds(kinds, dim, seen)

    def of_kinds(self, kinds: list[str], dim: int, seen: set[str]) -> Iterator[Any]:
        """Values of some kinds; what a list or a mapping holds are all kinds behind its word."""
        tied = ""
        for n, kind in enumerate(kinds):
            if kind in POINTS:
                yield POINTS[kind](dim)
                return
            if kind.startswith(("list of ", "names to ")):
                inner = [kind[8 if kind[0] == "l" else 9 :], *kinds[n + 1 :]]
                held = [k for k in inner if k != "number" or k == inner[0]]
                for one in self.of_kinds(held, dim, seen):
                    yield [one] if kind[0] == "l" else {"rock": one}
                return
            tied = kind if kind in PARAMETERS else tied
            if part := re.match(r"\[(.*?)\]", kind):
                yield from self.trials(part[1], dim, seen)
            elif kind == "`$parameter`":
                yield f"{self.factor}$p_{tied.replace(' ', '_')}"
            elif kind.startswith("`"):
                yield from re.findall(r"`([^`]*)`", kind)
            else:
                yield self.words[kind]


def subsets(keys: list[str]) -> list[tuple[str, ...]]:
    return [some for n in range(len(keys) + 1) for some in itertools.combinations(keys, n)]


def orders(keys: list[str]) -> list[tuple[str, ...]]:
    """All orders of a few keys; of many this one and the other way round."""
    if len(keys) < 4:
        return list(itertools.permutations(keys))
    return [tuple(keys), tuple(reversed(keys))]


def host(analysis: str, place: str, sections: dict[str, Any]) -> dict[str, Any]:
    """A case with some sections at one of its keys."""
    dim = 3 if analysis == "solid" else 2
    bolts = {"kind": "bolt", "ends": [[at(dim, 3, 0), at(dim, 7, 0)]], "EA": "90 MN"}
    tied = {**bolts, "k_grout": "2 GPa", "head": "free"}
    piles = {**bolts, "kind": "pile", "k_shaft": "60 MPa", "k_lateral": "40 MPa"}
    piles |= {"EI": "250 MNm2", "head": "free"}
    wall = {"kind": "beam", "on": "wall", "E": "30 GPa", "thickness": "0.3 m"}
    parameters = {
        f"p_{kind.replace(' ', '_')}": {"start": start, "bounds": yaml.safe_load(bounds)}
        for kind, (start, bounds) in PARAMETERS.items()
    }
    case: dict[str, Any] = {
        "format": "geoident-case/1",
        "parameters": parameters,
        "stages": [{"name": "heading"}],
        "dates": {"virgin": "2024-01-01", "heading": "2024-02-01"},
    }
    if any(isinstance(one, dict) and one.get("kind") == "reading" for one in sections.values()):
        return case | {"model": {"kind": "python", "function": "model:run"}, place: sections}
    case |= {
        "analysis": analysis,
        "mesh": {"file": "cavern.msh"},
        "materials": {"rock": {"E": "15 GPa", "nu": "0.25", "density": "2000 kg/m3"}},
        "groups": {"rock": "rock", "heading": "rock", "lining": "absent"},
        "supports": {"bottom": "fixed"},
        "in_situ": {"model": "constant", "xx": "-1 MPa", "yy": "-1 MPa", "zz": "-1 MPa"},
        "gravity": "9.81 m/s2",
        "interfaces": {"joint": {"along": "joint", "k_n": "9 GPa/m", "k_s": "3 GPa/m"}},
        "structures": {
            "plane-strain": {
                "bolts": {**bolts, "spacing": "2 m"},
                "tied": {**tied, "spacing": "2 m"},
                "piles": {**piles, "spacing": "2 m"},
                "wall": wall,
            },
            "axisymmetric": {
                "bolts": {**bolts, "number": "12"},
                "tied": {**tied, "number": "12"},
                "wall": wall,
            },
            "solid": {
                "bolts": bolts,
                "tied": tied,
                "piles": piles,
                "wall": {**wall, "kind": "shell", "nu": "0.2", "axis": ["1", "0", "0"]},
            },
        }[analysis],
        "stages": [{"name": "heading", "excavate": ["heading"], "build": ["bolts", "tied"]}],
    }
    if analysis == "plane-strain" and place != "materials":  # hardening soil has none
        case["face"] = {"profile": "panet", "radius": "4 m"}
        case["stages"][0]["distance"] = "2 m"
    if any(isinstance(one, dict) and one.get("kind") in OF_OPENINGS for one in sections.values()):
        del case["mesh"], case["interfaces"]
        case["fit"] = {"method": "closed-form"}
        case["fit"]["closed-form"] = {"centre": at(dim, 0, 0), "radius": "3 m"}
    if place == "face":
        return case | {"face": {"radius": "4 m", **sections}}
    return case | {place: {**case.get(place, {}), **sections} if place in NAMED else sections}


def refusals(
    folder: Path, analysis: str, place: str, trials: list[dict[str, Any]]
) -> dict[int, str]:
    """Number of a trial to why the reader refuses it."""
    if place not in NAMED:
        cases = (faults_of(folder, host(analysis, place, trial)) for trial in trials)
        return {n: str(faults[0]) for n, faults in enumerate(cases) if faults}
    alone = [n for n, trial in enumerate(trials) if "hardening-soil" in str(trial)]
    rest = sorted(set(range(len(trials))) - set(alone))
    return {
        n: why
        for numbers in (rest, alone)  # hardening soil stands beside no other ground that yields
        for n, why in _refusals(folder, analysis, place, {n: trials[n] for n in numbers}).items()
    }


def _refusals(folder: Path, analysis: str, place: str, trials: dict[int, Any]) -> dict[int, str]:
    found: dict[int, str] = {}
    while True:  # a reader tells the first faults, and how many more there are
        sections = {f"t{n}": trial for n, trial in trials.items() if n not in found}
        faults = faults_of(folder, host(analysis, place, sections))
        named = [(re.match(rf"{place}\.t(\d+)", fault.path), fault) for fault in faults]
        assert not faults or any(match for match, _ in named), faults
        found |= {int(match[1]): str(fault) for match, fault in named if match}
        if not faults:
            return found


class Plain(yaml.SafeDumper):
    """Writes values out wherever they stand."""

    def ignore_aliases(self, _: object) -> bool:
        return True


def faults_of(folder: Path, case: dict[str, Any]) -> list[Fault]:
    """What is wrong with a case beside what its trials do not need.

    That is parameters, and the service in which materials creep.
    """
    text = yaml.dump(case, Dumper=Plain, sort_keys=False, width=10_000)
    try:
        parse_case(text, str(folder / "case.yaml"), with_texts=False)
    except InputError as error:
        return [f for f in error.faults if f.code not in ("unused-parameter", "no-time")]
    return []


def refused_by_all(folder: Path, place: str, part: str, text: str) -> list[str]:
    """What a page allows at a key of a case and the reader refuses in every kind of analysis."""
    (folder / "cavern.msh").touch()
    (folder / "model.py").write_text("def run(p): return {}\n")
    (folder / "tests.csv").write_text("x [m],y [m],value [GPa]\n1,0,2\n3,0,2.5\n")
    (folder / "motions.csv").write_text("x [m],y [m],ux [mm],uy [mm]\n1,0,2,0\n3,0,2.5,1\n")
    page, refused = Page(text), None
    trials = page.of(part, 2)
    assert trials
    for analysis in ("plane-strain", "solid", "axisymmetric"):
        tried = page.of(part, 3 if analysis == "solid" else 2)
        kept = [n for n in range(len(tried)) if refused is None or n in refused]
        own = refusals(folder, analysis, place, [tried[n] for n in kept])
        refused = {kept[n]: why for n, why in own.items()}
    return [f"{trials[n]}: {why}" for n, why in (refused or {}).items()]


def parts() -> list[tuple[str, str]]:
    """Keys of a case with the parts of the page that may stand there."""
    page = Page(PAGE.read_text(encoding="utf-8"))
    allowed = {place: page.keys("Case")[place][1] for place in PLACES}
    return [
        (place, part)
        for place in PLACES
        for part in re.findall(r"\[(.*?)\]\(", allowed[place])
        if part not in OF_FILES
    ]


@pytest.mark.parametrize(("place", "part"), parts())
def test_every_documented_combination_is_read(tmp_path, place, part):
    refused = refused_by_all(tmp_path, place, part, PAGE.read_text(encoding="utf-8"))
    assert not refused, "\n".join(refused)


@pytest.mark.parametrize(
    ("place", "part", "old", "new"),
    [
        ("materials", "Orthotropic", "`axis_1` and `axis_2`.\n", "`axis_1` and `dip`.\n"),
        (
            "gauges",
            "Displacement",
            "`component`, or `direction`.",
            "`component` (with `direction`).",
        ),
        ("loads", "Load", "- `at` (list of length or number)", "- `at` (text)"),
    ],
)
def test_what_the_page_names_and_the_reader_refuses_is_seen(tmp_path, place, part, old, new):
    page = PAGE.read_text(encoding="utf-8")
    assert old in page
    assert refused_by_all(tmp_path, place, part, page.replace(old, new))


@pytest.mark.parametrize(
    ("number", "factor"),
    [("1e308", "1e300 "), ("1e-300", "1e-300 "), ("0", "0 "), ("-1e20", "-1e12 "), ("1e20", "-")],
)
@pytest.mark.parametrize("place", NAMED)
def test_numbers_of_any_size_are_read_or_refused(tmp_path, place, number, factor):
    """In every key that takes one; `tests/cli/test_scales.py` computes with some of them."""
    page = Page(PAGE.read_text(encoding="utf-8"))
    page.number, page.factor = number, factor
    (tmp_path / "cavern.msh").touch()
    for part in [part for one, part in parts() if one == place]:
        trials = {f"t{n}": trial for n, trial in enumerate(page.of(part, 2))}
        found = faults_of(tmp_path, host("plane-strain", place, trials))
        assert found or abs(float(number)) < 1e300
