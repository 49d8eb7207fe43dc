"""Templates in Jinja: `{{ E_rock | to("GPa") }}`, loops and conditions, by the library jinja2.

A template may come from anywhere, so it is filled in a sandbox, in which it reaches nothing but the
parameters; names that are none are errors, and there is no other file to include. Products and
powers stay of a size that a template needs, but a sandbox does not hold up loops in loops, nor a
width of a billion characters: a template is filled, and compiled, which computes constants, only
for who trusts the case. Before, its syntax and names are looked at.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sized
from traceback import walk_tb
from typing import Any

from jinja2 import StrictUndefined, TemplateRuntimeError, TemplateSyntaxError, nodes
from jinja2.sandbox import ImmutableSandboxedEnvironment

from geoident.errors import Fault, Location
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean
from geoident.model.external import JinjaTemplate, TemplateField
from geoident.model.parameter import Parameter
from geoident.units import UNITS, UnitError, normal_unit, unit_size

_TO = "to"
"""The filter that gives a parameter in a unit."""

_COARSEST, _FINEST = -1, -15
"""Exponents of ten of the changes of a parameter that are tried."""

_LONGEST, _LONGEST_NUMBER = 10**6, 10**4
"""Characters of a text that is repeated, and bits of a whole number, at most."""


def _to(value: float, unit: str) -> float:
    return value / UNITS[normal_unit(unit)][1]


class _Sandbox(ImmutableSandboxedEnvironment):
    """Products and powers that fill the memory are errors."""

    intercepted_binops = frozenset(["*", "**"])

    def call_binop(self, context: Any, operator: str, left: Any, right: Any) -> Any:
        """A product or a power.

        Raises:
            TemplateRuntimeError: it is larger than any that a template needs.
        """
        sizes = [len(one) for one in (left, right) if isinstance(one, Sized)]
        counts = [one for one in (left, right) if isinstance(one, int)]
        if sizes and counts and sizes[0] * counts[0] > _LONGEST:
            raise TemplateRuntimeError(f"a text or list of more than {_LONGEST} parts")
        if len(counts) == 2:
            bits, other = abs(counts[0]).bit_length(), abs(counts[1])
            if (bits * other if operator == "**" else bits + other.bit_length()) > _LONGEST_NUMBER:
                raise TemplateRuntimeError(f"a whole number of more than {_LONGEST_NUMBER} bits")
        return super().call_binop(context, operator, left, right)


def _environment() -> _Sandbox:
    environment = _Sandbox(undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False)
    environment.filters[_TO] = _to
    return environment


def read_jinja(
    source: str, target: str, parameters: Mapping[str, Parameter], *, limit: int
) -> tuple[JinjaTemplate, list[Fault]]:
    """A template in Jinja, and what is wrong in it.

    Args:
        source: its path.
        target: name of the file that is made of it.
        parameters: of the case, by name.
        limit: of its size, bytes.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    text = decode(read_bytes(source, limit=limit, what="template"), source)
    environment, lines = _environment(), text.splitlines()
    try:
        tree = environment.parse(text)
        faults = [
            *_faults(tree, source, lines, parameters),
            *_unknown(tree, source, lines, environment),
        ]
        fields = {
            node.name: TemplateField(node.name, location=_place(source, lines, node, node.name))
            for node in tree.find_all(nodes.Name)
            if node.name in parameters
        }
    except TemplateSyntaxError as error:
        place = Location(source, error.lineno, 1)
        hint = "Write {{ NAME }}; {% ... %} is a statement of Jinja."
        fault = Fault("bad-template", f"this is not Jinja: {error.message}", hint, place)
        return JinjaTemplate(source, target, text, ()), [fault]
    except RecursionError:
        message = "an expression of the template is too long, or too deep in brackets"
        fault = Fault("bad-template", message, "Write it in parts.", Location(source))
        return JinjaTemplate(source, target, text, ()), [fault]
    if not faults and not fields:
        message = "the template has no field, so no run differs from another by it"
        hint = "Write {{ NAME }} where a parameter stands, or name the file under 'files'."
        faults.append(Fault("no-field", message, hint, Location(source)))
    return JinjaTemplate(source, target, text, tuple(fields.values())), faults


