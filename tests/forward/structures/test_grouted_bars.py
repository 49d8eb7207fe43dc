"""Grouted bolts and piles against closed forms in rigid ground; exact derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import cosh, sinh, sqrt, tanh

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from geoident.errors import CollapseError, InputError
from geoident.forward.structures.grouted import PlacedBars
from geoident.model.actions import HeadForce, Traction
from geoident.model.case import Analysis, Stage, Support
from geoident.model.gauges import Channel, Reads
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import GroutedBars, Piles
from tests.forward.structures.test_interfaces import on_level
from tests.support.cases import displacement, material, model, rollers
from tests.support.derivatives import assert_exact, assert_slopes
from tests.support.meshes import box, from_grid

NOTHING, ZERO = np.empty(0), Scalar(0.0)
EA, K, BOND, L = 1e8, 2e9, 1e5, 3.0
LAMBDA = sqrt(K / EA)
RIGID = material("rock", 1e15, 0.2)


def gauge(name, kind, bars, at=0.0, *, bar=0, **changes):
    """A gauge at a distance from the head of a bar; motions count into the ground."""
    head, toe = np.array(bars.ends[bar])
    along = (toe - head) / np.linalg.norm(toe - head)
    moves = kind == "bar-displacement"
    zero = "built" if moves else "virgin"
    settings = {
        "dimension": "length" if moves else {"strain": "strain"}.get(kind, "force"),
        "reads": Reads.CHANGE if moves else Reads.VALUE,
        "quantity": "" if kind != "load-cell" else "N",
        "structure": "bar",
        "member": bar,
    } | changes
    return Channel(
        name, name, kind, None, tuple(head + at * along), tuple(along), 1e-5, zero,
        ("gauges", name), **settings,
    )  # fmt: skip


def bars(dim=2, *, inclined=False, kind=GroutedBars, **changes):
    """A bar of the length L in a box of 4 m; downwards, or along a diagonal of it."""
    along = np.ones(dim) / sqrt(dim) if inclined else -np.eye(dim)[-1]
    head = np.full(dim, 0.9) if inclined else np.array([1.7] * (dim - 1) + [3.5])
    settings = {"EA": Scalar(EA), "k_grout": Scalar(K), "head": "free"} | changes
    spacing = settings.pop("spacing", Scalar(1.3) if dim == 2 else None)
    return kind(((tuple(head), tuple(head + L * along)),), spacing, **settings)


def held(mesh, structure, stages, **changes):
    """A box whose sides are all held."""
    dim = mesh.dim
    fixed = tuple(Support(f"{a}{s}", tuple(range(dim))) for a in "xyz"[:dim] for s in (0, 1))
    settings = {
        "materials": {"rock": RIGID},
        "groups": {"all": "rock"},
        "supports": fixed,
        "structures": {"bar": structure},
        "stages": (Stage("built", build=("bar",)), *stages),
    }
    return model(mesh, **{**settings, **changes})


def forces(*pulls):
    """A stage for each force on the head, out of the ground."""
    return tuple(
        Stage(f"pull {n}", loads={"pull": HeadForce("bar", Scalar(pull))})
        for n, pull in enumerate(pulls, start=1)
    )


def read(structure, *pulls, kind="quad8", at=(0.0,), what="bar-displacement", **changes):
    """Readings (gauge, stage) at distances from the head."""
    dim = 3 if kind.startswith(("hex", "tet")) else 2
    channels = tuple(gauge(f"g{n}", what, structure, x) for n, x in enumerate(at))
    mesh = box(kind, (2,) * dim, size=(4.0,) * dim)
    staged = held(mesh, structure, forces(*pulls), channels=channels, **changes)
    response = staged.response(
        [(c.name, f"pull {n + 1}") for c in channels for n in range(len(pulls))]
    )
    return response.readings(NOTHING).reshape(len(at), len(pulls))


# --- bolts -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "inclined"), [("quad8", False), ("tri3", True), ("hex8", True)])
def test_an_elastic_bolt_that_is_pulled(kind, inclined):
    """u = F / (EA lambda) coth(lambda L), N = F sinh(lambda (L - x)) / sinh(lambda L)."""
    F, bolt = 1e5, bars(3 if kind == "hex8" else 2, inclined=inclined, pieces=80)
    (head, deep) = read(bolt, F, kind=kind, at=(0.0, 1.0))[:, 0]
    u = F / (EA * LAMBDA)
    assert -head == pytest.approx(u / tanh(LAMBDA * L), rel=1e-5)
    assert -deep == pytest.approx(u * cosh(LAMBDA * (L - 1)) / sinh(LAMBDA * L), rel=0.02)
    expected = [F * sinh(LAMBDA * (L - x)) / sinh(LAMBDA * L) for x in (0.0, 0.3, 1.0)]
    N = read(bolt, F, kind=kind, at=(0.0, 0.3, 1.0), what="load-cell")[:, 0]
    np.testing.assert_allclose(N, expected, rtol=0.02)
    strain = read(bolt, F, kind=kind, at=(0.3,), what="strain")
    assert strain[0, 0] == pytest.approx(N[1] / EA, rel=1e-12)


def test_the_force_of_a_bolt_converges_with_the_square_of_its_pieces():
    exact = 1e5 * sinh(LAMBDA * (L - 1)) / sinh(LAMBDA * L)
    errors = [
        abs(read(bars(pieces=n), 1e5, at=(1.0,), what="load-cell")[0, 0] - exact)
        for n in (24, 48, 96)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.15)


def slipped(a):
    """Pull and motion of the head where a bolt has slipped along a length a from its head.

    Elastic, ideally plastic bond (Farmer 1975; Li and Stillborg 1999): behind the front the bolt is
    elastic with the slip bond / k_grout at it.
    """
    behind = EA * LAMBDA * BOND / K * tanh(LAMBDA * (L - a))
    return BOND * a + behind, BOND / K + behind * a / EA + BOND * a * a / (2 * EA)


def test_a_bolt_slips_from_its_head_on_and_is_elastic_again(verification):
    """Loaded in three steps to two fronts of slip, and let go."""
    fronts, n = (0.6, 1.8), 150
    pulls, motions = zip(*(slipped(a) for a in fronts), strict=True)
    u = -read(bars(bond=Scalar(BOND), pieces=n), *pulls, 0.8 * pulls[1])[0]
    np.testing.assert_allclose(u[:2], motions, rtol=2e-3)
    verification("bolt", "pulled", [f"{p / 1e3:.0f}" for p in pulls], exact=motions, found=u[:2])
    back = 0.2 * pulls[1] / (EA * LAMBDA) / tanh(LAMBDA * L)  # without slip backwards
    assert u[1] - u[2] == pytest.approx(back, rel=2e-3)


def test_the_most_that_a_bolt_bears_is_bond_times_length():
    bolt = bars(bond=Scalar(BOND), pieces=6)
    read(bolt, 0.999 * BOND * L)
    with pytest.raises(CollapseError, match="'bar' cannot carry the loads") as error:
        read(bolt, 1.001 * BOND * L)
    assert error.value.fraction == pytest.approx(1 / 1.001, rel=1e-6)


def test_steel_that_yields_before_the_bond_is_used_up():
    bolt = bars(bond=Scalar(BOND), capacity=Scalar(1.5e5), pieces=60)
    more = BOND * L / 60 / 2  # the grout of half a piece before the first middle
    assert -read(bolt, 1.49e5 + more)[0, 0] > 0.0
    with pytest.raises(CollapseError):
        read(bolt, 1.51e5 + more)


def test_a_stressed_bolt_is_stretched_from_plate_to_grout_and_locked_off():
    """The jack's force is that of the free length; the grout slips below it as in a pull-out."""
    P = 1.2e5
    bolt = bars(free=0.8, head="joined", bond=Scalar(BOND), pieces=110)
    cells = [gauge(f"c{n}", "load-cell", bolt, x) for n, x in enumerate((0.4, 0.8))]
    moves = gauge("u", "bar-displacement", bolt, 0.8, quantity="slip")
    staged = held(
        box("quad8", (3, 3), size=(4.0, 4.0)),
        bolt,
        (Stage("jack", prestress={"bar": Scalar(P)}), Stage("locked")),
        channels=(*cells, moves),
    )
    N, below, u = staged.computed(NOTHING)[:, 1:]
    np.testing.assert_allclose([N, below], P, rtol=1e-6)
    survey = staged.survey(NOTHING, fields=False).members
    free = survey.structures.index("bar (free length)")
    assert survey.axial[free, 1:] == pytest.approx(P)
    assert survey.prestress[free, 1] == P
    half = BOND / K * EA * LAMBDA  # of an infinitely long bolt at the front of slip
    front = (P - half * tanh(LAMBDA * 1.8)) / BOND
    expected = BOND / K + half * front / EA + BOND * front**2 / (2 * EA)
    np.testing.assert_allclose(-u, expected, rtol=0.01)


