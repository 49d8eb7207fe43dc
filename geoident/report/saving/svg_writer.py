"""An SVG of a figure in the form that files and pages need, written in one go.

matplotlib's own writer makes a document that would have to be read, changed and written twice more:
for words of a stated length, and for a page that takes no styles and no names of another figure.
This one writes attributes instead of styles, short numbers, lengths of words, names in their order,
and images with a palette; lines of one look that follow each other are one element. The same figure
gives the same bytes.
"""

from __future__ import annotations

import base64
import io
import re
from functools import lru_cache
from html import escape
from typing import Any

import numpy as np
from matplotlib import _path
from matplotlib.backend_bases import FigureCanvasBase, RendererBase
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.colors import rgb2hex
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font, weight_dict
from matplotlib.transforms import Affine2D, Transform
from PIL import Image

from geoident.report.saving.words import FONTS, HALO, length_of, size_of

LINK = "xlink:href"
"""The attribute that refers to another element, as old readers of SVG want it."""

_POINTS = 72  # to the inch, the unit of an SVG
_DIGITS = 2  # behind the point: a hundredth of a point
_COMMANDS = [b"M", b"L", b"Q", b"C", b"z"]
_STROKE = ' stroke="#ffffff" stroke-width="2" stroke-linejoin="round" paint-order="stroke"'
_SPACES = re.compile(r"^ +| +$|(?<= ) +")
_CAPS = {"projecting": "square", "butt": "butt", "round": "round"}
_COLOURS = 256  # of a palette
_PACKED = 6  # how hard to press an image
_SAMPLE = 5000  # runs of pixels by which a picture of many colours is known


