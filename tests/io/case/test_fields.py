"""Constants that vary from place to place: what a case says of them, and what is wrong with it."""

from math import radians

import pytest
from support.trench import CASE, write_case

from geoident.errors import InputError
from geoident.io.case.file import parse_case, read_case
from geoident.model.ground import Attitude, Axes, Isotropic
from geoident.model.parameter import Scalar

ROCK = "rock: {elastic: isotropic, E: $E, nu: 0.25}"
CSV = "x [m], y [m], E [GPa], accuracy [GPa]\n1, 2, 4.5, 0.5\n\n5.5, 0.5, 6,\n"


def read(folder, rock, *, analysis="plane-strain", **files):
    path = write_case(folder)
    path.write_text(
        CASE.replace(ROCK, f"rock: {rock}").replace("plane-strain", analysis), encoding="utf-8"
    )
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text)
    return read_case(str(path))


def field(**changes):
    keys = {"mean": "$E", "sd": "30 %", "length": "[4 m, 2 m]", **changes}
    body = ", ".join(f"{key}: {value}" for key, value in keys.items() if value)
    return f"{{elastic: isotropic, E: {{field: {{{body}}}}}, nu: 0.25}}"


def faults(folder, rock, **given):
    with pytest.raises(InputError) as caught:
        read(folder, rock, **given)
    return [
        (f.location.file.rpartition("/")[2], f.location.line, f.code, f.message)
        for f in caught.value.faults
    ]


def test_a_field_is_a_number_with_more_to_it(tmp_path):
    case = read(tmp_path, field(along="{dip: 30 deg}", modes="20", smoothness="0.5")).case
    rock = case.materials["rock"]
    assert rock.elastic == Isotropic(E=Scalar(1.0, "E"), nu=Scalar(0.25))
    (found,) = rock.fields
    assert case.fields == (found,)
    assert (found.name, found.constant, found.surface) == ("rock.E", "E", None)
    assert (found.sd, found.lengths, found.modes, found.smoothness) == (0.3, (4.0, 2.0), 20, 0.5)
    assert isinstance(found.frame, Attitude)
    assert found.frame.dip.factor == pytest.approx(radians(30))
    assert found.mean == Scalar(1.0, "E")


def test_a_deviation_may_be_a_number_where_the_mean_is_one(tmp_path):
    rock = field(mean="6 GPa", sd="1.5 GPa", length="3 m").replace("E:", "K:")
    rock = rock.replace("nu: 0.25", "G: 0.4 $E")
    (found,) = read(tmp_path, rock).case.fields
    assert (found.sd, found.lengths, found.unit) == (0.25, (3.0,), "GPa")


def test_strengths_vary_too(tmp_path):
    surface = "{type: tresca, strength: {field: {mean: 2 MPa, sd: 20 %, length: 3 m}}}"
    weak = "{type: weak-plane, dip: 30 deg, cohesion: 1 MPa, "
    weak += "friction: {field: {mean: 30 deg, sd: 10 %, length: 3 m}}}"
    rock = f"{{E: $E, nu: 0.25, yield: [{surface.replace('2 MPa,', '2 MPa,')}, {weak}]}}"
    rock = rock.replace("}}}, {type: weak", "}}, planes: 16}, {type: weak")
    one, other = read(tmp_path, rock).case.fields
    assert (one.name, one.constant, one.surface) == ("rock.cohesion", "cohesion", 0)
    assert (other.name, other.constant, other.surface) == ("rock.yield-2.friction", "friction", 1)
    assert other.dimension == "angle"