def test_a_bolt_holds_a_joint_together():
    """Stiff blocks drift apart by d: on each side N = EA lambda d / 2 tanh(lambda l)."""
    bolt = GroutedBars(
        (((0.55, 2.6), (0.55, 0.6)),), Scalar(1.0), EA=Scalar(EA), k_grout=Scalar(K),
        head="free", pieces=80,
    )  # fmt: skip
    pull, k_n, half = 1e5, 1e6, 1.0
    mesh = on_level(box("quad8", (2, 4), size=(1.0, 3.2)), 1.6)
    cell = gauge("N", "load-cell", bolt, 1.0)
    staged = model(
        mesh,
        materials={"rock": RIGID},
        groups={"rock": "rock", "low": "rock"},
        supports=(Support("y0", (0, 1)), Support("x0", (0,)), Support("x1", (0,))),
        interfaces={"joint": Interface("joint", Scalar(k_n), Scalar(k_n))},
        structures={"bar": bolt},
        stages=(
            Stage("built", build=("bar",)),
            Stage("pull", loads={"p": Traction("y1", (ZERO, Scalar(pull)))}),
        ),
        channels=(cell,),
    )
    stiffness = EA * LAMBDA / 2 * tanh(LAMBDA * half)
    expected = pull * stiffness / (stiffness + k_n)
    rotates = staged.computed(NOTHING)[0, -1]
    assert rotates == pytest.approx(expected, rel=2e-3)