class SvgRenderer(RendererBase):
    """What matplotlib draws with: elements of an SVG.

    Args:
        width: of the figure, points.
        height: of the figure, points.
        image_dpi: pixels to the inch of what is drawn as pixels.
    """

    def __init__(self, width: float, height: float, image_dpi: float) -> None:
        super().__init__()
        self.width, self.height = width, height
        self._image_dpi = image_dpi
        self._elements: list[str] = []
        self._definitions: list[str] = []
        self._names: dict[Any, str] = {}
        self._halo = False
        self._flip = Affine2D().scale(1.0, -1.0).translate(0.0, height)
        self._open: tuple[str, list[str]] | None = None

    def document(self, title: str, description: str) -> bytes:
        """The whole SVG.

        Args:
            title: what it shows.
            description: what has to be known to read it.
        """
        self._close_lines()
        said = [
            f"<{n}>{escape(t)}</{n}>" for n, t in (("title", title), ("desc", description)) if t
        ]
        size = f"{_short(self.width)}", f"{_short(self.height)}"
        head = (
            '<?xml version="1.0" encoding="utf-8"?>\n'
            '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
            f'width="{size[0]}pt" height="{size[1]}pt" viewBox="0 0 {size[0]} {size[1]}" '
            f'version="1.1" font-family="{escape(FONTS)}" stroke-linejoin="round">'
        )
        defined = ["<defs>", *self._definitions, "</defs>"] if self._definitions else []
        return "".join([head, *said, *defined, *self._elements, "</svg>\n"]).encode()

    def draw_path(self, gc: Any, path: Any, transform: Transform, rgbFace: Any = None) -> None:
        """Write a line or an area.

        Args:
            gc: look of the line.
            path: its points.
            transform: of the points to points of the page.
            rgbFace: colour within; None for a line.
        """
        look = _look(gc, rgbFace)
        if not look:
            return
        line = rgbFace is None
        clip = (0.0, 0.0, self.width, self.height) if line else None
        data = self._data(path, transform, clip, simplify=line and path.should_simplify)
        if not data:
            return
        look += self._clip(gc)
        if line and "opacity" not in look:
            self._add_line(look, data)
        else:
            self._add(f'<path d="{data}"{look}/>')

    def draw_markers(
        self,
        gc: Any,
        marker_path: Any,
        marker_trans: Transform,
        path: Any,
        trans: Transform,
        rgbFace: Any = None,
    ) -> None:
        """Write one marker, and where else it is used.

        Args:
            gc: look of its line.
            marker_path: the marker.
            marker_trans: of the marker to points.
            path: where it stands.
            trans: of these places to points of the page.
            rgbFace: colour within.
        """
        look = _look(gc, rgbFace)
        if not look or not len(path.vertices):
            return
        data = self._data(marker_path, marker_trans + Affine2D().scale(1, -1), None, flip=False)
        name = self._define((data, look), f'<path d="{data}"{look}/>')
        flipped = trans + self._flip
        size = self._image_dpi, self.width + self._image_dpi, self.height + self._image_dpi
        uses = [
            f'<use {LINK}="#{name}" x="{_short(vertices[-2])}" y="{_short(vertices[-1])}"/>'
            for vertices, _ in path.iter_segments(flipped, simplify=False)
            if len(vertices)
            and -size[0] < vertices[-2] < size[1]
            and -size[0] < vertices[-1] < size[2]
        ]
        clip = self._clip(gc)
        self._add("".join([f"<g{clip}>", *uses, "</g>"] if clip else uses))

    def draw_image(self, gc: Any, x: float, y: float, im: Any, transform: Any = None) -> None:
        """Write pixels.

        Args:
            gc: opacity and clip.
            x: of the left lower corner, points.
            y: of the left lower corner, points.
            im: (rows, columns, 4) pixels, the lowest row first.
            transform: of the unit square to the page; None for pixels of the image's own size.
        """
        rows, columns = im.shape[:2]
        if not rows or not columns:
            return
        look = ""
        if transform is None:
            width, height = (_POINTS * n / self._image_dpi for n in (columns, rows))
            (x0, y0), (x1, y1) = (x, y), (x + width, y + height)
        else:
            (x0, y0), (x1, y1) = transform.transform([(0.0, 0.0), (1.0, 1.0)]) + np.array([x, y])
            look = ' preserveAspectRatio="none" image-rendering="pixelated"'
            look += f' opacity="{_short(gc.get_alpha())}"' if gc.get_alpha() != 1.0 else ""
        pixels = im[:: -1 if y1 > y0 else 1, :: 1 if x1 > x0 else -1]
        place = (
            f'x="{_short(min(x0, x1))}" y="{_short(self.height - max(y0, y1))}" '
            f'width="{_short(abs(x1 - x0))}" height="{_short(abs(y1 - y0))}"'
        )
        picture = f'<image {LINK}="{_png(pixels)}" {place}{look}/>'
        clip = self._clip(gc)
        self._add(f"<g{clip}>{picture}</g>" if clip else picture)

    def draw_text(
        self,
        gc: Any,
        x: float,
        y: float,
        s: str,
        prop: Any,
        angle: float,
        ismath: Any = False,
        mtext: Any = None,
    ) -> None:
        """Write words, as long as they were laid out.

        Args:
            gc: colour and opacity.
            x: where they begin, points.
            y: of their base line, points, down.
            s: the words.
            prop: their font.
            angle: by which they are turned, degrees, counterclockwise.
            ismath: not used; formulas are plain text here.
            mtext: not used; the text as an artist.
        """
        size, weight = prop.get_size_in_points(), _weight(prop)
        place = f'x="{_short(x)}" y="{_short(y)}"'
        look = f' font-size="{_short(size)}"'
        look += f' font-weight="{weight}"' if weight != 400 else ""
        look += ' font-style="italic"' if prop.get_style() != "normal" else ""
        colour = gc.get_rgb()
        look += f' fill="{_hex(tuple(colour[:3]))}"' if tuple(colour[:3]) != (0, 0, 0) else ""
        alpha = gc.get_alpha() if gc.get_forced_alpha() else colour[3]
        look += f' opacity="{_short(alpha)}"' if alpha != 1 else ""
        look += f' transform="rotate({_short(-angle)} {_short(x)} {_short(y)})"' if angle else ""
        look += _STROKE if self._halo else ""
        if s.strip():
            length = _short(length_of(s, size, weight))
            look += f' textLength="{length}" lengthAdjust="spacingAndGlyphs"'
        words = _SPACES.sub(lambda found: "\u00a0" * len(found[0]), s)
        self._add(f"<text {place}{look}>{escape(words)}</text>")

    def open_group(self, s: str, gid: str | None = None) -> None:
        """Note which words have an outline; groups themselves are not written."""
        if gid is not None and gid.startswith(HALO):
            self._halo = True

    def close_group(self, s: str) -> None:
        """The words that had an outline end here."""
        if s == "text":
            self._halo = False

    def option_scale_image(self) -> bool:
        """Readers of an SVG scale its images."""
        return True

    def option_image_nocomposite(self) -> bool:
        """Images stay apart."""
        return True

    def flipy(self) -> bool:
        """Down is positive."""
        return True

    def get_canvas_width_height(self) -> tuple[float, float]:
        """Width and height, points."""
        return self.width, self.height

    def get_image_magnification(self) -> float:
        """Pixels to the point."""
        return self._image_dpi / _POINTS

    def get_text_width_height_descent(
        self, s: str, prop: Any, ismath: Any
    ) -> tuple[float, float, float]:
        """Of words in their font, points; measured once for all figures.

        Args:
            s: the words.
            prop: their font.
            ismath: not used; formulas are plain text here.
        """
        return size_of(s, prop.get_size_in_points(), _weight(prop))

    def _get_font_height_metrics(self, prop: Any) -> tuple[float, float, float]:
        """Ascent, descent and gap of a font, points; newer matplotlib asks for each word."""
        size = prop.get_size_in_points()
        ascent, descent, gap = _heights(_weight(prop))
        return ascent * size, descent * size, gap * size

    def _data(
        self,
        path: Any,
        transform: Transform,
        clip: tuple[float, float, float, float] | None,
        *,
        simplify: bool = False,
        flip: bool = True,
    ) -> str:
        """What a path is in an SVG."""
        whole = transform + self._flip if flip else transform
        written: Any = _path
        text = written.convert_to_string(
            path, whole, clip, simplify, None, _DIGITS, _COMMANDS, False
        )
        return " ".join(text.decode("ascii").split())

    def _clip(self, gc: Any) -> str:
        """The attribute that cuts what lies outside of some axes."""
        path, transform = gc.get_clip_path()
        if path is not None:
            data = self._data(path, transform, None)
            name = self._define(("clip", data), f'<clipPath><path d="{data}"/></clipPath>')
            return f' clip-path="url(#{name})"'
        rectangle = gc.get_clip_rectangle()
        if rectangle is None:
            return ""
        x, y, width, height = rectangle.bounds
        shape = (
            f'<rect x="{_short(x)}" y="{_short(self.height - y - height)}" '
            f'width="{_short(width)}" height="{_short(height)}"/>'
        )
        return f' clip-path="url(#{self._define(shape, f"<clipPath>{shape}</clipPath>")})"'

    def _define(self, key: Any, element: str) -> str:
        """The name of something that is used more than once, defined when first asked for."""
        if key not in self._names:
            name = f"r{len(self._names)}"
            self._names[key] = name
            start, _, rest = element.partition(">")
            ended = start.endswith("/")
            self._definitions.append(f'{start.removesuffix("/")} id="{name}"{"/" * ended}>{rest}')
        return self._names[key]

    def _add_line(self, look: str, data: str) -> None:
        """Add a line to those of the same look before it."""
        if self._open is not None and self._open[0] == look:
            self._open[1].append(data)
            return
        self._close_lines()
        self._open = look, [data]

    def _close_lines(self) -> None:
        if self._open is not None:
            look, data = self._open
            self._elements.append(f'<path d="{" ".join(data)}"{look}/>')
            self._open = None

    def _add(self, element: str) -> None:
        self._close_lines()
        self._elements.append(element)


