"""What is said of cases that do not fit their mesh, and of what is seldom meant: the words.

The numbers in them are reckoned here by hand.
"""

from math import asin, degrees, exp, sqrt

import pytest
from support.squares import case_of, grid, said_of

IN_SITU = "{model: heim, vertical: 10 MPa, K0: 0.5}"
COULOMB = "yield: {type: mohr-coulomb, cohesion: 1 MPa, friction: 30 deg}"
COLUMNS = "{" + ", ".join(f"g{n}: rock" for n in range(1, 9)) + "}"
LOW = "{S: {kind: settlement, point: [2 m, 1 m], accuracy: 0.1 mm}}"


def rock(elasticity: str, *more: str) -> str:
    return "{rock: {" + ", ".join([elasticity, *more]) + "}}"


def by_column(column, _):
    return f"g{column + 1}"


def said(tmp_path, mesh="", **keys):
    """What check says in one line, and the same with its lines."""
    found = said_of(tmp_path, case_of(**keys), mesh)
    return " ".join(found.split()), found.splitlines()


def fault(lines, place):
    """Message and remedy of the one fault at a place ``line:column: key``."""
    (at,) = (n for n, line in enumerate(lines) if line.startswith(f"case.yaml:{place}: "))
    return lines[at].removeprefix(f"case.yaml:{place}: "), lines[at + 1].strip()


def test_the_weight_above_more_groups_than_are_named(tmp_path):
    # points of a 2 x 2 rule in squares of 1 m: 0.2113 m and 1.7887 m below the surface
    materials = rock("E: $E, nu: 0.25, density: 2000 kg/m3")
    stages = "[{name: dig, excavate: [g8]}]"
    groups = COLUMNS[:-1] + ", g9: rock, g10: rock}"
    text, _ = said(
        tmp_path, grid(10, 2, by_column), groups=groups, gauges=LOW, stages=stages,
        materials=materials, gravity="10 m/s2", in_situ="{model: geostatic, K0: 0.5}",
    )  # fmt: skip
    low, high = (20 * (1 + k + s * 0.5 / sqrt(3) - 0.5) for k, s in ((0, -1), (1, 1)))
    each = f"{low:.3g} .. {high:.3g} kPa"
    assert f"in compression: 'g1' {each}, 'g2' {each}" in text
    assert f"'g8' {each} and 2 more groups" in text


def test_what_does_not_turn_about_the_axis(tmp_path):
    in_situ = (
        "{model: heim, vertical: 1 MPa, K0: 0.5, K0_across: 0.6, groups: {g1: {model: constant,"
        " xx: -1 MPa, yy: -1 MPa, zz: -2 MPa, xy: 0.1 MPa}}}"
    )
    _, lines = said(
        tmp_path, grid(8, 2, by_column, x0=-1), analysis="axisymmetric", groups=COLUMNS,
        gauges=LOW, stages="[{name: dig, excavate: [g8]}]", gravity="[1 m/s2, -9.81 m/s2]",
        loads="{quake: {seismic: [0.1, 0]}}", in_situ=in_situ,
    )  # fmt: skip
    at = lines.index(
        "squares.msh: elements 1, 19 have negative radii x, down to -1 m: the axis of an "
        "axisymmetric analysis is x = 0"
    )
    assert lines[at + 1].strip() == "mesh one half of the section, at x >= 0, with y along the axis"
    for place, message, hint in (
        ("10:1: gravity", "gravity has a part across the axis", "let it act along y"),
        ("11:9: loads.quake", "shaking across the axis", "set its x to 0"),
        ("12:41: in_situ.K0", "are equal (rr = tt)", "give one K0"),
        ("12:121: in_situ.groups.g1.zz", "differ: on the axis", "write the same for both"),
        ("12:133: in_situ.groups.g1.xy", "is not zero: shear on the axis", "remove it"),
    ):
        found, remedy = fault(lines, place)
        assert message in found
        assert remedy == f"{hint}, or model it as a solid"


