"""In-situ stress, loads, water, temperature and load cases: what they become, what is refused."""

import math

import pytest

from geoident.model.actions import (
    HeadLine,
    PointForce,
    Pressure,
    Seismic,
    TemperatureField,
    Water,
    WaterPressure,
)
from geoident.model.in_situ import ConstantStress, HeimStress, ProfileStress
from geoident.model.parameter import Scalar

HEIM = "{model: heim, vertical: 8 MPa, K0: $K0}"
LOAD = "{on: left, pressure: 1 MPa}"
BENCH = "  - {name: bench 1, excavate: [bench], install: {lining: shotcrete}}"
SHOTCRETE = "shotcrete: {elastic: isotropic, K: 8 GPa, G: 6 GPa}"
ZERO = Scalar(0.0)


def solid(text):
    """The sound case in three dimensions."""
    for old, new in (
        ("plane-strain", "solid"), ("[x, y]", "fixed"), ("3 m]", "3, 0 m]"), ("0 m]]", "0, 0 m]]"),
        ("[-1, 0", "[-1, 0, 0"),
    ):  # fmt: skip
        text = text.replace(old, new)
    return text


def test_heim_with_two_ratios_and_an_azimuth(project, changed):
    heim = "{model: heim, unit_weight: 27 kN/m3, surface: hill, K0: $K0, K0_across: 0.7, "
    heim += "azimuth: 30 deg, tectonic: {xx: -1 MPa, xy: 0.2 MPa}}"
    text = solid(changed(HEIM, heim))
    assert project.read(text).case.in_situ == HeimStress(
        Scalar(1.0, "K0"),
        unit_weight=Scalar(27e3),
        surface="hill",
        K0_across=Scalar(0.7),
        azimuth=Scalar(math.radians(30)),
        tectonic=(Scalar(-1e6), ZERO, ZERO, Scalar(0.2e6), ZERO, ZERO),
    )


def test_a_surface_may_be_a_parameter(project, changed):
    text = changed(HEIM, "{model: heim, unit_weight: 27 kN/m3, surface: $top, K0: $K0}")
    text = text.replace(
        "parameters:\n", "parameters:\n  top: {start: 300 m, bounds: [200, 400 m]}\n"
    )
    assert project.read(text).case.in_situ.surface == Scalar(1.0, "top")


def test_profiles_and_zones(project, changed):
    text = changed(
        HEIM,
        "{model: profile, surface: 20 m, at_surface: {xx: -3 MPa}, gradient: {yy: -26 kN/m3}, "
        "groups: {bench: {model: constant, xx: -1 MPa, yy: -2 MPa, zz: -3 MPa}, "
        "heading: {model: heim, vertical: 1 MPa, K0: $K0}}}",
    )
    case = project.read(text).case
    assert case.in_situ == ProfileStress(
        (Scalar(-3e6), ZERO, ZERO, ZERO, ZERO, ZERO),
        (ZERO, Scalar(-26e3), ZERO, ZERO, ZERO, ZERO),
        Scalar(20.0),
    )
    assert case.in_situ_of == {
        "bench": ConstantStress((Scalar(-1e6), Scalar(-2e6), Scalar(-3e6), ZERO, ZERO, ZERO)),
        "heading": HeimStress(Scalar(1.0, "K0"), vertical=Scalar(1e6)),
    }
    again = project.read(project.read(text).resolved).case
    assert (again.in_situ, again.in_situ_of) == (case.in_situ, case.in_situ_of)


@pytest.mark.parametrize(
    ("written", "load"),
    [
        (LOAD, Pressure("left", Scalar(1e6))),
        ("{on: left, water: {level: 12 m}}", WaterPressure("left", Scalar(12.0), Scalar(9810.0))),
        (
            "{on: base, water: {level: 12 m, unit_weight: 10 kN/m3, falls: "
            "{from: [0, 0 m], to: [9, 0 m], level: 2 m}}}",
            WaterPressure(
                "base", Scalar(12.0), Scalar(10e3), HeadLine((0.0, 0.0), (9.0, 0.0), Scalar(2.0))
            ),
        ),
        (
            "{at: [1, 2 m], line_force: [0, -2 MN/m]}",
            PointForce((1.0, 2.0), (Scalar(0.0), Scalar(-2e6))),
        ),
        ("{on: pad, line_force: [1 kN/m, 0 N/m]}", PointForce("pad", (Scalar(1e3), Scalar(0.0)))),
        ("{seismic: [0.1, $K0]}", Seismic((Scalar(0.1), Scalar(1.0, "K0")))),
    ],
)
def test_loads(written, load, project, changed):
    loaded = project.read(changed(LOAD, written))
    assert loaded.case.loads == {"water": load}
    assert project.read(loaded.resolved).case.loads == {"water": load}


