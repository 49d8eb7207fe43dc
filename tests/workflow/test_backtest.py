"""Fits of the first stages and their predictions: right, counted, and as long as readings allow."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import ExitCode, InputError, Interrupted
from geoident.forward.model import StagedModel
from geoident.forward.reducible import ReducibleResponse
from geoident.io.result.file import read_result
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions
from geoident.model.results.findings import sentences_of
from geoident.report.text.backtest import fits_table
from geoident.workflow.backtest import backtest, ending
from geoident.workflow.estimating import mesh_error, search
from geoident.workflow.estimating.setup import prepare, problem_of
from geoident.workflow.fit import fit
from geoident.workflow.running.control import OUT_OF_TIME, Control, Monitor
from geoident.workflow.running.evaluation_log import carry_over
from geoident.workflow.running.jobs import Request, plan_backtest, plan_fit
from geoident.workflow.scoring.trials import NEARBY, near_answer, up_to
from geoident.workflow.scoring.verdict import settling
from tests.support.lifts import (
    CASE,
    LIFTS,
    SAME,
    TWO_ROCKS,
    readings_of,
    write_case,
    write_readings,
)

WITH_MESH = "fit.mesh_error=true"


class Kept(dict):
    """A log in memory."""

    def find(self, kind, p):
        return self.get((kind, p.tobytes()))

    def add(self, kind, p, arrays):
        self[kind, p.tobytes()] = arrays


@pytest.fixture
def pit(tmp_path, monkeypatch):
    """A case with readings of its own model, in the current folder."""
    monkeypatch.chdir(tmp_path)
    path = write_case(tmp_path)
    write_readings(tmp_path, readings_of(path, SAME, seed=1))
    return tmp_path


def run(*overrides, control=None, **options):
    request = Request("case.yaml", overrides=overrides, **options)
    return backtest(plan_backtest(request), control or Control()).result


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    """The folder of a case with readings of its own model, and its backtest as it is by itself."""
    folder = tmp_path_factory.mktemp("right")
    write_readings(folder, readings_of(write_case(folder), SAME, seed=1))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return folder, run()


@pytest.fixture
def whole(right):
    """The backtest of the case of `pit`, which several tests look at."""
    return right[1]


def of(result, last):
    """The step whose last fitted stage this is."""
    return next(s for s in result.backtest.steps if result.gauges.stages[s.last] == last)


class TestARightModel:
    def test_has_bands_that_hold(self, whole):
        found = whole
        assert (found.kind, found.status, found.exit_code) == ("backtest", "done", ExitCode.DONE)
        assert found.reason.startswith("The 95 % bands hold")
        assert found.backtest.next.readings == 15
        assert found.backtest.next.coverage >= 0.8
        assert [step.readings for step in found.backtest.steps] == [3, 8, 13, 18]
        assert not any("is not constant" in text for text in sentences_of(found.findings))
        assert sum(" is constant within its intervals: " in note for note in found.notes) == 2

    @pytest.mark.slow  # another seed is what `whole` was made of
    @pytest.mark.parametrize("seed", [1007, 1011])
    def test_settles_where_a_fit_gains_little_on_the_one_before(self, pit, seed):
        """Lift 4 takes 7 % off the variance of K0: that of its change is a small difference."""
        write_readings(pit, readings_of(pit / "case.yaml", SAME, seed=seed))
        assert not any("is not constant" in text for text in sentences_of(run().findings))

    def test_intervals_shrink_as_readings_are_added(self, whole):
        widths = np.array([s.upper95 - s.lower95 for s in whole.backtest.steps])
        assert (np.diff(widths, axis=0) < 0.0).all()

    def test_each_step_is_the_fit_of_its_stages(self, pit, whole):
        """It may start elsewhere, but it ends where a fit of these stages ends.

        What the mesh does is asked once, at the answer for other stages.
        """
        request = Request("case.yaml", overrides=("fit.stages=[lift 1, lift 2]",))
        alone = fit(plan_fit(request), Control()).result
        step = of(whole, "lift 2")
        assert step.values == pytest.approx(alone.parameters.values, rel=1e-5)
        assert step.sd == pytest.approx(alone.parameters.sd, rel=1e-4)
        later = np.s_[:, 2:]
        for name in ("mean", "lower95", "upper95"):
            ours, theirs = (getattr(p, name)[later] for p in (step.prediction, alone.prediction))
            assert ours == pytest.approx(theirs, rel=1e-4, abs=1e-8, nan_ok=True)

    def test_stages_after_those_of_fit_stages_are_taken(self, pit):
        found = run("fit.stages=[lift 1, lift 2]")
        assert [found.gauges.stages[s.last] for s in found.backtest.steps] == list(LIFTS)

    def test_a_stage_left_out_on_purpose_takes_no_part(self, pit):
        found = run("fit.stages=[lift 1, lift 3]")
        assert [found.gauges.stages[s.last] for s in found.backtest.steps] == [
            "lift 1", "lift 3", "lift 4",
        ]  # fmt: skip
        assert np.isnan(found.backtest.measured[:, 1]).all()
        assert any("left out of fit.stages" in note for note in found.notes)


@pytest.fixture(scope="module")
def two_rocks(tmp_path_factory):
    """The folder of a case with readings of ground that has two moduli."""
    folder = tmp_path_factory.mktemp("two-rocks")
    write_readings(folder, readings_of(write_case(folder), TWO_ROCKS, seed=1))
    return folder


@pytest.fixture(scope="module")
def wrong(two_rocks):
    """Its backtest."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(two_rocks)
        return run()


