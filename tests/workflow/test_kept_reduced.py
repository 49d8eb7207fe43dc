"""The reduced model that a fit keeps: asked by other commands, for the same case and mesh only."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

from geoident import read_result
from geoident.api import scan, simulate
from geoident.errors import InputError, UsageError
from geoident.identify.posterior.density import PosteriorDensity
from geoident.io.result.file import write_result
from geoident.model.results.findings import Finding
from geoident.model.results.reduced import FORM
from geoident.workflow.estimating.setup import problem_of_result
from geoident.workflow.predict import PredictRequest, plan_prediction, predict
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, build_model, inputs_of_result, load_inputs
from geoident.workflow.running.kept_reduced import restored_for
from geoident.workflow.sample import SampleRequest, plan_sample, sample
from tests.support.commands import run_command
from tests.support.trench import write_case, write_mesh

KEEP = ("--set", "fit.reduced=keep", "--set", "fit.stages=[first, second]")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A folder with a fit that keeps its reduced model."""
    folder = tmp_path_factory.mktemp("kept")
    case = write_case(folder)
    assert run_command("fit", str(case), *KEEP).exit_code in (0, 4)
    return folder


@pytest.fixture
def fitted(kept):
    return read_result(kept / "case.fit.h5")


def at(E, K0):
    return {"parameters.E.start": E, "parameters.K0.start": K0}


def simulated(kept, values, **more):
    from geoident import load_case  # noqa: PLC0415

    return simulate(load_case(kept / "case.yaml", values), **more)


def test_predictions_are_those_of_the_model_and_factorize_nothing(kept, fitted):
    path = kept / "plain.fit.h5"
    write_result(replace(fitted.data, reduced=None), path, overwrite=False)
    by_kept, by_model = (
        predict(
            plan_prediction(PredictRequest(Request(str(p)), stages=("second",))), Control()
        ).result
        for p in (kept / "case.fit.h5", path)
    )
    assert by_kept.counts.factorizations == 0
    assert by_model.counts.factorizations > 0
    for name in ("mean", "lower95", "upper95"):
        np.testing.assert_allclose(
            getattr(by_kept.prediction, name), getattr(by_model.prediction, name), atol=1e-9
        )
    scale = np.nanmax(np.abs(by_model.sensitivity), axis=(0, 1))
    np.testing.assert_allclose(by_kept.sensitivity / scale, by_model.sensitivity / scale, atol=1e-6)
    assert by_kept.fields is not None
    assert any("reduced model kept in" in note for note in by_kept.notes)
    assert not any("reduced model" in note for note in by_model.notes)


def test_it_answers_without_mesh_and_readings(kept, fitted, tmp_path):
    alone = tmp_path / "alone.fit.h5"
    alone.write_bytes((kept / "case.fit.h5").read_bytes())
    model = read_result(alone).reduced
    found = model({"E": "6 GPa"})
    p = fitted.data.parameters.values.copy()
    p[0] = 6e9
    np.testing.assert_array_equal(found.values, model(p).values)
    several = model(np.array([p, 1.1 * p]))
    np.testing.assert_allclose(several.values[0], found.values, rtol=1e-13)
    shown = simulated(kept, at("6 GPa", float(p[1])))
    for reading in shown.readings:
        gap = abs(found[reading.channel, reading.stage] - reading.value)
        assert gap <= found.bounds[found.pairs.index((reading.channel, reading.stage))]
    row = found.table.rows[0]
    assert row[2] == pytest.approx(1e3 * found.values[0])
    assert row[4] == "mm"
    assert model.parameters == ("E", "K0")
    assert repr(model).startswith("KeptModel(6 readings by E, K0; of")


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"G": 1.0}, "There is no parameter 'G'"),
        ({"E": "5 m"}, "expected a pressure"),
        ({"E": 1e12}, "E is beyond the bounds"),
        ([1.0, 2.0, 3.0], "Vectors of 2 parameters"),
    ],
)
def test_what_it_cannot_answer_is_said(fitted, values, why):
    with pytest.raises(UsageError, match=why):
        fitted.reduced(values)


def test_what_if_asks_it_where_it_is_close(kept):
    values = at("5.2 GPa", 1.55)
    near = simulated(kept, values, reduced=kept / "case.fit.h5")
    assert "are those of the reduced model" in near.note
    plain = simulated(kept, values)
    assert plain.note == ""
    for one, other in zip(near.readings, plain.readings, strict=True):
        assert one.value == pytest.approx(other.value, abs=0.02 * 1e-5)


