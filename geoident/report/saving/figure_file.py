"""A figure as a file: laid out once, written once, the same bytes for the same figure.

`Figure.savefig` draws every figure twice, once to see what it needs; the layout alone tells as
much, at half the time.
"""

from __future__ import annotations

import io

from matplotlib.figure import Figure

from geoident.report.saving.lean_axes import only_places_change
from geoident.report.saving.svg_writer import SvgCanvas
from geoident.report.saving.words import mark_halos

_DPI = 150  # of what is drawn as pixels
_POINTS = 72  # to the inch, the unit of an SVG
_DATES = {"pdf": "CreationDate", "png": "Creation Time"}


def figure_file(figure: Figure, suffix: str, *, title: str = "", description: str = "") -> bytes:
    """A figure as a file: ``svg``, ``png`` or ``pdf``.

    Args:
        figure: to be written; it is of no use afterwards.
        suffix: of the file.
        title: what it shows, for those who cannot see it.
        description: what more has to be known.
    """
    buffer = io.BytesIO()
    if suffix != "svg":
        figure.savefig(buffer, format=suffix, dpi=_DPI, metadata={_DATES[suffix]: None})
        return buffer.getvalue()
    mark_halos(figure)
    canvas = SvgCanvas(figure, _DPI)
    figure.dpi = _POINTS
    lay_out(figure)
    return canvas.written(title, description)


def lay_out(figure: Figure) -> None:
    """Give all that is in a figure its place, once and for all."""
    engine = figure.get_layout_engine()
    if engine is not None:
        with only_places_change(figure):
            engine.execute(figure)
        figure.set_layout_engine("none")
