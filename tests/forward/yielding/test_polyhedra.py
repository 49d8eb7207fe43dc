"""Every plane of every surface by the formula of its surface, one by one, with its name."""

from __future__ import annotations

from itertools import permutations
from math import cos, pi, sin, sqrt, tan

import numpy as np
import pytest

from geoident.forward.yielding.facets import (
    polygon_shrinkage,
    shrinkage,
    spread_directions,
    spread_frames,
)
from geoident.forward.yielding.mohr_coulomb import (
    _solid_shrinkage,
    cut_off,
    mohr_coulomb,
    products,
)
from geoident.forward.yielding.surfaces import cut_off_count, yield_planes
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Attitude, Axes, Isotropic
from geoident.model.parameter import Scalar
from geoident.model.yielding import (
    DruckerPrager,
    GivenPlanes,
    MohrCoulomb,
    WeakPlane,
    YieldPlane,
)

C, PHI, PSI, T = 0.7e6, 0.55, 0.21, 0.3e6
S = sin(PHI)
NOWHERE = ParameterPoint({}, ())
FITS = ("inscribed", "best", "circumscribed")


def planes_of(*surfaces, n_strain):
    ground = Isotropic(Scalar(1e9), Scalar(0.3))
    return yield_planes(Material("rock", ground, yields=surfaces), NOWHERE, n_strain)


def assert_planes(found, normals, distances):
    """The same planes in the same order, with normals of unit length."""
    normals, distances = np.array(normals), np.array(distances)
    size = np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(found.normals.value, normals / size[:, None], atol=1e-13)
    np.testing.assert_allclose(found.distances.value, distances / size, rtol=1e-12)


def on_tensor(matrix, n_strain=6):
    """Components whose product with a stress is the sum of a matrix times its tensor."""
    shears = [matrix[i, j] + matrix[j, i] for i, j in ((0, 1), (1, 2), (0, 2))]
    return np.array([*np.diag(matrix), *shears])[:n_strain]


def mohr_circle(sides, fit):
    """Sides of the polygon in place of the circle of Mohr: r as products with xx, yy, zz, xy."""
    turns = 2 * pi * np.arange(sides) / sides
    zero = 0.0 * turns
    return np.stack([np.cos(turns) / 2, -np.cos(turns) / 2, zero, np.sin(turns)], 1) / (
        polygon_shrinkage(sides, fit)
    )


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("sides", [4, 7])
def test_mohr_coulomb_in_a_section(sides, fit):
    surface = MohrCoulomb(Scalar(C), Scalar(PHI), tension=Scalar(T), planes=sides, fit=fit)
    mean, axial = np.array([0.5, 0.5, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 0.0])
    circle, turns = mohr_circle(sides, fit), [f"{180 * k / sides:g} deg" for k in range(sides)]
    families = {
        "shear": [2 * S * mean + 2 * r for r in circle],
        "shear, axial compression": [(1 + S) * (mean + r) - (1 - S) * axial for r in circle],
        "shear, axial tension": [(1 + S) * axial - (1 - S) * (mean - r) for r in circle],
        "tension": [mean + r for r in circle],
    }
    found = planes_of(surface, n_strain=4)
    normals = [*np.concatenate(list(families.values())), axial]
    assert_planes(found, normals, [2 * C * cos(PHI)] * (3 * sides) + [T] * (sides + 1))
    assert found.names == (*(f"{f} {turn}" for f in families for turn in turns), "tension axial")
    assert found.hardening is None
    plain = planes_of(MohrCoulomb(Scalar(C), Scalar(PHI), planes=sides, fit=fit), n_strain=4)
    assert plain.names == found.names[: 3 * sides]


