"""Strength reduction of ground in uniform stress, where the factor follows from the criterion."""

from __future__ import annotations

from dataclasses import replace
from math import atan, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.optimize import brentq
from support.cases import model
from support.in_stages import model_at, write_msh
from support.meshes import box
from support.yielding import NOTHING, constant, hoek, mohr, rock

from geoident.errors import CollapseError, ModelError
from geoident.forward.safety.search import Search, safety_factors
from geoident.forward.safety.strengths import divided_strength
from geoident.forward.yielding.hoek_brown import RockMassStrength
from geoident.model.actions import Pressure, Traction
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Attitude
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, SectionLimits
from geoident.model.yielding import DruckerPrager, HardeningSoil, WeakPlane


def block(surface, axial: float, lateral: float, *, E: float = 1e9):
    """A block in plane strain pressed along y and across, in one stage each."""
    return pressed(rock(E, 0.3, surface), axial, lateral)


def pressed(material: Material, axial: float, lateral: float):
    """The same of a material."""
    mesh = box("quad8", (1, 1))
    side, top = (Pressure(name, Scalar(p)) for name, p in (("x1", lateral), ("y1", axial)))
    return model(
        mesh,
        materials={"rock": material},
        groups={"all": "rock"},
        supports=(Support("x0", (0,)), Support("y0", (1,))),
        stages=(Stage("press", loads={"side": side, "top": top}),),
    )


def failure_of(staged, **search):
    """The factor of safety, and how the ground fails."""
    ((found, mechanism),) = safety_factors(staged, NOTHING, [1], Search(tolerance=0.002, **search))
    return found, mechanism


def factor_of(staged, **search):
    return failure_of(staged, **search)[0]


def coulomb(c: float, phi: float, axial: float, lateral: float) -> float:
    """The factor with which sigma_1 = N sigma_3 + 2 c sqrt(N)."""

    def excess(F: float) -> float:
        reduced = atan(tan(phi) / F)
        N = (1 + sin(reduced)) / (1 - sin(reduced))
        return N * lateral + 2 * c / F * sqrt(N) - axial

    return brentq(excess, 0.05, 50.0)


C, PHI = 50e3, radians(30.0)


@pytest.mark.parametrize(
    ("surface", "c", "phi", "axial"),
    [
        *((mohr(C, PHI), C, PHI, axial) for axial in (110e3, 200e3, 560e3)),
        (mohr(C, PHI, psi=radians(8.0)), C, PHI, 200e3),
        (mohr(C, PHI, planes=48), C, PHI, 200e3),
        (mohr(C, 0.0), C, 0.0, 110e3),
    ],
)
def test_factor_of_mohr_and_coulomb(surface, c, phi, axial):
    lateral = 60e3
    exact = coulomb(c, phi, axial, lateral)
    found = factor_of(block(surface, axial, lateral))
    assert found.lower <= exact * 1.004
    assert found.value == pytest.approx(exact, rel=0.004)
    assert found.fails
    assert found.upper / found.lower <= 1.002 + 1e-9


@pytest.mark.slow  # hundreds of planes; the others of one or two
def test_factor_of_drucker_and_prager():
    """In plane strain with associated flow the cone that is matched carries what Coulomb's does."""
    axial, lateral = 240e3, 60e3
    cone = DruckerPrager(Scalar(C), Scalar(PHI), planes=600)
    exact = coulomb(C, PHI, axial, lateral)
    assert factor_of(block(cone, axial, lateral)).value == pytest.approx(exact, rel=0.01)


def test_factor_of_a_weak_plane():
    """A block in simple shear on planes that lie flat: they slide where tau = (c + p tan(phi)) / F.

    The rock between them is elastic.
    """
    p, tau, c, phi = 100e3, 50e3, 30e3, radians(25.0)
    flat = Attitude(Scalar(0.0), Scalar(radians(90.0)))
    loads = {
        face: Traction(face, tuple(map(Scalar, traction)))
        for face, traction in (("y1", (tau, -p)), ("x1", (-p, tau)), ("x0", (p, -tau)))
    }
    staged = model(
        box("quad8", (1, 1)),
        materials={"rock": rock(1e9, 0.0, WeakPlane(flat, Scalar(c), Scalar(phi)))},
        groups={"all": "rock"},
        supports=(Support("y0", (0, 1)),),
        stages=(Stage("shear", loads=loads),),
    )
    assert factor_of(staged).value == pytest.approx((c + p * tan(phi)) / tau, rel=0.003)


