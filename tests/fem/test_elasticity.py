"""Elastic laws of every symmetry: what they say, how they turn, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from support.anisotropy import (
    ATTITUDE,
    LOVE,
    ORTHOTROPIC,
    STRATA,
    random_definite,
    random_rotation,
    turn_matrix,
    turn_tensor,
)
from support.meshes import KINDS, KINDS_2D, box

from geoident.fem.compatibility import block_geometry, strain_points
from geoident.fem.elasticity import (
    anisotropic_law,
    isotropic_law,
    love_law,
    orthotropic_law,
    strata_law,
    turned,
)
from geoident.fem.kinematics import PLANE_STRAIN, SOLID
from geoident.fem.rotation import bond, turn_of_attitude, turn_of_axes
from geoident.model.ground import ENTRIES

ANISOTROPIC = {
    name: float(random_definite(np.random.default_rng(3))[int(name[1]) - 1, int(name[2]) - 1])
    for name in ENTRIES
}
LAWS = {
    "young": (isotropic_law, {"E": 12e9, "nu": 0.3}),
    "bulk": (isotropic_law, {"K": 8e9, "G": 5e9}),
    "strata": (strata_law, STRATA),
    "love": (love_law, LOVE),
    "orthotropic": (orthotropic_law, ORTHOTROPIC),
    "anisotropic": (anisotropic_law, ANISOTROPIC),
}


@pytest.mark.parametrize("name", LAWS)
def test_slopes_agree_with_differences(name):
    law, constants = LAWS[name]
    given = law(constants)
    assert set(given.slopes) == set(constants)
    for constant, value in constants.items():
        step = 1e-4 * abs(value)

        def at(k, constant=constant, value=value, step=step):
            return law({**constants, constant: value + k * step}).matrix

        numeric = (8 * (at(1) - at(-1)) - at(2) + at(-2)) / (12 * step)
        scale = np.abs(given.slopes[constant]).max()
        np.testing.assert_allclose(given.slopes[constant], numeric, atol=1e-9 * scale)


@pytest.mark.parametrize("section", [False, True])
def test_slopes_by_the_angles_agree_with_differences(section):
    law = orthotropic_law(ORTHOTROPIC)
    given = turned(law, turn_of_attitude(**ATTITUDE, section=section))
    for angle, value in ATTITUDE.items():

        def at(k, angle=angle, value=value):
            moved = {**ATTITUDE, angle: value + k * 1e-3}
            return turned(law, turn_of_attitude(**moved, section=section)).matrix

        numeric = (8 * (at(1) - at(-1)) - at(2) + at(-2)) / 12e-3
        np.testing.assert_allclose(
            given.slopes[angle], numeric, atol=1e-9 * np.abs(given.matrix).max()
        )


def test_bond_turns_stress_and_moduli_as_tensors():
    rng = np.random.default_rng(1)
    for _ in range(5):
        R, sigma, E = random_rotation(rng), rng.normal(size=6), random_definite(rng, 1.0)
        np.testing.assert_allclose(bond(R) @ sigma, turn_tensor(sigma, R), atol=1e-14)
        np.testing.assert_allclose(bond(R) @ E @ bond(R).T, turn_matrix(E, R), atol=1e-13)


def test_engineering_constants_mean_what_they_say():
    """A pull along the normal of the strata, and one down their dip, in the material axes."""
    E = strata_law(STRATA).matrix
    eps = np.linalg.solve(E, [0, 0, 1e6, 0, 0, 0])
    assert eps[2] == pytest.approx(1e6 / STRATA["E_n"])
    assert -eps[0] / eps[2] == pytest.approx(STRATA["nu_np"])
    eps = np.linalg.solve(E, [1e6, 0, 0, 0, 0, 0])
    assert -eps[1] / eps[0] == pytest.approx(STRATA["nu_p"])
    eps = np.linalg.solve(E, [0, 0, 0, 0, 1e6, 0])
    assert eps[4] == pytest.approx(1e6 / STRATA["G_np"])
    E = orthotropic_law(ORTHOTROPIC).matrix
    eps = np.linalg.solve(E, [0, 1e6, 0, 0, 0, 0])
    assert -eps[2] / eps[1] == pytest.approx(ORTHOTROPIC["nu_23"])
    eps = np.linalg.solve(E, [0, 0, 0, 0, 0, 1e6])
    assert eps[5] == pytest.approx(1e6 / ORTHOTROPIC["G_13"])


def test_symmetries_contain_each_other():
    iso = isotropic_law({"E": 10e9, "nu": 0.25}).matrix
    shear = 10e9 / 2.5
    strata = {"E_p": 10e9, "nu_p": 0.25, "E_n": 10e9, "nu_np": 0.25, "G_np": shear}
    np.testing.assert_allclose(strata_law(strata).matrix, iso, rtol=1e-13, atol=1e-3)
    E = strata_law(STRATA).matrix
    love = {"A": E[0, 0], "C": E[2, 2], "F": E[0, 2], "L": E[4, 4], "N": E[3, 3]}
    np.testing.assert_allclose(love_law(love).matrix, E, rtol=1e-13, atol=1e-3)
    as_three = {
        "E_1": STRATA["E_p"], "E_2": STRATA["E_p"], "E_3": STRATA["E_n"],
        "nu_12": STRATA["nu_p"], "G_12": STRATA["E_p"] / 2 / (1 + STRATA["nu_p"]),
        "G_13": STRATA["G_np"], "G_23": STRATA["G_np"],
        **dict.fromkeys(("nu_13", "nu_23"), STRATA["nu_np"] * STRATA["E_p"] / STRATA["E_n"]),
    }  # fmt: skip
    np.testing.assert_allclose(orthotropic_law(as_three).matrix, E, rtol=1e-13, atol=1e-3)
    entries = {n: E[int(n[1]) - 1, int(n[2]) - 1] for n in ENTRIES}
    np.testing.assert_array_equal(anisotropic_law(entries).matrix, E)


def test_attitude_points_where_a_compass_says():
    """Strata that fall by 30 degrees towards the east (x), in a solid."""
    R = turn_of_attitude(np.radians(30), np.radians(90), 0.0).matrix
    c, s = np.cos(np.radians(30)), 0.5
    np.testing.assert_allclose(R[:, 0], [c, 0, -s], atol=1e-15)  # down the dip
    np.testing.assert_allclose(R[:, 1], [0, 1, 0], atol=1e-15)  # along the strike
    np.testing.assert_allclose(R[:, 2], [s, 0, c], atol=1e-15)  # normal, upwards
    north = turn_of_attitude(np.radians(30), 0.0, 0.0).matrix
    np.testing.assert_allclose(north[:, 0], [0, c, -s], atol=1e-15)
    flat = turn_of_attitude(0.0, np.pi / 2, np.radians(90)).matrix
    np.testing.assert_allclose(flat[:, 0], [0, 1, 0], atol=1e-15)  # turned about the normal


def test_apparent_dip_falls_towards_x_in_a_section():
    R = turn_of_attitude(np.radians(30), np.radians(90), 0.0, section=True).matrix
    c, s = np.cos(np.radians(30)), 0.5
    np.testing.assert_allclose(R[:, 0], [c, -s, 0], atol=1e-15)
    np.testing.assert_allclose(R[:, 2], [s, c, 0], atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0)
    same = turn_of_axes(R[:, 0], R[:, 1])
    np.testing.assert_allclose(same.matrix, R, atol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_patch_test_of_an_anisotropic_material(kind):
    """A linear displacement: forces only where the outer faces carry the constant stress."""
    kinematics = PLANE_STRAIN if kind in KINDS_2D else SOLID
    dim, n = kinematics.dim, kinematics.n_strain
    mesh = box(kind, (3,) * dim, distortion=0.2)
    geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
    points = strain_points(mesh, geometries, kinematics)
    E = random_definite(np.random.default_rng(2), 1.0)[:n, :n]
    gradient = np.random.default_rng(4).normal(size=(dim, dim))
    stress = np.tensordot(E, points.strain((mesh.points @ gradient.T).ravel()), axes=1)
    np.testing.assert_allclose(stress, np.broadcast_to(stress[:, :1], stress.shape), atol=1e-12)
    forces = points.forces(stress, points.volume).reshape(-1, dim)
    inner = np.all((mesh.points > 1e-9) & (mesh.points < 1 - 1e-9), axis=1)
    assert inner.any()
    np.testing.assert_allclose(forces[inner], 0.0, atol=1e-12)
    assert np.abs(forces[~inner]).max() > 1e-3
