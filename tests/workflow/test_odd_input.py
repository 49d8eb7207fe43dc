"""Input that is allowed and seldom meant: it is said, not refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from support.meshes import build
from support.trench import CASE, READINGS, write_case

from geoident.cli.app import geoident
from geoident.fem.faces import distance_to_faces, face_table, patches
from geoident.forward.gauges.beyond_mesh import allowed_distance
from tests.support.commands import said_findings


def _json(command, case):
    result = CliRunner().invoke(geoident, [command, str(case), "--json", "-q"])
    return json.loads(result.stdout)


def _fit(folder, readings, text=CASE):
    case = write_case(folder)
    case.write_text(text)
    (folder / "readings.csv").write_text(readings)
    return _json("fit", case)


def test_virgin_ground_in_tension_is_noted(tmp_path):
    case = write_case(tmp_path)
    assert not any("tension" in note for note in _json("check", case)["notes"])
    case.write_text(CASE.replace("vertical: 1 MPa", "vertical: 1 MPa, tectonic: {xx: 9 MPa}"))
    assert any("virgin ground is in tension" in note for note in _json("check", case)["notes"])


def test_gravity_without_any_density_is_noted(tmp_path):
    case = write_case(tmp_path)
    case.write_text(CASE.replace("in_situ:", "gravity: 9.81 m/s2\nin_situ:"))
    assert any("nothing weighs" in note for note in _json("check", case)["notes"])
    case.write_text(case.read_text().replace("nu: 0.25", "nu: 0.25, density: 2600 kg/m3"))
    assert not any("nothing weighs" in note for note in _json("check", case)["notes"])


def test_readings_that_go_the_other_way_are_told_from_bad_ones(tmp_path):
    rows = READINGS.splitlines()
    turned = [
        ",".join([*row.split(",")[:2], str(-float(row.split(",")[2])), row.split(",")[3]])
        for row in rows[1:]
    ]
    every_stage = CASE.replace(", stages: [first]", "").replace(
        "bounds: [0.2, 4]", "bounds: [0.9, 4]"
    )
    found = _fit(tmp_path, "\n".join([rows[0], *turned]) + "\n", every_stage)
    first = said_findings(found)[0]
    assert "All readings of the file 'readings.csv' have the wrong sign" in first


def test_a_model_that_does_not_meet_the_readings_says_so_at_once(tmp_path):
    good = _fit(tmp_path, READINGS)
    assert "does not fit" not in good["reason"]
    other = tmp_path / "other"
    other.mkdir()
    bent = READINGS.replace("CV,first,-0.598", "CV,first,-0.2").replace(
        "S,first,-0.1226", "S,first,0.9"
    )
    assert "does not fit the readings" in _fit(other, bent)["reason"]


ON_TOP = "S:  {kind: settlement, point: [1 m, 4 m]"


@pytest.mark.parametrize(("height", "told"), [(4.0, False), (4 + 1e-8, False), (4.00001, True)])
def test_a_point_just_outside_the_mesh_is_told_by_name(tmp_path, height, told):
    """Elements are 1 m high; what is no more than rounding is not worth a word."""
    case = write_case(tmp_path)
    case.write_text(CASE.replace(ON_TOP, f"S:  {{kind: settlement, point: [1 m, {height!r} m]"))
    notes = [note for note in _json("check", case)["notes"] if "outside the mesh" in note]
    expected = ["points just outside the mesh, taken by the nearest element: S"]
    assert notes == (expected if told else [])


@pytest.mark.parametrize(("height", "found"), [(4.0099, True), (4.0101, False), (4.3, False)])
def test_a_point_in_the_air_is_refused_beyond_rounding(tmp_path, height, found):
    """A hundredth of the length of the face below it, which is 1 m long and flat."""
    case = write_case(tmp_path)
    case.write_text(CASE.replace(ON_TOP, f"S:  {{kind: settlement, point: [1 m, {height!r} m]"))
    checked = _json("check", case)
    assert (checked["exit_code"] == 0) == found
    assert [fault["code"] for fault in checked.get("faults", [])] == (
        [] if found else ["gauge-outside"]
    )
    if height == 4.0101:
        said = checked["faults"][0]
        assert "'S' lies 0.01 m outside the mesh, in the air" in said["message"]
        assert "the nearest node is (1, 4) m" in said["hint"]


@pytest.mark.parametrize(("arc", "found"), [(0.5, True), (1.0, True), (1.9, False)])
def test_a_point_on_a_round_edge_that_straight_faces_cut_off_is_taken(arc, found):
    """Twelve faces on a circle of radius 6 m, whose arcs are 20 cm high."""
    n, radius = 12, 6.0
    angle = np.arange(n) * 2 * np.pi / n
    rings = [r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in (2.0, radius)]
    inner, outer = np.arange(n), n + np.arange(n)
    nodes = np.column_stack([inner, outer, np.roll(outer, -1), np.roll(inner, -1)])
    mesh = build("quad4", np.concatenate(rings), nodes)
    table = face_table(mesh)
    outline = patches(mesh, table, table.free(np.ones(mesh.n_elements, dtype=bool)))
    chord = radius * np.cos(np.pi / n)
    height = radius - chord
    place = np.array([np.cos(np.pi / n), np.sin(np.pi / n)]) * (chord + arc * height)
    away = distance_to_faces(mesh, outline, place)
    assert height == pytest.approx(0.204, abs=1e-3)
    assert away == pytest.approx(arc * height, rel=1e-6)
    assert (away <= allowed_distance(mesh, outline, place)) == found


def test_a_point_just_outside_reads_the_displacement_continued(tmp_path):
    """Along the side of an element it is linear: the same slope goes on above the ground."""
    case = write_case(tmp_path)
    gauges = "".join(
        f"  {name}: {{kind: settlement, point: [1 m, {y} m], accuracy: 0.01 mm}}\n"
        for name, y in (("A", 3.0), ("B", 4.0), ("C", 4.008))
    )
    case.write_text(CASE.replace("gauges:\n", f"gauges:\n{gauges}"))
    readings = _json("simulate", case)["readings"]
    below, top, above = (
        next(r["value"] for r in readings if (r["gauge"], r["stage"]) == (name, "second"))
        for name in "ABC"
    )
    assert above == pytest.approx(top + 0.008 * (top - below), rel=1e-9)
    assert abs(above - top) > 1e-4 * abs(top)


@pytest.mark.parametrize(("zero", "found"), [("first", False), ("second", True), ("third", True)])
def test_a_gauge_in_backfill_is_zeroed_when_it_is_there(tmp_path, zero, found):
    """The stage before the one that places it is "as built"; one earlier it is nowhere."""
    case = write_case(tmp_path)
    filled = "{name: third, install: {upper: rock}}"
    text = CASE.replace("excavate: [lower]}", f"excavate: [lower]}}\n  - {filled}")
    text = text.replace(ON_TOP, f"S:  {{kind: settlement, zero: {zero}, point: [3 m, 3.5 m]")
    case.write_text(text)
    rows = [row for row in READINGS.splitlines() if not row.startswith("S,")]
    (tmp_path / "readings.csv").write_text("\n".join(rows) + "\n")
    checked = _json("check", case)
    assert [fault["code"] for fault in checked.get("faults", [])] == (
        [] if found else ["gauge-in-absent-ground"]
    )


def test_elements_in_no_group_of_the_case_or_in_two_are_counted_and_named(tmp_path):
    """The lower part of the trench is the elements 15 and 16 of the grid of 6 by 4."""
    case = write_case(tmp_path)
    fewer = CASE.replace(", lower: rock}", "}").replace("excavate: [lower]", "remove: []")
    case.write_text(fewer)
    (fault,) = _json("check", case)["faults"]
    assert (fault["code"], fault["path"]) == ("group-coverage", "groups")
    assert "trench.inp are in none of the groups of the case" in fault["message"]
    assert fault["message"].startswith("2 elements of ")
    assert fault["message"].endswith("(in the mesh they are in: lower); first: 15, 16")
    mesh = tmp_path / "trench.inp"
    mesh.write_text(mesh.read_text() + "*ELSET, ELSET=more\n16, 1\n")
    case.write_text(CASE.replace("lower: rock}", "lower: rock, more: rock}"))
    (fault,) = _json("check", case)["faults"]
    assert fault["message"].startswith("2 elements of ")
    assert fault["message"].endswith(
        "in several groups of the case (in the mesh they are in: lower, more, rock); first: 1, 16"
    )


def test_a_stage_that_builds_on_another_than_the_one_before_is_said_to(tmp_path):
    """Load cases beside each other: the third on the first, the fourth on the last trunk."""
    case = write_case(tmp_path)
    case.write_text(
        CASE.replace(
            "  - {name: second, excavate: [lower]}\n",
            "  - {name: second, excavate: [lower], independent: true}\n"
            "  - {name: third, independent: true, base: first}\n"
            "  - {name: fourth}\n",
        )
    )
    checked = _json("check", case)
    assert {stage["name"]: stage["base"] for stage in checked["stages"]} == {
        "first": None,
        "second": None,
        "third": "first",
        "fourth": "first",
    }