def test_an_inclined_bolt_holds_a_joint_that_shears():
    """N = K s sin b of a slip s, b from the normal of the joint: T = k_s s + N sin b."""
    angle, half, shear, k_s = np.radians(40.0), 1.0, 1e5, 1e6
    along = np.array([-np.sin(angle), -np.cos(angle)])
    middle = np.array([1.0, 1.6])
    bolt = GroutedBars(
        ((tuple(middle - half * along), tuple(middle + half * along)),), Scalar(1.0),
        EA=Scalar(EA), k_grout=Scalar(K), head="free", pieces=80,
    )  # fmt: skip
    staged = model(
        on_level(box("quad8", (2, 4), size=(2.0, 3.2)), 1.6),
        materials={"rock": RIGID},
        groups={"rock": "rock", "low": "rock"},
        supports=(Support("y0", (0, 1)), Support("y1", (1,))),
        interfaces={"joint": Interface("joint", Scalar(1e9), Scalar(k_s))},
        structures={"bar": bolt},
        stages=(
            Stage("built", build=("bar",)),
            Stage("shear", loads={"p": Traction("y1", (Scalar(shear), ZERO))}),
        ),
        channels=(gauge("N", "load-cell", bolt, half),),
    )
    stiffness = EA * LAMBDA / 2 * tanh(LAMBDA * half) * np.sin(angle)
    slip = 2.0 * shear / (2.0 * k_s + stiffness * np.sin(angle))
    assert staged.computed(NOTHING)[0, -1] == pytest.approx(stiffness * slip, rel=2e-3)


