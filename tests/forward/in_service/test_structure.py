"""A finite element model in service against closed forms: temperature waves and a water level."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import iv, kv
from support.cases import displacement, make_case, material
from support.dam_on_mesh import section
from support.derivatives import assert_slopes
from support.meshes import box

from geoident.errors import InputError
from geoident.fem.solvers import pick_solver
from geoident.forward.in_service.structure import service_model
from geoident.model.actions import Drain, HeadLine, Pressure
from geoident.model.case import Analysis, Stage, Support
from geoident.model.creep import CreepCurve
from geoident.model.ground import Isotropic
from geoident.model.in_service import (
    DAY,
    YEAR,
    ReservoirFormula,
    Series,
    StructureInService,
    TimeCurve,
    Uplift,
)
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar

ALPHA, K, CAPACITY = 1e-5, 2.0, 2400.0 * 900.0
DAYS = np.arange(0.0, 8 * 365.25) * DAY
WAVE = 2.0 * np.pi / YEAR
SWING = 10.0


def series(name, values, times=DAYS, bridge=2 * DAY):
    return Series(name, f"{name}.csv", times, np.asarray(values, dtype=float), bridge)


AIR = series("air", 5.0 + SWING * np.cos(WAVE * DAYS))


def concrete(**changes):
    made = material("concrete", 2e10, 0.2)
    heat = {"expansion": Scalar(ALPHA), "conductivity": Scalar(K)}
    return replace(made, **{**heat, "heat_capacity": Scalar(CAPACITY), **changes})


def service(mesh, made, acting, **changes):
    case = make_case(
        mesh,
        materials={"concrete": made},
        groups=dict.fromkeys(mesh.groups, "concrete"),
        stages=(Stage("in service"),),
        service=acting,
        **changes,
    )
    return service_model(mesh, case, solver=pick_solver("auto"))


def wave_of(model, row=0, p=()):
    """Amplitude and lag, d, of the last year of what a channel reads."""
    t = DAYS[-366:]
    y = model.motions(np.array(p), np.full(366, row), t).parts["temperature"][:, 0]
    columns = np.column_stack([np.ones(366), np.cos(WAVE * t), np.sin(WAVE * t)])
    _, a, b = np.linalg.lstsq(columns, y, rcond=None)[0]
    return np.hypot(a, b), np.arctan2(b, a) / WAVE / DAY


def slab_mean(thickness, film=np.inf):
    """Mean of a slab whose faces swing with the air, by the swing: Stucky & Derron; with a film."""
    q = np.sqrt(1j * WAVE * CAPACITY / K)
    b = q * thickness / 2.0
    return np.tanh(b) / b / (1.0 + K * q / film * np.tanh(b))


@pytest.mark.parametrize("kind", ["quad8", "tri6", "quad4", "tri3"])
@pytest.mark.parametrize("film", [np.inf, 15.0])
def test_periodic_slab(kind, film, verification):
    """The slab cannot widen along its faces, so the wall moves by (1 + nu) / (1 - nu) alpha L T."""
    waves = {thickness: slab_wave(kind, film, thickness) for thickness in (2.0, 6.0, 20.0)}
    for (exact, late), (amplitude, lag) in waves.values():
        tolerance = 2e-3 if kind in ("quad8", "tri6") else 8e-3
        assert amplitude == pytest.approx(exact, rel=tolerance)
        assert lag == pytest.approx(late, abs=0.02 + tolerance * late)
    exact, found = zip(*((own[0], other[0]) for own, other in waves.values()), strict=True)
    name = kind if film == np.inf else f"{kind}, film"
    verification("slab-wave", name, list(waves), exact=exact, found=found)


def slab_wave(kind, film, thickness):
    """Amplitude and lag of the motion of a face: exact, and what the model has."""
    mesh = box(kind, (24, 1), size=(thickness, 1.0))
    acting = StructureInService(
        0.0, in_air=("x0", "x1"), air=AIR, film=None if film == np.inf else Scalar(film)
    )
    held = Support("y0", (1,)), Support("y1", (1,)), Support("x0", (0,))
    gauge = displacement("D", (thickness, 0.5), (1, 0))
    found = wave_of(service(mesh, concrete(), acting, supports=held, channels=(gauge,)))
    mean = slab_mean(thickness, film)
    motion = 1.2 / 0.8 * ALPHA * thickness * SWING * abs(mean)
    return (motion, -np.angle(mean) / WAVE / DAY), found


def test_a_slab_bends_with_the_linear_part_of_its_temperature():
    """A tall slab, warm on one side: its curvature is that of the first moment of the wave."""
    L, low, high = 3.0, 12.0, 18.0
    mesh = box("quad8", (20, 10), size=(L, 30.0))
    acting = StructureInService(0.0, in_air=("x1",), constant=("x0",), air=AIR)
    gauges = tuple(displacement(f"{x}{y}", (x, y), (0, 1)) for y in (low, high) for x in (0.0, L))
    model = service(mesh, concrete(), acting, supports=(Support("y0", (0, 1)),), channels=gauges)
    t = DAYS[-366:]
    parts = [
        model.motions(np.zeros(0), np.full(366, row), t).parts["temperature"][:, 0]
        for row in range(4)
    ]
    turned = (parts[3] - parts[2]) - (parts[1] - parts[0])
    columns = np.column_stack([np.ones(366), np.cos(WAVE * t), np.sin(WAVE * t)])
    _, a, b = np.linalg.lstsq(columns, turned, rcond=None)[0]
    q = np.sqrt(1j * WAVE * CAPACITY / K)
    sinh, cosh = np.sinh(q * L), np.cosh(q * L)
    # first moment of sinh(q x) / sinh(q L) about the middle, by 12 / L^2
    across = 12 / L**2 * (L * cosh / q / sinh - 1 / q**2 - L / 2 * (cosh - 1) / q / sinh)
    exact = 1.2 * ALPHA * SWING * across * (high - low)
    assert np.hypot(a, b) == pytest.approx(abs(exact), rel=3e-3)
    assert np.arctan2(b, a) / WAVE / DAY == pytest.approx(-np.angle(exact) / WAVE / DAY, abs=0.1)


def test_lame_cylinder_with_a_temperature_wave(verification):
    """A long hollow cylinder whose faces swing: Timoshenko & Goodier, section 151, with Bessel."""
    a, b, nu = 3.0, 9.0, 0.2
    mesh = box("quad8", (30, 1), size=(b - a, 1.0))
    mesh = replace(mesh, points=mesh.points + np.array([a, 0.0]))
    acting = StructureInService(0.0, in_air=("x0", "x1"), air=AIR)
    gauges = displacement("in", (a, 0.5), (1, 0)), displacement("out", (b, 0.5), (1, 0))
    model = service(
        mesh, concrete(), acting, analysis=Analysis.AXISYMMETRIC,
        supports=(Support("y0", (1,)), Support("y1", (1,))), channels=gauges,
    )  # fmt: skip
    q = np.sqrt(1j * WAVE * CAPACITY / K)
    shape = np.array([[iv(0, q * r), kv(0, q * r)] for r in (a, b)])
    c = np.linalg.solve(shape, [1.0, 1.0])
    # integrals of T r: of r I0 it is r I1 / q, of r K0 it is -r K1 / q
    whole = sum(
        s * r / q * (c[0] * iv(1, q * r) - c[1] * kv(1, q * r)) for s, r in ((1, b), (-1, a))
    )
    exact, found = [], []
    for row, r in enumerate((a, b)):
        inside = whole if r == b else 0.0
        u = ((1 - 2 * nu) * r**2 + a**2) / (b**2 - a**2) * whole + inside
        u *= ALPHA * (1 + nu) / (1 - nu) / r * SWING
        amplitude, lag = wave_of(model, row)
        assert amplitude == pytest.approx(abs(u), rel=2e-3)
        assert lag == pytest.approx(-np.angle(u) / WAVE / DAY, abs=0.1)
        exact.append(abs(u))
        found.append(amplitude)
    verification("cylinder-wave", "", (a, b), exact=exact, found=found)


def reservoir(level, made=None, **changes):
    """A wall of height 8 m behind water, fixed at its back; what it moves on the average."""
    H, L, n = 8.0, 3.0, 4
    mesh = box("quad8", (3, n), size=(L, H))
    gauss = 0.5 / np.sqrt(3.0)
    heights = [H / n * (j + 0.5 + s) for j in range(n) for s in (-gauss, gauss)]
    gauges = tuple(displacement(f"D{k}", (0.0, y), (1, 0)) for k, y in enumerate(heights))
    acting = StructureInService(0.0, wetted=("x0",), level=level, **changes)
    model = service(
        mesh, made or material("concrete", 2e9, 0.0), acting,
        supports=(Support("x1", (0,)), Support("y0", (1,)), Support("y1", (1,))), channels=gauges,
    )  # fmt: skip
    return model, H, L


def test_water_level_that_steps(verification):
    """The mean motion of the wall is that of the force of the water: gamma z^2 / 2 L / (E H)."""
    z = np.where(DAYS < 100 * DAY, 2.7, np.where(DAYS < 400 * DAY, 6.1, 7.45))
    model, H, L = reservoir(series("level", z))
    levels, exact, found = [], [], []
    for day in (20.0, 250.0, 600.0):
        rows = np.arange(8)
        moved = model.motions(np.zeros(0), rows, np.full(8, day * DAY)).parts["level"][:, 0]
        level = np.interp(day * DAY, DAYS, z)
        levels.append(level)
        exact.append(9810.0 * level**2 / 2 * L / (2e9 * H))
        found.append(moved.mean())
        assert found[-1] == pytest.approx(exact[-1], rel=1e-4)
    verification("level-steps", "", levels, exact=exact, found=found)


YEARS = np.array([0.3, 1.0, 2.5, 7.0]) * YEAR
STEPS = ((0.0, 2.7), (100.0, 6.1), (400.0, 4.3), (900.0, 7.45))
"""Days on which the level takes a new value, m."""


def mean_motion(model, times):
    """Of the wall at some times, what its parts make of it: name to (k,)."""
    rows = np.tile(np.arange(8), len(times))
    parts = model.motions(np.zeros(0), rows, np.repeat(times, 8)).parts
    return {name: part[:, 0].reshape(-1, 8).mean(axis=1) for name, part in parts.items()}


def elastic(z):
    return 9810.0 * z**2 / 2 * 3.0 / (2e9 * 8.0)


def stepped():
    z = np.zeros(len(DAYS))
    for day, level in STEPS:
        z[day * DAY <= DAYS] = level
    return series("level", z)


def loading(times):
    """What has been loaded before each time, and when: rises of the elastic motion, s since."""
    rises = np.diff([0.0, *(elastic(z) for _, z in STEPS)])
    # the level is linear between the day before and the day of a step
    since = times[:, None] - np.array([(day - 0.5) if day else 0.0 for day, _ in STEPS]) * DAY
    return np.where(since > 0.0, rises, 0.0), np.maximum(since, 0.0)


GROWTHS = {
    "exponential": lambda t: 1.0 - np.exp(-t / (1.5 * YEAR)),
    "logarithmic": lambda t: np.log1p(t / (1.5 * YEAR)),
}


@pytest.mark.parametrize("law", GROWTHS)
def test_a_wall_that_creeps_under_a_level_that_steps(law):
    """A Kelvin element, and one of the logarithm, in series with the spring, by superposition."""
    creeps = replace(
        material("concrete", 2e9, 0.0), creep=(CreepCurve(Scalar(0.8), Scalar(1.5 * YEAR), law),)
    )
    model, _, _ = reservoir(stepped(), creeps)
    rises, since = loading(YEARS)
    exact = (0.8 * rises * GROWTHS[law](since)).sum(axis=1)
    assert mean_motion(model, YEARS)["creep"] == pytest.approx(exact, rel=2e-4)


def test_a_wall_whose_modulus_grows_or_falls():
    """What is loaded later meets a larger modulus; one that falls lets all loads strain more."""
    curve = TimeCurve(Scalar(0.4), Scalar(1.5 * YEAR))
    plain = material("concrete", 2e9, 0.0)
    rises, since = loading(YEARS)
    at_loading = 0.4 * GROWTHS["exponential"](YEARS[:, None] - since)
    ages = mean_motion(reservoir(stepped(), replace(plain, ageing=curve))[0], YEARS)
    exact = (rises / (1.0 + at_loading)).sum(axis=1)
    assert ages["level"] + ages["creep"] == pytest.approx(exact, rel=2e-4)
    softens = mean_motion(reservoir(stepped(), replace(plain, softening=curve))[0], YEARS)
    exact = rises.sum(axis=1) / (1.0 - 0.4 * GROWTHS["exponential"](YEARS))
    assert softens["level"] + softens["creep"] == pytest.approx(exact, rel=2e-4)


def test_what_was_loaded_long_ago_creeps_on_slowly():
    """Under the mean level of the readings since it was loaded, and no load of the years before."""
    creeps = replace(
        material("concrete", 2e9, 0.0), creep=(CreepCurve(Scalar(0.8), Scalar(1.5 * YEAR)),)
    )
    model, _, _ = reservoir(series("level", np.full(len(DAYS), 5.0)), creeps, loaded=-2.0 * YEAR)
    exact = 0.8 * elastic(5.0) * GROWTHS["exponential"](YEARS + 2.0 * YEAR)
    assert mean_motion(model, YEARS)["creep"] == pytest.approx(exact, rel=2e-4)


def test_creep_goes_on_while_loads_of_a_past_year_are_taken():
    """As for the extremes of the year to come, of which no level is known yet."""
    creeps = replace(
        material("concrete", 2e9, 0.0), creep=(CreepCurve(Scalar(0.8), Scalar(1.5 * YEAR)),)
    )
    model, _, _ = reservoir(series("level", np.full(800, 5.0), DAYS[:800]), creeps)
    rows, times = np.arange(8), np.full(8, 3.0 * YEAR)
    parts = model.motions(np.zeros(0), rows, times, times - YEAR).parts
    assert parts["level"][:, 0].mean() == pytest.approx(elastic(5.0), rel=1e-4)
    exact = 0.8 * elastic(5.0) * GROWTHS["exponential"](3.0 * YEAR)
    assert parts["creep"][:, 0].mean() == pytest.approx(exact, rel=2e-4)


def test_in_situ_stress_does_not_creep():
    """Rock that was there before any load is at rest."""
    rock = replace(material("rock", 2e9, 0.2), creep=(CreepCurve(Scalar(0.8), Scalar(1.5 * YEAR)),))
    acting = StructureInService(0.0, wetted=("x0",), level=stepped())
    held = Support("x1", (0,)), Support("y0", (1,))
    gauge = displacement("D", (0.0, 6.0), (1, 0))
    crept = [
        service(
            box("quad8", (3, 4), size=(3.0, 8.0)), rock, acting, supports=held, channels=(gauge,),
            in_situ=stress,
        ).motions(np.zeros(0), np.zeros(4, dtype=int), YEARS).parts["creep"]
        for stress in (None, HeimStress(K0=Scalar(1.3), vertical=Scalar(6e6)))
    ]  # fmt: skip
    assert np.abs(crept[0]).max() > 1e-5
    assert crept[1] == pytest.approx(crept[0], rel=1e-6)


def test_a_dry_wall_does_not_move():
    model, _, _ = reservoir(series("level", np.where(DAYS < 50 * DAY, -3.0, 4.0)))
    assert model.motions(np.zeros(0), np.arange(8), np.full(8, DAY)).parts[
        "level"
    ] == pytest.approx(0.0)


def test_levels_are_linear_between_values_and_unknown_in_gaps():
    times = np.array([0.0, 1.0, 2.0, 30.0, 31.0]) * DAY
    model, _, _ = reservoir(series("level", [3.0, 4.0, 5.0, 5.0, 5.0], times))
    t = np.array([1.5, 2.0, 20.0, 30.5]) * DAY
    known = model.motions(np.zeros(0), np.zeros(4, dtype=int), t).parts["level"][:, 0]
    assert np.isnan(known).tolist() == [False, False, True, False]


def test_zhu_reservoir():
    """Bofang Zhu as another program has it, KRATOS DamApplication: months, warmest air at 6.5."""
    water = ReservoirFormula(45.0, 14.0, 8.0, 9.0, 6.5 / 12.0 * YEAR)
    months = np.array([1.0, 4.0, 7.0, 10.0])
    told = {
        0.0: [5.1468894, 12.370814, 22.849506, 15.648767],
        5.0: [5.1745478, 9.3615792, 20.212072, 16.049049],
        10.0: [5.3028418, 7.5640835, 17.948549, 15.710285],
    }
    for depth, values in told.items():
        at = water.at(months / 12.0 * YEAR, np.array([depth]))[:, 0]
        assert at == pytest.approx(values, abs=0.04)  # it takes 0.52323 for 2 pi / 12


def seepage(start, end, at, tail=None, left=None):
    """The level falls from one point to another in the plane, with a drain at some distance."""
    start, end = np.array(start), np.array(end)
    place = start + (end - start) * at / np.linalg.norm(end - start)
    drain = Drain(tuple(place), Scalar(left) if left is not None else Scalar(1.0, "left"))
    level = Scalar(tail) if tail is not None else Scalar(1.0, "tail")
    return HeadLine(tuple(start), tuple(end), level, drain)


def mean_head(z, length, at, tail, left):
    """Of a level that falls from z to that of the drain and to that of the tail, by trapezia."""
    drain = tail + left * (z - tail)
    return ((z + drain) * at + (drain + tail) * (length - at)) / (2.0 * length)


def test_uplift_in_the_pores_of_an_elastic_base():
    """A dry block on wet ground that cannot widen: its stress is the mean pressure of the water.

    So it rises by the integral of gamma (mean head - y) / E over the ground, y from below.
    """
    L, H, n, E = 10.0, 4.0, 5, 1.5e9
    mesh = box("quad8", (n, 7), size=(L, 7.0))
    middle = mesh.points[mesh.blocks[0].nodes].mean(axis=1)[:, 1]
    rows = {"ground": np.flatnonzero(middle < H), "block": np.flatnonzero(middle > H)}
    mesh = replace(mesh, groups=rows)
    gauss = 0.5 / np.sqrt(3.0)
    places = [L / n * (j + 0.5 + s) for j in range(n) for s in (-gauss, gauss)]
    z = np.where(DAYS < 200 * DAY, 4.5, 6.6)
    plain = {name: material(name, E, 0.0) for name in rows}
    acting = StructureInService(
        0.0, wetted=("x0",), level=series("level", z),
        uplift=(Uplift(seepage((0.0, H), (L, H), 2.0, tail=4.2, left=0.3), pores=("ground",)),),
    )  # fmt: skip
    case = make_case(
        mesh, materials=plain, groups={name: name for name in rows}, service=acting,
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (1,))),
        stages=(Stage("in service"),),
        channels=(
            *(displacement(f"D{k}", (x, 7.0), (0, 1)) for k, x in enumerate(places)),
            replace(displacement("PZ", (5.0, 1.0), (0, 0)), kind="piezometer", accuracy=100.0),
        ),
    )  # fmt: skip
    model = service_model(mesh, case, solver=pick_solver("auto"))
    for day, level in ((100.0, 4.5), (300.0, 6.6)):
        moved = model.motions(np.zeros(0), np.arange(2 * n), np.full(2 * n, day * DAY)).total
        rise = 9810.0 * (mean_head(level, L, 2.0, 4.2, 0.3) * H - H**2 / 2) / E
        assert moved[:, 0].mean() == pytest.approx(rise, rel=1e-4)
        water = model.motions(np.zeros(0), np.array([2 * n]), np.array([day * DAY])).total[0, 0]
        head = 4.2 + 0.3 * 5.0 / 8.0 * (level - 4.2)  # what the drain leaves, on the way to the end
        assert water == pytest.approx(9810.0 * (head - 1.0), rel=1e-4)


def test_uplift_on_a_face():
    """It pushes the wall with the mean of gamma (head - y)."""
    uplift = Uplift(seepage((3.0, 0.0), (3.0, 8.0), 2.0, tail=9.0, left=0.3), on=("x1",))
    H, L, n = 8.0, 3.0, 4
    mesh = box("quad8", (3, n), size=(L, H))
    gauss = 0.5 / np.sqrt(3.0)
    heights = [H / n * (j + 0.5 + s) for j in range(n) for s in (-gauss, gauss)]
    gauges = tuple(displacement(f"D{k}", (L, y), (1, 0)) for k, y in enumerate(heights))
    level = series("level", np.full(len(DAYS), 7.3))
    model = service(
        mesh, material("concrete", 2e9, 0.0),
        StructureInService(0.0, wetted=("x0",), level=level, uplift=(uplift,)),
        supports=(Support("x0", (0,)), Support("y0", (1,)), Support("y1", (1,))), channels=gauges,
    )  # fmt: skip
    moved = model.motions(np.zeros(0), np.arange(8), np.full(8, 300.0 * DAY)).total[:, 0].mean()
    pressure = 9810.0 * (mean_head(7.3, H, 2.0, 9.0, 0.3) - H / 2)
    assert moved == pytest.approx(-pressure * L / 2e9, rel=1e-4)


NAMES = ("E_dam", "E_rock", "nu", "alpha", "k", "c", "film", "ratio")
P = np.array([22e9, 30e9, 0.21, 1e-5, 2.3, 2.1e6, 18.0, 1.05])


def weathered(**changes):
    """A dam on its rock in plane strain, with all kinds of parameters."""
    rng = np.random.default_rng(5)
    days = np.arange(0.0, 2.4 * 365.25) * DAY
    noise = np.convolve(rng.standard_normal(len(days)), np.ones(5) / 2, "same")
    air = series("air", 9 - 9 * np.cos(WAVE * (days - 20 * DAY)) + noise, days)
    level = series("level", 35 + 15 * np.sin(WAVE * days) + noise, days)
    acting = StructureInService(
        0.0, ("upstream", "floor"), ("downstream", "crest", "ground"), ("bottom",),
        Scalar(1.0, "film"), level, air, ReservoirFormula(55.0, 11.0, 6.0, 8.0, 0.55 * YEAR),
    )  # fmt: skip
    dam = concrete(
        elastic=Isotropic(E=Scalar(1.0, "E_dam"), nu=Scalar(1.0, "nu")),
        expansion=Scalar(1.0, "alpha"), conductivity=Scalar(1.0, "k"),
        heat_capacity=Scalar(1.0, "c"),
    )  # fmt: skip
    rock = replace(
        material("rock", Scalar(1.0, "E_rock"), 0.25),
        expansion=Scalar(0.8, "alpha"), conductivity=Scalar(1.3, "k"),
        specific_heat=Scalar(850.0), density=Scalar(2700.0),
    )  # fmt: skip
    gauges = (
        displacement("P", (2.0, 55.0), (1, 0)),
        replace(displacement("Q", (20.0, 30.0), (0.6, 0.8)), ratio=Scalar(1.0, "ratio")),
        displacement("R", (10.0, -20.0), (0, 1)),
    )
    mesh = section()
    case = make_case(
        mesh, materials={"dam": dam, "rock": rock}, groups={"dam": None, "rock": "rock"},
        stages=(Stage("in service", install={"dam": "dam"}),), channels=gauges, service=acting,
        supports=(Support("bottom", (0, 1)), Support("sides", (0,))),
        parameters=tuple(
            Parameter(n, float(v), 0.2 * v, 5 * v) for n, v in zip(NAMES, P, strict=True)
        ),
        **changes,
    )  # fmt: skip
    return service_model(mesh, case, solver=pick_solver("auto")), days


def test_derivatives_are_exact():
    model, days = weathered()
    at = days[40::45]
    rows, times = np.repeat(np.arange(3), len(at)), np.tile(at + 0.3 * DAY, 3)

    def total(p):
        return model.motions(p, rows, times).total[:, 0]

    motions = model.motions(P, rows, times)
    assert all(np.abs(motions.total[:, 1 + h]).max() > 0 for h in range(len(NAMES)))
    assert_slopes(total, P, motions.total[:, 1:], NAMES, step=2e-3, rtol=3e-7)


LATE = {
    "E_dam": 22e9, "E_rock": 30e9, "nu": 0.21, "phi": 0.8, "tau": 0.7 * YEAR, "grown": 0.25,
    "lost": 0.1, "tail": 5.0, "left": 0.4,
}  # fmt: skip


def test_derivatives_by_creep_ageing_softening_and_drains_are_exact():
    """Of a dam with its weight on wet rock, by what they depend on and by the moduli."""
    days = np.arange(0.0, 500.0) * DAY
    level = series("level", 35 + 15 * np.sin(WAVE * days), days)
    acting = StructureInService(
        60.0 * DAY, ("upstream", "floor"), level=level,
        uplift=(Uplift(seepage((0.0, 0.0), (46.0, 0.0), 6.0), pores=("rock",)),),
    )  # fmt: skip
    dam = replace(
        material("dam", Scalar(1.0, "E_dam"), Scalar(1.0, "nu")), density=Scalar(2400.0),
        creep=(CreepCurve(Scalar(1.0, "phi"), Scalar(1.0, "tau")),),
        ageing=TimeCurve(Scalar(1.0, "grown"), Scalar(2.0, "tau")),
    )  # fmt: skip
    rock = replace(
        material("rock", Scalar(1.0, "E_rock"), 0.25),
        softening=TimeCurve(Scalar(1.0, "lost"), Scalar(0.8, "tau"), "logarithmic"),
    )
    mesh, p = section(), np.array([*LATE.values()])
    case = make_case(
        mesh, materials={"dam": dam, "rock": rock}, groups={"dam": None, "rock": "rock"},
        stages=(Stage("in service", install={"dam": "dam"}),), service=acting,
        gravity=(0.0, -9.81),
        supports=(Support("bottom", (0, 1)), Support("sides", (0,))),
        channels=tuple(displacement(n, (2.0, y), (1, 0)) for n, y in (("P", 55.0), ("Q", -9.0))),
        parameters=tuple(Parameter(n, v, 0.2 * v, 5 * v) for n, v in LATE.items()),
    )  # fmt: skip
    model = service_model(mesh, case, solver=pick_solver("auto"))
    at = np.arange(70.0, 480.0, 29.0) * DAY + 0.3 * DAY
    rows, times = np.repeat(np.arange(2), len(at)), np.tile(at, 2)
    motions = model.motions(p, rows, times)
    assert all(np.abs(motions.total[:, 1 + h]).max() > 0 for h in range(len(LATE)))
    assert_slopes(
        lambda q: model.motions(q, rows, times).total[:, 0], p, motions.total[:, 1:], tuple(LATE),
        step=2e-3, rtol=3e-7,
    )  # fmt: skip


def test_an_evaluation_factorizes_once_whatever_the_number_of_days():
    model, days = weathered()
    rows = np.zeros(len(days) - 1, dtype=int)
    model.motions(P, rows, days[:-1])
    before = model.counts
    model.motions(1.01 * P, rows, days[:-1])
    model.motions(1.01 * P, rows, days[:-1] + 0.5 * DAY)
    spent = model.counts.since(before)
    assert spent.factorizations == 1
    assert spent.evaluations == 1


def test_fields_of_few_days_hold_all_days():
    """The same at other parameters than those at which the temperature fields were made."""
    other = P * [1.2, 0.8, 1.0, 1.3, 1.6, 0.8, 0.7, 1.0]
    model, days = weathered()
    rows, times = np.repeat(np.arange(3), 60), np.tile(days[30:810:13], 3)
    made = model.motions(other, rows, times).total[:, 0]
    moved = tuple(
        replace(q, start=float(v)) for q, v in zip(model.case.parameters, other, strict=True)
    )
    case = replace(model.case, parameters=moved)
    again = service_model(model.mesh, case, solver=pick_solver("auto"))
    expected = again.motions(other, rows, times).total[:, 0]
    for one, two in zip(made.reshape(3, 60), expected.reshape(3, 60), strict=True):
        assert np.ptp(one - two) < 4e-3 * np.ptp(two)


def two_rings(inner, outer, pressure, radii, nu):
    """Radial motions of two bonded rings in plane strain at their three radii, by Lame."""
    a, b, c = radii

    def stress(E, r):
        return [E / ((1 + nu) * (1 - 2 * nu)), -E / ((1 + nu) * r**2)]

    rows = [
        [*stress(inner, a), 0, 0],
        [b, 1 / b, -b, -1 / b],
        [*stress(inner, b), *(-x for x in stress(outer, b))],
        [0, 0, *stress(outer, c)],
    ]
    one, two, three, four = np.linalg.solve(rows, [-pressure, 0, 0, 0])
    return np.array([one * a + two / a, one * b + two / b, three * c + four / c])


@pytest.mark.parametrize("kind", ["creep", "softening"])
def test_a_lining_that_creeps_in_an_elastic_ring(kind):
    """To the first order in the growth: the slope of Lame's solution by the lining's compliance."""
    radii, nu, pressure = (3.0, 4.0, 9.0), 0.2, 2e6
    mesh = box("quad8", (12, 1), size=(6.0, 1.0))
    mesh = replace(mesh, points=mesh.points + np.array([3.0, 0.0]))
    middle = mesh.points[mesh.blocks[0].nodes].mean(axis=1)[:, 0]
    groups = {"lining": np.flatnonzero(middle < 4.0), "ring": np.flatnonzero(middle > 4.0)}
    mesh = replace(mesh, groups=groups)
    curve = TimeCurve(Scalar(0.05), Scalar(YEAR))
    if kind == "creep":
        curve = (CreepCurve(Scalar(0.05), Scalar(YEAR)),)
    plain = replace(concrete(), elastic=Isotropic(E=Scalar(3e10), nu=Scalar(nu)))
    case = make_case(
        mesh, analysis=Analysis.AXISYMMETRIC,
        materials={"lining": replace(plain, **{kind: curve}), "ring": concrete()},
        groups={"lining": None, "ring": "ring"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        stages=(
            Stage("lined", install={"lining": "lining"}),
            Stage("filled", loads={"water": Pressure("x0", Scalar(pressure))}),
        ),
        channels=tuple(displacement(f"r{r:g}", (r, 0.5), (1, 0)) for r in radii),
        service=StructureInService(0.0, in_air=("x1",), air=AIR),
    )  # fmt: skip
    model = service_model(mesh, case, solver=pick_solver("auto"))
    t, E, step = 1.7 * YEAR, 3e10, 1e-4
    crept = model.motions(np.zeros(0), np.arange(3), np.full(3, t)).parts["creep"][:, 0]
    softer, stiffer = (two_rings(E / (1 + x), 2e10, pressure, radii, nu) for x in (step, -step))
    grown = 0.05 * (1.0 - np.exp(-1.7))
    grown = grown / (1.0 - grown) if kind == "softening" else grown
    assert crept == pytest.approx((softer - stiffer) / (2 * step) * grown, rel=2e-3)


def test_what_does_not_fit_is_named_all_at_once():
    bare = replace(concrete(), conductivity=None)
    level = series("level", np.full(len(DAYS), 75.0))
    acting = StructureInService(0.0, ("upstream",), ("downstreem",), (), None, level, AIR, AIR)
    held = Support("bottom", (0, 1))
    gauge = displacement("P", (2.0, 55.0), (1, 0))
    with pytest.raises(InputError) as refused:
        service(section(), bare, acting, supports=(held,), channels=(gauge,))
    messages = [fault.message for fault in refused.value.faults]
    assert any("has no group of edges 'downstreem'" in m for m in messages)
    assert any("how 'concrete' conducts heat is not known" in m for m in messages)


def test_a_level_above_the_crest_is_refused_with_its_date():
    z = np.where((DAYS > 39.5 * DAY) & (DAYS < 40.5 * DAY), 8.4, 5.0)
    with pytest.raises(InputError, match=r"1970-02-10 is 8\.4 m, above the top"):
        reservoir(series("level", z))
