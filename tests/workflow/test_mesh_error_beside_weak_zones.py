"""Where one refinement is too large, the error of each reading is of the right size, beside a fault
one element wide too: judged by meshes that are refined in earnest."""

import numpy as np
import pytest

from geoident.fem.refinement.finer import halved
from geoident.model.case import Stage
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Scalar
from geoident.workflow.estimating import mesh_error as module
from geoident.workflow.estimating.mesh_error import mesh_error, orders
from tests.support.cases import displacement, material, model, rollers
from tests.support.meshes import box, regroup

NOTHING = np.empty(0)
PLACES = {
    "wall": (2.0, 0.0),
    "roof": (0.0, 2.0),
    "before fault": (3.0, 0.0),
    "behind fault": (4.0, 0.0),
    "far": (6.0, 0.0),
    "above": (2.0, 4.0),
}


def beside_fault(kind, contrast, refinements):
    """A square heading beside a fault of one element, in rock 1 / contrast times as stiff.

    Walls and fault are read, by a quarter of the section (in space an eighth).
    """
    dim = 3 if kind in ("tet4", "tet10", "hex8") else 2
    mesh = regroup(
        box(kind, (10,) * 2 + (2,) * (dim - 2), size=(10.0,) * 2 + (2.0,) * (dim - 2)),
        core=lambda c: np.all(c < 2.0, axis=1),
        fault=lambda c: (c[:, 0] > 3.0) & (c[:, 0] < 4.0),
    )
    for _ in range(refinements):
        mesh = halved(mesh)
    zero = Scalar(0.0)
    axes = [(name, place, axis) for name, place in PLACES.items() for axis in (0, 1)]
    return model(
        mesh,
        materials={
            "rock": material("rock", 10e9, 0.22),
            "weak": material("weak", contrast * 10e9, 0.3),
        },
        groups={"core": "rock", "fault": "weak", "rock": "rock"},
        supports=rollers(dim),
        in_situ=ConstantStress((Scalar(-13e6), Scalar(-8e6), Scalar(-9e6), zero, zero, zero)),
        stages=(Stage("open", excavate=("core",)),),
        channels=tuple(
            displacement(f"{name} {axis}", (*place, 0.0)[:dim], tuple(np.eye(dim)[axis]))
            for name, place, axis in axes
            if place[axis] > 0.0
        ),
    )  # fmt: skip


@pytest.mark.parametrize("contrast", [1.0, pytest.param(0.1, marks=pytest.mark.slow), 0.02])
@pytest.mark.parametrize(
    "kind",
    [
        "tri3",
        "quad4",
        "tri6",
        "quad8",
        "hex8",
        "tet4",
        pytest.param("tet10", marks=pytest.mark.slow),
    ],
)
def test_errors_are_of_the_right_size_beside_a_weak_zone(kind, contrast, monkeypatch):
    staged = beside_fault(kind, contrast, 0)
    one = beside_fault(kind, contrast, 1)
    two = one if staged.mesh.dim == 3 else beside_fault(kind, contrast, 2)
    q, _ = orders(staged)
    computed, finer, finest = (each.computed(NOTHING)[:, 0] for each in (staged, one, two))
    before = computed if two is one else finer
    true = finest + (finest - before) / (2.0**q - 1.0) - computed
    monkeypatch.setattr(module, "free_memory", lambda: 1e5)
    estimate = mesh_error(staged, staged.case, NOTHING)
    assert estimate.how == "recovery"
    error = estimate.error[:, 0]
    at_least = 0.0 if "a lower bound" in estimate.notes[1] else 1 / 3
    assert at_least < np.linalg.norm(error) / np.linalg.norm(true) < 3.0
    large = np.abs(true) > 0.1 * np.abs(true).max()
    ratio = np.abs(error[large] / true[large])
    assert np.all((ratio > at_least) & (ratio < 5.0)), ratio
