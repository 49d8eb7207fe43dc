"""``geoident sample``: the command, its file, and who reads it."""

from __future__ import annotations

import csv
import io
import itertools
import os
import sys
import warnings
from dataclasses import replace

import h5py
import numpy as np
import pytest

from geoident.errors import ExitCode, Interrupted
from geoident.io.result.file import read_result, write_result
from geoident.workflow.running import control
from geoident.workflow.running.answers import Asked
from geoident.workflow.running.control import Control, Monitor
from geoident.workflow.running.jobs import Request
from geoident.workflow.sample import SampleRequest, plan_sample, sample

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import arviz

FEW = ("-n", "1000", "--effective", "400")


@pytest.fixture
def fitted(after):
    """The folder of a case with its fit."""
    return after(("fit", "case.yaml"))


@pytest.fixture
def sampled(after):
    return after(("fit", "case.yaml"), ("sample", "case.fit.h5", *FEW))


def test_its_path_stands_on_stdout(fitted, run):
    found = run("sample", "case.fit.h5", *FEW)
    assert (found.exit_code, found.stdout) == (0, "case.sample.h5\n")


def test_draws_of_a_nearly_linear_case_agree_with_its_fit(sampled):
    """Three readings of 2 parameters, a hundredth of a millimetre: Laplace's intervals hold."""
    fit, drawn = read_result("case.fit.h5").parameters, read_result("case.sample.h5")
    table, found = drawn.parameters, drawn.posterior
    np.testing.assert_allclose(table.values, fit.values, atol=0.3 * fit.sd.max(), rtol=0.02)
    width, expected = table.upper95 - table.lower95, fit.upper95 - fit.lower95
    np.testing.assert_allclose(width, expected, rtol=0.2)
    assert found.n_draws == 1000
    assert found.least_effective >= 400
    assert found.pareto_k < 0.7
    assert drawn.status == "converged"


def test_predictions_have_the_bands_of_the_fit(sampled):
    """Of the later stage, whose readings depend on the parameters almost linearly."""
    fit, drawn = read_result("case.fit.h5").prediction, read_result("case.sample.h5").prediction
    later = np.isfinite(fit.sd)
    np.testing.assert_allclose(drawn.mean[later], fit.mean[later], atol=0.3 * fit.sd[later].max())
    width, expected = drawn.upper95 - drawn.lower95, fit.upper95 - fit.lower95
    np.testing.assert_allclose(width[later], expected[later], rtol=0.3)
    assert np.isfinite(drawn.mean).sum() > np.isfinite(fit.mean).sum()  # the fitted stage too


def test_arviz_opens_the_file(sampled):
    found = read_result("case.sample.h5").posterior
    data = arviz.from_netcdf("case.sample.h5").load()
    data.close()
    assert set(data.posterior.data_vars) == {"E", "K0"}
    assert data.posterior["E"].dims == ("chain", "draw")
    np.testing.assert_array_equal(data.posterior["E"].to_numpy(), found.values[:, :, 0])
    np.testing.assert_array_equal(data.sample_stats["lp"].to_numpy(), found.log_density)
    assert data.posterior_predictive["readings"].dims == ("chain", "draw", "reading")
    assert "CV at second" in data.posterior_predictive["reading"].to_numpy().tolist()
    assert data.posterior.attrs["pareto_k"] == found.pareto_k
    summary = arviz.hdi(data, hdi_prob=0.95)
    assert summary["K0"].shape == (2,)


def test_the_file_gives_back_what_was_written(sampled):
    first = read_result("case.sample.h5")
    write_result(first, "again.h5", overwrite=False)
    again = read_result("again.h5").posterior
    for name in ("values", "log_density", "effective", "r_hat", "predicted", "taken"):
        np.testing.assert_array_equal(getattr(first.posterior, name), getattr(again, name))
    assert again.channels == first.posterior.channels
    assert again.evaluations == first.posterior.evaluations


