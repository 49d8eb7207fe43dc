"""What a plan of gauges is for: a later reading, a limit on it, or a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geoident.errors import Term, UsageError
from geoident.io.case.decisions import read_place
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.arrays import Bools
from geoident.model.case import Case
from geoident.model.decision import Condition


@dataclass(frozen=True)
class Wanted:
    """One of what is to be known.

    Args:
        text: as it was asked for.
        parameter: number of a parameter; None for a reading.
        row: number of the channel.
        stage: number of the stage; of a parameter that after the last one. Readings before it tell.
        condition: on the reading, or None.
    """

    text: str
    parameter: int | None
    row: int
    stage: int
    condition: Condition | None = None


def read_wanted(
    texts: Sequence[str], case: Case, names: Sequence[str], used: Bools | None
) -> tuple[Wanted, ...]:
    """What is to be known, from what the user wrote.

    Args:
        texts: such as ``CV1 at bench 5``, ``CV1 > 40 mm at bench 5``, ``E_rock``.
        case: with the gauges that are spoken of.
        names: of the parameters.
        used: (n_channels, n_stages) what a fit has read; None before any.

    Raises:
        UsageError: there is no such thing, or it was read already.
    """
    if not texts:
        raise UsageError(f"Say what the gauges are for: {Term.WANTED} 'CV1 at bench 5'.")
    channels = {channel.name: channel for channel in case.channels}
    stages = [stage.name for stage in case.stages]
    wanted = []
    for text in texts:
        if text in names:
            wanted.append(Wanted(text, list(names).index(text), -1, len(stages)))
            continue
        if " at " not in text:
            hint = did_you_mean(text, names, what="Parameters")
            message = f"'{shorten(text)}' is neither a parameter nor a reading at a stage"
            raise UsageError(
                f"{Term.WANTED}: {message}. {hint} A reading is written 'CV1 at bench 5'."
            )
        try:
            name, stage, condition = read_place(text, channels, stages)
        except Refusal as error:
            raise UsageError(
                f"{Term.WANTED} '{shorten(text)}': {error.message}. {error.hint}"
            ) from error
        row, column = list(channels).index(name), stages.index(stage)
        if used is not None and column <= _last(used):
            words = f"'{stage}' is past: the fit has readings of it, or of later stages"
            raise UsageError(
                f"{Term.WANTED} '{shorten(text)}': {words}. Name a stage still to come."
            )
        wanted.append(Wanted(text, None, row, column, condition))
    return tuple(wanted)


def _last(used: Bools) -> int:
    """Number of the last stage that was read."""
    read = [j for j in range(used.shape[1]) if used[:, j].any()]
    return max(read, default=-1)
