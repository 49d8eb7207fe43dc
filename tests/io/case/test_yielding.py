"""How materials yield, as case files say it, and what is refused where."""

from __future__ import annotations

from math import hypot, pi, radians

import jsonschema
import pytest
import yaml

from geoident.io.docs.case_schema import case_schema
from geoident.model.ground import Attitude, Axes
from geoident.model.parameter import Scalar
from geoident.model.yielding import DruckerPrager, GivenPlanes, MohrCoulomb, WeakPlane, YieldPlane

ROCK = "  rock: {E: $E_rock, nu: 0.25, density: 2650 kg/m3}\n"
E_ROCK = "  E_rock: {start: 15 GPa, bounds: [2 GPa, 80 GPa], scale: log}\n"
MORE = """\
  c: {start: 1 MPa, bounds: [0.1 MPa, 5 MPa]}
  phi: {start: 30 deg, bounds: [10 deg, 50 deg]}
  k1: {start: 2 MPa, bounds: [1 MPa, 5 MPa]}
  dip: {start: 20 deg, bounds: [0 deg, 80 deg]}
"""
USED = "{E: $E_rock, nu: 0.25, yield: {type: planes, planes: [{normal: [1, 0, 0], distance: $c}, "
USED += "{normal: [0, 1, 0], distance: $k1}], hardening: $c}}"
PHI = "{E: $E_rock, nu: 0.25, yield: {type: weak-plane, dip: $dip, cohesion: $c, friction: $phi}}"


@pytest.fixture
def text(changed):
    """A case whose rock yields in some way; two others use all parameters."""

    def write(of_yield: str, *, solid: bool = False, elastic: str = "E: $E_rock, nu: 0.25") -> str:
        rock = f"  rock: {{{elastic}, yield: {of_yield}}}\n  used: {USED}\n  phi: {PHI}\n"
        case = changed(ROCK, rock).replace(E_ROCK, E_ROCK + MORE)
        return _solid(case) if solid else case

    return write


@pytest.fixture
def yields(project, text):
    def read(*given, **options):
        return project.read(text(*given, **options)).case.materials["rock"].yields

    return read


@pytest.fixture
def fault(project, text):
    def read(*given, **options):
        return project.only_fault(text(*given, **options))

    return read


def _solid(case: str) -> str:
    case = case.replace("plane-strain", "solid").replace(
        "dip: $dip", "dip: $dip, dip_direction: 0 deg"
    )
    case = case.replace("[1, 0, 0]", "[1, 0, 0, 0, 0, 0]").replace(
        "[0, 1, 0]", "[0, 1, 0, 0, 0, 0]"
    )
    for point in ("[12.5, 3 m]", "[17.5, 3 m]", "[-1, 0 m]", "[1, 0 m]"):
        case = case.replace(point, point.replace(" m]", ", 0 m]"))
    return case


def test_what_says_nothing_stays_elastic(project):
    assert project.read().case.materials["rock"].yields == ()


def test_mohr_coulomb_with_ties_in_every_number(yields):
    (found,) = yields(
        "{type: mohr-coulomb, cohesion: 2 $c, friction: $phi, dilation: 0.5 $phi, tension: 0.1 $c}"
    )
    assert found == MohrCoulomb(
        Scalar(2.0, "c"), Scalar(1.0, "phi"), Scalar(0.5, "phi"), Scalar(0.1, "c")
    )
    (found,) = yields("{type: mohr-coulomb, cohesion: 1 MPa, friction: 30 deg, planes: 16}")
    assert found == MohrCoulomb(Scalar(1e6), Scalar(radians(30)), planes=16, fit="best")


@pytest.mark.parametrize("key", ["strength", "cohesion"])
def test_tresca_is_mohr_coulomb_without_friction(yields, key):
    (found,) = yields(f"{{type: tresca, {key}: $c, planes: 8, fit: inscribed}}")
    assert found == MohrCoulomb(Scalar(1.0, "c"), Scalar(0.0), planes=8, fit="inscribed")


def test_a_list_of_surfaces_that_all_hold(yields):
    prager, weak = yields(
        "[{type: drucker-prager, cohesion: $c, friction: $phi, match: outer, tension: 1 kPa}, "
        "{type: weak-plane, dip: $dip, cohesion: 1 kPa, friction: 20 deg}]"
    )
    assert prager == DruckerPrager(
        Scalar(1.0, "c"), Scalar(1.0, "phi"), "outer", Scalar(1e3), planes=24, fit="best"
    )
    frame = Attitude(Scalar(1.0, "dip"), Scalar(pi / 2))
    assert weak == WeakPlane(frame, Scalar(1e3), Scalar(radians(20)))


