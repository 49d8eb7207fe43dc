"""Point forces and pseudo-static earthquakes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import NOWHERE, displacement, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import box, opening, regroup

from geoident.errors import InputError
from geoident.model.actions import PointForce, Pressure, Seismic
from geoident.model.case import Stage, Support
from geoident.model.parameter import Parameter, Scalar

E, NU = 10e9, 0.25
ROCK = material("rock", E, NU, 2600.0)


def of_rock(mesh, **changes):
    """A model of rock on rollers."""
    usual = {"materials": {"rock": ROCK}, "groups": {"all": "rock"}, "supports": rollers(mesh.dim)}
    return model(mesh, **{**usual, **changes})


def scalars(*numbers):
    return tuple(Scalar(float(x)) for x in numbers)


def sphere_displacement(x, force, radius):
    """Kelvin's solution for a force along z at the centre of a sphere whose surface is held.

    Kelvin's field (Love, article 130) less the regular field alpha F + beta (r^2 F + kappa (x F) x)
    that equals it on the sphere; kappa makes the latter satisfy Navier's equation.
    """
    mu = E / (2 * (1 + NU))
    c = force / (16 * np.pi * mu * (1 - NU))
    m = 1 / (1 - 2 * NU)
    kappa = -(3 + m) / (1 + 2 * m)
    beta = c / (kappa * radius**3)
    alpha = c * (3 - 4 * NU) / radius - beta * radius**2
    r = np.linalg.norm(x, axis=1, keepdims=True)
    F = np.array([0.0, 0.0, 1.0])
    along = x[:, 2:] * x
    kelvin = c * ((3 - 4 * NU) * F / r + along / r**3)
    return kelvin - alpha * F - beta * (r**2 * F + kappa * along)


def pushed_sphere(n, layers):
    """Places at 0.2 to 0.6 of the radius, displacements there, found and exact."""
    mesh = opening("hex20", 3, n=n, layers=layers, radius=1.0, reach=10.0)
    flat = np.concatenate([mesh.facet_groups[f"{a}0"] for a in "xyz"])
    far = np.setdiff1d(mesh.facet_groups["outer"], flat)
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, "far": far})
    force = 8e6
    staged = of_rock(
        mesh,
        groups={"core": "rock", "rock": "rock"},
        supports=(
            Support("x0", (0,)), Support("y0", (1,)), Support("z0", (0, 1)),
            Support("far", (0, 1, 2)),
        ),
        stages=(
            Stage("push", loads={"f": PointForce((0.0, 0.0, 0.0), scalars(0, 0, force / 8))}),
        ),
    )  # fmt: skip
    found = staged.survey(np.empty(0), fields=True).fields.displacement[-1]
    r = np.linalg.norm(mesh.points, axis=1)
    there = (r > 2.0) & (r < 6.0)
    exact = sphere_displacement(mesh.points[there], force, 10.0)
    return mesh.points[there], found[there], exact


def test_kelvin_in_a_sphere_converges_away_from_the_force(verification):
    spheres = [pushed_sphere(2, 4), pushed_sphere(3, 8)]
    errors = [np.abs(found - exact).max() / np.abs(exact).max() for _, found, exact in spheres]
    at, found, exact = spheres[1]
    axis = np.hypot(at[:, 0], at[:, 1]) < 1e-9
    verification("kelvin", "", at[axis, 2], exact=exact[axis, 2], found=found[axis, 2])
    assert errors[1] < 0.01
    assert errors[1] < errors[0] / 10


@pytest.mark.parametrize("kind", ["tri6", "quad4", "tet10", "hex8"])
def test_a_force_inside_an_element_keeps_its_resultant_and_its_moment(kind):
    dim = 2 if kind in ("tri6", "quad4") else 3
    mesh = box(kind, (3,) * dim, distortion=0.1)
    at = (0.41, 0.37, 0.62)[:dim]
    value = np.array([3.0, -5.0, 2.0])[:dim]
    staged = of_rock(
        mesh,
        loads={"f": PointForce(at, scalars(*value))},
    )
    forces = staged.actions.forces(0, NOWHERE)[:, 0].reshape(-1, dim)
    np.testing.assert_allclose(forces.sum(axis=0), value, rtol=1e-12)
    moment = np.einsum("ni,nj->ij", staged.mesh.points, forces)
    np.testing.assert_allclose(moment, np.outer(at, value), rtol=1e-9)


def test_nodes_of_a_group_share_a_force():
    mesh = box("quad4", (4, 4))
    mesh = replace(mesh, node_groups={"pad": np.array([4, 9, 14])})
    staged = of_rock(
        mesh,
        loads={"f": PointForce("pad", scalars(0, -9))},
    )
    forces = staged.actions.forces(0, NOWHERE)[:, 0].reshape(-1, 2)
    np.testing.assert_allclose(forces[[4, 9, 14]], [[0, -3]] * 3)
    np.testing.assert_allclose(forces.sum(axis=0), [0, -9])


def test_an_earthquake_pushes_with_a_part_of_the_weight():
    staged = of_rock(
        box("tri3", (4, 4), size=(8.0, 5.0)),
        supports=(Support("y0", (0, 1)),),
        gravity=(0.0, -9.81),
        loads={"quake": Seismic(scalars(0.15, 0.05))},
    )
    weight = 2600 * 9.81 * 40
    total = staged.actions.forces(0, NOWHERE)[:, 0].reshape(-1, 2).sum(axis=0)
    np.testing.assert_allclose(total, [0.15 * weight, -0.95 * weight], rtol=1e-12)


def test_nothing_is_pushed_where_nothing_weighs():
    staged = of_rock(
        box("tri3", (4, 4), size=(8.0, 5.0)),
        supports=(Support("y0", (0, 1)),),
        loads={"quake": Seismic(scalars(0.15, 0.05))},
    )
    assert not staged.actions.forces(0, NOWHERE).any()


VALUES = {"f": 3e6, "k": 0.12, "density": 2500.0, "E": 8e9}


def shaken(names):
    def number(name):
        return Scalar(1.0, name) if name in names else Scalar(VALUES[name])

    return of_rock(
        box("quad8", (4, 4), size=(8.0, 8.0)),
        parameters=tuple(Parameter(n, VALUES[n], 0, np.inf) for n in names),
        materials={"rock": material("rock", number("E"), 0.3, number("density"))},
        supports=(Support("y0", (0, 1)),),
        gravity=(0.0, -9.81),
        stages=(
            Stage("anchor", loads={"a": PointForce((5.1, 6.3), (number("f"), Scalar(2e6)))}),
            Stage("quake", loads={"q": Seismic((number("k"), Scalar(0.02)))}),
        ),
        channels=(displacement("c", (2.0, 7.0), (0.6, 0.8)),),
    )


def test_forces_and_seismic_factors_are_differentiated_exactly():
    staged = shaken(tuple(VALUES))
    response = staged.response([("c", "anchor"), ("c", "quake")])
    assert_exact(response, np.array(list(VALUES.values())), staged.names)


def test_the_obstacle_is_the_factor_times_the_density():
    pairs = [("c", "quake")]
    assert "product of k and density" in shaken(("k", "density")).response(pairs).obstacle()
    assert shaken(("k", "f", "E")).response(pairs).obstacle() is None


def test_a_force_outside_the_ground_is_a_fault():
    with pytest.raises(InputError, match="lies in no ground"):
        of_rock(
            box("quad4", (2, 2)),
            loads={"f": PointForce((5.0, 5.0), scalars(0, 1))},
        )


def test_a_load_that_is_given_twice_is_at_fault_where_it_has_no_ground():
    """The same force before its ground is placed and again afterwards: the first is the fault."""
    mesh = regroup(box("quad4", (2, 2)), fill=lambda x: x[:, 1] > 0.5)
    force = PointForce((0.5, 0.9), scalars(0, 1))
    with pytest.raises(InputError) as error:
        of_rock(
            mesh,
            groups={"rock": "rock", "fill": None},
            loads={"f": force},
            stages=(
                Stage("fill", install={"fill": "rock"}, remove=("f",)),
                Stage("again", loads={"f": force}),
            ),
        )
    (fault,) = error.value.faults
    assert fault.path == "loads.f.at"
    assert "at stage 'virgin'" in fault.message


def test_a_load_on_faces_that_border_nothing_is_a_fault():
    """An edge across an element, as where a line was drawn into a mesh and not meshed along."""
    mesh = box("quad4", (2, 2))
    (ends,) = (block.nodes[:1] for block in mesh.blocks)
    lines = replace(mesh.facets[0], nodes=ends[:, [0, 2]], numbers=np.array([99]))
    number = sum(len(block) for block in mesh.facets)
    groups = {**mesh.facet_groups, "across": np.array([number])}
    mesh = replace(mesh, facets=(*mesh.facets, lines), facet_groups=groups)
    stage = Stage("one", loads={"p": Pressure("across", Scalar(1e5))})
    with pytest.raises(InputError) as caught:
        of_rock(
            mesh,
            stages=(stage,),
        )
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == ("missing-group", "stages[0].loads.p.on")
    assert fault.message == "some faces of 'across' border no element"
    assert fault.hint == "its groups of faces: across, outer, x0, x1, y0, y1"
