"""Forces and strains of structures at a place, and what the ground presses on a lining."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.force_gauges import gauge
from support.load_cells import ENDS, GAUGES, VALUES, cell, nailed
from support.load_cells import P as NAILED
from support.meshes import box, regroup
from support.tunnels import walled, with_lines

from geoident.errors import InputError
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.gauges import Reads
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Beam

ZERO = Scalar(0.0)
NOTHING = np.empty(0)
HEIGHT, LOAD, THICKNESS = 4.0, 5e3, 0.4
E_WALL = 30e9
DIMENSIONS = {"N": "line load", "Q": "line load", "M": "moment per length"}


def _cell(name, point, quantity="N", **more):
    return gauge(
        "load-cell", name, point, quantity, structure="wall", dimension=DIMENSIONS[quantity], **more
    )


def _cantilever(*channels, soft=1.0, **changes):
    """A wall on the right edge of very soft ground, clamped at its foot, pulled to the right.

    Parameters are E and the thickness of the wall; the ground bears next to nothing.
    """
    mesh = box("quad8", (2, 8), size=(1.0, HEIGHT))
    right = np.flatnonzero(np.abs(mesh.points[:, 0] - 1.0) < 1e-9)
    right = right[np.argsort(mesh.points[right, 1])]
    mesh = with_lines(mesh, "line", np.stack([right[:-1], right[1:]], axis=1))
    number = {"E": Scalar(1.0, "E"), "t": Scalar(1.0, "t")}
    settings = {
        "parameters": (Parameter("E", E_WALL, 1e9, 1e12), Parameter("t", THICKNESS, 0.1, 1.0)),
        "materials": {"mud": material("mud", soft, 0.0)},
        "groups": {"all": "mud"},
        "supports": (Support("y0", (0, 1)),),
        "structures": {
            "wall": Beam("line", number["E"], number["t"], clamped_on=("y0",)),
        },
        "stages": (
            Stage("build", build=("wall",)),
            Stage("pull", loads={"q": Traction("x1", (Scalar(LOAD), Scalar(2 * LOAD)))}),
        ),
        "channels": channels,
    }
    return model(mesh, **{**settings, **changes})


P = np.array([E_WALL, THICKNESS])


def test_moment_shear_and_axial_force_of_a_wall_are_those_of_a_cantilever():
    """M = q (h - y)^2 / 2, Q = q (h - y), N = n (h - y) under q across and n along the wall.

    The ground is on its left, the inside on the right. Pulled to the right, the wall is stretched
    on the left: M counts negative.
    """
    places = {"low": 0.4, "at a node": 1.5, "high": 3.1}
    cells = [
        _cell(f"{name} {q}", (1.0, y), q) for name, y in places.items() for q in ("N", "M", "Q")
    ]
    found = _cantilever(*cells).survey(P, fields=False).computed[:, 1].reshape(-1, 3)
    for (N, M, Q), y in zip(found, places.values(), strict=True):
        left, piece = HEIGHT - y, 0.25
        assert pytest.approx(LOAD * left**2 / 2, rel=0.02) == -M
        assert abs(Q) == pytest.approx(LOAD * left, abs=LOAD * piece)
        assert pytest.approx(2 * LOAD * left, abs=2 * LOAD * piece) == N


def test_the_side_of_the_inside_turns_moment_and_fibres_and_nothing_else():
    place, left, right = (1.0, 0.7), (0.0, 0.7), (2.0, 0.7)
    named = {"open": None, "left": left, "right": right}
    channels = [
        _cell(f"{side} {q}", place, q, towards=towards)
        for side, towards in named.items()
        for q in ("N", "M", "Q")
    ]
    N, M, Q = _cantilever(*channels).survey(P, fields=False).computed[:, 1].reshape(3, 3).T
    assert N[0] == N[1] == N[2]
    assert Q[0] == Q[1] == Q[2]
    assert M[0] == M[2] == -M[1]


def test_shear_is_the_slope_of_the_moment_with_the_inside_on_the_right():
    """The inside is at x > 1, so s runs upwards."""
    ys = 1.5 + np.array([-0.05, 0.05]) + 0.1
    cells = [_cell(f"M{k}", (1.0, y), "M") for k, y in enumerate(ys)]
    M0, M1, Q = (
        _cantilever(*cells, _cell("Q", (1.0, 1.6), "Q")).survey(P, fields=False).computed[:, 1]
    )
    assert pytest.approx((M1 - M0) / 0.1, rel=1e-9) == Q


def _fibre(name, quantity, **more):
    return gauge("strain", name, (1.0, 0.7), quantity, structure="wall", reads=Reads.VALUE, **more)


def test_fibre_strains_are_those_of_axial_force_and_moment():
    staged = _cantilever(
        _cell("N", (1.0, 0.7)),
        _cell("M", (1.0, 0.7), "M"),
        _fibre("axis", "axis"),
        _fibre("in", "inside"),
        _fibre("out", "outside"),
        _fibre("bar", "inside", fibre=0.15),
    )
    N, M, axis, inside, outside, bar = staged.survey(P, fields=False).computed[:, 1]
    EA, EI = E_WALL * THICKNESS, E_WALL * THICKNESS**3 / 12
    assert axis == pytest.approx(N / EA, rel=1e-12)
    assert inside == pytest.approx(N / EA + M / EI * THICKNESS / 2, rel=1e-12)
    assert outside == pytest.approx(N / EA - M / EI * THICKNESS / 2, rel=1e-12)
    assert bar == pytest.approx(N / EA + M / EI * 0.15, rel=1e-12)
    assert inside < 0 < outside  # pulled to the right, where nothing is


def test_forces_and_fibres_are_differentiated_exactly():
    channels = [
        *(_cell(q, (1.0, 0.7), q) for q in ("N", "M", "Q")),
        *(_fibre(f, f) for f in ("axis", "inside", "outside")),
        replace(_fibre("since", "inside"), reads=Reads.CHANGE, zero="build"),
    ]  # fmt: skip
    staged = _cantilever(*channels, soft=2e9)
    for kind in ("N", "M", "Q", "axis", "inside", "outside", "since"):
        assert_exact(staged.response([(kind, "pull")]), P, ("E", "t"))


def test_the_strain_of_a_bolt_is_its_force_over_its_stiffness():
    values = np.array([2e9, 3e8, 1.5, -2e6])
    strain = gauge("strain", "e", ENDS[1][1], structure="nails", member=1, reads=Reads.VALUE)
    cell = gauge("load-cell", "N", ENDS[1][1], "N", structure="nails", member=1, dimension="force")
    staged = nailed(strain, cell, replace(cell, name="push", compression=True))
    e, N, push = staged.survey(values, fields=False).computed[:, 2]
    assert e == pytest.approx(N / 3e8, rel=1e-12)
    assert push == -N
    assert_exact(staged.response([("e", "go on")]), values, ("E", "EA", "s", "p"))


RADIUS, P0, NU = 3.0, 5e6, 0.3


def _ring(*channels, n=6, EA=4e9, p0=P0):
    layers = int(np.ceil(np.log(40) / np.log(1 + np.pi / 4 / n))) + 1
    mesh = walled("quad8", n=n, layers=layers, radius=RADIUS, reach=40 * RADIUS)
    stress = (*(Scalar(-p0),) * 2, Scalar(-2 * NU * p0), ZERO, ZERO, ZERO)
    return model(
        mesh,
        materials={"rock": material("rock", 2e9, NU)},
        groups={"core": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=ConstantStress(stress),
        structures={
            "wall": Beam("wall", EA=Scalar(EA), EI=Scalar(3e7), clamped_on=("x0", "y0")),
        },
        stages=(
            Stage("open", excavate=("core",), release={"core": Scalar(0.4)}),
            Stage("line", build=("wall",), release={"core": Scalar(1.0)}),
        ),
        channels=channels,
    )


def test_the_pressure_on_a_lining_is_that_of_convergence_and_confinement():
    """p = (1 - lambda) p0 / (1 + 2 G / (k R)), k = EA / R^2 (Panet, 1995); the lining bears p R."""
    at = (RADIUS * np.cos(0.5), RADIUS * np.sin(0.5))
    cell = gauge("pressure-cell", "p", at, structure="wall", compression=True)
    force = _cell("N", at)
    staged = _ring(cell, force)
    pressure, N = staged.survey(NOTHING, fields=False).computed[:, 1]
    G, k = 2e9 / (2 * (1 + NU)), 4e9 / RADIUS**2
    exact = 0.6 * P0 / (1 + 2 * G / (k * RADIUS))
    assert pressure == pytest.approx(exact, rel=0.02)
    assert pytest.approx(exact * RADIUS, rel=0.01) == -N
    assert staged.unreadable("p", "open") == "its structure does not stand then"


def test_in_the_middle_of_ground_the_inside_must_be_said():
    mesh = box("quad4", (4, 4), size=(4.0, 4.0))
    line = np.array([mesh_node(mesh, (2.0, y)) for y in (1.0, 2.0, 3.0, 4.0)])
    mesh = regroup(with_lines(mesh, "line", np.stack([line[:-1], line[1:]], axis=1)),
                   pit=lambda x: (x[:, 0] < 2.0) & (x[:, 1] > 2.0))  # fmt: skip
    settings = {
        "materials": {"soil": material("soil", 1e8, 0.3)},
        "groups": {"rock": "soil", "pit": "soil"},
        "supports": (Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        "in_situ": ConstantStress((Scalar(-1e5), *(ZERO,) * 5)),
        "structures": {"wall": Beam("line", EA=Scalar(1e9), EI=Scalar(1e7))},
        "stages": (Stage("build", build=("wall",)), Stage("dig", excavate=("pit",))),
    }
    deep, high = (2.0, 1.5), (2.0, 3.5)
    with pytest.raises(InputError) as error:
        model(mesh, **settings, channels=(_cell("M", deep, "M"), _cell("N", deep)))
    (fault,) = error.value.faults
    assert fault.code == "which-side"
    assert fault.message == (
        "gauge 'M' reads the structure 'wall' at (2, 1.5) m, where there is ground on both sides "
        "of it or on none: which side is its inside is not known"
    )
    wrong = gauge("pressure-cell", "cell", (2.0, 2.5), structure="wall", compression=True,
                  towards=(4.0, 2.5))  # fmt: skip
    with pytest.raises(InputError) as error:
        model(mesh, **settings, channels=(wrong,))
    (fault,) = error.value.faults
    assert fault.code == "no-ground-behind"
    assert fault.message == (
        "gauge 'cell' finds no ground at (2, 2.5) m that presses on the outside of 'wall' as long "
        "as that stands"
    )
    assert fault.hint == "'towards' is a point on its inside, where ground is excavated"
    lean = gauge("tilt", "lean", high, structure="wall", zero="virgin", dimension="angle")
    with pytest.raises(InputError) as error:
        model(mesh, **settings, channels=(lean,))
    assert [(f.code, f.hint) for f in error.value.faults] == [
        ("zero-before-structure", "zero it at one of these stages")
    ]
    pressures = [
        gauge("pressure-cell", "behind", high, structure="wall", compression=True),
        gauge("pressure-cell", "right", deep, structure="wall", compression=True,
              towards=(0.0, 1.5)),
        gauge("pressure-cell", "left", deep, structure="wall", compression=True,
              towards=(4.0, 1.5)),
    ]  # fmt: skip
    staged = model(mesh, **settings, channels=(*pressures, _cell("M", high, "M")))
    built, dug = staged.survey(NOTHING, fields=False).computed[:3].T
    np.testing.assert_allclose(built, 1e5, rtol=1e-9)
    assert dug[0] < dug[1]
    assert dug[1] != pytest.approx(dug[2], rel=1e-3)


def mesh_node(mesh, place):
    """The node at a place."""
    return int(np.linalg.norm(mesh.points - np.array(place), axis=1).argmin())


def _tilt(name, y, zero="build", towards=1.0):
    return gauge(
        "tilt", name, (1.0, y), structure="wall", dimension="angle", zero=zero,
        direction=(towards, 0.0),
    )  # fmt: skip


def test_tilt_of_a_wall_is_that_of_a_cantilever():
    """theta = q (h^2 y - h y^2 + y^3 / 3) / (2 E I), the top leaning to the right."""
    places = (0.4, 1.5, 3.1, 4.0)
    channels = [_tilt(f"t{k}", y) for k, y in enumerate(places)]
    channels.append(_tilt("back", 1.5, towards=-1.0))
    found = _cantilever(*channels).survey(P, fields=False).computed[:, 1]
    y, stiffness = np.array(places), E_WALL * THICKNESS**3 / 12
    expected = LOAD * (HEIGHT**2 * y - HEIGHT * y**2 + y**3 / 3) / (2 * stiffness)
    np.testing.assert_allclose(found[:4], expected, rtol=5e-3)
    assert found[4] == -found[1]


def test_tilt_of_a_wall_is_differentiated_exactly():
    response = _cantilever(_tilt("t", 1.6)).response([("t", "pull")])
    assert_exact(response, P, ("E", "t"))
    assert response.obstacle() == "gauge 't' reads something else than displacements"


def said(build, *channels, **changes):
    """Code, message and hint of every fault of gauges."""
    with pytest.raises(InputError) as error:
        build(*channels, **changes)
    faults = [fault for fault in error.value.faults if fault.path.startswith("gauges")]
    return [(fault.code, fault.message, fault.hint) for fault in faults]


SINCE = Reads.CHANGE


@pytest.mark.parametrize(
    ("channel", "code", "message", "hint"),
    [
        (_cell("b", (1.2, 1.0)), "not-on-structure",
         "sits at (1.2, 1) m, which is not on the structure 'wall'; its nearest place is (1, 1) m, "
         "0.2 m away", "correct the point or the structure"),
        (replace(_cell("b", (1.0, 1.0), "M"), dimension="force"), "unit",
         "reads the bending moment of a beam, per metre: a moment per length; its accuracy is a "
         "force", "write the accuracy as a moment per length"),
        (replace(_cell("b", (1.0, 1.0)), zero="virgin", reads=SINCE), "zero-before-structure",
         "reads zero at stage 'virgin', at which the structure 'wall' does not stand; it stands "
         "at: build, pull",
         "zero it at one of these stages, or remove 'zero' to read what there is since then"),
        (replace(_tilt("b", 1.5), zero="virgin"), "zero-before-structure",
         "reads zero at stage 'virgin', at which the structure 'wall' does not stand; it stands "
         "at: build, pull", "zero it at one of these stages"),
    ],
)  # fmt: skip
def test_faults_of_gauges_on_a_wall(channel, code, message, hint):
    assert said(_cantilever, channel) == [(code, f"gauge 'b' {message}", hint)]


@pytest.mark.parametrize("kind", ["load-cell", "pressure-cell"])
def test_a_structure_that_is_never_built_carries_no_gauge(kind):
    more = {"dimension": "line load", "quantity": "N"} if kind == "load-cell" else {}
    channel = gauge(kind, "b", (1.0, 1.0), structure="wall", **more)
    message = "gauge 'b' sits on the structure 'wall', which no stage builds"
    expected = [("structure-never-built", message, "add 'build: [wall]'")]
    assert said(_cantilever, channel, stages=(Stage("wait"),)) == expected


def test_a_fibre_needs_a_thickness_or_its_distance():
    beam = {"wall": Beam("line", EA=Scalar(1e10), EI=Scalar(1e8), clamped_on=("y0",))}
    channels = _fibre("in", "inside"), _fibre("axis", "axis")
    (fault,) = said(_cantilever, *channels, structures=beam)
    message = "gauge 'in' reads a fibre of the structure 'wall', whose thickness is not given"
    hint = "give 'depth': its distance from the axis of the beam"
    assert fault == ("no-thickness", message, hint)
    staged = _cantilever(_fibre("in", "inside", fibre=0.2), structures=beam)
    assert staged.unreadable("in", "pull") is None


@pytest.mark.parametrize(
    ("kind", "more", "code", "message", "hint"),
    [
        ("pressure-cell", {}, "wrong-structure",
         "reads a pressure on the structure 'nails', whose bars the ground does not press on",
         "name a beam, or give a point and a normal"),
        ("tilt", {"dimension": "angle"}, "wrong-structure",
         "reads a rotation of the structure 'nails', whose bars have none of their own",
         "name a beam, or give the two points of 'between'"),
        ("load-cell", {"quantity": "M", "dimension": "moment"}, "wrong-structure",
         "reads 'M' of the structure 'nails'; its bars bear only N",
         "remove the key, or name a beam"),
        ("strain", {"quantity": "inside"}, "wrong-structure",
         "reads 'inside' of the structure 'nails'; its bars bear only N",
         "remove the key, or name a beam"),
        ("load-cell", {"quantity": "N", "dimension": "force", "member": 2}, "no-such-bar",
         "sits on bar 3 of the structure 'nails', which has 2", "correct 'bar'; they count from 1"),
        ("load-cell", {"quantity": "N", "dimension": "pressure"}, "unit",
         "reads the axial force of one bar: a force; its accuracy is a pressure",
         "write the accuracy as a force"),
    ],
)  # fmt: skip
def test_faults_of_gauges_on_bars(kind, more, code, message, hint):
    """A case in a file is refused before; these are channels put together in code."""
    channel = gauge(kind, "b", ENDS[0][0], structure="nails", zero="bolt", **more)
    assert said(nailed, channel) == [(code, f"gauge 'b' {message}", hint)]


def test_a_load_cell_reads_the_axial_force_of_its_bolt_while_that_stands():
    staged = nailed(*GAUGES)
    survey = staged.survey(NAILED, fields=False)
    stages = ["open", "bolt", "go on", "cut"]
    forces = survey.members.axial[:, stages.index("go on")]
    assert np.abs(forces).min() > 1.0
    np.testing.assert_allclose(survey.computed[1:3, stages.index("go on")], forces, rtol=1e-14)
    before = survey.computed[1:3, stages.index("bolt")]  # free of stress when it is built
    assert np.abs(before).max() < 1e-12 * np.abs(forces).max()
    assert staged.unreadable("n1", "go on") is None
    assert staged.unreadable("n1", "open") == "its structure does not stand then"
    assert staged.unreadable("n1", "cut") == "its structure does not stand then"
    assert "later stage" in staged.unreadable("late", "bolt")


def test_forces_of_bolts_are_differentiated_exactly_and_have_no_unit_forces():
    staged = nailed(*GAUGES)
    response = staged.response([("n1", "go on"), ("d", "go on"), ("n2", "go on")])
    assert_exact(response, NAILED, tuple(VALUES))
    reason = "gauge 'n1' reads something else than displacements"
    assert response.obstacle() == response.system_obstacle() == reason


def test_every_point_outside_the_mesh_and_every_missing_bar_is_said_at_once():
    far = replace(displacement("far", (9.0, 6.0), (1.0, 0.0)), first=(7.0, 8.0))
    wide = replace(displacement("wide", (1.0, 1.5), (1.0, 0.0)), first=(-3.0, 2.0))
    cells = (cell("x", *ENDS[0], member=2), cell("y", *ENDS[1], member=3))
    text = "\n".join(message for _, message, _ in said(nailed, far, wide, *cells))
    assert text.count("gauge") == 5
    for place in ("(7, 8) m", "(9, 6) m", "(-3, 2) m", "'x'", "'y'"):
        assert place in text
