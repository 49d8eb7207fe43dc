"""What is recorded of the whole mesh, from states that are made up: all by hand."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import model
from support.meshes import box, regroup
from support.yielding import rock

from geoident.forward.analysis.fields import ReactionRecorder
from geoident.forward.analysis.stage import StageEnd
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


# --- laws of materials whose strength is a field ---
