"""What an analysis carries from stage to stage, keeps for later ones, and starts from."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.forward.analysis import plastic_step
from geoident.forward.analysis.plastic_step import WarmStart
from geoident.forward.analysis.stage import (
    BaseStates,
    LastFactor,
    StressState,
    UnitForces,
    _runs,
    not_positive_definite,
)
from geoident.forward.stages import ConstructionState
from geoident.model.actions import Pressure
from geoident.model.case import Support
from geoident.model.parameter import Scalar

RNG = np.random.default_rng(9)
BEGIN = RNG.bit_generator.state


@pytest.fixture(autouse=True)
def same_draws():
    """Each test draws the same numbers, whatever ran before it."""
    RNG.bit_generator.state = BEGIN


def carried():
    """Three strain components, four points, two rows of structures, three columns."""
    found = StressState(RNG.normal(size=(3, 4, 3)), RNG.normal(size=(2, 3)))
    found.add_multipliers("clay", np.array([0, 2]), slice(0, 1), RNG.normal(size=(5, 2, 1)))
    return found


# --- what is carried ---


def test_columns_are_views_and_copies_are_not():
    whole = carried()
    part = whole.columns(slice(1, None))
    np.testing.assert_array_equal(part.stress, whole.stress[..., 1:])
    np.testing.assert_array_equal(part.members, whole.members[:, 1:])
    part.stress[1, 2, 0], part.members[1, 1] = 7.0, 8.0
    assert (whole.stress[1, 2, 1], whole.members[1, 2]) == (7.0, 8.0)
    copy = whole.copy()
    for name in ("stress", "members"):
        getattr(copy, name)[:] = 0.0
        assert getattr(whole, name).any()
    copy.hardened["clay"][:] = 0.0
    assert whole.hardened["clay"].any()


def test_points_that_are_gone_carry_nothing():
    for where, gone in ((np.array([1, 2]), [1, 2]), (slice(2, 4), [2, 3]),
                        (np.array([True, False, False, True]), [0, 3])):  # fmt: skip
        found = carried()
        found.stress[:], found.hardened["clay"][:] = 1.0, 1.0
        found.clear(where)
        assert np.flatnonzero(~found.stress.any(axis=(0, 2))).tolist() == gone
        assert np.flatnonzero(~found.hardened["clay"].any(axis=(0, 2))).tolist() == gone


def test_multipliers_add_up_by_material_point_and_column():
    found = StressState(np.zeros((3, 4, 3)), np.zeros((2, 3)))
    assert found.multipliers("clay", slice(None), 0) is None
    first, second = RNG.normal(size=(5, 2, 1)), RNG.normal(size=(5, 3, 2))
    found.add_multipliers("clay", np.array([0, 2]), slice(0, 1), first)
    found.add_multipliers("clay", slice(1, 4), slice(1, 3), second)
    found.add_multipliers("clay", np.array([2]), slice(0, 1), first[:, :1])
    expected = np.zeros((5, 4, 3))
    expected[:, [0, 2], :1] += first
    expected[:, 1:4, 1:] += second
    expected[:, 2, :1] += first[:, 0]
    np.testing.assert_allclose(found.hardened["clay"], expected)
    np.testing.assert_array_equal(
        found.multipliers("clay", np.array([2, 3]), 0), expected[:, 2:, 0]
    )
    part = found.multipliers("clay", slice(1, 3), slice(1, None))
    np.testing.assert_array_equal(part, expected[:, 1:3, 1:])
    assert found.multipliers("sand", slice(None), 0) is None


def test_a_copy_is_restored_whole():
    found, kept = carried(), carried()
    kept.hardened["sand"] = np.ones((1, 4, 3))
    stress, members = found.stress, found.members
    found.restore(kept)
    assert found.stress is stress
    assert found.members is members
    np.testing.assert_array_equal(stress, kept.stress)
    np.testing.assert_array_equal(members, kept.members)
    assert set(found.hardened) == {"clay", "sand"}
    found.hardened["sand"][:] = 0.0
    assert kept.hardened["sand"].all()
    plain = StressState(stress, members)
    found.restore(plain)
    assert found.hardened == {}


# --- states that later ones build on ---


def states(*bases):
    return [SimpleNamespace(base=base) for base in bases]


def test_states_are_kept_as_long_as_later_ones_build_on_them():
    """A tree: 2 and 5 build on 1, 3 on 2, 4 and 6 on 0."""
    bases = BaseStates(states(0, 0, 1, 2, 0, 1, 0))
    u, now = np.zeros((4, 2)), carried()
    held, found = {}, {}
    for n in range(7):
        bases.go_to(n, u, now)
        found[n] = float(u[0, 0]), float(now.stress[0, 0, 0])
        u[:], now.stress[:] = n + 10.0, n + 20.0
        bases.leave(n, u, now)
        held[n] = sorted(bases._kept)
    assert {n: pair for n, pair in found.items() if n} == {
        1: (10.0, 20.0), 2: (11.0, 21.0), 3: (12.0, 22.0), 4: (10.0, 20.0), 5: (11.0, 21.0),
        6: (10.0, 20.0),
    }  # fmt: skip
    assert held == {0: [0], 1: [0, 1], 2: [0, 1], 3: [0, 1], 4: [0, 1], 5: [0], 6: []}


def test_states_in_a_row_are_not_kept():
    bases = BaseStates(states(0, 0, 1, 2))
    u, now = np.zeros((4, 2)), carried()
    for n in range(4):
        bases.go_to(n, u, now)
        u += 1.0
        bases.leave(n, u, now)
        assert bases._kept == {}
    assert u[0, 0] == 4.0


# --- factors ---


def stands(materials, structures=(), stressed=(), **supports):
    held = {name: Support(name, axes) for name, axes in supports.items()}
    return ConstructionState(
        "s", materials, frozenset(), {"p": Pressure("y1", Scalar(1.0))},
        structures=frozenset(structures), stressed=dict.fromkeys(stressed, Scalar(1.0)),
        supports=held,
    )  # fmt: skip


class Kept:
    """A factor that can be lost."""

    valid = True


def test_a_factor_serves_all_that_stands_alike():
    last, state, factor = LastFactor(), stands({0: "a", 1: "b"}, ("w",), (), x=(0,)), Kept()
    assert last.find(state) is None
    last.keep(state, factor, "analysis", 5)
    assert last.find(stands({1: "b", 0: "a"}, ("w",), (), x=(0,))) is factor
    for other in (
        stands({0: "a", 1: "a"}, ("w",), (), x=(0,)),
        stands({0: "a"}, ("w",), (), x=(0,)),
        stands({0: "a", 1: "b"}, (), (), x=(0,)),
        stands({0: "a", 1: "b"}, ("w",), ("w",), x=(0,)),
        stands({0: "a", 1: "b"}, ("w",), (), x=(0, 1)),
        stands({0: "a", 1: "b"}, ("w",), (), y=(0,)),
    ):
        assert last.find(other) is None
    factor.valid = False
    assert last.find(state) is None


def test_the_oldest_factors_go_where_there_is_no_room():
    last = LastFactor(30)
    ground = [stands({0: name}) for name in "abcd"]
    factors = [Kept() for _ in ground]
    for state, factor, size in zip(ground[:3], factors, (10, 8, 9), strict=False):
        last.make_room(size)
        last.keep(state, factor, size, size)
    assert [last.find(state) for state in ground] == [*factors[:3], None]
    last.make_room(3)  # 27 + 3 are 30
    assert last.find(ground[0]) is factors[0]
    last.make_room(4)
    assert [last.find(state) is not None for state in ground] == [False, True, True, False]
    assert last.uses(9)
    assert not last.uses(10)
    last.make_room(22)
    assert [last.find(state) is not None for state in ground] == [False, False, False, False]
    last.keep(ground[3], factors[3], 1, 1)
    last.forget()
    assert last.find(ground[3]) is None
    one = LastFactor()
    one.keep(ground[0], factors[0], 1, 1)
    one.make_room(0)
    assert one.find(ground[0]) is None


def test_a_singular_stiffness_is_told_with_its_place():
    error = not_positive_definite("dig", " near (1, 2) m")
    assert error.message == (
        "at stage 'dig' the stiffness matrix is not positive definite near (1, 2) m"
    )
    assert error.hint == "look there for elements without stiffness, or held by next to nothing"


# --- unit forces, columns of modes ---


def test_unit_forces_act_in_columns_or_on_the_state():
    forces, active = RNG.normal(size=(4, 2)), np.array([[1.0, 0.0], [-1.0, 1.0]])
    columns = UnitForces(forces, active)
    assert columns.n_columns == 2
    acting = np.ones((4, 5))
    columns.add_to(acting, 1)
    np.testing.assert_array_equal(acting[:, :3], 1.0)
    np.testing.assert_array_equal(acting[:, 3:], forces * [-1.0, 1.0])
    pushed = UnitForces(forces, active, np.array([3.0, 5.0]))
    assert pushed.n_columns == 0
    acting = np.ones((4, 5))
    pushed.add_to(acting, 1)
    np.testing.assert_allclose(acting[:, 0], 1.0 - 3.0 * forces[:, 0] + 5.0 * forces[:, 1])
    np.testing.assert_array_equal(acting[:, 1:], 1.0)
    nothing = UnitForces(np.zeros((4, 0)), np.zeros((2, 0)))
    nothing.add_to(acting, 0)
    np.testing.assert_array_equal(acting[:, 1:], 1.0)


@pytest.mark.parametrize(
    ("names", "columns", "runs"),
    [
        ("abc", "xabc", [((0, 3), (1, 4))]),
        ("abc", "cab", [((0, 2), (1, 3)), ((2, 3), (0, 1))]),
        ("abcde", "abde", [((0, 2), (0, 2)), ((3, 5), (2, 4))]),
        ("abc", "cba", [((0, 1), (2, 3)), ((1, 2), (1, 2)), ((2, 3), (0, 1))]),
        ("abc", "xy", []),
        ("abcd", "abxcd", [((0, 2), (0, 2)), ((2, 4), (3, 5))]),
    ],
)
def test_modes_whose_columns_stand_together_are_one_run(names, columns, runs):
    found = _runs(list(names), {name: k for k, name in enumerate(columns)})
    assert [((a.start, a.stop), (b.start, b.stop)) for a, b in found] == runs


# --- held factors ---


# --- where Newton's method starts ---


def task(number, n=2, **values):
    names = tuple(values)[:n]
    point = SimpleNamespace(values=values, names=names)
    return SimpleNamespace(number=number, point=point, n=n, forces=np.zeros((6, 1 + n)))


def test_a_start_is_that_of_the_nearest_parameters_and_along_their_slopes():
    """How far is counted in parts of each parameter: 2 % of E are nearer than 10 % of c."""
    warm = WarmStart()
    assert warm.guesses(task(3, E=1.0, c=1.0)) == []
    du = {}
    for E, c in ((1e9, 1.0), (1.02e9, 1.1), (2e9, 1.0)):
        du[E] = RNG.normal(size=(6, 4))
        warm.keep(task(3, E=E, c=c), du[E])
    warm.keep(task(4, E=1.01e9, c=1.02), RNG.normal(size=(6, 3)))
    first, second = warm.guesses(task(3, E=1.03e9, c=1.02))
    np.testing.assert_array_equal(first, du[1e9][:, 0])
    change = np.array([0.03e9, 0.02])
    np.testing.assert_allclose(second, first + du[1e9][:, 1:3] @ change, rtol=1e-12)
    np.testing.assert_array_equal(warm.guesses(task(3, E=1.9e9, c=1.0))[0], du[2e9][:, 0])
    # without a parameter to differentiate by there is no slope
    warm.keep(task(5, 0, E=1.0), np.ones((6, 1)))
    one, other = warm.guesses(task(5, 0, E=2.0))
    np.testing.assert_array_equal(one, other)
    du[1e9][:] = 0.0
    assert warm.guesses(task(3, E=1e9, c=1.0))[0].any()


@pytest.mark.parametrize(("far", "kept"), [(1.019, False), (1.021, True)])
def test_what_is_known_near_by_with_slopes_is_not_replaced_by_less(far, kept):
    """An analysis without derivatives 2 % away; one with them counts anywhere."""
    warm = WarmStart()
    warm.keep(task(1, 1, E=1.0), np.ones((6, 2)))
    warm.keep(task(1, 0, E=far), np.full((6, 1), 2.0))
    assert (warm.guesses(task(1, 1, E=far))[0][0] == 2.0) == kept
    warm.keep(task(1, 1, E=1.0), np.full((6, 2), 3.0))
    assert len(warm._known[1]) == 2 + kept


def test_at_least_four_parameter_vectors_are_kept(monkeypatch):
    for numbers, most in ((10_000_000, 50), (6 * 3 * 7, 7), (0, 4)):
        monkeypatch.setattr(plastic_step, "_KEPT", numbers)
        warm = WarmStart()
        for k in range(50):
            warm.keep(task(1, E=1.0 + k, c=1.0), np.full((6, 3), float(k)))
        known = [one.du[0] for one in warm._known[1]]
        assert known == [float(k) for k in range(50 - most, 50)]
    assert plastic_step._FEWEST == 4
