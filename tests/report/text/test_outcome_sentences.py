"""The first paragraph of a page, word for word, with numbers calculated by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.report.text.result import outcome_sentences
from tests.support.results import changed_gauges, example_result

RESULT = example_result(2)
# (measured - computed) / sd of the readings by stage, from the noise of the example
DRIFT, BENCH_1, BENCH_2 = (-1,), (1, -1, 8, 2, 1), (-1, 1, 1, -1, 0)


def lead(**changes):
    return " ".join(outcome_sentences(replace(RESULT, **changes)))


def with_used(*stages):
    """The gauges with all readings of some stages used."""
    table = RESULT.gauges
    used = np.isfinite(table.measured) & np.isin(table.stages, stages)
    return changed_gauges(table, used=used)


@pytest.mark.parametrize(
    ("stages", "during", "residuals"),
    [
        (("bench 1",), "bench 1", BENCH_1),
        (("drift", "bench 1"), "drift to bench 1", DRIFT + BENCH_1),
        (("drift", "bench 1", "bench 2"), "drift to bench 2", DRIFT + BENCH_1 + BENCH_2),
    ],
)
def test_lead_counts_readings_names_stages_and_tells_their_scatter(stages, during, residuals):
    text = lead(gauges=with_used(*stages), prediction=None)
    rms = np.sqrt(sum(r**2 for r in residuals) / len(residuals))
    assert text.startswith(
        f"3 parameters were identified from {len(residuals)} readings ({during}) by gauss-newton."
    )
    assert f"residuals is {rms:.2f} of their standard deviations" in text
    assert "one reading exceeds 3 standard deviations." in text  # the 8 of bench 1


@pytest.mark.parametrize(
    ("noise", "count"), [(2.99, "no reading exceeds"), (3.01, "one reading exceeds")]
)
def test_a_reading_stands_out_from_three_standard_deviations_on(noise, count):
    table = with_used("bench 2")
    measured = table.computed + 0.0
    measured[0, 2] += noise * 1e-4
    text = lead(gauges=changed_gauges(table, measured=measured, used=table.used & (table.sd > 0)))
    assert f"{count} 3 standard deviations." in text


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("off", "inside"), [(1.95, 4), (1.97, 3)])
def test_predicted_readings_count_up_to_the_ends_of_their_band(side, off, inside):
    """Four of bench 2 have a band of 1.96 times 0.15 mm; that of the settlement is endless."""
    table = RESULT.gauges
    measured = table.measured.copy()
    measured[3, 2] = table.computed[3, 2] + side * off * 1.5e-4
    text = lead(gauges=changed_gauges(table, measured=measured))
    assert f"{inside} of 4 predicted readings lie within their 95 % bands." in text


def test_values_stand_in_their_units_with_their_interval():
    text = lead()
    assert "E_rock = 12.3 GPa (95 %: 11.6 to 13.1); K0 = 3.00 (95 %: 2.80 to 3.00)." in text
    assert "sigma_v is known only from its prior." in text
