"""What ``check`` says a case amounts to, number by number."""

from dataclasses import replace

import pytest

from geoident.model.results.summary import (
    CaseSummary,
    CostEstimate,
    GaugeSummary,
    GroupSummary,
    PlaceSummary,
    ReadingSummary,
    StageSummary,
)
from geoident.report.text.case import case_text

COST = CostEstimate("cholmod", 2_320_000, 4.87e9, 312e6, 1.24)


def summary(**changes):
    given = {
        "case": "case.yaml",
        "title": "Cavern",
        "analysis": "plane-strain",
        "mesh": "cavern.msh",
        "nodes": 5531,
        "elements": 10856,
        "groups": (
            GroupSummary("rock", "rock", 9000, 12345.6),
            GroupSummary("fill", None, 9, 0.5),
        ),
        "stages": (
            StageSummary("heading", ("top",), (("lining", "concrete"),), (("rock", "weak"),),
                         ("lake",), ("jack",), 11062, 4, warmed=("dam",), water=True),
            StageSummary("bench", (), (), (), (), (), 10900, 13, base="heading", built=("wall",),
                         dismantled=("shell",), stressed=("anchors",), supported=("side",),
                         freed=("foot", "top")),
        ),
        "gauges": (
            GaugeSummary("EX.a2", "extensometer", "drift", 1.5e-4, 3, 2),
            GaugeSummary("EX.a5", "extensometer", "", 1.5e-4, 3, 2),
        ),
        "places": (
            PlaceSummary(("EX.a2", "EX.a5", "CV"), (12.5, -32.123456), 77, "rock", 1.236),
            PlaceSummary(("ST",), (0.0, 1.0), 78, "rock", None),
        ),
        "readings": (
            ReadingSummary("bench", ("EX.a2", "EX.a5"), (("flagged as bad: hit", ("CV",)),)),
            ReadingSummary("end", (), ()),
        ),
        "parameters": ("E_rock", "K0"),
        "methods": ("condensation", "gauss-newton"),
        "evaluations": "A fit by gauss-newton takes 5 to 10 evaluations.",
        "used": 33,
        "unused": (("the stage is not in fit.stages", 81),),
        "cost": COST,
        "notes": ("there is water in the pores",),
    }  # fmt: skip
    return CaseSummary(**{**given, **changes})


@pytest.fixture(scope="module")
def words():
    """The text as lists of words, one a line."""
    return [line.split() for line in case_text(summary()).splitlines()]


def test_the_head_has_mesh_parameters_and_methods():
    lines = case_text(summary()).splitlines()
    assert lines[:3] == [
        "case.yaml: Cavern",
        "plane-strain, 5531 nodes, 10856 elements (cavern.msh)",
        "parameters E_rock, K0; method condensation + gauss-newton",
    ]
    bare = case_text(summary(title="", mesh="", parameters=())).splitlines()
    assert bare[:2] == ["case.yaml", "plane-strain, no mesh: closed form of a circular opening"]
    assert bare[2].startswith("parameters none;")


@pytest.mark.parametrize(
    ("analysis", "unit"),
    [("plane-strain", ["m2"]), ("axisymmetric", ["m3", "(whole", "turn)"]), ("solid", ["m3"])],
)
def test_groups_have_their_size_and_first_material(analysis, unit):
    lines = [line.split() for line in case_text(summary(analysis=analysis)).splitlines()]
    assert ["name", "elements", *unit, "material", "at", "the", "start"] in lines
    assert ["rock", "9000", "12346", "rock"] in lines
    assert ["fill", "9", "0.5", "absent"] in lines


def test_stages_have_unknowns_readings_and_all_that_happens(words):
    (heading,) = [" ".join(line) for line in words if line[:1] == ["heading"]]
    assert heading == (
        "heading 11062 4 -top, +lining: concrete, rock becomes weak, load lake, end of load jack, "
        "temperature of dam, water in the pores"
    )
    assert ["name", "unknowns", "readings", "what", "happens"] in words
    events = "builds on heading, builds wall, dismantles shell, stresses anchors, "
    events += "support side, lets go of foot, lets go of top"
    assert ["bench", "10900", "13", *events.split()] in words


def test_gauges_have_their_accuracy_in_mm_and_their_readings(words):
    assert ["name", "kind", "zero", "accuracy", "mm", "used", "not", "used"] in words
    assert ["EX.a2", "extensometer", "drift", "0.15", "3", "2"] in words
    assert ["EX.a5", "extensometer", "-", "0.15", "3", "2"] in words


def test_points_of_gauges_have_coordinates_element_and_distance(words):
    assert ["EX.a2,a5", "CV", "12.5,", "-32.1235", "77", "rock", "1.24"] in words
    assert ["ST", "0,", "1", "78", "rock", "-"] in words


def test_readings_are_counted_and_those_left_out_have_their_reason(words):
    text = [" ".join(line) for line in words]
    assert "Readings: 33 used" in text
    assert "81 not used: the stage is not in fit.stages" in text
    assert "- bench: EX.a2,a5 used" in text
    assert "not used: CV: flagged as bad: hit" in text
    assert "- end: none used" in text


def test_the_cost_is_in_words_and_units():
    text = " ".join(case_text(summary()).split())
    assert "has 2.32 million entries; all stages take 4870 million operations (counted)." in text
    assert "About 310 MB of memory and 1.2 s for one evaluation by cholmod" in text
    assert "(estimated). A fit by gauss-newton takes 5 to 10 evaluations." in text
    yielding = CostEstimate("splu", 574, 999_999, 1e6, 30.0, 15, yielding=("ground",))
    text = " ".join(case_text(summary(cost=yielding)).split())
    assert "574 entries; all stages take 1000000 operations" in text
    assert "ground yields, so 15 Newton steps per stage are assumed" in text
    both = replace(yielding, yielding=("structures", "interfaces"))
    text = " ".join(case_text(summary(cost=both)).split())
    assert "(estimated); structures yield and interfaces slip, so 15 Newton steps" in text
    lasting = CostEstimate("pardiso", 574, 999_999, 1e6, 30.0, time_steps=44)
    text = " ".join(case_text(summary(cost=lasting)).split())
    assert "(estimated); stages that last take 44 steps in time." in text
    assert "Computation" not in case_text(summary(cost=None))


def test_notes_come_last():
    assert case_text(summary()).endswith("Notes\n- there is water in the pores")
