"""Axisymmetric analyses: closed forms, agreement with plane and solid models, derivatives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.closed_forms import (
    circular_load,
    lame_cylinder,
    lift_settlement,
    spherical_cavity,
)
from support.meshes import KINDS_2D, box, from_grid, opening, regroup

from geoident.errors import InputError, ModelError
from geoident.fem.elements import reference_element
from geoident.model.actions import PointForce, Pressure, Seismic, Traction
from geoident.model.case import Analysis, Stage, Support
from geoident.model.gauges import Channel
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

E, NU = 10e9, 0.22
ROCK = material("rock", E, NU)
kinds = pytest.mark.parametrize("kind", KINDS_2D)


def revolve(mesh: Mesh, **changes: Any):
    return model(mesh, analysis=Analysis.AXISYMMETRIC, **changes)


def fields(mesh: Mesh, **changes: Any):
    return revolve(mesh, **changes).survey(np.empty(0), fields=True).fields


def constant(rr: float, axial: float, tt: float, shear: float = 0.0) -> ConstantStress:
    xx, yy, zz, xy = (Scalar(v) for v in (rr, axial, tt, shear))
    return ConstantStress((xx, yy, zz, xy, Scalar(0.0), Scalar(0.0)))


def section(kind: str, n: tuple[int, int], size: tuple[float, float], *, inner: float) -> Mesh:
    """A rectangle of the r-z plane whose sides are named x0, x1, y0, y1."""
    mesh = box(kind, n, size=size)
    return replace(mesh, points=mesh.points + np.array([inner, 0.0]))


# Closed forms ------------------------------------------------------------------------------------

INNER, OUTER, PUSH = 1.0, 3.0, 5e6


def pressed_section(kind: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Radii and radial displacements of a slice of the cylinder in the r-z plane."""
    mesh = section(kind, (n, n // 4), (OUTER - INNER, 0.5), inner=INNER)
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        stages=(Stage("press", loads={"p": Pressure("x0", Scalar(PUSH))}),),
    )
    return mesh.points[:, 0], result.displacement[-1][:, 0]


def pressed_quarter(kind: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The same of a quarter of the cylinder in plan, plane strain."""
    grid = np.stack(np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij"))
    flat = from_grid(kind, grid.reshape(2, -1).T, (n, n))
    r, angle = INNER + flat.points[:, 0] * (OUTER - INNER), flat.points[:, 1] * np.pi / 2
    mesh = replace(flat, points=np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1))
    result = (
        model(
            mesh,
            materials={"rock": ROCK},
            groups={"all": "rock"},
            supports=(Support("y0", (1,)), Support("y1", (0,))),
            stages=(Stage("press", loads={"p": Pressure("x0", Scalar(PUSH))}),),
        )
        .survey(np.empty(0), fields=True)
        .fields
    )
    return r, np.linalg.norm(result.displacement[-1], axis=1)


def lame_error(found: tuple[np.ndarray, np.ndarray]) -> float:
    exact = lame_cylinder(found[0], inner=INNER, outer=OUTER, pressure=PUSH, E=E, nu=NU)
    return float(np.abs(found[1] - exact).max() / np.abs(exact).max())


LAME_AT_16 = {"tri3": 1e-2, "tri6": 2e-4, "quad4": 3e-3, "quad8": 1e-5}


@kinds
def test_thick_cylinder_agrees_with_lame_and_converges(kind):
    coarse, fine = (lame_error(pressed_section(kind, n)) for n in (16, 32))
    assert coarse < LAME_AT_16[kind]
    assert np.log2(coarse / fine) > reference_element(kind).order + 1 - 0.5


@kinds
def test_thick_cylinder_in_plan_is_the_same_cylinder(kind):
    """Plane strain, whose elements cut the circle off, meets the same closed form."""
    assert lame_error(pressed_quarter(kind, 16)) < 3 * LAME_AT_16[kind]


RADIUS = 2.0
CAVITY = {"groups": {"core": "rock", "rock": "rock"}, "stages": (Stage("o", excavate=("core",)),)}


def cavity(kind: str, n: int, layers: int, reach: float, stress: tuple[float, float]):
    """Nodes of the wall and their displacements: a cavity opened in ground stressed (rr, axial)."""
    mesh = opening(kind, 2, n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS)
    result = fields(
        mesh,
        materials={"rock": ROCK},
        supports=(Support("y0", (1,)),),
        in_situ=constant(stress[0], stress[1], stress[0]),
        **CAVITY,
    )
    r = np.linalg.norm(mesh.points, axis=1)
    wall = np.flatnonzero(np.abs(r - RADIUS) < 1e-9)
    return mesh.points[wall], result.displacement[-1][wall]


def goodier(points: np.ndarray, stress: tuple[float, float]) -> np.ndarray:
    """Displacements (n, 2) of the closed form in the r-z plane."""
    solid = np.stack([points[:, 0], 0 * points[:, 0], points[:, 1]], axis=1)
    three = (stress[0], stress[0], stress[1])
    return spherical_cavity(solid, radius=RADIUS, E=E, nu=NU, stress=three)[:, [0, 2]]


CAVITY_MESHES = {"tri3": (32, 96), "tri6": (12, 36), "quad4": (16, 48), "quad8": (8, 24)}
CAVITY_ERRORS = {"tri3": 1e-2, "tri6": 1e-3, "quad4": 5e-3, "quad8": 2e-4}


def cavity_error(kind: str, n: int, layers: int, stress: tuple[float, float]) -> float:
    points, u = cavity(kind, n, layers, 30, stress)
    exact = goodier(points, stress)
    return np.linalg.norm(u - exact, axis=1).max() / np.linalg.norm(exact, axis=1).max()


@pytest.mark.parametrize("stress", [(-6e6, -6e6), (-6e6, -12e6)], ids=["hydrostatic", "two"])
@kinds
def test_spherical_cavity_agrees_with_goodier_and_converges(kind, stress):
    n, layers = CAVITY_MESHES[kind]
    fine = cavity_error(kind, n, layers, stress)
    assert fine < CAVITY_ERRORS[kind]
    assert cavity_error(kind, n // 2, layers // 2, stress) > 3 * fine


def test_spherical_cavity_is_the_same_as_in_three_dimensions():
    stress = (-6e6, -12e6)
    points, u = cavity("quad8", 3, 8, 12, stress)
    mesh = opening("hex20", 3, n=3, layers=8, radius=RADIUS, reach=12 * RADIUS)
    zero = Scalar(0.0)
    three = ConstantStress((Scalar(stress[0]), Scalar(stress[0]), Scalar(stress[1]), *[zero] * 3))
    solid = model(
        mesh, materials={"rock": ROCK}, supports=rollers(3), in_situ=three, **CAVITY
    ).survey(np.empty(0), fields=True)
    # On the plane y = 0 the octant has the nodes of the section.
    for place, moved in zip(points, u, strict=True):
        node = np.linalg.norm(mesh.points - [place[0], 0.0, place[1]], axis=1).argmin()
        np.testing.assert_allclose(mesh.points[node], [place[0], 0.0, place[1]], atol=1e-9)
        other = solid.fields.displacement[-1][node][[0, 2]]
        np.testing.assert_allclose(moved, other, atol=2e-3 * np.abs(u).max())


def half_space(kind: str, n: int, layers: int) -> Mesh:
    """A half-space y > 0 of 150 plate radii; the loaded face at y = 0 is the group ``plate``."""
    mesh = opening(kind, 2, n=n, layers=layers, radius=1.0, reach=150.0)
    faces = mesh.facets[0].nodes
    on_top = np.all(np.abs(mesh.points[faces][..., 1]) < 1e-9, axis=1)
    under = on_top & (mesh.points[faces][..., 0].max(axis=1) < 1 + 1e-9)
    far = np.linalg.norm(mesh.points[faces], axis=2).min(axis=1) > 150 * (1 - 1e-9)
    named = {"plate": np.flatnonzero(under), "far": np.flatnonzero(far)}
    return replace(mesh, facet_groups={**mesh.facet_groups, **named})


@kinds
def test_flexible_plate_on_a_half_space_within_one_percent(kind):
    """150 radii of ground, whose fixed far edge takes half a percent off; 8 elements underneath.

    12 for the linear triangle.
    """
    mesh = half_space(kind, *((12, 60) if kind == "tri3" else (8, 40)))
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"core": "rock", "rock": "rock"},
        supports=(Support("far", (0, 1)),),
        stages=(Stage("load", loads={"q": Pressure("plate", Scalar(2e6))}),),
    )
    w = result.displacement[-1][:, 1]
    centre, rim = circular_load(radius=1.0, pressure=2e6, E=E, nu=NU)
    at = [np.linalg.norm(mesh.points - p, axis=1).argmin() for p in ([0.0, 0.0], [1.0, 0.0])]
    assert w[at[0]] == pytest.approx(centre, rel=0.01)
    assert w[at[1]] == pytest.approx(rim, rel=0.02)


@kinds
@pytest.mark.parametrize("inner", [0.0, 1.0])
def test_column_of_lifts_settles_in_a_parabola(kind, inner):
    n, height, density, g = 4, 2.0, 2100.0, 9.81
    mesh = section(kind, (2, n), (1.5, n * height), inner=inner)

    def lift(k):
        return lambda c: c[:, 1] < (k + 1) * height

    mesh = regroup(mesh, **{f"lift-{k}": lift(k) for k in range(n)})
    result = fields(
        mesh,
        materials={"fill": material("fill", E, NU, density)},
        groups={"lift-0": "fill"},
        supports=(Support("y0", (1,)), Support("x0", (0,)), Support("x1", (0,))),
        gravity=(0.0, -g),
        stages=(Stage("s0"), *(Stage(f"s{k}", install={f"lift-{k}": "fill"}) for k in range(1, n))),
    )
    modulus = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    exact = lift_settlement(n, height, density * g, modulus)
    exact[0] -= density * g * height**2 / modulus * 0.5
    # Linear triangles can't carry the weight straight down.
    tolerance = 0.06 if kind == "tri3" else 1e-10
    for k in range(n):
        top = np.isclose(mesh.points[:, 1], (k + 1) * height)
        np.testing.assert_allclose(-result.displacement[-1][top, 1], exact[k], rtol=tolerance)


# Construction ------------------------------------------------------------------------------------

BENCHES = tuple(f"bench-{k}" for k in range(5))


def shaft(kind: str = "quad8", n: int = 8) -> Mesh:
    """Ground of 8 m by 8 m with a shaft of 2 m radius, 5 m deep, on the axis, and its lining."""
    mesh = box(kind, (n, n), size=(8.0, 8.0), distortion=0.1)

    def bench(k):
        return lambda c: (c[:, 0] < 1) & (c[:, 1] > 7 - k)

    def lining(c):
        return (c[:, 0] < 2) & (c[:, 1] > 5)

    return regroup(mesh, **{f"bench-{k}": bench(k) for k in range(5)}, lining=lining)


SINKING: dict[str, Any] = {
    "materials": {"rock": material("rock", 8e9, 0.3, 2600.0)},
    "groups": dict.fromkeys(("rock", "lining", *BENCHES), "rock"),
    "supports": (Support("y0", (1,)), Support("x1", (0,))),
}


@kinds
def test_one_stage_or_five_end_in_the_same_state(kind):
    common = {**SINKING, "in_situ": constant(-9e6, -6e6, -9e6), "gravity": (0.0, -9.81)}
    mesh = shaft(kind)
    one = fields(mesh, stages=(Stage("all", excavate=BENCHES),), **common)
    five = fields(mesh, stages=tuple(Stage(b, excavate=(b,)) for b in BENCHES), **common)
    here, scale = one.present[-1], np.abs(one.displacement[-1]).max()
    np.testing.assert_allclose(five.displacement[-1], one.displacement[-1], atol=1e-10 * scale)
    np.testing.assert_allclose(
        five.stress[-1][here], one.stress[-1][here], atol=1e-10 * np.nanmax(np.abs(one.stress))
    )


@kinds
def test_in_situ_stress_is_in_balance(kind):
    weight = 2600.0 * 9.81
    growing = HeimStress(K0=Scalar(0.3 / 0.7), unit_weight=Scalar(weight), surface=Scalar(8.0))
    for in_situ, gravity in ((growing, (0.0, -9.81)), (constant(-9e6, -6e6, -9e6), None)):
        staged = revolve(
            shaft(kind), in_situ=in_situ, gravity=gravity, stages=(Stage("nothing"),), **SINKING
        )
        result = staged.survey(np.empty(0), fields=True).fields
        assert staged.march.imbalance < 1e-12
        assert np.abs(result.displacement).max() < 1e-15


def test_hoop_stress_is_the_out_of_plane_component():
    """A long shaft in ground stressed -p: hoop -p (1 + 1/r^2), radial -p (1 - 1/r^2)."""
    mesh = box("quad8", (64, 1), size=(64.0, 0.5))
    points = mesh.points.copy()
    points[:, 0] = np.where(
        points[:, 0] < 4, points[:, 0] / 4, 40.0 ** (points[:, 0] / 60 - 1 / 15)
    )
    mesh = regroup(replace(mesh, points=points), core=lambda c: c[:, 0] < 1)
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"core": "rock", "rock": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        in_situ=constant(-4e6, -3e6, -4e6),
        stages=(Stage("open", excavate=("core",)),),
    )
    rock = mesh.groups["rock"]
    rr, axial, tt = result.stress[-1][rock].T[:3]
    ratio = 1 / points[mesh.blocks[0].nodes[rock, :4]].mean(axis=1)[:, 0] ** 2
    np.testing.assert_allclose(tt, -4e6 * (1 + ratio), rtol=2e-3)
    np.testing.assert_allclose(rr, -4e6 * (1 - ratio), atol=8e3)
    np.testing.assert_allclose(axial, -3e6, rtol=2e-3)


@kinds
@pytest.mark.parametrize("inner", [0.0, 1.0])
def test_free_ground_expands_with_temperature_by_alpha_in_every_direction(kind, inner):
    mesh = section(kind, (3, 3), (2.0, 1.0), inner=inner)
    result = fields(
        mesh,
        materials={"rock": replace(ROCK, expansion=Scalar(1e-5))},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)),),
        stages=(Stage("summer", temperature={"all": Scalar(20.0)}),),
    )
    np.testing.assert_allclose(result.displacement[-1], 2e-4 * mesh.points, atol=1e-15)
    np.testing.assert_allclose(result.stress[-1], 0.0, atol=1e-5)


def test_a_force_is_that_of_the_whole_turn():
    """A force on the axis of a long column: its mean axial stress is the force per round area."""
    mesh = section("quad8", (6, 24), (1.0, 8.0), inner=0.0)
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)),),
        stages=(Stage("load", loads={"P": PointForce((0.0, 8.0), (Scalar(0.0), Scalar(-6e6)))}),),
    )
    centre = mesh.points[mesh.blocks[0].nodes[:, :4]].mean(axis=1)
    low = centre[:, 1] < 2
    axial, share = result.stress[-1][low, 1], centre[low, 0]
    assert np.average(axial, weights=share) == pytest.approx(-6e6 / np.pi, rel=1e-6)
    np.testing.assert_allclose(axial, -6e6 / np.pi, rtol=1e-3)


def test_convergence_across_the_axis_is_twice_the_radial_motion():
    ends = (-1.0, 6.5), (1.0, 6.5)
    across = Channel("CV", "CV", "convergence", *ends, (1.0, 0.0), 1e-4, "virgin", ("gauges", "CV"))
    staged = revolve(
        shaft(),
        in_situ=constant(-9e6, -6e6, -9e6),
        stages=(Stage("open", excavate=BENCHES),),
        channels=(across, displacement("wall", ends[1], (1.0, 0.0))),
        **SINKING,
    )
    convergence, wall = staged.survey(np.empty(0), fields=False).computed[:, -1]
    assert wall < 0
    assert convergence == pytest.approx(2 * wall, rel=1e-12)


# What does not turn about the axis ---------------------------------------------------------------


def refused(mesh: Mesh | None = None, **changes: Any) -> str:
    with pytest.raises(InputError) as caught:
        revolve(shaft() if mesh is None else mesh, **{**SINKING, "stages": (), **changes})
    return "\n".join(f"{f.code} {f.path}: {f.message}" for f in caught.value.faults)


def test_elements_across_the_axis_are_refused_by_their_numbers():
    mesh = shaft()
    text = refused(replace(mesh, points=mesh.points - np.array([0.4, 0.0])))
    assert "negative-radius" in text
    assert "elements 1, 2, 3, 4, 5, 6, 7, 8 have negative radii x, down to -0.4 m" in text


def test_rounding_at_the_axis_is_the_axis():
    mesh = shaft()
    points = mesh.points.copy()
    axis = points[:, 0] == 0
    points[axis, 0] = np.random.default_rng(0).uniform(-1e-12, 1e-12, axis.sum())
    staged = revolve(replace(mesh, points=points), **SINKING)
    assert (
        f"{axis.sum()} nodes on the axis of revolution x = 0 are held radially" in staged.notes[0]
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gravity": (0.1, -9.81)}, "gravity: gravity has a part across the axis"),
        ({"in_situ": constant(-9e6, -6e6, -8e6)}, "in_situ.zz: xx (radial) and zz (hoop)"),
        ({"in_situ": constant(-9e6, -6e6, -9e6, 1e5)}, "in_situ.xy: xy (rz)"),
        (
            {"loads": {"quake": Seismic((Scalar(0.1), Scalar(0.0)))}},
            "loads.quake: shaking across the axis",
        ),
        (
            {"in_situ": HeimStress(K0=Scalar(1.0), vertical=Scalar(1e6), K0_across=Scalar(1.5))},
            "in_situ.K0: the horizontal in-situ stresses",
        ),
    ],
)
def test_what_is_not_axisymmetric_is_refused(changes, words):
    assert words in refused(**changes)


def test_a_ring_that_nothing_holds_along_the_axis_is_named():
    supports = (Support("x1", (0,)),)
    with pytest.raises(ModelError, match="can move along y freely"):
        revolve(shaft(), **{**SINKING, "supports": supports}, stages=())


# Derivatives -------------------------------------------------------------------------------------

PARAMETERS = {
    "E": 8e9, "nu": 0.27, "density": 2500.0, "K0": 1.4, "gamma": 26e3, "q": 1.5e6, "t": -0.7e6,
}  # fmt: skip


def sunk_with_everything(kind: str):
    rock = material("rock", Scalar(1.0, "E"), Scalar(1.0, "nu"), Scalar(1.0, "density"))
    shot = material("shot", Scalar(1.8, "E"), 0.2, 2400.0)
    places = [((2.5, 6.2), "virgin"), ((3.0, 3.1), "s1"), ((0.4, 1.0), "s2"), ((-1.5, 6.0), "s2")]
    return revolve(
        shaft(kind),
        parameters=tuple(
            Parameter(n, v, -np.inf, np.inf, "linear") for n, v in PARAMETERS.items()
        ),
        materials={"rock": rock, "shot": shot},
        groups=SINKING["groups"],
        supports=SINKING["supports"],
        in_situ=HeimStress(
            K0=Scalar(1.0, "K0"), unit_weight=Scalar(1.0, "gamma"), surface=Scalar(9.0), held=False
        ),
        gravity=(0.0, -9.81),
        loads={"dead": Pressure("y1", Scalar(0.2, "q"))},
        stages=(
            Stage("s1", excavate=BENCHES[:2], remove=("dead",)),
            Stage("s2", excavate=(BENCHES[2],), install={"lining": "shot"}),
            Stage("s3", excavate=BENCHES[3:]),
            Stage("s4", install={BENCHES[4]: "shot"}, loads={
                "t": Traction("x1", (Scalar(0.0), Scalar(1.0, "t")))}),
        ),
        channels=tuple(
            displacement(f"c{k}", point, (0.6, 0.8), zero=zero)
            for k, (point, zero) in enumerate(places)
        ),
    )  # fmt: skip


@kinds
def test_jacobian_agrees_with_richardson_differences(kind):
    staged = sunk_with_everything(kind)
    response = staged.response(
        [(c, s) for c, first in (("c0", 1), ("c1", 2), ("c2", 3), ("c3", 3))
         for s in [f"s{n}" for n in range(first, 5)]]
    )  # fmt: skip
    p = np.array(list(PARAMETERS.values()))
    v, jacobian = response.evaluate(p)
    np.testing.assert_allclose(response.readings(p), v, rtol=1e-12)
    assert np.all(v != 0)
    for h, name in enumerate(PARAMETERS):
        step = 2e-3 * abs(p[h]) * np.eye(len(p))[h]

        def slope(k, step=step, h=h):
            return (response.readings(p + step / k) - response.readings(p - step / k)) / (
                2 * step[h] / k
            )

        once = [(4 * slope(2 * k) - slope(k)) / 3 for k in (1, 2)]
        numeric = (16 * once[1] - once[0]) / 15
        scale = np.abs(jacobian[:, h]).max()
        assert scale > 0, f"{name} acts on nothing in this test"
        np.testing.assert_allclose(jacobian[:, h], numeric, atol=1e-7 * scale, err_msg=name)
