"""Pictures of shells: tunnels unrolled, slabs in their plane, others in space."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from geoident.model.parameter import Scalar
from geoident.model.results.shells import ShellForces
from geoident.model.structures import Shell
from geoident.report.drawing import sections
from geoident.report.drawing.shells import shell_pictures
from geoident.report.drawing.style import drawing_style

ALONG, AROUND = 3, 16


def _faces(place, normal, first, names):
    """Quadrilaterals of a grid on a surface of two coordinates, 0 to 1."""
    s, t = (np.linspace(0.0, 1.0, n + 1) for n in (ALONG, AROUND))
    grid = place(*np.meshgrid(s, t, indexing="ij"))
    corners = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
    corners = corners.reshape(-1, 4, 3)
    centres = corners.mean(axis=1)
    n = normal(centres)
    one = first - (n @ first)[:, None] * n
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    count = len(corners)
    moment = np.stack([1e3 + centres[:, 2] * 1e3, centres[:, 2] * 2e3, 0 * centres[:, 2]], axis=1)
    return ShellForces(
        structures=tuple(names[k * len(names) // count] for k in range(count)),
        numbers=np.arange(1, count + 1),
        stages=("line",),
        centres=centres,
        corners=corners,
        axes=np.stack([one, np.cross(n, one), n], axis=1),
        normal=-1e5 * np.ones((count, 3, 1)),
        moment=moment[:, :, None],
    )


def _tunnel(turn):
    """A part of a round tunnel of R = 2 m along y, 6 m long, from the crown on."""
    return _faces(
        lambda s, t: np.stack([2 * np.sin(turn * t), 6 * s, 2 * np.cos(turn * t)], axis=-1),
        lambda c: -c * [1, 0, 1] / np.linalg.norm(c * [1, 0, 1], axis=1, keepdims=True),
        np.array([0.0, 1.0, 0.0]),
        ("round 1", "round 2"),
    )


def _drawn(forces):
    (picture,) = shell_pictures(SimpleNamespace(shells=forces))
    with drawing_style():
        return picture, picture.draw()


@pytest.mark.parametrize("turn", [np.pi, 2 * np.pi])
def test_a_tunnel_is_unrolled_from_its_crown_with_the_linings_of_its_rounds(turn):
    picture, figure = _drawn(_tunnel(turn))
    assert picture.title == "Forces in round 1 to round 2"
    maps = [c for axes in figure.axes for c in axes.collections if isinstance(c, PolyCollection)]
    places = np.array([path.vertices[:4] for path in maps[0].get_paths()])
    assert np.ptp(places[..., 0]) == pytest.approx(6.0)
    assert np.ptp(places[..., 1]) == pytest.approx(2.0 * turn)
    sizes = np.ptp(places[..., 1], axis=1)  # of its faces: none is cut by the end of the circle
    np.testing.assert_allclose(sizes, 2.0 * turn / AROUND)
    right = places[np.argmax(_tunnel(turn).centres[:, 0]), :, 1].mean()
    assert right == pytest.approx(np.pi / 2 * 2.0, abs=2.0 * turn / AROUND)
    rows = [axes.get_ylabel() for axes in figure.axes if "N" in axes.get_ylabel()]
    assert rows == ["n_11 (kN/m)", "n_22 (kN/m)", "m_11 (kNm/m)", "m_22 (kNm/m)"]


def test_n_and_m_of_its_faces_are_drawn_in_the_diagram_of_its_section(monkeypatch):
    """Dots in three directions; the line of t = 0.3 m, 20 MPa and no tension reaches -6 MN/m."""
    forces = _tunnel(np.pi)
    count = len(forces.numbers)
    used = replace(forces, utilisation=np.full((count, 3, 1), 0.5), used_angle=np.zeros((count, 1)))
    shell = Shell("wall", Scalar(1e9), Scalar(0.3), Scalar(0.2), (0.0, 1.0, 0.0),
                  compressive_strength=20e6)  # fmt: skip
    case = SimpleNamespace(structures={"round 1": shell, "round 2": shell})
    monkeypatch.setattr(sections, "case_of", lambda result: case)
    parameters = SimpleNamespace(names=(), values=np.empty(0))
    pictures = sections.section_pictures(
        SimpleNamespace(members=None, shells=used, parameters=parameters)
    )
    assert [picture.name for picture in pictures] == ["strength-1", "strength-2"]
    with drawing_style():
        limit, dots = pictures[0].draw().axes[0].lines
    assert [*limit.get_ydata()[[0, 60]]] == pytest.approx([-6000.0, 0.0])
    assert limit.get_xdata().max() == pytest.approx(20e3 * 0.3**2 / 8)
    own = np.array(forces.structures) == "round 1"
    assert len(dots.get_xdata()) == 3 * own.sum()
    assert dots.get_xdata().max() == pytest.approx(forces.moment[own].max() / 1e3)


def test_a_slab_is_drawn_in_its_plane_and_a_dome_in_space():
    slab = _faces(
        lambda s, t: np.stack([6 * s, 0.0 * s + 1.0, 4 * t], axis=-1),
        lambda c: np.tile([0.0, 1.0, 0.0], (len(c), 1)),
        np.array([1.0, 0.0, 0.0]),
        ("wall",),
    )
    _, figure = _drawn(slab)
    assert figure.axes[0].name == "rectilinear"
    assert np.ptp(figure.axes[0].get_xlim()) == pytest.approx(6.0)
    dome = _faces(
        lambda s, t: np.stack([s, t, np.sqrt(4.0 - s**2 - t**2)], axis=-1),
        lambda c: c / np.linalg.norm(c, axis=1, keepdims=True),
        np.array([1.0, 0.0, 0.0]),
        ("dome",),
    )
    assert _drawn(dome)[1].axes[0].name == "3d"


def test_folds_part_shells_and_a_plate_has_no_rows_of_normal_forces():
    slab = _faces(
        lambda s, t: np.stack([6 * s, 4 * t, np.maximum(0.0, 6 * s - 4.0)], axis=-1),
        lambda c: np.where(c[:, :1] > 4.0, [-(0.5**0.5), 0.0, 0.5**0.5], [0.0, 0.0, 1.0]),
        np.array([1.0, 0.0, 0.0]),
        ("slab",),
    )
    slab.normal[:] = 1e-9
    pictures = shell_pictures(SimpleNamespace(shells=slab))
    assert len(pictures) == 2
    with drawing_style():
        labels = [axes.get_ylabel() for axes in pictures[0].draw().axes]
    assert not any("n_" in label for label in labels)
