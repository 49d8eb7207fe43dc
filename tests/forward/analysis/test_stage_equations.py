"""The equations of a stage on arrays, against loops, another solver's projections, differences."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from support.array_model import Operators
from support.plastic import Planes, definite, polyhedral, projection_by_piqp, random_planes

from geoident.fem.elasticity import UniformModuli
from geoident.fem.patches import Patch
from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.yielding.domain import NoProjection, NoReturn
from geoident.forward.analysis.constitutive import Flow, Ground, ReachedPlanes
from geoident.forward.analysis.stage_equations import (
    ELASTIC_PARTS,
    LARGE,
    NoEquilibrium,
    StageEquations,
    Trial,
)
from geoident.model.dual import Dual

S, M, D = 3, 7, 9
"""Strain components, points, degrees of freedom."""

RNG = np.random.default_rng(12)
C = RNG.normal(size=(S * M, D))
VOLUME = RNG.uniform(0.5, 2.0, M)
BEFORE = 0.2 * RNG.normal(size=(S, M))
BARS = 0.3 * definite(RNG, D)
LOCKED = RNG.normal(size=D)
DOFS = np.array([7, 0, 2, 5, 3])
FORCES = RNG.normal(size=D)
E = {name: definite(RNG, S) for name in ("hard", "plain", "soft")}
PLANES = {
    "hard": random_planes(RNG, 4, S, hardening=0.4),
    "soft": Planes(*(random_planes(RNG, 3, S).__dict__[n] for n in ("normals", "distances"))),
}
HARDENED = RNG.uniform(0.0, 0.3, (4, 3))
BEGIN = RNG.bit_generator.state


@pytest.fixture(autouse=True)
def same_draws():
    """Each test draws the same numbers, whatever ran before it."""
    RNG.bit_generator.state = BEGIN


def grounds(*, flow=False):
    """Two that yield and an elastic one between them; points in runs and one by one."""
    soft = polyhedral(E["soft"], PLANES["soft"])
    if flow:  # said to have no potential
        soft = SimpleNamespace(associated=False, project=soft.project, hardens=False)
    return [
        Ground("hard", np.array([1, 3, 6]), UniformModuli(E["hard"]),
               polyhedral(E["hard"], PLANES["hard"]), HARDENED),
        Ground("plain", np.array([0, 5]), UniformModuli(E["plain"])),
        Ground("soft", slice(2, 5, 2), UniformModuli(E["soft"]), soft),
    ]  # fmt: skip


def equations(**changes):
    settings = {
        "volume": VOLUME, "dofs": DOFS, "grounds": grounds(), "stress": BEFORE, "forces": FORCES,
        "tangents": None, "members": lambda du: LOCKED + BARS @ du,
    }  # fmt: skip
    return StageEquations(Operators(sp.csr_array(C), M), **(settings | changes))


def stresses(du, *, viscosity=0.0):
    """What the grounds bear, point by point, by an interior-point method."""
    strain = (C @ du).reshape(S, M)
    found = np.zeros((S, M))
    for name, points in (("hard", [1, 3, 6]), ("plain", [0, 5]), ("soft", [2, 4])):
        for place, k in enumerate(points):
            trial = BEFORE[:, k] + E[name] @ strain[:, k]
            found[:, k] = trial
            if name in PLANES:
                hardened = HARDENED[:, place] if name == "hard" else None
                borne = projection_by_piqp(E[name], PLANES[name], trial, hardened)
                found[:, k] = borne + viscosity * (trial - borne)
    return found


def internal(stress):
    return np.einsum("smd,sm,m->d", C.reshape(S, M, D), stress, VOLUME)


DU = 0.4 * RNG.normal(size=D)


@pytest.mark.parametrize("viscosity", [0.0, 0.3])
def test_a_trial_is_what_the_grounds_bear(viscosity):
    stage = equations().viscous(viscosity)
    trial = stage.at(DU)
    wanted = stresses(DU, viscosity=viscosity)
    np.testing.assert_allclose(trial.stress, wanted, atol=1e-6)
    acting = internal(trial.stress) + LOCKED + BARS @ DU
    np.testing.assert_allclose(trial.residual, (FORCES - acting)[DOFS], atol=1e-12)
    assert trial.scale >= np.abs(acting).max()
    assert trial.error == pytest.approx(np.abs(trial.residual).max() / trial.scale)
    assert [flow is None for flow in trial.flows] == [False, True, False]
    assert len(stage.flowing(trial)) == 2
    assert stage.viscous(viscosity) is stage
    np.testing.assert_array_equal(stage.stress, BEFORE)


def test_forces_at_work_are_the_largest_of_those_given_carried_and_of_elements():
    """Stress in equilibrium with itself counts, since signs at random keep it from cancelling."""
    rest = np.zeros(D)
    still = equations(stress=0.0 * BEFORE, forces=rest, members=None)
    assert still.at(rest).scale == 0.0
    assert still.at(rest).error == 0.0
    forced = equations(stress=0.0 * BEFORE, forces=np.array([*rest[:-1], -50.0]), members=None)
    assert forced.at(rest).scale == 50.0
    locked = equations(stress=0.0 * BEFORE, forces=rest, members=lambda du: 40.0 * LOCKED)
    assert locked.at(rest).scale == pytest.approx(40.0 * np.abs(LOCKED).max())
    own = np.zeros((S, M))
    null = np.linalg.svd((C * np.tile(VOLUME, S)[:, None]).T)[2][-1]  # balanced by itself
    own[:] = null.reshape(S, M)
    balanced = equations(stress=own, forces=rest, members=None, grounds=grounds()[1:2])
    assert np.abs(balanced.before()).max() < 1e-12
    assert balanced.at(rest).scale > 0.1 * np.abs(C).max() * np.abs(own).max()
    pushed = balanced.at(100.0 * DU)
    assert pushed.scale == pytest.approx(np.abs(internal(pushed.stress)).max())
    assert Trial(rest, own, (), np.array([-3.0, 2.0]), 0.0).error == 3.0


def test_what_is_carried_into_a_stage_is_held_by_forces():
    np.testing.assert_allclose(equations().before(), internal(BEFORE) + LOCKED)
    np.testing.assert_allclose(equations(members=None).before(), internal(BEFORE))
    other = equations().under(2.0 * FORCES)
    np.testing.assert_array_equal(other.forces, 2.0 * FORCES)


def test_the_residual_is_the_slope_of_the_potential():
    stage, h = equations(), 1e-5
    for du in (DU, -0.7 * DU, 0.01 * DU):
        trial = stage.at(du)
        for k, dof in enumerate(DOFS):
            unit = h * np.eye(D)[dof]
            ends = [stage.distance(stage.at(du + sign * unit)) for sign in (1, -1)]
            slope = (ends[0] - ends[1]) / (2 * h)
            assert slope == pytest.approx(-trial.residual[k], abs=1e-5)
    without = equations(members=None)
    ends = [without.distance(without.at(DU + sign * h * np.eye(D)[2])) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / (2 * h) == pytest.approx(-without.at(DU).residual[2], abs=1e-5)
    loose = equations(grounds=grounds(flow=True))
    assert not loose.associated
    assert loose.distance(loose.at(DU)) == loose.at(DU).error
    assert equations().associated


@pytest.mark.parametrize("viscosity", [0.0, 0.3])
def test_changes_are_those_of_the_stress_with_the_strain(viscosity):
    """(T E - E) V at the points that yield, of both grounds, by differences of the stress."""
    stage = equations(viscosity=viscosity)
    trial = stage.at(DU)
    points, changes = stage.changes(trial)
    yielding = sorted(k for f in stage.flowing(trial) for k in f.points)
    assert points.tolist() == yielding
    assert len(points) > 2
    assert np.all(np.diff(points) > 0)
    of = {1: "hard", 3: "hard", 6: "hard", 2: "soft", 4: "soft"}
    h = 1e-7
    for k, change in zip(points, changes, strict=True):
        slopes = np.zeros((S, S))
        for c in range(S):
            ends = []
            for sign in (1, -1):
                stress, strain = BEFORE.copy(), (C @ DU).reshape(S, M).copy()
                strain[c, k] += sign * h
                for ground in stage.grounds:
                    ground.bear(stress, strain, viscosity)
                ends.append(stress[:, k])
            slopes[:, c] = (ends[0] - ends[1]) / (2 * h)
        np.testing.assert_allclose(change / VOLUME[k], slopes - E[of[k]], atol=1e-6)
    still = equations(stress=0.0 * BEFORE).at(np.zeros(D))
    points, changes = stage.changes(still)
    assert points.shape == (0,)
    assert points.dtype == np.int64
    assert changes.shape == (0, S, S)


def test_elastic_forces_are_those_of_the_stiffness():
    stage, x = equations(), RNG.normal(size=len(DOFS))
    full = stage.spread(x)
    assert full.shape == (D,)
    np.testing.assert_array_equal(full[DOFS], x)
    assert np.count_nonzero(full) == len(DOFS)
    stress, strain = np.zeros((S, M)), (C @ full).reshape(S, M)
    for name, points in (("hard", [1, 3, 6]), ("plain", [0, 5]), ("soft", [2, 4])):
        stress[:, points] = E[name] @ strain[:, points]
    wanted = internal(stress)[DOFS]
    np.testing.assert_allclose(stage.elastic_forces(x), wanted + (BARS @ full)[DOFS], rtol=1e-11)
    np.testing.assert_allclose(equations(members=None).elastic_forces(x), wanted, rtol=1e-11)


class Refusing:
    """Makes factors from a number of calls on."""

    def __init__(self, refused):
        self.refused, self.asked = refused, []

    def __call__(self, points, change, *, symmetric):
        self.asked.append((points, change, symmetric))
        if len(self.asked) <= self.refused:
            raise NotPositiveDefinite(0)
        return "factor"


@pytest.mark.parametrize(("least", "refused"), [(0, 0), (0, 2), (3, 1), (6, 4), (10, 0)])
def test_a_tangent_is_made_stiffer_until_it_has_a_factor(least, refused):
    tangents = Refusing(refused)
    stage = equations(tangents=tangents)
    trial = stage.at(DU)
    assert stage.factor(trial, least=least) == ("factor", least + refused)
    points, change = stage.changes(trial)
    assert len(tangents.asked) == 1 + refused
    for level, asked in enumerate(tangents.asked, start=least):
        np.testing.assert_array_equal(asked[0], points)
        np.testing.assert_allclose(asked[1], (1.0 - ELASTIC_PARTS[level]) * change, rtol=1e-15)
        assert asked[2] is True


def test_without_potential_nothing_of_the_elastic_stiffness_is_left_at_first():
    tangents = Refusing(1)
    stage = equations(tangents=tangents, grounds=grounds(flow=True))
    trial = stage.at(DU)
    assert stage.factor(trial) == ("factor", 1)
    _, change = stage.changes(trial)
    np.testing.assert_array_equal(tangents.asked[0][1], change)
    np.testing.assert_allclose(tangents.asked[1][1], (1.0 - ELASTIC_PARTS[1]) * change, rtol=1e-15)
    assert tangents.asked[0][2] is False


@pytest.mark.parametrize(("du", "asked"), [(DU, 11), (0.0 * DU, 1)])
def test_a_stiffness_that_is_singular_elastically_is_refused(du, asked):
    """At all levels where points yield; at once where none does."""
    tangents = Refusing(99)
    stage = equations(tangents=tangents, stress=0.0 * BEFORE)
    with pytest.raises(NotPositiveDefinite):
        stage.factor(stage.at(du))
    assert len(tangents.asked) == asked


def test_a_patch_moves_as_the_whole_with_all_else_still():
    """Its residual is that of the whole at its unknowns, of points and bars alike."""
    points = np.array([1, 2, 4, 5])
    rows = np.concatenate([c * M + points for c in range(S)])
    dofs = np.array([0, 2, 3, 4, 6, 7])
    unknowns = np.array([0, 1, 2, 4])  # 7, 0, 2, 3
    places = np.searchsorted(dofs, DOFS[unknowns])
    local = C.copy()
    others = np.setdiff1d(np.arange(D), dofs)
    local[np.ix_(rows, others)] = 0.0  # the points of the patch are strained by its own nodes
    mine = np.zeros(S * M, dtype=bool)
    mine[rows] = True
    local[np.ix_(~mine, DOFS[unknowns])] = 0.0  # and its unknowns strain no others
    stage = replace(equations(), operators=Operators(sp.csr_array(local), M))
    patch = Patch(points, dofs, unknowns, places, sp.csr_array(local[np.ix_(rows, dofs)]))
    own = stage.within(patch, "tangents", DU)
    assert own.tangents == "tangents"
    assert [ground.name for ground in own.grounds] == ["hard", "plain", "soft"]
    assert [ground.points.tolist() for ground in own.grounds] == [[0], [3], [1, 2]]
    for step in (0.0, 0.3, -0.5):
        moved = DU.copy()
        moved[DOFS[unknowns]] += step * RNG.normal(size=4)
        whole, part = stage.at(moved), own.at(moved[dofs])
        np.testing.assert_allclose(part.residual, whole.residual[unknowns], atol=1e-12)
        np.testing.assert_allclose(part.stress, whole.stress[:, points], atol=1e-12)
    bare = replace(stage, members=None).within(patch, "tangents", DU)
    assert bare.members is None
    none = replace(stage, grounds=stage.grounds[:1]).within(
        replace(patch, points=np.array([0, 2, 4, 5])), "tangents", DU
    )
    assert none.grounds == []


@pytest.mark.parametrize("index", [np.array([0, 3, 4, 9]), slice(2, 8), slice(0, 9, 4)])
def test_the_part_of_a_ground_among_some_points_bears_what_it_bears_there(index):
    count = len(np.arange(10)[index])
    hardened = RNG.uniform(0.0, 0.3, (4, count))
    law = polyhedral(E["hard"], PLANES["hard"])
    ground = Ground("hard", index, UniformModuli(E["hard"]), law, hardened)
    stress, strain = RNG.normal(size=(2, S, 10))
    points = np.array([1, 3, 4, 6, 8])
    part = ground.among(points, 10)
    whole, own = stress.copy(), stress[:, points].copy()
    ground.bear(whole, strain, 0.1)
    flow = part.bear(own, strain[:, points], 0.1)
    mine = np.isin(points, np.arange(10)[index])
    np.testing.assert_allclose(own[:, mine], whole[:, points[mine]], atol=1e-10)
    np.testing.assert_array_equal(own[:, ~mine], stress[:, points[~mine]])
    assert flow.n_points == 5
    assert ground.among(np.setdiff1d(np.arange(10), np.arange(10)[index]), 10) is None
    assert ground.yields
    assert not Ground("plain", index, UniformModuli(E["plain"])).yields


def test_what_leads_nowhere_is_no_equilibrium_and_what_does_not_end_is_told():
    for error, told in (
        (NoReturn("?"), NoEquilibrium),
        (NoProjection(3), NoProjection),
        (ZeroDivisionError("a bug"), ZeroDivisionError),
        (FloatingPointError("a bug"), FloatingPointError),
    ):

        def fail(trial, hardened, error=error):
            raise error

        law = SimpleNamespace(project=fail, associated=True)
        one = Ground("odd", slice(0, M), UniformModuli(E["plain"]), law)
        with pytest.raises(told) as caught:
            equations(grounds=[one]).at(DU)
        if told is NoEquilibrium:
            assert caught.value.mechanism is None
            assert not caught.value.limit
            assert str(caught.value) == "no equilibrium"


def test_the_part_of_points_where_shear_may_go_into_a_band():
    stage = equations()
    flows = [
        SimpleNamespace(points=np.arange(3), may_localise=lambda: np.array([True, False, False])),
        SimpleNamespace(points=np.empty(0), may_localise=lambda: np.ones(9, dtype=bool)),
        SimpleNamespace(points=np.arange(2), may_localise=lambda: np.array([True, True])),
    ]
    trial = Trial(DU, BEFORE, (None, *flows), np.zeros(1), 1.0)
    assert stage.localising(trial) == pytest.approx(3.0 / 5.0)
    assert stage.localising(replace(trial, flows=(None,))) == 0.0


def test_large_begins_at_ten_thousand_unknowns():
    assert LARGE == 10_000
    assert not equations(dofs=np.arange(9_999)).large
    assert equations(dofs=np.arange(10_000)).large


# --- which planes are reached ---


class Limits:
    """Distances (y, 1 + n) with names."""

    def __init__(self, *distances):
        self.distances = Dual(np.array(distances))
        self.names = tuple(f"p{k}" for k in range(len(distances)))

    def __len__(self):
        return len(self.names)


def test_planes_are_noted_by_material_plane_and_stage():
    of = {"a": Limits([5.0, 1.0, 0.0], [7.0, 0.0, 2.0]), "b": Limits([9.0, 0.5, 0.25])}
    planes = ReachedPlanes(SimpleNamespace(limits=of), ("first", "second", "third"))

    def flow(name, multipliers, biactive):
        projection = SimpleNamespace(
            multipliers=np.array(multipliers), biactive=np.array(biactive, dtype=bool)
        )
        return Flow(SimpleNamespace(name=name), projection, 9)

    planes.flow(1, flow("a", [[1.0, 0.0], [2.0, 0.0], [0.0, 0.5]], [[0, 1], [0, 0], [1, 1]]))
    planes.flow(3, flow("a", [[1.0, 3.0]], [[0, 0]]))
    planes.flow(3, flow("b", [[2.0], [1.0]], [[0], [1]]))
    planes.flow(3, flow("b", [[2.0]], [[0]]))  # fewer than before: the most counts

    def ground(name, excess):
        law = SimpleNamespace(excess=lambda stress, hardened: np.array(excess))
        return SimpleNamespace(name=name, law=law, hardened=None)

    found = planes.reach(ground("a", [[-3.0, -1.0], [0.5, -2.0]]), None)
    assert found.tolist() == [[-3.0, -1.0], [0.5, -2.0]]
    planes.reach(ground("a", [[-2.0, -4.0], [-1.0, -1.0]]), None)
    activity = planes.activity()
    assert activity.planes == ("a: p0", "a: p1", "b: p0")
    assert activity.stages == ("first", "second", "third")
    assert activity.points.tolist() == [[2, 0, 1], [1, 0, 1], [0, 0, 2]]
    assert activity.biactive.tolist() == [[1, 0, 0], [2, 0, 0], [0, 0, 0]]
    assert activity.distances.tolist() == [5.0, 7.0, 9.0]
    assert activity.reached.tolist() == [4.0, 7.5, -np.inf]
    assert activity.slopes.tolist() == [[1.0, 0.0], [0.0, 2.0], [0.5, 0.25]]
    planes.reach(ground("b", np.zeros((1, 0))), None)
    assert planes.activity().reached[2] == -np.inf


def test_the_limit_of_a_plane_is_its_distance_at_the_point():
    law = polyhedral(E["hard"], PLANES["hard"])
    law.planes.__dict__["names"] = ("w", "x", "y", "z")
    ground = Ground("hard", np.array([1, 3, 6]), UniformModuli(E["hard"]), law)
    name, distance = ground.limit(2, 1, RNG.normal(size=(S, 3)))
    assert name == "y"
    assert distance == pytest.approx(PLANES["hard"].distances[2])
