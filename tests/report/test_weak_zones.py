"""A block with two weak zones across a heading, fitted: both are seen and named in every view."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import geoident
from geoident.report.drawing.album import album
from geoident.report.drawing.model.construction import material_colours
from geoident.report.drawing.scene import case_of, scene_of
from geoident.workflow.report import read_results
from tests.report.test_labels import overlapping
from tests.report.test_model_picture import placed, words
from tests.support.pictures import laid_out

CASE = """\
format: geoident-case/1
title: Heading through two weak zones
analysis: solid
mesh: {file: block.inp}
parameters:
  E:       {start: 8 GPa, bounds: [0.5 GPa, 50 GPa], scale: log}
  E_zones: {start: 3 GPa, bounds: [0.1 GPa, 20 GPa], scale: log}
materials:
  gneiss:   {elastic: isotropic, E: $E, nu: 0.25}
  crushed:  {elastic: isotropic, E: $E_zones, nu: 0.3}
  mylonite: {elastic: isotropic, E: 0.5 $E_zones, nu: 0.3}
groups: {rock: gneiss, zone-a: crushed, zone-b: mylonite, first: gneiss, second: gneiss}
supports: {side: x, far: x, front: y, back: y, bottom: z}
in_situ: {model: heim, vertical: 5 MPa, K0: 0.8}
stages:
  - {name: first, excavate: [first]}
  - {name: second, excavate: [second]}
gauges:
  A:
    {kind: extensometer, head: [4 m, 15 m, 20 m], anchors: {a: [4 m, 15 m, 26 m]},
     accuracy: 0.1 mm}
  B:
    {kind: extensometer, head: [4 m, 25 m, 20 m], anchors: {a: [4 m, 25 m, 26 m]},
     accuracy: 0.1 mm}
  C: {kind: convergence, between: [[0 m, 15 m, 20 m], [0 m, 15 m, 10 m]], accuracy: 0.1 mm}