def test_pieces_of_a_shell_on_the_axis(tmp_path):
    _, lines = said(
        tmp_path, analysis="axisymmetric", stages="[{name: dig, build: [w]}]",
        structures="{w: {kind: beam, on: left, EA: 1 GN/m, EI: 10 MNm2/m}}",
    )  # fmt: skip
    assert fault(lines, "10:30: structures.w.on") == (
        "4 pieces of the beam 'w' lie on the axis x = 0, where a shell of revolution has no radius",
        "let the group end at the axis",
    )


def test_stress_of_ground_that_is_not_there(tmp_path):
    own = "{model: constant, xx: -1 MPa, yy: -1 MPa, zz: -2 MPa}"
    _, lines = said(
        tmp_path, groups="{ground: rock, top: absent}", stages="[{name: dig, excavate: [ground]}]",
        in_situ="{model: heim, vertical: 1 MPa, K0: 0.5, groups: {top: " + own + "}}",
    )  # fmt: skip
    assert fault(lines, "10:59: in_situ.groups.top") == (
        "'top' is not present in the virgin state, so it has no in-situ stress",
        "remove the entry, or correct 'groups'",
    )
    stages = "[{name: fill, install: {ground: rock}}]"
    _, lines = said(
        tmp_path, groups="{ground: absent, top: absent}", stages=stages, in_situ=IN_SITU
    )
    assert fault(lines, "10:1: in_situ") == (
        "no ground is there before the first stage that could have an in-situ stress",
        "Remove 'in_situ': what is placed has none; or give a group a material under 'groups'.",
    )


def test_nothing_is_left(tmp_path):
    stages = "[{name: dig, excavate: [top]}, {name: rest, excavate: [ground]}]"
    _, lines = said(tmp_path, stages=stages, gauges="{}")
    assert fault(lines, "8:40: stages[1]") == (
        "after stage 'rest' no ground is present",
        "Something has to stay: leave out what the stage takes away last.",
    )


def test_points_outside_the_mesh_are_said_beside_groups_that_are_missing(tmp_path):
    """Of gauges in the ground and of measured values; a beam is not looked for there."""
    mesh = grid(group=lambda column, _: "other" if column == 1 else "ground")
    gauges = """{far: {kind: settlement, point: [2 m, -7 m], accuracy: 0.1 mm},
  on: {kind: load-cell, structure: w, point: [2 m, -8 m], quantity: Q, accuracy: 1 kN/m},
  S: {kind: settlement, point: [2 m, 1 m], accuracy: 0.1 mm}}"""
    field = "mean: $E, sd: 30 %, length: 2 m, measured: [{at: [9 m, 1 m], value: 2 GPa}, "
    _, lines = said(
        tmp_path, mesh, groups="{ground: rock}", gauges=gauges,
        materials=rock(f"E: {{field: {{{field}{{at: [1 m, 1 m], value: 1 GPa}}]}}}}", "nu: 0.25"),
        structures="{w: {kind: beam, on: bottom, EA: 1 GN/m, EI: 10 MNm2/m}}",
        stages="[{name: dig, build: [w], excavate: [ground]}]",
    )  # fmt: skip
    faults = [line for line in lines if line.startswith("case.yaml:")]
    assert [line.split(": ")[1] for line in faults] == [
        "groups", "gauges.far", "materials.rock.E.field.measured[0]"
    ]  # fmt: skip
    assert "(2, -7) m" in faults[1]
    assert faults[2].endswith("the measured point (9, 1) m is not in the mesh squares.msh")


