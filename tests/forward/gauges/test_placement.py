"""From when to when a point stands in its ground: sequences of stages by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, rollers
from support.force_gauges import gauge
from support.meshes import box, regroup

from geoident.errors import InputError
from geoident.forward.checks import check_on_mesh
from geoident.forward.gauges.placement import (
    best_site,
    from_zero,
    is_placed_after,
    placements,
)
from geoident.model.case import Stage
from geoident.model.gauges import Reads


def _sequence(*materials, bases, groups=("rock", "fill", "late")):
    """States with the groups that are there, by number, each built on another."""
    history = []
    for n, base in enumerate(bases):
        history.append({n} | (history[base] if n else set()))
    count = len(bases)
    built_on = np.array([[i in history[j] for j in range(count)] for i in range(count)])
    states = [SimpleNamespace(materials=dict.fromkeys(m, "rock")) for m in materials]
    return SimpleNamespace(states=states, built_on=built_on, groups=groups,
                           group_of=np.array([0, 1, 2, 1]))  # fmt: skip


# virgin; all but fill; fill placed; a load case beside it without rock; rock alone; late placed
SEQUENCE = _sequence({0, 1}, {0}, {0, 1}, {1}, {0}, {0, 2}, bases=(0, 0, 1, 2, 2, 4))
SITES = tuple(SimpleNamespace(element=n, outside=0.0) for n in range(4))


@pytest.mark.parametrize(
    ("element", "zero", "there"),
    [
        (0, 0, [1, 1, 1, 0, 1, 1]),
        (0, 2, [0, 0, 1, 0, 1, 1]),
        (1, 2, [0, 0, 1, 1, 0, 0]),
        (1, 0, [1, 0, 0, 0, 0, 0]),
        (2, 5, [0, 0, 0, 0, 0, 1]),
        (3, 3, [0, 0, 0, 1, 0, 0]),
    ],
)
def test_ground_that_stays_from_the_zero_on(element, zero, there):
    site, found = best_site(SITES[element : element + 1], SEQUENCE, zero)
    assert site is SITES[element]
    assert found.astype(int).tolist() == there
    assert not is_placed_after(SEQUENCE, zero, site)


@pytest.mark.parametrize(
    ("element", "zero", "there"),
    [(1, 1, [0, 1, 1, 1, 0, 0]), (2, 4, [0, 0, 0, 0, 1, 1]), (2, 3, None), (2, 1, None)],
)
def test_ground_that_is_placed_right_after_the_zero_counts_as_built(element, zero, there):
    site, found = best_site(SITES[element : element + 1], SEQUENCE, zero)
    if there is None:
        assert site is None
        assert not found.any()
    else:
        assert site is SITES[element]
        assert found.astype(int).tolist() == there
        assert is_placed_after(SEQUENCE, zero, site)
    refused, never = best_site(SITES[element : element + 1], SEQUENCE, zero, as_built=False)
    assert refused is None
    assert not never.any()


def test_of_several_elements_the_one_that_stays_longest_is_taken():
    assert best_site(SITES, SEQUENCE, 0)[0] is SITES[0]
    assert best_site(SITES[::-1], SEQUENCE, 2)[0] is SITES[0]
    assert best_site((SITES[3], SITES[1]), SEQUENCE, 2)[0] is SITES[3]  # the first of equals
    assert best_site((SITES[1], SITES[0]), SEQUENCE, 1)[0] is SITES[0]  # there at the zero
    nothing, never = best_site((), SEQUENCE, 0)
    assert nothing is None
    assert never.shape == (6,)


def test_values_are_read_at_any_state_and_changes_from_the_zero_on():
    channel = displacement("d", (0.0, 0.0), (1.0, 0.0), zero="two")
    on_mesh = SimpleNamespace(
        sequence=SimpleNamespace(states=[None] * 4), case=SimpleNamespace(zero_of=lambda _: 2)
    )
    assert from_zero(on_mesh, channel).tolist() == [False, False, True, True]
    value = gauge("stress", "s", (0.0, 0.0), "xx")
    assert from_zero(on_mesh, value).tolist() == [True] * 4


def _mesh():
    return regroup(
        box("quad4", (6, 4), size=(6.0, 4.0)),
        pit=lambda x: (x[:, 0] < 2.0) & (x[:, 1] > 3.0),
        fill=lambda x: (x[:, 0] > 4.0) & (x[:, 1] > 3.0),
        never=lambda x: (x[:, 0] > 4.0) & (x[:, 1] < 1.0),
    )


def _on_mesh(*channels):
    mesh = _mesh()
    case = make_case(
        mesh,
        materials={"rock": material("rock", 1e9, 0.25)},
        groups={"rock": "rock", "pit": "rock", "fill": None, "never": None},
        supports=rollers(2),
        stages=(Stage("dig", excavate=("pit",)), Stage("put", install={"fill": "rock"})),
        channels=channels,
    )
    return check_on_mesh(case, mesh)[0]


def test_where_gauges_stand_and_how_far_from_what_is_dug():
    """The pit reaches to x = 2 and down to y = 3; its top and left side are no walls."""
    on_mesh = _on_mesh(
        displacement("a", (3.5, 1.5), (1.0, 0.0)),
        displacement("b", (3.5, 1.5), (0.0, 1.0)),
        displacement("c", (3.5, 1.5), (0.0, 1.0), zero="dig"),
        displacement("d", (1.5, 3.5), (1.0, 0.0)),
        displacement("e", (5.5, 3.5), (1.0, 0.0), zero="put"),
    )
    found = {place.channels: place for place in placements(on_mesh)}
    assert list(found) == [("a", "b"), ("c",), ("d",), ("e",)]
    away = [place.distance for place in found.values()]
    np.testing.assert_allclose(away, [np.hypot(1.5, 1.5), np.hypot(1.5, 1.5), 0.5, 3.5])
    assert [place.group for place in found.values()] == ["rock", "rock", "pit", "fill"]
    assert found["a", "b"].point == (3.5, 1.5)
    centres = on_mesh.mesh.points[on_mesh.mesh.blocks[0].nodes].mean(axis=1)
    numbers = on_mesh.mesh.blocks[0].numbers
    for place in found.values():
        element = int(np.linalg.norm(centres - place.point, axis=1).argmin())
        assert place.element == numbers[element]


HINT = ("set 'zero' to 'put', which places that ground, or to 'dig' before it: then what its own "
        "placing does counts, too")  # fmt: skip


@pytest.mark.parametrize(
    ("channel", "said", "hint"),
    [
        (displacement("d", (5.5, 3.5), (1.0, 0.0)),
         "point (5.5, 3.5) m of gauge 'd' stands in 'fill', which is not there at stage 'virgin', "
         "where the gauge is zeroed", HINT),
        (displacement("d", (5.5, 0.5), (1.0, 0.0)),
         "point (5.5, 0.5) m of gauge 'd' stands in 'never', which is not there at stage 'virgin', "
         "where the gauge is zeroed",
         "correct the point, or let it be there: 'install' it"),
        (gauge("stress", "s", (5.5, 0.5), "xx"),
         "point (5.5, 0.5) m of gauge 's' stands in 'never', which is never there",
         "correct the point"),
        (gauge("stress", "s", (5.5, 3.5), "xx", reads=Reads.VIRGIN),
         "point (5.5, 3.5) m of gauge 's' stands in 'fill', which is not there before the first "
         "stage, when it is read", "correct the point"),
        (displacement("d", (7.5, 9.0), (1.0, 0.0)),
         "point (7.5, 9) m of gauge 'd' lies outside the mesh",
         "the mesh reaches from (0, 0) m to (6, 4) m"),
        (gauge("strain", "e", (7.5, 9.0), "xx"),
         "point (7.5, 9) m of gauge 'e' lies outside the mesh",
         "the mesh reaches from (0, 0) m to (6, 4) m"),
    ],
)  # fmt: skip
def test_why_a_point_stands_in_no_ground(channel, said, hint):
    with pytest.raises(InputError) as error:
        _on_mesh(channel)
    (fault,) = error.value.faults
    assert fault.message == said
    assert fault.hint == hint
    assert fault.path == f"gauges.{channel.name}"
