"""A logo in a page: a picture that brings no scripts and no addresses."""

from __future__ import annotations

import base64
import io
import re
from xml.etree import ElementTree

from PIL import Image, UnidentifiedImageError

from geoident.errors import Fault, InputError, Location
from geoident.report.page.html import Html, tag

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_SIZE = (780, 270)  # pixels of a PNG at most: three times what the page shows
_SHAPES = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "text", "tspan"}
_GROUPS = {"svg", "g", "defs", "symbol", "use", "title", "desc", "style", "marker", "textPath"}
_PAINTS = {"linearGradient", "radialGradient", "stop", "clipPath", "mask", "pattern"}
_ELEMENTS = _SHAPES | _GROUPS | _PAINTS
_ADDRESS = re.compile(r"url\(\s*['\"]?(?!#)|@import|javascript:|expression\(|\\", re.IGNORECASE)


def logo_element(content: bytes, path: str) -> Html:
    """A logo as an image of the page.

    Args:
        content: of its file, PNG or SVG.
        path: of the file, for messages.

    Raises:
        InputError: it is neither, or cannot be read.
    """
    if content.startswith(b"\x89PNG"):
        kind, data = "png", _small_png(content, path)
    else:
        kind, data = "svg+xml", _clean_svg(content, path)
    text = base64.b64encode(data).decode("ascii")
    return tag("img", src=f"data:image/{kind};base64,{text}", alt="Logo")


def _refused(path: str, message: str, hint: str) -> InputError:
    return InputError([Fault("bad-logo", message, hint, Location(path))])


def _small_png(content: bytes, path: str) -> bytes:
    """The picture alone, without what else was in the file, no larger than it is shown."""
    try:
        with Image.open(io.BytesIO(content), formats=["PNG"]) as picture:
            small = picture.convert("RGBA")
    except (UnidentifiedImageError, OSError, SyntaxError, Image.DecompressionBombError) as error:
        message = f"the logo cannot be read: {error}"
        raise _refused(path, message, "Save it again as PNG.") from error
    small.thumbnail(_SIZE)
    buffer = io.BytesIO()
    small.save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def _clean_svg(content: bytes, path: str) -> bytes:
    """The drawing alone: known elements, no handlers, no addresses but those of its own parts."""
    hint = "Give a .png, or an .svg saved as 'plain SVG'."
    if b"<!ENTITY" in content:
        raise _refused(path, "the logo defines entities", hint)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise _refused(path, f"the logo is neither PNG nor SVG: {error}", hint) from error
    if root.tag != f"{{{_SVG}}}svg":
        raise _refused(path, "the logo is XML, but not SVG", hint)
    _strip(root)
    cleaned: bytes = ElementTree.tostring(root, encoding="utf-8")
    return cleaned


def _strip(element: ElementTree.Element) -> None:
    for key in [key for key, value in element.attrib.items() if not _allowed(key, value)]:
        del element.attrib[key]
    for child in list(element):
        uri, _, name = str(child.tag).rpartition("}")
        harmless = uri == f"{{{_SVG}" and name in _ELEMENTS
        if not harmless or (name == "style" and _ADDRESS.search("".join(child.itertext()))):
            element.remove(child)
        else:
            _strip(child)


def _allowed(key: str, value: str) -> bool:
    """Whether an attribute stays: no handlers, no foreign ones, no addresses of other files."""
    uri, _, name = key.rpartition("}")
    if name == "href":
        return uri in ("", f"{{{_XLINK}") and value.startswith("#")
    return not uri and not name.lower().startswith("on") and not _ADDRESS.search(value)
