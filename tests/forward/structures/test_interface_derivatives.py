"""A dipping joint that yields in stressed ground: balanced virgin state, exact derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.in_situ import ConstantStress
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from tests.forward.structures.test_interfaces import ZERO, meter
from tests.support.cases import material, model
from tests.support.derivatives import assert_slopes
from tests.support.inner_faces import with_inner_faces
from tests.support.meshes import KINDS_2D, box, regroup

STARTS = {
    "k_n": 5e9, "k_s": 2e9, "c": 2e5, "phi": radians(25), "psi": radians(8), "R": 0.8, "ft": 5e4,
    "E": 1e10, "sv": -2e6,
}  # fmt: skip
LEAN = 0.3


def jointed(kind: str):
    """A box with a joint of the slope LEAN, pushed along and pulled up, then let go in part."""
    dim = 2 if kind in KINDS_2D else 3
    mesh = box(kind, (2, 4) if dim == 2 else (2, 2, 2))
    points = mesh.points.copy()
    points[:, -1] += LEAN * points[:, 0]
    mesh = with_inner_faces(
        replace(mesh, points=points),
        joint=lambda x: abs(x[..., -1] - LEAN * x[..., 0] - 0.5) < 1e-9,
    )
    mesh = regroup(mesh, low=lambda x: x[:, -1] - LEAN * x[:, 0] < 0.5)
    sv, axis = Scalar(1.0, "sv"), "xyz"[dim - 1]
    sizes = (Scalar(0.6, "sv"), sv, Scalar(0.5, "sv")) if dim == 2 else (
        Scalar(0.6, "sv"), Scalar(0.7, "sv"), sv
    )  # fmt: skip
    push = (Scalar(5.5e5), *(ZERO,) * (dim - 2), Scalar(6e5))
    back = tuple(Scalar(0.3 * part.factor) for part in push)
    one = {n: Scalar(1.0, n) for n in STARTS}
    limits = {"cohesion": "c", "friction": "phi", "R_inter": "R", "dilation": "psi",
              "tensile_strength": "ft"}  # fmt: skip
    return model(
        mesh,
        materials={"rock": material("rock", one["E"], 0.2)},
        groups={"rock": "rock", "low": "rock"},
        supports=(Support(f"{axis}0", tuple(range(dim))),),
        in_situ=ConstantStress((*sizes, *(ZERO,) * (1 if dim == 2 else 3)), held=True),
        imbalance_accepted=True,
        parameters=tuple(Parameter(n, v, *sorted((0.1 * v, 10 * v))) for n, v in STARTS.items()),
        interfaces={
            "joint": Interface(
                "joint", one["k_n"], one["k_s"], **{key: one[n] for key, n in limits.items()}
            )
        },
        stages=(
            Stage("push", loads={"p": Traction(f"{axis}1", push)}),
            Stage("back", loads={"p": Traction(f"{axis}1", back)}),
        ),
        channels=tuple(
            meter(f"m{x}", (x, *(0.5,) * (dim - 2), 0.5 + LEAN * x), "opening")
            for x in (0.25, 0.75)
        ),
    )


@pytest.mark.parametrize("kind", ["tri3", "quad8", "hex8"])
def test_derivatives_by_all_constants(kind):
    """By stiffness, strength, dilation, R_inter, the ground and its stress, to 1e-7."""
    staged, start = jointed(kind), np.array(list(STARTS.values()))
    assert staged.analysis.virgin(_point(staged, start))[1].max() < 1e-12
    response = staged.response(
        [(c.name, s) for c in staged.case.channels for s in ("push", "back")]
    )
    _, jacobian = response.evaluate(start)
    assert np.count_nonzero(np.abs(jacobian).max(axis=0) > 0) >= 6  # what the load reaches
    assert_slopes(response.readings, start, jacobian, tuple(STARTS), step=2e-4)


def _point(staged, start):
    return ParameterPoint(staged.values(start), tuple(STARTS))
