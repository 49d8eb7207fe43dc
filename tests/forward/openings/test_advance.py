"""Released parts by the distance to a tunnel's face: published profiles, and what yields."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import material
from support.derivatives import assert_exact, assert_slopes
from support.yielding import mohr, parameters, rock

from geoident.errors import CollapseError
from geoident.forward.openings.advance import AdvancingFace
from geoident.model.actions import FaceDistance, FaceProfile
from geoident.model.case import Stage
from geoident.model.dual import ParameterPoint
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Scalar
from geoident.model.yielding import HoekBrown

from .test_opening_model import GAUGES, RADIUS, MPa, displacement, quarter, staged, without_mesh

NOWHERE = ParameterPoint({}, ())
LAWS = {
    "panet": (Scalar(0.25), Scalar(0.75)),
    "chern": (Scalar(1.10), Scalar(1.7)),
}
"""Constants that the papers give: part at the face and reach of it in radii; reach and exponent."""

WALL = displacement("wall", (RADIUS, 0.0), (-1.0, 0.0))
DISTANCES = (-1.0, 0.0, 1.5, 4.0, 12.0)


def profile(law: str, **changes) -> FaceProfile:
    constants = LAWS.get(law, ())
    settings = {"groups": ("core",), "radius": Scalar(RADIUS), "constants": constants}
    return FaceProfile(law, **{**settings, **changes})


def stages(distances=DISTANCES) -> tuple[Stage, ...]:
    first, *rest = (Scalar(x) if isinstance(x, float) else x for x in distances)
    return (
        Stage("0", excavate=("core",), distance=first),
        *(Stage(str(n), distance=x) for n, x in enumerate(rest, start=1)),
        Stage("far", release={"core": Scalar(1.0)}),
    )


@pytest.mark.parametrize(
    ("law", "ratio", "away", "share"),
    [
        # Vlachopoulos & Diederichs 2009: u_0 = exp(-0.15 R*) / 3 at the face, read off by hand
        ("vlachopoulos-diederichs", 1.0, 0.0, 0.28690),
        ("vlachopoulos-diederichs", 2.5, 0.0, 0.22910),
        ("vlachopoulos-diederichs", 8.0, 0.0, 0.10040),
        ("vlachopoulos-diederichs", 2.5, -1.0, 0.22910 * 0.36788),
        ("vlachopoulos-diederichs", 2.5, 2.5, 1.0 - 0.77090 * 0.22313),
        # Panet 1995: 0.25 at the face, 1 - 0.75 (0.75 / 1.75)^2 a radius behind it
        ("panet", None, 0.0, 0.25),
        ("panet", None, 1.0, 0.86224),
        # Chern et al. 1998: 2^-1.7 at the face
        ("chern", None, 0.0, 0.30779),
        ("chern", None, 1.1, 0.58711),
    ],
)
def test_profiles_are_those_of_their_papers(law, ratio, away, share):
    radius = None if ratio is None else Scalar(ratio * RADIUS)
    face = AdvancingFace(profile(law, plastic_radius=radius))
    found = face.part(FaceDistance(Scalar(away * RADIUS)), NOWHERE, "")
    assert found.value == pytest.approx(share, abs=6e-6)


@pytest.mark.parametrize("law", ["vlachopoulos-diederichs", "chern"])
@pytest.mark.parametrize("conversion", [None, "reaction-curve", "direct"])
def test_elastic_ground_moves_by_the_profile(law, conversion):
    face = profile(law, conversion=conversion)
    opened = without_mesh(material("rock", 5e9, 0.25), face=face, stages=stages(), channels=(WALL,))
    moved = opened.survey(np.empty(0), fields=False).computed[0]
    given = AdvancingFace(face)
    shares = [given.part(FaceDistance(Scalar(x)), NOWHERE, "").value for x in DISTANCES]
    np.testing.assert_allclose(moved[:-1] / moved[-1], shares, rtol=1e-12)


@pytest.mark.parametrize(
    ("psi", "law"),
    [
        *((0.1, "vlachopoulos-diederichs"), (None, "chern")),
        *(pytest.param(*given, marks=pytest.mark.slow)
          for given in ((0.0, "vlachopoulos-diederichs"), (0.0, "chern"), (0.1, "chern"),
                        (None, "vlachopoulos-diederichs"))),
    ],
)  # fmt: skip
def test_ground_that_yields_moves_by_the_profile_too(law, psi):
    """The released part is larger than the share of the motion, and the wall moves by the share."""
    opened = without_mesh(
        rock(5e9, 0.25, mohr(1 * MPa, 0.5, psi=psi)),
        face=profile(law), stages=stages(), channels=(WALL,),
    )  # fmt: skip
    survey, found = opened.survey(np.empty(0), fields=True), opened.face_states({})
    moved = survey.computed[0]
    np.testing.assert_allclose(moved[:-1] / moved[-1], [s.share for s in found], rtol=1e-11)
    assert all(s.released > s.share for s in found)
    if law == "vlachopoulos-diederichs":
        at_face = np.exp(-0.15 * survey.reaction.stage_plastic_radius[-1] / RADIUS) / 3.0
        assert found[1].share == pytest.approx(at_face, rel=1e-12)


NUMBERS = {
    "K0": 0.95, "sv": 11 * MPa, "E": 5e9, "nu": 0.27, "c": MPa, "phi": 0.5, "psi": 0.1,
    "R": 2.1, "x": 1.4, "one": 1.15, "two": 1.6,
}  # fmt: skip


def identified(law: str, **changes):
    own = {name: Scalar(1.0, name) for name in NUMBERS}
    constants = {"panet": (Scalar(0.2, "one"), own["two"]), "chern": (own["one"], own["two"])}
    plastic = Scalar(2.0, "one") if changes.get("conversion") == "direct" else None
    wall = mohr(own["c"], own["phi"], psi=own["psi"])
    return {
        "materials": {"rock": rock(own["E"], own["nu"], wall)},
        "parameters": parameters(**NUMBERS),
        "in_situ": HeimStress(K0=own["K0"], vertical=own["sv"], K0_across=Scalar(1.0)),
        "face": profile(
            law, constants=constants.get(law, ()), radius=own["R"], plastic_radius=plastic,
            **changes,
        ),
        "stages": stages((own["x"], 4.0))[:2],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("law", "changes", "acts"),
    [
        ("vlachopoulos-diederichs", {}, set(NUMBERS) - {"one", "two"}),
        ("vlachopoulos-diederichs", {"conversion": "direct"}, set(NUMBERS) - {"two"}),
        ("panet", {}, set(NUMBERS)),
        ("chern", {}, set(NUMBERS)),
    ],
)
def test_derivatives_are_exact(law, changes, acts):
    settings = identified(law, **changes)
    ground = settings.pop("materials")["rock"]
    opened = without_mesh(ground, **settings)
    p = np.array(list(NUMBERS.values()))
    pairs = [(c.name, s.name) for c in GAUGES[1:] for s in settings["stages"]]
    response = opened.response(pairs)
    value, jacobian = response.evaluate(p)
    size = np.abs(jacobian * p).max(axis=0) / np.abs(value).max()
    assert {name for name, part in zip(NUMBERS, size, strict=True) if part > 1e-9} == acts
    jacobian[:, size <= 1e-9] = 0.0  # rounding
    free = [name in acts for name in NUMBERS]

    def readings(some):
        """With the numbers that act."""
        full = p.copy()
        full[free] = some
        return response.readings(full)

    names = [name for name in NUMBERS if name in acts]
    assert_slopes(readings, p[free], jacobian[:, free], names, step=1e-3)


@pytest.mark.parametrize(
    "law", ["vlachopoulos-diederichs", pytest.param("panet", marks=pytest.mark.slow)]
)
def test_a_mesh_is_released_as_the_closed_form(law):
    """The same parts of stress, and a wall that moves by the profile up to the mesh's error."""
    changes = {"face": profile(law), "stages": stages((0.5, 1.5, 4.0)), "channels": (WALL,)}
    ground = rock(5e9, 0.25, mohr(1 * MPa, 0.5, psi=0.3))
    meshed = staged(quarter(6, 20, 30.0), ground, **changes)
    closed = without_mesh(ground, **changes)
    one, other = meshed.face_states({}), closed.face_states({})
    np.testing.assert_allclose([s.released for s in one], [s.released for s in other], rtol=1e-13)
    moved = meshed.survey(np.empty(0), fields=False).computed[0]
    np.testing.assert_allclose(moved[:-1] / moved[-1], [s.share for s in one], rtol=0.01)


