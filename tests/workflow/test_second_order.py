"""`mesh: {order: 2}`: linear elements that are too stiff where ground yields, and the way out."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from support.commands import run_command
from support.deck import write_deck
from support.yielding import Cavity, mohr_limit

CIRCLE = """\
format: geoident-case/1
title: Circle in ground that keeps its volume
analysis: plane-strain
mesh: {file: circle.inp}
parameters:
  E: {start: 3 GPa, bounds: [0.3 GPa, 60 GPa], scale: log}
materials:
  rock: {elastic: isotropic, E: $E, nu: 0.25,
         yield: {type: mohr-coulomb, cohesion: 1 MPa, friction: 30 deg, dilation: 0 deg}}
groups: {core: rock, rock: rock}
supports: {x0: x, y0: y}
in_situ: {model: constant, xx: -10 MPa, yy: -10 MPa, zz: -10 MPa, held: true}
stages:
  - {name: opened, excavate: [core]}
gauges:
"""
CAVITY = Cavity(pressure=10e6, E=3e9, nu=0.25)


@pytest.fixture
def case(tmp_path):
    """Writes the case on a mesh of a kind; returns its path."""

    def write(kind):
        mesh = CAVITY.mesh(kind, n=6, layers=40, reach=20.0)
        write_deck(mesh, tmp_path / "circle.inp")
        wall = np.abs(np.linalg.norm(mesh.points, axis=1) - 1.0) < 1e-9
        gauges = [
            f"  W{n}: {{kind: displacement, point: [{x!r} m, {y!r} m], direction: [{x!r}, {y!r}], "
            "accuracy: 0.1 mm}\n"
            for n, (x, y) in enumerate(mesh.points[wall].tolist())
        ]
        path = tmp_path / "case.yaml"
        path.write_text(f"{CIRCLE}{''.join(gauges)}readings: []\n")
        return str(path)

    return write


def wall_of(path, *more):
    """Mean motion of the nodes of the wall, in parts of the exact one."""
    shown = run_command("simulate", path, *more)
    assert shown.exit_code == 0, shown.output
    rows = [line.split(",") for line in shown.output.splitlines() if ",opened," in line]
    limit = mohr_limit(1e6, pi / 6, 0.0)
    exact = CAVITY.closed_form(limit).displacement(np.array([1.0])).value[0]
    return 1e-3 * np.mean([float(row[2]) for row in rows]) / exact


LOCKS = "linear (tri3) and too stiff where it flows"


def test_linear_triangles_are_named_and_the_key_that_is_advised_mends_them(case):
    path = case("tri3")
    checked = " ".join(run_command("check", path).output.split())
    assert LOCKS in checked
    assert "write 'order: 2' under 'mesh'" in checked
    assert wall_of(path) < 0.97
    raised = run_command("check", path, "--set", "mesh.order=2")
    assert raised.exit_code == 0
    assert LOCKS not in " ".join(raised.output.split())
    assert wall_of(path, "--set", "mesh.order=2") == pytest.approx(1.0, abs=0.03)


def test_elements_that_do_not_lock_are_not_accused(case):
    for kind in ("quad4", "quad8", "tri6"):
        assert "too stiff" not in run_command("check", case(kind)).output
        assert wall_of(case(kind)) == pytest.approx(1.0, abs=0.03)


def test_elastic_triangles_are_not_accused(case):
    shown = run_command("check", case("tri3"), "--set", "materials.rock={E: $E, nu: 0.25}")
    assert shown.exit_code == 0, shown.output
    assert "too stiff" not in shown.output


def test_a_mesh_of_second_order_stays_as_it_is(case):
    path = case("tri6")
    assert wall_of(path, "--set", "mesh.order=2") == wall_of(path)


def test_there_is_no_third_order(case):
    shown = run_command("check", case("tri3"), "--set", "mesh.order=3")
    assert shown.exit_code == 3
    assert "'3' is not a whole number from 1 to 2" in shown.output
