"""The mechanism of a collapse as a picture: at the end of a command, and in a page."""

from __future__ import annotations

import pickle
from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from support.commands import run_command
from support.lifts import CASE, write_case
from support.meshes import box

from geoident.cli import collapse, jobs
from geoident.errors import CollapseError
from geoident.model.results.yielded import Mechanism
from geoident.report.drawing.fields.mechanism import mechanism_figure, mechanism_picture
from geoident.workflow import simulate as simulating

WEAK = (
    CASE.replace(
        "{elastic: isotropic, E: $E, nu: 0.25}",
        "{elastic: isotropic, E: $E, nu: 0.25, "
        "yield: {type: mohr-coulomb, cohesion: 60 kPa, friction: 5 deg}}",
    )
    .replace("readings: readings.csv\n", "")
    .replace("start: 1.0, bounds: [0.2, 4]", "start: 1.0, bounds: [0.9, 1.1]")
)


REST = "- {name: rest}\n  - {name: lift 1, excavate: [lift-1]}"


@pytest.fixture(scope="module")
def fallen(tmp_path_factory):
    """What a command says that ends by a collapse, its error, and the fields that it wrote."""
    folder = tmp_path_factory.mktemp("fallen")
    write_case(folder, WEAK.replace("- {name: lift 1, excavate: [lift-1]}", REST))
    errors = []

    def drawn(error, case, options):
        errors.append(CollapseError(str(error), stage=error.stage, fraction=error.fraction,
                                    motion=error.motion))  # fmt: skip
        return ""

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(collapse, "_drawn", drawn)
        done = run_command("simulate", "case.yaml", "--fields", "pit.vtkhdf")
    return done, errors[0], folder / "pit.vtkhdf"


@pytest.fixture
def weak(tmp_path, monkeypatch, fallen):
    """A pit that falls in at its first lift, in the current folder; its collapse is known."""

    def simulate(case, **asked):
        raise CollapseError("plastic collapse", stage="lift 1", fraction=0.5,
                            motion=fallen[1].motion)  # fmt: skip

    (tmp_path / "case.yaml").write_text(WEAK)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(simulating, "simulate", simulate)
    return tmp_path


def test_a_command_that_ends_by_collapse_draws_the_mechanism_and_names_it(weak, fallen):
    assert "plastic collapse" in fallen[0].stderr
    done = run_command("simulate", "case.yaml")
    assert done.exit_code == 5
    assert "plastic collapse" in done.stderr
    assert done.stderr.rstrip().endswith("The mechanism, as a picture: case.collapse.png")
    picture = (weak / "case.collapse.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    again = run_command("simulate", "case.yaml")  # its own picture gives way
    assert again.exit_code == 5
    assert "as a picture: case.collapse.png" in again.stderr


def test_a_prediction_of_another_case_draws_it_too(weak, fallen, monkeypatch):
    def predict(task, *given, **asked):
        raise fallen[1]

    inputs = SimpleNamespace(path="weak.yaml")
    task = SimpleNamespace(job=SimpleNamespace(inputs=inputs))
    monkeypatch.setattr(jobs, "plan_prediction", lambda request: task)
    monkeypatch.setattr(jobs, "predict", predict)
    (weak / "weak.yaml").write_text(WEAK)
    done = run_command("predict", "case.fit.h5", "--case", "weak.yaml")
    assert done.exit_code == 5
    assert done.stderr.rstrip().endswith("The mechanism, as a picture: weak.collapse.png")
    assert (weak / "weak.collapse.png").read_bytes().startswith(b"\x89PNG")


def test_what_geoident_did_not_make_stays(weak):
    (weak / "case.collapse.png").write_bytes(b"mine")
    done = run_command("simulate", "case.yaml")
    assert done.exit_code == 5
    assert "The mechanism is not drawn: case.collapse.png: exists" in done.stderr
    assert (weak / "case.collapse.png").read_bytes() == b"mine"


def test_fields_for_paraview_have_the_mechanism_and_the_stages_before_it(fallen):
    done, error, written = fallen
    assert done.exit_code == 5
    assert "Its mechanism and the stages before it, for ParaView: pit.vtkhdf" in done.stderr
    found = error.motion
    assert isinstance(found, Mechanism)
    with h5py.File(written) as file:
        group, states = file["VTKHDF"], int(file["VTKHDF/Steps"].attrs["NSteps"])
        velocity = group["PointData/mechanism"][:].reshape(states, -1, 3)
        shear = group["CellData/mechanism_shear"][:].reshape(states, -1)
        begins = group["Steps/PointDataOffsets/mechanism"][:]
        moved = group["PointData/displacement"][:].reshape(states, -1, 3)
        stress = group["CellData/stress"][:].reshape(states, -1, 6)
        yielded = group["CellData/yielded"][:].reshape(states, -1)
        balanced = group["CellData/equilibrium"][:].reshape(states, -1)
        there = group["CellData/present"][:].reshape(states, -1).astype(bool)
    assert states == 6
    assert begins.tolist() == [k * found.mesh.n_nodes for k in range(6)]
    np.testing.assert_allclose(velocity[2, :, :2], found.velocity)
    np.testing.assert_allclose(shear[2], found.shear)
    for others in (velocity, shear):
        assert not others[[0, 1, 3, 4, 5]].any()
    assert [set(state) for state in balanced.tolist()] == [{1}, {1}, {0}, {0}, {0}, {0}]
    # the last equilibrium on the way down, from where the ground at rest was
    assert np.isfinite(moved).all()
    assert np.isfinite(stress[there]).all()
    assert moved[2, :, 1].max() > 1e-4 > np.abs(moved[1]).max()
    assert yielded[2].any()
    for later in (3, 4, 5):
        np.testing.assert_array_equal(moved[later], moved[2])
        np.testing.assert_array_equal(stress[later][there[later]], stress[2][there[later]])
    # the sides of the pit move inwards and down, its floor up
    used = np.unique(np.concatenate([b.nodes[found.present[: len(b)]] for b in found.mesh.blocks]))
    x, y = found.mesh.points[used].T
    across, up = found.velocity[used].T
    walls = (y > 6.0) & (y < 8.0)
    assert np.all(across[walls & (x == 4.0)] > 0.05)
    assert np.all(across[walls & (x == 8.0)] < -0.05)
    assert np.all(up[(y == y.max()) & (np.abs(x - 6.0) < 3.0)] < 0.0)
    assert up[(np.abs(x - 6.0) < 1.0)].max() > 0.0


def plate(dim: int) -> Mechanism:
    """The upper half of a box slides along x; the lowest row of elements is gone."""
    mesh = box("quad4" if dim == 2 else "hex8", (8,) * dim)
    level = mesh.points[:, -1]
    velocity = np.zeros_like(mesh.points)
    velocity[:, 0] = level > 0.5
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)[:, -1]
    band = np.exp(-(((centre - 0.5) / 0.1) ** 2))
    return Mechanism("push", 1, 0.5, mesh, centre > 0.13, velocity, band / band.max())


