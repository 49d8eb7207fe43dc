"""`cases/creeping-tunnel`: rock and shotcrete that creep by other laws than those of the fit."""

from __future__ import annotations

import importlib.util
import shutil
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from geoident.api import fit, load_case
from geoident.cli.app import geoident
from geoident.io.case.file import read_case
from geoident.workflow.estimating.setup import prepare, used_response
from geoident.workflow.running.jobs import Request, plan_fit

CASE = Path(__file__).parents[2] / "cases" / "creeping-tunnel"
FOUND = {"share": 0.292, "time": 0.068 * 86400.0, "phi": 1.21}
"""By the fit of the case, SI."""


def load_script():
    """What made the readings, as a module of its own."""
    spec = importlib.util.spec_from_file_location("make_creeping", CASE / "make_readings.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def made():
    return load_script()


@pytest.fixture(scope="module")
def exact(made):
    """What the channels (days, channels) would read without noise: mm, MPa."""
    return made.readings()


def test_its_script_moves_as_closed_forms_do():
    """Elastic rock by Kirsch; a dashpot, n = m = 1, whose wall flows by 3 A p R / 2 a day.

    The deviator of the elastic stress is the one of steady flow as well, so nothing redistributes.
    """
    made = load_script()
    wall = made.displacements(np.zeros((2, len(made.MIDDLE))), 0.0)[0]
    assert wall == pytest.approx(-made.PRESSURE * made.RADIUS / (2 * made.SHEAR), rel=1e-3)
    made.A, made.N, made.M = 1e-4, 1.0, 1.0
    made.LINED = 20.0
    made.at_face = lambda t: (0.0, 0.0)
    seen = made.history([10.0, 20.0])
    flowed = seen[20.0][0][0] - seen[10.0][0][0]
    assert flowed == pytest.approx(-10 * 1.5 * 1e-4 * made.PRESSURE * made.RADIUS, rel=2e-3)


def test_its_readings_are_those_of_the_script(made, exact):
    case = read_case(str(CASE / "case.yaml")).case
    order = [name for name in made.CHANNELS if name in {c.name for c in case.channels}]
    assert order == list(made.CHANNELS)
    read = np.full(exact.shape, np.nan)
    for n, line in enumerate((CASE / "readings.csv").read_text().splitlines()[1:]):
        cells = line.split(",")[1:]
        read[n] = [float(cell) if cell else np.nan for cell in cells]
    z = (read - exact) / list(made.CHANNELS.values())
    assert np.isnan(z).sum() == 1  # no ring yet
    assert np.nanstd(z) == pytest.approx(1.0, abs=0.15)


def test_its_ring_carries_what_shotcrete_can(exact):
    assert -15.0 < exact[-1, -1] < -5.0


def test_the_model_goes_on_as_was_read():
    """At what the fit finds, it is beside the readings by their errors, later by a few of these."""
    until = ("fit.until=2024-06-29",)
    setup = prepare(
        plan_fit(Request(str(CASE / "case.yaml"), output="nowhere.h5", overrides=until))
    )
    p = np.array([FOUND[parameter.name] for parameter in setup.case.parameters])
    readings = setup.readings
    used = readings.used
    z = (readings.value[used] - used_response(setup).readings(p)) / readings.sd[used]
    later = readings.time[used] > datetime(2024, 4, 1, tzinfo=UTC).timestamp()
    assert (~later).sum() == 71
    assert np.sqrt(np.mean(z[~later] ** 2)) < 1.3
    assert np.abs(z[later]).max() < 8.0


def test_the_case_is_sound():
    run = CliRunner().invoke(geoident, ["check", str(CASE / "case.yaml")])
    assert run.exit_code == 0, run.output


@pytest.mark.slow
def test_bands_hold_later_readings(tmp_path, made, exact):
    """Of each of several draws of the noise three months ahead of the last reading that is used."""
    inside = []
    for seed in (4, 1, 2):
        for name in ("case.yaml", "tunnel.msh"):
            shutil.copy(CASE / name, tmp_path / name)
        made.write(tmp_path / "readings.csv", exact, seed)
        case = load_case(
            str(tmp_path / "case.yaml"), {"fit.backtest": False, "fit.mesh_error": False}
        )
        result = fit(case, output=str(tmp_path / f"{seed}.h5")).data
        later = ~result.gauges.used & np.isfinite(result.gauges.measured)
        measured, band = result.gauges.measured[later], result.prediction
        assert later.sum() == 48
        inside.append((band.lower95[later] <= measured) & (measured <= band.upper95[later]))
    assert np.mean(inside) >= 0.9