class TestOtherPhysics:
    """One side of the pit is three times as stiff, which the model does not know."""

    def test_the_bands_do_not_hold_and_it_is_said(self, wrong):
        assert (wrong.status, wrong.exit_code) == ("bands-fail", ExitCode.NOT_CONVERGED)
        assert "bands do not hold" in wrong.reason
        assert wrong.backtest.few < 0.01
        assert wrong.backtest.next.coverage < 0.7

    def test_the_reading_that_is_farthest_off_is_named(self, wrong):
        assert "Farthest off: X" in wrong.reason

    def test_a_fit_says_it_too(self, two_rocks, monkeypatch):
        monkeypatch.chdir(two_rocks)
        found = fit(plan_fit(Request("case.yaml")), Control()).result
        said = [
            text for text in sentences_of(found.findings) if text.startswith("Backtest of lift 4")
        ]
        assert len(said) == 1
        assert "do not hold" in said[0]
        assert len(found.backtest.steps) == 1


def test_a_fit_too_early_for_a_model_error_does_not_fail_the_others(pit):
    """Three readings of lift 1 cannot tell it, so their bands of lift 2 are too narrow."""
    write_readings(pit, readings_of(pit / "case.yaml", TWO_ROCKS, seed=1))
    found = run("fit.model_error=estimate")
    assert min(found.backtest.few, found.backtest.far) < 0.01  # of all together
    assert (found.status, found.exit_code) == ("done", ExitCode.DONE)
    assert "10 of 10 readings" in found.reason
    assert "from the readings up to lift 1 alone are not counted" in found.reason


def test_a_parameter_that_every_stage_wants_otherwise_does_not_settle(pit):
    """Rock that is weaker with every lift: its modulus drifts, and that is said."""
    rows = []
    for k, E in enumerate((8.0, 5.0, 3.0, 1.8)):
        truth = (f"parameters.E.start={E} GPa", SAME[1])
        rows += [r for r in readings_of(pit / "case.yaml", truth, seed=2) if r[1] == LIFTS[k]]
    write_readings(pit, rows)
    found = run()
    said = [text for text in sentences_of(found.findings) if text.startswith("E is not constant")]
    assert len(said) == 1
    assert "always downwards" in said[0]
    assert " GPa up to lift 1, " in said[0]
    assert found.exit_code == ExitCode.NOT_CONVERGED


