"""Consolidation against closed forms: a column, a plate, a sphere and a cylinder (theory 18).

Terzaghi with compressible water; Mandel as in A. H.-D. Cheng and E. Detournay (Int. J. Numer. Anal.
Meth. Geomech. 12, 1988, 449-469); Cryer's sphere and De Leeuw's cylinder as in A. Verruijt, Theory
and Problems of Poroelasticity.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import j0, j1
from support.in_stages import read, write_msh
from support.meshes import box, opening

GAMMA_W = 9810.0
HEAD = """\
format: geoident-case/1
analysis: {analysis}
mesh: {{file: m.msh}}
materials:
  clay:
    E: {E} Pa
    nu: {nu}
    hydraulic: {{permeability: {k} m/s, storage: {S} 1/Pa, biot: {biot}}}
"""


def stiffness(E, nu):
    """K, G and the modulus of a confined column."""
    K, G = E / (3.0 * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))
    return K, G, K + 4.0 * G / 3.0


class Terzaghi:
    """A column of height h under a pressure q, drained at its top."""

    def __init__(self, E, nu, k, S, biot, h, q):
        m, self.h = 1.0 / stiffness(E, nu)[2], h
        self.c = k / GAMMA_W / (S + biot**2 * m)
        self.p0 = biot * m * q / (S + biot**2 * m)
        self.u0, self.end = q * m * h * S / (S + biot**2 * m), q * m * h

    def pressure(self, z, T):
        n = 2.0 * np.arange(400) + 1.0
        parts = (-1.0) ** np.arange(400) / n * np.cos(n * np.pi * z / (2.0 * self.h))
        return 4.0 * self.p0 / np.pi * parts @ np.exp(-np.outer(n**2, T) * np.pi**2 / 4.0)

    def settlement(self, T):
        n = 2.0 * np.arange(2000) + 1.0
        left = 8.0 / np.pi**2 * (n**-2) @ np.exp(-np.outer(n**2, T) * np.pi**2 / 4.0)
        return self.u0 + (self.end - self.u0) * (1.0 - left)


COLUMN = """\
groups: {all: clay}
supports: {x0: x, x1: x, SIDES y0: fixed}
drained: {TOP: {}}
stages:
  - {name: load, loads: {q: {on: TOP, pressure: 100 kPa}}, lasts: END s}
gauges:
  S: {kind: settlement, point: [TIP], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [FOOT], accuracy: 1 kPa}
  M: {kind: piezometer, point: [MIDDLE], accuracy: 1 kPa}
