"""Three sections in which nothing is one, zero, alike or square, and their dense problem.

Different parameters in different orders, two laws of two kinds, a shared parameter, priors of what
is common and of what is a section's own, shared errors of readings, and a point off the laws.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import scipy.sparse as sp

from geoident.identify.hierarchical.joint_problem import JointUnknowns, SectionReadings
from geoident.identify.hierarchical.restricted_likelihood import LinearSections
from geoident.identify.hierarchical.search import HierarchicalFit
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.parameter import Parameter, Prior
from geoident.model.project.formulas import LawTerm
from geoident.model.project.project import ParameterLaw, Scatter
from support.sections import EXPONENTIAL, Formulas, name, times

E = Parameter("E", 5.0, 0.05, 500.0, "log")
K0 = Parameter("K0", 1.2, 0.1, 4.0, prior=Prior(1.1, 0.3))
H = Parameter("h", 3.0, -40.0, 60.0)
NU = Parameter("nu", 0.25, 0.05, 0.45, prior=Prior(0.22, 0.05))
C = Parameter("c", 2.0, 0.2, 90.0, "log")

MODULUS = ParameterLaw(
    "E", "a exp(b GSI)", EXPONENTIAL,
    (
        Parameter("a", 1.0, 0.01, 100.0, "log"),
        Parameter("b", 0.02, -0.2, 0.2, prior=Prior(0.03, 0.004)),
    ),
    Scatter("given", 0.3),
)  # fmt: skip
HEAD = ParameterLaw(
    "h", "m + n D", LawTerm("+", (name("m"), times(name("n"), name("D")))),
    (Parameter("m", 4.0, -70.0, 70.0), Parameter("n", 0.5, -9.0, 9.0, prior=Prior(0.4, 0.2))),
    Scatter("given", 1.5),
)  # fmt: skip

ORDERS = ((E, K0, NU, H), (K0, H, E), (C, E, NU, K0, H))
COVARIATES = ({"GSI": 31.0, "D": 2.0}, {"GSI": 47.0, "D": -1.5}, {"GSI": 58.0, "D": 3.2})
COUNTS = (7, 5, 9)
SCALE = {"E": None, "c": None, "K0": 1.2, "h": 10.0, "nu": 0.25}
"""References: |start|, at least a tenth of the width; None for logarithms."""

COMMON = {"K0": 1.2, "a": None, "b": 0.04, "m": 14.0, "n": 1.8}
LARGEST = np.array([np.log(500.0 / 0.05), 100.0 / 10.0]) / np.sqrt(12.0)
TAU = np.array([0.3, 0.15])


def formula(matrix):
    """v = M g(p), g = p^1.3, and its Jacobian."""
    return lambda p: (matrix @ np.abs(p) ** 1.3, matrix * (1.3 * np.abs(p) ** 0.3 * np.sign(p)))


class Site:
    """The sections, their unknowns, a point and all that is linear there."""

    def __init__(self, scattering=(True, True)):
        rng = np.random.default_rng(3)
        self.points = [
            np.array([{"E": 4.0, "K0": 1.35, "nu": 0.27, "h": 5.5, "c": 3.0}[q.name] * more
                      for q in order])
            for order, more in zip(ORDERS, (1.0, 1.1, 0.9), strict=True)
        ]  # fmt: skip
        for order, point in zip(ORDERS, self.points, strict=True):
            point[[q.name for q in order].index("K0")] = 1.35
        self.matrices = [rng.normal(size=(g, len(o))) for g, o in zip(COUNTS, ORDERS, strict=True)]
        sections, functions = [], []
        for s, (order, matrix) in enumerate(zip(ORDERS, self.matrices, strict=True)):
            functions.append(formula(matrix))
            v, _ = functions[-1](self.points[s])
            sd = rng.uniform(0.3, 0.9, len(v))
            B = rng.normal(size=(len(v), 2)) * 0.7
            shared = SharedErrors(sp.csr_array(B)) if s == 1 else None
            y = v + rng.normal(size=len(v))
            sections.append(SectionReadings(f"S{s}", order, COVARIATES[s], y, sd, shared))
        self.sections = sections
        self.models = Formulas(tuple(functions))
        self.laws = (MODULUS, HEAD)
        self.joint = JointUnknowns(sections, ["K0"], self.laws, np.array(scattering))
        self.common = np.array([1.35, 1.4, 0.025, 3.0, 0.6])  # K0, a, b, m, n
        self.values = self.joint.joined(self.common, self.points)
        self.linear = LinearSections.at(self.joint, self.models, self.values)

    def fit(self, tau=TAU):
        outcome = SimpleNamespace(values=self.values)
        return HierarchicalFit(self.joint, None, outcome, tau, np.zeros(2, dtype=bool), self.linear)

    def law(self, s, f):
        """The laws at a section on the scales of E and h, of the scaled common unknowns f (5,)."""
        b, m, n = (f[k] * COMMON[name] for k, name in ((2, "b"), (3, "m"), (4, "n")))
        known = self.sections[s].covariates if s < 3 else FURTHER.covariates
        return {"E": f[1] + b * known["GSI"], "h": (m + n * known["D"]) / SCALE["h"]}

    @property
    def f(self):
        """What is common at the point, scaled."""
        size = [1.2, 1.0, 0.04, 14.0, 1.8]
        f = self.common / size
        f[1] = np.log(self.common[1])
        return f

    def follows(self, s, order):
        """Phi (n, 5) and Z (n, 2) by unit steps of what is common; where x is from the laws."""
        Phi, Z, gap = np.zeros((len(order), 5)), np.zeros((len(order), 2)), np.zeros(len(order))
        for i, q in enumerate(order):
            if q.name == "K0":
                Phi[i, 0] = 1.0
            elif q.name in "Eh":
                at = self.law(s, self.f)[q.name]
                Phi[i] = [self.law(s, self.f + unit)[q.name] - at for unit in np.eye(5)]
                Z[i, "Eh".index(q.name)] = 1.0
                p = self.points[s][i] if s < 3 else np.nan
                gap[i] = (np.log(p) if q.name == "E" else p / SCALE["h"]) - at
        return Phi, Z, gap

    def rows(self, s):
        """White rows (r, n) of a section by its x, with own priors, and what is left there."""
        one, p = self.sections[s], self.points[s]
        sigma = np.diag(one.sd**2)
        if one.shared is not None:
            B = one.shared.columns.toarray()
            sigma = sigma + B @ B.T
        white = np.linalg.inv(np.linalg.cholesky(sigma))
        v, J = self.models.functions[s](p)
        slope = [x if SCALE[q.name] is None else SCALE[q.name]
                 for q, x in zip(one.parameters, p, strict=True)]  # fmt: skip
        A, b = white @ (J * slope), white @ (one.measured - v)
        for i, q in enumerate(one.parameters):
            if q.name == "nu":
                row = np.zeros(len(p))
                row[i] = SCALE["nu"] / q.prior.sd
                A, b = np.vstack([A, row]), np.append(b, (q.prior.mean - p[i]) / q.prior.sd)
        return A, b

    def dense(self, tau, left_out=()):
        """-2 log L of all unknowns f, then of each section a and w; their mean and covariance.

        And for each section x = X theta (n, N), from the law.
        """
        own = [[i for i, q in enumerate(o) if q.name in ("nu", "c")] for o in ORDERS]
        N = 5 + 3 * (2 + 2)
        X, blocks, right = [], [], []
        for s, order in enumerate(ORDERS):
            Phi, Z, gap = self.follows(s, order)
            moved = np.zeros((len(order), N))
            moved[:, :5], first = Phi, 5 + 4 * s
            moved[:, first : first + 2] = Z * tau
            moved[own[s], first + 2 + np.arange(len(own[s]))] = 1.0
            X.append(moved)
            if s not in left_out:
                A, b = self.rows(s)
                blocks.append(A @ moved)
                right.append(b + A @ gap)
        prior = np.zeros((3, N))  # of K0, b and n
        ends = [(0, 1.2, 1.1, 0.3), (2, 0.04, 0.03, 0.004), (4, 1.8, 0.4, 0.2)]
        for row, (k, size, _, sd) in zip(prior, ends, strict=True):
            row[k] = size / sd
        right.append([(mean - self.common[k]) / sd for k, _, mean, sd in ends])
        rows, right = np.vstack([*blocks, prior]), np.concatenate(right)
        weak = np.full(N, 1e-9)
        weak[[5 + 4 * s + k for s in range(3) for k in (0, 1)]] = 1.0
        matrix = rows.T @ rows + np.diag(weak)
        covariance = np.linalg.inv(matrix)
        mean = covariance @ rows.T @ right
        least = right @ right - right @ rows @ mean
        return least + np.linalg.slogdet(matrix)[1], mean, covariance, X


FURTHER = SectionReadings(
    "new", (H, C, replace(K0, prior=None), E, NU), {"GSI": 40.0, "D": 1.1}, np.zeros(0), np.zeros(0)
)
