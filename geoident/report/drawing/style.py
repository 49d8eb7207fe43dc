"""How all figures look, and how they are saved: the same result gives the same bytes.

Made for print and for colour-blind readers: the colours of Okabe and Ito with a marker each for
things, one scale that is monotonous in lightness for magnitudes.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from matplotlib import rc_context, rcdefaults
from matplotlib.axes import Axes
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from geoident.model.arrays import Ints

COMPUTED = "#1f4e79"
MEASURED = "#262626"
ACCENT = "#d95f02"
FAINT = "#8c8c8c"
GAUGE = "#1a1a1a"
"""Gauges in pictures of the ground: dark on light."""
MM = 1e3  # mm in a metre
WIDTH = 7.4
"""Of the widest figures, inches: a printed page shows them nearly as large as they are drawn."""
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
LENGTHS = "YlGnBu"
STRESSES = "YlOrBr"
DIVERGING = "PuOr"
SMALL = 7.0
MIDDLE = 8.5

_Item = TypeVar("_Item")
Progress = Callable[[str, float], None]
"""Is told which figure is drawn, and what share of all figures, 0 to 1, is done."""
_DPI = 200  # of what is drawn as pixels
_COLUMNS = 3
_SOFT = 1e6  # stresses below, Pa, are shown in kPa
_RC: Any = {
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "text.parse_math": False,  # a $ in a name is a $
    # DejaVu Sans comes with matplotlib, so that layouts do not depend on the machine; a browser
    # without it takes Verdana, whose letters are as wide
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Geneva"],
    "font.size": MIDDLE,
    "axes.titlesize": MIDDLE,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # else each pass of the layout looks for ticks above the axes
    "axes.labelsize": MIDDLE,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "figure.constrained_layout.use": True,
}


@dataclass(frozen=True)
class Picture:
    """A figure that has not been drawn yet.

    Args:
        name: of its file, and of its place in the page.
        title: what it shows.
        caption: what has to be known to read it.
        draw: makes the figure.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]


@contextmanager
def drawing_style() -> Iterator[None]:
    """Our settings of matplotlib, and none of the user's; missing glyphs are drawn as boxes."""
    with warnings.catch_warnings(), rc_context():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        rcdefaults()  # a matplotlibrc of the user does not count
        with rc_context(_RC):
            yield


def image(picture: Picture, suffix: str) -> bytes:
    """A figure as a file: ``svg``, ``png`` or ``pdf``.

    Names inside an SVG depend on that of the picture, so that figures can share a page.
    """
    metadata: Any = {
        "svg": {"Date": None, "Title": picture.title, "Description": picture.caption},
        "pdf": {"CreationDate": None},
        "png": {"Creation Time": None},
    }[suffix]
    buffer = io.BytesIO()
    with drawing_style(), rc_context({"svg.hashsalt": picture.name}):
        figure = picture.draw()
        _spare_layout(figure)
        figure.set_dpi(_DPI)
        canvas = get_registered_canvas_class(suffix)(figure)
        getattr(canvas, f"print_{suffix}")(buffer, metadata=metadata)  # savefig draws twice
    return buffer.getvalue()


def lay_out(figure: Figure) -> None:
    """Give the axes of a figure their places now, not only when it is saved."""
    _spare_layout(figure)
    figure.set_dpi(_DPI)
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)


def _spare_layout(figure: Figure) -> None:
    """Take out of the layout what changes nothing in it, but is measured at every pass."""
    for axes in figure.axes:
        for spine in axes.spines.values():
            spine.set_in_layout(False)  # it lies on the rim of the axes, which counts anyway
        if axes.name == "rectilinear":
            for axis in (axes.xaxis, axes.yaxis):
                if not axis.get_label_text():  # else a place is sought for it beside the numbers
                    axis.set_label_coords(0.0, 0.0)


def svg_files(pictures: Sequence[Picture], progress: Progress | None = None) -> list[bytes]:
    """Figures as files of SVG.

    Args:
        pictures: in their order.
        progress: is told before each figure.
    """
    return images([(picture, "svg") for picture in pictures], progress)


def images(files: Sequence[tuple[Picture, str]], progress: Progress | None = None) -> list[bytes]:
    """Figures as files.

    Args:
        files: picture and suffix of each.
        progress: is told before each file.
    """
    drawn = []
    for done, (picture, suffix) in enumerate(files):
        if progress is not None:
            progress(f"figure {done + 1} of {len(files)}", done / len(files))
        drawn.append(image(picture, suffix))
    return drawn