"""


def column(folder, kind, n, lasts, **constants):
    """A column as a case: in the plane along y, about its axis, or along z."""
    solid, revolved = kind in ("tet10", "hex20"), kind.startswith("about ")
    kind = kind.removeprefix("about ")
    cells, size = ((1, 1, n), (0.5, 0.5, 10.0)) if solid else ((1, n), (0.5, 10.0))
    mesh = box(kind, cells, size=size)
    top = "z1" if solid else "y1"
    write_msh(mesh, folder / "m.msh", sorted(set(mesh.facet_groups) - {"outer"}))
    text = COLUMN.replace("SIDES", "y0: y, y1: y," if solid else "").replace("TOP", top)
    if solid:
        text = text.replace("y0: fixed", "z0: fixed")
    across = "0.2 m, 0.3 m" if solid else "0.2 m"
    for word, height in (("TIP", "10 m"), ("FOOT", "0 m"), ("MIDDLE", "5 m")):
        text = text.replace(word, f"{across}, {height}")
    text = text.replace("END", str(lasts))
    analysis = "solid" if solid else "axisymmetric" if revolved else "plane-strain"
    path = folder / "case.yaml"
    path.write_text(HEAD.format(analysis=analysis, **constants) + text)
    return path


COMPRESSIBLE = {"E": 1e7, "nu": 0.25, "k": 1e-8, "S": 3e-8, "biot": 0.8}
TIMES = np.array([0.02, 0.05, 0.1, 0.2, 0.5, 1.0])


@pytest.mark.parametrize("kind", ["quad8", "tri6", "about quad8", "about tri6", "hex20", "tet10"])
def test_a_column_is_terzaghis(tmp_path, verification, kind):
    closed = Terzaghi(**COMPRESSIBLE, h=10.0, q=1e5)
    times = TIMES * closed.h**2 / closed.c
    path = column(tmp_path, kind, 20, times[-1], **COMPRESSIBLE)
    settlement, foot, middle = read(path, {"load": times[:-1]})
    np.testing.assert_allclose(settlement, closed.settlement(TIMES), atol=1e-3 * closed.end)
    np.testing.assert_allclose(foot, closed.pressure(0.0, TIMES), atol=2e-3 * closed.p0)
    np.testing.assert_allclose(middle, closed.pressure(5.0, TIMES), atol=2e-3 * closed.p0)
    verification("terzaghi", kind, TIMES, exact=closed.pressure(0.0, TIMES), found=foot)
    settled = closed.settlement(TIMES)
    verification("terzaghi-settlement", kind, TIMES, exact=settled, found=settlement)


@pytest.mark.parametrize(("kind", "cells"), [("quad8", (3, 6, 12, 24)), ("tri6", (3, 6, 12, 24))])
def test_errors_of_a_column_fall_with_its_elements(tmp_path, verification, kind, cells):
    """The pressure in the middle, soon after the load."""
    closed, T = Terzaghi(**COMPRESSIBLE, h=10.0, q=1e5), np.array([0.1])
    time = T[0] * closed.h**2 / closed.c
    found = [
        read(column(tmp_path, kind, n, time, **COMPRESSIBLE), overrides=("time_steps=24",))[2, 0]
        for n in cells
    ]
    exact = closed.pressure(5.0, T)[0]
    errors = np.abs(np.array(found) / exact - 1.0)
    assert (errors[:-1] > 3.0 * errors[1:]).all()
    verification("terzaghi-elements", kind, cells, exact=exact, found=found)


def test_errors_of_a_column_fall_with_its_steps(tmp_path, verification):
    closed, T = Terzaghi(**COMPRESSIBLE, h=10.0, q=1e5), np.array([0.1])
    time, steps = T[0] * closed.h**2 / closed.c, (1, 2, 3, 6, 12)
    path = column(tmp_path, "quad8", 40, time, **COMPRESSIBLE)
    found = [read(path, overrides=(f"time_steps={n}",))[2, 0] for n in steps]
    exact = closed.pressure(5.0, T)[0]
    assert abs(found[-1] / exact - 1.0) < 5e-4
    assert abs(found[0] / exact - 1.0) > 3.0 * abs(found[1] / exact - 1.0)
    verification("terzaghi-steps", "", steps, exact=exact, found=found)


MANDEL = """\
groups: {all: clay}
supports: {x0: x, y0: y}
drained: {x1: {}}
structures:
  plate: {kind: beam, on: y1, EA: 1 N/m, EI: 1e6 MNm2/m, clamped_on: [x0]}
stages:
  - {name: load, build: [plate], loads: {q: {on: y1, pressure: 100 kPa}}, lasts: END s}
gauges:
  P0: {kind: piezometer, point: [0 m, 0.05 m], accuracy: 1 kPa}
  P6: {kind: piezometer, point: [0.6 m, 0.05 m], accuracy: 1 kPa}
  U: {kind: displacement, point: [1 m, 0.05 m], direction: [1, 0], accuracy: 0.1 mm}
  S: {kind: settlement, point: [0.5 m, 0.1 m], accuracy: 0.1 mm}