def test_a_mechanism_is_said_in_one_line():
    """In a notebook it filled pages with the coordinates of its mesh."""
    assert repr(plate(2)) == "Mechanism('push', 50 % carried, 81 nodes)"
    assert repr(replace(plate(2), fraction=np.nan)) == "Mechanism('push', 81 nodes)"


@pytest.mark.parametrize("dim", [2, 3])
def test_arrows_stand_where_the_ground_moves_and_colours_where_it_shears(dim):
    found = plate(dim)
    figure = mechanism_figure(found, ("x", "y", "z"))
    axes = figure.axes[0]
    assert "Mechanism at stage push" in axes.get_title()
    assert "50 % of its load in equilibrium" in axes.get_title()
    (arrows,) = (c for c in axes.collections if hasattr(c, "U"))
    across, up = arrows.U, arrows.V
    assert len(across) > 10
    assert np.all(across > 0.0)
    assert np.abs(up).max() < 1e-12
    assert arrows.get_offsets()[:, 1].min() > 0.5
    shown = next(c for c in axes.collections if c.get_array() is not None and c is not arrows)
    assert np.nanmax(shown.get_array()) == pytest.approx(1.0)
    assert axes.get_ylim()[0] >= 0.12  # what is gone is not shown
    assert axes.get_ylabel() == ("y (m)" if dim == 2 else "z (m)")


def test_arrows_and_colours_are_the_arrays_of_the_mechanism():
    """Every arrow is the velocity of a node, on one scale; every triangle the rate of its cell."""
    found = plate(2)
    turn = np.column_stack([found.mesh.points[:, 1] - 0.2, 0.4 - found.mesh.points[:, 0]])
    found = replace(found, velocity=turn / np.abs(turn).max())
    figure = mechanism_figure(found, ("x", "y"))
    (arrows,) = (c for c in figure.axes[0].collections if hasattr(c, "U"))
    drawn, places = np.column_stack([arrows.U, arrows.V]), arrows.get_offsets()
    apart = np.linalg.norm(found.mesh.points[None] - places[:, None], axis=2)
    nodes = apart.argmin(axis=1)
    assert apart.min(axis=1).max() < 1e-12
    scale = np.linalg.norm(drawn) / np.linalg.norm(found.velocity[nodes])
    np.testing.assert_allclose(drawn, scale * found.velocity[nodes], atol=1e-9 * scale)
    cells = next(c for c in figure.axes[0].collections if c.get_array() is not None)
    centres = np.array([path.vertices[:3].mean(axis=0) for path in cells.get_paths()])
    row = np.floor(8 * centres[:, 1]).astype(int)
    by_row = {round(c, 6): s for c, s in zip(centre_heights(found), found.shear, strict=True)}
    expected = np.array([by_row[round((k + 0.5) / 8, 6)] for k in row])
    np.testing.assert_allclose(cells.get_array(), np.maximum(expected, 0.02))


def centre_heights(found: Mechanism) -> np.ndarray:
    return found.mesh.points[found.mesh.blocks[0].nodes].mean(axis=1)[:, 1]


def test_the_picture_says_what_it_shows():
    picture = mechanism_picture(plate(2), ("x", "y"))
    assert picture.title == "Mechanism at stage push"
    assert "50 % of its change of load" in picture.caption


def test_an_error_from_another_process_leaves_its_mesh_there():
    error = CollapseError("falls", "hold it", stage="s", fraction=0.5, motion=plate(2))
    error.add("see there")
    other = pickle.loads(pickle.dumps(error))
    assert (other.stage, other.fraction, other.motion) == ("s", 0.5, None)
    assert str(other).endswith("hold it\n    see there")
