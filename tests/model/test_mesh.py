"""Walking through the blocks of a mesh: elements are counted through all of them."""

from __future__ import annotations

import numpy as np

from geoident.model.mesh import ElementBlock, nodes_in, rows_in, spans


def blocks():
    """Two triangles, no quadrilateral, three lines."""
    return (
        ElementBlock("tri3", np.array([[0, 1, 2], [2, 1, 3]]), np.array([11, 12])),
        ElementBlock("quad4", np.empty((0, 4), dtype=np.int64), np.empty(0, dtype=np.int64)),
        ElementBlock("line2", np.array([[7, 8], [8, 9], [9, 5]]), np.array([1, 2, 3])),
    )


def test_spans_count_through_all_blocks():
    assert [span for _, span in spans(blocks())] == [slice(0, 2), slice(2, 2), slice(2, 5)]


def test_rows_stand_in_the_order_in_which_elements_are_asked_for():
    found = [rows.tolist() for _, rows in rows_in(blocks(), np.array([4, 1, 2, 0]))]
    assert found == [[1, 0], [], [2, 0]]
    mask = np.array([False, True, True, False, True])
    assert [rows.tolist() for _, rows in rows_in(blocks(), mask)] == [[1], [], [0, 2]]


def test_nodes_of_elements_stand_once_in_ascending_order():
    assert nodes_in(blocks(), np.array([4, 3, 0])).tolist() == [0, 1, 2, 5, 8, 9]
    assert nodes_in(blocks(), np.zeros(5, dtype=bool)).tolist() == []
    assert nodes_in((), np.empty(0, dtype=np.int64)).dtype == np.int64