def test_a_tunnel_with_bolts_all_round_in_elastic_ground(verification):
    """The two equations of ground and bolts along the radius, by scipy's collocation.

    (E_oed) (u'' + u'/r - u/r^2) + n q / (2 pi r t) = 0, EA w'' = q = k (w - u), n bolts in a slice
    of t; plates at the wall of radius a, from which a pressure p is released.
    """
    a, deep, far, t, n, p = 3.0, 4.0, 40.0, 0.25, 24, 2e6
    E_ground, nu, k = 2e9, 0.25, 4e8
    lame, G = E_ground * nu / ((1 + nu) * (1 - 2 * nu)), E_ground / (2 * (1 + nu))
    oed, end = lame + 2 * G, a + deep

    def slopes(r, y):
        u, du, w, dw = y
        q = k * (w - u)
        return np.array([du, -du / r + u / r**2 - n * q / (2 * np.pi * r * t * oed), dw, q / EA])

    def held(at_wall, at_toe):
        u, du, w, dw = at_wall
        plate = n * EA * dw / (2 * np.pi * a * t)
        ratio = (-1 / end**2 - 1 / far**2) / (1 / end - end / far**2)
        return np.array([
            (oed * du + lame * u / a + plate) / p - 1.0, w - u, at_toe[3],
            at_toe[1] - ratio * at_toe[0],
        ])  # fmt: skip

    r = np.linspace(a, end, 81)
    solution = solve_bvp(slopes, held, r, np.zeros((4, len(r))), tol=1e-8, max_nodes=20000)
    assert solution.success
    bolt = GroutedBars(
        (((a, t / 2), (end, t / 2)),), number=Scalar(float(n)), EA=Scalar(EA), k_grout=Scalar(k)
    )
    radii = np.concatenate([np.linspace(a, end, 60), np.geomspace(end, far, 40)[1:]])
    grid = np.stack(np.meshgrid(radii, [0.0, t], indexing="ij"), -1).reshape(-1, 2)
    places = (0.5, 1.5, 2.5, 3.5)
    staged = model(
        from_grid("quad4", grid, (len(radii) - 1, 1)),
        analysis=Analysis.AXISYMMETRIC,
        materials={"rock": material("rock", E_ground, nu)},
        groups={"all": "rock"},
        supports=(Support("x1", (0,)), Support("y0", (1,)), Support("y1", (1,))),
        structures={"bar": bolt},
        stages=(
            Stage("built", build=("bar",)),
            Stage("open", loads={"p": Traction("x0", (Scalar(-p), ZERO))}),
        ),
        channels=(
            *(gauge(f"N{x}", "load-cell", bolt, x) for x in places),
            gauge("head", "bar-displacement", bolt),
            gauge("slip", "bar-displacement", bolt, quantity="slip"),
        ),
    )
    *forces, head, slip = staged.computed(NOTHING)[:, -1]
    exact = EA * solution.sol(a + np.array(places))[3]
    np.testing.assert_allclose(forces, exact, rtol=5e-3)
    wall = -solution.sol(a)[0]
    assert -head == pytest.approx(wall, rel=2e-3)  # a plate moves with the wall
    assert abs(slip) < 1e-12
    verification("bolted-tunnel", "N", [f"{x:g}" for x in places], exact=exact, found=forces)


def test_bars_that_never_slip_go_with_the_ground():
    """Very stiff grout in ground that stretches by itself: N = EA eps, less near the ends."""
    bolt = bars(k_grout=Scalar(1e12), head="joined", pieces=100)
    staged = model(
        box("quad8", (3, 3), size=(4.0, 4.0)),
        materials={"rock": material("rock", 1e12, 0.0)},
        groups={"all": "rock"},
        supports=rollers(2),
        structures={"bar": bolt},
        stages=(
            Stage("built", build=("bar",)),
            Stage("pull", loads={"p": Traction("y1", (ZERO, Scalar(1e6)))}),
        ),
        channels=(gauge("N", "load-cell", bolt, 1.5),),
    )
    assert staged.computed(NOTHING)[0, -1] == pytest.approx(EA * 1e6 / 1e12, rel=1e-3)


# --- piles -------------------------------------------------------------------------------------


def settled(F, k_base):
    """Settlement of the head of an elastic pile on a spring: as of a bar on elastic foundation."""
    ratio = k_base / (EA * LAMBDA)
    t = tanh(LAMBDA * L)
    return F / (EA * LAMBDA) * (1 + ratio * t) / (t + ratio)


