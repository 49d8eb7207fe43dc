"""Axisymmetric construction: stages, stresses, what is refused, derivatives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.cases import displacement, imbalance, material
from support.derivatives import assert_exact
from support.meshes import KINDS_2D, box, regroup
from support.revolved import constant, fields, revolve, section

from geoident.errors import InputError, ModelError
from geoident.model.actions import PointForce, Pressure, Seismic, Traction
from geoident.model.case import Stage, Support
from geoident.model.gauges import Channel
from geoident.model.in_situ import HeimStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

ROCK = material("rock", 10e9, 0.22)
kinds = pytest.mark.parametrize("kind", KINDS_2D)

BENCHES = tuple(f"bench-{k}" for k in range(5))


def shaft(kind: str = "quad8", n: int = 8) -> Mesh:
    """Ground of 8 m by 8 m with a shaft of 2 m radius, 5 m deep, on the axis, and its lining."""
    mesh = box(kind, (n, n), size=(8.0, 8.0), distortion=0.1)

    def bench(k):
        return lambda c: (c[:, 0] < 1) & (c[:, 1] > 7 - k)

    def lining(c):
        return (c[:, 0] < 2) & (c[:, 1] > 5)

    return regroup(mesh, **{f"bench-{k}": bench(k) for k in range(5)}, lining=lining)


SINKING: dict[str, Any] = {
    "materials": {"rock": material("rock", 8e9, 0.3, 2600.0)},
    "groups": dict.fromkeys(("rock", "lining", *BENCHES), "rock"),
    "supports": (Support("y0", (1,)), Support("x1", (0,))),
}


@kinds
def test_one_stage_or_five_end_in_the_same_state(kind):
    common = {**SINKING, "in_situ": constant(-9e6, -6e6, -9e6), "gravity": (0.0, -9.81)}
    mesh = shaft(kind)
    one = fields(mesh, stages=(Stage("all", excavate=BENCHES),), **common)
    five = fields(mesh, stages=tuple(Stage(b, excavate=(b,)) for b in BENCHES), **common)
    here, scale = one.present[-1], np.abs(one.displacement[-1]).max()
    np.testing.assert_allclose(five.displacement[-1], one.displacement[-1], atol=1e-10 * scale)
    np.testing.assert_allclose(
        five.stress[-1][here], one.stress[-1][here], atol=1e-10 * np.nanmax(np.abs(one.stress))
    )


@kinds
def test_in_situ_stress_is_in_balance(kind):
    weight = 2600.0 * 9.81
    growing = HeimStress(K0=Scalar(0.3 / 0.7), unit_weight=Scalar(weight), surface=Scalar(8.0))
    for in_situ, gravity in ((growing, (0.0, -9.81)), (constant(-9e6, -6e6, -9e6), None)):
        staged = revolve(
            shaft(kind), in_situ=in_situ, gravity=gravity, stages=(Stage("nothing"),), **SINKING
        )
        result = staged.survey(np.empty(0), fields=True).fields
        assert imbalance(staged) < 1e-12
        assert np.abs(result.displacement).max() < 1e-15


def test_hoop_stress_is_the_out_of_plane_component():
    """A long shaft in ground stressed -p: hoop -p (1 + 1/r^2), radial -p (1 - 1/r^2)."""
    mesh = box("quad8", (64, 1), size=(64.0, 0.5))
    points = mesh.points.copy()
    points[:, 0] = np.where(
        points[:, 0] < 4, points[:, 0] / 4, 40.0 ** (points[:, 0] / 60 - 1 / 15)
    )
    mesh = regroup(replace(mesh, points=points), core=lambda c: c[:, 0] < 1)
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"core": "rock", "rock": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        in_situ=constant(-4e6, -3e6, -4e6),
        stages=(Stage("open", excavate=("core",)),),
    )
    rock = mesh.groups["rock"]
    rr, axial, tt = result.stress[-1][rock].T[:3]
    ratio = 1 / points[mesh.blocks[0].nodes[rock, :4]].mean(axis=1)[:, 0] ** 2
    np.testing.assert_allclose(tt, -4e6 * (1 + ratio), rtol=2e-3)
    np.testing.assert_allclose(rr, -4e6 * (1 - ratio), atol=8e3)
    np.testing.assert_allclose(axial, -3e6, rtol=2e-3)


@kinds
@pytest.mark.parametrize("inner", [0.0, 1.0])
def test_free_ground_expands_with_temperature_by_alpha_in_every_direction(kind, inner):
    mesh = section(kind, (3, 3), (2.0, 1.0), inner=inner)
    result = fields(
        mesh,
        materials={"rock": replace(ROCK, expansion=Scalar(1e-5))},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)),),
        stages=(Stage("summer", temperature={"all": Scalar(20.0)}),),
    )
    np.testing.assert_allclose(result.displacement[-1], 2e-4 * mesh.points, atol=1e-15)
    np.testing.assert_allclose(result.stress[-1], 0.0, atol=1e-5)


def test_a_force_is_that_of_the_whole_turn():
    """A force on the axis of a long column: its mean axial stress is the force per round area."""
    mesh = section("quad8", (6, 24), (1.0, 8.0), inner=0.0)
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)),),
        stages=(Stage("load", loads={"P": PointForce((0.0, 8.0), (Scalar(0.0), Scalar(-6e6)))}),),
    )
    centre = mesh.points[mesh.blocks[0].nodes[:, :4]].mean(axis=1)
    low = centre[:, 1] < 2
    axial, share = result.stress[-1][low, 1], centre[low, 0]
    assert np.average(axial, weights=share) == pytest.approx(-6e6 / np.pi, rel=1e-6)
    np.testing.assert_allclose(axial, -6e6 / np.pi, rtol=1e-3)


def test_convergence_across_the_axis_is_twice_the_radial_motion():
    ends = (-1.0, 6.5), (1.0, 6.5)
    across = Channel("CV", "CV", "convergence", *ends, (1.0, 0.0), 1e-4, "virgin", ("gauges", "CV"))
    staged = revolve(
        shaft(),
        in_situ=constant(-9e6, -6e6, -9e6),
        stages=(Stage("open", excavate=BENCHES),),
        channels=(across, displacement("wall", ends[1], (1.0, 0.0))),
        **SINKING,
    )
    convergence, wall = staged.survey(np.empty(0), fields=False).computed[:, -1]
    assert wall < 0
    assert convergence == pytest.approx(2 * wall, rel=1e-12)


# What does not turn about the axis ---------------------------------------------------------------


def refused(mesh: Mesh | None = None, **changes: Any) -> str:
    with pytest.raises(InputError) as caught:
        revolve(shaft() if mesh is None else mesh, **{**SINKING, "stages": (), **changes})
    return "\n".join(f"{f.code} {f.path}: {f.message}; {f.hint}" for f in caught.value.faults)


def test_elements_across_the_axis_are_refused_by_their_numbers():
    mesh = shaft()
    text = refused(replace(mesh, points=mesh.points - np.array([0.4, 0.0])))
    assert "negative-radius" in text
    assert "elements 1, 2, 3, 4, 5, 6, 7, 8 have negative radii x, down to -0.4 m" in text
    assert "mesh one half of the section, at x >= 0, with y along the axis" in text


def test_rounding_at_the_axis_is_the_axis():
    mesh = shaft()
    points = mesh.points.copy()
    axis = points[:, 0] == 0
    points[axis, 0] = np.random.default_rng(0).uniform(-1e-12, 1e-12, axis.sum())
    staged = revolve(replace(mesh, points=points), **SINKING)
    assert (
        f"{axis.sum()} nodes on the axis of revolution x = 0 are held radially" in staged.notes[0]
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gravity": (0.1, -9.81)}, "gravity: gravity has a part across the axis"),
        ({"in_situ": constant(-9e6, -6e6, -8e6)}, "in_situ.zz: xx (radial) and zz (hoop)"),
        ({"in_situ": constant(-9e6, -6e6, -9e6, 1e5)}, "in_situ.xy: xy (rz)"),
        (
            {"loads": {"quake": Seismic((Scalar(0.1), Scalar(0.0)))}},
            "loads.quake: shaking across the axis",
        ),
        (
            {"in_situ": HeimStress(K0=Scalar(1.0), vertical=Scalar(1e6), K0_across=Scalar(1.5))},
            "in_situ.K0: the horizontal in-situ stresses",
        ),
    ],
)
def test_what_is_not_axisymmetric_is_refused(changes, words):
    assert words in refused(**changes)


def test_a_ring_that_nothing_holds_along_the_axis_is_named():
    supports = (Support("x1", (0,)),)
    mesh = shaft()
    count = sum(map(len, mesh.blocks))
    whole = f"{count} elements of .* can move along y freely: nothing holds the piece"
    with pytest.raises(ModelError, match=whole):
        revolve(mesh, **{**SINKING, "supports": supports}, stages=())


# Derivatives -------------------------------------------------------------------------------------

PARAMETERS = {
    "E": 8e9, "nu": 0.27, "density": 2500.0, "K0": 1.4, "gamma": 26e3, "q": 1.5e6, "t": -0.7e6,
}  # fmt: skip


def sunk_with_everything(kind: str):
    rock = material("rock", Scalar(1.0, "E"), Scalar(1.0, "nu"), Scalar(1.0, "density"))
    shot = material("shot", Scalar(1.8, "E"), 0.2, 2400.0)
    places = [((2.5, 6.2), "virgin"), ((3.0, 3.1), "s1"), ((0.4, 1.0), "s2"), ((-1.5, 6.0), "s2")]
    return revolve(
        shaft(kind),
        parameters=tuple(
            Parameter(n, v, -np.inf, np.inf, "linear") for n, v in PARAMETERS.items()
        ),
        materials={"rock": rock, "shot": shot},
        groups=SINKING["groups"],
        supports=SINKING["supports"],
        in_situ=HeimStress(
            K0=Scalar(1.0, "K0"), unit_weight=Scalar(1.0, "gamma"), surface=Scalar(9.0), held=False
        ),
        gravity=(0.0, -9.81),
        loads={"dead": Pressure("y1", Scalar(0.2, "q"))},
        stages=(
            Stage("s1", excavate=BENCHES[:2], remove=("dead",)),
            Stage("s2", excavate=(BENCHES[2],), install={"lining": "shot"}),
            Stage("s3", excavate=BENCHES[3:]),
            Stage("s4", install={BENCHES[4]: "shot"}, loads={
                "t": Traction("x1", (Scalar(0.0), Scalar(1.0, "t")))}),
        ),
        channels=tuple(
            displacement(f"c{k}", point, (0.6, 0.8), zero=zero)
            for k, (point, zero) in enumerate(places)
        ),
    )  # fmt: skip


@kinds
def test_jacobian_agrees_with_richardson_differences(kind):
    staged = sunk_with_everything(kind)
    response = staged.response(
        [(c, s) for c, first in (("c0", 1), ("c1", 2), ("c2", 3), ("c3", 3))
         for s in [f"s{n}" for n in range(first, 5)]]
    )  # fmt: skip
    assert_exact(response, np.array(list(PARAMETERS.values())), tuple(PARAMETERS))
