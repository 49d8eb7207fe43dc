"""Probability and delay of detection, told before anything happens."""

import json

import numpy as np
import pytest
from support.service_dam import GAUGES, PHYSICS, YEAR, dam, write

from geoident import control, fit
from geoident.errors import UsageError
from tests.support.commands import run_command

DAY = 86400.0


def until(made, days):
    for gauge, (read, y) in made.read.items():
        made.read[gauge] = read[read <= days], y[read <= days]
    return made


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A dam with six years of readings and none later."""
    return fit(write(tmp_path_factory.mktemp("power"), until(dam(1), 6.0 * YEAR)))


@pytest.mark.slow
def test_larger_changes_are_seen_more_probably_and_sooner(fitted):
    words = [
        "P2 steps 0.001 mm", "P2 steps 0.5 mm", "P2 steps 1 mm", "P2 steps -30 mm",
        "P2 drifts 2 mm/year", "P2 drifts 166.67 um per month", "all soften 1 %", "all soften 40 %",
    ]  # fmt: skip
    found = control(fitted, power=words)
    assert found.state == "not judged"
    tiny, small, step, huge, yearly, monthly, little, soft = found.power
    assert tiny.probability < 0.35  # false alarms: 18 % in two years are stated
    assert tiny.probability < small.probability <= step.probability <= huge.probability == 1.0
    assert huge.late < 20.0 * DAY  # the first reading or the second
    assert step.median < small.median or np.isnan(small.median)
    assert huge.median < step.median < 200.0 * DAY
    assert monthly.probability == yearly.probability
    assert monthly.median == yearly.median
    assert little.probability < soft.probability
    assert soft.gauges == ", ".join(GAUGES)


def test_it_is_on_screen_in_json_in_a_table_and_on_the_page(fitted, tmp_path):
    out = tmp_path / "told.h5"
    words = "P1, P3 step 1 mm"
    done = run_command("control", str(fitted.path), "--power", words, "-o", str(out))
    assert done.exit_code == 0
    assert "not judged" in done.output
    assert words in done.output
    said = json.loads(run_command("show", str(out), "--json").stdout)
    (row,) = said["power"]
    assert row["gauges"] == "P1, P3"
    assert "There are no new readings" in said["reason"]
    table = run_command("export", str(out), "--table", "power").stdout
    page = tmp_path / "told.html"
    assert run_command("report", str(out), "-o", str(page)).exit_code == 0
    assert words in page.read_text()
    assert "within 731 days" in page.read_text()
    assert table.splitlines()[0].startswith("change,gauges,probability")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("P9 drifts 1 mm/year", "Gauges of the fit: P1, P2, P3, P4, P5, all"),
        ("P2 drifts 1 mm", "a drift needs a rate such as 1 mm/year"),
        ("P2 steps 1 mm/year", "a step needs a size such as 2 mm"),
        ("P2 moves 1 mm", "'P2 drifts 1 mm/year', 'P1, P2 step 2 mm' or 'all soften 20 %'"),
        ("P2 steps 1 kPa", "of P2"),
        ("P2 steps 0 mm", "is no change"),
        ("all soften 100 %", "above 0 % and below 100 %"),
        ("E_rock falls 20 %", "a seasonal model has none. Ask what gauges would show"),
    ],
)
def test_words_that_are_no_change_are_refused_with_what_was_expected(fitted, words, expected):
    with pytest.raises(UsageError) as refused:
        control(fitted, power=[words])
    assert expected in str(refused.value)


@pytest.mark.slow  # 30 s a dam
def test_changes_come_to_light_as_probably_and_as_late_as_told(tmp_path):
    """Of 18 dams of other physics in which the change then happens; any alarm counts, as told."""
    words, size = "P3 steps 0.8 mm", 0.8
    told, half, delays = [], [], []
    for seed in range(18):
        change = {"P3": lambda read: np.where(read > 6.0 * YEAR, size, 0.0)}
        made = dam(70 + seed, changes=change, physics=list(PHYSICS)[seed % len(PHYSICS)])
        case = write(tmp_path / str(seed), until(made, 6.0 * YEAR + 731.0))
        found = control(fit(case), power=[words])
        (row,) = found.power
        told.append(row.probability)
        half.append(row.median)
        shown = [c.shown for c in found.changes if c.kind != "reading"]
        first = np.datetime64("2010-01-01").astype("datetime64[s]").astype(float)
        delays.append(min(shown, default=np.inf) - first - 6.0 * YEAR * DAY)
    seen = np.mean(np.isfinite(delays))
    chance = np.mean(told)
    assert seen == pytest.approx(chance, abs=3.0 * np.sqrt(chance * (1.0 - chance) / len(told)))
    assert 0.3 < np.median(delays) / np.nanmedian(half) < 3.0
