"""What is known of the yield planes at a parameter vector, and what an identification proved."""

from __future__ import annotations

from dataclasses import dataclass, field

from geoident.model.arrays import Floats, Ints


@dataclass(frozen=True)
class Activity:
    """Which yield planes are reached where, at one parameter vector.

    Planes are those of all materials that yield, r in all; stages do not count the virgin state.

    Args:
        planes: r names such as ``rock: plane 3``.
        stages: names of the stages.
        points: (r, n_stages) strain points with a positive multiplier.
        biactive: (r, n_stages) strain points on the plane with no multiplier, to rounding.
        distances: (r,) k, Pa.
        reached: (r,) largest n^T sigma over all points and stages, Pa: if the plane was never
            reached, all that is known is k >= this. -inf where no point has the material.
        slopes: (r, n) dk/dp: on which parameters the distance depends.
    """

    planes: tuple[str, ...]
    stages: tuple[str, ...]
    points: Ints
    biactive: Ints
    distances: Floats
    reached: Floats
    slopes: Floats


@dataclass(frozen=True)
class Certificate:
    """What an identification of yield limits can say for itself.

    Args:
        kind: kind of stationary point: ``strongly stationary`` (no biactive point, gradient of the
            active pieces zero), ``stationary on the active pieces`` (biactive points: one-sided
            derivatives were checked), ``not stationary`` or ``global`` (a bound proves it).
        gradient: largest projected gradient of the discrepancy in scaled parameters, relative.
        activity: the planes at the estimate.
        lower_bounds: parameter to the value (SI) that it must exceed, for those whose planes no
            strain point reaches; they are not determined.
        bound: proven lower bound of the discrepancy, NaN if none was proven.
        gap: (objective - bound) relative to the objective, NaN if none.
        remarks: sentences for the report.
        open_above: parameters that may as well be so large that their planes are never reached;
            written as an interval that ends on the upper bound.
    """

    kind: str
    gradient: float
    activity: Activity
    lower_bounds: dict[str, float] = field(default_factory=dict)
    bound: float = float("nan")
    gap: float = float("nan")
    remarks: tuple[str, ...] = ()
    open_above: tuple[str, ...] = ()
