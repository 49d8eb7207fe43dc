"""Two results side by side."""

import shutil

import pytest

from geoident.workflow import diff as diff_workflow


@pytest.fixture
def two(after):
    """The same readings fitted by two methods, and with one reading more."""
    both = ("--set", "fit.stages=[first, second]", "-o", "both.h5")
    return after(("fit", "case.yaml", "-q"), ("fit", "case.yaml", "-q", *both))


def test_a_result_is_the_same_as_its_copy(two, run, run_json):
    shutil.copy("case.fit.h5", "copy.h5")
    done = run("diff", "case.fit.h5", "copy.h5")
    assert done.exit_code == 0
    assert "The same: " in done.stdout
    (found,) = run_json("diff", "case.fit.h5", "copy.h5")
    assert found["same"]
    assert found["compared"] > 30
    assert found["differences"] == []


def test_another_search_agrees_within_a_tolerance_that_means_something(two, run, run_json):
    run("fit", "case.yaml", "-q", "--set", "parameters.E.start=3 GPa", "-o", "other.h5")
    loose = ["--rtol", "1e-3", "--atol", "0.001mm"]
    assert run("diff", "case.fit.h5", "other.h5", *loose).exit_code == 0
    (found,) = run_json("diff", "case.fit.h5", "other.h5", "--rtol", "1e-15")
    assert not found["same"]


def test_it_says_which_and_by_how_much_in_the_units_of_the_case(two, run, run_json):
    done = run("diff", "case.fit.h5", "both.h5")
    assert done.exit_code == 1
    (found,) = run_json("diff", "case.fit.h5", "both.h5")
    (E,) = [d for d in found["differences"] if (d["item"], d["quantity"]) == ("E", "value")]
    assert E["unit"] == "Pa"
    line = next(line.split() for line in done.stdout.splitlines() if line.startswith("E  "))
    assert line[0:2] + line[-1:] == ["E", "value", "GPa"]
    assert float(line[2]) == pytest.approx(E["first"] / 1e9, rel=1e-6)
    assert float(line[4]) == pytest.approx((E["second"] - E["first"]) / 1e9, rel=1e-2)
    assert E["relative"] == pytest.approx((E["second"] - E["first"]) / max(E["first"], E["second"]))
    readings = [d for d in found["differences"] if d["quantity"] == "measured"]
    assert readings == []  # the same readings, only used or not


def test_a_tolerance_counts_for_numbers_of_its_kind(two, run_json):
    (strict,) = run_json("diff", "case.fit.h5", "both.h5")
    (loose,) = run_json("diff", "case.fit.h5", "both.h5", "--atol", "100 GPa")
    kinds = [{d["unit"] for d in found["differences"]} for found in (strict, loose)]
    assert kinds[0] - kinds[1] == {"Pa"}


def test_what_only_one_has_is_a_difference(two, run, run_json):
    case = (two / "case.yaml").read_text()
    more = "gauges:\n  N: {kind: settlement, point: [5 m, 4 m], accuracy: 0.1 mm}\n"
    (two / "case.yaml").write_text(case.replace("gauges:\n", more))
    run("fit", "case.yaml", "-q", "-o", "more.h5")
    done = run("diff", "case.fit.h5", "more.h5")
    assert done.exit_code == 1
    assert "only in B" in done.stdout
    assert "only in A" in run("diff", "more.h5", "case.fit.h5").stdout
    (found,) = run_json("diff", "case.fit.h5", "more.h5")
    assert {d["item"].partition(",")[0] for d in found["differences"]} == {"N"}
    assert all(d["first"] is None for d in found["differences"])


def test_another_ending_is_a_difference(two, run):
    one_step = ["--set", "fit.gauss-newton.max_iterations=1"]
    assert run("fit", "case.yaml", "-q", *one_step, "-o", "x.h5").exit_code == 4
    told = run("diff", "case.fit.h5", "x.h5")
    assert told.exit_code == 1
    assert "Status: converged in A" in told.stdout


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["case.fit.h5"], 2),
        (["case.fit.h5", "both.h5", "--rtol", "-1"], 2),
        (["case.fit.h5", "both.h5", "--atol", "0.1 mms"], 2),
        (["case.fit.h5", "both.h5", "--atol=-1mm"], 2),
        (["case.fit.h5", "nothing.h5"], 3),
        (["case.yaml", "case.fit.h5"], 3),
    ],
)
def test_trouble_is_not_taken_for_a_difference(two, run, arguments, code):
    assert run("diff", *arguments).exit_code == code


def test_a_bug_is_not_taken_for_a_difference(two, run, monkeypatch):
    monkeypatch.setattr(diff_workflow, "numbers", lambda result: 1 / 0)
    broken = run("diff", "case.fit.h5", "both.h5")
    assert broken.exit_code == 70
    assert "a bug in geoident" in broken.stderr


def test_quiet_leaves_only_the_exit_code(two, run):
    quiet = run("diff", "-q", "case.fit.h5", "both.h5")
    assert (quiet.exit_code, quiet.output) == (1, "")
