"""Materials, in-situ stress and water of a case."""

from __future__ import annotations

from collections.abc import Mapping

from geoident.report.text.inputs.construction import drained_text, heat_text
from geoident.report.text.inputs.numbers import CaseTexts, ShownNumbers, entries, listed, ranged
from geoident.report.text.layout import TextTable

_YIELD_NAMES = {
    "planes": "yield planes",
    "tresca": "Tresca",
    "mohr-coulomb": "Mohr-Coulomb",
    "drucker-prager": "Drucker-Prager",
    "weak-plane": "weak plane",
    "hoek-brown": "Hoek-Brown",
    "hardening-soil": "hardening soil",
}


def materials_table(case: CaseTexts, numbers: ShownNumbers) -> TextTable:
    """Materials with their laws, constants and groups.

    Args:
        case: as texts.
        numbers: how its numbers are shown.
    """
    users = _groups(case)
    rows = [
        [name, _law(material), _constants(material, numbers), ranged(users.get(name, ()))]
        for name, material in entries(case, "materials").items()
        if isinstance(material, Mapping)
    ]
    return TextTable(("material", "law", "constants", "groups"), rows)


def _groups(case: CaseTexts) -> dict[str, list[str]]:
    """Material to the groups that are of it, from the beginning or after some stage."""
    groups: dict[str, list[str]] = {}
    pairs = [*entries(case, "groups").items()]
    for stage in case.get("stages", ()):
        pairs += [*entries(stage, "install").items(), *entries(stage, "change").items()]
    for group, material in dict.fromkeys(pairs):
        groups.setdefault(str(material), []).append(str(group))
    return groups


def _law(material: CaseTexts) -> str:
    """Elasticity and yield surfaces by name."""
    names = [str(surface.get("type", "")) for surface in _surfaces(material)]
    yields = [_YIELD_NAMES.get(name, name) for name in names]
    return ", ".join([f"{material.get('elastic', 'isotropic')} elastic", *yields])


def _surfaces(material: CaseTexts) -> list[CaseTexts]:
    entry = material.get("yield", [])
    surfaces = entry if isinstance(entry, list) else [entry]
    return [surface for surface in surfaces if isinstance(surface, Mapping)]


def _constants(material: CaseTexts, numbers: ShownNumbers) -> str:
    order = sorted(material, key=lambda key: key in ("density", "expansion"))
    parts = [
        f"{key} = {numbers.text(material[key])}" for key in order if key not in ("elastic", "yield")
    ]
    for surface in _surfaces(material):
        own = {key: value for key, value in surface.items() if key not in ("type", "planes")}
        planes = listed(surface.get("planes"))
        parts += [f"{key} = {numbers.text(value)}" for key, value in own.items()]
        parts += [f"{len(planes)} planes"] if planes else []
    return "; ".join(parts)


def ground_sentences(case: CaseTexts, numbers: ShownNumbers) -> tuple[str, ...]:
    """In-situ stress, gravity and water, a sentence each; of a model elsewhere what is run.

    Args:
        case: as texts.
        numbers: how its numbers are shown.
    """
    model = entries(case, "model")
    if model.get("kind") == "convergence-law":
        law = _convergence_law(model, numbers)
        return (f"Convergence law of Sulem, Panet and Guenot (1987): {law}.",)
    if model.get("kind") == "settlement-law":
        return _settlement_law(model, numbers)
    if model.get("kind") == "seasonal":
        return (f"Seasonal model of each gauge: {_seasonal(model)}.",)
    if model:
        run = model.get("command") or [model.get("function") or model.get("file", "")]
        return (f"The model is external ({model.get('kind')}): {' '.join(map(str, run))}.",)
    stress = entries(case, "in_situ")
    parts = [
        f"{key.replace('_', ' ')} = {_by_group(value, numbers)}"
        for key, value in stress.items()
        if key not in ("model", "equilibrium", "groups")
    ]
    sentences = (
        [f"In-situ stress: {', '.join([str(stress.get('model')), *parts])}."] if stress else []
    )
    for group, own in entries(stress, "groups").items():
        sentences.append(f"In-situ stress of {group}: {numbers.text(own)}.")
    if case.get("gravity"):
        sentences.append(f"Gravity: {numbers.text(case['gravity'])}.")
    if case.get("water"):
        sentences.append(f"Water in the pores: {numbers.text(case['water'])}.")
    if case.get("drained"):
        sentences.append(f"Water leaves at {drained_text(entries(case, 'drained'), numbers)}.")
    if case.get("initial_temperature"):
        sentences.append(
            f"Temperature at the beginning: {numbers.text(case['initial_temperature'])}."
        )
    if case.get("heat"):
        sentences.append(f"Heat flows at {heat_text(entries(case, 'heat'), numbers)}.")
    return tuple(sentences)


