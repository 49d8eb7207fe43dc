"""What is said where there is no equilibrium, or none can be."""

from __future__ import annotations

import re
from ast import literal_eval
from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.meshes import box
from support.yielding import NOTHING, Cavity, analysed, given, mohr, parameters, rock

from geoident.errors import CollapseError, ModelError
from geoident.fem.yielding.domain import NoProjection
from geoident.fem.yielding.plane_laws import PolyhedralLaw
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.collapse import CarriedPart
from geoident.forward.analysis.collapse_message import collapse_error
from geoident.forward.analysis.stage_equations import NoEquilibrium
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Scalar

CAVITY = Cavity(pressure=10e6, E=2e9, nu=0.3)
STAGES = tuple(
    Stage(f"s{n}", excavate=() if n else ("core",), release={"core": Scalar(part)})
    for n, part in enumerate((0.5, 0.8, 1.0))
)


def pulled(load: float, *yields, **changes):
    """A square pulled up, free at its sides."""
    settings = {
        "materials": {"rock": rock(1e9, 0.3, *yields)},
        "groups": {"all": "rock"},
        "supports": rollers(2),
        "stages": (
            Stage("first", loads={"p": Traction("y1", (Scalar(0.0), Scalar(0.1 * load)))}),
            Stage("second", loads={"p": Traction("y1", (Scalar(0.0), Scalar(load)))}),
        ),
    }
    return model(box("tri6", (3, 3)), **{**settings, **changes})


@pytest.mark.parametrize("planes", [None, 16])
def test_collapse_names_stage_part_and_place(planes):
    """Tresca in plane strain bears 2 c: of the second stage's change, (2 - 0.4) / (4 - 0.4)."""
    c = 1e6
    tresca = mohr(c, 0.0, planes=planes, fit="circumscribed")
    with pytest.raises(CollapseError) as caught:
        pulled(4 * c, tresca).survey(NOTHING, fields=False)
    assert caught.value.stage == "second"
    assert caught.value.fraction == pytest.approx(1.6 / 3.6, rel=2e-3)
    said = "at stage 'second' the ground cannot carry the loads: plastic collapse; 44.4 % of the "
    said += "change of load of this stage is carried; it shears most in group 'all' near ("
    assert caught.value.message.startswith(said)
    most, band = caught.value.message.split("' near ")[1].split(", and strongly between ")
    low, high = (literal_eval(end.removesuffix(" m")) for end in band.split(" and "))
    place = literal_eval(most.removesuffix(" m"))
    assert all(0 < a <= x <= b < 1 for a, x, b in zip(low, place, high, strict=True))
    assert caught.value.hint == (
        "Raise the strengths (their start values or bounds), or see whether the stage lacks "
        "support or loads more than is meant."
    )
    pulled(1.99 * c, tresca).survey(NOTHING, fields=False)


@pytest.mark.parametrize("yields", [
    mohr(1.0, 0.0), mohr(0.0, 0.3), given(np.eye(6)[:3], [0.0] * 3), mohr(0.0, 0.3, psi=0.1),
    *(pytest.param(surface, marks=pytest.mark.slow)
      for surface in (mohr(1e-3, 0.0, planes=8), mohr(1.0, 0.4, psi=0.0))),
])  # fmt: skip
def test_ground_without_strength_collapses_soon(yields):
    """No endless search, whatever the strength; nothing of the load is carried."""
    staged = pulled(1e6, yields)
    with pytest.raises(CollapseError) as caught:
        staged.survey(NOTHING, fields=False)
    assert caught.value.stage == "first"
    assert not caught.value.fraction > 1e-3


def test_flow_without_potential_collapses_too():
    c = 1e6
    with pytest.raises(CollapseError) as caught:
        pulled(8 * c, mohr(c, 0.4, psi=0.1)).survey(NOTHING, fields=False)
    exact = 2 * c * np.cos(0.4) / (1 + np.sin(0.4))  # uniaxial tension
    assert caught.value.fraction <= (exact - 0.8 * c) / (7.2 * c) + 0.01


