"""Linings and bolts in staged ground: closed forms, invariants, exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.errors import InputError
from geoident.model.actions import FaceProfile, Traction
from geoident.model.case import Stage
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Beam, Bolts, Struts
from tests.support.array_model import solved_at_once
from tests.support.cases import displacement, material, model, rollers
from tests.support.derivatives import assert_exact
from tests.support.force_gauges import gauge
from tests.support.meshes import box, regroup
from tests.support.tunnels import ringed, walled, with_lines

RADIUS, P0 = 3.0, 5e6
E, NU = 2e9, 0.3
ZERO = Scalar(0.0)
NOTHING = np.empty(0)


def _stress(vertical, horizontal):
    out_of_plane = Scalar(-NU * (vertical + horizontal))
    return ConstantStress((Scalar(-horizontal), Scalar(-vertical), out_of_plane, *(ZERO,) * 3))


def _lined(mesh, stages, *, in_situ=None, lining=None, **changes):
    lining = lining or Beam("wall", EA=Scalar(4e9), EI=Scalar(3e7), clamped_on=("x0", "y0"))
    settings = {
        "materials": {"rock": material("rock", E, NU)},
        "groups": {"core": "rock", "rock": "rock"},
        "supports": rollers(2),
        "in_situ": in_situ or _stress(P0, P0),
        "structures": {"lining": lining},
        "stages": stages,
    }
    return model(mesh, **{**settings, **changes})


def _wall(mesh):
    return np.unique(mesh.facets[-1].nodes)


def _inwards(mesh, fields):
    wall = _wall(mesh)
    out = mesh.points[wall] / RADIUS
    return -np.sum(fields.displacement[:, wall] * out, axis=2)


def _tunnel(n=5, kind="quad8", reach=40):
    layers = int(np.ceil(np.log(reach) / np.log(1 + np.pi / 4 / n))) + 1
    return walled(kind, n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS)


@pytest.mark.parametrize("part", [0.0, 0.4, 0.8])
def test_lined_tunnel_follows_convergence_confinement(part, verification):
    """Ground u = (p0 - p) R / (2 G), lining p = k (u - u_0) with k = EA / R^2 (Panet, 1995)."""
    mesh = _tunnel()
    stages = (
        Stage("open", excavate=("core",), release={"core": Scalar(part)}),
        Stage("line", build=("lining",), release={"core": Scalar(1.0)}),
    )
    survey = _lined(mesh, stages).survey(NOTHING, fields=True)
    inwards = _inwards(mesh, survey.fields)
    G, k = E / (2 * (1 + NU)), 4e9 / RADIUS**2
    pressure = (1 - part) * P0 / (1 + 2 * G / (k * RADIUS))
    np.testing.assert_allclose(inwards[1], part * P0 * RADIUS / (2 * G), rtol=0.005, atol=1e-12)
    np.testing.assert_allclose(inwards[2], (P0 - pressure) * RADIUS / (2 * G), rtol=0.005)
    exact = np.array([part * P0, P0 - pressure]) * RADIUS / (2 * G)
    means = inwards[1:].mean(axis=1)
    variant = f"{part:.0%} released before"
    verification("confinement", variant, ["opened", "lined"], exact=exact, found=means)
    assert np.isnan(survey.members.axial[:, 0]).all()
    np.testing.assert_allclose(survey.members.axial[:, 1], -pressure * RADIUS, rtol=0.01)
    assert np.abs(survey.members.moment[..., 1]).max() < 0.01 * pressure * RADIUS**2


def _ring_in_ground(K, EA, EI):
    """N at spring line and crown, M at the crown: no slip, built as the ground is unloaded.

    The part constant around the tunnel is that of Einstein and Schwartz (J. Geotech. Eng. Div. ASCE
    105, 1979). For the part with cos 2a (w radial, v tangential motion of the wall, sin 2a)
    Michell's A / r^2 + B and a thin ring whose section turns by (w' - v) / R.
    """
    G, R, S = E / (2 * (1 + NU)), RADIUS, P0 * (1 - K) / 2
    load = np.array([[-6 / R**4, -4 / R**2], [-6 / R**4, -2 / R**2]])  # of A and B
    motion = np.array([[2 / R**3, 4 * (1 - NU) / R], [2 / R**3, -(2 - 4 * NU) / R]]) / (2 * G)
    stretch, bend = np.array([1.0, 2.0]) / R, np.array([-4.0, -2.0]) / R**2
    ring = EA * np.outer(stretch, stretch) + EI * np.outer(bend, bend)
    w, v = motion @ np.linalg.solve(ring @ motion - load, np.array([S, -S]))
    mean = -P0 * (1 + K) / 2 * R / (1 + 2 * G * R / EA)
    vary = EA * stretch @ [w, v]
    return mean + vary, mean - vary, EI * bend @ [w, v]


@pytest.mark.parametrize(("EA", "EI"), [(4e9, 3e7), (1.2e9, 4e8)])
def test_lining_under_unequal_stress(EA, EI, verification):
    mesh = _tunnel(8)
    lining = Beam("wall", EA=Scalar(EA), EI=Scalar(EI), clamped_on=("x0", "y0"))
    stages = (Stage("open", excavate=("core",), build=("lining",)),)
    staged = _lined(mesh, stages, in_situ=_stress(P0, 0.5 * P0), lining=lining)
    found = staged.survey(NOTHING, fields=False).members
    spring, crown, moment = _ring_in_ground(0.5, EA, EI)
    angle = np.arctan2(found.ends[..., 1], found.ends[..., 0]).mean(axis=1)
    order = np.argsort(angle)
    axial, moments = found.axial[order, 0], found.moment[order].mean(axis=1)[:, 0]
    assert axial[0] == pytest.approx(spring, rel=0.01)
    assert axial[-1] == pytest.approx(crown, rel=0.01)
    variant = f"EA {EA / 1e9:g} GN/m, EI {EI / 1e6:g} MNm2/m"
    where, ends = ["N at the spring line", "N at the crown"], axial[[0, -1]]
    verification("lining", variant, where, exact=[spring, crown], found=ends)
    # The crown comes down: tension on its open side; at the spring line it is on the ground's.
    assert moments[-1] == pytest.approx(abs(moment), rel=0.02)
    assert moments[0] == pytest.approx(-abs(moment), rel=0.02)
    # Ground is on the left, so the pieces run from the crown to the spring line.
    ends = found.moment[order, :, 0]
    np.testing.assert_allclose(ends[1:, 1], ends[:-1, 0], atol=1e-9 * abs(moment))


@pytest.mark.parametrize(("EA", "EI"), [(6e9, 4.5e7), (2e9, 1.67e6)])
def test_moments_and_shears_at_all_ends_converge_to_those_of_the_thin_ring(EA, EI):
    """M = -m cos 2a, Q = dM/ds = -2 m / R sin 2a; linings of 0.3 and 0.1 m of concrete.

    The nodes of the elements' edges bear 1 : 4 : 1. Without care that leaves teeth of p h^2 / 12 in
    M, of 0.4 to 3 times m on 16 pieces, and up to 30 times the largest Q.
    """
    lining = Beam("wall", EA=Scalar(EA), EI=Scalar(EI), clamped_on=("x0", "y0"))
    stages = (Stage("open", excavate=("core",), build=("lining",)),)
    m = abs(_ring_in_ground(0.5, EA, EI)[2])
    errors = []
    for n in (4, 8):
        staged = _lined(_tunnel(n), stages, in_situ=_stress(P0, 0.5 * P0), lining=lining)
        found = staged.survey(NOTHING, fields=False).members
        angle = np.arctan2(found.ends[..., 1], found.ends[..., 0])
        moment = np.abs(found.moment[..., 0] + m * np.cos(2 * angle)).max() / m
        slope = 2 * m / RADIUS
        shear = np.abs(found.shear[:, 0] + slope * np.sin(2 * angle.mean(axis=1))).max() / slope
        errors.append((moment, shear))
    (coarse, coarse_shear), (fine, fine_shear) = errors
    assert fine < 0.02
    assert fine < 0.5 * coarse < 0.05
    assert fine_shear < 0.12
    assert fine_shear < 0.5 * coarse_shear


def test_gauges_read_the_moments_and_shears_of_the_table():
    lining = Beam("wall", EA=Scalar(2e9), EI=Scalar(1.67e6), clamped_on=("x0", "y0"))
    stages = (Stage("open", excavate=("core",), build=("lining",)),)
    mesh, stress = _tunnel(4), _stress(P0, 0.5 * P0)
    piece = 5
    table = _lined(mesh, stages, in_situ=stress, lining=lining)
    table = table.survey(NOTHING, fields=False).members
    first, second = (tuple(map(float, end)) for end in table.ends[piece])
    middle = tuple(map(float, table.ends[piece].mean(axis=0)))
    cells = [
        gauge("load-cell", name, place, name[0], structure="lining", dimension=dimension)
        for name, place, dimension in (
            ("M first", first, "moment per length"),
            ("M second", second, "moment per length"),
            ("Q", middle, "line load"),
        )
    ]
    staged = _lined(mesh, stages, in_situ=stress, lining=lining, channels=cells)
    read = staged.survey(NOTHING, fields=False).computed[:, 0]
    expected = [*table.moment[piece, :, 0], table.shear[piece, 0]]
    np.testing.assert_allclose(read, expected, rtol=1e-6)


@pytest.mark.parametrize("upwards", [True, False])
def test_moment_goes_on_where_a_wall_enters_the_ground(upwards):
    """Ground stands on both sides of its foot; which way the mesh draws it does not matter."""
    mesh = regroup(box("quad4", (8, 8), size=(8.0, 8.0)),
                   pit=lambda x: (x[:, 0] < 4) & (x[:, 1] > 5))  # fmt: skip
    here = np.flatnonzero((mesh.points[:, 0] == 4.0) & (mesh.points[:, 1] >= 2.0))
    y = here[np.argsort(mesh.points[here, 1])]
    lines = np.stack([y[:-1], y[1:]], axis=1)
    mesh = with_lines(mesh, "wall", lines if upwards else lines[:, ::-1])
    push = {"push": Traction("x1", (Scalar(-1e5), ZERO))}
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e8, 0.3)},
        groups={"rock": "rock", "pit": "rock"},
        supports=rollers(2),
        structures={"wall": Beam("wall", EA=Scalar(4e9), EI=Scalar(3e8))},
        stages=(Stage("dig", excavate=("pit",), build=("wall",), loads=push),),
    )
    found = staged.survey(NOTHING, fields=False).members
    order = np.argsort(found.ends[:, :, 1].mean(axis=1))[::-1]
    ends, moment = found.ends[order], found.moment[order, :, 0]
    assert (ends[:, 0, 1] > ends[:, 1, 1]).all()  # downwards, with the ground on the left
    assert np.abs(moment).max() > 1e3
    np.testing.assert_allclose(moment[1:, 0], moment[:-1, 1], atol=1e-7 * np.abs(moment).max())


def _propped_wall(kind, n):
    """Places along a wall with a stiff strut 1 m below its top, and its moments there."""
    mesh = regroup(box(kind, (n, n), size=(8.0, 8.0)),
                   pit=lambda x: (x[:, 0] < 4) & (x[:, 1] > 4))  # fmt: skip
    here = np.flatnonzero((mesh.points[:, 0] == 4.0) & (mesh.points[:, 1] >= 2.0))
    y = here[np.argsort(mesh.points[here, 1])]
    ends = [y[:-1], y[1:]] if kind == "quad4" else [y[:-2:2], y[2::2], y[1::2]]
    mesh = with_lines(mesh, "wall", np.stack(ends, axis=1))
    strut = Struts((((4.0, 7.0), (0.0, 7.0)),), Scalar(1.0), EA=Scalar(1e10), second_end="fixed")
    push = {"push": Traction("x1", (Scalar(-1e5), ZERO))}
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e7, 0.3)},
        groups={"rock": "rock", "pit": "rock"},
        supports=rollers(2),
        structures={"wall": Beam("wall", EA=Scalar(4e9), EI=Scalar(3e8)), "strut": strut},
        stages=(Stage("dig", excavate=("pit",), build=("wall", "strut"), loads=push),),
    )
    found = staged.survey(NOTHING, fields=False).members
    wall = np.array([name == "wall" for name in found.structures])
    return found.ends[wall, 0, 1], found.moment[wall, 0, 0]


def test_the_moment_of_a_wall_has_its_peak_at_a_strut():
    """On quadratic elements, whose teeth are taken out, as on fine ones of first order."""
    (places, coarse), (fine_places, fine) = _propped_wall("quad8", 8), _propped_wall("quad4", 32)
    at, fine_at = np.isclose(places, 7.0), np.isclose(fine_places, 7.0)
    assert abs(fine[fine_at][0]) == np.abs(fine[fine_places > 6.0]).max() > 1e3
    np.testing.assert_allclose(coarse[at], fine[fine_at], rtol=0.05)


def test_dismantled_lining_leaves_the_unlined_tunnel():
    mesh = _tunnel(3, reach=8)
    several = (
        Stage("open", excavate=("core",), build=("lining",)),
        Stage("strip", dismantle=("lining",)),
    )
    lined = _lined(mesh, several).survey(NOTHING, fields=True)
    bare = _lined(mesh, (Stage("open", excavate=("core",)),)).survey(NOTHING, fields=True)
    a, b = lined.fields.displacement, bare.fields.displacement
    scale = np.abs(b).max()
    assert np.abs(a[1] - b[1]).max() > 0.01 * scale
    np.testing.assert_allclose(a[2], b[1], atol=1e-10 * scale)
    assert np.isnan(lined.members.axial[:, 1]).all()


def test_lining_built_after_all_motion_bears_nothing():
    mesh = _tunnel(3, reach=8)
    stages = (Stage("open", excavate=("core",)), Stage("line", build=("lining",)))
    found = _lined(mesh, stages).survey(NOTHING, fields=False).members
    assert np.abs(found.axial[:, 1]).max() < 1e-9 * P0 * RADIUS


def test_load_in_two_stages_ends_where_the_load_in_one_ends():
    mesh = _tunnel(3, reach=8)
    begin = Stage("open", excavate=("core",))
    line = Stage("line", build=("lining",))

    def push(name, part):
        value = (Scalar(-part * 1e6), ZERO)
        return Stage(name, loads={"push": Traction("right", value)})

    mesh = with_lines(mesh, "right", _right_edge(mesh))
    once = _lined(mesh, (begin, line, push("all", 1))).survey(NOTHING, fields=True)
    twice = _lined(mesh, (begin, line, push("half", 0.5), push("all", 1))).survey(
        NOTHING, fields=True
    )
    scale = np.abs(once.members.axial[:, -1]).max()
    assert scale > 1e4
    for name in ("axial", "moment", "shear"):
        one, two = getattr(once.members, name)[..., -1], getattr(twice.members, name)[..., -1]
        np.testing.assert_allclose(one, two, atol=1e-9 * scale)


def _right_edge(mesh):
    block = mesh.facets[0]
    centre = mesh.points[block.nodes].mean(axis=1)
    outer = np.linalg.norm(centre, axis=1) > 7.5 * RADIUS
    return block.nodes[outer & (centre[:, 0] > centre[:, 1])]


def test_two_load_cases_on_one_lining_do_not_mix():
    mesh = _tunnel(3, reach=8)
    mesh = with_lines(mesh, "right", _right_edge(mesh))
    begin = Stage("open", excavate=("core",), build=("lining",))

    def case(name, x):
        load = Traction("right", (Scalar(x), ZERO))
        return Stage(name, loads={"push": load}, independent=True)

    both = _lined(mesh, (begin, case("a", 1e6), case("b", -2e6))).survey(NOTHING, fields=False)
    last = _lined(mesh, (begin, case("b", -2e6))).survey(NOTHING, fields=False)
    np.testing.assert_allclose(both.members.axial[:, 2], last.members.axial[:, 1], rtol=1e-12)


def _block(dim, structures, stages, **changes):
    mesh = box({2: "quad4", 3: "hex8"}[dim], (2,) * dim)
    settings = {
        "materials": {"rock": material("rock", 1e9, 0.0)},
        "groups": {"all": "rock"},
        "supports": rollers(dim),
        "structures": structures,
        "stages": stages,
    }
    return model(mesh, **{**settings, **changes})


@pytest.mark.parametrize("dim", [2, 3])
def test_bolt_in_uniform_strain_bears_stiffness_times_strain(dim):
    ends = ((0.13, 0.21, 0.4)[:dim], (0.77, 0.34, 0.6)[:dim])
    bolts = Bolts((ends,), None if dim == 3 else Scalar(1.5), EA=Scalar(1e-3))
    pull = tuple(Scalar(1e6 * (axis == 0)) for axis in range(dim))
    stages = (Stage("bolt", build=("bolts",)), Stage("pull", loads={"x": Traction("x1", pull)}))
    found = _block(dim, {"bolts": bolts}, stages).survey(NOTHING, fields=False).members
    along = np.subtract(*ends)
    strain = 1e-3 * along[0] ** 2 / (along @ along)
    assert found.axial[0, 0] == pytest.approx(0, abs=1e-20)
    assert found.axial[0, 1] == pytest.approx(1e-3 * strain, rel=1e-9)
    assert np.isnan(found.moment).all()


def test_stiff_bolts_share_the_load_with_the_ground():
    """Ground E A and two bars EA / spacing on its sides stretch together (nu = 0)."""
    pair = (((0.0, 0.0), (1.0, 0.0)), ((0.0, 1.0), (1.0, 1.0)))
    E_steel, d, spacing = 200e9, 0.05, 1.5
    bolts = Bolts(pair, Scalar(spacing), E=Scalar(E_steel), diameter=Scalar(d))
    pull = (Scalar(1e6), ZERO)
    mesh = box("quad4", (1, 1))
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e9, 0.0)},
        groups={"all": "rock"},
        supports=rollers(2),
        structures={"bolts": bolts},
        stages=(Stage("pull", build=("bolts",), loads={"x": Traction("x1", pull)}),),
    )
    survey = staged.survey(NOTHING, fields=True)
    EA = E_steel * np.pi * d**2 / 4
    strain = 1e6 / (1e9 + 2 * EA / spacing)
    right = mesh.points[:, 0] == 1.0
    np.testing.assert_allclose(survey.fields.displacement[1, right, 0], strain, rtol=1e-12)
    np.testing.assert_allclose(survey.members.axial[:, 0], EA * strain, rtol=1e-12)


def _with_parameters(**names):
    parameters = (
        Parameter("E", E, 1e8, 1e11),
        Parameter("E_c", 15e9, 1e9, 1e11),
        Parameter("t", 0.2, 0.05, 1.0),
        Parameter("nu_c", 0.2, 0.0, 0.4),
        Parameter("d", 0.05, 0.01, 0.1),
        Parameter("s", 1.5, 0.5, 3),
        Parameter("part", 0.4, 0, 1),
    )
    lining = Beam(
        "wall", E=Scalar(1.0, "E_c"), thickness=Scalar(1.0, "t"), nu=Scalar(1.0, "nu_c"),
        clamped_on=("x0", "y0"),
    )  # fmt: skip
    ends = (((3.1, 0.9), (7.0, 2.0)), ((0.8, 3.2), (1.5, 6.5)))
    bolts = Bolts(ends, Scalar(1.0, "s"), E=Scalar(200e9), diameter=Scalar(1.0, "d"))
    stages = (
        Stage("open", excavate=("core",), build=("bolts",), release={"core": Scalar(1.0, "part")}),
        Stage("line", build=("lining",), release={"core": Scalar(1.0)}),
        Stage("cut", dismantle=("bolts",)),
    )
    return _lined(
        _tunnel(3, reach=8),
        stages,
        in_situ=_stress(P0, 0.6 * P0),
        lining=lining,
        structures={"lining": lining, "bolts": bolts},
        materials={"rock": material("rock", Scalar(1.0, "E"), NU)},
        parameters=parameters,
        channels=(
            displacement("a", (3.1, 0.2), (1.0, 0.0)),
            displacement("b", (0.2, 3.1), (0.0, 1.0)),
        ),
        **names,
    )


def test_derivatives_by_every_number_of_a_structure():
    staged = _with_parameters()
    response = staged.response([(c, s) for c in "ab" for s in ("open", "line", "cut")])
    p = np.array([q.start for q in staged.case.parameters])
    assert_exact(response, p, staged.names)
    assert "enters its stiffness nonlinearly" in (
        _with_only("t").response([("a", "line")]).obstacle() or ""
    )


def _with_only(name):
    staged = _with_parameters()
    kept = tuple(q for q in staged.case.parameters if q.name == name)
    return _lined(
        staged.mesh,
        (Stage("line", excavate=("core",), build=("lining",)),),
        lining=Beam("wall", E=Scalar(15e9), thickness=Scalar(1.0, name)),
        parameters=kept,
        channels=(displacement("a", (3.1, 0.2), (1.0, 0.0)),),
    )


def _tunnel_of_free_lining():
    """Its readings, and the numbers EA, EI and E with which they are made."""
    lining = Beam("wall", EA=Scalar(1.0, "EA"), EI=Scalar(1.0, "EI"), clamped_on=("x0", "y0"))
    names = (("EA", 4e9), ("EI", 3e8), ("E", E))
    staged = _lined(
        _tunnel(3, reach=8),
        (Stage("open", excavate=("core",), build=("lining",)),),
        in_situ=_stress(P0, 0.5 * P0),
        lining=lining,
        materials={"rock": material("rock", Scalar(1.0, "E"), NU)},
        parameters=tuple(Parameter(n, v, v / 10, v * 10) for n, v in names),
        channels=tuple(
            displacement(f"c{k}", tuple(RADIUS * 1.05 * np.array(x)), x)
            for k, x in enumerate([(1.0, 0.0), (0.0, 1.0), (0.6, 0.8), (0.8, 0.6)])
        ),
    )
    response = staged.response([(f"c{k}", "open") for k in range(4)])
    return response, np.array([v for _, v in names])


def test_the_exported_equations_of_a_lining_give_the_same_readings():
    """It stretches and bends, each with its own number; at others than those of the export."""
    response, start = _tunnel_of_free_lining()
    p = start * [1.4, 0.6, 1.1]
    v, jacobian = response.evaluate(p)
    assert (np.abs(jacobian * p).max(axis=0) > 1e-3 * np.abs(v).max()).all()  # all three matter
    np.testing.assert_allclose(solved_at_once(response.system(), p), v, rtol=1e-8)


def test_condensation_finds_the_stiffness_of_a_lining():
    response, true = _tunnel_of_free_lining()
    assert response.obstacle() is None
    measured = response.readings(true)
    p = true * [1.3, 0.8, 1.1]
    for _ in range(20):
        condensed = response.condense(p, measured, np.full(4, 1e-4))
        p = np.linalg.lstsq(condensed.matrix * true, condensed.vector)[0] * true
    np.testing.assert_allclose(p, true, rtol=1e-6)


def test_beam_is_the_limit_of_a_thin_lining_of_elements():
    """Beside what the lining does at all, the two differ by parts of t / R."""
    apart = []
    for thin in (0.05, 0.025, 0.0125):
        mesh = ringed(n=6, radius=RADIUS, thickness=thin * RADIUS, reach=15 * RADIUS)
        dug = {"excavate": ("core", "ring")}
        crown = np.argmin(np.linalg.norm(mesh.points - [0.0, RADIUS], axis=1))
        shell = Beam(
            "wall", E=Scalar(60e9), nu=Scalar(0.2), thickness=Scalar(thin * RADIUS),
            clamped_on=("x0", "y0"),
        )  # fmt: skip
        settings = {
            "in_situ": _stress(P0, 0.5 * P0),
            "lining": shell,
            "groups": {"core": "rock", "ring": "rock", "rock": "rock"},
            "materials": {"rock": material("rock", E, NU), "shot": material("shot", 60e9, 0.2)},
        }
        bare, beam, solid = (
            _lined(mesh, (Stage("open", **does),), **settings)
            .survey(NOTHING, fields=True)
            .fields.displacement[1, crown, 1]
            for does in (
                dug,
                {**dug, "build": ("lining",)},
                {"excavate": ("core",), "install": {"ring": "shot"}},
            )
        )
        apart.append(abs((beam - solid) / (bare - solid)))
    assert apart[0] < 0.05
    assert apart[1] < 0.6 * apart[0]
    assert apart[2] < 0.6 * apart[1]


PANET = FaceProfile(
    "panet", ("core",), Scalar(RADIUS), constants=(Scalar(0.25), Scalar(0.75)), conversion="direct"
)


def _behind_face(*stages, **changes):
    return _lined(_tunnel(), stages, face=PANET, **changes)


@pytest.mark.parametrize(
    ("stages", "closed_at"),
    [
        ((Stage("open", ("core",), distance=Scalar(2.5)),
          Stage("lined", build=("lining",), distance=Scalar(2.5)),
          Stage("far", distance=Scalar(1e4))), 2.5),
        ((Stage("open", ("core",), distance=Scalar(2.5)),
          Stage("far", build=("lining",), distance=Scalar(1e4))), 2.5),
        ((Stage("ahead", ("core",), distance=Scalar(0.0)),
          Stage("open", distance=Scalar(4.0)),
          Stage("far", build=("lining",), distance=Scalar(1e4))), 4.0),
    ],
)  # fmt: skip
def test_a_lining_behind_a_face_takes_what_is_released_after_it(stages, closed_at):
    """Panet's s = lambda there; then ground p0 - p = 2 G u / R and ring p = k (u - u_0)."""
    found = _behind_face(*stages)
    axial = found.survey(NOTHING, fields=True).members.axial[:, -1]
    left = 0.75 * (0.75 / (0.75 + closed_at / RADIUS)) ** 2
    G, k = E / (2 * (1 + NU)), 4e9 / RADIUS**2
    exact = -left * P0 / (1 + 2 * G / (k * RADIUS)) * RADIUS
    np.testing.assert_allclose(axial, exact, rtol=0.01)
    (note,) = (text for text in found.notes if "'lining'" in text)
    assert f"{closed_at:g} m behind it" in note


