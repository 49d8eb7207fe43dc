"""Files as sites deliver them: encodings, remarks, marks for missing readings, spread headers,
dates of stages that are late, frequencies of vibrating wires, coordinates of total stations."""

import contextlib
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geoident.errors import InputError
from geoident.io.readings.calibration import Calibration
from geoident.io.readings.file import parse_readings
from geoident.io.readings.layout import Layout, Origin
from geoident.io.readings.survey import SurveyGrid, axes_of_azimuth

DATES = "dates: {heading: 2024-03-01, bench 1: 2024-04-01}\nreadings: "


@pytest.fixture
def read(project, changed):
    """Read the sound case with a description of readings in place of its own."""

    def read(description, *, files=None, changes=()):
        for name, text in (files or {}).items():
            data = text if isinstance(text, bytes) else text.encode()
            Path(project.folder, name).write_bytes(data)
        text = changed("readings: readings.csv", description)
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        return project.read(text).case

    return read


@pytest.fixture
def refused(read):
    def refused(description, **options):
        with pytest.raises(InputError) as caught:
            read(description, **options)
        return caught.value.faults

    return refused


def values(case):
    """(channel, stage, mm) of the readings."""
    return [
        (r.channel, r.stage, None if r.value is None else pytest.approx(1e3 * r.value, abs=1e-9))
        for r in case.readings
    ]


# Encodings

UMLAUT = "gauge,stage,value,unit,remarks\nCV1,bench 1,1,mm,geprüft\n"


@pytest.mark.parametrize("name", ["windows-1252", "Latin-1", "utf-16-le", "cp437", "UTF-8"])
def test_a_declared_encoding_is_read(read, name):
    case = read(f"{{file: r.csv, encoding: {name}}}".join(["readings: ", ""]),
                files={"r.csv": UMLAUT.encode(name)})  # fmt: skip
    assert case.readings[0].note == "geprüft"


def test_a_byte_order_mark_says_utf_16(read):
    text = UMLAUT.replace(",", "\t")
    case = read("readings: {file: r.txt, delimiter: tab}", files={"r.txt": text.encode("utf-16")})
    assert case.readings[0].note == "geprüft"


def test_what_is_not_utf_8_is_refused_with_the_key(refused):
    (fault,) = refused("readings: r.csv", files={"r.csv": UMLAUT.encode("cp1252")})
    assert (fault.code, fault.location.line, fault.location.column) == ("not-text", 2, 22)
    assert fault.message == "byte 0xfc is not UTF-8 text"
    assert "encoding: windows-1252" in fault.hint


def test_text_of_another_encoding_than_declared_is_refused_at_its_place(refused):
    (fault,) = refused("readings: {file: r.csv, encoding: ascii}", files={"r.csv": UMLAUT})
    assert fault.message == "byte 0xc3 is not ascii text"
    assert (fault.location.line, fault.location.column) == (2, 22)


@pytest.mark.parametrize("name", ["wind-1252", "base64", "idna", "unicode_escape", "\u0661", "''"])
def test_only_encodings_of_texts_are_encodings(refused, name):
    (fault,) = refused(f"readings: {{file: r.csv, encoding: {name}}}", files={"r.csv": UMLAUT})
    assert (fault.code, fault.path) == ("bad-encoding", "readings.encoding")
    assert "windows-1252" in fault.hint


# Columns that are no gauges

FIELD = "date,EX1.a5 (mm),weather,CV1 (mm),Remarks\n2024-03-01,1,rain,n/a,head loose\n"


def test_remarks_are_kept_and_ignored_columns_are_not_read(read):
    description = "{file: r.csv, layout: wide, ignore: [Weather], blank: [n/a]}"
    case = read(DATES + description, files={"r.csv": FIELD})
    assert values(case) == [("EX1.a5", "heading", 1.0), ("CV1", "heading", None)]
    assert [r.note for r in case.readings] == ["head loose", "head loose"]


def test_a_column_that_is_no_gauge_is_said_with_what_to_declare(refused):
    faults = refused(DATES + "{file: r.csv, layout: wide, blank: [n/a]}", files={"r.csv": FIELD})
    (fault,) = faults
    assert fault.message == "the column 'weather' has no unit"
    assert "If it is not a gauge: ignore: [weather], or columns: {remarks: weather}." in fault.hint


