"""Moduli that vary from point to point: which are one matrix times a factor, and their bounds."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.anisotropy import STRATA, attitude, scalars
from support.cases import make_case
from support.meshes import box, regroup

from geoident.forward.ground.checks import trials
from geoident.forward.ground.elasticity import (
    ModuliAt,
    field_moduli,
    inadmissible_moduli,
    not_positive,
    vary_whole,
)
from geoident.forward.ground.field import (
    covariance_of,
    field_faults,
    mode_parameters,
    named_parameters,
    point_field,
    with_modes,
)
from geoident.forward.stages import CaseOnMesh
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import (
    Attitude,
    Axes,
    Field,
    Growth,
    Isotropic,
    PointField,
    PointGrowth,
    PointValue,
    TransverselyIsotropic,
    WithDepth,
)
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

POINTS = np.array([3, 5, 6, 9])
KNOWN = np.array([0.1, -0.2, 0.0, 0.3])
MODES = np.array([[0.5, 0.1], [-0.3, 0.2], [0.2, -0.4], [0.1, 0.6]])
XI = {"E.mode-1": 0.7, "E.mode-2": -0.9}


def field(constant="E", **changes):
    settings = {
        "material": "rock", "constant": constant, "surface": None, "points": POINTS,
        "known": KNOWN, "modes": MODES, "names": tuple(XI), "pull": np.zeros(4), "reference": 8e9,
    }  # fmt: skip
    return PointField(**{**settings, **changes})


def growth(constant="E", values=(1e9, 3e9, 2e9, 5e9)):
    said = Growth("rock", constant, Scalar(1.0), WithDepth(Scalar(1.0), Scalar(0.0)))

    def value(point):
        own = np.array(values) * (1.0 + 0.5 * (point.values.get("g", 0.0)))
        columns = np.zeros((4, point.n_columns))
        columns[:, 0] = own
        if "g" in point.names:
            columns[:, 1 + point.names.index("g")] = 0.5 * np.array(values)
        return Dual(columns)

    places = np.column_stack([np.arange(4.0), -np.arange(4.0)])
    return PointGrowth(said, POINTS, places, frozenset({"g"}), value, 2e9)


ISOTROPIC = Isotropic(E=Scalar(1.0, "E"), nu=Scalar(1.0, "nu"))
BULK = Isotropic(K=Scalar(1.0, "E"), G=Scalar(0.5, "E"))
PULL = np.array([0.3, 0.0, 0.6, 0.9])


@pytest.mark.parametrize(
    ("elastic", "fields", "whole"),
    [
        (ISOTROPIC, (field(),), True),
        (BULK, (field("K"),), False),
        (BULK, (field("K"), field("G")), True),
        (BULK, (field("K"), field("G", known=KNOWN + 0.1)), False),
        (BULK, (field("K"), field("G", modes=2 * MODES)), False),
        (BULK, (field("K"), field("G", names=("a", "b"))), False),
        (BULK, (field("K", pull=PULL), field("G")), False),
        (BULK, (field("K"), field("G", pull=PULL)), False),
    ],
)
def test_a_matrix_scales_as_a_whole_where_all_moduli_vary_alike(elastic, fields, whole):
    assert vary_whole(elastic, fields, ()) == whole


def test_a_matrix_grows_as_a_whole_with_its_only_modulus():
    assert vary_whole(ISOTROPIC, (), (growth(),))
    assert not vary_whole(ISOTROPIC, (field(),), (growth(),))
    assert not vary_whole(BULK, (), (growth("K"),))
    assert not vary_whole(BULK, (), (growth("K"), growth("G")))


VALUES = {"E": 6e9, "nu": 0.22, "g": 0.3, **XI}
EVERY = ParameterPoint(VALUES, tuple(VALUES))
FACTORS = np.exp(KNOWN + MODES @ np.array(list(XI.values())))


def matrix(E, nu):
    """(4, 4) of a plane section, of Hooke's law turned round."""
    compliance = np.full((3, 3), -nu / E)
    np.fill_diagonal(compliance, 1.0 / E)
    found = np.zeros((4, 4))
    found[:3, :3] = np.linalg.inv(compliance)
    found[3, 3] = E / (2 * (1 + nu))
    return found


