"""How many marches and factorizations a whole fit takes, with all that it says."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from geoident.errors import ExitCode, Interrupted
from geoident.forward.reduced import reduction
from geoident.workflow.estimating.setup import prepare, problem_of
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control, Silent
from geoident.workflow.running.evaluation_log import CERTAIN, Remembered
from geoident.workflow.running.jobs import Request, plan_fit
from geoident.workflow.simulate import simulate
from tests.support.deck import write_deck
from tests.support.meshes import box

CASE = """\
format: geoident-case/1
title: A drift in four rounds
analysis: solid
mesh: {file: drift.inp}
parameters:
  E: {start: 15 GPa, bounds: [1 GPa, 80 GPa], scale: log, prior: {mean: 9 GPa, sd: 2 GPa}}
  sv: {start: 5 MPa, bounds: [1 MPa, 15 MPa], prior: {mean: 5 MPa, sd: 0.5 MPa}}
  K0: {start: 1.0, bounds: [0.1, 10]}
materials:
  rock: {E: $E, nu: 0.25}
  shotcrete: {E: 10 GPa, nu: 0.2}
groups: {rock: rock, r1: rock, r2: rock, r3: rock, r4: rock, l1: rock, l2: rock, l3: rock}
supports: {x0: x, x1: x, y0: y, y1: y, z0: z}
in_situ: {model: heim, vertical: $sv, K0: $K0}
stages:
  - {name: one, excavate: [r1, l1]}
  - {name: two, excavate: [r2, l2], install: {l1: shotcrete}}
  - {name: three, excavate: [r3, l3], install: {l2: shotcrete}}
  - {name: four, excavate: [r4], install: {l3: shotcrete}}
gauges:
  roof: {kind: settlement, point: [0 m, 6 m, 8 m], accuracy: 0.2 mm}
  side:
    kind: extensometer
    head: [16 m, 6 m, 6 m]
    anchors: {a: [4 m, 6 m, 6 m], b: [8 m, 6 m, 6 m]}
    accuracy: 0.05 mm
  over:
    kind: extensometer
    head: [0 m, 10 m, 16 m]
    anchors: {a: [0 m, 10 m, 8 m], b: [0 m, 10 m, 12 m]}
    accuracy: 0.05 mm
readings: readings.csv
fit: {method: gauss-newton, stages: [one, two, three]}
"""

ROUNDS = 4
FITTED = 3


class NoLog:
    """Keeps nothing."""

    def find(self, kind, p):
        return None

    def add(self, kind, p, arrays):
        pass


def drift(n):
    """A quarter of a drift of 8 m by 4 m, with a lining at its side; n cells a side of 16 m."""
    mesh = box("hex8", (n, n, n), size=(16.0, 16.0, 16.0))
    x, y, z = mesh.points[mesh.blocks[0].nodes].mean(axis=1).T
    level = (z > 4.0) & (z < 8.0)
    found = {}
    for k in range(ROUNDS):
        here = level & (y > 4.0 * k) & (y < 4.0 * k + 4.0)
        found[f"r{k + 1}"] = np.flatnonzero(here & (x < 4.0))
        found[f"l{k + 1}"] = np.flatnonzero(here & (x > 4.0) & (x < 8.0))
    del found["l4"]
    taken = np.concatenate(list(found.values()))
    return replace(mesh, groups=found | {"rock": np.setdiff1d(np.arange(len(x)), taken)})


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Readings of a finer mesh, disturbed, so that errors of mesh and model are looked for."""
    folder = tmp_path_factory.mktemp("drift")
    (folder / "case.yaml").write_text(CASE)
    write_deck(drift(8), folder / "drift.inp")
    found = simulate(
        str(folder / "case.yaml"), overrides=["parameters.E.start=8 GPa", "parameters.K0.start=0.7"]
    )
    noise = 1.0 + 0.04 * np.sin(np.arange(1.0, len(found.readings) + 1))
    rows = [
        f"{r.channel},{r.stage},{1e3 * r.value * part!r},mm"
        for r, part in zip(found.readings, noise.tolist(), strict=True)
    ]
    (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows]) + "\n")
    write_deck(drift(4), folder / "drift.inp")
    return folder


