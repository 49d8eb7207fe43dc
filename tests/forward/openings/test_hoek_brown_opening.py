"""The opening in ground of Hoek and Brown: closed form, integration of the equations, elements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.yielding import Cavity, hoek, marched

from geoident.forward.openings.closed_forms import BeyondClosedForm, GroundState, Opening, Rock
from geoident.forward.openings.hoek_brown import EXPANDS, TORN, HoekBrownLimit
from geoident.model.case import Stage
from geoident.model.dual import Dual
from geoident.model.parameter import Scalar

MPa = 1e6
NAMES = ("sigci", "mb", "s", "a", "psi", "E", "nu", "p0", "z0", "p")


@dataclass(frozen=True)
class Site:
    """Numbers of a problem: SI, angles in rad, pressures positive in compression."""

    sigci: float = 30 * MPa
    mb: float = 0.9
    s: float = 8e-4
    a: float = 0.51
    psi: float = 0.1
    E: float = 4e9
    nu: float = 0.25
    p0: float = 10 * MPa
    z0: float = 10 * MPa
    p: float = 0.3 * MPa
    radius: float = 2.0

    def state(self) -> GroundState:
        """With derivatives by all numbers."""
        numbers = {
            name: Dual(np.concatenate([[getattr(self, name)], np.eye(len(NAMES))[k]]))
            for k, name in enumerate(NAMES)
        }
        rock = Rock(*(numbers[name] for name in ("E", "nu", "p0", "z0")))
        limit = HoekBrownLimit(*(numbers[name] for name in NAMES[:5]))
        return Opening(self.radius, rock, limit).under(numbers["p"])

    def width(self, radial: float) -> float:
        y = self.mb * radial / self.sigci + self.s
        return self.sigci * max(y, 0.0) ** self.a

    def integrated(self) -> tuple[float, float]:
        """Plastic radius and motion of the wall: stresses outwards, motions back inwards."""

        def at_edge(_way: float, radial: np.ndarray) -> float:
            return 2 * (self.p0 - radial[0]) - self.width(radial[0])

        at_edge.terminal = True
        out = solve_ivp(
            lambda _way, radial: [self.width(radial[0])],
            (0.0, 10.0),
            [self.p],
            events=at_edge,
            rtol=1e-12,
            atol=1e-4,
            dense_output=True,
        )
        far, K = out.t[-1], (1 + np.sin(self.psi)) / (1 - np.sin(self.psi))

        def moves(way: float, u: np.ndarray) -> list[float]:
            radial = out.sol(way)[0]
            hoop = radial + self.width(radial)
            axial = min(self.z0 + self.nu * (radial + hoop - 2 * self.p0), hoop)
            changes = np.array([radial - self.p0, hoop - self.p0, axial - self.z0])
            strain = ((1 + self.nu) * changes - self.nu * changes.sum()) / self.E
            shortens = strain[0] + K * (strain[1] + strain[2])
            return [-K * u[0] - self.radius * np.exp(way) * shortens]

        R = self.radius * np.exp(far)
        at_R = (out.y[0, -1] - self.p0) * R * (1 + self.nu) / self.E
        back = solve_ivp(moves, (far, 0.0), [at_R], rtol=1e-11, atol=1e-14, max_step=far / 200)
        return R, back.y[0, -1]


SITES = {
    "a little support": Site(),
    "none": Site(p=0.0),
    "no dilation, more stress along the tunnel": Site(psi=0.0, z0=14 * MPa),
    "no edge": Site(nu=0.45, p=2 * MPa),
    "poor ground, a of 0.6": Site(a=0.6, mb=0.4, s=1e-5),
    "intact": Site(sigci=12 * MPa, mb=8.0, s=1.0, a=0.5, p=0.0),
}


@pytest.mark.parametrize("name", SITES)
def test_closed_form_is_the_integral_of_the_equations(name):
    site = SITES[name]
    state = site.state()
    R, wall = site.integrated()
    assert state.plastic_radius is not None
    assert state.plastic_radius.value == pytest.approx(R, rel=1e-8)
    found = state.displacement(np.array([site.radius])).value[0]
    assert found == pytest.approx(wall, rel=1e-8)
    assert (state.edge_radius is None) == (name in ("no edge", "intact"))


@pytest.mark.parametrize("name", ["a little support", "no edge"])
def test_derivatives_of_motions_and_stresses(name):
    site, r = SITES[name], np.array([2.0, 2.2, 3.1, 9.0])

    def read(at: Site) -> np.ndarray:
        state = at.state()
        return np.stack([state.displacement(r).columns, *(x.columns for x in state.stresses(r))])

    exact = read(site)
    for k, parameter in enumerate(NAMES):
        h = 1e-5 * getattr(site, parameter)
        more, less = (
            read(replace(site, **{parameter: getattr(site, parameter) + side})) for side in (h, -h)
        )
        numeric = (more - less)[..., 0] / (2 * h)
        size = np.abs(numeric).max(axis=1, keepdims=True)
        assert np.abs(exact[..., 1 + k] - numeric).max(axis=1) == pytest.approx(
            0.0, abs=float(1e-6 * size.max())
        )


def test_stresses_meet_at_the_radii():
    state = SITES["a little support"].state()
    for radius in (state.plastic_radius, state.edge_radius):
        assert radius is not None
        sides = np.array([radius.value * (1 - 1e-9), radius.value * (1 + 1e-9)])
        for stress in state.stresses(sides):
            assert stress.value[0] == pytest.approx(stress.value[1], rel=1e-7)
        assert np.ptp(state.displacement(sides).value) < 1e-8


def test_back_and_forth():
    """Unloading is elastic until the wall yields the other way."""
    site = SITES["a little support"]
    state = site.state()
    opening, plain = state.opening, Dual(np.zeros(1 + len(NAMES)))
    path = [plain + 0.3 * MPa, plain + 0.5 * MPa, plain + 0.2 * MPa]
    first, second, third = opening.history(path)
    u = [float(s.displacement(np.array([2.0])).value[0]) for s in (first, second, third)]
    lame = 0.2 * MPa * 2.0 * (1 + site.nu) / site.E
    assert u[1] - u[0] == pytest.approx(lame, rel=1e-9)
    alone = replace(site, p=0.2 * MPa).state().displacement(np.array([2.0])).value[0]
    assert u[2] == pytest.approx(alone, rel=1e-12)
    with pytest.raises(BeyondClosedForm):
        list(opening.history([plain + 0.3 * MPa, plain + 9 * MPa]))


@pytest.mark.parametrize(("p", "why"), [(-0.1 * MPa, TORN), (19.9 * MPa, EXPANDS)])
def test_what_has_no_closed_form_is_refused(p, why):
    with pytest.raises(BeyondClosedForm, match=why.split(",", maxsplit=1)[0]):
        replace(Site(), p=p).state()


GROUND = Site(sigci=30 * MPa, mb=1.2, s=2e-3, a=0.507, psi=0.0, p=0.0, E=3e9, radius=1.0)


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
        axial = min(site.z0 + site.nu * (radial + hoop - 2 * site.p0), hoop)
        changes = np.array([radial - site.p0, hoop - site.p0, axial - site.z0])
        strain = ((1 + site.nu) * changes - site.nu * changes.sum()) / site.E
        shortens = strain[0] + K * (strain[1] + strain[2])
        return [-K * u[0] - np.exp(way) * shortens]

    edge = float(site.state().stresses(np.array([R]))[0].value[0])
    at_R = (edge - site.p0) * R * (1 + site.nu) / site.E
    exact = solve_ivp(moves, (np.log(R), 0.0), [at_R], rtol=1e-9, max_step=0.005).y[0, -1]
    assert wall == pytest.approx(exact, rel=0.01)
