"""Residuals that go together are the model's, not the gauges': named, with the key that helps."""

import re

import numpy as np
import pytest

from geoident.api import fit, load_case
from tests.support.settlement_plates import (
    days_of,
    hyperbola,
    inside_later,
    measured,
    settlement,
    write_plate,
)

CREEPS = settlement(np.random.default_rng(100))
SCATTERS = hyperbola()


def fitted(folder, truth, *, seed=0, part=1.0, more=", model_error: none"):
    rng = np.random.default_rng(seed)
    days = days_of(rng)
    readings = measured(rng, truth, days)
    path = write_plate(folder, days, readings, fitted=int(part * len(days)), more=more)
    return fit(load_case(str(path)), force=True).data


def of_kind(result, kind):
    return [finding for finding in result.findings if finding.kind == kind]


def test_runs_of_one_sign_along_a_series_are_found_with_the_key_to_write(tmp_path):
    result = fitted(tmp_path, CREEPS)
    [found] = of_kind(result, "correlated-residuals")
    assert found.subject == "P"
    gap = (result.gauges.measured - result.gauges.computed)[result.gauges.used]
    alike = int(np.sum(np.sign(gap[1:]) == np.sign(gap[:-1])))
    assert f"{alike} of {len(gap) - 1} neighbours have the same sign" in found.sentence
    assert re.search(r"Write 'model_error: \{time: \d+ days\}' under 'fit'\.", found.sentence)
    [misfit] = of_kind(result, "misfit")
    assert "go together" in misfit.sentence
    assert "accuracies: estimate" not in misfit.sentence


def test_what_it_says_to_write_makes_the_bands_hold(tmp_path):
    before = fitted(tmp_path, CREEPS, part=0.5)
    [found] = of_kind(before, "correlated-residuals")
    [key] = re.findall(r"Write '(model_error: .*?)' under", found.sentence)
    after = fitted(tmp_path, CREEPS, part=0.5, more=f", {key}")
    inside, count, _ = inside_later(before)
    assert inside < 0.5 * count
    inside, count, _ = inside_later(after)
    assert inside >= 0.85 * count
    assert not of_kind(after, "correlated-residuals")


def test_estimated_accuracies_are_not_said_to_be_the_gauges(tmp_path):
    more = ", model_error: none, accuracies: estimate"
    result = fitted(tmp_path, CREEPS, more=more)
    assert of_kind(result, "correlated-residuals")
    [accuracy] = of_kind(result, "accuracy")
    assert accuracy.sentence.startswith("As scatter the residuals of the kind reading would be")
    assert "it is the model that differs" in accuracy.sentence


@pytest.mark.parametrize(("more", "fits"), [(", model_error: none", 10), ("", 5)])
def test_independent_errors_are_accused_once_in_a_hundred_fits(tmp_path, more, fits):
    results = [fitted(tmp_path, SCATTERS, seed=seed, more=more) for seed in range(fits)]
    assert sum(len(of_kind(one, "correlated-residuals")) for one in results) <= 1


def test_gauges_that_scatter_more_than_stated_are_said_to(tmp_path):
    """Four times the stated accuracy, independent from reading to reading."""
    rng = np.random.default_rng(3)
    days = days_of(rng)
    readings = SCATTERS(days) + 20e-3 * rng.standard_normal(len(days))
    path = write_plate(tmp_path, days, readings, fitted=len(days), more=", model_error: none")
    result = fit(load_case(str(path))).data
    assert not of_kind(result, "correlated-residuals")
    [misfit] = of_kind(result, "misfit")
    assert "accuracies: estimate" in misfit.sentence


RODS = """\
format: geoident-case/1
analysis: plane-strain
parameters:
  E: {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}
materials:
  rock: {elastic: isotropic, E: $E, nu: 0.25}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 5 MPa, K0: 1.0}
stages: [{name: open, excavate: [tunnel]}]
gauges:
  EX:
    kind: extensometer
    head: [3 m, 0 m]
    anchors: {ANCHORS}
    accuracy: 0.1 mm
readings: readings.csv
fit:
  method: closed-form
  closed-form: {centre: [0, 0 m], radius: 3 m}
  backtest: false
  model_error: none
"""


def test_runs_along_an_instrument_are_found(tmp_path):
    """Rods in ground that moves as r^-2 around an opening, by an elastic model, r^-1."""
    places = np.arange(3.5, 12.1, 0.5)
    anchors = ", ".join(f"a{k}: [{x} m, 0 m]" for k, x in enumerate(places))
    path = tmp_path / "case.yaml"
    path.write_text(RODS.replace("ANCHORS", anchors))
    moved = 15e-3 * (1.0 - (3.0 / places) ** 2)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(len(places))
    rows = [f"EX.a{k},open,{1e3 * v:.3f},mm" for k, v in enumerate(moved + noise)]
    (tmp_path / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    result = fit(load_case(str(path))).data
    [found] = of_kind(result, "correlated-residuals")
    assert "runs of one sign along the instrument" in found.sentence
    assert re.search(r"Write 'model_error: \{length: [\d.]+ m\}' under 'fit'\.", found.sentence)