def settled(right, first, lower):
    """What is said of E, Pa, after a first fit with an interval to 14.2 GPa and three to 10 GPa."""
    folder, whole = right
    case = plan_backtest(Request(str(folder / "case.yaml"))).inputs.case
    steps = []
    for step, E in zip(whole.backtest.steps, (first, 10e9, 10.1e9, 10e9), strict=True):
        K0 = step.values[1]
        ends = (lower, 14.2e9) if first == E else (0.96 * E, 1.04 * E)
        low, value, high = (np.array([end, K0]) for end in (ends[0], E, ends[1]))
        steps.append(replace(step, values=value, lower95=low, upper95=high))
    variances = np.outer([8e-4, 6e-4, 5e-4, 4e-4], [1.0, 1.0])
    restless, others = settling(case, steps, variances, estimated=False)
    return next(text for text in (*sentences_of(restless), *others) if text.startswith("E "))


@pytest.mark.parametrize(("lower", "said"), [(8e9, "E is constant"), (13.5e9, "E is not constant")])
def test_what_settles_is_judged_by_intervals_that_are_long_for_good_reason(right, lower, said):
    """A first answer on its bound, far from the later ones, with an interval that holds them."""
    assert settled(right, 14e9, lower).startswith(said)


class TestCost:
    def test_fits_between_begin_at_the_answer_before(self, whole):
        first, *between, _ = (s.counts.evaluations for s in whole.backtest.steps)
        assert max(between) < first

    def test_a_fit_adds_a_few_evaluations_of_the_stages_before_its_last(self, pit):
        plain = fit(plan_fit(Request("case.yaml", ("fit.backtest=false",))), Control()).result
        both = fit(plan_fit(Request("case.yaml", output="both.h5")), Control()).result
        step = both.backtest.steps[0]
        assert plain.backtest is None
        assert step.counts.evaluations <= 3  # the first is part of one that the fit has made
        assert both.parameters.values == pytest.approx(plain.parameters.values, rel=1e-12)

    def test_what_a_fit_carries_over_is_what_its_backtest_would_compute(self, pit):
        job = plan_fit(Request("case.yaml"))
        setup = prepare(job)
        stages = np.array([LIFTS.index(s) for s in setup.readings.stage])
        p, all_log, some_log = np.array([5e9, 1.5]), Kept(), Kept()
        problem_of(setup, all_log, Control()).response.evaluate(p)
        some = problem_of(up_to(setup, 2), some_log, Control()).response
        carry_over(all_log.find("evaluate", p), some_log, p, stages[setup.readings.used] <= 2, 4)
        carried = some.evaluate(p), some.increments(p)
        assert setup.model.counts.evaluations == 1
        fresh = problem_of(up_to(setup, 2), Kept(), Control()).response
        (v, J), increments = fresh.evaluate(p), fresh.increments(p)
        np.testing.assert_array_equal(carried[0][0], v)
        np.testing.assert_array_equal(carried[0][1], J)
        np.testing.assert_array_equal(carried[1], increments)

    def test_the_mesh_is_asked_once_however_many_fits_there_are(self, pit, monkeypatch):
        """Where it does not count, by the first fit for its stages and by the second for all."""
        made, found = [], []
        real = mesh_error.halved
        monkeypatch.setattr(mesh_error, "halved", lambda mesh: made.append(1) or real(mesh))
        rough = tuple(f"gauges.{g}.accuracy=2 mm" for g in ("CV", "SL", "SR", "XL", "XR"))
        for overrides, asked in (((), 1), (rough, 2)):
            made.clear()
            found.append(run(WITH_MESH, *overrides, force=True).backtest.steps)
            assert len(found[-1]) == 4
            assert len(made) == asked
        made.clear()
        fit(plan_fit(Request("case.yaml", (WITH_MESH,))), Control())  # with its own backtest
        assert len(made) == 1


