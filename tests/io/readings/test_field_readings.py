"""Readings as they come from the field: described files, dates, several in a stage, bad ones."""

from pathlib import Path

import pytest

from geoident.errors import InputError
from geoident.io.text.dates import read_date

DATES = "dates: {heading: 2024-03-01, bench 1: 2024-04-01}\nreadings: "


@pytest.fixture
def read(project, changed):
    """Read the sound case with a description of readings in place of its own."""

    def read(description, *, files=None, more=""):
        for name, text in (files or {}).items():
            Path(project.folder, name).write_text(text, encoding="utf-8")
        return project.read(changed("readings: readings.csv", description) + more).case

    return read


@pytest.fixture
def refused(read):
    def refused(description, **options):
        with pytest.raises(InputError) as caught:
            read(description, **options)
        return caught.value.faults

    return refused


def values(case):
    """(channel, stage, mm) of the good readings."""
    return [
        (r.channel, r.stage, None if r.value is None else pytest.approx(1e3 * r.value))
        for r in case.readings
        if not r.bad
    ]


# Delimiters and decimal marks are declared


SHEET = "gauge;stage;value;unit\nEX1.a5;heading;1,25;mm\nCV1;bench 1;-0,3;cm\n"


def test_semicolons_and_decimal_commas_are_read_if_declared(read):
    case = read(
        "readings: {file: r.csv, delimiter: ;, decimal: ','}".replace(": ;", ": ';'"),
        files={"r.csv": SHEET},
    )
    assert values(case) == [("EX1.a5", "heading", 1.25), ("CV1", "bench 1", -3.0)]


def test_semicolons_that_are_not_declared_are_refused_with_what_to_declare(refused):
    (fault,) = refused("readings: {file: r.csv}", files={"r.csv": SHEET})
    assert (fault.code, fault.location.line) == ("bad-header", 1)
    assert "delimiter: ';'" in fault.hint


def test_a_decimal_comma_that_is_not_declared_stays_an_error(refused):
    (fault,) = refused("readings: {file: r.csv, delimiter: ';'}", files={"r.csv": SHEET})
    place = fault.code, fault.location.line, fault.location.column
    assert place == ("bad-number", 2, 16)
    assert 'decimal: ","' in fault.hint


@pytest.mark.parametrize("number", ["1.25", "1.234,5", "1,2,3", "1 2", "nan", "1,5 mm"])
def test_only_numbers_with_a_comma_are_numbers_where_commas_are_declared(refused, number):
    text = f"gauge;stage;value;unit\nCV1;bench 1;{number};mm\n"
    (fault,) = refused(
        "readings: {file: r.csv, delimiter: ';', decimal: ','}", files={"r.csv": text}
    )
    assert (fault.location.line, fault.location.column) == (2, 13)
    assert "decimal comma" in fault.message


def test_a_comma_cannot_be_both(refused):
    (fault,) = refused("readings: {file: readings.csv, decimal: ','}")
    assert (fault.code, fault.path) == ("contradiction", "readings.decimal")


def test_tabs_and_own_names_of_columns(read):
    text = "Ort\tInstrument\tGroesse\tBauzustand\n-\tEX1.a5\t2,5\theading\n"
    case = read(
        "readings: {file: r.txt, delimiter: tab, decimal: ',', unit: cm,\n"
        "  columns: {gauge: Instrument, value: Groesse, stage: Bauzustand}}",
        files={"r.txt": text},
    )
    assert values(case) == [("EX1.a5", "heading", 25.0)]


def test_channels_have_other_names_signs_and_units_in_the_file(read):
    text = "gauge,stage,value\nE1/5,heading,-0.25\nother,heading,9\nTape,bench 1,3\n"
    case = read(
        "readings: {file: r.csv, unit: mm,\n"
        "  channels: {EX1.a5: {name: E1/5, unit: cm, sign: -1}, CV1: Tape}}",
        files={"r.csv": text},
    )
    assert values(case) == [("EX1.a5", "heading", 2.5), ("CV1", "bench 1", 3.0)]