def test_a_name_that_is_no_gauge_is_said_once_and_not_for_every_row(refused):
    names, stages = ("CV", "CV2", "EX1"), ("heading", "bench 1")
    rows = [f"{name},{stage},1,mm\n" for stage in stages for name in names]
    text = "gauge,stage,value,unit\n" + "".join(rows)
    faults = refused("readings: {file: r.csv}", files={"r.csv": text})
    assert [fault.message for fault in faults] == [
        "there is no gauge 'CV' to read (in 2 rows: 2, 5)",
        "there is no gauge 'CV2' to read (in 2 rows: 3, 6)",
        "there is no gauge 'EX1' to read (in 2 rows: 4, 7)",
    ]
    assert [fault.location.line for fault in faults] == [2, 3, 4]


def test_a_column_to_be_ignored_must_be_there(refused):
    (fault,) = refused(
        DATES + "{file: r.csv, layout: wide, ignore: [wether], channels: {CV1: CV1}}",
        files={"r.csv": FIELD.replace("n/a", "")},
    )
    assert fault.message == "there is no column 'wether' to be ignored"
    assert fault.hint == "Did you mean 'weather'?"


def test_long_tables_ignore_and_remark_alike(read, refused):
    text = "gauge,stage,value,unit,crew,remarks\nCV1,bench 1,-,mm,A,no access\n"
    case = read("readings: {file: r.csv, ignore: [crew], blank: ['-']}", files={"r.csv": text})
    assert values(case) == [("CV1", "bench 1", None)]
    assert case.readings[0].note == "no access"
    (fault,) = refused("readings: {file: r.csv, blank: ['-']}", files={"r.csv": text})
    assert fault.message == "there is no column 'crew'"
    assert fault.hint.endswith("If it is not to be read, declare it: ignore: [crew].")


@pytest.mark.parametrize("mark", ["n/a", "---", "-", "dry"])
def test_a_mark_that_is_not_declared_is_refused(refused, mark):
    text = f"gauge,stage,value,unit\nCV1,bench 1,{mark},mm\n"
    (fault,) = refused("readings: r.csv", files={"r.csv": text})
    assert fault.hint == f"If it stands for a missing reading, declare it: blank: ['{mark}']."


def test_names_spread_over_rows_and_titles_above_them(read):
    text = (
        'Monitoring of the "north wall;;;\nExtensometer 1;;;\n\n'
        "Datum;EX1;;Konvergenz\n;a5;a15;CV1\n;mm;mm;cm\n01.03.2024;1,5;2;0,1\n"
    )
    case = read(
        DATES + "{file: r.csv, layout: wide, header_row: 4, header_rows: 2, unit_row: true,\n"
        "  delimiter: ';', decimal: ',', date_format: DD.MM.YYYY, columns: {date: Datum},\n"
        "  channels: {EX1.a5: EX1 a5, CV1: Konvergenz CV1}}",
        files={"r.csv": text},
    )
    assert values(case) == [("EX1.a5", "heading", 1.5), ("CV1", "heading", 1.0)]


# Dates

STAGES = ["heading", "bench 1"]


def weekly(read, shift, *, step=0.0, more=""):
    """Readings on the day of each stage and a week later, with stages dated ``shift`` days late."""
    days = {"heading": f"2024-03-{1 + shift:02d}", "bench 1": f"2024-04-{1 + shift:02d}"}
    dates = ", ".join(f"{name}: {day}" for name, day in days.items())
    text = "gauge,date,value,unit\n"
    for day, level in (("2024-02-20", 0), ("2024-03-01", 2), ("2024-03-08", 2 + step),
                       ("2024-04-01", 5), ("2024-04-08", 5)):  # fmt: skip
        text += f"EX1.a5,{day},{level},mm\n"
    return read(f"dates: {{{dates}}}\nreadings: {{file: r.csv{more}}}", files={"r.csv": text})


def test_what_went_where_is_known_stage_by_stage(read):
    case = weekly(read, 0)
    assert [(s.stage, s.number, s.channels, s.between) for s in case.when_read] == [
        ("virgin", 1, 1, 0),
        ("heading", 2, 1, 0),
        ("bench 1", 2, 1, 0),
    ]
    assert case.notes == ("1 reading of EX1.a5 before the first stage left out.",)