def test_the_table_says_quantiles_and_effective_size(sampled, run):
    told = run("show", "case.sample.h5").stdout
    assert "2.5 %" in told
    assert "97.5 %" in told
    assert "ESS" in told
    assert "Pareto k" in told
    assert "flat within the bounds: E in its logarithm; K0 in its value" in told.replace(
        "\n  ", " "
    )


def test_json_has_the_posterior(sampled, run_json):
    (found,) = run_json("show", "case.sample.h5")
    posterior = found["posterior"]
    assert posterior["draws"] == 1000
    assert posterior["parameters"]["E"]["quantiles"]["0.5"] == found["parameters"]["E"]["value"]
    assert posterior["effective_size"] >= 400


def test_draws_are_exported_in_the_units_of_the_case(sampled, run):
    text = run("export", "case.sample.h5", "--table", "draws").stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    found = read_result("case.sample.h5").posterior
    assert len(rows) == 1000
    np.testing.assert_allclose([float(r["E [GPa]"]) for r in rows], found.values[0, :, 0] / 1e9)
    assert "# draws" not in run("show", "case.sample.h5", "--csv").stdout
    assert "# posterior" in run("show", "case.sample.h5", "--csv").stdout


@pytest.mark.usefixtures("plain_pictures")
def test_the_report_has_a_corner_plot(sampled, run):
    assert run("report", "case.sample.h5", "--figures", ".").exit_code == 0
    assert "<svg" in (sampled / "posterior.svg").read_text(encoding="utf-8")
    assert "Pareto k" in (sampled / "case.sample.html").read_text()


def test_the_same_is_up_to_date_and_an_earlier_one_is_kept(sampled, run):
    again = run("sample", "case.fit.h5", *FEW)
    assert again.exit_code == 0
    assert "up to date" in again.stderr
    before = (sampled / "case.sample.h5").read_bytes()
    assert run("sample", "case.fit.h5", *FEW, "--seed", "1").exit_code == 0
    assert (sampled / "case.sample.1.h5").read_bytes() == before


def test_a_budget_that_is_too_small_is_told(fitted, run):
    found = run("sample", "case.fit.h5", *FEW, "--max-evaluations", "150")
    assert found.exit_code == ExitCode.NOT_CONVERGED
    assert "allowed are used up" in found.stderr.replace("\n", " ")
    assert read_result("case.sample.h5").status == "out-of-budget"


def test_only_a_fit_is_sampled(sampled, run):
    refused = run("sample", "case.sample.h5")
    assert refused.exit_code == ExitCode.INVALID_INPUT
    assert "A sample cannot be sampled from" in refused.stderr


def test_what_is_not_installed_is_named(fitted, run, monkeypatch):
    from geoident.identify.posterior.draws import library  # noqa: PLC0415

    library.cache_clear()
    monkeypatch.setitem(sys.modules, "emcee", None)
    refused = run("sample", "case.fit.h5")
    library.cache_clear()
    assert refused.exit_code == ExitCode.USAGE
    assert 'pip install "geoident[sample]"' in refused.stderr


class Stopping(Monitor):
    """Asks for a stop when some evaluations are done."""

    def __init__(self, control_of, number):
        self.control_of, self.number = control_of, number

    def part(self, words, done):
        if int(words.split(": ")[1].split()[0]) >= self.number:
            self.control_of().stop.ask(ExitCode.INTERRUPTED)


def test_a_run_that_was_interrupted_goes_on_from_its_checkpoint(fitted, monkeypatch):
    request = SampleRequest(Request("case.fit.h5"), draws=1000, effective=400)
    first = Control()
    first.monitor = Stopping(lambda: first, 200)
    with pytest.raises(Interrupted, match="continues from there"):
        sample(plan_sample(request), first)
    assert (fitted / "case.sample.checkpoint").exists()
    asked, once = [], Asked.answer
    with monkeypatch.context() as patch:
        patch.setattr(Asked, "answer", lambda self, p: asked.append(p) or once(self, p))
        found = sample(plan_sample(request), Control()).result.posterior
    assert len(asked) <= found.evaluations - 190
    assert not (fitted / "case.sample.checkpoint").exists()
    fresh = SampleRequest(Request("case.fit.h5", fresh=True), draws=1000, effective=400)
    whole = sample(plan_sample(fresh), Control()).result.posterior
    np.testing.assert_array_equal(whole.values, found.values)
    np.testing.assert_array_equal(whole.predicted, found.predicted)


