"""Numbers as people read them: as many digits as what is known of them warrants."""

import math

import numpy as np
import pytest

from geoident.report.text.layout import WIDTH, TextTable, with_interval


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ((9.98765, 8.4912, 11.7049), ("9.99", "8.5", "11.7")),
        ((12.34, 11.62, 13.1), ("12.3", "11.6", "13.1")),
        ((0.3, 0.28, 0.31), ("0.300", "0.280", "0.310")),
        ((15234.5, 14873.0, 15570.0), ("15230", "14870", "15570")),
        ((1e6 * 2.314, 2.11e6, 2.5e6), ("2.31e+06", "2.11e+06", "2.5e+06")),
        ((10.0, 0.5, 300.0), ("10.0", "0.50", "300")),  # of a logarithm: no end becomes zero
        ((0.0004, -0.001, 0.002), ("0.0004", "-0.0010", "0.0020")),
        ((3.0, math.nan, math.nan), ("3", "-", "-")),
        ((3.0, 2.0, math.inf), ("3", "2", "inf")),
    ],
)
def test_digits_are_those_that_the_interval_warrants(given, shown):
    assert with_interval(*given) == shown


def test_a_gauge_that_reads_to_a_tenth_has_no_hundredths():
    assert with_interval(1.234, 1.21, 1.26, most=1) == ("1.2", "1.2", "1.3")


def test_rounding_moves_nothing_by_more_than_a_twentieth_of_the_interval():
    random = np.random.default_rng(5)
    for _ in range(300):
        value = random.normal() * 10.0 ** random.uniform(-3, 4)
        gap = abs(value) * 10.0 ** random.uniform(-2.5, 0.5)
        exact = (value, value - gap, value + gap)
        rounded = [float(text) for text in with_interval(*exact)]
        assert rounded == pytest.approx(exact, abs=0.05 * 2.0 * gap + 1e-12)


def test_a_table_wider_than_the_terminal_is_folded_under_its_first_columns():
    names = [f"{kind} of stage {n}" for n in range(1, 5) for kind in ("value", "error")]
    rows = [["EX1", *(str(n) for n in range(8))], ["CONVERGENCE", *(str(10 * n) for n in range(8))]]
    folded = TextTable(["gauge", *names], rows, right="l" + "r" * 8).folded()
    parts = folded.split("\n\n")
    assert len(parts) == 3
    assert all(len(line) <= WIDTH for line in folded.splitlines())
    for part in parts:
        header, one, other = part.splitlines()
        assert header.startswith("gauge  ")
        assert (one.split()[0], other.split()[0]) == ("EX1", "CONVERGENCE")
    assert [word for part in parts for word in part.splitlines()[1].split()[1:]] == list("01234567")


def test_a_table_that_fits_or_is_empty_is_not_folded():
    table = TextTable(["gauge", "mm"], [["EX1", "1.5"]])
    assert table.folded() == table.text
    assert TextTable(["gauge", "a" * 50, "b" * 50], []).folded() == ""
    wide = TextTable(["gauge", "a" * 90], [["EX1", "1"]])
    assert wide.folded() == wide.text
