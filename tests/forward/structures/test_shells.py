"""Shells on faces of solids: plates and rings in closed form, stages, exact derivatives."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from geoident.errors import InputError
from geoident.forward.structures.checks import structure_notes
from geoident.model.actions import PointForce, Traction
from geoident.model.case import Stage, Support
from geoident.model.creep import StiffnessTable
from geoident.model.gauges import Reads
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Shell
from tests.support.cases import displacement, material, model, rollers
from tests.support.derivatives import assert_exact
from tests.support.force_gauges import gauge
from tests.support.meshes import box
from tests.support.shelled import tunnel_slice
from tests.support.yielding import Cavity, mohr, mohr_limit, rock

NOTHING = np.empty(0)
ZERO = Scalar(0.0)
E, NU, FC = 30e9, 0.2, 20e6


def _shell(group, t, *, axis=(1.0, 0.0, 0.0), **changes):
    return Shell(group, **{"E": Scalar(E), "thickness": Scalar(t), "nu": Scalar(NU)} | changes,
                 axis=axis)  # fmt: skip


def _plate(kind, n, t, *, clamped, normal=2):
    """A quarter of a square plate of 4 m on ground that bears next to nothing, and its faces.

    The plate is held at its edges, and along itself everywhere, as the ground is. Its normal is z,
    or another axis, with all of it turned round.
    """
    turned = np.roll([0, 1, 2], normal - 2)  # x, y, z lie along the axes
    axes = np.argsort(turned)
    mesh = box(kind, (n, n, 1), size=(2.0, 2.0, 0.5))
    mesh = replace(mesh, points=mesh.points[:, turned])
    everywhere = Support("outer", tuple(sorted(axes[:2].tolist())))
    held = Support("x1", (normal,)), Support("y1", (normal,))
    edges = ("x1", "y1") if clamped else ()
    shell = _shell("z1", t, mirrored_on=("x0", "y0"), clamped_on=edges,
                   axis=tuple(np.eye(3)[axes[0]].tolist()),
                   compressive_strength=FC, tensile_strength=FC)  # fmt: skip
    across = np.eye(3)[normal].tolist()
    push = {"push": Traction("z1", tuple(Scalar(-1e3 * part) for part in across))}
    staged = model(
        mesh,
        materials={"air": material("air", 1.0, 0.0)},
        groups={"all": "air"},
        supports=(everywhere, *held),
        structures={"slab": shell},
        stages=(Stage("load", build=("slab",), loads=push),),
        channels=(displacement("w", tuple(0.5 * part for part in across),
                               tuple(-part for part in across)),),
    )  # fmt: skip
    return staged.survey(NOTHING, fields=False)


@pytest.mark.parametrize(
    ("clamped", "deflection", "moment"), [(False, 0.00406, 0.0442), (True, 0.00126, None)]
)
@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
def test_a_square_plate_bends_as_timoshenko_has_it(kind, clamped, deflection, moment, verification):
    """w = alpha q a^4 / B, M = beta q a^2 with beta(nu) = 0.0479 (nu 0.3) to 0.0442 (nu 0.2)."""
    n, t = (8, 0.02) if kind.endswith(("8", "4")) else (4, 0.02)
    found = _plate(kind, n, t, clamped=clamped)
    exact = deflection * 1e3 * 4.0**4 / (E * t**3 / 12 / (1 - NU**2))
    assert found.computed[0, 0] == pytest.approx(exact, rel=0.03)
    edges = "clamped" if clamped else "with hinged edges"
    verification("square-plate", f"{kind}, {edges}", ["middle"], exact=[exact],
                 found=found.computed[0])  # fmt: skip
    shells = found.shells
    middle = np.linalg.norm(shells.centres[:, :2], axis=1).argmin()
    used = shells.utilisation[..., 0] * FC * t**2 / 4
    np.testing.assert_allclose(used[:, :2], np.abs(shells.moment[:, :2, 0]), rtol=1e-6)
    largest = np.abs(shells.m_principal[..., 0]).max(axis=1)
    np.testing.assert_allclose(used[:, 2], largest, rtol=4e-3)  # directions 5 degrees apart
    if moment is not None:  # the load presses on the side without ground
        assert shells.moment[middle, 0, 0] == pytest.approx(-moment * 1e3 * 16.0, rel=0.06)
    assert np.abs(shells.normal).max() < 1e-6 * np.abs(shells.moment).max()


def test_a_plate_bends_alike_whatever_axis_it_faces():
    """A plane of symmetry meets it in a straight line, along which other planes lie, too."""
    plates = [_plate("hex8", 4, 0.02, clamped=False, normal=axis) for axis in range(3)]
    for plate in plates[:2]:
        np.testing.assert_allclose(plate.computed, plates[2].computed, rtol=1e-9)
        np.testing.assert_allclose(plate.shells.moment, plates[2].shells.moment, rtol=1e-6)


def _alone(kind, n, place, shell, supports, point, direction, loads=(), **changes):
    """How a point of a shell moves that is nearly alone, on soft ground outside of it.

    The shell is on n by n cells of a box that `place` bends, as its inside.
    """
    grid = box(kind, (n, n, 1))
    mesh = replace(grid, points=place(*grid.points.T))
    foot = np.linalg.norm(mesh.points - place(0.5, 0.0, 0.0), axis=1).argmin()
    staged = model(
        replace(mesh, node_groups={**mesh.node_groups, "foot": np.array([foot])}),
        materials={"air": material("air", 1.0, 0.0)},
        groups={"all": "air"},
        supports=supports,
        structures={"shell": shell},
        stages=(Stage("load", build=("shell",), loads={f"f{k}": f for k, f in enumerate(loads)}),),
        channels=(displacement("w", point, direction),),
        **changes,
    )
    return staged.survey(NOTHING, fields=False).computed[0, 0]


def _roof_of_scordelis_and_lo(kind, n):
    """A quarter of it: 0.3024 ft (lb, ft; weight 90 lb/ft2)."""

    def place(angle, along, out):
        angle, r = np.radians(40.0) * angle, 25.0 + 0.5 * out
        return np.stack([r * np.sin(angle), r * np.cos(angle), 25.0 * (1.0 - along)], axis=-1)

    shell = _shell("z0", 0.25, axis=(0.0, 0.0, 1.0), E=Scalar(4.32e8), nu=ZERO,
                   weight=Scalar(90.0), mirrored_on=("x0", "y1"))  # fmt: skip
    supports = Support("x0", (0,)), Support("y1", (2,)), Support("y0", (0, 1))
    edge = tuple(place(1.0, 1.0, 0.0).tolist())
    down = (0.0, -1.0, 0.0)
    return _alone(kind, n, place, shell, supports, edge, down, gravity=(0.0, -10.0, 0.0)) / 0.3024


def _pinched_cylinder(kind, n):
    """An eighth of it, on diaphragms: 1.8248e-5 under a unit force."""

    def place(angle, along, out):
        angle, r = np.pi / 2 * angle, 300.0 + 20.0 * out
        return np.stack([r * np.sin(angle), r * np.cos(angle), 300.0 * (1.0 - along)], axis=-1)

    shell = _shell("z0", 3.0, axis=(0.0, 0.0, 1.0), E=Scalar(3e6), nu=Scalar(0.3),
                   mirrored_on=("x0", "x1", "y1"))  # fmt: skip
    supports = (Support("x0", (0,)), Support("x1", (1,)), Support("y1", (2,)),
                Support("y0", (0, 1)))  # fmt: skip
    top = (0.0, 300.0, 0.0)
    force = PointForce(top, (ZERO, Scalar(-0.25), ZERO))
    return _alone(kind, n, place, shell, supports, top, (0.0, -1.0, 0.0), (force,)) / 1.8248e-5


def _hemisphere(kind, n):
    """A quarter of one with a hole of 18 degrees, pulled and pushed by 2: 0.0940."""

    def place(angle, along, out):
        angle, up, r = np.pi / 2 * angle, np.radians(72.0) * along, 10.0 + 0.5 * out
        level = r * np.cos(up)
        return np.stack([level * np.cos(angle), level * np.sin(angle), r * np.sin(up)], axis=-1)

    shell = _shell("z0", 0.04, axis=(0.0, 0.0, 1.0), E=Scalar(6.825e7), nu=Scalar(0.3),
                   mirrored_on=("x0", "x1"))  # fmt: skip
    supports = Support("x0", (1,)), Support("x1", (0,)), Support("foot", (2,))
    ends = (10.0, 0.0, 0.0), (0.0, 10.0, 0.0)
    forces = (PointForce(ends[0], (Scalar(1.0), ZERO, ZERO)),
              PointForce(ends[1], (ZERO, Scalar(-1.0), ZERO)))  # fmt: skip
    return _alone(kind, n, place, shell, supports, ends[0], (1.0, 0.0, 0.0), forces) / 0.0940


@pytest.mark.slow  # 4 s each; the closed forms of plates above are quick
@pytest.mark.parametrize(("kind", "n"), [("hex8", 32), ("hex20", 16), ("tet10", 16)])
def test_the_shells_on_which_elements_are_tried(kind, n, verification):
    """The "obstacle course" of Belytschko and others (1985), R/t = 100 and 250 among them."""
    shells = _roof_of_scordelis_and_lo, _pinched_cylinder, _hemisphere
    found = np.array([shell(kind, n) for shell in shells])
    names = ["roof", "pinched cylinder", "hemisphere"]
    verification("shell-course", kind, names, exact=np.ones(3), found=found)
    np.testing.assert_allclose(found, 1.0, atol=0.02)


RADIUS, P0, E_ROCK, NU_ROCK = 3.0, 5e6, 2e9, 0.3
SIDES = ("x0", "y0", "z0", "z1")


def _lined(kind, n, thickness, stages, *, reach=40, **changes):
    layers = int(np.ceil(np.log(reach) / np.log(1 + np.pi / 4 / n))) + 1
    width = RADIUS * np.pi / 4 / n
    mesh = tunnel_slice(kind, n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS, width=width)
    vertical, horizontal = P0, 0.5 * P0
    in_situ = ConstantStress(
        (Scalar(-horizontal), Scalar(-vertical), Scalar(-NU_ROCK * (vertical + horizontal)),
         *(ZERO,) * 3)
    )  # fmt: skip
    shell = _shell("wall", thickness, axis=(0.0, 0.0, 1.0), mirrored_on=SIDES,
                   compressive_strength=FC)  # fmt: skip
    settings = {
        "materials": {"rock": material("rock", E_ROCK, NU_ROCK)},
        "groups": {"core": "rock", "rock": "rock"},
        "supports": tuple(Support(s, (a,)) for s, a in zip(SIDES, (0, 1, 2, 2), strict=True)),
        "in_situ": in_situ,
        "structures": {"lining": shell},
        "stages": stages,
    }
    return model(mesh, **{**settings, **changes})


def _thin_ring(thickness, E=E):
    """Mean and amplitude of N and of M (times cos 2a); see `test_structures._ring_in_ground`."""
    EA = E * thickness / (1 - NU**2)
    EI = EA * thickness**2 / 12
    G, R, S = E_ROCK / (2 * (1 + NU_ROCK)), RADIUS, P0 * 0.25
    load = np.array([[-6 / R**4, -4 / R**2], [-6 / R**4, -2 / R**2]])
    motion = np.array([[2 / R**3, 4 * (1 - NU_ROCK) / R],
                       [2 / R**3, -(2 - 4 * NU_ROCK) / R]]) / (2 * G)  # fmt: skip
    stretch, bend = np.array([1.0, 2.0]) / R, np.array([-4.0, -2.0]) / R**2
    ring = EA * np.outer(stretch, stretch) + EI * np.outer(bend, bend)
    moved = motion @ np.linalg.solve(ring @ motion - load, np.array([S, -S]))
    mean = -P0 * 0.75 * R / (1 + 2 * G * R / EA)
    return mean, EA * stretch @ moved, -abs(EI * bend @ moved)


OPEN = (Stage("open", excavate=("core",), build=("lining",)),)


@pytest.mark.parametrize(
    ("kind", "n", "of_n", "of_m"),
    [("hex8", 8, 0.005, 0.01), ("hex20", 4, 0.005, 0.01), ("tet10", 3, 0.005, 0.015)],
)
def test_a_slice_of_a_lined_tunnel_is_the_ring_of_the_plane(kind, n, of_n, of_m, verification):
    """n_22 and m_22 around the tunnel, of a lining of 0.3 m of concrete."""
    found = _lined(kind, n, 0.3, OPEN).survey(NOTHING, fields=False).shells
    mean, vary, bent = _thin_ring(0.3)
    twice = np.cos(2 * np.arctan2(found.centres[:, 1], found.centres[:, 0]))
    hoop, moment = found.normal[:, 1, 0], found.moment[:, 1, 0]
    np.testing.assert_allclose(hoop, mean + vary * twice, atol=of_n * abs(mean))
    np.testing.assert_allclose(moment, bent * twice, atol=of_m * abs(bent))
    assert moment @ twice / (twice @ twice) == pytest.approx(bent, rel=0.01)
    exact = -(mean + vary * twice) / (FC * (0.3 - 2 * np.abs(bent * twice / (mean + vary * twice))))
    np.testing.assert_allclose(found.utilisation[:, 1, 0], exact, rtol=0.02)  # EN 1992-1-1, 12.6.1
    ends = [np.argmax(twice), np.argmin(twice)]
    where = ["spring line", "crown"]
    verification("shell-ring", kind, where, exact=(mean + vary * twice)[ends], found=hoop[ends])


def _said_of_kinks(staged):
    said = [note for note in structure_notes(staged.on_mesh) if "triangles of first order" in note]
    return [float(re.search(r"some ([0-9]+) %", note)[1]) / 100 for note in said]


def test_moments_of_a_thin_lining_on_small_triangles_are_off_as_the_check_says():
    staged = _lined("tet4", 4, 0.1, OPEN, reach=10)
    (said,) = _said_of_kinks(staged)
    found = staged.survey(NOTHING, fields=False).shells
    twice = np.cos(2 * np.arctan2(found.centres[:, 1], found.centres[:, 0]))
    _, _, bent = _thin_ring(0.1)
    assert np.abs(found.moment[:, 1, 0] - bent * twice).max() / abs(bent) == pytest.approx(
        said, 0.3
    )
    for kind, thickness in (("tet4", 0.3), ("tet10", 0.1), ("hex8", 0.1)):
        assert not _said_of_kinks(_lined(kind, 4, thickness, OPEN, reach=4))
    flat = box("tet4", (2, 2, 2))
    slab = model(
        flat,
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=rollers(3),
        structures={"slab": _shell("z1", 0.01)},
        stages=(Stage("build", build=("slab",)),),
    )
    assert not _said_of_kinks(slab)


@pytest.mark.slow  # 6 s; the lining of 0.3 m above is quick
def test_moments_of_a_thin_lining_on_triangles_converge():
    """0.1 m of concrete, R = 3 m: what unevenness loads it with shrinks with the faces."""
    _, _, bent = _thin_ring(0.1)
    worst = []
    for n in (3, 6):
        found = _lined("tet10", n, 0.1, OPEN).survey(NOTHING, fields=False).shells
        twice = np.cos(2 * np.arctan2(found.centres[:, 1], found.centres[:, 0]))
        worst.append(np.abs(found.moment[:, 1, 0] - bent * twice).max() / abs(bent))
    assert worst[0] < 0.06
    assert worst[1] < 0.4 * worst[0]


def test_its_gauges_read_the_closed_form_between_the_middles_of_faces():
    mean, vary, bent = _thin_ring(0.3)
    cells = []
    for name, quantity, angle in (("N", "n_22", 40.0), ("M", "m_22", 0.0), ("M2", "m_22", 90.0)):
        at = np.radians(angle)
        place = (RADIUS * np.cos(at), RADIUS * np.sin(at), 0.1)
        dimension = "line load" if name == "N" else "moment per length"
        cells.append(gauge("load-cell", name, place, quantity, structure="lining",
                           dimension=dimension))  # fmt: skip
    read = _lined("hex8", 8, 0.3, OPEN, channels=tuple(cells)).survey(NOTHING, fields=False)
    exact = [mean + vary * np.cos(np.radians(80.0)), bent, -bent]
    np.testing.assert_allclose(read.computed[:, 0], exact, rtol=0.015)


def test_strain_gauges_and_pressure_cells_read_what_the_ring_has():
    """e = n_22 / D and y m_22 / B where nothing strains along the tunnel; p = -N / R."""
    t, (mean, vary, bent) = 0.3, _thin_ring(0.3)
    D = E * t / (1 - NU**2)
    cells, exact = [], []
    for angle in (0.0, 90.0):
        at, sign = np.radians(angle), np.cos(np.radians(2 * angle))
        place = (RADIUS * np.cos(at), RADIUS * np.sin(at), 0.1)
        around = (-float(np.sin(at)), float(np.cos(at)), 0.0)
        for fibre, y, depth in (("axis", 0.0, None), ("inside", t / 2, None),
                                ("outside", -0.1, 0.1)):  # fmt: skip
            name = f"{fibre} {angle}"
            cells.append(gauge("strain", name, place, fibre, structure="lining", fibre=depth,
                               direction=around, reads=Reads.VALUE))  # fmt: skip
            exact.append((mean + vary * sign) / D + y * bent * sign / (D * t**2 / 12))
    along = {"direction": (0.0, 0.0, 1.0), "reads": Reads.VALUE}
    cells.append(gauge("strain", "along", place, "axis", structure="lining", **along))
    stage = _lined("hex8", 8, t, OPEN, channels=tuple(cells))
    read = stage.survey(NOTHING, fields=False).computed[:, 0]
    np.testing.assert_allclose(read[:-1], exact, atol=1e-5)
    assert abs(read[-1]) < 1e-9
    cell = gauge("pressure-cell", "P", place, structure="lining", dimension="pressure",
                 compression=True)  # fmt: skip
    even = ConstantStress((Scalar(-P0),) * 3 + (ZERO,) * 3)
    found = _lined("hex20", 4, t, OPEN, channels=(cell,), in_situ=even).survey(
        NOTHING, fields=False
    )
    pressure = -found.shells.normal[:, 1, 0].mean() / RADIUS
    assert found.computed[0, 0] == pytest.approx(pressure, rel=0.03)


def test_a_shell_built_after_all_motion_bears_nothing_and_leaves_no_trace():
    stages = (
        Stage("open", excavate=("core",)),
        Stage("line", build=("lining",)),
        Stage("strip", dismantle=("lining",)),
    )
    found = _lined("hex8", 3, 0.3, stages, reach=8).survey(NOTHING, fields=True)
    assert np.isnan(found.shells.normal[..., [0, 2]]).all()
    assert np.abs(found.shells.normal[..., 1]).max() < 1e-9 * P0 * RADIUS
    u = found.fields.displacement
    np.testing.assert_allclose(u[3], u[1], atol=1e-10 * np.abs(u).max())


def test_one_that_ages_meets_every_load_with_its_stiffness_of_that_day():
    """In elastic ground each part of the release is that of a thin ring of its own modulus."""
    day = 86400.0
    ageing = StiffnessTable((0.0, 10.0 * day), (Scalar(5e9), Scalar(E)))
    shell = _shell("wall", 0.3, axis=(0.0, 0.0, 1.0), mirrored_on=SIDES, ageing=ageing)
    stages = (
        Stage("open", excavate=("core",), release={"core": Scalar(0.2)}, lasts=day),
        Stage("line", build=("lining",), release={"core": Scalar(0.5)}, lasts=10.0 * day),
        Stage("advance", release={"core": Scalar(1.0)}, lasts=day),
    )
    staged = _lined("hex8", 6, 0.3, stages, structures={"lining": shell})
    found = staged.survey(NOTHING, fields=False).shells
    twice = np.cos(2 * np.arctan2(found.centres[:, 1], found.centres[:, 0]))
    young, old = (np.array(_thin_ring(0.3, modulus)) for modulus in (5e9, E))
    for stage, (mean, vary, bent) in ((1, 0.3 * young), (2, 0.3 * young + 0.5 * old)):
        exact = mean + vary * twice
        np.testing.assert_allclose(found.normal[:, 1, stage], exact, atol=0.015 * abs(mean))
        moment = found.moment[:, 1, stage]
        assert moment @ twice / (twice @ twice) == pytest.approx(bent, rel=0.03)


def test_ground_that_yields_squeezes_it_as_convergence_and_confinement_have_it():
    """Mohr-Coulomb, all-round stress: the ring meets the ground's closed reaction curve."""
    cavity = Cavity(pressure=P0, E=E_ROCK, nu=NU_ROCK, radius=RADIUS)
    limit = mohr_limit(c := 0.5e6, phi := float(np.radians(25.0)))
    stages = (
        Stage("open", excavate=("core",), release={"core": Scalar(0.7)}),
        Stage("line", build=("lining",), release={"core": Scalar(1.0)}),
    )
    staged = _lined(
        "hex8", 8, 0.3, stages, reach=20,
        materials={"rock": rock(E_ROCK, NU_ROCK, mohr(c, phi))},
        in_situ=ConstantStress((Scalar(-P0),) * 3 + (ZERO,) * 3),
    )  # fmt: skip
    found = staged.survey(NOTHING, fields=True)
    assert found.yielded is not None
    stiff = E * 0.3 / (1 - NU**2) / RADIUS**2

    def wall(p):
        return float(cavity.closed_form(limit, 1.0 - p / P0).wall_inwards.value)

    built = wall(0.3 * P0)
    pressure = brentq(lambda p: stiff * (wall(p) - built) - p, 0.0, 0.3 * P0)
    np.testing.assert_allclose(-found.shells.normal[:, 1, 1] / RADIUS, pressure, rtol=0.02)


