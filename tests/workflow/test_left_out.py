"""``fit: {predict_gauges: [..]}``: a gauge is left out of the fit, predicted and scored."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
from support.commands import run_command
from support.trench import write_case

from geoident.io.result.file import read_result

ALL = ("--set", "fit.stages=[first, second]")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The trench with its settlement left out, and without the readings of it at all."""
    path = write_case(tmp_path_factory.mktemp("left-out"))
    out = run_command("fit", path, *ALL, "--set", "fit.predict_gauges=[S]")
    assert out.exit_code == 0, out.output
    other = path.with_name("without.yaml")
    other.write_text(path.read_text().replace("readings.csv", "without.csv"))
    lines = path.with_name("readings.csv").read_text().splitlines()
    kept = [line for line in lines if not line.startswith("S,")]
    path.with_name("without.csv").write_text("\n".join(kept) + "\n")
    assert run_command("fit", other, *ALL).exit_code == 0
    return path, out


def test_its_readings_take_no_part(fitted):
    path, _ = fitted
    left, without = (read_result(str(path.with_name(name)))
                     for name in ("case.fit.h5", "without.fit.h5"))  # fmt: skip
    np.testing.assert_allclose(left.parameters.values, without.parameters.values, rtol=1e-9)
    row = left.gauges.channels.index("S")
    assert not left.gauges.used[row].any()
    others = np.delete(np.arange(len(left.gauges.channels)), row)
    assert left.gauges.used[others].all()
    # motions are (a + b K0) / E: the posterior on a grid, and the error of the gauge
    E, K0 = left.parameters.values
    log_E, K = np.meshgrid(np.log(E) + np.linspace(-1, 2, 1500), np.linspace(0.2, 4, 1000))
    computed, per_K0, measured = (
        left.gauges.computed,
        left.sensitivity[..., 1],
        left.gauges.measured,
    )

    def motion(i, j):
        return E / np.exp(log_E) * (computed[i, j] + per_K0[i, j] * (K - K0))

    off = sum(((motion(i, j) - measured[i, j]) / 1e-5) ** 2 for i in others for j in (0, 1))
    weight = np.exp(-0.5 * (off - off.min()))
    for j in (0, 1):
        square = np.average((motion(row, j) - computed[row, j]) ** 2, weights=weight) + 1e-5**2
        np.testing.assert_allclose(left.prediction.sd[row, j], np.sqrt(square), rtol=0.02)
    assert np.isnan(left.prediction.mean[others]).all()


def test_it_is_scored_everywhere(fitted):
    """Counted by hand from bands and readings; on screen, page, JSON, CSV and in the file."""
    path, out = fitted
    result_file = path.with_name("case.fit.h5")
    result = read_result(str(result_file))
    row = result.gauges.channels.index("S")
    measured, bands = result.gauges.measured[row], result.prediction
    inside = np.sum((measured >= bands.lower95[row]) & (measured <= bands.upper95[row]))
    ends = np.where(measured < bands.mean[row], bands.lower95[row], bands.upper95[row])
    z = 1.96 * (measured - bands.mean[row]) / np.abs(ends - bands.mean[row])
    table = result.left_out
    assert table.names == ("S",)
    assert table.readings.tolist() == [2]
    assert table.inside.tolist() == [inside]
    assert table.rms[0] == pytest.approx(np.sqrt(np.mean(z**2)), rel=0.02)
    assert "Gauges left out of the fit" in out.output
    shown = run_command("show", result_file).output
    said = f"S, left out of the fit, is predicted: {inside} of 2 readings inside the 95 % band"
    assert said in " ".join(shown.split())
    told = json.loads(run_command("show", result_file, "--json").stdout)
    assert told["left_out"][0]["gauge"] == "S"
    assert told["left_out"][0]["inside"] == inside
    assert "# left-out" in run_command("show", result_file, "--csv").stdout
    with h5py.File(result_file) as file:
        assert file["left_out/predicted"][()].tolist() == [2]


@pytest.mark.usefixtures("plain_pictures")
def test_the_page_and_a_prediction_show_it(fitted):
    path, _ = fitted
    result_file = path.with_name("case.fit.h5")
    page = path.with_name("page.html")
    assert run_command("report", result_file, "-o", page).exit_code == 0
    assert "Gauges left out of the fit" in page.read_text()
    done = run_command("predict", result_file)
    assert done.exit_code == 0, done.output
    again = read_result(str(path.with_name("case.predict.h5")))
    before = read_result(str(result_file))
    np.testing.assert_allclose(again.prediction.upper95, before.prediction.upper95, rtol=1e-6)
    assert again.left_out.inside.tolist() == before.left_out.inside.tolist()


def test_a_single_channel_and_a_name_that_is_none(tmp_path):
    path = write_case(tmp_path)
    out = run_command("fit", path, *ALL, "--set", "fit.predict_gauges=[X.a]")
    assert out.exit_code == 0, out.output
    assert read_result(str(tmp_path / "case.fit.h5")).left_out.names == ("X.a",)
    out = run_command("check", path, "--set", "fit.predict_gauges=[X.b]")
    assert out.exit_code == 3
    assert "there is no gauge 'X.b'" in out.output
