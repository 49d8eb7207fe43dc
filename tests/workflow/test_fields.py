"""Fields through the commands: the posterior against its closed form, and what people are shown."""

import json
import re
import warnings
from dataclasses import replace

import h5py
import numpy as np
import pytest
from support.commands import run_command
from support.trench import CASE, READINGS, write_case

from geoident.errors import InputError
from geoident.io.result.file import read_result
from geoident.model.results.findings import sentences_of
from geoident.model.results.model_error import ModelErrorTable
from geoident.workflow.drawn import granted
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.setup import prepare
from geoident.workflow.running.jobs import (
    Request,
    build_model,
    inputs_of_result,
    load_inputs,
    plan_fit,
)

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import arviz

ROCK = "rock: {elastic: isotropic, E: $E, nu: 0.25}"
FIELD = "E: {field: {mean: MEAN, sd: SD, length: 3 m, modes: 12}}"
ALL = "stages: [first, second]"


def write(folder, *, mean="$E", sd="30 %", readings=READINGS, more=""):
    path = write_case(folder)
    text = CASE.replace(ROCK, f"rock: {{elastic: isotropic, {FIELD}, nu: 0.25}}")
    text = text.replace("MEAN", mean).replace("SD", sd).replace("stages: [first]", ALL + more)
    if not mean.startswith("$"):
        text = text.replace("  E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}\n", "")
    path.write_text(text)
    (folder / "readings.csv").write_text(readings)
    return path


ALONE = ("--set=fit.backtest=false", "--set=fit.mesh_error=false")


def fitted(path, *flags):
    done = run_command("fit", path, "--force", *flags)
    assert done.exit_code in (0, 4), done.output
    return read_result(str(path.with_name("case.fit.h5")))


