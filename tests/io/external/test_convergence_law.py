"""The key ``model`` with a convergence law: what is refused, where it stands, what to do."""

import pytest
from support.convergence import CASE, write_law

from geoident.errors import InputError
from geoident.io.case.file import parse_case, read_case


def faults_of(folder, *changes):
    text = CASE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(InputError) as caught:
        read_case(str(write_law(folder, text)))
    lines = text.splitlines()
    return [
        (fault.path, fault.message, fault.hint, lines[fault.location.line - 1])
        for fault in caught.value.faults
    ]


def test_stages_are_those_of_the_face_and_what_is_resolved_is_the_same_law(tmp_path):
    path = write_law(tmp_path)
    loaded = read_case(str(path))
    assert loaded.case.stage_names[1:3] == ("first", "second")
    again = parse_case(loaded.resolved, str(path))
    assert again.case.elsewhere == loaded.case.elsewhere
    assert again.resolved == loaded.resolved


@pytest.mark.parametrize(
    ("old", "new", "path", "message", "hint"),
    [
        ("X: {start: 9 m, bounds: [1 m, 60 m], scale: log}", "X: {start: 9 m, bounds: [0 m, 60 m]}",
         "parameters.X.bounds[0]", "the bound 0 m lets X", "must be positive"),
        ("T: {start: 3 days, bounds: [0.1 days, 100 days], scale: log}",
         "T: {start: 3 days, bounds: [-1 days, 100 days]}",
         "parameters.T.bounds[0]", "the bound -1 days lets T", "must be positive"),
        ("m: {start: 1.6, bounds: [0, 10]}", "m: {start: 1.6, bounds: [-1, 10]}",
         "parameters.m.bounds[0]", "lets m of the convergence law be negative", "0 or more"),
        ("X: $X", "X: -1 $X", "model.X", "X must be positive", "Correct"),
        ("X: {start: 9 m, bounds: [1 m, 60 m]", "X: {start: 9 days, bounds: [1 days, 60 days]",
         "model.X", "'$X' is a time", "Change the unit"),
        ("T: $T", "T: 3", "model.T", "'3' has no unit", ""),
        ("C_inf: {H: $C, V: 0.5 $C}", "C_inf: $m", "model.C_inf", "'H' reads a length", "unit"),
        ("C_inf: {H: $C, V: 0.5 $C}", "C_inf: {H: $C}", "model.C_inf", "no C_inf for 'V'",
         "Add it"),
        ("chainage: 100 m", "chainage: 105 m", "gauges.H.zero", "would be negative", "Correct the"),
        ("fourth: 127 m", "fourth: 107 m", "model.face.fourth", "behind that at 'third'",
         "stops"),
        ("first: 2024-03-01, ", "", "dates", "'first' has no date", "Add dates: {first:"),
        ("excavated: 2024-03-01", "excavated: 2024-03-02", "model.sections.A.excavated",
         "excavated after 'first'", "Correct this date"),
        (", excavated: 2024-03-01", "", "model.sections.A", "not known when 'A' was excavated",
         "Add excavated"),
        (", zero: first}\n  V", "}\n  V", "gauges.H", "since its first reading",
         "Add 'zero: STAGE'"),
        ("n: $n", "n: 0.5", "parameters.n", "nothing depends on it", "Write $n"),
        ("  T: $T\n  n: $n\n", "  n: $n\n", "model", "m, T and n, or none", "Give all three"),
        ("excavated: 2024-03-01", "gauges: [H]", "gauges.V", "belongs to no section", "Add it"),
        ("excavated: 2024-03-01", "gauges: [H, V, W]", "model.sections.A.gauges[2]", "'W'", ""),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place_and_a_remedy(tmp_path, old, new, path, message, hint):
    found = faults_of(tmp_path, (old, new))
    assert any(
        fault[0] == path and message in fault[1] and hint in (fault[2] or "") for fault in found
    ), found


def test_a_stage_without_place_of_the_face_is_named(tmp_path):
    stages = "stages: [{name: first}, {name: second}, {name: pause}]\nparameters:"
    found = faults_of(tmp_path, ("parameters:", stages))
    assert any("no place of the face at 'pause'" in message for _, message, *_ in found), found


def test_a_section_of_two_names_its_gauges(tmp_path):
    [found] = faults_of(
        tmp_path,
        ("  C_inf:", "    B: {chainage: 90 m, excavated: 2024-02-27, gauges: [V]}\n  C_inf:"),
    )
    assert found[0] == "model.sections.A"
    assert "gauges of 'A' are not named" in found[1]
