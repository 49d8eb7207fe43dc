"""A case whose readings a convergence law gives, with exact derivatives (theory 4.9)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.external.model import ExternalModel
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.external import ConvergenceLaw
from geoident.model.parameter import Values


def convergence(law: ConvergenceLaw, values: Values, names: Sequence[str] = ()) -> Dual:
    """C (n_stages, n_channels) since the ground was undisturbed, and its derivatives.

    NaN before the face has passed the section.

    Args:
        law: the law.
        values: of the parameters, SI.
        names: of the parameters by which to differentiate.
    """
    point = ParameterPoint(values, names)
    limit, reach = point.numbers(law.limit), point.numbers(law.range)
    ratio = reach / reach.plus(law.distance)
    closure = limit * (1.0 - ratio * ratio)
    if law.creep is None:
        return closure
    size, time, exponent = (
        point.numbers(each) for each in (law.creep.size, law.creep.time, law.creep.exponent)
    )
    left = (time / time.plus(law.age)).power(exponent)
    return closure * (size * (1.0 - left)).plus(1.0)


def final_convergence(law: ConvergenceLaw, values: Values, names: Sequence[str] = ()) -> Dual:
    """C_inf (1 + m), (n_channels,): far from the face, in the end, and its derivatives.

    Args:
        law: the law.
        values: of the parameters, SI.
        names: of the parameters by which to differentiate.
    """
    point = ParameterPoint(values, names)
    limit = point.numbers(law.limit)
    return limit if law.creep is None else limit * point.numbers(law.creep.size).plus(1.0)


class LawModel(ExternalModel):
    """A case whose readings a convergence law gives.

    Args:
        case: the case.
        law: of the case.
    """

    def __init__(self, case: Case, law: ConvergenceLaw) -> None:
        seen = np.array([parameter.name in law.seen for parameter in case.parameters], dtype=bool)
        super().__init__(case, np.isfinite(law.distance), seen)
        self.law = law

    def given_readings(self, p: Floats, *, derivatives: bool, exact: bool) -> Floats:
        """Convergences at p (n,); NaN before the face has passed."""
        names = self.names if derivatives else ()
        return convergence(self.law, self.values(p), names).columns

    def lost(self, p: Floats) -> Dual:
        """Convergence before the first reading, (n_channels,), and its derivatives; 0 for none.

        Args:
            p: (n,) parameters.
        """
        columns = convergence(self.law, self.values(p), self.names).columns
        before = np.concatenate([np.zeros((1, *columns.shape[1:])), columns])
        zero = self.rule.zero
        return Dual(before[zero, np.arange(len(zero))])

    def final(self, p: Floats) -> Dual:
        """All of the convergence in the end, (n_channels,), and its derivatives.

        Args:
            p: (n,) parameters.
        """
        return final_convergence(self.law, self.values(p), self.names)