class TestWhatReadingsAllow:
    def test_too_few_readings_for_a_small_k_are_skipped_and_said(self, pit):
        rows = [
            row for row in readings_of(pit / "case.yaml", SAME, seed=1)
            if row[1] != "lift 1" or row[0] == "CV"
        ]  # fmt: skip
        write_readings(pit, rows)
        found = run()
        assert [found.gauges.stages[s.last] for s in found.backtest.steps] == list(LIFTS[1:])
        assert found.backtest.skipped[0].stage == "lift 1"
        assert any("No fit of the readings up to lift 1: 1 usable" in note for note in found.notes)

    def test_a_fit_says_why_it_has_no_backtest(self, pit):
        rows = readings_of(pit / "case.yaml", SAME, seed=1)
        kept = [row for row in rows if row[1] == "lift 2" or row[:2] == ("CV", "lift 1")]
        write_readings(pit, kept)
        found = fit(plan_fit(Request("case.yaml")), Control()).result
        assert found.backtest is None
        assert any("Backtest of lift 2" in n and "none, 1 usable reading" in n for n in found.notes)

    def test_stages_without_readings_are_passed_over(self, pit):
        rows = readings_of(pit / "case.yaml", SAME, seed=1)
        write_readings(pit, [row for row in rows if row[1] != "lift 3"])
        found = run()
        assert [found.gauges.stages[s.last] for s in found.backtest.steps] == [
            "lift 1", "lift 2", "lift 4",
        ]  # fmt: skip
        assert found.backtest.next.readings == 10  # of lift 2, and of lift 4 from lift 2

    def test_one_stage_is_refused(self, pit):
        rows = readings_of(pit / "case.yaml", SAME, seed=1)
        write_readings(pit, [row for row in rows if row[1] == "lift 2"])
        with pytest.raises(InputError, match="one stage"):
            run()
        found = fit(plan_fit(Request("case.yaml")), Control()).result
        assert found.backtest is None
        assert not any("Backtest" in note for note in found.notes)

    def test_what_is_not_determined_is_said(self, pit):
        """Displacements know E over stress only, so with both free neither is known."""
        free = (
            "parameters.sv={start: 1 MPa, bounds: [0.1 MPa, 10 MPa], scale: log}",
            "in_situ.vertical=$sv",
        )
        found = run(*free)
        assert not of(found, "lift 4").determined[found.parameters.names.index("sv")]
        assert any("sv is determined by no fit" in note for note in found.notes)


def test_load_cases_that_branch_off_are_fitted_and_predicted(pit):
    """A load beside the first lift is a state of its own; the next lift builds on the first."""
    plate = "  - {name: plate, independent: true, loads: {P: {at: [3 m, 8 m], line_force: [0 MN/m, "
    plate += "-1 MN/m]}}}\n"
    write_case(pit, CASE.replace("  - {name: lift 2,", f"{plate}  - {{name: lift 2,"))
    write_readings(pit, readings_of(pit / "case.yaml", SAME, seed=1))
    found = run()
    names = [found.gauges.stages[s.last] for s in found.backtest.steps]
    assert names == ["lift 1", "plate", *LIFTS[1:]]
    assert found.status == "done"
    assert found.backtest.next.readings == 20


