"""Random fields of constants: their covariance, what tests hold of them, modes as parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.anisotropy import STRATA, attitude, scalars
from support.cases import field_on, make_case, model_with_fields, rollers
from support.meshes import box

from geoident.forward.ground.field import (
    covariance_of,
    mode_parameters,
    named_parameters,
    point_field,
    with_modes,
)
from geoident.model.case import Material
from geoident.model.ground import (
    Attitude,
    Axes,
    Isotropic,
    PointValue,
    RandomField,
    TransverselyIsotropic,
)
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

ISOTROPIC = Isotropic(E=Scalar(1.0, "m"), nu=Scalar(0.2))


def said(**changes):
    settings = {
        "material": "rock", "constant": "E", "mean": Scalar(2.0, "m"), "sd": 0.4,
        "lengths": (3.0,), "frame": Attitude(Scalar(0.0), Scalar(0.0)),
    }  # fmt: skip
    return RandomField(**{**settings, **changes})


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
    rock, other = (
        Material(name, ISOTROPIC, fields=(said(material=name),)) for name in ("rock", "other")
    )
    materials = {"rock": rock, "other": other}
    case = make_case(Mesh(np.empty((0, 2)), ()), parameters=(first,), materials=materials)
    positions = np.random.default_rng(2).uniform(0.0, 8.0, (6, 2))
    made = [
        point_field(replace(one, modes=2), np.arange(6), positions, {"m": 1.9})
        for one in case.fields
    ]
    names = [f"{name}.E.mode-{k}" for name in materials for k in (1, 2)]
    whole = with_modes(case, made)
    assert [p.name for p in whole.parameters] == ["m", *names]
    for p in whole.parameters[1:]:
        assert (p.start, p.lower, p.upper) == (0.0, -10.0, 10.0)
        assert (p.prior.mean, p.prior.sd) == (0.0, 1.0)
        assert p.name.startswith(f"{p.field}.")
    assert named_parameters(whole) == (first,)
    fewer = with_modes(whole, made[:1])  # of another mesh
    assert [p.name for p in fewer.parameters] == ["m", *names[:2]]
    assert mode_parameters(case, ["none.E.mode-1", "m"]) == ()


def test_ratios_that_a_field_of_moduli_does_not_allow_are_outside_the_domain():
    """nu_np = 0.18 allows E_n down to 2 x 0.18^2 E_p / (1 - 0.22); of the mean it is far above."""
    strata = TransverselyIsotropic(**scalars(STRATA), frame=attitude(0.4, np.pi / 2))
    limit = STRATA["E_n"] / (2 * STRATA["nu_np"] ** 2 * STRATA["E_p"] / (1 - STRATA["nu_p"]))
    staged = model_with_fields(
        box("quad4", (2, 2)),
        lambda on_mesh: [field_on(on_mesh, "rock", "E_n", lambda x: x[:, :1] > x[:, :1].mean())],
        materials={"rock": Material("rock", strata)},
        groups={"all": "rock"},
        supports=rollers(2),
        parameters=(Parameter("rock.E_n.mode-1", 0.0, -9.0, 9.0),),
    )
    for part in (0.0, -0.99, 1.01):
        assert staged.admissible(np.array([part * np.log(limit)])) is None
    found = staged.admissible(np.array([-1.01 * np.log(limit)]))
    assert found.startswith("where E_n of rock varies most, its elasticity is not positive")
