"""Elements numbered the other way round are mended, folded ones refused by their number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.meshes import KINDS, box

from geoident.errors import InputError
from geoident.fem.kinematics import PLANE_STRAIN, SOLID, block_geometry
from geoident.fem.orientation import oriented
from geoident.model.cells import CELLS

# Node by node what a mirror makes of the first rows of the tables of VTK.
MIRRORED = {
    "tri3": (0, 2, 1),
    "tri6": (0, 2, 1, 5, 4, 3),
    "tet4": (0, 2, 1, 3),
    "wedge6": (0, 2, 1, 3, 5, 4),
    "wedge15": (0, 2, 1, 3, 5, 4, 8, 7, 6, 11, 10, 9, 12, 14, 13),
    "pyramid5": (0, 3, 2, 1, 4),
    "pyramid13": (0, 3, 2, 1, 4, 8, 7, 6, 5, 9, 12, 11, 10),
}


def kinematics_of(mesh):
    return PLANE_STRAIN if mesh.dim == 2 else SOLID


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_mesh_stays_as_it_is(kind):
    mesh = box(kind, (2,) * CELLS[kind].dim, distortion=0.2)
    assert oriented(mesh, kinematics_of(mesh)).blocks[0] is mesh.blocks[0]


@pytest.mark.parametrize("kind", MIRRORED)
def test_turned_elements_are_turned_back(kind):
    mesh = box(kind, (2,) * CELLS[kind].dim, distortion=0.2)
    block = mesh.blocks[0]
    nodes = block.nodes.copy()
    nodes[::2] = nodes[::2][:, MIRRORED[kind]]
    turned = replace(mesh, blocks=(replace(block, nodes=nodes),))
    mended = oriented(turned, kinematics_of(mesh))
    np.testing.assert_array_equal(mended.blocks[0].nodes, block.nodes)
    volumes = block_geometry(mesh.points, mended.blocks[0], kinematics_of(mesh)).volumes
    assert np.all(volumes > 0)
    assert volumes.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("kind", "swap"), [("wedge6", (1, 4)), ("pyramid5", (2, 3))])
def test_folded_elements_are_refused_by_number(kind, swap):
    mesh = box(kind, (2, 2, 2))
    block = mesh.blocks[0]
    nodes = block.nodes.copy()
    nodes[7, list(swap)] = nodes[7, list(swap)][::-1]
    folded = replace(mesh, blocks=(replace(block, nodes=nodes),))
    with pytest.raises(InputError) as caught:
        oriented(folded, SOLID)
    (fault,) = caught.value.faults
    assert fault.code == "folded-element"
    x, y, z = mesh.points[nodes[7]].mean(axis=0)
    assert fault.message == (
        f"{kind} elements {block.numbers[7]} are folded or flat (the first near "
        f"({x:.6g}, {y:.6g}, {z:.6g}) m)"
    )
    assert fault.hint == (
        "check the mesh there: nodes numbered across, mid-nodes too far off, or zero thickness"
    )


def test_a_flat_pyramid_is_refused():
    mesh = box("pyramid5", (1, 1, 1))
    points = mesh.points.copy()
    points[-1] = points[mesh.blocks[0].nodes[2, :4]].mean(axis=0)  # the apex in the base of one
    with pytest.raises(InputError, match="folded or flat"):
        oriented(replace(mesh, points=points), SOLID)
