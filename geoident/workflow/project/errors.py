"""The errors of the readings of all sections: of their gauges, and of models that have one cause.

How far the model is from the ground, and how far the gauges scatter, are found for all sections
together at the parameters that they share (theory 15.3): a section by itself takes what all models
lack for its own parameters, and one with few readings cannot tell at all.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.later_readings import LaterReadings, given_used
from geoident.identify.hierarchical.error_sizes import (
    course_root,
)
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Floats, Ints
from geoident.workflow.estimating.model_error import NAME, percent
from geoident.workflow.estimating.model_error_covariance import ErrorModes, shared_columns
from geoident.workflow.estimating.model_error_search import SCATTER, ZERO, zero_columns
from geoident.workflow.project.sections import PreparedSection, SectionErrors
from geoident.workflow.running.readings import error_structure

MadeOf = tuple[Floats, Floats]
"""Steps and floors (l, n_states) of the model error of the readings that are shown, SI."""


@dataclass(frozen=True)
class CommonSizes:
    """How large the errors of all sections are.

    Args:
        size: eta of the model errors that cases want estimated.
        factor: by which gauges scatter more than stated.
        zero: error of the zeros that are not stated, in accuracies times that factor.
        course: of the course in time of each section, in parts of its motion; 0 for none.
        common: of that of all sections together.
        memory: over which these are correlated, in moments.
    """

    size: float
    factor: float
    zero: float
    course: float = 0.0
    common: float = 0.0
    memory: float = 1.0

    def of(self, section: SectionErrors) -> float:
        """Eta of a section, whose case may state it."""
        stated = section.stated
        return {"given": stated.size, "none": 0.0, "estimate": self.size}[stated.kind]

    def sentence(self) -> str:
        """In words, for who reads the result."""
        if self == STATED:
            return (
                "The sections have too few readings to say how well their models describe the "
                "ground: intervals and bands are those of models without error. 'model_error: "
                "15 %' under 'fit' of their cases assumes one."
            )
        in_time = ""
        if self.course or self.common:
            in_time = (
                f"a course in time that is off by {percent(self.course)} in each section by itself "
                f"and by {percent(self.common)} in all of them alike, "
            )
        return (
            f"All sections together show a model error of {percent(self.size)} of the motion, "
            f"{in_time}"
            f"gauges that scatter {self.factor:.2g} times as much as stated, and zeros that are "
            f"off by {self.zero:.2g} accuracies. Intervals and bands are those of these errors; if "
            "you expect a larger model error, write 'model_error: 30 %' under 'fit' of the cases."
        )

    def halfway(self, other: CommonSizes) -> CommonSizes:
        """Between both."""
        return CommonSizes(
            *(0.5 * (a + b) for a, b in zip(astuple(self), astuple(other), strict=True))
        )

    def near(self, other: CommonSizes) -> bool:
        """Whether intervals hardly notice the difference: one per cent."""
        pairs = zip(astuple(self), astuple(other), strict=True)
        return all(abs(a - b) <= _AT_REST * max(a, b, _LITTLE) for a, b in pairs)


STATED = CommonSizes(0.0, 1.0, 0.0)
"""Gauges as accurate as stated, and no model error that is not given."""

_AT_REST, _LITTLE = 0.01, 0.1
"""Part by which sizes may still change, and the size below which changes do not count as such."""


@dataclass(frozen=True)
class ErrorsAt:
    """The errors of the readings that are shown of a section, at some parameters.

    Args:
        stated: of its gauges.
        zeros: (l, k) columns of those of zeros as large as the accuracies, SI.
        model: (l, r) columns of that of the model at eta = 1, SI.
        left: (l,) own standard deviations that stand for what these leave out, SI.
        moved: (l,) what errors of the course in time are in parts of, SI; 0 where there are none.
        section: what is known of its readings.
    """

    stated: ErrorStructure
    zeros: sp.csr_array
    model: sp.csr_array
    left: Floats
    moved: Floats
    section: SectionErrors

    @classmethod
    def of(cls, section: SectionErrors, made_of: MadeOf) -> ErrorsAt:
        """Of a section whose model error is made of this."""
        steps, floors = made_of
        modes = ErrorModes()
        columns = sp.csr_array((len(section.rows), 0))
        left = np.zeros(len(section.rows))
        if section.stated.kind != "none" and np.any(steps):
            known = replace(section.steps, steps=steps, floors=floors)
            columns, left = shared_columns([known], section.length, modes), modes.left
        channels = tuple(channel for channel, _ in section.rows)
        zeros = zero_columns(channels) if section.scatters else None
        if zeros is None:
            zeros = sp.csr_array((len(channels), 0))
        moved = np.where(section.follows, steps.sum(axis=1), 0.0)
        return cls(error_structure(section.rows), zeros, columns, left, moved, section)

    def used(self) -> ErrorsAt:
        """Those of the readings that are used."""
        return self.only(np.flatnonzero(self.section.used))

    def only(self, kept: Ints) -> ErrorsAt:
        """Those of some of the readings (m,)."""
        return replace(
            self, stated=self.stated.rows(kept), zeros=self.zeros[kept], model=self.model[kept],
            left=self.left[kept], moved=self.moved[kept], section=self.section.of(kept),
        )  # fmt: skip

    def sized(self, sizes: CommonSizes) -> ErrorStructure:
        """All of them."""
        structure, factors = self.stated, [1.0] * len(self.stated.names)
        if self.section.scatters:
            structure = structure.with_one_factor(SCATTER).with_component(self.zeros, ZERO)
            factors = [sizes.factor, sizes.factor * sizes.zero]
        eta = sizes.of(self.section)
        whole = structure.with_component(self.model, NAME)
        whole = whole.sized(2.0 * np.log(np.maximum([*factors, eta], _NOTHING)))
        if sizes.course and self.section.follows.any():
            _, kinds = np.unique(self.section.families, return_inverse=True)
            root = course_root(self.section.moments, kinds, sizes.memory)
            columns = sp.csr_array(sizes.course * self.moved[:, None] * root)
            whole = whole.with_component(columns, COURSE)
        return replace(whole, sd=np.hypot(whole.sd, eta * self.left))

    def like_others(self, sizes: CommonSizes) -> tuple[Floats, Floats]:
        """Standard deviations (l,) of readings of which none is known: of gauges, of the model."""
        gauges = self.sized(sizes)
        of_model = sizes.of(self.section) * np.sqrt(_squares(self.model))
        of_model = np.hypot(of_model, sizes.course * self.moved)
        square = gauges.sd**2 + _squares(gauges.columns) - of_model**2
        return np.sqrt(np.maximum(square, 0.0)), of_model


def _squares(columns: sp.csr_array) -> Floats:
    """(l,) sums of the squares of rows."""
    return np.asarray(columns.multiply(columns).sum(axis=1)).ravel()


_NOTHING = 1e-6
"""Size that stands for none."""

COURSE = "course in time"
"""Component of what the course of each section is off."""


def shown_given_used(
    section: PreparedSection,
    errors: ErrorStructure,
    problem: Problem,
    used: tuple[Floats, Floats],
    shown_jacobian: Floats,
) -> LaterReadings:
    """All readings that are shown of a section that was fitted, as those used imply them.

    Args:
        section: the section.
        errors: of the readings that are shown.
        problem: of all sections.
        used: what the model says of the readings used (g,), with derivatives (g, n), SI.
        shown_jacobian: derivatives (l, n) of those shown, SI.
    """
    of_used = errors.rows(np.flatnonzero(section.errors.used))
    sd, shared = of_used.stated
    own = replace(problem, measured=section.measured, sd=sd, shared=shared)
    return given_used(own, *used, later=errors, later_jacobian=shown_jacobian)
