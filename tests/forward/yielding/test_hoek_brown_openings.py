"""Openings in ground of Hoek and Brown by elements, against the closed form (theory 4.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from support.cases import model
from support.meshes import from_grid, regroup
from support.yielding import NOTHING, Cavity, analysed, constant, dual, hoek, rock

from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.openings.closed_forms import GroundState, flow_slope
from geoident.forward.openings.hoek_brown import HoekBrownLimit
from geoident.model.case import Analysis, Stage, Support
from geoident.model.parameter import Scalar

MPa = 1e6


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

    @property
    def cavity(self) -> Cavity:
        return Cavity(pressure=self.p0, E=self.E, nu=self.nu)

    def state(self) -> GroundState:
        """The closed form, radius 1 m."""
        constants = map(dual, (self.sigci, self.mb, self.s, self.a))
        limit = HoekBrownLimit(*constants, flow_slope(dual(self.psi)))
        return self.cavity.closed_form(limit, 1.0 - self.p / self.p0)

    def width(self, radial: float) -> float:
        y = self.mb * radial / self.sigci + self.s
        return self.sigci * max(y, 0.0) ** self.a


GROUND = Site()


def opened(psi: float, *, n: int, layers: int, reach: float):
    """Displacement of the wall and plastic radius by elements, in three stages."""
    cavity = GROUND.cavity
    mesh = cavity.mesh("quad8", n=n, layers=layers, reach=reach)
    surface = hoek(GROUND.sigci, mb=GROUND.mb, s=GROUND.s, a=GROUND.a, psi=psi)
    stages = tuple(
        Stage(f"s{k}", excavate=() if k else ("core",), release={"core": Scalar(part)})
        for k, part in enumerate((0.6, 0.9, 1.0))
    )
    staged = cavity.staged(mesh, surface, stages=stages)
    end = analysed(staged)[-1]
    wall = cavity.outwards(staged, end)
    assert np.ptp(wall) < 1e-3 * np.abs(wall).max()
    return wall.mean(), cavity.plastic_radius(staged, end)


@pytest.mark.parametrize(
    "degrees", [8.0, *(pytest.param(psi, marks=pytest.mark.slow) for psi in (0.0, 20.0))]
)
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


# --- an independent integration of the rates, and a strip about an axis of elements ---

LAYERS = 50
PLACES = (0, 2, 4)
"""Rings of elements behind the wall at whose inner edges motions are compared."""


@dataclass(frozen=True)
class Integration:
    """The equations of an opening, integrated inwards from the edge R of the plastic zone.

    Stresses and strains depend on l = ln(R / r) alone: what a place sees while R grows is what
    stands on the way inwards at one moment. With g = eps_t (inwards displacement by radius; strains
    are positive in compression) compatibility is eps_r = g - g', equilibrium
    d sigma_r / dl = -(sigma_t - sigma_r), and the rates of the plastic strains, total less elastic,
    satisfy eps_r' = -K (eps_t' + eps_z'), with eps_z = 0 in all; sigma_z follows from elasticity
    until it meets sigma_t.

    Args:
        site: its numbers.
        associated: K = 1 + dQ/d sigma_r at the stress of the moment, else that of the dilation.
    """

    site: Site
    associated: bool

    @property
    def edge(self) -> float:
        """sigma_r at the edge, where elastic stresses reach the limit."""
        site = self.site
        return float(brentq(lambda s: 2 * (site.p0 - s) - site.width(s), 0.0, site.p0))

    def rates(self, way: float, state: np.ndarray) -> list[float]:
        """Of sigma_r, g and g' by l."""
        site, (radial, _, slope) = self.site, state
        width = site.width(radial)
        rise = site.a * site.mb * (site.mb * radial / site.sigci + site.s) ** (site.a - 1)
        by_l = np.array([-width, -width * (1 + rise), 0.0])
        hoop = radial + width
        if site.p0 + site.nu * (radial + hoop - 2 * site.p0) < hoop:
            by_l[2] = site.nu * (by_l[0] + by_l[1])
        else:
            by_l[2] = by_l[1]
        r, t, z = ((1 + site.nu) * by_l - site.nu * by_l.sum()) / site.E
        sine = np.sin(site.psi)
        K = 1 + rise if self.associated else (1 + sine) / (1 - sine)
        return [by_l[0], slope, slope - r + K * (slope - t - z)]

    def inwards(self, radii: np.ndarray) -> np.ndarray:
        """Displacements at radii in the plastic zone of an opening of radius 1 m."""
        site = self.site
        strain = (1 + site.nu) * (site.p0 - self.edge) / site.E

        def wall(way: float, state: np.ndarray) -> float:
            return float(state[0]) - site.p

        wall.terminal = True  # type: ignore[attr-defined]
        start = [self.edge, strain, 2 * strain]
        found = solve_ivp(
            self.rates,
            (0.0, 9.0),
            start,
            events=wall,
            rtol=1e-9,
            atol=1e-13,
            max_step=0.01,
            dense_output=True,
        )
        return np.asarray(radii * found.sol(found.t[-1] - np.log(radii))[1])

    def steps(self, n: int) -> tuple[float, ...]:
        """Parts of release from first yielding on, at which R grows by equal factors."""
        site = self.site
        both = np.array([self.edge, site.p])
        w = np.linspace(*((site.mb * both / site.sigci + site.s) ** (1 - site.a)), n + 1)
        inside = (w ** (1 / (1 - site.a)) - site.s) * site.sigci / site.mb
        return tuple(1 - inside / site.p0)