def test_a_channel_that_is_not_renamed_is_read_by_its_own_name(read):
    text = "gauge,stage,value\nE1/5,heading,0.25\nother,heading,9\nCV1,bench 1,3\n"
    renamed = "unit: mm, channels: {EX1.a5: E1/5}}"
    case = read(f"readings: {{file: r.csv, {renamed}", files={"r.csv": text})
    assert values(case) == [("EX1.a5", "heading", 0.25), ("CV1", "bench 1", 3.0)]
    text = "date,E1/5,CV1,weather\n2024-03-01,0.5,2,rain\n"
    case = read(f"{DATES}{{file: r.csv, layout: wide, {renamed}", files={"r.csv": text})
    assert values(case) == [("EX1.a5", "heading", 0.5), ("CV1", "heading", 2.0)]


# One column a channel


WIDE = "date,EX1.a5 (mm),CV1 [cm],note\n2024-03-01,0.5,0,\n2024-04-02,,1.5,rain\n"


def test_wide_tables_have_their_units_in_the_header(read):
    case = read(
        DATES + "{file: r.csv, layout: wide, channels: {EX1.a5: EX1.a5, CV1: CV1}}",
        files={"r.csv": WIDE},
    )
    assert values(case) == [
        ("EX1.a5", "heading", 0.5),
        ("CV1", "heading", 0.0),
        ("EX1.a5", "bench 1", None),
        ("CV1", "bench 1", 15.0),
    ]


@pytest.mark.parametrize(
    ("text", "words", "at"),
    [
        ("date,,CV1 (mm)\n2024-03-01,,1\n2024-03-02,5,1\n", "column 2 has no name", (3, 12)),
        ("2024-03-01,1\n2024-03-02,2\n", "is not a header", (1, 1)),
    ],
)
def test_a_wide_table_needs_names_above_its_cells(refused, text, words, at):
    (fault,) = refused(DATES + "{file: r.csv, layout: wide}", files={"r.csv": text})
    assert words in fault.message
    assert (fault.location.line, fault.location.column) == at


def test_wide_tables_may_have_a_row_of_units_and_stages(read):
    text = "stage;EX1.a5;CV1\n;mm;[cm]\nheading;0,5;\nbench 1;1;2\n"
    case = read(
        "readings: {file: r.csv, layout: wide, unit_row: true, delimiter: ';', decimal: ','}",
        files={"r.csv": text},
    )
    assert values(case)[0] == ("EX1.a5", "heading", 0.5)
    assert values(case)[-1] == ("CV1", "bench 1", 20.0)


def test_a_column_without_unit_is_refused_at_its_place(refused):
    (fault,) = refused(
        DATES + "{file: r.csv, layout: wide}", files={"r.csv": "date,EX1.a5\n2024-03-01,1\n"}
    )
    assert (fault.code, fault.location.line, fault.location.column) == ("unit", 1, 6)
    assert "EX1.a5 (mm)" in fault.hint


def test_a_column_that_is_not_there_is_refused_with_the_nearest(refused):
    (fault,) = refused(
        DATES + "{file: r.csv, layout: wide, channels: {CV1: CV-1}}", files={"r.csv": WIDE}
    )
    assert "no column 'CV-1'" in fault.message


# Dates


DATED = """\
gauge,date,value,unit
EX1.a5,2024-02-28,0.0,mm
EX1.a5,2024-03-01,1.0,mm
EX1.a5,2024-03-31 23:59,2.0,mm
EX1.a5,2024-04-01,4.0,mm
EX1.a5,2024-05-01,6.0,mm
CV1,2024-02-01,7.0,mm
CV1,2024-04-03,3.0,mm
"""


def test_a_reading_belongs_to_the_last_stage_complete_at_its_date(read):
    case = read(DATES + "{file: r.csv}", files={"r.csv": DATED})
    assert values(case) == [
        ("EX1.a5", "heading", 2.0),
        ("EX1.a5", "bench 1", 6.0),
        ("CV1", "bench 1", 3.0),
    ]
    assert case.readings[1].time == read_date("2024-05-01")
    assert case.dates == {"heading": read_date("2024-03-01"), "bench 1": read_date("2024-04-01")}


def test_of_readings_of_one_date_the_last_in_the_file_counts(read):
    text = "gauge,date,value,unit\n" + "".join(
        f"EX1.a5,{date},{value},mm\n"
        for date, value in (("2024-03-09", 1), ("2024-03-09", 2), ("2024-03-05", 3))
    )
    assert values(read(DATES + "r.csv", files={"r.csv": text})) == [("EX1.a5", "heading", 2.0)]