def test_identifiers_are_told_at_the_start_values():
    """There they hear what part is carried, always; elsewhere where it took the arc to know."""
    staged = CAVITY.staged(
        CAVITY.mesh("quad8", n=2, layers=14, reach=10),
        stages=STAGES,
        parameters=parameters(c=0.05e6),
        materials={"rock": rock(2e9, 0.3, mohr(Scalar(1.0, "c"), 0.0))},
        channels=(displacement("g", (1.01, 0.01), (1.0, 0.0)),),
    )
    response = staged.response([("g", stage.name) for stage in STAGES])
    with pytest.raises(CollapseError) as elsewhere:
        response.evaluate(np.array([0.04e6]))
    assert not elsewhere.value.fraction >= 1.0
    with pytest.raises(CollapseError) as start:
        response.evaluate(np.array([0.05e6]))
    assert 0.0 < start.value.fraction < 1.0
    assert np.all(np.isfinite(response.readings(np.array([5e6]))))


def virgin(*yields, K0: float = 0.3):
    return model(
        box("quad8", (4, 4), size=(10.0, 10.0)),
        materials={"soil": rock(1e8, 0.3, *yields, name="soil", density=2e3)},
        groups={"all": "soil"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (1,))),
        gravity=(0.0, -10.0),
        in_situ=HeimStress(K0=Scalar(K0), unit_weight=Scalar(2e4), surface=Scalar(10.0)),
        stages=(Stage("nothing"),),
    )


@pytest.mark.parametrize("planes", [None, 16])
def test_virgin_stress_outside_the_surface_is_refused_with_place_and_factor(planes):
    """Tresca, fit outside: the worst point is the lowest; there sigma_v (1 - K0) against 2 c."""
    c = 4e4
    staged = virgin(mohr(c, 0.0, planes=planes, fit="circumscribed"))
    deepest = 10.0 - staged.discretization.points.position[:, 1].min()
    with pytest.raises(ModelError, match="in-situ stress is outside the yield surface") as caught:
        analysed(staged)
    assert not isinstance(caught.value, CollapseError)
    factor = 2e4 * deepest * 0.7 / (2 * c)
    assert f"by a factor of {factor:.3g}" in str(caught.value)
    remedy = "Raise the strength, or correct the in-situ stress: virgin ground must carry it."
    assert caught.value.hint == remedy
    assert "soil near (" in str(caught.value)
    low = str(caught.value).split("near (")[1].split(")")[0].split(",")[1]
    assert float(low) == pytest.approx(10.0 - deepest, abs=0.01)


@pytest.mark.parametrize(("k", "size"), [(1e5, "by a factor of {:.3g}"), (0.0, "by {:.3g} Pa")])
def test_virgin_stress_outside_the_surface_is_refused_with_the_plane(k, size):
    """Of four planes only the vertical stress of the second is beyond its distance."""
    normals = np.eye(6)[[0, 1, 2, 3]] * np.array([1.0, -1.0, 1.0, 1.0])[:, None]
    staged = virgin(given(normals, [1e9, k, 1e9, 1e9]))
    vertical = 2e4 * (10.0 - staged.discretization.points.position[:, 1].min())
    with pytest.raises(ModelError, match="in-situ stress is outside the yield surface") as caught:
        analysed(staged)
    said = size.format(vertical / k if k else vertical)
    assert f", at its p1: {said}" in str(caught.value)


@pytest.mark.parametrize("planes", [None, 16])
def test_virgin_ground_exactly_on_the_surface_is_allowed(planes):
    """Cohesionless ground at Rankine's K_a = tan^2(45 - phi/2)."""
    phi = 0.5
    surface = mohr(0.0, phi, planes=planes, fit="circumscribed")
    K_a = np.tan(np.pi / 4 - phi / 2) ** 2
    for standing in analysed(virgin(surface, K0=K_a)):
        assert np.abs(standing.u).max() < 1e-6
    with pytest.raises(ModelError, match="outside the yield surface"):
        analysed(virgin(surface, K0=0.98 * K_a))


