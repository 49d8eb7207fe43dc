"""Templates in Jinja: what they say, what is wrong in them, and what they cannot do."""

import sys

import numpy as np
import pytest
from support.external import EXTERNAL, trusted, write_case

from geoident.errors import InputError
from geoident.io.case.file import parse_case, read_case
from geoident.io.external.jinja_templates import CannotRender, read_jinja, rendered, smallest_change
from geoident.model.parameter import Parameter
from geoident.workflow.running.jobs import build_model, load_inputs

PARAMETERS = {
    "E": Parameter("E", 6e9, 1e9, 5e10, dimension="pressure", unit="GPa"),
    "K0": Parameter("K0", 1.0, 0.3, 3.0),
}
VALUES = {"E": 6.25e9, "K0": 0.8}
IN_JINJA = EXTERNAL.replace(
    "{opening.in: opening.template}", "{opening.in: {template: opening.template, engine: jinja}}"
)
DECK = """\
{# what the program reads #}
{{ E | to("GPa") }}
{{ K0 }}
"""


def read(tmp_path, text):
    source = tmp_path / "deck.j2"
    source.write_text(text)
    return read_jinja(str(source), "deck", PARAMETERS, limit=10**6)


def case_of(tmp_path, text=DECK):
    case = write_case(tmp_path, IN_JINJA)
    (tmp_path / "opening.template").write_text(text)
    program = (tmp_path / "opening.py").read_text()
    (tmp_path / "opening.py").write_text(
        program.replace('open("opening.in")', "LINES").replace(
            "\nE, K = ", '\nLINES = [x for x in open("opening.in") if x.strip()]\nE, K = '
        )
    )
    return case


def test_it_is_filled_with_units_loops_and_conditions(tmp_path):
    text = "{% for n in range(2) %}{{ n }},{{ '%8.3f' | format(E | to('MPa')) }}\n{% endfor %}"
    text += "{% set wide = K0 * 2 %}{{ wide }}{% if K0 < 1 %} low{% endif %}\n"
    template, faults = read(tmp_path, text)
    assert faults == []
    assert {field.parameter for field in template.fields} == {"E", "K0"}
    assert rendered(template, VALUES) == "0,6250.000\n1,6250.000\n1.6 low\n"


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("{{ E }}\n  {{ nu }}\n", "2:6", "there is no parameter 'nu'"),
        ("{{ E }}\n{% if K0 %}\n", "2:1", "this is not Jinja"),
        ("{{ E:10.3e }}\n", "1:1", "this is not Jinja"),
        ("{{ E | round_up }}\n", "1:8", "Jinja has no filter 'round_up'"),
        ("\n{{ E | to('mm') }}\n", "2:12", "'mm' is not a unit of a pressure, as 'E' is"),
        ("{{ E | to('GPaa') }}\n", "1:12", "there is no unit 'GPaa'"),
        ("{{ E | to(K0) }}\n", "1:1", "the unit is not a text"),
        ("{{ E }}{% include '/etc/passwd' %}\n", "1:1", "cannot take in another file"),
        ("nothing\n", "", "the template has no field"),
    ],
)
def test_what_is_wrong_is_said_where_it_stands(tmp_path, text, place, said):
    _, faults = read(tmp_path, text)
    fault = faults[0]
    assert said in fault.message
    assert str(fault.location) == str(tmp_path / "deck.j2") + (f":{place}" if place else "")


ESCAPES = [
    "{{ E.__class__.__mro__[1].__subclasses__() }}",
    "{{ ''.__class__.__mro__ }}",
    "{{ E | attr('__class__') }}{{ (E | attr('__class__')).__mro__ }}",
    "{{ [E] | map(attribute='__class__') | map(attribute='__mro__') | list }}",
    "{{ [E] | map('attr', '__class__') | list | first | attr('mro') }}{{ 1 / 0 }}",
    "{{ '{0.__class__.__base__}'.format(E) }}",
    "{{ ('{0.__class__.__base__}' | attr('format'))(E) }}",
    "{{ '{a.__class__}'.format_map({'a': E}) }}",
    "{{ range.__init__.__globals__ }}",
    "{{ namespace.__init__.__globals__['__builtins__'] }}",
    "{{ (dict | attr('__base__')).__subclasses__() }}",
    "{% macro f() %}{% endmacro %}{{ f.__globals__ }}{{ f._func.__globals__ }}",
    "{{ (E | string).__getattribute__('__class__') }}",
    "{% set made = [] %}{{ made.append(E) }}",
]
"""Ways out of a template of Jinja that are known."""


@pytest.mark.parametrize("text", ESCAPES)
def test_nothing_but_parameters_is_reached(tmp_path, text):
    template, faults = read(tmp_path, "{{ E }}{{ K0 }}\n" + text)
    assert faults == []
    with pytest.raises(CannotRender) as caught:
        rendered(template, VALUES)
    assert str(caught.value).startswith(f"{tmp_path / 'deck.j2'}:2:1: ")