def test_late_dates_of_stages_are_found_by_what_changes_inside_a_stage(read):
    """The example of the issue: all readings move one stage back, and nothing else says so."""
    case = weekly(read, 3)
    assert case.readings[0].stage == "heading"
    assert case.notes[0] == "2 readings of EX1.a5 before the first stage left out."
    between, before, change = case.notes[1:]
    assert before.startswith("Before the first stage was complete the channel changes by more")
    assert between == (
        "1 reading counts for 'heading' (2024-03-04), the last stage that was complete. It was "
        "taken on 2024-04-01, 3 days before 'bench 1' was complete (2024-04-04). If it contains "
        "motion of 'bench 1', the date of 'bench 1' is too late."
    )
    assert change == (
        "Inside 'heading' the channel changes by more than 4 standard deviations of a difference "
        "of two readings, most EX1.a5: +3 mm from 2024-03-08 to 2024-04-01. According to the case "
        "nothing is built in between: check the dates of the stages."
    )


def test_a_change_that_accuracy_explains_is_none(read):
    accuracy = 0.1  # mm, of EX1 in the case
    limit = 4 * math.sqrt(2) * accuracy
    assert len(weekly(read, 0, step=0.99 * limit).notes) == 1
    assert "Inside 'heading'" in weekly(read, 0, step=1.01 * limit).notes[1]


def test_a_stage_without_readings_is_warned_of(read):
    case = read(
        "dates: {heading: 2024-03-01, bench 1: 2024-06-01}\nreadings: {file: r.csv}",
        files={"r.csv": "gauge,date,value,unit\nEX1.a5,2024-03-02,1,mm\n"},
    )
    assert case.notes == ("The stage 'bench 1' has no reading since it was complete (2024-06-01).",)


def test_files_of_one_layout_are_one_and_what_they_repeat_counts_once(read):
    analysis = "gauge,date,value,unit\nEX1.a5,2024-03-01,1,mm\nEX1.a5,2024-03-02,3,mm\n"
    april = "gauge,date,value,unit\nEX1.a5,2024-03-02,3,mm\nEX1.a5,2024-04-02,7,mm\n"
    case = read(
        DATES + "{file: [m.csv, a.csv], repeated_readings: mean}",
        files={"m.csv": analysis, "a.csv": april},
    )
    assert values(case) == [("EX1.a5", "heading", 2.0), ("EX1.a5", "bench 1", 7.0)]
    assert case.notes[0] == "1 reading stands in several files alike, and count once."


@pytest.mark.parametrize(("last", "said"), [(4.7, True), (4.8, False)])
def test_a_column_that_was_copied_is_named(read, last, said):
    rows = [f"{gauge},2024-03-{day:02d},{value},mm"
            for gauge, end in (("EX1.a5", 4.7), ("CV1", last))
            for day, value in ((2, 1.2), (9, 2.9), (16, 3.1), (23, end))]  # fmt: skip
    case = read(
        DATES + "{file: r.csv, repeated_readings: all}",
        files={"r.csv": "gauge,date,value,unit\n" + "\n".join(rows) + "\n"},
    )
    assert any("EX1.a5, CV1 have the same 4 readings" in note for note in case.notes) is said


# Calibrations


def test_frequencies_become_readings_by_the_formula_of_the_data_sheet(read):
    """By hand: R = f^2/1000, R0 - R = 9000 - 8410 = 590 digits, times 0.002 mm = 1.18 mm."""
    text = "date,EX1.a5 (Hz)\n2024-03-02,2900\n"
    calibration = "{reads: Hz, factor: 0.002 mm, zero: 3000, difference: zero - reading}"
    case = read(
        DATES
        + "{file: r.csv, layout: wide, channels: {EX1.a5: {calibration: "
        + calibration
        + "}}}",
        files={"r.csv": text},
    )
    assert values(case) == [("EX1.a5", "heading", 1.18)]


def test_polynomials_and_temperatures_of_the_sensor(read):
    """By hand: 10 - 0.001 x 8000 + 1e-8 x 8000^2 = 2.64 mm, plus 0.05 x (14 - 10.5) = 0.175."""
    text = "gauge,stage,value,unit,T\nP,heading,8000,digits,14\n"
    calibration = (
        "{reads: digits, polynomial: [10 mm, -1e-3 mm, 1e-8 mm], thermal: 0.05 mm, "
        "temperature: T, zero_temperature: 10.5 degC}"
    )
    case = read(
        "readings: {file: r.csv, channels: {EX1.a5: {name: P, sign: -1, calibration: "
        + calibration + "}}}",
        files={"r.csv": text},
    )  # fmt: skip
    assert values(case) == [("EX1.a5", "heading", -2.815)]


