"""A structure in service: its results on the screen, on the page, as tables, compared; control."""

import csv
import json
import math
import re
from datetime import date, timedelta

import numpy as np
import pytest

from geoident.io.result.file import read_result
from tests.support.commands import run_command

CASE = """\
format: geoident-case/1
title: Pendulums of a dam
model: {kind: seasonal, since: 2012-01-01, level: 2, season: 1, linear: true}
loads:
  level: {file: level.csv, unit: m}
gauges:
  P1: {kind: reading, accuracy: 0.1 mm}
  P2: {kind: reading, accuracy: 0.1 mm, alarm: {red: 40 mm}}
  P3: {kind: reading, accuracy: 0.1 mm}
readings: readings.csv
fit: {until: 2015-12-31}
"""
STEP, STEP_ON = 1.5, date(2016, 8, 1)  # of P1, mm
WRONG, WRONG_ON = 3.0, 1680  # of P2, mm; days since the first level
BEGIN = date(2012, 1, 1)


def level(day):
    return 80.0 + 12.0 * math.sin(day / 58.0) + 5.0 * math.sin(day / 23.0)


def read(gauge, day):
    """A reading, mm: effects, and an error of 0.08 mm."""
    share = (0.3, -0.2, 0.1)[gauge]
    season = math.sin(2.0 * math.pi * day / 365.25 + gauge)
    error = np.random.default_rng([gauge, day]).normal(0.0, 0.08)
    value = share * (level(day) - 60.0) + season + 0.1 * day / 365.25 + error
    if gauge == 0 and BEGIN + timedelta(days=day) >= STEP_ON:
        value += STEP
    return value + WRONG * (gauge == 1 and day == WRONG_ON)


def write_dam(folder, days=1820):
    (folder / "case.yaml").write_text(CASE, encoding="utf-8")
    levels = [f"{BEGIN + timedelta(days=day)},{level(day):.3f}" for day in range(0, 1830, 2)]
    (folder / "level.csv").write_text("\n".join(["date,level", *levels]) + "\n", encoding="utf-8")
    rows = [
        f"P{gauge + 1},{BEGIN + timedelta(days=day)},{read(gauge, day):.3f},mm"
        for day in range(10, days, 10)
        for gauge in range(3)
    ]
    text = "\n".join(["gauge,date,value,unit", *rows]) + "\n"
    (folder / "readings.csv").write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def dam(tmp_path_factory):
    """The folder of a dam with its fit, and the control of a year in which P1 and P2 are off."""
    folder = tmp_path_factory.mktemp("dam")
    write_dam(folder)
    assert run_command("fit", folder / "case.yaml", "-q").exit_code == 0
    done = run_command("control", folder / "case.fit.h5", "-q")
    assert done.exit_code == 8, done.output
    return folder


def test_the_state_and_the_change_are_those_of_the_truth(dam):
    result = read_result(dam / "case.control.h5")
    assert result.status in ("amber", "red")
    (step,) = [row for row in result.changes if row.kind == "step" and row.gauge == "P1"]
    assert step.size == pytest.approx(1e-3 * STEP, abs=3.0 * step.sd)
    assert 5.0 * step.sd < 1e-3 * STEP
    read = {BEGIN + timedelta(days=day) for day in range(10, 1820, 10)}
    seen = (date(1970, 1, 1) + timedelta(seconds=step.shown)).isoformat()
    assert seen in {str(day) for day in read}  # a day on which it was read
    (wrong,) = [row for row in result.changes if row.kind == "reading"]
    assert wrong.gauge == "P2"
    assert wrong.size == pytest.approx(1e-3 * WRONG, abs=3.0 * wrong.sd)


def test_the_page_is_a_status_page(dam):
    assert run_command("report", dam / "case.control.h5", "-o", dam / "status.html").exit_code == 0
    page = (dam / "status.html").read_text(encoding="utf-8")
    state = read_result(dam / "case.control.h5").status
    assert f"<b>{state.capitalize()}</b>" in page
    assert f'class="{state} on"' in page
    for words in ("What has changed", "What to do next", "Check the instruments P1", "1 wrong"):
        assert words in page
    wrong = str(BEGIN + timedelta(days=WRONG_ON))
    assert re.search(rf"<td[^>]*>P2</td><td[^>]*>{wrong}</td><td[^>]*>\+[23]\.\d", page)
    assert wrong in page.partition('id="figure-in-service-1"')[2]  # beside its cross
    assert "Construction" not in page


def test_the_page_of_the_fit_has_effects_and_every_gauge(dam):
    assert run_command("report", dam / "case.fit.h5", "-o", dam / "fit.html").exit_code == 0
    page = (dam / "fit.html").read_text(encoding="utf-8")
    assert "Effects on the gauges" in page
    assert "powers of the level up to 2; season with 1 harmonics" in page
    figure = page.partition('id="figure-in-service-1"')[2].partition("</figure>")[0]
    for gauge in ("P1", "P2", "P3"):
        assert f">{gauge}</text>" in figure