def test_motions_and_loads_that_cannot_be(tmp_path):
    stages = (
        "[{name: one, loads: {p: {on: above ground, pressure: 1 kPa}}},"
        " {name: two, excavate: [top]}]"
    )
    supports = "{left: {x: 1 mm}, bottom: {x: 2 mm, y: fixed}, right: {x: 2 mm}}"
    _, lines = said(tmp_path, supports=supports, stages=stages)
    assert fault(lines, "7:29: supports.bottom") == (
        "'left' and 'bottom' both hold the node at (0, 0) m along x, and give it different motions",
        "Take shared nodes out of one of them, hold one of them not along x, or give both the "
        "same motion.",
    )
    assert fault(lines, "8:34: stages[0].loads.p.on") == (
        "at stage 'one' faces of 'above ground' are not at the surface of the ground: elements "
        "stand on both sides, or on none",
        "let the load begin when the face is open, and 'remove' it before it is gone",
    )


def test_gauges_that_structures_cannot_be_read_by(tmp_path):
    structures = "{w: {kind: beam, on: above ground, EA: 1 GN/m, EI: 10 MNm2/m}}"
    gauges = """{A: {kind: strain, structure: w, point: [2 m, 3 m], fibre: inside, accuracy: $a},
  B: {kind: strain, structure: w, point: [2 m, 2.25 m], fibre: axis, accuracy: $a},
  C: {kind: load-cell, structure: w, point: [2 m, 3 m], quantity: Q, accuracy: 1 kNm/m},
  D: {kind: load-cell, structure: w, point: [2 m, 3 m], quantity: M, accuracy: 1 kN/m}}""".replace(
        "$a", "1 microstrain"
    )
    stages = "[{name: dig, build: [w]}]"
    _, lines = said(tmp_path, structures=structures, gauges=gauges, stages=stages)
    sides = "where there is ground on both sides of it or on none: which side is its inside is not"
    fibre = "gauge 'A' reads a fibre of the structure 'w', whose thickness is not given"
    at = lines.index(f"case.yaml:9:10: gauges.A: {fibre}")
    assert lines[at + 1].strip() == "give 'depth': its distance from the axis of the beam"
    both = f"case.yaml:9:10: gauges.A: gauge 'A' reads the structure 'w' at (2, 3) m, {sides} known"
    at = lines.index(both)
    assert lines[at + 1].strip() == "give 'towards': a point on the inside"
    assert fault(lines, "10:35: gauges.B.point") == (
        "gauge 'B' sits at (2, 2.25) m, which is not on the structure 'w'; its nearest place is "
        "(2, 3) m, 0.75 m away",
        "correct the point or the structure",
    )
    assert fault(lines, "11:70: gauges.C.accuracy") == (
        "gauge 'C' reads the shear force of a beam, per metre: a line load; its accuracy is a "
        "moment per length",
        "write the accuracy as a line load",
    )
    assert fault(lines, "12:70: gauges.D.accuracy") == (
        "gauge 'D' reads the bending moment of a beam, per metre: a moment per length; its "
        "accuracy is a line load",
        "write the accuracy as a moment per length",
    )


def test_a_bolt_between_grounds_that_are_never_there_together(tmp_path):
    """The message named a stage 'all at which it stands'."""
    _, lines = said(
        tmp_path, groups="{ground: rock, top: absent}", gauges="{}",
        supports="{left: x, right: x, bottom: y, crest: y}",
        structures="{b: {kind: bolt, ends: [[[1 m, 3 m], [3 m, 3 m]]], spacing: 1 m, EA: 1 MN}}",
        stages="[{name: one, build: [b]}, {name: two, excavate: [ground], install: {top: rock}}]",
    )  # fmt: skip
    assert fault(lines, "10:38: structures.b.ends[0][0]") == (
        "the end (1, 3) m lies in no ground that is present at all stages at which the structure "
        "'b' stands: one, two",
        "correct the place, or 'dismantle' the structure before its ground is gone",
    )