def test_a_lining_that_would_stand_before_its_tunnel_is_refused_with_the_line_to_write():
    """Built where the tunnel is excavated it carried all of the stress."""
    far = Stage("far", distance=Scalar(1e4))
    with pytest.raises(InputError) as caught:
        _behind_face(Stage("open", ("core",), distance=Scalar(2.5), build=("lining",)), far)
    (fault,) = caught.value.faults
    assert fault.path == "stages[0].build[0]"
    assert "would stand before anything is released and carry all of it" in fault.message
    assert "'{name: lined, distance: 2.5 m, build: [lining]}'" in fault.hint

    with pytest.raises(InputError) as caught:
        _lined(
            _tunnel(),
            (
                Stage("open", ("core",), release={"core": Scalar(0.4)}, build=("lining",)),
                Stage("line", release={"core": Scalar(1.0)}),
            ),
        )
    (fault,) = caught.value.faults
    assert "'{name: lined, build: [lining], release: {core: 1}}'" in fault.hint

    chern = replace(PANET, law="chern", constants=(Scalar(1.1), Scalar(1.7)))
    with pytest.raises(InputError) as caught:
        _lined(
            _tunnel(),
            (
                Stage("ahead", ("core",), distance=Scalar(-3.0)),
                Stage("lined", build=("lining",), distance=Scalar(2.5)),
            ),
            face=chern,
        )
    (fault,) = caught.value.faults
    assert "3 m ahead of it: before the face has passed" in fault.message

    found = _lined(_tunnel(), (Stage("open", ("core",), build=("lining",)),))
    (note,) = (text for text in found.notes if "'lining'" in text)
    assert "'{name: opened, excavate: [core], release: {core: 0.5}}'" in note
