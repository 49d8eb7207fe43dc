"""A case that a kept reduced model answers: which of the two is asked, and what is counted."""

from __future__ import annotations

from dataclasses import is_dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from support.sums import summed_model

from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.observed import Observed
from geoident.forward.reduced.case_model import ReducedCaseModel
from geoident.forward.reduced.coverage import reduction_obstacle, releases
from geoident.forward.reduced.kept import RestoredModel, _Blocks, _Packed
from geoident.forward.reduced.stress_rows import StressRows
from geoident.model.results.costs import Counts

STAGES = ("virgin", "one", "two", "three")
CHANNELS = ("a", "b")
READABLE = np.array([[1, 0], [1, 0], [1, 1], [1, 1]]).astype(bool)
ROWS, STATES = np.array([0, 1, 0, 0]), np.array([3, 2, 1, 2])  # not ("b", "three")
V = np.array([1.0, -2.0, 3.0, 5.0])
BUILT_ON = np.triu(np.ones((4, 4), dtype=bool))
P = np.array([0.5, 2.0])


SEEN = np.random.default_rng(5).standard_normal((4, 2, 1, 3))


class _Response:
    def __init__(self, error, fails=None):
        self.error, self.fails = np.array(error), fails

    def certified(self, values):
        if self.fails:
            raise self.fails
        assert values.shape == (1, 2)
        return V[None], self.error[None]


class _Restored:
    """A kept model of four readings with bounds that are given."""

    def __init__(self, error=(0.1, 0.2, 0.3, 0.4), fails=None):
        added = {"offset": None, "drift": None, "drift_per_stage": None, "is_zeroed": True}
        channels = tuple(SimpleNamespace(name=name, **added) for name in CHANNELS)
        self.case = SimpleNamespace(
            stage_names=STAGES, parameters=[SimpleNamespace(name=name) for name in "xy"],
            channels=channels, zero_of=lambda channel: 1, dates={}, readings=(),
        )  # fmt: skip
        self.kept = SimpleNamespace(readable=READABLE, rows=ROWS, states=STATES, channels=CHANNELS,
                                    built_on=BUILT_ON)  # fmt: skip
        weights = np.array([[1.0, 1.0], [-1.0, 0.0]])
        self.observation = ReadingRule(CHANNELS, np.array([1, 0]), weights, READABLE)
        self.bases = np.array([0, 0, 1, 2])
        self.pairs = tuple((CHANNELS[r], STAGES[s]) for r, s in zip(ROWS, STATES, strict=True))
        self.model = SimpleNamespace(states=lambda values: values, observed=lambda states: SEEN)
        self._answer = _Response(error, fails)

    def admissible(self, p):
        return "too much" if p[0] > 1.0 else None

    def response(self, pairs):
        return self._answer


class _Whole:
    """The model on the mesh: it sees nothing but ones."""

    def __init__(self):
        self.n_dofs, self.notes = (1, 2), ("a note",)
        self.counts, self.on_state, self.asked = Counts(5, 1, 4, 40), None, []

    def admissible(self, p):
        return "far too much" if p[0] > 3.0 else None

    def why_unseen(self, state, row):
        return f"{CHANNELS[row]} at {STAGES[state]}: gone"

    def response(self, pairs, times):
        return pairs, times

    def observe(self, p, query):
        self.asked.append((query.fields, query.partial, query.last))
        return Observed(np.ones((4, 2, 3)))


def _case_model(limit, **options):
    made = []

    def build():
        made.append(_Whole())
        return made[0]

    return ReducedCaseModel(_Restored(**options), np.array(limit, dtype=float), build), made


NONE = np.full((2, 3), np.nan)


def _limits(**some):
    """(n_channels, n_stages): of channels a and b, at stages 1 to 3."""
    limit = NONE.copy()
    for name, value in some.items():
        limit["ab".index(name[0]), int(name[1]) - 1] = value
    return limit


