"""Flow with little or no dilation on unstructured triangles, and loads that it does not carry.

The opening of `test_cavities` on meshes whose elements are 0.15 to 0.03 radii long at the wall,
made in three stages. The diffuse flow is not stable there: its tangents have eigenvalues around
zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.cases import displacement, model
from support.meshes import box, elevate, regroup, with_outer_faces
from support.yielding import (
    NOTHING,
    Cavity,
    constant,
    dual,
    hoek,
    mohr,
    mohr_limit,
    parameters,
    rock,
)

from geoident.errors import CollapseError
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.model import StagedModel
from geoident.forward.openings.closed_forms import GroundState, flow_slope
from geoident.forward.openings.hoek_brown import HoekBrownLimit
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Scalar

CAVITY, C, PHI = Cavity(), 3.45e6, np.pi / 6
RELEASED = (0.6, 0.9, 1.0)
STAGES = tuple(
    Stage(f"{part:.0%}", excavate=() if n else ("core",), release={"core": Scalar(part)})
    for n, part in enumerate(RELEASED)
)
MESHES = Path(__file__).with_name("opening_meshes.npz")
QUICK, FINE = (0.15,), (0.10, 0.05, 0.03)
DILATIONS = np.array([0.0, 2.0, 5.0, 10.0, 30.0])


@cache
def unstructured(size: float) -> Mesh:
    """A quarter out to 40 radii; middles of edges on the wall and the outer edge lie on them."""
    kept = np.load(MESHES)
    corners, cells = kept[f"points {size:.2f}"], kept[f"cells {size:.2f}"].astype(np.int64)
    points, raised = elevate(corners, cells, "tri6")
    radius = np.linalg.norm(corners, axis=1)
    for ends, middle in (((0, 1), 3), ((1, 2), 4), ((2, 0), 5)):
        for r in (1.0, radius.max()):
            on = np.all(np.abs(radius[raised[:, ends]] - r) < 1e-9 * r, axis=1)
            mine = raised[on, middle]
            points[mine] *= r / np.linalg.norm(points[mine], axis=1)[:, None]
    mesh = Mesh(points, (ElementBlock("tri6", raised, np.arange(1, len(raised) + 1)),))
    return regroup(with_outer_faces(mesh), core=lambda c: np.linalg.norm(c, axis=1) < 1.0)


def wall_of(state: GroundState) -> float:
    """Outward displacement of the wall."""
    return float(state.displacement(np.array([1.0])).value[0])


def opened(size: float, psi: float) -> StagedModel:
    return CAVITY.staged(unstructured(size), mohr(C, PHI, psi=psi), stages=STAGES)


@pytest.mark.parametrize(
    "size", [*QUICK, *(pytest.param(size, marks=pytest.mark.slow) for size in FINE)]
)
def test_opening_of_unstructured_triangles(size, verification):
    """The mean of the wall within 0.5 % at all stages, at most a little residual."""
    ends = []
    for psi in np.radians(DILATIONS):
        staged = opened(size, psi)
        run = staged.at(NOTHING, RunOptions(derivatives=False))
        walls = [CAVITY.outwards(staged, end) for end in run.states()][1:]
        limit = mohr_limit(C, PHI, psi)
        truth = [wall_of(CAVITY.closed_form(limit, released)) for released in RELEASED]
        assert max(run.findings.plastic.overstressed.values(), default=0.0) < 0.01
        for wall, right in zip(walls, truth, strict=True):
            assert wall.mean() == pytest.approx(right, rel=0.005)
            np.testing.assert_allclose(wall, right, rtol=0.015)
        ends.append((-truth[-1], -walls[-1].mean()))
    right, found = np.transpose(ends)
    verification("opening-dilation", f"{1000 * size:.0f} mm", DILATIONS, exact=right, found=found)


def parametric(size: float) -> StagedModel:
    ground = rock(Scalar(1.0, "E"), CAVITY.nu, mohr(Scalar(1.0, "c"), Scalar(1.0, "phi"), psi=0.0))
    return CAVITY.staged(
        unstructured(size),
        parameters=parameters(E=CAVITY.E, c=C, phi=PHI),
        materials={"rock": ground},
        channels=(
            displacement("wall", (1.0, 0.0), (1.0, 0.0)),
            displacement("crown", (0.0, 1.0), (0.0, 1.0)),
            displacement("inside", (1.3, 1.0), (1.0, 0.0)),
        ),
    )


@pytest.mark.parametrize("size", [0.10, pytest.param(0.05, marks=pytest.mark.slow)])
def test_derivatives_without_dilation_are_those_of_the_response(size):
    """By differences of analyses that start afresh, where Newton's method alone finds no state.

    By both strengths at once, which the readings feel alike; by E: in `test_derivatives.py`.
    """
    pairs = [(gauge, "open") for gauge in ("wall", "crown", "inside")]
    p = np.array([CAVITY.E, 1.02 * C, PHI])
    _, slopes = parametric(size).response(pairs).evaluate(p)
    step = 4e-6 * p * (0.0, 1.0, 1.0)
    parts = np.abs(slopes * step).max(axis=0)
    assert 0.5 < parts[1] / parts[2] < 2.0
    there = [parametric(size).response(pairs).readings(p + sign * step) for sign in (1, -1)]
    differences = 0.5 * (there[0] - there[1])
    scale = parts[1:].min()
    np.testing.assert_allclose(differences, slopes @ step, rtol=0, atol=1e-6 * scale)


WEAK = Cavity(pressure=10e6, E=3e9, nu=0.25)
HOEK = {"mb": 1.2, "s": 2e-3, "a": 0.507}


def weak_rock(psi: float, released: Sequence[float] = RELEASED) -> StagedModel:
    """Hoek-Brown on the 0.10 mesh; near the wall it is as ground of 60 degrees."""
    stages = tuple(
        Stage(f"{part:.1%}", excavate=() if n else ("core",), release={"core": Scalar(part)})
        for n, part in enumerate(released)
    )
    return WEAK.staged(unstructured(0.10), hoek(30e6, psi=psi, **HOEK), stages=stages)


@pytest.mark.slow
def test_where_the_even_flow_ends_a_band_is_shown():
    """Hoek-Brown without support: a row of elements loses its stability, and its place is said.

    Near the wall the ground is as one of 60 degrees; the motions are those of the closed form.
    """
    psi, staged = np.radians(10.0), weak_rock(np.radians(10.0))
    run = staged.at(NOTHING, RunOptions(derivatives=False))
    *_, end = run.states()
    limit = HoekBrownLimit(*map(dual, (30e6, *HOEK.values())), flow_slope(dual(psi)))
    short = 1.0 - WEAK.outwards(staged, end).mean() / wall_of(WEAK.closed_form(limit))
    (stage,) = run.findings.plastic.overstressed
    found = run.findings.plastic.localising[stage]
    assert abs(short) < 0.02
    assert 0.0 < found.short < 0.1
    assert found.band.startswith("a band has lost its stability, with half of its strain in ")
    assert int(found.band.split(" in ")[1].split()[0]) < 20
    assert "it shears most in group 'rock' near (0.0" in found.band


# --- loads that are not carried ---

PRESSURE, COHESION = 1e5, 1e4
LIMIT = PRESSURE * np.sin(PHI) + COHESION * np.cos(PHI)


def sheared(psi: float | None, part: float, kind: str = "quad8") -> StagedModel:
    """A box in simple shear, of whose load a part is carried: tau = p sin phi + c cos phi."""
    tau = LIMIT / part

    def traction(face: str, x: float, y: float) -> Traction:
        return Traction(face, (Scalar(x), Scalar(y)))

    loads = {
        "top": traction("y1", tau, 0.0),
        "right": traction("x1", 0.0, tau),
        "left": traction("x0", 0.0, -tau),
    }
    soil = rock(3e7, 0.3, mohr(COHESION, PHI, psi=psi), name="soil")
    return model(
        box(kind, (4, 4)),
        materials={"soil": soil},
        groups={"all": "soil"},
        supports=(Support("y0", (0, 1)),),
        in_situ=constant(*(-PRESSURE,) * 3),
        stages=(Stage("shear", loads=loads),),
    )


@pytest.mark.parametrize(
    ("psi", "part"),
    [
        *((0.0, 0.489), (0.1, 0.931), (None, 0.489)),
        # the other part of each
        *(pytest.param(*given, marks=pytest.mark.slow)
          for given in ((0.0, 0.931), (0.1, 0.489), (None, 0.931))),
    ],
)  # fmt: skip
def test_part_of_a_load_that_is_carried(psi, part):
    with pytest.raises(CollapseError) as caught:
        sheared(psi, part).survey(NOTHING, fields=False)
    assert caught.value.fraction == pytest.approx(part, abs=0.003)
    text = str(caught.value)
    assert "the ground cannot carry the loads: plastic collapse" in text
    assert "% of the change of load of this stage is carried; it shears most in group 'all'" in text
    motion = caught.value.mechanism.reshape(-1, 2)
    assert np.abs(motion).max() == pytest.approx(1.0)
    assert np.all(motion[:, 0] >= -0.05)  # to where it is sheared
    top = motion[:, 0].argmax()
    assert sheared(psi, part).mesh.points[top, 1] > 0.7


@pytest.mark.parametrize("psi", [0.0, 0.1, None])
def test_what_is_just_carried_is_in_equilibrium(psi):
    survey = sheared(psi, 1.01).survey(NOTHING, fields=False)
    assert survey.collapses == {}
    assert not [note for note in survey.notes if "not converged" in note]
