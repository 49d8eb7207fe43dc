"""What is kept and said of a face: numbers of the profile, notes, and where nothing is known."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import material
from support.yielding import constant, mohr, rock

from geoident.errors import CollapseError, ModelError
from geoident.forward.openings.advance import (
    chern,
    panet,
    vlachopoulos_diederichs,
)
from geoident.model.case import Stage
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Scalar

from .test_advance import WALL, profile, stages
from .test_mesh_reaction import oval
from .test_opening_model import RADIUS, MPa, quarter, staged, without_mesh

YIELDS = rock(5e9, 0.25, mohr(MPa, 0.5))
PLAIN = material("rock", 5e9, 0.25)
NOWHERE = ParameterPoint({}, ())


def advance(law, distances, **changes):
    opened = without_mesh(PLAIN, face=profile(law), stages=stages(distances), **changes)
    return opened.survey(np.empty(0), fields=True).advance


def test_the_profile_of_elastic_ground_by_hand():
    """R* = 1: s_0 = exp(-0.15) / 3; ahead s_0 exp(x / R), behind 1 - (1 - s_0) exp(-1.5 x / R)."""
    kept = advance("vlachopoulos-diederichs", (-1.0, 0.5, 7.0))
    x, at_face = kept.distance / RADIUS, np.exp(-0.15) / 3
    exact = np.where(x < 0, at_face * np.exp(x), 1 - (1 - at_face) * np.exp(-1.5 * x))
    np.testing.assert_allclose(kept.share, exact, rtol=1e-12)
    np.testing.assert_allclose(kept.stage_released, kept.stage_share, rtol=1e-14)
    x = np.array([-1.0, 0.5, 7.0]) / RADIUS
    own = np.where(x < 0, at_face * np.exp(x), 1 - (1 - at_face) * np.exp(-1.5 * x))
    np.testing.assert_allclose(kept.stage_share, own, rtol=1e-12)


def test_profiles_and_their_slopes_by_all_numbers():
    """Written out with plain numbers, their slopes by differences of fourth order."""

    def numbers(*values):
        n = len(values)
        return [Dual(np.append(v, np.eye(n)[k])) for k, v in enumerate(values)]

    def law_of(x, r):
        s = np.exp(-0.15 * r) / 3
        return s * np.exp(x) if x < 0 else 1 - (1 - s) * np.exp(-1.5 * x / r)

    for dual, plain, at in (
        (vlachopoulos_diederichs, law_of, (-0.7, 2.3)),
        (vlachopoulos_diederichs, law_of, (1.9, 2.3)),
        (panet, lambda x, a, m: a + (1 - a) * (1 - (m / (m + x)) ** 2), (1.7, 0.27, 0.64)),
        (chern, lambda x, r, k: (1 + np.exp(-x / r)) ** -k, (-0.6, 1.3, 1.8)),
    ):
        found = dual(*numbers(*at)).columns
        assert found[0] == pytest.approx(plain(*at), rel=1e-14)
        for k in range(len(at)):
            h = 1e-3 * np.eye(len(at))[k]
            a, b, c, d = (plain(*(np.array(at) + j * h)) for j in (-2, -1, 1, 2))
            assert found[1 + k] == pytest.approx((a - 8 * b + 8 * c - d) / 12e-3, rel=1e-9)


OVERSTRESSED = constant(-10 * MPa, -10 * MPa, -90 * MPa)
"""The stress along the tunnel makes the ground yield, which no formula covers."""


def test_what_is_known_where_the_ground_has_no_final_motion():
    """No collapse is said where only a formula is missing; without fields nothing is raised."""
    settings = {"stages": stages((0.0, 3.0))[:2], "channels": (WALL,), "in_situ": OVERSTRESSED}
    found = without_mesh(YIELDS, face=profile("chern"), **settings)
    with pytest.raises(ModelError, match="has none without support: it yields by") as caught:
        found.face_states({})
    assert not isinstance(caught.value, CollapseError)
    assert "made at stage '0' is not known" in str(caught.value)
    assert "write 'conversion: direct'" in caught.value.hint
    face = profile("vlachopoulos-diederichs", conversion="direct")
    found = without_mesh(YIELDS, face=face, **settings)
    with pytest.raises(ModelError, match="the wall has made at stage '0' is not known"):
        found.face_states({})


def test_what_is_said_where_the_ground_has_no_final_motion():
    """The other stages and the notes go on without the profile."""
    loose = rock(5e9, 0.25, mohr(0.0, 0.5))
    face = profile("vlachopoulos-diederichs")
    free = Stage("free", ("core",), release={"core": Scalar(0.2)}, base="virgin")
    far = (*stages((0.0, 3.0))[:2], free)
    found = without_mesh(loose, face=face, stages=far, channels=(WALL,))
    kept = found.survey(np.empty(0), fields=True, partial=True)
    assert kept.advance is None
    (said,) = kept.notes
    assert said.startswith("the part of its final motion that the wall has made at stage '0' is")
    assert np.isfinite(kept.computed[0]).tolist() == [False, False, True]


def test_the_note_of_stages_has_their_numbers():
    opened = without_mesh(PLAIN, face=profile("panet"), stages=stages((0.0, 3.0)))
    (said,) = opened.survey(np.empty(0), fields=False).notes
    part = 25 + 75 * (1 - (0.75 / 2.25) ** 2)
    assert said == (
        "released by the distance to the face (Panet's profile): 0: 0 m, 25 % of the final motion, "
        f"25 % of the stress; 1: 3 m, {part:.3g} % of the final motion, {part:.3g} % of the stress"
    )
    face = profile("vlachopoulos-diederichs", plastic_radius=Scalar(2.5 * RADIUS))
    opened = without_mesh(PLAIN, face=face, stages=stages((0.0, 3.0)))
    (said,) = opened.survey(np.empty(0), fields=False).notes
    assert "plastic radius 2.5 times that of the tunnel" in said


STEEP = HeimStress(K0=Scalar(1.0), unit_weight=Scalar(0.4 * MPa), surface=Scalar(25.0), held=True)


def test_the_stress_of_the_reaction_is_that_at_the_centre():
    """Of a quarter the centroid is 4 R / (3 pi) from both its sides; else as it is given."""

    def released(mesh, **changes):
        face = profile("chern", **changes)
        found = staged(mesh, YIELDS, face=face, stages=stages((1.5,)), in_situ=STEEP)
        return found.face_states({})[0].released

    mesh, middle = quarter(2, 5, 12.0), 4 * RADIUS / (3 * np.pi)
    own, given_ = released(mesh), released(mesh, centre=(middle, middle))
    assert own == pytest.approx(given_, abs=2e-6)
    deep = released(mesh, centre=(0.0, -3.0))
    assert deep > own + 0.005
    pressure = -0.4 * MPa * 28.0
    even = without_mesh(
        YIELDS, face=profile("chern"), stages=stages((1.5,)), in_situ=constant(*(pressure,) * 3)
    )
    assert deep == pytest.approx(even.face_states({})[0].released, rel=1e-12)


@pytest.mark.parametrize(
    ("stress", "told"),
    [
        ((-10.0, -10.19, -10.0), False),
        ((-10.0, -10.21, -10.0), True),
        ((-10.0, -10.0, -10.0, 0.099), False),
        ((-10.0, -10.0, -10.0, 0.101), True),
        ((-10.0, -10.18, -10.0, 0.1), True),
    ],
)
def test_stress_is_uneven_where_its_principal_ones_are_two_hundredths_apart(stress, told):
    """At half of that the difference of the principal stresses is 1 % from their mean."""
    in_situ = constant(*(s * MPa for s in stress))
    steps = stages((0.0, 3.0))
    found = staged(quarter(2, 5, 12.0), YIELDS, face=profile("chern"), stages=steps,
                   in_situ=in_situ)  # fmt: skip
    (note,) = [n for n in found.notes if n.startswith("distances to the face")]
    assert ("lies in uneven stress" in note) == told
    if len(stress) > 3 and stress[1] != -10.0:
        mean, apart = 10.09, np.hypot(0.09, 0.1)
        assert f"({mean - apart:.3g} and {mean + apart:.3g} MPa at the start values)" in note


@pytest.mark.parametrize(("stretch", "told"), [(1.0935, False), (1.0945, True)])
def test_a_wall_is_not_round_from_two_hundredths_of_its_radius_on(stretch, told):
    """A quarter of an ellipse, about the middle of the circle through it: at 1.0941 they are."""
    even = constant(*(-9 * MPa,) * 3)
    found = staged(oval(stretch=stretch), YIELDS, face=profile("chern"), stages=stages((0.0, 3.0)),
                   in_situ=even)  # fmt: skip
    (note,) = [n for n in found.notes if n.startswith("distances to the face")]
    assert ("is not round" in note) == told


def test_a_wall_that_moves_outwards_has_no_motion_inwards():
    """Ground that is pulled: the opening widens."""
    pulled = constant(*(0.2 * MPa,) * 3)
    found = staged(
        oval(), rock(5e9, 0.25, mohr(9 * MPa, 0.5)), face=profile("chern", conversion="mesh"),
        stages=stages((0.5,))[:1], in_situ=pulled,
    )  # fmt: skip
    with pytest.raises(ModelError, match="the mean convergence is outward") as caught:
        found.survey(np.empty(0), fields=False)
    assert not isinstance(caught.value, CollapseError)


def test_a_case_without_a_face_has_no_profile_and_no_note():
    none = without_mesh(PLAIN).survey(np.empty(0), fields=True)
    assert none.advance is None
    assert none.notes == ()