def test_factor_of_a_cut_off():
    found = factor_of(block(mohr(1e6, PHI, tension=90e3), -60e3, 0.0))
    assert found.value == pytest.approx(1.5, rel=0.003)


@pytest.mark.parametrize("constants", [{"mb": 2.0, "s": 0.004, "a": 0.51}, {"mi": 12, "GSI": 45}])
def test_factor_of_hoek_and_brown(constants):
    """The shear strength along the curve is divided: within 1.5 % by a curve of the same kind."""
    axial, lateral = 6e6, 1e6
    surface = hoek(30e6, **constants)
    mass = RockMassStrength.of(surface, {})
    exact = brentq(
        lambda F: divided_strength(mass, np.array([lateral]), F)[0] - (axial - lateral), 0.2, 20.0
    )
    found = factor_of(block(surface, axial, lateral, E=1e10))
    assert found.value == pytest.approx(exact, rel=0.015)


def test_reduced_curve_of_a_straight_criterion():
    """With a = 1 the curve of Hoek and Brown is Coulomb's line, whose c and phi are divided."""
    N, c = 3.0, 1e6
    mass = RockMassStrength(sigci=1.0, mb=N - 1.0, s=2.0 * c * sqrt(N), a=1.0)
    sigma_3, F = np.array([0.0, 1e6, 5e6]), 1.7
    reduced = atan((N - 1.0) / (2.0 * sqrt(N)) / F)
    slope = (1 + sin(reduced)) / (1 - sin(reduced))
    exact = (slope - 1.0) * sigma_3 + 2.0 * c / F * sqrt(slope)
    np.testing.assert_allclose(divided_strength(mass, sigma_3, F), exact, rtol=1e-9)


def test_factor_below_one_of_a_stage_that_collapses():
    found = factor_of(block(mohr(C, 0.0), 60e3 + 2 * C / 0.7, 60e3))
    assert found.value == pytest.approx(0.7, rel=0.003)
    assert found.proven


def test_no_factor_helps_ground_without_cohesion_that_is_pulled():
    with pytest.raises(CollapseError, match="cannot carry"):
        factor_of(block(mohr(0.0, PHI), -60e3, 0.0))


def test_at_least_the_largest_factor():
    found, mechanism = failure_of(block(mohr(C, 0.0), 62e3, 60e3), most=20.0)
    assert not found.fails
    assert found.value == 20.0
    assert mechanism is None


def test_guess_does_not_change_the_factor():
    exact = coulomb(C, PHI, 200e3, 60e3)
    for guess in (0.5 * exact, 0.99 * exact, 1.5 * exact):
        found = factor_of(block(mohr(C, PHI), 200e3, 60e3), guess=guess)
        assert found.value == pytest.approx(exact, rel=0.003)


def test_in_situ_stress_beyond_the_strength():
    """An error of a case; at a draw of a posterior it makes the factor less than one."""
    staged = model(
        box("quad8", (1, 1)),
        materials={"rock": rock(1e9, 0.3, mohr(C, 0.0))},
        groups={"all": "rock"},
        supports=(Support("x0", (0,)), Support("y0", (1,))),
        in_situ=constant(-60e3, -200e3, -100e3, held=True),
        stages=(Stage("as it is"),),
    )
    with pytest.raises(ModelError, match="outside the yield surface"):
        factor_of(staged)
    found = factor_of(staged, in_situ_too=True)
    assert found.value == pytest.approx(2 * C / 140e3, rel=0.003)


def test_hardening_soil_has_its_limit():
    """The factor is that of its c and phi, whatever its stiffness and its past."""
    axial, lateral = 200e3, 60e3
    soil = HardeningSoil(
        *map(Scalar, (0.5, 100e3, 0.9, C, PHI, radians(8.0), 0.0)), Scalar(20e6), Scalar(20e6)
    )
    material = replace(rock(60e6, 0.2), soil=soil)
    exact = coulomb(C, PHI, axial, lateral)
    found = factor_of(pressed(material, axial, lateral), guess=exact)
    assert found.value == pytest.approx(exact, rel=0.004)
    assert found.kept == found.unyielding == ""


