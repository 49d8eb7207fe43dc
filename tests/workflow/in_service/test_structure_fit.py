"""A dam on its mesh, fitted to readings in service and controlled.

The readings are computed on a mesh of four times as many elements, at other parameters than those
from which the fit begins, with noise that lasts.
"""

import json

import h5py
import numpy as np
import pytest
from support.dam_on_mesh import CASE, FIRST, TRUTH, write
from support.service_dam import YEAR

from tests.support.commands import run_command


def run(command, *arguments, code=0):
    done = run_command(command, *map(str, arguments), "--json")
    assert done.exit_code == code, done.output[:2000]
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dam")
    return folder, run("fit", write(folder, seed=4, fine=True))


def test_parameters_come_back_with_their_intervals(fitted):
    _, said = fitted
    assert said["status"] == "converged"
    for name, true in TRUTH.items():
        found = said["parameters"][name]
        assert abs(found["value"] - true) < 3.5 * found["sd"], name
        assert found["sd"] < 0.12 * true, name


def test_one_factorization_for_each_parameter_vector(fitted):
    _, said = fitted
    assert said["counts"]["evaluations"] <= 20
    assert said["counts"]["factorizations"] <= 30


def test_later_readings_lie_inside_their_bands(fitted):
    folder, _ = fitted
    with h5py.File(folder / "dam.fit.h5") as result:
        e = result["judged/innovation"][()]
    e = e[np.isfinite(e)]
    assert len(e) > 400
    assert 0.90 <= np.mean(np.abs(e) < 1.96) <= 0.985
    assert np.std(e) == pytest.approx(1.0, abs=0.12)


def test_effects_are_those_of_the_truth(fitted):
    """What the level does to each gauge over the fitted years, within the interval."""
    _, said = fitted
    effects = said["seasonal"]["gauges"]
    for gauge in ("P58", "P30", "IP"):
        own = effects[gauge]
        assert own["irreversible"] == pytest.approx(0.15e-3 * 6.0, abs=4 * own["irreversible_sd"])
        assert 0 < own["level_sd"] < 0.1 * own["level"]
        assert 0 < own["temperature_sd"] < 0.1 * own["temperature"]


def test_control_of_a_sound_dam_is_green(fitted):
    folder, _ = fitted
    assert run("control", folder / "dam.fit.h5", "-o", folder / "sound.h5")["status"] == "green"


def test_the_model_of_the_same_physics_hardly_errs(fitted):
    _, said = fitted
    assert said["model_error"]["size"] < 0.03
    assert said["model_error"]["lower95"] < 0.01


@pytest.mark.slow
def test_a_dam_of_other_physics_lies_in_the_intervals(tmp_path):
    """Less film, rock that stays cold, other water and other Poisson's ratios than the model's.

    Without an error of the model the noise of P58 is three times its accuracy, and the interval of
    E_rock ends far below the truth.
    """
    truth = CASE
    for old, new in {
        "expansion: 0.8e-5": "expansion: 0.1e-5", "film: 20": "film: 6",
        "amplitude: 8 K": "amplitude: 5 K", "E: $E_dam, nu: 0.2": "E: $E_dam, nu: 0.3",
        "E: $E_rock, nu: 0.25": "E: $E_rock, nu: 0.1",
    }.items():  # fmt: skip
        assert old in truth
        truth = truth.replace(old, new)
    said = run("fit", write(tmp_path, seed=4, truth=truth))
    for name, true in TRUTH.items():
        one = said["parameters"][name]
        assert abs(np.log(one["value"] / true)) < 2.5 * one["sd"] / one["value"], name
    gauges = said["seasonal"]["gauges"]
    assert gauges["P58"]["scatter"] < 0.2e-3
    assert gauges["IP"]["scatter"] < 0.15e-3
    assert 0.04 < said["model_error"]["size"] < 0.2
    with h5py.File(tmp_path / "dam.fit.h5") as result:
        e = result["judged/innovation"][()]
    e = e[np.isfinite(e)]
    assert 0.88 <= np.mean(np.abs(e) < 1.96) <= 0.985