def test_the_posterior_of_a_linear_field_is_that_of_the_formulas(tmp_path):
    """With 0.1 % the readings are linear in the field; K0 is given, its mean too.

    With C the exact covariance of the modes and H the derivative of the readings by the logarithm
    at the elements' modes, C H^T (H C H^T + R)^-1 is the gain of a linear-Gaussian estimate.
    """
    path = write(tmp_path, mean="5 GPa", sd="0.1 %")
    text = path.read_text().replace("  K0: {start: 1.0, bounds: [0.2, 4]}\n", "")
    text = text.replace("parameters:\n", "").replace("$K0", "1.5").replace("0.01 mm", "1e-5 mm")
    path.write_text(text)
    drawn = run_command("simulate", path, "--draw", "--seed", 4, "--noise")
    assert drawn.exit_code == 0, drawn.output
    (tmp_path / "readings.csv").write_text(drawn.stdout)
    result = fitted(path, "--set", "fit.model_error=none")  # R as stated
    (found,) = result.varied
    setup = prepare(plan_fit(Request(str(path), force=True)))
    rows = setup.readings.used
    pairs = [pair for pair, taken in zip(setup.readings.pairs, rows, strict=True) if taken]
    v, J = setup.model.response(pairs).evaluate(np.zeros(len(setup.model.names)))
    (made,) = setup.model.on_mesh.fields
    points = setup.model.discretization.points
    element = points.element[made.points]
    mean_of = np.zeros((len(found.elements), len(element)))
    for n, number in enumerate(found.elements):
        mine = element == number
        weight = points.volume[made.points][mine]
        mean_of[n, mine] = weight / weight.sum()
    Phi = mean_of @ made.modes
    H, R = J, np.diag(setup.readings.sd[rows] ** 2)
    gain = Phi @ H.T @ np.linalg.inv(H @ H.T + R)
    posterior = gain @ (setup.readings.value[rows] - v)
    variance = np.sum(Phi**2, axis=1) - np.einsum("qi,iq->q", gain, H @ Phi.T)
    size = np.sqrt(np.sum(Phi**2, axis=1).max())
    assert np.abs(posterior).max() > 0.3 * size  # the readings say something
    assert np.log(found.values / 5e9) == pytest.approx(posterior, abs=0.01 * size)
    assert found.sd == pytest.approx(np.sqrt(variance), rel=0.01, abs=1e-3 * size)
    assert found.reduction == pytest.approx(1 - variance / np.sum(Phi**2, axis=1), abs=0.01)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A case and its fit of both stages."""
    path = write(tmp_path_factory.mktemp("whole"))
    return path, fitted(path, *ALONE)


@pytest.fixture(scope="module")
def early(tmp_path_factory):
    """A case and its fit of the first stage, which predicts the second."""
    path = write(tmp_path_factory.mktemp("early"))
    path.write_text(path.read_text().replace(ALL, "stages: [first]"))
    return path, fitted(path, *ALONE)


def test_people_see_the_field_and_not_its_modes(whole):
    path, result = whole
    assert result.parameters.names[:2] == ("E", "K0")
    assert len(result.parameters.names) == 2 + 12
    assert result.parameters.fields == ("", "", *("rock.E",) * 12)
    out = path.with_name("case.fit.h5")
    for command in (
        ("show", out),
        ("show", out, "--csv"),
        ("show", out, "--json"),
        ("diff", out, out),
    ):
        said = run_command(*command).output
        assert "mode-" not in said, said
    shown = json.loads(run_command("show", out, "--json").stdout)
    assert list(shown["parameters"]) == ["E", "K0"]
    (told,) = shown["fields"]
    assert told["name"] == "rock.E"
    assert told["least"] < told["median"] < told["largest"]
    assert "rock.E" in run_command("show", out).output
    assert "rock.E has 12 modes" in " ".join(run_command("check", path).output.split())
    assert result.for_people.parameters.names == ("E", "K0")


def test_modes_that_only_the_prior_holds_are_no_fault(whole):
    """There are fewer readings than modes: the status speaks of the parameters of the case."""
    _, result = whole
    assert result.status != "not-determined"
    assert not any(
        re.search(r"\bmodes?\b", said) for said in (*sentences_of(result.findings), result.reason)
    )


def test_a_result_brings_back_its_fields_and_vtk_has_them(whole, tmp_path):
    path, result = whole
    (found,) = result.varied
    with h5py.File(path.with_name("case.fit.h5")) as file:
        cells = file["VTKHDF/CellData"]
        n = result.fields.mesh.n_elements
        assert cells["rock.E"].shape == cells["rock.E.sd"].shape == (n,)
        assert cells["rock.E"][()][found.elements] == pytest.approx(found.values)
        assert cells["rock.E.reduction"][()][found.elements] == pytest.approx(found.reduction)
        assert list(file["fields"].attrs["names"]) == ["rock.E"]
    done = run_command(
        "export", path.with_name("case.fit.h5"), "--format", "vtu", "-o", tmp_path / "vtu"
    )
    assert done.exit_code == 0, done.output
    assert 'Name="rock.E.sd"' in (tmp_path / "vtu" / "case.fit.0.vtu").read_text(errors="ignore")


def test_predictions_of_a_result_are_those_of_the_fit(early):
    path, result = early
    assert result.prediction is not None
    done = run_command("predict", path.with_name("case.fit.h5"), "--force")
    assert done.exit_code == 0, done.output
    again = read_result(str(path.with_name("case.predict.h5")))
    assert again.prediction.mean == pytest.approx(result.prediction.mean, rel=1e-9, nan_ok=True)
    assert again.prediction.sd == pytest.approx(result.prediction.sd, rel=1e-9, nan_ok=True)
    assert again.varied[0].name == "rock.E"


def test_draws_have_the_spread_of_the_field_and_a_seed(tmp_path):
    path = write(tmp_path)

    def simulated(*flags):
        done = run_command("simulate", path, *flags)
        assert done.exit_code == 0, done.output
        return done.stdout

    assert simulated("--draw", "--seed", 3) == simulated("--draw", "--seed", 3)
    assert simulated("--draw", "--seed", 3) != simulated("--draw", "--seed", 4)
    assert simulated() == simulated("--seed", 3)
    plain = write_case(tmp_path, "plain.yaml")
    refused = run_command("simulate", plain, "--draw")
    assert refused.exit_code == 3
    said = " ".join(refused.output.split())
    assert "no constant of the case varies from place to place: there is nothing to draw" in said
    remedy = "E: {field: {mean: ..., sd: 30 %, length: 20 m}}"
    assert f"Write '{remedy}' in a material." in said
    field = remedy.removeprefix("E: ").replace("...", "2 GPa")
    assert run_command("simulate", plain, "--draw", "--set", f"materials.rock.E={field}",
                       "--set", "parameters.E=null").exit_code == 0  # fmt: skip


def test_measured_points_must_lie_in_their_material(tmp_path):
    path = write(tmp_path)
    measured = "modes: 12, measured: [{at: [90 m, 1 m], value: 3 GPa}]"
    path.write_text(path.read_text().replace("modes: 12", measured))
    said = run_command("check", path)
    assert said.exit_code == 3
    assert "the measured point (90, 1) m is not in the mesh" in " ".join(said.output.split())


def test_a_measured_value_is_met_whatever_the_mean(tmp_path):
    """Where a test stands the field keeps its value while the mean parameter moves."""
    path = write(tmp_path)
    measured = "modes: 12, measured: [{at: [0.5 m, 0.5 m], value: 3 GPa}]"
    path.write_text(path.read_text().replace("modes: 12", measured))
    model = build_model(load_inputs(str(path)))
    (made,) = model.on_mesh.fields
    positions = model.discretization.points.position[made.points]
    near = int(np.argmin(np.linalg.norm(positions - 0.5, axis=1)))
    far = int(np.argmax(np.linalg.norm(positions - 0.5, axis=1)))
    values = dict.fromkeys(model.names, 0.0)
    one, other = (mean * made.factor(values, mean) for mean in (2e9, 8e9))
    assert one[near] == pytest.approx(3e9, rel=0.05)
    assert other[near] == pytest.approx(3e9, rel=0.1)
    assert other[far] / one[far] > 2.0


@pytest.mark.parametrize(
    ("members", "close"), [(50, 0.3), pytest.param(500, 0.05, marks=pytest.mark.slow)]
)
def test_the_ensemble_smoother_finds_the_field_of_gauss_newton(tmp_path, members, close):
    """With 5 % the readings are nearly linear; n members err by about sd / sqrt(n)."""
    path = write(tmp_path, sd="5 %")
    text = path.read_text().replace("start: 2 GPa", "start: 5 GPa")
    prior = "prior: {kind: lognormal, mean: 5 GPa, sd: 0.2 GPa}"
    text = text.replace("scale: log}", f"scale: log, {prior}}}")
    text = text.replace("[0.2, 4]}", "[0.2, 4], prior: {mean: 1.0, sd: 0.05}}")
    path.write_text(text.replace("0.01 mm", "0.003 mm"))
    drawn = run_command("simulate", path, "--draw", "--seed", 8, "--noise")
    (tmp_path / "readings.csv").write_text(drawn.stdout)
    newton = fitted(path, *ALONE)
    smoother = "fit.method=ensemble-smoother", f"fit.ensemble-smoother.ensemble={members}"
    smoothed = fitted(path, *ALONE, *(word for flag in smoother for word in ("--set", flag)))
    assert smoothed.method == "ensemble-smoother"
    assert any("95 % of the ensemble: E " in note for note in smoothed.notes)
    (one,), (other,) = newton.varied, smoothed.varied
    assert one.reduction.max() > 0.5
    assert np.log(one.values.max() / one.values.min()) > 0.03
    apart = np.log(other.values / one.values)
    assert np.all(np.abs(apart) <= 4 * one.sd * np.sqrt(5 / members))
    assert other.sd == pytest.approx(one.sd, rel=close)


def test_another_field_cannot_be_predicted_from_a_fit(early, tmp_path):
    """Modes are of one covariance: another length, other modes."""
    path, _ = early
    out, other = path.with_name("case.fit.h5"), path.with_name("other.yaml")
    other.write_text(path.read_text())
    same = run_command("predict", out, "--case", other, "-o", tmp_path / "same.h5")
    assert same.exit_code == 0, same.output
    other.write_text(path.read_text().replace("length: 3 m", "length: 4 m"))
    refused = run_command("predict", out, "--case", other, "-o", tmp_path / "other.h5")
    assert refused.exit_code == 3
    assert "the modes of rock.E are not those of the fit" in " ".join(refused.output.split())


def test_a_scan_and_a_plan_speak_of_the_parameters_of_the_case(tmp_path):
    path = write(tmp_path)
    scanned = run_command("scan", path, "--set", "fit.scan.points=3", "--json", "-q")
    assert scanned.exit_code == 0, scanned.output
    assert "mode-" not in scanned.stdout
    planned = run_command("check", path, "--identifiability")
    assert planned.exit_code == 0, planned.output
    assert "mode-" not in planned.output


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A fit of a field and draws of its posterior."""
    path = write(tmp_path_factory.mktemp("drawn"))
    fit = fitted(path)
    done = run_command("sample", path.with_name("case.fit.h5"), "-n", 200, "--effective", 100)
    assert done.exit_code == 0, done.output
    return fit, path.with_name("case.sample.h5"), done


