"""A seasonal model fitted to a dam of other physics, and readings held against it.

The dam of `support.service_dam` conducts heat through a slab, follows the level by a power that is
no whole number and creeps with the logarithm of time: nothing of it is a term of the model.
"""

import json

import h5py
import numpy as np
import pytest
from support.service_dam import GAUGES, YEAR, dam, write

from geoident import control
from geoident.errors import UsageError
from tests.support.commands import run_command

FIRST = np.datetime64("2010-01-01")


def run(command, *arguments, code=0):
    done = run_command(command, *map(str, arguments), "--json")
    assert done.exit_code == code, done.output
    return json.loads(done.stdout)


def controlled(sound, tmp_path, made, code):
    """What the fit of the sound dam says of the later readings of another."""
    new = later(made, tmp_path / "new.csv")
    out = tmp_path / "control.h5"
    return run("control", sound[0] / "dam.fit.h5", "--readings", new, "-o", out, code=code)


def later(made, path):
    """A file of the readings after those that are fitted."""
    rows = [
        f"{gauge},{FIRST + int(d)},{v:.3f},mm"
        for gauge, (read, y) in made.read.items()
        for d, v in zip(read, y, strict=True)
        if d > 6.0 * YEAR
    ]
    path.write_text("gauge,date,value,unit\n" + "\n".join(rows) + "\n")
    return path


def shown(said):
    """Changes that the result says: kind, gauges and sentence."""
    return [
        (f["subject"].split(", "), f["sentence"]) for f in said["findings"] if f["kind"] == "change"
    ]