def test_exported_tables_have_units_and_dates(dam):
    for kind in ("fit", "control"):
        done = run_command("export", dam / f"case.{kind}.h5", "-o", dam / "tables")
        assert done.exit_code == 0

    def table(name):
        with (dam / "tables" / f"case.{name}.csv").open(encoding="utf-8") as file:
            return list(csv.DictReader(file))

    by_gauge = {row["gauge"]: row for row in table("fit.seasonal")}
    assert by_gauge["P3"]["unit"] == "mm"
    assert by_gauge["P3"]["last"] == "2015-12-31T00:00:00" or by_gauge["P3"]["last"] < "2016"
    assert float(by_gauge["P3"]["level"]) == pytest.approx(3.3, abs=0.5)  # 0.1 mm/m of 33 m
    assert "coefficient level^2" in by_gauge["P3"]
    judged = table("control.judged")
    assert {row["time"][:4] for row in judged} == {"2016"}
    assert len(judged) == len(table("fit.judged"))
    (wrong,) = [row for row in table("control.changes") if row["kind"] == "reading"]
    assert wrong["since"] == f"{BEGIN + timedelta(days=WRONG_ON)}T00:00:00"
    assert float(wrong["size"]) == pytest.approx(WRONG, abs=0.5)
    assert wrong["unit"] == "mm"


def test_programs_get_the_same_in_si(dam):
    told = json.loads(run_command("show", dam / "case.control.h5", "--json").stdout)
    assert (told["exit_code"], told["gauges"]) == (8, [])
    assert {row["gauge"] for row in told["changes"]} >= {"P1", "P2"}
    fit = json.loads(run_command("show", dam / "case.fit.h5", "--json").stdout)
    coefficients = fit["seasonal"]["gauges"]["P1"]["coefficients"]
    assert list(coefficients) == fit["seasonal"]["terms"]
    assert coefficients["linear"] == pytest.approx(1e-4, abs=5e-5)  # 0.1 mm a year


def test_results_are_compared(dam):
    same = run_command("diff", dam / "case.control.h5", dam / "case.control.h5")
    assert same.exit_code == 0
    other = dam / "other.h5"
    case = dam / "case.yaml"
    run_command("fit", case, "-q", "--set", "model.level=1", "-o", other)
    different = run_command("diff", dam / "case.fit.h5", other)
    assert different.exit_code == 1
    assert "Effects" in different.stdout


def test_new_readings_from_a_file_of_their_own(dam):
    late = BEGIN + timedelta(days=1826)
    (dam / "new.csv").write_text(
        f"gauge,date,value,unit\nP3,{late},{read(2, 1826):.3f},mm\n", encoding="utf-8"
    )
    done = run_command(
        "control", dam / "case.fit.h5", "--readings", dam / "new.csv", "-o", dam / "new.h5"
    )
    assert done.exit_code == 0, done.output
    assert "green" in done.stderr
    assert "geoident report" in done.stderr  # what comes next


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        ("", "the file is empty"),
        ("gauge,date,value,unit\nP3,2014-01-01,1,mm\n", "no reading later than those of the fit"),
        ("gauge,date,value,unit\nP3,2030-01-01,1,mm\n", "The level is known to 2017-01-02: extend"),
        ("gauge,date,value,unit\nP9,2016-12-30,1,mm\n", "there is no gauge 'P9' to read"),
        (None, "there is no such file"),
    ],
)
def test_new_readings_that_cannot_be_judged(dam, tmp_path, readings, words):
    new = tmp_path / "new.csv"
    if readings is not None:
        new.write_text(readings, encoding="utf-8")
    out = tmp_path / "new.h5"
    done = run_command("control", dam / "case.fit.h5", "--readings", new, "-o", out)
    assert done.exit_code == 3
    assert words in done.stderr
    assert "new.csv" in done.stderr
    assert not out.exists()


def test_other_results_are_not_held_against(dam):
    done = run_command("control", dam / "case.control.h5")
    assert done.exit_code == 3
    assert "the result of a control" in done.stderr
    assert "Name the result of the fit: case.fit.h5" in done.stderr


@pytest.mark.parametrize("rate", ["10 years", "0 per 10 years", "1 per 10 m", "often"])
def test_a_rate_of_false_alarms_is_asked_for(dam, rate):
    done = run_command("control", dam / "case.fit.h5", "--false-alarms", rate)
    assert done.exit_code == 2
    assert "expected one such as '1 per 10 years'" in done.stderr


def test_two_files_of_readings_are_one_record(tmp_path):
    write_dam(tmp_path)
    rows = (tmp_path / "readings.csv").read_text(encoding="utf-8").splitlines()
    first, later = rows[:400], [rows[0], *rows[400:]]
    (tmp_path / "readings.csv").write_text("\n".join(first) + "\n", encoding="utf-8")
    (tmp_path / "later.csv").write_text("\n".join(later) + "\n", encoding="utf-8")
    text = CASE.replace("readings: readings.csv", "readings: [readings.csv, later.csv]")
    (tmp_path / "case.yaml").write_text(text, encoding="utf-8")
    told = json.loads(run_command("check", tmp_path / "case.yaml", "--json").stdout)
    assert told["used"] == 3 * 146
