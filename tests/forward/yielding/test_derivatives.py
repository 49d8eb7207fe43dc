"""Exact derivatives of readings where ground yields, against differences, and at a kink."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from support.cases import displacement, model, rollers
from support.derivatives import together
from support.meshes import box, regroup
from support.tunnels import walled
from support.yielding import constant, given, hoek, mohr, parameters, rock

from geoident.forward.model import StagedModel
from geoident.model.actions import Pressure, Traction, Water
from geoident.model.case import Analysis, Stage, Support
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.in_situ import HeimStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam


def tied(name: str, factor: float = 1.0) -> Scalar:
    return Scalar(factor, name)


@dataclass(frozen=True)
class Problem:
    """A model, where to differentiate, and what is read."""

    staged: StagedModel
    p: np.ndarray
    pairs: list[tuple[str, str]]


def problem(mesh: Mesh, stages, at, **changes: Any) -> Problem:
    values = changes.pop("values")
    dim = mesh.dim
    channels = [
        displacement(f"g{k}", tuple(x), tuple(np.eye(dim)[k % dim])) for k, x in enumerate(at)
    ]
    staged = model(
        mesh, parameters=parameters(**values), stages=stages, channels=tuple(channels), **changes
    )
    pairs = [(c.name, stage.name) for stage in stages for c in channels]
    return Problem(staged, np.array(list(values.values())), pairs)


def release(*parts) -> tuple[Stage, ...]:
    """The core leaves in parts."""
    return tuple(
        Stage(f"s{n}", excavate=() if n else ("core",), release={"core": part})
        for n, part in enumerate(parts)
    )


def tunnel(*yields, extra=(), stages=None, **values) -> Problem:
    mesh = walled("tri6", n=3, layers=12, radius=2.0, reach=16.0)
    values = {"E": 7e9, "nu": 0.2, "sig": -20e6, "lam": 0.7, **values}
    stages = stages or release(tied("lam"), Scalar(1.0))
    r = np.array([2.0, 2.3, 3.0, 2.2])
    angle = np.array([0.3, 0.9, 1.2, 0.06])
    at = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1) * 1.0001
    changes = {
        "materials": {"rock": rock(tied("E"), tied("nu"), *yields, expansion=1e-5)},
        "groups": {"core": "rock", "rock": "rock"},
        "supports": rollers(2),
        "in_situ": constant(tied("sig"), tied("sig", 1.15), tied("sig", 1.05)),
        **dict(extra),
    }
    return problem(mesh, stages, at, values=values, **changes)


MOHR = {"c": 2.5e6, "phi": 0.5}
strength = (tied("c"), tied("phi"))


def octahedron(hardening: float | Scalar = 0.0):
    """Ten planes, tied in pairs to five distances."""
    rng = np.random.default_rng(4)
    half = np.hstack([rng.normal(size=(5, 4)), np.zeros((5, 2))])
    half[:, :3] -= half[:, :3].mean(axis=1)[:, None]
    names = ["k1", "k1", "k2", "k2", "k3"]
    factors = [1.0, 1.2, 1.0, 0.9, 1.0]
    distances = [tied(n, f) for n, f in zip(names, factors, strict=True)]
    return given(np.vstack([half, -half]), distances * 2, hardening)


KS = {"k1": 7e6, "k2": 7.5e6, "k3": 8e6}


def lined() -> Problem:
    lining = Beam("wall", EA=tied("EA"), EI=Scalar(1e6), clamped_on=("x0", "y0"))
    stages = (
        Stage("s0", excavate=("core",), release={"core": tied("lam")}),
        Stage("s1", build=("lining",), release={"core": Scalar(1.0)}),
    )
    extra = {"structures": {"lining": lining}}
    return tunnel(mohr(*strength), extra=extra, stages=stages, EA=3e9, **MOHR)


def warmed() -> Problem:
    stages = (
        Stage("s0", excavate=("core",), release={"core": tied("lam")}),
        Stage("s1", release={"core": Scalar(1.0)}, temperature={"rock": tied("T")}),
        Stage("s2", temperature={"rock": tied("T", -0.5)}),
    )
    return tunnel(mohr(*strength, planes=12), stages=stages, T=30.0, **MOHR)


def soaked() -> Problem:
    """Water rises in the pores of a slope under a load."""
    mesh = regroup(
        box("quad8", (6, 4), size=(12.0, 8.0)), cut=lambda c: (c[:, 0] < 4) & (c[:, 1] > 4)
    )
    centres = np.concatenate([mesh.points[b.nodes].mean(axis=1) for b in mesh.facets])
    top = np.flatnonzero((centres[:, 1] > 7.99) & (centres[:, 0] > 4))
    mesh = replace(mesh, facet_groups={**mesh.facet_groups, "top": top})
    water = Water(Scalar(6.0), tied("gw"))
    stages = (
        Stage("dig", excavate=("cut",)),
        Stage("rise", water=water),
        Stage("load", loads={"p": Traction("top", (Scalar(0.0), tied("q", -1.0)))}),
    )
    return problem(
        mesh,
        stages,
        [(4.0, 6.0), (5.0, 7.5), (8.0, 8.0), (4.3, 5.0)],
        values={"E": 5e7, "K0": 0.6, "c": 2.2e4, "phi": 0.5, "gw": 1e4, "q": 2e4},
        materials={
            "soil": rock(tied("E"), 0.3, mohr(*strength, planes=16), name="soil", density=2e3)
        },
        groups={"cut": "soil", "rock": "soil"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        gravity=(0.0, -10.0),
        in_situ=HeimStress(K0=tied("K0"), unit_weight=Scalar(2e4), surface=Scalar(8.0)),
    )


def pressed_shaft(*yields, **values) -> Problem:
    """A thick tube about its axis, pressed inside, released, pressed again."""
    mesh = box("quad8", (8, 3), size=(2.0, 1.0))
    mesh = replace(mesh, points=mesh.points + np.array([1.0, 0.0]))
    stages = tuple(
        Stage(f"s{n}", loads={"p": Pressure("x0", tied("p", f))})
        for n, f in enumerate((1.0, 0.1, 1.1))
    )
    return problem(
        mesh,
        stages,
        [(1.0, 0.5), (1.3, 1.0), (2.0, 0.7), (2.9, 0.9)],
        analysis=Analysis.AXISYMMETRIC,
        values={"E": 2e9, "nu": 0.25, "p": 6e6, **values},
        materials={"rock": rock(tied("E"), tied("nu"), *yields)},
        groups={"all": "rock"},
        supports=(Support("y0", (0, 1)),),
    )


def block(*yields, **values) -> Problem:
    """A cube with one corner pressed."""
    stages = (
        Stage("s0", loads={"p": Traction("z1", (tied("q", 0.2), Scalar(0.0), tied("q", -1.0)))}),
        Stage("s1", loads={"s": Pressure("x1", tied("q", 0.3))}),
    )
    return problem(
        box("hex8", (3, 3, 3), distortion=0.1),
        stages,
        [(0.6, 0.6, 0.99), (1.0, 0.3, 0.7), (0.4, 1.0, 0.8)],
        values={"E": 1e9, "nu": 0.3, "q": 3.6e6, "sig": -1e6, **values},
        materials={"rock": rock(tied("E"), tied("nu"), *yields)},
        groups={"all": "rock"},
        supports=(Support("z0", (0, 1, 2)),),
        in_situ=constant(tied("sig"), tied("sig", 0.9), tied("sig", 1.2)),
    )


def by_gsi() -> Problem:
    """Strength and stiffness of a rock mass by the same GSI and D, with its own dilation."""
    surface = hoek(tied("sigci"), mi=tied("mi"), GSI=tied("GSI"), D=tied("D"), psi=tied("psi"))
    modulus = RockMassModulus(GSI=tied("GSI"), D=tied("D"), Ei=tied("E"))
    extra = {"materials": {"rock": rock(modulus, tied("nu"), surface)}}
    values = {"E": 40e9, "sigci": 60e6, "mi": 12.0, "GSI": 55.0, "D": 0.2, "psi": 0.15}
    return tunnel(extra=extra, stages=release(tied("lam"), Scalar(0.97)), **values)


MASS = {"sigci": tied("sigci"), "mb": tied("mb"), "s": tied("s"), "a": tied("a")}
STRONG = {"sigci": 60e6, "mb": 2.0, "s": 0.08, "a": 0.505}

PROBLEMS = {
    "tunnel, Hoek-Brown by GSI": by_gsi,
    "tunnel, Hoek-Brown, associated": lambda: tunnel(hoek(**MASS), **STRONG),
    "shaft, Hoek-Brown, cut-off": lambda: pressed_shaft(
        hoek(**MASS, tension=tied("cut")), sigci=14e6, mb=2.0, s=0.85, a=0.51, cut=3.3e6
    ),
    "tunnel, smooth": lambda: tunnel(mohr(*strength), **MOHR),
    "tunnel, inscribed, cut-off": lambda: tunnel(
        mohr(*strength, planes=10, tension=tied("cut"), fit="inscribed"), cut=2e5, **MOHR
    ),
    "tunnel, given planes": lambda: tunnel(octahedron(), **KS),
    "tunnel, given planes, hardening": lambda: tunnel(octahedron(tied("h")), h=1e9, **KS),
    "lining": lined,
    "temperature": warmed,
    "water": soaked,
    "shaft, smooth, cut-off": lambda: pressed_shaft(
        mohr(*strength, tension=tied("cut")), c=5e6, phi=0.4, cut=4.2e6
    ),
    "shaft, planes": lambda: pressed_shaft(mohr(*strength, planes=12), c=3e6, phi=0.3),
    "shaft, hardening": lambda: pressed_shaft(
        octahedron(tied("h")), h=2e8, k1=4e6, k2=3.6e6, k3=4e6
    ),
    "solid, smooth": lambda: block(mohr(*strength), c=9e5, phi=0.4),
    "solid, planes": lambda: block(mohr(*strength, planes=48), c=9e5, phi=0.4),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_derivatives_are_those_of_differences(name):
    """Steps small enough that no point changes its planes; the best of several steps."""
    given_ = PROBLEMS[name]()
    response = given_.staged.response(given_.pairs)
    v, jacobian = response.evaluate(given_.p)
    assert np.all(np.isfinite(v))
    assert response.activity(given_.p).points.sum() > 3
    scale = np.abs(jacobian).max(axis=0)
    for parameter, size in zip(response.names, scale, strict=True):
        assert size > 0, f"{parameter} acts on nothing in this test"

    def agree(way):
        """Whether central differences along a way agree, in the size of the least column."""
        slope = 0.5 * (response.readings(given_.p + way) - response.readings(given_.p - way))
        least = (scale * np.abs(way))[way != 0.0].min()
        return np.abs(slope - jacobian @ way).max() < 1e-6 * least

    steps, every = (3e-5, 3e-6, 3e-4, 3e-7), np.arange(len(scale))  # mostly the first will do
    if any(agree(together(given_.p, scale, every, step)) for step in steps[:2]):
        return  # all of them at once
    for column, parameter in enumerate(response.names):
        alone = abs(given_.p[column]) * np.eye(len(scale))[column]
        assert any(agree(step * alone) for step in steps), parameter


def test_at_a_kink_the_derivative_is_one_of_the_two():
    """A bar pulled exactly to its limit k: elastic on one side, hardening on the other."""
    E, k, h = 1e9, 1e6, 0.25e9
    kink = problem(
        box("quad4", (1, 1)),
        (Stage("pull", loads={"p": Traction("y1", (Scalar(0.0), tied("q")))}),),
        [(0.5, 1.0), (0.5, 1.0)],
        values={"q": k, "k": k},
        materials={"rock": rock(E, 0.0, given(np.eye(6)[[1]], [tied("k")], h))},
        groups={"all": "rock"},
        supports=rollers(2),
    )
    response = kink.staged.response(kink.pairs)
    slopes = response.evaluate(kink.p)[1][1]
    sides = np.array([[1 / E, 0.0], [1 / E + 1 / h, -1 / h]])
    assert np.any(np.all(np.isclose(slopes, sides, rtol=1e-9, atol=1e-18), axis=1))
    found = [response.evaluate(kink.p * [1 + d, 1])[1][1] for d in (-1e-6, 1e-6)]
    np.testing.assert_allclose(found, sides, rtol=1e-9, atol=1e-18)
