"""Parallel axes of a campaign: where values lie, what is written there, which runs are drawn."""

import numpy as np
import pytest

from geoident.report.drawing.campaign import MOST_LINES, ParallelAxis, parallel_figure, word_axis


def test_values_lie_between_the_ends_of_their_axis():
    axis = ParallelAxis("E (GPa)", np.array([2.0, 3.0, np.nan, 6.0]))
    assert axis.places() == pytest.approx([0.0, 0.25, np.nan, 1.0], nan_ok=True)
    assert axis.ticks() == [(0.0, "2"), (0.5, "4"), (1.0, "6")]


def test_values_that_lie_decades_apart_are_logarithmic():
    axis = ParallelAxis("k", np.array([1.0, 10.0, 100.0]))
    assert axis.places() == pytest.approx([0.0, 0.5, 1.0])
    assert axis.ticks()[1] == (0.5, "10")


def test_what_does_not_vary_lies_in_the_middle():
    axis = ParallelAxis("nu", np.array([0.25, 0.25, np.nan]))
    assert axis.places() == pytest.approx([0.5, 0.5, np.nan], nan_ok=True)
    assert axis.ticks() == [(0.5, "0.25")]


def test_words_have_places_of_their_own():
    axis = word_axis("fit.method", ["simplex", "scan", "", "simplex"])
    assert axis.places() == pytest.approx([0.0, 1.0, np.nan, 0.0], nan_ok=True)
    assert axis.ticks() == [(0.0, "simplex"), (1.0, "scan")]


def test_the_best_run_is_drawn_over_the_others_and_lines_end_at_its_misfit():
    misfit = np.array([4.0, 1.0, np.inf, 2.0])
    figure = parallel_figure([ParallelAxis("K0", np.array([0.0, 1.0, 0.5, 2.0]))], misfit=misfit)
    (panel,) = figure.axes
    (lines,) = panel.collections
    drawn = [path.vertices[:, 1].tolist() for path in lines.get_paths()]
    assert drawn == [pytest.approx([0.0, 1.0]), pytest.approx([1.0, 1 / 3]), [0.5, 0.0]]
    assert panel.lines[0].get_ydata().tolist() == [0.5, 0.0]


def test_of_many_runs_the_best_are_drawn():
    misfit = np.arange(1000.0)
    figure = parallel_figure([ParallelAxis("K0", misfit)], misfit=misfit)
    paths = figure.axes[0].collections[0].get_paths()
    assert len(paths) == MOST_LINES
    assert paths[-1].vertices[0, 1] == 0.0
