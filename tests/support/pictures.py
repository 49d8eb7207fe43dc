"""Figures of reports: that are their names alone, and laid out as in pages."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def laid_out(draw: Callable[[], Figure]) -> Figure:
    """A figure with all at its place, as in a page.

    Args:
        draw: makes the figure.
    """
    from geoident.report.drawing.style import drawing_style  # noqa: PLC0415 - with matplotlib

    with drawing_style():
        figure = draw()
        figure.draw_without_rendering()
    return figure


def draw_names_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meanwhile every figure of a report is its name alone.

    They are files of their format with their texts; to draw them in full takes seconds a page.
    """
    style = pytest.importorskip("geoident.report.drawing.style", reason="reports need matplotlib")
    # pictures of models take `image` by its name: imported first, else they keep ours for good
    pytest.importorskip("geoident.report.drawing.model.figure", reason="reports need matplotlib")
    draw = style.image

    def image(picture: Any, suffix: str) -> bytes:
        # others than drawings are looked at by nobody, and texts in them cost most
        words = picture.name, picture.title, picture.caption
        return _named(draw, *(words if suffix == "svg" else ("", "", "")), suffix)

    monkeypatch.setattr(style, "image", image)


@cache
def _named(draw: Callable[..., bytes], name: str, title: str, caption: str, suffix: str) -> bytes:
    """A file with the name of a figure in it; made once for all tests."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    from geoident.report.drawing.style import Picture  # noqa: PLC0415

    def figure() -> Figure:
        drawn = Figure(figsize=(1.0, 1.0))
        drawn.set_layout_engine("none")
        drawn.text(0.1, 0.5, name)
        return drawn

    return draw(Picture(name, title, caption, figure), suffix)
