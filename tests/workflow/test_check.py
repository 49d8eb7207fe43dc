"""What `check` finds out without computing a stage."""

from __future__ import annotations

import pytest
from support.trench import write_case

from geoident.workflow.check import check
from tests.support.commands import run_command

HEAVY = ("gravity=[0, -10 m/s2]", "materials.rock.density=2700 kg/m3")


@pytest.fixture
def case(tmp_path) -> str:
    return str(write_case(tmp_path))


def out_of_balance(case: str, *overrides: str) -> list[str]:
    notes = check(case, overrides=overrides).summary.notes
    return [note for note in notes if "out of balance" in note]


def test_a_stress_in_balance_is_not_mentioned(case):
    assert out_of_balance(case) == []


def test_an_elastic_case_out_of_balance_is_said(case):
    """Squares of 1 m: a node inside bears 27 kN/m; one on top 1000 kN/m and half of it."""
    expected = 100 * 27.0 / (1000.0 + 13.5)
    (note,) = out_of_balance(case, *HEAVY)
    assert note.startswith(f"the in-situ stress is out of balance by {expected:.3g} % of the ")


def test_a_yielding_case_out_of_balance_is_said_once(case):
    strong = "materials.rock.yield={type: tresca, strength: 100 MPa}"
    (note,) = out_of_balance(case, *HEAVY, strong)
    assert "out of balance by 2.66 %" in note


def test_simulate_says_which_gauge_it_can_compute_nowhere(case):
    silent = "gauges.core={kind: settlement, point: [3 m, 3.5 m], accuracy: 1 mm}"
    done = run_command("simulate", case, "--set", silent)
    assert done.exit_code == 0
    assert "core" not in done.stdout
    assert "no readable stage after the zero: core, as" in " ".join(done.stderr.split())
    assert "no readable stage" not in run_command("simulate", case).stderr


def test_a_gauge_that_nobody_can_read_is_said(case):
    silent = "{kind: settlement, point: [3 m, 3.5 m], accuracy: 1 mm}"
    notes = check(case, overrides=[f"gauges.core={silent}"]).summary.notes
    (note,) = [note for note in notes if "no readable stage" in note]
    assert note.startswith("no readable stage after the zero: core, as ")
    late = "{kind: settlement, point: [1 m, 4 m], accuracy: 1 mm, zero: second}"
    notes = check(case, overrides=[f"gauges.late={late}"]).summary.notes
    assert any(note.endswith("late, as it is zeroed at the last stage") for note in notes)
    assert not any("no readable stage" in note for note in check(case).summary.notes)
