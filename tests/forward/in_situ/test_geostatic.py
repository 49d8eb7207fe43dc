"""The geostatic stress: the weight of all that stands above, by hand and by elasticity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import NOWHERE, displacement, imbalance, make_case, material, model, virgin
from support.derivatives import assert_slopes
from support.meshes import KINDS, box, regroup

from geoident.fem.kinematics import kinematics_of
from geoident.fem.location import Locator
from geoident.fem.orientation import oriented
from geoident.forward.analysis.virgin import local_imbalance
from geoident.forward.in_situ.overburden import Overburden
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Pressure, Seismic, Traction, Water, WaterPressure
from geoident.model.case import Analysis, Stage, Support
from geoident.model.dual import ParameterPoint
from geoident.model.in_situ import GeostaticStress, HeimStress
from geoident.model.parameter import Parameter, Scalar

G = 9.81
GAMMA_W = 9810.0
SAND = material("sand", 60e6, 0.3, 1850.0)
CLAY = material("clay", 20e6, 0.3, 1950.0)
ROCK = material("rock", 2e9, 0.3, 2600.0)
MATERIALS = {"sand": SAND, "clay": CLAY, "rock": ROCK}
LAYERS = {"sand": "sand", "clay": "clay", "rock": "rock"}
K0 = {"sand": Scalar(0.45), "clay": Scalar(0.6), "rock": Scalar(1.2)}
ZERO = Scalar(0.0)


def sides(dim):
    """Rollers around and below."""
    axes = "xyz"[:dim]
    around = [Support(f"{axis}{end}", (n,)) for n, axis in enumerate(axes[:-1]) for end in (0, 1)]
    return (*around, Support(f"{axes[-1]}0", (dim - 1,)))


def layered(kind, *, warp=None, n=6):
    """A box of 12 m: rock below 4 m, clay to 8 m, sand to the top; ``warp`` moves its points."""
    dim = 2 if kind.startswith(("tri", "quad")) else 3
    mesh = box(kind, (n,) * dim, size=(12.0,) * dim)
    mesh = regroup(  # what is in no group is rock
        mesh,
        clay=lambda c: (c[:, -1] > 4) & (c[:, -1] < 8),
        sand=lambda c: c[:, -1] > 8,
    )
    return mesh if warp is None else replace(mesh, points=warp(mesh.points))


def heavy(mesh, stress, **more):
    settings = {
        "materials": MATERIALS,
        "groups": LAYERS,
        "supports": sides(mesh.dim),
        "gravity": (*(0.0,) * (mesh.dim - 1), -G),
        "in_situ": stress,
        "stages": (Stage("nothing"),),
    }
    return model(mesh, **{**settings, **more})


def stress_of(staged):
    """Positions (m, dim), groups (m,) by name, and the in-situ stress (n_strain, m)."""
    points = staged.discretization.points
    names = np.array(staged.sequence.groups)[staged.sequence.group_of[points.element]]
    return points.position, names, staged.analysis.in_situ.columns(NOWHERE)[..., 0]


def total_at(z, *, q=0.0):
    """Weight above a level of the horizontal layers of `layered`, Pa."""
    sand, clay, rock = (m.density.factor * G for m in (SAND, CLAY, ROCK))
    above = [np.clip(12 - z, 0, 4), np.clip(8 - z, 0, 4), np.clip(4 - z, 0, 4)]
    return q + sand * above[0] + clay * above[1] + rock * above[2]


def ratio_of(names):
    return np.array([K0[name].factor for name in names])


# Horizontal layers -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_layered_column_carries_the_sum_of_its_layers_and_is_in_equilibrium(kind):
    staged = heavy(layered(kind), GeostaticStress(K0=K0))
    positions, names, stress = stress_of(staged)
    dim = positions.shape[1]
    expected = -total_at(positions[:, -1])
    np.testing.assert_allclose(stress[dim - 1], expected, rtol=1e-12)
    np.testing.assert_allclose(stress[0], ratio_of(names) * expected, rtol=1e-12)
    np.testing.assert_allclose(stress[2 if dim == 2 else 1], ratio_of(names) * expected, rtol=1e-12)
    assert imbalance(staged) < 1e-12
    assert staged.contradictions() == []


def test_by_hand_with_water_and_surcharge():
    """Sand 4 m, clay below; table 2 m down, 10 kPa on top: figures as on paper."""
    mesh = layered("quad8")
    on_top = GeostaticStress(K0=K0, surcharge=Scalar(10e3))
    water = Water(Scalar(10.0), Scalar(GAMMA_W))
    staged = heavy(mesh, on_top, water=water)
    positions, _, stress = stress_of(staged)
    z = positions[:, 1]
    np.testing.assert_allclose(
        stress[1], -total_at(z, q=10e3) + GAMMA_W * np.clip(10 - z, 0, None), rtol=1e-12
    )
    assert imbalance(staged) < 1e-12
    # 6 m down, in the clay: 10 + 4 x 18.1485 + 2 x 19.1295 - 4 x 9.81 = 81.613 kPa
    places = np.array([[3.1, 6.0]])
    above = Overburden(staged.on_mesh).above(places)
    weight = above.weight(staged.case, NOWHERE).value[0]
    assert weight + 10e3 - 4 * GAMMA_W == pytest.approx(81.613e3, rel=1e-9)


def test_dry_groups_and_the_lake_above():
    """Water in the sand only; a lake of 3 m stands on it as a load."""
    lake = {"lake": WaterPressure("y1", Scalar(15.0), Scalar(GAMMA_W))}
    water = Water(Scalar(15.0), Scalar(GAMMA_W), groups=("sand",))
    staged = heavy(layered("tri6"), GeostaticStress(K0=K0), water=water, loads=lake)
    positions, names, stress = stress_of(staged)
    z = positions[:, 1]
    pores = np.where(names == "sand", GAMMA_W * (15 - z), 0.0)
    np.testing.assert_allclose(stress[1], -total_at(z, q=3 * GAMMA_W) + pores, rtol=1e-12)
    assert imbalance(staged) < 1e-12


@pytest.mark.parametrize(
    ("load", "q", "times"),
    [
        (Pressure("y1", Scalar(20e3)), 20e3, 1.0),
        (Traction("y1", (ZERO, Scalar(-20e3))), 20e3, 1.0),
        (Seismic((ZERO, Scalar(-0.1))), 0.0, 1.1),
    ],
)
def test_loads_from_the_beginning_count(load, q, times):
    staged = heavy(layered("quad4"), GeostaticStress(K0=K0), loads={"fill": load})
    positions, _, stress = stress_of(staged)
    np.testing.assert_allclose(stress[1], -times * total_at(positions[:, 1], q=q), rtol=1e-12)
    assert imbalance(staged) < 1e-12


@pytest.mark.parametrize("held", [None, True])
@pytest.mark.parametrize("kind", ["quad8", "hex8"])
def test_ground_above_the_mesh_is_a_cover_that_leaves_with_the_ground_below(held, kind):
    mesh = layered(kind)
    stress = GeostaticStress(
        K0=K0, surface=Scalar(30.0), cover=Scalar(20e3), surcharge=Scalar(5e3), held=held
    )
    staged = heavy(mesh, stress, stages=(Stage("dig", excavate=("sand",)),))
    positions, _, found = stress_of(staged)
    q = 5e3 + 18 * 20e3
    np.testing.assert_allclose(found[mesh.dim - 1], -total_at(positions[:, -1], q=q), rtol=1e-12)
    assert imbalance(staged) < 1e-12
    moved = staged.survey(np.empty(0), fields=True).fields.displacement[-1]
    top = np.isclose(mesh.points[:, -1], 8.0)
    # all that lay on the clay is gone: it heaves as under 360 + 5 + 4 x 18.15 kPa upwards
    relief = total_at(8.0, q=q)

    def heave(m, h):
        e, nu = m.elastic.E.factor, m.elastic.nu.factor
        return relief * h * (1 + nu) * (1 - 2 * nu) / (e * (1 - nu))

    np.testing.assert_allclose(moved[top, -1], heave(CLAY, 4) + heave(ROCK, 4), rtol=1e-9)


def test_axisymmetric_ground_is_weighed_in_its_section():
    staged = heavy(
        layered("quad8"), GeostaticStress(K0=K0, surcharge=Scalar(10e3)),
        analysis=Analysis.AXISYMMETRIC,
        water=Water(Scalar(9.0), Scalar(GAMMA_W)),
    )  # fmt: skip
    positions, names, stress = stress_of(staged)
    z = positions[:, 1]
    expected = -total_at(z, q=10e3) + GAMMA_W * np.clip(9 - z, 0, None)
    np.testing.assert_allclose(stress[1], expected, rtol=1e-12)
    np.testing.assert_allclose(stress[2], ratio_of(names) * expected, rtol=1e-12)
    assert imbalance(staged) < 1e-3  # the table passes through elements: a kink of K0 sigma_v
    assert staged.contradictions() == []


# Tilted layers, lenses, voids --------------------------------------------------------------------


def tilted(kind, n=6):
    """The layers fall by 0.2 along x (and 0.1 along y); the top stays at 12 m, the bottom at 0."""

    def warp(points):
        x, y, z = points[:, 0], points[:, -2], points[:, -1]
        fall = 0.2 * x + (0.1 * y if points.shape[1] == 3 else 0.0)
        bend = np.interp(z, [0, 4, 8, 12], [0, 1, 1, 0])
        return np.column_stack([points[:, :-1], z - bend * fall])

    return layered(kind, warp=warp, n=n)


@pytest.mark.parametrize("kind", KINDS)
def test_tilted_interfaces_by_hand(kind):
    staged = heavy(tilted(kind), GeostaticStress(K0=Scalar(0.5)))
    positions, _, stress = stress_of(staged)
    dim = positions.shape[1]
    x, y, z = positions[:, 0], positions[:, -2], positions[:, -1]
    fall = 0.2 * x + (0.1 * y if dim == 3 else 0.0)
    sand, clay, rock = (m.density.factor * G for m in (SAND, CLAY, ROCK))
    expected = (
        sand * np.minimum(12 - z, 4 + fall)
        + clay * np.clip(8 - fall - z, 0, 4)
        + rock * np.clip(4 - fall - z, 0, None)
    )
    # mid-nodes stay in the middle and faces are flat: exact in all kinds
    np.testing.assert_allclose(stress[dim - 1], -expected, rtol=1e-9)


def test_a_lens_and_what_is_not_there():
    """A lens of clay in sand; an absent building above; an old gallery that is void."""
    mesh = box("tri3", (24, 24), size=(12.0, 12.0))
    mesh = regroup(
        mesh,
        lens=lambda c: np.abs(c[:, 0] - 6) + 2 * np.abs(c[:, 1] - 5) < 3,
        building=lambda c: c[:, 1] > 10,
        gallery=lambda c: np.all(np.abs(c - [3.0, 7.0]) < 1, axis=1),
    )
    (rest,) = {"rock", "all"} & mesh.groups.keys()
    staged = heavy(
        mesh, GeostaticStress(K0=Scalar(0.5)),
        groups={rest: "sand", "lens": "clay", "building": None, "gallery": None},
    )  # fmt: skip
    above = Overburden(staged.on_mesh).above
    case = staged.case
    sand, clay = SAND.density.factor * G, CLAY.density.factor * G

    def weight(x, y):
        return above(np.array([[x, y]])).weight(case, NOWHERE).value[0]

    assert weight(0.7, 4.0) == pytest.approx(6 * sand, rel=1e-8)
    members = mesh.groups["lens"]
    corners = mesh.points[mesh.blocks[0].nodes[members]]
    area = 0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    xs = (np.arange(4000) + 0.5) * 12 / 4000
    places = np.column_stack([xs, np.full(len(xs), 0.1)])
    found = above(places)
    lens = found.lengths.toarray()[:, found.materials.index("clay")]
    assert lens.sum() * 12 / 4000 == pytest.approx(area.sum(), rel=1e-6)
    beside = np.abs(xs - 6) > 3.5
    assert not lens[beside].any()
    gallery = np.abs(xs - 3) < 1
    np.testing.assert_allclose(found.lengths.sum(axis=1)[gallery], 9.9 - 2, atol=1e-6)
    assert weight(xs[2003], 0.1) == pytest.approx(sand * 9.9 + (clay - sand) * lens[2003], rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_layers_of_any_shape_fill_the_line_to_the_top(kind):
    """Distorted elements of three materials at random: warped faces too are met just once."""
    dim = 2 if kind.startswith(("tri", "quad")) else 3
    mesh = box(kind, (4,) * dim, size=(8.0,) * dim, distortion=0.25)
    of = np.random.default_rng(5).integers(0, 3, mesh.n_elements)
    mesh = replace(mesh, groups={n: np.flatnonzero(of == k) for k, n in enumerate(LAYERS)})
    case = make_case(mesh, materials=MATERIALS, groups=LAYERS, gravity=(*(0.0,) * (dim - 1), -G))
    mesh = oriented(mesh, kinematics_of(case.analysis))
    places = np.random.default_rng(6).uniform(0.05, 7.95, (200, dim))
    found = Overburden(CaseOnMesh(case, mesh)).above(places)
    np.testing.assert_allclose(found.lengths.sum(axis=1), 8 - places[:, -1], rtol=1e-9)
    assert (found.lengths.toarray() > 0).all(axis=1).sum() > 10
    if kind not in ("tri3", "tet4", "quad4"):
        return  # faces that are not flat are cut otherwise than the elements' own mapping
    locator, steps = Locator(mesh), 100
    for n in range(2):
        x, top = places[n], 8 - places[n, -1]
        heights = x[-1] + (np.arange(steps) + 0.5) / steps * top
        above = [locator.sites((*x[:-1], z))[0].element for z in heights]
        sampled = np.bincount(of[above], minlength=3) * top / steps
        mine = found.lengths[[n]].toarray()[0]
        expected = [sampled[list(LAYERS).index(name)] for name in found.materials]
        np.testing.assert_allclose(mine, expected, atol=6 * top / steps)


def test_curved_layers_converge_with_the_mesh():
    """The interface is a parabola between mid-nodes: flat pieces are off by the square of size."""

    def error(n):
        def warp(points):
            x, z = points.T
            bend = np.interp(z, [0, 4, 8, 12], [0, 1, 1, 0])
            return np.column_stack([x, z + bend * 0.5 * np.sin(x / 2)])

        staged = heavy(layered("quad8", warp=warp, n=n), GeostaticStress(K0=Scalar(0.5)))
        positions, _, stress = stress_of(staged)
        x, z = positions.T
        lift = 0.5 * np.sin(x / 2)
        sand, clay, rock = (m.density.factor * G for m in (SAND, CLAY, ROCK))
        expected = (
            sand * np.minimum(12 - z, 4 - lift)
            + clay * np.clip(8 + lift - z, 0, 4)
            + rock * np.clip(4 + lift - z, 0, None)
        )
        return np.abs(stress[1] + expected).max()

    coarse, fine = error(6), error(12)
    assert fine < coarse / 3.3
    assert fine < 0.1e3


# Local balance ------------------------------------------------------------------------------------


def part_out_of_balance(staged):
    return local_imbalance(staged.analysis, NOWHERE).part


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad4", "quad8", "tet4"])
@pytest.mark.parametrize("table", [8.3, 8.9, 10.1, 11.9])
def test_a_table_inside_elements_is_below_the_line(kind, table):
    """Elements of 2 m and layers right below the surface: the stress has a kink inside them."""
    mesh = layered(kind)
    if kind in ("tri3", "quad4", "tet4"):  # straight mid-nodes would no longer be in the middle
        inner = np.all((mesh.points > 0.1) & (mesh.points < 11.9), axis=1)
        inner &= ~np.isin(mesh.points[:, -1].round(9), (4.0, 8.0))
        shift = np.random.default_rng(1).uniform(-0.4, 0.4, mesh.points.shape)
        mesh = replace(mesh, points=mesh.points + inner[:, None] * shift)
    wet = Water(Scalar(float(table)), Scalar(GAMMA_W))
    assert part_out_of_balance(heavy(mesh, GeostaticStress(K0=Scalar(0.4)), water=wet)) < 0.008


@pytest.mark.parametrize(("kind", "expected"), [("tri3", 0.023), ("quad8", 0.0147)])
def test_a_slope_is_out_of_balance_by_the_same_part_on_every_mesh(kind, expected):
    """In parts of the largest nodal force it would vanish with the size of the elements."""

    def slope(points):
        x, z = points.T
        return np.column_stack([x, z * (1 - 0.1 * x / 12)])

    coarse, fine = (
        heavy(layered(kind, warp=slope, n=n), GeostaticStress(K0=Scalar(0.5))) for n in (6, 24)
    )
    for staged in (coarse, fine):
        assert part_out_of_balance(staged) == pytest.approx(expected, rel=0.02)
        (fault,) = staged.contradictions()
        assert fault.code == "out-of-balance"
    assert imbalance(fine) < imbalance(coarse) / 4


def test_what_is_told_is_the_imbalance_of_the_stress_and_not_of_its_derivatives():
    """A K0 of the clay alone: its derivative is that of one dipping layer, far out of balance."""

    def dip(points):
        x, z = points.T
        return np.column_stack([x, z + np.interp(z, [0, 4, 8, 12], [0, 1, 1, 0]) * x / 12])

    ratios = {"sand": Scalar(0.5), "clay": Scalar(1.0, "K0"), "rock": Scalar(0.5)}
    parameter = Parameter("K0", 0.55, 0.1, 2.0)
    staged = heavy(layered("tri6", warp=dip), GeostaticStress(K0=ratios), parameters=(parameter,))
    _, (stress, derivative) = staged.analysis.virgin(ParameterPoint({"K0": 0.55}, ("K0",)))
    assert derivative > 2 * stress
    run = staged.at(np.array([0.55]))
    next(run.states())
    assert run.findings.imbalance == pytest.approx(stress)


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad8"])
@pytest.mark.parametrize("part", [-0.019, 0.019])
def test_a_wrong_weight_is_out_of_balance_by_half_its_part_at_most(kind, part):
    mesh = layered(kind)
    stress = HeimStress(
        K0=Scalar(0.5), unit_weight=Scalar((1 + part) * 2600 * G), surface=Scalar(12.0)
    )
    staged = heavy(mesh, stress, groups=dict.fromkeys(LAYERS, "rock"))
    assert 0.002 < part_out_of_balance(staged) < 0.0095 * 1.02
    assert staged.contradictions() == []


# Elasticity, derivatives -------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["tri6", "quad8", "hex20", "tet4"])
def test_it_is_what_gravity_turned_on_makes_of_laterally_confined_layers(kind):
    """Without in-situ stress the first step finds K0 = nu / (1 - nu) and the same vertical."""
    mesh = layered(kind, n=3 if kind == "hex20" else 6)
    ratio = {
        name: Scalar(m.elastic.nu.factor / (1 - m.elastic.nu.factor))
        for name, m in MATERIALS.items()
    }
    given = virgin(heavy(mesh, GeostaticStress(K0=ratio))).stress
    turned_on = virgin(heavy(mesh, None)).stress
    size = np.abs(given).max()
    if kind == "tet4":  # linear elements hold a linear stress in the mean only
        volume = heavy(mesh, None).systems[0].volume
        assert volume @ turned_on[2, :, 0] == pytest.approx(volume @ given[2, :, 0], rel=1e-3)
        return
    np.testing.assert_allclose(turned_on, given, atol=1e-9 * size)


VALUES = {
    "sand": 1850.0, "clay": 1950.0, "K0": 0.45, "K0c": 0.6, "across": 0.7, "azimuth": 0.4,
    "q": 10e3, "cover": 17e3, "level": 14.0, "table": 9.3, "gw": 9810.0, "p": 20e3, "lake": 15.0,
    "k": -0.08, "t": -7e3,
}  # fmt: skip


def p(name):
    return Scalar(1.0, name)


@pytest.mark.parametrize("kind", ["tri3", "quad8", "hex8", "tet10"])
@pytest.mark.parametrize("held", [None, True])
def test_every_number_is_differentiated_exactly(kind, held):
    staged, names, values = free_in_everything(kind, held)
    columns = staged.analysis.in_situ.columns
    at = ParameterPoint(values, names)
    for h, name in enumerate(names):
        step = 1e-5 * abs(values[name])
        ahead, behind = (
            columns(ParameterPoint({**values, name: values[name] + s}, ()))[..., 0]
            for s in (step, -step)
        )
        slope = columns(at)[..., 1 + h]
        scale = np.abs(slope).max()
        assert scale > 0, name
        np.testing.assert_allclose(
            (ahead - behind) / (2 * step), slope, atol=1e-7 * scale, err_msg=name
        )
    channels = [channel.name for channel in staged.case.channels]
    response = staged.response([(c, stage) for c in channels for stage in ("dig", "deeper")])
    act = np.array([values[n] for n in names])
    _, jacobian = response.evaluate(act)
    idle = ["across"] if staged.mesh.dim == 2 else []  # out of plane nothing moves
    assert [
        name for name, column in zip(names, jacobian.T, strict=True) if not column.any()
    ] == idle
    assert_slopes(response.readings, act, jacobian, names, step=2e-4)


def free_in_everything(kind, held):
    """Tilted layers in which every number is a parameter; names of these and their values."""
    mesh = tilted(kind, n=6 if kind in ("tri3", "quad8") else 3)
    dim = mesh.dim
    top = "xyz"[dim - 1] + "1"
    names = tuple(n for n in VALUES if dim == 3 or n != "azimuth")
    stress = GeostaticStress(
        K0={"sand": p("K0"), "clay": p("K0c"), "rock": Scalar(0.8)},
        K0_across={"sand": p("across"), "clay": Scalar(1.1, "across"), "rock": Scalar(0.9)},
        azimuth=p("azimuth") if dim == 3 else None,
        surface=p("level"), cover=p("cover"), surcharge=p("q"), held=held,
    )  # fmt: skip
    up = (ZERO,) * (dim - 1)
    loads = {
        "fill": Pressure(top, p("p")),
        "lake": WaterPressure(top, p("lake"), p("gw")),
        "quake": Seismic((*up, p("k"))),
        "drag": Traction(top, (*up, p("t"))),
    }
    staged = heavy(
        mesh, stress,
        parameters=tuple(Parameter(n, VALUES[n], -np.inf, np.inf) for n in names),
        materials={
            "sand": material("sand", 60e6, 0.3, p("sand")),
            "clay": material("clay", 20e6, 0.3, p("clay")),
            "rock": ROCK,
        },
        loads=loads, water=Water(p("table"), p("gw")),
        stages=(
            Stage("dig", excavate=("sand",), remove=tuple(loads)),
            Stage("deeper", excavate=("clay",)),
        ),
        channels=tuple(
            displacement(f"c{n}", (*(5.1,) * (dim - 1), 1.7), direction)
            for n, direction in enumerate(np.eye(dim))
        ),
    )  # fmt: skip
    # a level at a strain point is a kink: take the middle of the widest gap
    heights = np.sort(staged.discretization.points.position[:, -1])
    heights = heights[(heights > 8.5) & (heights < 10.5)]
    widest = int(np.argmax(np.diff(heights)))
    return staged, names, {**VALUES, "table": heights[widest : widest + 2].mean()}
