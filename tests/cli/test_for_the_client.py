"""What whoever pays for a report asks: strength, settlement, alarm values, plain words."""

import importlib.metadata
import json
import math
import shutil
from pathlib import Path

import pytest
from scipy.stats import norm

import geoident
from tests.cli.test_structures import write_lined
from tests.support.trench import READINGS

MESH = Path(geoident.__file__).parent / "templates" / "twin-tunnels" / "twin-tunnels.msh"
AREA = math.pi * 3.0**2
POINTS = {
    f"P{k}": x for k, x in enumerate((-45, -33, -27, -21, -17, -13, -9, -5, -1, 3, 9, 15, 27))
}
TUNNEL = """\
format: geoident-case/1
title: Tunnel in incompressible ground
analysis: plane-strain
mesh: {file: twin-tunnels.msh}
parameters:
  V: {start: 0.5 %, bounds: [0 %, 5 %], describe: volume loss of the drive}
materials:
  soft: {E: 20 MPa, nu: 0.4999, density: 2000 kg/m3}
groups: {made-ground: soft, clay: soft, marl: soft, tunnel-a: soft, tunnel-b: soft}
supports: {sides: x, bottom: [x, y]}
gravity: 9.81 m/s2
in_situ: {model: geostatic, K0: 1.0}
stages:
  - {name: drive, excavate: [tunnel-a], supports: {ring-a: {contraction: $V}}}
gauges:
  S: {kind: levelling, points: {POINTS}, accuracy: 1 mm}
readings: readings.csv
fit: {mesh_error: false}
"""


def write_tunnel(folder):
    """A tunnel at x = -9 m of radius 3 m; what was read is the Gauss curve of 8 mm and i = 7 m."""
    shutil.copy(MESH, folder)
    points = ", ".join(f"{name}: [{x} m, 0 m]" for name, x in POINTS.items())
    (folder / "case.yaml").write_text(TUNNEL.replace("{POINTS}", f"{{{points}}}"))
    rows = [
        f"S.{p},drive,{8.0 * math.exp(-0.5 * ((x + 9) / 7) ** 2)},mm" for p, x in POINTS.items()
    ]
    (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))


def write_watched(folder):
    """The lined trench with alarm values, strengths and words; the second stage was not read."""
    write_lined(folder)
    case = folder / "case.yaml"
    text = case.read_text()
    text = text.replace(
        "bounds: [0.1 GPa, 50 GPa],", "describe: modulus of the rock, bounds: [0.1 GPa, 50 GPa],"
    )
    text = text.replace(
        "thickness: 0.3 m}",
        "thickness: 0.3 m, compressive_strength: 15 MPa, tensile_strength: 1 MPa}",
    )
    text = text.replace(
        "[4 m, 3.5 m]], ", "[4 m, 3.5 m]], alarm: {amber: -0.5 mm, red: -1.0 mm, far: 9 mm}, "
    )
    text = text.replace("point: [1 m, 4 m], ", "point: [1 m, 4 m], limits: 0.05 mm, ")
    text = text.replace("head: [2 m, 3 m], ", "head: [2 m, 3 m], limits: {red: 0.27 mm}, ")
    case.write_text(text)
    read = [line for line in READINGS.splitlines() if "second" not in line]
    (folder / "readings.csv").write_text("\n".join([*read, ""]))


@pytest.fixture
def watched(after):
    return after(("fit", "case.yaml"), write=write_watched)


@pytest.mark.usefixtures("watched")
def test_alarm_values_are_reached_by_readings_and_expected_by_predictions(run, run_json):
    (told,) = run_json("show", "case.fit.h5")
    amber, red, far, *_ = told["alarms"]
    assert (amber["level"], amber["reached"], amber["value"]) == ("amber", "first", -5e-4)
    assert amber["largest"] == pytest.approx(-0.598e-3)
    (later,) = [p for p in told["predictions"] if (p["gauge"], p["stage"]) == ("CV", "second")]
    assert (red["reached"], red["likeliest"]) == ("", "second")
    side = (later["mean"] - later["lower95"] if later["mean"] > -1e-3
            else later["upper95"] - later["mean"]) / 1.959964  # fmt: skip
    assert red["probability"] == pytest.approx(norm.cdf(-1e-3, later["mean"], side), rel=1e-4)
    assert red["expected"] == ("second" if red["probability"] > 0.5 else "")
    assert far["probability"] < 1e-6
    assert "alarm" in {finding["kind"] for finding in told["findings"]}
    shown = run("show", "case.fit.h5").stdout
    assert "Alarm value 'amber' was reached by CV (first)." in " ".join(shown.split())
    assert "1 of 5 alarm values were not reached" in shown


