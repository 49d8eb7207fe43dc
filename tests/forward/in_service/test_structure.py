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
from geoident.model.case import Analysis, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.in_service import (
    DAY,
    YEAR,
    ReservoirFormula,
    Series,
    StructureInService,
)
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
    y = model.motions(np.array(p), np.full(366, row), t).temperature[:, 0]
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


def reservoir(level, **changes):
    """A wall of height 8 m behind water, fixed at its back; what it moves on the average."""
    H, L, n = 8.0, 3.0, 4
    mesh = box("quad8", (3, n), size=(L, H))
    gauss = 0.5 / np.sqrt(3.0)
    heights = [H / n * (j + 0.5 + s) for j in range(n) for s in (-gauss, gauss)]
    gauges = tuple(displacement(f"D{k}", (0.0, y), (1, 0)) for k, y in enumerate(heights))
    acting = StructureInService(0.0, wetted=("x0",), level=level, **changes)
    model = service(
        mesh, material("concrete", 2e9, 0.0), acting,
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
        moved = model.motions(np.zeros(0), rows, np.full(8, day * DAY)).level[:, 0]
        level = np.interp(day * DAY, DAYS, z)
        levels.append(level)
        exact.append(9810.0 * level**2 / 2 * L / (2e9 * H))
        found.append(moved.mean())
        assert found[-1] == pytest.approx(exact[-1], rel=1e-4)
    verification("level-steps", "", levels, exact=exact, found=found)


def test_a_dry_wall_does_not_move():
    model, _, _ = reservoir(series("level", np.where(DAYS < 50 * DAY, -3.0, 4.0)))
    assert model.motions(np.zeros(0), np.arange(8), np.full(8, DAY)).level == pytest.approx(0.0)


def test_levels_are_linear_between_values_and_unknown_in_gaps():
    times = np.array([0.0, 1.0, 2.0, 30.0, 31.0]) * DAY
    model, _, _ = reservoir(series("level", [3.0, 4.0, 5.0, 5.0, 5.0], times))
    t = np.array([1.5, 2.0, 20.0, 30.5]) * DAY
    known = model.motions(np.zeros(0), np.zeros(4, dtype=int), t).level[:, 0]
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