@pytest.mark.slow  # looks long for an equilibrium that there is not
def test_hardening_soil_that_collapses_as_it_is():
    """No equilibrium is found; with its limit alone and more strength there is one."""
    axial, lateral = 400e3, 60e3
    soil = HardeningSoil(*map(Scalar, (0.5, 100e3, 0.9, C, PHI, PHI, 0.0, 20e6)))
    exact = coulomb(C, PHI, axial, lateral)
    found = factor_of(pressed(replace(rock(60e6, 0.2), soil=soil), axial, lateral))
    assert found.value == pytest.approx(exact, rel=0.004)
    assert exact < 1.0


WET = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  c: {start: 5 kPa, bounds: [1 kPa, 100 kPa]}
materials:
  clay:
    E: 10 MPa
    nu: 0.3
    yield: {type: mohr-coulomb, cohesion: $c, friction: 25 deg, dilation: 0 deg}
    hydraulic: {permeability: 1e-9 m/s, storage: 1e-12 1/Pa}
groups: {all: clay}
in_situ: {model: constant, xx: -100 kPa, yy: -100 kPa, zz: -100 kPa}
supports: {x0: x, y0: y, x1: x, y1: y}
drained: {y1: {}, x1: {}}
stages:
  - name: press
    supports: {x1: free, y1: free}
    loads: {top: {on: y1, pressure: 60 kPa}}
    lasts: 1000 years
gauges:
  S: {kind: settlement, point: [1 m, 1 m], accuracy: 1 mm}
"""


def wet_factors(folder, text: str):
    """The factors of its two moments, one by one: at once, and when the water has left."""
    write_msh(box("quad8", (1, 1)), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    path = folder / "case.yaml"
    path.write_text(text)
    staged = model_at(path, {"press": [0.0]})
    factors = safety_factors(staged, np.array([5e3]), [1, 2], Search(tolerance=0.002))
    return (found for found, _ in factors)


def test_factors_while_water_leaves(tmp_path):
    """Effective strength under the pressure of water that there is at a moment.

    At once the mean effective stress in the plane stays: water takes half of the load.
    """
    first, last = wet_factors(tmp_path, WET)
    assert first.stage == "press + 0 d"
    phi = radians(25.0)
    assert first.value == pytest.approx(coulomb(5e3, phi, 130e3, 70e3), rel=0.004)
    assert last.value == pytest.approx(coulomb(5e3, phi, 160e3, 100e3), rel=0.004)


def test_pressures_stay_as_strength_is_divided(tmp_path):
    """Ground that dilates as much as it rubs would carry any load if its water stayed in it."""
    first = next(wet_factors(tmp_path, WET.replace(", dilation: 0 deg", "")))
    assert first.value == pytest.approx(coulomb(5e3, radians(25.0), 130e3, 70e3), rel=0.004)
    assert first.proven


def test_undrained_strength_of_ground_with_water(tmp_path):
    """Given as such it is divided, whatever the water does: 2 s_u / q."""
    text = WET.replace("mohr-coulomb, cohesion: $c, friction: 25 deg, dilation: 0 deg",
                       "tresca, strength: 8 $c")  # fmt: skip
    assert next(wet_factors(tmp_path, text)).value == pytest.approx(80 / 60, rel=0.002)


@pytest.mark.parametrize(
    "limits", [pytest.param(None, marks=pytest.mark.slow), SectionLimits(M=Scalar(1.0))]
)
def test_structures_keep_their_strength_and_are_named(limits):
    """A thin beam on the block; with hinges its rotations are unknowns, too."""
    beam = Beam("y1", EA=Scalar(1.0), EI=Scalar(1.0), limits=limits)
    plain = block(mohr(C, 0.0), 110e3, 60e3)
    press = replace(plain.case.stages[0], build=("beam",))
    staged = model(
        box("quad8", (1, 1)),
        materials=plain.case.materials,
        groups={"all": "rock"},
        supports=plain.case.supports,
        structures={"beam": beam},
        stages=(press,),
    )
    exact = coulomb(C, 0.0, 110e3, 60e3)
    found = factor_of(staged, guess=exact)
    assert found.value == pytest.approx(exact, rel=0.004)
    assert (found.kept, found.unyielding) == (("", "beam") if limits is None else ("beam", ""))
