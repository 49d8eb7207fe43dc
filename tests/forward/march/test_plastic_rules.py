"""What a plastic stage does where its equilibrium fails: parts of a load, the arc, what is said."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import CollapseError, ModelError
from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.yielding.domain import EmptyDomain, NoProjection
from geoident.forward.march import plastic_step
from geoident.forward.march.bands import ShearBand
from geoident.forward.march.collapse import Limit
from geoident.forward.march.equilibrium import Balance
from geoident.forward.march.plastic_step import PlasticFindings, PlasticSteps, yielded_points
from geoident.forward.march.stage_equations import EvenFlow, NoEquilibrium, Trial

FORCES, CARRIED = np.array([10.0, -3.0]), np.array([2.0, 1.0])


def trial(du, *flows, stress=7.0):
    return Trial(np.array(du), np.full((3, 4), stress), flows, np.zeros(2), 1.0)


class Stage:
    """Equations that remember under which forces they are, and where they were asked."""

    associated = False

    def __init__(self, forces=FORCES, flows=(), log=None):
        self.forces, self.flows = forces, flows
        self.log = [] if log is None else log
        self.operators = SimpleNamespace(n_points=4)

    def before(self):
        return CARRIED

    def under(self, forces):
        return Stage(forces, self.flows, self.log)

    def viscous(self, part):
        self.log.append(("viscous", part))
        return self

    def at(self, du):
        return trial(du)

    def flowing(self, trial):
        return self.flows


def flow(points, multipliers):
    found = np.array(multipliers)
    return SimpleNamespace(points=np.array(points), flowing=(found > 0.0).any(axis=1))


TASK = SimpleNamespace(state=SimpleNamespace(name="dig"), system="system", motion=None)
MOVED = SimpleNamespace(state=SimpleNamespace(name="dig"), system="system", motion=np.zeros((2, 1)))


@pytest.fixture
def steps(monkeypatch):
    """Steps whose strains are ten times the displacements, and whose collapses are told in full."""
    found = object.__new__(PlasticSteps)
    points = SimpleNamespace(strain=lambda du: 10.0 * np.tile(du[:1], (3, 4)))
    found.systems = SimpleNamespace(
        discretization=SimpleNamespace(points=points), on_mesh="mesh",
        describe_unknown=lambda system, unknown: f" at unknown {unknown} of {system}",
    )  # fmt: skip
    found.explain, found.even_only = True, False
    found.equations = Stage()
    found._equations = lambda task, grounds: found.equations

    def told(on_mesh, task, fraction, mechanism, **more):
        error = CollapseError("collapse", "", stage=task.state.name, fraction=fraction)
        error.told = {"fraction": fraction, "mechanism": mechanism, **more}
        return error

    monkeypatch.setattr(plastic_step, "collapse_error", told)
    return found


def balance(du):
    return Balance(trial(du), 3, None, None)


# --- the part of a load that is carried ---


@pytest.mark.parametrize("limit", [True, False])
def test_the_part_of_a_load_is_halved_to_a_five_hundredth(steps, monkeypatch, limit):
    """0.37 of the change from (2, 1) to (10, -3) is carried; each start is the last equilibrium."""
    asked = []

    def solve(equations, guesses, *, even_only, effort):
        part = (equations.forces - CARRIED) / (FORCES - CARRIED)
        assert part[0] == pytest.approx(part[1])
        asked.append((part[0], [guess.tolist() for guess in guesses], even_only, effort))
        if part[0] > 0.37:
            raise NoEquilibrium(np.array([part[0], 0.0]), limit=limit)
        return balance([0.01 * part[0], 1.0])

    monkeypatch.setattr(plastic_step, "solve", solve)
    error = NoEquilibrium(None, limit=limit)
    part, reached, failed = steps._carried_part(TASK, (), error)
    parts = [one[0] for one in asked]
    assert parts[:4] == pytest.approx([0.5, 0.25, 0.375, 0.3125])
    assert len(parts) == 9
    assert part == pytest.approx(189 / 512)
    np.testing.assert_allclose(reached.u, [0.01 * part, 1.0])
    assert (reached.stress == 7.0).all()
    assert asked[0][1] == [[0.0, 0.0], [0.0, 0.0]]
    np.testing.assert_allclose(asked[2][1], [[0.0, 0.0], [0.0025, 1.0]])
    assert {one[2] for one in asked} == {not limit}
    if limit:
        assert {one[3] for one in asked} == {None}
    else:
        assert asked[0][3].left == 80
        assert all(one[3] is asked[0][3] for one in asked)
    last = min(p for p in parts if p > 0.37)
    assert failed.mechanism[0] == pytest.approx(last)


def test_a_spent_effort_ends_the_halving(steps, monkeypatch):
    def solve(equations, guesses, *, even_only, effort):
        if effort is not None:
            effort.left -= 40
        raise NoEquilibrium(None)

    monkeypatch.setattr(plastic_step, "solve", solve)
    error = NoEquilibrium(np.ones(2))
    part, reached, failed = steps._carried_part(TASK, (), error)
    assert (part, reached) == (0.0, None)
    assert failed is error


def test_a_mechanism_under_a_part_counts_where_it_is_sure(steps, monkeypatch):
    """Of the whole load it was found to move without end: what wanders under a part says less."""
    for sure, counts in ((True, True), (False, False)):

        def solve(*args, sure=sure, **kwargs):
            raise NoEquilibrium(np.ones(2), limit=sure)

        monkeypatch.setattr(plastic_step, "solve", solve)
        error = NoEquilibrium(np.zeros(2), limit=True)
        _, _, failed = steps._carried_part(TASK, (), error)
        assert (failed is not error) == counts


@pytest.mark.parametrize(("du", "carried"), [(0.099, True), (0.101, False), (-0.101, False)])
def test_equilibria_of_large_strains_mean_nothing(steps, monkeypatch, du, carried):
    """Strains of 1 where ground flows; elsewhere they may be."""
    steps.equations = Stage(flows=[flow([1, 2], [[1.0], [0.0]])])
    monkeypatch.setattr(plastic_step, "solve", lambda *_, **__: balance([du, 0.0]))
    part, reached, _ = steps._carried_part(TASK, (), NoEquilibrium(None, limit=True))
    assert (part > 0.99) == carried
    assert (reached is not None) == carried
    if carried:
        assert reached.yielded.tolist() == [False, True, False, False]
    steps.equations = Stage()
    assert steps._carried_part(TASK, (), NoEquilibrium(None, limit=True))[0] > 0.99


def test_points_yield_that_have_a_positive_multiplier():
    stage = Stage(flows=[flow([3], [[0.0, 0.0]]), flow([0, 2], [[0.0, 2.0], [0.0, 0.0]])])
    assert yielded_points(stage, None).tolist() == [True, False, False, False]


# --- after the limit ---


@pytest.mark.parametrize("task", [TASK, MOVED])
def test_the_arc_says_what_part_is_carried(steps, monkeypatch, task):
    """With a motion that supports impose the part is not known."""
    monkeypatch.setattr(plastic_step, "limit_of", lambda equations: Limit(0.4, np.ones(2)))
    with pytest.raises(CollapseError) as caught:
        steps._after_limit(task, steps.equations, NoEquilibrium(np.array([5.0, 6.0])))
    told = caught.value.told
    assert told["mechanism"].tolist() == [5.0, 6.0]
    if task is MOVED:
        assert np.isnan(told["fraction"])
        assert "reached" not in told
    else:
        assert told["fraction"] == 0.4
        assert told["reached"].u.tolist() == [1.0, 1.0]


def test_the_arc_may_lead_to_the_whole_load(steps, monkeypatch):
    monkeypatch.setattr(plastic_step, "limit_of", lambda equations: Limit(1.0, np.ones(2)))
    asked = []

    def solve(equations, guesses):
        asked.append([guess.tolist() for guess in guesses])
        return "balance"

    monkeypatch.setattr(plastic_step, "solve", solve)
    found = steps._after_limit(TASK, steps.equations, NoEquilibrium(None))
    assert (found, asked) == ("balance", [[[1.0, 1.0]]])

    def lost(equations, guesses):
        raise NoEquilibrium(np.array([8.0, 9.0]))

    monkeypatch.setattr(plastic_step, "solve", lost)
    with pytest.raises(CollapseError) as caught:
        steps._after_limit(TASK, steps.equations, NoEquilibrium(np.zeros(2)))
    assert caught.value.told["mechanism"].tolist() == [8.0, 9.0]
    assert np.isnan(caught.value.told["fraction"])


# --- the balance of a stage ---


class Associated(Stage):
    associated = True


def balanced(steps, found, equations=None, columns=3, guesses=((1.0, 2.0),)):
    """What is asked of the solver, and what comes of its answer."""
    asked = []

    def solve(equations, starts, *, even_only):
        asked.append(([start.tolist() for start in starts], even_only))
        if isinstance(found, Exception):
            raise found
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plastic_step, "solve", solve)
        task = SimpleNamespace(**TASK.__dict__, forces=np.zeros((2, columns)))
        starts = [np.array(guess) for guess in guesses]
        try:
            return asked, steps._balance(task, equations or steps.equations, starts)
        except (ModelError, NoEquilibrium) as error:
            return asked, error


def test_a_stage_starts_from_rest_and_from_what_is_known(steps):
    found = balance([0.01, 0.0])
    asked, answer = balanced(steps, found)
    assert answer is found
    assert asked == [([[0.0, 0.0], [1.0, 2.0]], False)]
    steps.even_only = True
    asked, _ = balanced(steps, found, columns=1, guesses=())
    assert asked == [([[0.0, 0.0]], True)]


@pytest.mark.parametrize("met", ["the stage", "what is left of it", "a part of its load"])
@pytest.mark.parametrize(
    ("lost", "message", "hint"),
    [
        (
            NotPositiveDefinite(17),
            "at stage 'dig' the stiffness matrix is not positive definite at unknown 17 of system",
            None,
        ),
        (
            EmptyDomain((0, 4)),
            "the yield planes of a material contradict each other: no stress satisfies the yield "
            "planes 1, 5 at once",
            "Raise their distances k (start values or bounds).",
        ),
        (
            NoProjection(6),
            "at stage 'dig' the projection of 6 points on the yield planes did not end: planes of "
            "a material that nearly coincide",
            "Leave out planes that are the same but for little, or move them apart.",
        ),
    ],
)
def test_what_keeps_a_stage_from_being_solved_is_told(steps, monkeypatch, met, lost, message, hint):
    """Whether it is met by the stage, on the arc beyond its limit, or under a part of its load."""

    def solve(equations, starts, **more):
        raise lost if met == "the stage" else NoEquilibrium(np.ones(2))

    def fails(*_):
        raise lost

    monkeypatch.setattr(plastic_step, "grounds_of", lambda task, laws: "grounds")
    monkeypatch.setattr(plastic_step, "impose_motion", lambda task, systems: None)
    monkeypatch.setattr(plastic_step, "solve", solve)
    monkeypatch.setattr(plastic_step, "limit_of", fails)
    steps._laws, steps._carried_part = None, fails
    steps.warm = SimpleNamespace(guesses=lambda task: [])
    if met != "a part of its load":
        steps.equations = Associated()
    with pytest.raises(ModelError) as caught:
        steps.step(SimpleNamespace(**TASK.__dict__, forces=np.zeros((2, 1))))
    assert not isinstance(caught.value, CollapseError)
    assert caught.value.message == message
    assert hint in (None, caught.value.hint)
    assert caught.value.__cause__ is lost


@pytest.mark.parametrize("explain", [True, False])
def test_collapse_is_explained_to_those_who_ask(steps, monkeypatch, explain):
    steps.explain = explain
    monkeypatch.setattr(plastic_step, "limit_of", lambda equations: Limit(0.4, np.ones(2)))
    _, error = balanced(steps, NoEquilibrium(np.array([3.0, 4.0])), Associated())
    assert isinstance(error, CollapseError)
    assert error.told["mechanism"].tolist() == [3.0, 4.0]
    assert (error.told["fraction"] == 0.4) == explain
    lost = NoEquilibrium(np.ones(2))
    _, error = balanced(steps, lost)
    assert error is lost
    far = Associated(flows=[flow([0], [[1.0]])])
    _, error = balanced(steps, balance([0.2, 0.0]), far)
    assert error.told["mechanism"].tolist() == [0.2, 0.0]


# --- what is said of flow without potential ---


@pytest.mark.parametrize("explain", [True, False])
@pytest.mark.parametrize("task", [TASK, MOVED])
def test_lost_flow_is_told_with_its_band_and_its_part(steps, monkeypatch, explain, task):
    error = NoEquilibrium(np.ones(2), even=EvenFlow(trial([1.0, 1.0]), 0.02))
    monkeypatch.setattr(plastic_step, "grounds_of", lambda task, laws: "grounds")
    band, other = ShearBand(np.ones(2), 3, 4, -0.1), NoEquilibrium(np.full(2, 9.0))
    asked = []

    def band_at(equations, trial):
        asked.append((equations, trial))
        return band

    def solved(task, grounds):
        raise error

    monkeypatch.setattr(plastic_step, "band_at", band_at)
    steps._laws, steps._solved, steps.explain = None, solved, explain
    steps._carried_part = lambda task, grounds, error: (0.3, "reached", other)
    with pytest.raises(CollapseError) as caught:
        steps.step(task)
    told = caught.value.told
    assert told["ended"] is error.even
    assert told["proven"] is False
    assert told["band"] is (band if explain else None)
    known = explain and task is TASK
    assert told["mechanism"].tolist() == ([9.0, 9.0] if known else [1.0, 1.0])
    assert told["reached"] == ("reached" if known else None)
    assert (told["fraction"] == 0.3) == known
    if explain:
        assert steps.equations.log == [("viscous", 0.02)]
        assert asked == [(steps.equations, error.even.trial)]
    steps.even_only = True
    with pytest.raises(ModelError) as caught:
        steps.step(task)
    assert not isinstance(caught.value, CollapseError)
    error.limit = True
    with pytest.raises(CollapseError) as caught:
        steps.step(task)
    assert caught.value.told["proven"] == (not known)


@pytest.mark.parametrize("explain", [True, False])
def test_where_shear_goes_into_bands_is_said_in_words(steps, monkeypatch, explain):
    steps.explain = explain
    steps.equations.localising = lambda trial: 0.25
    monkeypatch.setattr(plastic_step, "describe_mechanism", lambda *args: f" there {args[2][0]:g}")
    for band in (None, ShearBand(np.full(2, 6.0), 3, 40, -0.1)):
        monkeypatch.setattr(plastic_step, "band_at", lambda *_, band=band: band)
        found = Balance(trial([1.0, 1.0]), 1, None, None, viscosity=1e-3, short=0.07)
        said = steps._localisation(TASK, steps.equations, found)
        assert (said.part, said.short) == (0.25, 0.07)
        assert said.band == (
            "a band has lost its stability, with half of its strain in 3 of the 40 strain points "
            "that yield there 6"
            if explain and band is not None
            else ""
        )


@pytest.mark.parametrize("motion", [None, np.array([[0.5, 0.25], [0.0, 2.0]])])
@pytest.mark.parametrize(
    ("unbalanced", "viscosity"), [(0.0, 0.0), (0.004, 0.0), (0.0, 2e-3), (0.003, 1e-4)]
)
@pytest.mark.parametrize("columns", [1, 2])
def test_what_a_stage_finds_is_noted(steps, monkeypatch, motion, unbalanced, viscosity, columns):
    """Steps with what supports impose, derivatives where they are wanted, and what is left over."""
    order, kept = [], []
    findings = PlasticFindings(planes=None)
    steps.findings = findings
    steps.warm = SimpleNamespace(
        guesses=lambda task: "guesses", keep=lambda task, du: kept.append(du.copy())
    )
    steps.equations = Stage(flows=[flow([2], [[1.0]])])
    found = Balance(trial([3.0, 4.0]), 1, None, None, unbalanced, viscosity)
    steps._balance = lambda task, equations, guesses: order.append(guesses) or found
    steps._accept = lambda task, equations, trial: order.append(trial)
    steps._localisation = lambda task, equations, balance: "bands"
    monkeypatch.setattr(plastic_step, "impose_motion", lambda task, systems: order.append("moved"))
    slopes = np.array([[7.0], [8.0]])
    monkeypatch.setattr(
        plastic_step, "plastic_derivatives", lambda *_: order.append("dp") or slopes
    )
    task = SimpleNamespace(
        state=SimpleNamespace(name="dig"), forces=np.zeros((2, columns)),
        motion=None if motion is None else motion[:, :columns],
    )  # fmt: skip
    du, yielded = steps._solved(task, "grounds")
    expected = np.array([[3.0, 7.0], [4.0, 8.0]])[:, :columns]
    np.testing.assert_array_equal(kept[0], expected)
    np.testing.assert_array_equal(
        du, expected if motion is None else expected + motion[:, :columns]
    )
    assert order == ["moved", "guesses", *(["dp"] if columns > 1 else []), found.trial]
    assert yielded.tolist() == [False, False, True, False]
    assert steps.equations.log == [("viscous", viscosity)]
    assert findings.unbalanced == ({"dig": unbalanced} if unbalanced else {})
    assert findings.overstressed == ({"dig": viscosity} if viscosity else {})
    assert findings.localising == ({"dig": "bands"} if unbalanced or viscosity else {})