def test_a_gauge_in_ground_that_is_never_there_and_a_force_on_no_nodes(tmp_path):
    keys = {
        "groups": "{ground: rock, top: absent}",
        "stages": "[{name: dig, change: {ground: rock}}]",
    }
    gauge = "{S: {kind: stress, components: [yy], point: [2 m, 3.5 m], accuracy: 1 kPa}}"
    _, lines = said(tmp_path, gauges=gauge, in_situ=IN_SITU, **keys)
    assert fault(lines, "9:10: gauges.S") == (
        "point (2, 3.5) m of gauge 'S.yy' lies in 'top', which is never there",
        "correct the point",
    )
    nails = "{nails: {on: heads, line_force: [0 N/m, 1 N/m]}}"
    _, lines = said(tmp_path, loads=nails)
    assert fault(lines, "10:17: loads.nails.on") == (
        "the mesh squares.msh has no group 'heads'",
        "its groups of nodes: none",
    )


GROWS = "E: {reference: $E, exponent: 0.5, pressure: $l}, nu: 0.25"
WITH_L = (
    "{E: {start: 2 GPa, bounds: [0.1 GPa, 50 GPa]}, l: {start: %s kPa, bounds: [-9 kPa, 9 kPa]}}"
)


@pytest.mark.parametrize("start", ["-1", "0"])
def test_a_pressure_that_is_not_positive(tmp_path, start):
    """It was said beside a warning of numpy."""
    keys = {"materials": rock(GROWS), "parameters": WITH_L % start, "in_situ": IN_SITU}
    _, lines = said(tmp_path, **keys)
    assert fault(lines, "5:20: materials.rock.E") == (
        "E of rock grows with the in-situ stress, and its 'pressure' and 'least' must be positive "
        "at the start values",
        "Correct the start of the parameter.",
    )


def test_growth_with_a_stress_that_is_not_there(tmp_path):
    materials = rock("E: {reference: $E, exponent: 0.5, pressure: 100 kPa}, nu: 0.25")
    place, words = "5:20: materials.rock.E", "E of rock grows with the in-situ stress, and "
    _, lines = said(tmp_path, materials=materials)
    assert fault(lines, place) == (f"{words}the case has none", "Add 'in_situ'.")
    _, lines = said(
        tmp_path, materials=materials, in_situ=IN_SITU, groups="{ground: rock, top: absent}",
        stages="[{name: fill, install: {top: rock}}]",
    )  # fmt: skip
    assert fault(lines, place) == (
        f"{words}'top' is placed later, with no stress in situ",
        "Give it a material of its own, with a number or growth with depth.",
    )


def test_a_modulus_that_falls_below_zero_with_depth(tmp_path):
    materials = rock("E: {at: $E, gradient: -1 GPa/m, surface: 4 m}, nu: 0.25")
    _, lines = said(tmp_path, materials=materials)
    deepest = 0.5 - 0.5 / sqrt(3)  # y of the lowest point of a 2 x 2 rule
    number = f"{2e9 - 1e9 * (4 - deepest):.4g}"
    assert fault(lines, "5:20: materials.rock.E") == (
        f"E of rock grows with depth: it is {number} Pa at ({deepest:.6f}, {deepest:.6f}) m, where "
        "it must be positive at the start values",
        "Correct the base, the growth, or the surface from which depth is counted.",
    )


@pytest.mark.parametrize(
    ("elasticity", "more", "place", "message", "hint"),
    [
        (
            "K: $E, G: {field: {mean: 1 GPa, sd: 30 %, length: 2 m}}", COULOMB,
            "5:31: materials.rock.G.field",
            "G of 'rock' varies from place to place, but K not, and it yields: its elasticity must "
            "vary as a whole",
            "Give E and nu and let E vary, or leave out 'yield' or what varies.",
        ),
        (
            "E: {field: {mean: $E, sd: 30 %, length: 2 m}}, nu: 0.25",
            "yield: {type: planes, hardening: 1 MPa, "
            "planes: [{normal: [1, 0, 0], distance: 9 MPa}]}",
            "5:24: materials.rock.E.field",
            "'rock' hardens, and E varies from place to place",
            "Leave out the hardening, or let nothing vary: the hardening would have to as well.",
        ),
        (
            "E: {field: {mean: $E, sd: 30 %, length: 2 m, "
            "measured: [{at: [9 m, 1 m], value: 2 GPa}]}}",
            "nu: 0.25", "5:76: materials.rock.E.field.measured[0]",
            "the measured point (9, 1) m is not in the mesh squares.msh",
            "Correct its coordinates, or remove it: it gives no information on 'rock'.",
        ),
    ],
    ids=["moduli", "hardening", "measured"],
)  # fmt: skip
def test_fields_that_cannot_be(tmp_path, elasticity, more, place, message, hint):
    _, lines = said(tmp_path, materials=rock(elasticity, more), in_situ=IN_SITU)
    assert fault(lines, place) == (message, hint)


