"""What is said where weight and in-situ stress disagree, word by word, and forces by hand."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import NOWHERE, material, model
from support.meshes import box, regroup

from geoident.forward.analysis.virgin import (
    contradictions,
    local_imbalance,
    overburden_notes,
    surface_gaps,
)
from geoident.model.actions import PointForce, Water
from geoident.model.case import Stage, Support
from geoident.model.in_situ import ConstantStress, GeostaticStress, HeimStress, ProfileStress
from geoident.model.parameter import Scalar

G = 9.81
NOTHING = (Scalar(0.0),) * 6


def layered(dim=2, *, low=1500.0, high=2000.0, held=True, n=3, **changes):
    """A box of 6 m: `fill` above 4 m, `clay` from 2 to 4 m, `rock` below; clay is as rock."""
    mesh = box("quad4" if dim == 2 else "hex8", (n,) * dim, size=(6.0,) * dim)
    mesh = regroup(mesh, fill=lambda c: c[:, -1] > 4, clay=lambda c: c[:, -1] > 2)
    axes = "xyz"[:dim]
    sides = tuple(Support(f"{a}{end}", (k,)) for k, a in enumerate(axes[:-1]) for end in (0, 1))
    settings = {
        "materials": {
            "heavy": material("heavy", 1e9, 0.3, high), "light": material("light", 1e9, 0.3, low)
        },
        "groups": {"fill": "light", "clay": "heavy", "rock": "heavy"},
        "supports": (*(sides if held else ()), Support(f"{axes[-1]}0", (dim - 1,))),
        "gravity": (*(0.0,) * (dim - 1), -G),
        "stages": (Stage("nothing"),),
    }  # fmt: skip
    return model(mesh, **{**settings, **changes})


def profile(dim, growth, surface=6.0):
    gradient = list(NOTHING)
    gradient[dim - 1] = Scalar(-growth)
    return ProfileStress(NOTHING, tuple(gradient), Scalar(surface))


def heim(growth, surface=6.0):
    return HeimStress(Scalar(0.5), unit_weight=Scalar(growth), surface=Scalar(surface))


ACCEPT = "or accept it: in_situ: {equilibrium: accept}"


# --- unit weights ---


@pytest.mark.parametrize("dim", [2, 3])
def test_a_profile_is_judged_by_its_vertical_group_by_group(dim):
    """20 kN/m3 is 1.9 % more than 2000 kg/m3, and a third more than 1500 kg/m3."""
    (fault,) = contradictions(layered(dim, in_situ=profile(dim, 20e3)).analysis, {})
    assert fault.code == "unit-weight"
    assert fault.path == f"in_situ.gradient.{'xyz'[dim - 1] * 2}"
    assert fault.message == (
        "the in-situ stress of 'fill' grows by 20 kN/m3 with depth, but density times gravity of "
        "'light' is 14.71 kN/m3 (1500 kg/m3 x 9.81 m/s2)"
    )
    assert fault.hint == (
        f"Correct '{'xyz'[dim - 1] * 2}' (14.71 kN/m3) or the density (2039 kg/m3), or let 'model: "
        f"geostatic' take the weight from the densities, {ACCEPT}."
    )


def test_groups_of_one_material_are_told_together_and_listed():
    faults = contradictions(layered(in_situ=heim(24e3), low=2000.0).analysis, {})
    assert [fault.message.partition(" grows")[0] for fault in faults] == [
        "the in-situ stress of 'fill'", "the in-situ stress of 'clay' and 'rock'"
    ]  # fmt: skip
    (fault,) = contradictions(
        layered(
            in_situ=heim(24e3), groups=dict.fromkeys(("fill", "clay", "rock"), "heavy")
        ).analysis,
        {},
    )
    assert fault.message.startswith("the in-situ stress of 'fill', 'clay' and 'rock' grows by 24 ")
    assert fault.path == "in_situ.unit_weight"


@pytest.mark.parametrize(("growth", "faults"), [(1.019, 0), (1.021, 1), (0.981, 0), (0.979, 1)])
def test_two_percent_of_the_weight_may_differ(growth, faults):
    staged = layered(in_situ=heim(growth * 2000 * G), low=2000.0)
    assert len(contradictions(staged.analysis, {})) == 2 * faults


def test_without_gravity_the_ground_weighs_nothing():
    for density, said in (
        (1500.0, "'light' has 1500 kg/m3"),
        (0.0, "'light' has no density: 1835 kg/m3 would be 18 kN/m3"),
    ):
        staged = layered(
            in_situ=heim(18e3), gravity=None, low=density,
            groups=dict.fromkeys(("fill", "clay", "rock"), "light"),
        )  # fmt: skip
        (fault,) = contradictions(staged.analysis, {})
        assert (fault.code, fault.path) == ("no-gravity", "in_situ.unit_weight")
        assert fault.message == (
            "the in-situ stress of 'fill', 'clay' and 'rock' grows by 18 kN/m3 with depth, but "
            "there is no gravity: the ground weighs 0 kN/m3"
        )
        assert fault.hint == f"Add 'gravity: 9.81 m/s2' ({said}), {ACCEPT}."


def test_gravity_of_none_needs_no_density_by_division():
    """A gravity of 0 is no gravity to divide by: nothing is said of a density."""
    staged = layered(in_situ=heim(18e3), gravity=(0.0, -0.0))
    first, *_ = contradictions(staged.analysis, {})
    assert "is 0 kN/m3 (1500 kg/m3 x 0 m/s2)" in first.message
    assert "or the density (0 kg/m3)" in first.hint


def test_below_the_water_the_ground_weighs_less():
    """The table is at 3 m: clay above and below it, the rock below, the fill above."""
    wet = Water(Scalar(3.0), Scalar(10e3))
    staged = layered(in_situ=heim(9.62e3), water=wet, low=9.62e3 / G, n=6)
    (fault,) = contradictions(staged.analysis, {})
    assert fault.message.startswith("the in-situ stress of 'clay' grows by 9.62 kN/m3 with depth, ")
    assert fault.message.endswith("'heavy' is 19.62 kN/m3 (2000 kg/m3 x 9.81 m/s2)")
    staged = layered(in_situ=heim(19.62e3), water=wet, low=2000.0, n=6)
    (fault,) = contradictions(staged.analysis, {})
    assert fault.message == (
        "the in-situ stress of 'clay' and 'rock' grows by 19.62 kN/m3 with depth, but below the "
        "water table 'heavy' weighs 9.62 kN/m3 (2000 kg/m3 x 9.81 m/s2 less 10 kN/m3 of water; "
        "in-situ stresses are effective)"
    )
    assert "(9.62 kN/m3) or the density (3019 kg/m3)" in fault.hint
    # where only the rock has water in its pores, only that is lighter
    dry = layered(in_situ=heim(19.62e3), low=2000.0, n=6,
                  water=Water(Scalar(3.0), Scalar(10e3), ("rock",)))  # fmt: skip
    (fault,) = contradictions(dry.analysis, {})
    assert fault.message.startswith("the in-situ stress of 'rock' grows")


def test_only_ground_below_the_surface_of_a_stress_is_judged():
    """A surface at 4 m: the fill is above it. A stress of one group is judged for that group."""
    staged = layered(in_situ=heim(19.62e3, 4.0))
    assert all(fault.code != "unit-weight" for fault in contradictions(staged.analysis, {}))
    zones = layered(
        in_situ=heim(19.62e3), low=2000.0,
        in_situ_of={"clay": heim(30e3), "rock": GeostaticStress(Scalar(0.5))},
    )  # fmt: skip
    (fault,) = contradictions(zones.analysis, {})
    assert fault.path == "in_situ.groups.clay.unit_weight"
    assert fault.message.startswith("the in-situ stress of 'clay' grows by 30 kN/m3 with depth")


def test_a_profile_without_growth_or_no_stress_at_all_contradicts_no_weight():
    level = ProfileStress(NOTHING, NOTHING, Scalar(6.0))
    assert all(
        f.code == "out-of-balance" for f in contradictions(layered(in_situ=level).analysis, {})
    )
    assert contradictions(layered().analysis, {}) == []
    alone = layered(in_situ_of={"clay": heim(30e3)})
    assert contradictions(alone.analysis, {})[0].path == "in_situ.groups.clay.unit_weight"


# --- local balance ---


def patches_by_hand(staged, stresses, weights):
    """Forces out of balance and forces at work (n_nodes,) of rectangles of constant stress.

    A corner gets half a side of the traction on both sides of the rectangle that meet there.
    """
    mesh = staged.mesh
    total, size = np.zeros((mesh.n_nodes, 2)), np.zeros(mesh.n_nodes)
    own = np.zeros((mesh.n_nodes, 2))
    for element, nodes in enumerate(mesh.blocks[0].nodes):
        places = mesh.points[nodes]
        a, b = np.ptp(places, axis=0)
        xx, yy, xy = stresses[element]
        for node, sign in zip(nodes, np.sign(places - places.mean(axis=0)), strict=True):
            pull = np.array([
                xx * sign[0] * b / 2 + xy * sign[1] * a / 2,
                xy * sign[0] * b / 2 + yy * sign[1] * a / 2,
            ])  # fmt: skip
            total[node] += pull
            size[node] += np.linalg.norm(pull)
            own[node, 1] -= weights[element] * a * b / 4
    rest, size = own - total, size + np.linalg.norm(own, axis=1)
    return rest, size


def test_the_part_out_of_balance_is_that_of_the_patch_by_hand():
    """Constant stresses of three layers, of which none is in balance; held along x at the sides."""
    stress = {"fill": (-1e4, -3e4, 2e3), "clay": (-4e4, -5e4, -1e3), "rock": (-2e4, -9e4, 5e2)}
    zones = {
        name: ConstantStress(
            tuple(Scalar(v) for v in (xx, yy, -7e4, xy, 0.0, 0.0)), held=False
        )
        for name, (xx, yy, xy) in stress.items()
    }  # fmt: skip
    staged = layered(in_situ_of=zones)
    mesh = staged.mesh
    of = {e: name for name in stress for e in mesh.groups[name]}
    density = {"fill": 1500.0, "clay": 2000.0, "rock": 2000.0}
    n = mesh.n_elements
    rest, size = patches_by_hand(
        staged, [stress[of[e]] for e in range(n)], [density[of[e]] * G for e in range(n)]
    )
    x, y = mesh.points.T
    rest[(x == 0.0) | (x == 6.0), 0] = 0.0
    rest[y == 0.0, 1] = 0.0
    part = np.linalg.norm(rest, axis=1) / size
    worst = int(np.argmax(part))
    found = local_imbalance(staged.analysis, NOWHERE)
    assert found.part == pytest.approx(part[worst], rel=1e-12)
    assert found.rest == pytest.approx(np.linalg.norm(rest[worst]), rel=1e-12)
    assert found.size == pytest.approx(size[worst], rel=1e-12)
    np.testing.assert_array_equal(found.position, mesh.points[worst])
    beside = {of[e] for e in range(n) if worst in mesh.blocks[0].nodes[e]}
    assert found.group in beside
    # however small or large all forces are
    for scale in (1e-150, 1e150):
        smaller = {
            name: ConstantStress(
                tuple(Scalar(scale * c.factor) for c in one.components), held=False
            )
            for name, one in zones.items()
        }
        again = local_imbalance(
            layered(in_situ_of=smaller, gravity=(0.0, -scale * G)).analysis, NOWHERE
        )
        assert again.part == pytest.approx(found.part, rel=1e-9)
        assert again.rest == pytest.approx(scale * found.rest, rel=1e-9)


def test_a_load_counts_as_one_of_the_forces_of_its_patch():
    """A force of 30 kN on the corner at (4, 6) of four, in a stress that is in balance."""
    force = PointForce((4.0, 6.0), (Scalar(0.0), Scalar(-30e3)))
    staged = layered(in_situ=heim(2000 * G), low=2000.0, loads={"crane": force})
    still = layered(in_situ=heim(2000 * G), low=2000.0)
    before = local_imbalance(still.analysis, NOWHERE)
    assert before.part < 1e-12
    found = local_imbalance(staged.analysis, NOWHERE)
    np.testing.assert_array_equal(found.position, [4.0, 6.0])
    assert found.rest == pytest.approx(30e3, rel=1e-12)
    assert found.part == pytest.approx(found.rest / found.size, rel=1e-12)
    (fault,) = contradictions(staged.analysis, {})
    assert fault.code == "out-of-balance"
    assert fault.path == "in_situ"
    assert fault.message == (
        "the initial state is out of balance near (4, 6) m in 'fill' by "
        f"{100 * found.part:.2g} % of the local stress: 30 of {found.size / 1e3:.3g} kN/m"
    )
    assert fault.hint == (
        "Hold the edges of the model ('supports', or 'held: true'), and let weight, water, loads "
        "and in-situ stress agree, as 'model: geostatic' does; where slopes or dipping layers "
        "remain, accept it: in_situ: {equilibrium: accept}."
    )
    solid = layered(
        3, in_situ=heim(2000 * G), low=2000.0,
        loads={"crane": PointForce((4.0, 2.0, 6.0), (Scalar(0.0), Scalar(0.0), Scalar(-30e3)))},
    )  # fmt: skip
    (fault,) = contradictions(solid.analysis, {})
    assert "near (4, 2, 6) m in 'fill' by " in fault.message
    assert fault.message.endswith(" kN")


@pytest.mark.parametrize(("force", "told"), [(0.99, False), (1.01, True)])
def test_one_percent_of_the_local_forces_may_be_out_of_balance(force, told):
    at_corner = layered(
        in_situ=heim(2000 * G), low=2000.0,
        loads={"crane": PointForce((4.0, 6.0), (Scalar(0.0), Scalar(-1.0)))},
    )  # fmt: skip
    size = local_imbalance(at_corner.analysis, NOWHERE).size
    load = 0.01 * force * size / (1.0 - 0.01 * force)  # it counts among the forces itself
    staged = layered(
        in_situ=heim(2000 * G), low=2000.0,
        loads={"crane": PointForce((4.0, 6.0), (Scalar(0.0), Scalar(-load)))},
    )  # fmt: skip
    assert bool(contradictions(staged.analysis, {})) == told


def halves(dim, axis, left, right, *, vertical=(-1e5, -1e5), edges=True):
    """A box of two halves along an axis, each of its own horizontal stress, held all around."""
    mesh = box("quad4" if dim == 2 else "hex8", (4,) * dim, size=(4.0,) * dim)
    mesh = regroup(mesh, low=lambda c: c[:, axis] < 2.0)
    zones = {}
    for name, side, up in (("low", left, vertical[0]), ("rock", right, vertical[1])):
        stress = [Scalar(side)] * 3
        stress[dim - 1] = Scalar(up)
        zones[name] = ConstantStress((*stress, *NOTHING[:3]), held=False)
    free = () if edges else (f"{'xyz'[axis]}1",)
    sides = ((f"{'xyz'[k]}{end}", k) for k in range(dim) for end in (0, 1))
    supports = tuple(Support(name, (k,)) for name, k in sides if name not in free)
    return model(
        mesh,
        materials={"rock": material("rock", 1e9, 0.3)},
        groups={"low": "rock", "rock": "rock"},
        supports=supports,
        in_situ_of=zones,
        stages=(Stage("nothing"),),
    )


@pytest.mark.parametrize(("dim", "axis"), [(2, 0), (3, 0), (3, 1)])
def test_groups_of_different_horizontal_stress_meet_at_a_steep_boundary(dim, axis):
    staged = halves(dim, axis, -5e4, -8e4)
    found = local_imbalance(staged.analysis, NOWHERE)
    assert found.across == ("low", "rock")
    assert found.position[axis] == 2.0
    (fault,) = contradictions(staged.analysis, {})
    assert " m where 'low' and 'rock' meet, by " in fault.message
    assert fault.hint == (
        "A steep boundary bears only one horizontal stress, that of both sides: give 'low' and "
        "'rock' the same horizontal stress there (one K0), or let them meet at a horizontal "
        "boundary; where the ground is so, accept it: in_situ: {equilibrium: accept} "
        "brings the difference to equilibrium before the first stage."
    )


@pytest.mark.parametrize(
    ("left", "right", "vertical", "differ"),
    [
        (-5.0e4, -5.04e4, (-1e5, -1e5), False),  # less than 1 % of the larger ratio
        (-5.0e4, -5.06e4, (-1e5, -1e5), True),
        (-5.0e4, -6.0e4, (-1e5, -1.2e5), False),  # ratios to the vertical count
        (-5.0e4, -6.0e4, (-1e5, -1.1e5), True),
        (-5.0e4, -6.0e4, (0.0, 0.0), True),
    ],
)
def test_horizontal_stresses_differ_by_one_percent_in_parts_of_the_vertical(
    left, right, vertical, differ
):
    found = local_imbalance(halves(2, 0, left, right, vertical=vertical).analysis, NOWHERE)
    assert found.across == (("low", "rock") if differ else ())


def test_a_free_edge_and_a_level_boundary_are_no_steep_one():
    free = local_imbalance(halves(2, 0, -5e4, -8e4, edges=False).analysis, NOWHERE)
    assert free.position[0] == 4.0  # all of 8e4 there
    assert free.across == ()
    level = halves(2, 1, -5e4, -5e4, vertical=(-1e5, -2e5))
    assert local_imbalance(level.analysis, NOWHERE).across == ()


@pytest.mark.parametrize("free", ["x0", "x1"])
def test_layers_that_differ_at_a_free_edge_do_not_meet_there(free):
    """Where two of them begin at the edge, all ground is on one side of it."""
    zones = {
        name: ConstantStress((Scalar(side), Scalar(-1e5), *NOTHING[:4]), held=False)
        for name, side in (("fill", -1e4), ("clay", -9e4), ("rock", -1e4))
    }
    sides = (("x0", 0), ("x1", 0), ("y0", 1), ("y1", 1))
    supports = tuple(Support(name, (axis,)) for name, axis in sides if name != free)
    staged = layered(in_situ_of=zones, gravity=None, supports=supports)
    found = local_imbalance(staged.analysis, NOWHERE)
    assert found.position[0] == (0.0 if free == "x0" else 6.0)
    assert found.position[1] in (2.0, 4.0)
    assert found.across == ()


# --- surfaces and overburden ---


@pytest.mark.parametrize("dim", [2, 3])
def test_a_surface_below_or_above_the_mesh_is_told_with_its_place(dim):
    def gaps(level, **more):
        stress = GeostaticStress(Scalar(0.5), Scalar(level), **more)
        return surface_gaps(layered(dim, in_situ=stress).analysis, {})

    where = r"at x = " if dim == 2 else r"at (x, y) = ("
    (below,) = gaps(5.25)
    assert (below.code, below.path) == ("surface", "in_situ.surface")
    assert below.message.startswith(where)
    assert below.message.endswith(" m the surface lies 0.75 m below the top of the mesh")
    assert below.hint == "Correct 'surface', or leave it out: the ground then ends with the mesh."
    (above,) = gaps(6.5)
    assert above.message.startswith(where)
    assert above.message.endswith(
        " m the surface lies 0.5 m above the top of the mesh, and 'cover', the unit weight "
        "between, is missing"
    )
    assert above.hint == "Add 'cover: 20 kN/m3', correct 'surface', or leave it out."
    assert gaps(6.5, cover=Scalar(2e4)) == []
    assert gaps(6.0) == []
    if dim == 3:
        plan = below.message.removeprefix(where).partition(") = ")[0].partition(") m")[0]
        assert len(plan.split(", ")) == 2


def test_the_surface_of_a_zone_is_judged_over_its_groups():
    zone = {"rock": GeostaticStress(Scalar(0.5), Scalar(5.5))}
    (fault,) = surface_gaps(layered(in_situ_of=zone, in_situ=heim(2e4)).analysis, {})
    assert fault.path == "in_situ.groups.rock.surface"
    assert surface_gaps(layered(in_situ=GeostaticStress(Scalar(0.5))).analysis, {}) == []
    dug = {"in_situ": GeostaticStress(Scalar(0.5), Scalar(4.0))}
    absent = {"groups": {"fill": None, "clay": "heavy", "rock": "heavy"}}
    assert surface_gaps(layered(**dug, **absent).analysis, {}) == []


def test_what_lies_above_is_said_of_the_groups_with_a_geostatic_stress():
    """Gauss points stand 0.4226 m from the ends of elements of 2 m."""
    staged = layered(in_situ=GeostaticStress(Scalar(0.5)), in_situ_of={"clay": heim(15e3)})
    near, far = 1.0 - 1.0 / np.sqrt(3.0), 1.0 + 1.0 / np.sqrt(3.0)
    fill, heavy = 1.5 * G, 2.0 * G
    top = f"'fill' {near * fill:.3g} .. {far * fill:.3g} kPa"
    low = f"'rock' {2 * (fill + heavy) + near * heavy:.3g} .. "
    low += f"{2 * (fill + heavy) + far * heavy:.3g} kPa"
    assert overburden_notes(staged.analysis, {}) == [
        "vertical in-situ stress by the weight above, at the start values, in compression: "
        f"{top}, {low}"
    ]
    wet = Water(Scalar(-50.0), Scalar(10e3))
    (note,) = overburden_notes(
        layered(in_situ=GeostaticStress(Scalar(0.5)), water=wet).analysis, {}
    )
    assert note.startswith("vertical effective in-situ stress by the weight above")
    zone = layered(in_situ=heim(2e4), in_situ_of={"rock": GeostaticStress(Scalar(0.5))})
    (note,) = overburden_notes(zone.analysis, {})
    assert note.endswith(f"in compression: {low}")
    assert overburden_notes(layered(in_situ=heim(2e4)).analysis, {}) == []


def test_eight_groups_are_said_and_the_others_counted():
    mesh = box("quad4", (2, 5), size=(2.0, 10.0))

    def row(k, side):
        return lambda c: (np.floor(c[:, 1] / 2.0) == k) & ((c[:, 0] > 1.0) == side)

    parts = {f"g{2 * k + side}": row(k, bool(side)) for k in range(5) for side in range(2)}
    mesh = regroup(mesh, **parts)
    mesh.groups.pop("rock")
    for count, more in ((8, ""), (9, " and 1 more groups"), (10, " and 2 more groups")):
        names = [f"g{k}" for k in range(count)]
        rest = {f"g{k}": None for k in range(count, 10)}
        staged = model(
            mesh,
            materials={"heavy": material("heavy", 1e9, 0.3, 2000.0)},
            groups={**dict.fromkeys(names, "heavy"), **rest},
            supports=(Support("y0", (0, 1)),),
            gravity=(0.0, -G),
            in_situ=GeostaticStress(Scalar(0.5)),
            stages=(Stage("nothing"),),
        )
        (note,) = overburden_notes(staged.analysis, {})
        assert note.count("kPa") == 8
        assert note.endswith(f"kPa{more}")
        assert "'g0' " in note
        assert "'g8' " not in note