@pytest.mark.parametrize("axis", [False, True])
def test_shaft_and_toe_of_a_pile(axis):
    """Also on the axis of a body of revolution, where one pile stands."""
    k_base = 0.8 * EA * LAMBDA
    pile = bars(kind=Piles, k_base=Scalar(k_base), pieces=80)
    changes = {}
    if axis:
        pile = replace(pile, ends=(((0.0, 3.5), (0.0, 0.5)),), spacing=None, number=Scalar(1.0))
        changes["analysis"] = Analysis.AXISYMMETRIC
    F = -2e5
    u = read(pile, F, -F, **changes)[0]
    assert u[0] == pytest.approx(settled(2e5, k_base), rel=1e-3)
    # pulled it has no toe
    assert -u[1] == pytest.approx(2e5 / (EA * LAMBDA) / tanh(LAMBDA * L), rel=1e-3)


def test_the_most_that_a_pile_bears():
    pile = bars(
        kind=Piles, k_base=Scalar(1e8), base_capacity=Scalar(1.5e5), bond=Scalar(BOND), pieces=4
    )
    most = BOND * L + 1.5e5
    staged = held(box("quad8", (1, 1), size=(4.0, 4.0)), pile, forces(-0.999 * most))
    members = staged.survey(NOTHING, fields=False).members
    toe = members.structures.index("bar (toe)")
    assert members.axial[toe, -1] == pytest.approx(-(0.999 * most - BOND * L), rel=1e-6)
    assert members.grout[0, -1] == pytest.approx(BOND, rel=1e-9)
    with pytest.raises(CollapseError) as error:
        read(pile, -1.001 * most)
    assert error.value.fraction == pytest.approx(1 / 1.001, rel=1e-5)


def test_the_shaft_of_a_pile_goes_with_the_mean_motion_around_it():
    """Of u_z = x^2 that is x^2 + R^2 / 2 of an upright pile, also of half of one at an edge."""
    R = 0.5
    for x in (1.7, 0.0):
        pile = bars(3, kind=Piles, diameter=Scalar(2 * R))
        pile = replace(pile, ends=(((x, 1.7, 3.5), (x, 1.7, 0.5)),))
        staged = held(box("hex20", (8, 1, 1), size=(4.0,) * 3), pile, ())
        on_mesh = staged.on_mesh
        placed = PlacedBars(on_mesh, "bar", pile, np.ones(8, dtype=bool))
        site = placed.holding(0, np.array([x, 1.7, 2.0]), around=True)
        u = np.zeros(on_mesh.mesh.points.shape)
        u[:, 2] = -(on_mesh.mesh.points[:, 0] ** 2)
        mean = placed.rows.ground([site], np.array([0])) @ u.ravel()
        assert mean[0] == pytest.approx(x**2 + R**2 / 2, rel=1e-6)


G, NU, RADIUS, DEEP = 20e6, 0.3, 0.4, 20.0


def randolph_and_wroth(F, E_pile):
    """Settlement of a pile in an elastic half-space (Randolph and Wroth 1978)."""
    zeta = np.log(2.5 * DEEP * (1 - NU) / RADIUS)
    mu = sqrt(2 / (zeta * E_pile / G)) * DEEP / RADIUS
    base, slender = 4 / (1 - NU), tanh(mu) / mu * DEEP / RADIUS
    stiffness = (base + 2 * np.pi / zeta * slender) / (1 + base * slender * G / (np.pi * E_pile))
    return F / (G * RADIUS * stiffness)


