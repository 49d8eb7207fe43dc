"""Openings in ground of Hoek and Brown by elements, against the closed form (theory 4.6)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.yielding import Cavity, hoek, marched

from geoident.forward.openings.closed_forms import GroundState, Opening, Rock, flow_slope
from geoident.forward.openings.hoek_brown import HoekBrownLimit
from geoident.model.case import Stage
from geoident.model.dual import Dual
from geoident.model.parameter import Scalar

MPa = 1e6


def number(x: float) -> Dual:
    return Dual(np.array([x]))


@dataclass(frozen=True)
class Site:
    """Numbers of a problem: SI, angles in rad, pressures positive in compression."""

    sigci: float = 30 * MPa
    mb: float = 1.2
    s: float = 2e-3
    a: float = 0.507
    psi: float = 0.0
    E: float = 3e9
    nu: float = 0.25
    p0: float = 10 * MPa
    p: float = 0.0

    def state(self) -> GroundState:
        """The closed form, radius 1 m."""
        rock = Rock(*map(number, (self.E, self.nu, self.p0, self.p0)))
        constants = map(number, (self.sigci, self.mb, self.s, self.a))
        limit = HoekBrownLimit(*constants, flow_slope(number(self.psi)))
        return Opening(1.0, rock, limit).under(number(self.p))

    def width(self, radial: float) -> float:
        y = self.mb * radial / self.sigci + self.s
        return self.sigci * max(y, 0.0) ** self.a


GROUND = Site()


def opened(psi: float | None, *, n: int, layers: int, reach: float, p: float = 0.0):
    """Displacement of the wall and plastic radius by elements, in three stages."""
    cavity = Cavity(pressure=GROUND.p0, E=GROUND.E, nu=GROUND.nu)
    mesh = cavity.mesh("quad8", n=n, layers=layers, reach=reach)
    surface = hoek(GROUND.sigci, mb=GROUND.mb, s=GROUND.s, a=GROUND.a, psi=psi)
    parts = (0.6, 0.9, 1.0 - p / GROUND.p0) if psi is not None else (1.0 - p / GROUND.p0,)
    stages = tuple(
        Stage(f"s{k}", excavate=() if k else ("core",), release={"core": Scalar(part)})
        for k, part in enumerate(parts)
    )
    staged = cavity.staged(mesh, surface, stages=stages)
    end = marched(staged)[-1]
    wall = cavity.outwards(staged, end)
    assert np.ptp(wall) < 1e-3 * np.abs(wall).max()
    return wall.mean(), cavity.plastic_radius(staged, end)


@pytest.mark.parametrize("degrees", [0.0, 8.0, 20.0])
def test_opening_by_elements_within_one_percent(degrees, verification):
    psi = np.radians(degrees)
    state = replace(GROUND, psi=psi).state()
    exact = float(state.displacement(np.array([1.0])).value[0])
    errors = []
    for n, layers, reach in ((2, 20, 12), (3, 50, 40)):
        wall, radius = opened(psi, n=n, layers=layers, reach=reach)
        errors.append(abs(wall / exact - 1))
    assert errors[1] < 0.01
    assert errors[1] < 0.5 * errors[0]
    assert state.plastic_radius is not None
    assert radius == pytest.approx(float(state.plastic_radius.value), rel=0.02)
    name = f"dilation {degrees:g} degrees"
    verification("opening-hoek-brown", name, ["wall"], exact=-exact, found=-wall)


def test_associated_flow_by_elements():
    """In one stage: the dilation of the end counts for all of it, by an implicit return."""
    p = 0.6 * MPa
    wall, _ = opened(None, n=3, layers=60, reach=40, p=p)
    site = replace(GROUND, p=p)
    R = float(site.state().plastic_radius.value)

    def moves(way: float, u: np.ndarray) -> list[float]:
        w = (site.mb * p / site.sigci + site.s) ** (1 - site.a) + (1 - site.a) * site.mb * way
        radial = (w ** (1 / (1 - site.a)) - site.s) * site.sigci / site.mb
        K, hoop = 1 + site.mb * site.a / w, radial + site.width(radial)
        axial = min(site.p0 + site.nu * (radial + hoop - 2 * site.p0), hoop)
        changes = np.array([radial - site.p0, hoop - site.p0, axial - site.p0])
        strain = ((1 + site.nu) * changes - site.nu * changes.sum()) / site.E
        shortens = strain[0] + K * (strain[1] + strain[2])
        return [-K * u[0] - np.exp(way) * shortens]

    edge = float(site.state().stresses(np.array([R]))[0].value[0])
    at_R = (edge - site.p0) * R * (1 + site.nu) / site.E
    exact = solve_ivp(moves, (np.log(R), 0.0), [at_R], rtol=1e-9, max_step=0.005).y[0, -1]
    assert wall == pytest.approx(exact, rel=0.01)
