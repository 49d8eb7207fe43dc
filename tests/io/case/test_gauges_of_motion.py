"""Instruments of several points: the channels that they become, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from geoident.errors import InputError

PLANE = (
    "  CV1: {kind: convergence, between: [[-1, 0 m], [1, 0 m]], accuracy: 0.2 mm, zero: heading}"
)

SOLID = """\
format: geoident-case/1
title: Drive
analysis: solid
mesh: {file: cavern.msh}
parameters: {E_rock: {start: 15 GPa, bounds: [2 GPa, 80 GPa]}}
materials: {rock: {E: $E_rock, nu: 0.25}}
groups: {rock: rock, heading: rock}
supports: {bottom: [x, y, z]}
in_situ: {model: heim, vertical: 8 MPa, K0: 1}
stages: [{name: dig, excavate: [heading]}]
gauges:
  G: GAUGE
fit: {method: gauss-newton}
"""


def plane(changed, gauge):
    """The sound case with a gauge G in place of the convergence, and no readings of that."""
    return changed(PLANE, f"  G: {gauge}").replace("readings: readings.csv\n", "")


def channels(project, text):
    """Name to channel of gauge G."""
    return {c.name: c for c in project.read(text).case.channels if c.gauge == "G"}


def motion(channel, displacement):
    """What a channel reads of a displacement field."""
    return sum(np.dot(vector, displacement(np.array(point))) for point, vector in channel.motions)


def test_inclinometer_reads_across_its_casing_against_the_bottom(project, changed):
    gauge = (
        "{kind: inclinometer, casing: [[12, 0 m], [12, -20 m]], depths: [0, 5, 10 m],"
        " accuracy: 0.2 mm}"
    )
    found = channels(project, plane(changed, gauge))
    assert list(found) == ["G.A0", "G.A5", "G.A10"]
    five = found["G.A5"]
    assert (five.first, five.second, five.direction) == ((12, -20), (12, -5), (1, 0))
    assert (five.run, five.along) == ("G.A", 15.0)


def test_an_interval_ends_before_the_reference_end(project, changed):
    def depths(reference):
        gauge = (
            "{kind: inclinometer, casing: [[0, 0 m], [0, -2 m]], interval: 0.5 m,"
            f" relative_to: {reference}, accuracy: 0.2 mm}}"
        )
        return list(channels(project, plane(changed, gauge)))

    assert depths("bottom") == ["G.A0", "G.A0.5", "G.A1", "G.A1.5"]
    assert depths("top") == ["G.A0.5", "G.A1", "G.A1.5", "G.A2"]


def test_increments_add_up_to_what_is_cumulated(project, changed):
    """On a casing that bends, in any displacement field."""
    text = (
        "{{kind: inclinometer, casing: [[0, 0 m], [1, -4 m], [4, -8 m]], depths: [0, 2.5, 4.5, 7"
        " m], reading: {}, relative_to: {}, accuracy: 0.2 mm}}"
    )

    def field(x):
        return np.array([np.sin(0.3 * x[0] + 0.2 * x[1]), np.cos(x[0] - 0.4 * x[1])])

    whole = channels(project, plane(changed, text.format("cumulated", "bottom")))
    steps = channels(project, plane(changed, text.format("incremental", "bottom")))
    sums = np.cumsum([motion(channel, field) for channel in reversed(steps.values())])[::-1]
    np.testing.assert_allclose([motion(c, field) for c in whole.values()], sums, rtol=1e-12)
    assert np.abs(sums).max() > 0.1


def test_a_bent_casing_adds_up_each_piece_in_its_own_direction(project, changed):
    """Down 3 m and then to the right at 45 degrees: the lower piece reads across itself."""
    gauge = (
        "{kind: inclinometer, casing: [[0, 0 m], [0, -3 m], [4, -7 m]], depths: [1 m],"
        " accuracy: 0.2 mm}"
    )
    (channel,) = channels(project, plane(changed, gauge)).values()
    low = motion(channel, lambda x: np.array([1.0, 2.0]) if x[1] < -6.9 else np.zeros(2))
    knee = motion(channel, lambda x: np.array([1.0, 2.0]) if abs(x[1] + 3) < 0.1 else np.zeros(2))
    top = motion(channel, lambda x: np.array([1.0, 2.0]) if x[1] > -1.1 else np.zeros(2))
    across = (1.0 + 2.0) / math.sqrt(2.0)  # (1, 1)/sqrt(2), nearest to x
    assert [low, knee, top] == pytest.approx([-across, across - 1.0, 1.0])


def test_axes_of_an_inclined_casing_in_space(project):
    """A is the part of its horizontal direction across the casing, B a quarter turn clockwise."""
    gauge = (
        "{kind: inclinometer, casing: [[0, 0, 0 m], [0, 6, -8 m]], depths: [2 m], axes: [A, B],"
        " A: [0, 1, 0], rings: [5 m], ring_accuracy: 1 mm, accuracy: 0.2 mm}"
    )
    found = channels(project, SOLID.replace("GAUGE", gauge))
    assert list(found) == ["G.A2", "G.B2", "G.S5"]
    assert found["G.A2"].direction == pytest.approx((0, 0.8, 0.6))
    assert found["G.B2"].direction == pytest.approx((1, 0, 0))
    assert found["G.S5"].direction == pytest.approx((0, 0.6, -0.8))
    assert found["G.S5"].second == pytest.approx((0, 3, -4))


def test_target_across_and_up_in_a_plane(project, changed):
    found = channels(project, plane(changed, "{kind: target, point: [3, 4 m], accuracy: 1 mm}"))
    assert {name: c.direction for name, c in found.items()} == {
        "G.across": (1.0, 0.0),
        "G.up": (0.0, 1.0),
    }


def test_target_in_the_axes_of_a_tunnel(project):
    """Driven to the south-east: across points to the south-west."""
    gauge = "{kind: target, point: [3, 4, 5 m], along: [1, -1, 0.5], accuracy: 1 mm}"
    found = channels(project, SOLID.replace("GAUGE", gauge))
    s = math.sqrt(0.5)
    assert found["G.along"].direction == pytest.approx((s, -s, 0))
    assert found["G.across"].direction == pytest.approx((-s, -s, 0))
    assert found["G.up"].direction == pytest.approx((0, 0, 1))


def test_target_by_chainage(project):
    """4 m in plan beyond the corner of an axis that climbs 1 in 10, 2 m right and 3 m above it."""
    gauge = (
        "{kind: target, chainage: 114 m, start_chainage: 100 m, beside: [2, 3 m],"
        " alignment: [[0, 0, 0 m], [10, 0, 1 m], [10, 20, 3 m]], components: [across],"
        " accuracy: 1 mm}"
    )
    (channel,) = channels(project, SOLID.replace("GAUGE", gauge)).values()
    assert channel.second == pytest.approx((12, 4, 4.4))
    assert channel.direction == pytest.approx((1, 0, 0))


def test_tilt_of_a_rigid_body(project):
    """A pair of points in any position reads the rotation itself, and a point does."""
    spin = np.array([0.3, -0.2, 0.5])  # rad, so small that only the sign of 1e-0 is dropped

    def field(x):
        return np.cross(spin, x) + np.array([1.0, 2.0, 3.0])

    # the top leans towards (3, 4, 0)/5 by a turn about up x towards = (-4, 3, 0)/5
    expected = (-4 * spin[0] + 3 * spin[1]) / 5
    for pair in ("[[0, 0, 0 m], [0, 0, 2 m]]", "[[0, 0, 0 m], [3, 4, 0 m]]"):
        gauge = f"{{kind: tilt, between: {pair}, towards: [3, 4, 7], accuracy: 0.1 mrad}}"
        (channel,) = channels(project, SOLID.replace("GAUGE", gauge)).values()
        assert motion(channel, field) == pytest.approx(expected)
        assert (channel.dimension, channel.unit) == ("angle", "mrad")


def test_levelling_and_distortion(project, changed):
    gauge = (
        "{kind: levelling, points: {P1: [0, 0 m], P2: [4, 0 m], P3: [9, 1 m]}, relative_to: P1,"
        " accuracy: 0.3 mm, zero: heading, distortions: {pairs: [[P2, P3]], accuracy: 0.1 mm/m}}"
    )
    found = channels(project, plane(changed, gauge))
    assert list(found) == ["G.P2", "G.P3", "G.P2-P3"]
    settled = {0.0: 1.0, 4.0: 3.0, 9.0: 13.0}

    def field(x):
        return np.array([7.0, -settled[x[0]]])

    assert [motion(c, field) for c in found.values()] == pytest.approx([2.0, 12.0, 10.0 / 5.0])
    pair = found["G.P2-P3"]
    assert (pair.dimension, pair.accuracy, pair.zero) == ("angle", 1e-4, "heading")


@pytest.mark.parametrize(
    ("layout", "text"),
    [
        ("long", "gauge,stage,value,unit\nG.P2-P3,bench 1,0.44,mm/m\n"),
        ("wide", "stage,G.P2-P3\n,mm/m\nbench 1,0.44\n"),
    ],
)
def test_a_distortion_is_read_as_an_angle_with_its_own_accuracy(project, changed, layout, text):
    gauge = (
        "  G: {kind: levelling, points: {P2: [4, 0 m], P3: [9, 1 m]}, accuracy: 0.3 mm,"
        " zero: heading, distortions: {pairs: [[P2, P3]], accuracy: 0.1 mm/m}}"
    )
    Path(project.file).with_name("tilt.csv").write_text(text)
    keys = "layout: wide, unit_row: true" if layout == "wide" else "layout: long"
    found = changed(PLANE, gauge).replace(
        "readings: readings.csv", f"readings: {{file: tilt.csv, {keys}}}"
    )
    case = project.read(found).case
    (reading,) = case.readings
    assert (reading.channel, reading.value) == ("G.P2-P3", pytest.approx(0.44e-3))
    assert reading.accuracy in {None, 1e-4}


def test_line_of_sight(project, changed):
    """From a satellite in the west, 30 degrees from the vertical: ground goes east and down."""
    gauge = (
        "{kind: line-of-sight, points: {a: [1, 2, 3 m]}, incidence: 30 deg, azimuth: 270 deg,"
        " positive: away, accuracy: 2 mm}"
    )
    (channel,) = channels(project, SOLID.replace("GAUGE", gauge)).values()
    assert channel.name == "G.a"
    assert motion(channel, lambda x: np.array([0.1, 5.0, -0.2])) == pytest.approx(
        0.1 * 0.5 + 0.2 * math.sqrt(0.75)
    )
    gauge = "{kind: line-of-sight, point: [1, 2 m], sensor: [4, 6 m], accuracy: 1 mm}"
    (channel,) = channels(project, plane(changed, gauge)).values()
    assert channel.direction == pytest.approx((0.6, 0.8))


@pytest.mark.parametrize(
    ("gauge", "message", "hint"),
    [
        (
            "{kind: inclinometer, casing: [[1, 0 m], [1, -9 m]], depths: [2, «9 m»],"
            " accuracy: 1 mm}",
            "the depth 9 m is the bottom of the casing, to which all readings are relative: it "
            "always reads zero",
            "Remove it, or correct 'relative_to'.",
        ),
        (
            "{kind: inclinometer, casing: [[1, 0 m], [1, -9 m]], depths: [2 m], A: «[0, 1]»,"
            " accuracy: 1 mm}",
            "axis A has no direction across the casing",
            "Give a direction that is not along the casing.",
        ),
        (
            "{kind: tilt, point: [0, 3 m], drift: «1 mm/year», accuracy: 1 mrad}",
            "'1 mm/year' is a velocity; expected an angle rate",
            "Its units: mrad/month, rad/month, urad/month, deg/month, arcsec/month, mrad/year, "
            "rad/year, urad/year, deg/year, arcsec/year, mrad/day, rad/day, urad/day, deg/day, "
            "arcsec/day, mrad/week, rad/week and 13 more.",
        ),
        (
            "{kind: levelling, points: {a: [0, 0 m], b: [1, 0 m]}, relative_to: «c»,"
            " accuracy: 1 mm}",
            "there is no point 'c' in the line",
            "Its points: a, b.",
        ),
        (
            "«{kind: line-of-sight, point: [0, 0 m], accuracy: 1 mm}»",
            "found none of them; expected direction, or sensor, or incidence (with azimuth)",
            "Give one of them.",
        ),
    ],
)
def test_what_is_refused_in_a_plane(project, changed, gauge, message, hint):
    fault = project.only_fault(plane(changed, gauge.replace("»", "")))
    assert fault.message == message
    if hint is not None:
        assert fault.hint == hint


@pytest.mark.parametrize(
    ("gauge", "message"),
    [
        (
            "{kind: inclinometer, casing: [[0, 0, 0 m], [0, 0, -9 m]], depths: [1 m],"
            " accuracy: 1 mm}",
            "'A' is missing: the horizontal direction of axis A",
        ),
        (
            "{kind: target, point: [0, 0, 0 m], components: [across], accuracy: 1 mm}",
            "the component 'across' needs the direction of the axis",
        ),
        (
            "{kind: target, chainage: 130 m, beside: [0, 0 m], alignment: [[0, 0, 0 m], [9, 0, 0"
            " m]], accuracy: 1 mm}",
            "the chainage 130 m is not on the alignment, which reaches from 0 m to 9 m in plan",
        ),
        (
            "{kind: tilt, point: [0, 0, 0 m], accuracy: 1 mrad}",
            "'towards' is missing: the direction in which the top leans",
        ),
        (
            "{kind: tilt, between: [[0, 0, 0 m], [0, 3, 0 m]], towards: [1, 0, 0], accuracy: 1"
            " mrad}",
            "the line between the two points does not turn when it leans in the direction",
        ),
        (
            "{kind: line-of-sight, point: [0, 0, 0 m], incidence: 30 deg, accuracy: 1 mm}",
            "'azimuth' is missing: the direction towards the sensor, clockwise from y",
        ),
    ],
)
def test_what_is_refused_in_space(project, gauge, message):
    (fault,) = project.faults(SOLID.replace("GAUGE", gauge))
    assert fault.message == message


def test_a_tilt_sits_on_a_structure_that_the_case_has(project, changed):
    gauge = "{kind: tilt, on: «wall, point: [1, 0 m], accuracy: 0.1 mrad}"
    fault = project.only_fault(plane(changed, gauge))
    assert fault.message == "there is no structure 'wall'"
    gauge = "«{kind: tilt, on: wall, between: [[1, 0 m], [1, 2 m]], accuracy: 0.1 mrad}"
    fault = project.only_fault(plane(changed, gauge))
    assert fault.message == "found on and between; expected point (with on), or between"


def test_rings_are_read_by_another_probe(project, changed):
    gauge = (
        "«{kind: inclinometer, casing: [[1, 0 m], [1, -9 m]], depths: [2 m], rings: [3 m],"
        " accuracy: 1 mm}"
    )
    fault = project.only_fault(plane(changed, gauge))
    assert fault.message == "found one of rings and ring_accuracy; expected both or none"
    assert fault.hint == "Rings are read by another probe: add 'ring_accuracy: 1 mm' to 'rings'."
    sound = gauge.replace("«", "").replace("accuracy: 1 mm", "accuracy: 1 mm, ring_accuracy: 4 mm")
    found = channels(project, plane(changed, sound))
    assert (found["G.A2"].accuracy, found["G.S3"].accuracy) == (1e-3, 4e-3)


def test_a_reading_of_a_gauge_of_several_channels_names_them(project, changed):
    gauge = "  G: {kind: levelling, points: {P2: [4, 0 m], P3: [9, 1 m]}, accuracy: 0.3 mm}"
    text = changed(PLANE, gauge).replace(
        "readings: readings.csv", "readings: [{gauge: G, stage: bench 1, value: 1 mm}]"
    )
    with pytest.raises(InputError) as error:
        project.read(text)
    assert [fault.hint for fault in error.value.faults] == [
        "It has one reading for each of its channels: G.P2, G.P3."
    ]


def test_the_sizes_of_errors_of_rings_are_checked(project, changed):
    gauge = (
        "{kind: inclinometer, casing: [[1, 0 m], [1, -9 m]], depths: [2 m], rings: [3 m],"
        " accuracy: 1 mm, ring_accuracy: {reading: «5 kPa}}"
    )
    fault = project.only_fault(plane(changed, gauge))
    assert fault.message == "'5 kPa' is a pressure; expected a length"


def test_a_casing_is_not_read_at_a_million_depths(project, changed):
    gauge = "{kind: inclinometer, casing: [[1, 0 m], [1, -9 m]], interval: «1 nm, accuracy: 1 mm}"
    gauge = gauge.replace("1 nm", "1e-6 mm")
    fault = project.only_fault(plane(changed, gauge))
    assert fault.message == "more than 10000 depths in a casing of 9 m"


def test_the_drift_of_an_inclinometer_needs_the_dates_of_its_stages(project, changed):
    gauge = (
        "  G: {kind: inclinometer, casing: [[1, 0 m], [1, -9 m]], depths: [2.5 m], accuracy: 1 mm,"
        " zero: heading, drift: 1 mm/month}"
    )
    text = changed(PLANE, gauge).replace(
        "readings: readings.csv", "readings: [{gauge: G.A2.5, stage: bench 1, value: 1 mm}]"
    )
    with pytest.raises(InputError) as error:
        project.read(text)
    assert "'G' drifts in time, but the stage 'bench 1' has no date" in [
        fault.message for fault in error.value.faults
    ]


def test_estimated_accuracies_of_distortions_begin_at_what_is_usual_for_them(project, changed):
    gauge = (
        "{kind: levelling, points: {P2: [4, 0 m], P3: [9, 1 m]}, accuracy: 0.3 mm,"
        " distortions: {pairs: [[P2, P3]], accuracy: estimate}}"
    )
    pair = channels(project, plane(changed, gauge))["G.P2-P3"]
    assert (pair.errors.reading, pair.unit) == (5e-5, "mrad")
    assert dict(pair.errors.estimated) == {"reading": "distortion: reading"}


def test_rings_and_distortions_take_the_accuracy_of_their_own_zero(project, changed):
    """Root of 0.4^2 + 0.4^2 mm where the gauge itself states its zero and the rings do not."""
    gauge = (
        "  G: {kind: inclinometer, casing: [[1, 0 m], [1, -9 m]], depths: [2 m], rings: [3 m],"
        " accuracy: {reading: 1 mm, zero: 2 mm, along: 0 mm/sqrt(m)}, ring_accuracy: 0.4 mm,"
        " zero: heading}"
    )
    rows = "gauge,date,value,unit\nG.S3,2024-03-02,1,mm\nG.S3,2024-04-02,3,mm\n"
    Path(project.file).with_name("rings.csv").write_text(rows)
    text = changed(PLANE, gauge).replace(
        "readings: readings.csv",
        "dates: {heading: 2024-03-01, bench 1: 2024-04-01}\n"
        "readings: {file: rings.csv, rezero: true}",
    )
    found = {c.name: c for c in project.read(text).case.channels}
    assert found["G.S3"].errors.zero == pytest.approx(4e-4)
    assert found["G.A2"].errors.zero == 2e-3