def test_a_case_whose_readings_are_close_is_answered_without_the_mesh():
    found, made = _case_model(_limits(a3=0.2, b2=0.2, b1=1e-9))
    survey = found.survey(P, fields=True)
    table, seen = np.full((2, 3, 3), np.nan), SEEN[:, :, 0]
    table[0], table[1, 1:] = seen[1:, 0] - seen[1, 0], seen[2:, 1]  # a change, and a value
    np.testing.assert_allclose(survey.computed, table[..., 0])
    np.testing.assert_allclose(survey.sensitivity, table[..., 1:])
    changes = seen[[0, 1, 2, 3], 0, 0] - [0.0, *seen[[0, 1, 2], 0, 0]]
    np.testing.assert_allclose(survey.increments[:, 0], changes)
    assert survey.fields is None
    assert (found.by_reduced, found.by_model, found.worst, made) == (1, 0, 1.0, [])
    assert found.counts == Counts(1, 0, 0, 0)
    assert found.notes == ()
    found.survey(P, fields=True)
    assert (found.by_reduced, found.counts.evaluations, found.worst) == (2, 2, 1.0)


@pytest.mark.parametrize(
    ("limit", "options"),
    [
        (_limits(a3=0.099), {}),
        (_limits(b2=0.199), {}),
        (_limits(b3=9.0), {}),  # it does not give that one
        (_limits(a3=9.0), {"error": (np.nan, 0.0, 0.0, 0.0)}),
        (_limits(a3=9.0), {"fails": ValueError("left the span")}),
        (_limits(a3=9.0), {"fails": np.linalg.LinAlgError("singular")}),
    ],
)
def test_a_case_whose_readings_are_not_close_is_answered_on_the_mesh(limit, options):
    found, made = _case_model(limit, **options)
    answer = found.survey(P, fields=True, partial=True, last=2)
    np.testing.assert_array_equal(answer.computed, [[0, 0, np.nan], [np.nan, 1, np.nan]])
    assert (found.by_reduced, found.by_model, found.worst, len(made)) == (0, 1, 0.0, 1)
    found.survey(P, fields=False)
    assert found.by_model == 2
    assert [whole.asked for whole in made] == [[(True, True, 2), (False, False, 3)]]


def test_the_worst_is_the_largest_part_of_a_limit():
    found, _ = _case_model(_limits(a3=0.4, b2=0.25, a1=3.0))
    found.survey(P, fields=False)
    assert found.worst == pytest.approx(0.8)


def test_parameters_that_it_does_not_answer_are_for_the_mesh():
    found, made = _case_model(NONE)
    assert found.admissible(P) is None
    assert not made
    assert found.admissible(np.array([2.0, 1.0])) is None  # the mesh answers
    assert found.admissible(np.array([4.0, 1.0])) == "far too much"
    found.survey(np.array([2.0, 1.0]), fields=False)
    assert (found.by_reduced, found.by_model) == (0, 1)


def test_what_it_hands_on_and_what_it_knows_itself():
    found, made = _case_model(NONE)
    assert found.names == ("x", "y")
    assert found.case.stage_names == STAGES
    assert found.values(P) == {"x": 0.5, "y": 2.0}
    assert found.unreadable("a", "two") is None
    np.testing.assert_array_equal(
        found.steps([("a", "three"), ("b", "two")]).T, [[0, 0, 1, 1], [1, 1, 1, 0]]
    )
    assert found.response(()).admissible(P) is None
    assert not made
    assert found.unreadable("b", "one") == "b at one: gone"
    assert found.response([("a", "one")], [3.0]) == ([("a", "one")], [3.0])
    assert (found.n_dofs, found.notes) == ((1, 2), ("a note",))
    assert found.counts == Counts(5, 1, 4, 40)
    assert len(made) == 1


def test_who_asks_for_states_is_told_by_the_mesh():
    states = []
    found, made = _case_model(NONE)
    found.on_state = states.append
    assert not made
    found.whole.on_state(3)
    found.on_state = None
    found.whole.on_state(4)
    assert states == [3]


