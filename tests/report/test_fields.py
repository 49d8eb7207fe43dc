"""What figures of fields say, against states that are known in closed form."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from matplotlib.text import Text

from geoident.model.case import Material, Stage
from geoident.model.ground import Isotropic
from geoident.model.mesh import element_centres
from geoident.model.parameter import Scalar
from geoident.model.results.result import FieldSeries
from geoident.model.results.varied import FieldEstimate
from geoident.model.yielding import MohrCoulomb
from geoident.report.drawing.fields.motion import vector_figure
from geoident.report.drawing.fields.panels import ColouredField, bands, shade, table_figure
from geoident.report.drawing.fields.strength import (
    plastic_strain,
    utilisation,
    utilisation_figure,
    yielded_figure,
)
from geoident.report.drawing.fields.stress import cross_figure, stress_pictures
from geoident.report.drawing.scene import Scene, Window
from geoident.report.drawing.style import drawing_style
from geoident.report.drawing.varied import varied_figure
from tests.support.cases import displacement, make_case
from tests.support.meshes import box
from tests.support.pictures import laid_out
from tests.support.results import example_result

E, NU, C, PHI = 1e9, 0.25, 1e6, np.radians(30.0)
SOIL = Material(
    "soil", Isotropic(E=Scalar(E), nu=Scalar(NU)), yields=(MohrCoulomb(Scalar(C), Scalar(PHI)),)
)


def scene_with(stress, strain, **case):
    """A square under one stress (xx, yy, zz, xy) and strain (xx, yy, xy) from state 1 on."""
    mesh = box("tri6", (3, 3), size=(20.0, 20.0))
    sigma = np.zeros((4, mesh.n_elements, 6))
    sigma[1:, :, :4] = stress
    gradient = np.array([[strain[0], strain[2]], [0.0, strain[1]]])
    motion = np.array([0.0, 1.0, 1.0, 3.0])[:, None, None] * (mesh.points @ gradient.T)
    present = np.ones((4, mesh.n_elements), dtype=bool)
    fields = FieldSeries(mesh, motion, sigma, present, np.zeros_like(present))
    scene = Scene(replace(example_result(2), fields=fields), fields)
    stages = (Stage("drift"), Stage("bench 1"), Stage("bench 2", independent=True))
    settings = {"materials": {"soil": SOIL}, "groups": {"all": "soil"}, "stages": stages, **case}
    scene.__dict__["case"] = make_case(replace(mesh, groups={"all": np.arange(mesh.n_elements)}),
                                       **settings)  # fmt: skip
    scene.fields.mesh.groups["all"] = np.arange(mesh.n_elements)
    return scene


def test_utilisation_is_one_on_the_surface_and_follows_the_deviator():
    """Uniaxial compression 2 c cos(phi) / (1 - sin(phi)) yields; at no stress nothing is used."""
    strength = 2 * C * np.cos(PHI) / (1 - np.sin(PHI))
    for part, expected in ((1.0, 1.0), (0.0, 0.0)):
        scene = scene_with([0.0, -part * strength, 0.0, 0.0], [0, 0, 0])
        np.testing.assert_allclose(utilisation(scene, 1), expected, atol=1e-12)
    half = utilisation(scene_with([0.0, -0.5 * strength, 0.0, 0.0], [0, 0, 0]), 1)
    # yields at the same mean stress p with s1 = t - p, s3 = -2 t - p
    p = 0.5 * strength / 3
    t = (C * np.cos(PHI) + p * np.sin(PHI)) * 2 / (3 - np.sin(PHI))
    np.testing.assert_allclose(half, 0.5 * strength / 3 / t)


def test_plastic_strain_is_what_the_stress_does_not_explain():
    sigma = np.array([-1e6, -2e6, -0.5e6, 0.3e6])
    elastic = np.append((sigma[:3] * (1 + NU) - NU * sigma[:3].sum()) / E, 2 * (1 + NU) / E * 3e5)
    plastic = np.array([2e-3, -1e-3, -elastic[2], 4e-3])  # xx, yy, gamma xy; none out of plane
    total = elastic + plastic
    found = plastic_strain(scene_with(sigma, [total[0], total[1], total[3]]))
    squares = (plastic[:3] ** 2).sum() + 0.5 * plastic[3] ** 2
    np.testing.assert_allclose(found[1], np.sqrt(2 / 3 * squares), rtol=1e-9)
    np.testing.assert_allclose(found[0], 0.0)


def test_a_stage_builds_on_its_base_and_displacements_count_since_the_zero():
    channels = tuple(displacement(f"g{k}", (1.0, 1.0), (1.0, 0.0), zero="drift") for k in range(3))
    scene = scene_with([0] * 4, [1e-3, 0, 0], channels=channels)
    assert [scene.base(state) for state in (1, 2, 3)] == [0, 1, 2]
    assert scene.history(3) == (1, 2, 3)
    assert scene.zero_state == 1
    x = scene.fields.mesh.points[:, 0]
    np.testing.assert_allclose(scene.displacement(3, since=2)[:, 0], 2e-3 * x, atol=1e-15)


def test_vectors_end_inside_their_panels(plane):
    scene = Scene(plane, plane.fields)
    figure = laid_out(partial(vector_figure, scene.views[0]))
    for axes in figure.axes:
        (arrows,) = [c for c in axes.collections if isinstance(c, Quiver)]
        tips = np.stack([arrows.X + arrows.U, arrows.Y + arrows.V], axis=1)
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        assert len(tips)
        assert (tips >= low).all()
        assert (tips <= high).all()


def test_crosses_lie_along_the_principal_stresses():
    angle = np.radians(20.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    tensor = turn @ np.diag([-4e6, -1e6]) @ turn.T
    scene = scene_with([tensor[0, 0], tensor[1, 1], -2e6, tensor[0, 1]], [0, 0, 0])
    with drawing_style():
        axes = cross_figure(scene.views[0]).axes[0]
    lines = [c for c in axes.collections if isinstance(c, LineCollection)]
    arms = np.diff(np.array(lines[-2].get_segments()), axis=1)[:, 0].reshape(-1, 2, 2)
    assert len(arms) > 100
    long, short = arms[:, 0], arms[:, 1]
    ratio = np.linalg.norm(long, axis=1) / np.linalg.norm(short, axis=1)
    np.testing.assert_allclose(ratio, 4.0)
    np.testing.assert_allclose(np.arctan(long[:, 1] / long[:, 0]), angle)
    assert len(lines[-1].get_segments()) == 0  # no tension


def scale_of(figure, label):
    """First and last value of a scale of colours."""
    (axes,) = [each for each in figure.axes if each.get_xlabel().startswith(label)]
    return axes.get_xlim()


def test_stresses_of_soils_are_shown_in_kilopascal():
    for size, unit in ((2e5, "kPa"), (2e6, "MPa")):
        ground = scene_with([-size, -size, -size, 0], [0, 0, 0])
        figure = laid_out(stress_pictures(ground.views[0])[0].draw)
        ends = scale_of(figure, f"minimum principal stress ({unit}, tension positive)")
        assert ends == pytest.approx((-200 if unit == "kPa" else -2,) * 2, abs=1e-3)


def test_scales_of_colours_are_in_the_units_that_they_name():
    """2 and 3 MPa of compression, 62.5 % of the strength, 1.5 % of plastic strain."""
    even = scene_with([-2e6, -3e6, -2e6, 0], [0, 0, 0])
    least, largest, _ = stress_pictures(even.views[0])
    unit = "principal stress (MPa, tension positive)"
    assert scale_of(laid_out(least.draw), f"minimum {unit}") == pytest.approx((-3, -3), abs=1e-4)
    assert scale_of(laid_out(largest.draw), f"maximum {unit}") == pytest.approx((-2, -2), abs=1e-4)
    turned = scene_with([-2.5e6, -2.5e6, -2e6, 1.5e6], [0, 0, 0])  # -1 and -4 MPa at 45 degrees
    least, largest, _ = stress_pictures(turned.views[0])
    assert scale_of(laid_out(least.draw), f"minimum {unit}") == pytest.approx((-4, -4), abs=1e-4)
    assert scale_of(laid_out(largest.draw), f"maximum {unit}") == pytest.approx((-1, -1), abs=1e-4)
    strength = 2 * C * np.cos(PHI) / (1 - np.sin(PHI))
    used = scene_with([0.0, -0.5 * strength, 0.0, 0.0], [0, 0, 0])
    _, last = scale_of(laid_out(lambda: utilisation_figure(used.views[0])), "utilisation (%")
    assert 62.5 < last < 75.0
    flowed = scene_with([0, 0, 0, 0], [1.5e-2 * np.sqrt(0.75), -1.5e-2 * np.sqrt(0.75), 0])
    flowed.fields.yielded[1:] = True
    label = "equivalent plastic strain (%)"
    _, last = scale_of(laid_out(lambda: yielded_figure(flowed.views[0])), label)
    assert 1.5 <= last < 2.0 or 4.5 <= last < 6.0  # of the state with three times the motion


def test_a_field_that_varies_is_drawn_in_its_unit_with_parts_in_percent():
    scene = scene_with([-2e6, -3e6, -2e6, 0], [0, 0, 0])
    n = scene.fields.mesh.n_elements
    step = np.linspace(0.0, 1.0, n)
    found = FieldEstimate(
        "rock.E", "rock", "E", "pressure", "GPa", np.arange(n), np.zeros((n, 2)),
        (2 + step) * 1e9, 0.1 + 0.1 * step, np.full(n, 0.3), 0.4 + 0.2 * step, 3, 0.9,
    )  # fmt: skip
    figure = laid_out(lambda: varied_figure(scene.views[0], found))
    ends = {
        axes.get_title(loc="left") or axes.get_title(): np.ptp(mesh.get_array()) * 1j
        + mesh.get_array().min()
        for axes in figure.axes
        for mesh in axes.collections
        if isinstance(mesh, PolyCollection) and mesh.get_array() is not None
    }
    assert ends["E (GPa)"] == pytest.approx(2.0 + 1.0j)
    assert ends["standard deviation (%)"] == pytest.approx(10.0 + 10.0j)
    assert ends["variance reduction (%)"] == pytest.approx(40.0 + 20.0j)


@pytest.mark.parametrize(("low", "high"), [(0.5, 9.0), (-4.0, 5.0)])
def test_colours_are_those_of_their_bands_and_what_is_absent_stays_white(low, high):
    scene = scene_with([0] * 4, [0, 0, 0])
    (view,) = scene.views
    scene.fields.present[1] = element_centres(scene.fields.mesh)[:, 0] < 40 / 3  # two of three rows
    value = low + (high - low) * view.sheet.xy[:, 1] / 20.0
    scale = bands(np.stack([np.clip(value, low + 1.0, high - 1.0), np.ones(len(value))]), "Blues")
    with drawing_style():
        figure = Figure(figsize=(2, 2), layout="none")
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        shade(axes, view, 1, value, scale)
        axes.set(xlim=(0, 20), ylim=(0, 20))
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())[::-1, :, :3] / 255
    rows, columns = pixels.shape[:2]
    rising = low + (high - low) * (np.arange(rows) + 0.5) / rows
    clear = np.abs(rising[:, None] - scale["levels"]).min(axis=1) > 3 * (high - low) / rows
    expected = scale["cmap"](scale["norm"](rising))[:, None, :3]
    here = slice(2, int(columns * 2 / 3) - 2)
    assert clear.mean() > 0.5
    np.testing.assert_allclose(pixels[clear, here], np.broadcast_to(
        expected[clear], pixels[clear, here].shape), atol=0.01)  # fmt: skip
    assert (pixels[:, int(columns * 2 / 3) + 2 :] == 1.0).all()


@pytest.mark.parametrize("state", [1, 3])
def test_of_one_stage_only_its_state_is_drawn(plane, state):
    scene = Scene(plane, plane.fields, only=state)
    with drawing_style():
        figure = vector_figure(scene.views[0])
    assert len(figure.axes) == 1


@pytest.mark.parametrize("aspect", [0.7, pytest.param(1.0, marks=pytest.mark.slow), 1.05])
def test_titles_over_scales_of_colours_are_not_cut(plane, aspect):
    """Panels that are narrower than their room stand below their title, not in its room."""
    scene = Scene(plane, plane.fields)
    (view,) = scene.views
    low, high = scene.box
    part = np.array([1.0, aspect]) / max(1.0, aspect)
    window = Window(low, low + (high - low) * part)
    view.window = window
    quantity = ColouredField("size (mm)", lambda v, state: np.full(len(v.sheet.xy), state), "Blues")
    figure = laid_out(lambda: table_figure(view, [quantity] * 4))
    said = {axes.get_title(loc="left") for axes in figure.axes} - {""}
    titles = [text.get_window_extent() for text in figure.findobj(Text) if text.get_text() in said]
    assert max(box.y1 for box in titles) < figure.bbox.y1 - 2.5  # the layout keeps 3 points free
