"""The errors of the readings of all sections: of their gauges, and of models that have one cause.

How far the model is from the ground, and how far the gauges scatter, are found for all sections
together at the parameters that they share (theory 15.3): a section by itself takes what all models
lack for its own parameters, and one with few readings cannot tell at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.special import chdtri

from geoident.identify.assessment.later_readings import LaterReadings, given_used
from geoident.identify.assessment.model_error import weigh_all
from geoident.identify.assessment.variance_components import seen_likelihood
from geoident.identify.hierarchical.error_sizes import (
    NODES,
    AccuracyOff,
    CommonCourse,
    SectionResiduals,
    SizesLikelihood,
    accuracies_off,
    course_root,
    likeliest_sizes,
)
from geoident.identify.hierarchical.joint_problem import SectionModels
from geoident.identify.hierarchical.search import HierarchicalFit
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Floats, Ints
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.costs import Counts
from geoident.workflow.estimating.model_error import ENOUGH, NAME, percent
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


def weighed_together(
    fit: HierarchicalFit,
    answers: Sequence[tuple[Floats, Floats]],
    errors: Sequence[ErrorsAt],
    common: CommonErrors,
    before: CommonSizes | None,
) -> CommonSizes:
    """The sizes of the errors of all sections, from their residuals at a fit.

    The restricted likelihood is that of theory 9.2 over all unknowns of the project; the deviations
    from laws are priors.

    Args:
        fit: of the sections.
        answers: of each what its model says of the readings (g,) that are used, with derivatives
            (g, n), SI.
        errors: of these.
        common: what they have in common.
        before: sizes to begin with; None for none.
    """
    estimated = [each.section.stated.kind == "estimate" for each in errors]
    readings = sum(len(each.section.rows) for each in errors)
    own = fit.joint.n_common - len(common.names)
    if not any(estimated) or readings < own + ENOUGH:
        return STATED
    scatters = all(each.section.scatters for each in errors)
    gap, J, priors = _linearised(fit, answers, common)
    if common.names:
        zeroed = scatters and any(each.zeros.shape[1] for each in errors)
        free = np.array([True, scatters, zeroed, True, True, True])
        begin = _FIRST if before is None or before == STATED else before
        start = np.where(free, astuple(begin), astuple(STATED))
        of_sizes = sizes_likelihood(gap, J, priors, errors, common)
        return CommonSizes(*likeliest_sizes(of_sizes, start, free).tolist())
    structure = _stacked([each.sized(STATED) for each in errors])  # with errors that are given
    models = [
        each.model if free else each.model[:, :0]
        for each, free in zip(errors, estimated, strict=True)
    ]
    likelihood = seen_likelihood(
        structure,
        structure.sd,
        np.concatenate(gap),
        (np.concatenate(J), priors[0]),
        priors[1],
    )
    zeros = _diagonal([each.zeros for each in errors])
    weighed = weigh_all(
        likelihood, _diagonal(models), zeros if zeros.shape[1] else None, free=scatters
    )
    return CommonSizes(weighed.size, weighed.factor, weighed.zero)


_FIRST = CommonSizes(0.1, 1.2, 1.0, 0.1, 0.1, 1.0)
"""Where the search for sizes begins."""


def _linearised(
    fit: HierarchicalFit, answers: Sequence[tuple[Floats, Floats]], common: CommonErrors
) -> tuple[list[Floats], list[Floats], tuple[Floats, Floats]]:
    """All sections at a fit, without the unknowns that they have in common of their errors.

    Returns:
        Of each section its residuals (g,) and their derivatives (g, q) by the free unknowns on
        their scales, SI; the rows of priors and laws likewise (k, q), and their residuals (k,).
    """
    joint, values = fit.joint, fit.outcome.values
    scaling = Scaling(joint.unknowns)
    dp_dx = scaling.dp_dx(values)
    of_errors = np.array([q.name in common.names for q in joint.unknowns], dtype=np.bool_)
    lower, upper = fit.problem.bounds
    free = (values > lower) & (values < upper) & ~of_errors
    gap = [s.measured - v for s, (v, _) in zip(joint.sections, answers, strict=True)]
    J = [
        (jacobian @ joint.point(k, values)[1][: jacobian.shape[1]] * dp_dx)[:, free]
        for k, (_, jacobian) in enumerate(answers)
    ]
    deviation, rows = joint.law_rows(values)
    tau = fit.problem.sd[len(fit.problem.sd) - len(deviation) :, None]
    kept = [k for k, (i, _) in enumerate(scaling.priors) if not of_errors[i]]
    prior_rows = [scaling.prior_jacobian(values)[kept], rows * dp_dx / tau]
    prior = np.concatenate([scaling.prior_residuals(values)[kept], deviation / tau[:, 0]])
    return gap, J, (np.concatenate(prior_rows)[:, free], prior)


def sizes_likelihood(
    gap: Sequence[Floats],
    J: Sequence[Floats],
    priors: tuple[Floats, Floats],
    errors: Sequence[ErrorsAt],
    common: CommonErrors,
) -> SizesLikelihood:
    """The likelihood of the sizes of the errors of sections that are followed in time.

    Of a section with many readings some tell enough of them.

    Args:
        gap: of each section its residuals (g,), SI.
        J: their derivatives (g, q) by the unknowns on their scales.
        priors: rows (k, q) and residuals (k,).
        errors: of the readings.
        common: what they have in common.
    """
    sections = []
    for y, jacobian, whole in zip(gap, J, errors, strict=True):
        kept = np.unique(np.linspace(0, len(y) - 1, min(len(y), _MOST_READINGS)).astype(np.int64))
        each, known = whole.only(kept), whole.section.stated
        model = _covariance(each.model) + np.diag(each.left**2)
        stated = each.stated
        sections.append(
            SectionResiduals(
                y[kept],
                jacobian[kept],
                np.diag(stated.sd**2) + _covariance(stated.columns),
                _covariance(each.zeros),
                model if known.kind == "estimate" else 0.0 * model,
                known.size**2 * model if known.kind == "given" else 0.0 * model,
                each.moved,
                each.section.moments,
                common.kinds(each.section),
            )
        )
    return SizesLikelihood(sections, common.course, priors)


def doubtful_accuracies(
    fit: HierarchicalFit,
    answers: Sequence[tuple[Floats, Floats]],
    errors: Sequence[ErrorsAt],
    common: CommonErrors,
    sizes: CommonSizes,
) -> dict[int, AccuracyOff]:
    """Sections (by their numbers in the fit) whose accuracies are off.

    Nothing is said of sections whose gauges have their accuracies estimated.

    Args:
        fit: of the sections.
        answers: of each what its model says of the readings that are used, with derivatives, SI.
        errors: of these.
        common: what they have in common.
        sizes: of the errors.
    """
    if len(errors) < _FEWEST or any(each.stated.names for each in errors):
        return {}
    gap, J, priors = _linearised(fit, answers, common)
    likelihood = sizes_likelihood(gap, J, priors, errors, common)
    gain = float(chdtri(1, _UNLIKELY / len(errors)))
    return accuracies_off(likelihood, np.array(astuple(sizes)), gain)


_FEWEST, _MOST_READINGS = 3, 400
"""Sections that can tell of one of them; readings of a section by which sizes are told."""

_UNLIKELY = 0.001
"""Probability that any of sound sections is named."""


def _covariance(columns: sp.csr_array) -> Floats:
    return np.asarray((columns @ columns.T).toarray())


def _diagonal(blocks: Sequence[sp.csr_array]) -> sp.csr_array:
    return sp.csr_array(sp.block_diag(blocks, format="csr"))


def _stacked(structures: Sequence[ErrorStructure]) -> ErrorStructure:
    """The errors of several sections, which share none."""
    columns = _diagonal([one.columns for one in structures])
    none = np.full(columns.shape[1], -1, dtype=np.int64)
    sd = np.concatenate([one.sd for one in structures])
    return ErrorStructure(sd, np.full(len(sd), -1, dtype=np.int64), columns, none, ())


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