def _faults(
    tree: nodes.Template, source: str, lines: list[str], parameters: Mapping[str, Parameter]
) -> Iterator[Fault]:
    own = {node.name for node in tree.find_all(nodes.Name) if node.ctx != "load"}
    own |= {"range", "loop", "namespace", "dict", "true", "false", "none"}
    own |= {node.name for node in tree.find_all(nodes.Macro)}
    seen = set[str]()
    for node in tree.find_all(nodes.Name):
        if node.name in own or node.name in parameters or node.name in seen:
            continue
        seen.add(node.name)
        hint = did_you_mean(node.name, parameters, what="Parameters")
        place = _place(source, lines, node, node.name)
        yield Fault("unknown-parameter", f"there is no parameter '{node.name}'", hint, place)
    for other in tree.find_all((nodes.Include, nodes.Import, nodes.FromImport, nodes.Extends)):
        message = "a template cannot take in another file"
        hint = "Write what stands there into this template."
        yield Fault("bad-template", message, hint, Location(source, other.lineno, 1))
    for call in tree.find_all(nodes.Filter):
        if call.name == _TO:
            yield from _unit_faults(call, source, lines, parameters)


def _unknown(
    tree: nodes.Template, source: str, lines: list[str], environment: ImmutableSandboxedEnvironment
) -> Iterator[Fault]:
    """Filters and tests that there are none of."""
    for kind, what, known in (
        (nodes.Filter, "filter", environment.filters),
        (nodes.Test, "test", environment.tests),
    ):
        for node in tree.find_all(kind):
            if node.name not in known:
                place = _place(source, lines, node, node.name)
                hint = did_you_mean(node.name, known, what=f"{what.capitalize()}s")
                yield Fault("bad-template", f"Jinja has no {what} '{node.name}'", hint, place)


def _unit_faults(
    call: nodes.Filter, source: str, lines: list[str], parameters: Mapping[str, Parameter]
) -> Iterator[Fault]:
    """What is wrong with a unit, which stands there as a text."""
    given = call.args[0] if len(call.args) == 1 and not call.kwargs else None
    if not isinstance(given, nodes.Const) or not isinstance(given.value, str):
        message = "the unit is not a text"
        hint = 'Write {{ NAME | to("GPa") }}.'
        yield Fault("unit", message, hint, Location(source, call.lineno, 1))
        return
    place = _place(source, lines, call, given.value)
    parameter = parameters.get(call.node.name) if isinstance(call.node, nodes.Name) else None
    try:
        if parameter is None:
            normal_unit(given.value)
        else:
            unit_size(given.value, parameter.dimension, parameter.name)
    except UnitError as error:
        yield Fault("unit", error.message, error.hint, place)


def _place(source: str, lines: list[str], node: nodes.Node, word: str) -> Location:
    """Where a word stands from the line of a node on."""
    for number in range(node.lineno, min(node.lineno + 20, len(lines)) + 1):
        at = lines[number - 1].find(word)
        if at >= 0:
            return Location(source, number, at + 1)
    return Location(source, node.lineno, 1)


class CannotRender(ValueError):
    """A template cannot be filled with these values."""


def rendered(template: JinjaTemplate, values: Mapping[str, float]) -> str:
    """The text of a template with its fields filled.

    Args:
        template: the template.
        values: parameters by name, SI.

    Raises:
        CannotRender: what it computes cannot be computed, or is not finite where it must be.
    """
    known = {field.parameter: values[field.parameter] for field in template.fields}
    try:
        return _environment().from_string(template.text).render(known)
    except Exception as error:  # whatever it is, the template has asked for it
        lines = [line for frame, line in walk_tb(error.__traceback__)
                 if "__jinja_exception__" in frame.f_globals]  # fmt: skip
        line = lines[-1] if lines else getattr(error, "lineno", 0) or 0
        place = Location(template.source, line, 1)
        raise CannotRender(f"{place}: {str(error) or type(error).__name__}") from error


def smallest_change(template: JinjaTemplate, values: Mapping[str, float], name: str) -> float:
    """The smallest change of a parameter that changes what is written, to a power of ten.

    0 where none does.

    Args:
        template: the template.
        values: parameters by name, SI.
        name: of the parameter.
    """
    if name not in {field.parameter for field in template.fields}:
        return 0.0
    before, size = rendered(template, values), abs(values[name]) or 1.0

    def is_seen(exponent: int) -> bool:
        moved = {**values, name: values[name] + size * 10.0**exponent}
        return rendered(template, moved) != before

    fine, coarse = _FINEST, _COARSEST
    if not is_seen(coarse):
        return 0.0
    while fine < coarse:
        middle = (fine + coarse) // 2
        fine, coarse = (fine, middle) if is_seen(middle) else (middle + 1, coarse)
    return size * 10.0**coarse