class SvgCanvas(FigureCanvasBase):
    """A figure that is going to be an SVG: layouts measure with the renderer that writes it."""

    def __init__(self, figure: Figure, image_dpi: float) -> None:
        super().__init__(figure)
        self._image_dpi = image_dpi

    @classmethod
    def get_default_filetype(cls) -> str:
        """The one kind of file that it makes."""
        return "svg"

    def print_svg(self, file: Any, **_: Any) -> None:
        """Write the SVG of the figure into an open file; matplotlib asks so for a renderer."""
        file.write(self.written("", ""))

    def get_renderer(self) -> SvgRenderer:
        """A renderer that measures."""
        width, height = self.figure.get_size_inches() * _POINTS
        return SvgRenderer(float(width), float(height), self._image_dpi)

    def written(self, title: str, description: str) -> bytes:
        """The SVG of the figure.

        Args:
            title: what it shows.
            description: what has to be known to read it.
        """
        renderer = self.get_renderer()
        width, height = self.figure.get_size_inches()
        self.figure.dpi = _POINTS
        mixed_renderer: Any = MixedModeRenderer
        mixed = mixed_renderer(self.figure, width, height, self._image_dpi, renderer)
        self.figure.draw(mixed)
        return renderer.document(title, description)


def _look(gc: Any, face: Any) -> str:
    """Attributes of a line or an area; empty where nothing would be seen."""
    forced = gc.get_forced_alpha()
    alpha = gc.get_alpha() if forced else None
    dashes = gc.get_dashes()
    return _attributes(
        None if face is None else tuple(float(c) for c in face),
        tuple(float(c) for c in gc.get_rgb()),
        float(gc.get_linewidth()),
        alpha,
        gc.get_joinstyle(),
        gc.get_capstyle(),
        (dashes[0], None if dashes[1] is None else tuple(dashes[1])),
    )


