"""How large the errors of all sections are, at the parameters that these share (theory 15.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple

import numpy as np
import scipy.sparse as sp
from scipy.special import chdtri

from geoident.identify.assessment.model_error import weigh_all
from geoident.identify.assessment.variance_components import seen_likelihood
from geoident.identify.hierarchical.error_sizes import (
    AccuracyOff,
    SectionResiduals,
    SizesLikelihood,
    accuracies_off,
    likeliest_sizes,
)
from geoident.identify.hierarchical.search import HierarchicalFit
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Floats
from geoident.workflow.estimating.model_error import ENOUGH
from geoident.workflow.project.common_errors import CommonErrors
from geoident.workflow.project.errors import STATED, CommonSizes, ErrorsAt


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
