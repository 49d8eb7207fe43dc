"""A case in words: what it amounts to, its title, and what its axes are called."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
import yaml

from geoident.io.text.dates import DateError, read_date
from geoident.model.arrays import Floats
from geoident.model.moments import time_text
from geoident.model.results.result import GaugeTable, Result
from geoident.model.results.summary import CaseSummary, CostEstimate, StageSummary
from geoident.report.text.errors import surface
from geoident.report.text.inputs.construction import load_texts
from geoident.report.text.inputs.materials import ground_sentences, materials_table
from geoident.report.text.inputs.numbers import CaseTexts, ShownNumbers, entries
from geoident.report.text.inputs.structures import (
    interfaces_table,
    structures_table,
    supports_table,
)
from geoident.report.text.layout import (
    TextTable,
    bullets,
    decimals,
    moment_text,
    number,
    section,
    sections,
    sentence,
)
from geoident.units import in_unit, shown_unit


def case_entries(text: str) -> Mapping[str, Any]:
    """A case as texts; empty if it cannot be read.

    Args:
        text: of the case.
    """
    return _case(text)


def case_title(result: Result) -> str:
    """The title that the user gave the case; empty if there is none."""
    title = _case(result.case_resolved).get("title", "")
    return title if isinstance(title, str) else ""


def axis_names(result: Result) -> tuple[str, str, str]:
    """What the coordinates are called."""
    turned = _case(result.case_resolved).get("analysis") == "axisymmetric"
    return ("radius r", "height y", "") if turned else ("x", "y", "z")


def case_mapping(result: Result, key: str) -> Mapping[str, Any]:
    """What a key of the case holds, as texts; empty where it holds no mapping."""
    return _mapping(_case(result.case_resolved), key)


def of_tests(result: Result) -> bool:
    """Whether it is of tests, whose specimens come with geoident."""
    return str(case_mapping(result, "mesh").get("file", "")).startswith("geoident:")


def stage_dates(result: Result) -> Floats:
    """When the stages end, from the case, by their names where these are days, or from readings.

    Returns:
        (n_stages,) seconds since 1970; NaN where nobody says.
    """
    table, dates = result.gauges.readings, case_mapping(result, "dates")
    times = result.gauges.times
    if times is not None and np.isfinite(times.date).any():
        return times.date
    seconds = np.full(len(result.gauges.stages), np.nan)
    names = np.array(table.stage)
    for k, stage in enumerate(result.gauges.stages):
        read = table.time[names == stage] if len(table) else np.empty(0)
        try:
            seconds[k] = read_date(str(dates.get(stage, stage)))
        except DateError:
            seconds[k] = np.nanmax(read) if np.isfinite(read).any() else np.nan
    return seconds


def gauge_entry(result: Result, gauge: str) -> Mapping[str, Any]:
    """What the case says of a gauge, as texts; empty where that cannot be read."""
    gauges = _case(result.case_resolved).get("gauges")
    entry = gauges.get(gauge) if isinstance(gauges, dict) else None
    return entry if isinstance(entry, dict) else {}


def gauge_quantity(result: Result, gauge: str, dimension: str | None = None) -> str:
    """What a gauge measures, with its unit and direction, as a figure says it.

    Args:
        result: with the gauge.
        gauge: its name.
        dimension: of which of its channels, where they have several; None for the first.
    """
    entry = gauge_entry(result, gauge)
    unit, of = _unit_of_gauge(result.gauges, gauge, dimension)
    component = entry.get("component")
    along = f" {component}" if isinstance(component, str) else ""
    other = f"displacement{along}" if of == "length" else of
    name, direction = _QUANTITIES.get((str(entry.get("kind", "")), of), (other, ""))
    if entry.get("positive") == "away":
        direction = "away from the sensor"
    if entry.get("kind") in _OF_FORCE:
        structure = _mapping(_mapping(_case(result.case_resolved), "structures"),
                             str(entry.get("structure", "")))  # fmt: skip
        name, direction = _force_quantity(entry, structure)
    what = ", ".join(word for word in (unit, direction) if word)
    return f"{name} ({what})" if what else name


ACROSS, ALONG = "motion across the casing", "settlement along the casing"
"""What the axes and the rings of an inclinometer read."""

_QUANTITIES = {
    ("extensometer", "length"): ("extension", ""),
    ("convergence", "length"): ("change of length", ""),
    ("settlement", "length"): ("settlement", "downwards"),
    ("joint-meter", "length"): ("motion across the joint", "opening, or slip to the left"),
    ("bar-displacement", "length"): ("motion of the bar", "bolts outwards, piles inwards"),
    ("inclinometer", "length"): (ACROSS, ""),
    ("tilt", "angle"): ("tilt", "top towards its direction"),
    ("levelling", "length"): ("settlement", "downwards"),
    ("levelling", "angle"): ("angular distortion", "second point down"),
    ("line-of-sight", "length"): ("motion along the sight", "towards the sensor"),
}
"""Kind of a gauge and dimension of a channel: what it measures, and what counts as positive."""

_OF_FORCE = {
    "stress": "stress",
    "pressure-cell": "total pressure",
    "piezometer": "pore pressure",
    "thermometer": "temperature",
    "strain": "strain",
    "load-cell": "force",
}
_FORCES = {"N": "axial force", "M": "bending moment", "Q": "shear force"}


def _force_quantity(entry: Mapping[str, Any], structure: Mapping[str, Any]) -> tuple[str, str]:
    """What a gauge of stresses or forces measures, and which sign is positive."""
    kind = entry["kind"]
    name, direction = _OF_FORCE[kind], ""
    if kind == "load-cell":
        quantity = entry.get("quantity", "N")
        name = _FORCES.get(quantity, name)
        strut = structure.get("kind") == "strut"
        counts = entry.get("sign", "compression" if strut else "tension")
        direction = {"N": counts, "M": "tension inside"}.get(quantity, "")
    elif kind == "stress":
        direction = entry.get("positive", "tension")
    elif kind not in ("piezometer", "thermometer"):
        direction = "elongation" if kind == "strain" else "compression"
        direction = "compression" if entry.get("positive") == "compression" else direction
    since = "change of " if "zero" in entry and kind != "strain" else ""
    return since + name, str(direction)


def _mapping(entry: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """What a key of a case holds, if it is a mapping; else an empty one."""
    value = entry.get(key)
    return value if isinstance(value, dict) else {}


def _unit_of_gauge(gauges: GaugeTable, gauge: str, dimension: str | None) -> tuple[str, str]:
    """Unit and dimension of the channels of a gauge."""
    for name, unit, own_dimension in zip(
        gauges.gauges, gauges.shown_units, gauges.dimensions, strict=True
    ):
        if name == gauge and dimension in (None, own_dimension):
            return unit, own_dimension
    return "mm", "length"


_LOADER: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
"""Of libyaml where that is there, ten times as fast."""


@lru_cache(maxsize=8)
def _case(text: str) -> dict[str, Any]:
    """The case as texts; empty if there is none that can be read."""
    try:
        case = yaml.load(text, Loader=_LOADER)
    except (yaml.YAMLError, RecursionError):
        return {}
    return case if isinstance(case, dict) else {}


def case_text(summary: CaseSummary) -> str:
    """A case that was checked."""
    at_start = {name: (cohesion, friction) for name, cohesion, friction in summary.limits}
    return sections(
        _head(summary),
        section("Groups", _groups(summary)),
        section("Materials", _inputs(summary, materials_table)),
        section("Structures", _inputs(summary, structures_table)),
        section("Interfaces", _inputs(summary, partial(interfaces_table, at_start=at_start))),
        section("Supports", _inputs(summary, supports_table)),
        section("Ground and loads", bullets(_begin(summary))),
        section(
            surface.TITLE,
            surface.surface_table(summary.surface).text,
            sentence(surface.surface_words(summary.surface)),
        ),
        section("Stages", _stages(summary.stages)),
        section("Gauges", _gauges(summary)),
        section("Positions of the gauges", _places(summary)),
        _readings(summary),
        section("Dates of the readings", _when_read(summary)),
        section("Computation", _cost(summary.cost, summary.evaluations)),
        section("Notes", bullets(summary.notes)),
    )


def _head(summary: CaseSummary) -> str:
    parameters = ", ".join(summary.parameters) or "none"
    lines = [
        f"{summary.case}: {summary.title}" if summary.title else summary.case,
        summary.elsewhere or f"{summary.analysis}, {_model(summary)}",
        f"parameters {parameters}; method {' + '.join(summary.methods)}",
    ]
    return "\n".join(sentence(line) for line in lines)


def _model(summary: CaseSummary) -> str:
    if not summary.mesh:
        return "no mesh: closed form of a circular opening"
    return f"{summary.nodes} nodes, {summary.elements} elements ({summary.mesh})"


def _groups(summary: CaseSummary) -> str:
    size = {"plane-strain": "m2", "axisymmetric": "m3 (whole turn)"}.get(summary.analysis, "m3")
    rows = [
        [g.name, str(g.elements), number(g.volume, 5), g.material or "absent"]
        for g in summary.groups
    ]
    return TextTable(("name", "elements", size, "material at the start"), rows, right="lrr").text


_LABELS = {"groups": "groups ", "along": "along ", "limits": "limits ", "from stage": "from stage "}
"""Columns whose cells do not say by themselves what they are."""


def _inputs(summary: CaseSummary, table: Callable[[CaseTexts, ShownNumbers], TextTable]) -> str:
    """A table of what the case says, an entry a line: its cells are too long for columns."""
    case = _case(summary.resolved)
    inputs = table(case, ShownNumbers(entries(case, "parameters")))
    lines = []
    for first, *rest in inputs.rows:
        named = zip(inputs.header[1:], rest, strict=True)
        cells = [f"{_LABELS.get(name, '')}{cell}" for name, cell in named if cell]
        lines.append(f"{first}: {'; '.join(cells)}")
    return bullets(lines)


def _begin(summary: CaseSummary) -> tuple[str, ...]:
    """What acts before the first stage."""
    case = _case(summary.resolved)
    numbers = ShownNumbers(entries(case, "parameters"))
    loads = [f"Load {text}." for text in load_texts(entries(case, "loads"), numbers)]
    return (*ground_sentences(case, numbers), *loads)


def _stages(stages: tuple[StageSummary, ...]) -> str:
    rows = [[s.name, str(s.dofs), str(s.used), _events(s)] for s in stages]
    return TextTable(("name", "unknowns", "readings", "what happens"), rows, right="lrrl").text


def _events(stage: StageSummary) -> str:
    events = [f"builds on {stage.base}"] if stage.base else []
    if stage.lasts is not None:
        events.append(f"lasts {time_text(stage.lasts)} (computed at {stage.moments} moments)")
    events += [f"-{name}" for name in stage.leaves]
    events += [f"+{name}: {material}" for name, material in stage.enters]
    events += [f"{name} becomes {material}" for name, material in stage.changes]
    events += [f"releases {share} of {name}" for name, share in stage.released]
    events += [f"builds {name}" for name in stage.built]
    events += [f"dismantles {name}" for name in stage.dismantled]
    events += [f"stresses {name}" for name in stage.stressed]
    events += [f"load {name}" for name in stage.loads]
    events += [f"end of load {name}" for name in stage.removed]
    events += [f"temperature of {name}" for name in stage.warmed]
    events += ["water in the pores"] if stage.water else []
    heads = dict(stage.heads)
    events += [
        f"drains {name}" + (f" at head {heads[name]}" if name in heads else "")
        for name in stage.drained
    ]
    events += [f"closes {name}" for name in stage.closed]
    events += [f"heat at {name}" for name in stage.heated]
    events += [f"support {name}" for name in stage.supported]
    events += [f"lets go of {name}" for name in stage.freed]
    return ", ".join(events)


def _gauges(summary: CaseSummary) -> str:
    """A line for every channel; the unit of the accuracies in the header if all have the same."""
    units = [shown_unit(g.unit, g.dimension) for g in summary.gauges]
    unit = units[0] if len(set(units)) == 1 else ""
    accuracies = [
        "estimate"
        if g.estimated
        else number(in_unit(g.accuracy, g.unit, g.dimension)) + ("" if unit else f" {own}".rstrip())
        for g, own in zip(summary.gauges, units, strict=True)
    ]
    rows = [
        [g.name, g.kind, g.zero or "-", accuracy, str(g.used), str(g.unused)]
        for g, accuracy in zip(summary.gauges, accuracies, strict=True)
    ]
    header = ("name", "kind", "zero", f"accuracy {unit}".rstrip(), "used", "not used")
    return TextTable(header, rows, right="lllrrr").text


def _places(summary: CaseSummary) -> str:
    """A line for every point; the anchors of an extensometer share the name of its head."""
    rows = [
        [
            _together(place.channels),
            ", ".join(number(x, 6) for x in place.point),
            str(place.element),
            place.group,
            "-" if place.distance is None else decimals(place.distance, 2),
        ]
        for place in summary.places
    ]
    header = ("channels", "point (m)", "element", "group", "m to excavation")
    return TextTable(header, rows, right="llrlr").text


def _readings(summary: CaseSummary) -> str:
    lines = [f"Readings: {summary.used} used"]
    lines += [f"  {count} not used: {reason}" for reason, count in summary.unused]
    for reading in summary.readings:
        used = _together(reading.used) or "none"
        times = f" ({reading.moments} moments)" if reading.moments > 1 else ""
        lines.append(sentence(f"{reading.stage}: {used} used{times}", indent="- "))
        for reason, channels in reading.unused:
            lines.append(sentence(f"not used: {_together(channels)}: {reason}", indent="    "))
    return "\n".join(lines)


def _when_read(summary: CaseSummary) -> str:
    """A line for every stage: what went where, by the dates."""
    if not summary.when_read:
        return ""
    rows = [
        [
            stage.stage,
            _date(stage.complete),
            str(stage.number),
            str(stage.channels),
            _date(stage.first),
            _date(stage.last),
            str(stage.between or "-"),
        ]
        for stage in summary.when_read
    ]
    header = ("stage", "complete on", "readings", "channels", "first", "last", "nearer to the next")
    return TextTable(header, rows, right="llrrllr").text


def _date(seconds: float | None) -> str:
    text = None if seconds is None else moment_text(seconds)
    return "-" if text is None else text.replace("T", " ")[:16].removesuffix(" 00:00")


def _together(channels: Sequence[str]) -> str:
    """Names of channels, those of one gauge together.

    >>> _together(["EX.a5", "EX.a15", "CV"])
    'EX.a5,a15 CV'
    """
    gauges: dict[str, list[str]] = {}
    for channel in channels:
        gauge, _, anchor = channel.partition(".")
        gauges.setdefault(gauge, []).extend([anchor] if anchor else [])
    return " ".join(
        f"{gauge}.{','.join(anchors)}" if anchors else gauge for gauge, anchors in gauges.items()
    )


_YIELDING = {
    "ground": "ground yields", "structures": "structures yield", "interfaces": "interfaces slip"
}  # fmt: skip


def _cost(cost: CostEstimate | None, evaluations: str) -> str:
    if cost is None:
        return ""
    steps = ""
    if cost.newton_steps > 1:
        why = " and ".join(_YIELDING[name] for name in cost.yielding)
        steps = f"; {why}, so {cost.newton_steps} Newton steps per stage are assumed"
    if cost.time_steps:
        steps = f"; stages that last take {cost.time_steps} steps in time"
    factor = f"The factor of the largest stage has {_many(cost.factor_entries)} entries; all "
    factor += f"stages take {_many(cost.factor_flops)} operations (counted)."
    if cost.solver == "iterative":
        factor = f"A factor of the largest stage would have {_many(cost.factor_entries)} entries "
        factor += "(counted); conjugate gradients on several levels take its place."
    lines = [
        factor,
        f"About {number(cost.memory / 1e6, 2)} MB of memory and {number(cost.seconds, 2)} s for "
        f"one evaluation by {cost.solver} on two cores of 2.5 GHz (estimated){steps}. "
        + evaluations,
    ]
    return "\n".join(sentence(line) for line in lines)


def _many(count: float) -> str:
    """A large count in words.

    >>> _many(574), _many(2.32e6), _many(4.87e9)
    ('574', '2.32 million', '4870 million')
    """
    return number(count, 3) if count < 1e6 else f"{number(count / 1e6, 3)} million"
