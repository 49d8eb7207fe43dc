"""Templates: what fields write, and what is wrong with them, each at its place."""

import pytest

from geoident.io.external.templates import FieldTooNarrow, field_texts, filled, read_template
from geoident.model.parameter import Parameter

PARAMETERS = {
    "E": Parameter("E", start=15e9, lower=1e9, upper=1e11, dimension="pressure", unit="GPa"),
    "K0": Parameter("K0", start=1.0, lower=0.1, upper=3.0),
}
VALUES = {"E": 15e9, "K0": 1.25}


def template(tmp_path, text):
    path = tmp_path / "deck.template"
    path.write_text(text)
    return read_template(str(path), "deck.inp", PARAMETERS)


def test_values_are_written_in_their_unit_and_form(tmp_path):
    found, faults = template(tmp_path, "*ELASTIC\n{{E [MPa]:12.4e}},0.25\nK={{ K0 }}\n{E}\n")
    assert faults == []
    text = filled(found, field_texts(found, VALUES))
    assert text == "*ELASTIC\n  1.5000e+04,0.25\nK=1.25\n{E}\n"


def test_without_form_no_digit_is_lost(tmp_path):
    found, _ = template(tmp_path, "{{E}}")
    assert float(field_texts(found, {"E": 15e9 / 7})[0]) == 15e9 / 7


@pytest.mark.parametrize(
    ("text", "line", "column", "code", "said"),
    [
        ("a\n {{F}}", 2, 2, "unknown-parameter", "there is no parameter 'F'"),
        ("{{E [mm]}}", 1, 1, "unit", "'mm' is not a unit of a pressure"),
        ("{{E [Gpx]}}", 1, 1, "unit", "no unit 'Gpx'"),
        ("{{E:10d}}", 1, 1, "bad-form", "'10d' is not a form of a number"),
        ("{{E:.99999999999f}}", 1, 1, "bad-form", "is not a form of a number"),
        ("{{E:99999999999f}}", 1, 1, "bad-form", "is not a form of a number"),
        ("{{E + 1}}", 1, 1, "bad-field", "is not a field"),
        ("no field", 0, 0, "no-field", "has no field"),
    ],
)
def test_what_is_wrong_is_said_where_it_stands(tmp_path, text, line, column, code, said):
    _, [fault] = template(tmp_path, text)
    assert (fault.location.line, fault.location.column, fault.code) == (line, column, code)
    assert said in fault.message


def test_a_value_that_does_not_fit_would_shift_columns(tmp_path):
    found, [fault] = template(tmp_path, "{{E:8.1f}}")
    said = (
        "a field of 8 characters is too narrow for E within its bounds: '100000000000.0' takes 14"
    )
    assert fault.message == said
    with pytest.raises(FieldTooNarrow, match="takes 13 characters, its field has 8"):
        field_texts(found, VALUES)


PEST = "ptf #\n*ELASTIC\n#      e      #,0.25\nK=# K0 #, # k0                         #\n"


def test_a_template_of_pest_is_filled_as_pest_does(tmp_path):
    found, faults = template(tmp_path, PEST)
    assert faults == []
    text = filled(found, field_texts(found, {"E": 1.23456789e10, "K0": 1.25}))
    fields = [text.splitlines()[1][:15], text.splitlines()[2][2:8], text.splitlines()[2][10:39]]
    assert [float(field) for field in fields] == pytest.approx([12.3456789, 1.25, 1.25], rel=1e-12)
    assert [len(line) for line in text.splitlines()] == [
        len(line) for line in PEST.splitlines()[1:]
    ]


@pytest.mark.parametrize(
    ("text", "line", "column", "code", "said"),
    [
        ("ptf ~\na ~ e ~ ~ f ~\n", 2, 9, "unknown-parameter", "there is no parameter 'f'"),
        ("ptf ~\n\na ~ e ~ ~ k0\n", 3, 9, "bad-field", "has no second '~' on its line"),
        ("ptf ~\n a~e~\n", 2, 3, "narrow-field", "of 3 characters is too narrow for E"),
        ("ptf ~\nE e\n", 0, 0, "no-field", "has no field"),
    ],
)
def test_faults_of_a_template_of_pest(tmp_path, text, line, column, code, said):
    _, [fault] = template(tmp_path, text)
    assert (fault.location.line, fault.location.column, fault.code) == (line, column, code)
    assert said in fault.message


def test_names_that_pest_cannot_tell_apart_are_asked_for(tmp_path):
    twins = {name: Parameter(name, start=1.0, lower=0.0, upper=2.0) for name in ("k", "K")}
    path = tmp_path / "deck.tpl"
    path.write_text("ptf ~\n~   K   ~\n")
    found, faults = read_template(str(path), "deck.inp", twins)
    assert (faults, found.fields[0].parameter) == ([], "K")
    twins = {name: Parameter(name, start=1.0, lower=0.0, upper=2.0) for name in ("kK", "Kk")}
    path.write_text("ptf ~\n~   kk   ~\n")
    _, [fault] = read_template(str(path), "deck.inp", twins)
    assert fault.message == "'kk' may be kK and Kk"
