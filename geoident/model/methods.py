"""Names and options of the identifiers, as users write them.

One table, `METHOD_OPTIONS`, maps the names to the option types; the keys of `fit`, the schema and
the message on an unknown method are made from it. `geoident.identify.METHODS` has the same keys.

Losses: how much a large residual counts, as users write them.

One table, `LOSS_OPTIONS`, maps the names to the option types; the schema and the messages are made
from it. The formulas are in `geoident.identify.problem.losses`.

Model error: what is assumed of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal


def _option(default: Any, description: str, **limits: object) -> Any:
    """An option of a method or a loss, from which its key of `fit` is made.

    Args:
        default: its value if missing, or the type of an empty one.
        description: for the page of keys and the JSON schema.
        limits: ``above`` and ``below`` of a number (above 0 if missing), ``least`` of a whole one
            (1 if missing), and the ``dimension`` of a quantity.
    """
    metadata = {"description": description, **limits}
    if isinstance(default, type):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class GaussNewtonOptions:
    """Weighted least squares by a trust region with bounds."""

    tolerance: float = _option(
        1e-8, "Relative size of a step, or of the reduction it predicts, that ends the search."
    )
    max_iterations: int = _option(50, "Most steps.")
    starts: int | Literal["automatic"] = _option(
        "automatic",
        "Number of starts (the first is given, the others are spread over the bounds); "
        "`automatic` makes 1, or 5 where an angle of axes or planes is sought or the search met"
        " a sign of another minimum.",
    )


@dataclass(frozen=True)
class CondensationOptions:
    """Condensation with iterated least squares (Maier & Gioda, section 4)."""

    weighting: Literal["output", "equation"] = _option(
        "output",
        "`output` measures the error in readings, `equation` in forces, as the paper does.",
    )
    tolerance: float = _option(1e-8, "Relative change of the parameters that ends the iteration.")
    max_iterations: int = _option(50, "Most iterations.")


@dataclass(frozen=True)
class SimplexOptions:
    """Simplex search (Maier & Gioda, section 5, figure 7; Nelder & Mead)."""

    alpha: float = _option(1.0, "Factor of reflection.")
    beta: float = _option(0.5, "Factor of contraction.", above=0.0, below=1.0)
    gamma: float = _option(2.0, "Factor of expansion.", above=1.0)
    delta: float = _option(
        1e-10, "Relative spread of the misfit over the vertices that ends the search."
    )
    max_evaluations: int = _option(2000, "Most evaluations of the misfit.")
    restarts: int = _option(
        1, "Number of new simplexes that are built around the best vertex.", least=0
    )
    size: float = _option(0.1, "Edge of the first simplex, in scaled parameters.")


@dataclass(frozen=True)
class ScanAxis:
    """One axis of a scan: ``points`` values from ``start`` to ``stop`` (SI)."""

    start: float
    stop: float
    points: int = 21


@dataclass(frozen=True)
class ScanOptions:
    """The misfit on a grid of one or two parameters (the paper's parametric analysis)."""

    grid: Mapping[str, ScanAxis] = _option(
        dict,
        "Parameter to its axis; the first one or two parameters between their bounds if missing.",
    )
    points: int = _option(21, "Number of points of axes that `grid` does not give.", least=2)


@dataclass(frozen=True)
class ClosedFormOptions:
    """Circular opening in elastic or Mohr-Coulomb ground, by formulas (Lame, Kirsch, Salencon)."""

    centre: tuple[float, float] | None = _option(
        None, "Centre of the opening, which the method needs."
    )
    radius: float | None = _option(
        None, "Radius of the opening, which the method needs.", dimension="length"
    )
    starts: int = _option(
        10, "Number of starts: the first is given, the others are spread over the bounds."
    )
    tolerance: float = _option(
        1e-8, "Relative size of a step, or of the reduction it predicts, that ends the search."
    )
    max_iterations: int = _option(100, "Most steps of a start.")


@dataclass(frozen=True)
class ComplementarityOptions:
    """Yield limits by complementarity (Maier & Gioda, section 5)."""

    formulation: Literal["implicit", "full-space", "global"] = _option(
        "implicit",
        "`implicit` solves the stages for every trial; `full-space` is a nonlinear program in "
        "all unknowns (extra full-space); `global` proves a bound for small cases (extra "
        "global).",
    )
    restarts: int = _option(
        100,
        "Most descents that start anew around the best point, in search of a better one.",
        least=0,
    )
    max_evaluations: int = _option(1000, "Most analyses of all stages.")
    tolerance: float = _option(
        1e-8, "Relative size of a step, or of the reduction it predicts, that ends a descent."
    )
    seed: int = _option(1, "Seed of the random directions of the restarts.")
    gap: float = _option(
        1e-4,
        "For `global`: difference between the misfit and the proven bound that ends the search,"
        " relative to the misfit (to 1 where that is less).",
    )
    max_regions: int = _option(2000, "For `global`: most boxes of parameters that are examined.")


@dataclass(frozen=True)
class EnsembleSmootherOptions:
    """Ensemble smoother with multiple data assimilation: no derivatives (extra ensemble)."""

    ensemble: int = _option(200, "Number of members; the sampling error falls with the root of it.")
    assimilations: int = _option(4, "Number of steps in which the readings are taken in.")
    seed: int = _option(1, "Seed of the ensemble and of the perturbed readings.")


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
    """Huber's loss: quadratic for small residuals, linear for large ones: no reading dominates."""

    delta: float = _option(
        1.345,
        "Residual, in standard deviations, from which on a reading counts less. 1.345 loses 5 %"
        " of the information if no reading is wrong.",
    )


@dataclass(frozen=True)
class StudentOptions:
    """The loss of Student's t distribution: the influence of a reading that is far off vanishes."""

    nu: float = _option(
        4.0, "Degrees of freedom: few for many wrong readings, many for nearly least squares."
    )


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
        time: over which it is correlated, s; None: a third of the time of the readings of a model
            without ground of its own and behind a face, and by stages of construction of others.
        written: the case says so; else this is what happens by default.
    """

    kind: ModelErrorKind = "estimate"
    size: float = 0.0
    length: float | None = None
    time: float | None = None
    written: bool = False