@pytest.mark.usefixtures("watched", "plain_pictures")
def test_a_limit_is_reached_by_readings_of_either_sign(run, run_json):
    (told,) = run_json("show", "case.fit.h5")
    limit, beside = told["alarms"][3:]
    assert (limit["gauge"], limit["level"], limit["value"]) == ("S", "limit", 5e-5)
    assert (limit["reached"], limit["largest"]) == ("first", pytest.approx(-0.1226e-3))
    assert (limit["either_sign"], told["alarms"][0]["either_sign"]) == (True, False)
    for one in (limit, beside):  # both tails lie beyond it
        (later,) = [
            p for p in told["predictions"] if (p["gauge"], p["stage"]) == (one["gauge"], "second")
        ]
        ends = {True: later["upper95"] - later["mean"], False: later["mean"] - later["lower95"]}
        above, below = (
            norm.cdf(0.0, abs(side - later["mean"]), ends[side > later["mean"]] / 1.959964)
            if abs(side) > abs(later["mean"]) else math.nan
            for side in (one["value"], -one["value"])
        )  # fmt: skip
        assert one["probabilities"] == {"second": pytest.approx(above + below, rel=1e-4)}
        assert one["probability"] == one["probabilities"]["second"]
    assert beside["reached"] == ""
    shown = run("show", "case.fit.h5").stdout
    assert "Alarm value 'limit' was reached by S (first)." in " ".join(shown.split())
    assert "\N{PLUS-MINUS SIGN}0.050 mm" in shown
    header = run("export", "case.fit.h5", "--table", "alarms").stdout.splitlines()[0]
    assert header.endswith(",either_sign,probability at first,probability at second")
    assert run("report", "case.fit.h5").exit_code == 0
    assert "\N{PLUS-MINUS SIGN}0.050 mm" in Path("case.fit.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("watched")
def test_the_strength_of_the_wall_is_used_as_its_forces_say(run, run_json):
    (told,) = run_json("show", "case.fit.h5")
    wall = [piece for piece in told["structures"] if piece["structure"] == "wall"]
    for piece in wall:  # the limit is where 2 (fc + ft) |M| = (ft h - N)(fc h + N)
        u, m = piece["utilisation"], max(map(abs, piece["M"]))
        left = 2.0 * 16e6 * m / u
        assert left == pytest.approx((1e6 * 0.3 - piece["N"] / u) * (15e6 * 0.3 + piece["N"] / u))
    assert all(piece["utilisation"] is None for piece in told["structures"] if piece not in wall)
    most = 100.0 * max(piece["utilisation"] for piece in wall)
    assert f"{most:.0f} %" in run("show", "case.fit.h5").stdout
    table = run("export", "case.fit.h5", "--table", "structures").stdout.splitlines()
    assert table[0].endswith(",utilisation")


@pytest.mark.usefixtures("watched", "plain_pictures")
def test_the_page_has_the_words_of_parameters_and_no_empty_columns(run, run_json):
    assert run("report", "case.fit.h5").exit_code == 0
    page = Path("case.fit.html").read_text(encoding="utf-8")
    for words in ("E (modulus of the rock) =", "<td>modulus of the rock</td>", "Alarm values",
                  "Strength of linings", "figure-strength-1", "strength of the lin"):  # fmt: skip
        assert words in page, words
    assert ">prior</th>" not in page  # no parameter has one
    (told,) = run_json("show", "case.fit.h5")
    assert told["parameters"]["E"]["description"] == "modulus of the rock"
    assert "modulus of the rock" in run("show", "case.fit.h5").stdout


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("alarm: {amber: -0.5 mm, ", "alarm: {amber: -0.5 kPa, ", "is a pressure"),
        ("alarm: {amber: -0.5 mm, ", "alarm: {amber: 0 mm, ", "is reached by every reading"),
        ("limits: 0.05 mm", "limits: -0.05 mm", "a limit is the size of a reading"),
        ("limits: 0.05 mm", "limits: 0 mm", "is reached by every reading"),
        ("limits: 0.05 mm", "limits: 0.05 kPa", "is a pressure"),
        (" far: 9 mm}", " far: 9 mm}, limits: {far: 9 mm}", "name of an alarm value, too"),
        ("compressive_strength: 15 MPa, ", "", "without 'compressive_strength'"),
        ("tensile_strength: 1 MPa", "tensile_strength: -1 MPa", "is negative"),
        (
            "E: 20 GPa, nu: 0.2, thickness: 0.3 m",
            "EA: 6 GN/m, EI: 45 MNm2/m",
            "without a thickness",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused(old, new, words, watched, run):
    case = watched / "case.yaml"
    assert old in case.read_text()
    case.write_text(case.read_text().replace(old, new))
    refused = run("check", "case.yaml")
    assert refused.exit_code == 3
    assert words in refused.output


@pytest.fixture
def tunnel(after):
    return after(("fit", "case.yaml"), write=write_tunnel)


@pytest.mark.usefixtures("tunnel")
def test_incompressible_ground_loses_at_its_surface_what_the_tunnel_takes(run_json):
    (told,) = run_json("show", "case.fit.h5")
    surface = told["troughs"][0]
    assert (surface["line"], surface["of"]) == ("ground surface", "computed")
    assert surface["volume_loss"] == pytest.approx(told["parameters"]["V"]["value"], rel=0.01)
    assert surface["volume"] == pytest.approx(surface["volume_loss"] * AREA, rel=0.002)
    assert surface["at"] == pytest.approx(-9.0, abs=1.5)


@pytest.mark.usefixtures("tunnel", "plain_pictures")
def test_a_trough_that_was_read_has_the_width_and_volume_of_its_gauss_curve(run, run_json):
    (told,) = run_json("show", "case.fit.h5")
    (read,) = [row for row in told["troughs"] if row["of"] == "measured"]
    assert read["settlement"] == pytest.approx(8e-3)
    assert read["i"] == pytest.approx(7.0, rel=1e-3)
    assert read["volume"] == pytest.approx(math.sqrt(2.0 * math.pi) * 7.0 * 8e-3, rel=1e-3)
    assert read["volume_loss"] == pytest.approx(read["volume"] / AREA, rel=2e-3)
    table = run("export", "case.fit.h5", "--table", "troughs").stdout.splitlines()
    assert table[0].startswith("line,stage,of,settlement (m),at (m),i (m),volume (m2)")
    assert run("report", "case.fit.h5").exit_code == 0
    page = Path("case.fit.html").read_text(encoding="utf-8")
    assert "The largest settlement of the ground surface is" in page


def test_half_a_trough_has_no_width(tunnel, run, run_json):
    case = tunnel / "case.yaml"
    rows = (tunnel / "readings.csv").read_text().splitlines()
    kept = {f"S.{name}" for name, x in POINTS.items() if x >= -9}
    (tunnel / "readings.csv").write_text(
        "\n".join([rows[0], *(row for row in rows[1:] if row.split(",")[0] in kept), ""])
    )
    assert run("fit", str(case), "--force").exit_code in (0, 4)
    told = json.loads(run("show", "case.fit.h5", "--json").stdout)
    (read,) = [row for row in told["troughs"] if row["of"] == "measured"]
    assert (read["i"], read["volume"], read["volume_loss"]) == (None, None, None)


@pytest.mark.usefixtures("watched", "plain_pictures")
def test_each_printed_page_says_when_and_by_which_version_it_was_computed(run):
    assert run("report", "case.fit.h5").exit_code == 0
    page = Path("case.fit.html").read_text(encoding="utf-8")
    version = importlib.metadata.version("geoident")
    foot = page.partition("@bottom-left")[2].partition("}")[0]
    assert "computed" in foot
    assert version.replace(".", "\\2e ") in foot
    assert "i: distance from the middle" not in page  # it has no troughs