def at_points(values, kind):
    """(4, 4, 4) moduli at the points, reckoned one by one."""
    E, nu, g = values["E"], values["nu"], values["g"]
    factor = np.exp(KNOWN + MODES @ np.array([values[name] for name in XI]))
    if kind == "held":
        factor = factor * (8e9 / E) ** PULL
    if kind == "grown":
        moduli = np.array([1e9, 3e9, 2e9, 5e9]) * (1 + 0.5 * g)
    elif kind == "bulk":  # K varies, G = K_mean / 2 does not
        K, G = E * factor, 0.5 * E
        return np.array([matrix(9 * k * G / (3 * k + G), (3 * k - 2 * G) / (6 * k + 2 * G))
                         for k in K])  # fmt: skip
    else:
        moduli = E * factor
    return np.array([matrix(one, nu) for one in moduli])


@pytest.mark.parametrize("kind", ["plain", "held", "grown", "bulk"])
def test_moduli_and_their_derivatives_at_every_point(kind):
    fields = () if kind == "grown" else (field("K" if kind == "bulk" else "E"),)
    if kind == "held":
        fields = (field(pull=PULL),)
    growths = (growth(),) if kind == "grown" else ()
    elastic = replace(ISOTROPIC, E=Scalar(2e9)) if kind == "grown" else ISOTROPIC
    found = field_moduli(BULK if kind == "bulk" else elastic, fields, EVERY, 4, growths)
    every = np.arange(4)
    np.testing.assert_allclose(found.value.matrices(every), at_points(VALUES, kind), rtol=1e-11)
    some = found.at(np.array([3, 1]))
    np.testing.assert_allclose(
        some.value.matrices(np.arange(2)), at_points(VALUES, kind)[[3, 1]], rtol=1e-11
    )
    for name, value in VALUES.items():
        h = 1e-3 * abs(value)
        a, b, c, d = (at_points({**VALUES, name: value + k * h}, kind) for k in (-2, -1, 1, 2))
        exact = (a - 8 * b + 8 * c - d) / (12 * h)
        if name in XI:
            own = np.zeros((4, 4, 4))
            for slopes in found.modes:
                column = slopes.modes[:, tuple(XI).index(name)]
                own += slopes.moduli.matrices(every) * column[:, None, None]
            two = [m.moduli.matrices(np.arange(2)) * m.modes[:, [tuple(XI).index(name)]][..., None]
                   for m in some.modes]  # fmt: skip
            assert bool(two) == (kind != "grown")
            if two:
                np.testing.assert_allclose(sum(two), own[[3, 1]], rtol=1e-12)
        elif name in found.slopes:
            own = found.slopes[name].matrices(every)
            np.testing.assert_allclose(
                some.slopes[name].matrices(np.arange(2)), own[[3, 1]], rtol=1e-12
            )
        else:
            own = np.zeros((4, 4, 4))
        noise = 1e-13 * np.abs(a).max() / h
        np.testing.assert_allclose(own, exact, rtol=1e-8, atol=noise)
        known = name in XI or name in found.slopes
        assert known or np.abs(exact).max() < noise, name


def test_modes_that_are_not_asked_for_have_no_derivatives():
    point = ParameterPoint(VALUES, ("E",))
    for elastic, constant in ((ISOTROPIC, "E"), (BULK, "K")):
        found = field_moduli(elastic, (field(constant),), point, 4)
        assert found.modes == ()
        assert set(found.slopes) == {"E"}


ROCK = Material("rock", ISOTROPIC)


def test_what_varies_too_much_is_outside_of_the_domain():
    plain = {**VALUES}
    assert inadmissible_moduli(ROCK, (field(),), plain, 4) is None
    beyond = "E of rock is beyond all measure at a strain point"
    assert inadmissible_moduli(ROCK, (field(),), {**plain, "E.mode-1": 2e3}, 4) == beyond
    assert inadmissible_moduli(ROCK, (field(),), {**plain, "E.mode-1": -3e3}, 4) == beyond
    strata = TransverselyIsotropic(**scalars(STRATA), frame=attitude(0.4))
    rock = Material("rock", strata)
    varies = field("E_n", known=np.zeros(4), modes=np.eye(4)[:, :2])
    assert inadmissible_moduli(rock, (varies,), {**plain, **dict.fromkeys(XI, 0.1)}, 4) is None
    # nu_np = 0.18 allows E_p / E_n up to (1 - 0.22) / (2 x 0.18^2) = 12.04, of the mean it is 2.5
    limit = np.log(8e9 * (1 - 0.22) / (2 * 0.18**2) / 20e9)
    for part, told in ((-0.99, False), (-1.01, True)):
        values = {**plain, "E.mode-1": part * limit, "E.mode-2": 0.0}
        found = inadmissible_moduli(rock, (varies,), values, 4)
        assert (found is not None) == told
    assert found.startswith("where E_n of rock varies most, its elasticity is not positive")
    upper = replace(varies, modes=-varies.modes)
    assert inadmissible_moduli(rock, (upper,), values, 4) is None


