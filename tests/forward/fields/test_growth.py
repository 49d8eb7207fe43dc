"""Stiffness that grows with depth or with the stress in situ (theory 10.7)."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.derivatives import assert_exact
from support.meshes import box

from geoident.errors import InputError
from geoident.forward.affine import affine_obstacle
from geoident.forward.reduced.reduction import reduction_obstacle
from geoident.model.actions import Pressure
from geoident.model.case import Analysis, Material, Stage, Support
from geoident.model.ground import (
    Attitude,
    Growth,
    Isotropic,
    TransverselyIsotropic,
    WithDepth,
    WithStress,
)
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import MohrCoulomb

H, LOAD, NU = 10.0, 100e3, 0.3
CONSTRAINED = (1 - NU) / ((1 + NU) * (1 - 2 * NU))
PRESS = Stage("press", loads={"q": Pressure("y1", Scalar(LOAD))})
SIDES = (Support("x1", (0,)),)


def number(value):
    return value if isinstance(value, Scalar) else Scalar(float(value))


def with_depth(base, gradient, surface, constant="E"):
    return Growth("soil", constant, number(base), WithDepth(number(gradient), number(surface)))


def with_stress(base, exponent, pressure, least=1.0):
    law = WithStress(number(exponent), number(pressure), number(least))
    return Growth("soil", "E", number(base), law)


def soil(*growths, nu=NU, **changes):
    given = {growth.constant: growth.base for growth in growths}
    elastic = Isotropic(**given, **({} if "K" in given else {"nu": number(nu)}))
    return Material("soil", elastic, growths=growths, **changes)


def column(material, points, *, cells=8, **changes):
    channels = tuple(displacement(f"c{k}", (0.5, y), (0.0, -1.0)) for k, y in enumerate(points))
    given = {
        "materials": {"soil": material},
        "groups": {"all": "soil"},
        "supports": (*rollers(2), *SIDES),
        "stages": (PRESS,),
        "channels": channels,
        **changes,
    }
    return model(box("quad8", (1, cells), size=(1.0, H)), **given)


def computed(staged, p=()):
    return staged.survey(np.array(p, float), fields=False).computed[:, 0]


def test_layer_whose_modulus_grows_with_depth(verification):
    """u = q / (c m) log((E0 + m H) / (E0 + m z)), c E being the constrained modulus."""
    E0, m, heights = 5e6, 2e6, (2.5, 5.0, 10.0)
    found = computed(column(soil(with_depth(E0, m, H)), heights))
    depth = H - np.array(heights)
    exact = LOAD / (CONSTRAINED * m) * np.log((E0 + m * H) / (E0 + m * depth))
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    verification("growth-with-depth", "", list(heights), exact=exact, found=found)


def test_layer_whose_modulus_grows_with_the_root_of_the_stress(verification):
    """p' = g (z + z0) (1 + 2 K0) / 3, E = E_ref sqrt(p'/P): u is a difference of roots."""
    E_ref, P, weight, K0, above, heights = 30e6, 100e3, 20e3, 0.5, 1.0, (2.5, 5.0, 10.0)
    stress = HeimStress(Scalar(K0), unit_weight=Scalar(weight), surface=Scalar(H + above))
    staged = column(soil(with_stress(E_ref, 0.5, P)), heights, in_situ=stress)
    depth = H - np.array(heights) + above
    size = CONSTRAINED * E_ref * np.sqrt(weight * (1 + 2 * K0) / 3 / P)
    exact = 2 * LOAD / size * (np.sqrt(H + above) - np.sqrt(depth))
    found = computed(staged)
    np.testing.assert_allclose(found, exact, rtol=3e-4)
    verification("growth-with-stress", "", list(heights), exact=exact, found=found)


def test_gibson_soil_settles_evenly_beneath_a_strip(verification):
    """R. E. Gibson (1967): G = m z, nu = 0.5: q / (2 m) beneath a strip load, nothing beside it.

    Every place moves by its own load alone. The sides of the model are closed, so a uniform load
    moves nothing: what counts is the load less its mean over the width of 16 m.
    """
    nu, m, q, places = 0.4998, 1e6, 10e3, (0.0, 0.5, 2.0, 4.0, 8.0)
    mesh = box("quad8", (20, 16), size=(1.0, 1.0))
    x, y = mesh.points.T
    # a strip of half a width of 1 m at the top of 16 m by 16 m, finer there
    mesh.points[:, 0] = np.where(x < 0.5, 2 * x, 2 * x + 14 * (2 * x - 1) ** 2)
    mesh.points[:, 1] = 16 * (1 - 0.1 * (1 - y) - 0.9 * (1 - y) ** 2)
    top = mesh.facet_groups["y1"]
    centre = np.vstack([mesh.points[b.nodes].mean(axis=1) for b in mesh.facets])[top, 0]
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, "strip": top[centre < 1.0]})
    growth = with_depth(0.0, 2 * (1 + nu) * m, 16.0)
    staged = model(
        mesh,
        materials={"soil": soil(growth, nu=nu)},
        groups={"all": "soil"},
        supports=(*rollers(2), *SIDES),
        stages=(Stage("load", loads={"q": Pressure("strip", Scalar(q))}),),
        channels=tuple(displacement(f"s{k}", (x, 16.0), (0, -1)) for k, x in enumerate(places)),
    )
    found = computed(staged)
    exact = ((np.array(places) < 1.0) - 1 / 16) * q / (2 * m)
    np.testing.assert_allclose(found, exact, atol=0.01 * q / (2 * m))
    verification("gibson-soil", "", list(places), exact=exact, found=found)


PARAMETERS = {
    "at": 6e6, "gradient": 1.5e6, "surface": 10.5, "nu": 0.3, "reference": 20e6,
    "exponent": 0.6, "pressure": 90e3, "K0": 0.7, "weight": 19e3,
}  # fmt: skip


def with_parameters(names, kind="quad8", **changes):
    """A block of 4 m by 10 m, loaded and then dug, with all numbers of a growth as parameters."""
    found = tuple(Parameter(n, PARAMETERS[n], -np.inf, np.inf) for n in names)
    given = {
        "parameters": found,
        "groups": {"all": "soil"},
        "supports": (*rollers(2), *SIDES),
        "stages": (PRESS,),
        "channels": tuple(
            displacement(f"c{k}", p, (0.4, -0.9)) for k, p in enumerate([(1.0, 9.0), (3.0, 4.0)])
        ),
        **changes,
    }
    staged = model(box(kind, (2, 3), size=(4.0, H), distortion=0.1), **given)
    return staged, np.array([PARAMETERS[n] for n in names])


PAIRS = [("c0", "press"), ("c1", "press")]
DEPTH = ("at", "gradient", "surface", "nu")
STRESS = ("reference", "exponent", "pressure", "K0", "weight")


def by_depth(constant="E"):
    return with_depth(Scalar(1.0, "at"), Scalar(1.0, "gradient"), Scalar(1.0, "surface"), constant)


@pytest.mark.parametrize("analysis", [Analysis.PLANE_STRAIN, Analysis.AXISYMMETRIC])
def test_derivatives_by_all_numbers_of_growth_with_depth(analysis):
    material = soil(by_depth(), nu=Scalar(1.0, "nu"))
    staged, p = with_parameters(DEPTH, materials={"soil": material}, analysis=analysis)
    assert_exact(staged.response(PAIRS), p, DEPTH)


def test_derivatives_by_all_numbers_of_growth_with_stress():
    growth = with_stress(*(Scalar(1.0, n) for n in STRESS[:3]))
    stress = HeimStress(
        Scalar(1.0, "K0"), unit_weight=Scalar(1.0, "weight"), surface=Scalar(H + 1), K0_across=None
    )
    staged, p = with_parameters(STRESS, materials={"soil": soil(growth)}, in_situ=stress)
    assert_exact(staged.response(PAIRS), p, STRESS)


def test_derivatives_where_only_one_modulus_grows():
    """The matrix is another one at every point: K grows, G does not; and strata."""
    growth = with_depth(Scalar(3.0, "at"), Scalar(1.0, "gradient"), H, "K")
    mixed = Material("soil", Isotropic(K=growth.base, G=Scalar(1.0, "at")), growths=(growth,))
    flat = Attitude(Scalar(0.2), Scalar(np.pi / 2))
    normal = with_depth(Scalar(1.0, "at"), Scalar(1.0, "gradient"), H, "E_n")
    strata = TransverselyIsotropic(
        Scalar(30e6), Scalar(0.2), normal.base, Scalar(0.1), Scalar(5e6), flat
    )
    for material in (mixed, Material("soil", strata, growths=(normal,))):
        staged, p = with_parameters(DEPTH[:2], materials={"soil": material})
        assert_exact(staged.response(PAIRS), p, DEPTH[:2])


def test_derivatives_where_the_ground_yields():
    surface = MohrCoulomb(Scalar(5e3), Scalar(0.2), planes=None)
    material = soil(by_depth(), nu=Scalar(1.0, "nu"), yields=(surface,))
    stress = ConstantStress(tuple(Scalar(v) for v in (-20e3, -30e3, -26e3, 2e3, 0.0, 0.0)))
    staged, p = with_parameters(DEPTH, materials={"soil": material}, in_situ=stress)
    activity = staged.survey(p, fields=True)
    assert activity.fields.yielded.any()
    assert_exact(staged.response(PAIRS), p, DEPTH, rtol=1e-6)


def test_stiffness_that_does_not_grow_is_a_number():
    """Gradient and exponent zero, whatever else."""
    plain = computed(column(Material("soil", Isotropic(E=Scalar(2e7), nu=Scalar(NU))), (10.0,)))
    stress = ConstantStress(tuple(Scalar(v) for v in (-5e4, -9e4, -7e4, 0.0, 0.0, 0.0)))
    for growth in (with_depth(2e7, 0.0, 3.0), with_stress(2e7, 0.0, 1e5)):
        found = computed(column(soil(growth), (10.0,), in_situ=stress))
        np.testing.assert_allclose(found, plain, rtol=1e-12)
    # of tension the least stress counts: 2e7 (1e3 / 1e5)^0.5
    pulled = ConstantStress((*[Scalar(5e4)] * 3, *[Scalar(0.0)] * 3))
    found = computed(column(soil(with_stress(2e7, 0.5, 1e5, 1e3)), (10.0,), in_situ=pulled))
    np.testing.assert_allclose(found, 10.0 * plain, rtol=1e-12)


def growth_note(staged):
    """What is said of a growth: values (2,), MPa, places (2, 2), m, and what follows."""
    (note,) = [one for one in staged.notes if one.startswith("E of soil grows with")]
    found = re.search(
        r"start values (\S+) MPa near \((.*?)\)(?: m)? to (\S+) MPa near \((.*?)\)", note
    )
    places = [[float(x) for x in found[k].split(",")] for k in (2, 4)]
    return np.array([float(found[1]), float(found[3])]), np.array(places), note[found.end() :]


def test_from_what_to_what_a_modulus_grows_is_said():
    staged = column(soil(with_depth(5e6, 2e6, H)), (10.0,))
    values, places, rest = growth_note(staged)
    heights = staged.discretization.points.position[:, 1]
    assert places[:, 1] == pytest.approx([heights.max(), heights.min()], rel=1e-3)
    assert values == pytest.approx(5.0 + 2.0 * (H - places[:, 1]), rel=1e-3)
    assert "p'" not in rest
    alike = column(soil(with_depth(2e7, 0.0, 3.0)), (10.0,))
    assert any("at the start values 20 MPa everywhere" in one for one in alike.notes)


@pytest.mark.parametrize("least", [1e3, 50e3, 1e6])
def test_how_much_of_the_ground_is_below_the_least_stress_is_said(least):
    """p' = g z (1 + 2 K0) / 3 of the skeleton; what is less than the least stress counts as it."""
    stress = HeimStress(Scalar(0.5), unit_weight=Scalar(20e3), surface=Scalar(H))
    staged = column(soil(with_stress(30e6, 0.5, 100e3, least)), (10.0,), in_situ=stress)
    pressure = 20e3 * (H - staged.discretization.points.position[:, 1]) * 2.0 / 3.0
    part = np.mean(pressure <= least)
    said = f"at {'100' if part == 1.0 else f'{100 * part:.2g}'} % of its points p' is not above"
    said += f" {least / 1e3:g} kPa, which counts there"
    if part < 1.0:
        values, _, rest = growth_note(staged)
        ends = 30.0 * np.sqrt(np.maximum([pressure.min(), pressure.max()], least) / 100e3)
        assert values == pytest.approx(ends, rel=1e-3)
        assert (said in rest) == (part > 0.0)
        assert ("p'" in rest) == (part > 0.0)
    else:
        assert any("MPa everywhere" in one and said in one for one in staged.notes)


def test_what_cannot_be_is_said_with_its_place():
    with pytest.raises(InputError, match=r"E of soil grows with depth: it is -.* Pa at \(.*, 0"):
        column(soil(with_depth(1e6, -2e5, H)), (10.0,))
    with pytest.raises(InputError, match="grows with the in-situ stress, and the case has none"):
        column(soil(with_stress(1e6, 0.5, 1e5)), (10.0,))
    hills = replace(with_depth(1e6, 1e5, H), law=WithDepth(Scalar(1e5), "hills"))
    with pytest.raises(InputError, match="no group of faces 'hills'"):
        column(soil(hills), (10.0,))
    growth = with_depth(Scalar(1.0, "at"), Scalar(1.0, "gradient"), H)
    staged, p = with_parameters(DEPTH[:2], materials={"soil": soil(growth)})
    assert staged.admissible(p) is None
    assert "must be positive" in staged.admissible(np.array([1e6, -1e6]))
    assert "E of soil grows with depth: at the start values" in "\n".join(staged.notes)
    assert reduction_obstacle(staged.analysis) == "E of soil grows with depth"
    assert "E of soil grows with depth" in affine_obstacle(staged.analysis)