@pytest.mark.parametrize("E_pile", [30e9, 1e14])
def test_a_pile_in_a_half_space(E_pile, verification):
    """With a rough shaft (no slip to speak of) and the ground around it; theirs is good to 5 %."""
    far = 25 * DEEP
    x = np.concatenate([[0.0, 0.4], np.geomspace(RADIUS, far, 18)[1:]])
    down = [np.linspace(0, DEEP, 17), DEEP + RADIUS * np.geomspace(1, (far - DEEP) / RADIUS, 12)]
    y = -np.concatenate(down)[::-1]
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    pile = Piles(
        (((0.0, 0.0), (0.0, -DEEP)),), number=Scalar(1.0), E=Scalar(E_pile), head="free",
        diameter=Scalar(2 * RADIUS), k_grout=Scalar(1e10), k_base=Scalar(1e11), pieces=64,
    )  # fmt: skip
    staged = model(
        from_grid("quad8", grid, (len(x) - 1, len(y) - 1)),
        analysis=Analysis.AXISYMMETRIC,
        materials={"soil": material("soil", 2 * G * (1 + NU), NU)},
        groups={"all": "soil"},
        supports=(Support("x1", (0, 1)), Support("y0", (0, 1))),
        structures={"bar": pile},
        stages=(Stage("built", build=("bar",)), *forces(-1e6)),
        channels=(gauge("u", "bar-displacement", pile),),
    )
    found, exact = staged.computed(NOTHING)[0, -1], randolph_and_wroth(1e6, E_pile)
    assert found == pytest.approx(exact, rel=0.05)
    where = ["elastic" if E_pile < 1e12 else "rigid"]
    verification("pile", where[0], where, exact=[exact], found=[found])


# --- derivatives -------------------------------------------------------------------------------

STARTS = {"E": 4e9, "EA": 1e8, "k": 8e8, "bond": 1.1e5, "s": 1.4, "F": 2e5, "cap": 3e5,
          "k_base": 1e8, "base": 2e3}  # fmt: skip


def sought(structure, stages, channels, names, kind="quad8", starts=STARTS, **changes):
    dim = 3 if kind.startswith(("hex", "tet")) else 2
    one = {n: Scalar(1.0, n) for n in names}
    return model(
        box(kind, (2,) * dim, size=(4.0,) * dim),
        materials={"rock": material("rock", one["E"], 0.25)},
        groups={"all": "rock"},
        supports=rollers(dim),
        structures={"bar": structure},
        stages=(Stage("built", build=("bar",)), *stages),
        parameters=tuple(
            Parameter(n, starts[n], 0.1 * starts[n], 10 * starts[n]) for n in names
        ),
        channels=channels,
        **changes,
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["quad8", "hex8"])
def test_derivatives_of_elastic_bolts_and_their_adjoints(kind):
    names = ("E", "EA", "k", "F", *(("s",) if kind == "quad8" else ()))
    tied = {"EA": Scalar(1.0, "EA"), "k_grout": Scalar(1.0, "k")}
    bolt = bars(3 if kind == "hex8" else 2, inclined=True, pieces=6, free=0.7, head="joined", **(
        tied | ({"spacing": Scalar(1.0, "s")} if kind == "quad8" else {})
    ))  # fmt: skip
    dim = 3 if kind == "hex8" else 2
    load = Traction("x1", (Scalar(3e6), *(ZERO,) * (dim - 1)))
    staged = sought(
        bolt,
        (
            Stage("jack", prestress={"bar": Scalar(0.4, "F")}),
            Stage("locked", loads={"p": load}),
        ),
        (
            gauge("N", "load-cell", bolt, 1.2),
            gauge("e", "strain", bolt, 0.9),
            gauge("u", "bar-displacement", bolt, 0.8),
            gauge("slip", "bar-displacement", bolt, 0.8, quantity="slip"),
            displacement("x", (4.0,) * dim, tuple(np.eye(dim)[0])),
        ),
        names,
        kind,
    )
    start = np.array([STARTS[n] for n in names])
    for which in (("N",), ("e",), ("u", "slip", "x")):
        seen = [(name, stage) for name in which for stage in ("jack", "locked")]
        assert_exact(staged.response(seen), start, names)


def test_derivatives_of_bolts_that_slip():
    """By stiffness and strength of the grout, the steel, the spacing and the ground, to 1e-7."""
    names = ("E", "EA", "k", "bond", "s", "F")
    bolt = bars(
        inclined=True, pieces=9, EA=Scalar(1.0, "EA"), k_grout=Scalar(1.0, "k"),
        bond=Scalar(1.0, "bond"), spacing=Scalar(1.0, "s"),
    )  # fmt: skip
    pull, back = (HeadForce("bar", Scalar(part, "F")) for part in (1.0, 0.3))
    _check_slopes(bolt, pull, back, names)