def test_the_accuracy_of_a_frequency_is_carried_through():
    known = Calibration("Hz", (3.0, -0.2, 1e-5), zero=2900.0)
    h = 1e-3
    slope = (known.reading(2800.0 + h) - known.reading(2800.0 - h)) / (2 * h)
    assert known.slope(2800.0) == pytest.approx(slope, rel=1e-8)
    assert known.reading(2900.0) == 0.0


@pytest.mark.parametrize(
    ("calibration", "words"),
    [
        ("{reads: Hz}", "found neither; expected factor, zero and difference, or polynomial"),
        ("{reads: Hz, factor: 1 mm}", "found factor; expected factor, zero and difference, or"),
        (
            "{reads: Hz, factor: 1 mm, zero: 3}",
            "found factor and zero; expected factor, zero and difference",
        ),
        ("{reads: Hz, polynomial: [1 mm, 1 kPa]}", "'1 kPa' is a pressure, '1 mm' a length"),
        (
            "{reads: Hz, polynomial: [1 mm, 1 mm], thermal: 1 mm}",
            "found thermal; expected thermal, temperature and",
        ),
        ("{reads: Hz, polynomial: [1 kPa, 1 kPa]}", "the calibration gives a pressure, 'EX1.a5'"),
        ("{reads: digits, polynomial: [1 mm, 1 mm]}", "'Hz' is not what the calibration is for"),
        (
            "{reads: Hz, polynomial: [1 mm, 1 mm], thermal: 1 mm, temperature: t, "
            "zero_temperature: 1 degC}",
            "there is no column 't', the temperature of 'EX1.a5'",
        ),
    ],
)
def test_what_is_wrong_with_a_calibration_is_said(refused, calibration, words):
    channels = f"channels: {{EX1.a5: {{calibration: {calibration}}}}}"
    faults = refused(
        f"{DATES}{{file: r.csv, layout: wide, {channels}}}",
        files={"r.csv": "date,EX1.a5 (Hz)\n2024-03-02,2900\n"},
    )
    assert any(words in fault.message for fault in faults), faults


# Coordinates


def test_axes_of_an_azimuth_are_right_handed():
    for plane in (True, False):
        axes = np.array(axes_of_azimuth(0.7, plane=plane))
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        np.testing.assert_allclose(axes[1 if plane else 2], (0, 0, 1))
    np.testing.assert_allclose(axes_of_azimuth(math.pi / 2, plane=False)[0], (1, 0, 0), atol=1e-15)


def test_a_scale_and_an_origin_place_the_coordinates():
    """By hand: 4 m east and 3 m north of the origin, x to the north: x = 3, y = -4, in 1/0.5."""
    survey = SurveyGrid(axes_of_azimuth(0.0, plane=False), 2.0, (100.0, 200.0, 50.0))
    np.testing.assert_allclose(survey.position((104.0, 203.0, 51.0)), (6.0, -8.0, 2.0), atol=1e-12)


POINTS = """\
Point;Date;E (m);N (m);H (m);Remarks
P7;20.02.2024;1003.0000;2004.0000;51.0000;installed
P9;20.02.2024;1.0;2.0;3.0;
P7;25.02.2024;1003.0005;2004.0000;51.0000;
P7;02.03.2024;1003.0060;2004.0080;50.9950;
P7;02.04.2024;1003.0060;2004.0080;;prism turned
"""
GAUGES = """\
gauges:
  S: {kind: settlement, point: [5 m, 1 m], accuracy: 0.5 mm}
  T: {kind: target, point: [5 m, 1 m], components: [across, up], accuracy: 0.5 mm}
"""
SURVEY = (
    DATES + "{file: p.csv, layout: coordinates, delimiter: ';', date_format: DD.MM.YYYY,\n"
    "  columns: {east: E, north: N, height: H}, channels: {S: P7, T: {name: P7}},\n"
    "  transformation: {axes: {x: [3, 4, 0], y: [0, 0, 1]}, origin: [1000, 2000, 50 m]}}"
)