@pytest.mark.parametrize(
    ("elasticity", "place", "message", "hint"),
    [
        (
            "elastic: anisotropic, c11: $E, c22: 20 GPa, c33: 20 GPa, c44: 8 GPa, c55: 8 GPa, "
            "c66: 8 GPa, c12: 1 GPa, c15: 1 GPa",
            "5:125: materials.rock.c15",
            "c15 of 'rock' couples strains of the section with shear out of it",
            "leave it out",
        ),
        (
            "elastic: transversely-isotropic, E_p: $E, nu_p: 0.2, E_n: 1 GPa, nu_np: 0.2, "
            "G_np: 0.5 GPa, normal: [1, 1, 1]",
            "5:112: materials.rock.normal",
            "the strata or axes of 'rock' are oblique to the section, or may turn so in the fit",
            "give a strike normal or parallel to it",
        ),
    ],
    ids=["coupled", "oblique"],
)
def test_ground_that_moves_out_of_the_section(tmp_path, elasticity, place, message, hint):
    _, lines = said(tmp_path, materials=rock(elasticity))
    assert fault(lines, place) == (
        f"{message}, so the ground would also move out of the plane",
        f"Use analysis: solid, or {hint}.",
    )


def test_a_held_point_that_is_no_node(tmp_path):
    supports = "{left: x, right: x, bottom: [x, y], nail: {at: [2.2 m, 4 m], x: fixed}}"
    _, lines = said(tmp_path, supports=supports)
    assert fault(lines, "7:54: supports.nail.at") == (
        "no node of squares.msh is at (2.2, 4) m",
        "The nearest node is at (2, 4) m; write its coordinates.",
    )


@pytest.mark.parametrize("dip", ["0 deg", "20 deg"])
def test_what_dips_about_an_axis(tmp_path, dip):
    elasticity = (
        "elastic: transversely-isotropic, E_p: $E, nu_p: 0.2, E_n: 1 GPa, nu_np: 0.2, "
        f"G_np: 0.5 GPa, dip: {dip}"
    )
    weak = f"yield: {{type: weak-plane, dip: {dip}, cohesion: 9 MPa, friction: 20 deg}}"
    text, lines = said(tmp_path, materials=rock(elasticity, weak), analysis="axisymmetric")
    all_around = "dip are not the same all around the axis"
    if dip == "0 deg":
        assert all_around not in text
        return
    faults = [n for n, line in enumerate(lines) if all_around in line]
    assert [lines[n].split(": ", 2)[2] for n in faults] == [
        f"strata of 'rock' that {all_around}",
        f"weak planes of 'rock' that {all_around}",
    ]
    assert {lines[n + 1].strip() for n in faults} == {"Use 'dip: 0 deg', or analysis: solid."}


def as_coulomb(mb, s, a, sigci, most):
    """MPa and degrees, of a curve up to sigma3 = most (Hoek et al. 2002, eqs. 12 and 13)."""
    n = most / sigci
    rise = 6 * a * mb * (s + mb * n) ** (a - 1)
    both = (1 + a) * (2 + a)
    phi = rise / (2 * both + rise)
    c = sigci * ((1 + 2 * a) * s + (1 - a) * mb * n) * (s + mb * n) ** (a - 1)
    return c / (both * sqrt(1 + rise / both)), degrees(asin(phi))