class TestAccuraciesEstimated:
    @pytest.fixture
    def inexact(self, pit):
        """Gauges of one kind that are ten times worse than they state."""
        head, _, rest = CASE.partition("gauges:")
        gauges = "".join(
            f"  S{x}: {{kind: settlement, point: [{x} m, 8 m], accuracy: 0.02 mm}}\n"
            for x in (1, 2, 3, 8, 9)
        )
        readings = rest[rest.index("readings:") :]
        write_case(pit, f"{head}gauges:\n{gauges}{readings}")
        write_readings(pit, readings_of(pit / "case.yaml", SAME, seed=1, noise=0.2))

    def test_in_every_fit(self, inexact):
        stated, found = run(output="stated.h5"), run("fit.accuracies=estimate", output="est.h5")
        wide, narrow = (of(r, "lift 3").prediction.sd[:, 3] for r in (found, stated))
        assert (wide > 3.0 * narrow).all()
        assert (stated.status, found.status) == ("bands-fail", "done")
        assert found.accuracies is not None

    def test_not_from_fewer_readings_than_tell_them(self, inexact):
        found = run("fit.accuracies=estimate")
        assert [one.stage for one in found.backtest.skipped] == ["lift 1"]
        assert "say too little of 1 accuracies" in found.backtest.skipped[0].why


def test_given_accuracies_and_a_prior_make_up_for_few_readings(pit):
    rows = readings_of(pit / "case.yaml", SAME, seed=1)
    few = [row for row in rows if row[1] == "lift 1"][:2]
    write_readings(pit, [*few, *(row for row in rows if row[1] != "lift 1")])
    free = (
        "parameters.sv={start: 1 MPa, bounds: [0.1 MPa, 10 MPa], prior: {mean: 1 MPa, sd: 50 kPa}}",
        "in_situ.vertical=$sv",
    )
    found = run(*free)
    assert not found.backtest.skipped
    table = fits_table(found)
    column = next(i for i, name in enumerate(table.header) if name.startswith("sv"))
    assert [row[column] for row in table.rows] == ["as its prior"] * 4


def test_a_backtest_that_is_out_of_time_says_how_many_fits_it_has():
    found = SimpleNamespace(steps=("one", "two", "three"))
    status, reason = ending(None, found, None, out_of_time=True)
    assert (status, reason) == ("out-of-budget", f"{OUT_OF_TIME} Fits that were done: 3.")


class TestInterrupted:
    def test_out_of_time_keeps_what_was_done(self, pit, whole):
        short = run(control=Control(max_time=0.0))
        assert (short.status, short.exit_code) == ("out-of-budget", ExitCode.NOT_CONVERGED)
        assert short.backtest is None
        assert short.reason == f"{OUT_OF_TIME} No fit was done."
        assert (pit / "case.backtest.checkpoint").exists()
        again = run()
        assert not (pit / "case.backtest.checkpoint").exists()
        assert again.status == "done"
        assert again.counts.evaluations == whole.counts.evaluations

    @pytest.mark.parametrize(
        "after",
        [pytest.param(1, marks=pytest.mark.slow), 8, pytest.param(12, marks=pytest.mark.slow)],
    )
    def test_it_goes_on_to_the_result_of_an_uninterrupted_run(self, pit, whole, after):
        class Stopping(Monitor):
            steps = 0

            def step(self, iteration):
                self.steps += 1
                if self.steps == after:
                    control.stop.ask(ExitCode.INTERRUPTED)

        control = Control(Stopping())
        with pytest.raises(Interrupted):
            run(control=control)
        assert (pit / "case.backtest.checkpoint").exists()
        again = run()
        for ours, theirs in zip(again.backtest.steps, whole.backtest.steps, strict=True):
            assert (ours.values == theirs.values).all()

    def test_running_out_of_time_after_the_fit_does_not_undo_it(self, pit):
        job = plan_fit(Request("case.yaml", ("fit.backtest=false",)))
        steps = len(fit(job, Control()).result.history)

        class Counting(Monitor):
            seen = 0

            def step(self, iteration):
                self.seen += 1
                if self.seen > steps:
                    control.max_time = 0.0

        control = Control(Counting())

        job = plan_fit(Request("case.yaml", force=True))
        found = fit(job, control).result
        assert found.status == "converged"
        assert not (pit / "case.fit.checkpoint").exists()