def test_water_temperature_and_load_cases(project, changed):
    text = changed(SHOTCRETE, "shotcrete: {K: 8 GPa, G: 6 GPa, expansion: 1e-5 1/K}")
    text = text.replace("gravity:", "water: {table: 9 m}\ngravity:")
    text = text.replace(
        BENCH,
        BENCH
        + """
  - name: winter
    independent: true
    temperature: {lining: -8 K}
    water: {table: spring-line, unit_weight: 10 kN/m3, groups: [rock]}
  - name: sun
    base: winter
    temperature: {lining: {points: [[0, 0 m], [1, 0 m]], values: [4, 5 K], factor: 2}}""",
    )
    loaded = project.read(text)
    case = loaded.case
    assert case.materials["shotcrete"].expansion == Scalar(1e-5)
    assert case.water == Water(Scalar(9.0), Scalar(9810.0))
    winter, sun = case.stages[2:]
    assert (winter.independent, winter.base) == (True, None)
    assert winter.temperature == {"lining": Scalar(-8.0)}
    assert winter.water == Water("spring-line", Scalar(10e3), ("rock",))
    assert (sun.independent, sun.base) == (False, "winter")
    field = TemperatureField(((0.0, 0.0), (1.0, 0.0)), (4.0, 5.0), Scalar(2.0))
    assert sun.temperature == {"lining": field}
    assert project.read(loaded.resolved).case.stages == case.stages


