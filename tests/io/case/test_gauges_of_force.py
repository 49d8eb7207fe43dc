"""Gauges of forces: the channels that they become."""

import math

import pytest

from geoident.io.case.file import parse_case
from geoident.model.gauges import Reads

PLANE = (
    "  CV1: {kind: convergence, between: [[-1, 0 m], [1, 0 m]], accuracy: 0.2 mm, zero: heading}"
)
NAILS = """\
structures:
  nails: {kind: bolt, ends: [[[3 m, 0 m], [5 m, 0 m]], [[0 m, 3 m], [0 m, 6 m]]], spacing: 1 m,
          EA: 100 MN}
  prop: {kind: strut, ends: [[[-3 m, 0 m], [3 m, 0 m]]], spacing: 1 m, EA: 100 MN}
gauges:
"""


def found(project, changed, gauge, *, structures=False):
    """Name to channel of a gauge G, in place of a convergence of the sound case."""
    text = changed(PLANE, f"  G: {gauge}").replace("readings: readings.csv\n", "")
    if structures:
        text = text.replace("gauges:\n", NAILS)
    loaded = project.read(text)
    again = parse_case(loaded.resolved, str(project.folder / "case.yaml")).case.channels
    channels = {c.name: c for c in loaded.case.channels if c.gauge == "G"}
    for channel in again:  # what is resolved is read as the same
        if channel.gauge == "G":
            assert channel.reads is channels[channel.name].reads
            assert channel.compression == channels[channel.name].compression
            assert channel.terms == channels[channel.name].terms
    return channels


def test_a_stress_is_a_value_unless_a_zero_is_given(project, changed):
    kind = "{kind: stress, point: [1 m, 9 m], components: [xx, xy], accuracy: 0.3 MPa"
    value = found(project, changed, kind + "}")
    assert list(value) == ["G.xx", "G.xy"]
    assert [c.quantity for c in value.values()] == ["xx", "xy"]
    assert {c.reads for c in value.values()} == {Reads.VALUE}
    assert {c.dimension for c in value.values()} == {"pressure"}
    change = found(project, changed, kind + ", zero: virgin}")
    assert {c.reads for c in change.values()} == {Reads.CHANGE}
    virgin = found(project, changed, kind + ", state: virgin}")
    assert {c.reads for c in virgin.values()} == {Reads.VIRGIN}


def test_a_pressure_cell_counts_compression_across_its_plane(project, changed):
    kind = "{kind: pressure-cell, point: [1 m, 9 m], normal: [3, 4], accuracy: 10 kPa}"
    (cell,) = found(project, changed, kind).values()
    assert cell.compression
    assert not cell.effective
    assert cell.direction == pytest.approx((0.6, 0.8))


@pytest.mark.parametrize(
    ("keys", "compression"),
    [
        ("structure: nails, bar: 2", False),
        ("structure: prop", True),
        ("structure: prop, sign: tension", False),
        ("structure: nails, bar: 1, sign: compression", True),
    ],
)
def test_bolts_count_tension_and_struts_compression(project, changed, keys, compression):
    kind = f"{{kind: load-cell, {keys}, accuracy: 5 kN}}"
    (cell,) = found(project, changed, kind, structures=True).values()
    assert cell.compression is compression
    assert cell.reads is Reads.VALUE
    assert cell.dimension == "force"
    if "bar: 2" in keys:
        assert (cell.member, cell.first, cell.second) == (1, (0, 3), (0, 6))


def test_a_fibre_reads_the_mean_strain_around_each_station(project, changed):
    """An L of 2 m and 1 m: stretched along x by 1e-3, along y by 2e-3."""
    kind = (
        "{kind: strain, along: [[0, 9 m], [2, 9 m], [2, 10 m]], every: 0.8 m, base: 0.6 m, "
        "accuracy: 5 microstrain}"
    )
    channels = found(project, changed, kind)
    assert list(channels) == ["G.0.3", "G.1.1", "G.1.9", "G.2.7"]

    def read(channel):
        return sum(1e-3 * x * vx + 2e-3 * y * vy for (x, y), (vx, vy) in channel.motions)

    strains = [read(channel) for channel in channels.values()]
    bent = (0.4 * 1e-3 + 0.2 * 2e-3) / 0.6  # from 1.6 m to 2.2 m along the line
    assert strains == pytest.approx([1e-3, 1e-3, bent, 2e-3])
    assert {c.reads for c in channels.values()} == {Reads.CHANGE}


def test_hundreds_of_values_come_from_one_key(project, changed):
    kind = "{kind: strain, along: [[-20, 9 m], [20, 9 m]], every: 0.1 m, accuracy: 5 microstrain}"
    channels = found(project, changed, kind)
    assert len(channels) == 400
    assert math.isclose(list(channels.values())[-1].second[0], 20.0)


def test_strain_of_a_structure_is_a_value_since_it_was_built(project, changed):
    kind = "{kind: strain, structure: nails, bar: 1, accuracy: 5 microstrain}"
    (gauge,) = found(project, changed, kind, structures=True).values()
    assert gauge.reads is Reads.VALUE
    assert gauge.dimension == "strain"


def test_an_offset_has_the_dimension_of_what_is_read(project, changed):
    gauge = "{kind: load-cell, structure: prop, accuracy: 5 kN, offset: «3 kN/m}"
    text = changed(PLANE, f"  G: {gauge}").replace("readings: readings.csv\n", "")
    fault = project.only_fault(text.replace("gauges:\n", NAILS))
    assert fault.message == "'3 kN/m' is a line load; by its accuracy the gauge reads a force"