def test_derivatives_of_piles_that_sink_in():
    names = ("E", "EA", "k", "bond", "F", "k_base", "base")
    pile = bars(
        inclined=True, pieces=7, kind=Piles, EA=Scalar(1.0, "EA"), k_grout=Scalar(1.0, "k"),
        bond=Scalar(0.62, "bond"), k_base=Scalar(1.0, "k_base"), base_capacity=Scalar(1.0, "base"),
    )  # fmt: skip
    push, more = (HeadForce("bar", Scalar(-part, "F")) for part in (0.93, 1.0))
    _check_slopes(pile, push, more, names, forces=())  # statically determinate at last


def test_derivatives_of_steel_that_yields():
    """Between a plate and the grout the free length yields as the ground stretches."""
    names = ("E", "EA", "k", "bond", "cap")
    bolt = bars(
        inclined=True, pieces=8, free=0.7, head="joined", EA=Scalar(1.0, "EA"),
        k_grout=Scalar(1.0, "k"), bond=Scalar(0.25, "bond"), capacity=Scalar(0.2, "cap"),
    )  # fmt: skip
    load = Traction("x1", (Scalar(8e6), ZERO))
    _check_slopes(bolt, load, Traction("x1", (Scalar(5e6), ZERO)), names)


def _check_slopes(bars, load, less, names, forces=("N0.3", "N1.2", "N2.6")):
    staged = sought(
        bars,
        (Stage("load", loads={"p": load}), Stage("less", loads={"p": less})),
        (
            *(gauge(f"N{x}", "load-cell", bars, x) for x in (0.3, 1.2, 2.6)),
            gauge("u", "bar-displacement", bars, bars.free),
            gauge("deep", "bar-displacement", bars, 2.0, quantity="slip"),
            displacement("x", (4.0, 4.0), (1.0, 0.0)),
        ),
        names,
    )
    start = np.array([STARTS[n] for n in names])
    seen, acts = ("load", "less"), np.zeros(len(names))
    for which in filter(None, (forces, ("u", "deep", "x"))):
        response = staged.response([(name, stage) for name in which for stage in seen])
        _, jacobian = response.evaluate(start)
        acts = np.maximum(acts, np.abs(jacobian).max(axis=0))
        assert_slopes(response.readings, start, jacobian, names, step=2e-4)
    assert (acts > 0).all(), dict(zip(names, acts, strict=True))


# --- in stages ---------------------------------------------------------------------------------


def _beside_a_pit(*stages, **changes):
    mesh = from_grid("quad4", np.stack(np.meshgrid(*[np.arange(5.0)] * 2, indexing="ij"), -1)
                     .reshape(-1, 2), (4, 4))  # fmt: skip
    centres = np.array([mesh.points[nodes].mean(axis=0) for nodes in mesh.blocks[0].nodes])
    pit = (centres[:, 0] < 1) & (centres[:, 1] > 3)
    mesh = replace(mesh, groups={"pit": np.flatnonzero(pit), "rock": np.flatnonzero(~pit)})
    head = GroutedBars(
        (((1.0, 3.5), (3.0, 3.2)),), Scalar(1.0), EA=Scalar(EA), k_grout=Scalar(K), free=0.5
    )
    return model(
        mesh, materials={"rock": material("rock", 1e9, 0.2)},
        groups={"pit": "rock", "rock": "rock"}, supports=rollers(2),
        structures={"bar": head}, stages=stages, **changes,
    )  # fmt: skip


def test_bolts_built_with_the_excavation_at_their_heads_are_told_of():
    """A stage builds first: such bolts carry what the excavation releases."""
    half = {"pit": Scalar(0.5)}
    found = _beside_a_pit(Stage("first", ("pit",), build=("bar",)))
    assert any("carries what this releases" in text for text in found.notes)
    with pytest.raises(InputError, match="'bar' and builds it, so that it would stand before"):
        _beside_a_pit(Stage("first", ("pit",), build=("bar",), release=half), Stage("second"))
    jacked = Stage("first", ("pit",), build=("bar",), prestress={"bar": Scalar(1e4)}, release=half)
    for stages in ((Stage("open", ("pit",)), Stage("bolted", build=("bar",))), (jacked,)):
        assert not any("releases" in text for text in _beside_a_pit(*stages).notes)