def test_readings_before_the_zero_are_counted_not_dropped_in_silence(read):
    case = read(DATES + "{file: r.csv}", files={"r.csv": DATED})
    assert case.notes[:2] == (
        "1 reading of EX1.a5 before the first stage left out.",
        "1 reading of CV1 before its zero at the end of 'heading' (2024-03-01) left out.",
    )


def test_the_mean_has_the_accuracy_of_one_by_the_root_of_their_number(read):
    case = read(DATES + "{file: r.csv, repeated_readings: mean}", files={"r.csv": DATED})
    assert values(case)[:2] == [("EX1.a5", "heading", 1.5), ("EX1.a5", "bench 1", 5.0)]
    anchor = case.channels[0]
    assert anchor.sd(case.readings[0]) == pytest.approx(1e-4 / 2**0.5)
    assert case.readings[0].epochs == 2  # days
    assert case.readings[1].time == pytest.approx(read_date("2024-04-16"))
    assert case.readings[2].accuracy is None


def test_all_readings_of_a_stage_may_count(read):
    case = read(DATES + "{file: r.csv, repeated_readings: all}", files={"r.csv": DATED})
    assert [v[2] for v in values(case)] == [1.0, 2.0, 4.0, 6.0, 3.0]


def test_the_earlier_name_of_repeated_readings_is_read_and_noted(read, refused):
    case = read(DATES + "{file: r.csv, several: all}", files={"r.csv": DATED})
    assert [v[2] for v in values(case)] == [1.0, 2.0, 4.0, 6.0, 3.0]
    assert "the key 'several' of the readings is called 'repeated_readings' now" in case.notes
    both = DATES + "{file: r.csv, several: all, repeated_readings: mean}"
    (fault,) = refused(both, files={"r.csv": DATED})
    assert "both are given" in fault.message
    assert fault.path.endswith("several")


def test_what_was_read_at_zero_is_subtracted_if_asked_for(read):
    text = DATED.replace("CV1,2024-02-01", "CV1,2024-03-02")
    case = read(DATES + "{file: r.csv, rezero: true}", files={"r.csv": text})
    assert values(case) == [
        ("EX1.a5", "heading", 2.0),
        ("EX1.a5", "bench 1", 6.0),
        ("CV1", "bench 1", -4.0),
    ]


def test_gauges_that_read_a_value_have_no_zero_to_subtract(read):
    gauges = (
        "  PC: {kind: pressure-cell, point: [15, 3 m], normal: [1, 0], accuracy: 10 kPa}\n"
        "  PZ: {kind: pressure-cell, point: [15, 3 m], normal: [0, 1], accuracy: 10 kPa, "
        "zero: virgin}\n"
        "  O: {kind: stress, point: [20, 3 m], components: [yy], state: virgin, "
        "accuracy: 0.1 MPa}\n"
    )
    text = (
        "gauge,date,value,unit\nPC,2024-02-28,7,MPa\nPC,2024-03-05,4,MPa\nPZ,2024-02-28,8,MPa\n"
        "PZ,2024-03-05,9,MPa\nO.yy,2024-02-20,-8,MPa\nEX1.a5,2024-02-28,1,mm\n"
        "EX1.a5,2024-03-05,3,mm\n"
    )
    case = read(gauges + DATES + "{file: r.csv, rezero: true}", files={"r.csv": text})
    assert [(r.channel, r.stage, pytest.approx(r.value)) for r in case.readings] == [
        ("PC", "heading", 4e6),
        ("PZ", "heading", 1e6),
        ("O.yy", "heading", -8e6),
        ("EX1.a5", "heading", 2e-3),
    ]
    shared = {c.name: c.errors is not None and c.errors.zero for c in case.channels}
    assert shared["PZ"] == pytest.approx(1e4)
    assert not shared["PC"]


