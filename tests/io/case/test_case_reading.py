"""What a sound case becomes: SI units, channels, resolved text."""

import io
import math
from types import SimpleNamespace

import pytest

from geoident.errors import InputError, Location
from geoident.io.case.file import read_case
from geoident.model.actions import Pressure, Traction
from geoident.model.case import Analysis, Material, Stage, Support
from geoident.model.gauges import Channel, Reading
from geoident.model.ground import Isotropic
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.methods import (
    CondensationOptions,
    GaussNewtonOptions,
    ScanAxis,
    ScanOptions,
    SimplexOptions,
)
from geoident.model.parameter import Parameter, Prior, Scalar

HEIM = "{model: heim, vertical: 8 MPa, K0: $K0}"
FIT = "fit: {method: gauss-newton, stages: [bench 1]}"
CV1 = "  CV1: {kind: convergence, between: [[-1, 0 m], [1, 0 m]], accuracy: 0.2 mm, zero: heading}"


def test_everything_arrives_in_si_units(project):
    case = project.read().case
    assert case.title == "Cavern"
    assert case.analysis is Analysis.PLANE_STRAIN
    assert case.mesh_file == str(project.folder / "cavern.msh")
    assert case.parameters == (
        Parameter("E_rock", 15e9, 2e9, 80e9, "log", None, "pressure", "GPa"),
        Parameter("K0", 1.0, 0.3, 3.0),
    )
    assert case.materials == {
        "rock": Material(
            "rock", Isotropic(E=Scalar(1.0, "E_rock"), nu=Scalar(0.25)), Scalar(2650.0)
        ),
        "shotcrete": Material("shotcrete", Isotropic(K=Scalar(8e9), G=Scalar(6e9))),
    }
    assert case.groups == {"rock": "rock", "heading": "rock", "bench": "rock", "lining": None}
    assert case.supports == (
        Support("left", (0,)),
        Support("right", (0,)),
        Support("bottom", (0, 1)),
    )
    assert case.in_situ == HeimStress(K0=Scalar(1.0, "K0"), vertical=Scalar(8e6))
    assert case.gravity == (0.0, -9.81)
    assert case.loads == {"water": Pressure("left", Scalar(1e6))}
    assert case.stages == (
        Stage("heading", excavate=("heading",)),
        Stage("bench 1", excavate=("bench",), install={"lining": "shotcrete"}),
    )
    assert case.fit.methods == (GaussNewtonOptions(),)
    assert case.fit.stages == ("bench 1",)


def test_gauges_become_channels(project):
    assert project.read().case.channels == (
        Channel(
            name="EX1.a5",
            gauge="EX1",
            kind="extensometer",
            first=(12.5, 3.0),
            second=(17.5, 3.0),
            direction=(1.0, 0.0),
            accuracy=1e-4,
            zero="virgin",
            key=("gauges", "EX1", "anchors", "a5"),
        ),
        Channel(
            name="CV1",
            gauge="CV1",
            kind="convergence",
            first=(-1.0, 0.0),
            second=(1.0, 0.0),
            direction=(1.0, 0.0),
            accuracy=2e-4,
            zero="heading",
            key=("gauges", "CV1"),
        ),
    )


@pytest.mark.parametrize(
    ("gauge", "first", "direction"),
    [
        ("kind: settlement, point: [1, 2 m]", None, (0.0, -1.0)),
        ("kind: settlement, point: [1, 2 m], relative_to: [0, 0 m]", (0.0, 0.0), (0.0, -1.0)),
        ("kind: displacement, point: [1, 2 m], component: y", None, (0.0, 1.0)),
        (
            "kind: displacement, point: [1, 2 m], component: x, relative_to: ground",
            None,
            (1.0, 0.0),
        ),
        ("kind: displacement, point: [1, 2 m], direction: [3, 4]", None, (0.6, 0.8)),
    ],
)
def test_points_are_read_along_a_direction(gauge, first, direction, project, changed):
    text = changed(CV1, f"  CV1: {{{gauge}, accuracy: 1 mm, zero: heading}}")
    channel = project.read(text).case.channels[1]
    assert (channel.first, channel.second, channel.direction) == (first, (1.0, 2.0), direction)


def test_readings_come_with_their_places(project):
    case = project.read().case
    file = project.readings_file
    assert case.readings == (
        Reading("EX1.a5", "heading", 1.25e-3, None, Location(file, 2, 1)),
        Reading("EX1.a5", "bench 1", None, None, Location(file, 3, 1)),
        Reading("CV1", "bench 1", -3e-3, None, Location(file, 4, 1)),
    )


def test_readings_may_stand_in_the_case(project, changed):
    entries = "[{gauge: CV1, stage: bench 1, value: -3 mm, accuracy: 1 mm}, "
    entries += "{gauge: EX1.a5, stage: heading, value: }]"
    loaded = project.read(changed("readings.csv", entries))
    assert loaded.readings_paths == ()
    assert loaded.case.readings == (
        Reading("CV1", "bench 1", -3e-3, 1e-3, Location(project.file, 23, 20)),
        Reading("EX1.a5", "heading", None, None, Location(project.file, 23, 80)),
    )


