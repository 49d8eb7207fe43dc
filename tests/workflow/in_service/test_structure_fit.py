"""A dam on its mesh, fitted to readings in service and controlled.

The readings are computed on a mesh of four times as many elements, at other parameters than those
from which the fit begins, with noise that lasts.
"""

import json
import re
import shlex

import h5py
import numpy as np
import pytest
from support.dam_on_mesh import CASE, FIRST, TRUTH, Happening, write
from support.service_dam import YEAR

import geoident
from tests.support.commands import run_command

GAUGES = ("P58", "P30", "IP", "L58", "EH:a20")


def without_temperatures(case, *, keep=False):
    """Only the level acts; parameters of heat stay if asked for, or go."""
    case = case.replace("  air: {file: loads.csv}\n", "").replace("  film: 20 W/m2K\n", "")
    case = case[: case.index("  water_temperature")] + case[case.index("service:") :]
    case = case.replace(", air: [downstream, crest, ground]", "")
    if not keep:
        rows = case.splitlines(keepends=True)
        case = "".join(row for row in rows if not row.startswith(("  alpha:", "  k:")))
        case = case.replace("expansion: $alpha, conductivity: $k,", "expansion: 1e-5 1/K,")
    return case


def run(command, *arguments, code=0):
    done = run_command(command, *map(str, arguments), "--json")
    assert done.exit_code == code, done.output[:2000]
    return json.loads(done.stdout)


DAY = 7.2 * YEAR
"""When something happens, of years of which six are fitted."""

DRIFT = {"drift.csv": Happening({"P30": lambda t: np.where(t > DAY, (t - DAY) / YEAR, 0.0)})}
FALLS = {
    "rock.csv": Happening(day=DAY, becomes={"E_rock": 0.6 * TRUTH["E_rock"]}),
    "dam.csv": Happening(day=DAY, becomes={"E_dam": 0.75 * TRUTH["E_dam"]}),
}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dam")
    return folder, run("fit", write(folder, seed=4, fine=True, also=DRIFT))


@pytest.fixture(scope="module")
def fallen(tmp_path_factory):
    """Of the same dam, readings after a parameter fell: an analysis of the finer mesh each."""
    folder = tmp_path_factory.mktemp("fallen")
    write(folder, seed=4, fine=True, also=FALLS)
    return folder


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
    said = run("fit", write(tmp_path, seed=4, physics=truth))
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


def controlled(fitted, tmp_path, new):
    """The control of readings to which something has happened, and the path of its result."""
    out = tmp_path / "later.h5"
    return run("control", fitted[0] / "dam.fit.h5", "--readings", new, "-o", out, code=8), out


def days(text):
    return (np.datetime64(text[:10]) - FIRST).astype(int)


@pytest.mark.slow  # of a seasonal model: test_seasonal_fit.py
def test_control_names_the_gauge_that_drifts(tmp_path, fitted):
    said, _ = controlled(fitted, tmp_path, fitted[0] / "drift.csv")
    assert said["status"] == "amber"
    assert "parameter_changes" not in said
    (row,) = (one for one in said["changes"] if one["lasts"])
    assert (row["gauge"], row["kind"]) == ("P30", "drift")
    assert row["size"] * 1e3 == pytest.approx(1.0, abs=3.5 * row["sd"] * 1e3)
    assert abs(days(row["since"]) - DAY) < 120


@pytest.mark.slow  # of a shipped dam: tests/cases/test_dam_in_service.py
@pytest.mark.parametrize("name", ["rock", "dam"])
def test_control_names_the_parameter_that_falls(tmp_path, fitted, fallen, name):
    """Of all gauges together, of a truth of another mesh: which, how much, and since when."""
    said, out = controlled(fitted, tmp_path, fallen / f"{name}.csv")
    assert said["status"] == "red"
    (row,) = said["parameter_changes"]
    assert (row["parameter"], row["lasts"]) == (f"E_{name}", True)
    assert row["odds"] > 0.9
    part = {"rock": 0.6, "dam": 0.75}[name]
    assert row["lower95"] < part * row["before"] < row["upper95"]
    assert row["upper95"] - row["lower95"] < 0.25 * row["before"]
    assert days(row["earliest"]) - 5 < DAY < days(row["latest"]) + 5
    assert days(row["shown"]) - DAY < 90
    assert not [one for one in said.get("changes", ()) if one["lasts"]]
    (sentence,) = (f["sentence"] for f in said["findings"] if f["subject"] == f"E_{name}")
    assert re.match(rf"E_{name} fell by \d+\.?\d* % \(.* to .* %\) since 2017-0", sentence)
    table = run_command("export", str(out), "--table", "parameter-changes").stdout
    assert f"E_{name}" in table
    assert "GPa" in table
    page = tmp_path / "status.html"
    assert run_command("report", str(out), "-o", str(page)).exit_code == 0
    assert "Parameters that have changed" in page.read_text()
    assert f"E_{name} fell by" in page.read_text().partition("Gauges and their last readings")[2]


