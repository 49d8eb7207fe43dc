"""Errors of all channels of a case, when the whole case and its readings are known.

A zero that was subtracted from readings, `fit.accuracies` and set-ups that several gauges share
change what the section of each gauge says by itself (`accuracy`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from geoident.io.case.case import CaseSection
from geoident.io.text.faults import Faults
from geoident.model.case import Case
from geoident.model.gauges import PARTS, Channel, ErrorParts, Reading


def described_channels(
    case: Case, section: CaseSection, zeros: Mapping[str, Reading], faults: Faults
) -> tuple[Channel, ...]:
    """The channels of a case with all that is known of their errors.

    Args:
        case: with its channels.
        section: the same as it was written.
        zeros: channel to what was read at its zero and subtracted from its readings.
        faults: is told what cannot be estimated.
    """
    kinds = section.fit.accuracies
    stated = {c.name: section.gauges[c.gauge].read_by(c.probe).states_zero for c in case.channels}
    channels = tuple(
        _with_zero(c, zeros[c.name], stated=stated[c.name]) if c.name in zeros else c
        for c in case.channels
    )
    if isinstance(kinds, dict):
        present = dict.fromkeys(channel.kind for channel in channels)
        for kind in kinds.keys() - present.keys():
            path = ("fit", "accuracies", kind)
            faults.add_unknown(path, "kind of gauge", kind, list(present), key=True)
    described = tuple(
        _estimated(c) if isinstance(kinds, str) or (kinds and c.kind in kinds) else c
        for c in channels
    )
    if section.fit.loss != "squared" and any(c.errors and c.errors.estimated for c in described):
        message = f"accuracies cannot be estimated with the loss '{section.fit.loss}': it explains "
        message += "large residuals by wrong readings, an estimated accuracy by the gauge"
        hint = "Find the wrong readings first, list them under 'bad', and use 'loss: squared'."
        faults.add(("fit", "loss"), "contradiction", message, hint)
    return _one_set_up(
        tuple(
            c if c.errors is None else _complete(c, c.errors, stated=stated[c.name])
            for c in described
        )
    )


def _one_set_up(channels: tuple[Channel, ...]) -> tuple[Channel, ...]:
    """Channels that share a set-up have one component for it, also where their kinds differ.

    If one of them has it estimated, it is; of several components that are stated, the first by name
    is taken.
    """
    with_set_up = [c for c in channels if c.errors is not None and c.errors.epoch > 0.0]
    names: dict[str, str] = {}
    for channel in with_set_up:
        if name := channel.error_parts.component("epoch"):
            survey = channel.error_parts.survey or channel.gauge
            names[survey] = min(name, names.get(survey, name))
    shared: dict[str, Channel] = {}
    for channel in with_set_up:
        parts = channel.error_parts
        if name := names.get(parts.survey or channel.gauge):
            estimated = tuple({**dict(parts.estimated), "epoch": name}.items())
            shared[channel.name] = replace(channel, errors=replace(parts, estimated=estimated))
    return tuple(shared.get(channel.name, channel) for channel in channels)


def _complete(channel: Channel, parts: ErrorParts, *, stated: bool) -> Channel:
    """A channel with its total accuracy; a value has the error of a zero only if that is stated."""
    if not channel.is_zeroed and not stated:
        kept = tuple(pair for pair in parts.estimated if pair[0] != "zero")
        parts = replace(parts, zero=0.0, zero_surveyed=0.0, estimated=kept)
    return _with_parts(channel, parts)


def _with_zero(channel: Channel, zero: Reading, *, stated: bool) -> Channel:
    """A channel whose readings are differences from one that was read at its zero.

    Args:
        channel: of the case.
        zero: what was subtracted, perhaps a mean.
        stated: the case itself says how accurate the zero is.
    """
    if stated:
        return channel
    parts = channel.error_parts
    own, size = zero.accuracy, channel.own_sd(zero)
    kept = tuple(pair for pair in parts.estimated if pair[0] != "zero")
    component = parts.component("reading")
    if own is None and component is not None:
        kept = (*kept, ("zero", component))
    surveyed = 1.0 / math.sqrt(zero.epochs)
    parts = replace(parts, zero=size, zero_surveyed=surveyed, estimated=kept)
    return _with_parts(channel, parts)


def _estimated(channel: Channel) -> Channel:
    parts = channel.error_parts
    known = dict(parts.estimated)
    more = {
        name: channel.kind for name in PARTS if getattr(parts, name) > 0.0 and name not in known
    }
    return _with_parts(channel, replace(parts, estimated=tuple((known | more).items())))


def _with_parts(channel: Channel, parts: ErrorParts) -> Channel:
    return replace(channel, errors=parts, accuracy=parts.total(channel.along))
