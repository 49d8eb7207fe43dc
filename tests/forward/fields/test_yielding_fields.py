"""Strengths and moduli that vary from strain point to strain point, in ground that yields."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, field_on, model, model_with_fields, rollers
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.errors import InputError
from geoident.model.actions import Pressure
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Attitude, Isotropic, RandomField
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.yielding import HoekBrown, MohrCoulomb

COHESION, YOUNG = 20e3, 50e6
XI = np.array([0.25, -0.3])
NAMES = ("left", "right")
# so that two principal stresses are not equal, at an edge of the surface
AROUND = ConstantStress(tuple(Scalar(v) for v in (-6e3, -9e3, -20e3, 2e3, 0.0, 0.0)))
PLANES = {"smooth": None, "planes": 12, "Hoek-Brown": "curved"}


def surface(c, planes, **more):
    if planes == "curved":
        sigci = replace(c, factor=4.0 * c.factor)
        return HoekBrown(sigci, mb=Scalar(1.0), s=Scalar(0.1), a=Scalar(0.51))
    return MohrCoulomb(c, Scalar(0.2), planes=planes, **more)


def ground(mesh, name, E, c, planes):
    return Material(name, Isotropic(E=E, nu=Scalar(0.3)), yields=(surface(c, planes),))


def square():
    mesh = box("quad8", (4, 4), size=(4.0, 4.0))
    return regroup(mesh, left=lambda c: c[:, 0] < 2.0, top=lambda c: c[:, 0] > 2.0)


def site(load=190e3):
    footing = {"q": Pressure("y1", Scalar(load))}
    return {
        "groups": {"left": "left", "top": "right"},
        "supports": (*rollers(2), Support("x1", (0,))),
        "in_situ": AROUND,
        "stages": (
            Stage("press", loads=footing),
            Stage("lift", remove=("q",)),
        ),
        "channels": tuple(
            displacement(f"c{k}", p, (0.3, 0.9)) for k, p in enumerate([(0.5, 3.9), (1.7, 3.0)])
        ),
    }


PAIRS = [("c0", "press"), ("c1", "press"), ("c0", "lift"), ("c1", "lift")]


def varying(planes, constants):
    """Both halves of one material; the modes are one in a half."""
    common = site()
    common["groups"] = {"left": "rock", "top": "rock"}

    def halves(x):
        return np.stack([x[:, 0] < 2.0, x[:, 0] > 2.0], axis=1).astype(float)

    def fields_of(on_mesh):
        found = []
        for constant in constants:
            strength = {"surface": 0} if constant == "cohesion" else {}
            name = "sigci" if strength and planes == "curved" else constant
            found.append(field_on(on_mesh, "rock", name, halves, names=NAMES, **strength))
        return found

    mean = Scalar(1.0, "c")
    rock = ground(None, "rock", Scalar(YOUNG), mean, planes)
    return model_with_fields(
        square(),
        fields_of,
        materials={"rock": rock},
        parameters=(
            Parameter("c", COHESION, 0.0, np.inf),
            *(Parameter(n, x, -9.0, 9.0) for n, x in zip(NAMES, XI, strict=True)),
        ),
        **common,
    )


def uniform_halves(planes, constants):
    factors = dict(zip(NAMES, np.exp(XI), strict=True))
    return model(
        square(),
        materials={
            name: ground(
                None,
                name,
                Scalar(YOUNG * (f if "E" in constants else 1.0)),
                Scalar(COHESION * (f if "cohesion" in constants else 1.0)),
                planes,
            )
            for name, f in factors.items()
        },
        **site(),
    )


@pytest.mark.parametrize("planes", PLANES)
def test_halves_by_modes_are_halves_by_materials(planes):
    planes, constants = PLANES[planes], ("cohesion", "E")
    one = varying(planes, constants).survey(np.array([COHESION, *XI]), fields=True)
    other = uniform_halves(planes, constants).survey(np.empty(0), fields=True)
    assert other.fields.yielded.any()
    np.testing.assert_array_equal(one.fields.yielded, other.fields.yielded)
    np.testing.assert_allclose(one.computed, other.computed, rtol=1e-8)


@pytest.mark.parametrize("constants", [("cohesion",), ("cohesion", "E")])
@pytest.mark.parametrize("planes", PLANES)
def test_derivatives_where_strengths_vary(planes, constants):
    staged = varying(PLANES[planes], constants)
    response = staged.response(PAIRS)
    assert "yields" in response.adjoints.obstacle
    p = np.array([COHESION, *XI])
    assert_exact(response, p, ("c", *NAMES), step=3e-5, rtol=1e-4)


REFUSED = {
    "an angle": ("friction", {}, "an angle.*makes the shape of the yield surface"),
    "another angle": ("dilation", {}, "a material of their own"),
    "a tension beside it": ("cohesion", {"tension": Scalar(1e3)}, "not change its shape"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_fields_that_change_the_shape_of_a_surface_are_refused(what):
    constant, more, said = REFUSED[what]
    flat = Attitude(Scalar(0.0), Scalar(np.pi / 2))
    field = RandomField("rock", constant, Scalar(1.0), 0.3, (2.0,), flat, surface=0)
    rock = Material(
        "rock",
        Isotropic(E=Scalar(YOUNG), nu=Scalar(0.3)),
        yields=(surface(Scalar(COHESION), None, **more),),
        fields=(field,),
    )
    common = site()
    common["groups"] = {"left": "rock", "top": "rock"}
    with pytest.raises(InputError, match=said):
        model(square(), materials={"rock": rock}, **common)
