"""Gauges of all kinds that drift in time: what closed forms read, plus a drift, is found again."""

from __future__ import annotations

import re
from datetime import date

import numpy as np
import pytest
from support.commands import run_command
from support.external import gauge_values, write_table_case
from support.squares import case_of, grid

from geoident.api import fit
from geoident.errors import InputError
from geoident.workflow.running.jobs import load_inputs
from geoident.workflow.simulate import simulate

DATES = {"virgin": date(2024, 1, 1), "one": date(2024, 3, 1), "two": date(2024, 6, 1),
         "three": date(2025, 1, 1)}  # fmt: skip
MONTH = 365.25 / 12  # days
LOAD = {"one": 1e6, "two": 2.5e6, "three": 3e6}
E, NU = 2.3e9, 0.25
STIFF = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))  # confined: no strain across
RATES = {"d_cell": 4e3, "d_stress": -3e3, "d_strain": 6e-6, "d_tilt": 2e-5}  # SI, per month


def months(stage: str, since: str) -> float:
    return (DATES[stage] - DATES[since]).days / MONTH


def confined_block(**more: str) -> str:
    """A block between walls under a load that grows: stress and strain are the same everywhere."""
    stages = ", ".join(
        f"{{name: {name}, loads: {{top: {{on: crest, pressure: {q:.0f} Pa}}}}}}"
        for name, q in LOAD.items()
    )
    return case_of(
        parameters="{E: {start: 1 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}, "
        "d_cell: {start: 0 kPa/month, bounds: [-50, 50 kPa/month]}, "
        "d_stress: {start: 0 kPa/month, bounds: [-50, 50 kPa/month]}, "
        "d_strain: {start: 0 microstrain/month, bounds: [-50, 50 microstrain/month]}, "
        "d_tilt: {start: 0 mrad/month, bounds: [-1, 1 mrad/month]}}",
        groups="{ground: rock, top: rock}",
        stages=f"[{stages}]",
        gauges="{P: {kind: pressure-cell, point: [2.2 m, 1.6 m], normal: [0, 1], "
        "accuracy: 2 kPa, drift: $d_cell}, "
        "Q: {kind: stress, point: [2.2 m, 1.6 m], components: [yy], accuracy: 2 kPa, zero: one, "
        "drift: $d_stress}, "
        "S: {kind: strain, point: [2.2 m, 1.6 m], component: yy, accuracy: 1 microstrain, "
        "drift: $d_strain}, "
        "T: {kind: tilt, between: [[1 m, 1 m], [1 m, 3 m]], accuracy: 0.01 mrad, zero: one, "
        "drift: $d_tilt}}",
        dates="{" + ", ".join(f"{name}: {day}" for name, day in DATES.items()) + "}",
        fit="{model_error: none, backtest: false}",
        **more,
    )


def what_they_read() -> dict[tuple[str, str], float]:
    """Gauge and stage to its reading, SI: closed form and drift."""
    found = {}
    for stage, q in LOAD.items():
        found["P", stage] = q + RATES["d_cell"] * months(stage, "virgin")
        found["S", stage] = -q / STIFF + RATES["d_strain"] * months(stage, "virgin")
        if stage != "one":
            change = -(q - LOAD["one"])
            found["Q.yy", stage] = change + RATES["d_stress"] * months(stage, "one")
            found["T", stage] = RATES["d_tilt"] * months(stage, "one")
    return found