def test_a_weak_plane_by_its_normal(yields):
    (found,) = yields(
        "{type: weak-plane, normal: [3, 0, 4], cohesion: 1 kPa, friction: 20 deg}", solid=True
    )
    assert isinstance(found.frame, Axes)
    (a, b, c), (p, q, r) = found.frame.first, found.frame.second
    normal = (b * r - c * q, c * p - a * r, a * q - b * p)
    assert normal == pytest.approx((0.6, 0.0, 0.8), abs=1e-12)


def test_planes_by_three_or_four_stresses_in_a_section(yields):
    (found,) = yields(
        "{type: planes, planes: [{name: a, normal: [0.6, 0, 0.8], distance: $k1}, "
        "{normal: [0, 0, 0.6, -0.8], distance: 0.5 $k1}], hardening: 2 GPa}"
    )
    assert found == GivenPlanes(
        (
            YieldPlane("a", (0.6, 0.0, 0.0, 0.8, 0.0, 0.0), Scalar(1.0, "k1")),
            YieldPlane("plane 2", (0.0, 0.0, 0.6, -0.8, 0.0, 0.0), Scalar(0.5, "k1")),
        ),
        hardening=Scalar(2e9),
    )


def test_rounded_normals_become_unit(yields):
    (found,) = yields("{type: planes, planes: [{normal: [0.707, 0.707, 0], distance: 1 MPa}]}")
    assert hypot(*found.planes[0].normal) == pytest.approx(1.0, rel=1e-15)


def test_planes_of_a_solid_take_six_stresses(yields, fault):
    plane = "{{type: planes, planes: [{{normal: {}, distance: 1 MPa}}]}}"
    (found,) = yields(plane.format("[0, 0, 0, 0, 0.6, 0.8]"), solid=True)
    assert found.planes[0].normal == pytest.approx((0, 0, 0, 0, 0.6, 0.8))
    found = fault(plane.format("«[1, 0, 0, 0]"), solid=True)
    assert "expected 6" in found.message


@pytest.mark.parametrize(
    ("given", "code", "remedy"),
    [
        ("{type: tresca, strength: $c, planes: «7}", "number-of-planes", "planes: 8"),
        ("{type: tresca, strength: $c, planes: «2}", "number-of-planes", "planes: 4"),
        (
            "{type: mohr-coulomb, cohesion: $c, friction: $phi, dilation: «1.1 $phi}",
            "out-of-range",
            "Change the start of phi.",
        ),
        (
            "{type: mohr-coulomb, cohesion: $c, friction: «90 deg}",
            "out-of-range",
            "Correct the number or its unit.",
        ),
        (
            "{type: planes, planes: [{normal: «[3, 0, 4], distance: 1 MPa}]}",
            "not-unit",
            "[0.6, 0, 0.8]",
        ),
        (
            "{type: planes, hardening: «-1 MPa, planes: [{normal: [1, 0, 0], distance: 1 MPa}]}",
            "out-of-range",
            "Correct",
        ),
    ],
)
def test_faults_at_their_place_with_a_remedy(fault, given, code, remedy):
    found = fault(given)
    assert found.code == code
    assert remedy in found.hint


def test_few_planes_in_a_solid(fault):
    found = fault("{type: tresca, strength: $c, planes: «16}", solid=True)
    assert "48" in found.hint


def test_smooth_surfaces_go_with_isotropy_only(fault):
    strata = "elastic: transversely-isotropic, E_p: $E_rock, nu_p: 0.2, E_n: 9 GPa, nu_np: 0.1, "
    strata += "G_np: 3 GPa, dip: 10 deg"
    found = fault("«{type: tresca, strength: $c}", elastic=strata)
    assert found.code == "smooth-surface"
    assert "planes: 16" in found.hint


def test_a_tie_of_another_dimension(fault):
    found = fault("{type: mohr-coulomb, cohesion: $c, friction: «$c}")
    assert "expected an angle" in found.message


def test_the_schema_agrees(text):
    schema = jsonschema.Draft202012Validator(case_schema())

    def valid(given):
        return schema.is_valid(yaml.safe_load(text(given).replace("{on:", "{'on':")))

    assert valid("[{type: tresca, strength: $c, planes: 8}]")
    for wrong in ("{type: tresco, strength: $c}", "[]", "{type: mohr-coulomb, cohesion: 1}"):
        assert not valid(wrong)
