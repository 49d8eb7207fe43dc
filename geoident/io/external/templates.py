"""Templates: files with fields such as ``{{E_rock:10.3e}}``, in which values are written.

A field is ``{{NAME}}``, with a unit ``{{NAME [GPa]}}`` and a form ``{{NAME [GPa]:10.3f}}`` where
wanted. Without unit the value is in SI, without form it has all its digits. The width of a form
is the width of the field: a value that does not fit would shift the columns after it. A template of
PEST, which begins with ``ptf``, is read as well (`pest_templates`).
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping

from geoident.errors import Fault, Location
from geoident.io.external.pest_templates import pest_mark, pest_pieces
from geoident.io.text.text_file import decode, position, read_bytes
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.external import AnyTemplate, JinjaTemplate, Template, TemplateField
from geoident.model.parameter import Parameter
from geoident.units import UnitError, unit_size

MAX_BYTES = 200 * 10**6
_FIELD = re.compile(r"\{\{(.*?)\}\}", re.DOTALL)
_INSIDE = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\[([^\]]*)\]\s*)?(?::([^\n]*))?")
_FORM = re.compile(r"\s*([<>^=]?[+\- ]?0?([0-9]{0,3})(?:\.[0-9]{1,3})?[eEfFgG])\s*")


def read_template(
    source: str, target: str, parameters: Mapping[str, Parameter]
) -> tuple[Template, list[Fault]]:
    """A template, and what is wrong in it.

    Args:
        source: its path.
        target: name of the file that is made of it.
        parameters: of the case, by name.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    text = decode(read_bytes(source, limit=MAX_BYTES, what="template"), source)
    if pest_mark(text):
        pieces, faults = pest_pieces(text, source, parameters)
    else:
        pieces, faults = _pieces(text, source, parameters)
    if not faults and not any(isinstance(piece, TemplateField) for piece in pieces):
        message = "the template has no field, so no run differs from another by it"
        hint = "Write {{NAME}} where a parameter stands, or name the file under 'files'."
        faults.append(Fault("no-field", message, hint, Location(source)))
    return Template(source, target, tuple(piece for piece in pieces if piece != "")), faults


def _pieces(
    text: str, source: str, parameters: Mapping[str, Parameter]
) -> tuple[list[str | TemplateField], list[Fault]]:
    """Texts and fields in their order, and what is wrong."""
    pieces: list[str | TemplateField] = []
    faults: list[Fault] = []
    end = 0
    for match in _FIELD.finditer(text):
        place = Location(source, *position(text, match.start()))
        pieces.append(text[end : match.start()])
        try:
            field = _field(match[1], place, parameters)
            pieces.append(field)
            faults += _too_narrow(field, parameters[field.parameter])
        except Refusal as error:
            faults.append(Fault(error.code, error.message, error.hint, place))
            named = _INSIDE.fullmatch(match[1])
            if named and named[1] in parameters:  # so that nobody misses it
                pieces.append(TemplateField(named[1], location=place))
        end = match.end()
    pieces.append(text[end:])
    return pieces, faults


def _field(inside: str, place: Location, parameters: Mapping[str, Parameter]) -> TemplateField:
    """The field of what stands between its brackets.

    Raises:
        Refusal: it is none.
    """
    match = _INSIDE.fullmatch(inside)
    if match is None:
        hint = "Write {{NAME}}, {{NAME [GPa]}} or {{NAME [GPa]:10.3e}}."
        raise Refusal("bad-field", f"'{shorten(f'{{{{{inside}}}}}')}' is not a field", hint)
    name, unit, form = match[1], match[2], match[3] or ""
    parameter = parameters.get(name)
    if parameter is None:
        hint = did_you_mean(name, parameters, what="Parameters")
        raise Refusal("unknown-parameter", f"there is no parameter '{name}'", hint)
    try:
        size = 1.0 if unit is None else unit_size(unit, parameter.dimension, name)
    except UnitError as error:
        raise Refusal("unit", error.message, error.hint) from None
    known = _FORM.fullmatch(form)
    if form and known is None:
        hint = "Width, digits after the point and e, f or g: 10.3e, 12.6f, .17g."
        raise Refusal("bad-form", f"'{shorten(form)}' is not a form of a number", hint)
    return TemplateField(name, size, known[1] if known else "", place)


def _too_narrow(field: TemplateField, parameter: Parameter) -> Iterator[Fault]:
    """Why runs within the bounds could not be written, and that before the first one is made."""
    width, values = _width(field), (parameter.start, parameter.lower, parameter.upper)
    longest = max((field.written(value).strip() for value in values), key=len)
    if width and len(longest) > width:
        message = f"a field of {width} characters is too narrow for {field.parameter} within its "
        message += f"bounds: '{longest}' takes {len(longest)}"
        hint = "Widen it, as far as the program reads, or write fewer digits."
        yield Fault("narrow-field", message, hint, field.location)


def _width(field: TemplateField) -> int:
    """Characters of a field; 0 for as many as it takes."""
    known = _FORM.fullmatch(field.form)
    return int(known[2] or 0) if known else 0


class CannotBeFilled(ValueError):
    """A template cannot be filled with these values."""


class FieldTooNarrow(CannotBeFilled):
    """A value does not fit into its field."""


def field_texts(template: AnyTemplate, values: Mapping[str, float]) -> list[str]:
    """What is written in each field of a template, in their order; of one in Jinja all of it.

    Args:
        template: the template.
        values: parameters by name, SI.

    Raises:
        CannotBeFilled: a value is wider than its field, or Jinja cannot compute what it says.
    """
    if isinstance(template, JinjaTemplate):
        return [_rendered(template, values)]
    texts = []
    for field in template.fields:
        text = field.written(values[field.parameter])
        width = _width(field)
        if width and len(text) > width:
            where = f"{field.location}: "
            message = f"{where}'{text.strip()}' of {field.parameter} takes {len(text)} characters, "
            raise FieldTooNarrow(f"{message}its field has {width}")
        texts.append(text)
    return texts


def _rendered(template: JinjaTemplate, values: Mapping[str, float]) -> str:
    from geoident.io.external import jinja_templates  # noqa: PLC0415 - an optional library

    try:
        return jinja_templates.rendered(template, values)
    except jinja_templates.CannotRender as error:
        raise CannotBeFilled(str(error)) from error


def last_digit(template: JinjaTemplate, values: Mapping[str, float], name: str) -> float:
    """The smallest change of a parameter that a template in Jinja shows; 0 where none does.

    Args:
        template: the template.
        values: parameters by name, SI.
        name: of the parameter.
    """
    from geoident.io.external import jinja_templates  # noqa: PLC0415 - an optional library

    try:
        return jinja_templates.smallest_change(template, values, name)
    except jinja_templates.CannotRender:
        return 0.0


def key_texts(template: AnyTemplate, texts: list[str]) -> list[str]:
    """What tells a file that was filled from others: its fields; of one in Jinja a checksum.

    Args:
        template: the template.
        texts: of its fields, in their order.
    """
    if isinstance(template, JinjaTemplate):
        return [hashlib.sha256(texts[0].encode()).hexdigest()]
    return [text.strip() for text in texts]


def filled(template: AnyTemplate, texts: list[str]) -> str:
    """The text of a template with its fields filled.

    Args:
        template: the template.
        texts: of its fields, in their order.
    """
    if isinstance(template, JinjaTemplate):
        return texts[0]
    left = iter(texts)
    return "".join(
        next(left) if isinstance(piece, TemplateField) else piece for piece in template.pieces
    )
