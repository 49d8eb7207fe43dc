"""Decisions that depend on a reading: how probable today, and which earlier reading would tell."""

from pathlib import Path

import pytest
from scipy.stats import norm

from tests.support.trench import CASE, READINGS, write_case

DECISION = """\
decision: {if: CV < -1.085 mm at third, then: install the second row of bolts}
readings: readings.csv
"""


def write_decided(folder):
    """A trench dug in three steps, of which the first was read."""
    write_case(folder)
    text = CASE.replace("readings: readings.csv\n", DECISION).replace(
        "  - {name: second, excavate: [lower]}\n",
        "  - {name: second, excavate: [lower], release: {lower: 50 %}}\n"
        "  - {name: third, release: {lower: 100 %}}\n",
    )
    (folder / "case.yaml").write_text(text)
    read = [line for line in READINGS.splitlines() if "second" not in line]
    (folder / "readings.csv").write_text("\n".join([*read, ""]))


@pytest.fixture
def decided(after):
    return after(("fit", "case.yaml"), write=write_decided)


def with_reading(folder, line, stages):
    """The case with one more reading, fitted to more stages."""
    with (folder / "readings.csv").open("a") as file:
        file.write(f"{line}\n")
    case = folder / "case.yaml"
    case.write_text(case.read_text().replace("stages: [first]", f"stages: [{stages}]"))


@pytest.mark.usefixtures("decided")
def test_the_probability_is_that_of_the_band_and_a_prediction_tells_the_same(run, run_json):
    (told,) = run_json("show", "case.fit.h5")
    (one,) = told["decisions"]
    (later,) = [p for p in told["predictions"] if (p["gauge"], p["stage"]) == ("CV", "third")]
    side = (later["mean"] - later["lower95"]) / 1.959964
    assert one["probability"] == pytest.approx(norm.cdf(-1.085e-3, later["mean"], side), rel=1e-3)
    assert (one["state"], one["then"]) == ("open", "install the second row of bolts")
    assert told["telling_readings"][0]["gauge"] == "CV"
    assert run("predict", "case.fit.h5").exit_code == 0
    (predicted,) = run_json("show", "case.predict.h5")
    assert predicted["decisions"] == told["decisions"]
    for before, now in zip(told["telling_readings"], predicted["telling_readings"], strict=True):
        assert now["at_5"] == pytest.approx(before["at_5"])


@pytest.mark.parametrize(("gauge", "likely"), [("CV", 5), ("CV", 50), ("X.a", 50)])
def test_a_fit_of_the_reading_that_would_tell_finds_the_decision_as_likely(
    gauge, likely, decided, run, run_json
):
    (told,) = run_json("show", "case.fit.h5")
    (telling,) = [r for r in told["telling_readings"] if r["gauge"] == gauge]
    with_reading(decided, f"{gauge},second,{1e3 * telling[f'at_{likely}']!r},mm", "first, second")
    assert run("fit", "case.yaml", "--force").exit_code in (0, 4)
    (now,) = run_json("show", "case.fit.h5")
    near = 0.01 if likely == 5 else 0.03  # the model is linear nearly
    assert now["decisions"][0]["probability"] == pytest.approx(likely / 100, abs=near)
    assert all(reading["stage"] != "second" for reading in now["telling_readings"])


@pytest.mark.parametrize(("read", "state"), [(-1.1, "due"), (-1.05, "not due")])
def test_a_decision_whose_stage_was_read_is_due_or_not(read, state, decided, run, run_json):
    with_reading(decided, f"CV,third,{read},mm", "first, third")
    assert run("fit", "case.yaml", "--force").exit_code in (0, 4)
    (told,) = run_json("show", "case.fit.h5")
    assert (told["decisions"][0]["state"], told["decisions"][0]["measured"]) == (
        state, pytest.approx(1e-3 * read),
    )  # fmt: skip
    due = [f["sentence"] for f in told["findings"] if f["kind"] == "decision"]
    words = "CV < -1.085 mm at third: -1.1 mm was read. Then: install the second row of bolts."
    assert due == ([words] if state == "due" else [])
    assert not told.get("telling_readings")


def test_a_decision_whose_stage_is_past_without_its_reading_says_so(decided, run, run_json):
    with_reading(decided, "S,third,0.01,mm", "first, third")
    assert run("fit", "case.yaml", "--force").exit_code in (0, 4)
    (told,) = run_json("show", "case.fit.h5")
    assert told["decisions"][0]["state"] == "not read"
    said = [f["sentence"] for f in told["findings"] if f["kind"] == "decision"]
    assert said[0].startswith("CV < -1.085 mm at third: the stage is past, and CV was not read.")
    assert "but not read" in run("show", "case.fit.h5").stdout


@pytest.mark.usefixtures("decided", "plain_pictures")
def test_screen_page_and_tables_have_it(run):
    shown = " ".join(run("show", "case.fit.h5").stdout.split())
    assert "Readings that would tell: CV < -1.085 mm at third" in shown
    assert run("report", "case.fit.h5").exit_code == 0
    page = Path("case.fit.html").read_text(encoding="utf-8")
    assert "install the second row of bolts" in page
    assert "Readings that would tell" in page
    for table in ("decisions", "telling-readings"):
        assert "CV < -1.085 mm at third" in run("export", "case.fit.h5", "--table", table).stdout


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CV < -1.085 mm", "CW < -1.085 mm", "there is no channel 'CW'"),
        ("at third", "at fourth", "there is no stage 'fourth'"),
        ("-1.085 mm", "-1.09 kPa", "is a pressure"),
        ("CV < -1.085 mm at third", "CV at third", "has no value"),
        ("CV < -1.085 mm at third", "when it moves", "is no reading at a stage"),
        (", then: install the second row of bolts", "", "'then' is missing"),
    ],
)
def test_what_cannot_be_decided_is_refused_where_it_stands(old, new, words, decided, run):
    case = decided / "case.yaml"
    case.write_text(case.read_text().replace(old, new))
    refused = run("check", "case.yaml")
    assert refused.exit_code == 3
    assert words in refused.output
    line = next(n for n, x in enumerate(case.read_text().splitlines(), 1) if "decision" in x)
    assert f"case.yaml:{line}:" in refused.output
