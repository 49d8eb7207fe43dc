"""The analysis by conjugate gradients on several levels: states, derivatives, adjoints, counts."""

from __future__ import annotations

import numpy as np
from support.cases import displacement, make_case, material, rollers
from support.meshes import box, regroup

from geoident.fem.solvers import Solver, pick_solver
from geoident.fem.solvers.splu import SpluFactorization
from geoident.forward.checks import check_on_mesh
from geoident.forward.model import StagedModel
from geoident.model.actions import Pressure
from geoident.model.case import Stage
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar

E, NU = Scalar(1.0, "E"), Scalar(1.0, "nu")
PLACES = {"roof": (4.0, 4.0, 6.0), "wall": (6.0, 4.0, 4.0), "top": (4.0, 4.0, 8.0)}


def staged(solver):
    """A cube of which two blocks are taken out, with pressure on its top, and gauges about them."""
    mesh = box("tet10", (4, 4, 4), size=(8.0, 8.0, 8.0))

    def slab(low, high):
        def inside(c):
            middle = np.abs(c[:, :2] - 4).max(axis=1) < 2
            return middle & (c[:, 2] > low) & (c[:, 2] < high)

        return inside

    mesh = regroup(mesh, lower=slab(2, 4), upper=slab(4, 6))
    case = make_case(
        mesh,
        parameters=(
            Parameter("E", 5e9, 1e9, 5e10, scale="log"),
            Parameter("nu", 0.25, 0.05, 0.45),
        ),
        materials={"rock": material("rock", E, NU, 2600.0)},
        groups=dict.fromkeys(("rock", "lower", "upper"), "rock"),
        supports=rollers(3),
        in_situ=ConstantStress((*(Scalar(v) for v in (-9e6, -6e6, -7e6)), *(Scalar(0.0),) * 3)),
        stages=(
            Stage("upper", excavate=("upper",)),
            Stage("lower", excavate=("lower",), loads={"weight": Pressure("z1", Scalar(2e5))}),
        ),
        channels=tuple(displacement(n, p, (0.0, 0.6, 0.8)) for n, p in PLACES.items()),
    )
    return StagedModel(*check_on_mesh(case, mesh), solver=solver)


def answers(model):
    pairs = [(name, stage) for stage in ("upper", "lower") for name in PLACES]
    response = model.response(pairs)
    p = np.array([7e9, 0.3])
    return response.by_tangents(p), response.by_adjoints(p)


def test_readings_and_derivatives_are_those_of_a_factor():
    direct = staged(pick_solver("splu"))
    beyond = staged(Solver("iterative", SpluFactorization, lambda pattern: True))
    for (v, slopes), (v2, slopes2) in zip(answers(direct), answers(beyond), strict=True):
        np.testing.assert_allclose(v2, v, rtol=1e-8)
        np.testing.assert_allclose(slopes2, slopes, rtol=1e-7, atol=1e-9 * np.abs(slopes).max())
    assert direct.counts.iterations == 0
    assert beyond.counts.iterations > 100
    assert beyond.counts.solves == direct.counts.solves
