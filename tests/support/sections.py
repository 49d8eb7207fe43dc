"""Sections by formulas: no mesh, no files."""

from dataclasses import dataclass, field

import numpy as np

from geoident.identify.hierarchical.joint_problem import SectionReadings
from geoident.model.parameter import Parameter
from geoident.model.project.formulas import LawTerm
from geoident.model.project.project import ParameterLaw, Scatter
from geoident.model.results.costs import Counts


def name(text):
    return LawTerm("name", name=text)


def times(*terms):
    first, *rest = terms
    return LawTerm("*", (first, times(*rest))) if rest else first


EXPONENTIAL = times(name("a"), LawTerm("exp", (times(name("b"), name("GSI")),)))
"""a exp(b GSI)"""


@dataclass
class Formulas:
    """Models of sections that are functions p -> (v, J)."""

    functions: tuple
    asked: list = field(default_factory=list)

    @property
    def counts(self):
        return Counts(evaluations=sum(map(len, self.asked)))

    def evaluate(self, points):
        self.asked.append(dict(points))
        return {s: self.functions[s](p) for s, p in points.items()}

    def sharpen(self, points):
        return False


def linear_model(matrix):
    return lambda p: (matrix @ p, matrix)


def level(scatter="estimate", size=0.0):
    """The law z = m."""
    m = Parameter("m", start=0.3, lower=-1e3, upper=1e3)
    return ParameterLaw("z", "m", name("m"), (m,), Scatter(scatter, size))


def modulus_law(scatter="estimate", size=0.0):
    """The law E = a exp(b GSI)."""
    constants = (
        Parameter("a", start=1.0, lower=0.01, upper=100.0, scale="log"),
        Parameter("b", start=0.02, lower=-0.2, upper=0.2),
    )
    return ParameterLaw("E", "a exp(b GSI)", EXPONENTIAL, constants, Scatter(scatter, size))


E = Parameter("E", start=5.0, lower=0.05, upper=500.0, scale="log")
K0 = Parameter("K0", start=1.0, lower=0.1, upper=4.0)
Z = Parameter("z", start=0.3, lower=-1e3, upper=1e3)


def section(name_, parameters, measured, sd, **covariates):
    count = len(measured)
    return SectionReadings(
        name_, parameters, covariates, np.asarray(measured), np.broadcast_to(sd, count) * 1.0
    )


def quiet(iteration):
    """An observer that never stops a search."""
