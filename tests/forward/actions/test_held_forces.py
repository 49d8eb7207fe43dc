"""What is held of ground that left, and forces in structures as they are kept: small arrays."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.fem.structures import Members
from geoident.forward.actions.release import PartialRelease
from geoident.forward.structures.forces import MemberRecorder
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, Bolts, Struts

POINT = ParameterPoint({"a": 3.0, "b": 0.5}, ("a", "b"))
VOLUME = np.array([2.0, 3.0, 5.0, 7.0])
POINTS_OF = {4: np.array([0, 2]), 6: np.array([1]), 9: np.array([3])}
CARRIED = {4: np.arange(9.0).reshape(3, 3), 6: 10.0 + np.arange(9.0).reshape(3, 3)}


class _Points:
    """Three unknowns, four points of one component: forces are sums of volumes and stresses."""

    n_points, volume = 4, VOLUME
    by = np.array([[1.0, 2.0, 0.0, 1.0], [0.0, 1.0, 3.0, 0.0], [5.0, 0.0, 1.0, 2.0]])

    def forces(self, stress, volume):
        return np.einsum("dq,q,qk->dk", self.by, volume, stress[0])


class _Parts:
    """Half of what a group is given, and its derivative."""

    def part(self, release, point, stage):
        assert stage == "now"
        return Dual(np.array([0.5 * release, 0.25 * release, 0.125]))


def _release(**state):
    now = SimpleNamespace(**{"name": "now", "base": 1, "release": {}, "leaving": frozenset(),
                             **state})  # fmt: skip
    asked = []

    def carried(base, groups, point):
        asked.append((base, groups))
        return sum(CARRIED[g] for g in groups)

    on_mesh = SimpleNamespace(
        sequence=SimpleNamespace(states=[None, None, now]),
        discretization=SimpleNamespace(points=_Points(), points_of=POINTS_OF),
    )
    return PartialRelease(on_mesh, SimpleNamespace(carried=carried), _Parts()), asked


STRESS = np.random.default_rng(3).standard_normal((1, 4, 4))
"""A value, two derivatives and a unit force."""


def test_what_a_group_gave_to_the_ground_is_what_it_carried_less_its_stress():
    made, asked = _release(release={4: 0.4, 6: 0.8, 9: 1.0}, leaving=frozenset({4, 9 + 1}))
    before = {6: np.full((3, 4), 2.0), 5: np.full((3, 4), 3.0)}
    held = made.held(2, before, STRESS, POINT)
    assert set(held) == {4, 6}
    np.testing.assert_array_equal(held[6], before[6])
    assert asked == [(1, {4})]
    own = POINTS_OF[4]
    exact = -np.einsum("dq,q,qk->dk", _Points.by[:, own], VOLUME[own], STRESS[0, own])
    exact[:, :3] += CARRIED[4]
    np.testing.assert_allclose(held[4], exact, rtol=1e-13)


def test_what_is_still_held_falls_with_the_part_that_is_released():
    made, _ = _release(release={4: 0.4, 6: 0.8})
    H4, H6 = np.random.default_rng(5).standard_normal((2, 3, 4))
    found = made.forces(2, {4: H4, 6: H6}, POINT)
    exact = 0.8 * H4 + 0.6 * H6
    for k, slopes in ((1, (0.1, 0.2)), (2, (0.125, 0.125))):
        exact[:, k] -= slopes[0] * H4[:, 0] + slopes[1] * H6[:, 0]
    np.testing.assert_allclose(found, exact, rtol=1e-13)
    assert made.forces(2, {}, POINT) == 0.0
    np.testing.assert_allclose(made.part(2, 6, POINT).columns, [0.4, 0.2, 0.125])


ENDS = np.array([[[0.0, 0.0], [2.0, 0.0]], [[2.0, 0.0], [2.0, 3.0]]])


class _Part:
    """Two members of one structure, the forces of whose ends are given by its rows."""

    def __init__(self, name, structure, first, nu=None):
        self.name, self.structure = name, structure
        rows = 6 if isinstance(structure, Beam) else 2
        self.rows = slice(first, first + rows)
        self.members = Members(None, np.ones(rows), np.zeros(rows, bool), ENDS + first, nu=nu)

    def section_forces(self, forces):
        own = forces[self.rows].reshape(3, 2)
        return SimpleNamespace(axial=own[0], first=own[1] - 1, second=own[1] + 1, shear=own[2],
                               hoop=own[2] * 100)  # fmt: skip


PARTS = (
    _Part("wall", Beam("line"), 0),
    _Part("shell", Beam("line"), 6, nu=0.2),
    _Part("bolts", Bolts(((ENDS[0, 0], ENDS[0, 1]),), spacing=Scalar(2.0, "a")), 12),
    _Part("struts", Struts(((ENDS[0, 0], ENDS[0, 1]),), number=Scalar(8.0, "b")), 14),
)


def test_forces_are_kept_at_ends_by_stage_and_of_one_bar():
    every = {"wall", "shell", "bolts", "struts"}
    states = [
        SimpleNamespace(name="virgin", structures=set(), stressed={}),
        SimpleNamespace(name="one", structures=every - {"bolts"}, stressed={"struts": Scalar(2.0,
                                                                                              "a")}),
        SimpleNamespace(name="two", structures=every, stressed={"bolts": Scalar(5.0)}),
    ]  # fmt: skip
    sequence = SimpleNamespace(states=states)
    kept = MemberRecorder(SimpleNamespace(parts=PARTS), sequence, POINT.values)
    q = np.random.default_rng(6).standard_normal((3, 16, 2))
    for number in range(3):
        kept.add(number, q[number])
    table = kept.table()
    assert table.structures == tuple(n for n in ("wall", "shell", "bolts", "struts") for _ in "12")
    assert table.numbers.tolist() == [1, 2] * 4
    assert table.stages == ("one", "two")
    np.testing.assert_array_equal(table.ends, np.concatenate([p.members.ends for p in PARTS]))
    assert table.per_metre.tolist() == [True] * 4 + [False] * 4
    nan = np.nan
    for k in (0, 1):
        v = q[k + 1, :, 0]
        bolts = v[12:14] * 6.0 if k else np.full(2, nan)
        np.testing.assert_allclose(
            table.axial[:, k], np.concatenate([v[:2], v[6:8], bolts, v[14:16] * 0.25])
        )
        M = np.concatenate([v[2:4], v[8:10], np.full(4, nan)])
        np.testing.assert_allclose(table.moment[:, 0, k], M - 1)
        np.testing.assert_allclose(table.moment[:, 1, k], M + 1)
        np.testing.assert_allclose(
            table.shear[:, k], np.concatenate([v[4:6], v[10:12], np.full(4, nan)])
        )
        np.testing.assert_allclose(
            table.hoop[:, k], np.concatenate([[nan, nan], 100 * v[10:12], np.full(4, nan)])
        )
    given = np.full((8, 2), nan)
    given[6:, 0], given[4:6, 1] = -6.0, 5.0
    np.testing.assert_array_equal(table.prestress, given)


def test_without_structures_no_forces_are_kept():
    none = MemberRecorder(SimpleNamespace(parts=()), SimpleNamespace(states=[]), {})
    assert none.table() is None


@pytest.mark.parametrize("nu", [None, 0.2])
def test_only_shells_have_forces_in_hoops(nu):
    part = _Part("shell", Beam("line"), 0, nu=nu)
    kept = MemberRecorder(SimpleNamespace(parts=(part,)), SimpleNamespace(states=[]), {})
    found = kept._at_ends(part, np.arange(6.0))
    assert found.shape == (5, 2)
    assert np.isnan(found[4]).all() == (nu is None)
