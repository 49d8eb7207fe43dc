"""`cases/fill-on-clay`: three plates of other physics, by consolidation and by a curve."""

from datetime import date

import numpy as np
import pytest
from support.fill_on_clay import CASE, made

from geoident.api import fit, load_case
from geoident.io.case.file import read_case


@pytest.fixture(scope="module")
def truth():
    """Days and settlements of each plate, m, until the end of the design life."""
    lifts = tuple((day, made.WEIGHT * height) for day, height in made.LIFTS)
    return {
        name: made.settlement(made.Ground(thickness=H, lifts=lifts, **made.COMMON), 11200.0)
        for name, H in made.THICKNESS.items()
    }


def day(text):
    return (date.fromisoformat(text) - made.BEGIN).days


def test_its_readings_are_those_of_the_script(truth):
    readings = [r for r in read_case(str(CASE / "case.yaml")).case.readings if r.value is not None]
    known = [np.interp(day(r.stage), *truth[r.channel]) for r in readings]
    residuals = np.array([r.value for r in readings]) - known
    assert len(readings) == 165
    assert np.std(residuals) == pytest.approx(1e-3 * made.SD, rel=0.15)


@pytest.mark.parametrize("name", [pytest.param("case", marks=pytest.mark.slow), "hyperbola"])
def test_later_readings_and_what_remains_after_the_opening_are_foretold(tmp_path, truth, name):
    case = load_case(str(CASE / f"{name}.yaml"), {"fit.backtest": False})
    result = fit(case, output=str(tmp_path / "o.h5")).data
    later = ~result.gauges.used & np.isfinite(result.gauges.measured)
    measured, band = result.gauges.measured[later], result.prediction
    assert later.sum() == 63
    assert np.mean((band.lower95[later] <= measured) & (measured <= band.upper95[later])) >= 0.9
    for plate, (times, settled) in truth.items():
        [row] = [r for r in result.settlement if (r.gauge, r.quantity) == (plate, "remaining")]
        at_opening, at_end = np.interp([day("2024-10-01"), day("2053-10-01")], times, settled)
        assert row.lower95 <= at_end - at_opening <= row.upper95
        assert row.upper95 - row.lower95 < 0.15
