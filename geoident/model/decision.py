"""Decisions on the course of construction that depend on a reading (observational method)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Condition:
    """A reading beyond a value: ``CV1 > 40 mm at bench 5``.

    Args:
        channel: name of what is read.
        stage: name of the stage at whose end it is read.
        value: SI.
        below: it is fulfilled by readings below the value; else by those above.
        text: as the user wrote it.
    """

    channel: str
    stage: str
    value: float
    below: bool
    text: str


@dataclass(frozen=True)
class Decision:
    """What is to be done if a reading is beyond a value.

    Args:
        condition: on the reading.
        then: what is to be done, in the words of the user.
    """

    condition: Condition
    then: str
