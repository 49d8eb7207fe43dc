"""Yield limits from a case file to the result: complementarity by default, and its certificate."""

from pathlib import Path

import pytest

from geoident.io.result.file import read_result
from tests.support.commands import said_findings

TRUTH = ("--set", "parameters.k1.start=0.5 MPa", "--set", "parameters.k2.start=3 MPa")

LEAN = "mesh_error: false, backtest: false"


@pytest.fixture
def yielding(trench, run):
    """The trench in ground with two yield planes, one of which nothing reaches; exact readings."""
    case = trench / "case.yaml"
    text = case.read_text()
    text = text.replace(
        "  E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}\n"
        "  K0: {start: 1.0, bounds: [0.2, 4]}\n",
        "  k1: {start: 0.9 MPa, bounds: [0.1 MPa, 5 MPa], scale: log}\n"
        "  k2: {start: 3 MPa, bounds: [1.6 MPa, 9 MPa], scale: log}\n",
    )
    text = text.replace(
        "E: $E, nu: 0.25",
        "E: 5 GPa, nu: 0.25, yield: {type: planes, planes: [\n"
        "    {name: shear, normal: [0.7071067811865476, -0.7071067811865476, 0], distance: $k1},\n"
        "    {name: crush, normal: [-1, 0, 0], distance: $k2}]}",
    )
    text = text.replace("K0: $K0", "K0: 1.5")
    text = text.replace(
        "fit: {method: gauss-newton, stages: [first], mesh_error: false}\n", f"fit: {{{LEAN}}}\n"
    )
    case.write_text(text)
    assert run("simulate", "case.yaml", *TRUTH, "-o", "exact.csv").exit_code == 0
    case.write_text(text.replace("readings.csv", "exact.csv"))
    return trench


def test_a_strength_is_found_and_another_is_known_from_below(yielding, run, run_json):
    (found,) = run_json("fit", "case.yaml")
    assert found["method"] == "complementarity"
    assert found["status"] == "not-determined"
    assert found["parameters"]["k1"]["value"] == pytest.approx(0.5e6, rel=1e-4)
    assert (
        found["parameters"]["k2"] | {"value": None, "determined": False}
        == (found["parameters"]["k2"])
    )
    proof = found["certificate"]
    assert proof["kind"] == "global"
    assert 0 < proof["at_least"]["k2"] < 3e6
    assert [plane["plane"] for plane in proof["planes"]] == ["rock: shear", "rock: crush"]
    shear, crush = proof["planes"]
    assert min(shear["points"].values()) > 0
    assert len(shear["points"]) == 2
    assert sum(crush["points"].values()) == 0
    said = f"k2 is at least {proof['at_least']['k2'] / 1e6:.4g} MPa"
    assert any(said in finding for finding in said_findings(found))
    shown = run("show", "case.fit.h5").stdout
    assert "not determined" in shown
    assert f"at least {proof['at_least']['k2'] / 1e6:.4g}"[:12] in shown
    assert "never reached" in shown
    stored = read_result("case.fit.h5").certificate
    assert stored.lower_bounds == pytest.approx(proof["at_least"])


def test_another_method_may_be_named(yielding, run_json):
    (found,) = run_json("fit", "case.yaml", "--set", "fit.method=gauss-newton")
    assert found["method"] == "gauss-newton"
    assert "certificate" not in found


def by(formulation):
    return (
        "--set",
        f"fit={{{LEAN}, method: complementarity, complementarity: {{formulation: {formulation}}}}}",
    )


@pytest.mark.slow  # what it finds: `tests/identification/test_full_space.py`
def test_full_space_finds_the_same(yielding, run_json):
    (found,) = run_json("fit", "case.yaml", *by("full-space"))
    assert found["parameters"]["k1"]["value"] == pytest.approx(0.5e6, rel=1e-3)
    assert found["certificate"]["kind"] == "global"  # exact readings are met exactly


@pytest.mark.slow
def test_the_bound_that_global_proves_is_shown(yielding, run, run_json):
    """Readings of one digit: the discrepancy is not zero, and nothing in the bounds lowers it."""
    lines = [line for line in Path("exact.csv").read_text().splitlines() if line[0] != "#"]
    header, *body = [line.split(",") for line in lines]
    column = header.index("value")
    for row in body:
        row[column] = f"{float(row[column]):.1g}"
    Path("exact.csv").write_text("".join(",".join(row) + "\n" for row in (header, *body)))
    tight = (
        "--set", "parameters.k1={start: 0.5 MPa, bounds: [0.45 MPa, 0.6 MPa]}",
        "--set", "parameters.k2={start: 3 MPa, bounds: [2.9 MPa, 3.1 MPa]}",
    )  # fmt: skip
    (found,) = run_json("fit", "case.yaml", *by("global"), *tight)
    proof = found["certificate"]
    assert proof["kind"] == "global"
    assert 0.0 < proof["bound"] <= found["objective"]
    assert proof["gap"] < 1e-4
    assert "Proven: no misfit is below" in run("show", "case.fit.h5").stdout


def test_where_no_strength_is_sought_gauss_newton_remains(yielding, run_json):
    case = yielding / "case.yaml"
    text = case.read_text().replace("$k1", "0.5 MPa").replace("$k2", "3 MPa")
    lines = [line for line in text.splitlines() if not line.startswith(("  k1:", "  k2:"))]
    text = "\n".join(lines).replace("E: 5 GPa", "E: $E")
    text = text.replace("parameters:", "parameters:\n  E: {start: 2 GPa, bounds: [1 GPa, 9 GPa]}")
    case.write_text(text)
    (found,) = run_json("fit", "case.yaml")
    assert found["method"] == "gauss-newton"
    assert found["parameters"]["E"]["value"] == pytest.approx(5e9, rel=1e-4)


def test_complementarity_needs_yield_limits(trench, run):
    done = run("fit", "case.yaml", "--set", "fit.method=complementarity")
    assert done.exit_code == 3
    assert "no material of the model has yield limits" in done.stderr


def test_virgin_ground_outside_its_yield_surface_is_found_by_check(yielding, run):
    uneven = "in_situ={model: constant, xx: -1 MPa, yy: -9 MPa, zz: -4 MPa}"
    weak = "parameters.k1.start=0.11 MPa"
    done = run("check", "case.yaml", "--set", weak, "--set", uneven)
    assert done.exit_code == 5
    assert "the in-situ stress is outside the yield surface of rock near" in done.stderr
    assert "by a factor of" in done.stderr


def test_points_are_counted_in_predicted_stages_too(yielding, run_json):
    (found,) = run_json("fit", "case.yaml", "--set", "fit.stages=[first]")
    shear = found["certificate"]["planes"][0]["points"]
    assert min(shear.values()) > 0
    assert len(shear) == 2


def test_a_backtest_of_ground_that_yields(yielding, run_json):
    strong = "parameters.k2={start: 6 MPa, bounds: [5 MPa, 9 MPa]}"  # which nothing reaches
    (found,) = run_json("backtest", "case.yaml", "--set", strong)
    first, last = found["backtest"]["fits"]
    assert first["parameters"]["k1"]["determined"]
    assert last["parameters"]["k1"]["value"] == pytest.approx(0.5e6, rel=1e-4)
    told = found["backtest"]["next"]
    assert told["inside"] == told["readings"] == 3
    assert found["status"] == "done"
    assert last["counts"]["evaluations"] < first["counts"]["evaluations"]
    assert not any("elastic model" in text for text in (*said_findings(found), *found["notes"]))
