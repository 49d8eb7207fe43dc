"""What a model hands to identifiers: readings and equations, numbers and vectors.

Every model is a `Response`. Condensation takes `Condensed`. The formulations of the complementarity
method that solve all stages and parameters at once take a `BilinearSystem`, with unknowns x and
parameters p:

    R(x, p) = 0                              equations
    s(x, p) >= 0,  lam >= 0,  s^T lam = 0    slacks s and multipliers lam, some of the entries of x
    v(x, p)                                  readings

R, s and v are bilinear, y(x, p) = c_0 + A_0 x + sum_h p_h (c_h + A_h x), with sparse A. For given p
and lam the equations determine all other unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from geoident.model.arrays import Floats, Ints
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity


@runtime_checkable
class Response(Protocol):
    """A model that answers with readings: gauss-newton, simplex and scan need only this.

    Parameter vectors p are in SI, in the order of ``names``; readings v(p) in one fixed order.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""

    @property
    def counts(self) -> Counts:
        """Costs so far."""

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain of the model, or None if it is inside."""

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,). Raises `geoident.errors.ModelError` where the model has no solution."""

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its exact Jacobian, (g, n)."""


@dataclass(frozen=True)
class Evaluation:
    """What a model says of the readings at one parameter vector; it depends on that alone.

    Args:
        readings: (g,) v(p).
        jacobian: (g, n) its derivatives; None where they were not asked for.
        increments: (n_states, n_channels) what the step of each state changes in what all channels
            see, SI.
        activity: of the yield planes; None where nothing can yield.
    """

    readings: Floats
    jacobian: Floats | None = None
    increments: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    activity: Activity | None = None


CERTAIN = 1e-9
"""Relative error in energy up to which a surrogate is as good as the model.

Its derivatives then agree with those of the model to about 1e-6.
"""


class Surrogate(Response, Protocol):
    """A model that stands for another one and estimates its own error: a reduced model."""

    def error(self, p: Floats) -> float:
        """Error of its stresses at p (n,) in energy, relative to their own; infinite for none."""

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see, (n_states, n_channels)."""


@runtime_checkable
class HasSurrogate(Response, Protocol):
    """A model that may have a surrogate."""

    def surrogate_obstacle(self) -> str | None:
        """Why there is none, a clause, or None if there may be one."""

    def surrogate(self, visited: Sequence[Floats]) -> Surrogate | None:
        """The surrogate that some evaluations make; None where there is none.

        At each of these parameter vectors it gives the readings and derivatives of the model, up
        to rounding.

        Args:
            visited: (n,) where the model was evaluated with derivatives; where it was not, it is
                evaluated now. The surrogate depends on them and on their order alone.

        Raises:
            ModelError: the model has no solution at one of them.
        """


@dataclass(frozen=True)
class Condensed:
    """The condensed equations of an affine elastic model at one parameter vector (theory 4.1).

    With the displacements corrected so that they meet the measured readings, the equation error of
    the parameters q, carried to the gauges by the frozen model, is ``matrix @ q - vector``.
    At q = p it equals measured - v(p) as far as the readings are independent.

    Args:
        readings: (g,) v(p).
        flexibility: (g, g) S = G K^-1 G^T; its inverse turns an error in readings to one in forces.
        matrix: (g, n).
        vector: (g,).
    """

    readings: Floats
    flexibility: Floats
    matrix: Floats
    vector: Floats


@dataclass(frozen=True)
class Bilinear:
    """m values c_0 + A_0 x + sum_h p_h (c_h + A_h x) of N unknowns x and n parameters p.

    Args:
        constant: (m,) c_0.
        by_p: (m, n) c_h, column by column.
        by_x: (m, N) sparse A_0.
        products: A_h (m, N), sparse, of those parameters h for which it is not zero.
    """

    constant: Floats
    by_p: Floats
    by_x: sp.csr_array
    products: Mapping[int, sp.csr_array]

    def at(self, p: Floats) -> tuple[Floats, sp.csr_array]:
        """The vector c (m,) and the matrix A (m, N) of the values c + A x at parameters p (n,).

        >>> one = sp.csr_array(np.eye(1))
        >>> c, A = Bilinear(np.ones(1), np.ones((1, 1)), one, {0: one}).at(np.array([3.0]))
        >>> c, A.toarray()
        (array([4.]), array([[4.]]))
        """
        matrix = self.by_x
        for h, product in self.products.items():
            matrix = matrix + float(p[h]) * product
        return np.asarray(self.constant + self.by_p @ p), sp.csr_array(matrix)


@dataclass(frozen=True)
class BilinearSystem:
    """A bilinear complementarity system of N unknowns, n parameters, q pairs and g readings.

    Unknowns are of several kinds (displacements, the stresses of one material, ...). Those of one
    kind have one unit and are of one size; so have equations and slacks that name the kind.

    Args:
        names: the n parameters.
        equations: R, N - q of them.
        slacks: s, (q,).
        readings: v, (g,).
        multipliers: (q,) index in x of the multiplier that pairs with each slack.
        stiffness: (q,) how fast a slack grows with its own multiplier where no displacement
            follows, at parameters of the usual size; slack size by it is the multiplier's size.
        work: (q,) slack times multiplier times this is the work of the pair, all in one unit.
        kind_of_unknown: (N,) from 0; -1 for multipliers.
        kind_of_equation: (N - q,) or -1 where an equation is in a unit of its own.
        kind_of_slack: (q,).
    """

    names: tuple[str, ...]
    equations: Bilinear
    slacks: Bilinear
    readings: Bilinear
    multipliers: Ints
    stiffness: Floats
    work: Floats
    kind_of_unknown: Ints
    kind_of_equation: Ints
    kind_of_slack: Ints

    @property
    def n_pairs(self) -> int:
        """Number q of pairs."""
        return int(self.multipliers.shape[0])

    @property
    def determined(self) -> Ints:
        """(N - q,) the unknowns that are no multipliers: what the equations determine."""
        return np.setdiff1d(np.arange(len(self.kind_of_unknown)), self.multipliers)
