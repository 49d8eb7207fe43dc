"""Strains of the ground: at a point, between points, along a fibre; exact for linear fields."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.force_gauges import gauge
from support.meshes import box, regroup
from support.revolved import revolve, section

from geoident.model.actions import Pressure
from geoident.model.case import Stage, Support
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar

INNER, OUTER, PRESSURE, E, NU = 1.0, 3.0, 5e6, 4e9, 0.25
NOTHING = np.empty(0)


def _along(name, *line):
    """A mean strain along a line, as the case file makes it."""
    length = sum(np.linalg.norm(np.subtract(b, a)) for a, b in pairwise(line))
    terms = []
    for a, b in pairwise(line):
        t = np.subtract(b, a) / np.linalg.norm(np.subtract(b, a)) / length
        terms += [(a, tuple(-t)), (b, tuple(t))]
    return gauge("strain", name, line[-1], terms=tuple(terms), first=line[0])


def _cylinder(kind, n, *channels):
    """A thick cylinder of one metre length between smooth ends, pressed from inside."""
    mesh = section(kind, n, (OUTER - INNER, 1.0), inner=INNER)
    return revolve(
        mesh,
        materials={"steel": material("steel", E, NU)},
        groups={"all": "steel"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        stages=(Stage("press", loads={"p": Pressure("x0", Scalar(PRESSURE))}),),
        channels=channels,
    ).survey(NOTHING, fields=False).computed[:, 0]  # fmt: skip


def _lame(r):
    """Strains rr and tt of the thick cylinder, and the displacement (Lame 1852), plane strain."""
    a, b = INNER**2, OUTER**2
    factor = (1 + NU) / E * PRESSURE * a / (b - a)
    return factor * (1 - 2 * NU - b / r**2), factor * (1 - 2 * NU + b / r**2)


@pytest.mark.parametrize(("kind", "n"), [("quad8", (16, 4)), ("tri3", (60, 6))])
def test_strains_at_points_of_lames_cylinder(kind, n):
    radii = (1.2, 1.7, 2.6)
    channels = [
        gauge("strain", f"{r} {c}", (r, 0.4), c) for r in radii for c in ("xx", "yy", "zz", "xy")
    ]
    found = _cylinder(kind, n, *channels).reshape(-1, 4)
    for (radial, axial, hoop, shear), r in zip(found, radii, strict=True):
        rr, tt = _lame(r)
        assert radial == pytest.approx(rr, rel=0.01)
        assert hoop == pytest.approx(tt, rel=0.01)
        assert abs(axial) < 0.01 * tt
        assert abs(shear) < 0.01 * tt


def test_a_fibre_in_lames_cylinder_reads_the_mean_radial_strain(verification):
    """(u(b) - u(a)) / (b - a) for every base length, with u from Lame's strains: eps_tt r."""
    ends = np.linspace(1.1, 2.9, 10)
    fibre = [_along(f"F{k}", (a, 0.5), (b, 0.5)) for k, (a, b) in enumerate(pairwise(ends))]
    found = _cylinder("quad8", (16, 2), *fibre)
    u = np.array([_lame(r)[1] * r for r in ends])
    exact, middle = np.diff(u) / np.diff(ends), (ends[1:] + ends[:-1]) / 2
    np.testing.assert_allclose(found, exact, rtol=2e-3)
    verification("fibre", "", middle, exact=exact, found=found)


def test_any_strain_is_met_where_displacements_are_linear():
    """Confined compression along y: eps_yy only; along a bent fibre the mean of its pieces."""
    mesh = box("tri3", (4, 4), size=(2.0, 2.0), distortion=0.2)
    line = (0.3, 0.2), (0.3, 1.2), (0.8, 1.2)
    channels = (
        gauge("strain", "along", (0.7, 0.9), direction=(0.6, 0.8)),
        gauge("strain", "yy", (0.7, 0.9), "yy"),
        gauge("strain", "xy", (0.7, 0.9), "xy"),
        _along("bent", *line),
        _along("slant", (0.2, 0.2), (0.8, 1.0)),
    )
    modulus = 1e9 * (1 - 0.2) / ((1 + 0.2) * (1 - 0.4))
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (1,))),
        stages=(Stage("press", loads={"p": Pressure("y1", Scalar(1e6))}),),
        channels=channels,
    )
    found = staged.survey(NOTHING, fields=False).computed[:, 0]
    yy = -1e6 / modulus
    np.testing.assert_allclose(found, [0.64 * yy, yy, 0.0, yy / 1.5, 0.64 * yy], atol=1e-9 * -yy)


VALUES = {"E": 5e9, "nu": 0.28, "v": 8e6, "K0": 0.6}


@pytest.mark.parametrize("dim", [2, 3])
def test_strains_are_exact_in_their_derivatives_and_serve_condensation(dim):
    names = tuple(VALUES)
    mesh = box("hex8" if dim == 3 else "quad8", (3,) * dim, size=(3.0,) * dim)
    mesh = regroup(mesh, core=lambda x: (x[:, 0] < 1.5) & (x[:, -1] > 1.0))
    one, other = (2.1, 0.7, 0.8)[:dim], (2.6, 0.3, 1.9)[:dim]
    channels = (
        gauge("strain", "a", one, "xx"),
        gauge("strain", "b", one, direction=(0.6, 0.8, 0.0)[:dim]),
        gauge("strain", "late", one, "xy", zero="dig"),
        _along("c", one, other),
        displacement("d", other, (1.0, 0.0, 0.0)[:dim]),
    )
    staged = model(
        mesh,
        parameters=tuple(Parameter(n, v, v / 2, v * 1.7) for n, v in VALUES.items()),
        materials={"rock": material("rock", Scalar(1.0, "E"), Scalar(1.0, "nu"))},
        groups={"rock": "rock", "core": "rock"},
        supports=rollers(dim),
        in_situ=HeimStress(Scalar(1.0, "K0"), vertical=Scalar(1.0, "v")),
        stages=(
            Stage("dig", excavate=("core",)),
            Stage("load", loads={"q": Pressure("x1", Scalar(2e6))}),
        ),
        channels=channels,
    )
    p = np.array(list(VALUES.values()))
    pairs = [(c.name, s) for c in channels for s in ("dig", "load") if c.name != "late"]
    response = staged.response([*pairs, ("late", "load")])
    assert_exact(response, p, names)
    assert "something else" not in (response.obstacle() or "")
    rows = np.arange(len(channels))
    assert staged.gauges.operator(rows).shape == (5, mesh.points.size)