@pytest.mark.parametrize(
    "text",
    [
        "{{ cycler.__init__.__globals__.os.popen('id').read() }}",
        "{{ lipsum.__globals__ }}",
        "{{ joiner.__init__ }}",
        "{{ self.__init__ }}",
        "{{ self._TemplateReference__context }}",
        "{{ get_flashed_messages.__globals__ }}",
        "{% include '/etc/passwd' %}",
        "{% import '../other.j2' as other %}",
        "{% from '/etc/passwd' import root %}",
        "{% extends '/etc/passwd' %}",
        "{{ E" + " + E" * 5000 + " }}",
        "{{ " + "(" * 2000 + "E" + ")" * 2000 + " }}",
    ],
)
def test_what_no_template_may_ask_for_is_a_fault_of_the_case(tmp_path, text):
    _, faults = read(tmp_path, "{{ E }}\n" + text)
    place = str(faults[0].location)
    assert place.startswith(str(tmp_path / "deck.j2"))
    assert place.split(":")[1:2] in (["2"], [])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{{ E / (K0 - 0.8) }}", "float division by zero"),
        ("{{ range(10 ** 9) | list | length + E }}", "Range too big"),
        ("{{ 'x' * 10 ** 10 }}", "more than"),
        ("{{ [E] * 10 ** 10 }}", "more than"),
        ("{{ 10 ** (10 ** 10) }}", "more than"),
        ("{% set n = namespace(x=9) %}{% for i in range(99) %}{% set n.x = n.x * n.x %}"
         "{% endfor %}", "more than"),
        ("{% macro f() %}{{ f() }}{% endmacro %}{{ f() }}", "recursion"),
        ("{{ 'a'.encode('no') }}", "unknown encoding"),
        ("{{ '{2}'.format(E) }}", "index out of range"),
        ("{{ '%d %d' | format(E) }}", "not enough arguments"),
        ("{{ 'x'.ljust(10 ** 17) }}", "MemoryError"),
        ("{{ E.nothing.more }}", "has no attribute 'nothing'"),
    ],
)  # fmt: skip
def test_what_it_cannot_compute_is_a_failed_run_with_its_place(tmp_path, text, said):
    template, faults = read(tmp_path, f"{{{{ K0 }}}}\n\n{text}\n")
    assert faults == []
    with pytest.raises(CannotRender) as caught:
        rendered(template, VALUES)
    assert str(caught.value).startswith(f"{tmp_path / 'deck.j2'}:3:1: ")
    assert said in str(caught.value)


def test_the_digits_that_it_writes_are_found(tmp_path):
    template, _ = read(tmp_path, "{{ '%.3e' | format(E) }} {{ K0 }}")
    assert 1e-4 <= smallest_change(template, VALUES, "E") / 6.25e9 <= 1e-3
    assert smallest_change(template, VALUES, "K0") < 1e-14
    constant, _ = read(tmp_path, "{% if E > 1e9 %}stiff{% endif %}")
    assert smallest_change(constant, VALUES, "E") == 0.0


def test_a_case_is_read_checked_and_run_with_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    case = case_of(tmp_path)
    loaded = read_case(str(case))
    assert loaded.case.elsewhere.seen == {"E", "K0"}
    assert parse_case(loaded.resolved, str(case)).case.elsewhere == loaded.case.elsewhere
    model = build_model(load_inputs(str(case)))
    plain = build_model(load_inputs(str(write_case(tmp_path / "plain"))))
    with trusted():
        found, expected = (m.computed(np.array([7e9, 0.9])) for m in (model, plain))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    log = (tmp_path / "case.runs" / "runs.jsonl").read_text()
    assert "what the program reads" not in log


def test_a_parameter_that_it_does_not_name_is_a_fault_of_the_case(tmp_path):
    with pytest.raises(InputError, match="'K0' has no field in any template"):
        read_case(str(case_of(tmp_path, "{{ E }}")))


def test_without_the_library_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    monkeypatch.delitem(sys.modules, "geoident.io.external.jinja_templates")
    with pytest.raises(InputError) as caught:
        read_case(str(case_of(tmp_path)))
    [fault] = caught.value.faults
    assert fault.hint == 'Install the library that fills it: pip install "geoident[jinja]".'
    assert fault.location.line == 5


ENDLESS = (
    '{{ E }}{{ K0 }}{{ 9 ** 9 ** 9 ** 9 }}{{ "x" * 10 ** 12 }}{% for n in range(9) %}{% endfor %}'
)


def test_nothing_of_a_template_is_computed_before_the_case_is_trusted(tmp_path):
    case = write_case(tmp_path, IN_JINJA)
    (tmp_path / "opening.template").write_text(ENDLESS)
    model = build_model(load_inputs(str(case)))  # what `check` does
    assert not model.notes
    p = np.array([6e9, 1.0])
    for ask in (model.runs.quantum, lambda p: list(model.runs.each([p], lambda: None))):
        with pytest.raises(InputError) as caught:
            ask(p)
        assert caught.value.faults[0].code == "not-trusted"


@pytest.mark.parametrize(
    ("text", "said", "hint"),
    [
        ("{{ E | rund(2) }}{{ K0 }}", "Jinja has no filter 'rund'", "'round'"),
        ("{{ K0 }}{% if E is odder %}{% endif %}", "Jinja has no test 'odder'", "'odd'"),
    ],
)
def test_filters_and_tests_that_are_none_are_named(tmp_path, text, said, hint):
    [fault] = read(tmp_path, text)[1]
    assert (fault.message, fault.location.line) == (said, 1)
    assert hint in fault.hint