def test_a_sample_of_a_field_says_its_mean_and_spread_at_the_elements(drawn):
    """Those of its own draws, not those of the fit."""
    fit, path, _ = drawn
    sampled = read_result(path)
    (found,) = sampled.varied
    (of_fit,) = fit.varied
    draws = sampled.posterior
    assert found.elements.tolist() == of_fit.elements.tolist()
    assert not np.array_equal(found.values, of_fit.values)
    inputs = inputs_of_result(sampled, str(path))
    model = build_model(inputs)
    (made,) = model.on_mesh.fields
    points = model.discretization.points
    first = found.elements[0]
    mine = points.element[made.points] == first
    weight = points.volume[made.points][mine]
    modes = weight / weight.sum() @ made.modes[mine]
    logarithm = np.log(draws.flat[:, 0]) + draws.flat[:, 2:] @ modes
    assert found.values[0] == pytest.approx(np.exp(logarithm.mean()), rel=1e-9)
    assert found.sd[0] == pytest.approx(logarithm.std(), rel=1e-9)
    assert found.sd == pytest.approx(of_fit.sd, rel=0.25)


def test_draws_of_a_field_are_opened_by_arviz_and_leave_the_modes_unsaid(drawn):
    _, path, done = drawn
    data = arviz.from_netcdf(path).load()
    data.close()
    assert data.posterior["rock.E"].dims == ("chain", "draw", "rock.E_mode")
    assert data.posterior["rock.E"].shape[2] == 12
    for said in (done.output, run_command("show", path).output):
        assert "rock.E" in said
        assert "mode-" not in said, said


