"""The model error of models without ground of their own: given, estimated, and lasting in time."""

import numpy as np
import pytest
from support.external import (
    EXTERNAL,
    HEAD,
    PROGRAM,
    PYTHON,
    READINGS,
    SCRIPT,
    TEMPLATE,
    trusted,
    write_table_case,
)
from support.settlement_plates import (
    SD,
    days_of,
    hyperbola,
    inside_later,
    measured,
    predicted,
    settlement,
    write_plate,
)

from geoident.api import fit, load_case, predict
from geoident.errors import InputError


@pytest.fixture(scope="module")
def plates(tmp_path_factory):
    """Of eight plates the later readings inside and in all, and half widths, with and without."""
    folder = tmp_path_factory.mktemp("plates")
    truths = [settlement(np.random.default_rng(100 + seed)) for seed in range(8)]
    return {
        more: [inside_later(predicted(folder, truth, seed, more=more))
               for seed, truth in enumerate(truths)]
        for more in ("", ", model_error: none")
    }  # fmt: skip


def coverage(rows):
    inside, total, _ = np.sum(rows, axis=0)
    return inside / total


def test_bands_hold_for_ground_that_consolidates_and_creeps(plates):
    """Half of the readings are known. Without model error most of the others are outside."""
    assert coverage(plates[", model_error: none"]) < 0.6
    assert coverage(plates[""]) >= 0.85


def test_bands_are_no_wider_than_what_may_come(plates):
    """A quarter of the settlement, which is about 1 m, at most."""
    assert np.mean([width for _, _, width in plates[""]]) < 0.25


def test_bands_of_a_right_model_stay_narrow(tmp_path):
    rows = [inside_later(predicted(tmp_path, hyperbola(), seed)) for seed in range(4)]
    assert coverage(rows) > 0.9
    assert np.mean([width for _, _, width in rows]) < 0.1


def test_the_time_is_stated_and_shown(tmp_path):
    """Errors that last longer leave wider bands where the readings say as little of them."""
    found = {
        days: predicted(
            tmp_path, settlement(np.random.default_rng(1)), 1,
            more=f", model_error: {{size: 20 %, time: {days} days}}",
        )
        for days in (30, 300)
    }  # fmt: skip
    for days, result in found.items():
        error = result.model_error
        assert error.time == pytest.approx(days * 86400.0)
        assert error.time_unit == "s"
        assert (error.kind, error.size) == ("given", 0.2)
    widths = [inside_later(result)[2] for result in found.values()]
    assert widths[0] != pytest.approx(widths[1], rel=0.1)


def test_a_time_without_dates_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "case.yaml"
    (tmp_path / "opening.py").write_text(SCRIPT)
    (tmp_path / "readings.csv").write_text(READINGS)
    more = "fit: {model_error: {time: 3 days}, "
    path.write_text(PYTHON + HEAD.replace("fit: {", more))
    with pytest.raises(InputError) as refused:
        load_case(str(path))
    [fault] = refused.value.faults
    assert fault.message == "the stage 'half' has no date"
    assert "dates: {half: 2024-03-01}" in fault.hint


@pytest.mark.parametrize("kind", ["program", "python", "table"])
def test_a_given_size_widens_intervals(tmp_path, kind):
    """Of six readings of an opening by a program, a function, a table, with and without 15 %."""
    if kind == "table":
        path = write_table_case(tmp_path, 60)
        text = path.read_text()
    else:
        text = (EXTERNAL if kind == "program" else PYTHON) + HEAD
    (tmp_path / "opening.py").write_text(PROGRAM if kind == "program" else SCRIPT)
    (tmp_path / "opening.template").write_text(TEMPLATE)
    (tmp_path / "readings.csv").write_text(READINGS)
    sd = {}
    for error in ("none", "15 %"):
        path = tmp_path / "case.yaml"
        path.write_text(text.replace("fit: {", f"fit: {{model_error: {error}, "))
        with trusted():
            sd[error] = fit(load_case(str(path)), force=True).data.parameters.sd
    assert np.all(sd["15 %"] > 2.0 * sd["none"])


