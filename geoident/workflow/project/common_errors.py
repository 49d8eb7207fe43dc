"""What the courses in time of all sections have in common, as unknowns of the fit (theory 15.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.hierarchical.error_sizes import (
    NODES,
    CommonCourse,
)
from geoident.identify.hierarchical.joint_problem import SectionModels
from geoident.model.arrays import Floats, Ints
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.costs import Counts
from geoident.workflow.project.errors import CommonSizes
from geoident.workflow.project.sections import SectionErrors


@dataclass(frozen=True)
class CommonErrors:
    """What the courses in time of all sections have in common: unknowns of the fit (theory 15.3).

    Args:
        course: by which unknowns it is known.
        numbers: of the kinds of readings by their names.
    """

    course: CommonCourse
    numbers: Mapping[str, int]

    @classmethod
    def of(cls, sections: Sequence[SectionErrors]) -> CommonErrors:
        """Of sections on one clock."""
        moments = np.concatenate([one.moments[one.follows] for one in sections])
        kinds = [name for one in sections for name in one.families]
        numbers = {name: k for k, name in enumerate(dict.fromkeys(kinds))}
        if not len(moments):
            return cls(CommonCourse(np.zeros(0), 0), numbers)
        nodes = np.linspace(moments.min(), max(moments.max(), moments.min() + 0.1), NODES)
        return cls(CommonCourse(nodes, len(numbers)), numbers)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the r unknowns, none of which a case can have."""
        return tuple(
            f"common error {k + 1}" for k in range(len(self.course.nodes) * self.course.kinds)
        )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The r unknowns."""
        prior = Prior(0.0, 1.0)
        return tuple(Parameter(name, 0.0, -_WIDE, _WIDE, prior=prior) for name in self.names)

    def basis(self, section: SectionErrors, sizes: CommonSizes) -> Floats:
        """What each unknown adds to the readings (l, r) of a section, in parts of these."""
        if not self.names:
            return np.zeros((len(section.rows), 0))
        made = self.course.basis(section.moments, self.kinds(section), sizes.memory)
        return np.asarray(sizes.common * made * section.follows[:, None])

    def kinds(self, section: SectionErrors) -> Ints:
        """(l,) numbers of what the readings of a section are."""
        return np.array([self.numbers[name] for name in section.families], dtype=np.int64)


_WIDE = 10.0
"""Standard deviations that no unknown of variance one is off."""


@dataclass(frozen=True)
class WithCommonErrors:
    """Models of sections whose readings are v (1 + basis z), z the last parameters of each.

    Args:
        models: that give v.
        basis: number of each section to its (g, r).
    """

    models: SectionModels
    basis: Mapping[int, Floats]

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self.models.counts

    def evaluate(self, points: Mapping[int, Floats]) -> Mapping[int, tuple[Floats, Floats]]:
        """Readings (g,) of some sections and their Jacobians (g, n + r)."""
        answers = self.models.evaluate(self._of_models(points))
        return {
            k: with_common(answers[k], self.basis[k], p[len(p) - self.basis[k].shape[1] :])
            for k, p in points.items()
        }

    def sharpen(self, points: Mapping[int, Floats]) -> bool:
        """Improve Jacobians that are differences; returns whether any could be improved."""
        return self.models.sharpen(self._of_models(points))

    def _of_models(self, points: Mapping[int, Floats]) -> dict[int, Floats]:
        return {k: p[: len(p) - self.basis[k].shape[1]] for k, p in points.items()}


def with_common(answer: tuple[Floats, Floats], basis: Floats, z: Floats) -> tuple[Floats, Floats]:
    """Readings (g,) and Jacobians (g, n) of a model with the common error z (r,): (g, n + r)."""
    v, J = answer
    factor = 1.0 + basis @ z
    return v * factor, np.concatenate([factor[:, None] * J, v[:, None] * basis], axis=1)


def on_one_clock(sections: Sequence[SectionErrors]) -> tuple[SectionErrors, ...]:
    """The same with moments that mean the same in all: of the longest correlation time of any."""
    longest: dict[str, float] = {}
    for one in sections:
        if one.time is not None:
            longest[one.time.unit] = max(longest.get(one.time.unit, 0.0), one.time.size)
    return tuple(
        one
        if one.time is None
        else replace(
            one,
            steps=replace(
                one.steps,
                moments=np.log1p(np.expm1(one.moments) * one.time.size / longest[one.time.unit]),
            ),
            time=replace(one.time, size=longest[one.time.unit]),
        )
        for one in sections
    )
