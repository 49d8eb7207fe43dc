"""Ground that is meshed twice is found, for all elements; sound meshes have nothing to say."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.errors import InputError, ModelError
from geoident.fem.faces import face_table
from geoident.fem.overlaps import overlaps
from geoident.model.case import Stage
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh
from tests.support.cases import material, model, rollers
from tests.support.meshes import KINDS, KINDS_2D, box, mixed_box, opening


def beside(*meshes, names=("rock", "block", "third")):
    """Meshes in one file that share no node, each a group."""
    points, blocks, groups, n, e = [], [], {}, 0, 0
    for mesh, name in zip(meshes, names, strict=False):
        points.append(mesh.points)
        for block in mesh.blocks:
            blocks.append(replace(block, nodes=block.nodes + n, numbers=block.numbers + e))
        groups[name] = np.arange(e, e + mesh.n_elements)
        n, e = n + mesh.n_nodes, e + mesh.n_elements
    return Mesh(np.vstack(points), tuple(blocks), groups=groups)


def moved(mesh, by):
    return replace(mesh, points=mesh.points + np.array(by))


def found(mesh, part=None):
    part = np.zeros(mesh.n_elements, dtype=np.int64) if part is None else part
    return overlaps(mesh, face_table(mesh), part)


def cells(kind, n):
    return (n,) * (2 if kind in KINDS_2D else 3)


@pytest.mark.parametrize("kind", KINDS)
def test_sound_meshes_have_no_overlap(kind):
    dim = CELLS[kind].dim
    meshes = [box(kind, cells(kind, 2), distortion=0.15)]
    if not kind.startswith("pyramid"):
        meshes.append(opening(kind, dim, n=2, layers=1, radius=1.0, reach=4.0))
    for mesh in meshes:
        halves = (np.arange(mesh.n_elements) % 2).astype(np.int64)  # faces between parts too
        assert len(found(mesh).element) == 0
        assert len(found(mesh, halves).element) == 0


def test_kinds_that_meet_do_not_overlap():
    for mesh in (mixed_box(1), mixed_box(2), mixed_box(1, distortion=0.1)):
        assert len(found(mesh).element) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_second_copy_is_found(kind):
    """The same elements on nodes of their own: every face at the border of one is in the other."""
    mesh = box(kind, cells(kind, 2), distortion=0.1)
    twice = beside(mesh, mesh)
    seen = found(twice)
    outer = np.unique(
        face_table(mesh).element[face_table(mesh).free(np.ones(mesh.n_elements, bool))]
    )
    both = np.concatenate([outer, outer + mesh.n_elements])
    assert np.unique(seen.element).tolist() == both.tolist()
    assert set(both).issuperset(seen.other)
    assert np.all((seen.element < mesh.n_elements) != (seen.other < mesh.n_elements))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 4])
def test_a_block_in_ground_that_was_not_cut_is_found(kind, n):
    """Larger elements, and smaller ones that lie within one element of the ground."""
    dim = CELLS[kind].dim
    ground = box(kind, cells(kind, 3), size=(3.0,) * dim)
    block = moved(box(kind, cells(kind, n), size=(0.9,) * dim), (1.2,) * dim)
    seen = found(beside(ground, block))
    assert len(seen.element)
    sides = np.stack([seen.element, seen.other], axis=1) >= ground.n_elements
    assert np.all(sides.any(axis=1) != sides.all(axis=1))
    assert np.all(seen.place >= 1.2)
    assert np.all(seen.place <= 2.1)


@pytest.mark.parametrize("kind", KINDS)
def test_parts_that_touch_are_no_overlap_and_corners_in_each_other_are(kind):
    dim = CELLS[kind].dim
    one = box(kind, cells(kind, 2))
    for gap in (0.0, 1e-9, -1e-9, -0.01):
        assert len(found(beside(one, moved(one, [1.0 + gap] + [0.0] * (dim - 1)))).element) == 0
    assert len(found(beside(one, moved(one, (0.7, 0.75, 0.65)[:dim]))).element)


def test_a_wall_meshed_by_chords_of_different_length_from_both_sides_is_no_overlap():
    """A core of fine chords in ground of coarse ones, 22.5 degrees each."""
    coarse = opening("tri3", 2, n=2, layers=2, radius=1.0, reach=4.0)
    fine = opening("tri3", 2, n=6, layers=1, radius=1.0, reach=4.0)
    rock = coarse.groups["rock"]
    core = fine.groups["core"]

    def only(mesh, rows):
        (block,) = mesh.blocks
        kept = replace(block, nodes=block.nodes[rows], numbers=np.arange(1, len(rows) + 1))
        return Mesh(mesh.points, (kept,))

    assert len(found(beside(only(coarse, rock), only(fine, core))).element) == 0
    assert len(found(beside(only(coarse, rock), moved(only(fine, core), (0.3, 0.3)))).element)


def on(mesh, groups, stages=()):
    dim = mesh.dim
    outer = {
        f"{axis}0": np.flatnonzero(np.isclose(mesh.points[:, k], mesh.points[:, k].min()))
        for k, axis in enumerate("xyz"[:dim])
    }
    return model(
        replace(mesh, node_groups=outer), materials={"rock": material("rock", 1e9, 0.2)},
        groups=groups, stages=stages, supports=rollers(dim),
    )  # fmt: skip


def test_a_case_is_refused_where_its_ground_is_there_twice_at_a_stage():
    mesh = beside(box("quad4", (3, 3)), moved(box("quad4", (1, 1), size=(0.5, 1.0)), (0.0, 0.0)))
    with pytest.raises(InputError) as caught:
        on(mesh, {"rock": "rock", "block": "rock"})
    (fault,) = caught.value.faults
    assert fault.code == "overlapping-ground"
    assert "the groups 'rock' and 'block' overlap" in fault.message
    assert "BooleanFragments" in fault.hint
    taken = (Stage("one", install={"block": "rock"}),)
    with pytest.raises(InputError, match="overlap"):
        on(mesh, {"rock": "rock", "block": None}, taken)
    instead = (Stage("one", excavate=("rock",), install={"block": "rock"}),)
    on(mesh, {"rock": "rock", "block": None}, instead)  # one after the other: nothing to say


def test_a_group_may_lie_on_itself():
    mesh = beside(box("hex8", (2, 2, 2)), moved(box("hex8", (1, 1, 1)), (0.5, 0.0, 0.0)))
    mesh = replace(mesh, groups={"rock": np.arange(mesh.n_elements)})
    with pytest.raises(InputError, match="'rock' overlaps itself"):
        on(mesh, {"rock": "rock"})


def test_what_is_loose_since_its_nodes_are_copies_says_so():
    upper = moved(box("quad4", (2, 2)), (0.0, 1.0))
    mesh = beside(box("quad4", (2, 2)), upper)
    with pytest.raises(ModelError) as caught:
        on(mesh, {"rock": "rock", "block": "rock"})
    assert "3 of its nodes stand where nodes of 'rock' stand" in caught.value.hint
