"""One small case in which all that an elastic analysis knows acts together, by three ways.

Tangents against differences of the readings, adjoints against tangents, and the states against a
analysis of dense matrices that is written from the statement of the problem alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.all_at_once import assert_slopes_in_sizes, bracing, compatibility, unbounded
from support.cases import displacement, field_on, material, model_with_fields
from support.derivatives import assert_adjoint
from support.force_gauges import gauge
from support.meshes import box, regroup

from geoident.forward.analysis import adjoint
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.stage import UnitForces
from geoident.forward.gauges.adjoints import ReadingAdjoints
from geoident.model.actions import Pressure
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Scalar

P = {
    "E": 8e9, "El": 1e10, "nu": 0.25, "part": 0.4, "sv": 5e6, "K0": 0.8, "alpha": 1.3e-5,
    "move": 4e-3, "rock.E.mode-1": 0.2, "rock.E.mode-2": -0.3,
}  # fmt: skip
STATES = ("open", "lined", "test", "bench", "other", "end")


def cells(x, y):
    return lambda c: (x[0] < c[:, 0]) & (c[:, 0] < x[1]) & (y[0] < c[:, 1]) & (c[:, 1] < y[1])


def expanding(name, E, nu, density, expansion):
    return Material(name, Isotropic(E=E, nu=nu), Scalar(density), expansion)


ONE, PART = Scalar(1.0), Scalar(1.0, "part")
SETTINGS = {
    "parameters": unbounded(P),
    "materials": {
        "rock": expanding("rock", Scalar(1.0, "E"), Scalar(1.0, "nu"), 2500.0,
                          Scalar(1.0, "alpha")),
        "young": expanding("young", Scalar(0.3, "El"), Scalar(0.2), 2500.0, Scalar(2e-5)),
        "shot": material("shot", Scalar(1.0, "El"), 0.2, 2400.0),
    },
    "groups": dict.fromkeys(("rock", "heading", "bench", "lining", "fill"), "rock"),
    "supports": (Support("x0", (0,)), Support("y0", (1,)), Support("x1", (0,))),
    "in_situ": HeimStress(vertical=Scalar(1.0, "sv"), K0=Scalar(1.0, "K0")),
    "structures": bracing(((1.0, 8.5), (1.5, 11.0)), thickness=0.5),
    "stages": (
        Stage("open", excavate=("heading", "lining"),
              release=dict.fromkeys(("heading", "lining"), PART), build=("plate", "bolts")),
        Stage("lined", install={"lining": "young"}, build=("struts",),
              release={"heading": Scalar(1.5, "part"), "lining": ONE},
              temperature={"rock": Scalar(7.0), "lining": Scalar(20.0)}),
        Stage("test", loads={"top": Pressure("y1", Scalar(0.1, "sv"))}, independent=True,
              temperature={"lining": Scalar(30.0)}),
        Stage("bench", excavate=("bench",), change={"lining": "shot"}, dismantle=("bolts",),
              supports={"x1": Support("x1", (0,), motions=((0, Scalar(1.0, "move")),))}),
        Stage("other", base="open", excavate=("bench", "fill"), supports={"x1": None}),
        Stage("end", base="bench", install={"heading": "young", "fill": "shot"},
              release={"heading": ONE}, supports={"x1": None}),
    ),
    "channels": (
        displacement("roof", (1.0, 9.0), (0.6, 0.8), zero="open"),
        displacement("side", (8.0, 5.0), (1.0, 0.0)),
        displacement("edge", (12.0, 3.0), (1.0, 0.0)),
        displacement("top", (2.0, 12.0), (0.0, 1.0), zero="bench"),
        displacement("low", (9.0, 3.0), (0.0, 1.0), zero="test"),
        gauge("load-cell", "strut", (4.5, 5.0), "N", structure="struts", dimension="force"),
        gauge("load-cell", "bolt", (4.5, 7.0), "N", structure="bolts", zero="open",
              dimension="force"),
        gauge("load-cell", "bent", (5.3, 12.0), structure="plate", towards=(6.0, 0.0),
              dimension="moment per length", quantity="M"),
        gauge("stress", "xx", (6.0, 6.1), "xx", dimension="pressure"),
        gauge("stress", "yy", (6.0, 6.1), "yy", zero="open", dimension="pressure"),
        gauge("stress", "xy", (3.1, 6.9), "xy", zero="lined", dimension="pressure"),
    ),
}  # fmt: skip


def everything(**changes):
    """A heading that leaves with a part of its stress, lined later, and a bench below it.

    Bolts that go, jacked struts, a plate; warmth, a moved support, load cases; E is a field.
    """
    mesh = regroup(
        box("quad4", (6, 6), size=(12.0, 12.0), distortion=0.1),
        heading=cells((0, 2), (6, 8)),
        bench=cells((0, 2), (4, 6)),
        lining=cells((2, 4), (6, 8)),
        fill=cells((8, 12), (0, 2)),
    )
    return model_with_fields(
        mesh,
        lambda on_mesh: [
            field_on(on_mesh, "rock", "E", lambda x: 0.1 * np.cos(np.outer(x @ [0.2, 0.3], [1, 2])))
        ],
        **(SETTINGS | changes),
    )


PAIRS = [
    *((name, s) for name in ("side", "edge", "low", "xx") for s in STATES),
    *((name, s) for name in ("roof", "yy") for s in STATES),
    *(("strut", s) for s in ("lined", "test", "bench", "end")),
    *(("bolt", s) for s in ("lined", "test")),
    *(("bent", s) for s in STATES),
    *(("xy", s) for s in ("test", "bench", "end")),
    ("top", "end"),
]
HERE = np.array(list(P.values()))


@pytest.fixture(scope="module")
def staged():
    return everything()


def test_adjoints_are_tangents_and_tangents_are_differences(staged):
    assert len(PAIRS) > adjoint._AT_ONCE
    response = staged.response(PAIRS)
    assert_adjoint(response, HERE)
    _, jacobian = response.by_tangents(HERE)
    assert_slopes_in_sizes(response.readings, P, jacobian, PAIRS, step=2e-3, rtol=1e-6)


@pytest.mark.parametrize("kept", [slice(0, 1), slice(3, None, 7), slice(None, None, 2)])
def test_adjoints_of_some_readings_are_rows_of_those_of_all(staged, kept):
    some = PAIRS[kept]
    values, jacobian = staged.response(PAIRS).by_tangents(HERE)
    found, rows = staged.response(some).by_adjoints(HERE)
    np.testing.assert_allclose(found, values[kept], rtol=1e-11)
    size = np.abs(jacobian).max(axis=0)
    np.testing.assert_allclose(rows / size, jacobian[kept] / size, rtol=0.0, atol=1e-10)
    assert isinstance(staged.response(some).adjoints, ReadingAdjoints)


# --- the states of a dense analysis ---


def moduli(E, nu):
    """Isotropic elasticity (4, 4) of a section."""
    lame, shear = E * nu / (1 + nu) / (1 - 2 * nu), E / 2 / (1 + nu)
    found = np.diag([2 * shear] * 3 + [shear])
    found[:3, :3] += lame
    return found


class Dense:
    """An analysis of the case without structures, as theory 2 states it, on dense matrices.

    Of the program it has C, V, and the forces that act from outside.
    """

    def __init__(self, staged):
        self.staged, self.points = staged, staged.discretization.points
        m, self.V = self.points.n_points, self.points.volume
        self.C = compatibility(staged)
        self.names = np.array(staged.sequence.groups)[staged.sequence.group_of[self.points.element]]
        modes = staged.on_mesh.fields[0]
        self.factor = np.ones(m)
        xi = np.array([P["rock.E.mode-1"], P["rock.E.mode-2"]])
        self.factor[modes.points] = np.exp(modes.modes @ xi)

    def elasticity(self, materials):
        """E (m, 4, 4) of the points; zero where nothing is."""
        of = {
            "rock": (P["E"], P["nu"], P["alpha"]), "young": (0.3 * P["El"], 0.2, 2e-5),
            "shot": (P["El"], 0.2, 0.0),
        }  # fmt: skip
        E, alpha = np.zeros((len(self.V), 4, 4)), np.zeros(len(self.V))
        for group, name in materials.items():
            mine = self.names == group
            Young, nu, alpha[mine] = of[name]
            factor = self.factor[mine] if name == "rock" else np.ones(mine.sum())
            E[mine] = factor[:, None, None] * moduli(Young, nu)
        return E, alpha

    def forces(self, stress, among):
        weighted = stress * np.where(among, self.V, 0.0)
        return np.einsum("smd,sm->d", self.C, weighted)

    def states(self):
        """Displacements (d,) and stresses (4, m) of the states, the virgin one first."""
        mesh, sequence = self.staged.mesh, self.staged.sequence
        x, y = mesh.points.T
        virgin = -P["sv"] * np.array([P["K0"], 1.0, P["K0"], 0.0])[:, None] * np.ones(len(self.V))
        found, held = [(np.zeros(2 * len(x)), virgin, {}, 0.0 * self.V)], {}
        release = {"open": {"heading": P["part"], "lining": P["part"]},
                   "lined": {"heading": 1.5 * P["part"], "lining": 1.0},
                   "end": {"heading": 1.0}}  # fmt: skip
        warm = {"lined": {"rock": 7.0, "lining": 20.0}, "test": {"lining": 30.0}}
        for n, state in enumerate(sequence.states[1:], start=1):
            u, stress, held, warmth = (part.copy() for part in found[state.base])
            made = {sequence.groups[g]: m for g, m in state.materials.items()}
            leaving = {sequence.groups[g] for g in state.leaving}
            placed = {sequence.groups[g] for g in state.placed}
            here = np.isin(self.names, list(made))
            for group in leaving:
                held[group] = 0.0, -self.forces(stress, self.names == group)
            for group, part in release.get(state.name, {}).items():
                held[group] = part, held[group][1]
            for group in leaving - release.get(state.name, {}).keys():
                del held[group]
            gone = ~here | np.isin(self.names, list(placed))
            stress[:, gone], warmth[gone] = 0.0, 0.0
            E, alpha = self.elasticity(made)
            more = np.zeros_like(warmth)
            for group, T in warm.get(state.name, {}).items():
                mine = self.names == group
                more[mine] = T - warmth[mine]
                warmth[mine] = T
            strain = np.array([1.0, 1.0, 1.0, 0.0])[:, None] * (alpha * more)
            stress -= np.einsum("mst,tm->sm", E, strain)
            standing = np.zeros(len(x), dtype=bool)
            on = np.isin(sequence.group_of, list(state.materials))
            standing[np.unique(mesh.blocks[0].nodes[on])] = True
            u[np.repeat(~standing, 2)] = 0.0
            fixed = np.zeros((len(x), 2), dtype=bool)
            fixed[x == 0.0, 0] = True
            fixed[y == 0.0, 1] = True
            if state.name not in ("other", "end"):
                fixed[x == 12.0, 0] = True
            du = np.zeros((len(x), 2))
            if state.name == "bench":
                du[x == 12.0, 0] = P["move"]
            du, free = du.ravel(), (np.repeat(standing, 2) & ~fixed.ravel())
            acting = self.staged.analysis.actions.forces(n, self.staged.at(HERE).point)[:, 0]
            acting = acting + sum((1.0 - part) * pull for part, pull in held.values())
            K = np.einsum("smd,mst,tme,m->de", self.C, E, self.C, np.where(here, self.V, 0.0),
                          optimize=True)  # fmt: skip
            rest = acting - self.forces(stress, here) - K @ du
            du[free] = np.linalg.solve(K[np.ix_(free, free)], rest[free])
            stress += np.einsum("mst,tmd,d->sm", E, self.C, du, optimize=True)
            found.append((u + du, stress, held, warmth))
        return found


def test_states_are_those_of_a_dense_march():
    channels = tuple(c for c in SETTINGS["channels"] if c.kind != "load-cell")
    stages = tuple(replace(s, build=(), dismantle=()) for s in SETTINGS["stages"])
    staged = everything(structures={}, stages=stages, channels=channels)
    wanted = Dense(staged).states()
    size, most = np.abs(wanted[4][0]).max(), P["sv"]
    assert size > 1e-3
    for end, (u, stress, _, _) in zip(staged.at(HERE).states(), wanted, strict=True):
        np.testing.assert_allclose(end.u[:, 0], u, rtol=0.0, atol=1e-10 * size)
        np.testing.assert_allclose(end.stress[..., 0], stress, rtol=0.0, atol=1e-10 * most)


@pytest.mark.parametrize("derivatives", [True, False])
def test_columns_of_unit_forces_are_what_a_push_adds(staged, derivatives):
    """All is linear in forces: displacements, stresses and forces in structures of all states."""
    n = 2 * staged.mesh.n_nodes
    rng = np.random.default_rng(5)
    forces = np.zeros((n, 2))
    forces[[64, 77], 0] = 1.0, -2.0  # on nodes that are always there
    forces[[81, 91], 1] = 1.0, 0.5
    active = rng.choice([-1.0, 0.0, 1.0], (1 + len(STATES), 2))
    sizes = np.array([3e5, -2e5])

    def ends(**options):
        run = staged.at(HERE, RunOptions(derivatives=derivatives, **options))
        return [(end.u.copy(), end.stress.copy(), end.members.copy()) for end in run.states()]

    plain, columns = ends(), ends(unit_forces=UnitForces(forces, active))
    pushed = ends(unit_forces=UnitForces(forces, active, sizes))
    moved = False
    for before, beside, after in zip(plain, columns, pushed, strict=True):
        for one, more, other in zip(before, beside, after, strict=True):
            size = np.abs(one[..., 0]).max(initial=0.0)
            np.testing.assert_allclose(more[..., :-2], one, rtol=1e-9, atol=1e-10 * size)
            added = other[..., 0] - one[..., 0]
            moved |= np.abs(added).max(initial=0.0) > 1e-3 * size > 0.0
            np.testing.assert_allclose(more[..., -2:] @ sizes, added, rtol=0.0, atol=1e-8 * size)
    assert moved