@pytest.fixture
def case(files, tmp_path, monkeypatch):
    """The case in the current folder, with a reduced model, small as its mesh is."""
    monkeypatch.setattr(reduction, "PROJECTED", 0.0)
    monkeypatch.chdir(shutil.copytree(files, tmp_path / "here"))


def fitted(*overrides, control=None, **options):
    job = plan_fit(Request("case.yaml", overrides, **options))
    return fit(job, control or Control(Silent())).result


@pytest.fixture(scope="module")
def whole(files, tmp_path_factory):
    """A fit of the case, uninterrupted and with nothing known before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reduction, "PROJECTED", 0.0)
        patch.chdir(shutil.copytree(files, tmp_path_factory.mktemp("whole") / "here"))
        return fitted()


def test_a_fit_says_all_with_few_evaluations(whole):
    """Its search takes one; the mesh two, one of them on the finer mesh."""
    assert whole.status == "converged"
    assert whole.prediction is not None
    assert len(whole.backtest.steps) == 1
    assert any("The mesh is too coarse" in said for said in whole.findings)
    assert whole.counts.evaluations == 1 + (1 + 1) + 1 + 1  # the third on the finer mesh
    assert whole.backtest.steps[0].counts.evaluations == 1


@pytest.mark.slow  # answers of a reduced model close to those of the model: test_reduced_answers.py
def test_it_says_what_the_model_alone_would(case, whole, monkeypatch):
    """Weights are known to `AT_REST`: another way there changes answers by 1e-4 of an interval."""
    plain = fitted("fit.reduced=false", "fit.backtest=false")
    monkeypatch.setattr(Remembered, "_instead", lambda self, p: None)
    unled = fitted("fit.backtest=false", output="unled.h5")
    assert plain.counts.evaluations > 2 * whole.counts.evaluations
    assert unled.counts.evaluations > whole.counts.evaluations
    wide = whole.parameters.upper95 - whole.parameters.lower95
    for name in ("values", "lower95", "upper95"):
        ours, same, theirs = (getattr(r.parameters, name) for r in (whole, unled, plain))
        np.testing.assert_allclose(ours, same, rtol=1e-6)
        assert np.all(np.abs(ours - theirs) <= 1e-4 * wide)
    assert whole.model_error.size == pytest.approx(unled.model_error.size, rel=1e-5)
    for name in ("mean", "lower95", "upper95"):
        ours, same = (getattr(found.prediction, name) for found in (whole, unled))
        np.testing.assert_allclose(ours, same, rtol=1e-6)
    np.testing.assert_allclose(whole.sensitivity, unled.sensitivity, rtol=1e-6)
    np.testing.assert_allclose(whole.fields.stress, unled.fields.stress, rtol=1e-6, atol=1.0)


@pytest.mark.slow  # a search by the reduced model, cut short: test_reduced_search.py
@pytest.mark.parametrize("after", [2, 5])
def test_one_that_was_cut_short_ends_with_the_same_numbers_and_counts(case, whole, after):
    class Stopping(Silent):
        steps = 0

        def step(self, iteration):
            self.steps += 1
            if self.steps == after:
                control.stop.ask(ExitCode.INTERRUPTED)

    control = Control(Stopping())
    with pytest.raises(Interrupted):
        fitted(control=control)
    again, other = fitted(), whole
    np.testing.assert_array_equal(again.parameters.values, other.parameters.values)
    np.testing.assert_array_equal(again.sensitivity, other.sensitivity)
    np.testing.assert_array_equal(again.fields.displacement, other.fields.displacement)
    assert again.counts.evaluations == other.counts.evaluations
    assert again.counts.factorizations == other.counts.factorizations


def test_a_march_that_waits_holds_its_states_and_no_factor(case):
    setup = prepare(plan_fit(Request("case.yaml")))
    problem = problem_of(setup, NoLog(), Control(Silent()))
    problem.response.evaluate(problem.start)
    model = setup.model
    kept = model.march_to(problem.start, FITTED)
    assert model.counts.factorizations == FITTED
    assert kept.run.factors.find(model.sequence.states[FITTED]) is None
    assert {end.stress.shape[2] for end in kept.ends} == {1}
    found = model.survey(problem.start, fields=True)
    assert model.counts.factorizations == ROUNDS
    assert model.counts.evaluations == 1
    alone = prepare(plan_fit(Request("case.yaml"))).model.survey(problem.start, fields=True)
    np.testing.assert_allclose(found.computed, alone.computed, rtol=1e-9)
    np.testing.assert_allclose(found.sensitivity, alone.sensitivity, rtol=1e-7)
    np.testing.assert_allclose(found.fields.stress, alone.fields.stress, rtol=1e-9)
    elsewhere = model.survey(0.9 * problem.start, fields=False)
    assert model.counts.evaluations == 2
    assert not np.allclose(elsewhere.computed, found.computed, rtol=1e-3)


def marched_once():
    """A response of the case, marched at the start values, and these."""
    setup = prepare(plan_fit(Request("case.yaml")))
    response = setup.model.response([("roof", "three"), ("over.a", "two")])
    response.keep_marches()
    p = np.array([q.start for q in setup.case.parameters])
    response.evaluate(p)
    return response, p


def test_one_march_is_enough_where_one_parameter_moves_the_moduli(case, monkeypatch):
    """E of the rock against a lining: within 1e-8 of the model at a third more of all."""
    response, p = marched_once()
    there, reduced = 1.3 * p, response.reduced()
    assert reduced.error(there) <= CERTAIN
    v, dv_dp = (
        prepare(plan_fit(Request("case.yaml")))
        .model.response([("roof", "three"), ("over.a", "two")])
        .evaluate(there)
    )
    ours, slopes = reduced.evaluate(there)
    np.testing.assert_allclose(ours, v, rtol=1e-8)
    np.testing.assert_allclose(slopes * there, dv_dp * there, atol=1e-7 * np.abs(v).max())
    monkeypatch.setattr(reduction, "MOST_FURTHER", reduction.MOST_SECOND)
    response, p = marched_once()
    assert response.reduced().error(there) > 1e4 * CERTAIN


@pytest.fixture
def lending(case):
    """A model that was marched at three parameter vectors, and another one near to them."""
    setup = prepare(plan_fit(Request("case.yaml")))
    response = setup.model.response([("roof", "three"), ("over.a", "two")])
    response.keep_marches()
    p = np.array([q.start for q in setup.case.parameters])
    for size in (1.0, 1.01, 0.99):
        response.evaluate(p * [size, 1.0, size**2])
    return setup.model, response, 1.002 * p


def test_a_march_follows_displacements_that_are_known(lending):
    model, response, p = lending
    assert response.reduced().error(p) < 1e-8
    response.lend(p)
    before = model.counts.factorizations
    found = model.survey(p, fields=True)
    assert model.counts.factorizations - before == ROUNDS - FITTED  # they are known to the third
    alone = prepare(plan_fit(Request("case.yaml"))).model.survey(p, fields=True)
    for name, close in (("computed", 1e-7), ("sensitivity", 1e-5)):
        ours, theirs = (np.nan_to_num(getattr(one, name)) for one in (found, alone))
        assert np.abs(ours - theirs).max() <= close * np.abs(theirs).max()
    for name in ("displacement", "stress"):
        ours, theirs = (np.nan_to_num(getattr(one.fields, name)) for one in (found, alone))
        assert np.abs(ours - theirs).max() <= 1e-7 * np.abs(theirs).max()


def test_what_is_lent_serves_its_parameters_alone_and_until_the_model_forgets(lending):
    model, response, p = lending
    for q, forgets in ((1.001 * p, False), (p, True)):
        response.lend(p)
        before = model.counts.factorizations
        if forgets:
            model.forget()
        model.survey(q, fields=False)
        assert model.counts.factorizations - before == ROUNDS


def test_what_a_march_leaves_for_the_reduced_model_is_its_displacements(case):
    setup = prepare(plan_fit(Request("case.yaml")))
    response = setup.model.response([("roof", "three"), ("over.a", "two")])
    response.keep_marches()
    response.evaluate(np.array([q.start for q in setup.case.parameters]))
    (snapshot,) = response.reduction.snapshots
    states, channels = FITTED, len(setup.case.channels)
    each = setup.model.discretization.points.n_dofs * states + channels * (states + 1)
    assert snapshot.entries == each * snapshot.columns
