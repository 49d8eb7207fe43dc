"""Changes of temperature: free and restrained expansion, fields, derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.model.actions import TemperatureField
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.parameter import Parameter, Scalar

E, NU, ALPHA, RISE = 20e9, 0.2, 1.1e-5, 15.0


def concrete(name="concrete", *, expansion=ALPHA):
    elastic = Isotropic(E=Scalar(E), nu=Scalar(NU))
    return Material(name, elastic, Scalar(2400.0), Scalar(expansion))


def warmed(mesh, *, supports, stages=None, materials=None, groups=None):
    staged = model(
        mesh,
        materials=materials or {"concrete": concrete()},
        groups=groups or {"all": "concrete"},
        supports=supports,
        stages=stages or (Stage("warm", temperature={"all": Scalar(RISE)}),),
    )
    return staged.survey(np.empty(0), fields=True).fields


@pytest.mark.parametrize("kind", ["tet4", "hex8", "tet10", "hex20"])
def test_a_free_solid_expands_without_stress(kind):
    result = warmed(box(kind, (2, 2, 3), distortion=0.1), supports=rollers(3))
    np.testing.assert_allclose(
        result.displacement[1], ALPHA * RISE * result.mesh.points, atol=1e-12 * ALPHA * RISE
    )
    assert np.abs(result.stress[1]).max() < 1e-10 * E * ALPHA * RISE


def test_a_plane_section_is_held_out_of_plane():
    """eps_zz = 0: sigma_zz = -E alpha dT, and in the plane (1 + nu) alpha dT."""
    result = warmed(box("quad8", (3, 2), distortion=0.1), supports=rollers(2))
    expected = (1 + NU) * ALPHA * RISE * result.mesh.points
    np.testing.assert_allclose(result.displacement[1], expected, atol=1e-12 * ALPHA * RISE)
    stress = result.stress[1]
    np.testing.assert_allclose(stress[:, 2], -E * ALPHA * RISE, rtol=1e-10)
    assert np.abs(stress[:, [0, 1, 3]]).max() < 1e-9 * E * ALPHA * RISE


def test_a_restrained_bar_is_compressed():
    supports = (*rollers(3), Support("x1", (0,)))
    result = warmed(box("hex8", (6, 2, 2), size=(6.0, 1.0, 1.0)), supports=supports)
    np.testing.assert_allclose(result.stress[1][:, 0], -E * ALPHA * RISE, rtol=1e-10)
    assert np.abs(result.stress[1][:, 1:]).max() < 1e-9 * E * ALPHA * RISE


def test_a_linear_field_bends_a_free_body_without_stress(verification):
    """dT = T x in a free solid: u_x = a T (x^2 - y^2 - z^2) / 2, u_y = a T x y, u_z = a T x z."""
    points = tuple((float(x), float(y), float(z)) for x in (0, 2) for y in (0, 1) for z in (0, 1))
    field = TemperatureField(points, tuple(10.0 * x for x, _, _ in points))
    mesh = box("hex20", (2, 2, 2), size=(2.0, 1.0, 1.0))
    stages = (Stage("warm", temperature={"all": field}),)
    origin = {"origin": np.flatnonzero(np.all(mesh.points == 0, axis=1))}
    # The plane x = 0 bends, so it is held along x in one node only.
    supports = (*rollers(3)[1:], Support("origin", (0,)))
    result = warmed(replace(mesh, node_groups=origin), supports=supports, stages=stages)
    x, y, z = result.mesh.points.T
    expected = 10 * ALPHA * np.stack([(x**2 - y**2 - z**2) / 2, x * y, x * z], axis=1)
    found = result.displacement[1]
    np.testing.assert_allclose(found, expected, atol=1e-9 * ALPHA * 10)
    edge = (y == 1) & (z == 1)
    verification("temperature", "", x[edge], exact=expected[edge, 0], found=found[edge, 0])
    assert np.abs(result.stress[1]).max() < 1e-7 * E * ALPHA * 10


def test_changes_count_from_the_beginning_and_cooling_undoes_warming():
    stages = (
        Stage("warm", temperature={"all": Scalar(RISE)}),
        Stage("wait"),
        Stage("cool", temperature={"all": Scalar(0.0)}),
    )
    result = warmed(box("quad4", (2, 2)), supports=(Support("y0", (0, 1)),), stages=stages)
    most = np.abs(result.displacement[1]).max()
    np.testing.assert_allclose(result.displacement[2], result.displacement[1], atol=1e-12 * most)
    assert np.abs(result.displacement[3]).max() < 1e-12 * most


def test_what_is_placed_counts_its_own_temperature_and_a_change_of_material_moves_nothing():
    mesh = regroup(box("quad4", (4, 4)), lift=lambda c: c[:, 1] > 0.5)
    other = concrete("other", expansion=3 * ALPHA)
    stages = (
        Stage("warm", temperature={"rock": Scalar(RISE)}),
        Stage("change", change={"rock": "other"}),
        Stage("place", install={"lift": "concrete"}),
        Stage("cool", temperature={"lift": Scalar(-RISE)}),
    )
    result = warmed(
        mesh,
        supports=rollers(2),
        stages=stages,
        materials={"concrete": concrete(), "other": other},
        groups={"rock": "concrete", "lift": None},
    )
    motion = np.abs(np.diff(result.displacement, axis=0)).max(axis=(1, 2))
    assert motion[0] > 0
    assert motion[3] > 0
    assert np.all(motion[1:3] < 1e-12 * motion[0])
    # The lift above shrinks freely out of the warm ground only where it is held: top moves down.
    top = np.isclose(result.mesh.points[:, 1], 1.0)
    assert np.all(result.displacement[4][top, 1] < 0)


VALUES = {"E": 20e9, "nu": 0.2, "alpha": 1.1e-5, "rise": 12.0, "part": 0.7}


def branches():
    def p(name):
        return Scalar(1.0, name)

    mesh = regroup(box("tri6", (6, 6), size=(6.0, 6.0)), lift=lambda c: c[:, 1] > 3)
    rock = material("rock", 8e9, 0.25)
    dam = Material("dam", Isotropic(E=p("E"), nu=p("nu")), Scalar(2400.0), p("alpha"))
    field = TemperatureField(((0.0, 3.0), (6.0, 3.0), (3.0, 6.0)), (5.0, -4.0, 9.0), p("part"))
    return model(
        mesh,
        parameters=tuple(Parameter(n, v, -np.inf, np.inf) for n, v in VALUES.items()),
        materials={"rock": rock, "dam": dam},
        groups={"rock": "rock", "lift": None},
        supports=(Support("y0", (0, 1)),),
        gravity=(0.0, -9.81),
        stages=(
            Stage("build", install={"lift": "dam"}, temperature={"lift": Scalar(0.3, "rise")}),
            Stage("summer", temperature={"lift": p("rise")}, independent=True),
            Stage("winter", temperature={"lift": field}, independent=True),
            Stage("crack", change={"lift": "rock"}),
        ),
        channels=(displacement("c", (1.0, 5.0), (0.6, 0.8), zero="build"),),
    )


def test_every_number_of_the_temperature_is_differentiated_exactly():
    staged = branches()
    response = staged.response([("c", "summer"), ("c", "winter")])
    assert_exact(response, np.array(list(VALUES.values())), staged.names)


def test_the_obstacle_is_the_product():
    assert "nu of dam" in branches().response([("c", "summer")]).obstacle()


def test_what_warm_ground_still_holds_is_a_product_of_temperature_and_release():
    """Its thermal stress, half released: affine in the rise alone and in the part alone."""
    mesh = regroup(
        box("tri6", (6, 6), size=(6.0, 6.0)), core=lambda c: (abs(c - 3) < 1).all(axis=1)
    )

    def obstacle(*free):
        start = {"rise": 12.0, "part": 0.7}
        rise, part = (Scalar(1.0, n) if n in free else Scalar(value) for n, value in start.items())
        stages = (
            Stage("warm", temperature={"core": rise}),
            Stage("open", excavate=("core",), release={"core": part}),
        )
        staged = model(
            mesh,
            parameters=tuple(Parameter(n, start[n], -np.inf, np.inf) for n in free),
            materials={"rock": concrete("rock")},
            groups={"rock": "rock", "core": "rock"},
            supports=rollers(2),
            stages=stages,
            channels=(displacement("c", (1.0, 5.0), (0.6, 0.8)),),
        )
        return staged.response([("c", "open")]).obstacle()

    assert obstacle("rise") is None
    assert obstacle("part") is None
    assert "the product of rise and part" in obstacle("rise", "part")