@lru_cache(maxsize=4096)
def _attributes(
    face: tuple[float, ...] | None,
    line: tuple[float, ...],
    width: float,
    alpha: float | None,
    join: str,
    cap: str,
    dashes: tuple[float | None, tuple[float, ...] | None],
) -> str:
    filled = face is not None and (alpha if alpha is not None else (*face, 1.0)[3]) > 0
    stroked = width > 0 and (alpha if alpha is not None else line[3]) > 0
    if not filled and not stroked:
        return ""
    found = ' fill="none"'
    if filled and face is not None:
        found = f' fill="{_hex(face[:3])}"' if face[:3] != (0, 0, 0) else ""
        if alpha is None and len(face) == 4 and face[3] != 1.0:
            found += f' fill-opacity="{_short(face[3])}"'
    if alpha is not None and alpha != 1.0:
        found += f' opacity="{_short(alpha)}"'
    if not stroked:
        return found or ' fill="#000000"'
    found += f' stroke="{_hex(line[:3])}"'
    if alpha is None and line[3] != 1.0:
        found += f' stroke-opacity="{_short(line[3])}"'
    found += f' stroke-width="{_short(width)}"' if width != 1.0 else ""
    found += f' stroke-linejoin="{join}"' if join != "round" else ""
    found += f' stroke-linecap="{_CAPS[cap]}"' if cap != "butt" else ""
    if dashes[1] is not None:
        found += f' stroke-dasharray="{",".join(map(_short, dashes[1]))}"'
        found += f' stroke-dashoffset="{_short(dashes[0])}"' if dashes[0] else ""
    return found


@lru_cache(maxsize=512)
def _hex(colour: tuple[float, ...]) -> str:
    red, green, blue = colour
    return rgb2hex((red, green, blue))


@lru_cache(maxsize=16)
def _heights(weight: int) -> tuple[float, float, float]:
    """Ascent, descent and gap of a font, in parts of its size."""
    font: Any = get_font(findfont(f"DejaVu Sans:weight={weight}"))
    table, units = font.get_sfnt_table("OS/2"), font.get_sfnt_table("head")["unitsPerEm"]
    parts = table["sTypoAscender"], -table["sTypoDescender"], table["sTypoLineGap"]
    ascent, descent, gap = (float(part) / units for part in parts)
    return ascent, descent, gap


def _weight(prop: Any) -> int:
    weight = prop.get_weight()
    return int(weight_dict.get(weight, weight))


def _short(value: Any) -> str:
    """A number with two digits behind the point, without those that say nothing.

    >>> _short(12.0), _short(0.126), _short(-0.001)
    ('12', '0.13', '0')
    """
    text = f"{value:.{_DIGITS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _png(pixels: Any) -> str:
    """The address of an image (rows, columns, 4) with a palette, the highest row first."""
    whole = np.ascontiguousarray(pixels)
    few = _palette(whole)
    if few is None:
        few = Image.fromarray(whole).quantize(_COLOURS, method=Image.Quantize.FASTOCTREE)
    buffer = io.BytesIO()
    few.save(buffer, format="png", compress_level=_PACKED)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def _palette(pixels: Any) -> Image.Image | None:
    """An image of few colours with exactly these as its palette; None where it has more.

    Colours are told apart run by run: most pixels look like the one before them.
    """
    codes = pixels.view(np.uint32).ravel()
    starts = np.flatnonzero(np.r_[True, codes[1:] != codes[:-1]])
    runs = codes[starts]
    if len(np.unique(runs[:_SAMPLE])) > _COLOURS:
        return None
    colours, number = np.unique(runs, return_inverse=True)
    if len(colours) > _COLOURS:
        return None
    index = np.repeat(number.astype(np.uint8), np.diff(starts, append=len(codes)))
    few = Image.frombytes("P", pixels.shape[1::-1], index.tobytes())
    few.putpalette(colours.view(np.uint8).tobytes(), rawmode="RGBA")
    return few