def _march(**changes):
    """What is asked of a march of two states whether it has a reduced model."""
    one = SimpleNamespace(name="one", base=0, stressed=(), release={}, leaving=frozenset())
    two = SimpleNamespace(name="two", base=1, stressed=("bolts",), release={3: 0.5},
                          leaving=frozenset({4}))  # fmt: skip
    stage = {"name": "one", "supports": (), "temperature": {}}
    given = {"parameters": ("E",), "fields": (), "growths": (), "moved": None, "yields": False,
             "states": (one, two), "stages": (SimpleNamespace(**stage),), **changes}  # fmt: skip
    rock = SimpleNamespace(yields=given["yields"])
    return SimpleNamespace(
        case=SimpleNamespace(parameters=given["parameters"], materials={"rock": rock},
                             growths=given["growths"], stages=given["stages"]),
        sequence=SimpleNamespace(materials=("rock",), states=given["states"]),
        on_mesh=SimpleNamespace(fields=given["fields"]),
        motions=SimpleNamespace(moved=lambda: given["moved"]),
    )  # fmt: skip


def _state(**changes):
    start = {"name": "two", "base": 1, "stressed": (), "release": {}, "leaving": frozenset()}
    return SimpleNamespace(**{**start, **changes})


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"parameters": ()}, "nothing is sought"),
        ({"yields": True}, "rock yields: its stresses are not linear in the displacements"),
        ({"fields": (SimpleNamespace(constant="E", material="rock"),)}, "E of rock is a field"),
        ({"growths": (SimpleNamespace(words="E grows with depth"),)}, "E grows with depth"),
        ({"states": (_state(stressed=("bolts",)), _state(stressed=("struts", "bolts")))},
         "the bars of 'bolts' are stressed more than once"),
        ({"moved": "wall"}, "the support 'wall' is moved"),
        ({"stages": (SimpleNamespace(name="hold", supports=("x",), temperature={}),)},
         "the stage 'hold' changes what is held"),
        ({"stages": (SimpleNamespace(name="fire", supports=(), temperature={"rock": 9.0}),)},
         "the stage 'fire' changes temperatures"),
        ({"states": (_state(release={3: 0.5}, leaving=frozenset({3})),)},
         "the stage 'two' releases in part the stress of ground that other stages have changed "
         "before"),
        ({"states": (_state(base=0, release={3: 0.5}, leaving=frozenset({3})),)}, None),
        ({}, None),
    ],
)  # fmt: skip
def test_why_a_march_has_no_reduced_model(changes, why):
    assert reduction_obstacle(_march(**changes)) == why


def test_whether_any_stage_releases_in_part():
    assert releases(_march())
    assert not releases(_march(states=(_state(), _state(stressed=("bolts",)))))


def test_channels_of_stresses_by_points_and_by_rows():
    """Three channels that read stresses at five points."""
    weights = np.random.default_rng(4).standard_normal((3, 4, 5))
    rows = StressRows(np.array([6, 2, 9]), np.array([3, 8, 11, 20, 21]), weights)
    points, some = rows.at(np.array([1, 8, 20, 30]))
    assert points.tolist() == [8, 20]
    np.testing.assert_array_equal(some, weights[:, :, [1, 3]])
    assert rows.at(np.array([], dtype=np.int64))[1].shape == (3, 4, 0)
    assert rows.of(np.array([9, 5, 2, 9, 6, 0])).tolist() == [2, -1, 1, 2, 0, -1]


def _restored(**kept):
    """A kept model of which only its domain and its readings are there."""
    made = RestoredModel.__new__(RestoredModel)
    made.kept = SimpleNamespace(
        names=("x", "y"), lower=np.array([1.0, -4.0]), upper=np.array([3.0, 6.0]), **kept
    )
    made.case, made._ground = None, None
    made._place = {("a", "one"): 1, ("b", "two"): 0}
    return made


