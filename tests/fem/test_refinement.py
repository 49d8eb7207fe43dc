"""Refined meshes: the same body, twice as fine, with the same groups."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.fem.faces import face_table, nonconforming, patches
from geoident.fem.kinematics import kinematics_of
from geoident.fem.measure import coinciding_nodes, element_volumes
from geoident.fem.orientation import oriented, overlapping, turned_elements
from geoident.fem.refinement.finer import halved, n_raised, raised
from geoident.model.case import Analysis
from geoident.model.cells import CELLS
from tests.support.meshes import KINDS, KINDS_2D, box, opening

CHILDREN = {"tri": 4, "quad": 4, "tet": 8, "hex": 8, "wedge": 8, "pyramid": 10}


def of(mesh):
    return kinematics_of(Analysis.SOLID if mesh.dim == 3 else Analysis.PLANE_STRAIN)


@pytest.mark.parametrize("kind", KINDS)
def test_the_refined_body_is_the_same_and_sound(kind):
    mesh = box(kind, (3, 2) if kind in KINDS_2D else (2, 2, 2), distortion=0.15)
    fine = halved(mesh)
    assert fine.n_elements == CHILDREN[CELLS[kind].shape.name] * mesh.n_elements
    np.testing.assert_array_equal(fine.points[: mesh.n_nodes], mesh.points)
    kinematics = of(mesh)
    assert len(turned_elements(fine, oriented(fine, kinematics))) == 0  # none folded either
    table = face_table(fine)
    assert len(overlapping(fine, table)) == 0
    assert len(coinciding_nodes(fine)) == 0
    assert len(nonconforming(fine, table)) == 0
    # every face inside has two elements, so the free ones are those of the box
    free = patches(fine, table, table.free(np.ones(fine.n_elements, bool)))
    corners = [fine.points[p.nodes[:, : CELLS[p.kind].n_corners]] for p in free]
    for at in corners:
        assert np.all(np.any(np.all((at == 0.0) | (np.abs(at - 1.0) < 1e-12), axis=1), axis=1))
    volume = element_volumes(fine, kinematics)
    coarse = element_volumes(mesh, kinematics)
    assert volume.sum() == pytest.approx(coarse.sum(), rel=1e-12)
    assert len(fine.facets) == len({p.kind for p in free})
    for name, group in mesh.facet_groups.items():
        assert len(fine.facet_groups[name]) == (2 if mesh.dim == 2 else 4) * len(group)
    assert set(np.unique(np.concatenate([b.nodes.ravel() for b in fine.blocks]))) == set(
        range(fine.n_nodes)
    )


@pytest.mark.parametrize("kind", [kind for kind in KINDS if CELLS[kind].order == 1])
def test_a_node_on_every_edge_makes_elements_of_second_order(kind):
    """As many as there were, with straight edges and the same groups."""
    n = (3, 2) if kind in KINDS_2D else (2, 2, 2)
    mesh = box(kind, n, distortion=0.15)
    fine = raised(mesh)
    second = next(
        c.kind for c in CELLS.values()
        if c.shape is CELLS[kind].shape and c.order == 2 and c.usable
    )  # fmt: skip
    assert [block.kind for block in fine.blocks] == [second]
    assert fine.n_elements == mesh.n_elements
    assert fine.n_nodes == n_raised(mesh) == box(second, n).n_nodes
    np.testing.assert_array_equal(fine.points[: mesh.n_nodes], mesh.points)
    nodes, corners = fine.blocks[0].nodes, CELLS[kind].n_corners
    np.testing.assert_array_equal(nodes[:, :corners], mesh.blocks[0].nodes)
    for k, (a, b) in enumerate(CELLS[second].edges):
        middle = 0.5 * (fine.points[nodes[:, a]] + fine.points[nodes[:, b]])
        np.testing.assert_allclose(fine.points[nodes[:, corners + k]], middle, atol=1e-12)
    kinematics = of(mesh)
    assert len(turned_elements(fine, oriented(fine, kinematics))) == 0
    assert len(coinciding_nodes(fine)) == 0
    assert element_volumes(fine, kinematics).sum() == pytest.approx(1.0)
    for name, group in mesh.facet_groups.items():
        assert fine.facet_groups[name].tolist() == group.tolist()
    side = np.flatnonzero(mesh.points[:, 0] == 0.0)
    held = raised(replace(mesh, node_groups={"side": side})).node_groups["side"]
    assert held.tolist() == np.flatnonzero(fine.points[:, 0] == 0.0).tolist()


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad8"])
def test_groups_hold_the_children_of_their_members(kind):
    mesh = opening(kind, 2, n=4, layers=6, radius=2.0, reach=10.0)
    fine = halved(mesh)
    coarse, parts = element_volumes(mesh, of(mesh)), element_volumes(fine, of(mesh))
    for name, group in mesh.groups.items():
        assert len(fine.groups[name]) == 4 * len(group)
        assert parts[fine.groups[name]].sum() == pytest.approx(coarse[group].sum(), rel=1e-12)


def test_nodes_of_a_curved_edge_stay_on_its_parabola():
    mesh = opening("quad8", 2, n=4, layers=6, radius=2.0, reach=10.0)
    fine = halved(mesh)
    r = np.linalg.norm(fine.points, axis=1)
    near = np.abs(r - 2.0) < 1e-3
    # of a circle of eighths: the parabola through three points leaves it by 1e-4 of the radius
    assert np.count_nonzero(near) == 33
    assert np.abs(r[near] - 2.0).max() < 1e-3


def test_node_groups_grow_along_borders_only():
    mesh = box("tri3", (2, 2))
    side = np.flatnonzero(mesh.points[:, 0] == 0.0)
    corner = np.flatnonzero(mesh.points.sum(axis=1) == 0.0)
    inner = np.flatnonzero(mesh.points[:, 0] == 0.5)
    everything = np.arange(mesh.n_nodes)
    mesh = replace(mesh, node_groups={
        "side": side, "corner": corner, "inner": inner, "all": everything,
    })  # fmt: skip
    fine = halved(mesh)
    x = fine.points
    assert fine.node_groups["side"].tolist() == np.flatnonzero(x[:, 0] == 0.0).tolist()
    assert fine.node_groups["corner"].tolist() == corner.tolist()
    assert fine.node_groups["inner"].tolist() == inner.tolist()
    assert fine.node_groups["all"].tolist() == list(range(fine.n_nodes))
    halves = {"left": np.flatnonzero(x[:0, 0]), "right": np.flatnonzero(x[:0, 0])}
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)[:, 0]
    halves = {"left": np.flatnonzero(centre < 0.5), "right": np.flatnonzero(centre > 0.5)}
    fine = halved(replace(mesh, groups=halves))
    assert fine.node_groups["inner"].tolist() == np.flatnonzero(x[:, 0] == 0.5).tolist()


def test_a_slit_stays_open():
    """Two squares that share no node, at one place."""
    one = box("quad4", (1, 1))
    nodes = np.concatenate([one.blocks[0].nodes, one.blocks[0].nodes + 4])
    points = np.concatenate([one.points, one.points + np.array([1.0, 0.0])])
    mesh = replace(one, points=points, facets=(), facet_groups={}, groups={"all": np.arange(2)},
                   blocks=(replace(one.blocks[0], nodes=nodes, numbers=np.arange(2)),))  # fmt: skip
    assert halved(mesh).n_nodes == 18
