"""What a case says of ground, construction and structures, with what was identified."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.report.text.inputs.construction import construction_table
from geoident.report.text.inputs.materials import ground_sentences, materials_table
from geoident.report.text.inputs.numbers import ShownNumbers, ranged
from geoident.report.text.inputs.structures import (
    interfaces_table,
    structures_table,
    supports_table,
)
from tests.support.results import example_result

CASE = {
    "analysis": "plane-strain",
    "parameters": {"E_rock": {"start": "20 GPa"}, "sigma_v": {"start": "8 MPa"}},
    "materials": {
        "clay": {"density": "1900 kg/m3", "elastic": "isotropic", "E": "0.5 $E_rock",
                 "yield": {"type": "mohr-coulomb", "cohesion": "$sigma_v", "friction": "28 deg"}},
        "fill": {"elastic": "isotropic", "E": {"mean": "3 GPa", "sd": "20 %"}},
    },
    "groups": {"clay": "clay", "dig-1": "clay", "dig-2": "clay", "dig-3": "clay", "heap": "absent"},
    "supports": {"bottom": "fixed", "side": ["x"]},
    "in_situ": {"model": "geostatic", "K0": {"clay": "0.5", "dig-1": "0.5", "heap": "0.7"}},
    "gravity": "9.81 m/s2",
    "loads": {"house": {"on": "ground", "pressure": "120 kPa"}},
    "dates": {"dig": "2025-03-14"},
    "structures": {
        "wall": {"kind": "beam", "on": "line", "EA": "4.5 GN/m", "EI": "188 MNm2/m"},
        "struts": {"kind": "strut", "ends": [[["10 m", "-2 m"], ["0 m", "-2 m"]]], "E": "210 GPa",
                   "area": "262 cm2", "spacing": "3 m", "prestress": "250 kN",
                   "second_end": "symmetry"},
    },
    "stages": [
        {"name": "dig", "excavate": ["dig-1", "dig-2", "dig-3"], "release": {"dig-1": "0.6"},
         "build": ["wall"]},
        {"name": "heap", "install": {"heap": "fill"}, "dismantle": ["wall"], "build": ["struts"],
         "remove": ["house"], "prestress": {"struts": "350 kN"}, "water": {"table": "-2 m"}},
    ],
}  # fmt: skip
BEFORE = ShownNumbers(CASE["parameters"])


@pytest.fixture
def after():
    """12.34 GPa between 11.6 and 13.1 for E_rock; sigma_v as its prior."""
    return ShownNumbers(CASE["parameters"], example_result().parameters)


def test_materials_have_law_constants_and_groups_of_all_stages():
    clay, fill = materials_table(CASE, BEFORE).rows
    assert clay == [
        "clay",
        "isotropic elastic, Mohr-Coulomb",
        "E = 0.5 E_rock (start 20 GPa); density = 1900 kg/m3; "
        "cohesion = sigma_v (start 8 MPa); friction = 28 deg",
        "clay, dig-1 to 3",
    ]
    assert fill == ["fill", "isotropic elastic", "E = mean 3 GPa, sd 20 %", "heap"]


def test_identified_constants_have_their_values_and_intervals(after):
    constants = materials_table(CASE, after).rows[0][2]
    assert "E = 6.17 GPa (5.80 to 6.55)" in constants  # half of what was identified
    assert "cohesion = sigma_v (as its prior)" in constants


def test_a_value_that_nothing_determines_is_no_number(after):
    table = replace(
        after.identified,
        determined=np.zeros(3, dtype=bool),
        priors=(None,) * len(after.identified.names),
    )
    assert ShownNumbers({}, table).text("$E_rock") == "E_rock (not determined)"


def test_construction_says_all_that_happens_and_leaves_out_what_never_does():
    table = construction_table(CASE, BEFORE)
    assert table.header == ["no.", "stage", "date", "excavated", "placed", "released so far",
                            "built", "removed", "loads", "stressed", "water"]  # fmt: skip
    start, dig, heap = (dict(zip(table.header, row, strict=True)) for row in table.rows)
    assert start["loads"] == "house: pressure 120 kPa on ground"
    assert (dig["no."], dig["date"], dig["excavated"]) == ("1", "2025-03-14", "dig-1 to 3")
    assert (dig["released so far"], dig["built"]) == ("60 % of dig-1", "wall")
    assert (heap["placed"], heap["removed"]) == ("heap of fill", "wall, house")
    assert (heap["stressed"], heap["water"]) == ("struts 350 kN", "table -2 m")


def test_structures_have_section_stiffness_and_their_time():
    wall, struts = structures_table(CASE, BEFORE).rows
    assert wall == ["wall", "wall or lining", "on line", "EA = 4.5 GN/m; EI = 188 MNm2/m", "",
                    "from dig, until heap"]  # fmt: skip
    assert struts[2:] == [
        "(10 m, -2 m) to (0 m, -2 m)",
        "E = 210 GPa; area = 262 cm2",
        "spacing 3 m; prestress 250 kN; second end symmetry",
        "from heap",
    ]


def test_interfaces_have_their_faces_stiffness_and_limits():
    """At the start c 5 kPa times 0.6 and atan(0.6 tan 25 deg), where the table is told so."""
    springs = {"k_n": "100 MPa/m", "k_s": "10 MPa/m", "permeable": "true"}
    joined = {"along": "line in clay", **springs, "R_inter": "0.6", "of": "clay",
              "dilation": "3 deg", "permeable": "false"}  # fmt: skip
    case = {**CASE, "interfaces": {"skin": joined, "joint": {"along": "lift", **springs}}}
    limits = "R_inter = 0.6 of clay; dilation = 3 deg"
    stiffness = "k_n = 100 MPa/m; k_s = 10 MPa/m"
    skin, joint = interfaces_table(case, BEFORE).rows
    assert skin == ["skin", "line in clay, on both sides of wall", stiffness, limits]
    assert joint == ["joint", "lift", stiffness, "none, elastic"]
    flowing = {**case, "materials": {"clay": {"hydraulic": {"permeability": "1e-9 m/s"}}}}
    at_start = {"skin": (3e3, np.arctan(0.6 * np.tan(np.radians(25.0))))}
    skin, joint = interfaces_table(flowing, BEFORE, at_start).rows
    assert skin[3] == (
        "R_inter = 0.6 of clay: cohesion 3 kPa, friction 15.6 deg at the start; dilation = 3 deg; "
        "holds water back"
    )
    assert joint[3] == "none, elastic"


def test_supports_are_held_along_the_axes_that_there_are():
    said = supports_table(CASE, ShownNumbers({})).rows
    assert said == [["bottom", "", "held along x, y"], ["side", "", "held along x"]]
    solid = supports_table({**CASE, "analysis": "solid"}, ShownNumbers({})).rows
    assert solid[0] == ["bottom", "", "held along x, y, z"]


def test_supports_that_move_say_by_how_much_and_from_when():
    """Each row is a sentence: before, a stage stood between "held along" and the motion."""
    moving = {
        "parameters": {"V": {"start": "1.2 %"}},
        "supports": {"wall": {"contraction": "$V"}, "probe": {"at": ["3 m", "4 m"], "y": "1 mm"}},
        "stages": [
            {"name": "push", "supports": {"wall": "free", "side": {"x": "2 mm", "y": "fixed"}}},
            {"name": "on", "supports": {"top": {"measured": {"file": "m.csv", "factor": "2"}}}},
        ],
    }
    numbers = ShownNumbers(moving["parameters"])
    assert supports_table(moving, numbers).rows == [
        ["wall", "", "contracted by V (start 1.2 %) of the area within"],
        ["probe", "", "moved by 1 mm along y, at (3 m, 4 m)"],
        ["wall", "push", "let go"],
        ["side", "push", "moved by 2 mm along x, held along y"],
        ["top", "on", "moved as measured (m.csv) times 2"],
    ]
    table = construction_table(moving, numbers)
    column = [row[table.header.index("supports")] for row in table.rows]
    assert column == [
        "", "wall let go; side moved by 2 mm along x, held along y",
        "top moved as measured (m.csv) times 2",
    ]  # fmt: skip


def test_stress_and_gravity_are_said_by_groups_of_one_number():
    assert ground_sentences(CASE, BEFORE) == (
        "In-situ stress: geostatic, K0 = 0.5 in clay, dig-1; 0.7 in heap.",
        "Gravity: 9.81 m/s2.",
    )


def test_only_names_that_count_on_are_drawn_together():
    assert ranged(["a1", "a2", "a3", "a5", "b", "c-9", "c-10"]) == "a1 to 3, a5, b, c-9, c-10"


def test_an_unreadable_case_says_nothing():
    assert not materials_table({}, BEFORE).rows
    assert len(construction_table({"stages": ["x", None]}, BEFORE).rows) == 1
    assert ground_sentences({"in_situ": "x"}, BEFORE) == ()
