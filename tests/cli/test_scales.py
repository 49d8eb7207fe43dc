"""Numbers that no one can mean: refused at their place; and no traceback where they are not."""

from __future__ import annotations

import numpy as np
import pytest
from support.commands import run_command
from support.squares import case_of, grid

from geoident.cli.error_boundary import say_bug

COMMANDS = (("check",), ("simulate",), ("fit", "--force"), ("scan", "--force"))


def block(modulus="$E", load="100 kPa", value="0.3 mm", **keys):
    return case_of(
        **{
            "parameters": "{E: {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}}",
            "materials": f"{{rock: {{E: {modulus}, nu: 0.25}}}}",
            "gauges": "{S: {kind: settlement, point: [2 m, 3 m], accuracy: 0.1 mm}}",
            "readings": f"[{{gauge: S, stage: q, value: {value}}}]",
            "stages": f"[{{name: q, loads: {{q: {{on: crest, pressure: {load}}}}}}}]",
            "fit": "{backtest: false, model_error: none}",
        }
        | keys
    )


@pytest.fixture
def written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "squares.msh").write_text(grid())

    def write(text):
        (tmp_path / "case.yaml").write_text(text)
        return "case.yaml"

    return write


@pytest.mark.parametrize(
    ("case", "mark", "said"),
    [
        (block("1e300 $E"), "1e300", "expected a factor from 1e-12 to 1e+12"),
        (block("-1e13 $E"), "-1e13", "expected a factor from 1e-12 to 1e+12"),
        (block("1e-300 $E"), "1e-300", "expected a factor from 1e-12 to 1e+12"),
        (block("1e999 $E"), "1e999", "expected a factor from 1e-12 to 1e+12"),
        (block("0 $E"), "0 $E", "is zero, whatever the parameter is"),
        (block("-1 $E"), "-1 $E", "it must be positive"),
        (block("1e308 GPa"), "1e308", "'1e308 GPa' is too large to be computed with"),
        (block("1e21 Pa"), "1e21", "'1e21 Pa' is too large to be computed with"),
        (block("1e-300 GPa"), "1e-300", "'1e-300 GPa' is too small to be computed with"),
        (block(load="-1e300 kPa"), "-1e300", "'-1e300 kPa' is too large to be computed with"),
        (block(value="1e300 mm"), "1e300", "'1e300 mm' is too large to be computed with"),
    ],
)
def test_a_number_that_no_one_can_mean_is_refused_at_its_place(written, case, mark, said):
    done = run_command("check", written(case))
    line = next(n for n, row in enumerate(case.splitlines(), 1) if mark in row)
    column = case.splitlines()[line - 1].index(mark) + 1
    assert f"case.yaml:{line}:{column}: " in done.output
    assert said in done.output
    assert done.exit_code == 3


@pytest.mark.parametrize("text", ["1e300 $E", "0 $E", "1e308 GPa", "1e30 $E"])
def test_it_is_refused_on_the_command_line_too(written, text):
    done = run_command("fit", written(block()), "--set", f"materials.rock.E={text}")
    assert done.exit_code == 3
    assert f"'{text}'" in done.output
    assert "--set" in done.output


SCALES = {
    "factor 1e12": block("1e12 $E"),
    "factor 1e-12": block("1e-12 $E"),
    "stiff": block("1e20 Pa", load="$E", value="1e-20 m"),
    "soft": block("1e-19 Pa", load="$E"),
    "wide bounds": block(parameters="{E: {start: 1 GPa, bounds: [1e-20 Pa, 1e20 Pa], scale: log}}"),
    "wide bounds, linear": block(parameters="{E: {start: 1e20 Pa, bounds: [1e-20 Pa, 1e20 Pa]}}"),
    "load": block(load="1e20 Pa"),
    "suction": block(load="-1e20 Pa"),
    "no load": block(load="1e-20 Pa"),
    "reading": block(value="1e20 m"),
    "no reading": block(value="-1e-300 m"),
    "accurate": block(
        gauges="{S: {kind: settlement, point: [2 m, 3 m], accuracy: 1e-10 m, offset: 1e20 m}}"
    ),
    "gravity": block(
        gravity="1e20 m/s2", materials="{rock: {E: $E, nu: 0.25, density: 1e20 kg/m3}}"
    ),
    "prior": block(
        parameters="{E: {start: 1 GPa, bounds: [1e-20 Pa, 1e20 Pa], prior: {mean: 1 GPa, "
        "sd: 1e-20 Pa}}}"
    ),
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of quotients of numbers that far apart
@pytest.mark.parametrize("name", SCALES)
def test_a_problem_out_of_scale_never_ends_in_a_traceback(written, name):
    case = written(SCALES[name])
    for command in COMMANDS:
        done = run_command(*command, case)
        assert done.exit_code in {0, 3, 4, 5}, (command, done.output, done.exception)
        assert "a bug" not in done.output


def test_equations_that_precision_cannot_solve_are_said_to_be_so(capsys):
    try:
        np.linalg.inv(np.zeros((2, 2)))
    except np.linalg.LinAlgError as error:
        code = say_bug(error)
    said = capsys.readouterr().err
    assert code == 5
    assert "cannot be solved with the precision of numbers" in said
    assert "units, exponents, bounds or accuracies" in said