def test_a_mean_of_differences_has_the_error_of_the_zero_once(read):
    text = "gauge,date,value,unit,accuracy\nEX1.a5,2024-02-28,0,mm,0.3\n"
    text += "".join(f"EX1.a5,2024-03-0{day},2,mm,0.4\n" for day in range(1, 5))
    description = "{file: r.csv, rezero: true, several: SEVERAL}"
    for several, sd in (("mean", 0.2), ("last", 0.4), ("all", 0.4)):
        case = read(DATES + description.replace("SEVERAL", several), files={"r.csv": text})
        (anchor,) = {c for c in case.channels if c.name == "EX1.a5"}
        accuracies = {round(1e3 * anchor.sd(r), 9) for r in case.readings}
        assert accuracies == {round((0.3**2 + sd**2) ** 0.5, 9)}
        assert anchor.errors.zero == pytest.approx(3e-4)  # of all of them


def test_a_zero_that_is_flagged_is_not_subtracted(refused):
    text = "gauge,date,value,unit,bad\nEX1.a5,2024-02-28,7,mm,bumped\nEX1.a5,2024-03-05,9,mm,\n"
    (fault,) = refused(DATES + "{file: r.csv, rezero: true}", files={"r.csv": text})
    assert fault.code == "no-zero-reading"


def test_without_a_reading_at_zero_nothing_can_be_subtracted(refused):
    text = DATED.replace("EX1.a5,2024-02-28,0.0,mm\n", "")
    (fault, other) = refused(DATES + "{file: r.csv, rezero: true}", files={"r.csv": text})
    assert {fault.code, other.code} == {"no-zero-reading"}
    assert "'EX1.a5' was not read at its zero, 'virgin'" in {fault.message, other.message}


def test_dates_have_the_declared_format(read, refused):
    text = "gauge,date,value,unit\nEX1.a5,02.03.2024 14:30,1,mm\n"
    case = read(DATES + "{file: r.csv, date_format: DD.MM.YYYY hh:mm}", files={"r.csv": text})
    assert case.readings[0].time == read_date("2024-03-02 14:30")
    (fault,) = refused(DATES + "{file: r.csv}", files={"r.csv": text})
    assert (fault.code, fault.location.line, fault.location.column) == ("bad-date", 2, 8)
    assert "date_format" in fault.hint


@pytest.mark.parametrize(
    ("description", "path", "words"),
    [
        (DATES + "{file: r.csv, date_format: DD.MM.YY}", "readings.date_format", "four digits"),
        (DATES + "{file: r.csv, date_format: '%d'}", "readings.date_format", "made of"),
        (
            DATES + "{file: r.csv, date_format: DD.MM.YYYY hh hh}",
            "readings.date_format",
            "more than once",
        ),
        (DATES + "{file: r.csv, unit: m/s2}", "readings.unit", "not a unit of length"),
        (DATES + "{file: r.csv, columns: {gage: G}}", "readings.columns.gage", "no column 'gage'"),
        (DATES + "{file: r.csv, channels: {EX1: E}}", "readings.channels.EX1", "no gauge 'EX1'"),
        (DATES + "{file: r.csv, several: first}", "readings.several", "expected last, mean, all"),
        (DATES + "{fil: r.csv}", "readings.fil", "not known here"),
        (DATES + "{file: s.csv}", "readings.file", "no file"),
        ("dates: {bench: 2024-03-01}\nreadings: r.csv", "dates.bench", "no stage 'bench'"),
        ("dates: {heading: 1.3.2024}\nreadings: r.csv", "dates.heading", "not a date of the form"),
        (
            "dates: {heading: 2024-05-01, bench 1: 2024-04-01}\nreadings: r.csv",
            "dates.bench 1",
            "ends before 'heading' (2024-05-01)",
        ),
        ("readings: {file: r.csv}", "readings.file", "the stages have none"),
    ],
)
def test_what_is_wrong_in_a_description_is_said_at_its_key(refused, description, path, words):
    faults = refused(description, files={"r.csv": DATED})
    fault = next(fault for fault in faults if words in fault.message)
    assert fault.path == path
    assert fault.location.line > 0


# Several files, and bad readings


def test_several_files_and_single_readings_go_together(read):
    case = read(
        DATES + "\n"
        "  - {file: r.csv, repeated_readings: last}\n"
        "  - tape.csv\n"
        "  - {gauge: CV1, stage: bench 1, value: 3 mm}\n",
        files={
            "r.csv": DATED[: DATED.index("CV1")],
            "tape.csv": "gauge,stage,value,unit\nCV1,heading,0,mm\n",
        },
    )
    assert [v[0] for v in values(case)] == ["EX1.a5", "EX1.a5", "CV1", "CV1"]


