"""A trench with a lined wall and a bolt, from the files to the forces that are shown."""

import json
from pathlib import Path

import numpy as np
import pytest

from geoident.io.result.file import read_result
from geoident.report.text.structures import force_table
from tests.support.trench import write_case

STRUCTURES = """\
structures:
  wall: {kind: beam, on: wall, E: 20 GPa, nu: 0.2, thickness: 0.3 m}
  nail: {kind: bolt, E: 200 GPa, diameter: 40 mm, spacing: 1 m, ends: [[[4, 2.7 m], [5.6, 2.3 m]]]}
stages:
"""


def write_lined(folder):
    case = write_case(folder)
    deck = folder / "trench.inp"
    lines = "*ELEMENT, TYPE=B21, ELSET=wall\n1001, 17, 24\n1002, 24, 31\n"
    deck.write_text(deck.read_text() + lines)
    text = case.read_text().replace("stages:\n", STRUCTURES, 1)
    text = text.replace("excavate: [upper]}", "excavate: [upper], build: [nail]}")
    text = text.replace("excavate: [lower]}", "excavate: [lower], build: [wall]}")
    text = text.replace(", stages: [first]", ", backtest: false")
    case.write_text(text)


@pytest.fixture
def lined(after):
    return after(write=write_lined)


@pytest.fixture
def fitted(after):
    """The same with its fit."""
    return after(("fit", "case.yaml"), write=write_lined)


@pytest.mark.usefixtures("fitted")
def test_forces_are_written_shown_and_told_as_json(run, run_json):
    assert run("check", "case.yaml").exit_code == 0
    members = read_result("case.fit.h5").members
    assert members.structures == ("wall", "wall", "nail")
    assert np.isnan(members.axial[:2, 0]).all()
    assert np.isfinite(members.axial[:, 1]).all()
    shown = run("show", "case.fit.h5").stdout
    rows = [line.split() for line in shown.splitlines()]
    (row,) = [row for row in rows if row[:2] == ["nail", "first"]]
    assert float(row[2]) == pytest.approx(members.axial[2, 0] / 1e3, rel=1e-3)
    (told,) = run_json("show", "case.fit.h5")
    assert [(m["structure"], m["number"], m["stage"]) for m in told["structures"]] == [
        ("wall", 1, "second"), ("wall", 2, "second"), ("nail", 1, "first"), ("nail", 1, "second"),
    ]  # fmt: skip
    assert told["structures"][2]["N"] == members.axial[2, 0]
    assert told["structures"][2]["M"] is None
    # The free ends of the wall bear no moment, and M is continuous between its pieces.
    moment = members.moment[:2, :, 1]
    scale = np.abs(moment).max()
    inner = [m for m in moment.ravel() if abs(m) > 1e-9 * scale]
    assert len(inner) == 2
    assert inner[0] == pytest.approx(inner[1], rel=1e-9)
    assert json.dumps(told)


@pytest.mark.usefixtures("fitted")
def test_xarray_reads_the_forces():
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    members = read_result("case.fit.h5").members
    with xarray.open_dataset("case.fit.h5", group="structures", engine="h5netcdf") as table:
        assert table["M"].dims == ("member", "end", "stage")
        assert float(table["N"].sel(member="nail:1", stage="first")) == members.axial[2, 0]
        assert table["Q"].attrs["unit"] == "N/m"


@pytest.mark.usefixtures("fitted", "plain_pictures")
def test_forces_are_in_tables_and_in_the_report(run):
    members = read_result("case.fit.h5").members
    found = run("export", "case.fit.h5", "--table", "structures").stdout.splitlines()
    forces = "N (kN),M_first (kNm),M_second (kNm),Q (kN),N_hoop (kN),stressed_to (kN)"
    places = ",".join(f"{axis}_{end} (m)" for end in ("first", "second") for axis in "xyz")
    assert found[0] == f"structure,number,stage,{places},{forces}"
    cells = found[1].split(",")
    assert cells[:3] == ["nail", "1", "first"]
    ends = [float(cell) if cell else None for cell in cells[3:9]]
    assert ends == [*members.ends[2, 0], None, *members.ends[2, 1], None]
    assert float(cells[9]) == pytest.approx(members.axial[2, 0] / 1e3, rel=1e-11)
    assert cells[10:] == [""] * 5
    assert len(found) == 5
    rows = force_table(read_result("case.fit.h5").members).rows
    assert [row[:2] for row in rows] == [["wall", "second"], ["nail", "first"], ["nail", "second"]]
    assert run("report", "case.fit.h5").exit_code == 0
    page = Path("case.fit.html").read_text(encoding="utf-8")
    assert "<td>nail</td><td>first</td>" in page


