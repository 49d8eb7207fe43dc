"""`cases/fill-in-lifts`: a fill on clay with drains, its readings by other physics."""

import csv
import importlib.util
import shutil
import sys

import numpy as np
import pytest
from support.commands import run_command
from support.fill_on_clay import CASE as NEIGHBOUR

from geoident.api import fit, load_case

CASE = NEIGHBOUR.parent / "fill-in-lifts"
_spec = importlib.util.spec_from_file_location("make_fill_in_lifts", CASE / "make_readings.py")
made = sys.modules[_spec.name] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(made)


@pytest.fixture(scope="module")
def truth():
    """What each gauge reads without errors: days and values, mm and kPa."""
    return made.truth()


def test_its_readings_are_those_of_the_script(truth):
    with (CASE / "readings.csv").open(encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    assert rows == made.readings(1, truth)
    assert [name.split()[0] for name in names[1:]] == list(truth)


def test_the_truth_hardly_depends_on_its_steps_and_rings(truth):
    fine = made.truth(made.Clay(rings=12, layers=18), last=150.0)
    for name, (days, values) in fine.items():
        at = np.interp(days, *truth[name])
        assert np.abs(at - values).max() < 0.04 * np.ptp(values), name


def test_a_cell_of_the_truth_drains_as_barron_says():
    """Of clay that hardly changes, by Hansbo for equal strain, once the load has come."""
    clay = made.Clay(surcharge=400.0, preconsolidation=0.0, falls=1e9, layers=24, rings=16)
    days, _, pressures = made.column(clay, 0.0, 110.0, longest=1.0)
    n, s = clay.cell / clay.drain, clay.smear / clay.drain
    mu = np.log(n / s) + clay.disturbed * np.log(s) - 0.75
    m = clay.compression / np.log(10.0) / (clay.stress[12] + 50.0)
    rate = 8.0 * clay.ratio * clay.k / 9.81 / m / mu / clay.cell**2
    middle, later = pressures[:, 12], (days > 85.0) & (days < 110.0)
    found = -np.polyfit(days[later], np.log(middle[later]), 1)[0]
    assert found == pytest.approx(rate, rel=0.08)


def test_check_says_what_goes_where():
    said = run_command("check", str(CASE / "case.yaml")).stdout
    assert "Water leaves at surface." in said
    assert "surcharge: P1 P2 P3 P4 U1 U2 U3 U4 used" in said


@pytest.mark.slow
def test_later_readings_and_the_end_of_the_fill_alone_lie_in_their_bands(tmp_path, truth):
    """Over several sets of errors of the gauges, with the model error that a fit estimates."""
    inside, of_parameters = [], []
    for seed in (1, 2, 3, 4):
        folder = tmp_path / str(seed)
        shutil.copytree(CASE, folder)
        with (CASE / "readings.csv").open(encoding="utf-8") as file:
            head = file.readline()
        rows = [",".join(row) + "\n" for row in made.readings(seed, truth)]
        (folder / "readings.csv").write_text("".join([head, *rows]), encoding="utf-8")
        case = load_case(str(folder / "case.yaml"), {"fit.mesh_error": False})
        result = fit(case, output=str(folder / "o.h5")).data
        gauges, band = result.gauges, result.prediction
        later = ~gauges.used & np.isfinite(gauges.measured)
        assert later.sum() == 88
        measured = gauges.measured[later]
        inside.append(
            np.mean((band.lower95[later] <= measured) & (measured <= band.upper95[later]))
        )
        of_parameters.append(result.parameters.values)
    assert np.mean(inside) >= 0.9, inside
    spread = np.std(np.log(of_parameters), axis=0)
    assert (spread < 0.1).all(), of_parameters
