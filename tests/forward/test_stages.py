"""Places that are one run are a slice, others are numbered."""

import numpy as np
import pytest

from geoident.forward.stages import as_index, numbers


@pytest.mark.parametrize(
    ("marked", "expected"),
    [
        ([2, 3, 4], slice(2, 5)),
        ([0], slice(0, 1)),
        ([4], slice(4, 5)),
        ([0, 2, 3, 4], None),
        ([0, 2, 3, 5], None),
        ([1, 2, 4], None),
        ([], None),
        (range(6), slice(0, 6)),
    ],
)
def test_only_one_run_is_a_slice(marked, expected):
    mask = np.zeros(6, dtype=bool)
    mask[list(marked)] = True
    found = as_index(mask)
    assert isinstance(found, slice) == (expected is not None)
    if expected is not None:
        assert found == expected
    assert numbers(found, 6).tolist() == list(marked)