def test_coordinates_become_the_components_of_targets(read):
    """By hand: (6, 8, -5) mm along (0.6, 0.8, 0) is 10 mm; heights lack in April."""
    case = read(SURVEY, files={"p.csv": POINTS}, changes=[("gauges:\n", GAUGES)])
    assert values(case) == [
        ("S", "heading", 5.0),
        ("T.across", "heading", 10.0),
        ("T.up", "heading", -5.0),
        ("S", "bench 1", None),
        ("T.across", "bench 1", 10.0),
        ("T.up", "bench 1", None),
    ]
    assert [r.note for r in case.readings if r.stage == "bench 1"] == ["prism turned"] * 3


def test_the_zero_of_coordinates_is_their_first_epoch_at_the_zero_of_the_gauge(read):
    gauges = GAUGES.replace("0.5 mm", "0.5 mm, zero: heading")
    case = read(SURVEY, files={"p.csv": POINTS}, changes=[("gauges:\n", gauges)])
    assert values(case)[1] == ("T.across", "bench 1", 0.0)


def test_an_azimuth_and_a_scale_turn_coordinates(read):
    """By hand: x points at atan2(3, 4) from north; a projection of 0.5 doubles what is surveyed."""
    azimuth = math.degrees(math.atan2(3, 4))
    survey = SURVEY.replace("axes: {x: [3, 4, 0], y: [0, 0, 1]}, origin: [1000, 2000, 50 m]",
                            f"azimuth: {azimuth} deg, scale: 0.5")  # fmt: skip
    case = read(survey, files={"p.csv": POINTS}, changes=[("gauges:\n", GAUGES)])
    assert values(case)[:3] == [
        ("S", "heading", 10.0),
        ("T.across", "heading", 20.0),
        ("T.up", "heading", -10.0),
    ]