def test_what_a_hoek_brown_rock_amounts_to(tmp_path):
    materials = rock(
        "E: $E, nu: 0.25",
        "yield: {type: hoek-brown, sigci: 50 MPa, mi: 10, GSI: 45, dilation: 0 deg}",
    )
    mb, s = 10 * exp(-55 / 28), exp(-55 / 9)
    a = 0.5 + (exp(-3) - exp(-20 / 3)) / 6
    named = f"'rock' has mb {mb:.3g}, s {s:.3g} and a {a:.3g} at the start values"
    text, _ = said(tmp_path, materials=materials)
    assert f"{named}; there is no in-situ stress to fit c and phi to" in text
    # strength of the mass and largest sigma3 around a deep tunnel (eqs. 17 and 18)
    mass = 50 * (mb + 4 * s - a * (mb - 8 * s)) * (mb / 4 + s) ** (a - 1) / (2 * (1 + a) * (2 + a))
    deep = 0.47 * mass * (mass / 10) ** -0.94
    around, there = as_coulomb(mb, s, a, 50, deep), as_coulomb(mb, s, a, 50, 5.0)
    text, _ = said(tmp_path, materials=materials, in_situ=IN_SITU)
    assert (
        f"{named}; as Mohr-Coulomb that is c {around[0]:.3g} MPa and phi {around[1]:.3g} deg up to "
        f"sigma3 = {deep:.3g} MPa around a deep tunnel in the largest in-situ stress of 10 MPa, c "
        f"{there[0]:.3g} MPa and phi {there[1]:.3g} deg up to sigma3 = 5 MPa that there is in situ "
        "(Hoek et al. 2002); what is computed is the curve itself"
    ) in text