@pytest.mark.slow  # of Mohr-Coulomb: above
def test_a_mesh_of_hoek_and_brown_moves_by_the_profile():
    """Released by the closed form of its ground, a mesh that flows without dilation."""
    rock_mass = HoekBrown(Scalar(40 * MPa), mi=Scalar(10.0), GSI=Scalar(35.0), dilation=Scalar(0.0))
    ground = replace(material("rock", 3e9, 0.25), yields=(rock_mass,))
    changes = {
        "face": profile("vlachopoulos-diederichs"),
        "stages": stages((1.0, 4.0)),
        "channels": (WALL,),
    }
    meshed = staged(quarter(9, 32, 60.0), ground, **changes)
    found = meshed.face_states({})
    assert all(s.released > s.share for s in found)
    moved = meshed.survey(np.empty(0), fields=False).computed[0]
    np.testing.assert_allclose(moved[:-1] / moved[-1], [s.share for s in found], rtol=0.01)
    closed = without_mesh(ground, **changes).survey(np.empty(0), fields=False).computed[0]
    np.testing.assert_allclose(moved, closed, rtol=0.01)


def test_derivatives_on_a_mesh_are_exact():
    """Through the analysis and backwards where the ground is elastic, and through flow."""
    E, x, two = Scalar(1.0, "E"), Scalar(1.0, "x"), Scalar(1.0, "two")
    face = profile("chern", constants=(Scalar(1.1), two))
    numbers = {"E": 5e9, "x": 1.4, "two": 1.6}
    settings = {"face": face, "stages": stages((x, 4.0))[:2], "parameters": parameters(**numbers)}
    pairs = [(c.name, s.name) for c in GAUGES for s in settings["stages"]]
    p = np.array(list(numbers.values()))
    elastic = staged(quarter(2, 5, 20.0), material("rock", E, 0.25), **settings)
    assert_exact(elastic.response(pairs), p, tuple(numbers))
    yields = staged(quarter(3, 8, 20.0), rock(E, 0.25, mohr(MPa, 0.5, psi=0.3)), **settings)
    assert_exact(yields.response(pairs), p, tuple(numbers), rtol=1e-6, step=5e-4)


