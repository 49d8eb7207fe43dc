"""``geoident update``: new readings judged by the last fit, fitted in, and the history of both.

The truths come from outside: the closed form of Kirsch in `tests.support.growing_tunnel`; and for
p-values an identity of least squares without prior, by which the errors of predictions, squared by
their covariance, are by what the least misfit of all readings exceeds that of the old ones.
"""

import csv
import io
import json
import re
import shutil

import numpy as np
import pytest
from scipy.special import chdtrc

from geoident import read_result, update
from geoident.errors import InputError
from geoident.io.result.file import read_result as read_data
from geoident.io.result.file import write_result
from tests.support.commands import run_command, said_findings
from tests.support.growing_tunnel import DAYS, rows, write_readings, write_tunnel


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The folder of a tunnel after the fit of two days."""
    folder = tmp_path_factory.mktemp("fitted")
    assert run_command("fit", write_tunnel(folder, "day 1", "day 2"), "-q").exit_code == 0
    return folder


@pytest.fixture
def tunnel(fitted, tmp_path):
    return shutil.copytree(fitted, tmp_path / "tunnel")


@pytest.fixture(scope="module")
def updated(fitted, tmp_path_factory):
    """The folder of a tunnel after two updates, the second of which has CV90 2 mm off."""
    folder = shutil.copytree(fitted, tmp_path_factory.mktemp("updated") / "tunnel")
    write_readings(folder, rows("day 1", "day 2", "day 4"))
    assert run_command("update", folder / "case.yaml", "-q").exit_code == 0
    off = rows("day 8", off={"CV90": 2.0})
    write_readings(folder, [*rows("day 1", "day 2", "day 4"), *off])
    done = run_command("update", folder / "case.yaml")
    assert done.exit_code == 8, done.output
    (folder / "said.txt").write_text(done.stderr, encoding="utf-8")
    return folder


def test_the_p_value_is_that_of_least_squares_and_the_answer_that_of_a_fit(
    tunnel, tmp_path, verification
):
    write_readings(tunnel, rows(*DAYS))
    done = run_command("update", tunnel / "case.yaml", "--json", "-q")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    before, after = found["updates"]["steps"]
    assert (before["new"], before["judged"], after["new"], after["judged"]) == (6, 0, 6, 6)
    truth = chdtrc(6, after["objective"] - before["objective"])
    assert after["p_value"] == pytest.approx(truth, rel=1e-3)
    verification("update-p", "", ["one parameter"], exact=[truth], found=[after["p_value"]])
    assert found["findings"] == [] or "new-readings" not in {f["kind"] for f in found["findings"]}
    alone = write_tunnel(tmp_path, *DAYS)
    assert run_command("fit", alone, "-q").exit_code == 0
    fresh, kept = (
        read_result(folder / "case.fit.h5").parameters["E"] for folder in (tmp_path, tunnel)
    )
    assert kept.value == pytest.approx(fresh.value, rel=1e-6)
    assert kept.sd == pytest.approx(fresh.sd, rel=1e-4)
    assert kept.lower95 < 8e9 < kept.upper95


def test_the_p_value_where_only_a_prior_separates_two_parameters(tmp_path, verification):
    """Along p0 / E the readings are the same: their errors are correlated by the curve of that."""
    case = write_tunnel(tmp_path, "day 1", "day 2")
    case.write_text(with_unknown_stress(case.read_text(encoding="utf-8")), encoding="utf-8")
    update(case)
    write_readings(tmp_path, rows(*DAYS))
    before, after = update(case).updates
    truth = chdtrc(6, after.objective - before.objective)
    assert after.p_value == pytest.approx(truth, rel=0.05)
    verification("update-p", "prior", ["two parameters"], exact=[truth], found=[after.p_value])


def with_unknown_stress(text):
    """The case of the tunnel with the in-situ stress as a second parameter, and its prior."""
    prior = "  p0: {start: 6 MPa, bounds: [1 MPa, 30 MPa], prior: {mean: 6 MPa, sd: 1 MPa}}\n"
    text = text.replace("vertical: 6 MPa", "vertical: $p0")
    return text.replace("materials:", f"{prior}materials:", 1)


def test_the_prediction_that_judges_is_the_one_that_stood_in_the_fit(tunnel):
    before = read_data(tunnel / "case.fit.h5")
    write_readings(tunnel, rows("day 1", "day 2", "day 8"))
    found = update(tunnel / "case.yaml").data
    assert {row.stage for row in found.updates.readings} == {"day 8"}
    for row in found.updates.readings:
        at = before.gauges.channels.index(row.channel), before.gauges.stages.index("day 8")
        assert row.predicted == before.prediction.mean[at]
        assert row.lower95 == before.prediction.lower95[at]


def test_readings_that_do_not_belong_are_an_alarm_that_names_the_gauge(updated):
    found = read_data(updated / "case.fit.h5")
    good, bad = found.updates.steps[1:]
    assert (good.belong, good.alarm, bad.belong, bad.alarm) == (True, False, False, True)
    assert good.p_value > 0.005 > bad.p_value
    (finding,) = [one for one in found.findings if one.kind == "new-readings"]
    assert finding.subject == "CV90"
    assert re.search(r"CV90 at day 8 \(\+\d+\.\d sd\)", finding.sentence)
    said = " ".join((updated / "said.txt").read_text(encoding="utf-8").split())
    assert "3 new readings: do not belong to the model that predicted them" in said


def test_nothing_new_leaves_the_result_as_it_is(updated):
    before = (updated / "case.fit.h5").read_bytes()
    for path in (updated / "case.yaml", updated / "case.fit.h5"):
        done = run_command("update", path)
        assert done.exit_code == 0
        assert "Nothing new" in done.stderr
    text = (updated / "readings.csv").read_text(encoding="utf-8")
    (updated / "readings.csv").write_text(text.replace("\n", "\r\n"), encoding="utf-8", newline="")
    done = run_command("update", updated / "case.yaml")
    assert done.exit_code == 0
    assert "no used reading is new, changed or gone" in " ".join(done.stderr.split())
    assert (updated / "case.fit.h5").read_bytes() == before


def test_the_history_has_every_answer_and_survives_the_file(updated, tmp_path):
    found = read_data(updated / "case.fit.h5")
    write_result(found, tmp_path / "again.h5", overwrite=False)
    assert repr(read_data(tmp_path / "again.h5").updates) == repr(found.updates)
    values, low, high, _ = found.updates.values_of("E")
    assert values[-1] == found.parameters.values[0]
    assert (high - low)[1] < (high - low)[0]
    assert {row.update for row in found.updates.predictions} == {0, 1}  # then all was read


@pytest.mark.parametrize("given", ["date", "update 0"])
def test_the_history_is_shown_as_of_a_date_or_an_update(fitted, updated, given):
    first = read_data(fitted / "case.fit.h5")
    path = updated / "case.fit.h5"
    made = read_data(path).updates.steps[0].made.replace("+00:00", "Z")
    done = run_command("show", path, "--as-of", made if given == "date" else given, "--json")
    assert done.exit_code == 0, done.output
    shown = json.loads(done.stdout)
    assert shown["parameters"]["E"]["value"] == first.parameters.values[0]
    assert shown["parameters"]["E"]["upper95"] == first.parameters.upper95[0]
    assert len(shown["updates"]["steps"]) == 1
    ahead = {(row["gauge"], row["stage"]): row["mean"] for row in shown["predictions"]}
    i, j = first.gauges.channels.index("CV0"), first.gauges.stages.index("day 8")
    assert ahead["CV0", "day 8"] == first.prediction.mean[i, j]
    now = json.loads(run_command("show", path, "--as-of", "2999-01-01", "--json").stdout)
    assert now["parameters"] == json.loads(run_command("show", path, "--json").stdout)["parameters"]


@pytest.mark.parametrize(
    ("date", "said"),
    [
        ("2001-01-01", "There was no fit"),
        ("yesterday", "not a date"),
        ("update 99", "There was no update 99"),
    ],
)
def test_a_date_without_a_fit_is_refused(updated, date, said):
    done = run_command("show", updated / "case.fit.h5", "--as-of", date)
    assert done.exit_code == 2
    assert said in done.stderr


def test_a_fit_without_updates_has_no_history(fitted):
    done = run_command("show", fitted / "case.fit.h5", "--as-of", "2999-01-01")
    assert done.exit_code == 2
    assert "no history yet" in done.stderr


def test_screen_tables_and_page_have_the_history(updated, tmp_path):
    path = updated / "case.fit.h5"
    text = run_command("show", path).stdout
    assert "do not belong" in text
    assert re.search(r"update +E GPa", text)
    tables = run_command("show", path, "--csv").stdout
    table = tables.split("# update-readings\n")[1].split("\n\n")[0]
    first = next(iter(csv.DictReader(io.StringIO(table))))
    assert (first["channel"], first["stage"], first["unit"]) == ("CV0", "day 4", "mm")
    page = tmp_path / "page.html"
    assert run_command("report", path, "-o", page, "-q").exit_code == 0
    html = page.read_text(encoding="utf-8")
    assert "Parameters over the updates" in html
    assert "New readings against their predictions" in html


def test_changed_and_removed_readings_are_said(tunnel):
    lines = rows("day 1", "day 2")
    changed = lines[0].replace(",-1.2", ",-1.1")
    write_readings(tunnel, [changed, *lines[1:-1]])
    done = run_command("update", tunnel / "case.yaml", "--json", "-q")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    (said,) = [text for text in said_findings(found) if "changed since" in text]
    assert "1 reading has changed since the last result: CV0 at day 1." in said
    assert "1 reading is not used any more: EX.a3 at day 2." in said
    assert found["updates"]["steps"][-1]["p_value"] is None


def test_a_changed_case_is_said_and_judged_as_it_is_now(tunnel):
    case = tunnel / "case.yaml"
    text = case.read_text(encoding="utf-8")
    case.write_text(text.replace("nu: 0.25", "nu: 0.26"), encoding="utf-8")
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))
    found = update(case)
    assert found.updates[-1].case_changed
    assert any("The case has changed" in one.sentence for one in found.data.findings)
    assert found.updates[-1].judged == 3


def test_gauges_and_stages_may_come_and_go_with_a_model_error(tmp_path):
    case = write_tunnel(tmp_path, "day 1", "day 2", "day 4")
    text = case.read_text(encoding="utf-8").replace("  model_error: none\n", "")
    case.write_text(text, encoding="utf-8")
    assert run_command("fit", case, "-q").exit_code == 0
    gone = text.replace("  CV90:", "  CV45:").replace(
        "distance: 25 m}\n", "distance: 25 m}\n  - {name: end, distance: 90 m}\n"
    )
    case.write_text(
        gone.replace("[0, -3 m], [0, 3 m]", "[-2.1213, -2.1213 m], [2.1213, 2.1213 m]"),
        encoding="utf-8",
    )
    lines = [line for line in rows(*DAYS) if "CV90" not in line]
    write_readings(tmp_path, lines)
    found = update(case)
    assert found.updates[-1].removed == 3
    assert found.updates[-1].judged == 2
    assert found.updates[-1].belong
    assert "end" in found.data.gauges.stages


def test_overrides_of_the_last_fit_are_kept(tmp_path):
    case = write_tunnel(tmp_path, "day 1", "day 2")
    assert run_command("fit", case, "-q", "--set", "materials.rock.nu=0.3").exit_code == 0
    write_readings(tmp_path, rows("day 1", "day 2", "day 4"))
    found = update(tmp_path / "case.fit.h5")
    assert "nu: 0.3" in found.data.case_resolved
    assert not found.updates[-1].case_changed


def test_an_alarm_value_that_is_reached_is_an_alarm(tunnel):
    case = tunnel / "case.yaml"
    text = case.read_text(encoding="utf-8")
    text = text.replace("zero: day 0}\n  CV90", "zero: day 0, alarm: {red: -1.7 mm}}\n  CV90")
    case.write_text(text, encoding="utf-8")
    done = run_command("update", case, "--json", "-q")
    assert done.exit_code == 0, done.output  # -1.65 mm was read
    write_readings(tunnel, rows("day 1", "day 2", "day 4"))
    done = run_command("update", case, "--json", "-q")
    assert done.exit_code == 8, done.output
    step = json.loads(done.stdout)["updates"]["steps"][-1]
    assert (step["belong"], step["alarm"]) == (True, True)


def test_other_parameters_cannot_be_continued_and_a_fit_keeps_the_history(updated, tmp_path):
    folder = shutil.copytree(updated, tmp_path / "tunnel")
    case = folder / "case.yaml"
    case.write_text(with_unknown_stress(case.read_text(encoding="utf-8")), encoding="utf-8")
    done = run_command("update", case)
    assert done.exit_code == 3
    assert "the case identifies E, p0; the last result has E" in " ".join(done.stderr.split())
    assert run_command("fit", case, "--force").exit_code in (0, 4)
    assert read_data(folder / "case.fit.h5").updates is None
    assert len(read_data(folder / "case.fit.1.h5").updates.steps) == 3


@pytest.mark.parametrize(
    ("path", "code", "said"), [("-", 2, "from stdin"), ("nowhere.h5", 3, "nowhere.h5")]
)
def test_what_cannot_be_updated_is_refused(path, code, said):
    done = run_command("update", path)
    assert done.exit_code == code
    assert said in done.stderr


def test_the_result_of_another_command_is_refused(fitted, tmp_path):
    folder = shutil.copytree(fitted, tmp_path / "tunnel")
    assert run_command("predict", folder / "case.fit.h5", "-q").exit_code == 0
    with pytest.raises(InputError, match="result of a predict"):
        update(folder / "case.predict.h5", output=folder / "case.predict.h5")


@pytest.mark.slow
def test_p_values_of_readings_that_belong_are_uniform(tmp_path):
    """Kolmogorov's distance of 60 of them: beyond 0.21 in one of a hundred runs."""
    values = []
    for seed in range(60):
        folder = tmp_path / str(seed)
        folder.mkdir()
        case = write_tunnel(folder, "day 1", "day 2", seed=100 + seed)
        update(case)
        write_readings(folder, rows(*DAYS, seed=100 + seed))
        values.append(update(case).updates[-1].p_value)
    steps = np.arange(61) / 60.0
    distance = np.abs(np.sort(values) - np.array([steps[:-1], steps[1:]])).max()
    assert distance < 0.21