def test_one_reading_in_two_files_is_refused(refused):
    text = "gauge,stage,value,unit\nCV1,bench 1,1,mm\n"
    (fault,) = refused("readings: [a.csv, b.csv]", files={"a.csv": text, "b.csv": text})
    assert fault.code == "duplicate-reading"
    assert "a.csv:2:1" in fault.message


def test_two_readings_of_a_stage_need_a_word_on_what_to_do_with_them(read, refused):
    text = "gauge,stage,value,unit\nCV1,bench 1,1,mm\nCV1,bench 1,3,mm\n"
    (fault,) = refused("readings: r.csv", files={"r.csv": text})
    assert fault.code == "duplicate-reading"
    case = read("readings: {file: r.csv, repeated_readings: mean}", files={"r.csv": text})
    assert values(case) == [("CV1", "bench 1", 2.0)]


def test_bad_readings_are_kept_with_their_reason_and_not_counted(read):
    text = DATED.replace("unit\n", "unit,bad\n", 1).replace("6.0,mm", "6.0,mm,head hit by blast")
    text = text.replace("4.0,mm", "4.0,mm,no").replace("3.0,mm", "3.0,mm,x")
    case = read(DATES + "{file: r.csv}", files={"r.csv": text})
    assert values(case) == [("EX1.a5", "heading", 2.0), ("EX1.a5", "bench 1", 4.0)]
    assert [(r.channel, r.bad) for r in case.readings if r.bad] == [
        ("EX1.a5", "head hit by blast"),
        ("CV1", "flagged in the file"),
    ]


@pytest.mark.parametrize(
    ("entry", "flags"),
    [
        ("{gauge: EX1.a5, stage: heading, reason: hit}", ["hit", "", ""]),
        ("{gauge: EX1, reason: hit}", ["hit", "hit", ""]),
        ("{gauge: CV1, stage: bench 1, reason: tape}", ["", "", "tape"]),
    ],
)
def test_the_case_lists_bad_readings(read, entry, flags):
    case = read("readings: readings.csv", more=f"bad: [{entry}]\n")
    assert [reading.bad for reading in case.readings] == flags


def test_a_bad_reading_of_nothing_is_refused(refused):
    more = "bad: [{gauge: EX7, reason: a}, {gauge: CV1, stage: bench, reason: b}]\n"
    faults = refused("readings: readings.csv", more=more)
    assert [fault.path for fault in faults] == ["bad[0].gauge", "bad[1].stage"]


# AGS4


AGS = """\
"GROUP","MOND"
"HEADING","LOCA_ID","MONG_ID","MONG_DIS","MOND_DTIM","MOND_TYPE","MOND_RDNG","MOND_UNIT"
"UNIT","","","m","dd/mm/yyyy hh:mm","","",""
"TYPE","ID","X","2DP","DT","PA","XN","PU"
"DATA","BH7","EXT1","5.00","02/03/2024 08:00","DSPA","-1.5","mm"
"DATA","BH7","EXT1","15.00","02/03/2024 08:00","DSPA","-9","mm"
"DATA","BH7","EXT1","5.00","03/04/2024 08:00","DSPA","-0.25","cm"
"DATA","BH7","EXT1","5.00","04/04/2024 08:00","TEMP","17","degC"
"""
CHANNEL = "{LOCA_ID: BH7, MONG_ID: EXT1, MONG_DIS: '5', MOND_TYPE: DSPA, sign: -1}"