def day(text):
    return (np.datetime64(text) - FIRST).astype(int)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A dam in which nothing changes, fitted."""
    folder = tmp_path_factory.mktemp("sound")
    made = dam(1)
    return folder, made, run("fit", write(folder, made))


def test_later_readings_lie_inside_their_bands(sound):
    folder, made, _ = sound
    with h5py.File(folder / "dam.fit.h5") as found:
        e = found["judged/innovation"][()]
    e = e[np.isfinite(e)]
    number = sum(int((read > 6.0 * YEAR).sum()) for read, _ in made.read.values())
    assert abs(len(e) - number) <= len(GAUGES)
    assert 0.90 <= np.mean(np.abs(e) < 1.96) <= 0.985
    assert np.std(e) == pytest.approx(1.0, abs=0.12)


def test_effects_are_of_the_size_of_their_causes(sound):
    """The range of what the level causes in the dam, gauge by gauge, within the interval."""
    folder, made, _ = sound
    fitted = made.days <= 6.0 * YEAR
    cause = ((made.level[fitted] - 70.0) / 55.0) ** 2.6
    with h5py.File(folder / "dam.fit.h5") as found:
        size, sd = found["seasonal/level"][()] * 1e3, found["seasonal/level_sd"][()] * 1e3
        explained = found["seasonal/explained"][()]
    truth = [(0.4 + 0.2 * n) * 6.0 * np.ptp(cause) for n in range(len(GAUGES))]
    assert np.all(np.abs(size - truth) < 4.0 * sd)
    assert np.all(explained > 0.9)


def test_a_gauge_that_drifts_is_named_with_its_rate_and_the_date(tmp_path, sound):
    change = {"P2": lambda t: np.where(t > 7.5 * YEAR, 1.2 * (t - 7.5 * YEAR) / YEAR, 0.0)}
    said = controlled(sound, tmp_path, dam(1, changes=change), 8)
    assert said["status"] == "amber"
    gauges, sentence = shown(said)[0]
    assert gauges == ["P2"]
    assert "drift of P2" in sentence
    assert "check this one" in sentence
    (row,) = (one for one in said["changes"] if one["gauge"] == "P2")
    assert row["size"] * 1e3 == pytest.approx(1.2, abs=3.0 * row["sd"] * 1e3)
    since = day(row["since"][:10])
    assert abs(since - 7.5 * YEAR) < 120.0


def test_a_structure_that_moves_otherwise_is_told_from_a_gauge(tmp_path, sound):
    """All gauges move by 0.25 to 1.25 mm at once, of an accuracy of 0.25 mm that lasts."""
    changes = {
        gauge: (lambda t, k=k: np.where(t > 7.5 * YEAR, 0.25 * k, 0.0))
        for k, gauge in enumerate(GAUGES, 1)
    }
    said = controlled(sound, tmp_path, dam(1, changes=changes), 8)
    assert said["status"] == "red"
    gauges, sentence = shown(said)[0]
    assert {"P4", "P5"} < set(gauges)
    assert "2017-07" in sentence
    rows = {one["gauge"]: one for one in said["changes"]}
    for k, gauge in enumerate(GAUGES, 1):
        if gauge in rows:
            assert rows[gauge]["size"] * 1e3 == pytest.approx(0.25 * k, abs=0.6)


def test_a_single_wrong_reading_is_no_change(tmp_path, sound):
    _, made, _ = sound
    read, y = made.read["P3"]
    wrong = y.copy()
    at = int(np.searchsorted(read, 8.0 * YEAR))
    wrong[at] += 5.0
    other = dam(1)
    other.read["P3"] = read, wrong
    said = controlled(sound, tmp_path, other, 0)
    assert said["status"] == "green"
    assert not shown(said)
    (finding,) = (f for f in said["findings"] if f["kind"] == "far-reading")
    assert finding["subject"] == "P3"
    assert str(FIRST + int(read[at])) in finding["sentence"]


def test_new_readings_in_a_file_of_their_own_are_judged_alike(tmp_path, sound):
    folder, made, _ = sound
    new = later(made, tmp_path / "new.csv")
    fit = folder / "dam.fit.h5"
    of_case = run_command("control", str(fit), "--json", "-o", str(tmp_path / "a.h5"))
    of_file = run_command(
        "control", str(fit), "--readings", str(new), "--json", "-o", str(tmp_path / "b.h5")
    )
    one, other = json.loads(of_case.stdout), json.loads(of_file.stdout)
    assert one["status"] == other["status"]
    assert one["reason"] == other["reason"]


def test_new_readings_are_laid_out_as_several_files_of_the_case(tmp_path):
    """Files of the case that are alike say how a further one is laid out; others do not."""
    made = dam(1, years=5.0)
    case = write(tmp_path, made, fitted_years=4.0)
    header, *rows = (tmp_path / "readings.csv").read_text().replace(",", ";").splitlines()
    for number, part in enumerate((rows[::2], rows[1::2])):
        old = [row for row in part if row.split(";")[1] < "2014-01-01"]
        (tmp_path / f"part{number}.csv").write_text("\n".join([header, *old]) + "\n")
    new = [row for row in rows if row.split(";")[1] >= "2014-01-01"]
    (tmp_path / "new.csv").write_text("\n".join([header, *new]) + "\n")
    alike = "[{file: part0.csv, delimiter: ';'}, {file: part1.csv, delimiter: ';'}]"
    case.write_text(case.read_text().replace("readings: readings.csv", f"readings: {alike}"))
    run("fit", case)
    fit, further = tmp_path / "dam.fit.h5", ("--readings", tmp_path / "new.csv")
    done = run_command("control", str(fit), *map(str, further), "--json")
    assert f"{len(new)} readings of 5 gauges" in json.loads(done.stdout)["reason"]
    (tmp_path / "part1.csv").write_text((tmp_path / "part1.csv").read_text().replace(";", ","))
    other = alike.replace("part1.csv, delimiter: ';'", "part1.csv, delimiter: ','")
    case.write_text(case.read_text().replace(alike, other))
    run("fit", case, "--force")
    done = run_command("control", str(fit), *map(str, further))
    assert done.exit_code == 3
    assert "laid out differently" in done.output
    assert "leave out --readings" in done.output.replace("`", "")


@pytest.mark.parametrize("command", ["scan", "backtest"])
def test_commands_that_need_parameters_refuse_a_seasonal_model(tmp_path, command):
    done = run_command(command, str(write(tmp_path, dam(1, years=3.0))))
    assert done.exit_code == 3
    assert "a seasonal model has coefficients of each gauge, and no parameters" in done.output
    assert "--set" not in done.output


@pytest.mark.parametrize(
    ("model", "missing"),
    [
        ("season: 2", "level"),
        ("level: 3\n  season: 2", "air"),
        ("level: 3\n  air: [3 d, 25 d]", "season"),
    ],
)
def test_each_effect_may_be_left_out(tmp_path, model, missing):
    """HST, HTT and a model of the season alone are fitted with the same keys."""
    made = dam(1, years=5.0)
    case = write(tmp_path, made, fitted_years=5.0, model=model)
    if "level" not in model:
        text = case.read_text().replace("loads:\n  level: {file: loads.csv}\n", "")
        case.write_text(text)
    run("fit", case)
    with h5py.File(tmp_path / "dam.fit.h5") as found:
        assert np.isnan(found[f"seasonal/{missing}"][()]).all()
        assert np.isfinite(found["seasonal/white"][()]).all()


def test_python_gives_the_state_the_changes_and_a_frame(tmp_path, sound):
    folder, made, _ = sound
    found = control(folder / "dam.fit.h5", output=tmp_path / "python.h5")
    assert found.state in ("green", "amber", "red")
    assert found.state == found.status
    frame = found.to_frame()
    assert set(frame["gauge"]) == set(GAUGES)
    assert len(frame) == sum(int((read > 6.0 * YEAR).sum()) for read, _ in made.read.values())
    with pytest.raises(UsageError, match="1 per 10 years"):
        control(folder / "dam.fit.h5", false_alarms="seldom")