def test_structure_outside_the_ground_is_refused_at_its_place(lined, run):
    case = lined / "case.yaml"
    case.write_text(case.read_text().replace("[4, 2.7 m]", "[3, 2.7 m]"))
    refused = run("check", "case.yaml")
    assert refused.exit_code != 0
    assert "structure 'nail' stands, but the end (3, 2.7) m lies in no ground" in refused.output
    assert "structures.nail.ends[0][0]" in refused.output


@pytest.mark.usefixtures("plain_pictures")
def test_jacked_strut_and_anchor_from_the_file_to_the_result(lined, run, run_json):
    case = lined / "case.yaml"
    text = case.read_text()
    bars = """\
  prop: {kind: strut, EA: 500 MN, spacing: 2 m, second_end: fixed, ends: [[[4, 3.5 m], [3, 3.5 m]]]}
  tie: {kind: anchor, E: 200 GPa, area: 400 mm2, spacing: 2 m, grouted: 0.5 m, prestress: 80 kN,
        ends: [[[4, 2.3 m], [5.4, 1.9 m]]]}
  shore: {kind: strut, EA: 50 MN, spacing: 2 m, second_end: fixed, ends: [[[4, 3.2 m], [5, 3.2 m]]]}
  wedged: {kind: strut, EA: 50 MN, spacing: 2 m, ends: [[[4, 3.2 m], [5, 3.2 m]]],
           second_end: fixed, compression_only: true}
stages:
"""
    text = text.replace("stages:\n", bars, 1)
    text = text.replace("build: [nail]}", "build: [nail, prop, shore, wedged]}")
    text = text.replace("build: [wall]}", "build: [wall, tie], prestress: {prop: 50 kN}}")
    case.write_text(text)
    assert run("check", "case.yaml").exit_code == 0
    done = run("fit", "case.yaml")
    assert done.exit_code == 0, done.output
    members = read_result("case.fit.h5").members
    of = {name: n for n, name in enumerate(members.structures)}
    np.testing.assert_allclose(members.axial[[of["prop"], of["tie"]], 1], [-5e4, 8e4], rtol=1e-12)
    np.testing.assert_array_equal(members.prestress[of["prop"]], [np.nan, -5e4])
    assert np.isnan(members.hoop).all()
    assert members.axial[of["shore"], 1] > 1e3  # the wall leaves it
    np.testing.assert_allclose(members.axial[of["wedged"]], 0.0, atol=1e-6)
    (told,) = run_json("show", "case.fit.h5")
    (pulls,) = [one for one in told["findings"] if one["kind"] == "pull"]
    assert pulls["subject"] == "shore"
    assert pulls["numbers"]["force"] == members.axial[of["shore"]].max()
    shown = run("show", "case.fit.h5").stdout
    (row,) = [line.split() for line in shown.splitlines() if line.split()[:2] == ["tie", "second"]]
    assert row[2:] == ["80", "80", "-", "-", "80"]
    table = run("export", "case.fit.h5", "--table", "structures").stdout.splitlines()
    assert any(
        line.startswith("prop,1,second,4,3.5,,3,3.5,,-50") and line.endswith(",-50")
        for line in table
    )
    assert run("report", "case.fit.h5").exit_code == 0
    page = Path("case.fit.html").read_text(encoding="utf-8")
    assert "Forces in struts, anchors and bolts" in page
    assert "Forces in wall" in page
    assert "second end fixed; only compression" in page