def test_two_plates_are_predicted_as_the_formulas_of_dense_matrices(tmp_path):
    """By hand (theory 9.1): relative errors of 20 %, half shared, alike over log(1 + t / 60)."""
    rng = np.random.default_rng(5)
    days, truth = days_of(rng, 14), settlement(np.random.default_rng(7))
    both = np.column_stack([factor * measured(rng, truth, days) for factor in (1.0, 0.8)])
    more = ", model_error: {size: 20 %, time: 60 days}"
    path = write_plate(tmp_path, days, both, fitted=8, plates=("P", "Q"), more=more)
    result = fit(load_case(str(path))).data
    names = {f"d{day:.0f}": np.log1p(day / 60.0) for day in days}
    stages = [j for j, stage in enumerate(result.gauges.stages) if stage in names]
    places = [(i, j) for j in stages for i in range(2)]
    v, y = (np.array([table[at] for at in places])
            for table in (result.gauges.computed, result.gauges.measured))  # fmt: skip
    J = np.array([result.sensitivity[at] for at in places])
    plate = np.array([i for i, _ in places])
    tau = np.array([names[result.gauges.stages[j]] for _, j in places])
    mean = np.sqrt(0.5 * sum(v[plate == i] ** 2 for i in (0, 1)))[np.repeat(range(len(days)), 2)]
    steps = np.diff(np.concatenate([[np.zeros(2)], v.reshape(-1, 2)]), axis=0)
    floor = 0.1 * np.cumsum(np.sqrt(np.mean(steps**2, axis=1)))[np.repeat(range(len(days)), 2)]
    assert np.all(floor <= mean)
    lasting = np.exp(-np.abs(tau[:, None] - tau))
    alike = np.where(plate[:, None] == plate, 1.0, 0.5) * lasting
    C = 0.04 * (np.outer(v, v) + np.outer(floor, floor)) * alike + SD**2 * np.eye(len(v))
    g = 16
    K = np.linalg.solve(C[:g, :g], C[:g, g:]).T
    known = np.linalg.inv(J[:g].T @ np.linalg.solve(C[:g, :g], J[:g]))
    moved = J[g:] - K @ J[:g]
    variance = np.diag(moved @ known @ moved.T) + np.diag(C[g:, g:]) - np.sum(K * C[g:, :g], axis=1)
    at = tuple(np.array(places[g:]).T)
    np.testing.assert_allclose(result.prediction.sd[at], np.sqrt(variance), rtol=0.02)
    np.testing.assert_allclose(result.prediction.mean[at], v[g:] + K @ (y - v)[:g], rtol=0.02)


def test_predict_says_what_the_fit_said(tmp_path):
    """From the file: the sizes, the times of the readings used, and those of later ones."""
    fitted = predicted(tmp_path, settlement(np.random.default_rng(1)), 1)
    again = predict(str(tmp_path / "case.fit.h5")).data
    for name in ("mean", "sd", "lower95", "upper95"):
        of_fit, of_predict = (getattr(one.prediction, name) for one in (fitted, again))
        np.testing.assert_allclose(of_predict, of_fit, rtol=1e-6, atol=1e-9)


def test_stages_without_dates_are_the_clock(tmp_path):
    """As many stages ahead as were read: a correlation time of a third of the latter."""
    rng = np.random.default_rng(2)
    days = days_of(rng)
    path = write_plate(
        tmp_path, days, measured(rng, hyperbola(), days), fitted=12, more=", model_error: 10 %"
    )
    lines = ["import json", f"DAYS = {[float(day) for day in days]!r}", ""]
    lines += [
        "def readings(values):",
        "    return {'P': {f'd{t:.0f}': values['s'] * t / (values['h'] + t) for t in DAYS}}",
        "",
    ]
    (tmp_path / "hyper.py").write_text("\n".join(lines))
    names = [f"d{day:.0f}" for day in days]
    path.write_text(f"""\
format: geoident-case/1
model: {{kind: python, function: "hyper:readings"}}
parameters:
  s: {{start: 1 m, bounds: [0.05 m, 20 m], scale: log}}
  h: {{start: 100, bounds: [1, 3000], scale: log}}
stages: [{", ".join(f"{{name: {name}}}" for name in names)}]
gauges: {{P: {{kind: reading, accuracy: 5 mm, zero: virgin}}}}
readings: readings.csv
fit: {{stages: [{", ".join(names[:12])}], backtest: false, model_error: 10 %}}
""")
    with trusted():
        error = fit(load_case(str(path))).data.model_error
    assert (error.time, error.time_unit) == (4.0, "stages")
    np.testing.assert_allclose(error.moments[:12], np.log1p(np.arange(1, 13) / 4.0))
