"""What small cases in which all acts together have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from geoident.forward.model import StagedModel
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Beam, Bolts, Structure, Struts
from support.derivatives import Readings, assert_slopes

End = tuple[float, float]


def unbounded(values: Mapping[str, float]) -> tuple[Parameter, ...]:
    """Parameters that may be anything, from their starts."""
    return tuple(Parameter(name, value, -np.inf, np.inf) for name, value in values.items())


def bracing(further: tuple[End, End], thickness: float) -> dict[str, Structure]:
    """A plate on y1, two bolts and a jacked strut, by El and sv.

    Args:
        further: ends of the second bolt, m.
        thickness: of the plate, m.
    """
    one = Scalar(1.0)
    return {
        "plate": Beam("y1", E=Scalar(1.0, "El"), thickness=Scalar(thickness)),
        "bolts": Bolts((((4.5, 7.0), (9.0, 7.5)), further), one, EA=Scalar(0.02, "El")),
        "struts": Struts(
            (((4.5, 5.0), (8.0, 3.0)),), one, EA=Scalar(5e8), prestress=Scalar(0.05, "sv")
        ),
    }


def assert_slopes_in_sizes(
    readings: Readings,
    values: Mapping[str, float],
    jacobian: Floats,
    pairs: Sequence[tuple[str, str]],
    *,
    step: float,
    rtol: float,
) -> None:
    """Every parameter acts, and the Jacobian (g, n) agrees with differences, gauge by gauge.

    Metres stand beside newtons here: each reading is judged in the size of what its gauge reads.

    Args:
        readings: (g,) of parameters (n,).
        values: of the parameters, by their names.
        jacobian: of the readings there.
        pairs: gauge and stage of each reading.
        step: largest step, as a part of each parameter.
        rtol: largest error of a column, as a part of its largest entry.
    """
    here = np.array(list(values.values()))
    assert np.abs(jacobian).max(axis=0).min() > 0.0
    moved = np.abs(jacobian * here).max(axis=1)
    gauges = np.array([gauge for gauge, _ in pairs])
    size = np.array([moved[gauges == gauge].max() for gauge in gauges])
    assert_slopes(
        lambda p: readings(p) / size, here, jacobian / size[:, None], tuple(values),
        step=step, rtol=rtol,
    )  # fmt: skip


def compatibility(staged: StagedModel) -> Floats:
    """C (4, n_points, n_dofs) of a section, dense."""
    points = staged.discretization.points
    whole = points.compatibility(np.arange(points.n_points)).toarray()
    return np.asarray(whole.reshape(4, points.n_points, -1))
