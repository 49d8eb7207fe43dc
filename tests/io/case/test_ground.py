"""Materials of every symmetry in case files: how they are read, and what is refused where."""

from __future__ import annotations

from itertools import permutations
from math import cos, pi, radians, sin

import numpy as np
import pytest
from support.cases import moduli_at

from geoident.model.ground import (
    Anisotropic,
    Attitude,
    Axes,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
)
from geoident.model.parameter import Scalar

ROCK = "  rock: {E: $E_rock, nu: 0.25, density: 2650 kg/m3}\n"
STRATA = "elastic: transversely-isotropic, E_p: $E_rock, nu_p: 0.2, E_n: 0.5 $E_rock, nu_np: 0.1"
THREE = (
    "elastic: orthotropic, E_1: $E_rock, E_2: 9 GPa, E_3: 7 GPa, nu_12: 0.2, nu_13: 0.2, "
    "nu_23: 0.1, G_12: 4 GPa, G_13: 3 GPa, G_23: 2 GPa"
)
ENTRIES = "elastic: anisotropic, c11: $E_rock, c22: 20 GPa, c33: 20 GPa, c44: 8 GPa, c12: 5 GPa"


@pytest.fixture
def rock(project, changed):
    """The material rock of a case, or the one fault of what is written for it."""

    def read(text: str, *, solid: bool = False):
        case = changed(ROCK, f"  rock: {{{text}}}\n")
        if solid:
            case = _solid(case)
        return project.read(case).case.materials["rock"]

    return read


@pytest.fixture
def fault(project, changed):
    def read(text: str, *, solid: bool = False):
        case = changed(ROCK, f"  rock: {{{text}}}\n")
        return project.only_fault(_solid(case) if solid else case)

    return read


def _solid(case: str) -> str:
    case = case.replace("plane-strain", "solid")
    for point in ("[12.5, 3 m]", "[17.5, 3 m]", "[-1, 0 m]", "[1, 0 m]"):
        case = case.replace(point, point.replace(" m]", ", 0 m]"))
    return case


def test_strata_in_a_section_fall_towards_x(rock):
    elastic = rock(f"{STRATA}, G_np: 3 GPa, dip: 35 deg").elastic
    assert isinstance(elastic, TransverselyIsotropic)
    assert elastic.E_n == Scalar(0.5, "E_rock")
    assert elastic.frame == Attitude(Scalar(radians(35)), Scalar(pi / 2))


def test_strata_in_a_solid_lie_by_dip_and_dip_direction(rock):
    elastic = rock(
        f"{STRATA}, G_np: 3 GPa, dip: 35 deg, dip_direction: 120 deg", solid=True
    ).elastic
    assert elastic.frame == Attitude(Scalar(radians(35)), Scalar(radians(120)))


def test_a_normal_says_the_same_as_dip_and_dip_direction(rock):
    dip, azimuth = radians(35), radians(120)
    n = (sin(dip) * sin(azimuth), sin(dip) * cos(azimuth), cos(dip))
    by_normal = rock(f"{STRATA}, G_np: 3 GPa, normal: [{n[0]}, {n[1]}, {n[2]}]", solid=True)
    by_angles = rock(f"{STRATA}, G_np: 3 GPa, dip: 35 deg, dip_direction: 120 deg", solid=True)
    E, F = (moduli_at(m, {"E_rock": 15e9}, 6) for m in (by_normal, by_angles))
    np.testing.assert_allclose(E, F, atol=1e-6 * 15e9 * 1e-6)
    section = rock(f"{STRATA}, G_np: 3 GPa, normal: [{2 * sin(dip)}, {2 * cos(dip)}]")
    apparent = rock(f"{STRATA}, G_np: 3 GPa, dip: 35 deg")
    E, F = (moduli_at(m, {"E_rock": 15e9}, 4) for m in (section, apparent))
    np.testing.assert_allclose(E, F, atol=1e-12 * 15e9)


def test_love_moduli_and_an_angle_as_parameter(project, changed):
    text = changed(ROCK, "  rock: {elastic: transversely-isotropic, A: $E_rock, C: 9 GPa, "
                         "F: 3 GPa, L: 2 GPa, N: 4 GPa, dip: $dip}\n")  # fmt: skip
    text = text.replace(
        "parameters:\n", "parameters:\n  dip: {start: 30 deg, bounds: [0, 60 deg]}\n"
    )
    case = project.read(text).case
    elastic = case.materials["rock"].elastic
    assert isinstance(elastic, LoveModuli)
    assert elastic.frame.dip == Scalar(1.0, "dip")
    assert case.parameters[0].start == pytest.approx(pi / 6)
    assert case.parameters[0].dimension == "angle"