readings: readings.csv
fit: {mesh_error: false, model_error: none}
"""
READINGS = """\
gauge,stage,value,unit
A.a,first,0.47,mm
C,first,-15.51,mm
A.a,second,-0.19,mm
B.a,second,-0.05,mm
C,second,-25.52,mm
"""
"""Of the model at E = 4 GPa, E_zones = 1 GPa, with noise."""

N = (6, 12, 6)
SIZE = (24.0, 42.0, 30.0)
LEAN = 0.35
"""Of the planes of the zones, by the height."""


def deck():
    """A block of hexahedra whose layers across the heading lean, as an Abaqus deck."""
    place = {}
    for i in range(N[0] + 1):
        for j in range(N[1] + 1):
            for k in range(N[2] + 1):
                x, y, z = (SIZE[a] * n / N[a] for a, n in enumerate((i, j, k)))
                bulge = np.sin(np.pi * j / N[1])  # ends stay upright
                place[i, j, k] = (x, y + LEAN * (z - 15.0) * bulge * 0.6, z)
    number = {at: 1 + n for n, at in enumerate(place)}
    lines = ["*NODE", *(f"{number[at]}, {x}, {y}, {z}" for at, (x, y, z) in place.items())]
    groups = {name: [] for name in ("rock", "zone-a", "zone-b", "first", "second")}
    lines.append("*ELEMENT, TYPE=C3D8")
    corner = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
    count = 0
    for i in range(N[0]):
        for j in range(N[1]):
            for k in range(N[2]):
                count += 1
                nodes = [number[i + a, j + b, k + c + up] for up in (0, 1) for a, b, c in corner]
                lines.append(", ".join(map(str, [count, *nodes])))
                dug = i < 1 and k in (2, 3)
                name = (("first" if j < 5 else "second") if dug and j < 9
                        else "zone-a" if j == 5 else "zone-b" if j == 8 else "rock")  # fmt: skip
                groups[name].append(count)
    for name, members in groups.items():
        lines += [f"*ELSET, ELSET={name}", *map(str, members)]
    sides = {"side": (0, 0), "far": (0, N[0]), "front": (1, 0), "back": (1, N[1]), "bottom": (2, 0)}
    for name, (axis, value) in sides.items():
        lines += [f"*NSET, NSET={name}"]
        lines += [str(number[at]) for at in place if at[axis] == value]
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("zones")
    (folder / "block.inp").write_text(deck())
    (folder / "readings.csv").write_text(READINGS)
    (folder / "case.yaml").write_text(CASE)
    found = geoident.fit(folder / "case.yaml")
    ((_, result),) = read_results([str(Path(found.path))])
    return result


@pytest.fixture(scope="module")
def model(fitted):
    (picture,) = album(fitted).model
    return laid_out(picture.draw)


def test_the_moduli_of_rock_and_zones_are_found(fitted):
    truth = np.array([4e9, 1e9])
    assert (fitted.parameters.lower95 < truth).all()
    assert (truth < fitted.parameters.upper95).all()
    assert fitted.parameters.determined.all()


def panel(figure, title):
    (found,) = [axes for axes in figure.axes if axes.get_title().startswith(title)
                or axes.get_title(loc="left").startswith(title)]  # fmt: skip
    return found


@pytest.mark.parametrize("title", ["inside", "section x"])
def test_both_zones_have_their_names_where_they_are(model, title):
    axes = panel(model, title)
    labels = {text.get_text(): text for text in placed(axes) if text.get_visible()}
    assert {"crushed", "mylonite"} <= set(labels)
    boxes = np.array([text.get_window_extent().extents for text in labels.values()])
    assert overlapping(boxes) == 0
    if title == "section x":  # they lean; the names stand in or at their bands
        to_data = axes.transData.inverted()
        for name, y in (("crushed", 19.3), ("mylonite", 31.0)):
            box = to_data.transform(labels[name].get_window_extent().extents.reshape(2, 2))
            assert abs(box[:, 0].mean() - y) < 8.0


def test_the_legend_has_the_zones_with_what_was_found(model):
    said = words(model)
    assert any(text.startswith("crushed: E = ") for text in said)
    assert any(text.startswith("mylonite: E = ") for text in said)


def test_both_zones_have_their_colours_on_the_outside_and_inside(fitted, model):
    colours = material_colours(case_of(fitted))
    for title in ("the whole model", "inside"):
        axes = panel(model, title)
        faces = np.concatenate([c.get_facecolor() for c in axes.collections if
                                len(c.get_facecolor())])[:, :3]  # fmt: skip
        for name in ("crushed", "mylonite"):
            shades = faces / np.maximum(faces.max(axis=1, keepdims=True), 1e-9)
            own = np.array(to_rgb(colours[name]))
            assert (np.abs(shades - own / own.max()).max(axis=1) < 0.02).any(), (title, name)


def test_a_section_through_leaning_zones_has_no_teeth(fitted):
    """Points on the border of a zone in a section lie on its plane, not on corners of elements."""
    scene = scene_of(fitted)
    sheet = next(
        view.sheet for view in scene.views if view.sheet.plane and view.sheet.plane.axis == 0
    )
    label = np.zeros(fitted.fields.mesh.n_elements, dtype=np.int64)
    label[fitted.fields.mesh.groups["zone-a"]] = 1
    ends = sheet.borders(label).at(fitted.fields.mesh.points)[:, :, list(sheet.axes)].reshape(-1, 2)
    assert len(ends) > 8
    bulge = {j: np.sin(np.pi * j / N[1]) for j in (5, 6)}
    off = [np.abs(ends[:, 0] - (SIZE[1] * j / N[1] + LEAN * 0.6 * bulge[j] * (ends[:, 1] - 15.0)))
           for j in bulge]  # fmt: skip
    assert np.min(off, axis=0).max() < 1e-6
