"""The stages that a tunnel's own reaction is asked of, and from where its parts are sought."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import make_case
from support.yielding import mohr, parameters, rock

from geoident.forward.openings.mesh_reaction import (
    follow_each_other,
    mean_inwards,
    stages_by_distance,
    tunnel_base,
    wall_of,
    yields_at_tunnel,
)
from geoident.forward.stages import CaseOnMesh
from geoident.model.case import Stage
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar

from .test_advance import profile
from .test_mesh_reaction import UNEVEN, oval, stages, wall_by_hand
from .test_opening_model import MPa, quarter, staged

X = Scalar(1.0)
SOFT, HARD = rock(5e9, 0.25, mohr(MPa, 0.5)), rock(9e9, 0.2, name="hard")


def on(*given, groups=None):
    mesh = quarter(1, 3, 12.0)
    case = make_case(
        mesh, stages=given, groups=groups or {"core": "rock", "rock": "rock"},
        materials={"rock": SOFT, "hard": HARD},
    )  # fmt: skip
    return CaseOnMesh(case, mesh)


WAIT, ONE = Stage("wait"), Stage("one", ("core",), distance=X)
TWO, LINE = Stage("two", distance=X), Stage("line")


@pytest.mark.parametrize(
    ("given", "chain", "follow"),
    [
        ((), [], True),
        ((WAIT,), [], True),
        ((ONE,), [1], True),
        ((WAIT, ONE, LINE, TWO, Stage("three", distance=X)), [2, 4, 5], True),
        ((ONE, TWO, Stage("three", distance=X, base="one")), [1, 2, 3], False),
        ((ONE, Stage("two", ("core",), distance=X, base="virgin")), [1, 2], False),
        ((ONE, Stage("aside", distance=X, independent=True), TWO), [1, 2, 3], False),
        ((ONE, Stage("aside", independent=True), TWO), [1, 3], True),
        ((WAIT, ONE, Stage("two", ("core",), distance=X, base="wait"), LINE), [2, 3], False),
    ],
)
def test_stages_with_a_distance_are_one_sequence(given, chain, follow):
    found = on(*given)
    assert stages_by_distance(found) == chain
    assert follow_each_other(found) == follow


def test_what_is_there_before_the_tunnel():
    assert tunnel_base(on(ONE, TWO)) == 0
    assert tunnel_base(on(WAIT, LINE, ONE, TWO)) == 2
    assert tunnel_base(on(WAIT, LINE, Stage("one", ("core",), distance=X, base="wait"))) == 1
    assert yields_at_tunnel(on(ONE))
    assert not yields_at_tunnel(on(ONE, groups={"core": "hard", "rock": "hard"}))
    change = Stage("soften", change={"rock": "rock"})
    hard = {"core": "hard", "rock": "hard"}
    assert yields_at_tunnel(on(change, ONE, groups=hard))
    assert not yields_at_tunnel(on(ONE, change, groups=hard))


def test_the_mean_motion_of_the_wall_is_that_of_its_lines():
    """Any motion of the nodes, by Simpson's rule; only ground that stays is a wall."""
    mesh = oval(1, 3)
    case = make_case(mesh, stages=(ONE,), groups={"core": "rock", "rock": "rock"},
                     materials={"rock": SOFT})  # fmt: skip
    found = CaseOnMesh(case, mesh)
    assert sum(len(patch.nodes) for patch in wall_of(found, ("core",), 0)) == 2
    motion = np.random.default_rng(4).normal(size=(mesh.n_nodes, 2))
    inwards = mean_inwards(found, ("core",), 0)
    assert inwards @ motion.ravel() == pytest.approx(wall_by_hand(mesh, motion), rel=1e-3)
    assert wall_of(found, ("core", "rock"), 0) == ()


def reaction():
    """The reaction of an oval by a cohesion, and the parts at which it was analysed."""
    c = Scalar(1.0, "c")
    found = staged(
        oval(1, 4), rock(5e9, 0.25, mohr(c, 0.5)), face=profile("chern", conversion="mesh"),
        stages=stages((0.5, 4.0)), parameters=parameters(c=2 * MPa), in_situ=UNEVEN, channels=(),
    )  # fmt: skip
    wall, asked = found.face._wall, []
    moved = wall._moved

    def watched(parts, point):
        asked.append(parts.copy())
        return moved(parts, point)

    wall._moved = watched
    return wall, asked


def at(c):
    return ParameterPoint({"c": c}, ("c",))


def test_parts_are_sought_from_where_the_last_ones_lead():
    wall, asked = reaction()
    shares = [Dual(np.array([share, 0.0])) for share in (0.4, 0.9)]
    first = wall.parts(shares, at(2 * MPa))
    np.testing.assert_array_equal(asked[0], [0.4, 0.9])
    columns = np.array([first[r].columns for r in wall.releases])
    assert wall.parts(shares, at(2 * MPa)).keys() == first.keys()
    plain = wall.parts([Dual(np.array([share])) for share in (0.4, 0.9)],
                       ParameterPoint({"c": 2 * MPa}, ()))  # fmt: skip
    assert [plain[r].columns.tolist() for r in wall.releases] == columns[:, :1].tolist()
    analyses = len(asked)
    near = wall.parts(shares, at(2.01 * MPa))
    np.testing.assert_allclose(asked[analyses], columns @ [1.0, 0.01 * MPa], rtol=1e-12)
    found = np.array([near[r].columns[0] for r in wall.releases])
    np.testing.assert_allclose(found, asked[analyses], rtol=1e-3)
    assert np.abs(columns[:, 1]).max() > 0.0
    # where they would lead beyond all of the stress, from the last ones
    columns = np.array([near[r].columns for r in wall.releases])
    wall._last.columns[:, 1] = 1.0
    analyses = len(asked)
    wall.parts(shares, at(2.02 * MPa))
    np.testing.assert_array_equal(asked[analyses], columns[:, 0])
    wall._last.columns[:, 1] = -1.0
    analyses, columns = len(asked), wall._last.columns[:, 0].copy()
    wall.parts(shares, at(2.03 * MPa))
    np.testing.assert_array_equal(asked[analyses], columns)
    wall.forget()
    analyses = len(asked)
    wall.parts(shares, at(2.03 * MPa))
    np.testing.assert_array_equal(asked[analyses], [0.4, 0.9])


def test_derivatives_that_were_not_known_are_sought():
    wall, asked = reaction()
    shares = [Dual(np.array([share])) for share in (0.4, 0.9)]
    wall.parts(shares, ParameterPoint({"c": 2 * MPa}, ()))
    analyses = len(asked)
    wide = [Dual(np.array([share, 0.0])) for share in (0.4, 0.9)]
    found = wall.parts(wide, at(2 * MPa))
    assert len(asked) > analyses
    assert all(found[r].columns.shape == (2,) for r in wall.releases)