def test_a_constant_that_grows_must_be_positive_everywhere():
    assert not_positive(growth(), {}) is None
    assert not_positive(growth(values=(1e9, 3e9, 1e-3, 5e9)), {}) is None
    for bad, number in ((0.0, "0"), (-2e9, "-2e+09"), (np.nan, "nan")):
        said = not_positive(growth(values=(1e9, 3e9, bad, 5e9)), {})
        assert said == (
            f"E of rock grows with depth: it is {number} Pa at (2, -2) m, where it must be positive"
        )
    assert "at (3, -3) m" in not_positive(growth(values=(1e9, -1e9, 2e9, -5e9)), {})
    rock = Material("rock", replace(ISOTROPIC, E=Scalar(2e9)))
    low = growth(values=(1e9, 3e9, -1.0, 5e9))
    assert "must be positive" in inadmissible_moduli(rock, (), VALUES, 4, (low,))
    assert inadmissible_moduli(rock, (), VALUES, 4, (growth(),)) is None


def test_moduli_of_some_points_are_those_of_all_at_them():
    mesh = regroup(box("quad4", (3, 2)), low=lambda c: c[:, 1] < 0.5)
    case = make_case(
        mesh, materials={"rock": ROCK, "other": replace(ROCK, name="other")},
        groups={"low": "rock", "rock": "other"},
    )  # fmt: skip
    on_mesh = CaseOnMesh(case, mesh)
    points = on_mesh.material_points("rock")
    n = len(points)
    varies = field(points=points, known=0.1 * np.arange(n), modes=np.zeros((n, 2)),
                   pull=np.zeros(n))  # fmt: skip
    at = ModuliAt(on_mesh.with_fields(case, (varies,)), EVERY, 4)
    whole = at.moduli("rock").value.matrices(np.arange(n))
    np.testing.assert_allclose(
        whole, [matrix(6e9 * np.exp(0.1 * k), 0.22) for k in range(n)], rtol=1e-11
    )
    some = points[[1, 4, 7]]
    part = at.moduli("rock", some)
    np.testing.assert_allclose(part.value.matrices(np.arange(3)), whole[[1, 4, 7]], rtol=1e-14)
    assert at.moduli("rock", some) is part
    other = points[[2, 3]]
    np.testing.assert_allclose(
        at.moduli("rock", other).value.matrices(np.arange(2)), whole[[2, 3]], rtol=1e-14
    )
    assert at.moduli("rock", points) is at.moduli("rock")
    uniform = at.moduli("other")
    assert at.moduli("other", on_mesh.material_points("other")[:2]) is uniform
    np.testing.assert_allclose(uniform.value.matrices(np.arange(1))[0], matrix(6e9, 0.22))


def said(**changes):
    settings = {
        "material": "rock", "constant": "E", "mean": Scalar(2.0, "m"), "sd": 0.4,
        "lengths": (3.0,), "frame": Attitude(Scalar(0.0), Scalar(0.0)),
    }  # fmt: skip
    return Field(**{**settings, **changes})