def test_three_axes_by_angles_or_by_two_vectors(rock):
    elastic = rock(f"{THREE}, dip: 35 deg, rotation: 10 deg").elastic
    assert isinstance(elastic, Orthotropic)
    assert elastic.frame.rotation == Scalar(radians(10))
    elastic = rock(f"{THREE}, axis_1: [3, 4], axis_2: [-4, 3]").elastic
    assert elastic.frame == Axes((0.6, 0.8, 0.0), (-0.8, 0.6, 0.0))


def axes_of_a_compass(dip: float, azimuth: float, rotation: float) -> np.ndarray:
    """Axes 1, 2, 3 as columns in east, north, up, from the words of the manual.

    1 down the dip, 3 along the normal, upwards, 2 along the strike so that they are right-handed;
    `rotation` turns 1 and 2 about 3 (Rodrigues' formula).
    """
    down = np.array([cos(dip) * sin(azimuth), cos(dip) * cos(azimuth), -sin(dip)])
    normal = np.array([sin(dip) * sin(azimuth), sin(dip) * cos(azimuth), cos(dip)])
    turned = [
        cos(rotation) * v + sin(rotation) * np.cross(normal, v)
        for v in (down, np.cross(normal, down))
    ]
    return np.column_stack([*turned, normal])


def stiffness_along(axes: np.ndarray) -> np.ndarray:
    """E (6, 6) of `THREE` with these axes: the compliance inverted, the tensor turned, Pa.

    Rows and columns xx, yy, zz, xy, yz, xz.
    """
    E, G, nu = (15e9, 9e9, 7e9), (4e9, 2e9, 3e9), {(0, 1): 0.2, (0, 2): 0.2, (1, 2): 0.1}
    S = np.diag([1 / x for x in (*E, *G)])
    for (i, j), ratio in nu.items():
        S[i, j] = S[j, i] = -ratio / E[i]
    C, pairs = np.linalg.inv(S), [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]
    tensor = np.zeros((3, 3, 3, 3))
    for a, (i, j) in enumerate(pairs):
        for b, (k, m) in enumerate(pairs):
            for one in {(i, j), (j, i)}:
                for other in {(k, m), (m, k)}:
                    tensor[(*one, *other)] = C[a, b]
    turned = np.einsum("ia,jb,kc,md,abcd->ijkm", axes, axes, axes, axes, tensor)
    return np.array([[turned[(*one, *other)] for other in pairs] for one in pairs])


@pytest.mark.parametrize("keys", list(permutations(["dip", "dip_direction", "rotation"])))
def test_axes_by_dip_direction_and_rotation_lie_as_the_manual_says(rock, keys):
    """An independent turn of the tensor of stiffness; the order of the keys does not matter."""
    angles = {"dip": 35.0, "dip_direction": 120.0, "rotation": 25.0}
    written = ", ".join(f"{key}: {angles[key]} deg" for key in keys)
    found = moduli_at(rock(f"{THREE}, {written}", solid=True), {"E_rock": 15e9}, 6)
    axes = axes_of_a_compass(*(radians(angles[key]) for key in angles))
    np.testing.assert_allclose(found, stiffness_along(axes), atol=1e-9 * 15e9)


@pytest.mark.parametrize("keys", list(permutations(["dip", "dip_direction", "rotation"])))
def test_axes_in_a_section_lie_as_in_a_solid_seen_looking_north(rock, keys):
    """x is east, y up, z south: the turned stiffness of the solid with these components."""
    angles = {"dip": 35.0, "dip_direction": 90.0, "rotation": 90.0}
    written = ", ".join(f"{key}: {angles[key]} deg" for key in keys)
    found = moduli_at(rock(f"{THREE}, {written}"), {"E_rock": 15e9}, 4)
    seen = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # x, y, z of the section
    axes = seen @ axes_of_a_compass(*(radians(angles[key]) for key in angles))
    np.testing.assert_allclose(found, stiffness_along(axes)[:4, :4], atol=1e-9 * 15e9)


@pytest.mark.parametrize("keys", list(permutations(["dip", "dip_direction", "rotation"])))
def test_axes_of_a_field_take_the_angles_in_any_order(rock, keys):
    angles = {"dip": 35.0, "dip_direction": 120.0, "rotation": 25.0}
    along = ", ".join(f"{key}: {angles[key]} deg" for key in keys)
    field = "{field: {mean: $E_rock, sd: 30 %, length: [9 m, 5 m, 2 m], along: {" + along + "}}}"
    frame = rock(f"E: {field}, nu: 0.2", solid=True).fields[0].frame
    assert frame == Attitude(*(Scalar(radians(angle)) for angle in angles.values()))