@pytest.mark.parametrize(
    ("p", "why"),
    [
        ((1.0 - 1.9e-9, 6.0 + 9e-9), None),  # a thousand-millionth of the range is rounding
        ((1.0 - 2.1e-9, 0.0), "x is beyond the bounds with which the reduced model was made"),
        ((3.0 + 2.1e-9, 0.0), "x is beyond the bounds with which the reduced model was made"),
        ((3.0 + 1.9e-9, -4.0 - 9e-9), None),
        ((2.0, -4.0 - 1.1e-8), "y is beyond the bounds with which the reduced model was made"),
        ((2.0, 6.0 + 1.1e-8), "y is beyond the bounds with which the reduced model was made"),
        ((2.0, np.nan), "a parameter is not finite"),
        ((-np.inf, 0.0), "a parameter is not finite"),
        ((2.0, 5.5), "y is impossible"),
    ],
)
def test_parameters_that_a_kept_model_does_not_answer(p, why, monkeypatch):
    def numbers(case, ground, values):
        assert set(values) == {"x", "y"}
        return "y is impossible" if values["y"] == 5.5 else None

    monkeypatch.setattr("geoident.forward.reduced.kept.inadmissible_numbers", numbers)
    assert _restored().admissible(np.array(p)) == why


def test_which_readings_a_kept_model_gives():
    made = _restored()
    assert made.pairs == (("a", "one"), ("b", "two"))
    assert made.covers([("b", "two")])
    assert made.covers([])
    assert not made.covers([("b", "two"), ("b", "one")])
    assert made.names == ("x", "y")


def test_arrays_are_found_by_what_they_are_and_what_they_are_about():
    """As they are packed: by state and material, by material, by both numbers."""
    packed = _Packed(("rock", "clay"))
    packed._add("one", 7.0)
    packed._add("of two", np.arange(3), 1, 4)
    packed._add_all("by-both", {(3, "clay"): np.ones(2), (1, "rock"): np.zeros(1)}, 9)
    packed._add_all("by-both", {(3, "clay"): np.ones(5)}, 8)
    packed._add_all("by-material", {"clay": np.full(2, 4.0)}, 9, 2)
    assert sorted(packed.blocks) == [
        "by-both 8 3 1", "by-both 9 1 0", "by-both 9 3 1", "by-material 9 2 1", "of two 1 4", "one",
    ]  # fmt: skip
    assert all(block.dtype == np.float64 for block in packed.blocks.values())
    blocks = {name.replace("of two", "two"): block for name, block in packed.blocks.items()}
    found = _Blocks(SimpleNamespace(materials=("rock", "clay"), blocks=blocks))
    assert found.one("one") == 7.0
    assert found.whole("one") == 7
    np.testing.assert_array_equal(found.one("two", 1, 4), [0, 1, 2])
    assert found.get("two", 1, 5) is None
    assert found.get("three") is None
    terms = found.terms("by-both", 9)
    assert {key: len(block) for key, block in terms.items()} == {(3, "clay"): 2, (1, "rock"): 1}
    assert {key: len(b) for key, b in found.terms("by-both", 8).items()} == {(3, "clay"): 5}
    assert list(found.materials("by-material", 9, 2)) == ["clay"]
    assert found.materials("by-material", 9, 3) == {}
    assert found.terms("nothing", 1) == {}


def test_stages_that_are_packed_are_found_as_they_were():
    """Also the materials that change in one, by pairs; random arrays of unequal sizes."""
    model = summed_model()
    packed = _Packed(tuple(model.form.spans))
    for number, stage in enumerate(model.stages):
        packed.stage(number, stage)
    found = _Blocks(SimpleNamespace(materials=tuple(model.form.spans), blocks=packed.blocks))
    assert [len(stage.changes) for stage in model.stages] == [0, 0, 0, 2]
    for number, stage in enumerate(model.stages):
        _assert_same(found.stage(number), stage)


def _assert_same(one, other):
    if isinstance(other, np.ndarray):
        np.testing.assert_array_equal(one, other)
    elif is_dataclass(other):
        _assert_same(vars(one), vars(other))
    elif isinstance(other, dict):
        assert set(one) == set(other)
        for key, part in other.items():
            _assert_same(one[key], part)
    elif isinstance(other, tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            _assert_same(a, b)
    else:
        assert one == other
