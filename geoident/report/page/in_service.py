"""The parts of a page that a structure in service has: its state, effects, changes."""

from __future__ import annotations

from geoident.model.results.findings import sentences_of
from geoident.model.results.result import Result
from geoident.report.page.blocks import Block, TitledTable
from geoident.report.page.html import Html, tag
from geoident.report.text import in_service

_LIGHTS = (in_service.RED, in_service.AMBER, in_service.GREEN)


def status(result: Result) -> tuple[Block, ...]:
    """The traffic light, what has changed, what to do next, and every gauge with its last reading.

    Nothing but of a control.
    """
    if result.kind != "control":
        return ()
    what = sentences_of(result.findings)
    return (
        _light(result),
        tag("h3", "What has changed"),
        tag("ul", *(tag("li", text) for text in what)) if what else tag("p", "Nothing."),
        tag("h3", "What to do next"),
        tag("ol", *(tag("li", text) for text in in_service.next_steps(result))),
        TitledTable("Gauges and their last readings", in_service.latest_table(result)),
    )


def _light(result: Result) -> Html:
    """Three lights, of which one is on, and the state in words."""
    lamps = [
        tag("i", class_=f"{colour} on" if colour == result.status else "") for colour in _LIGHTS
    ]
    words = tag(
        "div",
        tag("b", result.status.capitalize()),
        tag("p", result.reason),
        tag("p", in_service.states_sentence(result)),
    )
    return tag("div", tag("span", *lamps, aria_hidden="true"), words, class_="status")


def effects(result: Result) -> tuple[Block, ...]:
    """How large the effects are, and what they leave."""
    table = in_service.effects_table(result)
    return (TitledTable(in_service.TITLE, table), tag("p", in_service.WHAT, class_="note"))[
        : 2 * bool(table.rows)
    ]


def later(result: Result) -> tuple[Block, ...]:
    """How readings after the fit compare with what was expected."""
    title = in_service.later_title(result)
    tables = {title: in_service.judged_table(result)}
    if result.kind == "fit":
        tables["Last readings"] = in_service.latest_table(result)
    return tuple(TitledTable(name, table) for name, table in tables.items())


def power(result: Result) -> tuple[Block, ...]:
    """Changes that may happen, and whether they would be seen."""
    note = in_service.power_note(result)
    table = TitledTable(in_service.POWER_TITLE, in_service.power_table(result))
    return (table, tag("p", note, class_="note")) if note else ()


def changed(result: Result) -> tuple[Block, ...]:
    """Parameters, steps and drifts, and single wrong readings."""
    return (
        TitledTable("Parameters that have changed", in_service.parameter_changes_table(result)),
        TitledTable("Steps and drifts", in_service.changes_table(result)),
        TitledTable("Single wrong readings", in_service.wrong_table(result)),
    )
