"""The table of the parameters of a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.identify.assessment.uncertainty import Assessment
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter
from geoident.model.result import ParameterTable


def parameter_table(
    parameters: Sequence[Parameter], values: Floats, assessment: Assessment
) -> ParameterTable:
    """The parameters at their values with what is known of them.

    Args:
        parameters: the n unknowns.
        values: (n,) SI.
        assessment: how well they are known.
    """
    return replace(
        bare_parameter_table(parameters, values),
        sd=assessment.sd,
        lower95=assessment.lower95,
        upper95=assessment.upper95,
        at_bound=assessment.at_bound,
        determined=assessment.determined,
        covariance=assessment.covariance,
        correlation=assessment.correlation,
    )


def bare_parameter_table(parameters: Sequence[Parameter], values: Floats) -> ParameterTable:
    """The parameters at their values (n,) where nothing was asked about their uncertainty."""
    n = len(parameters)
    unknown = np.full(n, np.nan)
    bounds = np.array([(q.lower, q.upper) for q in parameters], dtype=np.float64).reshape(n, 2)
    return ParameterTable(
        names=tuple(q.name for q in parameters),
        values=values,
        sd=unknown,
        lower95=unknown,
        upper95=unknown,
        lower=bounds[:, 0],
        upper=bounds[:, 1],
        start=np.array([q.start for q in parameters], dtype=np.float64),
        at_bound=np.any(bounds == values[:, None], axis=1),
        determined=np.ones(n, dtype=np.bool_),
        priors=tuple(q.prior for q in parameters),
        units=tuple(q.unit for q in parameters),
        dimensions=tuple(q.dimension for q in parameters),
        covariance=np.full((n, n), np.nan),
        correlation=np.full((n, n), np.nan),
    )
