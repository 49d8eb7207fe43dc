"""Elastic laws of every symmetry: what they say, how they turn, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from support.anisotropy import (
    ATTITUDE,
    LOVE,
    ORTHOTROPIC,
    STRATA,
    axes,
    each_a_parameter,
    moduli,
    random_definite,
    random_rotation,
    turn_matrix,
    turn_tensor,
)
from support.meshes import KINDS, KINDS_2D, box

from geoident.fem.elasticity import (
    anisotropic,
    axes_of_attitude,
    axes_of_vectors,
    bond,
    isotropic,
    love,
    orthotropic,
    transversely_isotropic,
    turned,
)
from geoident.fem.kinematics import PLANE_STRAIN, SOLID, block_geometry, strain_points
from geoident.model.dual import Dual
from geoident.model.ground import ENTRIES

ANISOTROPIC = {
    name: float(random_definite(np.random.default_rng(3))[int(name[1]) - 1, int(name[2]) - 1])
    for name in ENTRIES
}
LAWS = {
    "young": (isotropic, {"E": 12e9, "nu": 0.3}),
    "bulk": (isotropic, {"K": 8e9, "G": 5e9}),
    "strata": (transversely_isotropic, STRATA),
    "love": (love, LOVE),
    "orthotropic": (orthotropic, ORTHOTROPIC),
    "anisotropic": (anisotropic, ANISOTROPIC),
}


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_agree_with_differences(name):
    law, constants = LAWS[name]
    given = law(each_a_parameter(constants))
    for column, (constant, value) in enumerate(constants.items()):
        step = 1e-4 * abs(value)

        def at(k, constant=constant, value=value, step=step):
            return moduli(law, {**constants, constant: value + k * step})

        numeric = (8 * (at(1) - at(-1)) - at(2) + at(-2)) / (12 * step)
        found = given.slope(column)
        np.testing.assert_allclose(found, numeric, atol=1e-9 * np.abs(found).max())


@pytest.mark.parametrize("section", [False, True])
def test_derivatives_by_the_angles_agree_with_differences(section):
    law = moduli(orthotropic, ORTHOTROPIC)

    def at(**angles):
        given = axes_of_attitude(**each_a_parameter(angles), section=section)
        return turned(Dual.constant(law, 3), given)

    given = at(**ATTITUDE)
    for column, (angle, value) in enumerate(ATTITUDE.items()):
        moved = [at(**{**ATTITUDE, angle: value + k * 1e-3}).value for k in (1, -1, 2, -2)]
        numeric = (8 * (moved[0] - moved[1]) - moved[2] + moved[3]) / 12e-3
        np.testing.assert_allclose(
            given.columns[..., 1 + column], numeric, atol=1e-9 * np.abs(given.value).max()
        )


def test_bond_turns_stress_and_moduli_as_tensors():
    rng = np.random.default_rng(1)
    for _ in range(5):
        R, sigma, E = random_rotation(rng), rng.normal(size=6), random_definite(rng, 1.0)
        M = bond(Dual.constant(R, 0)).value
        np.testing.assert_allclose(M @ sigma, turn_tensor(sigma, R), atol=1e-14)
        np.testing.assert_allclose(M @ E @ M.T, turn_matrix(E, R), atol=1e-13)


def test_engineering_constants_mean_what_they_say():
    """A pull along the normal of the strata, and one down their dip, in the material axes."""
    E = moduli(transversely_isotropic, STRATA)
    eps = np.linalg.solve(E, [0, 0, 1e6, 0, 0, 0])
    assert eps[2] == pytest.approx(1e6 / STRATA["E_n"])
    assert -eps[0] / eps[2] == pytest.approx(STRATA["nu_np"])
    eps = np.linalg.solve(E, [1e6, 0, 0, 0, 0, 0])
    assert -eps[1] / eps[0] == pytest.approx(STRATA["nu_p"])
    eps = np.linalg.solve(E, [0, 0, 0, 0, 1e6, 0])
    assert eps[4] == pytest.approx(1e6 / STRATA["G_np"])
    E = moduli(orthotropic, ORTHOTROPIC)
    eps = np.linalg.solve(E, [0, 1e6, 0, 0, 0, 0])
    assert -eps[2] / eps[1] == pytest.approx(ORTHOTROPIC["nu_23"])
    eps = np.linalg.solve(E, [0, 0, 0, 0, 0, 1e6])
    assert eps[5] == pytest.approx(1e6 / ORTHOTROPIC["G_13"])


def test_symmetries_contain_each_other():
    iso = moduli(isotropic, {"E": 10e9, "nu": 0.25})
    shear = 10e9 / 2.5
    strata = {"E_p": 10e9, "nu_p": 0.25, "E_n": 10e9, "nu_np": 0.25, "G_np": shear}
    np.testing.assert_allclose(moduli(transversely_isotropic, strata), iso, rtol=1e-13, atol=1e-3)
    E = moduli(transversely_isotropic, STRATA)
    by_love = {"A": E[0, 0], "C": E[2, 2], "F": E[0, 2], "L": E[4, 4], "N": E[3, 3]}
    np.testing.assert_allclose(moduli(love, by_love), E, rtol=1e-13, atol=1e-3)
    as_three = {
        "E_1": STRATA["E_p"], "E_2": STRATA["E_p"], "E_3": STRATA["E_n"],
        "nu_12": STRATA["nu_p"], "G_12": STRATA["E_p"] / 2 / (1 + STRATA["nu_p"]),
        "G_13": STRATA["G_np"], "G_23": STRATA["G_np"],
        **dict.fromkeys(("nu_13", "nu_23"), STRATA["nu_np"] * STRATA["E_p"] / STRATA["E_n"]),
    }  # fmt: skip
    np.testing.assert_allclose(moduli(orthotropic, as_three), E, rtol=1e-13, atol=1e-3)
    entries = {n: E[int(n[1]) - 1, int(n[2]) - 1] for n in ENTRIES}
    np.testing.assert_array_equal(moduli(anisotropic, entries), E)


def test_attitude_points_where_a_compass_says():
    """Strata that fall by 30 degrees towards the east (x), in a solid."""
    R = axes(np.radians(30), np.radians(90), 0.0)
    c, s = np.cos(np.radians(30)), 0.5
    np.testing.assert_allclose(R[:, 0], [c, 0, -s], atol=1e-15)  # down the dip
    np.testing.assert_allclose(R[:, 1], [0, 1, 0], atol=1e-15)  # along the strike
    np.testing.assert_allclose(R[:, 2], [s, 0, c], atol=1e-15)  # normal, upwards
    north = axes(np.radians(30), 0.0, 0.0)
    np.testing.assert_allclose(north[:, 0], [0, c, -s], atol=1e-15)
    flat = axes(0.0, np.pi / 2, np.radians(90))
    np.testing.assert_allclose(flat[:, 0], [0, 1, 0], atol=1e-15)  # turned about the normal


def test_apparent_dip_falls_towards_x_in_a_section():
    R = axes(np.radians(30), np.radians(90), 0.0, section=True)
    c, s = np.cos(np.radians(30)), 0.5
    np.testing.assert_allclose(R[:, 0], [c, -s, 0], atol=1e-15)
    np.testing.assert_allclose(R[:, 2], [s, c, 0], atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0)
    same = axes_of_vectors(R[:, 0], R[:, 1])
    np.testing.assert_allclose(same, R, atol=1e-15)


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