def test_drifts_of_cells_strains_and_tilts_are_found_from_closed_forms(tmp_path):
    units = {"P": ("kPa", 1e3), "Q": ("kPa", 1e3), "S": ("microstrain", 1e-6), "T": ("mrad", 1e-3)}
    rows = ["gauge,stage,value,unit"]
    for (gauge, stage), value in what_they_read().items():
        unit, size = units[gauge[0]]
        rows.append(f"{gauge},{stage},{value / size!r},{unit}")
    (tmp_path / "readings.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "squares.msh").write_text(grid())
    (tmp_path / "case.yaml").write_text(confined_block(readings="readings.csv"))
    found = fit(tmp_path / "case.yaml")
    table = found.parameters
    second = 86400 * MONTH
    assert table["E"].value == pytest.approx(E, rel=1e-6)
    for name, rate in RATES.items():
        assert table[name].value * second == pytest.approx(rate, rel=1e-5), name
    shown = run_command("show", tmp_path / "case.fit.h5").output
    assert re.search(r"d_cell +4\.00 .* kPa/month\n", shown)
    # from the last reading alone, at 12 months, and two before: least squares through the zero
    times = np.array([months(stage, "virgin") for stage in LOAD])
    assert table["d_cell"].sd * second == pytest.approx(2e3 / np.linalg.norm(times), rel=0.05)


def test_a_piezometer_drifts_beside_its_water(tmp_path):
    text = confined_block(water="{table: 3 m}").replace(
        "T: {",
        "W: {kind: piezometer, point: [2.2 m, 1.6 m], accuracy: 1 kPa, drift: 2 kPa/month}, T: {",
    )
    (tmp_path / "squares.msh").write_text(grid())
    (tmp_path / "case.yaml").write_text(text)
    found = {r.stage: r.value for r in simulate(str(tmp_path / "case.yaml")).readings
             if r.channel == "W"}  # fmt: skip
    for stage in LOAD:
        expected = 9810 * 1.4 + 2e3 * months(stage, "virgin")
        assert found[stage] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("zero", ["", ", zero: half"])
def test_a_plain_reading_drifts_in_its_own_unit(tmp_path, zero):
    dates = {"virgin": date(2024, 1, 1), "half": date(2024, 4, 1), "open": date(2024, 12, 1)}
    since = "half" if zero else "virgin"
    rows = ["gauge,stage,value,unit"]
    for (gauge, stage), value in gauge_values(6e9, 0.9).items():
        read = value
        if gauge == "D":
            read += 5e-5 * (dates[stage] - dates[since]).days / MONTH
            read -= gauge_values(6e9, 0.9)["D", "half"] if zero else 0.0
        rows.append(f"{gauge},{stage},{1e3 * read!r},mm")
    case = write_table_case(tmp_path, 60, readings="\n".join(rows) + "\n")
    text = case.read_text().replace(
        "D: {kind: reading, accuracy: 0.02 mm",
        f"D: {{kind: reading, accuracy: 0.02 mm{zero}, drift: $d",
    )
    text = text.replace(
        "parameters:\n", "parameters:\n  d: {start: 0 mm/month, bounds: [-1, 1 mm/month]}\n"
    )
    text += "dates: {" + ", ".join(f"{n}: {day}" for n, day in dates.items()) + "}\n"
    case.write_text(text)
    table = fit(case).parameters
    assert table["d"].value * 86400 * MONTH == pytest.approx(5e-5, rel=0.02)
    assert table["E"].value == pytest.approx(6e9, rel=0.01)


def test_a_drift_of_another_dimension_is_refused_at_its_place(tmp_path):
    text = confined_block().replace("d_tilt: {start: 0 mrad/month", "d_tilt: {start: 0 kPa/month")
    text = text.replace("[-1, 1 mrad/month]", "[-1, 1 kPa/month]")
    (tmp_path / "squares.msh").write_text(grid())
    (tmp_path / "case.yaml").write_text(text)
    with pytest.raises(InputError, match="expected an angle rate"):
        load_inputs(str(tmp_path / "case.yaml"))


COMMANDS = (
    ("check",),
    ("check", "--identifiability"),
    ("simulate",),
    ("fit",),
    ("scan", "--force"),
    ("backtest",),
)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_drift_without_the_date_of_its_zero_is_refused_by_every_command(tmp_path, command):
    """With readings or without: nothing of the gauge can be computed, so nothing is left out."""
    text = confined_block(readings="[{gauge: P, stage: one, value: 1 MPa}]")
    text = text.replace("virgin: 2024-01-01, ", "")
    (tmp_path / "squares.msh").write_text(grid())
    (tmp_path / "case.yaml").write_text(text)
    done = run_command(*command, tmp_path / "case.yaml")
    assert done.exit_code == 3
    line, column = next(
        (n, row.index("$d_cell") + 1)
        for n, row in enumerate(text.splitlines(), 1)
        if row.startswith("gauges")
    )
    where = f"case.yaml:{line}:{column}: gauges.P.drift: "
    assert f"{where}'P' drifts in time, but the stage 'virgin' has no date" in done.output
    assert "Add it: dates: {virgin: 2024-03-01}; or use drift_per_stage." in done.output


def test_predictions_and_draws_of_a_drift_without_a_date_are_refused_too(tmp_path):
    text = confined_block(readings="[{gauge: P, stage: one, value: 1 MPa}]")
    (tmp_path / "squares.msh").write_text(grid())
    case = tmp_path / "case.yaml"
    case.write_text(text.replace(", drift: $d_cell", ""))
    text = case.read_text()
    for name in ("d_cell", "d_stress", "d_strain", "d_tilt"):
        text = re.sub(rf"(, )?{name}: {{[^}}]*}}", "", text).replace(f", drift: ${name}", "")
    case.write_text(text)
    fit(case)
    new = text.replace("accuracy: 2 kPa}, Q", "accuracy: 2 kPa, drift: 1 kPa/month}, Q")
    (tmp_path / "new.yaml").write_text(new.replace("virgin: 2024-01-01, ", ""))
    done = run_command("predict", tmp_path / "case.fit.h5", "--case", tmp_path / "new.yaml")
    assert done.exit_code == 3
    assert "'P' drifts in time, but the stage 'virgin' has no date" in done.output


def test_a_stage_without_a_date_is_left_out_with_a_word(tmp_path):
    text = confined_block().replace(", three: 2025-01-01", "")
    (tmp_path / "squares.msh").write_text(grid())
    (tmp_path / "case.yaml").write_text(text)
    done = run_command("simulate", tmp_path / "case.yaml")
    assert done.exit_code == 0
    assert "P,two," in done.stdout
    assert "P,three," not in done.stdout
    said = "not computed at 'three', which has no date, as the gauge drifts in time: P, Q.yy, S, T"
    assert said in done.stderr
    checked = run_command("check", tmp_path / "case.yaml").output
    assert "'P' drifts in time and is not computed at stages without a date: 'three'" in " ".join(
        checked.split()
    )
