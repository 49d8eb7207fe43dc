"""What is recorded of the whole mesh, from states that are made up: all by hand."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import model
from support.meshes import box, regroup
from support.yielding import mohr, rock

from geoident.forward.analysis.fields import FieldRecorder, MeshRecorder, ReactionRecorder
from geoident.forward.analysis.stage import LastEquilibrium, StageEnd
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar
from geoident.model.structures import Bolts

RNG = np.random.default_rng(21)
BEGIN = RNG.bit_generator.state


@pytest.fixture(autouse=True)
def same_draws():
    """Each test draws the same numbers, whatever ran before it."""
    RNG.bit_generator.state = BEGIN


def staged(*surfaces, **changes):
    """Three columns of ground of two elements; the first is dug and filled again."""
    mesh = regroup(
        box("quad4", (3, 2), size=(3.0, 2.0), distortion=0.2),
        dug=lambda c: c[:, 0] < 1.0,
        rest=lambda c: c[:, 0] > 2.0,
    )
    settings = {
        "materials": {"rock": rock(1e9, 0.3, *surfaces)},
        "groups": dict.fromkeys(("dug", "rest", "rock"), "rock"),
        "supports": (Support("y0", (0, 1)), Support("x1", (0, 1)), Support("outer", (0,))),
        "stages": (
            Stage("dig", excavate=("dug",), supports={"outer": None}),
            Stage("fill", install={"dug": "rock"}),
            Stage("aside", excavate=("rest",), base="dig"),
        ),
    }
    return model(mesh, **{**settings, **changes})


def end(model, state, *, lost=False, yielded=(), last=None, forces=True):
    """A state of random numbers in two columns; NaN where it is lost."""
    points = model.discretization.points
    nan = np.nan if lost else 1.0
    u = RNG.normal(size=(points.n_dofs, 2)) * nan
    stress = RNG.normal(size=(4, points.n_points, 2)) * nan
    flows = np.isin(np.arange(points.n_points), yielded)
    members = RNG.normal(size=(model.systems.structures.n_rows, 2))
    acting = RNG.normal(size=(points.n_dofs, 2)) if forces else None
    return StageEnd(state, u, stress, members, flows, acting, last)


def means(model, stress, state):
    """(n_elements, 6) means of elements that are there, weighted with volume."""
    points, present = model.discretization.points, model.sequence.present(state)
    found = np.full((model.mesh.n_elements, 6), np.nan)
    for e in np.flatnonzero(present):
        mine = points.element == e
        found[e, :4] = stress[:, mine] @ points.volume[mine] / points.volume[mine].sum()
        found[e, 4:] = 0.0
    return found


def test_fields_are_copies_of_column_0_and_means_of_elements():
    model = staged()
    recorder, ends = FieldRecorder(model.on_mesh), [end(model, n) for n in range(4)]
    for one in ends:
        recorder.add(one)
    series = recorder.series()
    shape = (model.mesh.n_nodes, 2)
    for n, one in enumerate(ends):
        np.testing.assert_array_equal(series.displacement[n], one.u[:, 0].reshape(shape))
        np.testing.assert_allclose(series.stress[n], means(model, one.stress[..., 0], n))
        np.testing.assert_array_equal(series.present[n], model.sequence.present(n))
    assert series.last is None
    assert not series.yielded.any()
    ends[1].u[:] = 7.0
    assert not (series.displacement[1] == 7.0).any()


def elements(model, points):
    """The elements in which some strain points are."""
    return set(model.discretization.points.element[list(points)].tolist())


def test_what_has_yielded_stays_so_until_it_is_placed_anew():
    """Points 0 and 4 of the first column, then one of the others; on two branches."""
    model = staged(mohr(1e5, 0.3))
    element = model.discretization.points.element
    first = [int(np.flatnonzero(np.isin(element, model.mesh.groups["dug"]))[k]) for k in (0, 5)]
    others = [
        int(np.flatnonzero(np.isin(element, model.mesh.groups[g]))[1]) for g in ("rock", "rest")
    ]
    recorder = FieldRecorder(model.on_mesh)
    for n, points in enumerate(([*first, others[1]], others[:1], [], others)):
        recorder.add(end(model, n, yielded=points))
    found = [set(np.flatnonzero(row).tolist()) for row in recorder.series().yielded]
    assert found[0] == elements(model, [*first, others[1]])
    assert found[1] == elements(model, others)  # what is dug is gone
    assert found[2] == elements(model, others)  # and what is filled is new
    assert found[3] == elements(model, others[:1])  # built on `dig`, without `rest`


def test_of_a_lost_state_the_last_equilibrium_or_what_it_began_with_is_shown():
    model = staged(mohr(1e5, 0.3))
    points = model.discretization.points
    known = LastEquilibrium(
        RNG.normal(size=points.n_dofs), RNG.normal(size=(4, points.n_points)),
        np.arange(points.n_points) == 9,
    )  # fmt: skip
    ends = [end(model, 0), end(model, 1, yielded=[9]), end(model, 2, lost=True, yielded=[0]),
            end(model, 3, lost=True, last=known)]  # fmt: skip
    recorder = FieldRecorder(model.on_mesh)
    for one in ends:
        recorder.add(one)
    series = recorder.series()
    assert series.last.states.tolist() == [2, 3]
    assert np.isnan(series.displacement[2:]).all()
    assert not series.yielded[2:].any()
    before = ends[1].u[:, 0].reshape(-1, 2)
    np.testing.assert_array_equal(series.last.displacement[0], before)
    stress = means(model, ends[1].stress[..., 0], 1)
    stress[model.mesh.groups["dug"]] = 0.0  # what is placed bears nothing
    np.testing.assert_allclose(series.last.stress[0], stress)
    assert set(np.flatnonzero(series.last.yielded[0])) == elements(model, [9])
    np.testing.assert_array_equal(series.last.displacement[1], known.u.reshape(-1, 2))
    np.testing.assert_allclose(series.last.stress[1], means(model, known.stress, 3))


def test_reactions_are_what_supports_exert_each_degree_of_freedom_once():
    bolts = Bolts((((1.2, 0.3), (1.8, 1.6)),), Scalar(1.0), EA=Scalar(1e8))
    stages = (
        Stage("dig", excavate=("dug",), build=("bolts",), supports={"outer": None}),
        Stage("fill", install={"dug": "rock"}),
        Stage(
            "aside",
            excavate=("rest",),
            base="dig",
            supports={"x1": None, "x0": Support("x0", (0,))},
        ),
    )
    model = staged(structures={"bolts": bolts}, stages=stages)
    structures, points = model.systems.structures, model.discretization.points
    recorder, ends = ReactionRecorder(model.on_mesh, structures), [end(model, n) for n in range(4)]
    ends[3] = end(model, 3, forces=False)
    for one in ends:
        recorder.add(one)
    table = recorder.table()
    assert table.supports == ("y0", "x1", "outer", "x0")
    assert table.states == ("virgin", "dig", "fill", "aside")
    assert table.force.shape == (4, 4, 2)
    x, y = model.mesh.points.T
    edge = (x == 0) | (x == 3) | (y == 0) | (y == 2)
    C = points.compatibility(np.arange(points.n_points)).toarray().reshape(4, points.n_points, -1)
    for n in (0, 1, 2):
        present = model.sequence.present(n)[points.element]
        pulled = np.einsum("smd,sm,m->d", C, ends[n].stress[..., 0], points.volume * present)
        pulled = pulled + structures.nodal_forces(ends[n].members[:, :1])[:, 0]
        rest = (pulled - ends[n].forces[:, 0]).reshape(-1, 2)
        found = dict(zip(table.supports, table.force[:, n], strict=True))
        assert found["y0"] == pytest.approx(rest[y == 0].sum(axis=0))
        assert found["x1"] == pytest.approx(rest[(x == 3) & (y != 0)].sum(axis=0))
        if n:
            assert np.isnan(found["outer"]).all()
        else:
            free = edge & (x != 3) & (y != 0)
            assert found["outer"][0] == pytest.approx(rest[free, 0].sum())
            assert np.isnan(found["outer"][1])
        assert np.isnan(found["x0"]).all()
    assert np.isnan(table.force[:, 3]).all()


def test_yielding_is_recorded_where_something_yields():
    for surfaces, yields in (((), False), ((mohr(1e5, 0.3),), True)):
        model = staged(*surfaces)
        recorder = MeshRecorder(model.on_mesh, model.systems.structures)
        for n in range(2):
            recorder.add(end(model, n, yielded=[13]))
        recorder.add(end(model, 2, lost=True))
        found = recorder.yielded_ground()
        assert (found is not None) == yields
        if yields:
            volume = model.discretization.points.volume[13]
            assert found.volume[1] == pytest.approx(volume)
            assert np.isnan(found.volume[2])
        assert len(recorder.fields.series().displacement) == 3
        assert recorder.reactions.table().states == ("virgin", "dig", "fill")


# --- laws of materials whose strength is a field ---
