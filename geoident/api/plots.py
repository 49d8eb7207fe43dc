"""Figures of a result as axes of matplotlib: those of the report, one by one."""

# ruff: noqa: PLC0415 - matplotlib is loaded by what draws, and may be missing

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from geoident.api.calling import needed, spoken
from geoident.errors import UsageError
from geoident.io.text.wording import did_you_mean
from geoident.model.results.result import Result
from geoident.report.page.html import Html, joined, tag

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from geoident.report.drawing.album import Album
    from geoident.report.drawing.style import Picture

_SECTION = re.compile(r"section-(\d+)-")
_DPI = 100


class Drawing(tuple["Axes", ...]):
    """The axes of one or more figures, which a notebook shows.

    ``drawing[0].set_title(...)`` changes a panel, ``drawing.figure.savefig("a.pdf")`` saves it. No
    figure is registered with pyplot, so none has to be closed.

    Attributes:
        figures: the figures to which the axes belong.
        captions: of each figure, what it shows and what has to be known to read it.
    """

    figures: tuple[Figure, ...]
    captions: tuple[str, ...]

    @classmethod
    def of(cls, pictures: Sequence[Picture]) -> Drawing:
        """Draw pictures."""
        from geoident.report.drawing.style import drawing_style

        with drawing_style():
            figures = tuple(picture.draw() for picture in pictures)
        drawn = cls(axes for figure in figures for axes in figure.axes)
        drawn.figures = figures
        drawn.captions = tuple(f"{p.title}. {p.caption}".strip() for p in pictures)
        return drawn

    @property
    def figure(self) -> Figure:
        """The first figure."""
        return self.figures[0]

    def __repr__(self) -> str:
        return f"Drawing({len(self)} axes: {' '.join(self.captions)})"

    def _repr_html_(self) -> str:
        pairs = zip(self.figures, self.captions, strict=True)
        return joined(
            tag("figure", _image(figure, caption), tag("figcaption", caption))
            for figure, caption in pairs
        )


def _image(figure: Figure, words: str) -> Html:
    """A figure inside HTML."""
    from geoident.report.drawing.style import drawing_style

    buffer = io.BytesIO()
    with drawing_style():
        figure.savefig(buffer, format="png", dpi=_DPI)
    content = base64.b64encode(buffer.getvalue()).decode("ascii")
    return tag("img", src=f"data:image/png;base64,{content}", alt=words, style="max-width: 100%")


class Plots:
    """The figures of a result, drawn when they are asked for.

    Args:
        result: what to draw.
    """

    def __init__(self, result: Result) -> None:
        self._result = result.for_people

    @spoken
    def overview(self) -> Drawing:
        """Displacements around the gauges, and the gauges whose readings say most.

        Raises:
            MissingExtra: matplotlib is not installed.
            UsageError: nothing was computed that could be drawn.
        """
        return self._drawn(self._album.overview, "overview")

    @spoken
    def gauges(self) -> Drawing:
        """All channels: measured, computed and predicted, with their profiles.

        Raises:
            MissingExtra: matplotlib is not installed.
            UsageError: nothing was read.
        """
        pictures = [p for p in self._album.readings if not p.name.startswith("signs")]
        return self._drawn(pictures, "figure of gauges")

    @spoken
    def parameters(self) -> Drawing:
        """Estimates against priors and bounds, and what else there is of parameters.

        Raises:
            MissingExtra: matplotlib is not installed.
            UsageError: there are no parameters.
        """
        return self._drawn(self._album.parameters, "figure of parameters")

    @spoken
    def field(
        self, stage: str | None = None, quantity: str = "displacement", *, section: int = 1
    ) -> Drawing:
        """A field after one stage.

        Args:
            stage: its name; the last fitted stage if None.
            quantity: such as ``displacement``; `quantities` has them.
            section: which of the sections of a solid.

        Raises:
            MissingExtra: matplotlib is not installed.
            UsageError: the result has no fields, or no such stage, quantity or section.
        """
        pictures = {_split(picture.name): picture for picture in self._of_stage(stage)}
        names = sorted({name for name, _ in pictures})
        if quantity not in names:
            _refuse("quantity", quantity, names)
        by_number = {number: p for (name, number), p in pictures.items() if name == quantity}
        if section not in by_number:
            _refuse("section", str(section), [str(number) for number in sorted(by_number)])
        return Drawing.of([by_number[section]])

    @spoken
    def quantities(self) -> tuple[str, ...]:
        """The quantities that `field` can draw; none where the result has no fields.

        Raises:
            MissingExtra: matplotlib is not installed.
        """
        if self._result.fields is None:
            return ()
        return tuple(dict.fromkeys(_split(p.name)[0] for p in self._of_stage(None)))

    @spoken
    def names(self) -> tuple[str, ...]:
        """The names of all figures of the report, in its order.

        Raises:
            MissingExtra: matplotlib is not installed.
        """
        return tuple(picture.name for picture in self._album.all)

    @spoken
    def named(self, name: str) -> Drawing:
        """A figure of the report by its name.

        Raises:
            MissingExtra: matplotlib is not installed.
            UsageError: there is no such figure.
        """
        matches = [picture for picture in self._album.all if picture.name == name]
        if not matches:
            _refuse("figure", name, [picture.name for picture in self._album.all])
        return Drawing.of(matches)

    @cached_property
    def _album(self) -> Album:
        needed("matplotlib", extra="report", what="a figure")
        from geoident.report.drawing.album import album

        return album(self._result)

    def _of_stage(self, stage: str | None) -> tuple[Picture, ...]:
        needed("matplotlib", extra="report", what="a figure")
        from geoident.report.drawing.album import stage_pictures

        gauges, fields = self._result.gauges, self._result.fields
        if fields is None:
            kind = self._result.kind
            of_fit = kind in ("scan", "backtest", "sample")
            why = "draw those of a fit" if of_fit else "it has no mesh of its own"
            msg = f"This {kind} holds no displacements and stresses: {why}."
            raise UsageError(msg)
        if stage is None:
            used = np.flatnonzero(gauges.used.any(axis=0))
            state = 1 + int(used.max()) if used.size else len(fields.displacement) - 1
        elif stage in gauges.stages:
            state = 1 + gauges.stages.index(stage)
        else:
            _refuse("stage", stage, gauges.stages)
        if state >= len(fields.displacement) or np.isnan(fields.displacement[state]).any():
            msg = f"The ground does not stand after {gauges.stages[state - 1]!r}: nothing to draw."
            raise UsageError(msg)
        return stage_pictures(self._result, state)

    def _drawn(self, pictures: Sequence[Picture], what: str) -> Drawing:
        if not pictures:
            msg = (
                f"A {self._result.kind} has no {what}; it has {', '.join(self.names()) or 'none'}."
            )
            raise UsageError(msg)
        return Drawing.of(pictures)

    def __repr__(self) -> str:
        return (
            "Plots: overview(), gauges(), parameters(), field(stage), "
            "and named(name) for all of names()"
        )


def _split(name: str) -> tuple[str, int]:
    """Quantity and section of the name of a picture.

    >>> _split("section-2-displacement"), _split("yielded")
    (('displacement', 2), ('yielded', 1))
    """
    match = _SECTION.match(name)
    return (name[match.end() :], int(match[1])) if match else (name, 1)


def _refuse(kind: str, name: str, names: Sequence[str]) -> NoReturn:
    """Raise `UsageError` for a name that is not there."""
    hint = did_you_mean(name, names, what=f"{kind.capitalize()}s")
    msg = f"There is no {kind} {name!r}.\n    {hint}"
    raise UsageError(msg)
