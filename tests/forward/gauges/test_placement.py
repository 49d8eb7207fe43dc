"""Where gauges stand on the mesh, what is no point of the ground, which stages are not read."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, make_case, material, rollers
from support.force_gauges import gauge
from support.meshes import box, regroup

from geoident.errors import InputError
from geoident.forward.checks import check_on_mesh
from geoident.forward.gauges.placement import placements
from geoident.model.case import Stage
from geoident.model.gauges import Reading, Reads


def _mesh():
    return regroup(
        box("quad4", (6, 4), size=(6.0, 4.0)),
        pit=lambda x: (x[:, 0] < 2.0) & (x[:, 1] > 3.0),
        fill=lambda x: (x[:, 0] > 4.0) & (x[:, 1] > 3.0),
        never=lambda x: (x[:, 0] > 4.0) & (x[:, 1] < 1.0),
    )


def _on_mesh(*channels, readings=()):
    mesh = _mesh()
    case = make_case(
        mesh,
        materials={"rock": material("rock", 1e9, 0.25)},
        groups={"rock": "rock", "pit": "rock", "fill": None, "never": None},
        supports=rollers(2),
        stages=(Stage("dig", excavate=("pit",)), Stage("put", install={"fill": "rock"})),
        channels=channels,
        readings=readings,
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
         "point (5.5, 3.5) m of gauge 'd' lies in 'fill', which is not there at stage 'virgin', "
         "where the gauge is zeroed", HINT),
        (displacement("d", (5.5, 0.5), (1.0, 0.0)),
         "point (5.5, 0.5) m of gauge 'd' lies in 'never', which is not there at stage 'virgin', "
         "where the gauge is zeroed",
         "correct the point, or let it be there: 'install' it"),
        (gauge("stress", "s", (5.5, 0.5), "xx"),
         "point (5.5, 0.5) m of gauge 's' lies in 'never', which is never there",
         "correct the point"),
        (gauge("stress", "s", (5.5, 3.5), "xx", reads=Reads.VIRGIN),
         "point (5.5, 3.5) m of gauge 's' lies in 'fill', which is not there before the first "
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


def test_readings_of_stages_at_which_the_ground_is_not_there_are_refused():
    """Blank and bad ones are not, and those of a faulty gauge are not judged."""
    pit = displacement("pit", (1.5, 3.5), (1.0, 0.0))
    fill = displacement("fill", (5.5, 3.5), (1.0, 0.0), zero="put")
    readings = (
        Reading("pit", "dig", 1e-3),
        Reading("pit", "put", None),
        Reading("pit", "put", 1e-3, bad=True),
        Reading("fill", "dig", 1e-3),
        Reading("fill", "put", 1e-3),
    )
    with pytest.raises(InputError) as error:
        _on_mesh(pit, fill, readings=readings)
    said = [fault.message for fault in error.value.faults]
    assert said == [
        "gauge 'pit' can't have been read at stage 'dig': a point of it lies in excavated ground",
        "gauge 'fill' can't have been read at stage 'dig': it is zeroed only at a later stage",
    ]
    nowhere = displacement("pit", (1.5, 9.0), (1.0, 0.0))
    with pytest.raises(InputError) as error:
        _on_mesh(nowhere, readings=readings[:3])
    assert [fault.code for fault in error.value.faults] == ["gauge-outside"]


@pytest.mark.parametrize(("face", "turn"), [(0, 6.0), (1, 6.0), (2, 4.0)])
def test_how_far_beside_a_curved_face_a_point_may_lie(face, turn):
    """A hundredth of the face, and half as much again as an eighth of its length times the angle.

    The top of a row of three blocks rises by 6 degrees, then by 4 more.
    """
    mesh = box("hex8", (3, 1, 1), size=(3.0, 1.0, 1.0))
    rises = np.tan(np.radians([0.0, 6.0, 10.0]))
    mesh.points[:, 2] += np.interp(mesh.points[:, 0], np.arange(4), [0, *np.cumsum(rises)])
    centre = np.array([face + 0.5, 0.5, 1.0 + rises[:face].sum() + rises[face] / 2])
    normal = np.array([-rises[face], 0.0, 1.0]) / np.hypot(rises[face], 1.0)
    allowed = np.hypot(np.sqrt(2.0), rises[face]) * (0.01 + 1.5 / 8 * np.radians(turn))

    def faults(part):
        point = tuple((centre + part * allowed * normal).tolist())
        case = make_case(
            mesh,
            materials={"rock": material("rock", 1e9, 0.25)},
            groups={"all": "rock"},
            supports=rollers(3),
            channels=(displacement("d", point, (1.0, 0.0, 0.0)),),
        )
        try:
            check_on_mesh(case, mesh)
        except InputError as error:
            return [fault.message for fault in error.faults]
        return []

    assert faults(0.99) == []
    (message,) = faults(1.01)
    assert message.endswith("m outside the mesh, in the air")
