"""Gauges that are zeroed at a load case on its own: what their readings are made of, or why not.

A confined column under a load q at its top: the point at the height y settles by q y / M, with the
confined modulus M; excavating the uppermost row lifts what is below it.
"""

from __future__ import annotations

import pytest
from support.squares import case_of, grid, said_of

from geoident.workflow.simulate import simulate

M = 1e9 * 0.75 / (1.25 * 0.5)
POINT = "point: [2.3 m, 3.5 m]"
STAGES = (
    "[{name: dig, excavate: [top], independent: true}, "
    "{name: b, loads: {q: {on: crest, pressure: 100 kPa}}}, "
    "{name: c, loads: {q: {on: crest, pressure: 200 kPa}}}]"
)


def column(gauge: str, stages: str = STAGES, **more: str) -> str:
    return case_of(
        parameters="",
        materials="{rock: {E: 1 GPa, nu: 0.25, density: 2000 kg/m3}}",
        gravity="9.81 m/s2",
        in_situ="{model: geostatic, K0: 0.3333333333333333}",
        stages=stages,
        gauges=f"{{S: {{{gauge}}}}}",
        **more,
    )


def readings(folder, text):
    (folder / "squares.msh").write_text(grid())
    (folder / "case.yaml").write_text(text)
    found = simulate(str(folder / "case.yaml")).readings
    return {(r.channel, r.stage): r.value for r in found}


@pytest.mark.parametrize(
    "gauge",
    [
        f"kind: settlement, {POINT}, accuracy: 0.1 mm",
        f"kind: tilt, {POINT}, accuracy: 0.1 mrad",
        f"kind: strain, {POINT}, component: yy, accuracy: 5 microstrain",
        f"kind: stress, {POINT}, components: [yy], accuracy: 5 kPa",
        "kind: extensometer, head: [2.3 m, 0.5 m], anchors: {a: [2.3 m, 3.5 m]}, accuracy: 0.1 mm",
    ],
)
def test_a_zero_where_a_load_case_has_taken_the_ground_away_is_refused(tmp_path, gauge):
    """The difference to the later stages would mix motions of ground and of where it was."""
    text = column(f"{gauge}, zero: dig")
    found = said_of(tmp_path, text)
    line = next(n for n, row in enumerate(text.splitlines(), 1) if row.startswith("gauges"))
    at = f"case.yaml:{line}:{text.splitlines()[line - 1].index('zero: dig') + 1}: gauges.S.zero: "
    assert at in found
    assert "lies in 'top', which is not there at stage 'dig', where the gauge is" in found
    assert "write 'zero: virgin' (it is there at 'b', 'c', too), or correct the point" in found
    assert "placing" not in found


def test_zeros_that_are_proposed_read_the_closed_form(tmp_path):
    gauge = f"kind: settlement, {POINT}, accuracy: 0.1 mm"
    virgin = readings(tmp_path, column(f"{gauge}, zero: virgin"))
    assert virgin["S", "b"] == pytest.approx(1e5 * 3.5 / M, rel=1e-9)
    later = readings(tmp_path, column(f"{gauge}, zero: b"))
    assert later["S", "c"] == pytest.approx(1e5 * 3.5 / M, rel=1e-9)


def test_a_zero_at_a_load_case_that_leaves_the_ground_counts_from_there(tmp_path):
    """Excavation of a row of 1 m lifts the point at 2.5 m; the load then presses it down."""
    gauge = "kind: settlement, point: [2.3 m, 2.5 m], accuracy: 0.1 mm, zero: dig"
    found = readings(tmp_path, column(gauge))
    lift = 2000 * 9.81 * 1.0 * 2.5 / M
    assert found["S", "b"] == pytest.approx(1e5 * 2.5 / M + lift, rel=1e-9)


def test_ground_that_two_branches_place_each_for_itself_is_not_one(tmp_path):
    """What stands at the zero and at the reading was not placed by the same stage."""
    stages = (
        "[{name: alone, install: {top: rock}, independent: true}, "
        "{name: b, install: {top: rock}}, "
        "{name: c, loads: {q: {on: crest, pressure: 100 kPa}}}]"
    )
    gauge = f"kind: settlement, {POINT}, accuracy: 0.1 mm"
    groups = "{ground: rock, top: absent}"
    assert not readings(tmp_path, column(f"{gauge}, zero: alone", stages, groups=groups))
    built = readings(tmp_path, column(f"{gauge}, zero: b", stages, groups=groups))
    assert built["S", "c"] == pytest.approx(1e5 * 3.5 / M, rel=1e-9)


def test_a_strut_that_two_branches_build_each_for_itself_is_not_one(tmp_path):
    stages = (
        "[{name: alone, build: [bar], independent: true}, {name: b, build: [bar]}, "
        "{name: c, loads: {q: {on: crest, pressure: 100 kPa}}}]"
    )
    bar = "{bar: {kind: bolt, ends: [[[2 m, 1 m], [2 m, 3 m]]], EA: 1 MN, spacing: 1 m}}"
    gauge = "kind: load-cell, structure: bar, accuracy: 1 kN"
    assert not readings(tmp_path, column(f"{gauge}, zero: alone", stages, structures=bar))
    since = readings(tmp_path, column(f"{gauge}, zero: b", stages, structures=bar))
    assert list(since) == [("S", "c")]