def test_ground_that_has_no_final_motion_says_so():
    """Without cohesion nothing carries the wall, but for the face; directly, there is no need."""
    ground = rock(5e9, 0.25, mohr(0.0, 0.3))
    settings = {"face": profile("chern"), "stages": stages((0.0,))[:1], "channels": (WALL,)}
    with pytest.raises(CollapseError, match=r"(?s)has none without support.*conversion"):
        without_mesh(ground, **settings).survey(np.empty(0), fields=False)
    settings["face"] = profile("chern", conversion="direct")
    moved = without_mesh(ground, **settings).survey(np.empty(0), fields=False).computed
    assert np.isfinite(moved).all()


@pytest.mark.parametrize(
    "law", ["panet", pytest.param("vlachopoulos-diederichs", marks=pytest.mark.slow)]
)
def test_the_profile_is_kept_with_its_stages(law):
    """Every stage on the curve, from ahead of the face on where the profile goes there."""
    opened = without_mesh(
        rock(5e9, 0.25, mohr(1 * MPa, 0.5)), face=profile(law), stages=stages((0.5, 4.0)),
        channels=(replace(WALL, zero="0"),),
    )  # fmt: skip
    kept = opened.survey(np.empty(0), fields=True).advance
    states = opened.face_states({})
    assert (kept.law, kept.radius, kept.stages) == (law, RADIUS, ("0", "1"))
    assert list(kept.stage_released) == [s.released for s in states]
    np.testing.assert_allclose(
        np.interp(kept.stage_distance, kept.distance, kept.share), kept.stage_share, atol=1e-3
    )
    assert list(kept.stage_zero) == [True, False]
    assert kept.distance[0] == (0.0 if law == "panet" else -2.0 * RADIUS)
    assert (np.diff(kept.distance) > 0.0).all()
    assert opened.survey(np.empty(0), fields=False).advance is None