FAULTS = {
    "azimuth in a plane": (HEIM, HEIM[:-1] + ", «azimuth: 3 deg}", "in_situ.azimuth", ["plane"]),
    "tectonic vertical": (
        HEIM,
        HEIM[:-1] + ", tectonic: {«yy: 3 MPa}}",
        "in_situ.tectonic.yy",
        ["not horizontal", "profile"],
    ),
    "unknown zone": (
        HEIM,
        HEIM[:-1] + ", groups: {«bnch: {model: heim, vertical: 8 MPa, K0: 1}}}",
        "in_situ.groups.bnch",
        ["mean 'bench'?"],
    ),
    "no load": (LOAD, "{on: left}", "loads.water", ["found none of them", "seismic"]),
    "pressure at a point": (
        LOAD,
        "{at: [1, 2 m], pressure: 1 MPa}",
        "loads.water",
        ["found 'at'", "group of faces"],
    ),
    "force nowhere": (LOAD, "{line_force: [1, 2 N/m]}", "loads.water", ["no place"]),
    "force in a plane": (
        LOAD,
        "{at: [1, 2 m], «force: [1, 2 N]}",
        "loads.water.force",
        ["expected 'line_force'"],
    ),
    "force of three": (
        LOAD,
        "{at: [1, 2 m], line_force: «[1, 2, 3 N/m]}",
        "loads.water.line_force",
        ["found 3; expected 2 components"],
    ),
    "uplift of no length": (
        LOAD,
        "{on: b, water: {level: 1 m, falls: {from: [0, 1 m], to: «[0, 1 m], level: 0 m}}}",
        "loads.water.water.falls.to",
        ["one point"],
    ),
    "level in MPa": (
        LOAD,
        "{on: left, water: {level: «1 MPa}}",
        "loads.water.water.level",
        ["a pressure; expected a length"],
    ),
    "warm without expansion": (
        BENCH,
        BENCH + "\n  - {name: warm, temperature: {«lining: 5 K}}",
        "stages[2].temperature.lining",
        ["no expansion", "1e-5 1/K"],
    ),
    "warm what is gone": (
        BENCH,
        BENCH + "\n  - {name: warm, temperature: {«heading: 5 K}}",
        "stages[2].temperature.heading",
        ["not present"],
    ),
    "warm by pressure": (
        BENCH,
        BENCH + "\n  - {name: warm, temperature: {lining: «5 kPa}}",
        "stages[2].temperature.lining",
        ["expected a temperature"],
    ),
    "base that is later": (
        BENCH,
        BENCH + "\n  - {name: a, base: «b}\n  - {name: b}",
        "stages[2].base",
        ["not before this stage"],
    ),
    "unknown base": (
        BENCH,
        BENCH + "\n  - {name: a, base: «haeding}",
        "stages[2].base",
        ["Did you mean 'heading'?"],
    ),
    "branch without the other branch": (
        BENCH,
        BENCH + "\n  - {name: a, base: heading, change: {«lining: rock}}",
        "stages[2].change.lining",
        ["not present"],
    ),
    "water in unknown ground": (
        "gravity:",
        "water: {table: 1 m, groups: [«rok]}\ngravity:",
        "water.groups[0]",
        ["mean 'rock'?"],
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_fault_is_said_at_its_place(name, project, changed):
    old, new, path, words = FAULTS[name]
    fault = project.only_fault(changed(old, new))
    assert fault.path == path
    for word in words:
        assert word in f"{fault.message} {fault.hint}"


def test_an_earthquake_needs_gravity(project, changed):
    text = changed("gravity: 9.81 m/s2\n", "").replace(LOAD, "{seismic: [0.1, 0]}")
    fault = project.only_fault(text)
    assert "no gravity" in fault.message


def test_a_bench_may_be_excavated_on_two_branches(project, changed):
    again = "\n  - {name: other, base: heading, excavate: [bench], independent: true}"
    case = project.read(changed(BENCH, BENCH + again)).case
    assert case.stages[2].base == "heading"


# Temperatures from a file -----------------------------------------------------------------------

WARM = "\n  - {name: warm, temperature: {lining: {file: warm.csv, factor: $K0}}}"


def warm(changed):
    text = changed(SHOTCRETE, "shotcrete: {K: 8 GPa, G: 6 GPa, expansion: 1e-5 1/K}")
    return text.replace(BENCH, BENCH + WARM)


TABLES = {
    "commas": "x [m],y [cm],change [K]\n0,100,4\n2,300,-5.5\n\n",
    "semicolons": "change (degC); x (m); y (m)\n4; 0; 1\n-5.5; 2; 3\n",
}


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_file_of_temperatures_becomes_part_of_the_case(table, project, changed):
    (project.folder / "warm.csv").write_text(table)
    loaded = project.read(warm(changed))
    expected = TemperatureField(((0.0, 1.0), (2.0, 3.0)), (4.0, -5.5), Scalar(1.0, "K0"))
    assert loaded.case.stages[2].temperature == {"lining": expected}
    (project.folder / "warm.csv").unlink()
    assert project.read(loaded.resolved).case.stages == loaded.case.stages


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (None, "cannot be read"),
        ("", "there is no column 'x'"),
        ("x,y,change\n1,2,3\n", "warm.csv:1:1: stages[2].temperature.lining.file: 'x' has no unit"),
        ("x [m],y [m],change [MPb]\n1,2,3\n", "there is no unit 'MPb'"),
        ("x [m],y [m],change [K]\n1,2\n", "the cell is empty (change)"),
        ("x [m],y [m],change [K]\n1,2,warm\n", "'warm' is not a number (change)"),
        ("x [m],y [m],change [K]\n", "the table has no row"),
        ("x [m],y [m],change [kPa]\n1,2,3\n", "has no unit of a temperature"),
        ("x [m],y [m],z [m],change [K]\n1,2,3,4\n", "the column 'z [m]' is not known here"),
    ],
)
def test_a_faulty_file_of_temperatures_is_said(table, words, project, changed):
    if table is not None:
        (project.folder / "warm.csv").write_text(table)
    text = warm(changed)
    faults = project.faults(text)
    assert words in str(faults[0])
    if table is None:
        assert "name: warm" in text.splitlines()[faults[0].location.line - 1]
    else:
        assert faults[0].location.file.endswith("warm.csv")