def test_in_a_solid_the_axes_are_those_of_the_model(tmp_path):
    path = write_case(tmp_path)
    text = CASE.replace(ROCK, f"rock: {field(length='[4 m, 3 m, 2 m]')}")
    text = text.replace("plane-strain", "solid").partition("gauges:")[0]
    path.write_text(text.replace("K0: $K0", "K0: $K0, azimuth: 0 deg"))
    (found,) = read_case(str(path)).case.fields
    assert found.frame == Axes((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert found.lengths == (4.0, 3.0, 2.0)


def test_tests_are_read_from_files_and_from_the_case(tmp_path):
    rock = field(measured="[holes.csv, {at: [3 m, 1 m], value: 5 GPa, accuracy: 10 %}]")
    loaded = read(tmp_path, rock, holes=CSV)
    first, second, third = loaded.case.fields[0].measured
    assert (first.position, first.value, first.accuracy) == ((1.0, 2.0), 4.5e9, 0.5e9)
    assert first.origin == "holes.csv, line 2"
    assert (second.value, second.accuracy, second.origin) == (6e9, 0.0, "holes.csv, line 4")
    assert (third.position, third.accuracy) == ((3.0, 1.0), pytest.approx(0.5e9))
    (tmp_path / "holes.csv").unlink()
    again = parse_case(loaded.resolved, str(tmp_path / "case.yaml"))
    assert again.case.fields == loaded.case.fields  # the resolved case needs no file


def test_faults_in_a_file_of_tests_are_told_by_line_and_column(tmp_path):
    table = "x [m], y [ft], E [kPx], acuracy [GPa]\n"
    rows = "x [m], y [m], value [GPa]\n1, two, 3\n1, 2\n1, 2, 3, 4\n"
    rock = field(measured="[a.csv, b.csv, c.csv]")
    found = faults(tmp_path, rock, a=table, b=rows)
    assert ("a.csv", 1, "unit") in [f[:3] for f in found]
    assert ("a.csv", 1, "unknown-column") in [f[:3] for f in found]
    assert [f[:3] for f in found if f[0] == "b.csv"] == [
        ("b.csv", 2, "bad-number"),
        ("b.csv", 3, "bad-number"),
        ("b.csv", 4, "bad-row"),
    ]
    assert ("case.yaml", "unreadable-file") in [(f[0], f[2]) for f in found]


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"sd": "30"}, "out-of-range", "3000 %"),
        ({"sd": "3 m"}, "unit", "is a length"),
        ({"sd": "1 GPa"}, "unit", "the mean is a parameter"),
        ({"mean": "-2 GPa"}, "out-of-range", "must be positive"),
        ({"mean": "2 m"}, "unit", "'2 m'"),
        ({"mean": "$EE"}, "unknown-parameter", "'EE'"),
        ({"mean": "$K0"}, "unit", "'$K0'"),
        ({"length": "[1 m, 2 m, 3 m]"}, "wrong-dimension", "3 lengths; expected one, or two"),
        ({"length": "[]"}, "wrong-dimension", "found no length; expected one, or two"),
        ({"length": "-1 m"}, "out-of-range", "positive"),
        ({"length": ""}, "missing-key", "'length'"),
        ({"lenght": "1 m"}, "unknown-key", "'lenght'"),
        ({"smoothness": "40"}, "out-of-range", "'40'"),
        ({"along": "{dipp: 3 deg}"}, "unknown-key", "'dipp'"),
        ({"along": "{dip: $K0}"}, "bad-tie", "parameter cannot be used"),
        (
            {"measured": "[{at: [1 m], value: 3 GPa}]"},
            "wrong-dimension",
            "found 1; expected 2 components",
        ),
        ({"measured": "[{at: [1 m, 1 m], value: 3 m}]"}, "unit", "is a length"),
        ({"measured": "[{at: [1 m, 1 m], value: -3 GPa}]"}, "out-of-range", "positive"),
        (
            {"measured": "[{at: [1, 1 m], value: 3 GPa}, {at: [1, 1 m], value: 4 GPa}]"},
            "contradiction",
            "differ",
        ),
    ],
)
def test_what_cannot_be_is_refused_where_it_stands(tmp_path, changes, code, words):
    found = faults(tmp_path, field(**changes))
    line = CASE.splitlines().index(f"  {ROCK}") + 1
    assert any(c == code and words in text and at == line for _, at, c, text in found), found


def test_a_constant_that_cannot_vary_says_so(tmp_path):
    rock = "{E: $E, nu: {field: {mean: 0.2, sd: 5 %, length: 3 m}}}"
    assert faults(tmp_path, rock)[0][2] == "no-field"


def test_uniform_ground_is_asked_of_a_case_without_mesh(tmp_path):
    path = write_case(tmp_path)
    text = CASE.replace(ROCK, f"rock: {field()}").replace("mesh: {file: trench.inp}\n", "")
    path.write_text(
        text.replace("fit: {", "fit: {closed-form: {centre: [3 m, 3 m], radius: 1 m}, ")
    )
    with pytest.raises(InputError) as caught:
        read_case(str(path))
    assert "no-mesh" in {fault.code for fault in caught.value.faults}
