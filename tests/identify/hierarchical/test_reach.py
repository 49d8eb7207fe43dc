"""How far from an estimate a model is asked for its readings, where it has no solution far off."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.identify.hierarchical.bands import _Axes


def side(solved_up_to, sign, *, room=np.inf, found=None):
    """Where the model was asked along axis 3, and what is known of it; v(t) = 7 t, J = 11."""
    asked = []

    def evaluate(points):
        (t,) = points
        asked.append(float(t))
        solved = abs(t) <= solved_up_to
        return [(7.0 * t, np.full((1, 1), 11.0)) if solved else None]

    def point(k, t):
        assert k == 3
        return np.array(t)

    axes = SimpleNamespace(
        point=point,
        reach=lambda k, t: float(np.clip(t, -room, room)),
        slope=lambda J, k, p: J[:, 0] + p,
    )
    return asked, _Axes.side(axes, evaluate, found, 3, sign)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("solved", [1.0, 0.5, 0.25])
def test_the_way_is_halved_until_there_is_a_solution(sign, solved):
    """Beginning with half of two standard deviations, where the first answer was none."""
    asked, found = side(solved, sign)
    assert asked == [sign * t for t in (1.0, 0.5, 0.25) if t >= solved]
    assert (found.t, found.v) == (asked[-1], 7.0 * asked[-1])
    assert found.slope.tolist() == [11.0 + asked[-1]]


def test_three_halvings_are_enough():
    asked, found = side(0.1, 1.0)
    assert (asked, found) == ([1.0, 0.5, 0.25], None)


def test_what_is_known_is_not_asked_again_and_no_way_is_none():
    known = (np.array([5.0]), np.full((1, 1), 2.0))
    asked, found = side(0.0, -1.0, found=known)
    assert asked == []
    assert (found.t, found.v.tolist(), found.slope.tolist()) == (-2.0, [5.0], [0.0])
    assert side(0.0, 1.0, found=known, room=1e-7)[1] is None
    assert side(0.0, 1.0, found=known, room=1e-5)[1].t == 1e-5