"""
IN_SPACE = {
    # of a shell that bears nothing along itself and does not bend
    "kind: beam, on: y1, EA: 1 N/m, EI: 1e6 MNm2/m, clamped_on: [x0]": "kind: shell, on: z1, "
    "E: 1e-3 Pa, nu: 0, thickness: 100 km, axis: [1, 0, 0], mirrored_on: [x0, y0, y1]",
    "y0: y}": "y0: y, y1: y, z0: z}",
    "on: y1": "on: z1",
    " m, 0.05 m]": " m, 0, 0.05 m]",
    " m, 0.1 m]": " m, 0, 0.1 m]",
    "[1, 0]": "[1, 0, 0]",
}


def mandel(E, nu, k, S, biot, times, q):
    """Pressures at x = 0 and 0.6 a, motion of the side and of the plate; a = 1 m, height 0.1 m."""
    K, G, column_ = stiffness(E, nu)
    undrained = K + biot**2 / S
    B, nu_u = biot / S / undrained, (3 * undrained - 2 * G) / (2 * (3 * undrained + G))
    c = k / GAMMA_W / (S + biot**2 / column_)
    ratio = (1 - nu) / (nu_u - nu)
    inner = [(n * np.pi + 1e-9, (n + 0.5) * np.pi - 1e-9) for n in range(200)]
    w = np.array([brentq(lambda x: np.tan(x) - ratio * x, *ends) for ends in inner])[:, None]
    fade, sine, cosine = np.exp(-(w**2) * c * times), np.sin(w), np.cos(w)
    bulge = sine * cosine / (w - sine * cosine)

    def pressure(x):
        parts = sine / (w - sine * cosine) * (np.cos(w * x) - cosine) * fade
        return 2.0 * q * B * (1 + nu_u) / 3.0 * parts.sum(axis=0)

    fall = q * (1 - nu) / (2 * G) - q * (1 - nu_u) / G * (bulge * fade).sum(axis=0)
    out = q * nu / (2 * G) - q * nu_u / G * (bulge * fade).sum(axis=0)
    out += q / G * (cosine / (w - sine * cosine) * sine * fade).sum(axis=0)
    return pressure(0.0), pressure(0.6), out, 0.1 * fall


@pytest.mark.parametrize("analysis", ["plane-strain", "solid"])
def test_a_plate_is_mandels_and_pressures_rise_first(tmp_path, verification, analysis):
    """In the plane the plate is a beam, in space a shell."""
    constants = {"E": 1.8e6, "nu": 0.2, "k": 1e-8, "S": 1e-7, "biot": 0.9}
    c = 1e-8 / GAMMA_W / (1e-7 + 0.81 / stiffness(1.8e6, 0.2)[2])
    times = np.array([0.002, 0.01, 0.02, 0.05, 0.1, 0.3, 1.0]) / c
    text, mesh = MANDEL.replace("END", str(times[-1])), box("quad8", (24, 1), size=(1.0, 0.1))
    if analysis == "solid":
        mesh = box("hex20", (24, 1, 1), size=(1.0, 0.1, 0.1))
        for plane, space in IN_SPACE.items():
            text = text.replace(plane, space)
    write_msh(mesh, tmp_path / "m.msh", sorted(set(mesh.facet_groups) - {"outer"}))
    path = tmp_path / "case.yaml"
    path.write_text(HEAD.format(analysis=analysis, **constants) + text)
    found = read(path, {"load": times[:-1]})
    wanted = mandel(**constants, times=times, q=1e5)
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, atol=3e-3 * np.abs(other).max())
    assert found[0].argmax() == 3
    assert found[0].max() > 1.02 * found[0][0]
    under = ", under a shell" * (analysis == "solid")
    for n, place in enumerate(("in the middle", "at 0.6 of the half width")):
        verification("mandel", place + under, c * times, exact=wanted[n], found=found[n])


ROUND = """\
groups: {core: clay, rock: clay}
supports: {x0: x, y0: y}
drained: {round: {}}
stages:
  - {name: load, loads: {q: {on: round, pressure: 100 kPa}}, lasts: END s}
gauges:
  P: {kind: piezometer, point: [0 m, 0 m], accuracy: 1 kPa}