def test_entries_of_a_general_matrix(rock):
    elastic = rock(f"{ENTRIES}, c14: -1 GPa").elastic
    assert isinstance(elastic, Anisotropic)
    assert elastic.entries["c14"] == Scalar(-1e9)
    E = moduli_at(rock(ENTRIES), {"E_rock": 15e9}, 4)
    np.testing.assert_array_equal(
        E, 1e9 * np.array([[15, 5, 0, 0], [5, 20, 0, 0], [0, 0, 20, 0], [0, 0, 0, 8]])
    )


def test_the_resolved_case_says_the_same(project, changed):
    text = changed(ROCK, f"  rock: {{{STRATA}, G_np: 3 GPa, dip: 35 deg}}\n")
    loaded = project.read(text)
    again = project.read(loaded.resolved)
    assert again.case.materials == loaded.case.materials


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("elastic: «transverse, E: $E_rock", ["'transverse'", "transversely-isotropic"]),
        (f"{STRATA}, G_np: «3, dip: 0 deg", ["no unit"]),
        (f"{STRATA}, G_np: 3 GPa, dip: «35", ["no unit", "angle"]),
        (f"{STRATA}, G_np: 3 GPa, dip: 0 deg, «G_pn: 3 GPa", ["'G_pn'"]),
        (
            f"{STRATA.replace('nu_np: 0.1', 'nu_np: «0.9')}, G_np: 3 GPa, dip: 0 deg",
            ["E_n/E_p = 0.5", "nu_p = 0.2", "between -0.4472 and 0.4472"],
        ),
        (f"{STRATA}, G_np: 3 GPa, normal: «[1, 0, 0, 0]", ["4 components"]),
        (f"{STRATA}, G_np: 3 GPa, normal: «[0, 0]", ["length zero"]),
        (f"{THREE}, axis_1: [1, 0], axis_2: «[1, 1]", ["right angle"]),
        (f"{THREE.replace('nu_23: 0.1', 'nu_23: «1.2')}, dip: 0 deg", ["E_2/E_3"]),
        (
            THREE.replace("$E_rock", "15 GPa")
            .replace("nu_12: 0.2, nu_13: 0.2, nu_23: ", "nu_12: 1.0, nu_13: 0.9, nu_23: «")
            .replace("G_12: 4 GPa", "G_12: $E_rock")
            + ", dip: 0 deg",
            # where det [1/15, -1/15, -0.9/15; -1/15, 1/9, -nu/9; -0.9/15, -nu/9, 1/7] is zero
            ["with nu_12 = 1 and nu_13 = 0.9", "between -1.106 and 0.02558"],
        ),
        (ENTRIES.replace("c44: 8 GPa", "c44: «-8 GPa"), ["positive"]),
        (ENTRIES.replace("c22: 20 GPa", "c22: «1 GPa"), ["must exceed 1.66667e+09 Pa"]),
    ],
)
def test_a_fault_is_told_at_its_place(fault, text, words):
    message = str(fault(text))
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("text", "solid", "words"),
    [
        (STRATA + ", dip: 0 deg", False, ["found E_p, nu_p, E_n and nu_np", "G_np"]),
        (STRATA + ", G_np: 3 GPa", False, ["dip (with dip_direction), or normal"]),
        (STRATA + ", G_np: 3 GPa, dip: 5 deg, normal: [0, 1]", False, ["dip and normal"]),
        (STRATA + ", G_np: 3 GPa, dip: 5 deg", True, ["direction of the dip is missing"]),
        (THREE + ", dip: 5 deg, axis_1: [1, 0]", False, ["dip and axis_1"]),
        (ENTRIES, True, ["'c55' is missing"]),
    ],
)
def test_what_is_missing_is_told(project, changed, text, solid, words):
    case = changed(ROCK, f"  rock: {{{text}}}\n")
    first = str(project.faults(_solid(case) if solid else case)[0])
    for word in words:
        assert word in first


def test_an_inadmissible_tie_is_told_with_the_parameter_to_change(fault):
    found = fault("elastic: isotropic, E: $E_rock, nu: «$K0")
    assert "is 1 at the start; it must be between -1 and 0.5" in found.message
    assert found.hint == "Change the start of K0."


def test_a_number_that_the_parameters_make_inadmissible_names_them(project, changed):
    text = changed(ROCK, f"  rock: {{{STRATA.replace('nu_np: 0.1', 'nu_np: 0.9')}, "
                         "G_np: 3 GPa, dip: $dip}\n")  # fmt: skip
    dip = "parameters:\n  dip: {start: 30 deg, bounds: [0, 60 deg]}\n"
    (found,) = project.faults(text.replace("parameters:\n", dip))
    assert found.path == "materials.rock.nu_np"
    assert found.hint == "Change it, or the start of E_rock."
