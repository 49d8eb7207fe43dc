"""The table of peers: what is measured of a command, and how numbers once measured are shown."""

from __future__ import annotations

import resource
import subprocess
import sys

import numpy as np
import pytest
import yaml
from benchmarks import cube, peers
from benchmarks.peers import Cost
from support import calculix
from support.meshes import box, regroup

from geoident.workflow.check import check

FIT = {"evaluations": 6.0, "factorizations": 54.0}
MEASURED = {
    "tunnel-3d": {
        "CalculiX": Cost(10.0, 16.0, 1.5e9),
        "fit": Cost(25.0, 48.0, 1.25e9, FIT),
    },
    "cube-30k": {"CG": Cost(1.0, 1.0, 1e8), "fit": Cost(6.0, 6.0, 5e8, FIT)},
    "cube-150k": {
        "CG": Cost(7.5, 7.5, 5e8),
        "removal": Cost(100.0, 150.0, 3e9),
        "fit": Cost(30.0, 60.0, 2e9, FIT),
    },
    "cube-1000k": {"CG": Cost(70.0, 70.0, 3e9)},
    "scripted": {
        "script": Cost(80.0, 80.0, 2e8, {"evaluations": 42.0}),
        "fit": Cost(2.0, 2.0, 1e9),
    },
    "growth": {},
    "check-1000k": {"check": Cost(31.0, 29.0, 2.6e9)},
    "cavern-plastic": {"fit": Cost(100.0, 100.0, 5e8, {"factorizations": 390.0})},
    "report": {"dam": Cost(2.0, 2.0, 2e8), "shaft": Cost(3.5, 3.5, 2e8)},
    "reduced": {
        "fit": Cost(25.0, 48.0, 1.25e9, FIT),
        "made": Cost(30.0, 50.0, 1e9),
        "reduced": Cost(5.0, 12.0, 1e9, {"close": 0.9996}),
    },
}  # fmt: skip


def row(what):
    found = [line for line in peers.table(MEASURED) if line.startswith(f"| {what}")]
    assert len(found) == 1
    return [cell.strip() for cell in found[0].strip("|").split("|")][1:]


def test_every_row_is_shown_with_its_ratio_and_what_is_wanted():
    assert row("cases/tunnel-3d: whole fit") == [
        "25 (48) s, 1.2 GB (6 evaluations, 54 factorizations)",
        "10 (16) s, 1.5 GB",
        "2.5 (3)",
        "<= 3.5",
    ]
    assert row("cube of 150,000 unknowns: whole fit / one")[2:] == ["4 (8)", "<= 3.5"]
    assert row("cube of 150,000 unknowns: whole fit / two")[2:] == ["0.3 (0.4)", ""]
    assert row("cube of 30,000 unknowns: scipy")[1:] == [
        "80 (80) s, 0.2 GB (42 runs)",
        "40 (40)",
        "",
    ]
    assert row("geoident check")[0] == "31 (29) s, 2.6 GB"
    assert row("cases/cavern-plastic")[0] == "390"
    assert row("geoident report")[0].startswith("shaft 3.5")
    reduced = row("cases/tunnel-3d: 100,000")
    assert reduced[0] == "5 (12) s, 1 GB, 100 % of the readings proven (made in 30 (50) s)"
    assert reduced[2] == "0.2 (0.25)"


def test_a_row_that_was_left_out_says_so():
    assert row("cube of 1,040,000 unknowns")[0] == "not begun: too little memory was free"


def test_growth_is_that_of_the_cubes_that_were_fitted():
    assert row("growth")[0] == "n^1.00 (n^1.43)"
    assert peers.exponent([10.0, 100.0, 1000.0], [3.0, 3e2, 3e4]) == pytest.approx(2.0)


def test_what_was_measured_is_kept_and_shown_again(tmp_path, capsys):
    kept = tmp_path / "measured.json"
    peers.write(kept, "a machine", MEASURED)
    assert peers.read(kept) == ("a machine", MEASURED)
    peers.main(["--recorded", str(kept)])
    printed = capsys.readouterr().out.splitlines()
    assert printed == ["a machine", "", *peers.table(MEASURED)]


def test_a_command_is_measured_with_what_it_prints():
    words = "import time; x = b'x' * 200_000_000; time.sleep(0.2); print(len(x))"
    cost, printed = peers.measure([sys.executable, "-c", words])
    assert printed == "200000000\n"
    assert 0.2 < cost.seconds < 60.0
    # Linux counts what the parent held when it started the command
    own = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert 0.2e9 < cost.peak < max(0.6e9, 1.1 * own)
    with pytest.raises(subprocess.CalledProcessError):
        peers.measure([sys.executable, "-c", "raise SystemExit(3)"])


def test_counts_are_read_from_what_a_fit_prints():
    assert peers.counts_of('[{"counts": {"solves": 12, "factorizations": 7}}]') == {
        "solves": 12.0,
        "factorizations": 7.0,
    }


def test_the_cube_is_a_sound_case_of_the_size_that_was_asked_for(tmp_path):
    found = cube.write_mesh(tmp_path / "cube.msh", 9000)
    assert found == pytest.approx(9000, rel=0.2)
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(cube.case()))
    checked = check(str(tmp_path / "case.yaml"), overrides=("readings=[]",))
    assert checked.summary.stages[0].dofs == pytest.approx(found, rel=0.1)
    # nodes stand at the instruments, so that a script need not interpolate
    points = checked.mesh.points
    for channel in checked.case.channels:
        for place in (channel.first, channel.second):
            assert place is None or np.linalg.norm(points - np.array(place), axis=1).min() < 1e-9


@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
def test_ground_removed_in_a_second_step_moves_as_ground_that_was_never_there(tmp_path):
    mesh = regroup(
        box("tet10", (3, 3, 3), size=(5.0, 5.0, 5.0)),
        hole=lambda c: np.all(np.abs(c - [2.5, 2.5, 2.5]) < 1.0, axis=1),
    )
    staged = calculix.opened(mesh)
    moved = {}
    for name, removal in (("at-once", False), ("removed", True)):
        path = tmp_path / f"{name}.inp"
        calculix.write_first_stage(staged, path, removal=removal)
        moved[name] = {int(r[0]): r[1:] for r in calculix.solve(path, threads=1)}
    scale = max(np.abs(u).max() for u in moved["at-once"].values())
    for node, u in moved["at-once"].items():
        np.testing.assert_allclose(moved["removed"][node], u, atol=2e-6 * scale)