def test_a_result_comes_back_from_its_file(right):
    folder, found = right
    again = read_result(folder / "case.backtest.h5")
    assert again.backtest.skipped == found.backtest.skipped
    assert replace(again.backtest.next) == found.backtest.next
    assert (again.backtest.few, again.backtest.far) == (found.backtest.few, found.backtest.far)
    assert again.backtest.measured == pytest.approx(found.backtest.measured, nan_ok=True)
    for ours, theirs in zip(again.backtest.steps, found.backtest.steps, strict=True):
        assert (ours.last, ours.readings, ours.status) == (
            theirs.last,
            theirs.readings,
            theirs.status,
        )
        assert ours.counts == theirs.counts
        for name in ("values", "sd", "lower95", "upper95", "log_density", "excess"):
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), nan_ok=True)
        for name in ("mean", "sd", "lower95", "upper95"):
            pair = (getattr(one.prediction, name) for one in (ours, theirs))
            np.testing.assert_array_equal(*pair)


@pytest.mark.slow
def test_where_ground_yields_a_step_begins_with_what_the_one_before_has_computed(pit, monkeypatch):
    rows = readings_of(pit / "case.yaml", SAME, seed=1)
    write_readings(pit, [row for row in rows if row[1] != "lift 4"])
    said = ("materials.rock.yield={type: tresca, cohesion: 0.5 MPa}",)
    surveyed, again = set(), []
    survey, evaluate = StagedModel.survey, ReducibleResponse.evaluation
    monkeypatch.setattr(
        StagedModel, "survey",
        lambda self, p, **how: surveyed.add(p.tobytes()) or survey(self, p, **how),
    )  # fmt: skip
    monkeypatch.setattr(
        ReducibleResponse, "evaluation",
        lambda self, p, **how: again.append(p.tobytes() in surveyed) or evaluate(self, p, **how),
    )  # fmt: skip
    found = run(*said)
    assert again
    assert not any(again)
    surveyed.clear()
    monkeypatch.setattr("geoident.workflow.backtest.hand_on", lambda *told: None)
    alone = run(*said, output="alone.h5")
    assert sum(again) == len(found.backtest.steps) - 2  # the last is that of the command fit
    assert alone.counts.factorizations > found.counts.factorizations
    for mine, other in zip(found.backtest.steps, alone.backtest.steps, strict=True):
        assert mine.values == pytest.approx(other.values, rel=1e-6)
        assert mine.sd == pytest.approx(other.sd, rel=1e-4)


@pytest.mark.slow  # what a step begins with where ground yields: above
def test_where_ground_yields_a_fit_beside_an_answer_weighs_the_readings_there(pit, monkeypatch):
    """What they would say without model error is not asked for."""
    said = ("materials.rock.yield={type: tresca, cohesion: 0.5 MPa}",)
    begun = []
    real = search._Search.identified
    monkeypatch.setattr(
        search._Search,
        "identified",
        lambda self, problem, methods: begun.append(1) or real(self, problem, methods),
    )

    def answer(*more, near, start):
        setup = prepare(plan_fit(Request("case.yaml", (*said, *more))))
        begun.clear()
        given = (NEARBY,), Kept(), Control()
        found = search.estimated(setup, *given, start=start, near=near)
        assert found.outcome.status == "converged"
        return found.outcome.values

    plain = answer("fit.model_error=estimate", near=False, start=None)
    assert begun
    beside = answer("fit.model_error=estimate", near=True, start=plain)
    assert not begun
    assert beside == pytest.approx(plain, rel=1e-3)
    answer("fit.model_error=none", near=True, start=plain)
    assert begun


def test_the_fit_without_the_last_stage_is_no_more_exact_than_the_fit():
    plain, strengths = GaussNewtonOptions(tolerance=1e-8), ComplementarityOptions(tolerance=1e-3)
    assert near_answer(plain).tolerance == NEARBY.tolerance
    assert near_answer(strengths).tolerance == 1e-3
    assert near_answer(replace(strengths, tolerance=1e-8)) == NEARBY