def _seasonal(model: CaseTexts) -> str:
    """The effects of a seasonal model as the case gives them."""
    words = {
        "level": "powers of the level up to {}",
        "season": "season with {} harmonics of the year",
        "air": "air temperature with response times of {}",
        "settling": "irreversible motions that fade in {}",
    }
    effects = [
        text.format(", ".join(listed(model[key])) or model[key])
        for key, text in words.items()
        if model.get(key)
    ]
    if model.get("linear") == "true":
        effects.append("an irreversible motion that goes on")
    return f"{'; '.join(effects)}; in service since {model.get('since')}"


def _convergence_law(model: CaseTexts, numbers: ShownNumbers) -> str:
    """The constants of a convergence law as the case gives them."""
    names = ("C_inf", "X", "m", "T", "n")
    constants = [(name, model[name]) for name in names if model.get(name) is not None]
    return ", ".join(f"{name} = {_by_group(value, numbers)}" for name, value in constants)


_CURVES = {
    "asaoka": "S [1 - exp(-t / T)] (Asaoka 1978)",
    "hyperbola": "S t / (T + t) (Tan 1991)",
    "consolidation": "one-dimensional consolidation (Terzaghi, Barron, Hansbo)",
}


def _settlement_law(model: CaseTexts, numbers: ShownNumbers) -> tuple[str, ...]:
    """A settlement law, its constants, its lifts and its drains, as the case gives them."""
    names = ("S", "T", "c_v", "path", "stress", "creep", "creep_time", "unit_weight")
    given = [(name, model[name]) for name in names if model.get(name) is not None]
    constants = ", ".join(f"{name} = {_by_group(value, numbers)}" for name, value in given)
    since = f" since {model['since']}" if model.get("since") else ""
    sentences = [f"Settlement law: {_CURVES[str(model.get('law'))]}{since}; {constants}."]
    fill = model.get("fill")
    fills = {"": fill} if isinstance(fill, list) or "file" in entries(model, "fill") else fill
    for gauge, own in (fills if isinstance(fills, Mapping) and fill else {}).items():
        of = f" at {gauge}" if gauge else ""
        sentences.append(f"Fill{of}: {_lifts(own, numbers)}.")
    drains = entries(model, "drains")
    if drains:
        parts = [
            f"{key.replace('_', ' ')} {_by_group(value, numbers)}"
            if key not in ("pattern", "installed")
            else f"{key} {value}"
            for key, value in drains.items()
        ]
        sentences.append(f"Vertical drains: {', '.join(parts)}.")
    return tuple(sentences)


def _lifts(fill: object, numbers: ShownNumbers) -> str:
    """The lifts of a fill; of a file its name."""
    if isinstance(fill, Mapping):
        return f"as in {fill.get('file')}"
    lifts = []
    for lift in fill if isinstance(fill, list) else []:
        size = numbers.text(lift.get("height") or lift.get("load"))
        over = f" over {numbers.text(lift['lasts'])}" if lift.get("lasts") else ""
        lifts.append(f"{size} from {lift.get('date')}{over}")
    return ", ".join(lifts)


def _by_group(value: object, numbers: ShownNumbers) -> str:
    """A number, or one for each group: groups of one number together."""
    if not isinstance(value, Mapping):
        return numbers.text(value)
    groups: dict[str, list[str]] = {}
    for group, entry in value.items():
        groups.setdefault(numbers.text(entry), []).append(str(group))
    return "; ".join(f"{entry} in {ranged(names)}" for entry, names in groups.items())
