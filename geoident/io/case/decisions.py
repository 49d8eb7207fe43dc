"""Decisions that depend on a reading: ``if: CV1 > 40 mm at bench 5``."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Annotated

from pydantic import Discriminator, Field, Tag

from geoident.io.case.durations import Timetable
from geoident.io.schema.section import Context, Section
from geoident.io.schema.values import Text, shape_of
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.decision import Condition, Decision
from geoident.model.gauges import Channel
from geoident.units import UnitError, read_quantity, unit_list, with_article

_PLACE = re.compile(r"\s*(\S.*?)(?:\s*([<>])=?\s*(\S.*?))?\s+at\s+(\S.*?)\s*")
"""Channel, sign, value, stage; the first two of them, or none."""


class DecisionSection(Section):
    """What is to be done if a reading is beyond a value."""

    if_: Text = Field(
        alias="if",
        description="Channel, `>` or `<`, a value, `at` a stage.",
        examples=["CV1 > 40 mm at bench 5"],
    )
    then: Text = Field(
        description="What is to be done then.", examples=["install the second row of bolts"]
    )


Decisions = Annotated[
    Annotated[DecisionSection, Tag("mapping")] | Annotated[list[DecisionSection], Tag("list")],
    Discriminator(lambda value: "list" if shape_of(value) == "list" else "mapping"),
]


def read_place(
    text: str,
    channels: Mapping[str, Channel],
    stages: Collection[str],
    times: Timetable | None = None,
) -> tuple[str, str, Condition | None]:
    """Channel and stage of a reading, and the condition on it where there is one.

    Args:
        text: ``CV1 at bench 5`` or ``CV1 > 40 mm at bench 5``.
        channels: of the case, by name.
        stages: names of its stages.
        times: of these, where moments that the case does not have yet may be named.

    Raises:
        Refusal: it is no such text, or there is no such channel or stage.
    """
    match = _PLACE.fullmatch(text)
    if match is None:
        hint = "Write it like 'CV1 > 40 mm at bench 5'."
        raise Refusal("bad-condition", f"'{shorten(text)}' is no reading at a stage", hint)
    name, sign, value, stage = match.groups()
    if name not in channels:
        hint = did_you_mean(name, channels, what="Channels")
        raise Refusal("unknown-gauge", f"there is no channel '{shorten(name)}'", hint)
    moment = None if times is None else times.moment(stage)
    if times is not None and moment is not None:
        stage = times.name_of(*moment)
    elif stage not in stages:
        hint = did_you_mean(stage, stages, what="Stages")
        raise Refusal("unknown-stage", f"there is no stage '{shorten(stage)}'", hint)
    channel = channels[name]
    if channel.is_zeroed and channel.zero == stage:
        hint = "Name a later stage."
        raise Refusal("at-zero", f"{name} reads zero at '{stage}'", hint)
    if not sign:
        return name, stage, None
    try:
        quantity = read_quantity(value, channel.dimension)
    except UnitError as error:
        raise Refusal("unit", error.message, error.hint) from error
    if quantity.dimension != channel.dimension:
        message = f"'{value}' is {with_article(quantity.dimension)}; {name} reads "
        message += with_article(channel.dimension)
        raise Refusal("unit", message, f"Its units: {unit_list(channel.dimension)}.")
    return name, stage, Condition(name, stage, quantity.value, sign == "<", text.strip())


def build_decisions(
    given: DecisionSection | list[DecisionSection] | None,
    channels: Sequence[Channel],
    times: Timetable,
    context: Context,
) -> tuple[Decision, ...]:
    """The decisions of a case; what cannot be decided is noted as a fault.

    Args:
        given: as written.
        channels: of the case.
        times: of its stages.
        context: of the key.
    """
    known, decisions = {channel.name: channel for channel in channels}, []
    single = isinstance(given, DecisionSection)
    for n, section in enumerate([given] if isinstance(given, DecisionSection) else given or ()):
        at = context.at("if") if single else context.at(n, "if")
        try:
            _, _, condition = read_place(section.if_, known, times.stages[1:], times)
            if condition is None:
                hint = "Write it like 'CV1 > 40 mm at bench 5'."
                message = f"'{shorten(section.if_)}' has no value"
                raise Refusal("bad-condition", message, hint)
            decisions.append(Decision(condition, section.then))
        except Refusal as error:
            at.refuse(error.code, error.message, error.hint)
    return tuple(decisions)