def test_correlation_lengths_are_those_along_the_axes():
    """exp(-1) at a distance of the length; in a section down the dip and normal to it."""
    tilt, corner = 0.4, np.zeros((1, 2))
    dipping = Attitude(Scalar(tilt), Scalar(np.pi / 2))
    sectional = covariance_of(said(lengths=(6.0, 2.0), frame=dipping, smoothness=0.5), 2)
    down, normal = np.array([np.cos(tilt), -np.sin(tilt)]), np.array([np.sin(tilt), np.cos(tilt)])
    for way, length in ((down, 6.0), (normal, 2.0)):
        (found,) = sectional.between(corner, length * way[None])
        assert found == pytest.approx(0.4**2 * np.exp(-1.0), rel=1e-9)
    axes = Axes((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    for lengths in ((5.0,), (5.0, 3.0, 2.0)):
        solid = covariance_of(said(lengths=lengths, frame=axes, smoothness=0.5), 3)
        for axis, length in enumerate(lengths * (3 // len(lengths))):
            (found,) = solid.between(np.zeros((1, 3)), length * np.eye(3)[[axis]])
            assert found == pytest.approx(0.4**2 * np.exp(-1.0), rel=1e-9)


def test_a_field_passes_through_its_tests_as_simple_kriging_says():
    rng = np.random.default_rng(2)
    positions = rng.uniform(0.0, 8.0, (6, 2))
    tests = (
        PointValue((1.0, 2.0), 5.0, 0.5),
        PointValue((6.0, 3.0), 2.5),
        PointValue((4.0, 7.0), 3.0, 0.3),
    )
    given = said(measured=tests, smoothness=0.5)
    made = point_field(given, np.arange(10, 16), positions, {"m": 1.9})
    at = np.array([test.position for test in tests])

    def covariance(a, b):
        return 0.16 * np.exp(-np.linalg.norm(a[:, None] - b[None], axis=2) / 3.0)

    noise = np.array([0.1**2, 1e-10 * 0.16, 0.1**2])
    weights = covariance(positions, at) @ np.linalg.inv(covariance(at, at) + np.diag(noise))
    logs = np.log(np.array([5.0, 2.5, 3.0]) / 3.8)
    np.testing.assert_allclose(made.known, weights @ logs, rtol=1e-8)
    np.testing.assert_allclose(made.pull, weights.sum(axis=1), rtol=1e-8)
    assert made.reference == pytest.approx(3.8)
    left = covariance(positions, positions) - weights @ covariance(at, positions)
    whole = point_field(replace(given, modes=6), np.arange(6), positions, {"m": 1.9})
    assert whole.explained >= 0.99
    np.testing.assert_allclose(whole.modes @ whole.modes.T, left, atol=0.011 * np.trace(left))
    assert made.explained >= 0.99
    one = point_field(replace(given, modes=1), np.arange(6), positions, {"m": 1.9})
    assert one.modes.shape == (6, 1)
    assert one.explained == pytest.approx(np.linalg.eigvalsh(left)[-1] / np.trace(left), rel=1e-6)
    np.testing.assert_array_equal(made.points, np.arange(10, 16))
    assert made.names[:2] == ("rock.E.mode-1", "rock.E.mode-2")


def test_modes_are_parameters_after_those_of_the_case():
    first = Parameter("m", 1.9, 1.0, 4.0)
    rock = Material("rock", ISOTROPIC, fields=(said(),))
    other = Material("other", ISOTROPIC, fields=(replace(said(), material="other"),))
    case = make_case(
        Mesh(np.empty((0, 2)), ()), parameters=(first,), materials={"rock": rock, "other": other}
    )
    names = ("rock.E.mode-1", "other.E.mode-1", "none.E.mode-1", "m")
    found = mode_parameters(case, names)
    assert [p.name for p in found] == list(names[:2])
    assert [p.field for p in found] == ["rock.E", "other.E"]
    for p in found:
        assert (p.start, p.lower, p.upper) == (0.0, -10.0, 10.0)
        assert (p.prior.mean, p.prior.sd) == (0.0, 1.0)
    made = with_modes(case, [SimpleNamespace(names=names[:1]), SimpleNamespace(names=names[1:2])])
    assert [p.name for p in made.parameters] == ["m", *names[:2]]
    again = with_modes(made, [SimpleNamespace(names=names[:1]), SimpleNamespace(names=())])
    assert [p.name for p in again.parameters] == ["m", names[0]]
    assert named_parameters(made) == (first,)


def test_tests_outside_of_their_material_are_faults():
    tests = (PointValue((1.0, 2.0), 5.0), PointValue((6.0, 3.0), 2.5, origin="line 7"))
    case = make_case(
        Mesh(np.empty((0, 2)), ()),
        materials={"rock": Material("rock", ISOTROPIC, fields=(said(measured=tests),))},
    )
    asked = []

    def not_in(material, point):
        asked.append((material, point))
        return None if point == (1.0, 2.0) else "lies in the group 'top'"

    (fault,) = field_faults(case, not_in)
    assert asked == [("rock", (1.0, 2.0)), ("rock", (6.0, 3.0))]
    assert fault.message == "the measured point (6, 3) m (line 7) lies in the group 'top'"
    assert field_faults(case, lambda material, point: None) == []


def test_points_at_which_sections_are_looked_at():
    """A second one beside the start, so that no coincidence there counts."""
    angle = Parameter("dip", 0.0, 0.0, 3.0, dimension="angle")
    start, moved = trials((Parameter("E", 5.0, 1.0, 9.0), angle, Parameter("nu", 0.2, 0.0, 0.5)))
    assert start == {"E": 5.0, "dip": 0.0, "nu": 0.2}
    assert all(moved[name] != start[name] for name in start)
    assert abs(moved["dip"]) > 0.05
