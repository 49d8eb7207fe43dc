"""Readings that are not used are counted in words, one or many."""

from types import SimpleNamespace

import pytest

from geoident.workflow.running.readings import unused_notes


@pytest.mark.parametrize(
    ("number", "said"), [(1, "1 reading is not used: late."), (2, "2 readings are not used: late.")]
)
def test_unused_readings_are_counted(number, said):
    table = SimpleNamespace(unused=range(number), reason=["late"] * number, bad=[False] * number)
    assert unused_notes(table) == (said,)