def test_what_is_not_estimated_to_be_close_is_computed(kept, fitted, tmp_path):
    """A kept model whose readings were far off where it was tested: the mesh is asked."""
    found = fitted.data.reduced
    worse = {name: 1e9 * b if name == "ratios" else b for name, b in found.blocks.items()}
    path = tmp_path / "worse.fit.h5"
    write_result(replace(fitted.data, reduced=replace(found, blocks=worse)), path, overwrite=False)
    values = at("5.2 GPa", 1.55)
    shown = simulated(kept, values, reduced=path)
    assert "not estimated to be close enough" in shown.note
    assert shown.readings == simulated(kept, values).readings


def sampled(path, output):
    request = SampleRequest(Request(str(path), output=str(output)), draws=400, effective=150)
    return sample(plan_sample(request), Control()).result


def note_of(result):
    return next(note for note in result.notes if "evaluations are those of" in note)


def test_draws_ask_it_and_evaluate_the_model_once(kept, fitted, tmp_path):
    """At their mean, for the fields. The draws are the same: the points proposed are."""
    found = sampled(kept / "case.fit.h5", tmp_path / "kept.sample.h5")
    assert "those of the reduced model that the fit keeps" in note_of(found)
    assert note_of(found).endswith("none is of the full model.")
    assert found.counts.factorizations == 2  # one analysis of two stages
    path = kept / "none.fit.h5"
    write_result(replace(fitted.data, reduced=None), path, overwrite=False)
    plain = sampled(path, tmp_path / "none.sample.h5")
    assert "those of a reduced model" in note_of(plain)
    assert plain.counts.factorizations > 2
    one, other = found.posterior, plain.posterior
    assert one.sampler == other.sampler
    sd = other.values.std(axis=(0, 1))
    np.testing.assert_allclose(one.values / sd, other.values / sd, atol=1e-3)
    scale = np.nanmax(np.abs(other.predicted))
    np.testing.assert_allclose(one.predicted, other.predicted, atol=1e-3 * scale)
    assert_density_of_the_model(found, fitted.data, str(kept / "case.yaml"))


def assert_density_of_the_model(found, fit, path):
    """Draws that are so near each other are the same for a density that is a little wrong: this
    one is that of readings from the mesh.
    """
    inputs = inputs_of_result(fit, path)
    used = fit.gauges.readings.used_pairs
    problem = problem_of_result(fit, inputs.case, build_model(inputs).response(used))
    density = PosteriorDensity(problem)
    values = found.posterior.values.reshape(-1, 2)
    few = np.linspace(0, len(values) - 1, 5).astype(int)
    logs = density.logarithms(np.array([density.coordinates(p) for p in values[few]]))
    told = found.posterior.log_density.ravel()[few]
    assert np.ptp(logs) > 0.5
    np.testing.assert_allclose(told - told[0], logs - logs[0], atol=1e-4)


def test_a_grid_near_the_fit_needs_no_new_march(kept, fitted):
    grid = {"E": {"from": "4.6 GPa", "to": "5.4 GPa"}, "K0": {"from": 1.4, "to": 1.6}}
    values = {"fit.scan.grid": grid, "fit.scan.points": 6, "fit.stages": ["first", "second"]}
    from geoident import load_case  # noqa: PLC0415

    case = load_case(kept / "case.yaml", values)
    found = scan(case, reduced=fitted, output=kept / "kept.scan.h5")
    assert found.notes[0].startswith("36 of 36 points of the grid are those of a reduced model")
    assert "that was kept" in found.notes[0]
    plain = scan(case.with_values({"fit.reduced": False}), output=kept / "plain.scan.h5")
    np.testing.assert_allclose(found.grid.objective, plain.grid.objective, rtol=0.002, atol=0.02)


@pytest.mark.parametrize(
    ("override", "why"),
    [
        ("materials.rock.nu=0.3", "materials.rock.nu was 0.25, it is 0.3"),
        ("parameters.K0=null", "parameters.K0 was sought, it is not there"),
        ("gauges.S.point=[1.5 m, 4 m]", "gauges.S.point[0] was 1 m, it is 1.5 m"),
    ],
)
def test_another_case_is_refused_and_what_differs_is_named(kept, override, why):
    more = ["in_situ.K0=1.2"] if "K0" in override else []
    inputs = load_inputs(str(kept / "case.yaml"), overrides=[override, *more])
    with pytest.raises(InputError) as caught:
        restored_for(str(kept / "case.fit.h5"), inputs)
    assert "its reduced model is of another case" in str(caught.value)
    if not more:
        assert why in str(caught.value)