def test_its_weight_is_that_of_its_area_in_plan():
    mesh = box("hex20", (2, 2, 1), size=(2.0, 3.0, 1.0))
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e8, 0.2)},
        groups={"all": "rock"},
        supports=rollers(3),
        gravity=(0.0, 0.0, -10.0),
        structures={"slab": _shell("z1", 0.5, density=Scalar(2400.0))},
        stages=(Stage("build", build=("slab",)),),
    )
    reactions = staged.survey(NOTHING, fields=True).reactions
    assert reactions.force[2, 1, 2] == pytest.approx(2400.0 * 10.0 * 0.5 * 6.0, rel=1e-9)


def _sought(*, age=False):
    names = {"E_lining": 20e9, "t": 0.3, "nu": 0.22, "weight": 7e3, "E_rock": 2e9}
    bounds = {name: (0.2 * start, 3.0 * start) for name, start in names.items()}
    bounds["nu"] = (0.0, 0.4)
    parameters = tuple(Parameter(n, start, *bounds[n]) for n, start in names.items())
    shell = Shell(
        "wall", Scalar(1.0, "E_lining"), Scalar(1.0, "t"), Scalar(1.0, "nu"), (0.0, 0.0, 1.0),
        mirrored_on=SIDES, weight=Scalar(1.0, "weight"),
    )  # fmt: skip
    stages = (
        Stage("open", excavate=("core",), release={"core": Scalar(0.4)}),
        Stage("line", build=("lining",), release={"core": Scalar(0.7)}),
        Stage("more", release={"core": Scalar(1.0)}),
    )
    at = (RADIUS * float(np.cos(0.4)), RADIUS * float(np.sin(0.4)), 0.3)
    channels = [displacement("u", at, (0.6, 0.8, 0.0))]
    for quantity in ("n_22", "n_11", "m_22", "m_11"):
        dimension = "line load" if quantity[0] == "n" else "moment per length"
        channels.append(gauge("load-cell", quantity, at, quantity, structure="lining",
                              dimension=dimension))  # fmt: skip
    channels.append(gauge("tilt", "tilt", at, structure="lining", dimension="angle",
                          reads=Reads.CHANGE, zero="line", direction=(1.0, 0.0, 0.0)))  # fmt: skip
    for fibre in ("inside", "outside"):
        channels.append(gauge("strain", fibre, at, fibre, structure="lining", reads=Reads.VALUE,
                              direction=(-0.3, 0.6, 0.5), towards=(0.0, 0.0, 0.3)))  # fmt: skip
    rock = material("rock", Scalar(1.0, "E_rock"), NU_ROCK)
    staged = _lined(
        "hex8", 3, 0.3, stages, reach=6, parameters=parameters, materials={"rock": rock},
        structures={"lining": shell}, gravity=(0.0, -10.0, 0.0), channels=tuple(channels),
    )  # fmt: skip
    return staged, np.array(list(names.values())), tuple(names)


