"""The error of the mesh: against closed forms, in words, and in what a fit says."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.fem.faces import face_table
from geoident.fem.singularity import exponent, openings
from geoident.model.actions import Pressure
from geoident.model.case import Analysis, Stage, Support
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Scalar
from geoident.workflow.running import mesh_error as module
from geoident.workflow.running.mesh_error import mesh_error, mesh_sentence
from geoident.workflow.running.recovery import energy_error
from tests.support.cases import displacement, material, model, rollers
from tests.support.closed_forms import kirsch, lame_cylinder
from tests.support.meshes import KINDS_2D, box, opening
from tests.support.revolved import section

RADIUS, E, NU = 2.0, 10e9, 0.22
ROCK = {"rock": material("rock", E, NU)}
NOTHING = np.empty(0)


def excavated(kind, n, *, reach=40.0):
    """A quarter of a round hole, its wall read along both axes, and the exact readings."""
    mesh = opening(kind, 2, n=n, layers=3 * n, radius=RADIUS, reach=reach * RADIUS)
    wall = np.unique(mesh.blocks[0].nodes)
    wall = wall[np.abs(np.linalg.norm(mesh.points[wall], axis=1) - RADIUS) < 1e-9]
    read = [(k, a) for k in wall for a in (0, 1) if abs(mesh.points[k, a]) > 1e-9]
    zero = Scalar(0.0)
    staged = model(
        mesh,
        materials=ROCK,
        groups={"core": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=ConstantStress((Scalar(-13e6), Scalar(-8e6), Scalar(-9e6), zero, zero, zero)),
        stages=(Stage("open", excavate=("core",)),),
        channels=tuple(
            displacement(f"c{k}.{a}", tuple(mesh.points[k]), tuple(np.eye(2)[a])) for k, a in read
        ),
    )
    places = mesh.points[[k for k, _ in read]]
    exact = kirsch(places, radius=RADIUS, E=E, nu=NU, horizontal=13e6, vertical=8e6)
    return staged, exact[np.arange(len(read)), [a for _, a in read]]


def pressed(kind, n):
    """A thick cylinder about its axis, and what its inner face moves."""
    mesh = section(kind, (n, 1), (2.0, 0.5), inner=1.0)
    staged = model(
        mesh,
        analysis=Analysis.AXISYMMETRIC,
        materials=ROCK,
        groups={"all": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        stages=(Stage("press", loads={"p": Pressure("x0", Scalar(1e6))}),),
        channels=(displacement("wall", (1.0, 0.0), (1.0, 0.0)),),
    )
    exact = lame_cylinder(np.ones(1), inner=1, outer=3, pressure=1e6, E=E, nu=NU)
    return staged, exact


def effectivity(staged, exact):
    found = mesh_error(staged, staged.case, NOTHING)
    assert found.how == "refinement"
    true = exact - found.computed[:, 0]
    return np.linalg.norm(found.error[:, 0]) / np.linalg.norm(true)


@pytest.mark.parametrize(
    ("kind", "n"), [("tri3", 2), ("tri3", 4), ("tri3", 8), ("quad4", 2), ("quad4", 4),
                    ("quad4", 8), ("tri6", 2), ("quad8", 2)],
)  # fmt: skip
def test_the_error_of_a_hole_is_that_against_kirsch(kind, n):
    assert 0.7 < effectivity(*excavated(kind, n)) < 1.4


@pytest.mark.parametrize("kind", KINDS_2D)
@pytest.mark.parametrize("n", [2, 4])
def test_the_error_of_a_cylinder_is_that_against_lame(kind, n):
    assert 0.5 < effectivity(*pressed(kind, n)) < 2.0


def test_corners_are_seen_with_their_openings():
    """A square hole has four corners of 270 degrees; a round one of curved elements has none."""
    mesh = box("quad4", (6, 6))
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    present = np.any(np.abs(centre - 0.5) > 1.0 / 6.0, axis=1)
    table = face_table(mesh)
    found = np.degrees(openings(mesh, table, present))
    assert np.count_nonzero(np.abs(found - 270.0) < 1e-6) == 4
    assert np.count_nonzero(np.abs(found - 90.0) < 1e-6) == 4
    assert exponent(1.5 * np.pi) == pytest.approx(0.544484, abs=1e-6)
    for kind, sharpest in (("quad8", 180.5), ("quad4", 191.5)):
        staged, _ = excavated(kind, 4)
        assert np.degrees(module.orders(staged)[1]) <= sharpest
    cube = box("hex8", (3, 3, 3))
    middle = cube.points[cube.blocks[0].nodes].mean(axis=1)
    hollow = np.any(np.abs(middle - 0.5) > 0.2, axis=1)
    edges = np.degrees(openings(cube, face_table(cube), hollow))
    assert np.count_nonzero(np.abs(edges - 270.0) < 1e-6) == 12


def test_a_square_hole_converges_slowly_and_that_is_said():
    """Against a mesh that is refined twice more; the order of the corner is 1.09."""
    mesh = box("quad4", (8, 8))
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    hole = np.all(np.abs(centre - 0.5) < 0.25, axis=1)
    mesh = replace(mesh, groups={"hole": np.flatnonzero(hole), "rock": np.flatnonzero(~hole)})

    def at(mesh):
        return model(
            mesh, materials=ROCK, groups={"hole": "rock", "rock": "rock"}, supports=rollers(2),
            in_situ=ConstantStress((Scalar(-1e6), Scalar(-1e6), *[Scalar(0.0)] * 4)),
            stages=(Stage("dig", excavate=("hole",)),),
            channels=(displacement("side", (0.75, 0.5), (1.0, 0.0)),),
        )  # fmt: skip

    staged = at(mesh)
    found = mesh_error(staged, staged.case, NOTHING)
    assert found.order == pytest.approx(1.089, abs=1e-3)
    assert any("Corners of 270 degrees" in note for note in found.notes)
    fine = mesh
    for _ in range(4):
        fine = module.refined(fine)
    true = at(fine).computed(NOTHING) - found.computed
    assert 0.7 < float(found.error[0, 0] / true[0, 0]) < 1.5


@pytest.mark.parametrize(("kind", "n"), [("tri3", 4), ("tri3", 8), ("quad4", 4), ("quad4", 8)])
def test_jumps_of_the_stress_tell_about_the_same(kind, n, monkeypatch):
    staged, exact = excavated(kind, n)
    monkeypatch.setattr(module, "_free_memory", lambda: 1e6)
    found = mesh_error(staged, staged.case, NOTHING)
    assert found.how == "recovery"
    assert found.notes[0].startswith("One refinement needs about 0.1 GB of memory")
    true = np.linalg.norm(exact - found.computed[:, 0])
    assert 0.4 < np.linalg.norm(found.error) / true < 2.0
    assert energy_error(staged, NOTHING) < 0.1


def test_what_takes_too_long_is_not_refined_beside_a_fit(monkeypatch):
    staged, _ = excavated("tri3", 2)
    slow = replace(module.refinement_cost(staged), seconds=1e4)
    monkeypatch.setattr(module, "refinement_cost", lambda _model: slow)
    assert mesh_error(staged, staged.case, NOTHING, patience=60.0).how == "recovery"
    assert mesh_error(staged, staged.case, NOTHING).how == "refinement"


def test_a_sentence_says_whether_it_matters():
    staged, _ = excavated("tri3", 4)
    found = mesh_error(staged, staged.case, NOTHING)
    everything = np.ones(found.error.shape, dtype=bool)
    for accuracy, said in ((1e-6, "is too coarse"), (4e-4, "fine enough"), (1.0, "eats little")):
        one = replace(found, accuracy=np.full(len(found.channels), accuracy))
        assert said in mesh_sentence(one, everything)
