"""Weight and in-situ stress that do not agree are refused, or taken knowingly.

Every sentence and limit: `tests/forward/analysis/test_initial_state.py`.
"""

from __future__ import annotations

import json

import pytest
from support.trench import CASE, write_case

from geoident.errors import InputError
from geoident.workflow.check import check
from tests.support.commands import run_command

HEIM = "in_situ: {model: heim, vertical: 1 MPa, K0: $K0}"
DENSITY = "nu: 0.25, density: 1900 kg/m3}"
GRAVITY = "gravity: 9.81 m/s2\n"
ACCEPT = ", equilibrium: accept}"


@pytest.fixture
def case(tmp_path):
    """Writes a trench of soil with another in-situ stress."""

    def write(in_situ: str, *changes: tuple[str, str]) -> str:
        path = write_case(tmp_path)
        text = CASE.replace("nu: 0.25}", DENSITY).replace(HEIM, in_situ)
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
        return str(path)

    return write


def faults(path: str) -> list[str]:
    """What `check` refuses, sentence by sentence."""
    try:
        check(path)
    except InputError as error:
        return [fault.message for fault in error.faults]
    return []


def notes(path: str) -> str:
    return " | ".join(check(path).summary.notes)


def heim(unit_weight: str, more: str = "}") -> str:
    return f"in_situ: {{model: heim, unit_weight: {unit_weight}, surface: 4 m, K0: $K0{more}"


class TestTheTwoTriedExamples:
    """Of which one gave exit code 0 and a wrong modulus."""

    def test_a_stress_that_grows_without_gravity(self, case, capsys):
        path = case(heim("18.64 kN/m3"))
        assert faults(path) == [
            "the in-situ stress of 'rock', 'upper' and 'lower' grows by 18.64 kN/m3 with depth, "
            "but there is no gravity: the ground weighs 0 kN/m3"
        ]
        for command in ("check", "fit"):
            told = run_command(command, path)
            assert told.exit_code == 3
            assert "Add 'gravity: 9.81 m/s2' ('rock' has 1900 kg/m3)" in told.stderr

    def test_right_they_are_in_balance(self, case):
        path = case(GRAVITY + heim("18.639 kN/m3"))
        assert faults(path) == []
        assert "out of balance" not in notes(path)


def test_what_is_accepted_is_still_said(case):
    path = case(GRAVITY + heim("18.64 kN/m3", ACCEPT), ("1900 kg/m3", "1500 kg/m3"))
    assert "is 14.71 kN/m3 (1500 kg/m3 x 9.81 m/s2) (accepted: in_situ.equilibrium)" in notes(path)
    assert "one equilibrium step was made" in notes(path)
    told = run_command("fit", path, "--json", "-q")
    assert told.exit_code in (0, 4)
    assert "(accepted: in_situ.equilibrium)" in told.stdout


GEOSTATIC = "in_situ: {model: geostatic, K0: $K0}"


@pytest.mark.parametrize("table", ["4 m", "3.6 m", "3.3 m", "2.77 m", "0.4 m"])
def test_a_water_table_inside_elements_is_no_contradiction(case, table):
    """Elements of 1 m: a kink of the stress inside them, also close to the surface."""
    path = case(f"water: {{table: {table}}}\n" + GRAVITY + GEOSTATIC, ("start: 1.0", "start: 0.4"))
    assert faults(path) == []


def test_without_in_situ_stress_gravity_makes_it(case):
    path = case(GRAVITY.rstrip(), ("  K0: {start: 1.0, bounds: [0.2, 4]}\n", ""))
    assert faults(path) == []


def test_a_unit_weight_that_is_fitted_away_from_the_density_is_said_at_the_end(case):
    """At the start both agree; the end is elsewhere, and says it."""
    free = "  gamma: {start: 18.639 kN/m3, bounds: [10 kN/m3, 400 kN/m3]}\nmaterials:"
    path = case(
        GRAVITY + heim("$gamma"), ("  K0: {start: 1.0, bounds: [0.2, 4]}\n", ""), ("$K0", "1.5"),
        ("  E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}\n", ""), ("$E", "1 GPa"),
        ("materials:", free),
    )  # fmt: skip
    assert faults(path) == []
    told = run_command("fit", path, "--json", "-q")
    found = json.loads(told.stdout)
    value = found["parameters"]["gamma"]["value"]
    assert value > 1.1 * 18.639e3
    assert f"grows by {value / 1e3:.4g} kN/m3 with depth, but density times gravity" in told.stdout


def test_a_free_density_carries_the_geostatic_stress_along(case):
    """Density as a parameter: weight and stress stay one at all its values."""
    free = "  rho: {start: 1900 kg/m3, bounds: [1000 kg/m3, 60000 kg/m3]}\nmaterials:"
    path = case(
        GRAVITY + "in_situ: {model: geostatic, K0: 1.5}",
        ("  K0: {start: 1.0, bounds: [0.2, 4]}\n", ""),
        ("density: 1900 kg/m3", "density: $rho"),
        ("materials:", free),
    )
    told = run_command("fit", path, "--json", "-q")
    assert told.exit_code in (0, 4)
    assert "out of balance" not in told.stdout
    assert "grows by" not in told.stdout


ONE_UNKNOWN = (
    ("  K0: {start: 1.0, bounds: [0.2, 4]}\n", ""),
    ("stages: [first]", "stages: [first, second]"),
)


def test_the_modulus_is_found_only_where_weight_and_stress_agree(case, tmp_path):
    """Readings of a pit at E = 2 GPa; accepted contradictions miss it."""
    right = GRAVITY + "in_situ: {model: geostatic, K0: 0.6}"
    exact = ("accuracy: 0.01 mm", "accuracy: 0.0001 mm")  # the pit moves by 0.01 mm
    readings = run_command("simulate", case(right, *ONE_UNKNOWN), "-q").stdout

    def fitted(in_situ: str, *changes: tuple[str, str]) -> float:
        path = case(in_situ, *ONE_UNKNOWN, ("start: 2 GPa", "start: 9 GPa"), exact, *changes)
        (tmp_path / "readings.csv").write_text(readings)
        alone = ("--set", "fit.backtest=false", "--set", "fit.model_error=none")
        told = run_command("fit", path, "--json", "-q", "--fresh", "--force", *alone)
        assert told.exit_code in (0, 4), told.stderr  # 4: the model does not fit the readings
        return float(json.loads(told.stdout)["parameters"]["E"]["value"]) / 1e9

    assert fitted(right) == pytest.approx(2.0, rel=1e-4)
    loose = heim("18.639 kN/m3", ACCEPT).replace("$K0", "0.6")
    without = fitted(loose)
    lighter = fitted(GRAVITY + loose, ("1900 kg/m3", "1500 kg/m3"))
    assert abs(without - 2.0) > 0.3
    assert abs(lighter - 2.0) > 0.05
