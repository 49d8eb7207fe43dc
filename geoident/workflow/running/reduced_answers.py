"""Thousands of answers by a reduced model, where it is proven to be close enough (theory 14).

The reduced model is made of a few marches: at the centre, and one after the other where among some
training points the bound of its error is largest. A reading that may be off by more than `CLOSE` of
its accuracy is computed by the model itself, so what is found does not depend on where the reduced
model is good; only the time does. The marches are the same in every run, and so are the answers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.forward.reduced.reducible import ReducibleResponse
from geoident.forward.reduced.response import ReducedResponse
from geoident.model.arrays import Bools, Floats
from geoident.workflow.running.answers import Answer, Asked, Compute

CLOSE = 0.02
"""Part of the accuracy of a reading by which the reduced model may be off."""

MARCHES = 8
"""Marches of which the reduced model is made at most."""

_GOOD = 1e-5
"""Bound of the relative error in energy that needs no further march."""

_AT_ONCE = 500
"""Parameter vectors that are answered together."""


def reduced_around(
    response: ReducibleResponse, centre: Floats, training: Floats, marches: int = MARCHES
) -> ReducedResponse | None:
    """The reduced model of a response with bounds of its readings; None where there is none.

    Args:
        response: whose readings are asked for.
        centre: (n,) parameters in the middle of what will be asked.
        training: (k, n) some of what will be asked.
        marches: of which it is made at most.
    """
    response.keep_marches(economical=False, most=marches)
    try:
        response.by_tangents(centre)
        for _ in range(marches - 1):
            reduced = response.reduced()
            if reduced is None:
                return None
            _, bounds = reduced.many(training)
            worst = int(np.argmax(bounds.relative))
            if bounds.relative[worst] <= _GOOD:
                break
            response.by_tangents(training[worst])
        return response.reduced(bounded=True, reference=centre)
    except (ModelError, ValueError):
        return None


@dataclass
class ReducedAnswers:
    """Answers by the reduced model where its bounds allow, by the model elsewhere.

    Args:
        reduced: with bounds of its readings.
        split: how many of its readings are those that are used.
        limit: (g + m,) by how much a reading may be off, SI.
        elsewhere: the model.

    Attributes:
        by_reduced: answers that the reduced model gave.
        by_model: answers that the model gave.
    """

    reduced: ReducedResponse
    split: int
    limit: Floats
    elsewhere: Compute
    by_reduced: int = 0
    by_model: int = 0

    def __call__(self, points: Floats) -> Iterator[Answer]:
        """Answers at p (k, n), SI, in their order."""
        for first in range(0, len(points), _AT_ONCE):
            some = points[first : first + _AT_ONCE]
            values, close = self._close(some)
            full = iter(self.elsewhere(some[~close]))
            for v, near in zip(values, close, strict=True):
                if near:
                    self.by_reduced += 1
                    yield Answer(v[: self.split], v[self.split :])
                else:
                    self.by_model += 1
                    yield next(full)

    def _close(self, points: Floats) -> tuple[Floats, Bools]:
        """Readings (k, g + m) by the reduced model, and where they are close enough (k,)."""
        inside = np.array([self.reduced.admissible(p) is None for p in points], dtype=bool)
        values = np.full((len(points), len(self.limit)), np.nan)
        close = np.zeros(len(points), dtype=bool)
        if inside.any():
            try:
                found, error = self.reduced.certified(points[inside])
            except (ValueError, np.linalg.LinAlgError):
                return values, close
            values[inside] = found
            close[inside] = np.all(error <= self.limit, axis=1) & np.isfinite(found).all(axis=1)
        return values, close

    @property
    def note(self) -> str:
        """How many answers are whose, a sentence."""
        count = self.by_reduced + self.by_model
        if not self.by_reduced:
            return f"All {count:,} evaluations are those of the full model."
        rest = "none is" if not self.by_model else f"{self.by_model:,} are"
        return (
            f"{self.by_reduced:,} of {count:,} evaluations are those of a reduced model, whose "
            f"readings are proven to be off by at most {100 * CLOSE:.2g} % of their accuracies; "
            f"{rest} of the full model."
        )


def reduced_answers(
    asked: Asked, centre: Floats, training: Floats, accuracy: Floats, elsewhere: Compute
) -> ReducedAnswers | None:
    """Answers of a model with the help of its reduced one; None where it has none.

    Args:
        asked: the model, and what it is asked for.
        centre: (n,) parameters in the middle of what will be asked.
        training: (k, n) some of what will be asked.
        accuracy: (g + m,) of the used readings and of all that can be read, SI.
        elsewhere: answers of the model.
    """
    response = asked.everything
    if not isinstance(response, ReducibleResponse):
        return None
    reduced = reduced_around(response, centre, training)
    if reduced is None:
        return None
    return ReducedAnswers(reduced, len(accuracy) - len(asked.places), CLOSE * accuracy, elsewhere)
