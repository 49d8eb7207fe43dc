"""Material constants that vary from strain point to strain point (theory 10.6)."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import displacement, field_on, material, model, model_with_fields, rollers
from support.derivatives import assert_adjoint, assert_exact
from support.meshes import box, regroup

from geoident.forward.ground.field import field_notes
from geoident.model.actions import Traction
from geoident.model.case import Analysis, Material, Stage
from geoident.model.ground import (
    Attitude,
    Isotropic,
    Orthotropic,
    RandomField,
    TransverselyIsotropic,
)
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar

STRESS = ConstantStress((*(Scalar(v) for v in (-9e6, -6e6, -7e6, 0.5e6)), Scalar(0.0), Scalar(0.0)))
ROUND = ConstantStress((*(Scalar(v) for v in (-9e6, -6e6, -9e6)), *[Scalar(0.0)] * 3))
LAYERS = 4
XI = np.array([0.3, -0.5, 0.8, -0.2])


def modes_of(n):
    return tuple(f"rock.mode-{k + 1}" for k in range(n))


def xi_parameters(values, names):
    return tuple(
        Parameter(n, float(x), -np.inf, np.inf) for n, x in zip(names, values, strict=True)
    )


def site(kind, analysis):
    """A block of 8 m with a hole in its middle, in layers; its sides do not move."""
    dim = 3 if analysis is Analysis.SOLID else 2
    n, size = ((6, 8), (8.0, 8.0)) if dim == 2 else ((4, 4, 4), (8.0, 8.0, 8.0))
    mesh = box(kind, n, size=size, distortion=0.1)
    names = [(k, hole) for hole in (False, True) for k in range(LAYERS)]
    found = {f"{'hole' if hole else 'layer'}-{k}": _part(k, hole) for k, hole in names}
    centres = np.vstack([mesh.points[block.nodes].mean(axis=1) for block in mesh.blocks])
    found = {name: here for name, here in found.items() if here(centres).any()}
    return regroup(mesh, **found), tuple(name for name in found if name.startswith("hole"))


def _part(k, hole):
    def here(c):
        inside = (np.abs(c - 4.0) < 1.8).all(axis=1)
        return (c[:, 1] // 2 == k) & (inside == hole)

    return here


def channels(dim):
    places = {2: [(4.0, 6.5), (1.0, 5.0), (6.7, 3.1)], 3: [(4.0, 6.5, 4.0), (1.0, 5.0, 3.0)]}
    along = {2: (0.6, 0.8), 3: (0.6, 0.8, 0.3)}
    return tuple(displacement(f"c{k}", x, along[dim]) for k, x in enumerate(places[dim]))


def common(mesh, holes, analysis):
    dim = mesh.dim
    return {
        "analysis": analysis,
        "supports": rollers(dim),
        "in_situ": ROUND if analysis is Analysis.AXISYMMETRIC else STRESS,
        "stages": (
            Stage("dig", excavate=holes[:1]),
            Stage("fill", excavate=holes[1:], install={holes[0]: "concrete"}),
        ),
        "channels": channels(dim),
    }


CONCRETE = material("concrete", 15e9, 0.2)


def layer_of(mesh, holes, points):
    """Mode k is one in layer k."""
    group = np.full(mesh.n_elements, -1)
    for k in range(LAYERS):
        for name in (f"layer-{k}", f"hole-{k}"):
            group[mesh.groups.get(name, [])] = k
    return group[points]


def by_modes(mesh, holes, rock, analysis, constants, parameters, **changes):
    def fields_of(on_mesh):
        points = on_mesh.material_points("rock")
        layer = layer_of(mesh, holes, on_mesh.discretization.points.element[points])
        modes = (layer[:, None] == np.arange(LAYERS)).astype(float)
        more = {"known": 0.1 * (layer == 2), "names": modes_of(LAYERS), **changes}
        return [field_on(on_mesh, "rock", c, lambda _: modes, **more) for c in constants]

    groups = dict.fromkeys(mesh.groups, "rock")
    groups = {g: "rock" for g in groups if g.startswith(("layer", "hole"))}
    return model_with_fields(
        mesh,
        fields_of,
        materials={"rock": rock, "concrete": CONCRETE},
        groups=groups,
        parameters=parameters,
        **common(mesh, holes, analysis),
    )


def by_groups(mesh, holes, rock_of, analysis):
    names = [g for g in mesh.groups if g.startswith(("layer", "hole"))]
    layers = range(LAYERS)
    return model(
        mesh,
        materials={f"rock-{k}": rock_of(k, np.exp(0.1 * (k == 2) + XI[k])) for k in layers}
        | {"concrete": CONCRETE},
        groups={g: f"rock-{g[-1]}" for g in names},
        **common(mesh, holes, analysis),
    )


STRATA = Attitude(Scalar(0.4), Scalar(np.pi / 2))


def strata(name, f, fields):
    factor = {c: f if c in fields else 1.0 for c in ("E_p", "E_n", "G_np")}
    return Material(
        name,
        TransverselyIsotropic(
            Scalar(20e9 * factor["E_p"]), Scalar(0.2), Scalar(9e9 * factor["E_n"]), Scalar(0.15),
            Scalar(4e9 * factor["G_np"]), STRATA,
        ),
    )  # fmt: skip


def orthotropic(name, f, fields):
    E = {
        c: v * (f if c in fields else 1.0)
        for c, v in {
            "E_1": 20e9,
            "E_2": 15e9,
            "E_3": 9e9,
            "G_12": 6e9,
            "G_13": 5e9,
            "G_23": 4e9,
        }.items()
    }
    nu = {"nu_12": 0.2, "nu_13": 0.15, "nu_23": 0.1}
    return Material(name, Orthotropic(**{k: Scalar(v) for k, v in (E | nu).items()}, frame=STRATA))


def isotropic(name, f, fields):
    if "K" in fields or "G" in fields:
        K, G = (v * (f if c in fields else 1.0) for c, v in (("K", 9e9), ("G", 5e9)))
        return Material(name, Isotropic(K=Scalar(K), G=Scalar(G)))
    return Material(name, Isotropic(E=Scalar(12e9 * f), nu=Scalar(0.25)))


LAWS = {
    "Young's modulus": (isotropic, ("E",)),
    "shear modulus": (isotropic, ("G",)),
    "bulk and shear together": (isotropic, ("K", "G")),
    "across the strata": (strata, ("E_n",)),
    "all of the strata": (strata, ("E_p", "E_n", "G_np")),
    "orthotropic": (orthotropic, ("E_2", "G_13")),
}

KINDS = (
    ("tri3", Analysis.PLANE_STRAIN),
    ("quad8", Analysis.PLANE_STRAIN),
    ("tri6", Analysis.AXISYMMETRIC),
    ("tet4", Analysis.SOLID),
    ("hex20", Analysis.SOLID),
)


CASES = [(kind, analysis, "Young's modulus") for kind, analysis in KINDS]
CASES += [("quad8", Analysis.PLANE_STRAIN, law) for law in LAWS if law != "Young's modulus"]
CASES += [("tet4", Analysis.SOLID, "orthotropic")]


@pytest.mark.parametrize(("kind", "analysis", "law"), CASES)
def test_layers_by_modes_are_layers_by_groups(kind, analysis, law):
    rock, constants = LAWS[law]
    mesh, holes = site(kind, analysis)
    found = by_modes(
        mesh, holes, rock("rock", 1.0, constants), analysis, constants,
        xi_parameters(XI, modes_of(LAYERS)),
    )  # fmt: skip
    truth = by_groups(mesh, holes, lambda k, f: rock(f"rock-{k}", f, constants), analysis)
    one, other = (m.survey(p, fields=True) for m, p in ((found, XI), (truth, np.empty(0))))
    np.testing.assert_allclose(one.computed, other.computed, rtol=1e-10)
    scale = np.nanmax(np.abs(other.fields.stress))
    np.testing.assert_allclose(one.fields.stress, other.fields.stress, atol=1e-10 * scale)


@pytest.mark.parametrize("change", [{"known": -0.3}, {"names": ("other",)}, {"pull": 0.4}])
def test_two_moduli_that_vary_differently_are_not_one_factor(change):
    """K and G differ in what tests say of them, in their mode, or in how tests hold them."""
    mesh, p = box("quad8", (2, 2)), np.array([0.4, -0.7])
    names = ("both", "other")

    def fields_of(on_mesh):
        def field(constant, **more):
            given = {"known": 0.2, "names": names[:1], "pull": 0.0, "reference": 2e9, **more}
            for key in ("known", "pull"):
                given[key] = np.full(len(on_mesh.material_points("rock")), given[key])
            return field_on(on_mesh, "rock", constant, lambda x: np.ones((len(x), 1)), **given)

        return [field("K"), field("G", **change)]

    given = {
        "groups": {"all": "rock"},
        "supports": rollers(2),
        "in_situ": STRESS,
        "stages": (Stage("load", loads={"q": Traction("x1", (Scalar(1e6), Scalar(3e5)))}),),
        "channels": (displacement("u", (0.9, 0.8), (0.6, 0.8)),),
    }
    staged = model_with_fields(
        mesh, fields_of, materials={"rock": isotropic("rock", 1.0, ("K", "G"))},
        parameters=xi_parameters(p, names), **given,
    )  # fmt: skip
    K = 9e9 * np.exp(0.2 + p[0])
    G = 5e9 * np.exp(change.get("known", 0.2) + (p[1] if "names" in change else p[0]))
    G *= (2e9 / 5e9) ** change.get("pull", 0.0)
    rock = Material("rock", Isotropic(K=Scalar(K), G=Scalar(G)))
    truth = model(mesh, materials={"rock": rock}, **given)
    exact = truth.survey(np.empty(0), fields=False).computed
    np.testing.assert_allclose(staged.survey(p, fields=False).computed, exact, rtol=1e-10)


def pairs_of(staged):
    return [(c.name, s.name) for s in staged.case.stages for c in staged.case.channels]


@pytest.mark.parametrize("law", ["Young's modulus", "across the strata", "orthotropic"])
def test_derivatives_by_modes_and_by_a_mean_that_tests_hold(law):
    rock, constants = LAWS[law]
    mesh, holes = site("quad8", Analysis.PLANE_STRAIN)
    first = constants[0]
    plain = rock("rock", 1.0, ())
    mean = getattr(plain.elastic, first).factor
    tied = replace(plain, elastic=replace(plain.elastic, **{first: Scalar(1.0, "mean")}))
    parameters = (Parameter("mean", mean, 0.0, np.inf), *xi_parameters(XI, modes_of(LAYERS)))
    points = np.isin(layer_of(mesh, holes, np.arange(mesh.n_elements)), (1, 2)).repeat(9)
    changes = {"pull": 0.3 + 0.4 * points, "reference": 0.8 * mean}
    staged = by_modes(mesh, holes, tied, Analysis.PLANE_STRAIN, constants, parameters, **changes)
    response = staged.response(pairs_of(staged))
    assert_exact(response, np.array([mean, *XI]), ("mean", *modes_of(LAYERS)), step=0.02)


@pytest.mark.parametrize(("kind", "analysis"), KINDS)
def test_adjoints_are_tangents(kind, analysis):
    mesh, holes = site(kind, analysis)
    rock = material("rock", Scalar(1.0, "mean"), 0.25)
    parameters = (Parameter("mean", 12e9, 0.0, np.inf), *xi_parameters(XI, modes_of(LAYERS)))
    staged = by_modes(mesh, holes, rock, analysis, ("E",), parameters)
    response = staged.response(pairs_of(staged))
    p = np.array([12e9, *XI])
    assert_adjoint(response, p)


@pytest.mark.parametrize(
    ("part", "modes", "measured", "advice"),
    [
        (0.912, None, 0, ""),
        (0.9, 4, 2, ""),
        (0.899, 4, 0, "give more `modes`"),
        (0.25, None, 3, "give longer lengths or more `modes`"),
    ],
)
def test_what_modes_leave_out_is_said_below_nine_tenths(part, modes, measured, advice):
    field = SimpleNamespace(name="rock.E", measured=(None,) * measured, modes=modes)
    made = SimpleNamespace(names=modes_of(7), explained=part)
    (note,) = field_notes(SimpleNamespace(fields=[field]), [made])
    begin = f"the field rock.E has 7 modes with {100 * part:g} % of its variance"
    begin += f" (what {measured} measured values leave of it)" if measured else ""
    assert note.startswith(begin)
    rest = note.removeprefix(begin)
    assert rest == "" if not advice else rest.endswith(f"than in the ground: {advice}")


def test_a_field_of_a_case_stands_at_the_points_of_its_material():
    """In the middle of its lengths, with its modes as parameters behind those of the case."""
    flat = Attitude(Scalar(0.0), Scalar(np.pi / 2))
    field = RandomField("rock", "E", Scalar(1.0, "E"), 0.4, (3.0,), flat, modes=3)
    varies = Material("rock", Isotropic(E=Scalar(1.0, "E"), nu=Scalar(0.2)), fields=(field,))
    mesh = regroup(box("quad4", (4, 4), size=(4.0, 4.0)), even=lambda c: c[:, 1] > 2.0)
    staged = model(
        mesh,
        materials={"rock": varies, "even": material("even", 1e9, 0.2)},
        groups={"rock": "rock", "even": "even"},
        parameters=(Parameter("E", 2e9, 1e9, 4e9),),
        supports=rollers(2),
    )
    (found,) = staged.on_mesh.fields
    points = staged.discretization.points.position
    assert (points[found.points, 1] < 2.0).all()
    assert len(found.points) == np.sum(points[:, 1] < 2.0)
    assert staged.names == ("E", *found.names)
    assert len(found.names) == 3
    # the farther apart two points are, the less they have in common
    first = (found.modes @ found.modes.T)[0]
    away = np.linalg.norm(points[found.points] - points[found.points[0]], axis=1)
    assert np.corrcoef(first, away)[0, 1] < -0.9
