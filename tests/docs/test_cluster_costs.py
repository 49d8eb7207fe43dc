"""What 10,000 fits on 100 nodes cost is reckoned from figures that the manual has elsewhere."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "geoident" / "docs"
PAGE = (DOCS / "how-to" / "cluster.md").read_text(encoding="utf-8")


def number(pattern, text=PAGE):
    found = re.search(pattern, text)
    assert found, pattern
    return float(found[1].replace(",", ""))


def test_a_campaign_on_100_nodes_is_reckoned_from_what_was_measured():
    speed = (DOCS / "speed.md").read_text(encoding="utf-8")
    t = number(r"t = ([\d.]+) s \(\[how fast\]")
    row = r"cases/tunnel-3d: whole fit[^|]*\| "
    assert t == number(row + r"([\d.]+) \(", speed)
    assert number(r"([\d.]+) GB a run") == number(row + r"[\d.]+ \([\d.]+\) s, ([\d.]+) GB", speed)
    runs, at_a_time = 10_000, number(r"\(W = (\d+),")
    c = number(r"time\): c \| \| ([\d.]+) ms") / 1e3
    a = number(r"time\): a \| \| ([\d.]+) ms") / 1e3
    size = number(r"A = (\d+) MB")
    fetched = number(r"F = ([\d.]+) MB")
    parts = {
        r"runs: .* \| ([\d,]+) s": runs * t / at_a_time,
        r"files: .* \| ([\d,]+) s": 0.025 * fetched * at_a_time,
        r"\| scheduler and command: .* \| ([\d,]+) s": runs * c,
        r"\| answers in the command: .* \| ([\d,]+) s": runs * a * size,
        r"on a disk of 200 MB/s \| ([\d,]+) s": runs * size / 200.0,
    }
    for pattern, value in parts.items():
        assert number(pattern) == pytest.approx(value, rel=0.02), pattern
    assert number(r"W = t / c, ([\d,]+) runs") == pytest.approx(t / c, rel=0.03)
    assert number(r"\(c \+ a A\) = ([\d,]+)") == pytest.approx(t / (c + a * size), rel=0.03)
    slow = t / (c + a * size + size / 200.0)
    assert number(r"A / disk\) = ([\d,]+)") == pytest.approx(slow, rel=0.03)
    files, serial = parts[r"files: .* \| ([\d,]+) s"], runs * (c + a * size)
    for disk, pattern in ((200.0, r"about (\d+) minutes"), (500.0, r"(\d+) minutes on a disk")):
        minutes = (files + serial + runs * size / disk) / 60.0
        assert number(pattern) == pytest.approx(minutes, abs=0.6), disk