def test_monitoring_groups_of_ags_files(read):
    pytest.importorskip("python_ags4", reason="needs pip install --no-deps python-ags4")
    case = read(
        f"{DATES}{{file: m.ags, channels: {{EX1.a5: {CHANNEL}}}}}",
        files={"m.ags": AGS.replace("\n", "\r\n")},
    )
    assert values(case) == [("EX1.a5", "heading", 1.5), ("EX1.a5", "bench 1", 2.5)]
    assert case.readings[0].time == read_date("2024-03-02 08:00")
    assert case.readings[0].location.line == 5


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("MONG_ID: EXT1", "MONG_ID: EXT2", 0, "no row of group MOND has LOCA_ID BH7, MONG_ID EXT2"),
        ("MOND_TYPE: DSPA", "MOND_REF: a", 0, "no heading MOND_REF"),
        (", MOND_TYPE: DSPA", "", 5, "the rows of 'EX1.a5' have several MOND_TYPE: DSPA, TEMP"),
        (", MONG_DIS: '5'", "", 5, "the rows of 'EX1.a5' have several MONG_DIS: 5.00, 15.00"),
        ("MOND_TYPE: DSPA", "MOND_TYPE: TEMP", 8, "'degC' is the unit of"),
        ('"-1.5"', '"1,5"', 5, "two ways"),
        ('"02/03/2024 08:00","DSPA","-1.5"', '"2024-03-02","DSPA","-1.5"', 5, "not a date of"),
        ('"dd/mm/yyyy hh:mm"', '"dd/mm/dd"', 0, "YYYY must occur in it once"),
        ('"MOND"', '"MONX"', 0, "no group MOND"),
        ('"DATA","BH7"', '"DATA","x","BH7"', 0, "not a readable AGS4 file"),
    ],
)
def test_what_is_wrong_in_an_ags_file_is_said_with_its_line(refused, old, new, line, words):
    pytest.importorskip("python_ags4", reason="needs pip install --no-deps python-ags4")
    channel, text = CHANNEL.replace(old, new), AGS.replace(old, new, 1)
    faults = refused(
        f"{DATES}{{file: m.ags, channels: {{EX1.a5: {channel}}}}}", files={"m.ags": text}
    )
    assert any(words in fault.message and fault.location.line == line for fault in faults), faults


def test_an_ags_file_needs_to_be_told_which_rows_are_whose(refused):
    (fault,) = refused(DATES + "{file: m.ags}", files={"m.ags": AGS})
    assert "'channels' is missing" in fault.message


# Offsets and drifts


def test_gauges_may_have_offset_and_drift_with_units(project, changed):
    text = changed("accuracy: 0.2 mm, zero", "accuracy: 0.2 mm, offset: 1 mm, drift: $d, zero")
    text = text.replace(
        "parameters:", "parameters:\n  d: {start: 0 mm/month, bounds: [-2, 2 mm/month]}"
    )
    text += "dates: {heading: 2024-03-01, bench 1: 2024-04-01}\n"
    channel = project.read(text).case.channels[1]
    assert channel.offset.factor == pytest.approx(1e-3)
    assert channel.drift.parameter == "d"


@pytest.mark.parametrize(
    ("given", "dates", "words"),
    [
        ("drift: 1 mm/month", "", "the stage 'bench 1' has no date"),
        ("drift: 1 mm", "{heading: 2024-03-01, bench 1: 2024-04-01}", "expected a velocity"),
        ("drift: 1 mm/day, drift_per_stage: 1 mm", "", "expected drift, or drift_per_stage"),
        ("offset: $E_rock", "", "expected a length"),
    ],
)
def test_what_is_wrong_with_a_drift_is_said(project, changed, given, dates, words):
    text = changed("accuracy: 0.2 mm, zero", f"accuracy: 0.2 mm, {given}, zero")
    text += f"dates: {dates}\n" if dates else ""
    faults = project.faults(text)
    assert any(words in fault.message for fault in faults), faults


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        (
            "accuracy: 2 kN, offset: $E_rock",
            "'$E_rock' is a pressure (start: 15 GPa); expected a force",
        ),
        ("accuracy: 2 kN, drift: $E_rock", "expected a force rate"),
        (
            "accuracy: 2 kN, drift: 2 kN",
            "'2 kN' is a force; by its accuracy the gauge reads a force",
        ),
        ("accuracy: 2 kN/m, drift: 2 kN/month", "'2 kN/month' is a force rate; by its accuracy"),
    ],
)
def test_what_is_added_to_a_load_cell_is_a_force(project, changed, cell, words):
    """A load cell may read N or N/m, so its accuracy says which; ties are held against it too."""
    gauge = f"gauges:\n  L: {{kind: load-cell, structure: bolts, {cell}}}\n"
    bolts = (
        "structures: {bolts: {kind: bolt, ends: [[[3, 0 m], [7, 0 m]]], EA: 9 MN, spacing: 1 m}}"
    )
    faults = project.faults(changed("gauges:\n", f"{bolts}\n{gauge}"))
    assert any(words in fault.message for fault in faults), faults
