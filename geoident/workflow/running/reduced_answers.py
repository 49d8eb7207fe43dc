"""Thousands of answers by a reduced model, where that is estimated to be close (theory 14).

A reading that may be off by more than `CLOSE` of its accuracy is computed by the model itself, so
what is found does not depend on where the reduced model is good; only the time does. The analyses
of which it is made are the same in every run, and so are the answers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from geoident.errors import ModelError
from geoident.forward.reduced.kept import RestoredModel
from geoident.forward.reduced.response import ReducedResponse
from geoident.forward.reducible import ReducibleResponse
from geoident.model.arrays import Floats
from geoident.workflow.running.answers import Answer, Asked, Compute

CLOSE = 0.02
"""Part of the accuracy of a reading by which the reduced model may be off."""

MOST_ANALYSES = 8
"""Analyses of which the reduced model is made at most."""

MADE = "a reduced model"
"""What one is called that a command makes for itself."""

OF_FIT = "the reduced model that the fit keeps"

_AT_ONCE = 500
"""Parameter vectors that are answered together."""


def reduced_around(
    response: ReducibleResponse,
    centre: Floats,
    training: Floats,
    analyses: int = MOST_ANALYSES,
    also: Sequence[Floats] = (),
) -> ReducedResponse | None:
    """The reduced model of a response for many readings; None where there is none.

    Args:
        response: whose readings are asked for.
        centre: (n,) parameters in the middle of what will be asked.
        training: (k, n) some of what will be asked.
        analyses: of which it is made at most.
        also: (n,) parameters of which it is to be made beside.
    """
    try:
        return response.surrogate_around(centre, training, most=analyses, also=also)
    except (ModelError, ValueError):
        return None


@dataclass
class ByReducedModel:
    """What is answered by a reduced model where that is close enough, by the model elsewhere.

    Args:
        reduced: the reduced model.
        whose: what it is called.

    Attributes:
        by_reduced: answers that the reduced model gave.
        by_model: answers that the model gave.
    """

    reduced: ReducedResponse
    whose: str = field(default=MADE, kw_only=True)
    by_reduced: int = field(default=0, kw_only=True)
    by_model: int = field(default=0, kw_only=True)

    def shares(self, answers: str, close: str) -> str:
        """How many answers are whose, a sentence.

        Args:
            answers: what they are called.
            close: how close those of the reduced model are, a clause.
        """
        count = self.by_reduced + self.by_model
        if not self.by_reduced:
            return f"All {count:,} {answers} are those of the full model."
        rest = "none is" if not self.by_model else f"{self.by_model:,} are"
        return (
            f"{self.by_reduced:,} of {count:,} {answers} are those of {self.whose}, whose "
            f"{close}; {rest} of the full model."
        )


@dataclass
class ReducedAnswers(ByReducedModel):
    """Answers whose readings all are close enough.

    Args:
        split: how many of its readings are those that are used.
        limit: (g + m,) by how much a reading may be off, SI.
        elsewhere: the model.
    """

    split: int
    limit: Floats
    elsewhere: Compute

    def __call__(self, points: Floats) -> Iterator[Answer]:
        """Answers at p (k, n), SI, in their order."""
        for first in range(0, len(points), _AT_ONCE):
            some = points[first : first + _AT_ONCE]
            values, error = self.reduced.estimated(some)
            close = np.all((error <= self.limit) & np.isfinite(values), axis=1)
            full = iter(self.elsewhere(some[~close]))
            for v, near in zip(values, close, strict=True):
                if near:
                    self.by_reduced += 1
                    yield Answer(v[: self.split], v[self.split :])
                else:
                    self.by_model += 1
                    yield next(full)

    @property
    def note(self) -> str:
        """How many answers are whose, a sentence."""
        off = f"at most {100 * CLOSE:.2g} % of their accuracies"
        return self.shares("evaluations", f"readings are estimated to be off by {off}")


def reduced_answers(
    asked: Asked,
    centre: Floats,
    training: Floats,
    accuracy: Floats,
    elsewhere: Compute,
    kept: RestoredModel | None = None,
) -> ReducedAnswers | None:
    """Answers of a model with the help of its reduced one; None where it has none.

    Args:
        asked: the model, and what it is asked for.
        centre: (n,) parameters in the middle of what will be asked.
        training: (k, n) some of what will be asked.
        accuracy: (g + m,) of the used readings and of all that can be read, SI.
        elsewhere: answers of the model.
        kept: a reduced model that was made before: none is made where it gives all that is asked.
    """
    response, split = asked.everything, len(accuracy) - len(asked.places)
    whose = MADE
    if kept is not None and kept.covers(asked.pairs):
        whose, reduced = OF_FIT, kept.response(asked.pairs, asked.times)
    elif isinstance(response, ReducibleResponse):
        made = reduced_around(response, centre, training)
        if made is None:
            return None
        reduced = made
    else:
        return None
    return ReducedAnswers(reduced, split, CLOSE * accuracy, elsewhere, whose=whose)
