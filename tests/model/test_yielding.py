"""What yield surfaces know of themselves: their words, and the numbers on which they depend."""

import pytest

from geoident.model.ground import Attitude, Axes
from geoident.model.parameter import Scalar
from geoident.model.yielding import DruckerPrager, GivenPlanes, MohrCoulomb, WeakPlane, YieldPlane

C, PHI, CUT = Scalar(1.0, "c"), Scalar(0.5, "phi"), Scalar(2e5)
PLANES = GivenPlanes((YieldPlane("a", (1.0, 0, 0, 0, 0, 0), Scalar(1.0, "k")),), Scalar(3.0))
DIPPING = WeakPlane(Attitude(Scalar(1.0, "dip"), Scalar(0.0)), C, PHI)


@pytest.mark.parametrize(
    ("surface", "words"),
    [
        (PLANES, "given planes"),
        (DIPPING, "a weak plane"),
        (MohrCoulomb(C, PHI), "Mohr-Coulomb, exact, with associated flow"),
        (MohrCoulomb(C, PHI, Scalar(0.1)), "Mohr-Coulomb, exact, with its own dilation"),
        (MohrCoulomb(C, Scalar(0.0), planes=16), "Tresca (best fit)"),
        (
            MohrCoulomb(C, PHI, None, CUT, 16, "inscribed"),
            "Mohr-Coulomb with a tension cut-off (inscribed fit)",
        ),
        (
            DruckerPrager(C, PHI, "outer", CUT),
            "Drucker-Prager's cone with a tension cut-off (best fit)",
        ),
    ],
)
def test_it_is_described_in_words(surface, words):
    assert surface.description == words


def test_it_knows_all_numbers_on_which_its_planes_depend():
    assert PLANES.numbers == (Scalar(3.0), Scalar(1.0, "k"))
    assert {number.parameter for number in DIPPING.numbers} == {"c", "phi", "dip", None}
    assert WeakPlane(Axes((1, 0, 0), (0, 1, 0)), C, PHI).numbers == (C, PHI)
    assert MohrCoulomb(C, PHI, Scalar(0.0), CUT).numbers == (C, PHI, Scalar(0.0), CUT)