"""


def round_mesh(dim, n, layers, kind):
    """A quarter of a disc, or an octant of a ball, of radius 1, with its round face."""
    mesh = opening(kind, dim, n=n, layers=layers, radius=0.5, reach=1.0)
    on = [np.linalg.norm(mesh.points[f.nodes], axis=2).min(axis=1) > 1 - 1e-6 for f in mesh.facets]
    groups = {**mesh.facet_groups, "round": np.flatnonzero(np.concatenate(on))}
    return replace(mesh, facet_groups=groups)


def cryer(nu, T):
    """Pressure at the centre of a sphere, by that on its surface."""
    eta = (1.0 - nu) / (1.0 - 2.0 * nu)
    r = roots(lambda x: (1.0 - eta * x * x / 2.0) * np.sin(x) - x * np.cos(x))
    parts = (np.sin(r) - r) / (eta * r * np.cos(r) / 2.0 + (eta - 1.0) * np.sin(r))
    return eta * parts @ np.exp(-np.outer(r**2, T))


def de_leeuw(nu, T):
    """Pressure on the axis of a cylinder in plane strain, by that on its surface."""
    m = (1.0 - nu) / (2.0 * (1.0 - 2.0 * nu))
    r = roots(lambda x: 2.0 * m * x * j0(x) - j1(x))
    parts = (1.0 - 1.0 / j0(r)) / (1.0 - m * r**2 - 1.0 / (4.0 * m))
    return parts @ np.exp(-np.outer(r**2, T))


def roots(function):
    """Its first roots above zero."""
    x = np.linspace(1e-3, 150.0, 60001)
    y = function(x)
    at = np.flatnonzero(y[:-1] * y[1:] < 0)
    return np.array([brentq(function, x[i], x[i + 1]) for i in at])


@pytest.mark.parametrize(
    ("analysis", "closed", "nu", "cells", "error"),
    [
        ("axisymmetric", cryer, 0.0, (9, 14), 5e-3),
        ("axisymmetric", cryer, 0.333, (9, 14), 5e-3),
        ("plane-strain", de_leeuw, 0.2, (9, 14), 5e-3),
        *(
            pytest.param("solid", cryer, 0.2, cells, error, marks=pytest.mark.slow)
            for cells, error in (((4, 6), 1.1e-2), ((5, 9), 7e-3), ((6, 12), 5e-3))
        ),
    ],
)
def test_a_ball_and_a_cylinder_have_the_pressures_of_cryer_and_de_leeuw(
    tmp_path, verification, analysis, closed, nu, cells, error
):
    """`cells` are those along a side of the core and the rings around it."""
    constants = {"E": 1e7, "nu": nu, "k": 1e-8, "S": 1e-12, "biot": 1.0}
    c = 1e-8 / GAMMA_W * stiffness(1e7, nu)[2]
    T = np.array([0.01, 0.03, 0.05, 0.1, 0.2, 0.5])
    dim, kind = (3, "hex20") if analysis == "solid" else (2, "quad8")
    write_msh(
        round_mesh(dim, *cells, kind),
        tmp_path / "m.msh",
        ["x0", "y0", "round"] + ["z0"] * (dim == 3),
    )
    path = tmp_path / "case.yaml"
    text = ROUND.replace("END", str(T[-1] / c))
    if dim == 3:
        text = text.replace("y0: y", "y0: y, z0: z").replace("[0 m, 0 m]", "[0 m, 0 m, 0 m]")
    path.write_text(HEAD.format(analysis=analysis, **constants) + text)
    (found,) = read(path, {"load": T[:-1] / c})
    np.testing.assert_allclose(found / 1e5, closed(nu, T), atol=error * closed(nu, T).max())
    assert found.max() > 1.1e5  # Cryer's rise above the load
    variant = f"{analysis}, nu {nu}"
    if dim == 3:
        variant += f", {cells[0]} cells and {cells[1]} rings"
    entry = "cryer" if closed is cryer else "de-leeuw"
    verification(entry, variant, T, exact=1e5 * closed(nu, T), found=found)
