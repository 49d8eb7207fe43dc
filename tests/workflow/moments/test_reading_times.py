"""To which moments readings belong, however times are written, and what the model says there."""

from __future__ import annotations

from datetime import date, timedelta

import numpy as np
import pytest
from support.column import DAY, FILL, settlement, write_column

from geoident.model.case import VIRGIN
from geoident.model.moments import usual_moments
from geoident.workflow.running.jobs import build_model, load_inputs
from geoident.workflow.running.readings import select_readings, times_of
from geoident.workflow.scoring.horizon import Clock

STAGES = f"  - {{name: fill, {FILL}, lasts: 60 d}}\n  - {{name: rest, lasts: 140 d}}"
AT = {"fill + 3 d": 3, "fill + 36 h": 1.5, "fill": 60, "rest + 20 d": 80, "rest": 200}
DAYS = {"fill + 3 d": "fill + 3 d", "fill + 36 h": "fill + 1.5 d"}


def truth_at_start(text: str) -> str:
    """A case whose start values are those of the truth."""
    return text.replace("start: 3 MPa", "start: 4 MPa").replace("start: 1e-9", "start: 2e-9")


def computed(path) -> dict[str, float]:
    """Moment to what S1 reads there at the start values."""
    path.write_text(truth_at_start(path.read_text()))
    model = build_model(load_inputs(str(path)))
    start = np.array([parameter.start for parameter in model.case.parameters])
    names = [stage.name for stage in model.case.stages]
    return dict(zip(names, model.computed(start)[0].tolist(), strict=True))


def dated(folder) -> str:
    rows = [
        "2024-01-01 00:00,0",
        *(
            f"{date(2024, 1, 1) + timedelta(int(d))} {'12:00' if d % 1 else '00:00'},{d}"
            for d in AT.values()
        ),
    ]
    (folder / "r.csv").write_text("\n".join(["date,S1 (mm)", *rows, ""]))
    return "dates: {fill: 2024-03-01}\nreadings: {file: r.csv, layout: wide}\n"


def by_time(folder) -> str:
    rows = ["fill,3,3", "fill,1.5,1.5", "fill,,60", "rest,20,80", "rest,140,200"]
    text = [
        "stage,time (d),gauge,value",
        *(f"{s},{t},S1,{v}" for s, t, v in (row.split(",") for row in rows)),
        "",
    ]
    (folder / "r.csv").write_text("\n".join(text))
    return "readings: {file: r.csv, unit: mm}\n"


