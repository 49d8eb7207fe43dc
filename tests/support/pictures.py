"""Figures of reports: that are their names alone, and laid out as in pages."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def laid_out(draw: Callable[[], Figure]) -> Figure:
    """A figure with all at its place, as in a page: at half the cost of matplotlib's own way.

    `tests/report/test_saving.py` holds that both put everything at the same places.

    Args:
        draw: makes the figure.
    """
    from geoident.report.drawing.style import drawing_style  # noqa: PLC0415 - with matplotlib
    from geoident.report.saving.figure_file import lay_out  # noqa: PLC0415
    from geoident.report.saving.lean_axes import lean_axes  # noqa: PLC0415

    with drawing_style(), lean_axes():
        figure = draw()
        lay_out(figure)
        figure.draw_without_rendering()
    return figure


@cache
def _named(name: str, title: str, caption: str, suffix: str) -> bytes:
    """A file with the name of a figure in it; made once for all tests."""
    style = import_module("geoident.report.drawing.style")
    with style.drawing_style():
        drawn = import_module("matplotlib.figure").Figure(figsize=(1.0, 1.0), layout="none")
        drawn.text(0.1, 0.5, name)
        file: bytes = style.figure_file(drawn, suffix, title=title, description=caption)
        return file


def draw_names_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meanwhile every figure of a report is its name alone.

    They are files of their format with their texts; to draw them in full takes seconds a page.
    """
    style = pytest.importorskip("geoident.report.drawing.style", reason="reports need matplotlib")
    page = import_module("geoident.report.page.page")  # before: it takes names of `style` over

    def image(picture: style.Picture, suffix: str) -> bytes:
        # others than drawings are looked at by nobody, and texts in them cost most
        words = picture.name, picture.title, picture.caption
        return _named(*(words if suffix == "svg" else ("", "", "")), suffix)

    monkeypatch.setattr(style, "image", image)
    monkeypatch.setattr(page, "image", image)