def colour(k: int) -> str:
    """The colour of the k-th of several things, with `marker`."""
    return _COLOURS[k % len(_COLOURS)]


def marker(k: int) -> str:
    """The marker of the k-th of several things."""
    return _MARKERS[k % len(_MARKERS)]


def key(label: str, **style: Any) -> Line2D:
    """A line or a marker of a legend."""
    return Line2D([], [], label=label, **style)


def arrow(paint: str, width: float) -> dict[str, Any]:
    """The look of an arrow from point to point, as ``annotate`` takes it."""
    return {"arrowstyle": "-|>", "color": paint, "lw": width, "shrinkA": 0, "shrinkB": 0}


def stress_unit(size: float) -> tuple[str, float]:
    """The unit in which stresses of such a size, Pa, are shown, and how many Pa it has.

    >>> stress_unit(2e5), stress_unit(3e6)
    (('kPa', 1000.0), ('MPa', 1000000.0))
    """
    return ("kPa", 1e3) if size < _SOFT else ("MPa", 1e6)


def short(text: str, most: int = 18) -> str:
    """A name cut to so many characters.

    >>> short("bench 1"), short("a stage with a very long name")
    ('bench 1', 'a stage with a ve…')
    """
    return text if len(text) <= most else f"{text[: most - 1]}…"


def evenly(n: int, most: int) -> Ints:
    """Numbers of n things, of more than so many evenly spaced ones, always the first and the last.

    >>> evenly(3, 4).tolist(), evenly(9, 3).tolist()
    ([0, 1, 2], [0, 4, 8])
    """
    return np.linspace(0, n - 1, min(n, most)).round().astype(np.int64)


def labelled(name: str, unit: str) -> str:
    """A name with its unit, for an axis.

    >>> labelled("E", "GPa"), labelled("K0", "")
    ('E (GPa)', 'K0')
    """
    return f"{name} ({unit})" if unit else name


_MOST_TICKS = 14


def stage_ticks(axes: Axes, stages: tuple[str, ...]) -> None:
    """Names of the stages along x, at an angle; of many, every second, third, ...

    Args:
        axes: where to draw.
        stages: their names.
    """
    every = -(-len(stages) // _MOST_TICKS)
    places = range(0, len(stages), every)
    names = [short(stages[k], 14) for k in places]
    axes.set_xticks(list(places), names, rotation=55, ha="right", rotation_mode="anchor")
    axes.set_xlim(-0.4, len(stages) - 0.6)


def hide_unused(panels: list[Axes], used: int) -> None:
    """Remove the panels after the used ones."""
    for axes in panels[used:]:
        axes.remove()


def panel_grid(
    n: int, *, height: float, extra: float, sharex: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure with n panels, up to three in a row.

    Args:
        n: number of panels.
        height: of a panel, inches.
        extra: height for the legend, inches.
        sharex: the panels of a column share their x axis, which is named under the lowest, also
            over an empty place.
    """
    columns = min(_COLUMNS, n)
    rows = -(-n // columns)
    figure = Figure(figsize=((5.0, 5.9, WIDTH)[columns - 1], height * rows + extra))
    panels = figure.subplots(rows, columns, squeeze=False, sharex=sharex)
    for k in range(n, rows * columns):
        if sharex:
            panels[rows - 2, k % columns].tick_params(labelbottom=True)
    hide_unused(list(panels.ravel()), n)
    return figure, list(panels.ravel()[:n])


def paged(
    items: Sequence[_Item],
    draw: Callable[[Sequence[_Item]], Figure],
    *,
    most: int,
    picture: tuple[str, str, str],
    label: Callable[[_Item], str],
) -> tuple[Picture, ...]:
    """Figures of so many things each.

    Args:
        items: what to draw.
        draw: makes the figure of some of them.
        most: items in a figure.
        picture: name, title and caption; the number goes behind the name, first and last item
            behind the title.
        label: what an item is called.
    """
    name, title, caption = picture
    parts = [items[k : k + most] for k in range(0, len(items), most)]
    return tuple(
        Picture(
            f"{name}-{number}",
            f"{title} ({_from_to(label(part[0]), label(part[-1]))})",
            caption,
            partial(draw, part),
        )
        for number, part in enumerate(parts, start=1)
    )


def _from_to(first: str, last: str) -> str:
    return first if first == last else f"{first} to {last}"