ONE = "{E: {start: 2 GPa, bounds: [0.1 GPa, 50 GPa]}}"
TWO_FREE = "{E: {start: 2 GPa, bounds: [0.1 GPa, 50 GPa]}, a: {start: %s}}"
LAYERED = (
    "elastic: transversely-isotropic, E_p: $E, nu_p: 0.2, E_n: 1 GPa, nu_np: 0.2, G_np: 0.5 GPa, "
    "dip: 0 deg"
)


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        (
            {"materials": rock(LAYERED)},
            "E_p of rock enters the stiffness nonlinearly unless E_p, E_n are all tied to one "
            "parameter (Love's A, C, F, L and N enter linearly). Possible are gauss-newton, "
            "simplex, scan, ensemble-smoother.",
        ),
        (
            {
                "materials": rock("E: 2 GPa, nu: $nu"),
                "parameters": "{nu: {start: 0.2, bounds: [0.1, 0.4]}}",
            },
            "nu of rock enters the stiffness nonlinearly (K and G enter linearly). Possible are "
            "gauss-newton, simplex, scan, ensemble-smoother.",
        ),
        (
            {"supports": "{left: {x: 1 mm}, right: x, bottom: y}"},
            "the support 'left' is moved: its motion times a modulus is a load. Possible are "
            "gauss-newton, simplex, scan, ensemble-smoother.",
        ),
        (
            {"fit": "{method: condensation, loss: huber}"},
            "its linear least squares need the squared loss, and the loss is huber. Possible are "
            "gauss-newton, simplex, scan.",
        ),
        (
            {
                "materials": rock("E: $E, nu: 0.2", COULOMB.replace("1 MPa", "9 MPa")),
                "fit": "{method: complementarity, complementarity: {formulation: full-space}}",
            },
            "for the formulation full-space, rock yields by an exact surface, which has no planes "
            "(give 'planes'). Possible are gauss-newton, simplex, scan, ensemble-smoother, "
            "complementarity in its default formulation.",
        ),
        (
            {"fit": "{method: closed-form}", "stages": "[{name: dig, change: {top: rock}}]"},
            "no stage excavates anything. Possible are gauss-newton, condensation, simplex, scan, "
            "ensemble-smoother.",
        ),
        (
            {
                "materials": rock("E: $E, nu: 0.2, expansion: $a"),
                "parameters": TWO_FREE % "1e-5 1/K, bounds: [1e-6 1/K, 1e-4 1/K]",
                "stages": "[{name: dig, excavate: [top], temperature: {ground: 10 K}}]",
            },
            "the thermal stress of rock contains the product of E and a, and both are free. "
            "Possible are gauss-newton, simplex, scan, ensemble-smoother.",
        ),
        (
            {
                "materials": rock("E: 2 GPa, nu: 0.2, density: $r"),
                "parameters": "{r: {start: 2000 kg/m3, bounds: [1000 kg/m3, 3000 kg/m3]}, "
                "a: {start: 0.1, bounds: [0, 1]}}",
                "gravity": "10 m/s2",
                "in_situ": "{model: geostatic, K0: 0.5}",
                "stages": "[{name: dig, excavate: [top], loads: {quake: {seismic: [$a, 0]}}}]",
            },
            "the seismic force 'quake' at stage 'dig' contains the product of r and a, and both "
            "are free. Possible are gauss-newton, simplex, scan, ensemble-smoother.",
        ),
        (
            {"materials": rock("E: {at: $E, gradient: 1 MPa/m, surface: 4 m}, nu: 0.2")},
            "E of rock grows with depth: its equations are not made as sums. Possible are "
            "gauss-newton, simplex, scan, ensemble-smoother.",
        ),
    ],
    ids=[
        "strata",
        "Poisson",
        "moved",
        "loss",
        "formulation",
        "opening",
        "heat",
        "quake",
        "growth",
    ],
)
def test_why_a_method_is_not_possible(tmp_path, keys, why):
    if "complementarity" in why:
        pytest.importorskip("casadi")
    given = {
        "parameters": ONE,
        "in_situ": "{model: heim, vertical: 1 MPa, K0: 0.5}",
        "gauges": "{S: {kind: settlement, point: [2 m, 3 m], accuracy: 0.1 mm}, "
        "T: {kind: settlement, point: [1 m, 3 m], accuracy: 0.1 mm}}",
        "readings": "[{gauge: S, stage: dig, value: 1 mm}, {gauge: T, stage: dig, value: 1 mm}]",
        "fit": "{method: condensation}",
        **keys,
    }
    name = given["fit"].split(": ")[1].split(",")[0].rstrip("}")
    text, _ = said(tmp_path, **given)
    assert text.startswith("case.yaml:")
    assert f": fit.method: The method {name} is not possible here: {why}" in text


@pytest.mark.parametrize(
    ("stage", "said_of_water"),
    [
        ("{name: dig, excavate: [g8]}", True),
        ("{name: dig, excavate: [g8], water: {table: 0.5 m}}", False),
        ("{name: dig, excavate: [g8], loads: {pond: {on: right, water: {level: 2 m}}}}", False),
        ("{name: dig, excavate: [g9]}", False),  # above the water
    ],
)
def test_an_excavation_below_water_that_stays(tmp_path, stage, said_of_water):
    """Two metres of it; none where it is lowered, stands in the pit, or is not reached."""
    text, _ = said(
        tmp_path, grid(8, 3, lambda column, row: f"g{column + 1}" if row < 2 else "g9"),
        groups=COLUMNS[:-1] + ", g9: rock}", gauges=LOW, stages=f"[{stage}]",
        materials=rock("E: $E, nu: 0.25"), in_situ=IN_SITU,
        water="{table: 2 m, unit_weight: 10 kN/m3}",
    )  # fmt: skip
    assert ("'dig' excavates below the water" in text) == said_of_water, text
    assert ("(up to 20 kPa)" in text) == said_of_water
