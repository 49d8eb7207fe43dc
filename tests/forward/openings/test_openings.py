"""Closed forms of a circular opening, against integration of the equations and published values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal, localcontext
from itertools import accumulate

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from geoident.forward.openings.closed_forms import (
    BeyondClosedForm,
    GroundState,
    Opening,
    Rock,
    mohr_coulomb,
)
from geoident.forward.openings.divided_differences import exp_divided
from geoident.model.dual import Dual
from tests.support.closed_forms import (
    lame_cylinder,
    salencon_wall,
    tresca_cylinder,
)
from tests.support.derivatives import assert_exact, assert_slopes

MPa = 1e6


@dataclass(frozen=True)
class Site:
    """Numbers of a problem: SI, angles in rad, pressures positive in compression."""

    E: float = 6.7776e9
    nu: float = 0.21034
    p0: float = 30 * MPa
    z0: float = 30 * MPa
    c: float = 3.45 * MPa
    phi: float = np.pi / 6
    psi: float = np.pi / 6
    p: float = 0.0

    def opening(self, radius: float = 1.0) -> Opening:
        rock = Rock(*(number(x) for x in (self.E, self.nu, self.p0, self.z0)))
        return Opening(radius, rock, mohr_coulomb(*map(number, (self.c, self.phi, self.psi))))

    def state(self, radius: float = 1.0) -> GroundState:
        return self.opening(radius).under(number(self.p))

    def history(self, *pressures: float, radius: float = 1.0) -> list[GroundState]:
        """Under pressures that follow each other, MPa."""
        first, *rest = (number(p * MPa) for p in pressures)
        opened = self.opening(radius).under(first)
        return list(accumulate(rest, GroundState.onward, initial=opened))


def number(x: float) -> Dual:
    return Dual(np.array([x]))


SITES = {
    "manual, associated": Site(),
    "manual, psi = 0": Site(psi=0.0),
    "dilation between": Site(psi=0.2, p=2 * MPa),
    "no edge zone": Site(nu=0.45, c=8 * MPa),
    "stiff out of the plane": Site(nu=0.05),
    "nearly Tresca": Site(phi=1e-9, psi=1e-9, c=12 * MPa),
    "Tresca": Site(phi=0.0, psi=0.0, c=12 * MPa),
    "steep friction": Site(phi=0.9, psi=0.4, p=0.5 * MPa, c=0.3 * MPa),
    "expansion": Site(p=120 * MPa),
    "expansion with little dilation": Site(p=150 * MPa, psi=0.1),
    "expansion of Tresca": Site(p=90 * MPa, phi=0.0, psi=0.0, c=12 * MPa),
    "expansion to the edge": Site(p=120 * MPa, phi=0.2, psi=0.1),
    "own stress out of the plane": Site(z0=26 * MPa),
}


def integrated(site: Site) -> tuple[float, np.ndarray, np.ndarray]:
    """Plastic radius, radii and [sigma_r, sigma_t, sigma_z, u] by integrating from outside inwards.

    Unknowns are sigma_r and u over ln r; the law is evaluated point by point: elastic trial out of
    the plane, and sigma_z brought back to sigma_t if it is beyond. Written without any formula of
    the program, in the strains of each principal direction.
    """
    sense = 1.0 if site.p < site.p0 else -1.0  # contraction, expansion
    N, K = ((1 + np.sin(x)) / (1 - np.sin(x)) for x in (site.phi, site.psi))
    Y = 2 * site.c * np.cos(site.phi) / (1 - np.sin(site.phi))
    G = site.E / (2 * (1 + site.nu))

    def stresses(radial: float) -> tuple[float, float, float]:
        hoop = N * radial + Y if sense > 0 else (radial - Y) / N
        axial = site.z0 + site.nu * (radial + hoop - 2 * site.p0)
        return radial, hoop, axial if sense * (hoop - axial) > 0 else hoop

    def rates(_: float, y: np.ndarray) -> list[float]:
        sigma = np.array(stresses(y[0]))
        change = sigma - [site.p0, site.p0, site.z0]
        e = ((1 + site.nu) * change - site.nu * change.sum()) / site.E
        plastic_hoop, plastic_axial = -y[1] / y[2] - e[1], -e[2]
        # all that flows along the hoop and the axis is paid for radially
        plastic_radial = -(plastic_hoop + plastic_axial) * (K if sense > 0 else 1 / K)
        return [sigma[1] - sigma[0], -y[2] * (e[0] + plastic_radial), y[2]]

    edge = (2 * site.p0 - Y) / (N + 1) if sense > 0 else (2 * N * site.p0 + Y) / (N + 1)
    start = [edge, (edge - site.p0) / (2 * G), 1.0]

    def wall(_: float, y: np.ndarray) -> float:
        return float(y[0] - site.p)

    wall.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(rates, (0.0, -8.0), start, rtol=1e-12, atol=1e-12, events=wall)
    radii = found.y[2]
    table = np.array([[*stresses(s), u] for s, u in found.y[:2].T])
    table[:, 3] /= radii[-1]
    return 1.0 / radii[-1], radii / radii[-1], table


@pytest.mark.parametrize("name", SITES)
def test_solution_is_that_of_the_differential_equations(name: str) -> None:
    site = SITES[name]
    R, r, table = integrated(site)
    state = site.state()
    r = np.maximum(r, 1.0)
    assert state.plastic_radius is not None
    assert float(state.plastic_radius.value) == pytest.approx(R, rel=1e-8)
    for dual, column in zip(state.stresses(r), table.T, strict=False):
        np.testing.assert_allclose(dual.value, column, atol=1e-7 * site.p0)
    scale = np.abs(table[:, 3]).max()
    np.testing.assert_allclose(state.displacement(r).value, table[:, 3], atol=1e-7 * scale)


@pytest.mark.parametrize("psi", [0.0, 30.0])
def test_example_of_the_manuals(psi: float, verification) -> None:
    """FLAC, RS2 and 3DEC verify with a = 1 m, p0 = 30 MPa, c = 3.45 MPa, phi = 30 degrees.

    They print R = 1.734 m and sigma_R = 12.013 MPa. Their wall displacement is Salencon's.
    """
    site = Site(psi=np.deg2rad(psi))
    state, given = site.state(), {"c": site.c, "phi": site.phi, "psi": site.psi}
    R, wall = salencon_wall(pressure=site.p0, inner=0.0, E=site.E, nu=site.nu, **given)
    assert state.plastic_radius is not None
    assert state.edge_radius is not None
    assert float(state.plastic_radius.value) == pytest.approx(1.734, abs=1.1e-3)
    assert float(state.plastic_radius.value) == pytest.approx(R, rel=1e-12)
    assert state.opening.critical is not None
    assert float(state.opening.critical[0].value) == pytest.approx(12.013 * MPa, rel=2e-4)
    ours = -float(state.displacement(np.array([1.0])).value[0])
    assert 1.005 < ours / wall < 1.02  # the edge zone, which Salencon leaves out
    found = float(state.plastic_radius.value)
    verification("manuals", f"dilation {psi:g} degrees", ["edge"], exact=1.734, found=found)


def test_salencons_displacement_where_the_axial_stress_is_in_the_middle() -> None:
    site = replace(SITES["no edge zone"], psi=0.3)
    given = {"c": site.c, "phi": site.phi, "psi": site.psi}
    _, wall = salencon_wall(pressure=site.p0, inner=0.0, E=site.E, nu=site.nu, **given)
    found = site.state(2.5).displacement(np.array([2.5])).value[0]
    assert found == pytest.approx(-2.5 * wall, rel=1e-12)


def test_elastic_ground_moves_as_lames_cylinder() -> None:
    site = Site(p=45 * MPa, c=1e12)
    r = np.array([2.0, 3.0, 10.0])
    thick = lame_cylinder(r, inner=2.0, outer=1e6, pressure=site.p - site.p0, E=site.E, nu=site.nu)
    np.testing.assert_allclose(site.state(2.0).displacement(r).value, thick, rtol=1e-9)


def test_edge_of_hills_cylinder_is_that_of_the_opening() -> None:
    """A very thick cylinder under inner pressure, and an opening in ground free of stress."""
    site = Site(phi=0.0, psi=0.0, p0=0.0, z0=0.0, c=1 * MPa, nu=0.49999)
    pressure, _ = tresca_cylinder(inner=1.0, outer=1e5, edge=3.0, c=site.c, E=site.E, nu=site.nu)
    found = replace(site, p=pressure).state()
    assert float(found.plastic_radius.value) == pytest.approx(3.0, rel=1e-6)


def test_elastic_unloading_and_reloading() -> None:
    site, r = Site(), np.array([1.0, 1.5, 6.0])
    states = site.history(2.0, 6.0, 2.0, 1.0)
    first, back, again, further = (state.displacement(r).value for state in states)
    G = site.E / (2 * (1 + site.nu))
    np.testing.assert_allclose(back - first, 4 * MPa / (2 * G * r), rtol=1e-12)
    np.testing.assert_allclose(again, first, rtol=1e-14)
    np.testing.assert_allclose(further, replace(site, p=MPa).state().displacement(r).value)
    radial, hoop, _ = states[1].stresses(r)
    assert float(radial.value[0]) == pytest.approx(6 * MPa)
    N, Y = 3.0, 2 * site.c * np.sqrt(3.0)
    assert float(hoop.value[0]) == pytest.approx(N * 2 * MPa + Y - 4 * MPa)


@pytest.mark.parametrize(
    ("site", "pressures", "words"),
    [
        (Site(c=0.0), (0.0,), "cannot carry"),
        (Site(), (0.0, 40.0), "in contraction and in expansion"),
        (Site(z0=70 * MPa), (0.0,), "out of the plane"),
        (Site(z0=1 * MPa), (0.0,), "out of the plane"),
        (Site(z0=200 * MPa), (29.0,), "out of the plane"),
    ],
)
def test_what_the_closed_form_does_not_cover(
    site: Site, pressures: tuple[float, ...], words: str
) -> None:
    with pytest.raises(BeyondClosedForm, match=words):
        site.history(*pressures)


def reached(site: Site, *pressures: float) -> bool:
    """Whether the closed form covers these pressures, MPa."""
    try:
        site.history(*pressures)
    except BeyondClosedForm:
        return False
    return True


def test_how_far_a_wall_that_has_yielded_may_be_pressed_back() -> None:
    """By Q = sigma_t - sigma_r there: of an empty one Y, of one under 2 MPa 2 x 2 MPa more."""
    strength = 2 * Site().c / MPa * np.sqrt(3.0)
    for inside in (0.0, 2.0):
        most = inside + strength + 2.0 * inside
        assert reached(Site(), inside, 0.9999 * most)
        assert not reached(Site(), inside, 1.0001 * most)
    strong = SITES["expansion of Tresca"]  # sigma_r - sigma_t = 2 c wherever it flows
    assert reached(strong, 90.0, 90.0 - 23.999)
    assert not reached(strong, 90.0, 90.0 - 24.001)


@pytest.mark.parametrize(
    ("z0", "covered"), [(98.9, True), (99.0, False), (6.4, True), (6.3, False)]
)
def test_stress_out_of_the_plane_at_an_elastic_wall(z0: float, covered: bool) -> None:
    """Stresses 29 and 31 MPa in it: the third is at most 3 x 29 + 11.95, at least (31 - 11.95) / 3.

    With c = 3.45 MPa and 30 degrees the strength is 11.95 MPa.
    """
    assert reached(Site(z0=z0 * MPa), 29.0) == covered


def test_stresses_far_from_a_wall_that_has_yielded_are_lames() -> None:
    """p0 -+ (p0 - sigma_R) (R / r)^2; along the tunnel nothing changes there."""
    site = SITES["own stress out of the plane"]
    state = site.state(2.5)
    R, edge = float(state.plastic_radius.value), float(state.opening.critical[0].value)
    r = np.array([R * 1.001, 2.0 * R, 9.0 * R])
    fall = (site.p0 - edge) * (R / r) ** 2
    radial, hoop, axial = (stress.value for stress in state.stresses(r))
    np.testing.assert_allclose(radial, site.p0 - fall, rtol=1e-12)
    np.testing.assert_allclose(hoop, site.p0 + fall, rtol=1e-12)
    np.testing.assert_allclose(axial, site.z0, rtol=1e-12)
    G = site.E / (2 * (1 + site.nu))
    np.testing.assert_allclose(state.displacement(r).value, -fall * r / (2 * G), rtol=1e-12)


def test_an_unloaded_wall_keeps_its_radii_and_its_stress_along_the_tunnel() -> None:
    site = Site()
    first, back = site.history(2.0, 7.0, radius=1.7)
    assert back.plastic_radius is first.plastic_radius
    assert back.edge_radius is first.edge_radius
    assert back.edge_radius is not None
    r = np.array([1.7, 2.1, 8.0])
    change = 5.0 * MPa * (1.7 / r) ** 2
    one, other = ([s.value for s in state.stresses(r)] for state in (first, back))
    np.testing.assert_allclose(other[0], one[0] + change, rtol=1e-12)
    np.testing.assert_allclose(other[1], one[1] - change, rtol=1e-12)
    np.testing.assert_array_equal(other[2], one[2])


class _Displacements:
    """Displacements as a response in E, nu, p0, z0, c, phi, psi, p."""

    def __init__(self, radii: tuple[float, ...]) -> None:
        self._radii = np.array(radii)

    def readings(self, p: np.ndarray) -> np.ndarray:
        return self._jet(p).value

    def evaluate(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        columns = self._jet(p).columns
        return columns[:, 0], columns[:, 1:]

    def _jet(self, p: np.ndarray) -> Dual:
        E, nu, p0, z0, c, phi, psi, inner = (
            Dual(np.concatenate([[x], row])) for x, row in zip(p, np.eye(8), strict=True)
        )
        opening = Opening(1.0, Rock(E, nu, p0, z0), mohr_coulomb(c, phi, psi))
        return opening.under(inner).displacement(self._radii)


NAMES = ("E", "nu", "p0", "z0", "c", "phi", "psi", "p")


@pytest.mark.parametrize(
    "site",
    [
        Site(p=3 * MPa, psi=0.2),
        Site(nu=0.45, c=8 * MPa, p=0.1 * MPa, psi=0.3),
        Site(p=120 * MPa, psi=0.2),
        Site(p=120 * MPa, phi=0.2, psi=0.1),
        Site(phi=0.02, psi=0.01, c=12 * MPa, p=1 * MPa),
    ],
)
def test_derivatives_are_exact(site: Site) -> None:
    p = np.array([getattr(site, name) for name in NAMES])
    response = _Displacements((1.0, 1.2, 1.5, 2.0, 8.0))
    if site.state().edge_radius is not None:  # else z0 acts on nothing
        assert_exact(response, p, NAMES)
        return
    _, jacobian = response.evaluate(p)
    assert_slopes(response.readings, p, jacobian, NAMES, step=2e-3)


def test_derivatives_by_the_angles_where_they_are_zero() -> None:
    """Tresca: the quotients by N - 1 are smooth there, seen by one-sided differences."""
    p = np.array([6.8e9, 0.2, 30 * MPa, 30 * MPa, 12 * MPa, 0.0, 0.0, 1 * MPa])
    response = _Displacements((1.0, 1.3, 4.0))
    v, jacobian = response.evaluate(p)
    for k in (5, 6):
        h = 1e-4 * np.eye(8)[k]
        numeric = (-3 * v + 4 * response.readings(p + h) - response.readings(p + 2 * h)) / 2e-4
        scale = np.abs(jacobian[:, k]).max()
        np.testing.assert_allclose(jacobian[:, k], numeric, atol=1e-5 * scale)


@pytest.mark.parametrize("size", [1e-8, 0.1, 1.0, 10.0, 60.0, 300.0])
def test_divided_differences_lose_no_digit_however_far_the_ground_yields(size: float) -> None:
    """Against 200 decimal digits: of two nodes, of many points at once, and their derivatives."""
    first, second = -size * np.array([[0.3, 0.9, 0.5, 1.0], [0.6, 0.2, 0.5 + 1e-12, 0.7]])
    found = exp_divided(
        Dual(np.stack([first, np.ones(4), np.zeros(4)], axis=-1)),
        Dual(np.stack([second, np.zeros(4), np.ones(4)], axis=-1)),
    )
    near = 1e-40  # of a node that stands twice, as a part of the other digits
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        assert found.value[k] == pytest.approx(_divided(0.0, a, b), rel=1e-13, abs=0.0)
        for column, node in ((1, a), (2, b)):
            exact = _divided(0.0, a, b, node, apart=near)
            assert found.columns[k, column] == pytest.approx(exact, rel=1e-13, abs=0.0)


def _divided(*nodes: float, apart: float = 0.0) -> float:
    """The divided difference of exp by its definition, the last node moved a little."""
    with localcontext() as context:
        context.prec = 200
        x = [Decimal(node) for node in nodes]
        x[-1] += Decimal(apart)
        table = [node.exp() for node in x]
        for k in range(1, len(x)):
            pairs = zip(table[:-1], table[1:], x[:-k], x[k:], strict=True)
            table = [(up - low) / (right - left) for low, up, left, right in pairs]
        return float(table[0])
