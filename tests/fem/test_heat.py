"""Matrices of heat on all kinds of elements, and the rules that they and moving levels need."""

import numpy as np
import pytest
from support.meshes import KINDS, box

from geoident.fem.elements import divided_rule, raised_rule
from geoident.fem.faces import face_table, patches
from geoident.fem.heat import capacity_and_conduction, film
from geoident.fem.kinematics import PLANE_STRAIN, SOLID


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.startswith("pyramid")])
def test_linear_temperatures_are_exact(kind):
    """Capacity int T^2 dV, conduction int |grad T|^2 dV and film int T^2 dA of T = 1 + 2 x - y."""
    dim = 2 if kind.startswith(("tri", "quad")) else 3
    size = (2.0, 1.0, 1.0)[:dim]
    mesh = box(kind, (2,) * dim, size=size)
    kinematics = PLANE_STRAIN if dim == 2 else SOLID
    every = np.ones(mesh.n_elements, dtype=bool)
    M, H = capacity_and_conduction(mesh, kinematics, every)
    x, y = mesh.points[:, :2].T
    T = 1.0 + 2.0 * x - y
    # int (1 + 2x - y)^2 over [0,2] x [0,1]: mean of squares of independent x and y
    mean, variance = 1.0 + 2.0 - 0.5, 4.0 * 4.0 / 12.0 + 1.0 / 12.0
    assert pytest.approx(2.0 * (mean**2 + variance)) == T @ (M @ T)
    assert pytest.approx(2.0 * 5.0) == T @ (H @ T)
    table = face_table(mesh)
    outer = patches(mesh, table, table.free(every))
    one = np.ones(mesh.n_nodes)
    F = film(mesh, kinematics, outer)
    assert one @ (F @ one) == pytest.approx(6.0 if dim == 2 else 10.0)


@pytest.mark.parametrize("kind", ["line2", "line3", "tri3", "tri6", "quad4", "quad8"])
def test_divided_rules_integrate_what_the_whole_rule_does_and_kinks_better(kind):
    points, weights = raised_rule(kind)
    fine, divided = divided_rule(kind, 5)
    assert divided.sum() == pytest.approx(weights.sum())
    assert divided @ fine == pytest.approx(weights @ points, abs=1e-14)
    many, best = divided_rule(kind, 60)
    kink = [np.maximum(at[:, 0] - 0.137, 0.0) for at in (points, fine, many)]
    whole, some, exact = (w @ k for w, k in zip((weights, divided, best), kink, strict=True))
    assert abs(some - exact) < 0.3 * abs(whole - exact)
