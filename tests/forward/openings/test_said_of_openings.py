"""Why an opening has no closed form, and what is said of one that has: the words."""

import pytest
from support.squares import case_of, grid, said_of

COULOMB = "yield: {type: mohr-coulomb, cohesion: 1 MPa, friction: 30 deg}"
OPENING = {
    "mesh": "",
    "supports": "",
    "groups": "{core: rock, ground: rock, side: rock}",
    "in_situ": "{model: heim, vertical: 10 MPa, K0: 0.5}",
    "stages": "[{name: dig, excavate: [core]}]",
    "gauges": "{C: {kind: convergence, between: [[-2 m, 0 m], [2 m, 0 m]], accuracy: 0.1 mm}}",
    "fit": "{closed-form: {centre: [0 m, 0 m], radius: 2 m}}",
}
TWO = "{rock: {E: $E, nu: 0.25}, marl: {E: 1 GPa, nu: 0.25}}"
ALONG_NORMALS = "type: hoek-brown, sigci: 50 MPa, mi: 9, GSI: 45, flow: associated"
LAYERED = (
    "{rock: {elastic: transversely-isotropic, E_p: $E, nu_p: 0.2, E_n: 1 GPa, nu_np: 0.2, "
    "G_np: 0.5 GPa, dip: 0 deg}}"
)
HEAVY = "{rock: {E: $E, nu: 0.25, density: 2600 kg/m3}}"


def ground(limit):
    return "{rock: {E: $E, nu: 0.25, yield: {" + limit + "}}}"


def said(tmp_path, **keys):
    return " ".join(said_of(tmp_path, case_of(**{**OPENING, **keys})).split())


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"stages": "[{name: dig, change: {core: rock}}]"}, "no stage excavates anything"),
        (
            {"stages": "[{name: dig, excavate: [core, ground, side]}]"},
            "every group is excavated, none is left around the opening",
        ),
        (
            {"groups": "{core: rock, ground: rock, side: marl}", "materials": TWO},
            "the ground around the opening is of several materials: 'marl', 'rock'",
        ),
        ({"analysis": "axisymmetric"}, "its formulas are those of plane strain"),
        ({"materials": LAYERED}, "'rock' is not isotropic"),
        (
            {"materials": ground(ALONG_NORMALS)},
            "'rock' flows along the normals of Hoek-Brown; with 'dilation' it has one",
        ),
        (
            {"materials": ground("type: weak-plane, dip: 0 deg, cohesion: 1 MPa, friction: 9 deg")},
            "'rock' has other yield limits than one of Mohr-Coulomb or Hoek-Brown",
        ),
        (
            {
                "in_situ": "{model: heim, vertical: 10 MPa, K0: 0.5, "
                "groups: {core: {model: heim, vertical: 9 MPa, K0: 0.5}}}"
            },
            "groups have in-situ stresses of their own",
        ),
        (
            {"in_situ": "{model: heim, unit_weight: 26 kN/m3, surface: hill, K0: 0.5}"},
            "the depth is counted from a group of faces, which needs a mesh",
        ),
        (
            {
                "in_situ": "{model: geostatic, K0: 0.5}",
                "materials": HEAVY,
                "gravity": "9.81 m/s2",
            },
            "the geostatic stress is the weight of the layers of a mesh",
        ),
    ],
)  # fmt: skip
def test_no_closed_form(tmp_path, keys, why):
    expected = f"fit.closed-form: there is no closed form of this case: {why}"
    found = said(tmp_path, **keys)
    assert found.endswith(expected)
    assert found.startswith("case.yaml:")


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        (
            {
                "stages": "[{name: early, loads: {p: {on: wall, pressure: 1 MPa}}}, "
                "{name: dig, excavate: [core]}]"
            },
            "the load 'p' acts before the opening is excavated",
        ),
        (
            {
                "stages": "[{name: dig, excavate: [core], change: {ground: marl}}]",
                "materials": TWO,
            },
            "stage 'dig' changes 'ground', which is not part of the opening",
        ),
    ],
)
def test_stages_without_a_closed_form(tmp_path, keys, why):
    """All reasons: `test_obstacles.py`."""
    said_of_gauge = f"no readable stage after the zero: C, as {why}"
    assert f"{said_of_gauge} - closed form of a circular opening of radius 2 m" in said(
        tmp_path, **keys
    )