def test_in_situ_models(project, changed):
    text = changed(HEIM, "{model: constant, xx: -1 MPa, yy: -2 MPa, zz: -3 MPa, xy: 0.5 MPa}")
    text = text.replace("nu: 0.25", "nu: 0.2 $K0")
    zero = Scalar(0.0)
    components = (Scalar(-1e6), Scalar(-2e6), Scalar(-3e6), Scalar(5e5), zero, zero)
    case = project.read(text).case
    assert case.in_situ == ConstantStress(components)
    assert case.materials["rock"].elastic.nu == Scalar(0.2, "K0")
    heim = "{model: heim, unit_weight: 27 kN/m³, surface: 300 m, K0: $K0, held: true}"
    assert project.read(changed(HEIM, heim)).case.in_situ == HeimStress(
        Scalar(1.0, "K0"), unit_weight=Scalar(27e3), surface=Scalar(300.0), held=True
    )


def test_solids_have_three_axes(project, changed):
    text = changed("plane-strain", "solid").replace("[x, y]", "fixed")
    text = (
        text.replace("3 m]", "3, 0 m]").replace("0 m]]", "0, 0 m]]").replace("[-1, 0", "[-1, 0, 0")
    )
    case = project.read(text).case
    assert case.gravity == (0.0, 0.0, -9.81)
    assert case.supports[2] == Support("bottom", (0, 1, 2))
    assert case.channels[1].second == (1.0, 0.0, 0.0)


def test_loads_begin_and_end_with_stages(project, changed):
    text = changed(
        "excavate: [heading]}",
        "excavate: [heading], remove: [water], loads: "
        "{push: {on: top, traction: [0, $E_rock]}, hold: {on: top, traction: [1, 2 kPa]}}}",
    ).replace("[0, $E_rock]", "[0 Pa, -0.1 $E_rock]")
    stage = project.read(text).case.stages[0]
    assert stage.remove == ("water",)
    assert stage.loads == {
        "push": Traction("top", (Scalar(0.0), Scalar(-0.1, "E_rock"))),
        "hold": Traction("top", (Scalar(1e3), Scalar(2e3))),
    }


def test_priors(project, changed):
    text = changed("scale: log}", "prior: {mean: 10 GPa, sd: 3 GPa, kind: lognormal}}")
    assert project.read(text).case.parameters[0].prior == Prior(10e9, 3e9, "lognormal")


def test_methods_follow_each_other_with_their_options(project, changed):
    fit = """fit:
  method: [scan, simplex, condensation]
  scan: {grid: {E_rock: {from: 5 GPa, to: 30 GPa, points: 5}, K0: {from: 1, to: 2}}, points: 11}
  simplex: {max_evaluations: 100, delta: 1e-4}
"""
    settings = project.read(changed(FIT, fit)).case.fit
    assert settings.stages is None
    assert settings.methods == (
        ScanOptions({"E_rock": ScanAxis(5e9, 30e9, 5), "K0": ScanAxis(1.0, 2.0, 11)}, 11),
        SimplexOptions(max_evaluations=100, delta=1e-4),
        CondensationOptions(),
    )


def test_without_fit_the_first_method_is_taken(project, changed):
    assert project.read(changed(FIT, "")).case.fit.methods == (GaussNewtonOptions(),)


def test_text_is_verbatim_and_resolved_reads_as_the_same_case(project):
    text = "# a comment\n" + project.read().text
    loaded = project.read(text, "parameters.E_rock.start=20 GPa")
    assert loaded.text == text
    assert "start: 20 GPa" in loaded.resolved
    assert "tolerance: 1e-08" in loaded.resolved
    again = project.read(loaded.resolved)
    assert again.resolved == loaded.resolved
    assert again.case.parameters == loaded.case.parameters
    assert again.case.channels == loaded.case.channels


def test_names_that_other_readers_turn_into_flags_and_numbers_stay_names(project, changed):
    text = changed("Cavern", "no").replace("bench 1", "1e9").replace("shotcrete", "on")
    (project.folder / "readings.csv").write_text("gauge,stage,value,unit\nCV1,1e9,1,mm\n")
    loaded = project.read(text)
    assert loaded.case.title == "no"
    assert loaded.case.stage_names == ("virgin", "heading", "1e9")
    assert loaded.case.groups["lining"] is None
    assert project.read(loaded.resolved).case.materials.keys() == {"rock", "on"}


def test_stdin_is_read_and_files_are_sought_in_the_working_folder(project, monkeypatch):
    text = project.read().text
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(text.encode())))
    monkeypatch.chdir(project.folder)
    loaded = read_case("-")
    assert (loaded.mesh_path, loaded.readings_paths) == ("cavern.msh", ("readings.csv",))
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(b"title: [")))
    with pytest.raises(InputError, match="<stdin>:2:1"):
        read_case("-")


def test_keys_are_located_for_later_faults(project):
    source = project.read(project.read().text, "parameters.E_rock.start=20 GPa").case.source
    assert source.locate(("stages", 1, "excavate", 0)) == Location(project.file, 19, 32)
    assert source.locate(("groups", "bench")) == Location(project.file, 11, 37)
    assert source.locate(("parameters", "E_rock", "start")).line == 6


def test_directions_are_unit_vectors(project, changed):
    text = changed("[[-1, 0 m], [1, 0 m]]", "[[-1, 0 m], [2, 7 m]]")
    assert math.hypot(*project.read(text).case.channels[1].direction) == pytest.approx(1, abs=1e-15)


@pytest.mark.parametrize("path", ["", ".", "no such file", "a\0b", "/dev/zero"])
def test_files_that_cannot_be_read_are_refused(path):
    with pytest.raises(InputError) as caught:
        read_case(path)
    assert caught.value.faults[0].code in {"unreadable-file", "not-a-file"}
