"""Names and options of the identifiers, as users write them.

One table, `METHOD_OPTIONS`, maps the names to the option types; the schema, the help texts and the
message on an unknown method are made from it, and `geoident.identify.METHODS` has the same keys.

Losses: how much a large residual counts, as users write them.

One table, `LOSS_OPTIONS`, maps the names to the option types; the schema and the messages are made
from it. The formulas are in `geoident.identify.problem.losses`.

Model error: what is assumed of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class GaussNewtonOptions:
    """Weighted least squares by a trust region with bounds.

    Args:
        tolerance: relative size of a step, or of the reduction it predicts, that ends the search.
        max_iterations: steps at most.
        starts: number of starts (the first is given, the others are spread over the bounds), or
            automatic: 1, or 5 where an angle of axes or planes is sought or the search met a sign
            of another minimum.
    """

    tolerance: float = 1e-8
    max_iterations: int = 50
    starts: int | Literal["automatic"] = "automatic"


@dataclass(frozen=True)
class CondensationOptions:
    """Condensation with iterated least squares (Maier & Gioda, section 4).

    Args:
        weighting: ``output`` measures the error in readings, ``equation`` in forces, as the paper.
        tolerance: relative change of the parameters that ends the iteration.
        max_iterations: iterations at most.
    """

    weighting: Literal["output", "equation"] = "output"
    tolerance: float = 1e-8
    max_iterations: int = 50


@dataclass(frozen=True)
class SimplexOptions:
    """Simplex search (Maier & Gioda, section 5, figure 7; Nelder & Mead).

    Args:
        alpha: reflection.
        beta: contraction.
        gamma: expansion.
        delta: tolerance: relative spread of the discrepancy over the vertices that ends the search.
        max_evaluations: evaluations of the discrepancy at most.
        restarts: new simplexes built around the best vertex.
        size: edge of the first simplex in scaled parameters.
    """

    alpha: float = 1.0
    beta: float = 0.5
    gamma: float = 2.0
    delta: float = 1e-10
    max_evaluations: int = 2000
    restarts: int = 1
    size: float = 0.1


@dataclass(frozen=True)
class ScanAxis:
    """One axis of a scan: ``points`` values from ``start`` to ``stop`` (SI)."""

    start: float
    stop: float
    points: int = 21


@dataclass(frozen=True)
class ScanOptions:
    """The discrepancy on a grid of one or two parameters (the paper's parametric analysis).

    Args:
        grid: parameter name to axis. Empty: the first one or two parameters between their bounds.
        points: number of points of axes that ``grid`` does not give.
    """

    grid: Mapping[str, ScanAxis] = field(default_factory=dict)
    points: int = 21


@dataclass(frozen=True)
class ClosedFormOptions:
    """Circular opening in elastic or Mohr-Coulomb ground, by formulas (Lame, Kirsch, Salencon).

    Args:
        centre: centre of the opening; None: not given, and the method refuses.
        radius: radius of the opening; None likewise.
        starts: number of starts (the first is given, the others are spread over the bounds).
        tolerance: relative size of a step, or of the reduction it predicts, that ends the search.
        max_iterations: steps of a start at most.
    """

    centre: tuple[float, float] | None = None
    radius: float | None = None
    starts: int = 10
    tolerance: float = 1e-8
    max_iterations: int = 100


@dataclass(frozen=True)
class ComplementarityOptions:
    """Yield limits by complementarity (Maier & Gioda, section 5).

    Args:
        formulation: ``implicit`` solves the stages for every trial, ``full-space`` is a nonlinear
            program in all unknowns (extra full-space), ``global`` proves a bound for small cases
            (extra global).
        restarts: most descents that start anew around the best point, in search of a better one.
        max_evaluations: analyses of all stages at most.
        tolerance: relative size of a step, or of the reduction it predicts, that ends a descent.
        seed: seed of the random directions of the restarts.
        gap: of ``global``: difference between discrepancy and proven bound that ends the search,
            relative to the discrepancy (to 1 where that is less).
        max_regions: of ``global``: most boxes of parameters that are examined.
    """

    formulation: Literal["implicit", "full-space", "global"] = "implicit"
    restarts: int = 100
    max_evaluations: int = 1000
    tolerance: float = 1e-8
    seed: int = 1
    gap: float = 1e-4
    max_regions: int = 2000


@dataclass(frozen=True)
class EnsembleSmootherOptions:
    """Ensemble smoother with multiple data assimilation: no derivatives (extra ensemble).

    Args:
        ensemble: members of the ensemble; its sampling error falls with the root of their number.
        assimilations: steps in which the readings are taken in.
        seed: of the ensemble and of the perturbed readings.
    """

    ensemble: int = 200
    assimilations: int = 4
    seed: int = 1


MethodOptions = (
    GaussNewtonOptions
    | CondensationOptions
    | SimplexOptions
    | ScanOptions
    | ClosedFormOptions
    | ComplementarityOptions
    | EnsembleSmootherOptions
)

METHOD_OPTIONS: Mapping[str, type[MethodOptions]] = {
    "gauss-newton": GaussNewtonOptions,
    "condensation": CondensationOptions,
    "simplex": SimplexOptions,
    "scan": ScanOptions,
    "closed-form": ClosedFormOptions,
    "complementarity": ComplementarityOptions,
    "ensemble-smoother": EnsembleSmootherOptions,
}


def method_name(options: MethodOptions) -> str:
    """The name under which users know the method that has these options."""
    return next(name for name, kind in METHOD_OPTIONS.items() if kind is type(options))


@dataclass(frozen=True)
class SquaredOptions:
    """Weighted least squares: right where all errors are as the accuracies say."""


@dataclass(frozen=True)
class HuberOptions:
    """Huber's loss: quadratic for small residuals, linear for large ones: no reading dominates.

    Args:
        delta: residual, in standard deviations, from which on a reading counts less. 1.345 loses
            5 % of the information if no reading is wrong.
    """

    delta: float = 1.345


@dataclass(frozen=True)
class StudentOptions:
    """The loss of Student's t distribution: the influence of a reading that is far off vanishes.

    Args:
        nu: degrees of freedom; few for many wrong readings, many for nearly least squares.
    """

    nu: float = 4.0


LossOptions = SquaredOptions | HuberOptions | StudentOptions

LOSS_OPTIONS: Mapping[str, type[LossOptions]] = {
    "squared": SquaredOptions,
    "huber": HuberOptions,
    "student-t": StudentOptions,
}


def loss_name(options: LossOptions) -> str:
    """The name under which users know a loss."""
    return next(name for name, kind in LOSS_OPTIONS.items() if kind is type(options))


def loss_text(options: LossOptions) -> str:
    """A loss with its option, as results hold it.

    >>> loss_text(HuberOptions()), loss_text(StudentOptions(3.0)), loss_text(SquaredOptions())
    ('huber (delta 1.345)', 'student-t (nu 3)', 'squared')
    """
    match options:
        case HuberOptions(delta):
            return f"huber (delta {delta:g})"
        case StudentOptions(nu):
            return f"student-t (nu {nu:g})"
        case _:
            return "squared"


ModelErrorKind = Literal["estimate", "none", "given"]


@dataclass(frozen=True)
class ModelErrorOptions:
    """What a case says of the model error.

    Args:
        kind: ``estimate`` it from the residuals, ``none``, or ``given``.
        size: relative to the computed motion, where it is given.
        length: over which it is correlated, m; None: as far as the gauges are spread.
        written: the case says so; else this is what happens by default.
    """

    kind: ModelErrorKind = "estimate"
    size: float = 0.0
    length: float | None = None
    written: bool = False
