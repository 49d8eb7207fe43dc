"""Readings that are not used are counted in words, one or many."""

from types import SimpleNamespace

import pytest
from support.trench import CASE, READINGS, write_case

from geoident import fit
from geoident.io.result.file import read_result
from geoident.workflow.running.readings import unused_notes


@pytest.mark.parametrize(
    ("number", "said"), [(1, "1 reading is not used: late."), (2, "2 readings are not used: late.")]
)
def test_unused_readings_are_counted(number, said):
    table = SimpleNamespace(unused=range(number), reason=["late"] * number, bad=[False] * number)
    assert unused_notes(table) == (said,)


def test_the_zero_of_a_gauge_is_no_reading_that_a_fit_uses(tmp_path):
    """It is 0 by definition; what else was read at that stage is a reading, and so is a stress."""
    path = write_case(tmp_path)
    cell = "  PC: {kind: pressure-cell, point: [1 m, 2 m], normal: [1, 0], accuracy: 10 kPa}\n"
    for old, new in (
        ("point: [1 m, 4 m], accuracy", "point: [1 m, 4 m], zero: first, accuracy"),
        ("head: [2 m, 3 m]", "zero: first, head: [2 m, 3 m]"),
        ("readings: readings.csv", f"{cell}readings: readings.csv"),
        ("stages: [first], ", ""),
    ):
        assert old in CASE
        path.write_text(path.read_text().replace(old, new))
    text = READINGS.replace("S,first,-0.1226", "S,first,0").replace(
        "X.a,first,0.0627", "X.a,first,0.002"
    )
    (tmp_path / "readings.csv").write_text(f"{text}PC,first,0,MPa\n")
    fit(str(path), output=str(tmp_path / "a.h5"))
    found = read_result(tmp_path / "a.h5")
    readings = found.gauges.readings
    unused = {(*readings.pairs[k], readings.reason[k]) for k in readings.unused}
    assert unused == {("S", "first", "it is zeroed at this stage")}
    assert "1 reading is not used: it is zeroed at this stage." in found.notes