def test_what_a_closed_form_takes_otherwise(tmp_path):
    # 10 and 5 MPa are 2.5 off their mean of 7.5 MPa
    off = "the in-situ stress around the opening is up to 33 % off its mean at the centre"
    limit = "type: mohr-coulomb, cohesion: 6 MPa, friction: 30 deg"
    smooth = "the closed form takes the exact surface for the polyhedron"
    found = said(tmp_path, materials=ground(f"{limit}, planes: 16"))
    assert (
        f"{off}; the closed form takes that part as if the ground were elastic - {smooth}" in found
    )
    assert smooth not in said(tmp_path, materials=ground(limit))


def tunnel(column, row):
    """A square tunnel of 2 m in 8 by 8 m, and what is above its middle."""
    return "core" if 3 <= column <= 4 and 3 <= row <= 4 else "roof" if row >= 4 else "ground"


TUNNEL = {
    "groups": "{core: rock, ground: rock, roof: rock}",
    "in_situ": OPENING["in_situ"],
    "gauges": "{S: {kind: settlement, point: [1 m, 1 m], accuracy: 0.1 mm}}",
    "stages": "[{name: near, distance: 1 m, excavate: [core]}, {name: far, distance: 20 m}]",
}


def said_of_face(tmp_path, **keys):
    found = said_of(tmp_path, case_of(**{**TUNNEL, **keys}), grid(8, 8, tunnel))
    return " ".join(found.split())


YIELDING = "{rock: {E: $E, nu: 0.25, " + COULOMB + "}}"
CURVE = (
    "the part of the final motion becomes a part of the stress on the reaction curve of a circular "
    "opening without support, in the mean in-situ stress. This tunnel is not round and lies in "
    "uneven stress (5 and 10 MPa at the start values), so that the mean motion of its wall is "
    "another part of the final one (theory 2.9): 'conversion: mesh' takes that of the mesh"
)
WALL = (
    "the part of the stress is that at which the mean motion of the tunnel's wall in the mesh, "
    "without support, is the part of its final motion"
)
SAME = "the part of the stress is that of the final motion (exact in elastic ground)"


@pytest.mark.parametrize(
    ("profile", "materials", "name", "way"),
    [
        ("panet", "", "Panet's profile", SAME),
        ("chern, conversion: direct", YIELDING, "Chern's profile", SAME),
        ("chern, conversion: mesh", YIELDING, "Chern's profile", WALL),
        (
            "vlachopoulos-diederichs", YIELDING,
            "the profile of Vlachopoulos and Diederichs", CURVE,
        ),
    ],
)  # fmt: skip
def test_how_distances_release_stress(tmp_path, profile, materials, name, way):
    more = {"materials": materials} if materials else {}
    found = said_of_face(tmp_path, face=f"{{profile: {profile}, radius: 1 m}}", **more)
    assert f"distances to the face release stress by {name}; {way}" in found


@pytest.mark.parametrize(
    ("profile", "what", "hint"),
    [
        (
            "panet, radius: 1 m", "how distances to the face become released stress",
            "Write 'conversion: mesh' in 'face', or 'conversion: direct' in 'face', with the "
            "plastic radius where the profile needs it, or give the parts by 'release', stage by "
            "stage.",
        ),
        (
            "vlachopoulos-diederichs, radius: 1 m, conversion: mesh",
            "the plastic radius, on which the profile depends,",
            "Give 'plastic_radius', of the tunnel without support, far from its face.",
        ),
    ],
)  # fmt: skip
def test_no_reaction_in_closed_form(tmp_path, profile, what, hint):
    limit = "nu: 0.25, " + COULOMB
    found = said_of_face(
        tmp_path, face=f"{{profile: {profile}}}", groups="{core: rock, ground: rock, roof: marl}",
        materials=f"{{rock: {{E: $E, {limit}}}, marl: {{E: 1 GPa, {limit}}}}}",
    )  # fmt: skip
    assert found == (
        f"case.yaml:11:1: face: {what} cannot be computed by a closed form: the ground at the wall "
        f"is of several materials, 'marl', 'rock' {hint}"
    )


def test_a_tunnel_without_a_wall(tmp_path):
    stages = "[{name: near, distance: 1 m, excavate: [core], install: {ground: rock, roof: rock}}]"
    found = said_of_face(
        tmp_path, face="{profile: chern, radius: 1 m, conversion: mesh}", stages=stages,
        groups="{core: rock, ground: absent, roof: absent}", gauges="{}",
    )  # fmt: skip
    assert (
        "face.conversion: no ground is beside 'core', so there is no wall whose motion could be "
        "computed Name the element groups of the tunnel by 'groups' of 'face'."
    ) in found