def by_name(folder) -> str:
    rows = [f"S1,{name},{day},mm" for name, day in AT.items()]
    (folder / "r.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    return "readings: r.csv\n"


def inline(folder) -> str:
    return """readings:
  - {gauge: S1, stage: fill, time: 3 d, value: 3 mm}
  - {gauge: S1, stage: fill, time: 36 h, value: 1.5 mm}
  - {gauge: S1, stage: fill, value: 60 mm}
  - {gauge: S1, stage: rest + 20 d, value: 80 mm}
  - {gauge: S1, stage: rest, time: 140 d, value: 200 mm}
"""


@pytest.mark.parametrize("written", [dated, by_time, by_name, inline])
def test_readings_are_compared_at_their_own_time(tmp_path, written):
    path = write_column(tmp_path, stages=STAGES, more=written(tmp_path))
    case = load_inputs(str(path)).case
    places = {reading.stage: reading.value for reading in case.readings}
    assert places == {DAYS.get(name, name): 1e-3 * day for name, day in AT.items()}
    told = computed(path)
    for name, day in AT.items():
        expected = settlement(day * DAY)[0]
        assert told[DAYS.get(name, name)] == pytest.approx(expected, rel=4e-3)
    # without dates the clock begins with the first stage
    times = case.times
    begin = times[VIRGIN]
    assert [times[DAYS.get(name, name)] - begin for name in AT] == [d * DAY for d in AT.values()]


def test_a_stage_has_moments_for_pictures_unless_it_says_which(tmp_path):
    stages = f"""  - {{name: fill, {FILL}, lasts: 60 d}}
  - {{name: rest, lasts: 9 d, moments: [2 h, 3 d]}}"""
    case = load_inputs(str(write_column(tmp_path, stages=stages))).case
    at = [stage.at for stage in case.stages if stage.whole == "fill"]
    assert at == [*usual_moments(60 * DAY, water=True), 60 * DAY]
    assert 8 <= len(at) <= 12
    assert [stage.name for stage in case.stages][len(at) :] == ["rest + 2 h", "rest + 3 d", "rest"]

    # ground that only creeps moves evenly: there are no early moments, and fewer steps
    creeping = write_column(tmp_path, stages=f"  - {{name: fill, {FILL}, lasts: 60 d}}")
    text = creeping.read_text().replace("drained: {y1: {}}\n", "")
    text = text.replace(
        "k: {start: 1e-9 m/s, bounds: [1e-11, 1e-7 m/s]", "t: {start: 9 d, bounds: [1, 99 d]"
    )
    text = text.replace(
        "hydraulic: {permeability: $k, storage: 1e-9 1/kPa}", "creep: {share: 1, time: $t}"
    )
    creeping.write_text(text)
    case = load_inputs(str(creeping)).case
    assert [stage.at for stage in case.stages] == [*usual_moments(60 * DAY, water=False), 60 * DAY]
    assert 0.01 < case.stages[0].at / (60 * DAY) < 0.02


def test_zero_at_the_beginning_of_a_stage_and_within_it(tmp_path):
    """A gauge that begins with the second load reads what has been added since."""
    stages = f"""  - {{name: first, {FILL}, lasts: 30 d}}
  - {{name: second, loads: {{more: {{on: y1, pressure: 50 kPa}}}}, lasts: 60 d, moments: [20 d]}}"""
    path = write_column(tmp_path, stages=stages)
    path.write_text(
        path.read_text().replace(
            "gauges:\n",
            """gauges:
  S2: {kind: settlement, point: [0, 5 m], accuracy: 0.5 mm, zero: second + 0 d}
  S3: {kind: settlement, point: [0, 5 m], accuracy: 0.5 mm, zero: second + 480 h}
""",
        )
    )
    path.write_text(truth_at_start(path.read_text()))
    model = build_model(load_inputs(str(path)))
    start = np.array([parameter.start for parameter in model.case.parameters])
    table = model.computed(start)
    rows = {channel.name: table[k] for k, channel in enumerate(model.case.channels)}
    names = [stage.name for stage in model.case.stages]
    end, middle, begin = (names.index(n) for n in ("second", "second + 20 d", "second + 0 d"))
    at = [settlement((30 + t) * DAY)[0] + settlement(t * DAY, 50e3)[0] for t in (0, 20, 60)]
    assert rows["S1"][begin] == pytest.approx(at[0], rel=4e-3)
    assert rows["S2"][[middle, end]] == pytest.approx([at[1] - at[0], at[2] - at[0]], rel=5e-3)
    assert rows["S3"][end] == pytest.approx(at[2] - at[1], rel=1e-2)
    assert np.isnan(rows["S3"][begin])


def test_many_dates_stay_few_moments_and_lose_no_reading(tmp_path):
    """A logger that reads every hour for 90 days: states a hundredth of their time apart."""
    hours = np.arange(1, 24 * 90)
    begin = np.datetime64("2024-01-01T00:00")
    rows = [f"{begin + np.timedelta64(int(h), 'h')},1" for h in hours]
    (tmp_path / "r.csv").write_text("\n".join(["date,S1 (mm)", *rows, ""]))
    more = "dates: {virgin: 2024-01-01}\nreadings: {file: r.csv, layout: wide}\n"
    path = write_column(tmp_path, stages=f"  - {{name: fill, {FILL}, lasts: 90 d}}", more=more)
    case = load_inputs(str(path)).case
    assert len(case.readings) == len(hours)
    assert len(case.stages) < 450
    since = {stage.name: stage.at for stage in case.stages}
    for reading in case.readings:
        own = reading.time - begin.astype("datetime64[s]").astype(float)
        assert since[reading.stage] == pytest.approx(own, rel=0.0101)


def test_drift_counts_time_and_stages_not_moments(tmp_path):
    path = write_column(tmp_path, stages=STAGES, more="")
    path.write_text(
        truth_at_start(path.read_text()).replace(
            "gauges:\n",
            """gauges:
  D: {kind: settlement, point: [0, 5 m], accuracy: 0.5 mm, drift: 1 mm/day}
  P: {kind: settlement, point: [0, 5 m], accuracy: 0.5 mm, drift_per_stage: 1 mm}
  O: {kind: settlement, point: [0, 5 m], accuracy: 0.5 mm, offset: 1 mm, zero: fill + 5 d}
""",
        )
    )
    model = build_model(load_inputs(str(path)))
    start = np.array([parameter.start for parameter in model.case.parameters])
    rows = dict(zip((c.name for c in model.case.channels), model.computed(start), strict=True))
    names = [stage.name for stage in model.case.stages]
    early, end, last = names.index("fill + 10 d"), names.index("fill"), names.index("rest")
    added = {name: 1e3 * (rows[name] - rows["S1"]) for name in ("D", "P")}
    assert added["D"][[early, end, last]] == pytest.approx([10.0, 60.0, 200.0])
    assert added["P"][[early, end, last]] == pytest.approx([1.0, 1.0, 2.0])
    zero = rows["S1"][names.index("fill + 5 d")]
    assert rows["O"][early] == pytest.approx(rows["S1"][early] - zero + 1e-3)


def test_readings_are_used_up_to_a_moment_or_a_date(tmp_path):
    for until in ("fill + 3 d", "2024-01-04"):
        path = write_column(tmp_path, stages=STAGES, more=dated(tmp_path), fit=f", until: {until}")
        model = build_model(load_inputs(str(path)))
        table = select_readings(model.case, model)
        assert {s for s, used in zip(table.stage, table.used, strict=True) if used} == {
            "fill + 1.5 d", "fill + 3 d",
        }  # fmt: skip
        assert times_of(table, table.used)
    path = write_column(tmp_path, stages=STAGES, more=by_time(tmp_path), fit=", until: fill")
    model = build_model(load_inputs(str(path)))
    table = select_readings(model.case, model)
    assert sum(table.used) == 3
    assert Clock.of(model.case).dated  # horizons are times without dates, too


def test_fit_stages_and_bad_mean_all_moments(tmp_path):
    more = inline(tmp_path) + "bad: [{gauge: S1, stage: rest, reason: hit by a truck}]\n"
    path = write_column(tmp_path, stages=STAGES, more=more, fit=", stages: [fill]")
    model = build_model(load_inputs(str(path)))
    table = select_readings(model.case, model)
    used = {s for s, used in zip(table.stage, table.used, strict=True) if used}
    assert used == {"fill + 3 d", "fill + 1.5 d", "fill"}
    assert {s for s, bad in zip(table.stage, table.bad, strict=True) if bad} == {
        "rest + 20 d", "rest",
    }  # fmt: skip