@pytest.mark.slow
def test_what_would_be_seen_of_a_parameter_is_told_before(fitted, tmp_path):
    words = [
        "E_rock falls 10 %",
        "E_rock falls 40 %",
        "E_rock falls by 13.3 GPa",
        "E_dam rises 1 %",
    ]
    asked = [part for text in words for part in ("--power", text)]
    said = run("control", fitted[0] / "dam.fit.h5", *asked, "-o", tmp_path / "power.h5")
    little, much, by, hardly = said["power"]
    assert little["probability"] < 0.6
    assert much["probability"] > 0.97
    assert by["probability"] == pytest.approx(much["probability"], abs=0.05)
    assert 10.0 * 86400.0 < much["median"] < 200.0 * 86400.0
    assert hardly["probability"] < 0.35  # false alarms: 18 % in two years are stated
    assert much["gauges"] == "P58, P30, IP, L58, EH.a20"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("E_rok falls 20 %", "Did you mean 'E_rock'?"),
        ("E_rock falls 100 %", "leaves nothing of E_rock"),
        ("E_rock falls 0 %", "write a size above zero"),
        ("E_rock rises by 2 mm", "of E_rock"),
    ],
)
def test_changes_of_parameters_that_cannot_be_are_refused(fitted, tmp_path, words, expected):
    out = tmp_path / "power.h5"
    done = run_command("control", str(fitted[0] / "dam.fit.h5"), "--power", words, "-o", str(out))
    assert done.exit_code == 2
    assert expected in " ".join(done.output.split())


@pytest.mark.slow  # half a minute a dam
def test_parameters_that_fall_come_to_light_as_probably_as_told(tmp_path):
    """Of a dozen dams; as they are they have an alarm as seldom as stated."""
    words = {"rock": "E_rock falls 20 %", "dam": "E_dam falls 8 %"}
    also = {
        "rock.csv": Happening(day=6.0 * YEAR, becomes={"E_rock": 0.8 * TRUTH["E_rock"]}),
        "dam.csv": Happening(day=6.0 * YEAR, becomes={"E_dam": 0.92 * TRUTH["E_dam"]}),
    }
    told, seen, alarmed, right = [], [], [], []
    for number in range(12):
        folder = tmp_path / str(number)
        case = write(folder, seed=4, noises=number, years=8.0, fine=True, also=also)
        run("fit", case)
        fit, out = str(folder / "dam.fit.h5"), str(folder / "out.h5")
        asked = [part for text in words.values() for part in ("--power", text)]
        first = run_command("control", fit, *asked, "--json")
        said = json.loads(first.stdout)
        told += [row["probability"] for row in said["power"]]
        alarmed.append(first.exit_code == 8 or "changes" in said or "parameter_changes" in said)
        for name in words:
            done = run_command("control", fit, "--readings", folder / f"{name}.csv", "-o", out,
                               "--force", "--json")  # fmt: skip
            later = json.loads(done.stdout)
            kinds = [row["kind"] for row in later.get("changes", ()) if row["kind"] != "reading"]
            rows = later.get("parameter_changes", ())
            seen.append(bool(kinds or rows))
            if not alarmed[-1]:  # else the alarm may be of before the change
                right += [row["parameter"] == f"E_{name}" for row in rows[:1]]
    spread = np.sqrt(np.mean(told) * (1.0 - np.mean(told)) / len(seen))
    assert np.mean(seen) == pytest.approx(np.mean(told), abs=3.0 * spread)
    assert np.mean(right) > 0.75
    assert np.mean(alarmed) <= 0.6  # 0.18 in two years, and three standard deviations of 12


@pytest.mark.slow  # three fits
def test_later_readings_are_judged_and_fitted_in_from_the_answer_before(tmp_path):
    """As in a fit of all of them; the history has the parameters before and after."""
    path = write(tmp_path, seed=4, case=without_temperatures(CASE))
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
    case = without_temperatures(CASE, keep=True)
    said = run("fit", write(tmp_path, case=case, years=7.0, every=24.0), code=4)
    assert said["status"] == "not-determined"
    assert {n for n, q in said["parameters"].items() if not q["determined"]} >= {"alpha", "k"}


def test_only_gauges_with_enough_readings_are_fitted(tmp_path):
    path = write(tmp_path, years=7.0, every=24.0, case=without_temperatures(CASE))
    rows = (tmp_path / "readings.csv").read_text().splitlines()
    few = [r for r in rows if not r.startswith("L58")] + [r for r in rows if r.startswith("L58")][
        :4
    ]
    (tmp_path / "readings.csv").write_text("\n".join(few) + "\n")
    said = run("fit", path)
    (finding,) = (f for f in said["findings"] if "L58" in f["subject"])
    assert "cannot be fitted" in finding["sentence"]


