"""How far ground yields, in numbers: against the closed form of an opening, and at a flat wall."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.meshes import box, regroup
from support.yielding import NOTHING, Cavity, constant, mohr, mohr_limit, rock

from geoident.forward.yielding.extent import YieldRecorder, circle_centre
from geoident.model.case import Stage
from geoident.model.parameter import Scalar
from geoident.report.text.extent import extent_sentence, extent_table
from geoident.report.text.rows import objects

CAVITY, C, PHI = Cavity(), 3.45e6, np.pi / 6


def test_plastic_radius_and_area_of_an_opening():
    stages = (
        Stage("half", excavate=("core",), release={"core": Scalar(0.8)}),
        Stage("whole", release={"core": Scalar(1.0)}),
    )
    mesh = CAVITY.mesh("quad8", n=4, layers=60, reach=40)
    staged = CAVITY.staged(mesh, mohr(C, PHI, psi=0.0), stages=stages)
    found = staged.survey(NOTHING, fields=True).yielded
    assert found.states == ("virgin", "half", "whole")
    assert found.unit == "m2"
    assert (found.volume[0], found.share[0]) == (0.0, 0.0)
    assert np.isnan([found.reach[0], found.radius[0], *found.lower[0]]).all()
    for k, released in ((1, 0.8), (2, 1.0)):
        state = CAVITY.closed_form(mohr_limit(C, PHI, 0.0), released)
        radius = float(state.plastic_radius.value)
        assert radius > 1.05
        assert found.radius[k] == pytest.approx(radius, rel=0.025)
        assert found.reach[k] == pytest.approx(found.radius[k] - 1.0, abs=3e-3)
        assert found.volume[k] == pytest.approx(np.pi / 4 * (radius**2 - 1.0), rel=0.06)
        np.testing.assert_allclose(found.upper[k], found.radius[k], rtol=0.01)
    assert found.most == 2
    said = extent_sentence(found)
    assert said.startswith("Yielded ground: ")
    assert f"at stage 'whole', up to {found.radius[2]:.3g} m from the centre." in said
    table = extent_table(found)
    assert [row[0] for row in table.rows] == ["half", "whole"]
    assert table.header == (
        "stage", "m2", "of the ground", "from the wall", "from the centre", "x", "y"
    )  # fmt: skip
    listed = objects(found, "state")
    assert listed[0] == {
        "stage": "virgin", "volume": 0.0, "share": 0.0, "from_excavation": None,
        "from_centre": None, "lower": [None, None], "upper": [None, None],
    }  # fmt: skip
    assert listed[2]["from_centre"] == pytest.approx(found.radius[2])


def pit(**changes):
    """Ground of 4 m by 4 m, the upper half in the strata of 'soil'; the right of it is dug."""
    mesh = regroup(
        box("quad8", (4, 4), size=(4.0, 4.0)),
        dug=lambda c: (c[:, 1] > 2) & (c[:, 0] > 2),
        soil=lambda c: c[:, 1] > 2,
    )
    settings = {
        "materials": {
            "soil": rock(3e7, 0.3, mohr(3.5e3, 0.3), name="soil"),
            "rock": rock(3e9, 0.3, mohr(1e8, 0.3), name="rock"),
        },
        "groups": {"dug": "soil", "soil": "soil", "rock": "rock"},
        "supports": rollers(2),
        "in_situ": constant(-1e4, -1e4, -1e4),
        "stages": (Stage("dig", excavate=("dug",)),),
    }
    return model(mesh, **(settings | changes))


def test_a_flat_wall_has_a_reach_but_no_centre():
    found = pit().survey(NOTHING, fields=True).yielded
    assert found.volume[1] > 0.1
    assert np.isnan(found.radius[1])
    assert found.reach[1] == pytest.approx(2.0 - found.lower[1, 0], abs=1e-9)
    able = 4.0 * 4.0 - 4.0
    assert found.share[1] == pytest.approx(found.volume[1] / able)
    assert "m from the excavation." in extent_sentence(found)
    assert "from the centre" not in extent_table(found).header


def test_what_cannot_yield_is_not_asked():
    elastic = {
        "soil": rock(3e7, 0.3, name="soil"),
        "rock": rock(3e9, 0.3, name="rock"),
    }
    staged = pit(materials=elastic)
    assert staged.survey(NOTHING, fields=True).yielded is None
    assert pit().survey(NOTHING, fields=False).yielded is None
    assert extent_sentence(None) == ""
    assert extent_table(None).text == ""


@pytest.mark.parametrize(
    "after",
    [Stage("renew", install={"soil": "rock"}), Stage("clear", excavate=("soil",))],
    ids=lambda stage: stage.name,
)
def test_what_was_placed_anew_has_not_yielded_and_what_is_gone_does_not_count(after):
    again = (Stage("dig", excavate=("dug",)), after)
    found = pit(stages=again).survey(NOTHING, fields=True).yielded
    assert found.volume[1] > 0.1
    assert found.volume[2] == 0.0


def test_a_stage_that_collapses_has_no_numbers():
    weak = {
        "soil": rock(3e7, 0.3, mohr(10.0, 0.01), name="soil"),
        "rock": rock(3e9, 0.3, mohr(1e8, 0.3), name="rock"),
    }
    stages = (Stage("wait"), Stage("dig", excavate=("dug",)))
    corner = displacement("D", (0.0, 4.0), (0.0, -1.0))
    staged = pit(materials=weak, stages=stages, channels=(corner,))
    survey = staged.survey(NOTHING, fields=True, partial=True)
    assert len(survey.collapses) == 1
    assert np.isnan(survey.yielded.volume[2])
    assert survey.yielded.most is None


def recorded(staged, masks, lost=()):
    """The table of strain points that are said to yield, state by state."""
    recorder = YieldRecorder(staged.on_mesh)
    for number, mask in enumerate(masks):
        recorder.add(number, mask, known=number not in lost)
    return recorder.table()


def test_numbers_of_points_that_yield_in_a_solid():
    """A box of 3 m with a corner of 1 m dug; which points yield is said, so all is by hand."""
    mesh = regroup(
        box("hex8", (3, 3, 3), size=(3.0, 3.0, 3.0)),
        dug=lambda c: c.max(axis=1) < 1.0,
        steel=lambda c: c[:, 2] > 2.0,
    )
    staged = model(
        mesh,
        materials={"rock": rock(1e9, 0.3, mohr(1e6, 0.3)), "steel": rock(1e9, 0.3)},
        groups={"dug": "rock", "rock": "rock", "steel": "steel"},
        supports=rollers(3),
        stages=(
            Stage("dig", excavate=("dug",)),
            Stage("more"),
            Stage("renew", install={"rock": "rock"}),
            Stage("aside", base="dig"),
        ),
    )
    points = staged.discretization.points
    position, element = points.position, points.element
    some = (position[:, 0] > 1.0) & (position.max(axis=1) < 2.0) & (position[:, 1] < 1.0)
    other = (position[:, 0] > 2.0) & (position[:, 1] > 1.0) & (position[:, 2] < 1.0)
    nothing = np.zeros(len(position), dtype=bool)
    gone = np.isin(element, mesh.groups["dug"])
    steel = np.isin(element, mesh.groups["steel"])
    found = recorded(staged, [nothing, some | gone | steel, other, nothing, other], lost=(3,))
    assert found.states == ("virgin", "dig", "more", "renew", "aside")
    assert found.unit == "m3"
    both = some | other
    expected = {1: some, 2: both, 4: both}
    for state, mask in expected.items():
        volume = points.volume[mask].sum()
        assert found.volume[state] == pytest.approx(volume, rel=1e-12)
        assert found.share[state] == pytest.approx(volume / 17.0, rel=1e-12)
        np.testing.assert_array_equal(found.lower[state], position[mask].min(axis=0))
        np.testing.assert_array_equal(found.upper[state], position[mask].max(axis=0))
        away = np.linalg.norm(np.maximum(position[mask] - 1.0, 0.0), axis=1)
        assert found.reach[state] == pytest.approx(away.max(), rel=1e-12)
    assert np.isnan(found.radius).all()
    assert (found.volume[0], found.share[0]) == (0.0, 0.0)
    assert np.isnan([found.reach[0], *found.lower[0], *found.upper[0]]).all()
    assert found.lower.shape == found.upper.shape == (5, 3)
    row = [found.volume[3], found.share[3], found.reach[3], *found.lower[3], *found.upper[3]]
    assert np.isnan(row).all()


def arc(count, angle, radius=2.0):
    turns = np.linspace(0.0, angle, count)
    return np.array([5.0, 7.0]) + radius * np.column_stack([np.cos(turns), np.sin(turns)])


def test_circles_are_told_from_other_outlines():
    """Eight points, a radius of at most twice the extent, and within a hundredth of the radius."""
    assert circle_centre(arc(7, 3.0)) is None
    np.testing.assert_allclose(circle_centre(arc(8, 3.0)), [5.0, 7.0], atol=1e-12)
    flat = np.column_stack([np.linspace(0, 1, 12), np.zeros(12)])
    assert circle_centre(flat) is None
    assert circle_centre(flat + [0.0, 1e-9] * np.arange(12)[:, None] ** 2) is None
    square = np.array([[x, y] for x in np.linspace(-1, 1, 9) for y in (-1.0, 1.0)])
    assert circle_centre(square) is None
    # a chord c of an angle has the extent c, and the radius c / (2 sin(angle / 2))
    for angle, is_round in ((2 * np.arcsin(0.26), True), (2 * np.arcsin(0.24), False)):
        assert (circle_centre(arc(30, angle)) is not None) == is_round
    rough = np.where(np.arange(40) % 2, 1.0, -1.0)[:, None] * (arc(40, 6.2) - [5.0, 7.0])
    for part, is_round in ((0.0095, True), (0.0105, False)):
        assert (circle_centre(arc(40, 6.2) + part * rough) is not None) == is_round
