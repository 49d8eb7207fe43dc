"""Templates of PEST: a first line ``ptf ~``, then fields such as ``~   e_rock   ~``.

A field is as wide as it stands there, with its marks, and is filled with as many digits as fit.
The number is in the unit in which the case gives the start of the parameter, as PARVAL1 of a
control file is. Small letters and capitals of names are the same, as in PEST.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from geoident.errors import Fault, Location
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.external import TemplateField
from geoident.model.parameter import Parameter
from geoident.units import size_in

_HEAD = re.compile(r"ptf[ \t]+(\S)[ \t]*\r?\n", re.IGNORECASE)
_ALL_DIGITS = 16


def pest_mark(text: str) -> str:
    r"""The mark around the fields of a template of PEST; empty for another text.

    >>> pest_mark("ptf ~\nE ~  e  ~\n"), pest_mark("E {{E}}\n")
    ('~', '')
    """
    head = _HEAD.match(text)
    return head[1] if head else ""


def pest_pieces(
    text: str, source: str, parameters: Mapping[str, Parameter]
) -> tuple[list[str | TemplateField], list[Fault]]:
    """Texts and fields of a template of PEST without its first line, and what is wrong in it.

    Args:
        text: that has a `pest_mark`.
        source: path of the template.
        parameters: of the case, by name.
    """
    mark = pest_mark(text)
    known: dict[str, list[Parameter]] = {}
    for parameter in parameters.values():
        known.setdefault(parameter.name.lower(), []).append(parameter)
    pieces, faults = list[str | TemplateField](), list[Fault]()
    for number, line in enumerate(text.splitlines(keepends=True)[1:], 2):
        parts = line.split(mark)
        if len(parts) % 2 == 0:
            place = Location(source, number, line.rfind(mark) + 1)
            message = f"the field that begins here has no second '{mark}' on its line"
            faults.append(Fault("bad-field", message, f"Write {mark}  NAME  {mark}.", place))
            continue
        column = 1
        for before, inside in zip(parts[::2], [*parts[1::2], None], strict=True):
            pieces.append(before)
            column += len(before)
            if inside is None:
                break
            place = Location(source, number, column)
            column += len(inside) + 2
            try:
                pieces.append(_field(inside, place, known))
            except Refusal as error:
                faults.append(Fault(error.code, error.message, error.hint, place))
    return pieces, faults


def _field(inside: str, place: Location, known: Mapping[str, list[Parameter]]) -> TemplateField:
    name, width = inside.strip(), len(inside) + 2
    meant = known.get(name.lower(), [])
    if not meant:
        hint = did_you_mean(name, [p.name for each in known.values() for p in each])
        raise Refusal("unknown-parameter", f"there is no parameter '{shorten(name)}'", hint)
    exact = [parameter for parameter in meant if parameter.name == name]
    if len(meant) > 1 and not exact:
        names = " and ".join(parameter.name for parameter in meant)
        raise Refusal("unknown-parameter", f"'{name}' may be {names}", "Write it as in the case.")
    parameter = (exact or meant)[0]
    size = size_in(parameter.unit, parameter.dimension) or 1.0
    form = _form(width, parameter.start / size, parameter.lower / size, parameter.upper / size)
    if not form:
        message = f"a field of {width} characters is too narrow for {parameter.name} within its "
        message += f"bounds, up to {max(abs(parameter.lower), abs(parameter.upper)) / size:.6g}"
        raise Refusal("narrow-field", message, "Widen it, as far as the program reads.")
    return TemplateField(parameter.name, size, form, place)


def _form(width: int, start: float, lower: float, upper: float) -> str:
    """The form that fills a width with the most digits of a number; empty if it is too narrow.

    Args:
        width: characters.
        start: a usual number.
        lower: the least number.
        upper: the largest one.

    >>> _form(14, 15.0, 1.0, 100.0), _form(14, 1e-9, 0.0, 1.0), _form(6, 1.0, 0.1, 3.0)
    ('14.10f', '14.7e', '6.4f')
    >>> _form(4, 1e5, 1e4, 1e6)
    ''
    """
    sign = 1 if lower < 0.0 else 0
    places = min(_ALL_DIGITS, width - 1 - sign - len(str(int(max(abs(lower), abs(upper))))))
    digits = min(_ALL_DIGITS, width - 7 - sign)  # one before the point, and e+00
    fixed = 10.0**-places if places >= 0 else math.inf
    scaled = abs(start) * 10.0**-digits if digits >= 1 else math.inf
    if fixed == scaled == math.inf:
        return ""
    return f"{width}.{places}f" if fixed <= scaled else f"{width}.{digits}e"
