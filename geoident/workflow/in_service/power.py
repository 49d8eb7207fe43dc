"""Whether a change would be seen, and how late: told before anything happens (theory 16.6)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import UsageError
from geoident.forward.in_service.seasonal import Effects
from geoident.io.text.wording import did_you_mean
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import Channel
from geoident.model.in_service import YEAR
from geoident.model.results.in_service import PowerRow
from geoident.model.results.result import Result
from geoident.units import UnitError, read_quantity
from geoident.workflow.in_service.fitted_gauges import STANDARD, FittedGauge, Sound
from geoident.workflow.in_service.parameter_changes import ChangingStructure

_EXPECTED = (
    "expected a change such as 'P2 drifts 1 mm/year', 'P1, P2 step 2 mm' or 'all soften 20 %', or "
    "on a mesh 'E_rock falls 20 %'"
)

_CHANGE = re.compile(r"\s*(.+?)\s+(drift|step|soften|fall|rise)s?\s+(.+?)\s*")
_OF_PARAMETERS = ("fall", "rise")
_RATE = re.compile(r"(.+?)\s*(?:/|\bper\b|\ba\b)\s*(day|d|week|month|year|yr|a)")
_PERCENT = re.compile(r"([0-9]+(?:\.[0-9]*)?)\s*%")

_TIMES = {
    "d": "1 d", "day": "1 d", "week": "7 d", "month": "30.4375 d", "year": "1 year",
    "yr": "1 year", "a": "1 year",
}  # fmt: skip


@dataclass(frozen=True)
class PlannedChange:
    """A change that may happen.

    Args:
        text: as it was asked for.
        kind: ``step``, ``drift`` or ``soften``, of a parameter ``fall`` or ``rise``.
        gauges: numbers of the channels that it concerns.
        size: of each, SI; of a drift by year; of a softening the part by which stiffness falls.
        parameter: name of the one that changes; empty for a change of gauges.
        value: that it takes, SI.
    """

    text: str
    kind: str
    gauges: tuple[int, ...]
    size: tuple[float, ...] = ()
    parameter: str = ""
    value: float = np.nan

    def motion(
        self, gauge: FittedGauge, effects: Effects, structure: ChangingStructure | None
    ) -> Floats:
        """(m,) what it adds to the readings on dates as usual, SI, if it begins with them.

        Args:
            gauge: one of a fit.
            effects: names of the terms and to which effect each belongs.
            structure: that the change of a parameter concerns.
        """
        if self.parameter:
            assert structure is not None
            return structure.motion(
                self.parameter, self.value, gauge, gauge.standard, earlier=STANDARD
            )
        times, columns = gauge.standard.times, gauge.standard.columns
        if gauge.number not in self.gauges:
            return np.zeros(len(times))
        size = self.size[self.gauges.index(gauge.number)]
        if self.kind == "step":
            return np.full(len(times), size)
        if self.kind == "drift":
            return np.asarray(size * (times - times[0]) / YEAR)
        level = np.isin(gauge.terms, effects.of("level"))
        motion = columns[:, level] @ gauge.state.mean[: len(level)][level]
        return np.asarray((1.0 / (1.0 - size) - 1.0) * motion)


def read_change(text: str, case: Case, fit: Result) -> PlannedChange:
    """A change from words such as ``P2 drifts 1 mm/year``.

    Args:
        text: the words.
        case: with the gauges.
        fit: of them.

    Raises:
        UsageError: the words are no change, or one of a gauge or parameter that is not there.
    """
    match = _CHANGE.fullmatch(text)
    if match is None:
        raise UsageError(f"'{text}' is no change; {_EXPECTED}.")
    who, kind, size = match.groups()
    assert fit.seasonal is not None
    channels = case.channels
    fitted = np.flatnonzero(np.isfinite(fit.seasonal.white)).tolist()
    if kind in _OF_PARAMETERS:
        value = _value(text, who, size, -1.0 if kind == "fall" else 1.0, case, fit)
        return PlannedChange(text, kind, tuple(fitted), parameter=who, value=value)
    numbers = _gauges(text, who, channels, fitted)
    if kind == "soften":
        percent = _PERCENT.fullmatch(size)
        if percent is None or not 0.0 < float(percent[1]) < 100.0:
            message = f"'{size}' in '{text}' is no part by which stiffness falls"
            raise UsageError(f"{message}; write one above 0 % and below 100 %, such as 20 %.")
        if "level" not in fit.seasonal.effects:
            message = f"'{text}' needs an effect of the level, which the model does not have"
            raise UsageError(f"{message}; ask for a step or a drift.")
        return PlannedChange(text, kind, numbers, (float(percent[1]) / 100.0,) * len(numbers))
    sizes = tuple(_size(text, kind, size, channels[number]) for number in numbers)
    return PlannedChange(text, kind, numbers, sizes)


def _value(text: str, name: str, size: str, sign: float, case: Case, fit: Result) -> float:
    """The value that a parameter takes, SI.

    Args:
        text: all the words.
        name: the parameter.
        size: by how much it changes, such as ``20 %`` or ``by 2 GPa``.
        sign: of the change.
        case: with the parameters.
        fit: with their values.
    """
    assert fit.seasonal is not None
    names = [fit.seasonal.terms[k] for k in fit.seasonal.shared]
    parameters = {parameter.name: parameter for parameter in case.parameters}
    if not parameters:
        raise UsageError(
            f"'{text}' is a change of a parameter, and a seasonal model has none. Ask what gauges "
            "would show: 'P2 drifts 1 mm/year', 'P1, P2 step 2 mm' or 'all soften 20 %'."
        )
    if name not in parameters:
        hint = did_you_mean(name, list(parameters), what="Parameters of the case")
        raise UsageError(f"'{name}' in '{text}' is no parameter. {hint}")
    if name not in names:
        message = f"the readings do not determine '{name}', so they would not show '{text}'"
        raise UsageError(f"{message}. {_known(names)}")
    parameter = parameters[name]
    before = float(fit.parameters.values[fit.parameters.names.index(name)])
    amount = size.removeprefix("by ").strip()
    if (percent := _PERCENT.fullmatch(amount)) is not None:
        by = float(percent[1]) / 100.0 * abs(before)
    else:
        try:
            by = read_quantity(amount, parameter.dimension).value
        except UnitError as error:
            raise UsageError(f"'{amount}' in '{text}', of {name}: {error}") from None
    value = before + sign * by
    if not by > 0.0:
        raise UsageError(f"'{amount}' in '{text}' is no change; write a size above zero.")
    if parameter.lower > 0.0 >= value:
        raise UsageError(f"'{text}' leaves nothing of {name}; write less.")
    return value


def _known(names: Sequence[str]) -> str:
    return f"They determine {', '.join(names)}." if names else "They determine no parameter."


def _gauges(
    text: str, who: str, channels: Sequence[Channel], fitted: Sequence[int]
) -> tuple[int, ...]:
    """Numbers of the gauges that are named, or of all."""
    if who == "all":
        return tuple(fitted)
    known = {channels[number].name: number for number in fitted}
    names = [name.strip() for name in who.split(",")]
    for name in names:
        if name not in known:
            hint = did_you_mean(name, [*known, "all"], what="Gauges of the fit")
            raise UsageError(f"'{name}' in '{text}' is no gauge that was fitted. {hint}")
    return tuple(dict.fromkeys(known[name] for name in names))


def _size(text: str, kind: str, size: str, channel: Channel) -> float:
    """The size of a step or, by year, of a drift of a gauge, SI."""
    rate = _RATE.fullmatch(size)
    if (rate is None) == (kind == "drift"):
        needs = "a rate such as 1 mm/year" if kind == "drift" else "a size such as 2 mm"
        raise UsageError(f"'{size}' in '{text}': a {kind} needs {needs}; {_EXPECTED}.")
    try:
        value = read_quantity(rate[1] if rate else size, channel.dimension).value
    except UnitError as error:
        raise UsageError(f"'{size}' in '{text}', of {channel.name}: {error}") from None
    time = read_quantity(_TIMES[rate[2]], "time").value if rate else YEAR
    if not value:
        raise UsageError(f"'{size}' in '{text}' is no change.")
    return value * YEAR / time


def power_of(
    change: PlannedChange,
    sound: Sound,
    effects: Effects,
    channels: Sequence[Channel],
    structure: ChangingStructure | None,
) -> PowerRow:
    """How probably and how late a change is seen that begins with dates as usual.

    Args:
        change: that may happen.
        sound: what gauges show without it.
        effects: names of the terms and to which effect each belongs.
        channels: of the case.
        structure: that the change of a parameter concerns.

    Raises:
        UsageError: the parameter cannot have that value.
    """
    if structure is not None and change.parameter:
        why = structure.why_not(change.parameter, change.value)
        if why is not None:
            raise UsageError(f"'{change.text}' cannot be: {why}.")
    changed = [
        own + gauge.standard.effects(change.motion(gauge, effects, structure)[:, None])
        for gauge, own in zip(sound.gauges, sound.innovations, strict=True)
    ]
    delay = sound.detector.first_seen(changed, sound.threshold)
    median, late = (float(np.quantile(delay, part, method="higher")) for part in (0.5, 0.9))
    return PowerRow(
        change=change.text,
        gauges=", ".join(channels[number].name for number in change.gauges),
        probability=float(np.mean(np.isfinite(delay))),
        median=median if np.isfinite(median) else np.nan,
        late=late if np.isfinite(late) else np.nan,
        horizon=STANDARD,
    )