@pytest.mark.parametrize(
    ("old", "new", "words", "hint"),
    [
        ("S: P7", "Q: P7", "there is no gauge 'Q' whose point is surveyed", "Gauges of points"),
        ("T: {name: P7}", "T: {name: P7, sign: -1}", "a point of coordinates has a name only", ""),
        (", channels: {S: P7, T: {name: P7}}", "", "there is no target 'P7'", "channels: {TARGET"),
        ("height: H", "height: Z", "columns missing in the header: z", "columns: {point: NAME"),
        ("x: [3, 4, 0]", "x: [3, 4, 1]", "the axes x and y are not at right angles", "Correct"),
        ("x: [3, 4, 0], y", "x: [3, 4], y", "the axis x is not a vector of", "[0.6, 0.8, 0]"),
        ("axes: {x: [3, 4, 0], y: [0, 0, 1]}, ", "", "found neither; expected azimuth", ""),
        ("  transformation:", "  #", "'transformation' is missing", "azimuth: 37.5 deg"),
        ("[1000, 2000, 50 m]", "[1000, 2000, 60 m]", "the case has 'S' at (5, 1) m, the survey "
         "'P7' at (5, -9) m", "Correct the origin, the axes or the point"),
        ("layout: coordinates", "layout: long", "a transformation belongs to the layout of", ""),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_survey_is_said(refused, old, new, words, hint):
    survey = SURVEY.replace(old, new)
    survey = survey.replace("H},\n  #", "H}}\n#") if new == "  #" else survey
    survey = survey.replace("{name: P7}},\n  #", "{name: P7}}}\n  #")
    faults = refused(survey, files={"p.csv": POINTS}, changes=[("gauges:\n", GAUGES)])
    assert any(words in f.message and hint in f.hint for f in faults), faults


# AGS4

AGS = """\
"GROUP","MONG"
"HEADING","LOCA_ID","MONG_ID","MONG_DIS","MONG_TYPE"
"UNIT","","","m",""
"TYPE","ID","X","2DP","PA"
"DATA","BH7","VW1","5.00","SPIE"
"DATA","BH7","VW2","9.00","SPIE"

"GROUP","MOND"
"HEADING","LOCA_ID","MONG_ID","MONG_DIS","MOND_DTIM","MOND_TYPE","MOND_REF","MOND_RDNG","MOND_UNIT","MOND_REM"
"UNIT","","","m","yyyy-mm-ddThh:mm:ss","","","","",""
"TYPE","ID","X","2DP","DT","PA","X","XN","PU","X"
"DATA","BH7","VW1","5.00","2024-03-02T08:00:00","FREQ","1","2900","Hz","18 °C"
"DATA","BH7","VW1","5.00","2024-04-02T08:00:00","FREQ","1","Dry","Hz",""
"DATA","BH7","VW1","5.00","2024-04-02T08:00:00","TEMP","1","12","degC",""
"""
WIRE = "calibration: {reads: Hz, factor: 0.002 mm, zero: 3000, difference: zero - reading}"


def test_ags_files_of_several_months_with_frequencies_and_remarks(read):
    pytest.importorskip("python_ags4", reason="needs pip install --no-deps python-ags4")
    april = AGS.replace("2024-03-02", "2024-04-02").replace("2900", "2800").replace('"Dry"', '""')
    case = read(
        DATES + "{file: [m.ags, a.ags], encoding: cp1252, blank: [Dry],\n"
        f"  channels: {{EX1.a5: {{MONG_ID: VW1, MOND_TYPE: FREQ, {WIRE}}}}}}}",
        files={"m.ags": AGS.encode("cp1252"), "a.ags": april.encode("cp1252")},
    )
    assert values(case) == [("EX1.a5", "heading", 1.18), ("EX1.a5", "bench 1", 2.32)]
    assert case.readings[0].note == "18 °C"


@pytest.mark.parametrize(
    ("channel", "text", "words", "hint"),
    [
        (
            f"{{MONG_ID: VW1, {WIRE}}}",
            AGS,
            "have several MOND_TYPE: FREQ, TEMP",
            "MOND_TYPE: 'FREQ'",
        ),
        ("{MONG_ID: VW2}", AGS, "no row of group MOND has MONG_ID VW2", "MONG has MONG_ID VW2"),
        ("{MONG_ID: VW1, MOND_TYPE: FREQ}", AGS, "'Hz' is what the sensor gives", "calibration"),
        (
            f"{{MONG_ID: VW1, MOND_TYPE: FREQ, {WIRE}}}",
            AGS.replace('04-02T08:00:00","FREQ","1"', '03-02T08:00:00","FREQ","2"'),
            "the rows of 'EX1.a5' have several MOND_REF: 1, 2",
            "MOND_REF: '1'",
        ),
    ],
)
def test_rows_of_ags_files_must_be_of_one_instrument(refused, channel, text, words, hint):
    pytest.importorskip("python_ags4", reason="needs pip install --no-deps python-ags4")
    faults = refused(
        f"{DATES}{{file: m.ags, blank: [Dry], channels: {{EX1.a5: {channel}}}}}",
        files={"m.ags": text},
    )
    assert any(words in f.message and hint in f.hint for f in faults), faults


def test_an_ags_file_named_alone_is_asked_what_is_whose(refused):
    """It ended in a traceback: a file by its name was held against what only a section can say."""
    pytest.importorskip("python_ags4", reason="needs pip install --no-deps python-ags4")
    (fault,) = refused("readings: m.ags", files={"m.ags": AGS.encode()})
    assert fault.code == "no-channels"
    assert "channels: {CHANNEL: {MONG_ID: ...}}" in fault.hint


# Whatever the cells are

cells = st.text(max_size=6) | st.sampled_from(
    ["point", "date", "E (m)", "N", "H", "gauge", "CV1 (Hz)", "2024-03-02", "1.5", "P1", "x", "T"]
)
SENSOR = Calibration("Hz", (0.0, 1.0), zero=2.0, thermal=1.0, temperature="T")
LAYOUTS = [
    Layout(survey=SurveyGrid(axes_of_azimuth(0.3, plane=True), targets={}), unit="m",
           columns={"east": "E", "north": "N", "height": "H"}),
    Layout(wide=True, header_rows=2, unit_row=True, blank=("x",), ignore=("P1",), data_row=4),
    Layout(channels={"CV1": Origin(calibration=SENSOR)}, header_row=2, encoding="cp1252"),
    Layout(wide=True, channels={"CV1": Origin(calibration=SENSOR)}),
]  # fmt: skip


@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(rows=st.lists(st.lists(cells, max_size=5), max_size=5), layout=st.sampled_from(LAYOUTS))
def test_any_cells_end_with_readings_or_faults(rows, layout):
    text = "\n".join(",".join(row) for row in rows)
    with contextlib.suppress(InputError):
        parse_readings(text.encode("utf-8", "ignore"), "r.csv", layout)


@settings(max_examples=30, deadline=None)
@given(
    azimuth=st.floats(-7, 7),
    moved=st.tuples(*[st.floats(-1, 1)] * 3),
    plane=st.booleans(),
    scale=st.floats(0.5, 2),
)
def test_a_turned_motion_keeps_its_length(azimuth, moved, plane, scale):
    turned = SurveyGrid(axes_of_azimuth(azimuth, plane=plane), scale).turned(moved)
    assert math.hypot(*turned) == pytest.approx(scale * math.hypot(*moved), rel=1e-12)
    assert turned[1 if plane else 2] == scale * moved[2]


def test_what_is_read_twice_in_one_file_counts_twice_and_a_later_flag_holds(read):
    analysis = "gauge,stage,value,unit,bad\nEX1.a5,heading,1,mm,\nEX1.a5,heading,1,mm,\n"
    analysis += "EX1.a5,heading,4,mm,\nCV1,bench 1,5,mm,\n"
    april = "gauge,stage,value,unit,bad\nCV1,bench 1,5,mm,hit by blast\n"
    case = read(
        "readings: {file: [m.csv, a.csv], repeated_readings: mean}",
        files={"m.csv": analysis, "a.csv": april},
    )
    assert values(case) == [("EX1.a5", "heading", 2.0), ("CV1", "bench 1", 5.0)]
    assert [r.bad for r in case.readings] == ["", "hit by blast"]


def test_ags_files_have_no_temperature_for_a_calibration(refused):
    wire = WIRE.replace("}", ", thermal: 0.05 mm, temperature: T, zero_temperature: 10 degC}")
    (fault,) = refused(
        f"{DATES}{{file: m.ags, channels: {{EX1.a5: {{MONG_ID: VW1, {wire}}}}}}}",
        files={"m.ags": AGS},
    )
    assert fault.message == (
        "an AGS file has no column with the temperature of the sensor of 'EX1.a5'"
    )
    assert fault.path == "readings.channels.EX1.a5.calibration.thermal"


def test_a_zero_temperature_is_that_of_the_column(refused):
    wire = WIRE.replace("}", ", thermal: 0.05 mm, temperature: T, zero_temperature: 283 K}")
    (fault,) = refused(
        f"{DATES}{{file: r.csv, layout: wide, channels: {{EX1.a5: {{{wire}}}}}}}",
        files={"r.csv": "date,EX1.a5 (Hz),T\n2024-03-02,2900,10\n"},
    )
    assert fault.message == "'283 K' is in kelvin; the column is in degrees Celsius"


def test_coordinates_of_a_point_are_no_motion_against_another(refused):
    gauges = GAUGES.replace("components:", "relative_to: [0 m, 9 m], components:")
    (fault,) = refused(SURVEY, files={"p.csv": POINTS}, changes=[("gauges:\n", gauges)])
    assert fault.path == "gauges.T.relative_to"
    assert fault.message == "'T' is read relative to a point; coordinates are of its own point"


def test_many_decimal_commas_are_one_fault_with_the_key_that_declares_them(read, refused):
    rows = ["CV1;bench 1;1,25;mm", "EX1.a5;bench 1;-2,5;mm", "EX1.a5;heading;0,75;mm"]
    files = {"r.csv": "\n".join(["gauge;stage;value;unit", *rows])}
    described = 'readings: {file: r.csv, delimiter: ";"%s}'
    (fault,) = refused(described % "", files=files)
    assert (fault.location.line, fault.location.column) == (2, 13)
    assert "'1,25' and 2 more numbers of the file have a comma" in fault.message
    assert 'declare it: readings: {file: ..., decimal: ","}' in fault.hint
    assert len(read(described % ', decimal: ","', files=files).readings) == 3


def test_a_date_format_of_another_language_is_said_in_the_one_of_a_case(refused):
    (fault,) = refused("readings: {file: r.csv, date_format: '%d.%m.%Y'}", files={"r.csv": ""})
    assert (fault.code, fault.hint) == ("bad-date-format", "Here it is written DD.MM.YYYY.")