def test_products_take_components_along_two_directions():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 5, 3))
    half = rng.normal(size=(3, 3))
    tensor = half + half.T
    stress = tensor[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(products(a, b) @ stress, np.einsum("ki,ij,kj->k", a, tensor, b))


def largest(coordinates, low=0.0):
    """Largest principal value, less a part of the smallest, of coordinates (m, 5) of deviators."""
    x, y, *shears = (np.asarray(part) for part in coordinates.T)
    tensor = np.zeros((len(coordinates), 3, 3))
    for k, diagonal in enumerate(
        (x / sqrt(2) - y / sqrt(6), -x / sqrt(2) - y / sqrt(6), y * 2 / sqrt(6))
    ):
        tensor[:, k, k] = diagonal
    for (i, j), shear in zip(((0, 1), (1, 2), (0, 2)), shears, strict=True):
        tensor[:, i, j] = tensor[:, j, i] = shear / sqrt(2)
    values = np.linalg.eigvalsh(tensor)
    return (1.0 + low) * values[:, 2] - (1.0 - low) * values[:, 0] if low else values[:, 2]


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("planes", [7, 18])
def test_mohr_coulomb_in_a_solid(planes, fit):
    """Of each frame all pairs of its axes; the deviator is divided by the factor of the fit."""
    count = -(-planes // 6)
    surface = MohrCoulomb(Scalar(C), Scalar(PHI), planes=planes, fit=fit)
    kappa, normals = _solid_shrinkage(count, fit), []
    for frame in spread_frames(count):
        for i, j in ((0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1)):
            a, b = frame[:, i], frame[:, j]
            whole = (1 + S) * np.outer(a, a) - (1 - S) * np.outer(b, b)
            mean = np.eye(3) * np.trace(whole) / 3
            normals.append(on_tensor(mean + (whole - mean) / kappa))
    found = planes_of(surface, n_strain=6)
    assert_planes(found, normals, [2 * C * cos(PHI)] * len(normals))
    assert found.names == tuple(f"shear {k}" for k in range(1, 1 + len(normals)))


@pytest.mark.parametrize("count", [3])
def test_the_factor_of_pairs_in_a_solid(count):
    """Inscribed: the least over all angles of friction; what is drawn comes near it from above."""
    rng = np.random.default_rng(4)
    x = rng.normal(size=(8_000, 5))
    tensors = [np.outer(a, a) for frame in spread_frames(count) for a in frame.T]
    basis = np.zeros((5, 6))
    basis[0, :2] = sqrt(0.5), -sqrt(0.5)
    basis[1, :3] = np.array([-1, -1, 2]) / sqrt(6)
    basis[2:, 3:] = sqrt(0.5) * np.eye(3)  # components of stresses of unit size
    stress = x @ basis
    along = stress @ np.array([on_tensor(t) for t in tensors]).T
    ratios = {}
    for s in (0.0, 0.3, 0.5, 0.95):
        pairs = [
            (1 + s) * along[:, 3 * f + i] - (1 - s) * along[:, 3 * f + j]
            for f in range(len(tensors) // 3)
            for i, j in permutations(range(3), 2)
        ]
        values = np.linalg.eigvalsh(
            np.array([[stress[:, 0], stress[:, 3], stress[:, 5]],
                      [stress[:, 3], stress[:, 1], stress[:, 4]],
                      [stress[:, 5], stress[:, 4], stress[:, 2]]]).transpose(2, 0, 1)
        )  # fmt: skip
        ratios[s] = np.max(pairs, axis=0) / ((1 + s) * values[:, 2] - (1 - s) * values[:, 0])
    least = min(ratio.min() for ratio in ratios.values())
    assert _solid_shrinkage(count, "inscribed") < least
    assert _solid_shrinkage(count, "inscribed") > 0.85 * least
    assert _solid_shrinkage(count, "best") == pytest.approx(ratios[0.5].mean(), rel=1e-2)
    assert _solid_shrinkage(count, "circumscribed") == 1.0


def test_the_factors_of_pairs_are_the_same_on_every_machine():
    """What was fitted with planes of one version is of the same strength in the next."""
    assert _solid_shrinkage(3, "best") == pytest.approx(0.8209186762364789, rel=1e-9)
    assert _solid_shrinkage(8, "best") == pytest.approx(0.8907986221729629, rel=1e-9)
    assert _solid_shrinkage(8, "inscribed") == pytest.approx(0.6321203034186605, rel=1e-9)


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("count", [3, 12, 20])
def test_a_cut_off_in_a_solid(count, fit):
    """One of each pair of opposite directions: the one that points ahead, first along x."""
    limit = Dual(np.array([T, 2.0]))
    found = cut_off(limit, ParameterPoint({}, ("p",)), 6, count, fit)
    kept = [
        a
        for a in spread_directions(2 * max(count, 12))
        if next(x for x in a if abs(x) > 1e-9) > 0.0
    ]
    deviators = [np.outer(a, a) - np.eye(3) / 3 for a in kept]
    kappa = shrinkage(fit, np.array([on_tensor(d) for d in deviators]), largest)
    normals = [on_tensor(np.eye(3) / 3 + d / kappa) for d in deviators]
    np.testing.assert_allclose(found.normals.value, normals, atol=1e-13)
    np.testing.assert_array_equal(found.normals.columns[..., 1], 0.0)
    np.testing.assert_array_equal(found.distances.columns, [[T, 2.0]] * len(kept))
    assert found.names == tuple(f"tension {k}" for k in range(1, 1 + len(kept)))


def test_a_polygon_of_planes_needs_their_number():
    with pytest.raises(ValueError, match=r"^the smooth surface is no polyhedron$"):
        mohr_coulomb(MohrCoulomb(Scalar(C), Scalar(PHI)), NOWHERE, 4)


@pytest.mark.parametrize("psi", [None, PSI])
@pytest.mark.parametrize("tension", [None, T])
def test_smooth_mohr_coulomb_in_sorted_principal_stresses(psi, tension):
    surface = MohrCoulomb(
        Scalar(C), Scalar(PHI), None if psi is None else Scalar(psi),
        None if tension is None else Scalar(tension),
    )  # fmt: skip
    found = planes_of(surface, n_strain=6)
    cut = [] if tension is None else [[1.0, 0.0, 0.0]]
    assert_planes(found, [[1 + S, 0.0, S - 1], *cut], [2 * C * cos(PHI), *[T] * len(cut)])
    assert found.names == ("shear", "tension")[: 1 + len(cut)]
    if psi is None:
        assert found.flow is None
    else:  # it keeps its angle to a normal of unit length
        size = sqrt((1 + S) ** 2 + (1 - S) ** 2)
        flow = [1 + sin(PSI), 0.0, sin(PSI) - 1]
        np.testing.assert_allclose(found.flow.value[0], np.array(flow) / size, rtol=1e-13)
        np.testing.assert_array_equal(found.flow.value[1:], cut or np.empty((0, 3)))


CONES = {
    "outer": (2 * S / (sqrt(3) * (3 - S)), 6 * C * cos(PHI) / (sqrt(3) * (3 - S))),
    "inner": (2 * S / (sqrt(3) * (3 + S)), 6 * C * cos(PHI) / (sqrt(3) * (3 + S))),
    "plane-strain": (
        tan(PHI) / sqrt(9 + 12 * tan(PHI) ** 2), 3 * C / sqrt(9 + 12 * tan(PHI) ** 2)
    ),
}  # fmt: skip


@pytest.mark.parametrize("n_strain", [4, 6])
@pytest.mark.parametrize("match", CONES)
def test_drucker_pragers_cone(match, n_strain):
    """alpha I1 plus a deviator, whose products over all facets come to sqrt(J2), within k."""
    alpha, k = CONES[match]
    surface = DruckerPrager(Scalar(C), Scalar(PHI), match, planes=40, fit="circumscribed")
    found = planes_of(surface, n_strain=n_strain)
    scale = k / found.distances.value  # what the normals were divided by
    normals = found.normals.value * scale[:, None]
    np.testing.assert_allclose(normals[:, :3].sum(axis=1), 3 * alpha, rtol=1e-12)
    deviators = normals - alpha * np.array([1.0] * 3 + [0.0] * (n_strain - 3))
    # as tensors of size 1 / sqrt 2, so that the product with itself is sqrt(J2) of it times that
    tensors = deviators * np.array([1.0] * 3 + [sqrt(0.5)] * (n_strain - 3))
    np.testing.assert_allclose(np.linalg.norm(tensors, axis=1), sqrt(0.5), rtol=1e-12)
    assert 40 <= len(found) < 60
    assert found.names == tuple(f"shear {n}" for n in range(1, 1 + len(found)))
    cut = planes_of(
        DruckerPrager(Scalar(C), Scalar(PHI), match, Scalar(T), 40, "circumscribed"),
        n_strain=n_strain,
    )
    count = cut_off_count(40, n_strain)
    wanted = cut_off(Dual(np.array([T])), NOWHERE, n_strain, count, "circumscribed")
    wanted = wanted.of_unit_length()
    np.testing.assert_allclose(cut.normals.value[len(found) :], wanted.normals.value, atol=1e-14)
    np.testing.assert_allclose(cut.distances.value[len(found) :], wanted.distances.value)
    assert cut.names == (*found.names, *wanted.names)


def test_facets_of_a_cone_are_shrunk_as_they_are_to_fit():
    sizes = {}
    for fit in FITS:
        surface = DruckerPrager(Scalar(C), Scalar(0.0), planes=24, fit=fit)
        sizes[fit] = planes_of(surface, n_strain=6)
    normals = sizes["circumscribed"].normals.value
    for fit in FITS:
        np.testing.assert_allclose(sizes[fit].normals.value, normals, atol=1e-13)
        facets = sqrt(2.0) * C / sizes["circumscribed"].distances.value[:, None] * normals
        part = shrinkage(fit, facets, lambda x: np.linalg.norm(x, axis=1))
        shorter = sizes[fit].distances.value / sizes["circumscribed"].distances.value
        np.testing.assert_allclose(shorter, part, rtol=1e-9)
    assert sizes["inscribed"].distances.value[0] < sizes["best"].distances.value[0]


def test_a_cut_off_of_a_cone_has_a_part_of_its_planes():
    """Half of them in a section, an even number, four at least; a sixth in a solid."""
    assert [cut_off_count(n, 4) for n in (3, 7, 8, 11, 12, 25)] == [4, 4, 4, 4, 6, 12]
    assert [cut_off_count(n, 6) for n in (24, 29, 30, 600)] == [4, 4, 5, 100]


def test_weak_planes_slide_and_open_in_a_section():
    """They fall towards +x by the dip: the normal is (sin, cos), along the plane (cos, -sin)."""
    dip = 0.3
    surface = WeakPlane(
        Attitude(Scalar(dip), Scalar(pi / 2)), Scalar(C), Scalar(PHI), Scalar(T), planes=9
    )
    normal, along = np.array([sin(dip), cos(dip), 0.0]), np.array([cos(dip), -sin(dip), 0.0])
    press = on_tensor(np.outer(normal, normal), 4)
    slide = on_tensor(np.outer(normal, along), 4)
    found = planes_of(surface, n_strain=4)
    sign = np.sign(found.normals.value[0] @ slide)
    rows = [S * press + cos(PHI) * sign * slide, S * press - cos(PHI) * sign * slide, press]
    assert_planes(found, rows, [C * cos(PHI)] * 2 + [T])
    assert found.names == ("slip 1", "slip 2", "opening")


def test_weak_planes_slide_along_a_polygon_in_a_solid():
    first, second = np.array([0.6, 0.8, 0.0]), np.array([-0.48, 0.36, 0.8])
    normal = np.cross(first, second)
    surface = WeakPlane(Axes(tuple(first), tuple(second)), Scalar(C), Scalar(PHI), None, planes=5)
    press = on_tensor(np.outer(normal, normal))
    turns = 2 * pi * np.arange(5) / 5
    longer = (pi / 5) / sin(pi / 5)  # of the same size on average
    ways = longer * (np.outer(np.cos(turns), first) + np.outer(np.sin(turns), second))
    rows = [S * press + cos(PHI) * on_tensor(np.outer(normal, way)) for way in ways]
    found = planes_of(surface, n_strain=6)
    assert_planes(found, rows, [C * cos(PHI)] * 5)
    assert found.names == tuple(f"slip {n}" for n in range(1, 6))


@pytest.mark.parametrize("n_strain", [4, 6])
def test_given_planes_are_as_they_are_given(n_strain):
    normals = np.random.default_rng(6).normal(size=(3, 6))
    planes = tuple(
        YieldPlane(f"p{k}", tuple(row), Scalar(1e6 * (k + 1))) for k, row in enumerate(normals)
    )
    found = planes_of(GivenPlanes(planes, Scalar(3e5)), n_strain=n_strain)
    np.testing.assert_array_equal(found.normals.value, normals[:, :n_strain])
    assert found.distances.value.tolist() == [1e6, 2e6, 3e6]
    np.testing.assert_array_equal(found.hardening.value, 3e5 * np.eye(3))
    assert found.names == ("p0", "p1", "p2")
    assert planes_of(GivenPlanes(planes), n_strain=n_strain).hardening is None


def test_planes_of_several_surfaces_say_which_surface_they_are_of():
    """Those of a kind that is there twice are counted; the others are not."""
    plane = (YieldPlane("a", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), Scalar(1e6)),)
    weak = [WeakPlane(Attitude(Scalar(d), Scalar(pi / 2)), Scalar(C), Scalar(PHI)) for d in (0, 1)]
    found = planes_of(weak[0], GivenPlanes(plane), weak[1], n_strain=4)
    assert found.names == (
        "weak-plane 1: slip 1", "weak-plane 1: slip 2", "planes: a",
        "weak-plane 2: slip 1", "weak-plane 2: slip 2",
    )  # fmt: skip
    assert len(found) == 5
