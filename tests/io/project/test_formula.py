"""Formulas of laws: what they say, their derivatives, and what is refused."""

import math

import numpy as np
import pytest

from geoident.io.project.formula import parse_formula
from geoident.io.text.wording import Refusal
from geoident.model.dual import Dual

VALUES = {"a": 2.0, "b": 0.3, "GSI": 4.0}


def at(text, **changed):
    values = {**VALUES, **changed}
    n = len(values)
    duals = {
        name: Dual(np.concatenate([[value], np.eye(n)[k]]))
        for k, (name, value) in enumerate(values.items())
    }
    return parse_formula(text).at(duals)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a * exp(b * GSI)", 2.0 * math.exp(1.2)),
        ("a - -b", 2.3),
        ("a * GSI^2 / 3", 32.0 / 3.0),
        ("a ** b", 2.0**0.3),
        ("a^0 + 2e3", 2001.0),
        ("(a + b) * GSI", 9.2),
        ("log(a) + log10(100) + sqrt(GSI)", math.log(2.0) + 4.0),
        ("a / (1 + exp((60 + 15*b - GSI) / 11))", 2.0 / (1 + math.exp((60 + 4.5 - 4) / 11))),
        ("+a", 2.0),
        ("(0 - a)^3", -8.0),
    ],
)
def test_a_formula_has_its_value_and_its_exact_derivatives(text, value):
    found = at(text)
    assert float(found.value) == pytest.approx(value, rel=1e-14)
    for k, (name, known) in enumerate(VALUES.items()):
        step = 1e-6
        slope = (
            at(text, **{name: known + step}).value - at(text, **{name: known - step}).value
        ) / (2 * step)
        assert found.columns[1 + k] == pytest.approx(float(slope), rel=1e-6, abs=1e-8)


@pytest.mark.parametrize(
    "text",
    [
        "", "a *", "exp(a, b)", "sin(a)", "a if b else c", "__import__('os')", "a.b",
        "[a]", "'x'", "a < b", "lambda: 1", "True", "1e999", "exp(x=1)", "a @ b", "a // b",
        "-" * 60 + "a", "a" * 600, "a; b", "a := 1",
    ],
)  # fmt: skip
def test_what_is_no_formula_is_refused(text):
    with pytest.raises(Refusal) as found:
        parse_formula(text)
    assert found.value.code == "bad-formula"


def test_a_function_that_is_nearly_known_is_named():
    with pytest.raises(Refusal) as found:
        parse_formula("expp(a)")
    assert "Did you mean 'exp'?" in found.value.hint
