"""Partial release: convergence-confinement of a round tunnel, and what must hold of any release."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import opening

from geoident.errors import InputError
from geoident.model.case import Stage
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

RADIUS, THICKNESS, P0 = 4.0, 0.3, 5e6
E, NU, E_LINING, NU_LINING = 2e9, 0.3, 20e9, 0.2
ZERO = Scalar(0.0)


def _tunnel(n=6):
    """A quarter of a tunnel; the outermost ring of its core becomes the lining."""
    layers = int(np.ceil(np.log(40) / np.log(1 + np.pi / 4 / n))) + 1
    mesh = opening("quad8", 2, n=n, layers=layers, radius=RADIUS - THICKNESS, reach=40 * RADIUS)
    # Pull the first ring outside the core to the radius of the excavation.
    r = np.linalg.norm(mesh.points, axis=1)
    rings = np.unique(np.round(r[r > (RADIUS - THICKNESS) * 1.0001], 9))
    wall = rings[1]  # mid-nodes of the first ring come first
    inner = RADIUS - THICKNESS
    scaled = np.where(r <= wall + 1e-9, inner + (r - inner) * THICKNESS / (wall - inner), r)
    outer = 40 * RADIUS
    beyond = RADIUS + (r - wall) * (outer - RADIUS) / (rings[-1] - wall)
    scaled = np.where(r > wall + 1e-9, beyond, scaled)
    scaled = np.where(r < inner - 1e-9, r, scaled)
    points = mesh.points * (scaled / np.maximum(r, 1e-12))[:, None]
    centre = np.linalg.norm(points[mesh.blocks[0].nodes].mean(axis=1), axis=1)
    groups = {
        "core": np.flatnonzero(centre < inner - 1e-6),
        "ring": np.flatnonzero((centre > inner - 1e-6) & (centre < RADIUS)),
        "rock": np.flatnonzero(centre > RADIUS),
    }
    return Mesh(points, mesh.blocks, mesh.facets, groups, mesh.facet_groups, {})


def _staged(mesh, fraction, **changes):
    held = {"core": fraction, "ring": fraction}
    free = {"core": Scalar(1.0), "ring": Scalar(1.0)}
    settings = {
        "materials": {
            "rock": material("rock", E, NU, 2500.0),
            "shot": material("shot", E_LINING, NU_LINING, 2400.0),
        },
        "groups": {"core": "rock", "ring": "rock", "rock": "rock"},
        "supports": rollers(2),
        "in_situ": ConstantStress((*(Scalar(-P0),) * 3, ZERO, ZERO, ZERO)),
        "stages": (
            Stage("open", excavate=("core", "ring"), release=held),
            Stage("line", install={"ring": "shot"}, release=free),
        ),
    }
    return model(mesh, **{**settings, **changes})


def _closed_form(fraction):
    """Wall displacement (inwards) after opening and after lining, and the lining's pressure.

    Ground reaction u = (p0 - p) R / (2 G); support p = k (u - u_0) with the stiffness of a thick
    ring in plane strain (Lame); Panet, Le calcul des tunnels par la methode
    convergence-confinement (1995).
    """
    G, g = E / (2 * (1 + NU)), E_LINING / (2 * (1 + NU_LINING))
    a, b = RADIUS - THICKNESS, RADIUS
    k = 2 * g * (b**2 - a**2) / (b * ((1 - 2 * NU_LINING) * b**2 + a**2))
    first = fraction * P0 * RADIUS / (2 * G)
    pressure = (1 - fraction) * P0 / (1 + 2 * G / (k * RADIUS))
    return first, (P0 - pressure) * RADIUS / (2 * G), pressure


@pytest.mark.parametrize("fraction", [0.0, 0.35, 0.7, 1.0])
def test_lined_tunnel_follows_convergence_confinement(fraction):
    mesh = _tunnel()
    fields = _staged(mesh, Scalar(fraction)).survey(np.empty(0), fields=True).fields
    r = np.linalg.norm(mesh.points, axis=1)
    wall = np.abs(r - RADIUS) < 1e-6
    inwards = -np.sum(fields.displacement[1:, wall] * mesh.points[wall], axis=2) / RADIUS
    first, last, _ = _closed_form(fraction)
    np.testing.assert_allclose(inwards[0], first, rtol=0.006, atol=1e-12)
    np.testing.assert_allclose(inwards[1], last, rtol=0.006)


def test_lining_bears_the_pressure_of_the_closed_form():
    mesh = _tunnel()
    fields = _staged(mesh, Scalar(0.4)).survey(np.empty(0), fields=True).fields
    _, _, pressure = _closed_form(0.4)
    ring = mesh.groups["ring"]
    hoop = np.sum(fields.stress[-1][ring][:, :2], axis=1)  # radial and hoop stress together
    mean = hoop.mean()
    a, b = RADIUS - THICKNESS, RADIUS
    assert mean == pytest.approx(-2 * pressure * b**2 / (b**2 - a**2), rel=0.01)


def test_nothing_released_moves_nothing_whatever_acts():
    heavy = {
        "gravity": (0.0, -9.81),
        "in_situ": HeimStress(
            K0=Scalar(0.8), unit_weight=Scalar(2500 * 9.81), surface=Scalar(300.0), held=True
        ),
        "stages": (
            Stage(
                "open",
                excavate=("core", "ring"),
                release={"core": Scalar(0.0), "ring": Scalar(0.0)},
            ),
        ),
    }
    fields = _staged(_tunnel(3), Scalar(0.0), **heavy).survey(np.empty(0), fields=True).fields
    heavy["stages"] = (Stage("open", excavate=("core", "ring")),)
    whole = _staged(_tunnel(3), Scalar(1.0), **heavy).survey(np.empty(0), fields=True).fields
    scale = np.abs(whole.displacement).max()
    assert np.abs(fields.displacement[1]).max() < 1e-9 * scale


def test_release_in_parts_ends_where_the_whole_release_ends():
    common = {"gravity": (0.0, -9.81)}
    mesh = _tunnel(3)
    parts = tuple(
        Stage(f"r{n}", release={"core": Scalar(f), "ring": Scalar(f)})
        for n, f in enumerate((0.5, 0.9, 1.0))
    )
    begin = Stage(
        "open", excavate=("core", "ring"), release={"core": Scalar(0.2), "ring": Scalar(0.2)}
    )
    whole = (Stage("open", excavate=("core", "ring")),)
    several = _staged(mesh, ZERO, stages=(begin, *parts), **common)
    once = _staged(mesh, ZERO, stages=whole, **common)
    a = several.survey(np.empty(0), fields=True).fields.displacement[-1]
    b = once.survey(np.empty(0), fields=True).fields.displacement[-1]
    np.testing.assert_allclose(a, b, atol=1e-10 * np.abs(b).max())


def test_derivatives_by_the_released_part_and_by_what_it_multiplies():
    parameters = (
        Parameter("part", 0.4, 0, 1),
        Parameter("E", E, 1e8, 1e11),
        Parameter("p", -P0, -1e8, 0),
        Parameter("density", 2500.0, 1000, 4000),
    )
    staged = _staged(
        _tunnel(2),
        Scalar(1.0, "part"),
        parameters=parameters,
        materials={
            "rock": material("rock", Scalar(1.0, "E"), NU, Scalar(1.0, "density")),
            "shot": material("shot", E_LINING, NU_LINING, 2400.0),
        },
        in_situ=ConstantStress(
            (Scalar(1.0, "p"), Scalar(0.8, "p"), Scalar(0.9, "p"), *(ZERO,) * 3)
        ),
        gravity=(0.0, -9.81),
        channels=(
            displacement("a", (5.0, 1.0), (1.0, 0.0)),
            displacement("b", (1.0, 6.0), (0.0, 1.0)),
        ),
    )
    response = staged.response([(c, s) for c in "ab" for s in ("open", "line")])
    p = np.array([q.start for q in parameters])
    assert_exact(response, p, staged.names)
    said = "what 'core' still holds at stage 'open' contains the product of part and "
    assert said in response.obstacle()


def test_condensation_finds_a_released_part_of_a_given_stress():
    """The held forces of ground that has not moved are the released part times given stresses."""
    parameters = (Parameter("part", 0.4, 0.05, 0.95), Parameter("E", E, 1e8, 1e11))
    staged = _staged(
        _tunnel(2),
        Scalar(1.0, "part"),
        parameters=parameters,
        materials={
            "rock": material("rock", Scalar(1.0, "E"), NU),
            "shot": material("shot", E_LINING, NU_LINING),
        },
        channels=(
            displacement("a", (5.0, 1.0), (1.0, 0.0)),
            displacement("b", (1.0, 6.0), (0.0, 1.0)),
        ),
    )
    response = staged.response([(c, s) for c in "ab" for s in ("open", "line")])
    assert response.obstacle() is None
    truth = np.array([0.55, 1.3 * E])
    measured, p = response.readings(truth), np.array([0.3, E])
    for _ in range(8):
        condensed = response.condense(p, measured, np.full(4, 1e-4))
        p = np.linalg.lstsq(condensed.matrix * truth, condensed.vector)[0] * truth
    np.testing.assert_allclose(p, truth, rtol=1e-9)


def test_a_released_part_of_ground_that_has_moved_is_multiplied_by_its_moduli():
    """What is held of the stress then contains modulus times strain."""
    parameters = (Parameter("part", 0.4, 0.05, 0.95), Parameter("E", E, 1e8, 1e11))
    held = {"core": Scalar(1.0, "part")}
    staged = _staged(
        _tunnel(2),
        ZERO,
        parameters=parameters,
        materials={"rock": material("rock", Scalar(1.0, "E"), NU)},
        stages=(Stage("ring", excavate=("ring",)), Stage("open", excavate=("core",), release=held)),
        channels=(displacement("a", (5.0, 1.0), (1.0, 0.0)),),
    )
    said = "what 'core' still holds at stage 'open' contains the product of part and E, and both "
    assert staged.response([("a", "open")]).obstacle() == said + "are free"


def test_a_lining_of_elements_in_the_stage_that_excavates_in_parts_is_refused():
    held = {"core": Scalar(0.4), "ring": Scalar(0.4)}
    stages = (
        Stage("open", excavate=("core", "ring"), install={"ring": "shot"}, release=held),
        Stage("rest", release={"core": Scalar(1.0), "ring": Scalar(1.0)}),
    )
    with pytest.raises(InputError) as caught:
        _staged(_tunnel(2), Scalar(0.4), stages=stages)
    (fault,) = caught.value.faults
    assert fault.path == "stages[0].install.ring"
    assert "{name: lined, install: {ring: shot}, release: {core: 1, ring: 1}}" in fault.hint