def test_derivatives_by_all_its_numbers_are_exact():
    staged, p, names = _sought()
    pairs = [(name, "more") for name in ("u", "n_22", "n_11", "m_22", "m_11", "inside", "outside")]
    pairs += [("u", "line"), ("tilt", "more")]
    assert_exact(staged.response(pairs), p, names)


def test_a_strain_across_a_shell_is_refused():
    across = gauge("strain", "across", (RADIUS, 0.0, 0.3), "inside", structure="lining",
                   direction=(1.0, 0.0, 0.0), reads=Reads.VALUE)  # fmt: skip
    with pytest.raises(InputError, match="which has none") as error:
        _lined("hex8", 3, 0.3, OPEN, reach=4, channels=(across,))
    assert [fault.code for fault in error.value.faults] == ["direction-across"]


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"group": "nowhere"}, "missing-group"),
        ({"mirrored_on": ("x0",)}, None),
        ({"mirrored_on": ("outer",)}, "no-symmetry-there"),
        ({"axis": (0.0, 0.0, 1.0)}, "axis-across"),
        ({"weight": Scalar(1e3)}, "no-gravity"),
    ],
)
def test_what_is_wrong_with_a_shell_on_its_mesh(changes, code):
    shell = {"group": "z1", "E": Scalar(E), "thickness": Scalar(0.2), "nu": Scalar(NU),
             "axis": (1.0, 0.0, 0.0)} | changes  # fmt: skip

    def build():
        return model(
            box("hex8", (2, 2, 2)),
            materials={"rock": material("rock", 1e9, 0.2)},
            groups={"all": "rock"},
            supports=rollers(3),
            structures={"it": Shell(**shell)},
            stages=(Stage("build", build=("it",)),),
        )

    if code is None:
        build()
        return
    with pytest.raises(InputError) as error:
        build()
    assert [fault.code for fault in error.value.faults] == [code]
