"""Gauges around an opening in uneven stress, by the functions of a complex variable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material
from support.yielding import constant, hoek, mohr, parameters, rock

from geoident.errors import CollapseError, ModelError
from geoident.model.actions import Pressure
from geoident.model.case import Stage
from geoident.model.in_situ import ProfileStress
from geoident.model.parameter import Scalar

from .test_opening_model import RADIUS, MPa, gauge, without_mesh

E, NU, A, CENTRE = 4.3e9, 0.31, 2.3, 1.7 - 3.1j
XX, YY, XY = -7 * MPa, -12 * MPa, 2.5 * MPa
PART, PRESS = 0.37, 1.9 * MPa
STAGES = (
    Stage("face", excavate=("core",), release={"core": Scalar(PART)}),
    Stage("open", release={"core": Scalar(1.0)}),
    Stage("grout", loads={"grout": Pressure("wall", Scalar(PRESS))}),
)


def excavated(x: float, y: float) -> complex:
    """u + iv of a round hole that is made in a stressed plane (Kolosov and Muskhelishvili).

    2 G (u + iv) = kappa phi - z conj(phi') - conj(psi), less what the far stress does:
    phi = -conj(S) a^2 / z and psi = -2 P a^2 / z - conj(S) a^4 / z^3, with P = (xx + yy) / 4 and
    S = (yy - xx) / 2 + i xy, tension positive.
    """
    z = complex(x, y) - CENTRE
    P, S = (XX + YY) / 4, complex((YY - XX) / 2, XY)
    phi, slope = -S.conjugate() * A**2 / z, S.conjugate() * A**2 / z**2
    psi = -2 * P * A**2 / z - S.conjugate() * A**4 / z**3
    moved = (3 - 4 * NU) * phi - z * slope.conjugate() - psi.conjugate()
    return moved / (E / (1 + NU))


def pressed(x: float, y: float) -> complex:
    """u + iv of a pressure within (Lame)."""
    z = complex(x, y) - CENTRE
    return PRESS * A**2 / (E / (1 + NU)) * z / abs(z) ** 2


def place(radius: float, angle: float) -> tuple[float, float]:
    at = CENTRE + A * radius * np.exp(1j * angle)
    return at.real, at.imag


NEAR, FAR, OTHER = place(1.0, 0.7), place(3.3, 1.9), place(1.4, -2.2)


def test_gauges_read_what_the_complex_functions_say():
    channels = (
        gauge("rod", NEAR, FAR),
        displacement("point", OTHER, (0.6, -0.8)),
        displacement("wall", place(0.97, 2.6), (0.0, 1.0)),  # within the tolerance: on the wall
    )
    opened = without_mesh(
        material("rock", E, NU), centre=(CENTRE.real, CENTRE.imag), radius=A,
        in_situ=constant(XX, YY, -8 * MPa, XY), channels=channels, stages=STAGES,
    )  # fmt: skip
    found = opened.survey(np.empty(0), fields=False).computed
    along = complex(*channels[0].direction)

    def read(of):
        rod = ((of(*FAR) - of(*NEAR)) * along.conjugate()).real
        point = (of(*OTHER) * complex(0.6, 0.8)).real
        return np.array([rod, point, of(*place(1.0, 2.6)).imag])

    exact = np.stack([PART * read(excavated), read(excavated), read(excavated) + read(pressed)])
    np.testing.assert_allclose(found, exact.T, rtol=1e-10)


@pytest.mark.parametrize(
    ("yy", "told"), [(-10.19, None), (-10.21, "1 %"), (-13.0, "13 %"), (10.0, "1e+07 Pa")]
)
def test_stress_is_uneven_from_a_hundredth_of_its_mean_on(yy, told):
    for ground, more in (
        (material("rock", E, NU), ""),
        (rock(E, NU, mohr(90 * MPa, 0.5)),
         "; the closed form takes that part as if the ground were elastic"),
    ):  # fmt: skip
        notes = without_mesh(ground, in_situ=constant(-10 * MPa, yy * MPa, -10 * MPa)).notes
        said = [note for note in notes if "in-situ stress around" in note]
        text = f"the in-situ stress around the opening is up to {told} off its mean at the centre"
        assert said == ([] if told is None else [text + more])


def test_stress_that_grows_along_the_opening_counts_at_all_ends_of_it():
    """2 % a radius of depth: the roof and the floor are that far off, the sides are not."""
    for gradient, told in ((0.009, False), (0.011, True)):
        slope = gradient * 10 * MPa / RADIUS
        at = tuple(Scalar(-10 * MPa if k < 3 else 0.0) for k in range(6))
        grows = tuple(Scalar(-slope if k < 3 else 0.0) for k in range(6))
        profile = ProfileStress(at, grows, Scalar(0.0))
        notes = without_mesh(material("rock", E, NU), in_situ=profile).notes
        assert any("in-situ stress around" in note for note in notes) == told


def test_what_is_said_of_the_ground():
    ground = rock(E, NU, mohr(MPa, 0.5, planes=12))
    opened = without_mesh(ground, centre=(1.25, -2.0), radius=2.5)
    first, *others = opened.notes
    assert first == "closed form of a circular opening of radius 2.5 m about (1.25, -2) m in 'rock'"
    assert "the closed form takes the exact surface for the polyhedron" in others
    smooth = without_mesh(rock(E, NU, mohr(MPa, 0.5))).notes
    assert not any("polyhedron" in note for note in smooth)


def test_a_parameter_that_is_no_number_is_outside_of_the_domain():
    ground = rock(Scalar(1.0, "E"), NU, mohr(MPa, 0.5))
    opened = without_mesh(ground, parameters=parameters(E=E))
    assert opened.admissible(np.array([E])) is None
    assert opened.admissible(np.array([np.nan])) == "a parameter is not finite"
    assert opened.admissible(np.array([-E])) is not None
    assert opened.n_dofs == (0,) * 4


WEAK = (Stage("open", excavate=("core",)),)


def reaction(opened):
    return opened.survey(np.empty(0), fields=True).reaction


def test_where_no_stage_stands_the_collapse_is_raised():
    opened = without_mesh(rock(E, NU, mohr(0.0, 0.3)), stages=WEAK)
    with pytest.raises(CollapseError, match="stage 'open'"):
        opened.survey(np.empty(0), fields=False, partial=True)
    response = opened.response(())
    assert not any("yields up to" in text for text in response.remarks(np.empty(0)))


def test_a_stage_that_stands_after_one_that_does_not_is_on_the_curve():
    stages = (*WEAK, Stage("half", excavate=("core",), base="virgin",
                           release={"core": Scalar(0.5)}))  # fmt: skip
    opened = without_mesh(rock(E, NU, mohr(0.0, 0.3)), stages=stages)
    known = opened.survey(np.empty(0), fields=True, partial=True)
    assert known.reaction.stages == ("half",)
    assert known.reaction.stage_pressure == pytest.approx([5 * MPa])
    held = reaction(without_mesh(material("rock", E, NU), stages=stages[1:]))
    assert (held.pressure[-1], len(held.pressure)) == (0.0, 81)
    np.testing.assert_array_equal(np.isfinite(known.computed[0]), [False, True])
    assert len(known.collapses) == 1


def test_failures_other_than_a_collapse_are_no_collapse():
    """The stress along the tunnel is by far the largest: it yields, which no formula covers."""
    opened = without_mesh(
        rock(E, NU, mohr(MPa, 0.5)), in_situ=constant(-10 * MPa, -10 * MPa, -90 * MPa)
    )
    with pytest.raises(ModelError, match="yields by the stress out of the plane") as caught:
        opened.survey(np.empty(0), fields=False)
    assert not isinstance(caught.value, CollapseError)
    assert "at stage 'face' the ground around the opening fails" in str(caught.value)


def test_the_reaction_curve_reaches_as_far_as_a_stage_does():
    """81 pressures from the far stress down to that of a stage which pulls at the wall."""
    stages = (Stage("pull", excavate=("core",), loads={"p": Pressure("wall", Scalar(-3 * MPa))}),)
    opened = without_mesh(material("rock", E, NU), stages=stages)
    found = reaction(opened)
    np.testing.assert_allclose(found.pressure, np.linspace(10 * MPa, -3 * MPa, 81), atol=1.0)
    assert len(found.radii) == 121
    np.testing.assert_allclose(found.radii, RADIUS * 4.0 ** np.linspace(0, 1, 121), rtol=1e-12)
    fall = 13 * MPa * (RADIUS / found.radii) ** 2
    np.testing.assert_allclose(found.radial[0], 10 * MPa - fall, rtol=1e-10, atol=1e-3)
    np.testing.assert_allclose(found.hoop[0], 10 * MPa + fall, rtol=1e-10)
    np.testing.assert_allclose(found.stage_displacement, 13 * MPa * RADIUS * (1 + NU) / E)


def test_the_reaction_goes_to_four_times_the_widest_plastic_radius():
    ground = rock(E, NU, mohr(MPa, 0.5))
    found = reaction(without_mesh(ground))
    widest = np.nanmax(found.stage_plastic_radius)
    assert widest > 1.3 * RADIUS
    assert found.radii[[0, -1]] == pytest.approx([RADIUS, 4.0 * widest], rel=1e-12)
    uneven = constant(-6 * MPa, -11 * MPa, -8.5 * MPa, MPa)
    found = reaction(without_mesh(ground, in_situ=uneven))
    np.testing.assert_allclose(found.in_situ, [6 * MPa, 11 * MPa, 8.5 * MPa, -MPa])
    assert found.pressure[0] == pytest.approx(8.5 * MPa)


@pytest.mark.parametrize("limit", [mohr, hoek])
def test_a_wall_is_torn_beyond_its_tension(limit):
    """Hoop stress 2 p0 - p of a pressure p inside: 23 MPa is torn beyond 3 MPa, not 2.9."""
    for tension, tension_limit in ((2.9 * MPa, True), (3.1 * MPa, False)):
        if limit is mohr:
            ground = rock(E, NU, mohr(90 * MPa, 0.5, tension=tension))
        else:
            strong = hoek(300 * MPa, psi=0.1, mb=2.0, s=1.0, a=0.5)
            ground = rock(E, NU, replace(strong, tension=Scalar(tension)))
        press = Stage("press", excavate=("core",), loads={"w": Pressure("wall", Scalar(23 * MPa))})
        opened = without_mesh(ground, stages=(press,))
        if tension_limit:
            with pytest.raises(ModelError, match=r"stage 'press' the wall .* torn by tension"):
                opened.survey(np.empty(0), fields=False)
        else:
            assert np.isfinite(opened.survey(np.empty(0), fields=False).computed).all()