def test_what_no_reading_depends_on_may_change(kept):
    changes = [
        "title=other",
        "parameters.E.start=9 GPa",
        "gauges.S.accuracy=1 mm",
        "fit.loss=huber",
    ]
    inputs = load_inputs(str(kept / "case.yaml"), overrides=changes)
    assert restored_for(str(kept / "case.fit.h5"), inputs).covers([("S", "second")])


def test_another_mesh_is_refused(kept, tmp_path):
    write_case(tmp_path)
    write_mesh(tmp_path / "trench.inp", n=(12, 8))
    inputs = load_inputs(str(tmp_path / "case.yaml"))
    with pytest.raises(InputError, match="of another mesh: the file has changed"):
        restored_for(str(kept / "case.fit.h5"), inputs)


def test_another_form_is_refused_and_predictions_go_on_without(kept, fitted, tmp_path):
    path = kept / "old.fit.h5"
    old = replace(fitted.data.reduced, form="geoident-reduced/0")
    write_result(replace(fitted.data, reduced=old), path, overwrite=False)
    inputs = load_inputs(str(kept / "case.yaml"))
    with pytest.raises(InputError, match=f"of the form 'geoident-reduced/0', not '{FORM}'"):
        restored_for(str(path), inputs)
    assert read_result(path).reduced is None
    request = PredictRequest(Request(str(path), output=str(tmp_path / "p.h5")), stages=("second",))
    assert predict(plan_prediction(request), Control()).result.counts.factorizations > 0


def test_a_fit_says_why_it_keeps_none(tmp_path):
    case = write_case(tmp_path)
    partial = "stages[1].release={lower: 0.5}"
    done = run_command("fit", str(case), *KEEP, "--set", partial)
    assert done.exit_code in (0, 4), done.output
    found = read_result(tmp_path / "case.fit.h5")
    assert found.reduced is None
    why = (
        "No reduced model is kept: the stage 'second' releases in part the stress of ground that "
        "other stages have changed before."
    )
    assert Finding("no-reduced-model", "", why) in found.data.findings
    inputs = load_inputs(str(case), overrides=[partial])
    with pytest.raises(InputError, match="releases in part the stress"):
        restored_for(str(tmp_path / "case.fit.h5"), inputs)


def test_stress_cells_are_given_too(tmp_path):
    case = write_case(tmp_path)
    cell = "gauges.P={kind: stress, point: [1 m, 1 m], components: [yy], accuracy: 0.1 MPa}"
    assert run_command("fit", str(case), *KEEP, "--set", cell).exit_code in (0, 4)
    model = read_result(tmp_path / "case.fit.h5").reduced
    start = {"parameters.E.start": "5.5 GPa", "parameters.K0.start": 1.45}
    found = model({"E": "5.5 GPa", "K0": 1.45})
    from geoident import load_case  # noqa: PLC0415

    shown = simulate(load_case(case, {**start, "gauges.P": {
        "kind": "stress", "point": ["1 m", "1 m"], "components": ["yy"], "accuracy": "0.1 MPa",
    }}))  # fmt: skip
    read = [r for r in shown.readings if r.channel == "P.yy"]
    assert len(read) == 2
    for reading in read:
        k = found.pairs.index((reading.channel, reading.stage))
        assert abs(found.values[k] - reading.value) <= found.bounds[k] < 1.0  # Pa
    moved = [k for k, (name, _) in enumerate(found.pairs) if not name.startswith("P")]
    assert np.all(found.bounds[moved] < 1e-9)  # rounding of stresses is not that of motions


def test_without_being_asked_for_none_is_kept(tmp_path):
    case = write_case(tmp_path)
    run_command("fit", str(case))
    with h5py.File(tmp_path / "case.fit.h5") as file:
        assert "reduced" not in file
    with pytest.raises(InputError, match="keeps no reduced model"):
        restored_for(str(tmp_path / "case.fit.h5"), load_inputs(str(case)))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("stages[1].release={lower: 0.5}", "no reduced model will be kept: the stage 'second'"),
        ("gauges.P={kind: stress, point: [1 m, 1 m], principal: [major], accuracy: 0.1 MPa}",
         "will be kept does not give P"),
    ],
)  # fmt: skip
def test_check_says_what_will_not_be_kept(tmp_path, change, why):
    case = write_case(tmp_path)
    done = run_command("check", str(case), *KEEP, "--set", change)
    assert why in " ".join(done.output.split()), done.output
    assert "reduced" not in run_command("check", str(case), "--set", change).output
