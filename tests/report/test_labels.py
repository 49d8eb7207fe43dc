"""Labels are read: inside the axes, apart from each other, off what they name, always the same."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from geoident.report.drawing.labels import arranged, place_labels
from geoident.report.drawing.space import hidden
from geoident.report.drawing.style import drawing_style

FRAME = np.array([0.0, 0.0, 300.0, 200.0])


def crowd(n, seed=3):
    """Half of the labels close together, the others anywhere, also on the border."""
    rng = np.random.default_rng(seed)
    points = np.vstack([rng.normal((150, 100), 20, (n // 2, 2)), rng.random((n - n // 2, 2))])
    points[n // 2 :] *= FRAME[2:]
    return [point[None] for point in points], np.tile((30.0, 8.0), (n, 1))


def overlapping(boxes):
    low = boxes[:, None, :2] < boxes[None, :, 2:]
    touch = (low & low.transpose(1, 0, 2)).all(axis=2)
    np.fill_diagonal(touch, val=False)
    return touch.sum() // 2


@pytest.mark.parametrize("n", [1, 12, 50])
def test_labels_lie_inside_and_apart(n):
    anchors, sizes = crowd(n)
    boxes, shrunk = arranged(anchors, sizes, FRAME)
    assert shrunk == 1.0
    assert (boxes[:, :2] > FRAME[:2]).all()
    assert (boxes[:, 2:] < FRAME[2:]).all()
    assert overlapping(boxes) == 0
    np.testing.assert_allclose(boxes[:, 2:] - boxes[:, :2], sizes)


def test_letters_become_smaller_where_there_is_no_room():
    anchors, sizes = crowd(60)
    boxes, shrunk = arranged(anchors, 1.42 * sizes, FRAME)
    assert shrunk < 1.0
    assert overlapping(boxes[np.isfinite(boxes[:, 0])]) == 0


def test_what_fits_nowhere_has_no_place():
    boxes, shrunk = arranged([np.array([[5.0, 5.0]])], np.array([[900.0, 8.0]]), FRAME)
    assert np.isnan(boxes).all()
    assert shrunk == pytest.approx(0.6)


def test_a_lone_label_stands_beside_its_anchor_and_marks_and_lines_are_left_free():
    anchor, size = [np.array([[150.0, 100.0]])], np.array([[30.0, 8.0]])
    (alone,), _ = arranged(anchor, size, FRAME)
    assert 150 < alone[0] < 156
    line = np.array([[100.0, 100.0], [250.0, 100.0]])
    mark = np.array([[160.0, 110.0]])
    (moved,), _ = arranged(anchor, size, FRAME, avoid=[line, mark])
    assert moved[3] < 100 or moved[1] > 100
    assert not (moved[0] < 160 < moved[2] and moved[1] < 110 < moved[3])


def test_a_centred_label_stands_on_its_anchor_if_it_can():
    anchors = [np.array([[150.0, 100.0]]), np.array([[170.0, 100.0]])]
    boxes, _ = arranged(anchors, np.tile((30.0, 8.0), (2, 1)), FRAME, centred=np.ones(2, bool))
    np.testing.assert_allclose((boxes[0, :2] + boxes[0, 2:]) / 2, (150, 100))
    assert overlapping(boxes) == 0


@pytest.mark.parametrize("projection", [None, "3d"])
def test_labels_of_a_figure_stay_in_their_axes_and_are_the_same_each_time(projection):
    def drawn():
        with drawing_style():
            figure = Figure(figsize=(4, 3))
            axes = figure.add_subplot(projection=projection)
            dim = 3 if projection else 2
            corner = [np.full(dim, k / 9) for k in range(10)]
            texts = place_labels(axes, corner, [f"gauge {k}" for k in range(10)], colour="red")
            texts += place_labels(axes, corner[:1], ["the corner"])
            figure.draw_without_rendering()
            extents = [text.get_window_extent().extents for text in texts]
            return np.array(extents), axes.get_window_extent().extents

    boxes, frame = drawn()
    assert overlapping(boxes) == 0
    assert (boxes[:, :2] > frame[:2]).all()
    assert (boxes[:, 2:] < frame[2:]).all()
    np.testing.assert_array_equal(boxes, drawn()[0])


def test_a_label_far_from_its_anchor_has_a_leader_to_it():
    with drawing_style():
        figure = Figure(figsize=(4, 3))
        axes = figure.subplots()
        place_labels(axes, [(0.5, 0.5)] * 20, ["name"] * 20)
        figure.draw_without_rendering()
        leaders = [line for line in axes.lines if line.get_visible()]
        ends = [line.get_transform().transform(line.get_xydata())[-1] for line in leaders]
        np.testing.assert_allclose(ends, [axes.transData.transform((0.5, 0.5))] * len(ends))
        assert len(leaders) > 12
        lone = place_labels(figure.add_subplot(), [(0.5, 0.5)], ["name"])[0].axes
        figure.draw_without_rendering()
        assert not [line for line in lone.lines if line.get_visible()]


def sphere(n):
    """Triangles (m, 3, 3) of the unit sphere, as patches between n meridians and n circles."""
    turn, rise = np.meshgrid(np.linspace(0, 2 * np.pi, n), np.linspace(0, np.pi, n), indexing="ij")
    at = np.stack([np.cos(turn) * np.sin(rise), np.sin(turn) * np.sin(rise), np.cos(rise)], axis=2)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(
        -1, 3, 3
    )


@pytest.mark.parametrize("far", [0.0, 1e5])
def test_what_lies_behind_or_inside_a_sphere_is_hidden(far):
    towards = np.array([0.6, -0.48, 0.64])
    points = np.random.default_rng(5).uniform(-2, 2, (500, 3))
    along = points @ towards
    beside = np.linalg.norm(points - along[:, None] * towards, axis=1)
    behind = (beside < 1) & (along < np.sqrt(np.clip(1 - beside**2, 0, None)))
    rim = np.abs(beside - 1) < 0.02  # the triangles are not quite a sphere
    rim |= (beside < 1) & (np.abs(along - np.sqrt(np.clip(1 - beside**2, 0, None))) < 0.02)
    found = hidden(points + far, sphere(60) + far, towards)
    assert np.array_equal(found[~rim], behind[~rim])
    assert 0 < behind.sum() < 250 < (~rim).sum()


def test_a_point_on_a_surface_is_not_hidden_by_it_and_without_one_nothing_is():
    towards = np.array([0.0, 0.0, 1.0])
    floor = np.array([[[0.0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 0, 0], [4, 0, 0], [4, 0, 4]]])
    points = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, -1.0], [2.2, 2.0, -1.0]])
    assert hidden(points, floor, towards).tolist() == [False, True, False]
    assert not hidden(points, np.empty((0, 3, 3)), towards).any()
    assert hidden(np.empty((0, 3)), floor, towards).shape == (0,)
