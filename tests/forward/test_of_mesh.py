"""What was found of a mesh is found once, as long as the mesh is there and is the one asked of."""

from __future__ import annotations

import numpy as np

from geoident.forward.of_mesh import OfMesh
from geoident.model.mesh import Mesh


class Finder:
    """Finds a number anew at each call."""

    def __init__(self):
        self.found = 0

    def __call__(self):
        self.found += 1
        return [self.found]


def mesh() -> Mesh:
    return Mesh(np.empty((0, 2)), ())


def test_the_same_question_is_answered_once():
    known, find, one = OfMesh[list](), Finder(), mesh()
    first, other = known(one, "a", find), known(one, "b", find)
    assert (first, other) == ([1], [2])
    assert known(one, "a", find) is first
    assert known(one, "b", find) is other


def test_another_mesh_takes_the_place_of_the_last():
    known, find, one, two = OfMesh[list](), Finder(), mesh(), mesh()
    assert known(one, "a", find) == [1]
    assert known(two, "a", find) == [2]
    assert known(two, "a", find) == [2]
    assert known(one, "a", find) == [3]