PROJECT = """format: geoident-project/1
title: Two blocks
sections:
  - {name: left, case: dam.yaml}
  - {name: right, case: dam.yaml}
shared: [E_rock]
"""


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("backtest dam.yaml", "have dates, not stages"),
        ("scan dam.yaml", "have dates, not stages"),
        ("simulate dam.yaml", "have dates, not stages"),
        ("check dam.yaml --identifiability", "have dates, not stages"),
        ("check dam.yaml --mesh-error", "have dates, not stages"),
        ("export dam.yaml --format pest -o control", "have dates, not stages"),
        ("export dam.yaml --format dakota -o study", "have dates, not stages"),
        ("plan dam.yaml --candidates c.yaml --budget 1 --for E_dam", "have dates, not stages"),
        ("fit project.yaml", "have dates, not stages"),
        ("check dam.yaml --set 'decision={if: P58 > 3 mm at in service, then: drain}'",
         "a decision is on the reading of a stage"),
    ],
)  # fmt: skip
def test_what_goes_stage_by_stage_is_refused(fitted, monkeypatch, words, why):
    folder, _ = fitted
    monkeypatch.chdir(folder)
    (folder / "project.yaml").write_text(PROJECT)
    files = set(folder.iterdir())
    done = run_command(*shlex.split(words))
    assert done.exit_code == 3, done.output
    assert why in done.output
    assert "    " in done.output  # with what to do in its place
    assert set(folder.iterdir()) == files


@pytest.mark.parametrize("command", ["predict", "sample"])
def test_commands_on_fits_of_stages_are_refused(fitted, command):
    folder, _ = fitted
    done = run_command(command, str(folder / "dam.fit.h5"))
    assert done.exit_code == 3
    assert "structure in service" in done.output


@pytest.mark.slow  # two fits; one that goes on follows
def test_an_interrupted_fit_goes_on_where_it_was(tmp_path):
    """As with Ctrl-C: what was computed is kept, and the answer is that of a whole fit."""
    path = write(tmp_path, years=7.0, case=without_temperatures(CASE))
    cut, whole = tmp_path / "cut.h5", tmp_path / "whole.h5"
    begun = []

    def stop(step):
        begun.append(step)
        if step.number == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        geoident.fit(path, output=cut, progress=stop)
    assert cut.with_suffix(".checkpoint").exists()
    resumed, complete = geoident.fit(path, output=cut), geoident.fit(path, output=whole)
    assert not cut.with_suffix(".checkpoint").exists()
    for name, one in complete.parameters.items():
        assert resumed.parameters[name].value == one.value
    one, other = (run("show", file)["counts"] for file in (cut, whole))
    assert one["evaluations"] == other["evaluations"]
    assert one["factorizations"] < other["factorizations"]


@pytest.mark.slow  # one that was interrupted goes on, above
def test_a_fit_that_ran_out_of_time_goes_on(tmp_path):
    path = write(tmp_path, years=7.0, every=24.0, case=without_temperatures(CASE))
    assert run("fit", path, "--max-time", "0s", code=4)["status"] == "out-of-budget"
    assert (tmp_path / "dam.fit.checkpoint").exists()
    assert run("fit", path)["status"] == "converged"


@pytest.mark.slow
def test_one_creep_of_the_concrete_explains_all_gauges(tmp_path):
    """Under its weight and the water; the motion of each gauge is told beside that of the level."""
    case = without_temperatures(CASE)
    case = case.replace(
        "scale: log}\nmaterials:",
        "scale: log}\n  phi: {start: 0.3, bounds: [0, 3]}\n"
        "  tau: {start: 3 years, bounds: [0.2 years, 20 years], scale: log}\nmaterials:",
    )
    case = case.replace("E: $E_dam,", "E: $E_dam, creep: {share: $phi, time: $tau},")
    truth = {**TRUTH, "phi": 0.9, "tau": 1.5 * YEAR * 86400.0}
    case = case.replace("  linear: true\n", "")
    still = dict.fromkeys(GAUGES, lambda t: -0.15 * t / YEAR)  # what all readings have there
    path = write(tmp_path, case=case, truth=truth, years=7.0, changes=still)
    said = run("fit", path)
    assert said["status"] == "converged"
    for name, one in said["parameters"].items():
        assert abs(one["value"] - truth[name]) < 3.5 * one["sd"], name
        assert one["sd"] < 0.25 * truth[name], name
    own = said["seasonal"]["gauges"]["P58"]
    assert 0 < own["creep_sd"] < 0.2 * abs(own["creep"])
    shown = run_command("show", str(tmp_path / "dam.fit.h5")).stdout
    assert "creep" in shown.split("Effects on the gauges")[1].splitlines()[1]