def strip(site: Site, parts: Sequence[float], psi: float | None) -> tuple[np.ndarray, np.ndarray]:
    """A slice about the axis by elements: radii, and displacements inwards at the end."""
    radii = np.append(0.0, np.geomspace(1.0, 40.0, LAYERS + 1))
    points = np.array([[r, z] for r in radii for z in (0.0, 0.05)])
    mesh = from_grid("quad8", points, (LAYERS + 1, 1))
    mesh = regroup(mesh, core=lambda c: c[:, 0] < 1.0)
    surface = hoek(site.sigci, mb=site.mb, s=site.s, a=site.a, psi=psi)
    staged = model(
        mesh,
        analysis=Analysis.AXISYMMETRIC,
        materials={"rock": rock(site.E, site.nu, surface)},
        groups=dict.fromkeys(mesh.groups, "rock"),
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        in_situ=constant(*(-site.p0,) * 3),
        stages=tuple(
            Stage(f"s{k}", excavate=() if k else ("core",), release={"core": Scalar(part)})
            for k, part in enumerate(parts)
        ),
    )
    *_, end = staged.at(NOTHING, RunOptions(derivatives=False)).states()
    moved = -end.u[:, 0].reshape(-1, 2)[:, 0]
    chosen = radii[1:][list(PLACES)]
    return chosen, np.array([moved[np.abs(mesh.points[:, 0] - r) < 1e-9].mean() for r in chosen])


SUPPORTED = replace(GROUND, p=0.6 * MPa)


@pytest.mark.parametrize("degrees", [0.0, 8.0])
def test_constant_dilation_against_the_integration(degrees, verification):
    """The closed form to rounding, the elements within 0.4 %, at the wall and behind it."""
    site = replace(SUPPORTED, psi=np.radians(degrees))
    ways = Integration(site, associated=False)
    radii, found = strip(site, ways.steps(1), site.psi)
    exact = ways.inwards(radii)
    closed = -site.state().displacement(radii).value
    np.testing.assert_allclose(closed, exact, rtol=1e-7)
    np.testing.assert_allclose(found, exact, rtol=4e-3)
    name = f"dilation {degrees:g} degrees"
    verification("opening-hoek-brown-rates", name, radii, exact=exact, found=found)


def test_associated_flow_against_the_integration(verification):
    """A stage has the flow of its end: deviations halve with the stages, and end within 0.5 %."""
    ways = Integration(SUPPORTED, associated=True)
    (radii, coarse), (_, fine) = (strip(SUPPORTED, ways.steps(n), None) for n in (10, 20))
    exact = ways.inwards(radii)
    limit = 2 * fine - coarse
    np.testing.assert_allclose(limit, exact, rtol=5e-3)
    assert 0.4 < (fine[0] - limit[0]) / (coarse[0] - limit[0]) < 0.6
    one = strip(SUPPORTED, ways.steps(1), None)[1]
    assert one[0] / exact[0] == pytest.approx(1.16, abs=0.02)
    verification("opening-hoek-brown-rates", "associated", radii, exact=exact, found=limit)