def test_planes_that_contradict_each_other_are_named_with_a_remedy():
    """Fill that would have to be pressed and not be pressed at once, at a k that may be tried."""
    facing = np.eye(6)[[0, 0]] * np.array([[1.0], [-1.0]])
    sideways = given(facing, [Scalar(1.0, "k"), 0.9e5])
    staged = CAVITY.staged(
        CAVITY.mesh("quad8", n=2, layers=2, reach=3),
        materials={"rock": material("rock", 2e9, 0.3), "fill": rock(1e9, 0.3, sideways)},
        groups={"core": None, "rock": "rock"},
        stages=(Stage("fill", install={"core": "fill"}),),
        parameters=parameters(k=-5e4),  # bounds -500 and -5 kPa
    )
    with pytest.raises(ModelError) as caught:
        staged.survey(np.array([-1e5]), fields=False)
    assert not isinstance(caught.value, CollapseError)
    assert caught.value.message == (
        "the yield planes of a material contradict each other: no stress satisfies the yield "
        "planes 1, 2 at once"
    )
    assert caught.value.hint == "Raise their distances k (start values or bounds)."


def test_planes_that_nearly_coincide_are_told_with_a_remedy(monkeypatch):
    """No case is known in which the projection does not end: it is kept from ending."""

    def without_end(law, trial, hardened=None):
        raise NoProjection(trial.shape[1])

    monkeypatch.setattr(PolyhedralLaw, "project", without_end)
    with pytest.raises(ModelError) as caught:
        pulled(3e6, mohr(1e6, 0.0, planes=8)).survey(NOTHING, fields=False)
    assert not isinstance(caught.value, CollapseError)
    assert re.fullmatch(
        r"at stage 'first' the projection of \d+ points on the yield planes did not end: planes "
        "of a material that nearly coincide",
        caught.value.message,
    )
    remedy = "Leave out planes that are the same but for little, or move them apart."
    assert caught.value.hint == remedy


def test_a_collapse_that_is_not_proven_has_another_remedy():
    """A mechanism and a band say more, elsewhere (`test_little_dilation`)."""
    task = SimpleNamespace(moment="stage 's'", state=SimpleNamespace(name="s"))
    failure = NoEquilibrium(None)
    carried = CarriedPart(0.1234, None, failure)
    error = collapse_error(SimpleNamespace(), task, failure, associated=False, carried=carried)
    message = (
        "at stage 's' not converged: no equilibrium was found; 12.3 % of the change of load of "
        "this stage was brought to equilibrium"
    )
    assert (error.message, error.fraction) == (message, 0.1234)
    assert error.hint.startswith("It may mean that the stage is beyond its limit load, or that ")
    unknown = collapse_error(SimpleNamespace(), task, failure, associated=False)
    assert unknown.message == message.partition("; ")[0]


def test_newtons_method_that_does_not_end_is_no_proof_of_a_collapse():
    """With associated flow a load is carried, or beyond the limit; its steps may run out before."""
    task = SimpleNamespace(moment="stage 'open'", state=SimpleNamespace(name="open"))
    failure = NoEquilibrium(None)
    carried = CarriedPart(0.25, None, failure)
    error = collapse_error(SimpleNamespace(), task, failure, associated=True, carried=carried)
    assert error.message == (
        "at stage 'open' not converged: no equilibrium was found in 60 Newton steps; 25 % of the "
        "change of load of this stage was brought to equilibrium"
    )
    assert error.hint == (
        "Divide the change of load among several stages, or raise the strengths: the ground is "
        "near its limit, or beyond it."
    )


def test_bands_that_are_not_asked_for_are_no_collapse():
    """The finer mesh of the mesh error looks for no flow in bands: it counts as no solution."""
    cavity = Cavity()
    surface = mohr(5e4, np.radians(65), psi=0.0)
    staged = cavity.staged(cavity.mesh("tri6", n=2, layers=6, reach=5), surface)
    with pytest.raises(ModelError) as caught:
        list(staged.at(NOTHING, RunOptions(derivatives=False, strict=True)).states())
    assert not isinstance(caught.value, CollapseError)
    said = "at stage 'open' the ground shears in bands, with a dilation far below the friction"
    assert (caught.value.message, caught.value.hint) == (said, "")
    list(staged.at(NOTHING, RunOptions(derivatives=False)).states())  # a little overstress is left