def test_processes_give_the_same_draws(sampled, run):
    alone = read_result("case.sample.h5").posterior
    found = run("sample", "case.fit.h5", *FEW, "-j", "2", "--fresh")
    assert found.exit_code == 0, found.stderr
    together = read_result("case.sample.h5").posterior
    np.testing.assert_array_equal(together.values, alone.values)
    np.testing.assert_array_equal(together.predicted, alone.predicted)
    assert "OMP_NUM_THREADS" not in os.environ or os.environ["OMP_NUM_THREADS"]


def test_a_time_limit_ends_with_what_there_is(fitted, run, monkeypatch):
    """The time is up when it was asked for often enough, on a slow machine as on a fast one."""
    # with a reduced model all draws would be there in time
    assert run("fit", "case.yaml", "--set", "fit.reduced=false", "--force").exit_code in (0, 4)
    assert run("sample", "case.fit.h5", "--max-time", "0.001s").exit_code == 4  # nothing yet
    assert not (fitted / "case.sample.h5").exists()
    asked = itertools.count()

    def over(self):
        self.out_of_time = self.out_of_time or next(asked) > 200
        return control.OUT_OF_TIME if self.out_of_time else None

    monkeypatch.setattr(Control, "over", over)
    long = ("--max-time", "1h", "-n", "1000", "--effective", "1000")
    found = run("sample", "case.fit.h5", *long)
    assert found.exit_code == ExitCode.NOT_CONVERGED
    assert "Time limit reached" in found.stderr.replace("\n", " ")
    assert (fitted / "case.sample.checkpoint").exists()
    result = read_result("case.sample.h5")
    assert result.posterior.n_draws == 1000
    assert result.posterior.least_effective < 1000


def test_axes_are_named_and_units_told(sampled):
    with h5py.File("case.sample.h5") as file:
        assert file["posterior/E"].dims[0][0].name == "/posterior/chain"
        assert file["posterior/E"].attrs["unit"] == "Pa"


def test_draws_of_a_model_that_does_not_fit_are_not_to_be_relied_on(fitted, run):
    fit = read_result("case.fit.h5")
    write_result(replace(fit, status="poor-fit", exit_code=4), "case.fit.h5", overwrite=True)
    found = run("sample", "case.fit.h5", *FEW)
    assert found.exit_code == ExitCode.NOT_CONVERGED
    assert "does not fit the readings" in found.stderr.replace("\n", " ")


def test_the_model_error_of_the_fit_widens_draws_and_predictions(trench, run):
    """Draws and bands are those of the fit, wider than with accuracies alone."""
    for name, size in (("with", "10 %"), ("without", "none")):
        given = f"fit.model_error={size}"
        assert run("fit", "case.yaml", "--set", given, "-o", f"{name}.fit.h5").exit_code in (0, 4)
        found = run("sample", f"{name}.fit.h5", *FEW)
        assert found.exit_code == 0, found.stderr
    fit, drawn = read_result("with.fit.h5"), read_result("with.sample.h5")
    sd = read_result("without.sample.h5").parameters.sd
    assert np.all(drawn.parameters.sd > 1.5 * sd)
    width = drawn.parameters.upper95 - drawn.parameters.lower95
    np.testing.assert_allclose(width, fit.parameters.upper95 - fit.parameters.lower95, rtol=0.3)
    later = np.isfinite(fit.prediction.sd)
    band, expected = (
        result.prediction.upper95[later] - result.prediction.lower95[later]
        for result in (drawn, fit)
    )
    np.testing.assert_allclose(band, expected, rtol=0.2)
    off = np.abs(drawn.prediction.mean[later] - fit.prediction.mean[later])
    assert np.all(off < 0.25 * fit.prediction.sd[later])
