import numpy as np
import pytest

from geoident.identify.problem.problem import Problem
from geoident.model.results.costs import Counts


class Formula:
    """A response from a formula of complex numbers: exact Jacobian by complex steps, counted."""

    def __init__(self, function, names, refuse=lambda p: None):
        self.function, self.names, self.refuse = function, names, refuse
        self.evaluations = 0

    @property
    def counts(self):
        return Counts(evaluations=self.evaluations)

    def admissible(self, p):
        return self.refuse(p)

    def readings(self, p):
        self.evaluations += 1
        return np.real(self.function(p.astype(complex)))

    def evaluate(self, p):
        v = self.readings(p)
        tiny = 1e-30 * np.maximum(np.abs(p), 1e-3)
        columns = [np.imag(self.function(p + 1j * h)) / h.sum() for h in np.diag(tiny)]
        return v, np.stack(columns, axis=1)


@pytest.fixture
def make_problem():
    def make(function, parameters, measured, sd, refuse=lambda p: None):
        measured = np.asarray(measured, dtype=float)
        response = Formula(function, tuple(q.name for q in parameters), refuse)
        return Problem(
            response, measured, np.broadcast_to(sd, measured.shape).astype(float), tuple(parameters)
        )

    return make