def test_control_names_the_gauge_that_drifts(tmp_path, fitted):
    drift = {"P30": lambda t: np.where(t > 7.2 * YEAR, 1.0 * (t - 7.2 * YEAR) / YEAR, 0.0)}
    case = write(tmp_path, seed=4, fine=True, changes=drift)
    run("fit", case)
    said = run("control", tmp_path / "dam.fit.h5", code=8)
    assert said["status"] == "amber"
    (row,) = (one for one in said["changes"] if one["lasts"])
    assert (row["gauge"], row["kind"]) == ("P30", "drift")
    assert row["size"] * 1e3 == pytest.approx(1.0, abs=3.5 * row["sd"] * 1e3)
    began = (np.datetime64(row["since"][:10]) - FIRST).astype(int)
    assert abs(began - 7.2 * YEAR) < 120


def test_later_readings_are_judged_and_fitted_in_from_the_answer_before(tmp_path):
    """As in a fit of all of them; the history has the parameters before and after."""
    path = write(tmp_path, seed=4)
    whole = path.read_text()
    path.write_text(whole.replace("fit: {until: 2016-01-01}", "fit: {until: 2014-01-01}"))
    before = run("fit", path)
    path.write_text(whole)
    said = run("update", path)
    first, last = said["updates"]["steps"]
    assert (first["judged"], last["new"] > 100, last["judged"]) == (0, True, last["new"])
    assert last["belong"]
    past = [row for row in said["updates"]["parameters"] if row["parameter"] == "E_dam"]
    assert [row["value"] for row in past] == pytest.approx(
        [answer["parameters"]["E_dam"]["value"] for answer in (before, said)]
    )
    alone = run("fit", path, "--fresh", "--force")
    for name, one in alone["parameters"].items():
        assert said["parameters"][name]["value"] == pytest.approx(one["value"], abs=0.2 * one["sd"])


def test_parameters_that_readings_cannot_tell_are_not_numbers(tmp_path):
    """Without temperatures nothing depends on expansion and conductivity."""
    case = CASE.replace("  air: {file: loads.csv}\n", "").replace("  film: 20 W/m2K\n", "")
    start = case.index("  water_temperature")
    case = case[:start] + case[case.index("service:") :]
    case = case.replace(", air: [downstream, crest, ground]", "")
    said = run("fit", write(tmp_path, case=case), code=4)
    assert said["status"] == "not-determined"
    assert {n for n, q in said["parameters"].items() if not q["determined"]} >= {"alpha", "k"}


def test_only_gauges_with_enough_readings_are_fitted(tmp_path):
    path = write(tmp_path, years=7.0)
    rows = (tmp_path / "readings.csv").read_text().splitlines()
    few = [r for r in rows if not r.startswith("L58")] + [r for r in rows if r.startswith("L58")][
        :4
    ]
    (tmp_path / "readings.csv").write_text("\n".join(few) + "\n")
    said = run("fit", path)
    (finding,) = (f for f in said["findings"] if "L58" in f["subject"])
    assert "cannot be fitted" in finding["sentence"]


@pytest.mark.parametrize(
    "words",
    ["backtest {}", "scan {}", "simulate {}", "check {} --identifiability", "check {} --mesh-error",
     "export {} --format pest", "plan {} --candidates c.yaml --budget 1 --for E_dam"],
)  # fmt: skip
def test_commands_of_stages_are_refused(fitted, words):
    folder, _ = fitted
    done = run_command(*words.format(folder / "dam.yaml").split())
    assert done.exit_code == 3, done.output
    assert "structure in service have dates" in done.output or "readings in time" in done.output


@pytest.mark.parametrize("command", ["predict", "sample"])
def test_commands_on_fits_of_stages_are_refused(fitted, command):
    folder, _ = fitted
    done = run_command(command, str(folder / "dam.fit.h5"))
    assert done.exit_code == 3
    assert "structure in service" in done.output
