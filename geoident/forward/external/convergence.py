"""A case whose readings a convergence law gives, with exact derivatives (theory 4.9)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.external.differences import Linear
from geoident.forward.external.model import ExternalModel
from geoident.forward.external.runs import ComputedRuns
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.external import ConvergenceLaw
from geoident.model.parameter import Scalar, Values


def convergence(law: ConvergenceLaw, values: Values, names: Sequence[str] = ()) -> Dual:
    """C (n_stages, n_channels) since the ground was undisturbed, and its derivatives.

    NaN before the face has passed the section.

    Args:
        law: the law.
        values: of the parameters, SI.
        names: of the parameters by which to differentiate.
    """
    point = ParameterPoint(values, names)
    limit, reach = _numbers(point, law.limit), _numbers(point, law.range)
    ratio = reach / reach.plus(law.distance)
    closure = limit * (1.0 - ratio * ratio)
    if law.creep is None:
        return closure
    size, time, exponent = (
        _numbers(point, each) for each in (law.creep.size, law.creep.time, law.creep.exponent)
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
    limit = _numbers(point, law.limit)
    return limit if law.creep is None else limit * _numbers(point, law.creep.size).plus(1.0)


def _numbers(point: ParameterPoint, scalars: Sequence[Scalar]) -> Dual:
    columns = [point.number(scalar).columns for scalar in scalars]
    return Dual(np.array(columns).reshape(-1, point.n_columns))  # also of no gauge


class LawRuns(ComputedRuns):
    """Readings by a convergence law, with exact derivatives.

    Args:
        case: the case.
        law: of the case.
    """

    def __init__(self, case: Case, law: ConvergenceLaw) -> None:
        self._law = law
        self._names = tuple(parameter.name for parameter in case.parameters)
        self.seen: Bools = np.array([name in law.seen for name in self._names], dtype=bool)
        self.given: Bools = np.isfinite(law.distance)

    def computed(self, p: Floats) -> Floats:
        """Convergences (n_stages, n_channels), SI, at p (n,); NaN before the face has passed."""
        return convergence(self._law, self._values(p)).value

    def derivatives(self, p: Floats) -> Floats:
        """Their derivatives (n_stages, n_channels, n) at p (n,)."""
        return convergence(self._law, self._values(p), self._names).columns[..., 1:]

    def _values(self, p: Floats) -> dict[str, float]:
        return dict(zip(self._names, map(float, p), strict=True))


class LawModel(ExternalModel):
    """A case whose readings a convergence law gives.

    Args:
        case: the case.
        law: of the case.
    """

    def __init__(self, case: Case, law: ConvergenceLaw) -> None:
        super().__init__(case, LawRuns(case, law))
        self.law = law

    def linear(self, p: Floats, *, exact: bool = False) -> Linear:
        """What the law gives at p (n,), (m,), and its derivatives.

        Args:
            p: (n,) parameters.
            exact: of no effect: derivatives are exact.
        """
        columns = convergence(self.law, self.values(p), self.names).columns[self.runs.given]
        self.differences.values(p)  # counts the evaluation
        return Linear(p, columns[:, 0], columns[:, 1:])

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
