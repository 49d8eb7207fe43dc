"""Struts, anchors and prestress: forces worked by hand, mirror images, exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.errors import InputError
from geoident.fem.location import Locator
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.gauges import Channel
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Anchors, Bolts, Struts
from geoident.model.yielding import MohrCoulomb
from tests.support.array_model import solved_at_once
from tests.support.cases import displacement, material, model, rollers
from tests.support.derivatives import assert_exact
from tests.support.load_cells import cell
from tests.support.meshes import box, regroup

NOTHING = np.empty(0)
ZERO = Scalar(0.0)
E = 1e8
EA, SPACING, LENGTH = 6e7, 3.0, 1.5
PAIR = (((1.0, 0.0), (1.0 + LENGTH, 0.0)), ((1.0, 1.0), (1.0 + LENGTH, 1.0)))
PUSH = 2e5


def _struts(second_end="fixed", ends=PAIR, **changes):
    return Struts(ends, Scalar(SPACING), EA=Scalar(EA), second_end=second_end, **changes)


def _push(x, name="push"):
    return Stage(name, loads={"push": Traction("x1", (Scalar(x), ZERO))})


def _wall(structures, stages, mesh=None, **changes):
    """A square metre of ground that is held at x = 0 and does not widen: it moves uniformly."""
    settings = {
        "materials": {"rock": material("rock", E, 0.0)},
        "groups": {"all": "rock"},
        "supports": rollers(2),
        "structures": structures,
        "stages": stages,
    }
    return model(mesh or box("quad4", (1, 1)), **{**settings, **changes})


def _forces(staged):
    return staged.survey(NOTHING, fields=False).members


def _motion(staged, point=(1.0, 1.0)):
    fields = staged.survey(NOTHING, fields=True).fields
    node = np.argmin(np.linalg.norm(fields.mesh.points - point, axis=1))
    return fields.displacement[1:, node, 0]


def test_prop_with_a_fixed_end_takes_its_share_by_stiffness():
    """The wall is a spring E, two struts one of 2 EA / (L s): u = p / (E + 2 EA / (L s))."""
    staged = _wall({"prop": _struts()}, (Stage("prop", build=("prop",)), _push(PUSH)))
    u = PUSH / (E + 2 * EA / LENGTH / SPACING)
    np.testing.assert_allclose(_motion(staged), [0, u], rtol=1e-12, atol=1e-18)
    found = _forces(staged)
    np.testing.assert_allclose(found.axial[:, 1], -EA / LENGTH * u, rtol=1e-12)
    np.testing.assert_allclose(found.axial[:, 0], 0, atol=1e-9)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_prop_in_a_solid_stands_by_itself(axis):
    turned = np.roll(np.eye(3), axis, axis=0)
    corners = [(1.0, a, b) for a in (0.0, 1.0) for b in (0.0, 1.0)]
    ends = tuple(
        (tuple(turned.T @ c), tuple(turned.T @ np.add(c, [LENGTH, 0, 0]))) for c in corners
    )
    struts = Struts(ends, EA=Scalar(EA), second_end="fixed")
    name = "xyz"[int(np.argmax(turned.T @ [1.0, 0, 0]))]
    pull = tuple(Scalar(float(x)) for x in turned.T @ [PUSH, 0, 0])
    staged = model(
        box("hex8", (1, 1, 1)),
        materials={"rock": material("rock", E, 0.0)},
        groups={"all": "rock"},
        supports=rollers(3),
        structures={"prop": struts},
        stages=(Stage("push", build=("prop",), loads={"p": Traction(f"{name}1", pull)}),),
    )
    u = PUSH / (E + 4 * EA / LENGTH)
    np.testing.assert_allclose(_forces(staged).axial[:, 0], -EA / LENGTH * u, rtol=1e-11)


def test_strut_on_a_plane_of_symmetry_is_half_of_the_whole_one():
    """Two blocks with a strut between them, against one of them with half of the strut."""
    half = regroup(box("quad8", (6, 4), size=(3.0, 2.0)), gap=_between)
    whole = regroup(box("quad8", (12, 4), size=(6.0, 2.0)), gap=_between)
    one = ((2.0, 1.3), (3.0, 1.3))
    both = ((2.0, 1.3), (4.0, 1.3))

    def forces(mesh, ends, second_end, supports, loaded):
        load = {side: Traction(side, (Scalar(sign * PUSH), ZERO)) for side, sign in loaded}
        return _forces(
            _wall(
                {"strut": _struts(second_end, (ends,))},
                (Stage("dig", excavate=("gap",), build=("strut",)), Stage("push", loads=load)),
                mesh,
                groups={"rock": "rock", "gap": "rock"},
                supports=supports,
                materials={"rock": material("rock", E, 0.3)},
            )
        )  # fmt: skip

    bottom = Support("y0", (0, 1))
    a = forces(half, one, "symmetry", (bottom, Support("x1", (0,))), (("x0", 1.0),))
    b = forces(whole, both, "joined", (bottom,), (("x0", 1.0), ("x1", -1.0)))
    assert a.axial[0, 1] < -1e3
    assert a.axial[0, 1] == pytest.approx(b.axial[0, 1], rel=1e-10)


def _between(x):
    return (x[:, 0] > 2.0) & (x[:, 0] < 4.0)


@pytest.mark.parametrize(
    ("ends", "supports", "said"),
    [
        (((1.0, 0.5), (2.0, 0.6)), rollers(2),
         "ends on a plane of symmetry, but it runs from (1, 0.5) m to (2, 0.6) m, inclined to the "
         "axes"),
        (((1.0, 0.5), (2.0, 0.5)), rollers(2), "but the mesh has no nodes at x = 2 m"),
        (((0.0, 0.5), (1.0, 0.5)), rollers(2),
         "but 2 of the 2 nodes at x = 1 m are not held along x"),
        (((0.5, 0.0), (0.5, 1.0)), (*rollers(2), Support("y1", (0,))),
         "but 2 of the 2 nodes at y = 1 m are not held along y"),
    ],
)  # fmt: skip
def test_strut_that_ends_on_no_plane_of_symmetry_is_refused(ends, supports, said):
    with pytest.raises(InputError) as error:
        _wall(
            {"strut": _struts("symmetry", (ends,))},
            (Stage("prop", build=("strut",)),),
            supports=supports,
        )
    (fault,) = error.value.faults
    assert fault.code == "no-symmetry-there"
    assert said in fault.message, fault.message


def test_plane_inside_the_mesh_is_none_of_symmetry():
    mesh = box("quad4", (2, 1))
    middle = np.flatnonzero(mesh.points[:, 0] == 0.5)
    mesh = replace(mesh, node_groups={**mesh.node_groups, "middle": middle})
    with pytest.raises(InputError) as error:
        _wall(
            {"strut": _struts("symmetry", (((1.0, 0.5), (0.5, 0.5)),))},
            (Stage("prop", build=("strut",)),),
            mesh,
            supports=(*rollers(2), Support("middle", (0,))),
        )
    assert "the mesh continues on both sides of x = 0.5 m, from 0 to 1 m" in str(error.value)


def test_jacked_strut_pushes_with_its_force_and_is_then_a_spring():
    """At the stage that jacks it the force is P whatever moves; then it grows by EA / L du."""
    prestress = Scalar(4e4)
    stages = (
        Stage("jack", build=("prop",), loads={"push": Traction("x1", (Scalar(PUSH / 4), ZERO))}),
        _push(PUSH),
    )
    staged = _wall({"prop": _struts(prestress=prestress)}, stages)
    jacked = (PUSH / 4 - 2 * 4e4 / SPACING) / E
    more = 0.75 * PUSH / (E + 2 * EA / LENGTH / SPACING)
    np.testing.assert_allclose(_motion(staged), [jacked, jacked + more], rtol=1e-12)
    found = _forces(staged)
    np.testing.assert_array_equal(found.axial[:, 0], -4e4)
    np.testing.assert_allclose(found.axial[:, 1], -4e4 - EA / LENGTH * more, rtol=1e-12)


def test_jacked_again_and_let_down():
    stages = (
        Stage("prop", build=("prop",)),
        _push(PUSH),
        Stage("jack", prestress={"prop": Scalar(9e4)}),
        _push(0.0, "relieve"),
        Stage("let down", prestress={"prop": ZERO}),
        _push(PUSH, "again"),
    )
    staged = _wall({"prop": _struts()}, stages)
    spring = E + 2 * EA / LENGTH / SPACING
    first = PUSH / spring
    jacked = (PUSH - 2 * 9e4 / SPACING) / E
    relieved = jacked - PUSH / spring
    np.testing.assert_allclose(
        _motion(staged), [0, first, jacked, relieved, 0, PUSH / spring], rtol=1e-11, atol=1e-14
    )
    forces = _forces(staged).axial[0]
    pushed = EA / LENGTH * PUSH / spring
    np.testing.assert_allclose(
        forces, [0, -pushed, -9e4, -9e4 + pushed, 0, -pushed], rtol=1e-11, atol=1e-6
    )


def _mass(n=8):
    """Ground behind a wall at x = 0, held at the far side and below."""
    return box("quad8", (n, n), size=(20.0, 20.0))


BACK = (Support("x1", (0,)), Support("y0", (0, 1)))
ANCHOR = (((0.0, 14.0), (12.0, 10.0)),)
GROUTED = 5.0


def _anchored(stages, structures=None, **changes):
    anchor = Anchors(ANCHOR, Scalar(2.0), EA=Scalar(1.2e8), grouted=GROUTED)
    return _wall(structures or {"A1": anchor}, stages, _mass(), supports=BACK, **changes)


def _pulled(sign=-1.0):
    return {"pull": Traction("x0", (Scalar(sign * 1e5), ZERO))}


def test_anchor_is_locked_off_at_its_force_and_then_follows_the_motion():
    """N = P at lock-off; later N = P + EA / L times what head and grout move apart."""
    head, toe = (np.array(x) for x in ANCHOR[0])
    length = float(np.linalg.norm(toe - head))
    along = tuple((toe - head) / length)
    apart = tuple(
        Channel(
            f"c{k}", "c", "convergence", ANCHOR[0][0],
            tuple(toe - (k + 0.5) / 10 * GROUTED * np.array(along)), along, 1e-4, "stress",
            ("gauges", "c"),
        )
        for k in range(10)
    )  # fmt: skip
    stages = (Stage("stress", build=("A1",), prestress={"A1": Scalar(3e5)}),
              Stage("dig", loads=_pulled()))  # fmt: skip
    survey = _anchored(stages, channels=apart).survey(NOTHING, fields=False)
    forces = survey.members.axial
    assert forces[0, 0] == 3e5
    more = 1.2e8 / (length - GROUTED) * survey.computed[:, 1].mean()
    assert abs(more) > 1e3
    assert forces[0, 1] == pytest.approx(3e5 + more, rel=1e-10)


def test_anchor_gives_its_force_to_the_ground_evenly_along_the_grout():
    """Nodal forces are those of ten equal forces; the free length touches nothing."""
    staged = _anchored((Stage("stress", build=("A1",), prestress={"A1": Scalar(3e5)}),))
    *_, end = staged.at(NOTHING).states()
    pull = -staged.structures.nodal_forces(end.members[:, :1]).reshape(-1, 2)
    head, toe = (np.array(x) for x in ANCHOR[0])
    along = (toe - head) / np.linalg.norm(toe - head)
    places = [toe - (s + 0.5) / 10 * GROUTED * along for s in range(10)]
    locator, expected = Locator(staged.mesh), np.zeros_like(pull)
    for force, place in [(3e5 / 2, head), *((-3e5 / 20, place) for place in places)]:
        site = locator.sites(tuple(place))[0]
        np.add.at(expected, site.nodes, np.outer(site.shapes, force * along))
    np.testing.assert_allclose(pull, expected, atol=1e-9 * 3e5)


PARAMETERS = (
    Parameter("E", E, 1e7, 1e9),
    Parameter("EA", EA, 1e6, 1e9),
    Parameter("s", SPACING, 1.0, 9.0),
    Parameter("P", 4e4, 0.0, 2e5),
    Parameter("P2", 9e4, 0.0, 2e5),
    Parameter("a", 6e-4, 1e-5, 1e-2),
    Parameter("PA", 1e5, 0.0, 1e6),
)
_STRUT, _ANCHOR = ((3.0, 2.6), (4.5, 2.6)), ((3.0, 1.7), (0.9, 1.1))


def _all(yields=(), free=None, **changes):
    """Struts and an anchor, stressed at building and later, with what they need."""
    free = [q.name for q in PARAMETERS] if free is None else free
    start = {q.name: q.start for q in PARAMETERS}

    def number(name):
        return Scalar(1.0, name) if name in free else Scalar(start[name])

    structures = {
        "prop": Struts((_STRUT,), number("s"), EA=number("EA"), prestress=number("P"),
                       second_end="fixed"),
        "A1": Anchors((_ANCHOR,), Scalar(2.0), E=Scalar(2e11), area=number("a"), grouted=0.8),
    }  # fmt: skip
    rock = replace(material("rock", number("E"), 0.3), yields=yields)
    stages = (
        Stage("dig", excavate=("cut",)),
        Stage("prop", build=("prop", "A1"), prestress={"A1": number("PA")},
              loads={"push": Traction("x0", (Scalar(6e5), ZERO))}),
        Stage("more", loads={"push": Traction("x0", (Scalar(9e5), ZERO))}),
        Stage("jack", prestress={"prop": number("P2")}),
        Stage("case", loads={"push": Traction("x0", (Scalar(1.1e6), ZERO))}, independent=True),
        Stage("least", loads={"push": Traction("x0", (Scalar(3e5), ZERO))}, dismantle=("A1",)),
    )  # fmt: skip
    mesh = regroup(
        box("quad8", (6, 4), size=(3.0, 3.0)), cut=lambda x: (x[:, 0] > 2.0) & (x[:, 1] > 2.8)
    )
    settings = {
        "materials": {"rock": rock},
        "groups": {"rock": "rock", "cut": "rock"},
        "supports": (Support("y0", (0, 1)),),
        "structures": structures,
        "stages": stages,
        "parameters": tuple(q for q in PARAMETERS if q.name in free),
        "channels": (
            displacement("top", (3.0, 2.5), (1.0, 0.0)),
            displacement("up", (1.4, 1.4), (0.6, 0.8)),
            cell("N1", *_STRUT, structure="prop"),
            cell("N2", *_ANCHOR, structure="A1"),
        ),
    }
    return model(mesh, **{**settings, **changes})


READ = [("top", s) for s in ("prop", "more", "jack", "case", "least")]
READ += [("up", s) for s in ("prop", "case", "least")]
CELLS = [("N1", s) for s in ("prop", "more", "jack", "case", "least")]
CELLS += [("N2", s) for s in ("prop", "more", "jack", "case")]
WEAK = (MohrCoulomb(cohesion=Scalar(1.5e6), friction=Scalar(0.3), planes=8),)
STRONG = (MohrCoulomb(cohesion=Scalar(1e9), friction=Scalar(0.3), planes=8),)


@pytest.mark.parametrize("yields", [(), WEAK])
def test_derivatives_by_every_number_of_bars_and_their_prestress(yields):
    staged = _all(yields)
    response = staged.response(READ + CELLS)
    p = np.array([q.start for q in PARAMETERS])
    if yields:
        ends = list(staged.at(p).states())
        assert all(end.yielded.any() for end in ends[2:4])
    assert_exact(response, p, staged.names)
    readings = response.readings(p)
    assert readings[READ_OF["N1", "prop"]] == -4e4
    assert readings[READ_OF["N1", "jack"]] == -9e4
    assert readings[READ_OF["N2", "prop"]] == 1e5


READ_OF = {pair: n for n, pair in enumerate(READ + CELLS)}


def test_condensation_finds_prestress_and_stiffness():
    staged = _all(free=["E", "EA", "P", "PA"])
    response = staged.response(READ)
    assert response.obstacle() is None
    true = np.array([E, EA, 4e4, 1e5])
    measured = response.readings(true)
    p = true * [1.2, 0.8, 1.3, 0.8]
    for _ in range(30):
        condensed = response.condense(p, measured, np.full(len(READ), 1e-4))
        last, p = p, np.linalg.lstsq(condensed.matrix * true, condensed.vector)[0] * true
        if np.allclose(p, last, rtol=1e-8):
            break
    np.testing.assert_allclose(p, true, rtol=1e-6)


def test_prestress_spread_over_a_free_spacing_is_not_affine():
    spread = _all(free=["s"], structures=_stressed_only())
    why = spread.response(READ).obstacle()
    assert why == "the prestress of the structure 'A1' at stage 'prop' is not linear in s"


def _stressed_only():
    """EA / s does not depend on s, the prestress per metre does."""
    bars = Bolts((_ANCHOR,), Scalar(1.0, "s"), E=Scalar(2e11), area=Scalar(1e-4, "s"))
    prop = Struts((_STRUT,), Scalar(3.0), EA=Scalar(EA), second_end="fixed")
    return {"prop": prop, "A1": bars}


def test_exported_equations_give_the_same_readings():
    """Solved as one linear system of all stages, at other parameters than those of the export."""
    staged = _all(STRONG, free=["E", "EA", "P", "P2", "PA"])
    response = staged.response(READ)
    assert response.system_obstacle() is None
    p = np.array([E, EA, 4e4, 9e4, 1e5]) * [1.1, 0.9, 1.2, 0.7, 1.1]
    found = solved_at_once(response.system(), p)
    np.testing.assert_allclose(found, response.readings(p), rtol=1e-8)
