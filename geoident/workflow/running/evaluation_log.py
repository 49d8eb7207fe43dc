"""Evaluations as the arrays that a log keeps, and the log itself as those see it who use it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Protocol

import numpy as np

from geoident.errors import ModelError
from geoident.model.arrays import Bools, Floats
from geoident.model.response import Evaluation
from geoident.model.results.costs import NO_COST, Counts
from geoident.model.yielding import Activity

EvaluationArrays = Mapping[str, Floats]
"""What an evaluation has computed, by name."""


class Log(Protocol):
    """Where evaluations are kept: `io.result.checkpoint.EvaluationLog`, or a toy in tests."""

    def find(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """What was kept for this kind of evaluation at p (n,), or None."""

    def add(self, kind: str, p: Floats, arrays: EvaluationArrays) -> None:
        """Keep an evaluation.

        Args:
            kind: of evaluation.
            p: (n,) where.
            arrays: (...) what was found, by name.
        """


def evaluation_arrays(evaluation: Evaluation) -> EvaluationArrays:
    """An evaluation as arrays."""
    arrays = {"v": evaluation.readings, "increments": evaluation.increments}
    if evaluation.jacobian is not None:
        arrays["dv_dp"] = evaluation.jacobian
    return (
        arrays
        if evaluation.activity is None
        else {**arrays, **activity_arrays(evaluation.activity)}
    )


_ACTIVITY = "activity "


def activity_arrays(activity: Activity) -> EvaluationArrays:
    """The yield planes as arrays of numbers, names as code points."""
    arrays: dict[str, Floats] = {}
    for each in fields(Activity):
        value = getattr(activity, each.name)
        if isinstance(value, tuple):
            value = list(map(ord, "\n".join(value)))
        arrays[_ACTIVITY + each.name] = np.asarray(value, dtype=float)
    return arrays


def activity_from_arrays(arrays: EvaluationArrays) -> Activity | None:
    """The yield planes that `activity_arrays` made arrays of; None where there are none."""
    if _ACTIVITY + "points" not in arrays:
        return None

    def text(name: str) -> tuple[str, ...]:
        return tuple("".join(chr(int(c)) for c in arrays[_ACTIVITY + name]).split("\n"))

    def number(name: str) -> Floats:
        return np.array(arrays[_ACTIVITY + name])

    return Activity(
        planes=text("planes"),
        stages=text("stages"),
        points=number("points").astype(np.int64),
        biactive=number("biactive").astype(np.int64),
        distances=number("distances"),
        reached=number("reached"),
        slopes=number("slopes"),
    )


def carry_over(
    known: Mapping[str, Floats] | None,
    other: Log,
    p: Floats,
    rows: Bools,
    n_states: int,
    visited: Sequence[Floats] = (),
) -> None:
    """Give a fit of some of the readings of another what is known of all at p, if it is.

    Args:
        known: readings, derivatives and increments at p, by `CachedResponse.exact_answer`; None
            for nothing.
        other: of the fit of some.
        p: (n,) parameters, SI.
        rows: (g,) which of the readings of the first the second has too.
        n_states: how far the second analyses, with the virgin state.
        visited: (n,) parameters at which the first was evaluated with derivatives: they serve the
            surrogate of the second.
    """
    if known is None or "increments" not in known:
        return
    some = {name: known[name][rows] for name in ("v", "dv_dp")}
    increments = np.array(known["increments"])
    increments[n_states:] = 0.0
    places = np.array(visited).reshape(-1, len(p))
    other.add("evaluate", p, {**some, "increments": increments, "visited": places})


@dataclass
class Recording:
    """What a part of a search has evaluated; a log that nobody else sees.

    Args:
        evaluations: kind, parameters (n,) and arrays of each.
        failures: kind and parameters (n,) of each that has no solution, and why.
        spent: what all of it has cost.
    """

    evaluations: list[tuple[str, Floats, EvaluationArrays]] = field(default_factory=list)
    failures: list[tuple[str, Floats, ModelError]] = field(default_factory=list)
    spent: Counts = NO_COST

    def find(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """What was kept for this kind of evaluation at p (n,), or None."""
        for known, place, arrays in self.evaluations:
            if known == kind and place.tobytes() == p.tobytes():
                return arrays
        return None

    def add(self, kind: str, p: Floats, arrays: EvaluationArrays) -> None:
        """Keep an evaluation.

        Args:
            kind: of evaluation.
            p: (n,) where.
            arrays: (...) what was found, by name.
        """
        self.evaluations.append((kind, p.copy(), dict(arrays)))