def test_a_sample_says_that_the_size_of_an_estimated_model_error_is_not_drawn(drawn):
    fit = drawn[0]
    nothing = np.empty((0, 0))
    table = ModelErrorTable(
        "estimated", 0.12, 0.03, 0.31, 20.0, *np.empty((2, 0)), (), nothing, nothing
    )
    assert not any("size of the model error" in note for note in granted(fit, ()))
    (said,) = granted(replace(fit, model_error=table), ())[1:]
    assert "that of the fit in all draws (12 % of the computed motion" in said
    assert "3 % to 31 %" in said
    assert len(granted(replace(fit, model_error=replace(table, kind="given")), ())) == 1


def test_a_model_whose_modes_are_others_than_those_of_the_fit_is_refused(drawn, tmp_path):
    """The same mesh and field, but more ground is of the material: the modes are others."""
    path = drawn[1].with_name("case.yaml")
    for name in ("trench.inp", "readings.csv", "case.fit.h5"):
        (tmp_path / name).write_bytes(path.with_name(name).read_bytes())
    text = path.read_text().replace("lower: rock}", "lower: soft}")
    text = text.replace("materials:\n", "materials:\n  soft: {E: 5 GPa, nu: 0.25}\n")
    (tmp_path / "new.yaml").write_text(text)
    new = ("--case", tmp_path / "new.yaml", "-o", tmp_path / "new.predict.h5")
    done = run_command("predict", tmp_path / "case.fit.h5", *new)
    assert done.exit_code == 3, done.output
    said = " ".join(done.stderr.split())
    assert "new.yaml:10" in said
    assert "the modes of rock.E are not those of the fit: they are of 22 elements" in said


def test_modes_that_turned_out_otherwise_are_noticed(drawn, tmp_path):
    """As with another version of a library: here the coefficient of a mode has the other sign."""
    fit, path, _ = drawn
    inputs = inputs_of_result(fit, str(path))
    model = build_model(inputs)
    values = fit.parameters.values.copy()
    require_same_modes(fit, model, inputs.case, values)
    values[np.argmax(np.abs(values[2:])) + 2] *= -1.0
    with pytest.raises(InputError, match=r"give values up to .* % from those of the fit"):
        require_same_modes(fit, model, inputs.case, values)


def test_a_comparison_counts_the_parameters_that_people_see(drawn, tmp_path):
    path = drawn[1].with_name("case.fit.h5")
    plain = tmp_path / "case.yaml"
    write_case(tmp_path).write_text(CASE.replace("stages: [first]", ALL))
    (tmp_path / "readings.csv").write_text(READINGS)
    assert run_command("fit", plain).exit_code in (0, 4)
    done = run_command("compare", plain.with_name("case.fit.h5"), path, "--json")
    told = json.loads(done.stdout)["models"]
    assert [(model["parameters"], model["modes"]) for model in told] == [(2, 0), (2, 12)]
    shown = run_command("compare", plain.with_name("case.fit.h5"), path).stdout
    assert "2 + 12 modes" in shown
