"""Yield planes against the surfaces that they stand for, their names, and their derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin, sqrt, tan

import numpy as np
import pytest
from support.cases import make_case
from support.derivatives import richardson
from support.meshes import box
from support.plastic import Planes

from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.stages import CaseOnMesh
from geoident.forward.yielding.surfaces import YieldLaws, yield_planes
from geoident.model.case import Material
from geoident.model.dual import ParameterPoint
from geoident.model.ground import Attitude, Axes, Isotropic
from geoident.model.parameter import Scalar
from geoident.model.yielding import (
    DruckerPrager,
    GivenPlanes,
    MohrCoulomb,
    WeakPlane,
    YieldPlane,
    YieldSurface,
)

ROCK = Isotropic(Scalar(1.0, "E"), Scalar(0.25))
VALUES = {
    "E": 9e9,
    "c": 1e6,
    "phi": 0.6,
    "psi": 0.3,
    "T": 3e5,
    "k": 2e6,
    "h": 1e8,
    "dip": 0.7,
    "direction": 1.1,
}
FITS = ("inscribed", "best", "circumscribed")


def tied(name):
    return Scalar(1.0, name)


def planes_of(*surfaces: YieldSurface, n_strain: int = 4, values=VALUES):
    rock = Material("rock", ROCK, yields=surfaces)
    planes = yield_planes(rock, ParameterPoint(values, ()), n_strain)
    return Planes(planes.normals.value, planes.distances.value)


def stresses(n_strain, count=20_000):
    draw = np.random.default_rng(3)
    stress = 1e6 * draw.normal(size=(n_strain, count))
    stress[:3] -= 2e6 * draw.uniform(size=count)
    return stress


PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def tensor_of(stress):
    """Stresses (s, m) as tensors (m, 3, 3)."""
    tensor = np.zeros((stress.shape[1], 3, 3))
    for component, (i, j) in zip(stress, PAIRS, strict=False):
        tensor[:, i, j] = tensor[:, j, i] = component
    return tensor


def principal(stress):
    """Principal stresses (m, 3), ascending."""
    return np.linalg.eigvalsh(tensor_of(stress))


def coulomb(stress, c=1e6, phi=0.6):
    low, _, high = principal(stress).T
    return (1 + sin(phi)) * high - (1 - sin(phi)) * low - 2 * c * cos(phi)


def drucker(stress, alpha, k):
    main = principal(stress)
    mean = main.mean(axis=1)
    return 3 * alpha * mean + np.sqrt(0.5 * ((main - mean[:, None]) ** 2).sum(axis=1)) - k


def excess(planes, stress):
    return (planes.normals @ stress - planes.distances[:, None]).max(axis=0)


SMOOTH = {
    "mohr-coulomb": (MohrCoulomb(tied("c"), tied("phi"), planes=48), coulomb),
    "tresca": (
        MohrCoulomb(Scalar(1.5e6), Scalar(0.0), planes=48),
        lambda stress: coulomb(stress, c=1.5e6, phi=0.0),
    ),
    "cut-off": (
        MohrCoulomb(tied("c"), tied("phi"), tension=tied("T"), planes=48),
        lambda stress: np.maximum(coulomb(stress), principal(stress)[:, 2] - 3e5),
    ),
    "drucker-prager": (
        DruckerPrager(tied("c"), tied("phi"), "outer", planes=48),
        lambda stress: drucker(
            stress,
            2 * sin(0.6) / (sqrt(3) * (3 - sin(0.6))),
            6e6 * cos(0.6) / (sqrt(3) * (3 - sin(0.6))),
        ),
    ),
}


@pytest.mark.parametrize("n_strain", [4, 6])
@pytest.mark.parametrize("name", SMOOTH)
def test_inscribed_lies_inside_circumscribed_outside_and_best_between(name, n_strain):
    surface, smooth = SMOOTH[name]
    surface = replace(surface, planes=16 if n_strain == 4 else 48)
    stress = stresses(n_strain)
    beyond = smooth(stress) > 1.0
    outside = {
        fit: excess(planes_of(replace(surface, fit=fit), n_strain=n_strain), stress) > 0
        for fit in FITS
    }
    assert 0.1 < beyond.mean() < 0.9
    assert not np.any(beyond & ~outside["inscribed"])
    assert not np.any(~beyond & outside["circumscribed"])
    assert np.any(~beyond & outside["best"])
    assert np.any(beyond & ~outside["best"])


def reach(planes, deviators, pressure=1e6):
    """How far the deviators (s, m) can be added to a pressure."""
    rising = planes.normals @ deviators
    left = planes.distances + pressure * planes.normals[:, :3].sum(axis=1)
    return 1 / (rising / left[:, None]).max(axis=0)


def misfit(surface, n_strain):
    """Mean difference of what the polyhedron bears, relative to Mohr-Coulomb."""
    deviators = np.random.default_rng(5).normal(size=(n_strain, 4000))
    deviators[:3] -= deviators[:3].mean(axis=0)
    low, _, high = principal(deviators).T
    exact = 2 * (1e6 * cos(0.6) + 1e6 * sin(0.6)) / ((1 + sin(0.6)) * high - (1 - sin(0.6)) * low)
    return np.abs(reach(planes_of(surface, n_strain=n_strain), deviators) / exact - 1).mean()


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.6])
def test_the_worst_deviators_just_touch_what_is_inscribed_in_a_solid(friction):
    axes = np.linalg.qr(np.random.default_rng(6).normal(size=(40_000, 3, 3)))[0]
    tensor = axes @ np.diag([1.0, 0.0, -1.0]) @ axes.transpose(0, 2, 1)
    deviators = np.stack([tensor[:, i, j] for i, j in PAIRS])
    surface = MohrCoulomb(tied("c"), Scalar(friction), planes=108, fit="inscribed")
    exact = 1e6 * (cos(friction) + sin(friction))  # half the difference of 1 and -1 is 1
    borne = reach(planes_of(surface, n_strain=6), deviators) / exact
    assert 0.95 < borne.max() < 1.0


@pytest.mark.parametrize("fit", FITS)
def test_polygons_converge_with_the_square_of_their_sides(fit):
    surface = MohrCoulomb(tied("c"), tied("phi"), fit=fit)
    wrong = [misfit(replace(surface, planes=sides), 4) for sides in (8, 16, 32, 64)]
    np.testing.assert_allclose(np.log2(np.array(wrong[:-1]) / wrong[1:]), 2.0, atol=0.15)
    assert wrong[1] < 0.02


def test_planes_in_a_solid_converge_as_frames_fill_the_rotations():
    surface = MohrCoulomb(tied("c"), tied("phi"))
    wrong = [misfit(replace(surface, planes=planes), 6) for planes in (30, 240)]
    assert np.log2(wrong[0] / wrong[1]) == pytest.approx(2.0, abs=0.3)  # y^(-2/3): a quarter


def test_a_weak_plane_in_a_section_is_coulomb_on_it():
    stress = stresses(4)
    for dip in (0.0, 0.3, 0.7, pi / 2):
        surface = WeakPlane(Attitude(Scalar(dip), Scalar(pi / 2)), tied("c"), tied("phi"))
        xx, yy, _, xy = stress
        normal = xx * sin(dip) ** 2 + yy * cos(dip) ** 2 + xy * sin(2 * dip)  # falls towards +x
        slip = (yy - xx) * sin(dip) * cos(dip) - xy * cos(2 * dip)
        psi = np.abs(slip) + normal * tan(0.6) - 1e6
        planes = planes_of(surface)
        assert len(planes.normals) == 2
        np.testing.assert_array_equal(excess(planes, stress) > 0, psi > 0)


def test_a_weak_plane_in_a_solid_opens_and_slides():
    flat = WeakPlane(
        Attitude(Scalar(0.0), Scalar(0.0)), tied("c"), tied("phi"), tied("T"), planes=64
    )
    tilted = replace(flat, frame=Axes((0.0, 0.6, 0.8), (1.0, 0.0, 0.0)))  # normal (0, 0.8, -0.6)
    stress = stresses(6)
    for surface, normal in ((flat, [0.0, 0.0, 1.0]), (tilted, [0.0, 0.8, -0.6])):
        traction = np.einsum("mij,j->im", tensor_of(stress), normal)
        pull = np.array(normal) @ traction
        slide = np.linalg.norm(traction - np.outer(normal, pull), axis=0)
        psi = np.maximum(slide + pull * tan(0.6) - 1e6, pull - 3e5)
        sure = np.abs(psi) > 2e-3 * np.abs(stress).max(axis=0)
        outside = excess(planes_of(surface, n_strain=6), stress) > 0
        np.testing.assert_array_equal(outside[sure], psi[sure] > 0)


def test_drucker_prager_meets_mohr_coulomb_where_it_says():
    phi, c = 0.6, 1e6
    fine = {
        match: planes_of(DruckerPrager(tied("c"), tied("phi"), match, planes=600, fit="best"))
        for match in ("outer", "inner", "plane-strain")
    }
    compression = np.array([[1.0], [1.0], [-2.0], [0.0]])  # axial
    edges = {"outer": compression, "inner": -compression}
    for match, deviator in edges.items():
        low, _, high = principal(deviator)[0]
        exact = 2 * (c * cos(phi) + c * sin(phi)) / ((1 + sin(phi)) * high - (1 - sin(phi)) * low)
        assert reach(fine[match], deviator)[0] == pytest.approx(exact, rel=2e-3)
    # In plane strain associated flow lets the stress out of plane settle where most is borne.
    planes, mean, radius = fine["plane-strain"], -1e6, []
    for axial in np.linspace(-3e6, 0.0, 301):
        left = planes.distances - planes.normals[:, :3] @ [mean, mean, axial]
        radius.append(1 / (planes.normals @ [1.0, -1.0, 0.0, 0.0] / left).max())
    assert max(radius) == pytest.approx(c * cos(phi) - mean * sin(phi), rel=3e-3)


LIMITED: dict[str, tuple[YieldSurface, ...]] = {
    "given": (
        GivenPlanes(
            (
                YieldPlane("a", (0.6, 0.0, 0.0, 0.8, 0.0, 0.0), tied("k")),
                YieldPlane("b", (0.0, -1.0, 0.0, 0.0, 0.0, 0.0), Scalar(2.0, "k")),
            ),
            hardening=tied("h"),
        ),
    ),
    "smooth": (MohrCoulomb(tied("c"), tied("phi"), tied("psi"), tied("T")),),
    "smooth, associated": (MohrCoulomb(tied("c"), tied("phi")),),
    "polyhedra": (
        MohrCoulomb(tied("c"), tied("phi"), tension=tied("T"), planes=8, fit="inscribed"),
        DruckerPrager(tied("c"), tied("phi"), "outer", tied("T"), 12),
        DruckerPrager(tied("c"), tied("phi"), "inner", planes=12),
        DruckerPrager(tied("c"), Scalar(1.2, "phi"), "plane-strain"),
        WeakPlane(Attitude(tied("dip"), tied("direction")), tied("c"), tied("phi"), tied("T")),
    ),
}
SOME = {
    "given": ("k", "h"),
    "smooth": ("c", "phi", "psi", "T"),
    "smooth, associated": ("c", "phi"),
    "polyhedra": ("c", "phi", "T", "dip", "direction"),
}


PARTS = ("normals", "distances", "flow", "hardening")


@pytest.mark.parametrize("n_strain", [4, 6])
@pytest.mark.parametrize("name", LIMITED)
def test_derivatives_agree_with_differences(name, n_strain):
    rock = Material("rock", ROCK, yields=LIMITED[name])
    here = parts_of(rock, VALUES, n_strain)
    for column, parameter in enumerate(VALUES):
        numeric = richardson(
            lambda p, name=parameter: stretched(parts_of(rock, {**VALUES, name: p[0]}, n_strain)),
            np.array([VALUES[parameter]]),
            0,
            1e-2 * VALUES[parameter],
        )
        moves = {part for part, dual in here.items() if dual.slope(column) is not None}
        assert bool(moves) == (parameter in SOME[name])
        at = 0
        for dual in here.values():
            exact, scale = dual.columns[..., 1 + column].ravel(), np.abs(dual.value).max()
            np.testing.assert_allclose(
                exact,
                numeric[at : at + exact.size],
                rtol=1e-6,
                atol=1e-8 * scale / VALUES[parameter],
            )
            at += exact.size


def parts_of(material, values, n_strain):
    """What the planes of a material are made of, with derivatives."""
    planes = yield_planes(material, ParameterPoint(values, tuple(VALUES)), n_strain)
    parts = {part: getattr(planes, part) for part in PARTS}
    return {part: dual for part, dual in parts.items() if dual is not None}


def stretched(parts):
    return np.concatenate([dual.value.ravel() for dual in parts.values()])


@pytest.mark.parametrize("n_strain", [4, 6])
@pytest.mark.parametrize("name", LIMITED)
def test_every_plane_has_its_own_name(name, n_strain):
    rock = Material("rock", ROCK, yields=LIMITED[name])
    planes = yield_planes(rock, ParameterPoint(VALUES, ()), n_strain)
    assert len(planes) == len(planes.names) == len(set(planes.names))


def names_of(*surfaces, n_strain=4):
    rock = Material("rock", ROCK, yields=surfaces)
    return yield_planes(rock, ParameterPoint(VALUES, ()), n_strain).names


def test_planes_are_named_by_family_direction_and_surface():
    """Of a kind that is there twice surfaces are counted; of the others not."""
    square = MohrCoulomb(tied("c"), tied("phi"), tension=tied("T"), planes=4)
    turns = ("0 deg", "45 deg", "90 deg", "135 deg")
    families = ("shear", "shear, axial compression", "shear, axial tension", "tension")
    names = (*(f"{family} {turn}" for family in families for turn in turns), "tension axial")
    assert names_of(square) == names
    assert names_of(replace(square, planes=None)) == ("shear", "tension")
    assert names_of(replace(square, planes=48), n_strain=6)[::48] == ("shear 1", "tension 1")
    plane = (YieldPlane("a", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), Scalar(1e6)),)
    weak = WeakPlane(Attitude(Scalar(0.0), Scalar(pi / 2)), tied("c"), tied("phi"))
    assert names_of(weak, GivenPlanes(plane), replace(weak, tension=tied("T"))) == (
        "weak-plane 1: slip 1", "weak-plane 1: slip 2", "planes: a",
        "weak-plane 2: slip 1", "weak-plane 2: slip 2", "weak-plane 2: opening",
    )  # fmt: skip


@pytest.mark.parametrize("psi", [None, 0.3])
@pytest.mark.parametrize("tension", [None, 3e5])
def test_smooth_mohr_coulomb_in_sorted_principal_stresses(psi, tension):
    """(1 + sin phi) s1 - (1 - sin phi) s3 <= 2 c cos phi; the flow has the angle of dilation."""
    S, strengths = sin(0.6), (None if x is None else Scalar(x) for x in (psi, tension))
    rock = Material("rock", ROCK, yields=(MohrCoulomb(tied("c"), tied("phi"), *strengths),))
    planes = yield_planes(rock, ParameterPoint(VALUES, ()), 6)
    size = sqrt((1 + S) ** 2 + (1 - S) ** 2)
    normals = np.array([[(1 + S) / size, 0.0, (S - 1) / size], [1.0, 0.0, 0.0]])
    count = len(planes)
    assert count == 1 + (tension is not None)
    np.testing.assert_allclose(planes.normals.value, normals[:count], rtol=1e-14)
    np.testing.assert_allclose(planes.distances.value, [2e6 * cos(0.6) / size, 3e5][:count])
    assert (planes.flow is None) == (psi is None)
    if psi is not None:
        flow = np.array([[1 + sin(psi), 0.0, sin(psi) - 1], [size, 0.0, 0.0]]) / size
        np.testing.assert_allclose(planes.flow.value, flow[:count], rtol=1e-14)


@pytest.mark.parametrize("n_strain", [4, 6])
def test_given_planes_are_as_they_are_given(n_strain):
    normals = np.random.default_rng(6).normal(size=(3, 6))
    given = tuple(YieldPlane(f"p{k}", tuple(row), Scalar(k + 1.0)) for k, row in enumerate(normals))
    rock = Material("rock", ROCK, yields=(GivenPlanes(given, Scalar(3e5)),))
    planes = yield_planes(rock, ParameterPoint({}, ()), n_strain)
    np.testing.assert_array_equal(planes.normals.value, normals[:, :n_strain])
    assert planes.distances.value.tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(planes.hardening.value, 3e5 * np.eye(3))
    assert planes.names == ("p0", "p1", "p2")


FROZEN = {
    ("mohr-coulomb", 4, "inscribed"): (81, 6.1503248520e07, 96.449514773),
    ("mohr-coulomb", 4, "best"): (81, 6.1740918219e07, 96.0810483862),
    ("mohr-coulomb", 6, "inscribed"): (43, 1.6969855624e07, 258.202416982),
    ("mohr-coulomb", 6, "best"): (43, 2.5138119196e07, 240.741102076),
    ("drucker-prager", 4, "inscribed"): (49, 4.2672100945e07, 78.1859394701),
    ("drucker-prager", 4, "best"): (49, 4.5760945493e07, 78.2926408398),
    ("drucker-prager", 6, "inscribed"): (47, 2.9307512906e07, 346.759843542),
    ("drucker-prager", 6, "best"): (47, 3.7819246821e07, 323.747235327),
    ("weak-plane", 6, None): (6, 4.2788526724e06, 44.5656825212),
}


@pytest.mark.parametrize("case", FROZEN, ids=str)
def test_planes_are_the_same_on_every_machine_and_in_every_version(case):
    """A case fitted with planes has the same strength later: number, distances, directions."""
    name, n_strain, fit = case
    surfaces = {
        "mohr-coulomb": MohrCoulomb(tied("c"), tied("phi"), None, tied("T"), 20),
        "drucker-prager": DruckerPrager(tied("c"), tied("phi"), "outer", tied("T"), 30),
        "weak-plane": WeakPlane(
            Attitude(tied("dip"), tied("direction")), tied("c"), tied("phi"), tied("T"), 5
        ),
    }
    surface = surfaces[name] if fit is None else replace(surfaces[name], fit=fit)
    planes = planes_of(surface, n_strain=n_strain)
    np.testing.assert_allclose(np.linalg.norm(planes.normals, axis=1), 1.0, rtol=1e-14)
    direction = np.random.default_rng(0).normal(size=(n_strain, 3))[:, 0]
    sums = len(planes.distances), planes.distances.sum(), ((planes.normals @ direction) ** 4).sum()
    assert sums == pytest.approx(FROZEN[case], rel=1e-9)


def test_what_does_not_yield_has_no_law():
    mesh = box("tri3", (1, 1))
    on_mesh = CaseOnMesh(make_case(mesh, materials={"steel": Material("steel", ROCK)}), mesh)
    laws = YieldLaws(ModuliAt(on_mesh, ParameterPoint(VALUES, ()), 4))
    assert laws.law("steel") is None
    assert laws.limits == {}
