"""Figures of reports that are their names alone."""

from __future__ import annotations

from functools import cache
from importlib import import_module

import pytest


def draw_names_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meanwhile every figure of a report is its name alone.

    They are files of their format with their texts; to draw them in full takes seconds a page.
    """
    style = pytest.importorskip("geoident.report.drawing.style", reason="reports need matplotlib")
    figure = pytest.importorskip("matplotlib.figure").Figure
    page = import_module("geoident.report.page.page")  # before: it takes names of `style` over

    @cache
    def named(name: str, title: str, caption: str, suffix: str) -> bytes:
        with style.drawing_style():
            drawn = figure(figsize=(1.0, 1.0), layout="none")
            drawn.text(0.1, 0.5, name)
            return style.figure_file(drawn, suffix, title=title, description=caption)

    def image(picture: style.Picture, suffix: str) -> bytes:
        return named(picture.name, picture.title, picture.caption, suffix)

    monkeypatch.setattr(style, "image", image)
    monkeypatch.setattr(page, "image", image)
